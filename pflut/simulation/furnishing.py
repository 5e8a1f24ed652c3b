"""Where the furniture goes: along the walls, out of the way of doors, with room to drive."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray, compose
from pflut.simulation.changes import Changes
from pflut.simulation.free_space import (
    footprint_mask,
    is_connected,
    occupied_by_walls,
    rectangle_mask,
)
from pflut.simulation.furniture import PIECES, Kit, clutter
from pflut.simulation.layout import CEILING, DOOR_WIDTH, Opening, Room
from pflut.simulation.scene import Material, SceneBuilder
from pflut.simulation.stock import Stock

DRIVING_RADIUS = 0.30  # metres: a robot of this radius gets everywhere between the furniture

# groups of pieces that stand side by side along a wall, by kind of room
ALONG_WALLS = {
    "living": (
        ("sofa",),
        ("television",),
        ("bookcase", "bookcase"),
        ("dresser",),
        ("bookcase",),
        ("armchair",),
        ("floor lamp",),
        ("plant",),
        ("parcels",),
    ),
    "kitchen": (
        ("fridge", *4 * ("kitchen unit",)),
        ("kitchen unit", "kitchen unit"),
        ("dresser",),
        ("plant",),
    ),
    "bedroom": (
        ("night table", "bed", "night table"),
        ("wardrobe",),
        ("dresser",),
        ("bookcase",),
        ("plant",),
        ("parcels",),
    ),
    "study": (
        ("desk",),
        ("bookcase", "bookcase", "bookcase"),
        ("sofa",),
        ("bookcase",),
        ("armchair",),
        ("plant",),
        ("parcels",),
    ),
    "bathroom": (
        ("bathtub",),
        ("washbasin",),
        ("toilet",),
        ("washing machine",),
        ("plant",),
    ),
}


class Furnisher:
    """Furnishes rooms so that a robot can still get everywhere.

    Parameters
    ----------
    b, stock, rooms, openings
        The empty home.
    rng : Generator
        Decides what stays.
    changes : Changes
        Decide about small objects, chairs and rugs.
    """

    def __init__(
        self,
        b: SceneBuilder,
        stock: Stock,
        rooms: tuple[Room, ...],
        openings: tuple[Opening, ...],
        rng: np.random.Generator,
        changes: Changes,
    ) -> None:
        self.footprints: list[list[float]] = []
        self._b, self._stock, self._rng = b, stock, rng
        self._rooms, self._openings = rooms, openings
        self._changes = changes
        self._chairs: list[FloatArray] = []
        self._kit = Kit(b, stock, rng, changes)
        self._occupied = occupied_by_walls(rooms, openings)
        self._kept_free = self._approaches()
        doors = [self._in_front(o, 0.0) for o in openings if o.is_door]
        self._places = np.array(doors)
        # what covers a wall: (room, side) -> intervals (start, end, bottom, top)
        self._covered: dict[tuple[int, int], list[tuple[float, float, float, float]]] = {
            (room, side): [] for room in range(len(rooms)) for side in range(4)
        }
        for o in openings:
            reach = 0.1 if o.is_door else 0.42
            cover = (o.start - reach, o.end + reach, o.bottom - 0.05, CEILING)
            self._covered[o.room, o.side].append(cover)

    def furnish(self) -> None:
        """Furnish all rooms; what people move about comes last, so that nothing depends on it."""
        for number, room in enumerate(self._rooms):
            self._hang_lamp(room)
            if room.kind in ("kitchen", "living"):
                self._dining_place(room)
            for group in ALONG_WALLS[room.kind]:
                self._along_wall(number, group)
            if room.kind in ("study", "bedroom"):
                spot = self._rng.uniform([room.x0 + 0.6, room.y0 + 0.6], [room.x1 - 1, room.y1 - 1])
                self._chairs.append(np.array([*spot, self._rng.uniform(0.0, 2.0 * np.pi)]))
            if room.kind != "kitchen":
                self._lay_rug(room)
            self._decorate(number)
        for pose in self._chairs:
            self._put_chair(pose)

    def _in_front(self, opening: Opening, distance: float) -> tuple[float, float]:
        """Give the point in front of an opening's middle, inside its room."""
        x, y, yaw, _ = self._rooms[opening.room].side(opening.side)
        middle = 0.5 * (opening.start + opening.end)
        pose = compose([x, y, yaw], [middle, -distance, 0.0])
        return float(pose[0]), float(pose[1])

    def _approaches(self) -> NDArray[np.bool_]:
        """Mark what doors keep free."""
        kept = np.zeros_like(self._occupied)
        for o in self._openings:
            if o.is_door:
                (x0, y0), (x1, y1) = self._in_front(o, 0.0), self._in_front(o, 0.85)
                reach = 0.5 * DOOR_WIDTH
                low = (min(x0, x1) - (reach if x0 == x1 else 0.0), min(y0, y1))
                high = (max(x0, x1) + (reach if x0 == x1 else 0.0), max(y0, y1))
                if abs(y0 - y1) < 1e-9:
                    low, high = (low[0], y0 - reach), (high[0], y0 + reach)
                elif abs(x0 - x1) < 1e-9:
                    low, high = (x0 - reach, low[1]), (x0 + reach, high[1])
                kept |= rectangle_mask(kept.shape, low, high)
        return kept

    def _fits(self, footprints: list[list[float]]) -> bool:
        """Try to put footprints on the floor; they stay if nothing is in the way of anything."""
        occupied = self._occupied.copy()
        for footprint in footprints:
            slim = [*footprint[:3], footprint[3] - 0.06, footprint[4] - 0.06]
            mask = footprint_mask(occupied.shape, slim)
            if (mask & (self._occupied | self._kept_free)).any():
                return False
            occupied |= footprint_mask(occupied.shape, footprint)
        if not is_connected(occupied, self._places, DRIVING_RADIUS):
            return False
        self._occupied = occupied
        self.footprints += footprints
        return True

    def _is_covered(
        self, wall: tuple[int, int], a: float, c: float, low: float, high: float
    ) -> bool:
        """Say whether something is at this place of a wall already."""
        return any(
            a < end and c > start and low < top and high > bottom
            for start, end, bottom, top in self._covered[wall]
        )

    def _along_wall(self, number: int, names: tuple[str, ...]) -> None:
        """Put a group of pieces against a wall; drops its last piece until it fits somewhere."""
        room = self._rooms[number]
        while names:
            pieces = [PIECES[name] for name in names]
            width = sum(piece.width for piece in pieces)
            for _ in range(24):
                side = int(self._rng.integers(4))
                length = room.side(side)[3]
                if length < width + 0.1:
                    continue
                start = float(self._rng.uniform(0.03, length - width - 0.03))
                if self._rng.random() < 0.4:  # into a corner
                    start = 0.03 if self._rng.random() < 0.5 else length - width - 0.03
                if self._try_along(number, side, start, names):
                    return
            names = names[:-1]

    def _try_along(self, number: int, side: int, start: float, names: tuple[str, ...]) -> bool:
        """Put a group of pieces at one place of a wall, if it fits."""
        x, y, yaw, _ = self._rooms[number].side(side)
        gap = 0.03
        at, spots, footprints, covers = start, [], [], []
        for name in names:
            piece = PIECES[name]
            if self._is_covered((number, side), at, at + piece.width, 0.0, piece.height):
                return False
            # the piece's x axis runs against the wall's
            pose = compose([x, y, yaw], [at + piece.width, -gap, np.pi])
            center = compose(pose, [0.5 * piece.width, 0.5 * piece.depth, 0.0])
            footprints.append([*map(float, center), 0.5 * piece.width, 0.5 * piece.depth])
            covers.append((at, at + piece.width, 0.0, piece.height + 0.05))
            spots.append((pose, piece))
            at += piece.width
        if not self._fits(footprints):
            return False
        self._covered[number, side] += covers
        for pose, piece in spots:
            with self._b.placed(*map(float, pose)):
                piece.draw(self._kit)
        if "sofa" in names:
            front = compose(spots[0][0], [1.55, 1.35 + 0.6, np.pi])
            self._put("coffee table", front)
        if "desk" in names:
            self._chairs.append(compose(spots[0][0], [0.9, 1.1, np.pi]))
        return True

    def _put(self, name: str, pose: Iterable[float]) -> bool:
        """Put one piece with the origin of its frame at a pose, if it fits."""
        piece = PIECES[name]
        x, y, yaw = (float(v) for v in pose)
        center = compose([x, y, yaw], [0.5 * piece.width, 0.5 * piece.depth, 0.0])
        if not self._fits([[*map(float, center), 0.5 * piece.width, 0.5 * piece.depth]]):
            return False
        with self._b.placed(x, y, yaw):
            piece.draw(self._kit)
        return True

    def _alone(self, room: Room, name: str, yaw: float) -> FloatArray | None:
        """Put a piece somewhere into a room; returns its pose, or None."""
        for _ in range(20):
            x = float(self._rng.uniform(room.x0 + 0.6, room.x1 - 0.6))
            y = float(self._rng.uniform(room.y0 + 0.6, room.y1 - 0.6))
            piece = PIECES[name]
            pose = compose([x, y, yaw], [-0.5 * piece.width, -0.5 * piece.depth, 0.0])
            if self._put(name, pose):
                return pose
        return None

    def _dining_place(self, room: Room) -> None:
        """Put a table into a room with chairs around it."""
        turned = room.y1 - room.y0 > room.x1 - room.x0
        if room.kind == "living" and room.area < 18.0:
            return
        pose = self._alone(room, "table", 0.5 * np.pi if turned else 0.0)
        if pose is None:
            return
        # a chair's back is at its y = 0: half a turn has it away from the table
        for x, y, turn in (
            (0.6, 1.36, np.pi),
            (1.3, 1.36, np.pi),
            (0.2, -0.51, 0),
            (0.9, -0.51, 0),
        ):
            self._chairs.append(compose(pose, [x, y, turn]))

    def _put_chair(self, pose: FloatArray) -> None:
        """Put a chair about where it belongs, or exactly there if that is too tight."""
        away = self._changes().normal(0.0, [0.10, 0.10, 0.25])
        # turned about the middle of its seat
        seat = compose(pose, [0.21, 0.21, 0.0]) + away
        if not self._put("chair", compose(seat, [-0.21, -0.21, 0.0])):
            self._put("chair", pose)

    def _hang_lamp(self, room: Room) -> None:
        """Hang a lamp from the middle of the ceiling."""
        b = self._b
        with b.placed(0.5 * (room.x0 + room.x1), 0.5 * (room.y0 + room.y1)):
            glow = b.lamp(0.0, 0.0, 2.05, 0.12 * room.area)
            shade = Material(self._stock.shade.texture, 0.3, 0.3, glow=glow)
            b.cylinder((0.0, 0.0), 0.012, (2.3, CEILING), self._stock.black, solid=False)
            if room.kind in ("living", "bedroom"):
                b.sphere((0.0, 0.0, 2.15), 0.19, shade, flattening=0.8, solid=False)
            else:
                b.cylinder((0.0, 0.0), 0.17, (2.12, 2.3), shade, solid=False)

    def _lay_rug(self, room: Room) -> None:
        """Lay a rug into the middle of a room."""
        rng = self._rng
        long = min(2.6, 0.6 * max(room.x1 - room.x0, room.y1 - room.y0))
        wide = 0.62 * long
        turned = room.y1 - room.y0 > room.x1 - room.x0
        x = 0.5 * (room.x0 + room.x1) + float(rng.uniform(-0.3, 0.3))
        y = 0.5 * (room.y0 + room.y1) + float(rng.uniform(-0.3, 0.3))
        rug = self._stock.rugs[int(rng.integers(len(self._stock.rugs)))]
        shift = self._changes().normal(0.0, [0.12, 0.12, 0.06])
        yaw = (0.5 * np.pi if turned else 0.0) + float(shift[2])
        with self._b.placed(x + float(shift[0]), y + float(shift[1]), yaw):
            self._b.rectangle((-0.5 * long, -0.5 * wide), (long, wide), 0.008, rug)

    def _decorate(self, number: int) -> None:
        """Hang pictures, posters, shelves and a clock on a room's walls."""
        room, b, stock, rng = self._rooms[number], self._b, self._stock, self._rng
        for side in range(4):
            x, y, yaw, length = room.side(side)
            for attempt in range(int(2.2 * length)):
                kind = int(rng.integers(8))
                width, height, middle = (
                    float(rng.uniform(0.4, 0.85)),
                    0.0,
                    float(rng.uniform(1.5, 1.7)),
                )
                height = width * float(rng.uniform(0.75, 1.25))
                if kind == 0:
                    width, height = 0.6, 0.9
                elif kind == 1:
                    width = height = 0.32
                elif kind == 2:
                    width, height, middle = 0.8, 0.34, 1.72
                if room.kind == "bathroom" and attempt > 1:
                    break
                start = float(rng.uniform(0.1, max(length - width - 0.1, 0.11)))
                low, high = middle - 0.5 * height, middle + 0.5 * height
                spot = (start - 0.08, start + width + 0.08, low - 0.04, high + 0.04)
                if start + width > length - 0.05 or self._is_covered((number, side), *spot):
                    continue
                self._covered[number, side].append(spot)
                with b.placed(x, y, yaw), b.placed(start + width, 0.0, np.pi):
                    if kind == 0:
                        poster = self._kit.pick(stock.posters)
                        b.box(
                            (0.0, width),
                            (0.0, 0.008),
                            (low, high),
                            stock.white,
                            front=poster,
                            solid=False,
                        )
                    elif kind == 1:
                        b.quad((width, 0.02), (0.0, 0.02), low, high, stock.clock)
                    elif kind == 2:
                        b.box(
                            (0.0, width),
                            (0.0, 0.2),
                            (low, low + 0.025),
                            self._kit.pick(stock.woods),
                        )
                        clutter(self._kit, width, 0.2, low + 0.025, 4)
                    else:
                        picture = self._kit.pick(stock.pictures)
                        b.box(
                            (0.0, width),
                            (0.0, 0.03),
                            (low, high),
                            stock.black,
                            front=picture,
                            solid=False,
                        )
