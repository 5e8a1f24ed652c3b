"""The equirectangular panorama: rows are elevations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pflut.camera.panorama import Panorama
from pflut.geometry import FloatArray


@dataclass(frozen=True)
class EquirectangularPanorama(Panorama):
    """A panorama with equally spaced azimuths and elevations; see `Panorama`.

    Row v looks along ``elevation_max - (v + 1/2) / height (elevation_max - elevation_min)``.
    The default is the whole sphere, as 360 degree cameras and renderers write it.

    Notes
    -----
    A column is ``2 pi / width`` wide and a pixel's bearing is that of its centre. Some data
    describes itself with ``azimuth = pi - u / (width - 1) 2 pi`` instead, which counts the
    column at the seam twice; the two differ by at most half a pixel, 0.09 degrees at a width
    of 2048.
    """

    model: ClassVar[str] = "equirectangular"

    def _row_value(self, elevation: FloatArray) -> FloatArray:
        return elevation

    def _row_elevation(self, value: FloatArray) -> FloatArray:
        # rounding on the border of the image must not pass the pole
        return np.clip(value, -np.pi / 2, np.pi / 2)
