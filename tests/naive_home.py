"""Readable twins of the home's kernels: one ray at a time against every surface."""

from __future__ import annotations

import heapq

import numpy as np

from pflut.simulation import raster


def first_surface(
    surfaces: np.ndarray, lens: np.ndarray, direction: np.ndarray
) -> tuple[int, float]:
    """Cast one ray in three dimensions; give the surface it meets first and how far along it."""
    best, nearest = -1, np.inf
    for number, row in enumerate(surfaces):
        for t in _meetings(row, lens, direction):
            if 1e-3 < t < nearest:
                best, nearest = number, t
    return best, nearest


def _meetings(row: np.ndarray, lens: np.ndarray, direction: np.ndarray) -> list[float]:
    """Give where a ray meets the seen side of a surface."""
    kind = row[raster.KIND]
    origin = np.array([row[raster.X], row[raster.Y], row[raster.Z]])
    along = np.array([row[raster.UX], row[raster.UY], 0.0])
    left = np.array([-row[raster.UY], row[raster.UX], 0.0])
    up = np.array([0.0, 0.0, 1.0])
    length, size, facing = row[raster.LENGTH], row[raster.SIZE], row[raster.FACING]
    if kind in (raster.QUAD, raster.RECTANGLE, raster.DISC):
        normal = -left if kind == raster.QUAD else up * facing
        if direction @ normal >= 0.0 and not (kind == raster.QUAD and facing == 0.0):
            return []
        if abs(direction @ normal) < 1e-12:
            return []
        t = ((origin - lens) @ normal) / (direction @ normal)
        local = lens + t * direction - origin
        if kind == raster.DISC:
            return [t] if np.hypot(local @ along, local @ left) <= length else []
        across = local @ (up if kind == raster.QUAD else left)
        inside = 0.0 <= local @ along <= length and 0.0 <= across <= size
        return [t] if inside else []
    flat = np.array([1.0, 1.0, 0.0 if kind == raster.CYLINDER else length / size])
    d, p = direction * flat, (lens - origin) * flat
    a, b, c = d @ d, p @ d, p @ p - length**2
    if b * b < a * c or c < 0.0:
        return []
    t = (-b - np.sqrt(b * b - a * c)) / a
    if kind == raster.CYLINDER and not 0.0 <= (lens + t * direction - origin)[2] <= size:
        return []
    return [t]


def cheapest_way(cost: np.ndarray, goal: tuple[int, int]) -> np.ndarray:
    """Dijkstra's algorithm on a grid with eight neighbors."""
    total = np.full(cost.shape, np.inf)
    total[goal] = 0.0
    queue = [(0.0, goal)]
    while queue:
        so_far, (y, x) = heapq.heappop(queue)
        if so_far > total[y, x]:
            continue
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                v, u = y + dy, x + dx
                if (dy or dx) and 0 <= v < cost.shape[0] and 0 <= u < cost.shape[1]:
                    way = so_far + 0.5 * np.hypot(dy, dx) * (cost[y, x] + cost[v, u])
                    if way < total[v, u]:
                        total[v, u] = way
                        heapq.heappush(queue, (way, (v, u)))
    return total


def enters_box(box: np.ndarray, start: np.ndarray, direction: np.ndarray) -> float:
    """Give where a ray enters a turned box, by sampling its six planes; infinite if it does not."""
    x, y, cos, sin, half_x, half_y, low, high = box
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    p, d = turn @ (start - [x, y, 0.0]), turn @ direction
    lower, upper = np.array([-half_x, -half_y, low]), np.array([half_x, half_y, high])
    if ((p > lower) & (p < upper)).all():
        return np.inf
    best = np.inf
    for axis in range(3):
        for plane in (lower[axis], upper[axis]):
            if abs(d[axis]) > 1e-12:
                t = (plane - p[axis]) / d[axis]
                at = p + t * d
                others = [k for k in range(3) if k != axis]
                inside = all(lower[k] <= at[k] <= upper[k] for k in others)
                if t > 0.0 and inside:
                    best = min(best, t)
    return best
