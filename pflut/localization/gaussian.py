"""A pose known up to a covariance: checked, and how much of it is near its mean."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import TWO_PI, FloatArray, as_poses
from pflut.localization.estimate import CONFIDENCE_ANGLE, CONFIDENCE_RADIUS

DRAWS = 8192


def as_gaussian(mean: ArrayLike, covariance: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Check a mean pose and its covariance.

    Parameters
    ----------
    mean : array_like of shape (3,)
        ``[x, y, heading]``.
    covariance : array_like of shape (3, 3)
        Symmetric, no eigenvalue below zero; zeros are allowed.

    Returns
    -------
    mean : ndarray of shape (3,)
    covariance : ndarray of shape (3, 3)

    Raises
    ------
    ValueError
        If the shapes are others, a number is not finite, or the covariance is none.
    """
    center = as_poses(mean, "mean")
    matrix = np.asarray(covariance, dtype=np.float64)
    if center.shape != (1, 3):
        raise ValueError(f"mean: expected shape (3,), got {np.shape(mean)}")
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise ValueError(f"covariance: expected 3 x 3 finite numbers, got {matrix.tolist()}")
    scale = np.abs(matrix).max()
    if (np.abs(matrix - matrix.T) > 1e-9 * scale).any():
        raise ValueError(f"covariance: expected a symmetric matrix, got {matrix.tolist()}")
    lowest = np.linalg.eigvalsh(matrix)[0]
    if lowest < -1e-9 * scale:
        raise ValueError(f"covariance: expected no eigenvalue below 0, got {lowest:.3g}")
    return center[0], matrix


def square_root(covariance: FloatArray) -> FloatArray:
    """Return a matrix U with U^T U = covariance, which may be singular.

    Parameters
    ----------
    covariance : ndarray of shape (n, n)
        Symmetric; eigenvalues that rounding made negative count as zero.

    Returns
    -------
    ndarray of shape (n, n)
        Its rows are the covariance's axes, each as long as one standard deviation.
    """
    variances, axes = np.linalg.eigh(covariance)
    return np.asarray((axes * np.sqrt(np.maximum(variances, 0.0))).T)


@cache
def _even_normals() -> FloatArray:
    """Spread standard normal numbers evenly, (DRAWS, 3): a rank-1 lattice, Box and Muller."""
    root = 1.0
    for _ in range(64):  # of x^5 = x + 1, whose powers fill four dimensions evenly (Roberts 2018)
        root = (1.0 + root) ** 0.2
    numbers = np.arange(1, DRAWS + 1)[:, None] / root ** np.arange(1, 5)
    a, b, c, d = ((numbers + 0.5) % 1.0).T
    radius_1, radius_2 = np.sqrt(-2.0 * np.log(1.0 - np.stack([a, c])))
    angle_1, angle_2 = TWO_PI * np.stack([b, d])
    return np.stack(
        [radius_1 * np.cos(angle_1), radius_1 * np.sin(angle_1), radius_2 * np.cos(angle_2)], axis=1
    )


def mass_nearby(covariance: FloatArray) -> float:
    """Give the probability that a Gaussian pose is within 0.5 m and 10 degrees of its mean.

    Parameters
    ----------
    covariance : ndarray of shape (3, 3)

    Returns
    -------
    float
        The share of 8192 evenly spread draws, right to about 0.005: the `confidence` of an
        `Estimate` made of particles, without any.
    """
    x, y, heading = (_even_normals() @ square_root(covariance)).T
    near = (np.hypot(x, y) <= CONFIDENCE_RADIUS) & (np.abs(heading) <= CONFIDENCE_ANGLE)
    return float(near.mean())
