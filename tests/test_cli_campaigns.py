"""``pflut simulate`` and ``pflut compare``: what they print and write, and wrong input."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import command_line
import pytest
from command_line import Outcome, Run

from pflut.campaign import drives
from pflut.cli.progress import Bars
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.table import LikelihoodTable

pytestmark = pytest.mark.usefixtures("own_folder")
QUICK = ("--filter", "odometry", "--jobs", 1, "--max-images", 2, "--bins", 32, "--no-figures")


def refused(outcome: Outcome, *words: str) -> None:
    """Check that bad input ended in one line, and printed nothing before it."""
    assert outcome.out == ""
    command_line.refused(outcome, *words)


def rows(outcome: Outcome) -> list[list[str]]:
    """Give the words of the table's lines."""
    assert outcome.code == 0 and outcome.err == ""
    lines = outcome.out.splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("scenario"))
    last = next(k for k, line in enumerate(lines) if line.startswith("converged within"))
    return [line.split() for line in lines[first + 1 : last]]


# --- simulate ----------------------------------------------------------------------------------


def test_simulate_sums_up_and_goes_on(run: Run) -> None:
    wanted = ("--bins", 32, "--particles", 1000, "--max-images", 3, "--jobs", 1, "--output", "out")
    outcome = run("simulate", "--scenario", "tracking", "--seeds", 2, *wanted)
    (row,) = rows(outcome)
    assert row[:7] == ["tracking", "pflut", "2", "100.0", "(34", "to", "100)"] and row[7] == "-"
    assert outcome.out.endswith("results: out\n")
    out = Path("out")
    first = (out / "tracking/pflut/seed_0.json").read_bytes()
    more = ("--scenario", "tracking,kidnapped", "--filter", "pflut,odometry")
    outcome = run("simulate", *more, "--seeds", "0..2", *wanted)
    assert [row[:3] for row in rows(outcome)] == [
        ["tracking", "pflut", "3"],
        ["tracking", "odometry", "3"],
        ["kidnapped", "pflut", "3"],
        ["kidnapped", "odometry", "3"],
    ]
    assert (out / "tracking/pflut/seed_0.json").read_bytes() == first
    metrics = json.loads((out / "metrics.json").read_text())
    assert [group["drives"] for group in metrics["groups"]] == [3] * 4
    assert set(metrics["calibration"]) == {
        f"{scenario}/{name}" for scenario in ("tracking", "kidnapped")
        for name in ("pflut", "odometry")
    }  # fmt: skip
    record = json.loads((out / "run.json").read_text())
    assert record["world"] == "landmarks" and record["table"]["bins"] == 32
    assert {path.name for path in (out / "figures").iterdir()} == {
        "tracking.png",
        "kidnapped.png",
        "errors.png",
        "confidence.png",
    }
    refused(run("simulate", *wanted, "--temperature", "0.9"), "out: ", "another temperature")


def test_simulate_with_rendered_homes(run: Run) -> None:
    outcome = run("simulate", "--world", "rendered", "--scenario", "tracking,sparse", "--seeds", 1,
                  "--particles", 1000, "--max-images", 2, "--bins", 32, "--jobs", 1,
                  "--no-figures")  # fmt: skip
    tracking, sparse = rows(outcome)
    assert tracking[:4] == ["tracking", "pflut", "1", "100.0"]
    assert sparse[:3] == ["sparse", "pflut", "1"]
    (folder,) = Path("results").iterdir()
    assert folder.name.endswith("_simulate") and not (folder / "figures").exists()


def test_all_are_all_of_the_world(run: Run) -> None:
    assert len(rows(run("simulate", "--scenario", "all", "--seeds", 1, *QUICK))) == 9


