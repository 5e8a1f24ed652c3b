"""Decide how a dataset is replayed: driven with odometry, or image by image."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pflut.datasets.base import Dataset
from pflut.geometry import FloatArray
from pflut.replay.options import ReplayOptions
from pflut.simulation.odometry import odometry_stream, simulate_odometry


@dataclass(frozen=True, eq=False)
class ReplayPlan:
    """How a dataset is replayed.

    Parameters
    ----------
    dataset : Dataset
        With odometry, if it is driven.
    each_on_its_own : bool
        Whether each image is localized in the whole map, without odometry.
    notes : tuple of str
        What was decided without being asked for, for the user to know.
    """

    dataset: Dataset
    each_on_its_own: bool
    notes: tuple[str, ...]


def prepare_dataset(
    dataset: Dataset,
    options: ReplayOptions,
    *,
    leave_one_out: bool | None = None,
    simulated_odometry: bool | None = None,
    max_images: int | None = None,
) -> ReplayPlan:
    """Decide how a dataset is replayed, and simulate the odometry that it lacks.

    Parameters
    ----------
    dataset : Dataset
    options : ReplayOptions
        Gives noise and seed of the simulated odometry.
    leave_one_out : bool, optional
        Localize each image on its own, against all references but itself. By default where
        images are both references and queries, or neither odometry nor ground truth to simulate
        it from is there.
    simulated_odometry : bool, optional
        Simulate odometry from the ground truth. By default where a drive has none.
    max_images : int, optional
        Leave out the query images after so many.

    Returns
    -------
    ReplayPlan

    Raises
    ------
    ValueError
        If there is nothing to localize, or odometry is needed and cannot be simulated.
    """
    notes = []
    if leave_one_out and not dataset.leave_one_out:
        dataset = dataset.with_references("all")
        notes.append("every image is a reference for all the others")
    if not len(dataset.query_indices):
        raise ValueError(
            f"{dataset.name}: every image is a reference and none is left to localize, expected "
            "fewer references or to leave one out"
        )
    if max_images is not None:
        if max_images < 1:
            raise ValueError(f"max_images: expected at least 1, got {max_images}")
        dataset = replace(dataset, query_indices=dataset.query_indices[:max_images])
    measured, posed = dataset.odometry is not None, dataset.ground_truth is not None
    if leave_one_out is None:
        wanted = bool(simulated_odometry)
        leave_one_out = not wanted and (dataset.leave_one_out or not (measured or posed))
        if leave_one_out:
            notes.append("each image is localized on its own, against all references but itself")
    elif not leave_one_out and dataset.leave_one_out:
        raise ValueError(
            f"{dataset.name}: its images are both references and queries, which only "
            "leave_one_out can replay; expected other references, such as 'every:2'"
        )
    if leave_one_out:
        return ReplayPlan(dataset, True, tuple(notes))
    if simulated_odometry or (simulated_odometry is None and not measured):
        dataset = dataset.with_odometry(_odometry(dataset, options))
        notes.append(
            "odometry simulated from the ground truth: "
            f"{100 * options.odometry_noise:g} % noise, scale {options.odometry_scale:g}, "
            f"drift {np.degrees(options.odometry_drift):.2g} deg/m"
        )
    return ReplayPlan(dataset, False, tuple(notes))


def _odometry(dataset: Dataset, options: ReplayOptions) -> FloatArray:
    """Simulate odometry along the true poses, NaN where there are none."""
    if dataset.ground_truth is None:
        raise ValueError(f"{dataset.name}: no ground truth to simulate odometry from")
    known = np.isfinite(dataset.ground_truth).all(axis=1)
    variance = options.odometry_noise**2
    measured = np.full(dataset.ground_truth.shape, np.nan)
    measured[known] = simulate_odometry(
        dataset.ground_truth[known],
        rotation_noise_from_rotation=variance,
        translation_noise_from_translation=variance,
        scale=options.odometry_scale,
        heading_drift=options.odometry_drift,
        rng=odometry_stream(options.seed),
    )
    return measured
