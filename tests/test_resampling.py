"""Resampling: the contract of every scheme, exact offspring statistics, oracles."""

import naive
import numpy as np
import pytest

from pflut.localization import resampling
from pflut.localization.resampling import RESAMPLERS, get_resampler, systematic_indices, take

WEIGHTS = np.array([0.03, 0.11, 0.0, 0.17, 0.29, 0.40])
SCHEMES = sorted(RESAMPLERS)


@pytest.fixture(params=SCHEMES)
def resample(request):
    return RESAMPLERS[request.param]


@pytest.mark.parametrize("size,n", [(1, 1), (1, 7), (7, 1), (50, 50), (300, 40), (40, 300)])
def test_kernels_equal_their_naive_twins(size, n):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        weights = rng.random(size) ** 4 * (rng.random(size) < 0.7)
        weights[rng.integers(size)] += 0.1
        uniform = np.random.default_rng(seed).random()
        uniforms = np.random.default_rng(seed).random(n)
        spacings = np.random.default_rng(seed).standard_exponential(n + 1)
        expected = {
            "systematic": naive.systematic(weights, n, uniform),
            "stratified": naive.stratified(weights, n, uniforms),
            "multinomial": naive.multinomial(weights, n, spacings),
            "residual": naive.residual(
                weights, n, lambda w, k, seed=seed: RESAMPLERS["multinomial"](w, k, seed)
            ),
            "ssp": naive.ssp(weights, n, np.random.default_rng(seed).random(size)),
        }
        for scheme, indices in expected.items():
            np.testing.assert_array_equal(RESAMPLERS[scheme](weights, n, seed), indices)


def test_systematic_and_stratified_equal_filterpy_with_the_same_uniforms(monkeypatch):
    filterpy = pytest.importorskip("filterpy.monte_carlo.resampling")
    for seed in range(10):
        weights = np.random.default_rng(seed).random(1000)
        weights /= weights.sum()

        def draw(*size, seed=seed):
            return np.random.default_rng(seed).random(*size)

        monkeypatch.setattr(filterpy, "random", draw)
        for scheme in ("systematic", "stratified"):
            theirs = getattr(filterpy, f"{scheme}_resample")(weights)
            np.testing.assert_array_equal(RESAMPLERS[scheme](weights, 1000, seed), theirs)


def test_contract(resample):
    rng = np.random.default_rng(1)
    for size, n in [(1, 1), (5, 3), (3, 5), (1000, 1000), (10, 0), (2, 1)]:
        weights = rng.random(size)
        indices = resample(weights, n, 3)
        assert indices.dtype == np.int32
        assert indices.shape == (n,)
        assert (np.diff(indices) >= 0).all()
        assert n == 0 or (indices[0] >= 0 and indices[-1] < size)
        np.testing.assert_array_equal(indices, resample(weights, n, 3))
        np.testing.assert_array_equal(indices, resample(weights, n, np.random.default_rng(3)))


def test_zero_weights_are_never_chosen(resample):
    for seed in range(300):
        rng = np.random.default_rng(seed)
        weights = rng.random(60) * (rng.random(60) < 0.3)
        weights[rng.integers(60)] = 1e-12
        weights[:2] = weights[-2:] = 0.0
        weights[30] = 0.5
        assert (weights[resample(weights, 200, rng)] > 0).all()


@pytest.mark.parametrize("uniform", [0.0, 0.5, np.nextafter(1.0, 0.0)])
def test_rounding_at_the_end_chooses_the_last_particle_with_weight(uniform):
    for n in (1, 3, 10, 1000, 99_999):
        weights = np.concatenate([np.full(997, 0.1), np.zeros(50)])
        indices = systematic_indices(weights, n, uniform)
        assert indices[-1] < 997
        assert (np.diff(indices) >= 0).all()


