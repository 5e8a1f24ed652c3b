"""Textures: an atlas with all levels of detail, and the noise that pictures are made with."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]

MAX_LEVEL = 10


@dataclass(frozen=True, eq=False)
class TextureAtlas:
    """All textures of a scene in the two arrays that the renderer reads.

    Attributes
    ----------
    texels : ndarray of shape (t, 4) uint8
        Red, green, blue and alpha of every texel of every level, row by row. The values are
        square roots of reflectances, close to what a screen shows.
    levels : ndarray of shape (textures, MAX_LEVEL + 1, 3) int64
        First texel, log2 of the width and log2 of the height of each level of detail; a short
        pyramid repeats its last level.
    """

    texels: NDArray[np.uint8]
    levels: NDArray[np.int64]

    @classmethod
    def from_images(cls, images: list[Image]) -> TextureAtlas:
        """Build the atlas: each level is half the one before.

        Parameters
        ----------
        images : list of ndarray of shape (h, w, 3) or (h, w, 4) uint8
            Sides are powers of two.

        Returns
        -------
        TextureAtlas

        Raises
        ------
        ValueError
            If a side is no power of two, or the type is another.
        """
        pieces: list[Image] = []
        levels = np.zeros((len(images), MAX_LEVEL + 1, 3), dtype=np.int64)
        total = 0
        for number, image in enumerate(images):
            level = _with_alpha(image, number)
            for depth in range(MAX_LEVEL + 1):
                height, width = level.shape[:2]
                levels[number, depth] = total, width.bit_length() - 1, height.bit_length() - 1
                if depth == MAX_LEVEL or min(height, width) == 1:
                    levels[number, depth:] = levels[number, depth]
                    break
                pieces.append(level.reshape(-1, 4))
                total += height * width
                level = cv2.resize(level, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
            pieces.append(level.reshape(-1, 4))
            total += level.shape[0] * level.shape[1]
        return cls(np.ascontiguousarray(np.concatenate(pieces)), levels)


def _with_alpha(image: Image, number: int) -> Image:
    """Check an image and give it an opaque alpha channel if it has none."""
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] not in (3, 4):
        raise ValueError(
            f"texture {number}: expected uint8 (h, w, 3 or 4), got {image.dtype} {image.shape}"
        )
    if any(side & (side - 1) or side == 0 for side in image.shape[:2]):
        raise ValueError(f"texture {number}: expected sides of powers of two, got {image.shape}")
    if image.shape[2] == 4:
        return image
    return np.dstack([image, np.full(image.shape[:2], 255, dtype=np.uint8)])


def to_image(values: NDArray[np.floating]) -> Image:
    """Turn values in [0, 1] of shape (h, w, 3) into a picture."""
    return np.asarray(np.clip(values * 255.0 + 0.5, 0.0, 255.0), dtype=np.uint8)


def noise(
    rng: np.random.Generator, height: int, width: int, cells: tuple[int, int], octaves: int = 4
) -> NDArray[np.float32]:
    """Draw smooth noise that repeats without a seam.

    Parameters
    ----------
    rng : Generator
    height, width : int
        Of the result in pixels.
    cells : (int, int)
        Bumps along the height and the width of the first octave, powers of two as the sides
        themselves; each next one has twice as many
        at half the strength.
    octaves : int

    Returns
    -------
    ndarray of shape (height, width) float32
        Mean 0, standard deviation 1.
    """
    total = np.zeros((height, width), dtype=np.float32)
    for octave in range(octaves):
        rows = min(cells[0] << octave, height)
        columns = min(cells[1] << octave, width)
        grid = rng.standard_normal((rows, columns), dtype=np.float32)
        pad_y, pad_x = min(rows, 2), min(columns, 2)
        grid = np.pad(grid, ((pad_y, pad_y), (pad_x, pad_x)), mode="wrap")
        scale_y, scale_x = height // rows, width // columns
        fine = cv2.resize(grid, None, fx=scale_x, fy=scale_y, interpolation=cv2.INTER_CUBIC)
        total += (
            0.5**octave
            * fine[
                pad_y * scale_y : pad_y * scale_y + height,
                pad_x * scale_x : pad_x * scale_x + width,
            ]
        )
    return np.asarray((total - total.mean()) / max(float(total.std()), 1e-6))


def plain(
    rng: np.random.Generator, color: tuple[float, float, float], size: int = 64, grain: float = 0.01
) -> Image:
    """Paint one color with a little grain.

    Parameters
    ----------
    rng : Generator
    color : (float, float, float)
        Red, green, blue in [0, 1].
    size : int
        Side in pixels, a power of two.
    grain : float
        Standard deviation of the brightness.

    Returns
    -------
    ndarray of shape (size, size, 3) uint8
    """
    bumps = noise(rng, size, size, (size // 8, size // 8), octaves=3)
    return to_image(np.asarray(color) + grain * bumps[..., None])
