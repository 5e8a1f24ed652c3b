"""The posterior on the grid: known answers, calibration, the turn on the spot."""

from __future__ import annotations

import naive
import numpy as np
import pytest

from pflut.correspondences import Correspondences
from pflut.geometry import TWO_PI, rotation_from_headings, wrap_to_pi
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.table import LikelihoodTable
from pflut.posterior import GridPosterior, pose_posterior
from pflut.simulation.correspondences import CorrespondenceSimulator

SIGMAS = 5.0


def posterior_of(probabilities: np.ndarray) -> GridPosterior:
    with np.errstate(divide="ignore"):
        return GridPosterior(np.log(probabilities / probabilities.sum()), 0.0)


def bump(
    bins: int, center: tuple[float, float], std: tuple[float, float], tilt: float = 0.0
) -> GridPosterior:
    """A normal posterior about a pose, with wrap-around."""
    axis = (np.arange(bins) + 0.5) * TWO_PI / bins
    d = wrap_to_pi(axis - center[0])[:, None]
    e = wrap_to_pi(axis - center[1])[None, :]
    return posterior_of(np.exp(-0.5 * ((d / std[0]) ** 2 + ((e - tilt * d) / std[1]) ** 2)))


def turn_on_the_spot(
    rotation: float, n: int, seed: int, *, noise: float = 0.01, mismatch: float = 0.0
) -> Correspondences:
    """The same landmarks from one place, the second time turned."""
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(0, TWO_PI, n)
    elevation = np.arcsin(rng.uniform(-0.8, 0.8, n))
    azimuth_r = azimuth - rotation + noise * rng.normal(size=n) / np.cos(elevation)
    elevation_r = elevation + noise * rng.normal(size=n)
    wrong = rng.uniform(size=n) < mismatch
    azimuth_r[wrong] = rng.uniform(0, TWO_PI, wrong.sum())
    elevation_r[wrong] = np.arcsin(rng.uniform(-0.8, 0.8, wrong.sum()))
    return Correspondences(azimuth, elevation, azimuth_r, elevation_r)


def test_posterior_is_the_normalised_exponential(
    small_table: LikelihoodTable, small_dense_table: DenseTable
) -> None:
    c = CorrespondenceSimulator(mismatch=0.5).pair(20, 0)[0]
    for table, log_likelihood in (
        (small_table, small_table.log_likelihood_grid(c).astype(float)),
        (small_dense_table, naive.grid(small_dense_table.log_ratio, c)),
    ):
        for temperature in (1.0, 0.3):
            posterior = pose_posterior(c, table, temperature=temperature)
            grid = np.exp(temperature * log_likelihood)
            assert posterior.prob == pytest.approx(grid / grid.sum(), rel=1e-3)
            assert posterior.log_evidence == pytest.approx(np.log(grid.mean()), abs=1e-3)
            assert posterior.prob.sum() == pytest.approx(1.0)
            assert posterior.bins == 32
            assert posterior.centers == pytest.approx((np.arange(32) + 0.5) * TWO_PI / 32)


def test_hundreds_of_correspondences_do_not_overflow(default_table: LikelihoodTable) -> None:
    c, theta, phi = CorrespondenceSimulator(mismatch=0.0).pair(3000, 1)
    posterior = pose_posterior(c, default_table)
    assert np.isfinite(posterior.log_evidence)
    assert posterior.log_evidence > 1000
    assert posterior.prob.sum() == pytest.approx(1.0)
    assert np.abs(wrap_to_pi(np.array(posterior.mode()) - [theta, phi])).max() < 0.05


def test_nothing_known_is_uniform(small_table: LikelihoodTable) -> None:
    posterior = pose_posterior(Correspondences.empty(), small_table)
    assert posterior.prob == pytest.approx(1 / 32**2)
    assert posterior.log_evidence == pytest.approx(0.0)
    assert posterior.entropy() == pytest.approx(2 * np.log(32))
    assert posterior.credible_mass(1.0, 2.0) == pytest.approx(0.5)
    assert posterior.rotation()[1] == pytest.approx(1 / 32)


def test_temperature_flattens(default_table: LikelihoodTable) -> None:
    c = CorrespondenceSimulator(mismatch=0.5).pair(30, 2)[0]
    entropies = [
        pose_posterior(c, default_table, temperature=t).entropy() for t in (1.0, 0.5, 0.1, 0.01)
    ]
    assert entropies == sorted(entropies)
    assert entropies[-1] > entropies[0] + 1


@pytest.mark.parametrize("bins", [32, 33])
def test_mode_is_interpolated(bins: int) -> None:
    """The logarithm of a normal density is a parabola: exact, also across the wrap."""
    rng = np.random.default_rng(0)
    for center in [*rng.uniform(0, TWO_PI, (20, 2)), (0.001, TWO_PI - 0.001), (np.pi, 0.0)]:
        posterior = bump(bins, center, (0.3, 0.5))
        mode = np.array(posterior.mode())
        assert np.abs(wrap_to_pi(mode - center)).max() < 1e-6
        assert (np.abs(mode) <= np.pi).all()


