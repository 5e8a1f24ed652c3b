"""The grid of the residual table: ridges, their maxima, and arithmetic on many numbers."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys

import naive
import numpy as np
import pytest
from naive import angles_of
from test_dense import EDGES, random_correspondences
from test_posterior import turn_on_the_spot

from pflut._jit import jit
from pflut._lanes import HALF, LANES, add_lanes, add_scaled, add_shares, add_transposed
from pflut.correspondences import Correspondences
from pflut.geometry import TWO_PI, wrap_to_pi
from pflut.likelihood.axes import residual_nodes
from pflut.likelihood.ridge_kernels import FULL, NATS, _largest, _log_mean_exp, _maxima
from pflut.likelihood.table import LikelihoodTable, bearing_columns
from pflut.simulation.correspondences import CorrespondenceSimulator

BINS = (5, 17, 63, 64, 100, 128, 200)


def simulated(n: int, seed: int, mismatch: float = 0.5) -> Correspondences:
    return CorrespondenceSimulator(mismatch=mismatch).pair(n, seed)[0]


def of_shapes(n: int, seed: int, least: float, r: tuple[float, float]) -> Correspondences:
    """Bearings all over, their elevations above a least one, |r| between two numbers."""
    rng = np.random.default_rng(seed)
    high = rng.uniform(least, 1.4, n)
    low = np.arctan(np.tan(high) * rng.uniform(*r, n))
    swap, sign = rng.uniform(size=n) < 0.5, rng.choice([-1.0, 1.0], n)
    elevations = sign * np.where(swap, [high, low], [low, high])
    azimuths = rng.uniform(0, TWO_PI, (2, n))
    return Correspondences(azimuths[0], elevations[0], azimuths[1], elevations[1])


# --- the grid against the mean ratio over each cell -----------------------------------------------


def compared(table: LikelihoodTable, c: Correspondences, bins: int, samples: int):
    """Give for each correspondence its grid, and the naive one."""
    for i, angles in enumerate(angles_of(c)):
        expected = naive.ridges(
            [angles], [table.prior_odds], table.density, table.profile, bins, samples
        )
        yield table.log_likelihood_grid(c[i : i + 1], bins), expected


@pytest.mark.parametrize(("bins", "samples"), [(64, 10), (33, 20)])
def test_grid_is_the_log_of_the_mean_ratio(
    default_table: LikelihoodTable, bins: int, samples: int
) -> None:
    """Within what a ridge of few profiles may do: an eighth of a cell aside, a step up or down."""
    c = of_shapes(24, 0, 0.15, (0.03, 0.85))
    peaks = []
    for grid, expected in compared(default_table, c, bins, samples):
        difference = grid - expected
        assert np.sqrt(np.mean(difference**2)) < 0.22
        assert np.corrcoef(grid.ravel(), expected.ravel())[0, 1] > 0.92
        assert np.abs(difference).max() < 2.5
        assert abs(difference.mean()) < 0.05
        assert grid.max() == pytest.approx(expected.max(), abs=0.75)
        evidence = np.log(np.exp(grid.astype(float)).mean())
        assert evidence == pytest.approx(np.log(np.exp(expected).mean()), abs=0.25)
        peaks.append(grid.max() - expected.max())
    assert abs(np.median(peaks)) < 0.4


@pytest.mark.parametrize(("least", "r"), [(0.15, (0.85, 1.0)), (0.05, (0.05, 1.0))])
def test_grid_near_the_horizon_and_where_r_is_one_is_coarser(
    default_table: LikelihoodTable, least: float, r: tuple[float, float]
) -> None:
    """There the ridge is as wide as the branches are apart."""
    similar, error = [], []
    for grid, expected in compared(default_table, of_shapes(16, 1, least, r), 64, 10):
        similar.append(np.corrcoef(grid.ravel(), expected.ravel())[0, 1])
        error.append(np.sqrt(np.mean((grid - expected) ** 2)))
    assert min(similar) > 0.6
    assert np.median(similar) > 0.9
    assert np.median(error) < 0.25


def test_grid_of_many_is_the_log_of_the_mean_ratios(default_table: LikelihoodTable) -> None:
    """Errors of single ridges are no bias of the sum."""
    c, theta, phi = CorrespondenceSimulator(mismatch=0.6).pair(30, 4)
    odds = default_table.odds(c)
    expected = naive.ridges(angles_of(c), odds, default_table.density, default_table.profile, 64, 6)
    grid = default_table.log_likelihood_grid(c, 64)
    assert np.unravel_index(grid.argmax(), grid.shape) == np.unravel_index(
        expected.argmax(), expected.shape
    )
    assert np.corrcoef(grid.ravel(), expected.ravel())[0, 1] > 0.95
    assert grid.max() == pytest.approx(expected.max(), abs=5.0)
    place = np.array(np.unravel_index(grid.argmax(), grid.shape)) + 0.5
    assert np.abs(wrap_to_pi(place * TWO_PI / 64 - [theta, phi])).max() < 1.5 * TWO_PI / 64


def test_grid_of_the_perspective_table_is_the_log_of_the_mean_ratio() -> None:
    """Of all elevations that its cameras see; no more than them were met in learning."""
    table = LikelihoodTable.default("perspective")
    for least, r in ((0.1, (0.5, 0.9)), (0.4, (0.5, 0.9))):
        c = of_shapes(40, 3, least, r)
        c = c[np.maximum(abs(c.elevation_l), abs(c.elevation_r)) < least + 0.15][:8]
        peaks = []
        for grid, expected in compared(table, c, 64, 16):
            assert np.corrcoef(grid.ravel(), expected.ravel())[0, 1] > 0.85
            peaks.append(grid.max() - expected.max())
        assert len(peaks) >= 3
        assert abs(np.median(peaks)) < 0.5


def test_profile_and_odds_shift_the_levels(default_table: LikelihoodTable) -> None:
    """Other shares of mismatches make other heights, without learning anything anew."""
    c = of_shapes(6, 5, 0.3, (0.1, 0.8))
    for mismatch in (0.02, 0.3, 0.98):
        table = dataclasses.replace(default_table, mismatch=mismatch)
        for grid, expected in compared(table, c, 48, 14):
            assert np.corrcoef(grid.ravel(), expected.ravel())[0, 1] > 0.88
            assert grid.max() == pytest.approx(expected.max(), abs=0.75)
            assert grid.min() == pytest.approx(expected.min(), abs=0.1)


# --- symmetries -----------------------------------------------------------------------------------


@pytest.mark.parametrize("bins", BINS)
def test_exchanged_views_give_the_transposed_grid(
    default_table: LikelihoodTable, bins: int
) -> None:
    for c in (simulated(60, 0), random_correspondences(60, 1)):
        # where r is one to the last bit either view may count as the nearer one
        c = c[np.abs(c.elevation_l) != np.abs(c.elevation_r)]
        grid = default_table.log_likelihood_grid(c, bins)
        other = default_table.log_likelihood_grid(c.exchanged(), bins)
        assert np.abs(other.T - grid).max() < 1e-4


@pytest.mark.parametrize("bins", BINS)
def test_turning_a_view_by_whole_cells_rolls_the_grid(
    default_table: LikelihoodTable, bins: int
) -> None:
    """But for crossings so near to the border of an eighth of a cell that rounding decides."""
    c = simulated(60, 2)
    grid = default_table.log_likelihood_grid(c, bins)
    for left, right in ((3, 0), (0, -2), (bins // 2, 1), (2 * bins, -bins)):
        turned = Correspondences(
            c.azimuth_l + left * TWO_PI / bins,
            c.elevation_l,
            c.azimuth_r + right * TWO_PI / bins,
            c.elevation_r,
        )
        rolled = np.roll(grid, (left, right), axis=(0, 1))
        difference = np.abs(default_table.log_likelihood_grid(turned, bins) - rolled)
        assert np.median(difference) < 1e-4
        assert difference.mean() < 0.02
        assert difference.max() < 1.5


def test_mirrored_scene_gives_the_mirrored_grid(default_table: LikelihoodTable) -> None:
    c = simulated(60, 3)
    mirrored = Correspondences(-c.azimuth_l, c.elevation_l, -c.azimuth_r, c.elevation_r)
    for bins in (64, 63):
        grid = default_table.log_likelihood_grid(c, bins)
        difference = default_table.log_likelihood_grid(mirrored, bins) - grid[::-1, ::-1]
        # places are rounded down to eighths of a cell, in the mirror up
        assert np.corrcoef(grid.ravel(), (grid + difference[::-1, ::-1]).ravel())[0, 1] > 0.98
        assert abs(difference.mean()) < 0.01


def test_upside_down_scene_gives_the_same_grid(default_table: LikelihoodTable) -> None:
    for c in (simulated(60, 3), random_correspondences(60)):
        flipped = Correspondences(c.azimuth_l, -c.elevation_l, c.azimuth_r, -c.elevation_r)
        grid = default_table.log_likelihood_grid(c)
        assert np.abs(default_table.log_likelihood_grid(flipped) - grid).max() < 1e-4


# --- any number of cells and of correspondences ---------------------------------------------------


@pytest.mark.parametrize("bins", BINS)
def test_grid_is_a_sum(default_table: LikelihoodTable, bins: int) -> None:
    c = simulated(101, 6)
    parts = [default_table.log_likelihood_grid(c[i : i + 1], bins) for i in range(len(c))]
    grid = default_table.log_likelihood_grid(c, bins)
    assert grid.dtype == np.float32
    assert grid.shape == (bins, bins)
    assert np.abs(grid - np.sum(parts, axis=0)).max() < 2e-3


@pytest.mark.parametrize("bins", [*BINS, 4, 23, 24, 25, 1024])
def test_every_number_of_cells_finds_the_pose(default_table: LikelihoodTable, bins: int) -> None:
    for seed in range(3):
        c, *pose = CorrespondenceSimulator(mismatch=0.3).pair(80, seed)
        grid = default_table.log_likelihood_grid(c, bins)
        assert np.isfinite(grid).all()
        place = np.array(np.unravel_index(grid.argmax(), grid.shape)) + 0.5
        error = np.abs(wrap_to_pi(place * TWO_PI / bins - pose)).max()
        assert error < max(1.5 * TWO_PI / bins, 0.05)


def test_grid_of_none_is_zero(default_table: LikelihoodTable) -> None:
    for bins in BINS:
        assert not default_table.log_likelihood_grid(Correspondences.empty(), bins).any()


def test_no_plane_overflows(default_table: LikelihoodTable) -> None:
    """A ridge that is added a thousand times is a thousand times as high."""
    c = of_shapes(2, 7, 0.3, (0.2, 0.9))
    one = default_table.log_likelihood_grid(c, 64).astype(float)
    many = default_table.log_likelihood_grid(c[np.arange(1000) % 2], 64)
    assert 500 * one.max() > 2 * FULL * NATS
    assert np.abs(many - 500 * one).max() < 0.05


@pytest.mark.parametrize("bins", [4, 5, 8, 12, 23])
def test_no_plane_of_few_cells_overflows(default_table: LikelihoodTable, bins: int) -> None:
    """Profiles that are wider than the grid fold onto the same cells again and again."""
    wide = np.interp(residual_nodes() / 25.0, residual_nodes(), default_table.profile[5])
    table = dataclasses.replace(
        default_table, profile=np.tile(wide, (len(default_table.profile), 1)), mismatch=0.1
    )
    c = of_shapes(2, 7, 0.3, (0.9, 0.99))
    one = table.log_likelihood_grid(c, bins).astype(float)
    many = table.log_likelihood_grid(c[np.arange(1000) % 2], bins)
    assert np.abs(many - 500 * one).max() < 0.05


def test_a_point_on_the_horizon_is_as_one_beside_it(default_table: LikelihoodTable) -> None:
    for elevation in (0.01, 0.05, 0.3):
        exact = Correspondences(1.0, 0.0, 2.0, elevation)
        beside = Correspondences(1.0, 1e-9, 2.0, elevation)
        grids = [default_table.log_likelihood_grid(c, 64) for c in (exact, beside)]
        # but for an eighth of a cell, by which the curve may be rounded to the other side
        assert grids[0].max() == pytest.approx(grids[1].max(), abs=0.3)
        assert np.abs(grids[0] - grids[1]).mean() < 0.05


def test_extreme_odds_are_bounded(default_table: LikelihoodTable) -> None:
    c = simulated(30, 0)
    opposite = Correspondences([1.0, 2.0], [0.4, -0.7], [3.0, 5.0], [-0.4, 0.2])
    for mismatch in (1e-310, 1e-20, 1e-9, 1.0 - 1e-16):
        table = dataclasses.replace(default_table, mismatch=mismatch)
        assert 1e-6 <= table.prior_odds <= 1e6
        grid = table.log_likelihood_grid(c, 32)
        assert np.isfinite(grid).all()
        assert (table.log_likelihood_grid(opposite, 32).max() <= 0.01).all()


def test_a_profile_that_never_falls_has_a_grid(default_table: LikelihoodTable) -> None:
    for profile in (np.ones_like(default_table.profile), np.zeros_like(default_table.profile)):
        table = dataclasses.replace(default_table, profile=profile)
        assert np.isfinite(table.log_likelihood_grid(simulated(10, 0), 32)).all()


def test_grid_of_thousands_is_finite(default_table: LikelihoodTable) -> None:
    c, theta, phi = CorrespondenceSimulator(mismatch=0.5).pair(5000, 0)
    grid = default_table.log_likelihood_grid(c)
    assert np.isfinite(grid).all()
    assert grid.max() > 1000
    place = (np.array(np.unravel_index(grid.argmax(), grid.shape)) + 0.5) * TWO_PI / 128
    assert np.abs(wrap_to_pi(place - [theta, phi])).max() < 0.06


@pytest.mark.parametrize("name", EDGES)
@pytest.mark.parametrize("bins", [5, 64, 100])
def test_grid_is_finite_at_the_edges(default_table: LikelihoodTable, name: str, bins: int) -> None:
    left, right = EDGES[name]
    for azimuths in ((0.0, 0.0), (np.pi, np.nextafter(TWO_PI, 0)), (1.0, TWO_PI - 1e-17)):
        for n in (1, 100):
            c = Correspondences([azimuths[0]] * n, [left] * n, [azimuths[1]] * n, [right] * n)
            grid = default_table.log_likelihood_grid(c, bins)
            assert np.isfinite(grid).all()
            assert grid.min() >= n * np.log(default_table.mismatch) - 1e-3 * n


def test_points_on_the_horizon_say_next_to_nothing(default_table: LikelihoodTable) -> None:
    """Where the elevations are less than their noise nothing tells of the ratio."""
    rng = np.random.default_rng(0)
    for spread in (0.0, 1e-6):
        elevations = rng.normal(0.0, spread, (2, 20))
        azimuths = rng.uniform(0, TWO_PI, (2, 20))
        c = Correspondences(azimuths[0], elevations[0], azimuths[1], elevations[1])
        for i in range(20):
            grid = default_table.log_likelihood_grid(c[i : i + 1], 64).astype(float)
            # nowhere more than a true match may be worth, and no evidence of the whole
            assert grid.max() < 6.0
            assert np.log(np.exp(grid).mean()) < 1.0


# --- the branches ---------------------------------------------------------------------------------


def test_acute_branch_follows_the_constraint(default_table: LikelihoodTable) -> None:
    """The ridge lies on sin v = -r sin u, on the side where v is acute and opposite to u."""
    bins = 256
    axis = (np.arange(bins) + 0.5) * TWO_PI / bins
    for r in (0.15, 0.4, 0.7):
        c = Correspondences(1.0, 0.6, 2.5, np.arctan(r * np.tan(0.6)))
        grid = default_table.log_likelihood_grid(c, bins)
        best = axis[grid.argmax(axis=1)]
        u, v = axis - 1.0, wrap_to_pi(best - 2.5)
        # near the baseline the landmark may as well be beyond both views
        off = np.abs(u) > 0.25
        assert off.sum() >= bins - 22
        assert np.abs(v - np.arcsin(-r * np.sin(u)))[off].max() < 1.5 * TWO_PI / bins
        # exchanged, it is the row that is found for a column
        other = default_table.log_likelihood_grid(c.exchanged(), bins)
        assert (axis[other.argmax(axis=0)] == best).mean() > 0.99


def test_obtuse_branch_is_there_where_r_is_one(default_table: LikelihoodTable) -> None:
    """Without it a turn on the spot is seen as something else (METHOD: the branches)."""
    bins = 128
    cell = TWO_PI / bins
    for r in (1.0, 0.99, 1.01, 0.97):
        for elevation in (0.2, 0.6, 1.1):
            c = Correspondences(1.0, elevation, 1.0, np.arctan(r * np.tan(elevation)))
            grid = default_table.log_likelihood_grid(c, bins)
            # the same direction in both views: phi - theta = pi, all the way round
            rows = np.arange(bins)
            band = np.stack([grid[rows, (rows + bins // 2 + k) % bins] for k in (-1, 0, 1)])
            assert (band.max(axis=0) > 0.5).mean() > (0.9 if abs(r - 1.0) < 0.02 else 0.7)
    # far from one there is none
    c = Correspondences(1.0, 0.6, 1.0, np.arctan(0.5 * np.tan(0.6)))
    grid = default_table.log_likelihood_grid(c, bins)
    u = wrap_to_pi((np.arange(bins) + 0.5) * cell - 1.0)
    v = wrap_to_pi(np.pi - np.arcsin(-0.5 * np.sin(u)))
    obtuse = grid[np.arange(bins), np.floor((v + 1.0) / cell).astype(int) % bins]
    assert (obtuse[np.abs(u) > 0.5] < 0.0).all()


def test_different_sides_of_the_horizon_agree_with_no_pose(
    default_table: LikelihoodTable,
) -> None:
    """Well away from it, where no noise could have done it."""
    c = Correspondences([1.0, 2.0, 4.0], [0.4, -0.7, 0.3], [3.0, 5.0, 1.0], [-0.4, 0.2, -1.2])
    grid = default_table.log_likelihood_grid(c)
    assert (grid < 0).all()
    assert grid == pytest.approx(3 * np.log(default_table.mismatch), abs=0.05)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_turn_on_the_spot_is_a_diagonal_band(default_table: LikelihoodTable, noise: float) -> None:
    """Every pose of the right rotation is better than any other of a wrong one."""
    bins = 128
    for seed, rotation in enumerate((0.0, 1.1, -2.5)):
        c = turn_on_the_spot(rotation, 60, seed, noise=noise)
        grid = default_table.log_likelihood_grid(c, bins).astype(float)
        i, j = np.indices(grid.shape)
        turn = wrap_to_pi((i - j) * TWO_PI / bins + np.pi - rotation)
        band = np.abs(turn) < 0.75 * TWO_PI / bins
        others = np.abs(turn) > 3 * TWO_PI / bins
        assert np.median(grid[band]) > np.quantile(grid[others], 0.999) + 10
        prob = np.exp(grid - grid.max())
        assert prob[~others].sum() / prob.sum() > 0.99


def test_band_of_a_turn_on_the_spot_is_even(default_table: LikelihoodTable) -> None:
    """No cell of the band is better than another for how its ridge is drawn.

    All are a little better than the mean ratio: lines of sight may diverge by the tolerance.
    """
    bins = 64
    cell = TWO_PI / bins
    rows = np.arange(bins)
    differences = []
    for seed, turns in enumerate((5.0, 5.4)):
        c = turn_on_the_spot(turns * cell, 14, seed)
        c = c[np.abs(c.elevation_l) > 0.1]
        for grid, expected in compared(default_table, c, bins, 10):
            columns = (rows - 5 + bins // 2 + np.array([[-1], [0], [1]])) % bins
            differences.append((grid - expected)[rows, columns])
    difference = np.stack(differences)
    assert len(difference) > 20
    assert 0.0 < difference.mean() < 0.4
    assert difference.std() < 0.6
    # nor do they drift as the band runs past the landmark
    assert difference.mean(axis=(0, 1)).std() < 0.15


def test_headings_of_a_turn_on_the_spot_are_open(default_table: LikelihoodTable) -> None:
    """The grid says little more of them than the likelihood itself."""
    bins = 128
    phi = (np.arange(bins) + 0.5) * TWO_PI / bins
    ratio = []
    for seed in range(8):
        rotation = np.random.default_rng(seed).uniform(-3, 3)
        c = turn_on_the_spot(rotation, 25, seed, mismatch=0.3)
        beside = np.linspace(-0.05, 0.05, 11)
        poses = [[f + rotation - np.pi + b, f] for f in phi for b in beside]
        exact = np.exp(default_table.log_likelihood(c, poses).reshape(bins, -1))
        grid = np.exp(default_table.log_likelihood_grid(c, bins).astype(float))
        open_headings = []
        for mass in (grid.sum(axis=0), exact.sum(axis=1)):
            prob = mass / mass.sum()
            open_headings.append(np.exp(-np.sum(prob * np.log(np.maximum(prob, 1e-300)))))
        ratio.append(open_headings[0] / open_headings[1])
    assert np.median(ratio) > 0.5
    assert np.median(ratio) < 1.5


# --- the kernels ----------------------------------------------------------------------------------


@pytest.mark.parametrize("bins", [4, 5, 8, 17, 64])
def test_maxima_equal_their_naive_twin(bins: int) -> None:
    for seed in range(20):
        grid = np.random.default_rng(seed).normal(size=(bins, bins)).astype(np.float32)
        for margin, most in ((1.0, 40), (10.0, 3), (10.0, 400), (0.0, 5)):
            found = np.full((most, 3), np.nan)
            count = _maxima(grid.ravel(), bins, margin, found)
            expected = np.array(naive.local_maxima(grid, margin, most))
            assert count == len(expected)
            assert found[:count] == pytest.approx(expected, abs=1e-5)


def test_maxima_of_plateaus_are_found_once() -> None:
    """Of cells that are equal no more than one is a maximum, wherever the border cuts them."""
    for shift in range(8):
        grid = np.zeros((8, 8), np.float32)
        grid[2:4, 3:5] = 1.0
        found = np.empty((9, 3))
        rolled = np.roll(grid, (shift, 2 * shift), axis=(0, 1))
        assert _maxima(rolled.ravel().copy(), 8, 0.5, found) <= 1
    assert _maxima(np.zeros(64, np.float32), 8, 1.0, np.empty((4, 3))) == 0


def test_largest_is_the_maximum() -> None:
    rng = np.random.default_rng(0)
    for shift in (-1e9, -300.0, 0.0, 1e-30, 5.0):
        grid = (rng.normal(size=50) + shift).astype(np.float32)
        for first, last in ((0, 50), (7, 8), (3, 41)):
            found = _largest(grid.view(np.int32), first, last, np.empty(1, np.float32))
            assert found == grid[first:last].max()


def test_log_mean_exp_equals_its_naive_twin() -> None:
    rng = np.random.default_rng(0)
    for scale in (0.0, 1.0, 10.0, 300.0):
        grid = (scale * rng.normal(size=4096)).astype(np.float32)
        expected = np.logaddexp.reduce(grid.astype(float)) - np.log(4096)
        # (1 + x / 4096) ** 4096 is below exp(x) by x^2 / 8192, where x matters at all
        assert _log_mean_exp(grid) == pytest.approx(expected, abs=5e-3)
    one = np.full(4096, -1000.0, np.float32)
    one[7] = 500.0
    assert _log_mean_exp(one) == pytest.approx(500.0 - np.log(4096), abs=1e-3)


def test_candidates_are_the_maxima_of_the_grids(default_table: LikelihoodTable) -> None:
    pairs = [simulated(n, n) for n in (40, 1, 25, 100)] + [Correspondences.empty()]
    columns = np.concatenate([bearing_columns(c) for c in pairs], axis=1)
    odds = np.concatenate([default_table.odds(c) for c in pairs])
    first = np.cumsum([0, *map(len, pairs)])
    for bins, margin, most in ((64, 10.0, 16), (37, 3.0, 4)):
        found = default_table.ridges(bins).candidates(
            columns, default_table.shapes(columns), odds, first, margin=margin, most=most
        )
        assert (np.diff(found.owners) >= 0).all()
        for k, c in enumerate(pairs):
            own = found.owners == k
            grid = default_table.log_likelihood_grid(c, bins)
            evidence = np.logaddexp.reduce(grid.ravel().astype(float)) - 2 * np.log(bins)
            assert found.evidence[k] == pytest.approx(evidence, abs=0.01)
            expected = np.empty((most, 3))
            count = _maxima(grid.ravel(), bins, margin, expected)
            assert own.sum() == max(count, 1)
            assert found.values[own][:count] == pytest.approx(expected[:count, 2], abs=1e-6)
            if count:
                poses = (expected[:count, :2] + 0.5) * TWO_PI / bins
                apart = np.abs(wrap_to_pi(found.poses[own][:, None] - poses)).max(axis=2)
                assert apart.min(axis=1).max() < 1e-2


# --- many numbers at once -------------------------------------------------------------------------


@jit
def _three(shorts, floats, out, at, stride, start, step):
    add_lanes(shorts[1], at, shorts[0], start)
    add_shares(shorts[2], at, shorts[0], start, shorts[3], start)
    add_scaled(floats, at, shorts[0], start, np.float32(0.25))
    add_transposed(out, at, stride, shorts[0], start, step, np.float32(0.5))


def assert_lanes_are_right() -> None:
    rng = np.random.default_rng(0)
    for at, stride, start, step in ((0, 8, 0, 8), (3, 11, 5, 17), (100, 8, 1, 64)):
        shorts = rng.integers(0, 30_000, (4, 600)).astype(np.uint16)
        floats, out = rng.normal(size=(2, 400)).astype(np.float32)
        sums, scaled, transposed = shorts[1].copy(), floats.copy(), out.copy()
        sums[at : at + 16] += shorts[0, start : start + 16]
        parts = shorts[2].astype(int)
        parts[at : at + 16] += (
            shorts[0, start : start + 16].astype(int) * shorts[3, start : start + 16] // 65536
        )
        scaled[at : at + 8] += shorts[0, start : start + 8] / np.float32(4)
        for i in range(8):
            for j in range(8):
                transposed[at + i * stride + j] += shorts[0, start + j * step + i] / np.float32(2)
        _three(shorts, floats, out, at, stride, start, step)
        assert (shorts[1] == sums).all()
        assert (shorts[2] == parts).all()
        assert (floats == scaled).all()
        assert (out == transposed).all()


def test_lanes_equal_their_naive_twin() -> None:
    assert (LANES, HALF) == (16, 8)
    assert_lanes_are_right()


def test_everything_works_without_the_compiler() -> None:
    """As coverage and a debugger need it; the lanes have a twin in Python then."""
    code = """
