"""KLD sampling against its equation, a plain count of cells, and what it promises."""

from __future__ import annotations

from statistics import NormalDist

import naive
import numpy as np
import pytest

from pflut.localization.motion import DifferentialDrive
from pflut.localization.particle_filter import ParticleFilter
from pflut.localization.sample_size import KLDSampling


def spread(width: float, n: int = 20_000, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.5, 0.5, (n, 3)) * [width, width, min(width, 2 * np.pi)]


@pytest.mark.parametrize("occupied", [1, 2, 3, 10, 100, 1000])
def test_bound_is_that_of_the_paper(occupied: int) -> None:
    kld = KLDSampling(min_particles=1, max_particles=10**6)
    exact = naive.kld_bound(occupied, 0.05, NormalDist().inv_cdf(0.99))
    assert kld.bound(occupied) == max(1, int(np.ceil(exact)))


def test_bound_is_the_chi_square_quantile() -> None:
    """n = chi2 / (2 error): the quantile by simulation, 50 occupied cells."""
    draws = np.random.default_rng(0).chisquare(49, 400_000)
    wanted = np.quantile(draws, 0.99) / (2 * 0.05)
    kld = KLDSampling(min_particles=1, max_particles=10**6)
    assert kld.bound(50) == pytest.approx(wanted, rel=0.01)


@pytest.mark.parametrize("width", [0.01, 0.8, 2.0, 5.0, 40.0])
def test_counts_what_its_naive_twin_counts(width: float) -> None:
    poses = spread(width)
    weights = np.random.default_rng(1).random(len(poses))
    kld = KLDSampling(min_particles=50, max_particles=3000)
    assert kld.sample_size(poses, weights) == naive.kld_sample_size(poses, weights, kld)


def test_wide_needs_many_narrow_needs_few() -> None:
    kld = KLDSampling(min_particles=100, max_particles=5000)
    sizes = [
        kld.sample_size(spread(width) + 0.25, np.ones(20_000)) for width in (0.01, 1.0, 3.0, 30.0)
    ]
    assert sizes[0] == 100
    assert sizes == sorted(sizes)
    assert sizes[1] > 100
    assert sizes[-1] == 5000


def test_negative_and_large_coordinates_are_cells_like_others() -> None:
    kld = KLDSampling(min_particles=10, max_particles=4000)
    here = kld.sample_size(spread(2.0), np.ones(20_000))
    far = kld.sample_size(spread(2.0) + np.array([-5000.0, 80_000.0, 0.0]), np.ones(20_000))
    assert far == here  # both are whole cells away


def test_the_histogram_is_as_close_as_promised() -> None:
    """The distance stays below the error in 99 % of the samples, by multinomial draws."""
    rng = np.random.default_rng(2)
    shares = rng.dirichlet(np.full(60, 2.0))
    kld = KLDSampling(min_particles=1, max_particles=10**6)
    n = kld.bound(60)
    counts = rng.multinomial(n, shares, size=4000) / n
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = np.where(counts > 0, counts * np.log(counts / shares), 0.0)
    exceeded = (terms.sum(axis=1) > 0.05).mean()
    # 1 % and 5 standard errors, and the chi-square law holds for large n only
    assert exceeded <= 0.01 + 5 * np.sqrt(0.01 / 4000)
    assert exceeded > 0.001  # and not for being far too many


def test_a_filter_shrinks_and_grows() -> None:
    class Position:
        std = 0.1

        def log_likelihood(self, poses: np.ndarray, observation: np.ndarray) -> np.ndarray:
            offset = poses[:, :2] - observation
            return -0.5 * (offset**2).sum(axis=1) / self.std**2

    sensor = Position()
    kld = KLDSampling(min_particles=200, max_particles=4000)
    wide = DifferentialDrive(position_noise=2.0)
    pf = ParticleFilter(DifferentialDrive(), sensor, num_particles=kld, rng=0)
    pf.initialize_uniform((-5, -5, 5, 5))
    assert len(pf.poses) == 4000
    for _ in range(4):
        pf.step([0.01, 0.0, 0.0], [0.0, 0.0])
    small = len(pf.poses)
    assert 200 <= small < 2000
    sensor.std = 3.0
    pf.motion = wide
    for _ in range(3):
        estimate = pf.step([0.0, 0.0, 0.0], [0.0, 0.0])
    assert estimate.num_particles > 2 * small
    assert len(pf.poses) <= 4000


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"min_particles": 0}, "min_particles"),
        ({"min_particles": 10, "max_particles": 9}, "min_particles"),
        ({"error": 0.0}, "error"),
        ({"error": np.nan}, "error"),
        ({"probability": 1.0}, "probability"),
        ({"cell_size": -1.0}, "cell_size"),
        ({"cell_angle": 0.001}, "cell_angle"),
    ],
)
def test_misuse_names_the_option(options: dict[str, float], named: str) -> None:
    with pytest.raises(ValueError, match=f"^{named}: expected"):
        KLDSampling(**options)
