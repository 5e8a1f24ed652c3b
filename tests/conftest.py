"""What several test files share."""

from __future__ import annotations

import pytest

from pflut.likelihood.table import LikelihoodTable


@pytest.fixture(scope="session")
def default_table() -> LikelihoodTable:
    """The 128-bin table, from the user's cache: learned there by the first run of all."""
    return LikelihoodTable.default()


@pytest.fixture(scope="session")
def small_table() -> LikelihoodTable:
    """A 32-bin table for what needs no accuracy."""
    return LikelihoodTable.from_simulation(bins=32, num_samples=2_000_000, seed=3)
