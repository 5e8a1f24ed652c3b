"""The README is run: its Python, and its commands as they stand there."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest

from pflut.cli import main
from pflut.datasets import Dataset

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PYTHON = re.findall(r"^```python\n(.*?)^```", README, re.DOTALL | re.MULTILINE)
CONSOLE = re.findall(r"^```console\n(.*?)^```", README, re.DOTALL | re.MULTILINE)
COMMANDS = re.findall(r"^\$ (.*)$", "".join(CONSOLE), re.MULTILINE)

# what a test cannot run in its own environment; .ci/run does
INSTALLING = [
    "python -m pip install .",
    "python -m venv .venv",
    ". .venv/bin/activate",
    "python -m pip install -e '.[dev]'",
    "python -m pytest",
]


@pytest.fixture
def user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room_home_cache: Path) -> Path:
    """A user's working folder; for the simulated home stands a small room, rendered before."""
    monkeypatch.setenv("PFLUT_CACHE", str(room_home_cache))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def drive(user: Path, room_dataset: Dataset, room_folder: Path) -> Path:
    """The folder ``drive`` as the README lays it out: stamps are the images' names."""
    folder = user / "drive"
    (folder / "images").mkdir(parents=True)
    names = [f"{stamp:.2f}.jpg" for stamp in room_dataset.stamps]
    for i, name in enumerate(names):
        assert cv2.imwrite(str(folder / "images" / name), room_dataset.image(i))
    for name in ("camera.toml", "groundtruth.tum", "odometry.tum"):
        (folder / name).write_bytes((room_folder / name).read_bytes())
    listed = "\n".join(names[i] for i in room_dataset.reference_indices)
    (folder / "references.txt").write_text(listed)
    return folder


def run(command: str, *more: str) -> None:
    """Run a command of the README; ``more`` makes it shorter."""
    assert command in COMMANDS
    program, *arguments = shlex.split(command)
    assert program == "pflut"
    assert main([*arguments, *more]) == 0


def labels(printed: str) -> set[str]:
    """Give the names of the rows of a replay's tables."""
    return {line[:32].strip() for line in printed.splitlines() if line.startswith("  ")}


def test_python_example_localizes_the_robot(user: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, object] = {}
    exec(PYTHON[0], names)
    home, step = names["home"], names["step"]
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(home.query_indices)
    assert lines[-1].startswith(f"{step.estimate.pose[0]:6.2f} m")
    assert np.hypot(*(step.estimate.pose - step.ground_truth)[:2]) < 0.3
    # the shorter examples go on from there
    references = home.reference_indices
    names["images"] = [home.image(int(i)) for i in references]
    names["poses"] = home.ground_truth[references]
    names["particles"] = np.tile(step.ground_truth, (7, 1))
    names["log_weights"] = np.zeros(7)
    names["image"] = home.image(step.index)
    exec(PYTHON[1], names)
    assert (names["log_weights"] > 0.0).all()
    names["image_a"], names["image_b"] = home.image(step.index - 2), names["image"]
    exec(PYTHON[2], names)
    assert names["pose"].success
    assert len(PYTHON) == 3


def test_replay_prints_what_the_readme_shows(
    user: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run("pflut replay")
    printed = capsys.readouterr().out
    shown = re.search(r"^```text\n(Simulated home.*?)^```", README, re.DOTALL | re.MULTILINE)
    assert shown is not None
    assert labels(shown[1]) == labels(printed)
    (results,) = (user / "results").iterdir()
    assert {"poses.tum", "groundtruth.tum", "steps.csv", "metrics.json", "run.json", "figures"} <= {
        path.name for path in results.iterdir()
    }


def test_own_data(drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("pflut dataset info drive/ --check")
    assert "24, all decode" in capsys.readouterr().out
    run("pflut replay drive/", "--max-images", "3", "--no-figures")
    run("pflut replay drive/ --start=-1.5,2,90", "--max-images", "2", "--no-figures")
    assert "started at -1.5, 2, 90 deg" in capsys.readouterr().out


def test_relative_pose(
    user: Path, room_dataset: Dataset, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, index in (("a.png", 16), ("b.png", 18)):
        assert cv2.imwrite(name, room_dataset.image(index))
    room_dataset.camera.save("camera.toml")
    run("pflut relpose a.png b.png --camera camera.toml")
    assert re.search(r"^success +yes$", capsys.readouterr().out, re.MULTILINE)


def test_every_command_is_run_here_or_by_ci() -> None:
    here = re.findall(r'^    run\("(.*?)"', Path(__file__).read_text(), re.MULTILINE)
    assert sorted(COMMANDS) == sorted([*here, *INSTALLING])
    ci = (ROOT / ".ci" / "run").read_text()
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o111
    for needed in ("-m venv", "-e '.[dev]'", "python -m pytest", "ruff check", "mypy"):
        assert needed in ci
