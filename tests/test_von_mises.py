"""Distributions of von Mises: exact answers, and mixtures fitted to grids."""

from __future__ import annotations

from dataclasses import replace

import naive
import numpy as np
import pytest
from scipy.special import i0e, i1e

from pflut.geometry import TWO_PI, wrap_to_pi
from pflut.likelihood.table import LikelihoodTable
from pflut.posterior import GridPosterior, pose_posterior
from pflut.simulation.correspondences import CorrespondenceSimulator
from pflut.von_mises import _components as components
from pflut.von_mises import expectation_kernels, maximization_kernels, point_kernels, sine
from pflut.von_mises.bessel import bessel_ratio, log_i0
from pflut.von_mises.distribution import VonMises, concentration_of_spread
from pflut.von_mises.fit import _axes, fit_mixture
from pflut.von_mises.mixture import LOG_UNIFORM, VonMisesMixture

SIGMAS = 5.0
CONCENTRATIONS = np.array([0.0, 1e-6, 0.1, 1.0, 5.0, 20.0, 49.9, 50.1, 200.0, 1e4, 1e7])
MODES = [
    ((1.0, 2.0), 0.5),
    ((5.0, 0.3), 0.9),
    ((0.1, 0.1), 0.99),
    ((100.0, 300.0), 0.99),
    ((1000.0, 20.0), -0.9),
    ((2000.0, 2000.0), 0.999),
]


def grid(bins: int) -> np.ndarray:
    axis = (np.arange(bins) + 0.5) * (TWO_PI / bins)
    return np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)


def posterior_of(prob: np.ndarray) -> GridPosterior:
    with np.errstate(divide="ignore"):
        return GridPosterior(np.log(prob / prob.sum()), 0.0)


def two_modes_and_a_band() -> VonMisesMixture:
    return VonMisesMixture(
        weights=[0.5, 0.2],
        means=[[1.0, 2.0], [0.0, -2.0]],
        concentrations=[[30.0, 20.0], [900.0, 300.0]],
        couplings=[10.0, -400.0],
        rotation_weights=[0.2],
        rotation_means=[1.0],
        rotation_concentrations=[200.0],
        uniform_weight=0.1,
        rotation_headings=[1.0],
        rotation_heading_concentrations=[3.0],
    )


def test_bessel_functions() -> None:
    k = CONCENTRATIONS
    assert log_i0(k) - k == pytest.approx(np.log(i0e(k)), abs=2e-9)
    assert bessel_ratio(k) == pytest.approx(i1e(k) / i0e(k), abs=1e-10)


@pytest.mark.parametrize("spread", [1e-6, 1e-3, 0.02, 0.1, 0.3, 0.6, 0.9, 0.999])
def test_concentration_has_the_mean_cosine(spread: float) -> None:
    k = concentration_of_spread(spread)
    assert 1.0 - i1e(k) / i0e(k) == pytest.approx(spread, rel=1e-6)
    # the kernels' is rough
    assert components.concentration(spread) == pytest.approx(k, rel=0.05)


def test_von_mises_against_numerical_integrals() -> None:
    a, b = VonMises(0.5, 3.0), VonMises(-2.0, 0.7)
    angles = (np.arange(2000) + 0.5) * (TWO_PI / 2000)
    p, q = a.log_density(angles), b.log_density(angles)
    step = TWO_PI / 2000
    assert np.exp(p).sum() * step == pytest.approx(1.0)
    assert -(np.exp(p) * p).sum() * step == pytest.approx(a.entropy())
    assert (np.exp(p) * (p - q)).sum() * step == pytest.approx(a.divergence(b))
    assert a.divergence(a) == pytest.approx(0.0, abs=1e-12)
    assert VonMises(0.0, 0.0).entropy() == pytest.approx(np.log(TWO_PI))
    assert VonMises(0.0, 1e4).deviation == pytest.approx(0.01, rel=1e-3)


def test_von_mises_fit_finds_what_angles_were_drawn_from() -> None:
    rng = np.random.default_rng(0)
    angles = rng.vonmises(3.0, 40.0, 4000)
    fit = VonMises.fit(angles)
    assert abs(wrap_to_pi(fit.mean - 3.0)) < SIGMAS / np.sqrt(40.0 * 4000)
    assert fit.concentration == pytest.approx(40.0, rel=SIGMAS * np.sqrt(2.0 / 4000))
    # a weight of two is an angle seen twice
    twice = VonMises.fit(angles, np.full(4000, 2.0))
    assert (twice.mean, twice.concentration) == pytest.approx((fit.mean, fit.concentration))
    merged = VonMises.of_components([0.3, 0.7], [3.0, 3.0], [40.0, 40.0])
    assert merged.concentration == pytest.approx(40.0)


