"""A scene of upright surfaces, and the builder that furniture and walls are made with."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from pflut.geometry import FloatArray, compose
from pflut.simulation import raster
from pflut.simulation.textures import Image, TextureAtlas

NO_GLOW = -1
SKY_GLOW = 0  # shines with the daylight; 1 + k shines with lamp k


@dataclass(frozen=True)
class Material:
    """How a surface looks.

    Parameters
    ----------
    texture : int
        Number of a picture of the scene.
    width, height : float
        Metres that one repeat covers; 0 stretches the picture over the whole surface.
    cutout : bool
        Whether the picture's transparent parts are holes.
    glow : int
        ``NO_GLOW``, ``SKY_GLOW`` or 1 + the number of the lamp that makes it shine.
    """

    texture: int
    width: float = 0.0
    height: float = 0.0
    cutout: bool = False
    glow: int = NO_GLOW


@dataclass(frozen=True, eq=False)
class Scene:
    """What the renderer and the light need to know.

    Attributes
    ----------
    surfaces : ndarray of shape (n, raster.COLUMNS)
        See ``pflut.simulation.raster``.
    glow : ndarray of shape (n,) int64
        The ``glow`` of each surface's material.
    solids : ndarray of shape (m, 8)
        Bodies that throw shadows: x, y of the centre, cos and sin of the yaw, half the length,
        half the width, bottom and top.
    lamps : ndarray of shape (k, 4)
        x, y, z and relative power.
    windows : ndarray of shape (w, 7)
        x, y, z of the centre, the inward normal's x and y, width and height.
    atlas : TextureAtlas
    """

    surfaces: FloatArray
    glow: np.ndarray
    solids: FloatArray
    lamps: FloatArray
    windows: FloatArray
    atlas: TextureAtlas


class SceneBuilder:
    """Collects surfaces given in a local frame that can be moved about.

    Heights are metres above the floor. The frame's x axis runs along furniture, y from its back
    to its front.
    """

    def __init__(self) -> None:
        self.images: list[Image] = []
        self.surfaces: list[list[float]] = []
        self.glow: list[int] = []
        self.solids: list[list[float]] = []
        self.lamps: list[tuple[float, float, float, float]] = []
        self.windows: list[tuple[float, ...]] = []
        self._frame = np.zeros(3)

    @contextmanager
    def placed(self, x: float, y: float, yaw: float = 0.0) -> Iterator[None]:
        """Build inside the block in a frame at (x, y), turned by ``yaw``, of the present one."""
        before = self._frame
        self._frame = compose(before, [x, y, yaw])
        try:
            yield
        finally:
            self._frame = before

    def to_world(self, x: float, y: float) -> tuple[float, float]:
        """Give the world position of a point of the present frame."""
        fx, fy, yaw = self._frame
        cos, sin = math.cos(yaw), math.sin(yaw)
        return float(fx + cos * x - sin * y), float(fy + sin * x + cos * y)

    def material(
        self,
        image: Image,
        width: float = 0.0,
        height: float | None = None,
        *,
        cutout: bool = False,
        glow: int = NO_GLOW,
    ) -> Material:
        """Add a picture and make a material of it; the height is the width if not given."""
        self.images.append(image)
        tall = width if height is None else height
        return Material(len(self.images) - 1, width, tall, cutout, glow)

    def quad(
        self,
        start: tuple[float, float],
        end: tuple[float, float],
        z0: float,
        z1: float,
        material: Material,
        *,
        two_sided: bool = False,
    ) -> None:
        """Add an upright rectangle; its front is to the right of the way from start to end."""
        x0, y0 = self.to_world(*start)
        x1, y1 = self.to_world(*end)
        length = float(np.hypot(x1 - x0, y1 - y0))
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        facing = 0.0 if two_sided else 1.0
        row = [raster.QUAD, x0, y0, ux, uy, length, z1 - z0, z0, facing]
        # a repeated texture goes on across neighboring surfaces
        self._add(row, material, length, z1 - z0, x0 * ux + y0 * uy, -z1)

    def rectangle(
        self,
        corner: tuple[float, float],
        size: tuple[float, float],
        z: float,
        material: Material,
        *,
        facing: int = 1,
    ) -> None:
        """Add a level rectangle from a corner along x and y, seen from above (1) or below (-1)."""
        x, y = self.to_world(*corner)
        ux, uy = float(np.cos(self._frame[2])), float(np.sin(self._frame[2]))
        row = [raster.RECTANGLE, x, y, ux, uy, size[0], size[1], z, float(facing)]
        self._add(row, material, size[0], size[1], x * ux + y * uy, y * ux - x * uy)

    def box(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        z: tuple[float, float],
        material: Material,
        *,
        front: Material | None = None,
        top: Material | None = None,
        solid: bool = True,
    ) -> None:
        """Add a box; ``front`` is the face towards +y. A box on the floor has no underside."""
        corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
        for side in range(4):
            face = front if side == 2 and front is not None else material
            self.quad(corners[side], corners[(side + 1) % 4], z[0], z[1], face)
        size = (x[1] - x[0], y[1] - y[0])
        self.rectangle(corners[0], size, z[1], top or material)
        if z[0] > 0.0:
            self.rectangle(corners[0], size, z[0], material, facing=-1)
        if solid:
            self.solid(x, y, z)

    def cylinder(
        self,
        center: tuple[float, float],
        radius: float,
        z: tuple[float, float],
        material: Material,
        *,
        top: Material | None = None,
        solid: bool = True,
    ) -> None:
        """Add an upright cylinder with its top and, above the floor, its underside."""
        px, py = self.to_world(*center)
        ux, uy = float(np.cos(self._frame[2])), float(np.sin(self._frame[2]))
        row = [raster.CYLINDER, px, py, ux, uy, radius, z[1] - z[0], z[0], 1.0]
        self._add(row, material, 2.0 * np.pi * radius, z[1] - z[0])
        for height, facing in ((z[1], 1.0), (z[0], -1.0)):
            if facing > 0.0 or height > 0.0:
                row = [raster.DISC, px, py, ux, uy, radius, radius, height, facing]
                self._add(row, top or material, 2.0 * radius, 2.0 * radius)
        if solid:
            half = 0.85 * radius
            x, y = center
            self.solid((x - half, x + half), (y - half, y + half), z)

    def sphere(
        self,
        center: tuple[float, float, float],
        radius: float,
        material: Material,
        *,
        flattening: float = 1.0,
        solid: bool = True,
    ) -> None:
        """Add a ball, or an ellipsoid whose vertical radius is ``flattening`` times the other."""
        px, py = self.to_world(center[0], center[1])
        ux, uy = float(np.cos(self._frame[2])), float(np.sin(self._frame[2]))
        tall = flattening * radius
        row = [raster.SPHERE, px, py, ux, uy, radius, tall, center[2], 1.0]
        self._add(row, material, 2.0 * np.pi * radius, np.pi * tall)
        if solid:
            x, y, z = center
            half = 0.6 * radius
            self.solid((x - half, x + half), (y - half, y + half), (z - half, z + half))

    def solid(self, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> None:
        """Add a body that throws shadows but has no surfaces."""
        cx, cy = self.to_world(0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1]))
        yaw = self._frame[2]
        half = (0.5 * (x[1] - x[0]), 0.5 * (y[1] - y[0]))
        self.solids.append([cx, cy, float(np.cos(yaw)), float(np.sin(yaw)), *half, z[0], z[1]])

    def lamp(self, x: float, y: float, z: float, power: float) -> int:
        """Add a light source; returns the ``glow`` of what shines with it."""
        self.lamps.append((*self.to_world(x, y), z, power))
        return len(self.lamps)

    def rows(self) -> FloatArray:
        """Give the surfaces so far, shape (n, raster.COLUMNS)."""
        return np.array(self.surfaces, dtype=np.float64).reshape(-1, raster.COLUMNS)

    def finish(self) -> Scene:
        """Give the scene."""
        return Scene(
            self.rows(),
            np.array(self.glow, dtype=np.int64),
            np.array(self.solids, dtype=np.float64).reshape(-1, 8),
            np.array(self.lamps, dtype=np.float64).reshape(-1, 4),
            np.array(self.windows, dtype=np.float64).reshape(-1, 7),
            TextureAtlas.from_images(self.images),
        )

    def _add(
        self,
        row: list[float],
        material: Material,
        size_u: float,
        size_v: float,
        shift_u: float = 0.0,
        shift_v: float = 0.0,
    ) -> None:
        """Add a surface's row with its texture coordinates; the light map comes later."""
        width, height = material.width or size_u, material.height or size_v
        offset_u = shift_u / width if material.width else 0.0
        offset_v = shift_v / height if material.height else 0.0
        texture = [material.texture, 1.0 / width, 1.0 / height, offset_u % 1.0, offset_v % 1.0]
        self.surfaces.append([*row, *texture, float(material.cutout), 0.0, 1.0, 1.0])
        self.glow.append(material.glow)
