"""The residual table: the coordinates of a correspondence, scoring, climbing, options."""

from __future__ import annotations

import dataclasses

import naive
import numpy as np
import pytest
from naive import angles_of
from test_dense import EDGES, random_correspondences

from pflut.correspondences import Correspondences
from pflut.geometry import TWO_PI, wrap_to_2pi, wrap_to_pi
from pflut.likelihood.axes import (
    ELEVATION_CELLS,
    NEGATIVE_CELLS,
    PARALLAX_CELLS,
    PARALLAX_FINE,
    PARALLAX_MIN,
    PARALLAX_STEPS,
    RATIO_CELLS,
    RATIO_EDGES,
    RESIDUAL_CELLS,
    RESIDUAL_MAX,
    elevation_edges,
    parallax_edges,
    parallax_lookup,
    parallax_positions,
    residual_nodes,
)
from pflut.likelihood.counts import SHAPE_CELLS
from pflut.likelihood.residual_kernels import (
    NOTHING,
    PairArrays,
    _agreement,
    _meet,
    coordinates,
    describe,
    maximize,
    mean_parallax,
    score,
    shape_cell,
)
from pflut.likelihood.table import (
    QUALITY_CELLS,
    LikelihoodTable,
    bearing_columns,
    sines_and_cosines,
)
from pflut.simulation.correspondences import CorrespondenceSimulator

SIGMAS = 5.0


def random_table(seed: int = 0, classes: int = 3) -> LikelihoodTable:
    """Numbers that have nothing to do with geometry: an error in a cell's number shows."""
    rng = np.random.default_rng(seed)
    density = rng.gamma(0.5, 20.0, (PARALLAX_CELLS, SHAPE_CELLS, classes))
    profile = rng.uniform(0.1, 2.0, (ELEVATION_CELLS, RESIDUAL_CELLS + 1))
    return LikelihoodTable(density.astype(np.float32), profile.astype(np.float32), 0.8)


def noisy(mismatch: float, n: int, seed: int) -> tuple[Correspondences, np.ndarray]:
    c, *headings = CorrespondenceSimulator(mismatch=mismatch, noise=0.01).pair(n, seed)
    return c, np.array(headings)


