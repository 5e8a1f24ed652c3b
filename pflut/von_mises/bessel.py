"""Modified Bessel functions of the order zero and one, for concentrations of any size."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import FloatArray

LARGE = 50.0
"""Above it the asymptotic series are exact to 1e-10."""
_NODES = np.cos(2.0 * np.pi * np.arange(128) / 128)


def log_i0(concentration: ArrayLike) -> FloatArray:
    """Give the log of I0, which itself overflows at 700.

    Parameters
    ----------
    concentration : array_like
        Not negative; any shape.

    Returns
    -------
    ndarray
        The same shape.
    """
    k = np.asarray(concentration, dtype=np.float64)
    small = np.minimum(k, LARGE)
    # the mean over even angles is exact to the accuracy of the numbers: the integrand is periodic
    exact = small + np.log(np.exp(small[..., None] * (_NODES - 1.0)).mean(axis=-1))
    q = 1.0 / np.maximum(k, LARGE)
    series = 1.0 + q * (1 / 8 + q * (9 / 128 + q * (75 / 1024 + q * (3675 / 32768))))
    asymptotic = k - 0.5 * np.log(2.0 * np.pi * np.maximum(k, LARGE)) + np.log(series)
    return np.asarray(np.where(k > LARGE, asymptotic, exact))


def bessel_ratio(concentration: ArrayLike) -> FloatArray:
    """Give I1 / I0, the mean of the cosine of a von Mises distribution about its mean.

    Parameters
    ----------
    concentration : array_like
        Not negative; any shape.

    Returns
    -------
    ndarray
        The same shape, in [0, 1).
    """
    k = np.asarray(concentration, dtype=np.float64)
    small = np.minimum(k, LARGE)
    terms = np.exp(small[..., None] * (_NODES - 1.0))
    exact = (terms @ _NODES) / terms.sum(axis=-1)
    q = 1.0 / np.maximum(k, LARGE)
    series = q * (1 / 2 + q * (1 / 8 + q * (1 / 8 + q * (25 / 128 + q * (13 / 32)))))
    return np.asarray(np.where(k > LARGE, 1.0 - series, exact))
