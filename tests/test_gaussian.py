"""A Gaussian pose: its root, and its mass near the mean against the exact answer."""

import math

import numpy as np
import pytest

from pflut.localization.gaussian import as_gaussian, mass_nearby, square_root


@pytest.mark.parametrize("std", [0.05, 0.2, 0.5, 2.0])
@pytest.mark.parametrize("heading", [0.02, 0.2, 1.0])
def test_mass_nearby_is_the_exact_one(std, heading):
    """A round Gaussian's: Rayleigh's distribution times the error function."""
    here = 1 - math.exp(-0.5 * (0.5 / std) ** 2)
    here *= math.erf(math.radians(10.0) / (heading * math.sqrt(2)))
    assert mass_nearby(np.diag([std**2, std**2, heading**2])) == pytest.approx(here, abs=0.005)


def test_mass_nearby_of_a_correlated_one_and_of_none():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3)) * [0.3, 0.3, 0.15]
    draws = rng.standard_normal((1_000_000, 3)) @ root
    near = (np.hypot(draws[:, 0], draws[:, 1]) < 0.5) & (np.abs(draws[:, 2]) < np.radians(10))
    assert mass_nearby(root.T @ root) == pytest.approx(near.mean(), abs=0.005)
    assert mass_nearby(np.zeros((3, 3))) == 1.0


def test_square_root_of_singular_matrices_too():
    rng = np.random.default_rng(1)
    for rank in (1, 2, 3):
        rows = rng.normal(size=(rank, 3))
        root = square_root(rows.T @ rows)
        np.testing.assert_allclose(root.T @ root, rows.T @ rows, atol=1e-12)


def test_as_gaussian_gives_arrays():
    mean, covariance = as_gaussian([1, 2, 3], np.eye(3).tolist())
    assert mean.shape == (3,) and mean.dtype == covariance.dtype == np.float64
    with pytest.raises(ValueError, match="symmetric"):
        as_gaussian([0, 0, 0], [[1, 1, 0], [0, 1, 0], [0, 0, 1]])
