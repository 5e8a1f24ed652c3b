"""The camera below a hyperbolic mirror: the unified model of central catadioptric cameras."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from pflut.camera.axes import image_axes
from pflut.camera.base import Camera
from pflut.camera.distortion import distort, fold_radius, undistort
from pflut.camera.fields import angle, check_positive, coefficients
from pflut.geometry import FloatArray, bearing_angles, bearing_vectors


@dataclass(frozen=True)
class HyperbolicMirror(Camera):
    """A camera that looks up into a hyperbolic (or parabolic) mirror above it.

    A ray's point on the unit sphere is projected from a point ``xi`` above the sphere's center,
    then distorted by the lens and scaled to pixels (Geyer and Daniilidis 2000; Mei and Rives
    2007, which is also OpenCV's ``cv2.omnidir``). The middle of the image shows what is below,
    the camera itself; the upper border looks forward.

    Parameters
    ----------
    width, height : int
        Of the image in pixels.
    xi : float
        The mirror: ``2 e / (1 + e^2)`` for a hyperbola of eccentricity e, 1 for a parabola.
        Calibrations may give more than 1 for wide lenses.
    fx, fy : float
        Generalized focal lengths in pixels.
    cx, cy : float
        The mirror's center in the image, in pixels; integers are pixel centers.
    distortion : tuple of 4 floats
        ``k1, k2, p1, p2`` of the lens. Default: none.
    elevation_min, elevation_max : float
        The mirror's ring in radians, in the camera's own frame: below is the camera itself,
        above the mirror's rim.
    mirrored : bool
        Whether left and right are exchanged, as a single mirror does; False if the image was
        flipped before.
    mount : Mount
        How the camera sits on the robot.

    Raises
    ------
    ValueError
        If a parameter is out of range or not finite.
    """

    model: ClassVar[str] = "hyperbolic"

    xi: float
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = coefficients(4)
    elevation_min: float = angle(-np.pi / 2)
    elevation_max: float = angle(np.pi / 2)
    mirrored: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "xi", "fx", "fy")
        if not self.elevation_min < self.elevation_max:
            raise ValueError(
                "HyperbolicMirror: elevation_min, elevation_max: expected min < max, "
                f"got {self.elevation_min:.6g} and {self.elevation_max:.6g}"
            )

    @cached_property
    def _axes(self) -> FloatArray:
        return image_axes("down", self.mirrored)

    @cached_property
    def _coefficients(self) -> tuple[float, ...]:
        return (*self.distortion, 0.0)

    @cached_property
    def _least_depth(self) -> float:
        """The least component along the image's middle that is projected one to one."""
        # at this depth the image is infinitely far out (xi <= 1) or folds (xi > 1)
        return -min(self.xi, 1.0 / self.xi) + 1e-6

    def _in_ring(self, elevation: FloatArray) -> FloatArray:
        # a bearing on the ring's very edge comes back with rounding errors
        slack = 1e-9
        inside = (elevation >= self.elevation_min - slack) & (
            elevation <= self.elevation_max + slack
        )
        return np.where(inside, 1.0, np.nan)

    def _pixels_to_angles(self, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        points = undistort((pixels - (self.cx, self.cy)) / (self.fx, self.fy), self._coefficients)
        r2 = np.einsum("ij,ij->i", points, points)
        with np.errstate(invalid="ignore"):
            # (points, 1) times the factor, less xi along the middle, lies on the sphere
            root = np.sqrt(1.0 + (1.0 - self.xi**2) * r2)
        factor = (self.xi + root) / (r2 + 1.0)
        depth = factor - self.xi
        rays = np.column_stack([points * factor[:, None], depth])
        rays[~(depth >= self._least_depth)] = np.nan
        azimuth, elevation = bearing_angles(rays @ self._axes.T)
        ring = self._in_ring(elevation)
        return azimuth * ring, elevation * ring

    def _angles_to_pixels(self, azimuth: FloatArray, elevation: FloatArray) -> FloatArray:
        rays = bearing_vectors(azimuth, elevation) @ self._axes
        seen = rays[:, 2] >= self._least_depth
        points = rays[:, :2] / np.where(seen, rays[:, 2] + self.xi, np.nan)[:, None]
        limit = fold_radius(self._coefficients)
        points[np.linalg.norm(points, axis=1) >= limit] = np.nan
        pixels = distort(points, self._coefficients) * (self.fx, self.fy) + (self.cx, self.cy)
        return np.asarray(pixels * self._in_ring(elevation)[:, None])
