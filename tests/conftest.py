"""What several test files share."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import room
from along_a_line import seen_along_a_line, start_alone
from command_line import Outcome, Run

from pflut.cli import main
from pflut.datasets import Dataset, load_folder
from pflut.datasets.simulated_home import RENDERER_VERSION
from pflut.features import FeatureCache, Features
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.all_pairs import all_pairs
from pflut.mapping.link_model import LinkModel
from pflut.mapping.links import Links
from pflut.mapping.pair_linker import LinkOptions, PairLinker


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


@pytest.fixture(scope="session")
def features() -> list[Features]:
    """Of images along a line through a room."""
    return seen_along_a_line()


@pytest.fixture
def link(features: list[Features], small_table: LikelihoodTable) -> Callable[..., Links]:
    """Link them in small batches."""

    def call(folder: Path, table: Any = small_table, **options: Any) -> Links:
        return all_pairs(
            options.pop("features", features), folder, table, **{"batch_size": 8, **options}
        )

    return call


@pytest.fixture
def whole(link: Callable[..., Links], tmp_path: Path) -> bytes:
    """The file of a run in this process that nothing interrupted."""
    link(tmp_path / "whole")
    return (tmp_path / "whole" / "links.npz").read_bytes()


@pytest.fixture(scope="session")
def anywhere(
    features: list[Features], small_table: LikelihoodTable, tmp_path_factory: pytest.TempPathFactory
) -> bytes:
    """The same by a process of its own, which reads the kernels that this one has compiled."""
    linker = PairLinker(
        table=small_table, options=LinkOptions(), link_model=LinkModel.default("panorama")
    )
    linker.warm_up()
    folder = tmp_path_factory.mktemp("anywhere") / "run"
    process = start_alone(folder, 1, 8)
    assert process.communicate()[1] == "" and process.returncode == 0
    return (folder / "links.npz").read_bytes()


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
