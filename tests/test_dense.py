"""The paper's table: learning and evaluating it."""

from __future__ import annotations

from pathlib import Path

import naive
import numpy as np
import pytest

from pflut.correspondences import Correspondences
from pflut.geometry import TWO_PI
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.dense_kernels import count, discretize
from pflut.likelihood.dense_learning import (
    BLOCK,
    count_pairs,
    count_simulated,
    log_ratio_from_counts,
)
from pflut.simulation.correspondences import CorrespondenceSimulator

SIMULATOR = CorrespondenceSimulator(mismatch=0.5)


def random_table(ratio_bins: int, bins: int, seed: int = 0) -> DenseTable:
    values = np.random.default_rng(seed).normal(size=(ratio_bins, bins, bins))
    return DenseTable(values.astype(np.float32))


def random_correspondences(n: int, seed: int = 0) -> Correspondences:
    """Bearings with every kind of r: negative, beyond one, near +-1, points near the horizon."""
    rng = np.random.default_rng(seed)
    left, right = rng.uniform(-1.5, 1.5, (2, n))
    kind = rng.integers(0, 5, n)
    right = np.where(kind == 0, left + rng.normal(0, 1e-3, n), right)
    right = np.where(kind == 1, -left + rng.normal(0, 1e-3, n), right)
    right = np.where(kind == 2, rng.normal(0, 1e-6, n), right)
    left = np.where(kind == 3, rng.normal(0, 1e-6, n), left)
    angles = rng.uniform(0, TWO_PI, (2, n))
    limit = np.pi / 2
    return Correspondences(
        angles[0], left.clip(-limit, limit), angles[1], right.clip(-limit, limit)
    )


EDGES = {
    "both on the horizon": (0.0, 0.0),
    "signed zeros": (0.0, -0.0),
    "left on the horizon": (0.0, 0.4),
    "right on the horizon": (-0.4, 0.0),
    "r is one": (0.3, 0.3),
    "r is minus one": (0.3, -0.3),
    "both at the zenith": (np.pi / 2, np.pi / 2),
    "zenith and nadir": (np.pi / 2, -np.pi / 2),
    "zenith and horizon": (np.pi / 2, 0.0),
    "next to nothing": (1e-300, 3e-308),
    "denormal": (5e-324, -5e-324),
}


# --- Algorithm 1 ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ratio_bins", "bins", "n"), [(4, 4, 9), (10, 12, 30), (7, 33, 12), (16, 16, 1)]
)
def test_grid_equals_its_naive_twin(ratio_bins: int, bins: int, n: int) -> None:
    table = random_table(ratio_bins, bins)
    for seed in range(4):
        correspondences = random_correspondences(n, seed)
        expected = naive.grid(table.log_ratio, correspondences)
        got = table.log_likelihood_grid(correspondences)
        assert got.dtype == np.float32
        assert np.abs(got - expected).max() < 1e-5 * n


@pytest.mark.parametrize("name", EDGES)
def test_grid_at_the_edges_equals_its_naive_twin(name: str) -> None:
    table = random_table(8, 8)
    for azimuths in ((0.0, 0.0), (np.pi, np.nextafter(TWO_PI, 0)), (1.0, TWO_PI - 1e-17)):
        c = Correspondences(azimuths[0], EDGES[name][0], azimuths[1], EDGES[name][1])
        expected = naive.grid(table.log_ratio, c)
        assert np.abs(table.log_likelihood_grid(c) - expected).max() < 1e-6


def test_grid_of_none_is_zero() -> None:
    assert not random_table(4, 12).log_likelihood_grid(Correspondences.empty()).any()


def test_grid_is_a_sum() -> None:
    table = random_table(16, 24)
    c = random_correspondences(40)
    parts = [table.log_likelihood_grid(c[i : i + 1]) for i in range(40)]
    assert np.abs(table.log_likelihood_grid(c) - np.sum(parts, axis=0)).max() < 1e-4


def test_exchanged_views_give_the_transposed_grid(dense_table: DenseTable) -> None:
    """Exactly for whole numbers, which float32 adds without rounding in any order."""
    whole = np.random.default_rng(0).integers(-99, 99, (16, 20, 20)).astype(np.float32)
    for table, rounding in ((DenseTable(whole), 0.0), (dense_table, 1e-4)):
        for seed in range(5):
            c = random_correspondences(60, seed)
            difference = table.log_likelihood_grid(c.exchanged()).T - table.log_likelihood_grid(c)
            assert np.abs(difference).max() <= rounding


