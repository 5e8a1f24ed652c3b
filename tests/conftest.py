"""What several test files share."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import room

from pflut.datasets import Dataset, load_folder
from pflut.datasets.simulated_home import RENDERER_VERSION
from pflut.features import FeatureCache
from pflut.likelihood.table import LikelihoodTable, default_description


@pytest.fixture(scope="session")
def default_table() -> LikelihoodTable:
    """The 128-bin table, from the user's cache: learned there by the first run of all."""
    return LikelihoodTable.default()


@pytest.fixture(scope="session")
def small_table() -> LikelihoodTable:
    """A 32-bin table for what needs no accuracy."""
    return LikelihoodTable.from_simulation(bins=32, num_samples=2_000_000, seed=3)


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
    small_table: LikelihoodTable,
) -> Path:
    """A user's cache folder: the simulated homes 0 to 2 are the room, the tables are small."""
    cache = room_cache.folder.parent
    for seed in range(3):
        name = f"v{RENDERER_VERSION}-seed{seed}-people0-blur0"
        shutil.copytree(room_folder, cache / "simulated-home" / name)
    for bins in (32, 128):
        # the small table's cells, as many as the default table has
        cells = small_table.log_ratio
        for axis in range(3):
            cells = cells.repeat(bins // 32, axis=axis)
        LikelihoodTable(cells, default_description(bins)).save(cache / f"table-{bins}.npz")
    return cache
