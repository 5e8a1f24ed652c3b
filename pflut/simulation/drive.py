"""Drives through a home: where the robot goes, and where it takes its images."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pflut._jit import jit
from pflut.geometry import FloatArray, wrap_to_pi
from pflut.simulation.free_space import FreeSpace
from pflut.simulation.home import Home, free_space
from pflut.simulation.textures import noise
from pflut.trajectory import Trajectory

RADIUS = 0.28  # metres: the robot's
COMFORT = 0.6  # metres: a path that can keeps this clear
SPEED = 0.4  # m/s
TURN_RATE = 0.7  # rad/s
CUSP = 1.9  # radians: a sharper bend is driven as a turn on the spot
STEP = 0.02  # metres between the points of a smooth path


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive and the moments at which it takes images.

    Attributes
    ----------
    path : Trajectory
        Every few centimetres and degrees.
    images : ndarray of shape (n,) int
        Which points of the path the images are taken at.
    """

    path: Trajectory
    images: NDArray[np.intp]

    @property
    def stamps(self) -> FloatArray:
        """When the images are taken, shape (n,), seconds."""
        return self.path.stamps[self.images]

    @property
    def poses(self) -> FloatArray:
        """Where the images are taken, shape (n, 3)."""
        return self.path.poses[self.images]


@jit
def cost_to_go(cost, row, column, total):  # type: ignore[no-untyped-def]
    """Sweep a grid until the cost of the way from every cell to one cell is found.

    Parameters
    ----------
    cost : ndarray of shape (rows, columns)
        Of a step's length in cells; infinite where nobody may go.
    row, column : int
        The goal.
    total : ndarray of shape (rows, columns)
        Out: infinite where there is no way.
    """
    rows, columns = cost.shape
    total[:] = np.inf
    total[row, column] = 0.0
    changed = True
    while changed:
        changed = False
        for sweep in range(4):
            for i in range(rows):
                y = i if sweep % 2 == 0 else rows - 1 - i
                for j in range(columns):
                    x = j if sweep // 2 == 0 else columns - 1 - j
                    here = cost[y, x]
                    if here == np.inf:
                        continue
                    best = total[y, x]
                    for dy in range(-1, 2):
                        for dx in range(-1, 2):
                            v, u = y + dy, x + dx
                            if v < 0 or u < 0 or v >= rows or u >= columns:
                                continue
                            length = 1.4142135623730951 if dx * dy != 0 else 1.0
                            way = total[v, u] + 0.5 * length * (here + cost[v, u])
                            if way < best - 1e-9:
                                best = way
                                changed = True
                    total[y, x] = best


def plan_mapping_drive(
    home: Home | FreeSpace, *, spacing: float = 0.72, rng: np.random.Generator | int | None = None
) -> Drive:
    """Plan a drive that covers all rooms.

    Parameters
    ----------
    home : Home or FreeSpace
        Or where in it a robot can be, where that is known already.
    spacing : float
        Metres between images, on average; each distance is up to an eighth longer or shorter.
    rng : Generator, int or None

    Returns
    -------
    Drive
    """
    generator = np.random.default_rng(rng)
    space = home if isinstance(home, FreeSpace) else free_space(home)
    cost = _cost(space, np.ones_like(space.clearance))
    stops = _spread_points(space, cost, generator)
    ways = np.empty((len(stops), *cost.shape))
    for stop, way in zip(stops, ways, strict=True):
        cost_to_go(cost, stop[0], stop[1], way)
    between = np.array([[way[tuple(stop)] for stop in stops] for way in ways])
    order = _short_tour(between)
    cells = [stops[order[0]]]
    for a, b in pairwise(order):
        cells += _descend(ways[b], stops[a])[1:]
    return _drive(space, cells, spacing, np.inf, generator)


