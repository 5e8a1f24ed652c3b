"""The cylindrical panorama: rows are tangents of elevations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pflut.camera.fields import angle
from pflut.camera.panorama import Panorama
from pflut.geometry import FloatArray


@dataclass(frozen=True)
class CylindricalPanorama(Panorama):
    """A panorama on an upright cylinder: vertical lines stay straight; see `Panorama`.

    Row v looks along the elevation whose tangent is equally spaced between those of
    ``elevation_max`` (the upper border) and ``elevation_min``. The default field is 45 degrees
    up and down; pixels are square where
    ``height / width = (tan elevation_max - tan elevation_min) / azimuth_span``.

    Raises
    ------
    ValueError
        If the vertical field reaches the poles, which a cylinder does not show.
    """

    model: ClassVar[str] = "cylindrical"

    elevation_min: float = angle(-np.pi / 4)
    elevation_max: float = angle(np.pi / 4)

    def __post_init__(self) -> None:
        super().__post_init__()
        if max(-self.elevation_min, self.elevation_max) >= np.pi / 2:
            raise ValueError(
                "CylindricalPanorama: elevation_min, elevation_max: expected less than pi/2 up "
                f"and down, got {self.elevation_min:.6g} and {self.elevation_max:.6g}"
            )

    def _row_value(self, elevation: FloatArray) -> FloatArray:
        return np.asarray(np.tan(elevation))

    def _row_elevation(self, value: FloatArray) -> FloatArray:
        return np.asarray(np.arctan(value))
