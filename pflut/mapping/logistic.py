"""Logistic regression: the weights of features that make answers of yes and no most probable."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray

MAX_STEPS = 100


def fit_logistic(
    features: FloatArray, yes: NDArray[np.bool_], times: FloatArray, *, ridge: float
) -> FloatArray:
    """Find the weights by Newton's method.

    Parameters
    ----------
    features : ndarray of shape (n, k)
        The last one is the constant.
    yes : ndarray of bool, shape (n,)
        Some must be, and some not.
    times : ndarray of shape (n,)
        How often each answer counts.
    ridge : float
        Inverse variance of the weights beforehand; of the constant it is zero.

    Returns
    -------
    ndarray of shape (k,)
    """
    found = np.zeros(features.shape[1])
    found[-1] = logit(float(times @ yes / times.sum()))
    penalty = np.full(len(found), ridge)
    penalty[-1] = 0.0

    def loss(weights: FloatArray) -> float:
        odds = features @ weights
        return float(times @ (np.logaddexp(0.0, odds) - yes * odds) + 0.5 * penalty @ weights**2)

    here = loss(found)
    for _ in range(MAX_STEPS):
        p = sigmoid(features @ found)
        slope = features.T @ (times * (p - yes)) + penalty * found
        curvature = (features * (times * p * (1.0 - p))[:, None]).T @ features + np.diag(penalty)
        step = np.linalg.solve(curvature + 1e-12 * np.eye(len(found)), slope)
        # the loss is convex, but a whole step may go beyond its other side
        factor = 1.0
        while (there := loss(found - factor * step)) > here and factor > 1e-6:
            factor *= 0.5
        if there > here:
            break
        found, gained, here = found - factor * step, here - there, there
        if gained <= 1e-12 * (1.0 + abs(here)):
            break
    return found


def sigmoid(odds: FloatArray) -> FloatArray:
    """Turn log-odds into probabilities."""
    return np.asarray(np.exp(-np.logaddexp(0.0, -odds)))


def logit(share: float) -> float:
    """Turn a share in (0, 1) into log-odds."""
    return float(np.log(share) - np.log1p(-share))
