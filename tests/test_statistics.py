"""Statistics: values by hand, SciPy as oracle, coverage of the intervals."""

from __future__ import annotations

import numpy as np
import pytest

from pflut.statistics import (
    adjusted_rand_index,
    bin_indices,
    bootstrap_median,
    bootstrap_median_ratio,
    median_absolute_deviation,
    root_mean_square,
    success_rate,
    summarize,
    wilson_interval,
)


def test_summary_by_hand():
    summary = summarize([-1, 2, -3, 4, 100, np.nan])
    assert (summary.count, summary.median, summary.mad, summary.maximum) == (5, 3, 1, 100)
    assert summary.rmse == pytest.approx(np.sqrt((1 + 4 + 9 + 16 + 10000) / 5))
    assert summary.percentile_90 == 100
    nothing = summarize([np.nan])
    assert nothing.count == 0
    assert np.isnan(nothing.median)
    assert nothing.as_dict()["median"] is None
    assert np.isnan(median_absolute_deviation([]))
    assert np.isnan(root_mean_square([]))


def test_mad_is_scipys():
    from scipy.stats import median_abs_deviation

    values = np.random.default_rng(1).standard_cauchy(101)
    assert median_absolute_deviation(values) == pytest.approx(median_abs_deviation(values))


def test_wilson_interval_is_scipys():
    from scipy.stats import binomtest

    for successes, count in [(0, 10), (10, 10), (19, 32), (19, 20), (1, 1)]:
        expected = binomtest(successes, count).proportion_ci(0.9, method="wilson")
        found = wilson_interval(successes, count, level=0.9)
        np.testing.assert_allclose(found, expected, atol=1e-12)
    assert wilson_interval(0, 0) == (0, 1)
    for bad in [(-1, 3), (4, 3)]:
        with pytest.raises(ValueError, match="successes"):
            wilson_interval(*bad)
    with pytest.raises(ValueError, match="level"):
        wilson_interval(1, 2, level=95)


def test_success_rate():
    rate = success_rate([True, True, False, True])
    assert (rate.successes, rate.count, rate.rate) == (3, 4, 0.75)
    assert (rate.low, rate.high) == wilson_interval(3, 4)
    assert success_rate([]).as_dict()["rate"] is None


def test_bootstrap_interval_covers_the_median():
    rng = np.random.default_rng(3)
    trials = 300
    covered = 0
    for _ in range(trials):
        low, high = bootstrap_median(rng.exponential(size=40), level=0.9, resamples=300, rng=rng)
        covered += low <= np.log(2) <= high
    # the percentile bootstrap of a median is near its level, not exactly at it
    assert abs(covered / trials - 0.9) < 0.03 + 5 * np.sqrt(0.09 / trials)
    values = rng.normal(size=20)
    assert bootstrap_median(values, rng=7) == bootstrap_median(values, rng=7)
    assert np.isnan(bootstrap_median([])).all()
    assert bootstrap_median([1.0, np.inf, np.inf], rng=0)[1] == np.inf


def test_bootstrap_ratio_covers_the_ratio_of_medians():
    rng = np.random.default_rng(5)
    trials, covered, widths = 300, 0, []
    for _ in range(trials):
        common = rng.exponential(size=60)
        errors, others = 0.8 * common, common * rng.uniform(0.9, 1.1, 60)
        low, high = bootstrap_median_ratio(errors, others, level=0.9, resamples=300, rng=rng)
        # uniform in [0.9, 1.1] times exponential: its median is that of the exponential to 0.2 %
        covered += low <= 0.8 <= high
        widths.append(high - low)
    assert abs(covered / trials - 0.9) < 0.06 + 5 * np.sqrt(0.09 / trials)
    # drawn together, errors of the same pairs tell the ratio far better than they tell the medians
    assert np.median(widths) < 0.15
    same = rng.exponential(size=20)
    assert bootstrap_median_ratio(same, 2.0 * same, rng=7) == (0.5, 0.5)
    assert np.isnan(bootstrap_median_ratio([], [])).all()
    gaps = [*same, np.nan, 1.0], [*(2.0 * same), 1.0, np.nan]
    assert bootstrap_median_ratio(*gaps, rng=7) == (0.5, 0.5)
    with pytest.raises(ValueError, match=r"expected the same shape \(n,\), got \(2,\) and \(1,\)"):
        bootstrap_median_ratio([1.0, 2.0], [1.0])
    with pytest.raises(ValueError, match="level: expected a confidence"):
        bootstrap_median_ratio([1.0], [1.0], level=1.0)


def test_bins_hold_what_lies_between_their_edges():
    edges = [0.0, 1.0, 2.5, 5.0]
    x = [-0.1, 0.0, 0.99, 1.0, 2.5, 4.9, 5.0, 5.1, np.nan, np.inf]
    assert bin_indices(x, edges).tolist() == [-1, 0, 0, 1, 2, 2, 2, -1, -1, -1]
    values = np.random.default_rng(4).uniform(-1.0, 6.0, 300)
    counted = [np.count_nonzero(bin_indices(values, edges) == k) for k in range(3)]
    assert counted == np.histogram(values, edges)[0].tolist()
    assert bin_indices([], edges).shape == (0,)


def test_adjusted_rand_index_by_hand():
    # 2 of 6 pairs are together in the first, 3 in the second, 1 in both; by chance 2 * 3 / 6
    assert adjusted_rand_index([0, 0, 1, 1], [5, 5, 5, 2]) == 0.0
    # 1 together, expected 1 * 2 / 6, at most 1.5
    found = adjusted_rand_index(list("aabc"), [0, 0, 1, 1])
    assert found == pytest.approx((1 - 1 / 3) / (1.5 - 1 / 3))
    assert adjusted_rand_index([3, 3, 1], ["x", "x", "y"]) == 1.0
    for same in ([0, 0, 0], [0, 1, 2], [0]):
        assert adjusted_rand_index(same, same) == 1.0
    assert adjusted_rand_index([0, 0, 0], [0, 1, 2]) == 0.0
    with pytest.raises(ValueError, match="first, second"):
        adjusted_rand_index([0, 1], [0])
    with pytest.raises(ValueError, match="first, second"):
        adjusted_rand_index([], [])


def test_random_groups_agree_by_chance():
    rng = np.random.default_rng(3)
    found = [adjusted_rand_index(*rng.integers(0, 4, (2, 40))) for _ in range(400)]
    assert abs(np.mean(found)) < 5 * np.std(found) / np.sqrt(400)