import numpy as np
import test_ridges
from pflut import estimate_relative_pose, LikelihoodTable
from pflut.simulation.correspondences import CorrespondenceSimulator

test_ridges.assert_lanes_are_right()
c, theta, phi = CorrespondenceSimulator(mismatch=0.0).pair(6, 1)
table = LikelihoodTable.default(bins=12)
grid = table.log_likelihood_grid(c)
estimate = table.log_likelihood(c, [theta, phi])
print(*grid.ravel(), *estimate)
"""
    printed = []
    for off in ("0", "1"):
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", code],
            capture_output=True,
            text=True,
            env={**os.environ, "NUMBA_DISABLE_JIT": off, "PYTHONPATH": os.pathsep.join(sys.path)},
            timeout=120,
        )
        assert done.returncode == 0, done.stderr
        printed.append([float(word) for word in done.stdout.split()])
    assert printed[0] == pytest.approx(printed[1], abs=1e-3)


@pytest.mark.parametrize("bins", [16, 20, 63, 64, 192])
def test_a_window_of_the_grid_is_the_grid_there(default_table: LikelihoodTable, bins: int) -> None:
    rng = np.random.default_rng(0)
    for c in (simulated(100, 3), simulated(8, 4), Correspondences.empty()):
        grid = default_table.log_likelihood_grid(c, bins)
        for _ in range(20):
            first, count = rng.integers(bins, size=2), rng.integers(1, bins + 1, size=2)
            window = np.stack([first, count], axis=1)
            # memory that holds no earlier grid
            del_me = np.full((bins, bins), np.nan, np.float32)
            del del_me
            part = default_table.log_likelihood_grid(c, bins, window=window)
            cells = np.ix_(*((f + np.arange(n)) % bins for f, n in window))
            assert (part[cells] == grid[cells]).all()


@pytest.mark.parametrize(
    "window",
    [
        [[-1, 5], [0, 5]],
        [[0, 5], [64, 5]],
        [[0, 65], [0, 5]],
        [[0, 5], [0, -1]],
        [0, 5],
        [[0.0, 5.0], [0.0, 5.0]],
    ],
)
def test_windows_that_are_none_are_refused(default_table: LikelihoodTable, window: list) -> None:
    with pytest.raises(ValueError, match=r"^window: expected "):
        default_table.log_likelihood_grid(simulated(10, 0), 64, window=window)
