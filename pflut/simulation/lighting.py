"""Light maps: daylight, lamps and the dark corners, computed once for a home and a light.

Each surface gets a coarse grid of light values. A point receives lamps and windows that it can
see (shadow rays against the scene's bodies), and light from all around as far as nothing close
hides it (ambient occlusion).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pflut._jit import jit
from pflut.geometry import FloatArray
from pflut.simulation import raster
from pflut.simulation.home import Home
from pflut.simulation.scene import SKY_GLOW, Scene

LAMP_COLOR = np.array([1.0, 0.84, 0.62])
SKY_COLOR = np.array([0.92, 0.97, 1.06])
TEXEL = 0.22  # metres between light values
LARGEST_GRID = 48
LAMP_SHINE = 6.0  # brightness of a lit shade
SKY_SHINE = 4.5  # brightness of the street
REACH = 1.2  # metres within which bodies darken a corner
CELL = 0.5  # metres of the grid that rays walk through


@dataclass(frozen=True)
class Lighting:
    """The light of one drive, and how the camera takes it.

    Parameters
    ----------
    sky : float
        Daylight; 1 is a bright day, 0 the night.
    lamps : tuple of float
        Strength of each of the home's lamps, in turn; the tuple repeats. 0 is off.
    exposure : float
        Factor on all light before the sensor.
    warmth : float
        White balance: > 0 gives redder pictures, < 0 bluer ones.
    shot_noise, read_noise : float
        Variance of the photon noise at full scale, and sd of the read noise.

    Raises
    ------
    ValueError
        If a strength, the exposure or a noise is negative or not finite.
    """

    sky: float = 1.0
    lamps: tuple[float, ...] = (0.0,)
    exposure: float = 1.0
    warmth: float = 0.0
    shot_noise: float = 3e-3
    read_noise: float = 4e-3

    def __post_init__(self) -> None:
        values = [self.sky, *self.lamps, self.exposure, self.shot_noise, self.read_noise]
        if not self.lamps or not np.isfinite([*values, self.warmth]).all() or min(values) < 0.0:
            raise ValueError(f"Lighting: expected finite numbers >= 0, got {self}")

    def lamp_strengths(self, count: int) -> FloatArray:
        """Give the strength of each of a number of lamps, shape (count,)."""
        return np.resize(np.asarray(self.lamps, dtype=np.float64), count)

    def gain(self) -> FloatArray:
        """Give the factor on red, green and blue, shape (3,)."""
        return self.exposure * np.array([1.0 + self.warmth, 1.0, 1.0 - self.warmth])


@dataclass(frozen=True, eq=False)
class LightMap:
    """The light on all surfaces of a scene.

    Attributes
    ----------
    surfaces : ndarray of shape (n, raster.COLUMNS)
        The scene's surfaces with the place of their light values filled in.
    values : ndarray of shape (l, 3) float32
        Light on each grid point: red, green, blue.
    emission : ndarray of shape (n,)
        Light that each surface sends out itself.
    sources : LightSources
        What it was made from.
    """

    surfaces: FloatArray
    values: NDArray[np.float32]
    emission: FloatArray
    sources: LightSources

    def with_surfaces(self, surfaces: FloatArray) -> LightMap:
        """Add surfaces that move about (they throw no shadows), shape (k, raster.COLUMNS)."""
        rows, points, normals = light_points(surfaces)
        rows[:, raster.LIGHT] += len(self.values)
        return LightMap(
            np.concatenate([self.surfaces, rows]),
            np.concatenate([self.values, self.sources.light(points, normals)]),
            np.concatenate([self.emission, np.zeros(len(rows))]),
            self.sources,
        )


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


@dataclass(frozen=True, eq=False)
class LightSources:
    """What lights a home: everything that does not depend on the point to be lit.

    Make it with ``LightSources.of``.
    """

    home: Home
    lighting: Lighting
    lamps: FloatArray
    cells: NDArray[np.int64]
    members: NDArray[np.int64]
    grid: FloatArray

    @classmethod
    def of(cls, home: Home, lighting: Lighting) -> LightSources:
        """Collect the light sources of a home."""
        lamps = home.scene.lamps.copy()
        lamps[:, 3] *= lighting.lamp_strengths(len(lamps))
        return cls(home, lighting, lamps, *_grid_of_solids(home.scene.solids))

    def light(self, points: FloatArray, normals: FloatArray) -> NDArray[np.float32]:
        """Compute the light at points (l, 3) with normals (l, 3): red, green, blue, (l, 3)."""
        scene = self.home.scene
        sky = self.lighting.sky * SKY_COLOR
        values = np.empty((len(points), 3), dtype=np.float32)
        bake(
            points,
            normals,
            _ambient(self.home, self.lamps, sky, points),
            scene.solids,
            self.cells,
            self.members,
            self.grid,
            self.lamps[self.lamps[:, 3] > 0.0],
            scene.windows[: len(scene.windows) if self.lighting.sky > 0.0 else 0],
            2.2 * LAMP_COLOR,
            9.0 * sky,
            _directions(32),
            values,
        )
        return values


def make_light_map(home: Home, lighting: Lighting) -> LightMap:
    """Compute the light on all surfaces of a home.

    Parameters
    ----------
    home : Home
    lighting : Lighting

    Returns
    -------
    LightMap
    """
    sources = LightSources.of(home, lighting)
    surfaces, points, normals = light_points(home.scene.surfaces)
    values = sources.light(points, normals)
    return LightMap(surfaces, values, emission_of(home.scene, lighting), sources)


def emission_of(scene: Scene, lighting: Lighting) -> FloatArray:
    """Give the light that each surface sends out itself, shape (n,)."""
    shine = np.zeros(len(scene.lamps) + 2)  # the last is that of no glow: index -1
    shine[SKY_GLOW] = SKY_SHINE * lighting.sky
    shine[1:-1] = LAMP_SHINE * np.minimum(lighting.lamp_strengths(len(scene.lamps)), 1.0)
    return shine[scene.glow]


def light_points(surfaces: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lay a grid of light values over every surface.

    Parameters
    ----------
    surfaces : ndarray of shape (n, raster.COLUMNS)

    Returns
    -------
    surfaces : ndarray of shape (n, raster.COLUMNS)
        A copy with the columns of the light maps filled in.
    points, normals : ndarray of shape (l, 3)
        Of the grid points, a little in front of the surfaces; the normal of a surface with two
        sides is zero.
    """
    result = surfaces.copy()
    points, normals = [], []
    total = 0
    for row in result:
        kind = row[raster.KIND]
        sizes = _sizes(row)
        nu, nv = (int(np.clip(np.ceil(s / TEXEL) + 1, 2, LARGEST_GRID)) for s in sizes)
        if kind in (raster.CYLINDER, raster.SPHERE):
            nu, nv = 7, 2 if kind == raster.CYLINDER else 4
        row[raster.LIGHT : raster.LIGHT_V + 1] = total, nu, nv
        total += nu * nv
        u, v = np.meshgrid(np.linspace(0.0, 1.0, nu), np.linspace(0.0, 1.0, nv))
        place, normal = _places(row, u.ravel(), v.ravel(), sizes)
        points.append(place)
        normals.append(normal)
    if not points:
        return result, np.empty((0, 3)), np.empty((0, 3))
    return result, np.concatenate(points), np.concatenate(normals)