def test_a_point_on_an_edge_belongs_to_the_particle_behind_it():
    weights = np.array([0.0, 1.0, 0.0, 1.0])
    np.testing.assert_array_equal(systematic_indices(weights, 2, 0.0), [1, 3])
    np.testing.assert_array_equal(systematic_indices(weights, 4, 0.0), [1, 1, 3, 3])
    out = np.empty(2, dtype=np.int32)
    resampling._merge_indices(weights, 3, 2.0, np.array([0.0, 1.0, 1.0]), out)
    np.testing.assert_array_equal(out, [1, 3])


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("scale", [1e-31, 1.0, 1e30, 2e38])
def test_scale_does_not_matter(resample, dtype, scale):
    weights = np.random.default_rng(5).integers(0, 64, 500).astype(dtype)
    scaled = weights / dtype(64) * dtype(scale)
    assert np.isfinite(scaled).all()
    counts = np.bincount(resample(weights, 500, 7), minlength=500)
    counts_scaled = np.bincount(resample(scaled, 500, 7), minlength=500)
    # the quotients differ in the last bit, which may move a point over an edge
    assert np.abs(counts - counts_scaled).sum() <= 4


@pytest.mark.parametrize("scale", [5e-324, 1e-310, 1e-250, 1e250, 1e308])
def test_weights_at_the_ends_of_float64(resample, scale):
    weights = np.array([0.0, 1.0, 0.0, 1.0, 0.0]) * scale
    indices = resample(weights, 1000, 1)
    assert set(indices.tolist()) == {1, 3}
    assert abs(np.count_nonzero(indices == 1) - 500) < 5 * np.sqrt(250)


def test_float32_weights_that_do_not_sum_to_one_stay_in_range(resample):
    for seed in range(40):
        rng = np.random.default_rng(seed)
        weights = rng.random(10_000).astype(np.float32)
        weights *= np.float32(0.999) / weights.sum()
        indices = resample(weights, 10_000, rng)
        assert indices[0] >= 0
        assert indices[-1] < 10_000
        assert (np.diff(indices) >= 0).all()


@pytest.mark.parametrize(
    "weights,message",
    [
        ([0.1, np.nan, 0.2], "value 1 is nan"),
        ([0.1, -0.1], "value 1 is -0.1"),
        ([np.inf, 0.1], "value 0 is inf"),
        ([0.0, 0.0], "all are zero"),
        ([], "N >= 1"),
        ([[0.1, 0.2]], "expected shape"),
    ],
)
def test_bad_weights_are_refused(resample, weights, message):
    with pytest.raises(ValueError, match=message):
        resample(np.array(weights), 3, 0)


def test_a_negative_number_is_refused(resample):
    with pytest.raises(ValueError, match="n: expected"):
        resample(WEIGHTS, -1, 0)


def fair_games(mean):
    """Exact covariance of SSP: both outcomes of each game, with their probabilities."""
    whole = np.floor(mean + 1e-9)
    players = np.flatnonzero(mean - whole > 1e-9)
    games = [(1.0, mean - whole, players[0])] if len(players) else [(1.0, mean - whole, 0)]
    for j in players[1:]:
        after = []
        for probability, rests, i in games:
            both = rests[i] + rests[j]
            few = both < 1 - 1e-9
            chance = rests[i] / both if few else (1 - rests[j]) / (2 - both)
            for share, winner, loser in ((chance, i, j), (1 - chance, j, i)):
                outcome = rests.copy()
                outcome[winner], outcome[loser] = (both, 0.0) if few else (1.0, both - 1.0)
                after.append((probability * share, outcome, winner if few else loser))
        games = after
    spreads = np.array([np.round(rests) - (mean - whole) for _, rests, _ in games])
    chances = np.array([probability for probability, *_ in games])
    return (spreads * chances[:, None]).T @ spreads