def plan_test_drive(
    home: Home | FreeSpace,
    *,
    length: float = 17.0,
    spacing: float = 0.35,
    turn: float = 0.5,
    rng: np.random.Generator | int | None = None,
) -> Drive:
    """Plan a drive between random places in several rooms.

    Parameters
    ----------
    home : Home or FreeSpace
    length : float
        Metres to drive.
    spacing, turn : float
        An image is taken after so many metres (up to an eighth more or less) or so many radians,
        whatever comes first.
    rng : Generator, int or None

    Returns
    -------
    Drive
    """
    generator = np.random.default_rng(rng)
    space = home if isinstance(home, FreeSpace) else free_space(home)
    # another path than the mapping's: some places are liked less today
    shape = (256, 256)
    mood = noise(generator, *shape, (8, 8), 1)[
        : space.clearance.shape[0], : space.clearance.shape[1]
    ]
    cost = _cost(space, np.exp(0.5 * mood))
    candidates = _reachable(space, cost, 0.1)
    total = np.empty_like(cost)
    cells = [candidates[int(generator.integers(len(candidates)))]]
    driven = 0.0
    while driven < length:
        goal = candidates[int(generator.integers(len(candidates)))]
        cost_to_go(cost, goal[0], goal[1], total)
        leg = _descend(total, cells[-1])
        metres = _length(space.points(leg))
        if 2.5 < metres < 9.0:
            driven += metres
            cells += leg[1:]
    drive = _drive(space, cells, spacing, turn, generator)
    steps = np.hypot(*np.diff(drive.path.poses[:, :2], axis=0).T)
    end = int(np.searchsorted(np.cumsum(steps), length))
    return Drive(drive.path, drive.images[drive.images <= end])


def apart(poses: FloatArray, spacing: float) -> list[int]:
    """Choose poses that are so far from each other: the first one, and in their order what fits.

    Parameters
    ----------
    poses : ndarray of shape (m, 3)
    spacing : float
        Metres.

    Returns
    -------
    list of int
        Their rows.
    """
    chosen: list[int] = []
    for k, pose in enumerate(poses):
        if not chosen or np.hypot(*(poses[chosen, :2] - pose[:2]).T).min() >= spacing:
            chosen.append(k)
    return chosen


def _cost(space: FreeSpace, mood: FloatArray) -> FloatArray:
    """Give each cell's cost: near obstacles it is higher, closer than the radius infinite."""
    closeness = np.clip((COMFORT - space.clearance) / (COMFORT - RADIUS), 0.0, 1.0)
    cost = mood * (1.0 + 4.0 * closeness**2)
    return np.where(space.clearance > RADIUS, cost, np.inf)


def _reachable(space: FreeSpace, cost: FloatArray, margin: float) -> NDArray[np.intp]:
    """Give the cells (n, 2) with some room to spare that can be reached from the best one."""
    way = np.empty_like(cost)
    row, column = np.unravel_index(np.argmax(space.clearance), cost.shape)
    cost_to_go(cost, row, column, way)
    return np.argwhere((space.clearance > RADIUS + margin) & np.isfinite(way))


def _spread_points(
    space: FreeSpace, cost: FloatArray, rng: np.random.Generator
) -> list[NDArray[np.intp]]:
    """Choose cells so that every free place is within about a metre of one: the farthest next."""
    cells = _reachable(space, cost, 0.06)
    stops = [cells[int(rng.integers(len(cells)))]]
    points = space.points(cells)
    nearest = np.full(len(cells), np.inf)
    while True:
        nearest = np.minimum(nearest, np.hypot(*(points - space.points(stops[-1])).T))
        farthest = int(np.argmax(nearest))
        if nearest[farthest] < 0.95:
            return stops
        stops.append(cells[farthest])


def _short_tour(between: FloatArray) -> list[int]:
    """Order places: always to the nearest, then reverse stretches while that shortens the way."""
    order = [0]
    left = set(range(1, len(between)))
    while left:
        order.append(min(left, key=lambda k: between[order[-1], k]))
        left.remove(order[-1])
    improved = True
    while improved:
        improved = False
        for a in range(1, len(order) - 1):
            for b in range(a + 1, len(order)):
                before = between[order[a - 1], order[a]]
                after = between[order[a - 1], order[b]]
                if b + 1 < len(order):
                    before += between[order[b], order[b + 1]]
                    after += between[order[a], order[b + 1]]
                if after < before - 1e-9:
                    order[a : b + 1] = order[a : b + 1][::-1]
                    improved = True
    return order


