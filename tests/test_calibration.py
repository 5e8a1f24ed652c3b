"""Calibration: the coverage of posteriors that are right by construction, and the temperature."""

from __future__ import annotations

import numpy as np
import pytest

from pflut.calibration import LEAST_TEMPERATURE, coverage, fit_temperature
from pflut.correspondences import Correspondences
from pflut.geometry import TWO_PI
from pflut.likelihood.known_pairs import Pair
from pflut.likelihood.table import LikelihoodTable
from pflut.plot import plot_calibration
from pflut.posterior import GridPosterior, pose_posterior
from pflut.simulation.correspondences import CorrespondenceSimulator
from pflut.statistics import wilson_interval

SIGMAS = 5.0
KAPPA = 4.0


class VonMises:
    """Azimuths that measure the headings themselves: the posterior is known exactly."""

    def __init__(self, scale: float = 1.0, bins: int = 64) -> None:
        self.scale, self.bins = scale, bins

    def log_likelihood_grid(
        self, c: Correspondences, bins: int | None = None, *, window: object = None
    ) -> np.ndarray:
        size = bins or self.bins
        centers = (np.arange(size) + 0.5) * TWO_PI / size
        rows, columns = (
            np.cos(centers[:, None] - angles[None, :]).sum(axis=1)
            for angles in (c.azimuth_l, c.azimuth_r)
        )
        return (self.scale * KAPPA * (rows[:, None] + columns[None, :])).astype(np.float32)


def measured(num_pairs: int, n: int = 3, seed: int = 0, copies: int = 1) -> list[Pair]:
    rng = np.random.default_rng(seed)
    pairs: list[Pair] = []
    for theta, phi in rng.uniform(0.0, TWO_PI, (num_pairs, 2)):
        left, right = (
            np.tile(rng.vonmises(heading - np.pi, KAPPA, n) + np.pi, copies)
            for heading in (theta, phi)
        )
        flat = np.zeros(n * copies)
        pairs.append((Correspondences(left, flat, right, flat), theta, phi))
    return pairs


def simulated(num_pairs: int, n: int, mismatch: float, seed: int, copies: int = 1) -> list[Pair]:
    headings, bearings = CorrespondenceSimulator(mismatch=mismatch).sample(num_pairs, n, seed)
    return [
        (Correspondences(*np.tile(views.T, copies)), *pose)
        for pose, views in zip(headings, bearings, strict=True)
    ]


LEVELS = tuple(np.linspace(0.1, 0.9, 9))


def is_uniform(rates: np.ndarray, levels: np.ndarray, count: int) -> bool:
    return bool((np.abs(rates - levels) < SIGMAS * np.sqrt(levels * (1 - levels) / count)).all())


@pytest.mark.parametrize("bins", [48, 64])
def test_right_posteriors_cover_as_often_as_they_say(bins: int) -> None:
    found = coverage(iter(measured(2000)), VonMises(bins=bins), levels=LEVELS)
    assert found.num_pairs == len(found.masses) == len(found.log_densities) == 2000
    assert is_uniform(found.rates, found.levels, 2000)
    assert ((found.low < found.rates) & (found.rates < found.high)).all()


@pytest.mark.parametrize(("scale", "below"), [(4.0, True), (0.3, False)])
def test_posteriors_that_are_too_narrow_or_too_wide_show(scale: float, below: bool) -> None:
    found = coverage(measured(500), VonMises(scale), levels=LEVELS)
    assert ((found.high < found.levels) if below else (found.low > found.levels)).all()


def test_a_single_cell_counts_by_the_share_of_it_that_is_needed() -> None:
    """Where nothing is known, and on a grid much coarser than the posterior, if it is right."""
    rng = np.random.default_rng(1)
    nothing = [(Correspondences.empty(), *pose) for pose in rng.uniform(0, TWO_PI, (2000, 2))]
    found = coverage(nothing, VonMises(), levels=LEVELS)
    assert is_uniform(found.rates, found.levels, 2000)
    assert found.log_score == pytest.approx(-2.0 * np.log(TWO_PI))
    assert fit_temperature(nothing, VonMises()) == 1.0

    class Coarse:
        """Nine in ten of the truths lie in the cell that is said to have so much."""

        bins = 4

        def log_likelihood_grid(
            self, c: Correspondences, bins: int | None = None, *, window: object = None
        ) -> np.ndarray:
            grid = np.full((4, 4), np.log(0.1 / 15), np.float32)
            grid[0, 0] = np.log(0.9)
            return grid

    cells = np.where(rng.uniform(size=2000) < 0.9, 0, rng.integers(1, 16, 2000))
    poses = (np.stack(np.divmod(cells, 4), axis=1) + 0.5) * TWO_PI / 4
    found = coverage([(Correspondences.empty(), *pose) for pose in poses], Coarse(), levels=LEVELS)
    assert is_uniform(found.rates, found.levels, 2000)


def test_coverage_is_that_of_the_posteriors(default_table: LikelihoodTable) -> None:
    pairs = simulated(40, 25, 0.8, 2)
    found = coverage(pairs, default_table, temperature=0.5, bins=64)
    for (c, theta, phi), mass, density in zip(
        pairs, found.masses, found.log_densities, strict=True
    ):
        posterior = pose_posterior(c, default_table, bins=64, temperature=0.5)
        cell = posterior.cell(theta, phi)
        equal = posterior.prob[posterior.log_prob == posterior.log_prob[cell]].sum()
        assert abs(mass - posterior.credible_mass(theta, phi)) <= 0.501 * equal
        assert density == pytest.approx(posterior.log_prob[cell] + 2 * np.log(64 / TWO_PI))
    assert found.log_score == pytest.approx(found.log_densities.mean())
    for k, level in enumerate((0.5, 0.8, 0.95, 0.99)):
        count = int((found.masses <= level).sum())
        assert found.levels[k] == level and found.rates[k] == count / 40
        assert (found.low[k], found.high[k]) == pytest.approx(wilson_interval(count, 40))
    again = coverage(pairs, default_table, temperature=0.5, bins=64)
    assert np.array_equal(again.masses, found.masses)


