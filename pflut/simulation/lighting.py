"""Light maps: daylight, lamps and the dark corners, computed once for a home and a light.

Each surface gets a coarse grid of light values. A point receives lamps and windows that it can
see (shadow rays against the scene's bodies), and light from all around as far as nothing close
hides it (ambient occlusion).
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray
from pflut.simulation import raster
from pflut.simulation.home import Home
from pflut.simulation.light_points import light_points
from pflut.simulation.scene import SKY_GLOW, Scene
from pflut.simulation.shadows import bake, directions_around, grid_of_solids

LAMP_COLOR = np.array([1.0, 0.84, 0.62])
SKY_COLOR = np.array([0.92, 0.97, 1.06])
LAMP_SHINE = 6.0  # brightness of a lit shade
AT_ONCE = 4096  # points that a thread lights in one go
SKY_SHINE = 4.5  # brightness of the street


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
        return cls(home, lighting, lamps, *grid_of_solids(home.scene.solids))

    def light(self, points: FloatArray, normals: FloatArray) -> NDArray[np.float32]:
        """Compute the light at points (l, 3) with normals (l, 3): red, green, blue, (l, 3)."""
        scene = self.home.scene
        sky = self.lighting.sky * SKY_COLOR
        values = np.empty((len(points), 3), dtype=np.float32)
        ambient = _ambient(self.home, self.lamps, sky, points)
        lamps = self.lamps[self.lamps[:, 3] > 0.0]
        windows = scene.windows[: len(scene.windows) if self.lighting.sky > 0.0 else 0]
        around = directions_around(32)

        def light_some(part: slice) -> None:
            bake(
                points[part],
                normals[part],
                ambient[part],
                scene.solids,
                self.cells,
                self.members,
                self.grid,
                lamps,
                windows,
                2.2 * LAMP_COLOR,
                9.0 * sky,
                around,
                values[part],
            )

        parts = [slice(k, k + AT_ONCE) for k in range(0, len(points), AT_ONCE)]
        if len(parts) == 1:
            light_some(parts[0])
        else:
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                list(pool.map(light_some, parts))
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
    return np.asarray(shine[scene.glow])


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
    sums = np.bincount(_room_of(rooms, places), values, minlength=len(rooms))
    return sums.astype(np.float64)
