"""Localize each image on its own in the whole map, leaving itself out of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from time import perf_counter

import numpy as np

from pflut.correspondences import ReferenceMatch
from pflut.datasets.base import Dataset
from pflut.features import FeatureCache, FeatureExtractor
from pflut.localization.global_search import GlobalSearch
from pflut.localization.localizer import Step
from pflut.posterior import Likelihood
from pflut.reference_map import ReferenceMap
from pflut.replay.options import ReplayOptions
from pflut.replay.sensor import ReplaySensor

# as many poses as fit into the memory of any computer
_MOST_POSES = 4_000_000


def localize_each(
    dataset: Dataset,
    reference_map: ReferenceMap,
    likelihood: Likelihood,
    extractor: FeatureExtractor,
    options: ReplayOptions,
    *,
    cache: FeatureCache | None = None,
) -> Iterator[tuple[Step, list[ReferenceMatch]]]:
    """Localize the query images one by one, without odometry or any idea of where they are.

    Parameters
    ----------
    dataset : Dataset
    reference_map : ReferenceMap
        Of all references; an image that is one of them is compared with the others.
    likelihood : LikelihoodTable or DenseTable
    extractor : FeatureExtractor
    options : ReplayOptions
    cache : FeatureCache, optional

    Yields
    ------
    step : Step
    matches : list of ReferenceMatch
        Their indices are rows of ``dataset.reference_indices``.
    """
    spacing = _spacing(reference_map.bounds(options.start_margin), options)
    for index in map(int, dataset.query_indices):
        others = np.flatnonzero(dataset.reference_indices != index)
        sensor = ReplaySensor(
            reference_map.subset(others), likelihood, extractor, options, cache=cache
        )
        search = GlobalSearch(
            sensor,
            margin=options.start_margin,
            spacing=spacing,
            num_headings=options.search_headings,
            noise=options.search_noise,
        )
        start = perf_counter()
        image = dataset.image(index)
        read = perf_counter()
        features = sensor.observe(image)
        found = perf_counter()
        estimate = search.localize(features)
        timings = {"image": read - start, "features": found - read, **sensor.seconds}
        timings["search"] = perf_counter() - found - sum(sensor.seconds.values())
        truth = None if dataset.ground_truth is None else dataset.ground_truth[index]
        step = Step(
            index=index,
            stamp=float(dataset.stamps[index]),
            estimate=estimate,
            ground_truth=truth if truth is not None and np.isfinite(truth).all() else None,
            odometry=np.full(3, np.nan),
            timings=timings,
        )
        yield step, [replace(match, index=int(others[match.index])) for match in sensor.matches]


def _spacing(bounds: tuple[float, float, float, float], options: ReplayOptions) -> float:
    """Give the lattice's spacing: the wanted one, unless the map is too large for it."""
    width, depth = bounds[2] - bounds[0], bounds[3] - bounds[1]
    finest = float(np.sqrt(width * depth * options.search_headings / _MOST_POSES))
    return max(options.search_spacing, finest)
