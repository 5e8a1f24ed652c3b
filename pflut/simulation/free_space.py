"""Where a robot can be: a grid of clearances."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.geometry import FloatArray
from pflut.simulation.layout import DEPTH, PARTITION, WIDTH, Opening, Room

RESOLUTION = 0.05  # metres a cell
MARGIN = 0.5  # metres of outside around the flat
REACHABLE = 0.97  # share of the free floor that furniture must not cut off
SHIFT = 4  # fractional bits of cv2.fillConvexPoly


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """How far each place is from walls and furniture.

    Attributes
    ----------
    clearance : ndarray of shape (rows, columns)
        Metres to the nearest obstacle, 0 inside obstacles; row 0 is at ``origin``'s y.
    origin : ndarray of shape (2,)
        World position of the center of cell (0, 0).
    resolution : float
        Metres a cell.
    """

    clearance: FloatArray
    origin: FloatArray
    resolution: float

    def cells(self, points: ArrayLike) -> NDArray[np.int64]:
        """Give the (row, column) of the cells that points (n, 2) lie in, clamped to the grid."""
        position = (np.asarray(points, dtype=np.float64) - self.origin) / self.resolution
        rows, columns = self.clearance.shape
        indices = np.rint(position).astype(np.int64)
        return np.stack(
            [np.clip(indices[:, 1], 0, rows - 1), np.clip(indices[:, 0], 0, columns - 1)], axis=1
        )

    def points(self, cells: ArrayLike) -> FloatArray:
        """Give the world positions (..., 2) of the centers of cells (row, column)."""
        array = np.asarray(cells, dtype=np.float64)
        return np.asarray(self.origin + self.resolution * array[..., ::-1])

    def at(self, points: ArrayLike) -> FloatArray:
        """Give the clearance at points (n, 2) in metres, of the nearest cell."""
        row, column = self.cells(points).T
        return np.asarray(self.clearance[row, column])

    @classmethod
    def from_occupied(cls, occupied: NDArray[np.bool_]) -> FreeSpace:
        """Measure the clearances of a grid of obstacles made by ``occupied_by_walls``."""
        distance = cv2.distanceTransform((~occupied).astype(np.uint8), cv2.DIST_L2, 5)
        clearance = RESOLUTION * distance.astype(np.float64)
        return cls(clearance, np.full(2, -MARGIN + 0.5 * RESOLUTION), RESOLUTION)


def occupied_by_walls(rooms: tuple[Room, ...], openings: tuple[Opening, ...]) -> NDArray[np.bool_]:
    """Mark everything that is no room and no doorway.

    Returns
    -------
    ndarray of shape (rows, columns) bool
    """
    shape = (round((DEPTH + 2 * MARGIN) / RESOLUTION), round((WIDTH + 2 * MARGIN) / RESOLUTION))
    free = np.zeros(shape, dtype=bool)
    for room in rooms:
        free |= rectangle_mask(shape, (room.x0, room.y0), (room.x1, room.y1))
    for opening in openings:
        if opening.is_door:
            x, y, yaw, _ = rooms[opening.room].side(opening.side)
            along = np.array([np.cos(yaw), np.sin(yaw)])
            out = np.array([-along[1], along[0]]) * PARTITION
            corners = np.array([x, y]) + np.array(
                [
                    opening.start * along,
                    opening.end * along,
                    opening.end * along + out,
                    opening.start * along + out,
                ]
            )
            free |= rectangle_mask(shape, tuple(corners.min(axis=0)), tuple(corners.max(axis=0)))
    return ~free


def free_space_of_walls(rooms: tuple[Room, ...], openings: tuple[Opening, ...]) -> FreeSpace:
    """Measure the clearances of an empty home."""
    return FreeSpace.from_occupied(occupied_by_walls(rooms, openings))


def rectangle_mask(
    shape: tuple[int, ...], low: tuple[float, float], high: tuple[float, float]
) -> NDArray[np.bool_]:
    """Mark the cells whose centers lie in an upright rectangle."""
    y, x = ((np.arange(n) + 0.5) * RESOLUTION - MARGIN for n in shape)
    slack = 1e-9
    inside_x = (x > low[0] - slack) & (x < high[0] + slack)
    inside_y = (y > low[1] - slack) & (y < high[1] + slack)
    return np.asarray(inside_y[:, None] & inside_x[None])


def footprint_mask(shape: tuple[int, ...], footprint: ArrayLike) -> NDArray[np.bool_]:
    """Mark the cells that a turned rectangle touches.

    Parameters
    ----------
    shape : tuple
        Of the grid.
    footprint : array_like of shape (5,)
        x and y of the center, yaw, half the length and half the width.
    """
    x, y, yaw, half_x, half_y = np.asarray(footprint, dtype=np.float64)
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    local = signs * [half_x, half_y]
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    corners = local @ turn.T + [x, y]
    cells = (corners + MARGIN) / RESOLUTION - 0.5
    mask = np.zeros(shape, dtype=np.uint8)
    cv2.fillConvexPoly(mask, np.rint(cells * 2**SHIFT).astype(np.int32), 1, shift=SHIFT)
    return mask.astype(bool)


def is_connected(occupied: NDArray[np.bool_], places: FloatArray, radius: float) -> bool:
    """Say whether a robot of a radius can go from any of the places (n, 2) to any other.

    It must also reach nearly all of the floor that has room for it.
    """
    space = FreeSpace.from_occupied(occupied)
    _, labels = cv2.connectedComponents((space.clearance > radius).astype(np.uint8), connectivity=4)
    row, column = space.cells(places).T
    found = np.unique(labels[row, column])
    if found.size != 1 or found[0] == 0:
        return False
    return bool((labels == found[0]).sum() >= REACHABLE * (labels > 0).sum())
