"""What equirectangular and cylindrical panoramas share: columns are azimuths."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from pflut.camera.base import Camera
from pflut.camera.fields import angle
from pflut.geometry import TWO_PI, FloatArray, wrap_to_2pi, wrap_to_pi


@dataclass(frozen=True)
class Panorama(Camera):
    """A panorama whose columns are equally spaced azimuths, decreasing to the right.

    The middle of the image, ``u = (width - 1) / 2``, looks along ``azimuth_center``; column u
    looks along ``azimuth_center + (1/2 - (u + 1/2) / width) azimuth_span``.

    Parameters
    ----------
    width, height : int
        Of the image in pixels.
    elevation_min, elevation_max : float
        The vertical field in radians: the image's lower and upper border (of the pixels, not
        their centres).
    azimuth_center : float
        Radians in the camera's frame, where the middle of the image looks.
    azimuth_span : float
        The horizontal field in radians, at most 2 pi, which is the default.
    mount : Mount
        How the camera sits on the robot.

    Raises
    ------
    ValueError
        If a field of view is empty or beyond the model.
    """

    elevation_min: float = angle(-np.pi / 2)
    elevation_max: float = angle(np.pi / 2)
    azimuth_center: float = angle(0.0)
    azimuth_span: float = angle(TWO_PI)

    def __post_init__(self) -> None:
        super().__post_init__()
        name = type(self).__name__
        if not 0.0 < self.azimuth_span <= TWO_PI:
            raise ValueError(
                f"{name}: azimuth_span: expected 0 < span <= 2 pi, got {self.azimuth_span:.6g}"
            )
        low, high = self.elevation_min, self.elevation_max
        if not (low < high and max(-low, high) <= np.pi / 2):
            raise ValueError(
                f"{name}: elevation_min, elevation_max: expected min < max within "
                f"[-pi/2, pi/2], got {low:.6g} and {high:.6g}"
            )

    @property
    def horizontally_periodic(self) -> bool:
        """Whether the panorama goes all the way around."""
        return self.azimuth_span == TWO_PI

    def _pixels_to_angles(self, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        fraction = 0.5 - (pixels[:, 0] + 0.5) / self.width
        azimuth = wrap_to_2pi(self.azimuth_center + fraction * self.azimuth_span)
        top, bottom = self._row_value(np.array([self.elevation_max, self.elevation_min]))
        value = top - (pixels[:, 1] + 0.5) / self.height * (top - bottom)
        return azimuth, self._row_elevation(value)

    def _angles_to_pixels(self, azimuth: FloatArray, elevation: FloatArray) -> FloatArray:
        offset = wrap_to_pi(azimuth - self.azimuth_center)
        u = (0.5 - offset / self.azimuth_span) * self.width - 0.5
        top, bottom = self._row_value(np.array([self.elevation_max, self.elevation_min]))
        v = (top - self._row_value(elevation)) / (top - bottom) * self.height - 0.5
        return np.stack([u, v], axis=1)

    @abstractmethod
    def _row_value(self, elevation: FloatArray) -> FloatArray:
        """Give the function of the elevation that rows are equally spaced in."""

    @abstractmethod
    def _row_elevation(self, value: FloatArray) -> FloatArray:
        """Invert ``_row_value``."""
