"""The M-estimator: its kernels, its losses, the polished pose; a pose from several references."""

from __future__ import annotations

import naive
import numpy as np
import pytest
from naive import angles_of
from scipy import integrate, optimize, stats

from pflut._robust import TUKEY, robust_weight
from pflut.correspondences import Correspondences
from pflut.geometry import bearing_angles, relative_headings, wrap_to_pi
from pflut.likelihood.table import bearing_columns
from pflut.relpose.refine import (
    CUTOFFS,
    LOSSES,
    STEPS_PER_CUTOFF,
    refine_headings,
    refine_relative_pose,
)
from pflut.relpose.refine_kernels import _residual, _solve, refine, refine_many, refine_pose
from pflut.simulation.correspondences import CorrespondenceSimulator

# --- kernels --------------------------------------------------------------------------------------


def test_residual_equals_its_naive_twin() -> None:
    c, *_ = CorrespondenceSimulator(mismatch=0.5).pair(300, 0)
    rows, angles = bearing_columns(c).T, angles_of(c)
    out = np.empty(3)
    checked = 0
    for (theta, phi), row, bearing in zip(
        np.random.default_rng(1).uniform(0, 2 * np.pi, (300, 2)), rows, angles, strict=True
    ):
        in_front = _residual(row, np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi), out)
        residual, norm = naive.epipolar_residual(bearing, theta, phi)
        assert out[0] == pytest.approx(residual, abs=1e-7)
        step = 1e-6
        for i, (d, e) in enumerate(((step, 0.0), (0.0, step))):
            slope = naive.epipolar_value(bearing, theta + d, phi + e)
            slope -= naive.epipolar_value(bearing, theta - d, phi - e)
            assert out[1 + i] == pytest.approx(slope / (2 * step) / norm, abs=1e-6)
        depths = naive.planar_depths(bearing, theta, phi)
        # nearer to the base line or the horizon the kernel gives the benefit of the doubt
        apex = np.sin(theta - bearing[0] - phi + bearing[2])
        if np.abs(depths).min() * apex**2 > 2e-3:
            checked += 1
            assert in_front == (depths > 0).all()
    assert checked > 150


@pytest.mark.parametrize("elevation", [0.0, np.pi / 2, -np.pi / 2])
def test_residual_is_finite_at_horizon_and_zenith(elevation: float) -> None:
    c = Correspondences([1.0, 1.0], [elevation, 0.3], [2.0, 2.0], [elevation, elevation])
    out = np.empty(3)
    for row in bearing_columns(c).T:
        for theta in (1.0, 2.0, 1.0 + np.pi):
            _residual(row, np.sin(theta), np.cos(theta), np.sin(2.0), np.cos(2.0), out)
            assert np.isfinite(out).all()
            assert abs(out[0]) < np.pi


def test_refine_finds_the_minimum_of_the_biweight() -> None:
    """Compared with a general minimiser of the naive cost, from the same start."""
    moved = 0.0
    for seed in range(6):
        c, theta, phi = CorrespondenceSimulator(mismatch=0.4).pair(40, seed)
        angles = angles_of(c)
        headings = np.array([theta + 0.02, phi - 0.015])
        start = headings.copy()
        inliers = refine(bearing_columns(c), TUKEY, 0.0, 0.01 * CUTOFFS, 50, headings, np.zeros(4))
        cutoff = 0.01 * CUTOFFS[-1]
        found = optimize.minimize(
            lambda x, rows=angles, k=cutoff: naive.biweight_cost(rows, x[0], x[1], k),
            headings,
            method="Nelder-Mead",
            options={"xatol": 1e-6, "fatol": 1e-9},
        ).x
        # Gauss-Newton takes the gradient's length as constant: a part of the noise's size
        assert np.abs(headings - found).max() < 2e-3
        assert abs(inliers - naive.count_inliers(angles, *headings, cutoff)) <= 1
        moved = max(moved, np.abs(headings - start).max())
    assert moved > 0.01


def test_refine_without_noise_is_exact() -> None:
    """The discretization error of any table is gone."""
    for seed in range(20):
        c, theta, phi = CorrespondenceSimulator(mismatch=0.0, noise=0.0).pair(40, seed)
        headings = np.array([theta + 0.025, phi - 0.025])
        refine(bearing_columns(c), TUKEY, 0.0, 0.01 * CUTOFFS, 30, headings, np.zeros(4))
        assert np.abs(headings - [theta, phi]).max() < 1e-6


