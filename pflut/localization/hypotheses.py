"""All places where the robot may be: the clusters of the particles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pflut.geometry import FloatArray, wrap_to_pi
from pflut.localization.estimate import heaviest_cluster


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


def find_hypotheses(
    poses: FloatArray, weights: FloatArray, *, max_count: int = 5, min_weight: float = 0.05
) -> list[Hypothesis]:
    """Take cluster after cluster out of the particles, the heaviest first.

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
    left = weights.copy()
    found: list[Hypothesis] = []
    while len(found) < max_count and left.sum() >= min_weight:
        share, pose, covariance, radius, angle = heaviest_cluster(poses, left)
        if share < min_weight:
            break
        offset = poses - pose
        near = np.hypot(offset[:, 0], offset[:, 1]) <= radius
        left[near & (np.abs(wrap_to_pi(offset[:, 2])) <= angle)] = 0.0
        pose[2] = wrap_to_pi(pose[2])
        found.append(Hypothesis(pose, covariance, min(share, 1.0)))
    return sorted(found, key=lambda hypothesis: -hypothesis.weight)
