"""What several test files share."""

from __future__ import annotations

from pathlib import Path

import pytest
import room

from pflut.datasets import Dataset, load_folder
from pflut.features import FeatureCache
from pflut.likelihood.table import LikelihoodTable


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
    return FeatureCache(tmp_path_factory.mktemp("features"))