def test_information_is_that_of_the_weighted_least_squares() -> None:
    c, theta, phi = CorrespondenceSimulator(mismatch=0.2).pair(60, 3)
    headings, information = np.array([theta, phi]), np.zeros(4)
    cutoff = 0.03
    refine(bearing_columns(c), TUKEY, 0.0, np.array([cutoff]), 1, headings, information)
    expected = np.zeros((2, 2))
    squares = 0.0
    for bearing in angles_of(c):
        residual, norm = naive.epipolar_residual(bearing, theta, phi)
        if abs(residual) >= cutoff or not (naive.planar_depths(bearing, theta, phi) > 0).all():
            continue
        weight = (1 - (residual / cutoff) ** 2) ** 2
        step = 1e-6
        slopes = [
            naive.epipolar_value(bearing, theta + a, phi + b)
            - naive.epipolar_value(bearing, theta - a, phi - b)
            for a, b in ((step, 0.0), (0.0, step))
        ]
        jacobian = np.array(slopes) / (2 * step) / norm
        expected += weight * np.outer(jacobian, jacobian)
        squares += weight * residual**2
    assert information == pytest.approx(
        [expected[0, 0], expected[0, 1], expected[1, 1], squares], rel=1e-4
    )


LOSS_NAMES = ("tukey", "huber", "cauchy")


@pytest.mark.parametrize("name", LOSS_NAMES)
def test_weight_equals_its_naive_twin(name: str) -> None:
    code, knee = LOSSES[name].code, LOSSES[name].knee
    for residual in np.linspace(-2.99, 2.99, 41):
        found = robust_weight(residual, code, knee, 3.0)
        assert found == pytest.approx(naive.robust_weight(residual, name, knee, 3.0))


@pytest.mark.parametrize("name", LOSS_NAMES)
def test_spread_is_the_weighted_variance_of_what_is_not_cut_off(name: str) -> None:
    """Of normal residuals within three standard deviations."""
    loss, cutoff = LOSSES[name], CUTOFFS[-1]

    def density(e: float) -> float:
        return naive.robust_weight(e, name, loss.knee, cutoff) * e**2 * stats.norm.pdf(e)

    within = stats.norm.cdf(cutoff) - stats.norm.cdf(-cutoff)
    weighted = integrate.quad(density, -cutoff, cutoff, points=[-loss.knee, loss.knee])[0]
    assert loss.spread == pytest.approx(weighted / within, abs=0.005)


@pytest.mark.parametrize("name", ["huber", "cauchy"])
def test_knees_are_those_of_95_percent_efficiency(name: str) -> None:
    """Without a cut-off: (E psi')^2 / E psi^2 of normal residuals, psi = w e."""
    knee = LOSSES[name].knee

    def psi(e: float) -> float:
        return naive.robust_weight(e, name, knee, np.inf) * e

    def mean(function) -> float:
        return integrate.quad(
            lambda e: function(e) * stats.norm.pdf(e), -12, 12, points=[-knee, knee], limit=200
        )[0]

    # E psi' = E e psi by parts
    found = mean(lambda e: e * psi(e)) ** 2 / mean(lambda e: psi(e) ** 2)
    assert found == pytest.approx(0.95, abs=0.002)


@pytest.mark.parametrize("name", LOSS_NAMES)
def test_refine_many_equals_its_naive_twin(name: str) -> None:
    """Pairs of different sizes, poses in any order."""
    code, knee = LOSSES[name].code, 0.01 * LOSSES[name].knee
    pairs = [CorrespondenceSimulator(mismatch=0.4).pair(n, n) for n in (30, 7, 18)]
    columns = np.concatenate([bearing_columns(c) for c, *_ in pairs], axis=1)
    first = np.cumsum([0, *(len(c) for c, *_ in pairs)])
    owners = np.array([2, 0, 1, 0, 2])
    rng = np.random.default_rng(0)
    poses = np.array([pairs[k][1:] for k in owners]) + rng.normal(0.0, 0.02, (5, 2))
    poses[-1] = rng.uniform(0, 6, 2)
    scales = np.array([0.06, 0.03])
    moved, information, inliers = poses.copy(), np.empty((5, 4)), np.empty(5, np.int64)
    refine_many(columns, first, code, knee, scales, 2, moved, owners, information, inliers)
    for k, pose in enumerate(poses):
        c, known = pairs[owners[k]][0], np.empty(4)
        expected = naive.polish(angles_of(c), *pose, scales, 2, name, knee)
        assert moved[k] == pytest.approx(expected, abs=1e-4)
        alone = pose.copy()
        count = refine(bearing_columns(c), code, knee, scales, 2, alone, known)
        assert moved[k] == pytest.approx(alone, abs=1e-9)
        assert information[k] == pytest.approx(known)
        assert inliers[k] == count
    assert np.abs(moved - poses).max() > 0.01


