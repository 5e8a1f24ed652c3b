"""The sensor model: how probable an image is at each of many poses, given reference images."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.correspondences import ReferenceMatch
from pflut.features import Features
from pflut.features.reference_matcher import ReferenceMatcher
from pflut.geometry import FloatArray, as_poses
from pflut.localization.pose_box import PoseBox
from pflut.localization.sensor_kernels import CHUNK, add_reference, rotation_curve
from pflut.posterior import Likelihood, check_temperature
from pflut.reference_map import ReferenceMap

if TYPE_CHECKING:
    from pflut.features import FeatureExtractor

RANGE_PER_SPACING = 6.0
SINGLE_RANGE = 5.0
RANGE_PER_NEAR = 4.0
CANDIDATES = 2
"""So many times the references that count for proposals are matched."""


class ReferenceImageModel:
    """Log-likelihood of an image at poses, from the posteriors of its pairs with references.

    An image is compared with the references near the poses; each pair gives a posterior over the
    two headings, which a particle looks up at its own headings. The references' log-likelihoods
    are added.

    Parameters
    ----------
    reference_map : ReferenceMap
    likelihood : LikelihoodTable or Likelihood
        Or a class of one's own with ``bins`` and a ``log_likelihood_grid`` of finite numbers.
    extractor : FeatureExtractor, optional
        Turns images into features. Without it only features are taken as observations.
    temperature : float
        Factor on the log-likelihood in (0, 1]. The sum over correspondences and references takes
        them as independent; they are not (one feature is matched with many references, one
        repeated texture gives many mismatches). It reads as the share of the correspondences that
        are independent evidence.
    link_probability : float
        In (0, 1): how probable it is beforehand that a reference within range shows the same
        scene as the image. The rest is a floor under the likelihood, so that a wrong reference
        costs a bounded amount.
    max_references : int
        So many references with the most matches enter the sum.
    max_candidates : int
        So many references are matched: the nearest to the poses; where more are near (a lost
        robot in a large map), the most similar of them.
    max_range : float, optional
        Metres. A reference says nothing about poses farther away; from 3/4 of it on it fades.
        Default: six times the spacing of the references, but at least four times ``near_range``;
        5 m where there is but one.
    near_range : float
        Metres. Nearer to a reference than this the direction to it fades out of the likelihood:
        where the robot stands on the reference only the rotation is defined.
    min_matches : int
        References with fewer matches say nothing.
    ratio : float
        Of the ratio test, in (0, 1].
    mutual : bool
        Whether matches must be each other's nearest.

    Raises
    ------
    ValueError
        If an option is out of its range.
    """

    def __init__(
        self,
        reference_map: ReferenceMap,
        likelihood: Likelihood,
        *,
        extractor: FeatureExtractor | None = None,
        temperature: float = 0.3,
        link_probability: float = 0.5,
        max_references: int = 10,
        max_candidates: int = 32,
        max_range: float | None = None,
        near_range: float = 0.3,
        min_matches: int = 4,
        ratio: float = 0.8,
        mutual: bool = True,
    ) -> None:
        if max_range is None:
            spacing = reference_map.spacing
            max_range = RANGE_PER_SPACING * spacing if np.isfinite(spacing) else SINGLE_RANGE
            # references that all but share a place leave room for the robot beside them
            max_range = max(max_range, RANGE_PER_NEAR * near_range)
        check_temperature(temperature)
        if not 0.0 < link_probability < 1.0:
            raise ValueError(f"link_probability: expected in (0, 1), got {link_probability}")
        for name, value in (
            ("max_references", max_references),
            ("max_candidates", max_candidates),
            ("min_matches", min_matches),
        ):
            if value < 1:
                raise ValueError(f"{name}: expected at least 1, got {value}")
        if not 0.0 <= near_range < max_range:
            raise ValueError(
                f"near_range: expected in [0, max_range), got {near_range} of {max_range}"
            )
        self.reference_map = reference_map
        self.likelihood = likelihood
        self.extractor = extractor
        self.temperature = temperature
        self.link_probability = link_probability
        self.max_references = max_references
        self.max_candidates = max_candidates
        self.max_range = max_range
        self.near_range = near_range
        self.min_matches = min_matches
        self._matcher = ReferenceMatcher(reference_map.features, ratio=ratio, mutual=mutual)

    def observe(self, image: NDArray[np.uint8]) -> Features:
        """Turn an image into the features that `log_likelihood` takes.

        Parameters
        ----------
        image : ndarray of shape (H, W) or (H, W, 3), uint8

        Returns
        -------
        Features

        Raises
        ------
        ValueError
            If the model has no extractor.
        """
        if self.extractor is None:
            raise ValueError("observation: an image, but the model was made without an extractor")
        return self.extractor(image)

    def match(
        self, poses: ArrayLike | None, observation: Any, *, max_candidates: int | None = None
    ) -> list[ReferenceMatch]:
        """Match an image with the references worth comparing.

        Parameters
        ----------
        poses : array_like of shape (N, 3) or None
            Where the robot may be; None is anywhere in the map.
        observation : Features, image or sequence of ReferenceMatch
            What was matched already is not matched again: of a matcher of one's own, say.
        max_candidates : int, optional
            So many references are matched; by default the model's.

        Returns
        -------
        list of ReferenceMatch
            At most ``max_references`` within range, the one with most matches first.

        Raises
        ------
        ValueError
            If a match is with no reference of the map.
        """
        checked = None if poses is None else as_poses(poses)
        if _is_matched(observation):
            matches = self._near(checked, observation)
        else:
            most = self.max_candidates if max_candidates is None else max_candidates
            matches = self._matched(checked, observation, most)
        matches = [match for match in matches if len(match.correspondences) >= self.min_matches]
        matches.sort(key=lambda match: (-len(match.correspondences), match.index))
        return matches[: self.max_references]

    def log_likelihood(self, poses: ArrayLike, observation: Any) -> FloatArray:
        """Compute the log-likelihood of an observation at poses.

        Parameters
        ----------
        poses : array_like of shape (N, 3)
            ``[x, y, heading]`` in the map's frame.
        observation : Features, image or sequence of ReferenceMatch
            Of the map's kind of features.

        Returns
        -------
        ndarray of shape (N,)
            Up to a constant: zero at a pose that no reference says anything about, so zero at all
            poses without matches or out of every reference's range. Always finite.
        """
        checked = as_poses(poses)
        return self.log_likelihood_of_matches(checked, self.match(checked, observation))

    def log_likelihood_with_proposals(
        self, poses: ArrayLike, proposed: int, observation: Any
    ) -> FloatArray:
        """Compute the log-likelihood at a filter's particles and at poses proposed anywhere.

        Of the references those near the particles count, as in `log_likelihood`, and half as many
        near the proposals besides: these take no place from those.

        Parameters
        ----------
        poses : array_like of shape (N + M, 3)
        proposed : int
            M, how many of the last ones are proposals.
        observation : Features, image or sequence of ReferenceMatch

        Returns
        -------
        ndarray of shape (N + M,)
        """
        checked = as_poses(poses)
        matches = self.match_apart(checked, proposed, observation)
        return self.log_likelihood_of_matches(checked, matches)

    def match_apart(
        self, poses: FloatArray, proposed: int, observation: Any
    ) -> list[ReferenceMatch]:
        """Match an image with references near particles, and with others near proposals.

        Parameters
        ----------
        poses : ndarray of shape (N + M, 3)
        proposed : int
            M, how many of the last ones are proposals.
        observation : Features, image or sequence of ReferenceMatch

        Returns
        -------
        list of ReferenceMatch
        """
        half = -(-self.max_references // 2)
        few = CANDIDATES * half
        others = self.match(poses[-proposed:], observation, max_candidates=few)[:half]
        near = self.match(poses[:-proposed], observation)
        known = {match.index for match in near}
        return [*near, *(match for match in others if match.index not in known)]

    def log_likelihood_of_matches(
        self, poses: ArrayLike, matches: Sequence[ReferenceMatch]
    ) -> FloatArray:
        """Compute the log-likelihood at poses where the matches are known.

        Parameters
        ----------
        poses : array_like of shape (N, 3)
        matches : sequence of ReferenceMatch

        Returns
        -------
        ndarray of shape (N,)
        """
        checked = as_poses(poses)
        total = np.zeros(len(checked))
        if not len(checked) or not matches:
            return total
        bins, share = self.likelihood.bins, (self.temperature, self.link_probability)
        references = self.reference_map.poses[[match.index for match in matches]]
        box = PoseBox.around(checked)
        windows = box.windows(references, bins)
        # where a particle stands on the reference, all poses of a rotation count
        # (the kernel's distances are float32)
        near = box.distances(references) <= self.near_range * (1.0 + 1e-6)
        windows[near] = [0, bins]
        nowhere = np.zeros(bins + 1)
        grids, rotations = [], []
        for match, window, close in zip(matches, windows, near, strict=True):
            grid = self.likelihood.log_likelihood_grid(match.correspondences, window=window)
            grids.append(np.require(grid, np.float32, ["C", "W"]))
            rotations.append(rotation_curve(grids[-1], *share) if close else nowhere)
        fade = self.near_range, 0.75 * self.max_range, self.max_range
        for first in range(0, len(checked), CHUNK):
            x, y, heading = np.ascontiguousarray(checked[first : first + CHUNK].T)
            part = total[first : first + CHUNK]
            for reference, grid, rotation in zip(references, grids, rotations, strict=True):
                add_reference(x, y, heading, reference, grid, *share, rotation, *fade, part)
        return total

    def _matched(
        self, poses: FloatArray | None, observation: Any, most: int
    ) -> list[ReferenceMatch]:
        """Match an image with the candidates."""
        features = observation if isinstance(observation, Features) else self.observe(observation)
        indices = self.reference_map.candidates(
            features, poses, max_range=self.max_range, max_candidates=most
        ).tolist()
        pairs = self._matcher(features, indices)
        return [ReferenceMatch(index, pair) for index, pair in zip(indices, pairs, strict=True)]

    def _near(
        self, poses: FloatArray | None, matches: Sequence[ReferenceMatch]
    ) -> list[ReferenceMatch]:
        """Keep the matches with references that are in range of a pose."""
        for match in matches:
            if not 0 <= match.index < len(self.reference_map):
                raise ValueError(
                    f"observation: expected matches with references 0 to "
                    f"{len(self.reference_map) - 1}, got {match.index}"
                )
        if poses is None:
            return list(matches)
        nearness = self.reference_map.nearness(poses, max_range=self.max_range)
        return [match for match in matches if nearness[match.index] > 0.0]


def _is_matched(observation: Any) -> TypeGuard[Sequence[ReferenceMatch]]:
    """Say whether an observation is a sequence of matches, an empty one included."""
    return isinstance(observation, list | tuple) and all(
        isinstance(item, ReferenceMatch) for item in observation
    )
