"""The motion of a robot over a topological map: it stays, or goes along links."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import FloatArray
from pflut.localization.motion import as_odometry
from pflut.mapping.topological_map import TopologicalMap

REST = 1e-12
"""Probability of so many hops that they are left out."""
MAX_HOPS = 10_000
"""Expected ones count as that many: a walk over any map that fits here has long spread by then."""


@dataclass(frozen=True, kw_only=True)
class NodeWalk:
    """A walk over the nodes of a map: Poisson many hops, each along one of a node's links.

    A map of images knows no distances, so odometry says how many hops are to be expected, not
    which. A hop takes a link as often as it is probable; a node without links is not left.

    Parameters
    ----------
    hops : float
        Expected between two images, where there is no odometry.
    hop_length : float
        Metres that a hop takes, where there is: about the distance of images that are next to each
        other, or half of that within which they are linked.
    carried_away : float
        In [0, 1): probability that the robot is at any of the nodes, all as probable, whatever was
        known before: one that was carried away, or went a way that no link shows.

    Raises
    ------
    ValueError
        If a parameter is out of its range.
    """

    hops: float = 0.5
    hop_length: float = 1.0
    carried_away: float = 0.001

    def __post_init__(self) -> None:
        if not 0.0 <= self.hops < np.inf:
            raise ValueError(f"hops: expected a number >= 0, got {self.hops}")
        if not 0.0 < self.hop_length < np.inf:
            raise ValueError(f"hop_length: expected positive metres, got {self.hop_length}")
        if not 0.0 <= self.carried_away < 1.0:
            raise ValueError(f"carried_away: expected in [0, 1), got {self.carried_away}")

    def expected_hops(self, odometry: ArrayLike | None = None) -> float:
        """Say how many hops a motion takes on average.

        Parameters
        ----------
        odometry : array_like of shape (3,), optional
            ``[dx, dy, dheading]``, the motion in the robot's own old frame, metres and radians.

        Returns
        -------
        float
        """
        if odometry is None:
            return self.hops
        dx, dy, _ = as_odometry(odometry)
        return float(np.hypot(dx, dy)) / self.hop_length

    def predict(
        self,
        topological_map: TopologicalMap,
        probabilities: FloatArray,
        odometry: ArrayLike | None = None,
    ) -> FloatArray:
        """Move the probabilities of nodes.

        Parameters
        ----------
        topological_map : TopologicalMap
            Of N nodes.
        probabilities : ndarray of shape (N,)
            They sum to one.
        odometry : array_like of shape (3,), optional
            See `expected_hops`.

        Returns
        -------
        ndarray of shape (N,)

        Raises
        ------
        ValueError
            If the odometry is not three finite numbers.
        """
        first, second = topological_map.edges.T
        count, likely = len(topological_map), topological_map.probability
        leaving = np.bincount(first, likely, count) + np.bincount(second, likely, count)
        linked = leaving > 0.0

        shares = _poisson(min(self.expected_hops(odometry), MAX_HOPS))
        walked, moved = probabilities, shares[0] * probabilities
        for share in shares[1:]:
            along = np.divide(walked, leaving, out=np.zeros(count), where=linked)
            walked = np.where(linked, 0.0, walked)
            walked += np.bincount(second, likely * along[first], count)
            walked += np.bincount(first, likely * along[second], count)
            moved = moved + share * walked
        moved = moved / moved.sum()
        return np.asarray((1.0 - self.carried_away) * moved + self.carried_away / count)


def _poisson(expected: float) -> FloatArray:
    """Give the probabilities of 0, 1, ... hops, up to the last that is not negligible."""
    hops = np.arange(1, int(expected + 9.0 * np.sqrt(expected)) + 20)
    # in logarithms: exp(-expected) is zero from 745 on
    with np.errstate(divide="ignore"):
        logs = np.cumsum(np.concatenate([[-expected], np.log(expected / hops)]))
    shares = np.exp(logs)
    return np.asarray(shares[: np.flatnonzero(shares > REST)[-1] + 1])