# --- the polished pose ----------------------------------------------------------------------------


@pytest.mark.parametrize("loss", LOSS_NAMES)
def test_a_good_guess_becomes_the_estimate(loss: str) -> None:
    """From 3 degrees aside, half of the correspondences wrong: as near as their noise allows."""
    errors, distances = [], []
    for seed in range(100):
        c, *truth = CorrespondenceSimulator(mismatch=0.5).pair(60, seed)
        e = refine_relative_pose(c, truth[0] + 0.04, truth[1] - 0.04, loss=loss)
        error = wrap_to_pi(np.array([e.heading_l, e.heading_r]) - truth)
        errors.append(np.abs(error).max())
        distances.append(error @ np.linalg.solve(e.covariance, error))
        assert (e.log_likelihood, e.log_evidence) == (0.0, 0.0)
        assert -np.pi < e.heading_l <= np.pi
        assert -np.pi < e.heading_r <= np.pi
    assert np.median(errors) < 0.009
    # the median of chi-square with two degrees is 1.39; of a hundred its standard error is 0.2
    assert 0.4 < np.median(distances) < 2.4


def test_cauchy_s_loss_is_the_most_accurate_of_few() -> None:
    """The biweight, cut off at three standard deviations, gives away a tenth."""
    medians = {}
    for loss in LOSS_NAMES:
        errors = []
        for seed in range(400):
            c, *truth = CorrespondenceSimulator(mismatch=0.0).pair(25, seed)
            e = refine_relative_pose(c, *truth, loss=loss)
            errors.append(np.abs(wrap_to_pi(np.array([e.heading_l, e.heading_r]) - truth)).max())
        medians[loss] = np.median(errors)
    assert medians["cauchy"] < 0.97 * medians["tukey"]
    assert medians["huber"] == pytest.approx(medians["cauchy"], rel=0.05)


def test_without_a_loss_nothing_moves_and_what_agrees_is_weighed() -> None:
    """Residuals beyond three standard deviations count nothing: the covariance is without them."""
    c, *truth = CorrespondenceSimulator(mismatch=0.0, noise=0.02).pair(200, 5)
    pose = np.array([truth])
    residuals = [abs(naive.epipolar_residual(bearing, *truth)[0]) for bearing in angles_of(c)]
    agrees = np.array(residuals) < 0.03
    assert np.count_nonzero(~agrees & (np.array(residuals) < 0.06)) > 10
    covariances = []
    for some in (c, c[agrees]):
        first = np.array([0, len(some)])
        headings, covariance = refine_headings(bearing_columns(some), first, pose, None, 0.01)
        assert (headings == pose).all()
        covariances.append(covariance)
    assert covariances[0] == pytest.approx(covariances[1], rel=1e-9)


