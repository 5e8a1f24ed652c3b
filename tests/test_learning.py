"""Learning the residual table: counting, the simulator's density, real pairs, quality."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import naive
import numpy as np
import pytest
from naive import angles_of
from scipy import optimize

from pflut._random import uniform
from pflut.correspondences import Correspondences
from pflut.geometry import TWO_PI, bearing_angles, wrap_to_2pi
from pflut.likelihood.axes import (
    ELEVATION_CELLS,
    NEGATIVE_CELLS,
    PARALLAX_CELLS,
    RATIO_CELLS,
    RESIDUAL_CELLS,
    parallax_edges,
    parallax_lookup,
    residual_nodes,
)
from pflut.likelihood.counts import SHAPE_CELLS, Counts
from pflut.likelihood.fitting import _decreasing, fit, quality_ratio
from pflut.likelihood.known_pairs import as_slopes
from pflut.likelihood.learning import BLOCK, count_simulated
from pflut.likelihood.pair_learning import (
    CHANCE_SAMPLES,
    _count_quality,
    count_pairs,
    pose_weights,
)
from pflut.likelihood.residual_kernels import count_chance, count_true
from pflut.likelihood.table import QUALITY_CELLS, LikelihoodTable, bearing_columns
from pflut.simulation.correspondences import CorrespondenceSimulator

SIGMAS = 5.0


def sampled(pairs: int, n: int, seed: int, mismatch: float = 0.0):
    """Headings, slopes as the kernels take them, and the same as angles."""
    headings, angles = CorrespondenceSimulator(mismatch=mismatch).sample(pairs, n, seed)
    slopes = angles.copy()
    slopes[..., 1::2] = np.tan(angles[..., 1::2])
    return headings, slopes, angles


# --- counting -------------------------------------------------------------------------------------


def test_count_true_equals_its_naive_twin() -> None:
    headings, slopes, angles = sampled(12, 20, 0, mismatch=0.3)
    weights = np.random.default_rng(1).uniform(size=12)
    band, edges = 0.03, np.array([0.3, 0.5])
    counts = Counts.zeros(3)
    count_true(
        slopes,
        headings,
        weights,
        parallax_lookup(),
        band,
        edges,
        np.empty((20, 8)),
        counts.inside,
        counts.profile,
        counts.seen,
    )
    expected = Counts.zeros(3)
    for pose, pair, weight in zip(headings, angles, weights, strict=True):
        depth = int((naive.mean_parallax(pair, *pose, band) > edges).sum())
        inside, profile = naive.count_residuals(pair, *pose, band)
        expected.inside[depth] += weight * inside
        expected.profile += weight * profile
        expected.seen[depth] += 20 * weight
    assert (expected.seen > 0).all()
    for name in ("inside", "profile", "seen"):
        assert getattr(counts, name) == pytest.approx(getattr(expected, name), abs=1e-9), name


def test_count_chance_equals_its_naive_twin() -> None:
    """At the same poses, which the twin draws with integers of its own."""
    _, slopes, angles = sampled(1, 40, 2, mismatch=1.0)
    counts, draws, band = Counts.zeros(1), 7, 0.1
    with np.errstate(over="ignore"):
        count_chance(
            slopes[0],
            np.array([2**64 - 12345], np.uint64),
            draws,
            parallax_lookup(),
            band,
            np.empty((40, 8)),
            counts.chance_inside,
            counts.chance_profile,
        )
    random = naive.SplitMix(2**64 - 12345)
    expected = Counts.zeros(1)
    for bearing in angles[0]:
        for _ in range(draws):
            theta, phi = (TWO_PI * random.uniform() for _ in range(2))
            inside, profile = naive.count_residuals([bearing], theta, phi, band)
            expected.chance_inside += inside
            expected.chance_profile += profile
    assert expected.chance_inside.sum() > 10
    assert (counts.chance_inside == expected.chance_inside).all()
    assert (counts.chance_profile == expected.chance_profile).all()
    assert counts.chance_profile.sum() == 40 * draws


def test_random_numbers_are_splitmix() -> None:
    state, random = np.array([7], np.uint64), naive.SplitMix(7)
    with np.errstate(over="ignore"):
        assert [uniform(state) for _ in range(50)] == [random.uniform() for _ in range(50)]


def test_learning_does_not_depend_on_the_threads() -> None:
    samples = 2 * 20 * BLOCK - 17

    def counted(seed: int, threads: int) -> Counts:
        return count_simulated(
            CorrespondenceSimulator(), samples, num_classes=3, seed=seed, num_threads=threads
        )

    one, two, three, other = counted(1, 1), counted(1, 2), counted(1, 3), counted(2, 1)
    assert one.seen.sum() == 20 * BLOCK
    assert one.chance_profile.sum() == 20 * BLOCK
    for name in vars(one):
        assert (getattr(one, name) == getattr(two, name)).all()
        assert (getattr(one, name) == getattr(three, name)).all()
    assert (one.inside != other.inside).any()
    # the classes are quantiles of 8,192 other pairs; here are 10,240
    assert one.seen / one.seen.sum() == pytest.approx(1 / 3, abs=SIGMAS * 0.007)


def test_table_is_reproducible() -> None:
    def learn(seed: int, threads: int, samples: int = 8 * BLOCK) -> LikelihoodTable:
        return LikelihoodTable.from_simulation(
            num_samples=samples, seed=seed, num_threads=threads, num_classes=2
        )

    assert (learn(7, 1).density == learn(7, 3).density).all()
    assert (learn(7, 1).profile == learn(7, 3).profile).all()
    assert (learn(7, 1).density != learn(8, 1).density).any()
    assert np.isfinite(learn(0, 1, 1).density).all()


def test_progress_is_reported() -> None:
    seen: list[tuple[int, int]] = []
    LikelihoodTable.from_simulation(
        num_samples=40 * BLOCK, num_threads=2, progress=lambda *done: seen.append(done)
    )
    assert seen[-1] == (40 * BLOCK, 40 * BLOCK)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def test_what_the_table_says_it_was_learned_from() -> None:
    simulator = CorrespondenceSimulator(mismatch=0.6, noise=0.02, scene="box")
    table = LikelihoodTable.from_simulation(
        num_samples=4 * BLOCK, simulator=simulator, num_classes=2, bins=40, seed=9
    )
    assert (table.mismatch, table.bins, table.num_classes) == (0.6, 40, 2)
    told = table.learned_from
    assert told["simulator"] == dataclasses.asdict(simulator)
    assert (told["num_samples"], told["num_classes"], told["seed"]) == (4 * BLOCK, 2, 9)


# --- the learned density against the simulator's own ----------------------------------------------


def seen_by_chance_and_truly(count: int, seed: int):
    """Rows of bearings with a pose each: true matches at theirs, mismatches at any.

    A simulator of its own, in NumPy: landmarks in a ball, cameras on a circle, normal noise.
    """
    rng = np.random.default_rng(seed)

    def bearings(places: np.ndarray, yaw: np.ndarray, points: np.ndarray) -> tuple:
        """Noise moves the point in the plane that touches the sphere there."""
        sight = points - places
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        east = np.cross([0.0, 0.0, 1.0], sight)
        east /= np.linalg.norm(east, axis=1, keepdims=True)
        noise = 0.01 * rng.normal(size=(2, len(sight), 1))
        azimuth, elevation = bearing_angles(
            sight + noise[0] * east + noise[1] * np.cross(sight, east)
        )
        return azimuth - yaw, elevation

    def ball(n: int) -> np.ndarray:
        points = rng.normal(size=(n, 3))
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        return 2.0 * points * rng.uniform(size=(n, 1)) ** (1 / 3)

    angle = rng.uniform(0, TWO_PI, (2, count))
    left, right = (np.stack([np.cos(a), np.sin(a), 0 * a], axis=1) for a in angle)
    yaw = rng.uniform(0, TWO_PI, (2, count))
    points = ball(count)
    towards = right - left
    direction = np.arctan2(towards[:, 1], towards[:, 0])
    poses = np.stack([direction - yaw[0], direction + np.pi - yaw[1]], axis=1)
    view = bearings(left, yaw[0], points)
    true = np.stack([*view, *bearings(right, yaw[1], points)], axis=1)
    false = np.stack([*view, *bearings(right, yaw[1], ball(count))], axis=1)
    return true, wrap_to_2pi(poses), false, rng.uniform(0, TWO_PI, (count, 2))


def cells_of(angles: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residual, cell of the parallax and shape of rows, by the twins, all rows at once."""
    columns = angles.T
    residual = np.abs(naive.residuals(columns, *poses.T))
    shapes = LikelihoodTable.shapes(bearing_columns(Correspondences(*columns)))
    return residual, naive.parallax_cells(columns, *poses.T), shapes


