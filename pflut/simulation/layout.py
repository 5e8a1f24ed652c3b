"""The plan of a flat: rooms, doors and windows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

WIDTH, DEPTH = 10.0, 8.0  # of the whole flat, metres
CEILING = 2.6
PARTITION = 0.12  # thickness of a wall between rooms
OUTER = 0.3
DOOR_WIDTH, DOOR_HEIGHT = 0.95, 2.08


@dataclass(frozen=True)
class Room:
    """A rectangular room, inside its walls.

    Parameters
    ----------
    kind : str
        "living", "kitchen", "bedroom", "study" or "bathroom".
    x0, y0, x1, y1 : float
        Metres.
    """

    kind: str
    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def area(self) -> float:
        """Square metres."""
        return (self.x1 - self.x0) * (self.y1 - self.y0)

    def side(self, number: int) -> tuple[float, float, float, float]:
        """Give a wall's frame: where it starts, its direction in radians and its length.

        Walls 0 to 3 are south, west, north, east. Along the direction the room lies to the
        right.
        """
        starts = [(self.x1, self.y0), (self.x0, self.y0), (self.x0, self.y1), (self.x1, self.y1)]
        yaw = [np.pi, 0.5 * np.pi, 0.0, -0.5 * np.pi][number]
        length = self.x1 - self.x0 if number % 2 == 0 else self.y1 - self.y0
        return (*starts[number], float(yaw), length)


@dataclass(frozen=True)
class Opening:
    """A door or a window in one wall of a room.

    Parameters
    ----------
    room, side : int
        Which wall.
    start, end : float
        Along the wall's frame in metres.
    bottom, top : float
        Heights in metres.
    is_door : bool
        Whether a robot can pass.
    """

    room: int
    side: int
    start: float
    end: float
    bottom: float
    top: float
    is_door: bool


def plan_flat(rng: np.random.Generator) -> tuple[tuple[Room, ...], tuple[Opening, ...]]:
    """Divide a flat into four to six rooms, connect them by doors and give them windows.

    Parameters
    ----------
    rng : Generator

    Returns
    -------
    rooms : tuple of Room
    openings : tuple of Opening
        A door between two rooms appears twice, once in the wall of each.
    """
    while True:
        cells = _divide(rng, int(rng.integers(4, 7)))
        doors = _connect(rng, cells)
        if doors is not None:
            break
    kinds = _kinds(rng, cells)
    half = 0.5 * PARTITION
    rooms = tuple(
        Room(
            kind,
            x0 + (half if x0 > 0.0 else 0.0),
            y0 + (half if y0 > 0.0 else 0.0),
            x1 - (half if x1 < WIDTH else 0.0),
            y1 - (half if y1 < DEPTH else 0.0),
        )
        for kind, (x0, y0, x1, y1) in zip(kinds, cells, strict=True)
    )
    openings = [
        _opening(rooms, room, side, center, DOOR_WIDTH, 0.0, DOOR_HEIGHT)
        for a, b, vertical, center in doors
        for room, side in (
            (a, (3 if vertical else 2)),
            (b, (1 if vertical else 0)),
        )
    ]
    for number, room in enumerate(rooms):
        openings += _windows(rng, rooms, number, room)
    return rooms, tuple(openings)


Cell = tuple[float, float, float, float]


def _divide(rng: np.random.Generator, count: int) -> list[Cell]:
    """Split the flat's rectangle until there are ``count`` cells; the largest goes first."""
    cells: list[Cell] = [(0.0, 0.0, WIDTH, DEPTH)]
    while len(cells) < count:
        cells.sort(key=lambda c: (c[2] - c[0]) * (c[3] - c[1]), reverse=True)
        x0, y0, x1, y1 = cells.pop(0)
        share = float(rng.uniform(0.40, 0.60))
        if x1 - x0 >= y1 - y0:
            cut = round(x0 + share * (x1 - x0), 2)
            cells += [(x0, y0, cut, y1), (cut, y0, x1, y1)]
        else:
            cut = round(y0 + share * (y1 - y0), 2)
            cells += [(x0, y0, x1, cut), (x0, cut, x1, y1)]
    return cells


def _connect(
    rng: np.random.Generator, cells: list[Cell]
) -> list[tuple[int, int, bool, float]] | None:
    """Choose doors: a random spanning tree and about one loop; None if a cell is cut off.

    A door is (cell, next cell in x or y, whether the wall is vertical, position along it).
    """
    walls = []
    for a, (ax0, ay0, ax1, ay1) in enumerate(cells):
        for b, (bx0, by0, bx1, by1) in enumerate(cells):
            for vertical, touch, low, high in (
                (True, ax1 == bx0, max(ay0, by0), min(ay1, by1)),
                (False, ay1 == by0, max(ax0, bx0), min(ax1, bx1)),
            ):
                if touch and high - low > DOOR_WIDTH + 0.5:
                    walls.append((a, b, vertical, low, high))
    group = list(range(len(cells)))
    doors = []
    extra = 1
    for k in rng.permutation(len(walls)):
        a, b, vertical, low, high = walls[int(k)]
        if group[a] == group[b]:
            if extra == 0:
                continue
            extra -= 1
        margin = 0.5 * DOOR_WIDTH + 0.22
        doors.append((a, b, vertical, float(rng.uniform(low + margin, high - margin))))
        group = [group[a] if g == group[b] else g for g in group]
    return doors if len(set(group)) == 1 else None


def _kinds(rng: np.random.Generator, cells: list[Cell]) -> list[str]:
    """Give each cell its use: the largest is the living room, the smallest the bathroom."""
    area = [(x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in cells]
    order = np.argsort(area)[::-1]
    middle = ["kitchen", "bedroom", "study", "bedroom"][: len(cells) - 2]
    last = "bathroom" if area[order[-1]] < 11.5 else "study"
    uses = ["living", *(middle[int(i)] for i in rng.permutation(len(middle))), last]
    kinds = [""] * len(cells)
    for use, cell in zip(uses, order, strict=True):
        kinds[int(cell)] = use
    return kinds


def _opening(
    rooms: tuple[Room, ...],
    room: int,
    side: int,
    center: float,
    width: float,
    bottom: float,
    top: float,
) -> Opening:
    """Make an opening around a world coordinate along a wall."""
    x, y, yaw, _ = rooms[room].side(side)
    along = (center - x) * np.cos(yaw) if side % 2 == 0 else (center - y) * np.sin(yaw)
    start = float(along) - 0.5 * width
    return Opening(room, side, start, start + width, bottom, top, bottom == 0.0)


def _windows(
    rng: np.random.Generator, rooms: tuple[Room, ...], number: int, room: Room
) -> list[Opening]:
    """Put windows into a room's outer walls."""
    outer = [room.y0 == 0.0, room.x0 == 0.0, room.y1 == DEPTH, room.x1 == WIDTH]
    windows = []
    for side in range(4):
        length = room.side(side)[3]
        if not outer[side] or length < 1.8:
            continue
        count = 2 if length > 4.4 else 1
        for k in range(count):
            width = float(rng.uniform(0.9, min(1.7, 0.6 * length / count)))
            middle = length * (k + 0.5) / count + float(rng.uniform(-0.15, 0.15))
            bottom = 0.88
            if room.kind == "bathroom":
                width, bottom = 0.7, 1.35
            windows.append(
                Opening(
                    number, side, middle - 0.5 * width, middle + 0.5 * width, bottom, 2.15, False
                )
            )
            if room.kind == "bathroom":
                return windows
    return windows
