"""Walls, floors, ceilings, doors, windows and the street outside."""

from __future__ import annotations

import numpy as np

from pflut.geometry import FloatArray
from pflut.simulation.changes import Changes
from pflut.simulation.layout import CEILING, DEPTH, OUTER, PARTITION, WIDTH, Opening, Room
from pflut.simulation.scene import Material, SceneBuilder
from pflut.simulation.stock import Stock

VIEW_DISTANCE = 13.0  # metres from the flat to the houses outside
VIEW_HEIGHTS = (-7.0, 13.0)
SKY_HEIGHT = 50.0


def build_walls(
    b: SceneBuilder,
    stock: Stock,
    rooms: tuple[Room, ...],
    openings: tuple[Opening, ...],
    rng: np.random.Generator,
    changes: Changes,
) -> None:
    """Build all rooms, empty.

    Each room owns the inner half of its walls: the face, and its half of every doorway.
    """
    for number, room in enumerate(rooms):
        size = (room.x1 - room.x0, room.y1 - room.y0)
        with b.placed(room.x0, room.y0):
            b.rectangle((0.0, 0.0), size, 0.0, stock.floors[room.kind])
            b.rectangle((0.0, 0.0), size, CEILING, stock.white, facing=-1)
        accent = int(rng.integers(4))
        for side in range(4):
            face = stock.accents[room.kind] if side == accent else stock.walls[room.kind]
            x, y, yaw, length = room.side(side)
            holes = [o for o in openings if (o.room, o.side) == (number, side)]
            thickness = OUTER if _is_outer(room, side) else 0.5 * PARTITION
            with b.placed(x, y, yaw):
                _wall(b, stock, face, length, thickness, holes, room.kind != "bathroom")
                for hole in holes:
                    if hole.is_door:
                        _doorway(b, stock, hole, thickness)
                    else:
                        _window(b, stock, hole, thickness, length, room.kind, rng, changes)
    # the corners of the outer walls, so that no daylight comes around them
    b.solid((-OUTER, 0.0), (-OUTER, DEPTH + OUTER), (0.0, CEILING))
    for x in (-OUTER, WIDTH):
        for y in (-OUTER, DEPTH):
            b.solid((x, x + OUTER), (y, y + OUTER), (0.0, CEILING))


def build_view(b: SceneBuilder, stock: Stock) -> None:
    """Build the houses across the street, on all four sides."""
    x0, y0 = -VIEW_DISTANCE, -VIEW_DISTANCE
    x1, y1 = WIDTH + VIEW_DISTANCE, DEPTH + VIEW_DISTANCE
    corners = [(x0, y1), (x1, y1), (x1, y0), (x0, y0)]
    for side in range(4):
        view = stock.views[side % 2]
        b.quad(corners[side], corners[(side + 1) % 4], *VIEW_HEIGHTS, view)
        b.quad(corners[side], corners[(side + 1) % 4], VIEW_HEIGHTS[1], SKY_HEIGHT, stock.sky)


def wall_segments(rooms: tuple[Room, ...], openings: tuple[Opening, ...]) -> FloatArray:
    """Give the walls' faces seen from above, with gaps at the doors.

    Returns
    -------
    ndarray of shape (s, 2, 2)
        Start and end of each segment in metres.
    """
    segments = []
    for number, room in enumerate(rooms):
        for side in range(4):
            x, y, yaw, length = room.side(side)
            along = np.array([np.cos(yaw), np.sin(yaw)])
            holes = [o for o in openings if (o.room, o.side) == (number, side) and o.is_door]
            for start, end in _between(holes, length):
                segments.append([[x, y] + start * along, [x, y] + end * along])
            for hole in holes:  # the two sides of the doorway
                out = 0.5 * PARTITION * np.array([-along[1], along[0]])
                for s in (hole.start, hole.end):
                    edge = [x, y] + s * along
                    segments.append([edge, edge + out])
    return np.array(segments)


def _is_outer(room: Room, side: int) -> bool:
    return (room.y0 == 0.0, room.x0 == 0.0, room.y1 == DEPTH, room.x1 == WIDTH)[side]


def _between(holes: list[Opening], length: float) -> list[tuple[float, float]]:
    """Give the intervals of a wall that no hole interrupts."""
    intervals, at = [], 0.0
    for hole in sorted(holes, key=lambda o: o.start):
        intervals.append((at, hole.start))
        at = hole.end
    intervals.append((at, length))
    return [(a, c) for a, c in intervals if c - a > 1e-6]


