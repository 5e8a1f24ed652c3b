"""Images from files, and what an image must be."""

from __future__ import annotations

import os
import re
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_STANDARD_ERROR = threading.Lock()
_DAMAGE = re.compile(r"corrupt|premature|truncated|incomplete|error|invalid|CRC|damaged", re.I)


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
        with _decoder_complaints() as complaints:
            image = cv2.imdecode(data, flags) if data.size else None
    except cv2.error:
        image = None
    if image is None:
        raise ValueError(f"{path}: does not decode as an image")
    if complaints:
        raise ValueError(f"{path}: damaged image ({complaints[0]})")
    return np.asarray(image, dtype=np.uint8)


@contextmanager
def _decoder_complaints() -> Iterator[list[str]]:
    """Catch what the libraries below OpenCV write to the standard error of the process.

    libpng and libjpeg report a damaged file there and nowhere else; the image that they give all
    the same is partly invented. The list is filled when the block ends.
    """
    complaints: list[str] = []
    with _STANDARD_ERROR, tempfile.TemporaryFile() as heard:
        kept = os.dup(2)
        os.dup2(heard.fileno(), 2)
        try:
            yield complaints
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            heard.seek(0)
            lines = heard.read().decode(errors="replace").splitlines()
            complaints += [line.strip() for line in lines if _DAMAGE.search(line)]


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