def poses_near(headings: np.ndarray, n: int, seed: int) -> np.ndarray:
    """Half of them all over the torus, half of them where something agrees."""
    rng = np.random.default_rng(seed)
    near = headings + rng.normal(0.0, 0.05, (n - n // 2, 2))
    return np.concatenate([rng.uniform(0, TWO_PI, (n // 2, 2)), near])


# --- axes -----------------------------------------------------------------------------------------


def test_edges_of_the_axes() -> None:
    for edges, first, last in (
        (elevation_edges(), 0.0, np.pi / 2),
        (residual_nodes(), 0.0, RESIDUAL_MAX),
        (parallax_edges(), PARALLAX_MIN, np.pi),
        (RATIO_EDGES, -1.0, 1.0),
    ):
        assert edges[[0, -1]] == pytest.approx([first, last])
        assert (np.diff(edges) > 0).all()
    assert len(elevation_edges()) == ELEVATION_CELLS + 1
    assert len(residual_nodes()) == RESIDUAL_CELLS + 1
    assert len(parallax_edges()) == PARALLAX_CELLS
    assert RATIO_EDGES[NEGATIVE_CELLS] == 0.0
    # fine about zero, where far landmarks are
    widths = np.diff(parallax_edges())
    assert widths.min() < 0.5 * PARALLAX_FINE
    assert abs(parallax_edges()[widths.argmin()]) < PARALLAX_FINE


def test_parallax_is_looked_up_in_its_cell() -> None:
    lookup = parallax_lookup()
    assert lookup.shape == (PARALLAX_STEPS + 1,)
    for gamma in np.linspace(-np.pi, np.pi, 999):
        step = int((np.sin(gamma / 2) + 1) * PARALLAX_STEPS / 2)
        expected = np.searchsorted(parallax_edges()[:-1], gamma, side="right")
        near = np.abs(parallax_edges() - gamma).min() < 2.0 / PARALLAX_STEPS
        assert lookup[step] == expected or near
    assert (np.diff(lookup.astype(int)) >= 0).all()
    assert lookup[[0, -1]].tolist() == [0, PARALLAX_CELLS - 1]


def test_positions_lie_between_the_middles_of_the_cells() -> None:
    positions = parallax_positions()
    assert positions.shape == (PARALLAX_STEPS + 1,)
    assert (np.diff(positions) >= 0).all()
    assert positions[[0, -1]].tolist() == [0.0, PARALLAX_CELLS - 1]
    # nothing between the first cell and the others, which are no neighbours of it
    assert not ((positions > 0) & (positions < 1)).any()
    assert ((positions == 0) == (parallax_lookup() == 0)).all()
    # the middle of a cell is a whole number, and within half a cell it is nearest to its own
    cells = np.maximum(parallax_lookup().astype(float), 1)
    inside = positions > 0
    assert np.abs(positions - cells)[inside].max() < 0.8
    edges = parallax_edges()
    for k in range(1, PARALLAX_CELLS):
        step = int((np.sin(0.25 * (edges[k - 1] + edges[k])) + 1) * PARALLAX_STEPS / 2)
        assert positions[step] == pytest.approx(k, abs=0.2)


# --- the coordinates ------------------------------------------------------------------------------


def test_coordinates_equal_their_naive_twin() -> None:
    c = random_correspondences(400)
    # at the zenith the twin cannot move an azimuth, and on the horizon there is no residual
    keep = (np.abs(c.elevation_l) < 1.5) & (np.abs(c.elevation_r) < 1.5)
    keep &= np.maximum(np.abs(c.elevation_l), np.abs(c.elevation_r)) > 1e-3
    c = c[keep]
    slopes = np.empty(2)
    lookup = parallax_lookup()
    apart = 0
    for row, angles in zip(bearing_columns(c).T, angles_of(c), strict=True):
        for theta, phi in np.random.default_rng(1).uniform(0, TWO_PI, (5, 2)):
            residual, step = coordinates(
                row, np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi), slopes
            )
            assert residual == pytest.approx(naive.residuals(angles, theta, phi), abs=1e-7)
            expected = np.array(naive.residual_slopes(angles, theta, phi))
            assert slopes == pytest.approx(expected, abs=1e-6)
            gamma = naive.parallax(angles, theta, phi)
            assert np.isnan(gamma) == (step < 0)
            apart += step < 0
            if step >= 0:
                assert abs(step + 0.5 - (np.sin(gamma / 2) + 1) * PARALLAX_STEPS / 2) <= 0.5001
                assert lookup[step] == naive.parallax_cells(angles, theta, phi)
    assert 0.3 < apart / (5 * len(c)) < 0.7


def test_residual_is_the_distance_to_the_constraint() -> None:
    """To the first order: a true match with a little noise of known size, per unit of noise."""
    headings, angles = CorrespondenceSimulator(mismatch=0.0, noise=1e-3).sample(400, 25, 7)
    slopes = np.empty(2)
    found = [
        coordinates(row, np.sin(h[0]), np.cos(h[0]), np.sin(h[1]), np.cos(h[1]), slopes)[0]
        for h, pair in zip(headings, angles, strict=True)
        for row in np.ascontiguousarray(sines_and_cosines(*pair.T).T)
    ]
    # four normals of 1e-3, each along one direction of the gradient: one normal of 1e-3
    assert np.std(found) == pytest.approx(1e-3, rel=SIGMAS / np.sqrt(2 * len(found)) + 0.01)


def test_meet_equals_coordinates() -> None:
    """The loop without branches computes the same."""
    c = random_correspondences(203)
    rows = np.ascontiguousarray(bearing_columns(c).T)
    n = len(c)
    for theta, phi in np.random.default_rng(2).uniform(0, TWO_PI, (10, 2)):
        residuals, halves, by_theta, by_phi = np.empty((4, n))
        _meet(*rows.T.copy(), theta, phi, residuals, halves, by_theta, by_phi)
        slopes = np.empty(2)
        for i in range(n):
            residual, step = coordinates(
                rows[i], np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi), slopes
            )
            assert residuals[i] == pytest.approx(residual, abs=1e-9)
            assert [by_theta[i], by_phi[i]] == pytest.approx(slopes, abs=1e-9)
            assert (halves[i] < -1) == (step < 0)
            if step >= 0:
                assert abs(halves[i] - ((step + 0.5) * 2 / PARALLAX_STEPS - 1)) < 2 / PARALLAX_STEPS


def test_shape_cells_equal_their_naive_twin() -> None:
    c = random_correspondences(3000)
    angles = angles_of(c)[(np.abs(c.elevation_l) < 1.57) & (np.abs(c.elevation_r) < 1.57)]
    found = [shape_cell(np.tan(a[1]), np.tan(a[3])) for a in angles]
    assert found == [naive.shape(a) for a in angles]
    assert len(set(found)) > 0.5 * SHAPE_CELLS
    columns = sines_and_cosines(*angles.T)
    # the tangents differ in their last bits; points next to an edge may fall to either side
    assert (LikelihoodTable.shapes(columns) == found).mean() > 0.99


@pytest.mark.parametrize("name", EDGES)
def test_shape_cells_at_the_edges(name: str) -> None:
    left, right = EDGES[name]
    cell = shape_cell(np.tan(left), np.tan(right))
    assert 0 <= cell < SHAPE_CELLS
    assert shape_cell(np.tan(right), np.tan(left)) == cell
    assert shape_cell(-np.tan(left), -np.tan(right)) == cell
    columns = sines_and_cosines(*(np.array([x]) for x in (1.0, left, 2.0, right)))
    assert LikelihoodTable.shapes(columns)[0] == cell
    assert cell // ELEVATION_CELLS < RATIO_CELLS


def test_describe_gives_sines_and_cosines() -> None:
    c = random_correspondences(50)
    angles = angles_of(c).clip(-1.57, 7.0)
    slopes = angles.copy()
    slopes[:, 1::2] = np.tan(angles[:, 1::2])
    out = np.empty((50, 8))
    describe(slopes, out)
    assert out == pytest.approx(sines_and_cosines(*angles.T).T, abs=1e-12)


def test_agreement_equals_its_naive_twin() -> None:
    row = np.random.default_rng(0).uniform(size=RESIDUAL_CELLS + 1)
    for residual in [*np.random.default_rng(1).uniform(-0.3, 0.3, 200), 0.0, 0.2499999, 1.5]:
        assert _agreement(residual, row) == pytest.approx(naive.agreement(residual, row), abs=1e-9)
    assert _agreement(RESIDUAL_MAX, row) == 0.0
    assert _agreement(-np.pi / 2, row) == 0.0


def test_mean_parallax_equals_its_naive_twin() -> None:
    seen = []
    for seed in range(20):
        c, headings = noisy(0.5, 30, seed)
        for pose in (headings, headings + 0.1):
            found = mean_parallax(
                np.ascontiguousarray(bearing_columns(c).T), *pose, parallax_lookup(), 0.03
            )
            assert found == pytest.approx(naive.mean_parallax(angles_of(c), *pose, 0.03), abs=1e-9)
            seen.append(found)
    assert mean_parallax(np.empty((0, 8)), 0.0, 0.0, parallax_lookup(), 0.03) == 0.0
    assert np.ptp(seen) > 0.3


# --- scoring --------------------------------------------------------------------------------------


@pytest.mark.parametrize("classes", [1, 4])
def test_log_likelihood_equals_its_naive_twin(classes: int) -> None:
    table = random_table(classes=classes)
    for seed in range(3):
        c, headings = noisy(0.5, 40, seed)
        poses = poses_near(headings, 40, seed)
        odds = np.full(40, 0.25)
        expected = [
            naive.log_likelihood(angles_of(c), odds, *pose, table.density, table.profile)[0]
            for pose in poses
        ]
        assert table.log_likelihood(c, poses) == pytest.approx(expected, abs=1e-3)
        assert np.ptp(expected) > 10


def test_log_likelihood_of_the_default_equals_its_naive_twin(
    default_table: LikelihoodTable,
) -> None:
    c, headings = noisy(0.5, 60, 5)
    poses = poses_near(headings, 40, 0)
    odds = default_table.odds(c)
    density, profile = default_table.density, default_table.profile
    expected = [naive.log_likelihood(angles_of(c), odds, *p, density, profile)[0] for p in poses]
    # what is left out is below 1e-5 times the largest density
    assert default_table.log_likelihood(c, poses) == pytest.approx(expected, abs=0.05)
    assert default_table.log_likelihood(c, headings)[0] > max(expected[:20]) + 20


def test_hundreds_of_correspondences_do_not_overflow(default_table: LikelihoodTable) -> None:
    c, headings = noisy(0.0, 3000, 1)
    value = default_table.log_likelihood(c, headings)[0]
    single = [default_table.log_likelihood(c[i : i + 1], headings)[0] for i in range(3000)]
    assert np.isfinite(value)
    # the classes know of the others' depth, alone a correspondence does not
    assert value > 0.9 * sum(single) > 1000


def test_log_likelihood_of_one_class_is_a_sum() -> None:
    table = random_table(classes=1)
    c, headings = noisy(0.5, 30, 1)
    poses = poses_near(headings, 20, 1)
    parts = [table.log_likelihood(c[i : i + 1], poses) for i in range(30)]
    assert table.log_likelihood(c, poses) == pytest.approx(np.sum(parts, axis=0), abs=1e-9)


def test_symmetries_of_the_log_likelihood(default_table: LikelihoodTable) -> None:
    c, headings = noisy(0.5, 60, 2)
    poses = poses_near(headings, 60, 2)
    value = default_table.log_likelihood(c, poses)
    exchanged = default_table.log_likelihood(c.exchanged(), poses[:, ::-1])
    mirrored = Correspondences(-c.azimuth_l, c.elevation_l, -c.azimuth_r, c.elevation_r)
    flipped = Correspondences(c.azimuth_l, -c.elevation_l, c.azimuth_r, -c.elevation_r)
    turned = Correspondences(c.azimuth_l + 1.0, c.elevation_l, c.azimuth_r - 2.0, c.elevation_r)
    assert exchanged == pytest.approx(value, abs=1e-6)
    assert default_table.log_likelihood(mirrored, -poses) == pytest.approx(value, abs=1e-6)
    assert default_table.log_likelihood(flipped, poses) == pytest.approx(value, abs=1e-6)
    moved = default_table.log_likelihood(turned, poses + np.array([1.0, -2.0]))
    # a rounding may carry the parallax into the next step of its axis
    assert np.median(np.abs(moved - value)) < 1e-6
    assert np.abs(moved - value).max() < 0.5


def test_log_likelihood_of_none_is_zero(default_table: LikelihoodTable) -> None:
    none = Correspondences.empty()
    assert default_table.log_likelihood(none, np.ones((7, 2))).tolist() == [0.0] * 7
    c, headings = noisy(0.0, 10, 0)
    assert default_table.log_likelihood(c, np.empty((0, 2))).shape == (0,)
    assert default_table.log_likelihood(c, headings).shape == (1,)


@pytest.mark.parametrize("name", EDGES)
def test_log_likelihood_is_finite_at_the_edges(default_table: LikelihoodTable, name: str) -> None:
    left, right = EDGES[name]
    c = Correspondences([1.0, 1.0, 0.0], [left] * 3, [2.0, 1.0, np.pi], [right] * 3)
    axis = np.linspace(0, TWO_PI, 33)
    poses = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    # on the base line itself, to the last bit
    poses = np.concatenate([poses, [[1.0, 2.0], [1.0 + np.pi, 2.0], [1.0, 1.0 + np.pi]]])
    value = default_table.log_likelihood(c, poses)
    assert np.isfinite(value).all()
    assert value.min() >= 3 * np.log(default_table.mismatch) - 1e-9


def ratios_of(table: LikelihoodTable, angles: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Give each correspondence's ratio of true match to mismatch at a pose of its own."""
    columns, n = sines_and_cosines(*angles.T), len(angles)
    out = np.empty(n)
    pairs = PairArrays(columns, table.shapes(columns), np.ones(n), np.arange(n + 1))
    score(pairs, np.ascontiguousarray(poses), np.arange(n), table.arrays, out)
    return np.exp(out) - 1.0


def test_mismatches_have_a_mean_ratio_of_one(default_table: LikelihoodTable) -> None:
    """A density ratio averages to one over what its denominator is the density of."""
    rng = np.random.default_rng(5)
    pairs, n = 20_000, 50
    _, angles = CorrespondenceSimulator(mismatch=1.0).sample(pairs, n, rng)
    poses = rng.uniform(0, TWO_PI, (pairs * n, 2))
    ratios = ratios_of(default_table, angles.reshape(-1, 4), poses)
    # those of one pair of places are not independent
    means = ratios.reshape(pairs, n).mean(axis=1)
    error = means.std() / np.sqrt(pairs)
    assert abs(means.mean() - 1) < SIGMAS * error
    assert error < 0.02


def test_true_matches_have_a_large_ratio(default_table: LikelihoodTable) -> None:
    headings, angles = CorrespondenceSimulator(mismatch=0.0).sample(2000, 20, 6)
    ratios = ratios_of(default_table, angles.reshape(-1, 4), np.repeat(headings, 20, axis=0))
    # the mean is the divergence of the two densities: how much a correspondence tells
    assert np.log(np.maximum(ratios, 1e-3)).mean() > 4.5
    assert (ratios < 1.0).mean() < 0.05


# --- climbing -------------------------------------------------------------------------------------


def climbed(
    table: LikelihoodTable, pairs: list[Correspondences], poses: np.ndarray, owners, steps: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give the poses after so many steps, their values before the last one, and informations."""
    columns = np.concatenate([bearing_columns(c) for c in pairs], axis=1)
    moved, value, information = poses.copy(), np.empty(len(poses)), np.empty((len(poses), 5))
    arrays = PairArrays(
        columns,
        table.shapes(columns),
        np.concatenate([table.odds(c) for c in pairs]),
        np.cumsum([0, *map(len, pairs)]),
    )
    maximize(arrays, moved, np.asarray(owners), steps, table.arrays, value, information)
    return moved, value, information


def test_one_step_equals_its_naive_twin(default_table: LikelihoodTable) -> None:
    for table in (default_table, random_table(1)):
        pairs, owners, poses = [], [], []
        for seed in range(6):
            c, headings = noisy(0.4, 17 + seed, seed)
            pairs.append(c)
            for pose in poses_near(headings, 4, seed):
                owners.append(seed)
                poses.append(pose)
        moved, value, information = climbed(table, pairs, np.array(poses), owners, 1)
        for k, (owner, pose) in enumerate(zip(owners, poses, strict=True)):
            angles, odds = angles_of(pairs[owner]), table.odds(pairs[owner])
            expected = naive.climb(angles, odds, *pose, table.density, table.profile, NOTHING)
            assert moved[k] == pytest.approx(expected[0], abs=1e-4)
            assert information[k] == pytest.approx(expected[1], rel=1e-3, abs=1e-3)
            value[k] -= np.log1p(odds).sum()
            likely, _ = naive.log_likelihood(angles, odds, *pose, table.density, table.profile)
            assert value[k] == pytest.approx(likely, abs=0.02)


def test_value_is_the_log_likelihood(default_table: LikelihoodTable) -> None:
    """Of the pose before the last step."""
    c, headings = noisy(0.5, 80, 3)
    start = poses_near(headings, 10, 3)
    before, *_ = climbed(default_table, [c], start, np.zeros(10, int), 2)
    _, value, _ = climbed(default_table, [c], start, np.zeros(10, int), 3)
    constant = np.log1p(default_table.odds(c)).sum()
    assert value - constant == pytest.approx(default_table.log_likelihood(c, before), abs=1e-6)


def test_climbing_ends_near_the_maximum(default_table: LikelihoodTable) -> None:
    """Nearly: it moves by the residuals alone, while the landmarks' density changes too."""
    gained, missed, errors = [], [], []
    for seed in range(60):
        c, headings = noisy(0.5, 60, seed)
        start = headings + np.random.default_rng(seed).normal(0.0, 0.01, 2)
        poses, *_ = climbed(default_table, [c], start[None], [0], 30)
        further, *_ = climbed(default_table, [c], poses, [0], 1)
        assert np.abs(further - poses).max() < 1e-3
        around = poses + np.random.default_rng(seed).normal(0.0, 0.01, (200, 2))
        before, here = default_table.log_likelihood(c, [start, poses[0]])
        gained.append(here - before)
        missed.append(default_table.log_likelihood(c, around).max() - here)
        errors.append(np.abs(wrap_to_pi(poses[0] - headings)).max())
    assert np.median(gained) > 1.5
    assert np.percentile(gained, 10) > 0.0
    assert np.median(missed) < 0.3
    assert np.median(errors) < 0.01


def test_climbing_leaves_what_nothing_agrees_with(default_table: LikelihoodTable) -> None:
    none = Correspondences.empty()
    poses = np.array([[1.0, 2.0], [3.0, 4.0]])
    moved, value, information = climbed(default_table, [none], poses, [0, 0], 8)
    assert (moved == poses).all()
    assert not value.any()
    assert not information.any()


@pytest.mark.parametrize("name", EDGES)
def test_climbing_is_finite_at_the_edges(default_table: LikelihoodTable, name: str) -> None:
    left, right = EDGES[name]
    c = Correspondences([1.0, 1.0, 0.0], [left] * 3, [2.0, 1.0, np.pi], [right] * 3)
    poses = np.random.default_rng(0).uniform(0, TWO_PI, (50, 2))
    moved, value, information = climbed(default_table, [c], poses, np.zeros(50, int), 8)
    assert np.isfinite(moved).all()
    assert np.isfinite(value).all()
    assert np.isfinite(information).all()


# --- the table ------------------------------------------------------------------------------------


def test_default_is_the_paper_s(default_table: LikelihoodTable) -> None:
    assert default_table.density.shape == (PARALLAX_CELLS, SHAPE_CELLS, 4)
    assert (default_table.bins, default_table.num_classes, default_table.mismatch) == (128, 4, 0.9)
    assert default_table.prior_odds == pytest.approx(1 / 9)
    assert default_table.quality is None
    assert default_table.learned_from["simulator"] == dataclasses.asdict(CorrespondenceSimulator())
    assert LikelihoodTable.default(bins=256).bins == 256


def test_with_bins_is_the_same_table(default_table: LikelihoodTable) -> None:
    c, headings = noisy(0.5, 40, 0)
    other = default_table.with_bins(63)
    assert other.bins == 63
    assert default_table.bins == 128
    assert other.log_likelihood_grid(c).shape == (63, 63)
    assert (other.log_likelihood_grid(c) == default_table.log_likelihood_grid(c, 63)).all()
    assert other.log_likelihood(c, headings) == default_table.log_likelihood(c, headings)
    assert other.learned_from == default_table.learned_from


def with_quality(table: LikelihoodTable) -> LikelihoodTable:
    return dataclasses.replace(table, quality=np.linspace(4.0, 0.25, QUALITY_CELLS))


def test_odds_count_quality_where_both_know_it(default_table: LikelihoodTable) -> None:
    c = random_correspondences(5)
    scored = Correspondences(
        c.azimuth_l, c.elevation_l, c.azimuth_r, c.elevation_r, quality=[0.0, 0.049, 0.5, 0.99, 1.0]
    )
    table = with_quality(default_table)
    prior = default_table.prior_odds
    assert default_table.odds(c) == pytest.approx([prior] * 5)
    assert default_table.odds(scored) == pytest.approx([prior] * 5)
    assert table.odds(c) == pytest.approx([prior] * 5)
    q = table.quality
    assert q is not None
    expected = prior * q[[0, 0, 10, 19, 19]]
    assert table.odds(scored) == pytest.approx(expected)
    assert table.odds(Correspondences.empty()).shape == (0,)
    nothing = dataclasses.replace(table, quality=np.zeros(QUALITY_CELLS))
    assert (nothing.odds(scored) > 0).all()


def test_quality_counts_in_grid_and_score(default_table: LikelihoodTable) -> None:
    c, headings = noisy(0.0, 30, 3)
    table = with_quality(default_table)
    angles = angles_of(c).T
    good, bad = (Correspondences(*angles, quality=np.full(30, q)) for q in (0.02, 0.98))
    for at in (
        lambda x: table.log_likelihood(x, headings)[0],
        lambda x: table.log_likelihood_grid(x).max(),
    ):
        assert at(good) > at(c) + 10 > at(bad) + 20


@pytest.mark.parametrize("noise", [0.005, 0.01, 0.02])
def test_noise_is_the_simulator_s(noise: float) -> None:
    simulator = CorrespondenceSimulator(noise=noise)
    table = LikelihoodTable.from_simulation(num_samples=2_000_000, simulator=simulator)
    assert table.noise == pytest.approx(noise, rel=0.1)


BAD_ARRAYS = {
    "density": [np.zeros((3, 4)), np.zeros((PARALLAX_CELLS, SHAPE_CELLS, 0)), np.zeros(())],
    "profile": [np.zeros((ELEVATION_CELLS, RESIDUAL_CELLS)), np.zeros(3)],
    "quality": [np.zeros(QUALITY_CELLS + 1), np.zeros(())],
}


@pytest.mark.parametrize("name", BAD_ARRAYS)
def test_arrays_out_of_range_are_named(default_table: LikelihoodTable, name: str) -> None:
    for bad in BAD_ARRAYS[name]:
        with pytest.raises(ValueError, match=rf"{name}: expected shape \("):
            dataclasses.replace(default_table, **{name: bad})
    good = getattr(with_quality(default_table), name)
    for value in (np.nan, np.inf, -1.0):
        spoilt = good.copy()
        spoilt.flat[-1] = value
        with pytest.raises(ValueError, match=f"{name}: expected finite numbers that are not neg"):
            dataclasses.replace(default_table, **{name: spoilt})


@pytest.mark.parametrize("mismatch", [0.0, 1.0, -0.5, np.nan])
def test_mismatch_out_of_range(default_table: LikelihoodTable, mismatch: float) -> None:
    with pytest.raises(ValueError, match=r"mismatch: expected a share in \(0, 1\)"):
        dataclasses.replace(default_table, mismatch=mismatch)


@pytest.mark.parametrize("bins", [3, 1025, 0, -1])
def test_bins_out_of_range(default_table: LikelihoodTable, bins: int) -> None:
    for call in (
        lambda: default_table.with_bins(bins),
        lambda: default_table.ridges(bins),
        lambda: default_table.log_likelihood_grid(Correspondences.empty(), bins),
        lambda: LikelihoodTable.default(bins=bins),
    ):
        with pytest.raises(ValueError, match="bins: expected 4 to 1024"):
            call()


@pytest.mark.parametrize("shape", [(3,), (4, 3), (2, 2, 2)])
def test_headings_of_another_shape(default_table: LikelihoodTable, shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"headings: expected shape \(m, 2\)"):
        default_table.log_likelihood(Correspondences.empty(), np.zeros(shape))


def test_angles_of_any_turn_are_the_same(default_table: LikelihoodTable) -> None:
    c, headings = noisy(0.5, 40, 0)
    wound = headings + np.array([TWO_PI, -2 * TWO_PI])
    value = default_table.log_likelihood(c, [headings, wound, wrap_to_2pi(headings)])
    assert value == pytest.approx(value[0], abs=0.2)


@pytest.mark.parametrize("bins", [64.0, 64.5, "64", 3, 1025])
def test_bins_that_are_no_number_of_cells_are_named(default_table: LikelihoodTable, bins) -> None:
    c = Correspondences([1.0], [0.1], [1.0], [0.2])
    with pytest.raises(ValueError, match=r"bins: expected (an integer|4 to 1024)"):
        default_table.log_likelihood_grid(c, bins)
    assert default_table.log_likelihood_grid(c, 64).shape == (64, 64)