def test_simulate_goes_on_with_the_same_table_only(
    run: Run, small_table: LikelihoodTable, small_dense_table: DenseTable
) -> None:
    wanted = ("simulate", "--seeds", 1, "--max-images", 1, "--no-figures", "--output", "out")
    small_dense_table.save("table.npz")
    assert run(*wanted, "--table", "table.npz").code == 0
    record = json.loads(Path("out/run.json").read_text())
    assert record["table"]["learned_from"] == small_dense_table.learned_from
    assert run(*wanted, "--table", "table.npz").code == 0
    refused(run(*wanted), "out: holds drives with another table, expected a new folder")
    small_table.save("table.npz")  # another one by the same name
    refused(run(*wanted, "--table", "table.npz"), "another table")
    refused(run(*wanted, "--table", "nothere.npz"), "nothere.npz: No such file")
    small_dense_table.save("table.npz")
    refused(run(*wanted, "--table", "table.npz", "--filter", "ekf-ml"), "ekf-ml expects")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--scenario", "easy"), "argument --scenario: expected one of tracking, global"),
        (("--scenario", "all,global"), "argument --scenario: expected names, or all"),
        (("--scenario", ","), "argument --scenario: expected names, or all"),
        (("--filter", "pflut,best"), "argument --filter: expected one of pflut, paper"),
        (("--world", "rendered", "--scenario", "dark"),
         "argument --scenario: expected one of tracking, global, kidnapped, crowded, sparse, "
         "odometry (rendered), got 'dark'"),
        (("--motion-blur", "0.03"), "argument --motion-blur: expected rendered homes"),
        (("--motion-blur", "-1"), "argument --motion-blur: expected seconds in [0, 1)"),
        (("--seeds", "0"), "expected a number or A..B"),
        (("--seeds", "5..3"), "expected a number or A..B"),
        (("--seeds=-1..3",), "expected a number or A..B"),
        (("--seeds", "many"), "expected a number or A..B"),
        (("--seeds", "1..2..3"), "expected a number or A..B"),
        (("--people", "3"), "unrecognized arguments: --people"),
    ],
)  # fmt: skip
def test_simulate_refuses_what_is_not_there(
    run: Run, options: tuple[str, ...], message: str
) -> None:
    outcome = run("simulate", *options)
    assert outcome.code == 2 and message in " ".join(outcome.err.split())
    assert outcome.err.startswith("usage: pflut simulate") and not Path("results").exists()


def test_simulate_takes_no_foreign_folder(run: Run) -> None:
    Path("out").mkdir()
    Path("out/precious").touch()
    refused(run("simulate", "--output", "out"), "out: holds something already")
    Path("out/settings.json").write_text("?")
    refused(run("simulate", "--output", "out"), "out/settings.json: not a JSON file")
    assert Path("out/precious").is_file()


def test_simulate_names_a_damaged_file(run: Run) -> None:
    wanted = ("simulate", "--seeds", 2, *QUICK, "--output", "out")
    assert run(*wanted).code == 0
    Path("out/global/odometry/seed_1.json").write_text('{"seed": 1}')
    refused(run(*wanted), "out/global/odometry/seed_1.json: expected a drive's outcome")


