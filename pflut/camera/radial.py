"""Inverting a radial function: angle from the axis to radius and back."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import FloatArray

Function = Callable[[FloatArray], FloatArray]

MAX_ITERATIONS = 100


def invert_increasing(
    function: Function, slope: Function, values: FloatArray, upper: float
) -> FloatArray:
    """Solve ``function(x) = value`` by Newton steps kept inside a shrinking bracket.

    Parameters
    ----------
    function, slope : callable
        An increasing function on [0, upper] with ``function(0) = 0``, and its derivative.
    values : ndarray of shape (n,)
    upper : float
        The end of the bracket.

    Returns
    -------
    ndarray of shape (n,)
        NaN where the value lies outside [0, function(upper)], or is NaN.
    """
    reachable = (values >= 0.0) & (values <= function(np.array([upper]))[0])
    target = np.where(reachable, values, 0.0)
    low, high = np.zeros_like(target), np.full_like(target, upper)
    x = np.full_like(target, 0.5 * upper)
    for _ in range(MAX_ITERATIONS):
        error = function(x) - target
        low, high = np.where(error < 0.0, x, low), np.where(error > 0.0, x, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = x - error / slope(x)
        inside = (step >= low) & (step <= high)
        new = np.where(error == 0.0, x, np.where(inside, step, 0.5 * (low + high)))
        done = np.abs(new - x) <= 4.0 * np.finfo(np.float64).eps * upper
        x = new
        if done.all():
            break
    return np.where(reachable, x, np.nan)


def first_positive_root(coefficients: ArrayLike) -> float:
    """Give the smallest positive real root of a polynomial; infinity where there is none.

    Parameters
    ----------
    coefficients : array_like
        Of rising powers.

    Returns
    -------
    float
    """
    roots = np.roots(np.asarray(coefficients, dtype=np.float64)[::-1])
    real = roots.real[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0.0)]
    return float(real.min()) if real.size else float("inf")