def test_mode_without_curvature() -> None:
    flat = posterior_of(np.ones((8, 8)))
    assert np.abs(flat.mode()).max() <= np.pi
    ridge = posterior_of(np.where(np.arange(8) == 3, 1.0, 1e-6)[:, None] * np.ones(8))
    assert ridge.mode()[0] == pytest.approx(3.5 * TWO_PI / 8)


def test_impossible_cells_do_no_harm() -> None:
    single = np.zeros((8, 8))
    single[2, 5] = 1.0
    posterior = posterior_of(single)
    assert posterior.mode() == pytest.approx((2.5 * TWO_PI / 8, wrap_to_pi(5.5 * TWO_PI / 8)))
    assert posterior.entropy() == 0.0
    assert posterior.credible_mass(2.1, 4.1) == pytest.approx(0.5)
    assert posterior.credible_mass(0.0, 0.0) == 1.0


def test_marginals_by_hand() -> None:
    random = np.random.default_rng(1).uniform(size=(12, 12))
    posterior = posterior_of(random)
    prob = random / random.sum()
    assert posterior.heading_l() == pytest.approx(prob.sum(1))
    assert posterior.heading_r() == pytest.approx(prob.sum(0))
    expected: dict[float, float] = {}
    for i in range(12):
        for j in range(12):
            psi = rotation_from_headings(posterior.centers[i], posterior.centers[j])
            key = round(float(psi) / (TWO_PI / 12)) % 12
            expected[key] = expected.get(key, 0.0) + prob[i, j]
    angles, rotation = posterior.rotation()
    assert (np.diff(angles) > 0).all()
    assert (np.abs(angles) <= np.pi).all()
    for angle, share in zip(angles, rotation, strict=True):
        assert share == pytest.approx(expected[round(float(angle) / (TWO_PI / 12)) % 12])
    assert posterior.rotation_mean() == pytest.approx(np.angle(rotation @ np.exp(1j * angles)))


def test_credible_mass_by_hand() -> None:
    prob = np.full((4, 4), 0.01)
    prob[0, 0], prob[1, 1], prob[2, 2] = 0.5, 0.27, 0.1
    posterior = posterior_of(prob)
    quarter = TWO_PI / 4
    assert posterior.credible_mass(0.1, 0.1) == pytest.approx(0.25)
    assert posterior.credible_mass(1.5 * quarter, 1.5 * quarter) == pytest.approx(0.5 + 0.135)
    assert posterior.credible_mass(2.5 * quarter - TWO_PI, 2.5 * quarter) == pytest.approx(0.82)
    assert posterior.credible_mass(0.1, -0.1) == pytest.approx(0.87 + 0.065)


def test_credible_region_is_the_smallest() -> None:
    rng = np.random.default_rng(2)
    prob = rng.uniform(size=(9, 9)) ** 4
    posterior = posterior_of(prob)
    for mass in (1e-6, 0.3, 0.68, 0.95, 1.0):
        region = posterior.credible_region(mass)
        inside = posterior.prob[region]
        assert inside.sum() >= mass - 1e-12
        assert inside.sum() - inside.min() < mass
        assert region.all() or inside.min() >= posterior.prob[~region].max()
    for mass in (0.0, 1.1, -1.0, np.nan):
        with pytest.raises(ValueError, match="mass: expected"):
            posterior.credible_region(mass)


def uniform(values: np.ndarray) -> None:
    """Kolmogorov and Smirnov's distance to the uniform distribution, at a level of 1e-6."""
    ordered = np.sort(values)
    n = len(ordered)
    distance = np.abs(ordered - (np.arange(n) + 0.5) / n).max()
    assert distance < np.sqrt(0.5 * np.log(2e6) / n)


def test_credible_mass_is_calibrated_for_a_known_posterior() -> None:
    """Poses drawn from the posterior itself have uniform masses, of however many modes it is."""
    rng = np.random.default_rng(3)
    prob = np.exp(rng.normal(size=(64, 64)))
    posterior = posterior_of(prob)
    drawn = rng.choice(64 * 64, 5000, p=posterior.prob.ravel())
    poses = (np.stack(np.divmod(drawn, 64), 1) + rng.uniform(size=(5000, 2))) * TWO_PI / 64
    uniform(np.array([posterior.credible_mass(*pose) for pose in poses]))


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_credible_mass_of_one_correspondence_is_calibrated(noise: float) -> None:
    """One correspondence's posterior is the paper's table itself: right on the average."""
    simulator = CorrespondenceSimulator(mismatch=0.01, noise=noise)
    table = DenseTable.from_simulation(bins=32, num_samples=8_000_000, simulator=simulator)
    headings, angles = CorrespondenceSimulator(mismatch=0.0, noise=noise).sample(4000, 1, 99)
    masses = [
        pose_posterior(Correspondences(*pair.T), table).credible_mass(*pose)
        for pose, pair in zip(headings, angles, strict=True)
    ]
    uniform(np.array(masses))


