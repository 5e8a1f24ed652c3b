"""Replay a dataset: map, sensor model, filter, one step an image."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from pflut.correspondences import ReferenceMatch
from pflut.datasets.base import Dataset
from pflut.features import FeatureCache, FeatureExtractor
from pflut.geometry import FloatArray
from pflut.localization.initial_poses import Bounds
from pflut.localization.localizer import Localizer, Step
from pflut.localization.particle_filter import ParticleFilter
from pflut.posterior import Likelihood
from pflut.reference_map import ReferenceMap
from pflut.replay.each import localize_each
from pflut.replay.filters import make_filter, start_covariance
from pflut.replay.options import ReplayOptions
from pflut.replay.prepare import prepare_dataset
from pflut.replay.result import MatchedPair, ReplayResult, ReplayStep
from pflut.replay.sensor import ReplaySensor
from pflut.replay.tables import choose_table

#: Called as ``progress(stage, done, total)`` with the stages "table", "references", "images".
Progress = Callable[[str, int, int], None]

#: The number under which the particles before the first step are kept.
START = -1


def replay_dataset(
    dataset: Dataset,
    options: ReplayOptions | None = None,
    *,
    table: Likelihood | None = None,
    leave_one_out: bool | None = None,
    simulated_odometry: bool | None = None,
    max_images: int | None = None,
    cache: FeatureCache | None = None,
    keep_particles: Container[int] = (),
    on_step: Callable[[int, ReplayStep], None] | None = None,
    progress: Progress | None = None,
) -> ReplayResult:
    """Localize the query images of a dataset in the map of its reference images.

    Parameters
    ----------
    dataset : Dataset
    options : ReplayOptions, optional
    table : LikelihoodTable or DenseTable, optional
        By default the one that the options name.
    leave_one_out, simulated_odometry : bool, optional
        See `prepare_dataset`.
    max_images : int, optional
        Stop after so many query images.
    cache : FeatureCache, optional
        Features are looked up there, and kept.
    keep_particles : container of int
        The particles after these steps, as they were weighted or resampled, are kept in the
        result; those before the first one as number -1.
    on_step : callable, optional
        Called as ``on_step(number, step)`` after each image.
    progress : callable, optional
        Called as ``progress(stage, done, total)``.

    Returns
    -------
    ReplayResult
        The same seed and options give the same steps, their timings aside.

    Raises
    ------
    ValueError
        If the dataset lacks what the replay needs, or an image does not decode.
    """
    options = ReplayOptions() if options is None else options
    plan = prepare_dataset(
        dataset,
        options,
        leave_one_out=leave_one_out,
        simulated_odometry=simulated_odometry,
        max_images=max_images,
    )
    dataset = plan.dataset
    likelihood = table or choose_table(
        options.table,
        bins=options.bins,
        camera=dataset.camera,
        progress=None if progress is None else partial(progress, "table"),
    )
    extractor = make_extractor(dataset, options)
    reference_map = ReferenceMap.from_dataset(
        dataset,
        extractor,
        cache=cache,
        progress=None if progress is None else partial(progress, "references"),
    )
    snapshots: dict[int, tuple[FloatArray, FloatArray]] = {}
    skipped: tuple[int, ...] = ()
    if plan.each_on_its_own:
        total = len(dataset.query_indices)
        located = localize_each(dataset, reference_map, likelihood, extractor, options, cache=cache)
    else:
        sensor = ReplaySensor(reference_map, likelihood, extractor, options, cache=cache)
        bounds = reference_map.bounds(options.start_margin)
        pf = make_filter(sensor, options, bounds)
        start_filter(pf, dataset, options, bounds)
        localizer = Localizer(dataset, pf)
        total, skipped = len(localizer), localizer.skipped
        located = _drive(localizer, pf, sensor, keep_particles, snapshots)
    if not total:
        raise ValueError(f"{dataset.name}: no image to localize has odometry")

    steps: list[ReplayStep] = []
    pair: MatchedPair | None = None
    for number, (step, matches) in enumerate(located):
        counts = [len(match.correspondences) for match in matches]
        if counts and (pair is None or counts[0] > len(pair.correspondences)):
            reference = int(dataset.reference_indices[matches[0].index])
            pair = MatchedPair(step.index, reference, matches[0].correspondences)
        steps.append(ReplayStep(**vars(step), num_references=len(counts), num_matches=sum(counts)))
        if on_step is not None:
            on_step(number, steps[-1])
        if progress is not None:
            progress("images", len(steps), total)
    return ReplayResult(
        dataset=dataset,
        options=options,
        each_on_its_own=plan.each_on_its_own,
        steps=tuple(steps),
        skipped=skipped,
        snapshots=snapshots,
        pair=pair,
    )


def _drive(
    localizer: Localizer,
    pf: ParticleFilter,
    sensor: ReplaySensor,
    keep_particles: Container[int],
    snapshots: dict[int, tuple[FloatArray, FloatArray]],
) -> Iterator[tuple[Step, list[ReferenceMatch]]]:
    """Drive the localizer; tell the stages of an update apart and keep some particles."""
    if START in keep_particles:
        snapshots[START] = (pf.poses, pf.log_weights)
    for number, step in enumerate(localizer):
        timings = dict(step.timings)
        update = timings.pop("update")
        timings |= sensor.seconds
        timings["weights"] = update - sum(sensor.seconds.values())
        if number in keep_particles:
            snapshots[number] = (pf.poses, pf.log_weights)
        yield replace(step, timings=timings), sensor.matches


def make_extractor(dataset: Dataset, options: ReplayOptions) -> FeatureExtractor:
    """Make the extractor of a dataset's images."""
    return FeatureExtractor(
        dataset.camera,
        detector=options.detector,
        contrast_threshold=options.contrast_threshold,
        max_features=options.max_features,
        mask_elevation=dataset.mask_elevation,
        mask=dataset.mask,
    )


def start_filter(
    pf: ParticleFilter, dataset: Dataset, options: ReplayOptions, bounds: Bounds
) -> None:
    """Start the particle filter where the options say.

    Raises
    ------
    ValueError
        If it is to start at the truth, and the first image has none.
    """
    if options.start == "lost":
        pf.initialize_uniform(bounds)
        return
    start = _true_start(dataset) if options.start == "truth" else np.array(options.start)
    pf.initialize_gaussian(start, start_covariance(options))


def _true_start(dataset: Dataset) -> FloatArray:
    """Give the true pose of the first image that is replayed."""
    if dataset.odometry is not None and dataset.ground_truth is not None:
        measured = np.isfinite(dataset.odometry[dataset.query_indices]).all(axis=1)
        for index in dataset.query_indices[measured][:1]:
            truth: FloatArray = dataset.ground_truth[index]
            if np.isfinite(truth).all():
                return truth
    raise ValueError(f"{dataset.name}: the first image has no true pose to start from")
