"""From light to a picture: the lens's blur, exposure and noise."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pflut._jit import jit


def blurred(linear: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    """Blur a panorama, around its seam too."""
    pad = int(np.ceil(3.0 * sigma))
    wide = np.pad(linear, ((0, 0), (pad, pad), (0, 0)), mode="wrap")
    size = (2 * pad + 1, 2 * pad + 1)
    soft = cv2.GaussianBlur(wide, size, sigma, borderType=cv2.BORDER_REPLICATE)
    return np.ascontiguousarray(soft[:, pad:-pad])


@jit
def develop(linear, gain, shot, read, noise, image):  # type: ignore[no-untyped-def]
    """Turn linear light into a picture: exposure, sensor noise, a soft shoulder, square root.

    Parameters
    ----------
    linear : ndarray of shape (height, width, 3) float32
    gain : ndarray of shape (3,)
        Exposure times the white balance of each channel.
    shot, read : float
        Variance of the shot noise at full scale, and sd of the read noise.
    noise : ndarray of shape (height, width, 3) float32
        Standard normal.
    image : ndarray of shape (height, width, 3) uint8
        Out: red, green, blue.
    """
    for y in range(linear.shape[0]):
        for x in range(linear.shape[1]):
            for channel in range(3):
                value = gain[channel] * linear[y, x, channel]
                value += noise[y, x, channel] * np.sqrt(shot * value + read * read)
                value = 1.0 - np.exp(-max(value, 0.0))
                image[y, x, channel] = int(255.0 * np.sqrt(value) + 0.5)
