"""Where the middle and the upper border of an image look in the camera's frame."""

from __future__ import annotations

import numpy as np

from pflut.geometry import FloatArray

# columns: the directions of the image's right, its lower border and its middle
_AXES = {
    "forward": ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)),
    "down": ((0.0, -1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
    "up": ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
}
LOOKS = tuple(_AXES)


def image_axes(looks: str, mirrored: bool) -> FloatArray:
    """Give the matrix camera <- image: columns u (right), v (down), middle of the image.

    Parameters
    ----------
    looks : {"forward", "down", "up"}
        Where the middle looks. The upper border looks up for a camera that looks forward, else
        forward.
    mirrored : bool
        Whether left and right are exchanged, as in the image of a single mirror.

    Returns
    -------
    ndarray of shape (3, 3)
        A rotation, or with ``mirrored`` a reflection.

    Raises
    ------
    ValueError
        If ``looks`` is another text.
    """
    if looks not in _AXES:
        raise ValueError(f"looks: expected one of {', '.join(LOOKS)}, got {looks!r}")
    matrix = np.array(_AXES[looks]).T
    if mirrored:
        matrix[:, 0] *= -1.0
    return matrix
