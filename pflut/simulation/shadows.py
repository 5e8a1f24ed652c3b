"""The kernels that light points: rays to lamps, windows and all around, stopped by bodies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pflut._jit import jit
from pflut.geometry import FloatArray

REACH = 1.2  # metres within which bodies darken a corner
CELL = 0.5  # metres of the grid that rays walk through


@jit
def _enters(solid, x, y, z, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Give the ray's parameter where it enters a solid, 1e30 if it does not (or starts inside)."""
    rx, ry = x - solid[0], y - solid[1]
    near, far = -1e30, 1e30
    for axis in range(3):
        if axis == 0:
            start, step = rx * solid[2] + ry * solid[3], dx * solid[2] + dy * solid[3]
            low, high = -solid[4], solid[4]
        elif axis == 1:
            start, step = ry * solid[2] - rx * solid[3], dy * solid[2] - dx * solid[3]
            low, high = -solid[5], solid[5]
        else:
            start, step, low, high = z, dz, solid[6], solid[7]
        if abs(step) < 1e-12:
            if start < low or start > high:
                return 1e30
        else:
            a, b = (low - start) / step, (high - start) / step
            near, far = max(near, min(a, b)), min(far, max(a, b))
    if near > far or near <= 0.0:
        return 1e30
    return near


@jit
def _first_hit(solids, cells, members, grid, x, y, z, dx, dy, dz, reach):  # type: ignore[no-untyped-def]
    """Give the distance to the first body along a unit ray, or ``reach`` if none is closer.

    The bodies of a grid cell are ``members[cells[c]:cells[c + 1]]``; ``grid`` holds its origin
    x, y, its columns and its rows.
    """
    columns, rows = int(grid[2]), int(grid[3])
    cx, cy = (x - grid[0]) / CELL, (y - grid[1]) / CELL
    column, row = int(np.floor(cx)), int(np.floor(cy))
    step_x, step_y = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
    skip_x = CELL / abs(dx) if abs(dx) > 1e-12 else 1e30
    skip_y = CELL / abs(dy) if abs(dy) > 1e-12 else 1e30
    next_x = skip_x * ((column + 1 - cx) if dx > 0.0 else (cx - column))
    next_y = skip_y * ((row + 1 - cy) if dy > 0.0 else (cy - row))
    at = 0.0
    best = reach
    while at < best and 0 <= column < columns and 0 <= row < rows:
        cell = row * columns + column
        for k in range(cells[cell], cells[cell + 1]):
            t = _enters(solids[members[k]], x, y, z, dx, dy, dz)
            best = min(best, t)
        if next_x < next_y:
            at, next_x, column = next_x, next_x + skip_x, column + step_x
        else:
            at, next_y, row = next_y, next_y + skip_y, row + step_y
    return best