@pytest.mark.parametrize(
    ("angles", "weights"), [([], None), ([1.0], [-1.0]), ([1.0, 2.0], [1.0]), ([1.0], [0.0])]
)
def test_von_mises_fit_refuses(angles: list[float], weights: list[float] | None) -> None:
    with pytest.raises(ValueError, match="angles, weights: expected"):
        VonMises.fit(angles, weights)


def test_von_mises_refuses() -> None:
    with pytest.raises(ValueError, match="concentration: expected"):
        VonMises(0.0, -1.0)
    with pytest.raises(ValueError, match="mean: expected"):
        VonMises(np.nan, 1.0)


@pytest.mark.parametrize(("k", "correlation"), MODES)
def test_normalizer_is_the_series(k: tuple[float, float], correlation: float) -> None:
    coupling = correlation * np.sqrt(k[0] * k[1])
    expected = naive.sine_normalizer(*k, coupling, terms=2000 if correlation > 0.995 else 400)
    assert sine.log_normalizer(k, coupling) == pytest.approx(expected, abs=1e-9)
    assert components.log_normalizer(*k, coupling) == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize(("k", "correlation"), MODES[:5])
def test_sine_log_density(k: tuple[float, float], correlation: float) -> None:
    coupling, mean, pose = correlation * np.sqrt(k[0] * k[1]), (0.3, -1.0), (0.5, -0.8)
    found = sine.log_density(pose, [mean], [k], [coupling])
    assert found == pytest.approx([naive.sine_log_density(pose, mean, k, coupling)], abs=1e-6)


@pytest.mark.parametrize(("k", "correlation"), MODES)
def test_quadrature_of_a_mode(k: tuple[float, float], correlation: float) -> None:
    """Stein's identity of a sine model: k1 E sin^2 d1 - c E sin d1 cos d1 sin d2 = E cos d1."""
    coupling = correlation * np.sqrt(k[0] * k[1])
    points, mass = sine.quadrature(np.zeros(2), np.array(k), coupling)
    s1, s2, c1 = np.sin(points[:, 0]), np.sin(points[:, 1]), np.cos(points[:, 0])
    assert mass @ (k[0] * s1 * s1 - coupling * s1 * c1 * s2) == pytest.approx(mass @ c1, rel=1e-3)


@pytest.mark.parametrize(("k", "correlation"), MODES)
def test_a_mode_ends_where_it_is_said_to(k: tuple[float, float], correlation: float) -> None:
    coupling, nats = correlation * np.sqrt(k[0] * k[1]), 14.0
    half = components.half_width(*k, coupling, nats)
    d1 = np.linspace(half, np.pi, 50)[:, None]
    d2 = np.linspace(-np.pi, np.pi, 721)
    value = k[0] * (np.cos(d1) - 1) + k[1] * (np.cos(d2) - 1) + coupling * np.sin(d1) * np.sin(d2)
    assert half == np.pi or (value <= -nats + 1e-6).all()


def test_mixture_against_numerical_integrals() -> None:
    mixture = two_modes_and_a_band()
    log = mixture.log_density(grid(500))
    area = (TWO_PI / 500) ** 2
    assert np.exp(log).sum() * area == pytest.approx(1.0)
    assert -(np.exp(log) * log).sum() * area == pytest.approx(mixture.entropy(), abs=1e-5)
    # broad compared with cells: the cells' probabilities are the density
    cells = mixture.cell_probabilities(256)
    density = np.exp(mixture.log_density(grid(256))) * (TWO_PI / 256) ** 2
    assert cells == pytest.approx(density, rel=1e-6)
    assert mixture.divergence(cells) == pytest.approx(0.0, abs=1e-12)
    highest = np.unravel_index(np.argmax(log), log.shape)
    assert mixture.mode() == pytest.approx(wrap_to_pi(grid(500)[highest]), abs=TWO_PI / 500)


def test_mixture_of_nothing_is_uniform() -> None:
    mixture = VonMisesMixture(uniform_weight=1.0)
    assert mixture.log_density([[1.0, 2.0]]) == pytest.approx([LOG_UNIFORM])
    assert mixture.entropy() == pytest.approx(-LOG_UNIFORM)
    assert mixture.cell_probabilities(8) == pytest.approx(np.full((8, 8), 1 / 64))
    assert mixture.covariances().shape == (0, 2, 2)
    assert mixture.mode() == (0.0, 0.0)
    assert mixture.num_components == 0


