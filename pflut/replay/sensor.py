"""The sensor model of a replay: features from the cache, a clock on every stage."""

from __future__ import annotations

from collections.abc import Sequence
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.correspondences import ReferenceMatch
from pflut.features import FeatureCache, FeatureExtractor, Features
from pflut.geometry import FloatArray
from pflut.localization.reference_image_model import ReferenceImageModel
from pflut.posterior import Likelihood
from pflut.reference_map import ReferenceMap
from pflut.replay.options import ReplayOptions


class ReplaySensor(ReferenceImageModel):
    """A `ReferenceImageModel` that remembers its last matches and the time they took.

    Parameters
    ----------
    reference_map : ReferenceMap
    likelihood : LikelihoodTable or DenseTable
    extractor : FeatureExtractor or None
        None where observations are matches.
    options : ReplayOptions
    cache : FeatureCache, optional
        Features are looked up there.

    Attributes
    ----------
    matches : list of ReferenceMatch
        Of the last image.
    seconds : dict
        What "match" and "likelihood" of the last image took.
    """

    def __init__(
        self,
        reference_map: ReferenceMap,
        likelihood: Likelihood,
        extractor: FeatureExtractor | None,
        options: ReplayOptions,
        *,
        cache: FeatureCache | None = None,
    ) -> None:
        super().__init__(
            reference_map,
            likelihood,
            extractor=extractor,
            temperature=options.temperature,
            link_probability=options.link_probability,
            max_references=options.max_references,
            max_candidates=options.max_candidates,
            max_range=options.max_range,
            near_range=options.near_range,
            min_matches=options.min_matches,
            ratio=options.ratio,
            mutual=options.mutual,
        )
        self.cache = cache
        self.matches: list[ReferenceMatch] = []
        self.seconds: dict[str, float] = {}
        self._observation: Any = None

    def observe(self, image: NDArray[np.uint8]) -> Features:
        """Turn an image into features, or find them in the cache."""
        if self.extractor is None or self.cache is None:
            return super().observe(image)
        return self.cache(self.extractor, image)

    def match(
        self, poses: ArrayLike | None, observation: Any, *, max_candidates: int | None = None
    ) -> list[ReferenceMatch]:
        """Match an image with the references worth comparing, by the clock."""
        start = perf_counter()
        matches = super().match(poses, observation, max_candidates=max_candidates)
        # recovery matches the same image before: all of it counts, the last matches are kept
        before = self.seconds.get("match", 0.0) if observation is self._observation else 0.0
        self.seconds["match"] = before + perf_counter() - start
        self.matches, self._observation = matches, observation
        return matches

    def log_likelihood_of_matches(
        self, poses: ArrayLike, matches: Sequence[ReferenceMatch]
    ) -> FloatArray:
        """Compute the log-likelihood at poses, by the clock."""
        start = perf_counter()
        answer = super().log_likelihood_of_matches(poses, matches)
        self.seconds["likelihood"] = perf_counter() - start
        return answer