def test_mirrored_scene_gives_the_mirrored_grid(small_dense_table: DenseTable) -> None:
    c = random_correspondences(60)
    mirrored = Correspondences(-c.azimuth_l, c.elevation_l, -c.azimuth_r, c.elevation_r)
    grid = small_dense_table.log_likelihood_grid(c)
    assert np.abs(small_dense_table.log_likelihood_grid(mirrored) - grid[::-1, ::-1]).max() < 1e-4


def test_upside_down_scene_gives_the_same_grid(small_dense_table: DenseTable) -> None:
    c = random_correspondences(60)
    flipped = Correspondences(c.azimuth_l, -c.elevation_l, c.azimuth_r, -c.elevation_r)
    assert (
        small_dense_table.log_likelihood_grid(flipped) == small_dense_table.log_likelihood_grid(c)
    ).all()


def test_turning_a_view_shifts_the_grid() -> None:
    table = random_table(8, 16)
    c = random_correspondences(30)
    turned = Correspondences(
        c.azimuth_l + 5 * TWO_PI / 16, c.elevation_l, c.azimuth_r, c.elevation_r
    )
    grid = np.roll(table.log_likelihood_grid(c), 5, axis=0)
    assert (table.log_likelihood_grid(turned) == grid).all()


def test_other_cells_than_its_own_are_refused(small_dense_table: DenseTable) -> None:
    none = Correspondences.empty()
    assert small_dense_table.log_likelihood_grid(none, 32).shape == (32, 32)
    with pytest.raises(ValueError, match="bins: this table has 32, got 64"):
        small_dense_table.log_likelihood_grid(none, 64)


# --- Algorithm 2 ----------------------------------------------------------------------------------


def test_count_equals_its_naive_twin() -> None:
    headings, bearings = CorrespondenceSimulator(max_tilt=0.2).sample_slopes(40, 15, 0)
    bearings[0, :3, 1] = [0.0, 0.0, 1e300]
    bearings[0, :3, 3] = [0.0, 0.5, -1e300]
    weights = np.random.default_rng(1).uniform(size=40)
    histogram = np.zeros((10, 12, 12))
    count(headings, bearings, weights, histogram)
    assert histogram == pytest.approx(naive.count(headings, bearings, weights, 10, 12))
    assert histogram.sum() == pytest.approx(15 * weights.sum())


def test_learning_and_evaluation_share_their_cells() -> None:
    """A correspondence is counted in the very cell that its true pose looks up."""
    simulator = CorrespondenceSimulator(mismatch=0.0, noise=0.0)
    headings, angles = simulator.sample(1, 200, 3)
    slopes = angles.copy()
    slopes[..., 1::2] = np.tan(angles[..., 1::2])
    histogram = np.zeros((16, 16, 16))
    count(headings, slopes, np.ones(1), histogram)
    table = DenseTable(histogram.astype(np.float32))
    i, j = (headings[0] / TWO_PI * 16).astype(int)
    for bearing in angles[0]:
        one = Correspondences(*bearing[:, None])
        assert table.log_likelihood_grid(one)[i, j] >= 1.0


@pytest.mark.parametrize("uniform", [0.9, 0.01])
def test_log_ratio_equals_its_naive_twin(uniform: float) -> None:
    histogram = np.random.default_rng(0).poisson(2.0, (6, 9, 9))
    histogram[2] = 0
    got = log_ratio_from_counts(histogram, uniform=uniform)
    assert np.abs(got - naive.log_ratio(histogram, uniform)).max() < 1e-5
    assert (got[2] == 0).all()


def test_blur_spreads_and_keeps_the_mass() -> None:
    histogram = np.zeros((1, 16, 16))
    histogram[0, 0, 0] = 5.0
    ratio = (np.exp(log_ratio_from_counts(histogram, uniform=0.01, blur=1.5)) - 0.01) / 0.99
    assert ratio.mean() == pytest.approx(1.0, abs=1e-5)
    near = np.arange(-8, 8)
    gauss = np.exp(-0.5 * (near / 1.5) ** 2)
    expected = np.roll(gauss / gauss.sum(), -8)
    assert ratio[0] / 256 == pytest.approx(np.outer(expected, expected), abs=1e-4)


