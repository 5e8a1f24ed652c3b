"""Trajectories laid over the truth, motions compared, and the errors of maps."""

from __future__ import annotations

import numpy as np
import pytest

from pflut.alignment import align_poses, relative_errors
from pflut.evaluation import root_mean_square
from pflut.geometry import compose, wrap_to_pi
from pflut.mapping.map_errors import MapErrors


def drive(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.normal(size=(30, 2)) * [3.0, 1.0], rng.uniform(-3.0, 3.0, 30)])


@pytest.mark.parametrize("turn", [0.3, 3.0, -2.0])
def test_a_moved_trajectory_comes_back(turn: float) -> None:
    truth = drive()
    moved = compose(np.array([4.0, -7.0, turn]), truth)
    np.testing.assert_allclose(align_poses(moved, truth), truth, atol=1e-12)
    larger = moved * [1.2, 1.2, 1.0]
    scaled = align_poses(larger, truth, scale=True)
    np.testing.assert_allclose(scaled[:, :2], truth[:, :2], atol=1e-12)
    assert np.abs(align_poses(larger, truth)[:, :2] - truth[:, :2]).max() > 0.2


def test_no_other_turn_or_shift_fits_better() -> None:
    truth, rng = drive(), np.random.default_rng(1)
    estimate = truth + rng.normal(0.0, 0.3, truth.shape)
    best = align_poses(estimate, truth)

    def error(poses: np.ndarray) -> float:
        return root_mean_square(np.hypot(*(poses - truth)[:, :2].T))

    for _ in range(50):
        other = compose(rng.normal(0.0, 0.02, 3), best)
        assert error(other) >= error(best)


def test_unknown_poses_are_moved_along_but_not_looked_at() -> None:
    truth = drive()
    moved = compose(np.array([1.0, 2.0, 0.5]), truth)
    partly = truth.copy()
    partly[::3] = np.nan
    np.testing.assert_allclose(align_poses(moved, partly), truth, atol=1e-12)


def test_relative_errors_of_a_drift_in_heading() -> None:
    truth = np.column_stack([np.arange(10.0), np.zeros(10), np.zeros(10)])
    angle = 0.01 * np.arange(10)
    estimate = np.column_stack([np.cumsum(np.cos(angle)), np.cumsum(np.sin(angle)), angle])
    position, heading = relative_errors(estimate, truth)
    np.testing.assert_allclose(heading, 0.01, atol=1e-12)
    np.testing.assert_allclose(position, 2.0 * np.sin(0.005), atol=1e-12)
    position, heading = relative_errors(estimate, truth, steps=4)
    assert len(position) == 6
    np.testing.assert_allclose(heading, 0.04, atol=1e-12)


def test_errors_of_a_map() -> None:
    truth = drive()
    exact = MapErrors.of(compose(np.array([4.0, -7.0, 2.0]), truth), truth)
    assert max(vars(exact).values()) < 1e-6
    larger = truth.copy()
    larger[:, :2] *= 1.1
    errors = MapErrors.of(larger, truth)
    centered = truth[:, :2] - truth[:, :2].mean(axis=0)
    spread = root_mean_square(np.hypot(*centered.T))
    assert errors.position == pytest.approx(0.1 * spread)
    assert errors.position_scaled < 1e-6 and errors.heading < 1e-6
    from_first = root_mean_square(np.hypot(*(truth - truth[0])[:, :2].T))
    assert errors.position_from_start == pytest.approx(0.1 * from_first)
    assert errors.position_median <= errors.position_largest
    entries = errors.as_dict()
    assert entries["position_m"] == errors.position
    turned = truth.copy()
    turned[:, 2] = wrap_to_pi(turned[:, 2] + 0.1)
    assert MapErrors.of(turned, truth).as_dict()["heading_deg"] == pytest.approx(np.degrees(0.1))


def test_true_poses_that_are_not_known_are_passed_over() -> None:
    truth = drive()
    estimate = truth + np.random.default_rng(2).normal(0.0, 0.1, truth.shape)
    known = np.arange(len(truth)) % 4 > 0
    partly = np.where(known[:, None], truth, np.nan)
    assert MapErrors.of(estimate, partly) == MapErrors.of(estimate[known], truth[known])


def test_what_cannot_be_compared_is_refused() -> None:
    truth = drive()
    with pytest.raises(ValueError, match="expected the same shape"):
        align_poses(truth[:3], truth)
    with pytest.raises(ValueError, match="expected 2 known poses at least, got 1"):
        align_poses(truth[:1], truth[:1])
    with pytest.raises(ValueError, match="steps: expected 1 to less"):
        relative_errors(truth, truth, steps=30)
