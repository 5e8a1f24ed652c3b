"""What several test files share."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import room
from command_line import Outcome, Run

from pflut.cli import main
from pflut.datasets import Dataset, load_folder
from pflut.datasets.simulated_home import RENDERER_VERSION
from pflut.features import FeatureCache
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.table import LikelihoodTable


@pytest.fixture(scope="session")
def default_table() -> LikelihoodTable:
    """The table that comes with pflut."""
    return LikelihoodTable.default()


@pytest.fixture(scope="session")
def small_table() -> LikelihoodTable:
    """The same with small grids, for what needs no accuracy."""
    return LikelihoodTable.default(bins=32)


@pytest.fixture(scope="session")
def dense_table() -> DenseTable:
    """The paper's table of 128 bins, from the user's cache: learned there by the first run."""
    return DenseTable.default()


@pytest.fixture(scope="session")
def small_dense_table() -> DenseTable:
    """The paper's table of 32 bins, for what needs no accuracy."""
    return DenseTable.from_simulation(bins=32, num_samples=2_000_000, seed=3)


@pytest.fixture(scope="session")
def room_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder dataset of a small rendered room; not to be changed."""
    return room.write_room(tmp_path_factory.mktemp("data") / "room")


@pytest.fixture(scope="session")
def room_dataset(room_folder: Path) -> Dataset:
    """The room as a dataset."""
    return load_folder(room_folder)


@pytest.fixture(scope="session")
def room_cache(tmp_path_factory: pytest.TempPathFactory) -> FeatureCache:
    """A cache of the room's features that the tests share."""
    return FeatureCache(tmp_path_factory.mktemp("cache") / "features")


@pytest.fixture(scope="session")
def room_home_cache(
    tmp_path_factory: pytest.TempPathFactory,
    room_folder: Path,
    room_cache: FeatureCache,
) -> Path:
    """A user's cache folder: the simulated homes 0 to 2 are the room."""
    cache = room_cache.folder.parent
    for seed in range(3):
        name = f"v{RENDERER_VERSION}-seed{seed}-people0-blur0"
        shutil.copytree(room_folder, cache / "simulated-home" / name)
    return cache


@pytest.fixture
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room_home_cache: Path) -> None:
    """No test writes into the working directory or the user's cache."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PFLUT_CACHE", str(room_home_cache))


@pytest.fixture
def run(capfd: pytest.CaptureFixture[str]) -> Run:
    """Run the command line in this process."""

    def call(*arguments: object) -> Outcome:
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as stop:  # argparse
            code = int(stop.code or 0)
        return Outcome(code, *capfd.readouterr())

    return call
