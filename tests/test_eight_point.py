"""The general 8-point RANSAC: its algebra, costs, refinement, success, covariance, tilted views."""

from __future__ import annotations

import naive
import numpy as np
import pytest
from scipy import optimize
from scipy.spatial.transform import Rotation

from pflut.correspondences import Correspondences
from pflut.geometry import bearing_angles, wrap_to_pi
from pflut.relpose.eight_point_kernels import (
    BLOCK,
    CHEIRALITY_SLACK,
    SAMPLE_SIZE,
    _solve_damped,
    agreeing_by_chance,
    decompose,
    null_vector,
    pose_cost,
    refine,
    solve,
)
from pflut.relpose.ransac import ransac_relative_pose, ransac_relative_poses
from pflut.relpose.refine import CUTOFFS, LOSSES
from pflut.simulation.correspondences import CorrespondenceSimulator


def general(
    n: int, seed: int, noise: float = 0.0, mismatches: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give bearings (n, 4) of two views that roll and pitch, the rotation and the translation."""
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=rng).as_matrix()
    shift = rng.normal(size=3)
    shift /= np.linalg.norm(shift)
    left = rng.uniform(-3, 3, (n, 3))
    right = left @ turn.T + shift
    right[:mismatches] = rng.uniform(-3, 3, (mismatches, 3))
    angles = np.stack([*bearing_angles(left), *bearing_angles(right)], axis=1)
    return angles + noise * rng.normal(size=angles.shape), turn, shift


def rays_of(angles: np.ndarray) -> np.ndarray:
    """Give the kernels' rays (6, n up to a multiple of BLOCK)."""
    rays = np.zeros((6, -(-len(angles) // BLOCK) * BLOCK))
    for i, bearing in enumerate(angles):
        rays[:3, i], rays[3:, i] = naive.unit(*bearing[:2]), naive.unit(*bearing[2:])
    return rays


def pose_of(turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    return np.concatenate([turn.ravel(), shift])


def scratch() -> tuple[np.ndarray, ...]:
    matrix, order = np.empty((8, 9)), np.empty(9, np.int64)
    return matrix, order, np.empty(9), np.empty((4, 12)), np.empty((6, SAMPLE_SIZE))


def refined(
    rays: np.ndarray, n: int, pose: np.ndarray, cutoffs: np.ndarray, loss: str, steps: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int, float]:
    found, information, slopes = pose.copy(), np.empty((5, 5)), np.empty((2, 5))
    chosen = LOSSES[loss]
    inliers, squares = refine(
        rays, n, chosen.code, 0.01 * chosen.knee, cutoffs, steps, found, information, slopes
    )
    return found, information, slopes, inliers, squares


# --- algebra --------------------------------------------------------------------------------------


def test_null_vector_is_that_of_the_singular_values() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        matrix = rng.normal(size=(8, 9))
        expected = np.linalg.svd(matrix)[2][8]
        vector = np.empty(9)
        assert null_vector(matrix.copy(), np.empty(9, np.int64), vector)
        vector /= np.linalg.norm(vector)
        assert abs(abs(vector @ expected) - 1.0) < 1e-12
        assert np.abs(matrix @ vector).max() < 1e-10


def test_dependent_equations_have_no_null_vector() -> None:
    matrix = np.random.default_rng(1).normal(size=(8, 9))
    matrix[5] = matrix[2] - 2.0 * matrix[7]
    assert not null_vector(matrix, np.empty(9, np.int64), np.empty(9))
    assert not null_vector(np.zeros((8, 9)), np.empty(9, np.int64), np.empty(9))


def test_decomposition_is_of_the_nearest_essential_matrix() -> None:
    rng = np.random.default_rng(2)
    poses = np.empty((4, 12))
    for seed in range(50):
        _, turn, shift = general(1, seed)
        cross = np.cross(np.eye(3), shift) @ turn
        noisy = cross + 0.05 * rng.normal(size=(3, 3))
        u, _, vt = np.linalg.svd(noisy)
        nearest = u @ np.diag([1.0, 1.0, 0.0]) @ vt
        assert decompose(noisy, poses)
        for pose in poses:
            rotation, direction = pose[:9].reshape(3, 3), pose[9:]
            assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-9)
            assert np.linalg.det(rotation) == pytest.approx(1.0)
            again = np.cross(np.eye(3), direction) @ rotation
            sign = np.sign((again * nearest).sum())
            assert sign * again == pytest.approx(nearest, abs=1e-8)
        assert len({tuple(np.round(pose, 6)) for pose in poses}) == 4
        # of the noise-free matrix one of the four is the pose itself
        assert decompose(cross, poses)
        assert np.abs(poses - pose_of(turn, shift)).max(axis=1).min() < 1e-8


def test_matrices_without_two_directions_have_no_decomposition() -> None:
    assert not decompose(np.zeros((3, 3)), np.empty((4, 12)))
    assert not decompose(np.outer([1.0, 2, 3], [0.5, 0, 1]), np.empty((4, 12)))


def test_damped_solution_is_numpy_s() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        root = rng.normal(size=(5, 9))
        matrix, vector, out = root @ root.T, rng.normal(size=5), np.empty(5)
        _solve_damped(matrix, vector, out)
        damped = matrix + (1e-6 * np.trace(matrix) + 1e-12) * np.eye(5)
        assert out == pytest.approx(np.linalg.solve(damped, vector), abs=1e-9)


# --- the solver -----------------------------------------------------------------------------------


def well_placed(angles: np.ndarray) -> bool:
    """Say whether the eight equations determine the matrix well: rounding grows with how alike."""
    rows = [np.outer(naive.unit(*b[2:]), naive.unit(*b[:2])).ravel() for b in angles]
    return bool(np.linalg.svd(np.array(rows))[1][7] > 0.01)


def test_solver_is_exact_without_noise() -> None:
    tried, pose = 0, np.empty(12)
    for seed in range(100):
        angles, turn, shift = general(SAMPLE_SIZE, seed)
        if well_placed(angles):
            assert solve(rays_of(angles), np.arange(SAMPLE_SIZE), scratch(), pose)
            assert np.abs(pose - pose_of(turn, shift)).max() < 1e-9
            tried += 1
    assert tried > 50


def test_solver_equals_its_naive_twin() -> None:
    """With noise, of the four poses of the nearest essential matrix."""
    tried, pose = 0, np.empty(12)
    for seed in range(60):
        angles, *_ = general(SAMPLE_SIZE, seed, noise=0.01)
        if not well_placed(angles):
            continue
        _, expected = naive.eight_point(angles)
        assert solve(rays_of(angles), np.arange(SAMPLE_SIZE), scratch(), pose)
        found = np.cross(np.eye(3), pose[9:]) @ pose[:9].reshape(3, 3)
        assert abs((found * expected).sum()) == pytest.approx(2.0, abs=1e-9)
        tried += 1
    assert tried > 30


def test_solver_finds_what_that_of_poselib_finds() -> None:
    poselib = pytest.importorskip("poselib", reason="the extra 'peers' is not installed")
    tried, pose = 0, np.empty(12)
    for seed in range(100):
        angles, *_ = general(SAMPLE_SIZE, seed)
        if not well_placed(angles):
            continue
        rays = rays_of(angles)
        assert solve(rays, np.arange(SAMPLE_SIZE), scratch(), pose)
        found = poselib.relpose_8pt(rays[:3].T, rays[3:].T)
        theirs = [pose_of(p.R, p.t / np.linalg.norm(p.t)) for p in found]
        assert np.abs(np.array(theirs) - pose).max(axis=1).min() < 1e-6
        tried += 1
    assert tried > 50


# --- cost and refinement --------------------------------------------------------------------------


@pytest.mark.parametrize("truncated", [True, False])
def test_cost_equals_its_naive_twin(truncated: bool) -> None:
    rng, checked, agreeing = np.random.default_rng(4), 0, 0
    for seed in range(20):
        angles, turn, shift = general(13, seed, noise=0.02, mismatches=4)
        turned = Rotation.from_rotvec(rng.normal(0.0, 0.03, 3)).as_matrix() @ turn
        for rotation in (turn, turned):
            # nearer to the base line the kernel gives the benefit of the doubt
            depths = np.array([naive.general_depths(b, rotation, shift) for b in angles])
            apex = [naive.unit(*b[2:]) @ rotation @ naive.unit(*b[:2]) for b in angles]
            clear = np.abs(depths).min(axis=1) * (1 - np.square(apex)) > 2 * CHEIRALITY_SLACK
            chosen = angles[clear]
            pose = pose_of(rotation, shift)
            found = pose_cost(rays_of(chosen), pose, 0.1, truncated, np.inf)
            expected = naive.general_cost(chosen, rotation, shift, 0.1, truncated)
            assert found == pytest.approx(expected, abs=1e-5)
            checked += len(chosen)
            agreeing += len(chosen) - expected
    assert checked > 400
    assert agreeing > 150


def test_refinement_finds_the_minimum_of_the_loss() -> None:
    """Compared with SciPy's robust least squares of the naive residuals, from the same start."""
    for seed in range(5):
        angles, turn, shift = general(40, seed, noise=0.005)
        depths = np.array([naive.general_depths(b, turn, shift) for b in angles])
        angles = angles[(depths > 0.05).all(axis=1)]
        start = pose_of(Rotation.from_rotvec([0.02, -0.01, 0.015]).as_matrix() @ turn, shift)
        cutoffs = np.array([1.0])
        found, *_ = refined(rays_of(angles), len(angles), start, cutoffs, "cauchy", 50)
        knee = 0.01 * LOSSES["cauchy"].knee

        def residuals(x: np.ndarray, angles=angles, start=start) -> np.ndarray:
            turn = Rotation.from_rotvec(x[:3]).as_matrix() @ start[:9].reshape(3, 3)
            moved = start[9:] + x[3:]
            moved = moved / np.linalg.norm(moved)
            return np.array([naive.general_residual(b, turn, moved) for b in angles])

        best = optimize.least_squares(residuals, np.zeros(6), loss="cauchy", f_scale=knee)
        turn = Rotation.from_rotvec(best.x[:3]).as_matrix() @ start[:9].reshape(3, 3)
        # Gauss-Newton takes the gradient's length as constant: a part of the noise's size
        assert np.abs(found[:9] - turn.ravel()).max() < 1e-3
        assert np.abs(start[:9] - found[:9]).max() > 5e-3


def test_refinement_without_noise_is_exact() -> None:
    for seed in range(10):
        angles, turn, shift = general(40, seed)
        start = pose_of(Rotation.from_rotvec([0.02, -0.01, 0.015]).as_matrix() @ turn, shift)
        found, *_ = refined(rays_of(angles), 40, start, 0.01 * CUTOFFS, "cauchy", 30)
        assert found == pytest.approx(pose_of(turn, shift), abs=1e-8)


def test_without_steps_the_pose_stays() -> None:
    angles, turn, shift = general(20, 0, noise=0.01)
    pose = pose_of(turn, shift)
    found, information, _, inliers, squares = refined(
        rays_of(angles), 20, pose, np.array([0.03]), "cauchy", 0
    )
    assert (found == pose).all()
    assert inliers >= 10
    assert squares > 0.0
    assert np.linalg.eigvalsh(information).min() > 0.0


def test_slopes_are_the_headings_derivatives() -> None:
    angles, turn, shift = general(20, 3, noise=0.01)
    pose = pose_of(turn, shift)
    _, _, slopes, *_ = refined(rays_of(angles), 20, pose, np.array([0.03]), "cauchy", 0)

    def headings(rotation: np.ndarray, direction: np.ndarray) -> np.ndarray:
        center = -rotation.T @ direction
        return np.array([np.arctan2(center[1], center[0]), np.arctan2(direction[1], direction[0])])

    axis = np.zeros(3)
    axis[np.abs(shift).argmin()] = 1.0
    first = np.cross(shift, axis)
    first /= np.linalg.norm(first)
    tangents = [first, np.cross(shift, first)]
    step = 1e-6
    for k in range(5):
        change = []
        for sign in (1.0, -1.0):
            rotation, direction = turn, shift
            if k < 3:
                rotation = Rotation.from_rotvec(sign * step * np.eye(3)[k]).as_matrix() @ turn
            else:
                direction = shift + sign * step * tangents[k - 3]
            change.append(headings(rotation, direction))
        assert slopes[:, k] == pytest.approx((change[0] - change[1]) / (2 * step), abs=1e-5)


def test_what_agrees_by_chance_is_counted() -> None:
    angles, turn, shift = general(30, 5, noise=0.01)
    pose, shifts = pose_of(turn, shift), 4
    rays = rays_of(angles)
    expected = 0
    for k in range(1, shifts + 1):
        rolled = np.concatenate([angles[:, :2], np.roll(angles[:, 2:], -k, axis=0)], axis=1)
        expected += 30 - pose_cost(rays_of(rolled), pose, 0.1, False, np.inf)
    assert agreeing_by_chance(rays, 30, pose, 0.1, shifts, np.empty_like(rays)) == expected > 0


# --- the estimate ---------------------------------------------------------------------------------


def errors_of(pairs: list[Correspondences], headings: np.ndarray, **options) -> np.ndarray:
    found = ransac_relative_poses(pairs, solver="8pt", **options)
    poses = np.array([[e.heading_l, e.heading_r] for e in found])
    return np.abs(wrap_to_pi(poses - headings)).max(axis=1)


@pytest.mark.parametrize(("n", "mismatch", "needed"), [(25, 0.0, 0.92), (100, 0.5, 0.93)])
def test_success(n: int, mismatch: float, needed: float) -> None:
    """0.96 and 0.98 of 200 pairs."""
    headings, bearings = CorrespondenceSimulator(mismatch=mismatch).sample(200, n, rng=1)
    pairs = [Correspondences(*pair.T) for pair in bearings]
    assert (errors_of(pairs, headings) < 0.1).mean() > needed


def test_tilt_does_no_harm() -> None:
    """The paper's Figure 6b: what is not planar cannot be harmed by a floor that is not."""
    medians = []
    for tilt in (0.0, 0.3):
        simulator = CorrespondenceSimulator(mismatch=0.2, max_tilt=tilt)
        headings, bearings = simulator.sample(200, 60, rng=1)
        pairs = [Correspondences(*pair.T) for pair in bearings]
        medians.append(np.median(errors_of(pairs, headings)))
        planar = np.array([[e.heading_l, e.heading_r] for e in ransac_relative_poses(pairs)])
        planar_error = np.median(np.abs(wrap_to_pi(planar - headings)).max(axis=1))
    assert medians[1] < 1.5 * medians[0] + 0.01
    assert planar_error > 5 * medians[1]


def test_covariance_is_calibrated() -> None:
    """Of the right estimates, the Mahalanobis distances are about chi-square of two degrees."""
    headings, bearings = CorrespondenceSimulator(mismatch=0.3).sample(200, 60, 3)
    distances = []
    for pair, truth in zip(bearings, headings, strict=True):
        e = ransac_relative_pose(Correspondences(*pair.T), solver="8pt")
        error = wrap_to_pi(np.array([e.heading_l, e.heading_r]) - truth)
        if np.abs(error).max() < 0.1:
            distances.append(error @ np.linalg.solve(e.covariance, error))
    assert len(distances) > 170
    # the median is 1.39, its standard error 0.14
    assert 0.7 < np.median(distances) < 2.2


def test_mismatches_alone_are_seldom_a_success() -> None:
    _, bearings = CorrespondenceSimulator(mismatch=1.0).sample(100, 40, 5)
    pairs = [Correspondences(*pair.T) for pair in bearings]
    found = ransac_relative_poses(pairs, solver="8pt", max_iterations=200)
    # 0.01 are claimed; six of a hundred would then be five standard errors too many
    assert np.mean([e.success for e in found]) <= 0.06


def test_adaptive_stop_finds_as_much() -> None:
    headings, bearings = CorrespondenceSimulator(mismatch=0.2).sample(100, 60, rng=1)
    pairs = [Correspondences(*pair.T) for pair in bearings]
    fixed = (errors_of(pairs, headings) < 0.1).mean()
    assert (errors_of(pairs, headings, confidence=0.999) < 0.1).mean() >= fixed - 0.03
