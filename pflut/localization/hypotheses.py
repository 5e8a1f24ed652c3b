"""All places where the robot may be: the clusters of the particles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pflut._jit import jit
from pflut.geometry import TWO_PI, FloatArray, wrap_to_pi
from pflut.localization.estimate import Cluster, heaviest_cluster


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A place where the robot may be.

    Parameters
    ----------
    pose : ndarray of shape (3,)
        ``[x, y, heading]``, the mean of the particles there; heading in (-pi, pi].
    covariance : ndarray of shape (3, 3)
        Of these particles, differences of headings wrapped: a cluster around a heading of pi is as
        narrow as any other.
    weight : float
        Their share of the weight, in (0, 1].
    """

    pose: FloatArray
    covariance: FloatArray
    weight: float


@jit
def _claim(
    poses: FloatArray,
    center: FloatArray,
    radius: float,
    angle: float,
    number: int,
    owners: NDArray[np.int64],
    left: FloatArray,
) -> None:
    """Give a window's particles that nobody owns to a cluster, and take their weight: O(N)."""
    for i in range(owners.size):
        x = poses[i, 0] - center[0]
        y = poses[i, 1] - center[1]
        h = poses[i, 2] - center[2]
        h -= TWO_PI * np.rint(h * (1.0 / TWO_PI))
        if owners[i] < 0 and x * x + y * y <= radius * radius and abs(h) <= angle:
            owners[i] = number
            left[i] = 0.0


def take_clusters(
    poses: FloatArray, weights: FloatArray, *, max_count: int, least: float
) -> tuple[list[Cluster], NDArray[np.int64]]:
    """Take cluster after cluster out of the particles, the heaviest first.

    Parameters
    ----------
    poses : ndarray of shape (N, 3)
        float64, contiguous, finite.
    weights : ndarray of shape (N,)
        Their sum is one.
    max_count : int
        At most so many.
    least : float
        Of the weight: less is no cluster.

    Returns
    -------
    clusters : list of Cluster
    owners : ndarray of shape (N,), int64
        Which one each particle belongs to, -1 for none.
    """
    left, owners = weights.copy(), np.full(len(weights), -1, dtype=np.int64)
    found: list[Cluster] = []
    while len(found) < max_count and left.sum() >= least:
        cluster = heaviest_cluster(poses, left)
        if cluster.share < least:
            break
        _claim(poses, cluster.pose, cluster.radius, cluster.angle, len(found), owners, left)
        found.append(cluster)
    return found, owners


def find_hypotheses(
    poses: FloatArray, weights: FloatArray, *, max_count: int = 5, min_weight: float = 0.05
) -> list[Hypothesis]:
    """Give all places where the robot may be, the heaviest first.

    Parameters
    ----------
    poses : ndarray of shape (N, 3)
        float64, contiguous, finite.
    weights : ndarray of shape (N,)
        Their sum is one.
    max_count : int
        At most so many.
    min_weight : float
        In (0, 1): less is no hypothesis, but a chance neighbourhood of a robot that is lost.

    Returns
    -------
    list of Hypothesis
        Their weights sum to one at most; what is missing lies scattered.

    Raises
    ------
    ValueError
        If an option is out of its range.
    """
    if max_count < 1:
        raise ValueError(f"max_count: expected at least 1, got {max_count}")
    if not 0.0 < min_weight < 1.0:
        raise ValueError(f"min_weight: expected in (0, 1), got {min_weight}")
    clusters, _ = take_clusters(poses, weights, max_count=max_count, least=min_weight)
    found = []
    for share, pose, covariance, _, _ in clusters:
        wrapped = np.array([pose[0], pose[1], wrap_to_pi(pose[2])])
        found.append(Hypothesis(wrapped, covariance, min(share, 1.0)))
    return sorted(found, key=lambda hypothesis: -hypothesis.weight)
