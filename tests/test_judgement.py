"""Judging poses: inliers, coincidence, covariances, the best candidates."""

from __future__ import annotations

import naive
import numpy as np
import pytest
from naive import angles_of
from scipy import stats

from pflut.correspondences import Correspondences
from pflut.likelihood.table import bearing_columns
from pflut.relpose.judge_kernels import choose, judge, log_false_alarms
from pflut.relpose.judgement import covariances, widened
from pflut.relpose.result import UNIFORM_VARIANCE
from pflut.simulation.correspondences import CorrespondenceSimulator


def judged(pairs: list[Correspondences], poses, cutoff: float, shifts: int) -> tuple:
    columns = np.concatenate([bearing_columns(c) for c in pairs], axis=1)
    first = np.cumsum([0, *map(len, pairs)])
    inliers, alarms = np.full(len(pairs), -1), np.full(len(pairs), np.nan)
    judge(columns, first, np.asarray(poses, float), cutoff, shifts, inliers, alarms)
    return inliers, alarms


def test_judge_equals_its_naive_twin() -> None:
    drawn = [CorrespondenceSimulator(mismatch=0.5).pair(n, n) for n in (25, 0, 60, 1, 2, 5)]
    pairs, poses = [c for c, *_ in drawn], [headings for _, *headings in drawn]
    for cutoff, shifts in ((0.1, 6), (0.03, 16), (0.03, 1)):
        inliers, alarms = judged(pairs, poses, cutoff, shifts)
        for k, c in enumerate(pairs):
            expected = naive.judge(angles_of(c), *poses[k], cutoff, shifts)
            assert inliers[k] == expected[0]
            assert alarms[k] == pytest.approx(expected[1], abs=1e-6)
    assert inliers[0] >= 10
    assert alarms[2] < -10


def test_judge_of_nothing_knows_nothing() -> None:
    inliers, alarms = judged([Correspondences.empty()], np.zeros((1, 2)), 0.03, 16)
    assert (inliers[0], alarms[0]) == (0, 0.0)
    judge(np.empty((8, 0)), np.zeros(1, int), np.empty((0, 2)), 0.03, 16, inliers[:0], alarms[:0])


@pytest.mark.parametrize(
    ("inliers", "total", "share"), [(3, 20, 0.05), (20, 20, 0.2), (8, 300, 0.01)]
)
def test_false_alarms_are_the_binomial_tail(inliers: int, total: int, share: float) -> None:
    poses = 2 * np.log(np.pi / 0.03)
    tail = stats.binom.logsf(inliers - 1, total, share)
    assert log_false_alarms(inliers, total, share, 0.03, 2) == pytest.approx(poses + tail)


@pytest.mark.parametrize(("inliers", "total"), [(0, 0), (0, 5), (3, 7), (7, 7), (12, 30)])
@pytest.mark.parametrize("share", [0.0, 1e-3, 0.3, 1.0])
def test_false_alarms_equal_their_naive_twin(inliers: int, total: int, share: float) -> None:
    expected = naive.log_false_alarms(inliers, total, share, 0.03, 2)
    assert log_false_alarms(inliers, total, share, 0.03, 2) == pytest.approx(expected, abs=1e-6)


def test_false_alarms_at_the_ends() -> None:
    assert np.isfinite(log_false_alarms(10, 10, 0.0, 0.03, 2))
    assert np.isfinite(log_false_alarms(3, 10, 1.0, 0.03, 2))
    assert log_false_alarms(10, 10, 0.0, 0.03, 2) < 0 < log_false_alarms(3, 10, 1.0, 0.03, 2)


def test_choose_equals_sorting() -> None:
    rng = np.random.default_rng(0)
    for count in (1, 2, 3, 9):
        owners = np.sort(rng.integers(0, 30, 100))
        values = rng.normal(size=100)
        chosen = np.empty(100, np.int64)
        total = choose(values, owners, count, chosen)
        expected = [
            m
            for owner in np.unique(owners)
            for m in sorted(np.flatnonzero(owners == owner), key=lambda m: -values[m])[:count]
        ]
        assert chosen[:total].tolist() == expected
    assert choose(np.empty(0), np.empty(0, np.int64), 1, np.empty(0, np.int64)) == 0


def test_covariances_are_between_the_noise_and_nothing_known() -> None:
    information = np.array([[4e4, 1e4, 9e4], [4e4, 1e4, 9e4], [4e4, 1e4, 9e4], [0.0, 0.0, 0.0]])
    squares, redundancy = np.array([0.0, 4e-2, 1.0, 0.0]), np.array([10.0, 100.0, 0.0, 10.0])
    found = covariances(information, squares, redundancy, 0.01)
    matrix = np.array([[4e4, 1e4], [1e4, 9e4]])
    prior = np.eye(2) / UNIFORM_VARIANCE
    # the noise where residuals are smaller, else their own spread
    assert found[0] == pytest.approx(np.linalg.inv(matrix / 1e-4 + prior))
    assert found[1] == pytest.approx(np.linalg.inv(matrix / 4e-4 + prior))
    # too few to tell, and no information
    for k in (2, 3):
        assert found[k] == pytest.approx(UNIFORM_VARIANCE * np.eye(2))


def test_widened_is_bounded() -> None:
    covariance = np.array([[[1.0, 0.2], [0.2, 0.5]]] * 2)
    found = widened(covariance, np.array([0.3, 100.0]))
    assert found[0] == pytest.approx(covariance[0] + 0.3)
    assert found[1].max() == pytest.approx(UNIFORM_VARIANCE)