def exact_offspring(scheme, weights, n):
    """Exact mean and covariance of the numbers of copies."""
    shares = weights / weights.sum()
    mean = n * shares
    if scheme == "multinomial":
        return mean, n * (np.diag(shares) - np.outer(shares, shares))
    if scheme == "residual":
        rest = mean - np.floor(mean + 1e-9)
        k = round(rest.sum())
        q = rest / max(k, 1)
        return mean, k * (np.diag(q) - np.outer(q, q))
    if scheme == "ssp":
        return mean, fair_games(mean)
    edges = np.concatenate([[0.0], np.cumsum(mean)])
    if scheme == "stratified":  # strata are independent, each one draw
        covariance = np.zeros((len(shares), len(shares)))
        for i in range(n):
            p = np.diff(np.clip(edges, i, i + 1))
            covariance += np.diag(p) - np.outer(p, p)
        return mean, covariance
    # systematic: the counts are constant between the uniforms at which a tooth meets an edge
    steps = np.unique(np.concatenate([[0.0, 1.0], edges % 1.0]))
    lengths = np.diff(steps)
    counts = np.array(
        [
            np.bincount(naive.systematic(weights, n, u), minlength=len(weights))
            for u in (steps[:-1] + steps[1:]) / 2
        ]
    )
    spread = counts - mean
    return mean, (spread * lengths[:, None]).T @ spread


@pytest.mark.parametrize("n", [5, 6, 17])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_offspring_mean_and_covariance(scheme, n):
    mean, covariance = exact_offspring(scheme, WEIGHTS, n)
    rng = np.random.default_rng(2024)
    runs = 20_000
    counts = np.array(
        [np.bincount(RESAMPLERS[scheme](WEIGHTS, n, rng), minlength=6) for _ in range(runs)]
    )
    spread = counts - mean
    error = spread.std(axis=0) / np.sqrt(runs)
    assert (np.abs(spread.mean(axis=0)) <= 5 * error + 1e-9).all()
    products = spread[:, :, None] * spread[:, None, :]
    error = products.std(axis=0) / np.sqrt(runs)
    assert (np.abs(products.mean(axis=0) - covariance) <= 5 * error + 1e-9).all()


def test_ssp_copies_are_rounded_expectations_and_negatively_associated():
    rng = np.random.default_rng(3)
    counts = np.array(
        [np.bincount(RESAMPLERS["ssp"](WEIGHTS, 7, rng), minlength=6) for _ in range(4000)]
    )
    expected = 7 * WEIGHTS
    assert ((counts >= np.floor(expected)) & (counts <= np.ceil(expected))).all()
    covariance = fair_games(expected)
    assert covariance[~np.eye(6, dtype=bool)].max() <= 1e-12


@pytest.mark.parametrize("scheme", ["systematic", "residual", "ssp"])
def test_equal_weights_give_each_one_copy(scheme):
    for n in (1, 3, 7, 49, 1000):
        np.testing.assert_array_equal(RESAMPLERS[scheme](np.full(n, 0.1), n, 0), np.arange(n))


def test_many_particles(resample):
    weights = np.random.default_rng(0).random(100_000)
    counts = np.bincount(resample(weights, 100_000, 0), minlength=100_000)
    chi2 = ((counts - weights / weights.sum() * 1e5) ** 2).sum() / 1e5
    assert chi2 < 1.05  # 1 for multinomial, less for the others


def test_take_copies_rows():
    poses = np.random.default_rng(0).random((10, 3))
    indices = np.array([0, 0, 3, 9], dtype=np.int32)
    np.testing.assert_array_equal(take(poses, indices), poses[indices])


def test_names():
    assert get_resampler("systematic") is resampling.systematic
    assert get_resampler(resampling.residual) is resampling.residual
    with pytest.raises(ValueError, match=r"expected one of .*'killing'"):
        get_resampler("killing")


@pytest.mark.parametrize(
    "answer", [np.zeros(4, int), np.zeros(5), np.arange(5) + 1, np.arange(5) - 1]
)
def test_a_resampler_of_ones_own_is_checked(answer):
    with pytest.raises(ValueError, match=r"^resampling: expected"):
        get_resampler(lambda weights, n, rng: answer)(np.ones(5), 5, 0)


def test_a_resampler_of_ones_own_gives_int32_of_its_own():
    answer = np.arange(5)
    indices = get_resampler(lambda weights, n, rng: answer)(np.ones(5), 5, 0)
    assert indices.dtype == np.int32
    answer[:] = 0
    np.testing.assert_array_equal(indices, np.arange(5))
