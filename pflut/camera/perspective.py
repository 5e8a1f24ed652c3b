"""The pinhole camera with lens distortion: OpenCV's standard model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from pflut.camera.base import Camera
from pflut.camera.distortion import distort, fold_radius, undistort
from pflut.camera.fields import check_positive, coefficients
from pflut.geometry import FloatArray, bearing_angles, bearing_vectors


@dataclass(frozen=True)
class Perspective(Camera):
    """A perspective camera that looks along x of its own frame.

    Parameters
    ----------
    width, height : int
        Of the image in pixels.
    fx, fy : float
        Focal lengths in pixels.
    cx, cy : float
        Principal point in pixels; integers are pixel centres, as in OpenCV.
    distortion : tuple of 5 or 4 floats
        OpenCV's ``k1, k2, p1, p2, k3``; four numbers leave out k3. Default: none.
    mount : Mount
        How the camera sits on the robot.

    Raises
    ------
    ValueError
        If a focal length is not positive or a number is not finite.

    Notes
    -----
    OpenCV's camera axes (x right, y down, z forward) are this frame's -y, -z and x.
    """

    model: ClassVar[str] = "perspective"

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = coefficients(5, 4)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "fx", "fy")

    @cached_property
    def _coefficients(self) -> tuple[float, ...]:
        return (*self.distortion, 0.0)[:5]

    @cached_property
    def _fold_radius(self) -> float:
        return fold_radius(self._coefficients)

    def _pixels_to_angles(self, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        points = (pixels - (self.cx, self.cy)) / (self.fx, self.fy)
        points = undistort(points, self._coefficients)
        rays = np.stack([np.ones(len(points)), -points[:, 0], -points[:, 1]], axis=1)
        azimuth, elevation = bearing_angles(rays)
        return np.where(np.isnan(points[:, 0]), np.nan, azimuth), elevation

    def _angles_to_pixels(self, azimuth: FloatArray, elevation: FloatArray) -> FloatArray:
        rays = bearing_vectors(azimuth, elevation)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            points = -rays[:, 1:] / rays[:, :1]
            seen = (rays[:, 0] > 0.0) & (np.linalg.norm(points, axis=1) < self._fold_radius)
            points = distort(points, self._coefficients)
        pixels = points * (self.fx, self.fy) + (self.cx, self.cy)
        return np.where(seen[:, None], pixels, np.nan)
