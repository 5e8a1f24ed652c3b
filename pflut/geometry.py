"""SE(2) poses, angles, bearings, and the two headings between poses.

Conventions (``docs/conventions.md``): robot frame x forward, y left, z up (REP 103); angles in
radians, counter-clockwise; a pose is a row ``[x, y, heading]`` of an ``(N, 3)`` float64 array.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

TWO_PI = 2.0 * np.pi


def wrap_to_pi(angle: ArrayLike) -> Any:
    """Wrap angles to (-pi, pi].

    Parameters
    ----------
    angle : array_like
        Radians, any shape.

    Returns
    -------
    ndarray or float
        The same shape, in (-pi, pi].
    """
    wrapped = np.pi - (np.pi - np.asarray(angle, dtype=np.float64)) % TWO_PI
    # just above an odd multiple of pi rounding gives -pi itself
    return np.where(wrapped <= -np.pi, np.pi, wrapped)[()]


def wrap_to_2pi(angle: ArrayLike) -> Any:
    """Wrap angles to [0, 2 pi).

    Parameters
    ----------
    angle : array_like
        Radians, any shape.

    Returns
    -------
    ndarray or float
        The same shape, in [0, 2 pi).
    """
    wrapped = np.asarray(angle, dtype=np.float64) % TWO_PI
    # a tiny negative angle rounds up to 2 pi itself
    return np.where(wrapped >= TWO_PI, 0.0, wrapped)[()]


def as_poses(poses: ArrayLike, name: str = "poses") -> FloatArray:
    """Check poses and return them as a contiguous ``(N, 3)`` float64 array.

    Parameters
    ----------
    poses : array_like of shape (N, 3) or (3,)
        ``[x, y, heading]`` in metres and radians.
    name : str
        What the error message calls them.

    Returns
    -------
    ndarray of shape (N, 3)

    Raises
    ------
    ValueError
        If the shape is another, or a value is not finite.
    """
    array = np.ascontiguousarray(np.atleast_2d(np.asarray(poses, dtype=np.float64)))
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name}: expected shape (N, 3) of [x, y, heading], got {array.shape}")
    with np.errstate(over="ignore", invalid="ignore"):
        total = array.sum()  # finite only if they all are, and made in half the time
    if not np.isfinite(total) and not np.isfinite(array).all():
        row = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
        raise ValueError(f"{name}: row {row} is not finite: {array[row]}")
    return array


def compose(pose_a_b: ArrayLike, pose_b_c: ArrayLike) -> FloatArray:
    """Compose poses: the pose of c in a from that of b in a and that of c in b.

    Parameters
    ----------
    pose_a_b, pose_b_c : array_like of shape (..., 3)
        ``[x, y, heading]``; they broadcast against each other.

    Returns
    -------
    ndarray of shape (..., 3)
        Heading in (-pi, pi].
    """
    a = np.asarray(pose_a_b, dtype=np.float64)
    b = np.asarray(pose_b_c, dtype=np.float64)
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + cos * b[..., 0] - sin * b[..., 1]
    y = a[..., 1] + sin * b[..., 0] + cos * b[..., 1]
    return np.stack([x, y, wrap_to_pi(a[..., 2] + b[..., 2])], axis=-1)


def inverse(pose_a_b: ArrayLike) -> FloatArray:
    """Invert poses: the pose of a in b from that of b in a.

    Parameters
    ----------
    pose_a_b : array_like of shape (..., 3)

    Returns
    -------
    ndarray of shape (..., 3)
    """
    a = np.asarray(pose_a_b, dtype=np.float64)
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = -cos * a[..., 0] - sin * a[..., 1]
    y = sin * a[..., 0] - cos * a[..., 1]
    return np.stack([x, y, wrap_to_pi(-a[..., 2])], axis=-1)


def relative_pose(pose_w_a: ArrayLike, pose_w_b: ArrayLike) -> FloatArray:
    """Give the pose of b in the frame of a, both known in one world frame.

    This is also the odometry between two stamps: the motion in the robot's own old frame.

    Parameters
    ----------
    pose_w_a, pose_w_b : array_like of shape (..., 3)

    Returns
    -------
    ndarray of shape (..., 3)
    """
    return compose(inverse(pose_w_a), pose_w_b)


def relative_headings(
    pose_w_l: ArrayLike, pose_w_r: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Give the two headings between views and their distance.

    ``heading_l`` (theta) is the direction from L to R in L's frame, ``heading_r`` (phi) the
    direction from R to L in R's frame (Booij et al. 2010, section II).

    Parameters
    ----------
    pose_w_l, pose_w_r : array_like of shape (..., 3)
        The reference views' and the query views' poses in the world; they broadcast.

    Returns
    -------
    heading_l, heading_r : ndarray
        Radians in [0, 2 pi). Where the distance is zero they are still such that
        ``rotation_from_headings`` gives the right rotation.
    distance : ndarray
        Metres.
    """
    left = np.asarray(pose_w_l, dtype=np.float64)
    right = np.asarray(pose_w_r, dtype=np.float64)
    dx = right[..., 0] - left[..., 0]
    dy = right[..., 1] - left[..., 1]
    direction = np.arctan2(dy, dx)
    heading_l = wrap_to_2pi(direction - left[..., 2])
    heading_r = wrap_to_2pi(direction + np.pi - right[..., 2])
    return heading_l, heading_r, np.hypot(dx, dy)


def rotation_from_headings(heading_l: ArrayLike, heading_r: ArrayLike) -> Any:
    """Give R's rotation relative to L: psi = theta - phi + pi.

    Parameters
    ----------
    heading_l, heading_r : array_like
        Radians.

    Returns
    -------
    ndarray or float
        Radians in (-pi, pi].
    """
    return wrap_to_pi(np.asarray(heading_l) - np.asarray(heading_r) + np.pi)


def bearing_vectors(azimuth: ArrayLike, elevation: ArrayLike) -> FloatArray:
    """Turn azimuth and elevation into unit vectors (x forward, y left, z up).

    Parameters
    ----------
    azimuth, elevation : array_like of shape (...)
        Radians.

    Returns
    -------
    ndarray of shape (..., 3)
    """
    a = np.asarray(azimuth, dtype=np.float64)
    b = np.asarray(elevation, dtype=np.float64)
    cos = np.cos(b)
    return np.stack([cos * np.cos(a), cos * np.sin(a), np.sin(b)], axis=-1)


def bearing_angles(vectors: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Turn vectors (of any length) into azimuth and elevation.

    Parameters
    ----------
    vectors : array_like of shape (..., 3)

    Returns
    -------
    azimuth : ndarray of shape (...)
        atan2(y, x), wrapped to [0, 2 pi).
    elevation : ndarray of shape (...)
        atan2(z, hypot(x, y)).
    """
    v = np.asarray(vectors, dtype=np.float64)
    azimuth = wrap_to_2pi(np.arctan2(v[..., 1], v[..., 0]))
    return azimuth, np.arctan2(v[..., 2], np.hypot(v[..., 0], v[..., 1]))


def circular_mean(angles: ArrayLike, weights: ArrayLike | None = None) -> float:
    """Give the circular mean of angles.

    Parameters
    ----------
    angles : array_like of shape (N,)
        Radians.
    weights : array_like of shape (N,), optional
        Not necessarily normalised.

    Returns
    -------
    float
        Radians in (-pi, pi].
    """
    a = np.asarray(angles, dtype=np.float64)
    w = np.ones_like(a) if weights is None else np.asarray(weights, dtype=np.float64)
    return float(np.arctan2(w @ np.sin(a), w @ np.cos(a)))
