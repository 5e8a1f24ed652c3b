"""A furnished flat, generated from a seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.geometry import FloatArray
from pflut.simulation.changes import Changes
from pflut.simulation.free_space import (
    FreeSpace,
    footprint_mask,
    free_space_of_walls,
    occupied_by_walls,
)
from pflut.simulation.furnishing import Furnisher
from pflut.simulation.layout import Opening, Room, plan_flat
from pflut.simulation.scene import Scene, SceneBuilder
from pflut.simulation.stock import Stock, make_stock
from pflut.simulation.walls import build_view, build_walls, wall_segments


@dataclass(frozen=True, eq=False)
class Home:
    """A furnished flat.

    Attributes
    ----------
    seed : int
    rearrangement : int
        0: as it was mapped. Another number: the same home on another day, with about half of
        what people move about (small objects, chairs, rugs, curtains, covers) moved or exchanged.
    rooms : tuple of Room
    openings : tuple of Opening
        Doors (twice, once in the wall of each room) and windows.
    scene : Scene
    stock : Stock
        The materials, for what is added later.
    footprints : ndarray of shape (m, 5)
        What stands on the floor: x and y of the center, yaw, half the length, half the width.
    walls : ndarray of shape (s, 2, 2)
        The walls' faces seen from above, without the doors: start and end of each.
    """

    seed: int
    rearrangement: int
    rooms: tuple[Room, ...]
    openings: tuple[Opening, ...]
    scene: Scene
    stock: Stock
    footprints: FloatArray
    walls: FloatArray

    @classmethod
    def generate(cls, seed: int, *, rearrangement: int = 0) -> Home:
        """Build a home.

        Parameters
        ----------
        seed : int
            Not negative; decides everything.
        rearrangement : int
            Which day it is: 0 is the day of the mapping.

        Returns
        -------
        Home

        Raises
        ------
        ValueError
            If a number is no integer or negative.
        """
        check_seed(seed, "seed")
        check_seed(rearrangement, "rearrangement")
        rng = np.random.default_rng([seed, 1])
        rooms, openings = plan_flat(rng)
        builder = SceneBuilder()
        stock = make_stock(builder, rng)
        changes = Changes(int(seed), int(rearrangement))
        build_walls(builder, stock, rooms, openings, rng, changes)
        build_view(builder, stock)
        furnisher = Furnisher(builder, stock, rooms, openings, rng, changes)
        furnisher.furnish()
        return cls(
            seed,
            rearrangement,
            rooms,
            openings,
            builder.finish(),
            stock,
            np.array(furnisher.footprints).reshape(-1, 5),
            wall_segments(rooms, openings),
        )


def check_seed(value: object, name: str) -> None:
    """Refuse what is no integer >= 0.

    Raises
    ------
    ValueError
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0:
        raise ValueError(f"{name}: expected an integer >= 0, got {value!r}")


def free_space(home: Home) -> FreeSpace:
    """Measure where in a home a robot can be.

    Parameters
    ----------
    home : Home

    Returns
    -------
    FreeSpace
        Walls and everything that stands on the floor are obstacles.
    """
    occupied = occupied_by_walls(home.rooms, home.openings)
    for footprint in home.footprints:
        occupied |= footprint_mask(occupied.shape, footprint)
    return FreeSpace.from_occupied(occupied)


def is_inside(home: Home, x: float, y: float) -> bool:
    """Say whether a point is in a room or a doorway of a home, not in a wall or outside."""
    space = free_space_of_walls(home.rooms, home.openings)
    return bool(space.at([[x, y]])[0] > 0.0)


def rooms_at(home: Home, points: ArrayLike) -> NDArray[np.intp]:
    """Say which rooms points are in.

    Parameters
    ----------
    home : Home
    points : array_like of shape (n, 2) or (n, 3)
        ``[x, y]`` in metres; a third column is ignored.

    Returns
    -------
    ndarray of shape (n,), int
        Indices of ``home.rooms``; of a point in a doorway the nearest room's.
    """
    x, y = np.asarray(points, dtype=np.float64)[:, :2].T[:, :, None]
    x0, y0, x1, y1 = np.array([(r.x0, r.y0, r.x1, r.y1) for r in home.rooms]).T
    outside = np.hypot(x - np.clip(x, x0, x1), y - np.clip(y, y0, y1))
    return np.asarray(np.argmin(outside, axis=1))