@jit
def bake(  # type: ignore[no-untyped-def]
    points, normals, ambient, solids, cells, members, grid, lamps, windows,
    lamp_color, sky_color, directions, values,
):  # fmt: skip
    """Compute the light at points.

    Parameters
    ----------
    points, normals : ndarray of shape (l, 3)
        A normal of zero length is a point lit from all around.
    ambient : ndarray of shape (l, 3)
        Light from all around.
    solids : ndarray of shape (m, 8)
        See ``Scene``.
    cells, members, grid : ndarray
        See ``_first_hit``.
    lamps : ndarray of shape (k, 4)
        Position and power.
    windows : ndarray of shape (w, 7)
        See ``Scene``.
    lamp_color, sky_color : ndarray of shape (3,)
        Light of a lamp of power 1 at 1 m, and radiance of the sky.
    directions : ndarray of shape (d, 3)
        Unit vectors all around.
    values : ndarray of shape (l, 3) float32
        Out.
    """
    light = np.empty(3)
    for i in range(points.shape[0]):
        x, y, z = points[i]
        nx, ny, nz = normals[i]
        faceless = nx * nx + ny * ny + nz * nz < 0.5
        total, seen = 0.0, 0.0
        for k in range(directions.shape[0]):
            dx, dy, dz = directions[k]
            cosine = 1.0 if faceless else nx * dx + ny * dy + nz * dz
            if cosine > 0.05:
                hit = _first_hit(solids, cells, members, grid, x, y, z, dx, dy, dz, REACH)
                total += cosine
                seen += cosine * np.sqrt(hit / REACH)
        for channel in range(3):
            light[channel] = ambient[i, channel] * seen / total
        for k in range(lamps.shape[0]):
            dx, dy, dz = lamps[k, 0] - x, lamps[k, 1] - y, lamps[k, 2] - z
            distance = np.sqrt(dx * dx + dy * dy + dz * dz) + 1e-6
            dx, dy, dz = dx / distance, dy / distance, dz / distance
            cosine = 0.5 if faceless else nx * dx + ny * dy + nz * dz
            strength = lamps[k, 3] * cosine / (distance * distance + 0.15)
            if strength > 2e-3:
                hit = _first_hit(solids, cells, members, grid, x, y, z, dx, dy, dz, distance)
                if hit >= distance:
                    for channel in range(3):
                        light[channel] += strength * lamp_color[channel]
        for k in range(windows.shape[0]):
            wx, wy = windows[k, 3], windows[k, 4]
            for sample in range(6):
                # three places along the window at two heights
                along = (sample % 3 - 1) / 3.0 * windows[k, 5]
                up = (sample // 3 - 0.5) * 0.5 * windows[k, 6]
                dx = windows[k, 0] - wy * along - x
                dy = windows[k, 1] + wx * along - y
                dz = windows[k, 2] + up - z
                distance = np.sqrt(dx * dx + dy * dy + dz * dz) + 1e-6
                dx, dy, dz = dx / distance, dy / distance, dz / distance
                cosine = 0.5 if faceless else nx * dx + ny * dy + nz * dz
                facing = -(wx * dx + wy * dy)
                if cosine <= 0.0 or facing <= 0.0:
                    continue
                area = windows[k, 5] * windows[k, 6] / 6.0
                strength = cosine * facing * area / (np.pi * (distance * distance + 0.1))
                if strength > 5e-4:
                    hit = _first_hit(solids, cells, members, grid, x, y, z, dx, dy, dz, distance)
                    if hit >= distance:
                        for channel in range(3):
                            light[channel] += strength * sky_color[channel]
        for channel in range(3):
            values[i, channel] = light[channel]


def directions_around(count: int) -> FloatArray:
    """Give unit vectors spread evenly over the sphere (a Fibonacci lattice), shape (count, 3)."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    angle = np.pi * (1.0 + 5.0**0.5) * k
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def grid_of_solids(
    solids: FloatArray,
) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """Sort bodies into the cells of a grid: (first member of each cell, members, the grid)."""
    reach_x = np.abs(solids[:, 2]) * solids[:, 4] + np.abs(solids[:, 3]) * solids[:, 5]
    reach_y = np.abs(solids[:, 3]) * solids[:, 4] + np.abs(solids[:, 2]) * solids[:, 5]
    low = solids[:, :2] - np.stack([reach_x, reach_y], axis=1)
    high = solids[:, :2] + np.stack([reach_x, reach_y], axis=1)
    origin = low.min(axis=0) - 0.1
    columns, rows = np.ceil((high.max(axis=0) + 0.1 - origin) / CELL).astype(int)
    first = np.floor((low - origin) / CELL).astype(int)
    last = np.floor((high - origin) / CELL).astype(int)
    lists: list[list[int]] = [[] for _ in range(rows * columns)]
    for k in range(len(solids)):
        for row in range(first[k, 1], last[k, 1] + 1):
            for column in range(first[k, 0], last[k, 0] + 1):
                lists[row * columns + column].append(k)
    cells = np.cumsum([0, *map(len, lists)]).astype(np.int64)
    members = np.array([k for cell in lists for k in cell], dtype=np.int64)
    return cells, members, np.array([*origin, columns, rows], dtype=np.float64)
