"""Errors of poses and convergence: values by hand and naive twins."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pflut.evaluation import (
    convergence_index,
    relative_pose_errors,
    summarize,
    trajectory_errors,
)
from pflut.geometry import compose


def test_trajectory_errors_by_hand():
    truth = [[1, 1, np.pi / 2], [0, 0, np.radians(179)]]
    estimate = [[0, 3, np.pi / 2 + 0.1], [0, 0, np.radians(-179)]]
    errors = trajectory_errors(estimate, truth)
    np.testing.assert_allclose(errors.position, [np.sqrt(5), 0])
    np.testing.assert_allclose(errors.heading, [0.1, np.radians(2)])
    np.testing.assert_allclose(errors.along_track, [2, 0], atol=1e-12)
    np.testing.assert_allclose(errors.cross_track, [1, 0], atol=1e-12)


def test_track_errors_are_the_estimate_in_the_true_frame():
    rng = np.random.default_rng(0)
    truth = np.column_stack([rng.normal(0, 5, (40, 2)), rng.uniform(-4, 4, 40)])
    offset = rng.normal(0, 1, (40, 3))
    errors = trajectory_errors(compose(truth, offset), truth)
    found = np.column_stack([errors.along_track, errors.cross_track, errors.heading])
    np.testing.assert_allclose(found, offset, atol=1e-12)
    np.testing.assert_allclose(errors.position, np.hypot(*offset[:, :2].T), atol=1e-12)


def test_unknown_truth_is_left_out_and_a_missing_estimate_is_not():
    truth = np.zeros((4, 3))
    truth[0] = np.nan
    estimate = np.full((4, 3), [3.0, 4.0, 0.0])
    estimate[3] = np.nan
    errors = trajectory_errors(estimate, truth)
    assert np.isnan([errors.position[0], errors.heading[0], errors.along_track[0]]).all()
    assert errors.position[1:].tolist() == [5, 5, np.inf]
    assert errors.heading[3] == np.pi
    summary = summarize(errors.position)
    assert (summary.count, summary.median, summary.mad) == (3, 5, 0)
    assert summary.rmse == summary.maximum == summary.percentile_90 == np.inf
    assert summarize([1, np.inf, np.inf]).mad == np.inf
    # what leaves as JSON is JSON
    text = json.dumps(errors.as_dict(), allow_nan=False)
    assert json.loads(text)["all"]["position_m"]["rmse"] is None


@pytest.mark.parametrize("shapes", [((3, 3), (2, 3)), ((3, 2), (3, 2)), ((3,), (3,))])
def test_trajectory_errors_refuse(shapes):
    with pytest.raises(ValueError, match="expected the same shape"):
        trajectory_errors(np.zeros(shapes[0]), np.zeros(shapes[1]))


def naive_convergence(position, heading):
    for start in range(len(position)):
        rest = range(start, len(position))
        if all(position[i] < 0.5 and abs(heading[i]) < np.radians(10) for i in rest):
            return start
    return None


def test_convergence_is_the_naive_search():
    rng = np.random.default_rng(2)
    seen = set()
    for _ in range(300):
        position = rng.choice([0.1, 0.6], p=[0.9, 0.1], size=8)
        heading = rng.choice([-0.1, 0.1, -0.5, 0.5], p=[0.47, 0.47, 0.03, 0.03], size=8)
        expected = naive_convergence(position, heading)
        assert convergence_index(position, heading) == expected
        seen.add(expected)
    assert seen == {None, *range(8)}


def test_convergence_passes_over_unknown_steps():
    nan = np.nan
    assert convergence_index([9, nan, nan, 0.1, nan], [0, nan, nan, 0, nan]) == 3
    assert convergence_index([0.1, nan], [0.0, nan]) == 0
    assert convergence_index([nan], [nan]) is None
    assert convergence_index([], []) is None
    assert convergence_index([0.1, 0.1], [0.0, np.pi]) is None
    assert convergence_index([0.3, 0.1], [0, 0], max_position=0.2) == 1
    errors = trajectory_errors([[9, 0, 0], [0.1, 0, 0]], np.zeros((2, 3)))
    assert errors.converged_at == 1
    record = errors.as_dict()
    assert record["after_convergence"]["position_m"]["median"] == pytest.approx(0.1)
    assert record["steps"] == 2
    assert errors.within(0.25, 0.1).tolist() == [False, True]


def test_relative_pose_errors_by_hand():
    heading, rotation = relative_pose_errors(
        [0.1, 6.2, np.nan, 1.0], [0.0, 0.0, 0.0, np.nan], [0.0, 0.1, 0.0, 1.0], [0.2, 0.0, 0.0, 0.0]
    )
    wrapped = 2 * np.pi - 6.1
    np.testing.assert_allclose(heading, [0.1, wrapped, np.pi, np.pi])
    np.testing.assert_allclose(rotation, [0.3, wrapped, np.pi, np.pi])
