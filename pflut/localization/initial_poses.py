"""Where particles start: anywhere in a rectangle, or around a pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import FloatArray
from pflut.localization.gaussian import as_gaussian, square_root

Bounds = tuple[float, float, float, float]
"""A rectangle (xmin, ymin, xmax, ymax), metres."""


def check_bounds(bounds: Bounds) -> None:
    """Refuse a rectangle that is none.

    Raises
    ------
    ValueError
        If it is not finite or the wrong way round.
    """
    low_x, low_y, high_x, high_y = bounds
    if not (np.isfinite(bounds).all() and low_x <= high_x and low_y <= high_y):
        raise ValueError(f"bounds: expected finite (xmin, ymin, xmax, ymax), got {bounds}")


def uniform_poses(
    bounds: Bounds,
    n: int,
    rng: np.random.Generator,
    *,
    heading: float | tuple[float, float] | None = None,
) -> FloatArray:
    """Draw poses uniformly from a rectangle.

    Parameters
    ----------
    bounds : tuple (xmin, ymin, xmax, ymax)
        Metres.
    n : int
    rng : numpy.random.Generator
    heading : float or tuple (from, to), optional
        Radians: the known heading, or an interval of it. By default the whole circle.

    Returns
    -------
    ndarray of shape (n, 3)

    Raises
    ------
    ValueError
        If the bounds or the heading are not finite or the wrong way round.
    """
    check_bounds(bounds)
    interval = (-np.pi, np.pi) if heading is None else np.broadcast_to(heading, (2,))
    if not (np.isfinite(interval).all() and interval[0] <= interval[1]):
        raise ValueError(f"heading: expected finite radians, from <= to, got {heading}")
    low_x, low_y, high_x, high_y = bounds
    return rng.uniform([low_x, low_y, interval[0]], [high_x, high_y, interval[1]], (n, 3))


def gaussian_poses(
    mean: ArrayLike, covariance: ArrayLike, n: int, rng: np.random.Generator
) -> FloatArray:
    """Draw poses around one that is known up to a covariance.

    Parameters
    ----------
    mean : array_like of shape (3,)
        ``[x, y, heading]``.
    covariance : array_like of shape (3, 3)
        Symmetric, no eigenvalue below zero; zeros are allowed.
    n : int
    rng : numpy.random.Generator

    Returns
    -------
    ndarray of shape (n, 3)

    Raises
    ------
    ValueError
        If the mean is no pose or the covariance is none.
    """
    center, matrix = as_gaussian(mean, covariance)
    poses: FloatArray = center + rng.standard_normal((n, 3)) @ square_root(matrix)
    return poses