@pytest.mark.parametrize(("bins", "mismatch"), [(32, 0.3), (64, 0.9)])
def test_credible_mass_of_a_ridge_is_calibrated(bins: int, mismatch: float) -> None:
    """As many mismatches as the table expects; of cells as probable as the pose's, any share."""
    simulator = CorrespondenceSimulator(mismatch=mismatch)
    table = LikelihoodTable.from_simulation(
        num_samples=16_000_000, simulator=simulator, num_classes=1, bins=bins
    )
    headings, angles = simulator.sample(4000, 10, 99)
    rng = np.random.default_rng(0)
    masses = []
    for pose, pair in zip(headings, angles, strict=True):
        one = pair[rng.integers(10)]
        posterior = pose_posterior(Correspondences(*one[:, None]), table)
        i, j = np.floor(pose / TWO_PI * bins).astype(int)
        level = posterior.log_prob[i, j]
        equal = posterior.prob[posterior.log_prob == level].sum()
        masses.append(posterior.prob[posterior.log_prob > level].sum() + rng.uniform() * equal)
    uniform(np.array(masses))


@pytest.mark.parametrize(
    ("kind", "n", "temperature", "least", "typical", "highest"),
    [
        ("dense_table", 25, 1.0, 20, 50, 0.3),
        ("dense_table", 60, 0.3, 60, 70, 0.3),
        ("default_table", 25, 1.0, 2, 12, 0.8),
        ("default_table", 60, 0.3, 10, 30, 0.35),
    ],
)
def test_turn_on_the_spot_is_a_diagonal_band(
    kind: str,
    n: int,
    temperature: float,
    least: float,
    typical: float,
    highest: float,
    request: pytest.FixtureRequest,
) -> None:
    """Figure 8: the rotation is known, the headings are not.

    Where r is one a ridge is a rough picture of its two branches and of what is between them, and
    along the band the posterior of the residual table is less even than it should be.
    """
    table = request.getfixturevalue(kind)
    spreads = []
    for seed, rotation in enumerate((0.0, 0.7, -1.9, np.pi, 2.2, -0.4)):
        c = turn_on_the_spot(rotation, n, seed, mismatch=0.3)
        posterior = pose_posterior(c, table, temperature=temperature)
        angles, probabilities = posterior.rotation()
        near = np.abs(wrap_to_pi(angles - rotation)) < 0.15
        assert probabilities[near].sum() > 0.85
        assert abs(wrap_to_pi(posterior.rotation_mean() - rotation)) < 0.1
        for heading in (posterior.heading_l(), posterior.heading_r()):
            # as many of the 128 cells are filled; a translation fills a few
            spreads.append(np.exp(-np.sum(heading * np.log(heading))))
            assert heading.max() < highest
    assert min(spreads) > least
    assert np.median(spreads) > typical


def test_a_translation_is_no_band(default_table: LikelihoodTable) -> None:
    c, theta, phi = CorrespondenceSimulator(mismatch=0.3).pair(60, 5)
    posterior = pose_posterior(c, default_table)
    assert np.exp(posterior.entropy()) < 25
    assert np.abs(wrap_to_pi(np.array(posterior.mode()) - [theta, phi])).max() < 0.05


def test_evidence_tells_linked_views_from_others(default_table: LikelihoodTable) -> None:
    linked, foreign = (
        [
            pose_posterior(CorrespondenceSimulator(mismatch=m).pair(50, seed)[0], default_table)
            for seed in range(40)
        ]
        for m in (0.6, 1.0)
    )
    low = np.percentile([p.log_evidence for p in linked], 10)
    assert low > np.percentile([p.log_evidence for p in foreign], 90) + 3


def test_any_number_of_cells(small_table: LikelihoodTable) -> None:
    none = Correspondences.empty()
    assert pose_posterior(none, small_table).bins == 32
    assert pose_posterior(none, small_table, bins=45).bins == 45


def test_misuse(small_table: LikelihoodTable, small_dense_table: DenseTable) -> None:
    none = Correspondences.empty()
    assert pose_posterior(none, small_dense_table, bins=32).bins == 32
    with pytest.raises(ValueError, match="bins: this table has 32, got 64"):
        pose_posterior(none, small_dense_table, bins=64)
    with pytest.raises(ValueError, match="bins: expected 4 to 1024"):
        pose_posterior(none, small_table, bins=2)
    for temperature in (0.0, -1.0, 1.1, np.nan):
        with pytest.raises(ValueError, match=r"temperature: expected a number in \(0, 1\]"):
            pose_posterior(none, small_table, temperature=temperature)