@pytest.fixture(scope="module")
def met() -> tuple:
    """Residual, parallax and shape of true matches and of mismatches."""
    true, poses, false, anywhere = seen_by_chance_and_truly(400_000, 11)
    return cells_of(true, poses), cells_of(false, anywhere)


def blocks_of(parallax: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Number cells of four by four by three, so that each is met often enough."""
    ratio, elevation = np.divmod(shapes, ELEVATION_CELLS)
    return (parallax // 4 * 5 + ratio // 4) * 4 + elevation // 3


def test_density_is_the_simulator_s(default_table: LikelihoodTable, met: tuple) -> None:
    """Counted with other random numbers and other code, in cells put together."""
    (residual, parallax, shapes), (by_chance, chance_parallax, chance_shapes) = met
    band, size = 0.02, 8 * 5 * 4
    inside, chance_inside = residual < band, by_chance < band
    counts = np.bincount(blocks_of(parallax, shapes)[inside], minlength=size)
    chance = np.bincount(blocks_of(chance_parallax, chance_shapes)[chance_inside], minlength=size)
    # what the table says of the mismatches that were met: its mean ratio times their number
    profile = np.array(
        [
            naive.agreement(e, default_table.profile[s % ELEVATION_CELLS])
            for e, s in zip(by_chance[chance_inside], chance_shapes[chance_inside], strict=True)
        ]
    )
    density = default_table.density.mean(axis=2)
    ratios = density[chance_parallax[chance_inside], chance_shapes[chance_inside]] * profile
    block = blocks_of(chance_parallax, chance_shapes)[chance_inside]
    expected = np.bincount(block, ratios, size)
    spread = np.bincount(block, ratios**2, size)
    # of the few that were never met by chance nothing can be expected
    known = chance >= 30
    assert known.sum() > 50
    assert counts[known].sum() > 0.75 * counts.sum()
    error = (counts - expected)[known] / np.sqrt((np.maximum(expected, counts) + spread)[known])
    assert np.abs(error).max() < SIGMAS + 1.0
    assert np.sqrt(np.mean(error**2)) < 1.6


def test_profile_is_the_noise_s(default_table: LikelihoodTable, met: tuple) -> None:
    """Beyond the very horizon: residuals of true matches over those of chance."""
    (residual, _, shapes), (by_chance, _, chance_shapes) = met
    nodes = residual_nodes()
    for elevation in range(1, ELEVATION_CELLS):
        own = residual[shapes % ELEVATION_CELLS == elevation]
        others = by_chance[chance_shapes % ELEVATION_CELLS == elevation]
        edges = nodes[[0, 6, 9, 12, 15, 18]]
        counted = np.histogram(own, edges)[0] / len(own)
        chance = np.histogram(others, edges)[0] / len(others)
        fine = np.linspace(0, edges[-1], 2000)
        row = naive.agreement(fine, default_table.profile[elevation])
        said = np.array([row[(fine >= a) & (fine < b)].mean() for a, b in pairwise(edges)])
        said *= chance
        said /= said.sum()
        counted /= counted.sum()
        error = SIGMAS * np.sqrt(counted / len(own) + (said / chance) ** 2 * chance / len(others))
        assert (np.abs(said - counted) < error + 0.02).all(), elevation


def test_what_only_noise_can_do_is_improbable(default_table: LikelihoodTable) -> None:
    """Lines of sight that diverge, or to different sides of the base line or of the horizon."""
    density = default_table.density.mean(axis=2).reshape(PARALLAX_CELLS, RATIO_CELLS, -1)
    # 22 to 50 degrees; at the zenith noise turns a line of sight by any angle
    high = density[:, NEGATIVE_CELLS:, 6:9]
    diverging = parallax_edges()[1:] < -0.1
    assert diverging.sum() >= 3
    assert high[1:][diverging].max() < 0.05
    # a landmark near the base line is seen on either side of it
    assert high[0].max() < 2.0
    assert density[:, :NEGATIVE_CELLS, 6:9].max() < 0.5
    assert high.max() > 100.0


def test_fit_of_the_counts_themselves() -> None:
    """Mismatches that are counted at the true pose are taken off again."""
    simulator = CorrespondenceSimulator()
    counts = count_simulated(simulator, 4_000_000, num_classes=2, seed=1)
    density, profile = fit(counts)
    mixed = Counts(**{name: value.copy() for name, value in vars(counts).items()})
    # as many mismatches in the same places as chance brings: half of the samples
    share = counts.seen / counts.chance_profile.sum()
    mixed.inside += share[:, None, None] * counts.chance_inside
    mixed.profile += share.sum() * counts.chance_profile
    mixed.seen *= 2.0
    again, profile_again = fit(mixed, 0.5)
    assert again == pytest.approx(density, rel=1e-3, abs=1e-3)
    assert profile_again == pytest.approx(profile, rel=1e-3, abs=1e-3)


def test_profile_is_scaled_to_chance(default_table: LikelihoodTable) -> None:
    """Its mean over the mismatches within the band is one: the density keeps its meaning."""
    nodes = residual_nodes()
    fine = np.linspace(0, 4 * 0.6745 * default_table.noise, 2000)
    for row in default_table.profile[3:]:
        # a mismatch's residual is all but uniform where it is small
        assert np.interp(fine, nodes, row).mean() == pytest.approx(1.0, abs=0.1)


# --- real pairs -----------------------------------------------------------------------------------


def real_pairs(n: int, size: int, mismatch: float, seed: int, noise: float = 0.01):
    headings, angles = CorrespondenceSimulator(mismatch=mismatch, noise=noise).sample(n, size, seed)
    return [(Correspondences(*pair.T), *pose) for pair, pose in zip(angles, headings, strict=True)]


@pytest.mark.parametrize("mismatch", [0.2, 0.6, 0.9])
def test_pairs_tell_the_share_of_mismatches(default_table: LikelihoodTable, mismatch) -> None:
    pairs = real_pairs(400, 50, mismatch, 3)
    table = LikelihoodTable.from_pairs(pairs, prior=default_table)
    assert table.mismatch == pytest.approx(mismatch, abs=0.05)
    told = table.learned_from
    assert (told["source"], told["num_samples"]) == ("pairs", 20_000)
    assert told["prior"] == default_table.learned_from


def test_few_pairs_leave_the_prior(default_table: LikelihoodTable) -> None:
    few = LikelihoodTable.from_pairs(
        real_pairs(5, 10, 0.5, 1), prior=default_table, prior_samples=1e6
    )
    large = default_table.density > 1.0
    # but for the very cells that the few fell into
    same = np.isclose(few.density[large], default_table.density[large], rtol=0.05)
    assert same.mean() > 0.999
    assert few.profile == pytest.approx(default_table.profile, rel=0.05, abs=0.05)
    assert few.bins == default_table.bins
    assert LikelihoodTable.from_pairs(real_pairs(5, 10, 0.5, 1), bins=48).bins == 48


def test_many_pairs_overrule_the_prior(default_table: LikelihoodTable) -> None:
    """A sharper camera than the prior's: the profile becomes narrower."""
    pairs = real_pairs(800, 50, 0.5, 2, noise=0.004)
    table = LikelihoodTable.from_pairs(pairs, prior=default_table, prior_samples=200.0)
    assert table.noise < 0.6 * default_table.noise
    assert table.noise > 0.003


def test_pairs_and_simulation_learn_the_same(default_table: LikelihoodTable) -> None:
    pairs = real_pairs(3000, 50, 0.5, 4)
    table = LikelihoodTable.from_pairs(pairs, prior=default_table, prior_samples=100.0)
    test = real_pairs(300, 40, 0.5, 5)

    def told(by: LikelihoodTable) -> float:
        by = dataclasses.replace(by, mismatch=0.5)
        return float(np.mean([by.log_likelihood(c, pose)[0] for c, *pose in test]))

    # of 85 nats of forty correspondences: of cells that chance hardly ever met no evidence is
    # taken, and that is most of the finer ones
    assert told(table) == pytest.approx(told(default_table), abs=8.0)
    assert table.noise == pytest.approx(default_table.noise, rel=0.1)


def test_pairs_without_correspondences(default_table: LikelihoodTable) -> None:
    pairs = real_pairs(20, 10, 0.3, 0)
    empty = (Correspondences.empty(), 0.0, 0.0)
    table = LikelihoodTable.from_pairs([empty, *pairs, empty], prior=default_table)
    same = LikelihoodTable.from_pairs(iter(pairs), prior=default_table)
    assert (table.density == same.density).all()
    assert (table.profile == same.profile).all()
    for none in ([], [empty]):
        with pytest.raises(ValueError, match="at least one pair"):
            LikelihoodTable.from_pairs(none, prior=default_table)


def test_learning_from_pairs_is_reproducible(default_table: LikelihoodTable) -> None:
    pairs = real_pairs(20, 10, 0.3, 0)
    one, two, other = (
        LikelihoodTable.from_pairs(pairs, prior=default_table, seed=seed) for seed in (1, 1, 2)
    )
    assert (one.density == two.density).all()
    assert (one.density != other.density).any()


def test_a_frequent_pose_counts_no_more_than_a_rare_one() -> None:
    """Algorithm 2's weights, exactly: a pose, its mirror image and its exchange are one pose."""
    frequent, rare, diagonal = (1.0, 3.0), (2.0, 0.5), (1.0, 1.0)
    mirrored = (TWO_PI - frequent[0], TWO_PI - frequent[1])
    headings = np.array(
        [frequent] * 9 + [mirrored] * 3 + [frequent[::-1]] * 2 + [rare] + [diagonal]
    )
    lengths = np.ones(len(headings), int)
    weights = pose_weights(headings, lengths)
    assert weights @ lengths == pytest.approx(len(headings))
    assert weights[:14] == pytest.approx(weights[0])
    assert weights[:14].sum() == pytest.approx(weights[14])
    # half as many poses are like one on the diagonal
    assert weights[15] == pytest.approx(0.5 * weights[14])
    # it is the correspondences that are counted
    twice = pose_weights(headings[[0, 14]], np.array([30, 10]))
    assert twice * [30, 10] == pytest.approx([20, 20])


def test_compensation_weighs_the_counts(default_table: LikelihoodTable) -> None:
    c = Correspondences([0.1, 0.2], [0.3, 0.4], [0.1, 0.5], [0.2, 0.3])
    pairs = [(c, 1.0, 3.0)] * 5 + [(c, 2.0, 0.5)]
    options = {"num_classes": 1, "noise": 0.01}
    counts, _, samples = count_pairs(pairs, **options)
    plain, _, _ = count_pairs(pairs, **options, compensate=False)
    assert samples == 12
    assert counts.seen.sum() == plain.seen.sum() == pytest.approx(12)
    alone = [count_pairs([pair], **options)[0].profile for pair in pairs[-2:]]
    assert counts.profile == pytest.approx(3 * alone[0] + 3 * alone[1])
    assert plain.profile == pytest.approx(5 * alone[0] + alone[1])


def test_mismatches_of_real_pairs_are_made_of_their_bearings(
    default_table: LikelihoodTable,
) -> None:
    """Never of the correspondence itself, and about as many as asked for."""
    pairs = real_pairs(40, 30, 0.0, 6)
    counts, mismatch, _ = count_pairs(pairs, num_classes=1, noise=0.01)
    assert counts.chance_profile.sum() == pytest.approx(CHANCE_SAMPLES, rel=0.01)
    assert mismatch == pytest.approx(0.02)
    # at random poses it makes no difference what the true ones were
    inside = counts.chance_inside.sum() / counts.chance_profile.sum()
    simulated = count_simulated(CorrespondenceSimulator(), 2 * 8 * BLOCK, num_classes=1)
    share = simulated.chance_profile[:, :20].sum() / simulated.chance_profile.sum()
    assert counts.chance_profile[:, :20].sum() / CHANCE_SAMPLES == pytest.approx(share, rel=0.15)
    assert 0.005 < inside < 0.1


# --- quality --------------------------------------------------------------------------------------


def with_quality(pairs, seed: int, informative: bool = True):
    """True matches have low scores, mismatches high ones, as the ratio test gives them."""
    rng = np.random.default_rng(seed)
    scored = []
    for c, *pose in pairs:
        wrong = np.abs([naive.residuals(angles, *pose) for angles in angles_of(c)]) > 0.05
        quality = np.where(wrong & informative, rng.beta(6, 2, len(c)), rng.beta(2, 3, len(c)))
        scored.append((dataclasses.replace(c, quality=quality), *pose))
    return scored


def test_quality_is_learned_where_it_tells(default_table: LikelihoodTable) -> None:
    pairs = with_quality(real_pairs(200, 50, 0.6, 7), 0)
    table = LikelihoodTable.from_pairs(pairs, prior=default_table)
    assert table.quality is not None
    assert (np.diff(table.quality) <= 0).all()
    assert table.quality[2] > 3.0
    assert table.quality[17] < 0.3
    # the mean over the mismatches of a density ratio is one
    rng = np.random.default_rng(1)
    cells = (rng.beta(6, 2, 100_000) * QUALITY_CELLS).astype(int)
    assert table.quality[cells].mean() == pytest.approx(1.0, abs=0.25)


def test_quality_that_tells_nothing_is_flat(default_table: LikelihoodTable) -> None:
    pairs = with_quality(real_pairs(200, 50, 0.6, 7), 0, informative=False)
    table = LikelihoodTable.from_pairs(pairs, prior=default_table)
    assert table.quality is not None
    assert (np.diff(table.quality) <= 0).all()
    # the last cells are met by few
    assert table.quality[:16] == pytest.approx(1.0, abs=0.25)


def test_scores_that_were_never_met_are_as_those_near_them(
    default_table: LikelihoodTable,
) -> None:
    """A ratio test lets none pass beyond its limit, and few are near zero."""
    pairs = []
    for c, *pose in with_quality(real_pairs(200, 50, 0.6, 7), 0):
        quality = np.clip(c.quality, 0.21, 0.79)
        quality[(quality > 0.5) & (quality < 0.6)] = 0.61
        pairs.append((dataclasses.replace(c, quality=quality), *pose))
    table = LikelihoodTable.from_pairs(pairs, prior=default_table)
    assert table.quality is not None
    assert np.isfinite(table.quality).all()
    assert (np.diff(table.quality) <= 0).all()
    assert (table.quality[:5] == table.quality[4]).all()
    assert (table.quality[15:] == table.quality[15]).all()
    assert table.quality[9] > table.quality[10] > table.quality[12]


def test_no_quality_none_learned(default_table: LikelihoodTable) -> None:
    assert (
        LikelihoodTable.from_pairs(real_pairs(20, 10, 0.5, 0), prior=default_table).quality is None
    )
    assert quality_ratio(Counts.zeros(1, QUALITY_CELLS)) is None


def test_quality_counts_equal_their_naive_twin() -> None:
    ((c, *pose),) = with_quality(real_pairs(1, 60, 0.5, 8), 1)
    counts = np.zeros((2, 10))
    _count_quality(c.quality, bearing_columns(c).T, np.array(pose), 0.03, 2.0, counts)
    expected = np.zeros((2, 10))
    for angles, quality in zip(angles_of(c), c.quality, strict=True):
        residual = abs(naive.residuals(angles, *pose))
        if residual < 0.03:
            expected[0, min(int(quality * 10), 9)] += 2.0
        elif residual > 0.15:
            expected[1, min(int(quality * 10), 9)] += 2.0
    assert (counts == expected).all()


def test_decreasing_is_the_nearest_such_sequence() -> None:
    """Against a general minimiser of the weighted squares."""
    rng = np.random.default_rng(3)
    for _ in range(10):
        values, weights = rng.uniform(size=6), rng.uniform(0.1, 1.0, 6)
        found = _decreasing(values, weights)
        # what it falls by from each to the next is not negative
        lower = np.tril(np.ones((6, 6)))[:, ::-1][:, ::-1].T
        solved = optimize.nnls(np.sqrt(weights)[:, None] * lower, np.sqrt(weights) * values)[0]
        assert found == pytest.approx(lower @ solved, abs=1e-9)
        assert (np.diff(found) <= 0).all()


# --- misuse ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "options", "message"),
    [
        ("from_simulation", {"bins": 3}, "bins: expected 4 to 1024"),
        ("from_simulation", {"num_samples": 0}, "num_samples: expected at least 1"),
        ("from_simulation", {"num_classes": 0}, "num_classes: expected 1 to 32"),
        ("from_simulation", {"num_classes": 33}, "num_classes: expected 1 to 32"),
        ("from_simulation", {"num_threads": 0}, "num_threads: expected at least 1"),
        (
            "from_simulation",
            {"simulator": CorrespondenceSimulator(mismatch=1.0)},
            r"simulator: expected a mismatch share in \(0, 1\)",
        ),
        ("from_pairs", {"pairs": [], "prior_samples": 0.0}, "prior_samples: expected a positive"),
        ("from_pairs", {"pairs": [], "prior_samples": np.nan}, "prior_samples: expected a posit"),
    ],
)
def test_misuse_names_the_option(method: str, options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        getattr(LikelihoodTable, method)(**options)


def test_one_correspondence_makes_a_table(default_table: LikelihoodTable) -> None:
    """There is no mismatch to be made of it."""
    one = Correspondences(1.0, 0.3, 2.0, 0.29)
    for pairs in ([(one, 0.3, 0.4)], [(one, 0.3, 0.4)] * 5):
        table = LikelihoodTable.from_pairs(pairs, prior=default_table)
        assert np.isfinite(table.density).all()
        assert np.isfinite(table.profile).all()


def test_slopes_of_correspondences() -> None:
    c = real_pairs(1, 5, 0.0, 0)[0][0]
    expected = angles_of(c)
    expected[:, 1::2] = np.tan(expected[:, 1::2])
    assert (as_slopes(c) == expected).all()
    assert SHAPE_CELLS == RATIO_CELLS * ELEVATION_CELLS
    assert Counts.zeros(2).profile.shape == (ELEVATION_CELLS, RESIDUAL_CELLS + 1)


def test_three_pairs_learn_no_garbage(default_table: LikelihoodTable) -> None:
    """What three pairs cannot say is the prior's, whatever they happen to be."""
    for seed in range(6):
        simulator = CorrespondenceSimulator(mismatch=0.5)
        pairs = [simulator.pair(40, 100 * seed + k) for k in range(3)]
        table = LikelihoodTable.from_pairs(pairs, prior=default_table, seed=seed)
        assert table.noise == pytest.approx(default_table.noise, rel=0.2)
        assert table.profile[:, residual_nodes() > 0.16].max() < 1e-3


def test_headings_that_are_not_finite_are_named(default_table: LikelihoodTable) -> None:
    c = CorrespondenceSimulator(mismatch=0.5).pair(40, 0)[0]
    with pytest.raises(ValueError, match="finite headings"):
        LikelihoodTable.from_pairs([(c, np.nan, 1.0)], prior=default_table)
