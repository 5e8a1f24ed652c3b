"""What the nodes of a pose graph leave unexplained, with derivatives: odometry and headings."""

from __future__ import annotations

import numpy as np

from pflut.geometry import FloatArray, wrap_to_pi
from pflut.mapping.pose_graph import IndexArray

MIN_DISTANCE = 1e-3
"""Metres; the direction between nodes that are nearer is not followed any further."""


def odometry_residuals(
    poses: FloatArray, nodes: IndexArray, motions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compare motions between nodes with the measured ones.

    The residual is the pose that the node has in the frame where odometry puts it: that of g2o's
    ``EDGE_SE2`` and of GTSAM's ``BetweenFactorPose2``.

    Parameters
    ----------
    poses : ndarray of shape (n, 3)
    nodes : ndarray of shape (k, 2), int
    motions : ndarray of shape (k, 3)

    Returns
    -------
    residuals : ndarray of shape (k, 3)
        Metres, metres, radians in (-pi, pi].
    jacobians : ndarray of shape (k, 3, 6)
        With respect to both nodes' ``[x, y, heading]``.
    """
    before, after = poses[nodes[:, 0]], poses[nodes[:, 1]]
    offset = after[:, :2] - before[:, :2]
    cos, sin = np.cos(before[:, 2]), np.sin(before[:, 2])
    dx = cos * offset[:, 0] + sin * offset[:, 1] - motions[:, 0]
    dy = -sin * offset[:, 0] + cos * offset[:, 1] - motions[:, 1]
    turn_cos, turn_sin = np.cos(motions[:, 2]), np.sin(motions[:, 2])
    residuals = np.stack(
        [
            turn_cos * dx + turn_sin * dy,
            -turn_sin * dx + turn_cos * dy,
            wrap_to_pi(after[:, 2] - before[:, 2] - motions[:, 2]),
        ],
        axis=1,
    )
    # the rotation from the world into the frame where odometry puts the node
    angle = before[:, 2] + motions[:, 2]
    c, s = np.cos(angle), np.sin(angle)
    jacobians = np.zeros((len(nodes), 3, 6))
    jacobians[:, 0, 3], jacobians[:, 0, 4] = c, s
    jacobians[:, 1, 3], jacobians[:, 1, 4] = -s, c
    jacobians[:, :2, :2] = -jacobians[:, :2, 3:5]
    jacobians[:, 0, 2] = -s * offset[:, 0] + c * offset[:, 1]
    jacobians[:, 1, 2] = -c * offset[:, 0] - s * offset[:, 1]
    jacobians[:, 2, 2], jacobians[:, 2, 5] = -1.0, 1.0
    return residuals, jacobians


def headings(poses: FloatArray, nodes: IndexArray) -> tuple[FloatArray, FloatArray]:
    """Give the two headings between nodes.

    Parameters
    ----------
    poses : ndarray of shape (n, 3)
    nodes : ndarray of shape (m, 2), int
        L and R.

    Returns
    -------
    headings : ndarray of shape (m, 2)
        ``[heading_l, heading_r]``, radians.
    jacobians : ndarray of shape (m, 2, 6)
        With respect to both nodes' ``[x, y, heading]``.
    """
    left, right = poses[nodes[:, 0]], poses[nodes[:, 1]]
    dx, dy = (right[:, :2] - left[:, :2]).T
    direction = np.arctan2(dy, dx)
    values = np.stack([direction - left[:, 2], direction + np.pi - right[:, 2]], axis=1)
    squared = np.maximum(dx**2 + dy**2, MIN_DISTANCE**2)
    jacobians = np.zeros((len(nodes), 2, 6))
    jacobians[:, :, 3] = (-dy / squared)[:, None]
    jacobians[:, :, 4] = (dx / squared)[:, None]
    jacobians[:, :, :2] = -jacobians[:, :, 3:5]
    jacobians[:, 0, 2] = jacobians[:, 1, 5] = -1.0
    return values, jacobians


def chords(angles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Give ``2 sin(a / 2)`` of angles, and its derivative.

    Half its square is ``1 - cos a``: least squares of chords are von Mises distributions, where
    those of angles would be normal ones that know of no turn.

    Parameters
    ----------
    angles : ndarray
        Radians, any number of turns.

    Returns
    -------
    chords, derivatives : ndarray
        Of the same shape.
    """
    half = 0.5 * wrap_to_pi(angles)
    return 2.0 * np.sin(half), np.cos(half)
