"""How sure an estimate is: its covariance, and whether coincidence would bring as many inliers."""

from __future__ import annotations

from math import log

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray
from pflut.relpose.judge_kernels import judge
from pflut.relpose.result import UNIFORM_VARIANCE

INLIER_CUTOFF = 3.0
"""Standard deviations of the noise within which a correspondence agrees with a pose."""
MIN_INLIERS = 3
SHIFTS = 16
"""Certain mismatches looked at a correspondence, to measure what coincidence brings."""
LOG_FALSE_ALARMS = log(0.01)


def covariances(
    information: FloatArray, squares: FloatArray, redundancy: FloatArray, noise: float
) -> FloatArray:
    """Invert informations at the residuals' own spread, bounded by that of uniform angles.

    Parameters
    ----------
    information : ndarray of shape (p, 3 or more)
        Entries (0, 0), (0, 1), (1, 1) of J^T W J; others are not looked at.
    squares : ndarray of shape (p,)
        Weighted sums of squared residuals.
    redundancy : ndarray of shape (p,)
        What to divide them by for a variance; where it is not positive nothing is known.
    noise : float
        Least standard deviation of a residual, radians: few inliers may agree by luck.

    Returns
    -------
    ndarray of shape (p, 2, 2)
    """
    variance = np.full(len(squares), np.inf)
    known = redundancy > 0.0
    variance[known] = np.maximum(squares[known] / redundancy[known], noise**2)
    prior = 1.0 / UNIFORM_VARIANCE
    a, b, c = information[:, :3].T / variance
    a, c = a + prior, c + prior
    inverse = np.stack([c, -b, -b, a], axis=1) / (a * c - b * b)[:, None]
    return np.asarray(inverse.reshape(-1, 2, 2))


def widened(covariance: FloatArray, band: FloatArray) -> FloatArray:
    """Add variances (p,) of both headings together, bounded by that of uniform angles."""
    largest = np.maximum(covariance[:, 0, 0], covariance[:, 1, 1])
    return covariance + np.minimum(band, UNIFORM_VARIANCE - largest)[:, None, None]


def judged(
    columns: FloatArray, first: NDArray[np.int64], headings: FloatArray, noise: float
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Count the inliers of each pair's pose, and tell whether they determine it.

    Parameters
    ----------
    columns : ndarray of shape (8, n)
        Sines and cosines of all pairs' bearings, see `bearing_columns`.
    first : ndarray of shape (p + 1,)
        Where each pair's columns begin, and the last one's end.
    headings : ndarray of shape (p, 2)
        Radians.
    noise : float
        Standard deviation of the bearings, radians.

    Returns
    -------
    inliers : ndarray of shape (p,)
    success : ndarray of shape (p,)
        False where fewer than three agree, or no more than coincidence would bring.
    """
    inliers, alarms = np.empty(len(headings), np.int64), np.empty(len(headings))
    judge(columns, first, headings, INLIER_CUTOFF * noise, SHIFTS, inliers, alarms)
    return inliers, (inliers >= MIN_INLIERS) & (alarms < LOG_FALSE_ALARMS)