def test_density_ratio_is_normalised(dense_table: DenseTable) -> None:
    """exp(log_ratio) is a density ratio to the uniform: its mean over (u, v) is one."""
    mean = np.exp(dense_table.log_ratio.astype(np.float64)).mean(axis=(1, 2))
    assert np.abs(mean - 1).max() < 1e-5


def test_table_is_mirror_symmetric(dense_table: DenseTable) -> None:
    table = dense_table.log_ratio
    mirrored = np.roll(table[:, ::-1, ::-1], (1, 1), axis=(1, 2))
    assert (table == mirrored).all()


def test_table_follows_the_constraint(dense_table: DenseTable) -> None:
    """Noise-free, the density of (u, v) lies on sin v = -r sin u, acute at v, u and -v alike."""
    table, bins = dense_table.log_ratio, dense_table.bins
    for k in (70, 90, 110):
        r = (k + 0.5) / bins * 2 - 1
        # a difference of two cells is triangular about its number: no half here
        u, v = np.unravel_index(np.argsort(table[k].ravel())[-60:], (bins, bins))
        u, v = u * TWO_PI / bins, v * TWO_PI / bins
        error = np.abs(np.sin(v) + r * np.sin(u))
        assert np.median(error) < TWO_PI / bins
        assert (np.sin(u) * np.sin(v) < 0.1).all()


