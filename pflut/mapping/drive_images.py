"""The images of a dataset that become the nodes of a map."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pflut.datasets.base import Dataset
from pflut.simulation.odometry import odometry_stream, simulate_odometry

Choice = Literal["all", "references", "queries"]


def image_indices(dataset: Dataset, choice: Choice = "all") -> NDArray[np.intp]:
    """Give the indices of some images of a dataset.

    Parameters
    ----------
    dataset : Dataset
    choice : {"all", "references", "queries"}
        Of which images.

    Returns
    -------
    ndarray of int
        Ascending.
    """
    return {
        "all": np.arange(len(dataset), dtype=np.intp),
        "references": np.sort(dataset.reference_indices),
        "queries": np.sort(dataset.query_indices),
    }[choice]


def choose_images(
    dataset: Dataset, choice: Choice = "all", *, max_images: int | None = None
) -> Dataset:
    """Take the images to be linked out of a dataset.

    Parameters
    ----------
    dataset : Dataset
    choice : {"all", "references", "queries"}
        Of which images.
    max_images : int, optional
        The first ones.

    Returns
    -------
    Dataset
        No references.

    Raises
    ------
    ValueError
        If fewer than two images are left.
    """
    chosen = image_indices(dataset, choice)[:max_images]
    if len(chosen) < 2:
        raise ValueError(f"{dataset.name}: expected 2 images, got {len(chosen)}")
    return dataset.select(chosen)


def drive_images(
    dataset: Dataset,
    choice: Choice = "all",
    *,
    simulate: bool = False,
    max_images: int | None = None,
    seed: int = 0,
) -> Dataset:
    """Take the images of a drive out of a dataset.

    Parameters
    ----------
    dataset : Dataset
    choice : {"all", "references", "queries"}
        Of which images.
    simulate : bool
        Whether odometry is simulated from the ground truth; otherwise the images are those that
        have odometry.
    max_images : int, optional
        The first ones.
    seed : int
        Of the simulated odometry.

    Returns
    -------
    Dataset
        Its images, all of them with odometry; no references.

    Raises
    ------
    ValueError
        If fewer than two images are left.
    """
    chosen = image_indices(dataset, choice)
    source = dataset.ground_truth if simulate else dataset.odometry
    what = "ground truth to simulate odometry from" if simulate else "odometry"
    if source is None:
        raise ValueError(f"{dataset.name}: expected {what}, the dataset has none")
    chosen = chosen[np.isfinite(source[chosen]).all(axis=1)][:max_images]
    if len(chosen) < 2:
        raise ValueError(f"{dataset.name}: expected 2 images with {what}, got {len(chosen)}")
    drive = dataset.select(chosen)
    if not simulate:
        return drive
    return drive.with_odometry(simulate_odometry(source[chosen], rng=odometry_stream(seed)))