def test_the_temperature_is_found_again() -> None:
    pairs = measured(600, seed=3)
    base = fit_temperature(pairs, VonMises(1.25))
    # one factor on two normal headings: a relative error of one over the root of the pairs
    assert base == pytest.approx(0.8, rel=SIGMAS / np.sqrt(600))
    # twice the likelihood, or every correspondence twice: half of it
    assert fit_temperature(pairs, VonMises(2.5)) == pytest.approx(0.5 * base, rel=5e-3)
    twice = measured(600, seed=3, copies=2)
    assert fit_temperature(twice, VonMises(1.25)) == pytest.approx(0.5 * base, rel=5e-3)
    fifth = fit_temperature(measured(200, copies=5), VonMises())
    assert fifth == pytest.approx(0.2, rel=SIGMAS / np.sqrt(200))


def test_temperatures_stay_in_their_range() -> None:
    pairs = measured(100)
    assert fit_temperature(pairs, VonMises(0.2)) == 1.0
    assert fit_temperature(pairs, VonMises(200.0)) == LEAST_TEMPERATURE


def test_the_temperature_has_the_best_log_score(default_table: LikelihoodTable) -> None:
    pairs = simulated(60, 100, 0.5, 4)
    temperature = fit_temperature(pairs, default_table)
    assert 0.05 < temperature < 0.9
    best, *others = (
        coverage(pairs, default_table, temperature=factor * temperature).log_score
        for factor in (1.0, 0.97, 1.03, 0.5)
    )
    assert best > max(others)
    doubled = fit_temperature(simulated(60, 100, 0.5, 4, copies=2), default_table)
    assert doubled == pytest.approx(0.5 * temperature, rel=5e-3)


def test_held_out_pairs_are_covered_better(default_table: LikelihoodTable) -> None:
    pairs = simulated(400, 100, 0.5, 5)
    temperature = fit_temperature(pairs[::2], default_table)
    before = coverage(pairs[1::2], default_table)
    after = coverage(pairs[1::2], default_table, temperature=temperature)
    assert after.log_score > before.log_score
    assert np.abs(after.rates - after.levels).max() < np.abs(before.rates - before.levels).max()


def test_cells_of_poses() -> None:
    posterior = GridPosterior(np.log(np.full((8, 8), 1 / 64)), 0.0)
    assert posterior.cell(0.0, TWO_PI / 8) == (0, 1)
    assert posterior.cell(-0.01, 2 * TWO_PI + 0.01) == (7, 0)
    assert posterior.log_density(1.0, -2.0) == pytest.approx(-np.log(TWO_PI**2))


def test_misuse(small_table: LikelihoodTable) -> None:
    pair = measured(1)
    for function in (coverage, fit_temperature):
        with pytest.raises(ValueError, match="pairs: expected at least one, got none"):
            function([], small_table)
        with pytest.raises(ValueError, match="the true headings of pair 1 are not finite"):
            function([*pair, (Correspondences.empty(), np.nan, 0.0)], small_table)
        with pytest.raises(ValueError, match="bins: expected 4 to 1024, got 2"):
            function(pair, small_table, bins=2)
    with pytest.raises(ValueError, match=r"levels: expected shares in \(0, 1\), got \(0.5, 1.0\)"):
        coverage(pair, small_table, levels=(0.5, 1.0))
    with pytest.raises(ValueError, match=r"temperature: expected a number in \(0, 1\], got 2"):
        coverage(pair, small_table, temperature=2.0)


def test_figure() -> None:
    rng = np.random.default_rng(0)
    masses = {"before": rng.uniform(size=50) ** 0.3, "after": rng.uniform(size=200)}
    figure = plot_calibration(masses, title="pairs")
    (axes,) = figure.axes
    lines = {line.get_label(): line.get_xydata() for line in axes.get_lines()}
    for name, values in masses.items():
        x, y = lines[name].T
        assert x[[0, -1]] == pytest.approx([0, 100]) and y[[0, -1]] == pytest.approx([0, 100])
        assert x[1:-1] == pytest.approx(100 * np.sort(values))
        assert y[1:-1] == pytest.approx(100 * np.arange(1, len(values) + 1) / len(values))
    texts = [text.get_text() for text in axes.get_legend().get_texts()]
    assert texts == ["calibrated: 95 % band of 50 pairs", "before", "after"]
    # the band is that of the Wilson interval: at its edge the interval ends at the diagonal
    band = axes.collections[0].get_paths()[0].vertices
    upper = band[np.isclose(band[:, 0], 50.0)][:, 1].max()
    assert wilson_interval(round(upper / 2) + 1, 50)[0] > 0.5 > wilson_interval(30, 50)[0]
    assert axes.get_title() == "pairs" and "[%]" in axes.get_xlabel()
    for wrong in ({}, {"none": []}):
        with pytest.raises(ValueError, match="masses: expected at least one pair"):
            plot_calibration(wrong)
