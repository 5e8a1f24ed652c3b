"""The radial and tangential lens distortion of Brown, as OpenCV writes it."""

from __future__ import annotations

import numpy as np

from pflut.camera.radial import first_positive_root
from pflut.geometry import FloatArray

MAX_ITERATIONS = 50


def distort(points: FloatArray, coefficients: tuple[float, ...]) -> FloatArray:
    """Move normalized image points to where the lens puts them.

    Parameters
    ----------
    points : ndarray of shape (n, 2)
        ``[x, y]`` on the plane at distance 1, x right, y down.
    coefficients : tuple of 5 floats
        ``k1, k2, p1, p2, k3``.

    Returns
    -------
    ndarray of shape (n, 2)
    """
    k1, k2, p1, p2, k3 = coefficients
    x, y = points[:, 0], points[:, 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return np.stack([xd, yd], axis=1)


def undistort(points: FloatArray, coefficients: tuple[float, ...]) -> FloatArray:
    """Invert `distort` by Newton's method.

    Parameters
    ----------
    points : ndarray of shape (n, 2)
        Distorted ``[x, y]``.
    coefficients : tuple of 5 floats
        ``k1, k2, p1, p2, k3``.

    Returns
    -------
    ndarray of shape (n, 2)
        NaN where no undistorted point within `fold_radius` maps there.
    """
    if not any(coefficients):
        return points
    limit = fold_radius(coefficients)
    estimate = points.copy()
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        for _ in range(MAX_ITERATIONS):
            residual = distort(estimate, coefficients) - points
            step = _newton_step(estimate, residual, coefficients)
            # a step as long as the point itself left the region where Newton converges
            length = np.linalg.norm(step, axis=1, keepdims=True)
            longest = 0.5 * (1.0 + np.linalg.norm(estimate, axis=1, keepdims=True))
            estimate = estimate - step * np.minimum(1.0, longest / np.maximum(length, 1e-300))
            if not (length > 1e-15 * (1.0 + np.abs(estimate).max(axis=1, keepdims=True))).any():
                break
        residual = np.abs(distort(estimate, coefficients) - points).max(axis=1)
        good = (residual < 1e-12 * (1.0 + np.abs(points).max(axis=1))) & (
            np.linalg.norm(estimate, axis=1) < limit
        )
    return np.where(good[:, None], estimate, np.nan)


def fold_radius(coefficients: tuple[float, ...]) -> float:
    """Give the undistorted radius at which the radial distortion turns back.

    Beyond it points far outside the field would be projected into the image.

    Parameters
    ----------
    coefficients : tuple of 5 floats
        ``k1, k2, p1, p2, k3``.

    Returns
    -------
    float
        Infinity where the distortion is monotonic.
    """
    k1, k2, _, _, k3 = coefficients
    turn = float(np.sqrt(first_positive_root([1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3])))
    # at the turn itself the inverse is infinitely steep
    return turn * (1.0 - 1e-6)


def _newton_step(
    points: FloatArray, residual: FloatArray, coefficients: tuple[float, ...]
) -> FloatArray:
    """Solve the 2 x 2 system Jacobian of `distort` times step = residual."""
    k1, k2, p1, p2, k3 = coefficients
    x, y = points[:, 0], points[:, 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3)
    xx = radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    xy = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    yy = radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    determinant = xx * yy - xy * xy
    a, b = residual[:, 0], residual[:, 1]
    return np.stack([(yy * a - xy * b) / determinant, (xx * b - xy * a) / determinant], axis=1)
