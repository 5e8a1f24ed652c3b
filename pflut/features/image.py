"""Images from files, and what an image must be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def read_image(path: str | Path) -> NDArray[np.uint8]:
    """Read an image file as 8-bit gray.

    Parameters
    ----------
    path : str or Path
        Any format that OpenCV decodes; color is converted, 16 bits become 8. An orientation
        in the file's EXIF data is not applied: the camera file is about the pixels as stored.

    Returns
    -------
    ndarray of shape (H, W), uint8

    Raises
    ------
    ValueError
        If the file does not decode as an image; naming it.
    OSError
        If the file cannot be read.
    """
    import cv2

    # reading the bytes here tells a missing file from a broken one, and takes any file name
    data = np.frombuffer(Path(path).read_bytes(), dtype=np.uint8)
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        image = cv2.imdecode(data, flags) if data.size else None
    except cv2.error:
        image = None
    if image is None:
        raise ValueError(f"{path}: does not decode as an image")
    return np.asarray(image, dtype=np.uint8)


def as_gray(image: NDArray[Any], width: int, height: int) -> NDArray[np.uint8]:
    """Check an image against its camera and return it in gray.

    Parameters
    ----------
    image : ndarray of shape (height, width) or (height, width, 3), uint8
        Three channels are blue, green, red, as OpenCV has them.
    width, height : int
        The camera's.

    Returns
    -------
    ndarray of shape (height, width), uint8
        Contiguous.

    Raises
    ------
    ValueError
        If the type, the number of channels or the size is another.
    """
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8:
        got = image.dtype if isinstance(image, np.ndarray) else type(image).__name__
        raise ValueError(f"image: expected an array of uint8, got {got}")
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
        raise ValueError(f"image: expected shape (H, W) or (H, W, 3), got {image.shape}")
    if image.shape[:2] != (height, width):
        raise ValueError(
            f"image: expected the camera's size {width} x {height}, "
            f"got {image.shape[1]} x {image.shape[0]}"
        )
    if image.ndim == 3:
        import cv2

        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    return np.ascontiguousarray(image)
