"""Probabilities and scores of yes-or-no questions: values by hand, repetition as oracle."""

from __future__ import annotations

import numpy as np
import pytest

from pflut.plot import plot_precision_recall, plot_reliability
from pflut.reliability import (
    average_precision,
    draws_of_pairs,
    expected_calibration_error,
    precision_recall,
    reliability_curve,
    share_interval,
)
from pflut.statistics import wilson_interval

SIGMAS = 5.0


def test_average_precision_by_hand() -> None:
    # yes at ranks 1, 3 and 4 of 5
    assert average_precision([1, 0, 1, 1, 0], [5, 4, 3, 2, 1]) == pytest.approx(
        (1 / 1 + 2 / 3 + 3 / 4) / 3
    )
    assert average_precision([True, True, False], [3.0, 2.0, 1.0]) == 1.0
    # all alike: one threshold, whose precision is the share
    assert average_precision([1, 0, 0, 1], [7, 7, 7, 7]) == 0.5
    assert np.isnan(average_precision([False, False], [1.0, 2.0]))
    with pytest.raises(ValueError, match=r"expected the same shape \(n,\), got \(2,\), \(1,\)"):
        average_precision([True, False], [1.0])


def test_average_precision_of_a_score_that_says_nothing_is_the_share() -> None:
    rng = np.random.default_rng(0)
    found = [average_precision(rng.random(2000) < 0.3, rng.random(2000)) for _ in range(50)]
    assert abs(np.mean(found) - 0.3) < SIGMAS * np.std(found) / np.sqrt(50) + 2e-3


def test_weights_are_repetitions() -> None:
    rng = np.random.default_rng(1)
    yes, score = rng.random(300) < 0.4, rng.integers(20, size=300).astype(float)
    given, times = rng.random(300), rng.integers(4, size=300)
    repeated = [np.repeat(values, times) for values in (yes, score, given)]
    assert average_precision(yes, score, weights=times) == pytest.approx(
        average_precision(*repeated[:2])
    )
    assert expected_calibration_error(given, yes, weights=times) == pytest.approx(
        expected_calibration_error(repeated[2], repeated[0])
    )


def test_precision_and_recall_at_every_threshold() -> None:
    precision, recall = precision_recall([1, 0, 1, 0], [0.9, 0.9, 0.5, 0.1])
    assert precision == pytest.approx([1 / 2, 2 / 3, 2 / 4])
    assert recall == pytest.approx([1 / 2, 1, 1])
    assert precision_recall([0, 0], [1.0, 2.0])[0].size == 0


def test_calibration_error_by_hand() -> None:
    # two at 0.2 of which one happened, two at 0.9 of which both did
    error = expected_calibration_error([0.2, 0.2, 0.9, 0.9], [1, 0, 1, 1])
    assert error == pytest.approx(0.5 * 0.3 + 0.5 * 0.1)
    assert np.isnan(expected_calibration_error([], []))
    for bad in ([1.1], [-0.1], [np.nan]):
        with pytest.raises(ValueError, match=r"probabilities: expected numbers in \[0, 1\]"):
            expected_calibration_error(bad, [True])
    with pytest.raises(ValueError, match="expected the same shape"):
        expected_calibration_error([0.5], [True, False])


def test_right_probabilities_have_a_small_calibration_error() -> None:
    rng = np.random.default_rng(2)
    given = rng.random(100_000)
    happened = rng.random(100_000) < given
    # each of ten classes of 10,000 is off by 0.004 or so
    assert expected_calibration_error(given, happened) < 0.01
    assert expected_calibration_error(given**2, happened) > 0.1


def test_reliability_curve_by_hand() -> None:
    curve = reliability_curve([0.05, 0.5, 0.55, 1.0], [0, 1, 0, 1])
    assert [part.count for part in curve] == [1, 2, 1]
    assert [part.predicted for part in curve] == pytest.approx([0.05, 0.525, 1.0])
    assert [part.observed for part in curve] == [0.0, 0.5, 1.0]
    assert (curve[1].low, curve[1].high) == wilson_interval(1, 2)
    assert reliability_curve([], []) == []


def test_intervals_over_groups_know_that_their_events_are_dependent() -> None:
    # 20 groups of 50 events that all happen or all do not
    happened = np.repeat(np.arange(20) % 2 == 0, 50)
    given, groups = np.full(1000, 0.5), np.repeat(np.arange(20), 50)
    (alone,) = reliability_curve(given, happened)
    (together,) = reliability_curve(given, happened, groups=groups)
    assert together.observed == alone.observed == 0.5
    assert together.high - together.low > 4 * (alone.high - alone.low)
    assert share_interval([25] * 20, [50] * 20) == (0.5, 0.5)


def test_an_interval_over_groups_is_that_of_their_mean() -> None:
    # sums of any sign; groups are of one size, so the mean is that of the groups
    sums = np.random.default_rng(1).normal(3.0, 10.0, 400)
    low, high = share_interval(sums, np.full(400, 10), resamples=10_000)
    spread = sums.std() / 10.0 / np.sqrt(400)
    middle = sums.mean() / 10.0
    # of a quantile of so many draws the standard error is some 3 % of the spread
    np.testing.assert_allclose(
        [low, high], middle + 1.96 * spread * np.array([-1, 1]), atol=0.15 * spread
    )


def test_a_pair_is_drawn_as_often_as_both_of_its_images() -> None:
    ends = np.array([(i, j) for i in range(10) for j in range(i)])
    draws = draws_of_pairs(ends, resamples=4000, rng=3)
    assert draws.shape == (4000, 45)
    # of a multinomial of n draws from n images the product of two counts has the mean 1 - 1 / n
    mean = draws.mean(axis=1)
    assert abs(mean.mean() - 0.9) < SIGMAS * mean.std() / np.sqrt(4000)
    # images are drawn, not pairs: of 10 draws, (sum of counts)^2 = sum of squares + 2 sum of pairs
    assert (2 * draws.sum(axis=1) <= 100 - 10).all()
    assert (draws == draws_of_pairs(ends, resamples=4000, rng=3)).all()


def test_figures_show_the_curves() -> None:
    curve = reliability_curve([0.05, 0.5, 0.55, 1.0], [0, 1, 0, 1])
    figure = plot_reliability({"a": curve}, what="links")
    upper, lower = figure.axes
    assert upper.lines[1].get_ydata().tolist() == [0.0, 50.0, 100.0]
    assert lower.lines[0].get_ydata().tolist() == [1, 2, 1]
    assert upper.get_ylabel() == "links [%]"
    with pytest.raises(ValueError, match="curves"):
        plot_reliability({"a": []})
    figure = plot_precision_recall({"a": ([1.0, 0.5], [0.5, 1.0])})
    assert figure.axes[0].lines[0].get_xydata().tolist() == [[0, 100], [50, 100], [100, 50]]
    with pytest.raises(ValueError, match="curves"):
        plot_precision_recall({"a": ([], [])})
