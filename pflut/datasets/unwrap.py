"""A folder dataset of a mirror or a fisheye lens as one of panoramas."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pflut.camera.unwrap import Unwrapper, default_panorama
from pflut.datasets.folder import IMAGE_SUFFIXES, load_folder, write_folder


def unwrap_folder(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    *,
    width: int = 1024,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a folder dataset anew, its images unwrapped to level panoramas.

    The new folder has the panoramas' ``camera.toml`` and a ``mask.png`` of what the camera saw,
    less what a mask of the old folder leaves out. Poses, references, the floor plan, the name and
    the elevations of the mask are those of the old one. The images are gray and numbered.

    Parameters
    ----------
    source : path
        A folder dataset of a camera that sees all around.
    target : path
        The folder to create; it must not exist, or be empty.
    width : int
        Of the panoramas in pixels.
    progress : callable, optional
        Called as ``progress(images written, images)``.

    Returns
    -------
    Path
        The new folder.

    Raises
    ------
    FileExistsError
        If the target holds something already.
    ValueError
        If the camera does not see all around, or naming the file of what is wrong in the source.
    OSError
        If a file is missing.
    """
    dataset = load_folder(source)
    try:
        panorama = default_panorama(dataset.camera, width=width)
    except ValueError as error:
        raise ValueError(f"{Path(source) / 'camera.toml'}: {error}") from None
    unwrap = Unwrapper(dataset.camera, panorama)
    mask = unwrap.mask
    if dataset.mask is not None:
        # between the used and the ignored the interpolated values are ignored
        mask = mask & (unwrap(np.where(dataset.mask, 255, 0).astype(np.uint8)) == 255)
    listed = len(dataset.reference_indices) > 0
    suffix = dataset.image_paths[0].suffix.lower()
    return write_folder(
        target,
        camera=panorama,
        stamps=dataset.stamps,
        images=(unwrap(dataset.image(index)) for index in range(len(dataset))),
        ground_truth=dataset.ground_truth,
        odometry=dataset.odometry,
        reference_indices=dataset.reference_indices if listed else None,
        floor_plan=dataset.floor_plan,
        mask_elevation=dataset.mask_elevation,
        mask=mask,
        name=dataset.name,
        suffix=suffix if suffix in IMAGE_SUFFIXES else ".png",
        progress=progress,
    )
