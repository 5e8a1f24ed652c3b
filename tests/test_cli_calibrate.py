"""``pflut lut calibrate``: what it prints and draws, and wrong input."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pflut.cli import main

SMALL = ("lut", "calibrate", "--simulate", "60", "--correspondences", "30", "--bins", "32")
pytestmark = pytest.mark.usefixtures("own_folder")


def test_simulated_pairs(capfd: pytest.CaptureFixture[str]) -> None:
    assert main([*SMALL, "--mismatch", "0.5", "--figure", "curve.png"]) == 0
    out, err = capfd.readouterr()
    assert err == ""
    assert out.startswith(
        "60 simulated pairs of 30 correspondences, 50 % mismatches; table default, 32 bins\n"
    )
    temperature = re.search(r"^temperature (0\.\d{3}), fitted on 30 pairs", out, re.MULTILINE)
    assert temperature is not None and 0.02 < float(temperature[1]) < 1.0
    rows = re.findall(
        r"^(0\.\d+) +([\d.]+) \(([\d.]+) to ([\d.]+)\) +([\d.]+) \(", out, re.MULTILINE
    )
    assert [float(row[0]) for row in rows] == [0.5, 0.8, 0.95, 0.99]
    for row in rows:
        low, rate, high = (float(row[i]) for i in (2, 1, 3))
        assert low < rate <= high
    assert re.search(r"^log score +-?\d+\.\d{3} +-?\d+\.\d{3}$", out, re.MULTILINE)
    assert out.endswith("figure: curve.png\n")
    assert Path("curve.png").read_bytes().startswith(b"\x89PNG")
    main([*SMALL, "--mismatch", "0.5", "--figure", "again.png"])
    assert capfd.readouterr().out == out.replace("curve", "again")
    main([*SMALL, "--mismatch", "0.5", "--seed", "1"])
    assert capfd.readouterr().out.splitlines()[-2] != out.splitlines()[-3]


def test_a_dataset(capfd: pytest.CaptureFixture[str], room_folder: Path) -> None:
    command = ["lut", "calibrate", str(room_folder), "--bins", "32", "--max-distance", "0.8"]
    assert main(command) == 0
    out, err = capfd.readouterr()
    found = re.match(r"room, (\d+) pairs within 0\.8 m; table default, 32 bins\n", out)
    assert err == "" and found is not None
    fitted = re.search(r"fitted on (\d+) pairs", out)
    assert fitted is not None and int(fitted[1]) == -(-int(found[1]) // 2)
    # other references make other pairs, and the simulated home (the room, here) needs no name
    assert main([*command, "--references", "every:2"]) == 0
    other = capfd.readouterr().out
    assert other.splitlines()[0] != out.splitlines()[0]
    assert main(["lut", "calibrate", "--bins", "32", "--max-distance", "0.8"]) == 0
    assert capfd.readouterr().out == out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["drive/"], "drive/: no such dataset"),
        (["--simulate", "1"], "to fit and to check takes two pairs, got 1"),
        (["--simulate", "9", "--mismatch", "2"], "mismatch: expected a share in [0, 1], got 2.0"),
        (["--simulate", "9", "--bins", "2"], "bins: expected 4 to 1024, got 2"),
        (["--simulate", "9", "--table", "none.npz"], "none.npz"),
        (["--simulate", "9", "--figure", "curve.txt"], "curve.txt: no format for figures"),
        (["--simulate", "9", "--figure", "no/curve.png"], "its folder does not exist"),
        (["--max-distance", "0.01"], "no reference and query with true poses 0 to 0.01 m apart"),
    ],
)
def test_bad_input_ends_in_one_line(
    arguments: list[str], words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["lut", "calibrate", *arguments]) == 1
    out, err = capfd.readouterr()
    assert out == "" and len(err.splitlines()) == 1
    assert err.startswith("pflut: error: ") and words in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--mismatch", "0.5"], "argument --mismatch: only allowed with argument --simulate"),
        (["--simulate", "9", "drive/"], "argument DATASET: not allowed with argument --simulate"),
        (["--simulate", "9", "--references", "all"], "--references: not allowed with argument"),
        (["--simulate", "0"], "expected at least 1, got 0"),
    ],
)
def test_wrong_usage(arguments: list[str], words: str, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["lut", "calibrate", *arguments])
    assert stopped.value.code == 2
    err = capfd.readouterr().err
    assert err.startswith("usage: pflut lut calibrate") and words in err
