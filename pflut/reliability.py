"""How good probabilities and scores of yes-or-no questions are.

Probabilities are calibrated if of the events that are given one half, half happen: the reliability
curve and the expected calibration error compare the two. Scores need only rank: the average
precision says how well they tell yes from no.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.geometry import FloatArray
from pflut.statistics import wilson_interval

RESAMPLES = 2000
TENTHS = tuple(np.linspace(0.0, 1.0, 11).tolist())


@dataclass(frozen=True)
class CalibrationBin:
    """Events of about one probability.

    Parameters
    ----------
    predicted : float
        Their mean probability.
    observed : float
        Share of them that happened.
    low, high : float
        95 % interval of that.
    count : int
        Events.
    """

    predicted: float
    observed: float
    low: float
    high: float
    count: int


def reliability_curve(
    probabilities: ArrayLike,
    happened: ArrayLike,
    *,
    edges: Sequence[float] = TENTHS,
    groups: ArrayLike | None = None,
) -> list[CalibrationBin]:
    """Compare probabilities with how often it happened.

    Parameters
    ----------
    probabilities : array_like of shape (n,)
    happened : array_like of bool, shape (n,)
    edges : sequence of float
        Of the classes of probability, increasing from 0 to 1; by default tenths.
    groups : array_like of int, shape (n,), optional
        Events of one group are not independent: the intervals are then by bootstrap over groups,
        numbered from 0. By default they are Wilson's, of independent events.

    Returns
    -------
    list of CalibrationBin
        Classes without events are left out.

    Raises
    ------
    ValueError
        If the shapes differ or a probability is none.
    """
    given, yes = _checked(probabilities, happened)
    places = np.digitize(given, np.asarray(edges)[1:-1])
    owner = None if groups is None else np.asarray(groups, dtype=np.int64)
    number = 0 if owner is None or not owner.size else int(owner.max()) + 1
    curve = []
    for k in range(len(edges) - 1):
        inside = places == k
        count = int(inside.sum())
        if not count:
            continue
        hits = int(yes[inside].sum())
        if owner is None:
            low, high = wilson_interval(hits, count)
        else:
            counts = np.bincount(owner[inside], minlength=number)
            low, high = share_interval(np.bincount(owner[inside & yes], minlength=number), counts)
        curve.append(CalibrationBin(float(given[inside].mean()), hits / count, low, high, count))
    return curve


def share_interval(
    hits: ArrayLike, counts: ArrayLike, *, resamples: int = RESAMPLES
) -> tuple[float, float]:
    """Give the 95 % interval of a share, by bootstrap over groups whose events are dependent.

    Parameters
    ----------
    hits, counts : array_like of shape (g,)
        How many of how many, in each group; of a mean, the sum of its values.
    resamples : int

    Returns
    -------
    low, high : float
    """
    successes, totals = np.asarray(hits), np.asarray(counts)
    draws = draws_of_groups(len(totals), resamples=resamples, rng=0)
    with np.errstate(invalid="ignore"):
        shares = (draws @ successes) / (draws @ totals)
    low, high = np.nanquantile(shares, (0.025, 0.975))
    return float(low), float(high)


def expected_calibration_error(
    probabilities: ArrayLike,
    happened: ArrayLike,
    *,
    edges: Sequence[float] = TENTHS,
    weights: ArrayLike | None = None,
) -> float:
    """Give the mean distance of the reliability curve from the diagonal.

    Parameters
    ----------
    probabilities : array_like of shape (n,)
    happened : array_like of bool, shape (n,)
    edges : sequence of float
        Of the classes, see `reliability_curve`.
    weights : array_like of shape (n,), optional
        How often each event counts.

    Returns
    -------
    float
        The sum over the classes of their share of the events times the absolute difference of
        mean probability and observed share; NaN of nothing.

    Raises
    ------
    ValueError
        If the shapes differ or a probability is none.

    References
    ----------
    M. P. Naeini, G. Cooper, M. Hauskrecht, "Obtaining well calibrated probabilities using Bayesian
    binning", AAAI 2015.
    """
    given, yes = _checked(probabilities, happened)
    times = np.ones(len(given)) if weights is None else np.asarray(weights, dtype=np.float64)
    places = np.digitize(given, np.asarray(edges)[1:-1])
    gaps = np.bincount(places, weights=times * (yes - given), minlength=len(edges) - 1)
    total = times.sum()
    return float(np.abs(gaps).sum() / total) if total > 0.0 else np.nan


def average_precision(
    happened: ArrayLike, scores: ArrayLike, *, weights: ArrayLike | None = None
) -> float:
    """Give the average precision of a score: the area under the steps of precision over recall.

    Parameters
    ----------
    happened : array_like of bool, shape (n,)
    scores : array_like of shape (n,)
        Large means yes; only their order counts, and equal ones are taken together.
    weights : array_like of shape (n,), optional
        How often each event counts.

    Returns
    -------
    float
        In (0, 1]: the share of yes if the score says nothing; NaN if there is no yes.

    Raises
    ------
    ValueError
        If the shapes differ.
    """
    precision, recall = precision_recall(happened, scores, weights=weights)
    return float(np.diff(recall, prepend=0.0) @ precision) if recall.size else np.nan


def precision_recall(
    happened: ArrayLike, scores: ArrayLike, *, weights: ArrayLike | None = None
) -> tuple[FloatArray, FloatArray]:
    """Give precision and recall at every threshold of a score.

    Parameters
    ----------
    happened, scores, weights
        See `average_precision`.

    Returns
    -------
    precision, recall : ndarray of shape (k,)
        From the highest threshold down, one a value that the score has; empty without a yes.

    Raises
    ------
    ValueError
        If the shapes differ.
    """
    yes, value = np.asarray(happened, dtype=bool), np.asarray(scores, dtype=np.float64)
    times = np.ones(value.shape) if weights is None else np.asarray(weights, dtype=np.float64)
    if yes.ndim != 1 or yes.shape != value.shape or yes.shape != times.shape:
        raise ValueError(
            "happened, scores, weights: expected the same shape (n,), got "
            f"{yes.shape}, {value.shape} and {times.shape}"
        )
    if not times[yes].sum() > 0.0:
        return np.empty(0), np.empty(0)
    order = np.argsort(-value, kind="stable")
    value, times = value[order], times[order]
    found = np.cumsum(times * yes[order])
    said = np.cumsum(times)
    last = np.append(value[1:] != value[:-1], True) & (said > 0.0)
    return found[last] / said[last], found[last] / found[-1]


def draws_of_groups(
    groups: int, *, resamples: int = RESAMPLES, rng: np.random.Generator | int | None = None
) -> NDArray[np.int64]:
    """Say how often bootstraps over groups draw each of them, of shape (resamples, groups)."""
    chance = np.full(groups, 1.0 / groups)
    return np.random.default_rng(rng).multinomial(groups, chance, size=resamples)


def draws_of_pairs(
    ends: ArrayLike, *, resamples: int = 1000, rng: np.random.Generator | int | None = None
) -> NDArray[np.int16]:
    """Say how often bootstraps over images draw each pair of images.

    Pairs share images and are not independent: a pair is drawn as often as both of its images are.

    Parameters
    ----------
    ends : array_like of shape (n, 2)
        The images of each pair.
    resamples : int
        Bootstraps.
    rng : Generator, int or None

    Returns
    -------
    ndarray of shape (resamples, n), int16
    """
    images, place = np.unique(np.asarray(ends), return_inverse=True)
    times = draws_of_groups(len(images), resamples=resamples, rng=rng)
    drawn = times[:, place.reshape(-1, 2)].prod(axis=2)
    return np.asarray(drawn.astype(np.int16))


def _checked(probabilities: ArrayLike, happened: ArrayLike) -> tuple[FloatArray, NDArray[np.bool_]]:
    given, yes = np.asarray(probabilities, dtype=np.float64), np.asarray(happened, dtype=bool)
    if given.ndim != 1 or given.shape != yes.shape:
        raise ValueError(
            "probabilities, happened: expected the same shape (n,), got "
            f"{given.shape} and {yes.shape}"
        )
    if not ((given >= 0.0) & (given <= 1.0)).all():
        raise ValueError("probabilities: expected numbers in [0, 1]")
    return given, yes
