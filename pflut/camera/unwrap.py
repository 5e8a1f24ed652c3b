"""Unwrapping: the image of any camera as a panorama, which is a camera itself."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut.camera.base import Camera
from pflut.camera.equirectangular import EquirectangularPanorama
from pflut.camera.mount import Mount
from pflut.geometry import TWO_PI


def unwrap_maps(camera: Camera, target: Camera) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Give the maps that ``cv2.remap`` makes the target's image with.

    Parameters
    ----------
    camera : Camera
        Of the image that is there, with its mount.
    target : Camera
        Of the image wanted, mostly a panorama; both are in one robot frame, so that a level
        target also undoes a tilted mount.

    Returns
    -------
    map_u, map_v : ndarray of shape (target.height, target.width), float32
        Columns and rows in the camera's image; NaN where it does not see the bearing.
    """
    maps = np.empty((2, target.height, target.width), dtype=np.float32)
    u = np.arange(target.width, dtype=np.float64)
    for v in range(target.height):
        azimuth, elevation = target.bearings(np.column_stack([u, np.full_like(u, v)]))
        maps[:, v] = camera.project(azimuth, elevation).T
    return maps[0], maps[1]


class Unwrapper:
    """Turn images of one camera into panoramas: the maps are computed once.

    Parameters
    ----------
    camera : Camera
        Of the images that are there.
    panorama : Camera, optional
        Of the images wanted; `default_panorama` of the camera if not given.
    margin : int
        How far, in pixels, `mask` keeps from what the camera does not see.

    Attributes
    ----------
    camera : Camera
        Of the images that go in.
    panorama : Camera
        Of the images that come out: use it for their bearings.
    mask : ndarray of shape (panorama.height, panorama.width), bool
        Where the panorama shows something, less the margin; for the feature extractor, which
        would otherwise find the border of the unseen in every image at the same place.
    """

    def __init__(self, camera: Camera, panorama: Camera | None = None, *, margin: int = 8) -> None:
        import cv2

        self.camera = camera
        self.panorama = default_panorama(camera) if panorama is None else panorama
        map_u, map_v = unwrap_maps(camera, self.panorama)
        self._seen = np.isfinite(map_u)
        outside = np.float32(-1e4)
        self._maps = np.where(self._seen, map_u, outside), np.where(self._seen, map_v, outside)
        window = np.ones((2 * margin + 1, 2 * margin + 1), dtype=np.uint8)
        self.mask = np.asarray(cv2.erode(self._seen.astype(np.uint8), window) > 0)

    def __call__(self, image: NDArray[Any]) -> NDArray[Any]:
        """Unwrap an image.

        Parameters
        ----------
        image : ndarray of shape (camera.height, camera.width) or (..., 3), uint8

        Returns
        -------
        ndarray of shape (panorama.height, panorama.width) or (..., 3), uint8
            Linearly interpolated; zero where the camera sees nothing.

        Raises
        ------
        ValueError
            If the image has another size.
        """
        import cv2

        size = (self.camera.height, self.camera.width)
        if image.shape[:2] != size:
            raise ValueError(f"image: expected shape {size}, got {image.shape}")
        around = self.camera.horizontally_periodic
        border = cv2.BORDER_WRAP if around else cv2.BORDER_REPLICATE
        panorama = cv2.remap(image, *self._maps, cv2.INTER_LINEAR, borderMode=border)
        panorama[~self._seen] = 0
        return np.asarray(panorama)


def default_panorama(camera: Camera, *, width: int = 1024) -> EquirectangularPanorama:
    """Choose a level full panorama for a camera that sees all around.

    Parameters
    ----------
    camera : Camera
    width : int
        Of the panorama in pixels.

    Returns
    -------
    EquirectangularPanorama
        Square pixels, as high above the floor as the camera; its vertical field is the widest run
        of elevations at which the camera sees at least 95 % of all azimuths.

    Raises
    ------
    ValueError
        If there is no such elevation: the camera does not see all around.
    """
    rows = 360
    elevation = np.pi * (0.5 - (np.arange(rows) + 0.5) / rows)
    azimuth = TWO_PI * np.arange(180) / 180
    grid_azimuth, grid_elevation = np.meshgrid(azimuth, elevation)
    pixels = camera.project(grid_azimuth.ravel(), grid_elevation.ravel())
    share = np.isfinite(pixels[:, 0]).reshape(rows, -1).mean(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], share >= 0.95, [0]]).astype(int)))
    if edges.size == 0:
        raise ValueError(
            f"{type(camera).__name__}: does not see all around, expected a panorama to unwrap to"
        )
    starts, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - starts))
    step = np.pi / rows
    high = np.pi / 2 - starts[longest] * step
    low = np.pi / 2 - ends[longest] * step
    height = max(1, round(width * (high - low) / TWO_PI))
    return EquirectangularPanorama(
        width,
        height,
        max(low, -np.pi / 2),
        min(high, np.pi / 2),
        mount=Mount(height=camera.mount.height),
    )
