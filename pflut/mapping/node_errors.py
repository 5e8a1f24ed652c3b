"""How wrong localization in a topological map is: the most probable nodes beside the true poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.geometry import FloatArray
from pflut.mapping.node_localizer import NodeEstimate
from pflut.mapping.topological_map import TopologicalMap

NEAR = 1.0
"""Metres within which a node counts as right."""
SURE = 0.9
"""Probability above which an estimate counts as sure."""


@dataclass(frozen=True, eq=False, kw_only=True)
class NodeErrors:
    """Estimates of a robot in a topological map, n of them, judged by true poses.

    A node says where an image of the map was taken, not where the robot is. The nearest node may
    stand behind a wall: walls are not looked at.

    Parameters
    ----------
    nearest : ndarray of shape (n,), int
        The node nearest to the true position; -1 where that is not known.
    nearest_distance : ndarray of shape (n,)
        Metres from the true position to that node, NaN where it is not known.
    distance : ndarray of shape (n,)
        Metres to the most probable node, NaN where one of the two positions is not known.
    place_right : ndarray of shape (n,), bool
        Whether the most probable place is that of the nearest node.
    probability, place_probability : ndarray of shape (n,)
        Of the most probable node and place.
    """

    nearest: NDArray[np.int64]
    nearest_distance: FloatArray
    distance: FloatArray
    place_right: NDArray[np.bool_]
    probability: FloatArray
    place_probability: FloatArray

    @classmethod
    def of(
        cls,
        topological_map: TopologicalMap,
        estimates: Sequence[NodeEstimate],
        nodes: ArrayLike,
        ground_truth: ArrayLike,
    ) -> NodeErrors:
        """Judge estimates.

        Parameters
        ----------
        topological_map : TopologicalMap
            Of N nodes.
        estimates : sequence of n NodeEstimate
        nodes : array_like of shape (N, 3)
            True poses of the nodes; NaN rows where they are not known.
        ground_truth : array_like of shape (n, 3)
            True poses of the robot in the same frame; NaN rows where they are not known.

        Returns
        -------
        NodeErrors
        """
        at = np.asarray(nodes, dtype=np.float64)[:, :2]
        robot = np.asarray(ground_truth, dtype=np.float64)[:, :2]
        away = np.hypot(*(robot[:, None] - at).transpose(2, 0, 1))
        found = np.array([estimate.node for estimate in estimates], dtype=np.int64)
        known = np.isfinite(away).any(axis=1)
        nearest = np.where(known, np.nan_to_num(away, nan=np.inf).argmin(axis=1), -1)
        steps = np.arange(len(found))
        place = np.array([estimate.place for estimate in estimates], dtype=np.int64)
        return cls(
            nearest=nearest,
            nearest_distance=np.where(known, away[steps, nearest], np.nan),
            distance=away[steps, found],
            place_right=known & (place == topological_map.places[nearest]),
            probability=np.array([estimate.probability for estimate in estimates]),
            place_probability=np.array([estimate.place_probability for estimate in estimates]),
        )

    @property
    def near(self) -> NDArray[np.bool_]:
        """Whether the most probable node is within a metre of the true position, shape (n,)."""
        return np.asarray(self.distance <= NEAR)

    def as_dict(self) -> dict[str, float]:
        """Return what there is to know of the images whose truth is known, for a JSON file.

        Returns
        -------
        dict
            Shares in [0, 1], distances in metres, and numbers of images; of no image, those alone.
        """
        judged, placed = np.isfinite(self.distance), self.nearest >= 0
        sure = judged & (self.probability > SURE)
        sure_place = placed & (self.place_probability > SURE)
        found: dict[str, float] = {
            "judged": int(judged.sum()),
            "sure": int(sure.sum()),
            "sure_and_wrong": int((sure & ~self.near).sum()),
            "place_sure": int(sure_place.sum()),
            "place_sure_and_wrong": int((sure_place & ~self.place_right).sum()),
        }
        if not judged.any():
            return found
        distance, least = self.distance[judged], self.nearest_distance[judged]
        return found | {
            "nearest_node": float((distance <= least).mean()),
            "near_node": float(self.near[judged].mean()),
            "place": float(self.place_right[placed].mean()),
            "distance_median_m": float(np.median(distance)),
            "distance_90_m": float(np.quantile(distance, 0.9)),
            "nearest_distance_median_m": float(np.median(least)),
        }