def test_obtuse_branch_exists_where_r_is_one(dense_table: DenseTable) -> None:
    """Without it a turn on the spot is seen as something else (METHOD: the branches)."""
    table, bins = dense_table.log_ratio[-1], dense_table.bins
    # the same direction in both views: u - v = pi, all the way round
    u = np.arange(bins)
    band = np.exp(table[u, (u + bins // 2) % bins])
    assert (band > 1.2).mean() > 0.9


def test_learning_does_not_depend_on_the_threads() -> None:
    samples = 5 * BLOCK - 17
    counts = [
        count_simulated(SIMULATOR, 16, samples, seed=1, num_threads=threads)
        for threads in (1, 2, 3)
    ]
    assert counts[0].sum() == 5 * BLOCK
    assert (counts[0] == counts[1]).all()
    assert (counts[0] == counts[2]).all()
    assert (counts[0] != count_simulated(SIMULATOR, 16, samples, seed=2)).any()


@pytest.mark.parametrize("mismatches", ["uniform", "simulated"])
def test_table_is_reproducible(mismatches) -> None:
    def learn(seed: int, threads: int, samples: int = 2 * BLOCK) -> np.ndarray:
        return DenseTable.from_simulation(
            bins=8, num_samples=samples, mismatches=mismatches, seed=seed, num_threads=threads
        ).log_ratio

    assert (learn(7, 1) == learn(7, 3)).all()
    assert (learn(7, 1) != learn(8, 1)).any()
    assert np.isfinite(learn(0, 1, 1)).all()


def test_counts_agree_with_the_naive_algorithm_on_another_simulator() -> None:
    """The same density, learned by the twins from their own random numbers."""
    settings = {"mismatch": 0.0, "noise": 0.01, "max_tilt": 0.0, "radius": 2.0}
    headings, bearings = naive.simulate(99, 300, 16, **settings)
    slow = naive.count(headings, bearings, np.ones(300), 4, 4)
    fast = count_simulated(CorrespondenceSimulator(mismatch=0.0), 4, 20 * BLOCK, seed=5)
    expected = fast / fast.sum() * slow.sum()
    # 16 correspondences a pair are not independent: their counts spread more than Poisson's
    spread = np.sqrt(16 * np.maximum(expected, 1.0))
    assert (np.abs(slow - expected) < 5 * spread).all()


def test_progress_is_reported() -> None:
    seen: list[tuple[int, int]] = []
    DenseTable.from_simulation(
        bins=8, num_samples=20 * BLOCK, num_threads=2, progress=lambda *done: seen.append(done)
    )
    assert seen[-1] == (20 * BLOCK, 20 * BLOCK)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def real_pairs(n: int, favourite: float, seed: int) -> list[tuple[Correspondences, float, float]]:
    """Pairs of which a share has theta in one quarter: a robot that mostly drives ahead."""
    rng = np.random.default_rng(seed)
    headings, angles = CorrespondenceSimulator(mismatch=0.0).sample(n, 12, rng)
    ahead = headings[:, 0] < 0.5 * np.pi
    kept = ahead | (rng.uniform(size=n) > favourite)
    return [
        (Correspondences(*pair.T), *pose)
        for pair, pose in zip(angles[kept], headings[kept], strict=True)
    ]


def test_a_frequent_pose_counts_no_more_than_a_rare_one() -> None:
    """Algorithm 2's weights, exactly: a pose, its mirror image and its exchange are one pose."""
    one = Correspondences(0.1, 0.3, 0.1, 0.2)
    frequent, rare, on_the_diagonal = (1.0, 3.0), (2.0, 0.5), (1.0, 1.0)
    mirrored = (TWO_PI - frequent[0], TWO_PI - frequent[1])
    pairs = [(one, *frequent)] * 9 + [(one, *mirrored)] * 3 + [(one.exchanged(), 3.0, 1.0)] * 2
    pairs += [(one, *rare), (one, *on_the_diagonal)]
    histogram, samples = count_pairs(pairs, 8)
    plain, _ = count_pairs(pairs, 8, compensate=False)
    assert samples == 16

    def at(counts: np.ndarray, theta: float, phi: float) -> float:
        return float(counts[:, naive.cell(theta, 8), naive.cell(phi, 8)].sum())

    # the azimuths lie in the first cell, so that the cells of (u, v) are those of the pose
    assert at(plain, *frequent) == 11
    assert at(histogram, *frequent) + at(histogram, *mirrored) == pytest.approx(1.0)
    assert at(histogram, *frequent) == pytest.approx(11 / 14)
    assert at(histogram, *rare) == pytest.approx(1.0)
    # half as many poses are like one on the diagonal
    assert at(histogram, *on_the_diagonal) == pytest.approx(0.5)


def test_compensation_removes_the_bias_of_a_habit() -> None:
    """A camera that looks ahead, in a robot that mostly drives one way: what it sees is biased."""

    def seen_ahead(favourite: float, seed: int):
        for c, theta, phi in real_pairs(12_000, favourite, seed):
            yield c[(np.cos(c.azimuth_l) > 0.0) & (np.cos(c.azimuth_r) > 0.0)], theta, phi

    def table(favourite: float, seed: int, *, compensate: bool = True) -> np.ndarray:
        pairs = seen_ahead(favourite, seed)
        return DenseTable.from_pairs(pairs, bins=4, uniform=0.1, compensate=compensate).log_ratio[
            2:
        ]

    fair = table(0.0, 2)
    error = np.abs(table(0.9, 3) - fair).mean()
    assert np.abs(table(0.9, 3, compensate=False) - fair).mean() > 3 * error
    assert error < 0.15


def test_pairs_and_simulation_learn_the_same() -> None:
    pairs = real_pairs(8_000, 0.0, 4)
    learned = DenseTable.from_pairs(pairs, bins=4, uniform=0.5)
    simulated = DenseTable.from_simulation(
        bins=4, num_samples=20 * BLOCK, simulator=CorrespondenceSimulator(mismatch=0.5)
    )
    seen = np.histogram(
        [np.tan(c.elevation_r) / np.tan(c.elevation_l) for c, _, _ in pairs], 4, (-1, 1)
    )[0]
    assert (seen[2:] > 4_000).all()
    # the negative r, on either side of the horizon by noise, are rare
    assert np.abs(learned.log_ratio - simulated.log_ratio)[2:].max() < 0.1
    assert learned.learned_from["num_samples"] == 96_000
    assert learned.learned_from["source"] == "pairs"


def test_pairs_without_correspondences() -> None:
    pair = real_pairs(50, 0.0, 0)
    empty = (Correspondences.empty(), 0.0, 0.0)
    table = DenseTable.from_pairs([empty, *pair, empty], bins=8)
    same = DenseTable.from_pairs(iter(pair), bins=8)
    assert (table.log_ratio == same.log_ratio).all()
    for none in ([], [empty]):
        with pytest.raises(ValueError, match="at least one pair"):
            DenseTable.from_pairs(none)


def test_slices_never_met_say_nothing() -> None:
    one = (Correspondences(1.0, 0.3, 2.0, 0.29), 0.3, 0.4)
    table = DenseTable.from_pairs([one], bins=8)
    assert np.count_nonzero(np.ptp(table.log_ratio, axis=(1, 2))) == 1
    # one sample and its mirror image, and no other cell, unless a blur is asked for
    assert np.count_nonzero(table.log_ratio > 0.0) == 2
    assert np.count_nonzero(DenseTable.from_pairs([one], bins=8, blur=1.0).log_ratio > 0.0) > 2


@pytest.mark.parametrize(
    ("method", "options", "message"),
    [
        ("from_simulation", {"bins": 3}, "bins: expected 4 to 512"),
        ("from_simulation", {"bins": 513}, "bins: expected 4 to 512"),
        ("from_simulation", {"num_samples": 0}, "num_samples: expected at least 1"),
        ("from_simulation", {"num_threads": 0}, "num_threads: expected at least 1"),
        ("from_simulation", {"mismatches": "none"}, "mismatches: expected 'uniform' or"),
        (
            "from_simulation",
            {"simulator": CorrespondenceSimulator(mismatch=0.0)},
            r"simulator: expected a mismatch share in \(0, 1\)",
        ),
        ("from_pairs", {"pairs": [], "bins": 2}, "bins: expected 4 to 512"),
        ("from_pairs", {"pairs": [], "uniform": 0.0}, r"uniform: expected a share in \(0, 1\)"),
    ],
)
def test_misuse_names_the_option(method: str, options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        getattr(DenseTable, method)(**options)


@pytest.mark.parametrize("shape", [(4, 4), (4, 4, 5), (0, 4, 4), (4, 0, 0)])
def test_table_of_another_shape(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="log_ratio: expected shape"):
        DenseTable(np.zeros(shape, np.float32))


def test_table_that_is_not_finite() -> None:
    values = np.zeros((4, 4, 4), np.float32)
    values[1, 2, 3] = -np.inf
    with pytest.raises(ValueError, match="not finite"):
        DenseTable(values)


def test_discretize_equals_its_naive_twin() -> None:
    c = random_correspondences(500)
    cells = np.empty((500, 4), np.int64)
    discretize(c.azimuth_l, c.elevation_l, c.azimuth_r, c.elevation_r, 24, 10, cells)
    for i, row in enumerate(cells):
        r, exchanged = naive.ratio_cell(np.tan(c.elevation_l[i]), np.tan(c.elevation_r[i]), 10)
        left, right = naive.cell(c.azimuth_l[i], 24), naive.cell(c.azimuth_r[i], 24)
        assert row.tolist() == [r, left, right, exchanged]


# --- the default one -----------------------------------------------------------------------------


def test_default_is_learned_once_and_again_where_spoilt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = "pflut.likelihood.dense"
    monkeypatch.setenv("PFLUT_CACHE", str(tmp_path))
    monkeypatch.setattr(f"{module}.DEFAULT_SAMPLES", BLOCK)
    learned: list[int] = []
    learn = DenseTable.from_simulation

    def counting(**options) -> DenseTable:
        learned.append(1)
        return learn(**options)

    monkeypatch.setattr(DenseTable, "from_simulation", counting)
    first = DenseTable.default(bins=8)
    assert (DenseTable.default(bins=8).log_ratio == first.log_ratio).all()
    assert len(learned) == 1
    (file,) = tmp_path.iterdir()
    file.write_bytes(file.read_bytes()[:100])
    assert (DenseTable.default(bins=8).log_ratio == first.log_ratio).all()
    assert len(learned) == 2
    DenseTable.default(bins=8)
    assert len(learned) == 2
    # another table under the same name is not taken for it, be it of other cells or other samples
    learn(bins=16, num_samples=BLOCK).save(file)
    assert DenseTable.default(bins=8).bins == 8
    learn(bins=8, num_samples=BLOCK, seed=1).save(file)
    assert (DenseTable.default(bins=8).log_ratio == first.log_ratio).all()
    monkeypatch.setattr(f"{module}.LEARNING_VERSION", 99)
    DenseTable.default(bins=8)
    assert len(learned) == 5


def test_default_is_the_paper_s(dense_table: DenseTable) -> None:
    assert dense_table.log_ratio.shape == (128, 128, 128)
    assert dense_table.learned_from["simulator"] == {
        "mismatch": 0.9,
        "noise": 0.01,
        "max_tilt": 0.0,
        "radius": 2.0,
        "scene": "ball",
        "field_of_view": None,
        "max_turn": np.radians(30),
    }
