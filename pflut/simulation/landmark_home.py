"""Homes of landmarks: a rendered home's plan and furniture, or a corridor, without pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Literal

import numpy as np

from pflut.geometry import FloatArray
from pflut.simulation.corridor import (
    corridor_landmarks,
    corridor_outline,
    plan_corridor_drive,
    plan_corridor_mapping,
)
from pflut.simulation.drive import Drive, plan_mapping_drive, plan_test_drive
from pflut.simulation.home import Home, check_seed, free_space
from pflut.simulation.landmarks import LandmarkBuilder, Landmarks, scatter
from pflut.simulation.layout import CEILING, DEPTH, WIDTH

WALL_DENSITY = 14.0  # landmarks a metre, on the average; some walls are bare
FACE_DENSITY = 22.0  # landmarks a square metre of furniture
FRAME_LANDMARKS = 8  # on the frame of a door
FRAME = 0.08  # metres: its width
SKIRTING = 0.1  # metres: below it there are no landmarks

Plan = Literal["home", "corridor"]


@dataclass(frozen=True, eq=False)
class LandmarkHome:
    """Walls, landmarks, and the drive that mapped them.

    Make it with ``landmark_home``.

    Attributes
    ----------
    plan : {"home", "corridor"}
    seed : int
    bounds : tuple (xmin, ymin, xmax, ymax)
        Metres, inside the outer walls.
    walls : ndarray of shape (s, 2, 2)
        Start and end of the segments that nobody sees through, metres.
    landmarks : Landmarks
    mapping : Drive
        Through all of it.
    plan_drive : callable
        ``(rng=Generator) -> Drive``, a test drive of about 17 m.
    """

    plan: Plan
    seed: int
    bounds: tuple[float, float, float, float]
    walls: FloatArray
    landmarks: Landmarks
    mapping: Drive
    plan_drive: Callable[..., Drive]


@lru_cache(maxsize=64, typed=True)
def landmark_home(plan: Plan = "home", seed: int = 0) -> LandmarkHome:
    """Make a home of landmarks; the last ones are remembered.

    Parameters
    ----------
    plan : {"home", "corridor"}
        "home" is the flat that the rendered home of this seed has, with the same furniture.
        "corridor" is eight segments that look the same, and two ends that do not.
    seed : int
        Not negative.

    Returns
    -------
    LandmarkHome

    Raises
    ------
    ValueError
        If the plan is another or the seed is none.
    """
    check_seed(seed, "seed")
    rng = np.random.default_rng([seed, 10])
    if plan == "corridor":
        walls, bounds = corridor_outline()
        landmarks = corridor_landmarks(np.random.default_rng([seed, 31]))
        mapping = plan_corridor_mapping(rng)
        return LandmarkHome(plan, seed, bounds, walls, landmarks, mapping, plan_corridor_drive)
    if plan != "home":
        raise ValueError(f"plan: expected 'home' or 'corridor', got {plan!r}")
    home = Home.generate(seed)
    space = free_space(home)
    return LandmarkHome(
        plan,
        seed,
        (0.0, 0.0, WIDTH, DEPTH),
        home.walls,
        home_landmarks(home, np.random.default_rng([seed, 31])),
        plan_mapping_drive(space, rng=rng),
        partial(plan_test_drive, space),
    )


def home_landmarks(home: Home, rng: np.random.Generator) -> Landmarks:
    """Put landmarks on the walls and the furniture of a home.

    Door frames look alike, and so do pieces of furniture of the same size.

    Parameters
    ----------
    home : Home
    rng : Generator

    Returns
    -------
    Landmarks
    """
    builder = LandmarkBuilder([])
    for number, room in enumerate(home.rooms):
        for side in range(4):
            x, y, yaw, length = room.side(side)
            holes = [o for o in home.openings if (o.room, o.side) == (number, side)]
            count = int(rng.poisson(WALL_DENSITY * length * rng.uniform(0.3, 1.7)))
            pattern = scatter(rng, count, length, SKIRTING, CEILING)
            for hole in holes:
                inside = (pattern[:, 0] > hole.start - FRAME) & (pattern[:, 0] < hole.end + FRAME)
                inside &= (pattern[:, 1] > hole.bottom) & (pattern[:, 1] < hole.top)
                pattern = pattern[~inside]
            builder.add(pattern, (x, y), yaw)
    _frame_doors(builder, home, rng)
    _cover_furniture(builder, home.footprints, rng)
    return builder.finish()


def _frame_doors(builder: LandmarkBuilder, home: Home, rng: np.random.Generator) -> None:
    """Put the same landmarks on the frames of all doors."""
    doors = [opening for opening in home.openings if opening.is_door]
    looks = builder.new_looks(FRAME_LANDMARKS)
    pattern = scatter(rng, FRAME_LANDMARKS, 2.0 * FRAME, SKIRTING, doors[0].top)
    right = pattern[:, 0] > FRAME  # of the middle: the other jamb
    for door in doors:
        x, y, yaw, _ = home.rooms[door.room].side(door.side)
        shifted = pattern.copy()
        shifted[:, 0] += np.where(right, door.end - FRAME, door.start - FRAME)
        builder.add(shifted, (x, y), yaw, looks)


def _cover_furniture(
    builder: LandmarkBuilder, footprints: FloatArray, rng: np.random.Generator
) -> None:
    """Put landmarks on the four sides of each piece; pieces of a size get the same."""
    sizes, kinds = np.unique(np.round(footprints[:, 3:], 2), axis=0, return_inverse=True)
    for kind, (half_x, half_y) in enumerate(sizes):
        height = float(rng.uniform(0.4, 2.0))
        faces = []
        for length in (2.0 * half_x, 2.0 * half_y, 2.0 * half_x, 2.0 * half_y):
            count = int(rng.poisson(FACE_DENSITY * length * (height - SKIRTING)))
            pattern = scatter(rng, count, length, SKIRTING, height)
            faces.append((pattern, builder.new_looks(count)))
        for x, y, yaw, *_ in footprints[kinds.ravel() == kind]:
            # counter-clockwise: the outside is to the right
            for turn, (pattern, looks) in enumerate(faces):
                direction = yaw + 0.5 * np.pi * turn
                along, out = (half_x, half_y) if turn % 2 == 0 else (half_y, half_x)
                cos, sin = np.cos(direction), np.sin(direction)
                start = (x - along * cos + out * sin, y - along * sin - out * cos)
                builder.add(pattern, start, direction, looks)
