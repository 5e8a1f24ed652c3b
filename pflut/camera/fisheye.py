"""The fisheye lens: OpenCV's ``cv2.fisheye`` model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from pflut.camera.axes import image_axes
from pflut.camera.base import Camera
from pflut.camera.fields import angle, check_positive, coefficients
from pflut.camera.radial import first_positive_root, invert_increasing
from pflut.geometry import FloatArray, bearing_angles, bearing_vectors


@dataclass(frozen=True)
class Fisheye(Camera):
    """A fisheye camera: the radius is a polynomial of the angle from the axis.

    ``r = a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8)`` with a the angle from the axis, and
    ``u = fx r cos + cx``, ``v = fy r sin + cy`` (Kannala and Brandt 2006, as OpenCV has it).
    Unlike OpenCV's functions it goes beyond 90 degrees from the axis.

    Parameters
    ----------
    width, height : int
        Of the image in pixels.
    fx, fy : float
        Focal lengths in pixels.
    cx, cy : float
        Where the axis is in the image, in pixels; integers are pixel centers.
    distortion : tuple of 4 floats
        ``k1, k2, k3, k4``. Default: none, the equidistant projection.
    max_angle : float
        Radians from the axis to the border of what the lens shows; pi by default. The model
        also ends where the polynomial stops growing.
    looks : {"forward", "down", "up"}
        Where the axis points in the camera's frame. The upper border of the image looks up for
        a camera that looks forward, else forward.
    mount : Mount
        How the camera sits on the robot.

    Raises
    ------
    ValueError
        If a parameter is out of range or not finite.
    """

    model: ClassVar[str] = "fisheye"

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = coefficients(4)
    max_angle: float = angle(np.pi)
    looks: str = "forward"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "fx", "fy", "max_angle")
        try:
            image_axes(self.looks, False)
        except ValueError as error:
            raise ValueError(f"Fisheye: {error}") from None

    @cached_property
    def _axes(self) -> FloatArray:
        return image_axes(self.looks, False)

    @cached_property
    def _limit(self) -> float:
        """The largest angle from the axis that the model maps one to one."""
        k = np.array(self.distortion)
        turn = np.sqrt(first_positive_root([1.0, *(k * (3.0, 5.0, 7.0, 9.0))]))
        # at the turn itself the inverse is infinitely steep
        return float(min(self.max_angle, np.pi, turn * (1.0 - 1e-6)))

    def _radius(self, a: FloatArray) -> FloatArray:
        k1, k2, k3, k4 = self.distortion
        s = a * a
        return a * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))))

    def _slope(self, a: FloatArray) -> FloatArray:
        k1, k2, k3, k4 = self.distortion
        s = a * a
        return 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4)))

    def _pixels_to_angles(self, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        points = (pixels - (self.cx, self.cy)) / (self.fx, self.fy)
        radius = np.hypot(points[:, 0], points[:, 1])
        a = invert_increasing(self._radius, self._slope, radius, self._limit)
        sideways = np.sin(a) / np.where(radius > 0.0, radius, 1.0)
        rays = np.column_stack([points * sideways[:, None], np.cos(a)]) @ self._axes.T
        return bearing_angles(rays)

    def _angles_to_pixels(self, azimuth: FloatArray, elevation: FloatArray) -> FloatArray:
        rays = bearing_vectors(azimuth, elevation) @ self._axes
        sideways = np.hypot(rays[:, 0], rays[:, 1])
        a = np.arctan2(sideways, rays[:, 2])
        scale = self._radius(a) / np.where(sideways > 0.0, sideways, 1.0)
        pixels = rays[:, :2] * scale[:, None] * (self.fx, self.fy) + (self.cx, self.cy)
        return np.where((a <= self._limit)[:, None], pixels, np.nan)