def test_interrupted_simulate_counts_the_drives_that_are_kept(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A drive may be done, its file written, and not handed on yet."""

    def some(_: object, seeds: range, folder: Path, **__: object) -> Iterator[None]:
        (folder / "global/pflut").mkdir(parents=True)
        (folder / "global/pflut/seed_0.json").touch()
        try:
            yield None
        finally:  # what another process had at hand when it was stopped
            (folder / "global/pflut/seed_2.json").touch()

    def stop(_: Bars, stage: str, done: int, total: int) -> None:
        if stage == "drives" and done == 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(drives, "run_campaign", some)
    monkeypatch.setattr(Bars, "__call__", stop)
    outcome = run("simulate", "--seeds", 4, "--bins", 32, "--output", "out")
    assert outcome.code == 130 and outcome.out == ""
    assert outcome.err.strip() == (
        "pflut: interrupted: 2 of 4 drives are kept in out; the same command with --output out "
        "goes on"
    )


# --- compare -----------------------------------------------------------------------------------


@pytest.fixture
def simulated(run: Run) -> Callable[..., Path]:
    """Make a campaign's folder."""

    def make(name: str, *options: object) -> Path:
        assert run("simulate", *QUICK, "--home-seed", 0, *options, "--output", name).code == 0
        return Path(name)

    return make


def test_compare_prints_the_drives_that_all_runs_share(
    run: Run, simulated: Callable[..., Path]
) -> None:
    simulated("a", "--seeds", 3, "--scenario", "tracking,global")
    simulated("b", "--seeds", "1..4", "--scenario", "tracking", "--translation-noise-from-rotation",
              "0.1")  # fmt: skip
    outcome = run("compare", "a", "b")
    table = rows(outcome)
    assert [row[:3] + row[-1:] for row in table] == [
        ["global", "odometry", "3", "a"],  # the other run has no such drives
        ["tracking", "odometry", "2", "a"],
        ["tracking", "odometry", "2", "b"],
    ]
    # drives 1 and 2 of both, and not 0 of the first: the table is that of the shared ones
    Path("a/tracking/odometry/seed_0.json").unlink()
    assert rows(run("compare", "a", "b"))[1] == table[1]
    assert rows(run("compare", "a"))[1] == table[1][:-1]


def test_compare_draws_and_counts_as_it_is_told(run: Run, simulated: Callable[..., Path]) -> None:
    folder = simulated("a", "--seeds", 1, "--scenario", "tracking")
    path = folder / "tracking/odometry/seed_0.json"
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"position_m": [2.0, 0.1]}))  # converges at the second
    outcome = run("compare", folder, "--within", 1, "--recovered-within", 7, "--figure", "c.png")
    assert rows(outcome)[0][3] == "0.0" and outcome.out.endswith("figure: c.png\n")
    assert "within 1 images and recovered within 7" in outcome.out
    assert Path("c.png").read_bytes().startswith(b"\x89PNG")
    assert rows(run("compare", folder, "--within", 2))[0][3] == "100.0"


def test_compare_keeps_runs_of_one_name_apart(run: Run, simulated: Callable[..., Path]) -> None:
    folders = [simulated(f"{name}/run", "--seeds", 1) for name in ("one", "other")]
    assert [row[-1] for row in rows(run("compare", *folders, folders[0]))] == [
        "one/run",
        "other/run",
    ]


def test_compare_leaves_out_scenarios_without_drives_in_common(
    run: Run, simulated: Callable[..., Path]
) -> None:
    simulated("a", "--seeds", 1, "--scenario", "tracking,global")
    simulated("b", "--seeds", 1, "--scenario", "tracking")
    simulated("b", "--seeds", "5..6", "--scenario", "global")
    outcome = run("compare", "a", "b")
    assert {row[0] for row in rows(outcome)} == {"tracking"}
    assert outcome.out.startswith("global: left out, no drive is in all runs\n")
    shutil.rmtree("b/tracking")
    shutil.rmtree("a/tracking")
    refused(run("compare", "a", "b"), "no drive is in all of them, expected seeds in common")


@pytest.mark.parametrize(
    ("options", "name"),
    [(("--home-seed", 1), "home_seed"), (("--max-images", 1), "max_images"),
     (("--world", "rendered"), "world")],
)  # fmt: skip
def test_compare_refuses_other_drives(
    run: Run, simulated: Callable[..., Path], options: tuple[Any, ...], name: str
) -> None:
    simulated("a", "--seeds", 1)
    simulated("b", "--seeds", 1, *options)
    refused(run("compare", "a", "b"), f"b: drives with another {name} than in a")


def test_compare_refuses_what_is_no_campaign(run: Run, simulated: Callable[..., Path]) -> None:
    folder = simulated("a", "--seeds", 1)
    refused(run("compare", "nothere"), "nothere: expected a folder of pflut simulate")
    Path("empty").mkdir()
    refused(run("compare", folder, "empty"), "empty: expected a folder of pflut simulate")
    refused(run("compare", folder, "--figure", "c.xyz"), "c.xyz: no format for figures")
    refused(run("compare", folder, "--figure", "no/c.png"), "no/c.png: its folder does not exist")
    (folder / "global/odometry/seed_0.json").write_text("{")
    refused(run("compare", folder), "seed_0.json: not a JSON file")
    (folder / "global/odometry/seed_0.json").unlink()
    refused(run("compare", folder), "a: no drive is done yet")
    assert run("compare").code == 2
