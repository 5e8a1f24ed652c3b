"""What a replay found: its steps, and the numbers that sum them up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from pflut.correspondences import Correspondences
from pflut.datasets.base import Dataset
from pflut.evaluation import TrajectoryErrors, success_rate, summarize, trajectory_errors
from pflut.geometry import FloatArray, compose, relative_pose
from pflut.localization.localizer import Step
from pflut.replay.options import ReplayOptions

#: What counts as a success where each image is localized on its own: metres, radians.
SUCCESS_POSITION = 0.25
SUCCESS_HEADING = float(np.radians(5.0))


@dataclass(frozen=True, eq=False)
class ReplayStep(Step):
    """One image of a replay, with what it was compared with.

    Parameters
    ----------
    num_references : int
        References whose matches counted.
    num_matches : int
        Their matches together.
    """

    num_references: int = 0
    num_matches: int = 0


@dataclass(frozen=True, eq=False)
class MatchedPair:
    """An image of the replay and the reference it has most matches with.

    Parameters
    ----------
    query, reference : int
        Images of the dataset.
    correspondences : Correspondences
        L is the reference.
    """

    query: int
    reference: int
    correspondences: Correspondences


@dataclass(frozen=True, eq=False)
class ReplayResult:
    """The outcome of a replay.

    Parameters
    ----------
    dataset : Dataset
        As it was replayed, simulated odometry included.
    options : ReplayOptions
    each_on_its_own : bool
        Whether each image was localized in the whole map, without odometry.
    steps : tuple of ReplayStep
        One an image.
    skipped : tuple of int
        Images left out, for they have no odometry.
    snapshots : mapping of int to (poses, log_weights)
        Particles after some steps, by the step's number; -1 before the first.
    pair : MatchedPair, optional
        Of the image and the reference that have the most matches.
    """

    dataset: Dataset
    options: ReplayOptions
    each_on_its_own: bool
    steps: tuple[ReplayStep, ...]
    skipped: tuple[int, ...] = ()
    snapshots: Mapping[int, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    pair: MatchedPair | None = None

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.steps)

    @cached_property
    def stamps(self) -> FloatArray:
        """Seconds, of shape (n,)."""
        return np.array([step.stamp for step in self.steps])

    @cached_property
    def estimates(self) -> FloatArray:
        """Estimated poses, of shape (n, 3)."""
        return np.array([step.estimate.pose for step in self.steps]).reshape(-1, 3)

    @cached_property
    def confidence(self) -> FloatArray:
        """The estimates' confidences, of shape (n,)."""
        return np.array([step.estimate.confidence for step in self.steps])

    @cached_property
    def ground_truth(self) -> FloatArray | None:
        """True poses, of shape (n, 3), NaN rows where unknown; None if all are."""
        unknown = np.full(3, np.nan)
        truth = np.array(
            [unknown if step.ground_truth is None else step.ground_truth for step in self.steps]
        ).reshape(-1, 3)
        return truth if np.isfinite(truth).any() else None

    @cached_property
    def odometry_alone(self) -> FloatArray | None:
        """Poses by odometry from the first true pose on, (n, 3); None without either."""
        if self.ground_truth is None or self.each_on_its_own:
            return None
        first = int(np.flatnonzero(np.isfinite(self.ground_truth).all(axis=1))[0])
        measured = np.array([step.odometry for step in self.steps])
        return compose(self.ground_truth[first], relative_pose(measured[first], measured))

    @cached_property
    def errors(self) -> TrajectoryErrors | None:
        """Errors of the estimates; None without ground truth."""
        if self.ground_truth is None:
            return None
        return trajectory_errors(self.estimates, self.ground_truth)

    @cached_property
    def odometry_errors(self) -> TrajectoryErrors | None:
        """Errors of the odometry alone, which starts at the truth."""
        if self.ground_truth is None or self.odometry_alone is None:
            return None
        return trajectory_errors(self.odometry_alone, self.ground_truth)

    def metrics(self) -> dict[str, Any]:
        """Return the numbers of ``metrics.json``: the same seed gives the same, so no timings."""
        estimates = [step.estimate for step in self.steps]
        numbers: dict[str, Any] = {
            "dataset": self.dataset.name,
            "images": len(self),
            "references": len(self.dataset.reference_indices),
            "skipped": len(self.skipped),
            "confidence": summarize(self.confidence).as_dict(),
            "matches": summarize([step.num_matches for step in self.steps]).as_dict(),
        }
        if not self.each_on_its_own:
            numbers["resampled"] = sum(estimate.resampled for estimate in estimates)
            numbers["degenerate"] = sum(estimate.degenerate for estimate in estimates)
        if self.errors is not None:
            if self.each_on_its_own:
                numbers["success"] = self.success()
            numbers["errors"] = self.errors.as_dict()
        if self.odometry_errors is not None:
            numbers["odometry_alone"] = self.odometry_errors.as_dict()
        return numbers

    def success(self) -> dict[str, Any]:
        """Return how many images were localized within 0.25 m and 5 degrees, and how surely.

        Returns
        -------
        dict
            The rate with its Wilson interval, the median confidences of successes and failures,
            and how many failures are less confident than the median success.
        """
        assert self.errors is not None
        known = ~np.isnan(self.errors.position)
        good = self.errors.within(SUCCESS_POSITION, SUCCESS_HEADING)[known]
        confidence = self.confidence[known]
        typical = summarize(confidence[good])
        return {
            "within_m": SUCCESS_POSITION,
            "within_deg": round(float(np.degrees(SUCCESS_HEADING)), 6),
            **success_rate(good).as_dict(),
            "confidence_of_successes": typical.as_dict()["median"],
            "confidence_of_failures": summarize(confidence[~good]).as_dict()["median"],
            "unsure_failures": int((confidence[~good] < typical.median).sum()),
        }

    def timings(self) -> dict[str, Any]:
        """Return the seconds that each stage took of an image: median and 90 % quantile."""
        stages = self.steps[0].timings if self.steps else {}
        return {
            stage: {
                key: summarize([step.timings[stage] for step in self.steps]).as_dict()[key]
                for key in ("median", "percentile_90")
            }
            for stage in stages
        }
