"""Estimates: clusters, headings around +-pi, covariances, confidence."""

import naive
import numpy as np
import pytest

from pflut.geometry import wrap_to_pi
from pflut.localization import estimate as module
from pflut.localization.estimate import estimate_from_particles
from pflut.localization.resampling import systematic_indices


def blob(n, center, stds, seed=0):
    poses = np.random.default_rng(seed).normal(center, stds, (n, 3))
    poses[:, 2] = wrap_to_pi(poses[:, 2])
    return poses


def test_moments_equal_their_naive_twin():
    rng = np.random.default_rng(0)
    poses = rng.uniform([-2, -2, -np.pi], [2, 2, np.pi], (500, 3))
    weights = rng.random(500)
    for center in ([0.0, 0.0, 3.0], [1.0, -1.0, 0.0]):
        for radius, angle in ((1.0, 0.5), (0.1, 3.0), (np.inf, np.inf)):
            out = np.empty((4, 4))
            module._moments(poses, weights, np.array(center), radius, angle, out)
            expected = naive.moments(poses, weights, center, radius, angle)
            np.testing.assert_allclose(out, expected, atol=1e-10)


@pytest.mark.parametrize("n", [1, 30, 1000, 5000])
def test_heaviest_cell_equals_its_naive_twin(n):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        poses = rng.uniform([-4, -4, -np.pi], [4, 4, np.pi], (n, 3))
        poses[: n // 2] = blob(n // 2, [1, 1, np.pi], 0.3, seed)
        weights = rng.random(n) / n
        drawn = poses[systematic_indices(weights, module.NUM_DRAWS, 0.5)]
        center = module._fullest_cell(drawn)
        expected, score = naive.heaviest_cell(drawn, module.CELL_SIZE, module.CELLS_OF_HEADING)
        if n > 1000:  # among few draws cells tie
            np.testing.assert_allclose(center, expected, atol=1e-9)
        else:
            near = np.abs(drawn - center) / [module.CELL_SIZE, module.CELL_SIZE, 1.0]
            assert (near[:, :2].max(axis=1) <= 1.5).sum() >= 1
            assert score >= 1.0


@pytest.mark.parametrize("heading", [0.0, np.pi, -3.0, 1.0])
@pytest.mark.parametrize("method", ["cluster", "mean"])
def test_one_gaussian(heading, method):
    std = np.array([0.1, 0.2, 0.1])
    n = 100_000
    result = estimate_from_particles(blob(n, [3.0, -2.0, heading], std), method=method)
    difference = result.pose - [3.0, -2.0, heading]
    difference[2] = wrap_to_pi(difference[2])
    assert (np.abs(difference) <= 5 * std / np.sqrt(n)).all()
    assert -np.pi < result.pose[2] <= np.pi
    error = 5 * np.outer(std, std) * np.sqrt(2 / n)
    # three standard deviations cut 1.5 % of the variance off
    allowed = error + (0.0 if method == "mean" else 0.03) * np.outer(std, std)
    assert (np.abs(result.covariance - np.diag(std**2)) <= allowed).all()
    assert result.position_std == pytest.approx(np.hypot(0.1, 0.2), rel=0.02)
    assert result.heading_std == pytest.approx(0.1, rel=0.02)
    assert result.num_particles == n
    assert result.effective_sample_size == pytest.approx(n)
    assert result.cluster_weight > 0.98


def test_wide_gaussian_is_not_cut():
    std = np.array([4.0, 1.0, 0.5])
    result = estimate_from_particles(blob(50_000, [30.0, -20.0, np.pi], std))
    assert result.cluster_weight > 0.95
    np.testing.assert_allclose(np.sqrt(result.covariance.diagonal()), std, rtol=0.03)
    assert result.confidence < 0.1


def test_the_heavier_of_two_clusters():
    left = blob(3000, [-3.0, 0.0, np.pi], [0.1, 0.1, 0.1], 1)
    right = blob(2000, [3.0, 0.0, 0.0], [0.1, 0.1, 0.1], 2)
    poses = np.concatenate([left, right])
    result = estimate_from_particles(poses)
    np.testing.assert_allclose(result.pose[:2], [-3, 0], atol=0.02)
    assert abs(wrap_to_pi(result.pose[2] - np.pi)) < 0.02
    assert result.cluster_weight == pytest.approx(0.6)
    assert result.confidence == pytest.approx(0.6 * 0.92, abs=0.03)  # 10 degrees: 1.75 sigma
    # weights decide, not numbers
    result = estimate_from_particles(poses, np.repeat([-1.0, 0.0], [3000, 2000]))
    np.testing.assert_allclose(result.pose, [3, 0, 0], atol=0.02)
    # the mean lies between them
    result = estimate_from_particles(poses, method="mean")
    assert result.pose[0] == pytest.approx(-0.6, abs=0.02)
    assert result.confidence == 0.0


def test_same_place_two_headings():
    poses = np.concatenate(
        [blob(3000, [0, 0, np.pi], [0.1, 0.1, 0.05], 1), blob(2000, [0, 0, 0.0], [0.1, 0.1, 0.05])]
    )
    result = estimate_from_particles(poses)
    assert abs(wrap_to_pi(result.pose[2] - np.pi)) < 0.01
    assert result.heading_std < 0.06


def test_a_cluster_on_a_cell_edge_beats_a_lighter_one_inside_a_cell():
    # 1000 particles spread over the 8 cells around a corner, 400 within one cell
    width = 2 * np.pi / module.CELLS_OF_HEADING
    corner = blob(1000, [0.0, 0.0, width], [0.1, 0.1, 0.05], 1)
    inside = blob(400, [5.25, 5.25, 2.5 * width], [0.02, 0.02, 0.02], 2)
    far = [[-10.0, -10.0, 0.0]]  # puts the grid's origin onto whole cells
    result = estimate_from_particles(np.concatenate([corner, inside, far]))
    np.testing.assert_allclose(result.pose, [0, 0, width], atol=0.02)


def test_cells_of_heading_on_both_sides_of_zero_are_neighbors():
    # the heavier cluster is split by the heading 0; the other one lies in a single cell
    width = 2 * np.pi / module.CELLS_OF_HEADING
    split = blob(600, [0.25, 0.25, 0.0], [0.02, 0.02, 0.05], 1)
    inside = blob(400, [5.25, 5.25, 2.5 * width], [0.02, 0.02, 0.02], 2)
    origin = [[-10.0, -10.0, 3.0]]
    result = estimate_from_particles(np.concatenate([split, inside, origin]))
    np.testing.assert_allclose(result.pose, [0.25, 0.25, 0.0], atol=0.02)


def test_confidence_is_the_share_within_half_a_metre_and_ten_degrees():
    poses = np.zeros((100, 3))
    poses[80:90, 0] = 0.6
    poses[90:, 2] = np.deg2rad(11)
    result = estimate_from_particles(poses)
    near = np.hypot(*(poses - result.pose)[:, :2].T) <= 0.5
    near &= np.abs(poses[:, 2] - result.pose[2]) <= np.deg2rad(10)
    assert result.confidence == pytest.approx(near.mean())
    assert 0.7 < result.confidence < 1.0


def test_the_calibration_of_the_confidence():
    # if the particles are right, the truth is as near as the confidence says
    rng = np.random.default_rng(4)
    hits, said = [], []
    for _ in range(400):
        stds = rng.uniform(0.1, 0.6) * np.array([1.0, 1.0, 0.3])
        result = estimate_from_particles(rng.normal(0, stds, (500, 3)))
        offset = result.pose - rng.normal(0, stds)  # the truth, drawn as the particles were
        hits.append(np.hypot(*offset[:2]) <= 0.5 and abs(offset[2]) <= np.deg2rad(10))
        said.append(result.confidence)
    error = np.sqrt(np.mean(np.array(said) * (1 - np.array(said))) / 400)
    assert abs(np.mean(hits) - np.mean(said)) < 5 * error


def test_one_particle_and_many_alike():
    for n in (1, 10):
        result = estimate_from_particles(np.array([[1e6, -2e6, -np.pi]] * n))
        np.testing.assert_allclose(result.pose[:2], [1e6, -2e6])
        assert result.pose[2] == pytest.approx(np.pi)
        np.testing.assert_array_equal(result.covariance, np.zeros((3, 3)))
        assert result.confidence == pytest.approx(1.0)
        assert result.effective_sample_size == pytest.approx(n)
    assert result.heading_std == 0.0


def test_a_few_outliers_far_away_change_nothing():
    poses = blob(1000, [2.0, 1.0, 0.5], 0.05)
    alone = estimate_from_particles(poses)
    poses = np.concatenate([poses, [[1e7, 1e7, 0.0], [-1e7, 0.0, 0.0]]])
    result = estimate_from_particles(poses)
    np.testing.assert_allclose(result.pose, alone.pose, atol=1e-9)
    np.testing.assert_allclose(result.covariance, alone.covariance, atol=1e-9)


def test_lost_is_finite_and_unsure():
    rng = np.random.default_rng(0)
    poses = rng.uniform([-50, -50, -np.pi], [50, 50, np.pi], (5000, 3))
    for method in ("cluster", "mean"):
        result = estimate_from_particles(poses, method=method)
        assert np.isfinite(result.pose).all()
        assert np.isfinite(result.covariance).all()
        assert (np.linalg.eigvalsh(result.covariance) > 0).all()
        assert result.confidence < 0.01
        assert result.position_std > 40.0  # uniform over 100 m has 41 m around its middle
        assert result.heading_std > 1.5
        spread = poses - result.pose
        spread[:, 2] = wrap_to_pi(spread[:, 2])
        around = spread.T @ spread / 5000  # around the pose, which is not their mean
        np.testing.assert_allclose(result.covariance[:2, :2], around[:2, :2], rtol=0.01)


def test_bad_input_is_refused():
    poses = np.zeros((3, 3))
    with pytest.raises(ValueError, match="expected 3, one a pose, got 2"):
        estimate_from_particles(poses, [0.0, 0.0])
    with pytest.raises(ValueError, match="method: expected"):
        estimate_from_particles(poses, method="median")
    with pytest.raises(ValueError, match="log_weights: expected"):
        estimate_from_particles(poses, [np.nan, 0.0, 0.0])
    with pytest.raises(ValueError, match="row 0 is not finite"):
        estimate_from_particles([[np.nan, 0, 0]])
    with pytest.raises(ValueError, match="log_weights: expected"):
        estimate_from_particles(np.empty((0, 3)), np.empty(0))
    with pytest.raises(ValueError, match="at least one"):
        estimate_from_particles(np.empty((0, 3)))


@pytest.mark.parametrize("n", [1, 7, 1000])
def test_mass_near_counts_the_weight_in_its_window(n):
    rng = np.random.default_rng(n)
    poses = blob(n, [1.0, -1.0, np.pi], 0.5, n)
    weights = rng.random(n)
    weights /= weights.sum()
    pose = np.array([1.1, -0.9, -np.pi + 0.05])
    inside = (np.hypot(*(poses[:, :2] - pose[:2]).T) <= 0.5) & (
        np.abs(wrap_to_pi(poses[:, 2] - pose[2])) <= np.radians(10)
    )
    assert module.mass_near(poses, weights, pose) == pytest.approx(weights[inside].sum())