def _descend(total: FloatArray, start: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Follow the cost to go downhill from a cell to the goal."""
    path = [np.asarray(start)]
    y, x = int(start[0]), int(start[1])
    while total[y, x] > 0.0:
        window = total[y - 1 : y + 2, x - 1 : x + 2]
        dy, dx = divmod(int(np.argmin(window)), 3)
        y, x = y + dy - 1, x + dx - 1
        path.append(np.array([y, x]))
    return path


def _length(points: FloatArray) -> float:
    """Give the length of a path in metres."""
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def _drive(
    space: FreeSpace,
    cells: list[NDArray[np.intp]],
    spacing: float,
    turn: float,
    rng: np.random.Generator,
) -> Drive:
    """Make a drive of a path of cells: smooth it, turn on the spot at its cusps."""
    pieces = [_smoothed(piece, space) for piece in _split_at_cusps(space.points(cells))]
    return drive_along(pieces, spacing=spacing, turn=turn, rng=rng)


def drive_along(
    pieces: list[FloatArray], *, spacing: float, turn: float, rng: np.random.Generator
) -> Drive:
    """Make a drive along lines, with a turn on the spot from each to the next.

    Parameters
    ----------
    pieces : list of ndarray of shape (k, 2)
        Points of smooth lines in metres; each starts where the one before ends.
    spacing, turn : float
        An image is taken after so many metres (up to an eighth more or less) or so many radians.
    rng : Generator

    Returns
    -------
    Drive
    """
    positions: list[FloatArray] = []
    headings: list[FloatArray] = []
    for piece in map(_resampled, pieces):
        tangents = np.gradient(piece, axis=0)
        heading = np.unwrap(np.arctan2(tangents[:, 1], tangents[:, 0]))
        if headings:
            before = headings[-1][-1]
            swing = float(wrap_to_pi(heading[0] - before))
            count = max(int(abs(swing) / 0.04), 1)
            headings.append(before + np.linspace(0.0, swing, count + 1)[1:-1])
            positions.append(np.repeat(piece[:1], count - 1, axis=0))
            heading = heading + (before + swing - heading[0])
        positions.append(piece)
        headings.append(heading)
    xy, heading = np.concatenate(positions), np.concatenate(headings)
    metres = np.hypot(*np.diff(xy, axis=0).T)
    radians = np.abs(np.diff(heading))
    keep = np.concatenate([[True], (metres > 1e-9) | (radians > 1e-9)])
    xy, heading = xy[keep], heading[keep]
    metres = np.hypot(*np.diff(xy, axis=0).T)
    radians = np.abs(np.diff(heading))
    stamps = np.concatenate([[0.0], np.cumsum(np.maximum(metres / SPEED, radians / TURN_RATE))])
    poses = np.column_stack([xy, wrap_to_pi(heading)])
    images = _moments(metres, radians, spacing, turn, rng)
    return Drive(Trajectory(stamps, poses), images)


def _moments(
    metres: FloatArray, radians: FloatArray, spacing: float, turn: float, rng: np.random.Generator
) -> NDArray[np.intp]:
    """Choose the points of a path where images are taken."""
    chosen = [0]
    driven = turned = 0.0
    wait = spacing * rng.uniform(0.875, 1.125)
    for k in range(len(metres)):
        driven += metres[k]
        turned += radians[k]
        if driven >= wait or turned >= turn:
            chosen.append(k + 1)
            driven = turned = 0.0
            wait = spacing * rng.uniform(0.875, 1.125)
    return np.array(chosen, dtype=np.intp)


def _split_at_cusps(points: FloatArray) -> list[FloatArray]:
    """Cut a path where it bends sharply within a third of a metre."""
    reach = 6
    pieces, start = [], 0
    k = reach
    while k < len(points) - reach:
        into, out = points[k] - points[k - reach], points[k + reach] - points[k]
        bend = abs(np.arctan2(into[0] * out[1] - into[1] * out[0], into @ out))
        if bend > CUSP:
            # the sharpest place is where the way in and the way out lie closest together
            spread = [
                float(np.hypot(*(points[j + reach] - points[j - reach])))
                for j in range(k, min(k + reach, len(points) - reach))
            ]
            k += int(np.argmin(spread))
            pieces.append(points[start : k + 1])
            start, k = k, k + reach
        k += 1
    pieces.append(points[start:])
    return [piece for piece in pieces if len(piece) > 1]


def _smoothed(points: FloatArray, space: FreeSpace) -> FloatArray:
    """Round the corners of a path, keeping its ends and the robot's distance from obstacles."""
    path = points.copy()
    floor = np.minimum(space.at(path), RADIUS + 0.02)[1:-1]
    for _ in range(60):
        moved = 0.5 * path[1:-1] + 0.25 * (path[:-2] + path[2:])
        safe = space.at(moved) >= floor
        path[1:-1] = np.where(safe[:, None], moved, path[1:-1])
    return path


def _resampled(points: FloatArray) -> FloatArray:
    """Give points every few centimetres of a path."""
    at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    count = max(int(at[-1] / STEP), 2)
    wanted = np.linspace(0.0, at[-1], count + 1)
    return np.column_stack([np.interp(wanted, at, points[:, k]) for k in range(2)])
