"""All places where the robot may be."""

from __future__ import annotations

import numpy as np
import pytest

from pflut.localization.estimate import estimate_from_particles
from pflut.localization.hypotheses import find_hypotheses


def around(pose: list[float], n: int, std: float = 0.1, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    poses = rng.normal(pose, [std, std, 0.5 * std], (n, 3))
    poses[:, 2] = (poses[:, 2] + np.pi) % (2 * np.pi) - np.pi
    return poses


def test_three_places_with_their_weights_means_and_covariances() -> None:
    truth = [([0.0, 0.0, 0.0], 5000), ([4.0, 1.0, 2.0], 3000), ([0.0, 0.0, 3.1], 2000)]
    poses = np.concatenate([around(pose, n, seed=k) for k, (pose, n) in enumerate(truth)])
    found = find_hypotheses(poses, np.full(10_000, 1e-4))
    assert len(found) == 3
    for hypothesis, (pose, n) in zip(found, truth, strict=True):
        assert hypothesis.weight == pytest.approx(n / 10_000, abs=0.005)
        offset = hypothesis.pose - pose
        offset[2] = (offset[2] + np.pi) % (2 * np.pi) - np.pi
        error = 5 * np.array([0.1, 0.1, 0.05]) / np.sqrt(n)
        assert (np.abs(offset) <= error).all()
        std = np.sqrt(hypothesis.covariance.diagonal())
        np.testing.assert_allclose(std, [0.1, 0.1, 0.05], rtol=5 / np.sqrt(2 * n))


def test_a_cluster_around_pi_is_one_and_as_narrow_as_any() -> None:
    """AMCL's old bug: yaw that wraps splits a cluster, or blows up its covariance."""
    for heading in (np.pi, -np.pi, 3.12, -3.13):
        (found,) = find_hypotheses(around([1.0, 2.0, heading], 4000), np.full(4000, 1 / 4000))
        assert found.weight == pytest.approx(1.0, abs=1e-9)
        assert np.sqrt(found.covariance[2, 2]) == pytest.approx(0.05, rel=0.06)
        assert abs((found.pose[2] - heading + np.pi) % (2 * np.pi) - np.pi) < 0.005
        assert -np.pi < found.pose[2] <= np.pi


def test_the_first_is_the_estimate() -> None:
    poses = np.concatenate([around([0, 0, 0], 600), around([3, 3, 1], 400)])
    first, second = find_hypotheses(poses, np.full(1000, 1e-3))
    estimate = estimate_from_particles(poses)
    np.testing.assert_array_equal(first.pose, estimate.pose)
    np.testing.assert_array_equal(first.covariance, estimate.covariance)
    assert first.weight == estimate.cluster_weight
    assert first.weight + second.weight == pytest.approx(1.0)


def test_a_lost_robot_has_none() -> None:
    rng = np.random.default_rng(0)
    poses = rng.uniform([-20, -20, -np.pi], [20, 20, np.pi], (5000, 3))
    assert find_hypotheses(poses, np.full(5000, 1 / 5000)) == []


def test_weights_count_and_input_is_left_alone() -> None:
    poses = np.concatenate([around([0, 0, 0], 100), around([3, 3, 1], 100)])
    weights = np.where(np.arange(200) < 100, 0.001, 0.009)
    before = weights.copy()
    first, second = find_hypotheses(poses, weights)
    assert first.weight == pytest.approx(0.9)
    assert second.weight == pytest.approx(0.1)
    np.testing.assert_array_equal(weights, before)
    assert len(find_hypotheses(poses, weights, max_count=1)) == 1
    assert len(find_hypotheses(poses, weights, min_weight=0.2)) == 1


def test_light_hypotheses_have_the_covariance_of_their_own_particles() -> None:
    poses = np.concatenate(
        [around([10.0 * k, 0, 0], n, 0.05, seed=k) for k, n in enumerate((940, 30, 30))]
    )
    found = find_hypotheses(poses, np.full(1000, 1e-3), min_weight=0.01)
    assert len(found) == 3
    for hypothesis in found:
        assert np.sqrt(hypothesis.covariance[0, 0]) == pytest.approx(0.05, rel=0.5)


@pytest.mark.parametrize(("name", "value"), [("max_count", 0), ("min_weight", 0.0)])
def test_misuse_names_the_option(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        find_hypotheses(np.zeros((1, 3)), np.ones(1), **{name: value})