def _sizes(row: FloatArray) -> tuple[float, float]:
    """Give a surface's extent along u and v in metres."""
    kind, length, size = row[raster.KIND], row[raster.LENGTH], row[raster.SIZE]
    if kind == raster.CYLINDER:
        return 2.0 * np.pi * length, size
    if kind == raster.SPHERE:
        return 2.0 * np.pi * length, np.pi * size
    if kind == raster.DISC:
        return 2.0 * length, 2.0 * length
    return length, size


def _places(
    row: FloatArray, u: FloatArray, v: FloatArray, sizes: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Give points and normals of a surface at fractions (u, v) of its extent."""
    kind = row[raster.KIND]
    x, y, z = row[raster.X], row[raster.Y], row[raster.Z]
    axis_u = np.array([row[raster.UX], row[raster.UY], 0.0])
    axis_v = np.array([-row[raster.UY], row[raster.UX], 0.0])
    up = np.array([0.0, 0.0, 1.0])
    # stay clear of the edges, where another surface begins
    inset = [min(0.02, 0.2 * size) / size for size in sizes]
    s = np.clip(u, inset[0], 1.0 - inset[0])[:, None]
    t = np.clip(v, inset[1], 1.0 - inset[1])[:, None]
    origin = np.array([x, y, z])
    if kind == raster.QUAD:
        places = origin + s * sizes[0] * axis_u + (1.0 - t) * sizes[1] * up
        facing = row[raster.FACING]
        normal = np.broadcast_to(-axis_v * facing, places.shape)
    elif kind in (raster.RECTANGLE, raster.DISC):
        start = 0.0 if kind == raster.RECTANGLE else 0.5
        places = origin + (s - start) * sizes[0] * axis_u + (t - start) * sizes[1] * axis_v
        normal = np.broadcast_to(up * row[raster.FACING], places.shape)
    else:
        angle = 2.0 * np.pi * u[:, None] - np.pi
        around = np.cos(angle) * axis_u + np.sin(angle) * axis_v
        if kind == raster.CYLINDER:
            normal = around
            places = origin + row[raster.LENGTH] * around + (1.0 - t) * sizes[1] * up
        else:
            polar = np.pi * v[:, None]
            normal = np.sin(polar) * around + np.cos(polar) * up
            places = origin + normal * np.array(
                [row[raster.LENGTH], row[raster.LENGTH], row[raster.SIZE]]
            )
    return places + 0.012 * normal, np.array(normal)


def _ambient(home: Home, lamps: FloatArray, sky: FloatArray, points: FloatArray) -> FloatArray:
    """Give the light from all around of each point: that of the room it lies in, shape (l, 3)."""
    rooms = np.array([[r.x0, r.y0, r.x1, r.y1] for r in home.rooms])
    area = (rooms[:, 2] - rooms[:, 0]) * (rooms[:, 3] - rooms[:, 1])
    light = np.tile(0.05 * sky + 0.02, (len(rooms), 1))
    light += (
        0.35 * _sum_by_room(rooms, lamps[:, :2], lamps[:, 3])[:, None] / area[:, None] * LAMP_COLOR
    )
    inside = home.scene.windows[:, :2] + 0.5 * home.scene.windows[:, 3:5]
    glass = _sum_by_room(rooms, inside, home.scene.windows[:, 5] * home.scene.windows[:, 6])
    light += 2.2 * (glass / area)[:, None] * sky
    return np.asarray(light[_room_of(rooms, points[:, :2])])


def _room_of(rooms: FloatArray, points: FloatArray) -> NDArray[np.int64]:
    """Give the room that each point lies in or is closest to."""
    beyond = np.maximum(rooms[None, :, :2] - points[:, None], points[:, None] - rooms[None, :, 2:])
    return np.asarray(np.argmin(np.maximum(beyond, 0.0).sum(axis=2), axis=1))


def _sum_by_room(rooms: FloatArray, places: FloatArray, values: FloatArray) -> FloatArray:
    """Add up what each room has."""
    return np.bincount(_room_of(rooms, places), values, minlength=len(rooms))


def _directions(count: int) -> FloatArray:
    """Give unit vectors spread evenly over the sphere (a Fibonacci lattice), shape (count, 3)."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    angle = np.pi * (1.0 + 5.0**0.5) * k
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def _grid_of_solids(
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