def test_covariances_are_those_of_the_curvature() -> None:
    mixture = two_modes_and_a_band()
    expected = np.linalg.inv([[900.0, 400.0], [400.0, 300.0]])
    assert mixture.covariances()[1] == pytest.approx(expected)
    points, mass = sine.quadrature(np.zeros(2), np.array([900.0, 300.0]), -400.0)
    assert (points.T * mass) @ points == pytest.approx(expected, rel=0.05)
    flat = replace(mixture, couplings=[np.sqrt(600.0), -400.0])
    assert np.isinf(np.diag(flat.covariances()[0])).all()
    weights, means, concentrations = mixture.rotation_components()
    assert weights == pytest.approx([0.5, 0.2, 0.2])
    assert means == pytest.approx([np.pi - 1.0, wrap_to_pi(2.0 + np.pi), 1.0])
    spread = expected[0, 0] + expected[1, 1] - 2.0 * expected[0, 1]
    assert concentrations[1:] == pytest.approx([1.0 / spread, 200.0])


def test_merged_modes_have_the_moments_of_their_components() -> None:
    mixture = VonMisesMixture(
        weights=[0.3, 0.1, 0.4],
        means=[[3.1, 1.0], [-3.1, 1.1], [0.0, 0.0]],
        concentrations=[[400.0, 400.0], [100.0, 200.0], [900.0, 900.0]],
        couplings=[0.0, 50.0, 0.0],
        uniform_weight=0.2,
    )
    weights, means, covariances = mixture.merged_modes()
    assert weights == pytest.approx([0.4, 0.4])
    near = means[np.argmax(np.abs(means[:, 0]))]
    apart = TWO_PI - 6.2
    assert near == pytest.approx([3.1 + 0.25 * apart, 1.025])
    d = np.array([apart, 0.1])
    parts = mixture.covariances()
    expected = 0.75 * parts[0] + 0.25 * parts[1] + 0.75 * 0.25 * np.outer(d, d)
    assert covariances[np.argmax(np.abs(means[:, 0]))] == pytest.approx(expected)
    # all three apart
    assert len(mixture.merged_modes(separation=0.05)[0]) == 3
    assert [len(part) for part in VonMisesMixture(uniform_weight=1.0).merged_modes()] == [0, 0, 0]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"weights": [0.5, 0.3]}, "weights: expected a sum of one"),
        ({"weights": [0.5]}, "means: expected shape"),
        ({"means": [[1.0, np.nan], [0.0, 0.0]]}, "means: expected finite"),
        ({"concentrations": [[-1.0, 20.0], [900.0, 300.0]]}, "concentrations: expected numbers"),
        ({"couplings": [25.0, 0.0]}, "couplings: expected c"),
        ({"rotation_means": [1.0, 2.0]}, "rotation_means: expected shape"),
        ({"uniform_weight": -0.1}, "weights: expected a sum of one"),
    ],
)
def test_mixture_refuses(changed: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(two_modes_and_a_band(), **changed)


def points_of(posterior: GridPosterior) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Give a posterior's points, where tiles start, the chunks, and how many are of blocks."""
    bins = posterior.bins
    size = bins * bins + point_kernels.LEVELS * point_kernels.CHUNK
    points = np.empty((5, size), np.float32)
    chunks = np.empty((6, size // point_kernels.CHUNK), np.float32)
    start = np.empty((point_kernels.LEVELS, point_kernels.TILES**2 + 1), np.int64)
    kinds, diagonals = np.empty((bins, bins), np.int8), np.empty(bins)
    information, blocks, number = point_kernels.make_points(
        posterior.log_prob, posterior.prob, _axes(bins), kinds, diagonals, points, start, chunks
    )
    assert information == pytest.approx(-posterior.entropy())
    # headings that are the same make a rotation of pi, the last one
    assert np.roll(diagonals, -1) == pytest.approx(posterior.rotation()[1])
    return points[:, : number * point_kernels.CHUNK], start, chunks[:, :number], blocks


def test_points_are_even_blocks_and_other_cells() -> None:
    posterior = posterior_of(two_modes_and_a_band().cell_probabilities(64))
    bins = 64
    points, start, chunks, parted = points_of(posterior)
    blocks, cells = naive.grid_points(posterior.log_prob, point_kernels.EVEN, point_kernels.BLOCK)
    assert start[:, 0].tolist() == [0, parted * point_kernels.CHUNK]
    assert (start[:, -1] - start[:, 0]).tolist() == [len(blocks), len(cells)]
    assert 0 < len(blocks) < bins * bins / 16
    cell = TWO_PI / bins
    for level, expected, side in ((0, blocks, 4), (1, cells, 1)):
        first, last = start[level, 0], start[level, -1]
        sines = points[:, first:last].astype(float)
        x, y = (np.arctan2(sines[k], sines[k + 1]) % TWO_PI for k in (0, 2))
        i, j = (np.rint(v / cell - side / 2).astype(int) for v in (x, y))
        found = dict(zip(zip(i.tolist(), j.tolist(), strict=True), sines[4], strict=True))
        assert found.keys() == expected.keys()
        assert [found[key] for key in expected] == pytest.approx(
            [max(value, 1e-12) for value in expected.values()], rel=1e-5
        )
        # each chunk's box holds its points and no more; what fills up the last weighs nothing
        for begin in range(int(first), int(last), point_kernels.CHUNK):
            box = chunks[:, begin // point_kernels.CHUNK]
            inside = slice(begin - int(first), begin - int(first) + point_kernels.CHUNK)
            for row, places in ((0, i[inside]), (2, j[inside])):
                low, high = places.min() * cell, (places.max() + side) * cell
                assert np.arctan2(box[row], box[row + 1]) % TWO_PI == pytest.approx(
                    (low + high) / 2, abs=1e-5
                )
                assert box[4 + row // 2] == pytest.approx((high - low) ** 2 / 12, rel=1e-5)
        end = -(-last // point_kernels.CHUNK) * point_kernels.CHUNK
        assert (points[4, last:end] == 0.0).all()


@pytest.mark.parametrize(
    ("mean", "k"),
    [
        ((1.0, 2.0), (40.0, 60.0, 30.0)),
        ((0.02, -0.03), (4000.0, 3900.0, -3850.0)),
        ((3.1, 5.0), (3000.0, 2500.0, 0.0)),
        ((1.0, 2.0), (0.5, 0.2, 0.1)),
    ],
)
def test_density_of_a_mode_at_the_points(
    default_table: LikelihoodTable, mean: tuple[float, float], k: tuple[float, float, float]
) -> None:
    # many crossing ridges: cells everywhere
    pair = CorrespondenceSimulator(mismatch=0.9).pair(100, 1)[0]
    posterior = pose_posterior(pair, default_table, temperature=0.3)
    points, _, chunks, blocks = points_of(posterior)
    cell, number = TWO_PI / posterior.bins, chunks.shape[1]
    rows = np.array([[0.7, *mean, *k, components.MODE]])
    runs = np.empty((1, number, 2), np.uint64)
    num_runs, scratch = np.empty(1, np.int64), np.empty((1, points.shape[1]), np.float32)
    total, reach = np.empty(points.shape[1], np.float32), np.empty(number, np.float32)
    points, chunks = np.ascontiguousarray(points), np.ascontiguousarray(chunks)
    expectation_kernels.expect(
        points, chunks, blocks, cell, rows, 0, 0.3, reach, runs, num_runs, scratch, total
    )
    x, y = np.arctan2(points[0], points[1]), np.arctan2(points[2], points[3])
    d1, d2 = x - mean[0], y - mean[1]
    log = k[0] * (np.cos(d1) - 1) + k[1] * (np.cos(d2) - 1) + k[2] * np.sin(d1) * np.sin(d2)
    mixture = VonMisesMixture([0.7], [mean], [k[:2]], [k[2]], uniform_weight=0.3)
    expected = (mixture.cell_probabilities(posterior.bins) - 0.3 / posterior.bins**2) / cell**2
    i, j = (np.floor((v % TWO_PI) / cell).astype(int) for v in (x, y))
    own = total - 0.3 / TWO_PI**2
    cells = np.arange(len(x)) >= blocks * point_kernels.CHUNK
    near = cells & (log > -5.0)
    assert near.sum() > 3
    assert own[near] == pytest.approx(expected[i, j][near], rel=0.02)
    # what is far was not evaluated
    held = np.zeros(len(x), bool)
    for first, last in runs[0, : num_runs[0]]:
        held[int(first) : int(last)] = True
    assert held[near].all()
    assert own[~held] == pytest.approx(0.0, abs=1e-6)
    if k[0] > 1.0:
        assert held.mean() < 0.6


def test_update_is_score_matching() -> None:
    rng = np.random.default_rng(1)
    d = rng.multivariate_normal([0.0, 0.0], [[0.09, 0.04], [0.04, 0.06]], 500)
    weights = rng.uniform(0.5, 1.0, 500)
    # moments about their own mean direction
    for _ in range(20):
        d -= np.arctan2(weights @ np.sin(d), weights @ np.cos(d))
    s1, s2 = np.sin(d).T
    c1, c2 = np.cos(d).T
    columns = [np.ones(500), s1, s2, 1 - c1, 1 - c2, s1 * s1, s2 * s2, s1 * s2]
    columns += [s1 * s2 * c1, s1 * s2 * c2, (s1 * s2) ** 2]
    moments = np.array([weights @ column for column in columns])
    component = np.zeros(components.COLUMNS)
    maximization_kernels.update_mode(moments, 0.0, 1e-6, component)
    k1, k2, coupling = naive.score_matching(d, weights, (0.0, 0.0))
    found = component[[components.K_1, components.K_2, components.COUPLING]]
    assert found == pytest.approx([k1, k2, coupling], rel=1e-6)


def test_steps_go_on_by_half() -> None:
    before = np.array([0.2, 1.0, 2.0, 100.0, 50.0, 0.1 * np.sqrt(5000.0), components.MODE])
    after = np.array([0.4, 1.2, 1.9, 400.0, 50.0, 0.3 * np.sqrt(20000.0), components.MODE])
    maximization_kernels._go_on(before, after)
    k1, k2 = after[components.K_1], after[components.K_2]
    assert after[: components.K_1] == pytest.approx([0.4 * np.sqrt(2.0), 1.3, 1.85])
    assert (k1, k2) == pytest.approx((800.0, 50.0))
    assert after[components.COUPLING] == pytest.approx(0.4 * np.sqrt(k1 * k2))


def test_covariances_are_sharpened() -> None:
    covariance = np.array([[0.5, 0.3], [0.3, 0.25]])
    out = np.empty(3)
    for blur, least in ((0.0, 0.01), (0.03, 0.01), (0.1, 0.02)):
        components.sharpen(0.5, 0.25, 0.3, blur, least, out)
        expected = naive.sharpened(covariance, blur, least)
        assert out == pytest.approx([expected[0, 0], expected[1, 1], expected[0, 1]])


@pytest.mark.parametrize("k", [(4000.0, 2500.0, 900.0), (3000.0, 9000.0, -4000.0)])
def test_sums_over_cells(k: tuple[float, float, float]) -> None:
    bins, mean = 64, np.array([1.03, 2.01])
    component = np.array([1.0, *mean, *k, components.MODE])
    assert components.is_sharp(component, TWO_PI / bins)
    sums = np.empty(6)
    components.sum_over_cells(component, TWO_PI / bins, sums)
    total, first, second = naive.cell_sums(mean, np.array(k[:2]), k[2], bins)
    assert sums[0] == pytest.approx(np.log(total), abs=1e-3)
    assert sums[1:3] == pytest.approx(first, abs=1e-5)
    expected = [second[0, 0], second[1, 1], second[0, 1]]
    assert sums[3:] == pytest.approx(expected, rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("bins", [32, 128, 90])
def test_fit_finds_what_the_grid_was_made_of(bins: int) -> None:
    truth = VonMisesMixture(
        weights=[0.6, 0.3],
        means=[[1.0, 2.0], [4.0, 0.5]],
        concentrations=[[150.0, 60.0], [80.0, 90.0]],
        couplings=[50.0, 0.0],
        uniform_weight=0.1,
    )
    posterior = posterior_of(truth.cell_probabilities(bins))
    mixture = posterior.von_mises_mixture(max_components=2)
    assert mixture.divergence(posterior.prob) < 0.02
    order = np.argsort(-mixture.weights)
    assert mixture.weights[order] == pytest.approx(truth.weights, abs=0.02)
    assert mixture.means[order] == pytest.approx(wrap_to_pi(truth.means), abs=0.02)
    assert mixture.concentrations[order] == pytest.approx(truth.concentrations, rel=0.15)


def test_fit_of_a_band() -> None:
    truth = VonMisesMixture(
        rotation_weights=[0.9],
        rotation_means=[-2.0],
        rotation_concentrations=[120.0],
        uniform_weight=0.1,
    )
    posterior = posterior_of(truth.cell_probabilities(128))
    mixture = posterior.von_mises_mixture()
    assert mixture.divergence(posterior.prob) < 0.05
    assert mixture.rotation_means == pytest.approx([-2.0], abs=0.01)
    assert mixture.rotation_weights == pytest.approx([0.9], abs=0.1)
    assert mixture.rotation_heading_concentrations[0] < 0.1


@pytest.mark.parametrize("offset", [0.0, 0.25, 0.5])
def test_fit_of_a_mode_sharper_than_a_cell(offset: float) -> None:
    """Its log at the cells is a parabola, whatever it lies on; the fit goes through it."""
    bins, cell = 128, TWO_PI / 128
    deviation = 0.35 * cell
    center = (40.5 + offset) * cell
    exponent = -0.5 * ((grid(bins) - center) / deviation) ** 2
    posterior = posterior_of(np.exp(exponent.sum(axis=-1)))
    mixture = posterior.von_mises_mixture()
    assert mixture.divergence(posterior.prob) < 0.05
    assert np.abs(mixture.means[np.argmax(mixture.weights)] - center).max() < 0.15 * cell
    assert np.sqrt(mixture.covariances()[:, 0, 0]).min() > 0.2 * cell


def test_fit_never_gets_sharper_than_the_grid() -> None:
    prob = np.zeros((128, 128))
    prob[17, 90] = 1.0
    mixture = posterior_of(prob).von_mises_mixture()
    assert mixture.num_components == 1
    assert mixture.divergence(prob) < 0.05
    cell = TWO_PI / 128
    assert 0.2 * cell < np.sqrt(mixture.covariances()[0, 0, 0]) < 0.3 * cell
    assert mixture.means[0] == pytest.approx(wrap_to_pi([17.5 * cell, 90.5 * cell]), abs=0.1 * cell)


def test_fit_tells_two_narrow_modes_in_one_place() -> None:
    # as a posterior of sure matches had them
    prob = np.zeros((128, 128))
    prob[38:42, 15] = 0.42, 0.19, 0.0, 0.36
    prob[38, 14] = 0.03
    _, divergence = fit_mixture(np.log(np.maximum(prob, 1e-30)), prob)
    assert divergence < 0.05


def test_fit_of_nothing_known() -> None:
    mixture, divergence = fit_mixture(
        np.full((64, 64), -np.log(64.0**2)), np.full((64, 64), 64.0**-2)
    )
    assert (mixture.num_components, mixture.uniform_weight) == (0, 1.0)
    assert divergence == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize(("count", "mismatch"), [(25, 0.0), (25, 0.8), (100, 0.5), (100, 0.9)])
def test_fits_of_simulated_pairs(
    default_table: LikelihoodTable, count: int, mismatch: float
) -> None:
    simulator = CorrespondenceSimulator(mismatch=mismatch)
    near = 0
    for correspondences in simulator.pairs(10, count, rng=5)[0]:
        posterior = pose_posterior(correspondences, default_table)
        mixture, divergence = fit_mixture(posterior.log_prob, posterior.prob)
        exact = naive.mixture_divergence(posterior.log_prob, mixture)
        assert mixture.divergence(posterior.prob) == pytest.approx(exact, abs=1e-9)
        assert divergence == pytest.approx(exact, abs=0.01)
        near += exact < 0.05
        # more components are never much worse
        few, coarse = fit_mixture(posterior.log_prob, posterior.prob, max_components=4)
        assert few.num_components <= 4
        assert divergence < coarse + 0.02
    assert near >= 8


@pytest.mark.parametrize("bins", [6, 16, 128])
def test_a_band_gets_no_sharper_along_itself_than_a_cell(bins: int) -> None:
    cell = TWO_PI / bins
    moments = np.zeros(maximization_kernels.MOMENTS)
    moments[0] = 1.0  # all at its mean heading
    band = np.array([1.0, 0.0, 1.0, 1.0 / cell**2, 2.0, 0.0, components.BAND])
    maximization_kernels.update_band(moments, 0.0, cell, 0.05 * cell**2, band)
    deviation = 1.0 / np.sqrt(band[components.K_2])
    assert deviation == pytest.approx(max(0.7 * cell, 0.045), rel=0.1)


def test_fit_refuses() -> None:
    flat = np.full((8, 8), 1.0 / 64)
    with pytest.raises(ValueError, match="max_components: expected"):
        fit_mixture(np.log(flat), flat, max_components=0)
    with pytest.raises(ValueError, match="log_prob, prob: expected"):
        fit_mixture(np.log(flat), flat[:4])