def test_nothing_to_polish_stays_where_it_is() -> None:
    e = refine_relative_pose(Correspondences.empty(), 1.0, 9.0)
    assert (e.heading_l, e.heading_r) == pytest.approx((1.0, 9.0 - 2 * np.pi))
    assert (e.num_inliers, e.success) == (0, False)
    assert np.sqrt(e.covariance.diagonal()).min() > 1.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"loss": "l2"}, "loss: expected one of tukey, huber, cauchy, got 'l2'"),
        ({"noise": 0.0}, r"noise: expected radians in \(0, pi/2\), got 0.0"),
        ({"noise": np.nan}, r"noise: expected radians in \(0, pi/2\), got nan"),
        ({"heading_r": np.inf}, r"heading_l, heading_r: expected finite radians, got \[0.0, inf\]"),
    ],
)
def test_misuse(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        refine_relative_pose(
            Correspondences.empty(), **{"heading_l": 0.0, "heading_r": 0.0, **options}
        )


# --- a pose from several references ---------------------------------------------------------------


def several_references(
    pose: np.ndarray, references: np.ndarray, n: int, noise: float, mismatch: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Bearing rows and owners: landmarks around, seen from every reference and from the pose."""
    rng = np.random.default_rng(seed)
    rows = []
    for reference in references:
        landmarks = rng.uniform([-4, -4, -1], [4, 4, 1.5], (n, 3))
        other = np.where(rng.uniform(size=(n, 1)) < mismatch, rng.permutation(landmarks), landmarks)
        views = []
        for viewer, seen in ((reference, landmarks), (pose, other)):
            vector = np.column_stack([seen[:, :2] - viewer[:2], seen[:, 2]])
            azimuth, elevation = bearing_angles(vector)
            spread = noise * rng.normal(size=(2, n))
            views += [azimuth - viewer[2] + spread[0] / np.cos(elevation), elevation + spread[1]]
        rows.append(bearing_columns(Correspondences(*views)).T)
    return np.ascontiguousarray(np.concatenate(rows)), np.repeat(np.arange(len(references)), n)


REFERENCES = np.array([[-1.0, -1.0, 0.3], [1.5, -0.5, 2.0], [0.2, 1.6, -2.5]])


def test_solve_against_numpy() -> None:
    rng = np.random.default_rng(4)
    for _ in range(50):
        root = rng.standard_normal((3, 5))
        matrix, vector, found = root @ root.T, rng.standard_normal(3), np.empty(3)
        _solve(matrix, vector, found)
        assert matrix @ found == pytest.approx(vector, abs=1e-9)


def test_refine_pose_finds_the_pose() -> None:
    rng = np.random.default_rng(0)
    for seed in range(10):
        pose = rng.uniform([-1, -1, -3], [1, 1, 3])
        rows, owners = several_references(pose, REFERENCES, 40, 0.0, 0.0, seed)
        found, information = pose + np.array([0.05, -0.04, 0.03]), np.zeros((3, 3))
        inliers = refine_pose(rows, owners, REFERENCES, 0.01 * CUTOFFS, 20, found, information)
        assert np.abs(found - pose).max() < 1e-6
        assert inliers >= 118
        assert (np.linalg.eigvalsh(information) > 0).all()


def test_refine_pose_error_is_as_its_information_says() -> None:
    pose, noise, sigmas = np.array([0.3, -0.2, 0.5]), 0.005, []
    for seed in range(60):
        rows, owners = several_references(pose, REFERENCES, 30, noise, 0.0, seed)
        found, information = pose.copy(), np.zeros((3, 3))
        refine_pose(rows, owners, REFERENCES, noise * CUTOFFS, STEPS_PER_CUTOFF, found, information)
        sigmas.append((found - pose) @ information @ (found - pose) / noise**2)
    # a chi-square of three degrees, a little more for what the biweight loses
    assert 2.0 < np.mean(sigmas) < 5.0


def test_refine_pose_agrees_with_refine_for_one_reference() -> None:
    """With one reference the distance is free; the headings are what `refine` finds."""
    pose, reference = np.array([0.4, 0.7, 1.0]), REFERENCES[:1]
    rows, owners = several_references(pose, reference, 60, 0.005, 0.2, 5)
    found = pose.copy()
    refine_pose(rows, owners, reference, 0.01 * CUTOFFS, 30, found, np.zeros((3, 3)))
    theta, phi, _ = relative_headings(reference[0], pose)
    headings = np.array([theta, phi])
    refine(np.ascontiguousarray(rows.T), TUKEY, 0.0, 0.01 * CUTOFFS, 30, headings, np.zeros(4))
    theta, phi, _ = relative_headings(reference[0], found)
    assert np.abs(wrap_to_pi(headings - [theta, phi])).max() < 1e-4


def test_refine_pose_on_a_reference_stays_finite() -> None:
    rows, owners = several_references(REFERENCES[0], REFERENCES, 30, 0.005, 0.3, 6)
    found = REFERENCES[0].copy()
    refine_pose(rows, owners, REFERENCES, 0.01 * CUTOFFS, 8, found, np.zeros((3, 3)))
    assert np.abs(found - REFERENCES[0]).max() < 0.1


def test_refine_pose_of_nothing_stays() -> None:
    found, none = np.array([1.0, 2.0, 3.0]), np.zeros(0, np.int64)
    args = (none, REFERENCES, 0.01 * CUTOFFS, 8, found, np.zeros((3, 3)))
    assert refine_pose(np.zeros((0, 8)), *args) == 0
    assert found.tolist() == [1.0, 2.0, 3.0]
