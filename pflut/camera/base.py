"""What every camera model offers: pixels to bearings and back."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.camera.fields import check_fields
from pflut.camera.mount import Mount
from pflut.geometry import FloatArray, bearing_angles, bearing_vectors

# a bearing on the image's very border comes back from a projection with rounding errors
BORDER_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Camera(ABC):
    """A central camera: every pixel looks along one ray from one point.

    Pixels are rows ``[u, v]``, u to the right, v down; integers are pixel centres (OpenCV's
    convention), so the image covers ``[-0.5, width - 0.5] x [-0.5, height - 0.5]``. Bearings
    are in the robot frame (x forward, y left, z up), the mount is applied.

    Parameters
    ----------
    width, height : int
        Of the image in pixels.
    mount : Mount
        How the camera sits on the robot.
    """

    model: ClassVar[str]

    width: int
    height: int
    mount: Mount = field(default_factory=Mount, kw_only=True)

    def __post_init__(self) -> None:
        check_fields(self)
        if not isinstance(self.mount, Mount):
            raise ValueError(f"{type(self).__name__}: mount: expected a Mount, got {self.mount!r}")

    @property
    def horizontally_periodic(self) -> bool:
        """Whether the image's right border continues at its left border."""
        return False

    def bearings(self, pixels: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Give the bearings of pixels.

        Parameters
        ----------
        pixels : array_like of shape (n, 2)
            ``[u, v]``, sub-pixel.

        Returns
        -------
        azimuth : ndarray of shape (n,)
            Radians in [0, 2 pi), counter-clockwise, in the robot frame. NaN where the pixel
            lies outside the image or has no ray.
        elevation : ndarray of shape (n,)
            Radians in [-pi/2, pi/2], NaN likewise.

        Raises
        ------
        ValueError
            If ``pixels`` has another shape.
        """
        array = np.asarray(pixels, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != 2:
            raise ValueError(f"pixels: expected shape (n, 2), got {array.shape}")
        azimuth, elevation = self._pixels_to_angles(self._inside(array))
        if not self.mount.is_aligned:
            vectors = bearing_vectors(azimuth, elevation)
            azimuth, elevation = bearing_angles(vectors @ self.mount.rotation().T)
        return azimuth, elevation

    def project(self, azimuth: ArrayLike, elevation: ArrayLike) -> FloatArray:
        """Give the pixels that look along bearings.

        Parameters
        ----------
        azimuth, elevation : array_like of shape (n,)
            Radians in the robot frame.

        Returns
        -------
        ndarray of shape (n, 2)
            ``[u, v]``, sub-pixel. NaN where the camera does not see the bearing.

        Raises
        ------
        ValueError
            If the shapes differ or are not one-dimensional.
        """
        a = np.asarray(azimuth, dtype=np.float64)
        b = np.asarray(elevation, dtype=np.float64)
        if a.ndim != 1 or a.shape != b.shape:
            raise ValueError(
                f"azimuth, elevation: expected two arrays (n,), got {a.shape} and {b.shape}"
            )
        if not self.mount.is_aligned:
            a, b = bearing_angles(bearing_vectors(a, b) @ self.mount.rotation())
        return self._inside(self._angles_to_pixels(a, b))

    def save(self, path: str | Path) -> None:
        """Write the camera to a TOML file (see ``pflut.camera.files.save_camera``)."""
        from pflut.camera.files import save_camera

        save_camera(self, path)

    def unwrap_maps(self, target: Camera) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Give the ``cv2.remap`` maps to a panorama (see `pflut.camera.unwrap.unwrap_maps`)."""
        from pflut.camera.unwrap import unwrap_maps

        return unwrap_maps(self, target)

    def _inside(self, pixels: FloatArray) -> FloatArray:
        """Replace pixels outside the image by NaN; a periodic image has no sides."""
        u, v = pixels[:, 0], pixels[:, 1]
        low, end = -0.5 - BORDER_TOLERANCE, -0.5 + BORDER_TOLERANCE
        seen = (v >= low) & (v <= self.height + end)
        if not self.horizontally_periodic:
            seen &= (u >= low) & (u <= self.width + end)
        return np.where(seen[:, None], pixels, np.nan)

    @abstractmethod
    def _pixels_to_angles(self, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Give azimuth in [0, 2 pi) and elevation in the camera's own frame; NaN stays NaN."""

    @abstractmethod
    def _angles_to_pixels(self, azimuth: FloatArray, elevation: FloatArray) -> FloatArray:
        """Give the pixels of bearings in the camera's own frame; NaN where there are none."""
