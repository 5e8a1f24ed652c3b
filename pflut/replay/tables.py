"""The likelihood table of a replay: chosen by its name, with grids that suit the camera."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from pflut.camera.base import Camera
from pflut.geometry import bearing_vectors
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.files import load_table
from pflut.likelihood.sampling import Progress
from pflut.likelihood.table import LikelihoodTable

SHIPPED: dict[str, Literal["panorama", "home", "perspective"]] = {
    "default": "panorama",
    "home": "home",
    "perspective": "perspective",
}
COMMON_BINS = 192
"""A particle interpolates between cells; wider ones cost accuracy, narrower ones only time."""
DENSE_BINS = 128
SHARP_BINS = 256
SHARP_PIXEL = 0.002


def choose_table(
    name: str = "default",
    *,
    bins: int | None = None,
    camera: Camera | None = None,
    progress: Progress | None = None,
) -> LikelihoodTable | DenseTable:
    """Load a likelihood table by its name.

    Parameters
    ----------
    name : str
        "default", "home" and "perspective" come with pflut, see `LikelihoodTable.default`; "dense"
        is the paper's table, learned at its first use; anything else is a table's file.
    bins : int, optional
        Cells an axis of the grids. By default a file's own, and of the others what suits the
        camera.
    camera : Camera, optional
    progress : callable, optional
        Called as ``progress(samples_done, samples_total)`` while the paper's table is learned.

    Returns
    -------
    LikelihoodTable or DenseTable

    Raises
    ------
    ValueError
        If the file is damaged, or holds a dense table of other bins.
    FileNotFoundError
        If there is no such file.
    """
    suitable = COMMON_BINS if camera is None else camera_bins(camera)
    if name in SHIPPED:
        return LikelihoodTable.default(SHIPPED[name], bins=bins or suitable)
    if name == "dense":
        # what the paper's table costs grows with the square
        suitable = DENSE_BINS if suitable == COMMON_BINS else suitable
        return DenseTable.default(bins=bins or suitable, progress=progress)
    table = load_table(name)
    if bins is None or bins == table.bins:
        return table
    if isinstance(table, LikelihoodTable):
        return table.with_bins(bins)
    raise ValueError(f"{name}: a dense table of {table.bins} bins, it cannot have {bins}")


def table_record(name: str, table: LikelihoodTable | DenseTable) -> dict[str, Any]:
    """Say which table was used, for a JSON file.

    Parameters
    ----------
    name : str
        As `choose_table` takes it.
    table : LikelihoodTable or DenseTable

    Returns
    -------
    dict
        Another one for another table, even if it has the name of a former one.
    """
    return {"file": name, "bins": table.bins, "learned_from": table.learned_from}


def camera_bins(camera: Camera) -> int:
    """Give the bins of a table that suit a camera: more where its bearings are sharp.

    Sharp is a camera with less than 0.002 rad a pixel, in the median over its image: perspective
    cameras mostly, panoramas from some 3,000 columns on.
    """
    u, v = np.meshgrid(np.linspace(0, camera.width - 2, 24), np.linspace(0, camera.height - 1, 24))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    here = bearing_vectors(*camera.bearings(pixels))
    beside = bearing_vectors(*camera.bearings(pixels + np.array([1.0, 0.0])))
    angles = np.linalg.norm(here - beside, axis=1)
    seen = angles[np.isfinite(angles)]
    return SHARP_BINS if seen.size and np.median(seen) < SHARP_PIXEL else COMMON_BINS
