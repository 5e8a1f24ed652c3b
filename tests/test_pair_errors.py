"""Errors of relative poses: their angles, their selections, what a table says of them."""

from __future__ import annotations

import numpy as np
import pytest

from pflut.comparison import Headings
from pflut.pair_errors import MAX_HEADING_ERROR, ErrorSummary, PairErrors, binned_summaries


def test_errors_are_those_of_the_angles() -> None:
    truth = np.array([[0.1, 3.1], [1.0, 2.0], [0.0, 0.0]])
    found = np.array([[-0.1, -3.1], [1.05, 2.05], [np.nan, 0.0]])
    errors = PairErrors.of([Headings(*row) for row in found], truth, 0.5)
    assert errors.heading_l == pytest.approx([0.2, 0.05, np.pi])
    assert errors.heading_r[:2] == pytest.approx([2 * np.pi - 6.2, 0.05])
    # psi = theta - phi + pi
    assert errors.rotation == pytest.approx([0.2 + 2 * np.pi - 6.2, 0.0, np.pi], abs=1e-12)
    assert errors.heading == pytest.approx([0.2, 0.05, np.pi])
    assert errors.found.tolist() == [False, True, False]
    assert MAX_HEADING_ERROR == 0.1
    assert errors.seconds == 0.5
    # some of the pairs, and several sets together: the mean pair's time
    some = errors[errors.found]
    assert (len(some), some.rotation.tolist()) == (1, errors.rotation[1:2].tolist())
    other = PairErrors.of([Headings(0.0, 0.0)], [[0.0, 0.3]], 0.9)
    both = PairErrors.concatenate([errors, other])
    assert len(both) == 4
    assert both.heading_r.tolist() == [*errors.heading_r, *other.heading_r]
    assert both[:3].heading_l.tolist() == errors.heading_l.tolist()
    assert both.seconds == pytest.approx(0.6)


def errors_of(degrees: list[float], seconds: float = 2e-6) -> PairErrors:
    """Make errors of a heading, half as much of the other one, twice as much of the rotation."""
    heading = np.radians(degrees)
    return PairErrors(heading, heading / 2.0, 2.0 * heading, seconds)


def test_a_summary_has_medians_shares_and_intervals() -> None:
    summary = errors_of([1.0, 2.0, 3.0, 4.0, 170.0]).summary()
    assert summary.pairs == 5
    assert (summary.heading_median_deg, summary.rotation_median_deg) == pytest.approx((3.0, 6.0))
    assert (summary.heading_mad_deg, summary.rotation_mad_deg) == pytest.approx((1.0, 2.0))
    assert 1.0 <= summary.heading_low_deg < 3.0 < summary.heading_high_deg <= 170.0
    assert summary.rotation_low_deg == pytest.approx(2.0 * summary.heading_low_deg)
    assert summary.found == pytest.approx(0.8)
    assert summary.found_low < 0.8 < summary.found_high
    assert summary.cpu_us == pytest.approx(2.0)
    line = str(summary)
    for part in ("heading  3.00 deg", "rotation  6.00 deg", "found 0.800", "2 us"):
        assert part in line
    assert line.count(" to ") == 3


def test_the_same_errors_have_the_same_summary() -> None:
    errors = errors_of(np.random.default_rng(0).exponential(size=50).tolist())
    assert errors.summary() == errors.summary()
    assert all(name in ErrorSummary._fields for name in ("heading_low_deg", "found_high"))


def test_summaries_in_bins_are_those_of_the_bins_pairs() -> None:
    distance = np.array([0.2, 2.5, 0.7, 3.0, 9.0])
    errors = {"a": errors_of([1, 2, 3, 4, 5]), "b": errors_of([9, 8, 7, 6, 5])}
    found = list(binned_summaries(distance, errors, [0.0, 1.0, 2.0, 3.0]))
    # nothing is between 1 and 2 m, and one pair beyond all bins
    spans = [(0.0, 1.0), (2.0, 3.0), (0.0, 3.0)]
    assert [row[:3] for row in found] == [(*span, name) for span in spans for name in "ab"]
    for (_, _, name, summary), chosen in zip(
        found, [c for c in ([0, 2], [1, 3], [0, 1, 2, 3]) for _ in "ab"], strict=True
    ):
        assert summary == errors[name][np.array(chosen)].summary()
