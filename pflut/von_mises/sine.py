"""The sine model: the von Mises distribution of two angles, with their correlation.

The density of the angles' differences (d1, d2) from the mean is

    exp(k1 cos d1 + k2 cos d2 + c sin d1 sin d2) / C(k1, k2, c)

with one maximum where c^2 < k1 k2. H. Singh, V. Hnizdo, E. Demchuk, "Probabilistic model for two
dependent circular variables", Biometrika 89 (2002) 719.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import TWO_PI, FloatArray
from pflut.von_mises.bessel import log_i0

NODES = 64
_HALF_WIDTHS: FloatArray = np.pi * np.power(0.8, np.arange(48.0))
_NEGLIGIBLE = 45.0
"""Nats below the maximum at which the integrand of the normaliser has ended."""


def log_normalizer(concentrations: ArrayLike, couplings: ArrayLike) -> FloatArray:
    """Give log C less the log-density's maximum: it stays small for any concentrations.

    One of the two integrals is a Bessel function, the other is the trapezoid rule's, whose error
    is below rounding for a smooth integrand that is periodic or has ended on both sides.

    Parameters
    ----------
    concentrations : array_like of shape (..., 2)
        k1 and k2, not negative.
    couplings : array_like of shape (...)
        c, between -sqrt(k1 k2) and sqrt(k1 k2).

    Returns
    -------
    ndarray of shape (...)
        log C - k1 - k2; zero concentrations give 2 log(2 pi).
    """
    k = np.asarray(concentrations, dtype=np.float64)
    k1, k2, c = k[..., 0, None], k[..., 1, None], np.asarray(couplings, dtype=np.float64)[..., None]

    def exponent(d: FloatArray) -> FloatArray:
        """Give the marginal's log over d2, without the Bessel function's decline."""
        inner = np.hypot(k1, c * np.sin(d))
        # hypot - k1 and cos - 1, without the differences of nearly equal numbers
        gain = (c * np.sin(d)) ** 2 / np.maximum(inner + k1, 1e-300)
        return np.asarray(gain - 2.0 * k2 * np.sin(0.5 * d) ** 2)

    ended = exponent(_HALF_WIDTHS) < -_NEGLIGIBLE
    half = _HALF_WIDTHS[np.maximum(ended.sum(axis=-1) - 1, 0)][..., None]
    d = half * ((np.arange(NODES) + 0.5) * (2.0 / NODES) - 1.0)
    inner = np.hypot(k1, c * np.sin(d))
    values = np.exp(exponent(d) + log_i0(inner) - inner)
    return np.asarray(np.log(TWO_PI) + np.log((2.0 / NODES) * half[..., 0] * values.sum(axis=-1)))


def log_density(
    headings: ArrayLike, means: ArrayLike, concentrations: ArrayLike, couplings: ArrayLike
) -> FloatArray:
    """Give the log-density of K sine models at any number of poses.

    Parameters
    ----------
    headings : array_like of shape (..., 2)
        Radians.
    means, concentrations : array_like of shape (K, 2)
    couplings : array_like of shape (K,)

    Returns
    -------
    ndarray of shape (..., K)
        Nats, per squared radian.
    """
    k, c = np.asarray(concentrations, np.float64), np.asarray(couplings, np.float64)
    d = np.asarray(headings, dtype=np.float64)[..., None, :] - np.asarray(means, np.float64)
    below = -2.0 * np.sin(0.5 * d) ** 2
    sines = np.sin(d)
    return np.asarray(
        (k * below).sum(axis=-1) + c * sines[..., 0] * sines[..., 1] - log_normalizer(k, c)
    )


def quadrature(
    mean: FloatArray, concentrations: FloatArray, coupling: float, nodes: int = 32
) -> tuple[FloatArray, FloatArray]:
    """Give points and weights that integrate a smooth function over one sine model.

    Parameters
    ----------
    mean, concentrations : ndarray of shape (2,)
    coupling : float
    nodes : int
        Of each angle.

    Returns
    -------
    points : ndarray of shape (nodes^2, 2)
        Radians.
    weights : ndarray of shape (nodes^2,)
        They sum to one.

    Notes
    -----
    Given d1, d2 is von Mises about atan(c sin d1 / k2); each has nodes where its density is not
    negligible.
    """
    k1, k2 = concentrations

    def spread(k: FloatArray) -> FloatArray:
        """Give places about a von Mises distribution's mean, ending 25 nats below it."""
        half = np.where(k > 12.5, 2.0 * np.arcsin(np.sqrt(12.5 / np.maximum(k, 12.5))), np.pi)
        return np.asarray(half[..., None] * ((np.arange(nodes) + 0.5) * (2.0 / nodes) - 1.0))

    # the marginal of d1 declines no faster than a von Mises distribution with this concentration
    narrow = np.array([_marginal_concentration(float(k1), float(k2), coupling)])
    d1 = spread(narrow)[0]
    inner = np.hypot(k2, coupling * np.sin(d1))
    d2 = np.arctan2(coupling * np.sin(d1), max(k2, 1e-300))[:, None] + spread(inner)
    log = (
        -2.0 * k1 * np.sin(0.5 * d1[:, None]) ** 2
        - 2.0 * k2 * np.sin(0.5 * d2) ** 2
        + coupling * np.sin(d1)[:, None] * np.sin(d2)
    )
    # the step in d2 is another for every d1
    steps = d2[:, 1] - d2[:, 0]
    weights = np.exp(log - log.max()) * steps[:, None]
    points = np.stack([np.broadcast_to(d1[:, None], d2.shape), d2], axis=-1) + mean
    return points.reshape(-1, 2), (weights / weights.sum()).ravel()


def _marginal_concentration(k1: float, k2: float, coupling: float) -> float:
    """Give the concentration that ends where the marginal of d1 is 25 nats below its maximum."""
    d = _HALF_WIDTHS
    across = coupling * np.sin(d)
    inner = np.hypot(k2, across)
    value = across**2 / np.maximum(inner + k2, 1e-300) - 2.0 * k1 * np.sin(0.5 * d) ** 2
    half = d[max(int((value < -25.0).sum()) - 1, 0)]
    return float(12.5 / np.sin(0.5 * half) ** 2) if half < np.pi else 0.0
