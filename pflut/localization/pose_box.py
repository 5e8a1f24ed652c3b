"""A box around particles: which cells of a pair's grid they can be in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pflut._jit import jit
from pflut.geometry import TWO_PI, FloatArray


def _bounds(poses, out):  # type: ignore[no-untyped-def]
    """Write the least and the largest x, y and turn from the first pose's heading: O(N)."""
    left = right = poses[0, 0]
    bottom = top = poses[0, 1]
    start, least, largest = poses[0, 2], 0.0, 0.0
    for n in range(poses.shape[0]):
        x, y, turns = poses[n, 0], poses[n, 1], (poses[n, 2] - start) * (1.0 / TWO_PI)
        turns -= np.floor(turns + 0.5)
        left, right = min(left, x), max(right, x)
        bottom, top = min(bottom, y), max(top, y)
        least, largest = min(least, turns), max(largest, turns)
    out[0, 0], out[0, 1] = left, right
    out[1, 0], out[1, 1] = bottom, top
    out[2, 0], out[2, 1] = start + least * TWO_PI, start + largest * TWO_PI


# a minimum is vectorised where nothing is NaN, and poses are finite
_bounds = jit(_bounds, fastmath=True)


@dataclass(frozen=True, eq=False)
class PoseBox:
    """The smallest box around poses, seen from the first one's heading.

    Parameters
    ----------
    bounds : ndarray of shape (3, 2)
        The least and the largest x, y (metres) and heading (radians, around the first one's).
    """

    bounds: FloatArray

    @classmethod
    def around(cls, poses: FloatArray) -> PoseBox:
        """Make the box of poses.

        Parameters
        ----------
        poses : ndarray of shape (N, 3), N >= 1

        Returns
        -------
        PoseBox
        """
        bounds = np.empty((3, 2))
        _bounds(poses, bounds)
        return cls(bounds)

    def distances(self, points: FloatArray) -> FloatArray:
        """Give the distances (m,) of points (m, 2 or 3) to the box, metres; 0 in it."""
        outside = np.maximum(self.bounds[:2, 0] - points[:, :2], points[:, :2] - self.bounds[:2, 1])
        outside = np.maximum(outside, 0.0)
        return np.asarray(np.hypot(outside[:, 0], outside[:, 1]))

    def windows(self, references: FloatArray, bins: int) -> NDArray[np.int64]:
        """Say which cells of grids over (heading_l, heading_r) interpolation may ask for.

        Parameters
        ----------
        references : ndarray of shape (m, 3)
            The poses of the views L.
        bins : int
            Cells an axis.

        Returns
        -------
        ndarray of shape (m, 2, 2), int64
            First cell and number of cells of either heading, around the circle; all cells for a
            reference in the box.
        """
        (left, right), (bottom, top), (least, largest) = self.bounds
        x = np.array([[left, right, left, right, 0.5 * (left + right)]]) - references[:, :1]
        y = np.array([[bottom, bottom, top, top, 0.5 * (bottom + top)]]) - references[:, 1:2]
        # a box that the reference is not in is seen under less than half a turn
        seen = np.arctan2(y, x)
        middle = seen[:, -1:]
        beside = (seen - middle + np.pi) % TWO_PI - np.pi
        first, last = middle[:, 0] + beside.min(axis=1), middle[:, 0] + beside.max(axis=1)
        starts = np.stack([first - references[:, 2], first + np.pi - largest], axis=1)
        ends = np.stack([last - references[:, 2], last + np.pi - least], axis=1)
        # the cells' centres on either side, and one for what rounding does
        start = np.floor(starts * (bins / TWO_PI) - 0.5).astype(np.int64) - 1
        end = np.floor(ends * (bins / TWO_PI) - 0.5).astype(np.int64) + 3
        windows = np.stack([start % bins, np.minimum(end - start, bins)], axis=2)
        windows[self.distances(references) <= 0.0] = [0, bins]
        return windows
