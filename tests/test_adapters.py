"""The page on the sensor model in other filters is run, and each of them finds the robot."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pflut.geometry import wrap_to_pi

PAGE = (Path(__file__).parents[1] / "docs" / "sensor-model.md").read_text(encoding="utf-8")
BLOCKS = {
    section.partition("\n")[0]: block
    for section in re.split(r"^## ", PAGE, flags=re.MULTILINE)
    for block in re.findall(r"^```python\n(.*?)^```", section, re.DOTALL | re.MULTILINE)
}
SETUP = "A room to try it in"
FLATTENING = "Who flattens?"
# a section's filter, and the package that it needs
FILTERS = {
    SETUP: ("pflut_filter", "pflut"),
    "Plain NumPy": ("numpy_filter", "numpy"),
    "pfilter": ("pfilter_filter", "pfilter"),
    "particles": ("particles_filter", "particles"),
    "Stone-Soup": ("stonesoup_filter", "stonesoup"),
}
SEEDS = (10, 11, 12)


@pytest.fixture
def names() -> dict[str, Any]:
    """What the first block defines."""
    names: dict[str, Any] = {"__name__": "page"}
    exec(BLOCKS[SETUP].replace("\nreport(", "\n# report("), names)
    return names


def errors(names: dict[str, Any], localize: Any, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors in metres and radians at each image of a drive."""
    sensor, truth, steps = names["room"](seed)
    off = np.array(list(localize(sensor, steps, seed))) - truth
    return np.hypot(off[:, 0], off[:, 1]), np.abs(wrap_to_pi(off[:, 2]))


@pytest.mark.parametrize("title", FILTERS)
def test_filter_finds_the_robot_as_well_as_pfluts_own(
    title: str, names: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    function, package = FILTERS[title]
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    exec(BLOCKS[title], names)
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == 3
    assert all(re.fullmatch(rf"{function} +0\.0\d\d m +\d+\.\d ms", line) for line in printed)

    found, own = [], []
    for seed in SEEDS:
        distance, turn = errors(names, names[function], seed)
        assert distance[-1] < 0.1
        assert turn[-1] < np.radians(3.0)
        found.append(distance[-3:].mean())
        own.append(errors(names, names["pflut_filter"], seed)[0][-3:].mean())
    assert np.mean(found) < np.mean(own) + 0.02


def test_filters_start_lost(names: dict[str, Any]) -> None:
    """Odometry alone finds nothing: the sensor model is what localizes."""

    class Blind:
        def log_likelihood(self, poses: np.ndarray, matches: object) -> np.ndarray:
            return np.zeros(len(poses))

    for seed in SEEDS:
        _, truth, steps = names["room"](seed)
        poses = np.array(list(names["pflut_filter"](Blind(), steps, seed)))
        assert np.hypot(*(poses[-1] - truth[-1])[:2]) > 0.5


def test_flat_leaves_the_share_of_particles(names: dict[str, Any]) -> None:
    exec(BLOCKS[FLATTENING], names)
    sharp = -0.5 * np.linspace(-50.0, 50.0, 1000) ** 2
    weights = np.exp(names["flat"](sharp, 0.2))
    effective = weights.sum() ** 2 / (weights**2).sum()
    assert effective == pytest.approx(200.0, rel=0.02)
    assert (names["flat"](0.01 * sharp[480:520]) == 0.01 * sharp[480:520]).all()


def test_every_block_is_run() -> None:
    assert PAGE.count("```python\n") == len(BLOCKS)
    assert set(BLOCKS) == {*FILTERS, FLATTENING}
