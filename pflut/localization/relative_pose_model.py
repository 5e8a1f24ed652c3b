"""A sensor model of relative poses: what a RANSAC makes of each reference, as a Gaussian."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from pflut.correspondences import Correspondences, ReferenceMatch
from pflut.geometry import TWO_PI, FloatArray, as_poses, wrap_to_pi
from pflut.localization.relative_pose_fix import RelativePoseFix
from pflut.reference_map import ReferenceMap
from pflut.relpose.ransac import ransac_relative_poses
from pflut.relpose.result import RelativePose

Estimator = Callable[[Sequence[Correspondences]], Sequence[RelativePose]]
"""Gives the relative pose of each pair of views, as `ransac_relative_poses` does."""


class Matcher(Protocol):
    """What the model asks of whatever matches images: `ReferenceImageModel` has it."""

    reference_map: ReferenceMap
    near_range: float
    max_range: float

    def match(self, poses: ArrayLike, observation: Any) -> list[ReferenceMatch]:
        """Match an observation with the references in range of poses (N, 3)."""
        ...  # pragma: no cover

    def match_apart(
        self, poses: FloatArray, proposed: int, observation: Any
    ) -> list[ReferenceMatch]:
        """Match with references near particles, and others near the last poses, proposals."""
        ...  # pragma: no cover


class RelativePoseModel:
    """Log-likelihood of an image at poses, from one relative pose with each reference.

    The usual way, and the baseline of `ReferenceImageModel`: an estimator decides for one relative
    pose of each pair of images, and that is all the filter hears of it. A pose is worth

        log((1 - p) + p (2 pi)^2 N(residual; covariance))

    for each reference whose relative pose was a success, p being ``link_probability`` and the
    residual that of both headings, wrapped: a ratio against uniform headings, so zero says nothing.

    Parameters
    ----------
    matcher : ReferenceImageModel
        Matches the images; the ranges are its own too: within ``near_range`` of a reference the
        headings fade into their difference, the rotation, and from 3/4 of ``max_range`` on all
        fades to zero.
    estimator : callable, optional
        Turns a sequence of `Correspondences` into a `RelativePose` each. By default
        `ransac_relative_poses` with its own defaults; for the maximum of the likelihood,
        ``lambda pairs: estimate_relative_poses(pairs, table)``.
    inflation : float
        Factor on the estimator's covariances: they know the noise of the bearings, and not that
        references share the image's features and that some poses are off by more. The default is
        where simulated drives were followed best.
    min_std : float
        Radians: standard deviation of a noise added to either heading after that, for the poses of
        the references and the camera's calibration. A wider peak also finds more particles.
    link_probability : float
        In (0, 1): the probability that a relative pose which its estimator trusts is about right.

    Raises
    ------
    ValueError
        If an option is out of its range.
    """

    def __init__(
        self,
        matcher: Matcher,
        estimator: Estimator = ransac_relative_poses,
        *,
        inflation: float = 4.0,
        min_std: float = 0.02,
        link_probability: float = 0.9,
    ) -> None:
        if not (np.isfinite(inflation) and inflation > 0.0):
            raise ValueError(f"inflation: expected a positive factor, got {inflation}")
        if not 0.0 <= min_std < np.pi / 2:
            raise ValueError(f"min_std: expected radians in [0, pi/2), got {min_std}")
        if not 0.0 < link_probability < 1.0:
            raise ValueError(f"link_probability: expected in (0, 1), got {link_probability}")
        self.matcher = matcher
        self.estimator = estimator
        self.inflation = inflation
        self.min_std = min_std
        self.link_probability = link_probability

    @property
    def reference_map(self) -> ReferenceMap:
        """The map of the matcher."""
        return self.matcher.reference_map

    @property
    def near_range(self) -> float:
        """Metres, of the matcher: nearer to a reference only the rotation counts."""
        return self.matcher.near_range

    def observe(self, image: Any) -> Any:
        """Turn an image into what the matcher compares: by its ``observe``, where it has that."""
        observe = getattr(self.matcher, "observe", None)
        return image if observe is None else observe(image)

    def fixes(self, poses: ArrayLike, observation: Any) -> list[RelativePoseFix]:
        """Estimate the relative poses of an observation with the references near some poses.

        Parameters
        ----------
        poses : array_like of shape (N, 3)
            Where the robot may be.
        observation : Features, image or sequence of ReferenceMatch
            As the matcher takes it.

        Returns
        -------
        list of RelativePoseFix
            Only the estimator's successes.

        Raises
        ------
        ValueError
            If the estimator does not give a relative pose for each pair.
        """
        return self.fixes_of(self.matcher.match(poses, observation))

    def fixes_of(self, matches: Sequence[ReferenceMatch]) -> list[RelativePoseFix]:
        """Estimate the relative poses of matches, see `fixes`.

        Parameters
        ----------
        matches : sequence of ReferenceMatch

        Returns
        -------
        list of RelativePoseFix
        """
        if not matches:
            return []
        found = self.estimator([match.correspondences for match in matches])
        if len(found) != len(matches):
            raise ValueError(f"estimator: expected {len(matches)} poses, got {len(found)}")
        return [
            RelativePoseFix.of(
                match.index,
                self.reference_map.poses[match.index],
                pose,
                inflation=self.inflation,
                min_std=self.min_std,
            )
            for match, pose in zip(matches, found, strict=True)
            if pose.success
        ]

    def log_likelihood(self, poses: ArrayLike, observation: Any) -> FloatArray:
        """Compute the log-likelihood of an observation at poses.

        Parameters
        ----------
        poses : array_like of shape (N, 3)
            ``[x, y, heading]`` in the map's frame.
        observation : Features, image or sequence of ReferenceMatch

        Returns
        -------
        ndarray of shape (N,)
            Zero where no reference says anything; always finite.
        """
        checked = as_poses(poses)
        return self.log_likelihood_of_fixes(checked, self.fixes(checked, observation))

    def log_likelihood_with_proposals(
        self, poses: ArrayLike, proposed: int, observation: Any
    ) -> FloatArray:
        """Compute the log-likelihood at particles and at poses proposed anywhere.

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
        matches = self.matcher.match_apart(checked, proposed, observation)
        return self.log_likelihood_of_fixes(checked, self.fixes_of(matches))

    def log_likelihood_of_fixes(
        self, poses: ArrayLike, fixes: Sequence[RelativePoseFix]
    ) -> FloatArray:
        """Compute the log-likelihood at poses where the relative poses are known.

        Parameters
        ----------
        poses : array_like of shape (N, 3)
        fixes : sequence of RelativePoseFix

        Returns
        -------
        ndarray of shape (N,)
        """
        checked = as_poses(poses)
        total = np.zeros(len(checked))
        near, reach = self.matcher.near_range, self.matcher.max_range
        for fix in fixes:
            distance = fix.distance(checked)
            (within,) = np.nonzero(distance < reach)
            away = distance[within]
            residuals = fix.residuals(checked[within])
            value = self._linked(residuals, fix.covariance)
            if near > 0.0 and (away < near).any():
                turned = wrap_to_pi(residuals[:, :1] - residuals[:, 1:])
                c = fix.covariance
                variance = np.array([[c[0, 0] - 2.0 * c[0, 1] + c[1, 1]]])
                share = np.minimum(away / near, 1.0)
                share = share * share * (3.0 - 2.0 * share)
                value = share * value + (1.0 - share) * self._linked(turned, variance)
            total[within] += value * np.minimum((reach - away) / (0.25 * reach), 1.0)
        return total

    def _linked(self, residuals: FloatArray, covariance: FloatArray) -> FloatArray:
        """Give log((1 - p) + p (2 pi)^k N(residual; covariance)) of residuals (N, k)."""
        p, size = self.link_probability, residuals.shape[1]
        squared = np.einsum("ni,ij,nj->n", residuals, np.linalg.inv(covariance), residuals)
        peak = 0.5 * (size * np.log(TWO_PI) - np.linalg.slogdet(covariance)[1])
        return np.asarray(np.logaddexp(np.log1p(-p), np.log(p) + peak - 0.5 * squared))
