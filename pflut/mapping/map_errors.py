"""How wrong a map is: the poses of its images beside the true ones."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import ArrayLike

from pflut.alignment import align_poses, relative_errors
from pflut.evaluation import trajectory_errors
from pflut.geometry import compose, relative_pose
from pflut.statistics import root_mean_square


@dataclass(frozen=True)
class MapErrors:
    """Errors of the poses of a drive's images, metres and radians.

    Parameters
    ----------
    position : float
        Root mean square distance from the true positions after the best fitting shift and turn,
        without scaling (absolute trajectory error).
    position_median, position_largest : float
        Of the same distances.
    position_scaled : float
        Root mean square, when the map may also be made larger or smaller: its shape's error.
    heading : float
        Root mean square, after the same turn.
    position_from_start : float
        Root mean square, when the first poses are laid over each other instead: what a robot that
        knows where it starts would get wrong.
    step_position, step_heading : float
        Root mean square of the motions from image to image.
    """

    position: float
    position_median: float
    position_largest: float
    position_scaled: float
    heading: float
    position_from_start: float
    step_position: float
    step_heading: float

    @classmethod
    def of(cls, poses: ArrayLike, ground_truth: ArrayLike) -> MapErrors:
        """Compare poses with the true ones.

        Parameters
        ----------
        poses, ground_truth : array_like of shape (n, 3)
            Of the same images in the order of time, at least two with a known true pose; NaN rows
            of the truth are passed over.

        Returns
        -------
        MapErrors
        """
        truth = np.asarray(ground_truth, dtype=np.float64)
        known = np.isfinite(truth).all(axis=1)
        truth, found = truth[known], np.asarray(poses, dtype=np.float64)[known]
        errors = trajectory_errors(align_poses(found, truth), truth)
        scaled = trajectory_errors(align_poses(found, truth, scale=True), truth)
        from_start = compose(truth[0], relative_pose(found[0], found))
        step_position, step_heading = relative_errors(found, truth)
        return cls(
            root_mean_square(errors.position),
            float(np.median(errors.position)),
            float(errors.position.max()),
            root_mean_square(scaled.position),
            root_mean_square(errors.heading),
            root_mean_square(trajectory_errors(from_start, truth).position),
            root_mean_square(step_position),
            root_mean_square(step_heading),
        )

    def as_dict(self) -> dict[str, float]:
        """Return the errors for a JSON file; names say the units, angles are in degrees."""
        return {
            f"{name}_deg" if "heading" in name else f"{name}_m": float(np.degrees(value))
            if "heading" in name
            else value
            for name, value in asdict(self).items()
        }