def _wall(
    b: SceneBuilder,
    stock: Stock,
    face: Material,
    length: float,
    thickness: float,
    holes: list[Opening],
    skirting: bool,
) -> None:
    """Build one wall's face around its holes; x runs along the wall, -y into the room."""
    pieces = [(a, c, 0.0, CEILING) for a, c in _between(holes, length)]
    for hole in holes:
        pieces.append((hole.start, hole.end, hole.top, CEILING))
        if hole.bottom > 0.0:
            pieces.append((hole.start, hole.end, 0.0, hole.bottom))
    for a, c, low, high in pieces:
        b.quad((a, 0.0), (c, 0.0), low, high, face)
        b.solid((a, c), (0.0, thickness), (low, high))
        if low == 0.0 and skirting:
            b.quad((a, -0.012), (c, -0.012), 0.0, 0.08, stock.white)


def _lining(b: SceneBuilder, stock: Stock, hole: Opening, thickness: float) -> None:
    """Build the sides and the top of a hole through the wall."""
    a, c, width = hole.start, hole.end, hole.end - hole.start
    b.quad((a, 0.0), (a, thickness), hole.bottom, hole.top, stock.white)
    b.quad((c, thickness), (c, 0.0), hole.bottom, hole.top, stock.white)
    b.rectangle((a, 0.0), (width, thickness), hole.top, stock.white, facing=-1)


def _doorway(b: SceneBuilder, stock: Stock, hole: Opening, thickness: float) -> None:
    """Build a doorway's lining, threshold and frame."""
    a, c = hole.start, hole.end
    _lining(b, stock, hole, thickness)
    b.rectangle((a, 0.0), (c - a, thickness), 0.0, stock.woods[1])
    edge, thick = 0.075, (-0.02, 0.0)
    for x in ((a - edge, a), (c, c + edge)):
        b.box(x, thick, (0.0, hole.top + edge), stock.white, solid=False)
    b.box((a, c), thick, (hole.top, hole.top + edge), stock.white, solid=False)


def _window(
    b: SceneBuilder,
    stock: Stock,
    hole: Opening,
    thickness: float,
    length: float,
    kind: str,
    rng: np.random.Generator,
    changes: Changes,
) -> None:
    """Build a window: lining, sill, frame with a bar, curtains, a radiator below."""
    a, c = hole.start, hole.end
    middle = 0.5 * (a + c)
    _lining(b, stock, hole, thickness)
    sill = (hole.bottom - 0.03, hole.bottom)
    b.box((a - 0.06, c + 0.06), (-0.13, thickness), sill, stock.white)
    depth = (0.6 * thickness, 0.6 * thickness + 0.05)
    bar = 0.055
    for across in ((a, a + bar), (c - bar, c), (middle - 0.5 * bar, middle + 0.5 * bar)):
        b.box(across, depth, (hole.bottom, hole.top), stock.white, solid=False)
    for low in (hole.bottom, hole.top - bar, hole.bottom + 0.68 * (hole.top - hole.bottom)):
        b.box((a, c), depth, (low, low + bar), stock.white, solid=False)
    x, y = b.to_world(middle, 0.5 * thickness)
    inside = np.array(b.to_world(middle, -1.0)) - b.to_world(middle, 0.0)
    height = hole.top - hole.bottom
    b.windows.append((x, y, hole.bottom + 0.5 * height, *map(float, inside), c - a, height))
    if kind == "bathroom":
        return
    if kind != "kitchen":
        cloth = stock.curtains[int(rng.integers(3))]
        wide = float(rng.uniform(0.22, 0.4))
        first, last = max(a - wide - 0.02, 0.02), min(c + wide + 0.02, length - 0.02)
        bottom = float(rng.choice([0.06, hole.bottom - 0.12]))
        drawn = changes()  # how far the curtains are drawn today
        reach = float(drawn.choice([0.05, 0.05, 0.5]) * drawn.uniform(0.6, 1.0) * (c - a))
        for left, right in ((first, a + reach), (c - reach, last)):
            if right - left > 0.12:
                b.box((left, right), (-0.17, -0.13), (bottom, 2.34), cloth)
        b.box((first - 0.02, last + 0.02), (-0.16, -0.14), (2.34, 2.37), stock.metal)
    b.box((a + 0.1, c - 0.1), (-0.11, -0.02), (0.12, 0.72), stock.radiator)
