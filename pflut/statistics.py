"""Statistics that errors are reported with, and how sure they are.

Statistics are of absolute errors: the median, the MAD (the median of the absolute deviations from
the median, as Booij et al. 2010 report it), the root of the mean square. NaN is unknown and left
out; infinity is a failure and counts.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.geometry import FloatArray


@dataclass(frozen=True)
class Summary:
    """Statistics of absolute errors, in the errors' own unit.

    Parameters
    ----------
    count : int
        Of errors; the statistics of none are NaN.
    median, mad, rmse, percentile_90, maximum : float
        Infinite where as many errors are.
    """

    count: int
    median: float
    mad: float
    rmse: float
    percentile_90: float
    maximum: float

    def as_dict(self) -> dict[str, int | float | None]:
        """Return the statistics for a JSON file, ``None`` where not finite."""
        return {k: v if np.isfinite(v) else None for k, v in asdict(self).items()}


@dataclass(frozen=True)
class Rate:
    """A share of successes with its Wilson interval.

    Parameters
    ----------
    successes, count : int
    rate, low, high : float
        In [0, 1]; NaN, 0 and 1 for a count of 0.
    """

    successes: int
    count: int
    rate: float
    low: float
    high: float

    def as_dict(self) -> dict[str, int | float | None]:
        """Return the rate for a JSON file, ``None`` where not finite."""
        return {k: v if np.isfinite(v) else None for k, v in asdict(self).items()}


def median_absolute_deviation(errors: ArrayLike) -> float:
    """Give the median of the absolute deviations from the median; NaN of nothing.

    Parameters
    ----------
    errors : array_like of shape (n,)
        NaN values are left out.

    Returns
    -------
    float
        In the errors' unit, without a factor that would make it a standard deviation.
    """
    values = _known(errors)
    if not values.size:
        return np.nan
    median = float(np.median(values))
    return float(np.median(np.abs(values - median))) if np.isfinite(median) else np.inf


def root_mean_square(errors: ArrayLike) -> float:
    """Give the root of the mean square; NaN values are left out, NaN of nothing."""
    values = _known(errors)
    return float(np.sqrt(np.mean(values**2))) if values.size else np.nan


def summarize(errors: ArrayLike) -> Summary:
    """Summarize errors, by their absolute values.

    Parameters
    ----------
    errors : array_like of shape (n,)
        Any unit, signed or not; NaN values are left out.

    Returns
    -------
    Summary
    """
    values = np.abs(_known(errors))
    if not values.size:
        return Summary(0, *[np.nan] * 5)
    # "higher", because between a finite and an infinite error there is nothing to interpolate
    percentile_90 = float(np.percentile(values, 90, method="higher"))
    return Summary(
        count=values.size,
        median=float(np.median(values)),
        mad=median_absolute_deviation(values),
        rmse=root_mean_square(values),
        percentile_90=percentile_90,
        maximum=float(values.max()),
    )


def wilson_interval(successes: int, count: int, *, level: float = 0.95) -> tuple[float, float]:
    """Give the Wilson score interval of a rate (E. B. Wilson, JASA 22, 1927).

    Parameters
    ----------
    successes, count : int
        How many of how many.
    level : float
        Of confidence, in (0, 1).

    Returns
    -------
    low, high : float
        In [0, 1]; (0, 1) for a count of 0.

    Raises
    ------
    ValueError
        If the numbers are none of a rate.
    """
    if not 0 <= successes <= count:
        raise ValueError(f"successes: expected 0 to {count}, got {successes}")
    _check_level(level)
    if count == 0:
        return 0.0, 1.0
    z2 = NormalDist().inv_cdf(0.5 + level / 2.0) ** 2
    share = successes / count
    center = (share + z2 / (2 * count)) / (1 + z2 / count)
    spread = np.sqrt(z2 * (share * (1 - share) / count + z2 / (4 * count**2))) / (1 + z2 / count)
    low = 0.0 if successes == 0 else float(center - spread)
    return low, 1.0 if successes == count else float(center + spread)


def success_rate(successes: ArrayLike, *, level: float = 0.95) -> Rate:
    """Give the share of successes with its Wilson interval.

    Parameters
    ----------
    successes : array_like of bool, shape (n,)
    level : float
        Of confidence, in (0, 1).

    Returns
    -------
    Rate
    """
    values = np.asarray(successes, dtype=bool)
    low, high = wilson_interval(int(values.sum()), values.size, level=level)
    rate = float(values.mean()) if values.size else np.nan
    return Rate(int(values.sum()), values.size, rate, low, high)


def bootstrap_median(
    errors: ArrayLike,
    *,
    level: float = 0.95,
    resamples: int = 2000,
    rng: np.random.Generator | int | None = None,
) -> tuple[float, float]:
    """Give the percentile bootstrap interval of the median.

    Parameters
    ----------
    errors : array_like of shape (n,)
        Independent of each other (one number a drive, not one a step); NaN are left out.
    level : float
        Of confidence, in (0, 1).
    resamples : int
        How often the errors are drawn again.
    rng : Generator, int or None
        Source of randomness.

    Returns
    -------
    low, high : float
        NaN of nothing.
    """
    _check_level(level)
    values = _known(errors)
    if not values.size:
        return np.nan, np.nan
    draws = np.random.default_rng(rng).integers(values.size, size=(resamples, values.size))
    medians = np.median(values[draws], axis=1)
    tail = 50.0 * (1.0 - level)
    # the nearest of the medians that occurred: infinite errors cannot be interpolated
    low, high = np.percentile(medians, [tail, 100.0 - tail], method="nearest")
    return float(low), float(high)


def bootstrap_median_ratio(
    errors: ArrayLike,
    others: ArrayLike,
    *,
    level: float = 0.95,
    resamples: int = 2000,
    rng: np.random.Generator | int | None = None,
) -> tuple[float, float]:
    """Give the percentile bootstrap interval of a ratio of medians, of errors on the same things.

    Parameters
    ----------
    errors, others : array_like of shape (n,)
        Row by row of the same pair, drive or seed: they are drawn again together. Rows with a NaN
        are left out.
    level : float
        Of confidence, in (0, 1).
    resamples : int
        How often the rows are drawn again.
    rng : Generator, int or None
        Source of randomness.

    Returns
    -------
    low, high : float
        Of median(errors) over median(others); NaN of nothing.

    Raises
    ------
    ValueError
        If the shapes differ.
    """
    _check_level(level)
    first, second = (np.asarray(values, dtype=np.float64) for values in (errors, others))
    if first.shape != second.shape or first.ndim != 1:
        raise ValueError(
            f"errors, others: expected the same shape (n,), got {first.shape} and {second.shape}"
        )
    known = ~(np.isnan(first) | np.isnan(second))
    first, second = first[known], second[known]
    if not first.size:
        return np.nan, np.nan
    draws = np.random.default_rng(rng).integers(first.size, size=(resamples, first.size))
    ratios = np.median(first[draws], axis=1) / np.median(second[draws], axis=1)
    low, high = np.quantile(ratios, [0.5 - level / 2.0, 0.5 + level / 2.0])
    return float(low), float(high)


def adjusted_rand_index(first: ArrayLike, second: ArrayLike) -> float:
    """Say how well two ways of sorting the same things into groups agree.

    Of all pairs of things, how many are together in both, beyond what chance would give to groups
    of these sizes (Hubert, Arabie, "Comparing partitions", 1985).

    Parameters
    ----------
    first, second : array_like of shape (n,)
        The group of each thing; the names of groups do not matter.

    Returns
    -------
    float
        1 for the same groups, 0 on average for random ones, at least -1. Also 1 where both put all
        things together, or each into a group of its own.

    Raises
    ------
    ValueError
        If the shapes differ, or there is nothing.
    """
    left, right = np.asarray(first), np.asarray(second)
    if left.ndim != 1 or left.shape != right.shape or not left.size:
        raise ValueError(
            f"first, second: expected two groups a thing, got shapes {left.shape} and {right.shape}"
        )
    _, a = np.unique(left, return_inverse=True)
    _, b = np.unique(right, return_inverse=True)
    counts = np.zeros((a.max() + 1, b.max() + 1))
    np.add.at(counts, (a, b), 1.0)

    def pairs(values: FloatArray) -> float:
        return float((values * (values - 1.0)).sum()) / 2.0

    together, of_first, of_second = pairs(counts), pairs(counts.sum(1)), pairs(counts.sum(0))
    expected = of_first * of_second / max(pairs(np.array([left.size], dtype=np.float64)), 1.0)
    most = 0.5 * (of_first + of_second)
    return 1.0 if most == expected else (together - expected) / (most - expected)


def bin_indices(x: ArrayLike, edges: ArrayLike) -> NDArray[np.intp]:
    """Say in which bin each x is.

    Parameters
    ----------
    x : array_like of shape (n,)
    edges : array_like of shape (b + 1,)
        Increasing; a bin holds its lower edge, the last one its upper edge too.

    Returns
    -------
    ndarray of shape (n,)
        0 to b - 1, or -1 in none.
    """
    border, position = (np.asarray(values, dtype=np.float64) for values in (edges, x))
    bins = np.searchsorted(border, position, side="right") - 1
    bins[position == border[-1]] = len(border) - 2
    bins[bins == len(border) - 1] = -1
    return bins


def _known(errors: ArrayLike) -> FloatArray:
    values = np.asarray(errors, dtype=np.float64).ravel()
    known: FloatArray = values[~np.isnan(values)]
    return known


def _check_level(level: float) -> None:
    if not 0.0 < level < 1.0:
        raise ValueError(f"level: expected a confidence in (0, 1), got {level}")
