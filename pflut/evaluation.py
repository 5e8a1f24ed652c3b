"""Errors of poses and of relative poses, and when a filter has converged.

A row without ground truth is NaN, and left out of the statistics (`pflut.statistics`, whose names
are here too); a row without an estimate counts as infinitely wrong, so that a method gains nothing
by giving up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.geometry import FloatArray, rotation_from_headings, wrap_to_pi
from pflut.statistics import (
    Rate,
    Summary,
    bin_indices,
    bootstrap_median,
    bootstrap_median_ratio,
    median_absolute_deviation,
    root_mean_square,
    success_rate,
    summarize,
    wilson_interval,
)

__all__ = [
    "CONVERGED_HEADING",
    "CONVERGED_POSITION",
    "Rate",
    "Summary",
    "TrajectoryErrors",
    "bin_indices",
    "bootstrap_median",
    "bootstrap_median_ratio",
    "convergence_index",
    "median_absolute_deviation",
    "relative_pose_errors",
    "root_mean_square",
    "success_rate",
    "summarize",
    "trajectory_errors",
    "wilson_interval",
]

#: A filter has converged when it stays within these, metres and radians.
CONVERGED_POSITION = 0.5
CONVERGED_HEADING = float(np.radians(10.0))


@dataclass(frozen=True, eq=False)
class TrajectoryErrors:
    """Errors of estimated poses, one a step; NaN where the truth is unknown.

    Parameters
    ----------
    position : ndarray of shape (n,)
        Distance, metres.
    heading : ndarray of shape (n,)
        Estimate minus truth, radians in (-pi, pi].
    along_track, cross_track : ndarray of shape (n,)
        Position, estimate minus truth, along the true heading and to the left of it, metres.
    """

    position: FloatArray
    heading: FloatArray
    along_track: FloatArray
    cross_track: FloatArray

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.position)

    def __getitem__(self, index: slice | NDArray[Any]) -> TrajectoryErrors:
        """Select steps by a slice, an index array or a mask."""
        return TrajectoryErrors(
            self.position[index],
            self.heading[index],
            self.along_track[index],
            self.cross_track[index],
        )

    @property
    def converged_at(self) -> int | None:
        """The step from which on the errors stay below 0.5 m and 10 degrees, if any."""
        return convergence_index(self.position, self.heading)

    @property
    def good(self) -> NDArray[np.bool_]:
        """Which steps are below 0.5 m and 10 degrees."""
        return near_truth(self.position, self.heading)

    def within(self, position: float, heading: float) -> NDArray[np.bool_]:
        """Say which steps are within a distance (metres) and an angle (radians) of the truth."""
        return np.asarray((self.position <= position) & (np.abs(self.heading) <= heading))

    def as_dict(self) -> dict[str, Any]:
        """Return the statistics for a JSON file: of all steps, and of those after convergence."""
        start = self.converged_at
        return {
            "steps": len(self),
            "converged_at": start,
            "all": self._statistics(),
            "after_convergence": None if start is None else self[start:]._statistics(),
        }

    def _statistics(self) -> dict[str, Any]:
        return {
            "position_m": summarize(self.position).as_dict(),
            "heading_deg": summarize(np.degrees(self.heading)).as_dict(),
            "along_track_m": summarize(self.along_track).as_dict(),
            "cross_track_m": summarize(self.cross_track).as_dict(),
        }


def trajectory_errors(estimates: ArrayLike, ground_truth: ArrayLike) -> TrajectoryErrors:
    """Compare estimated poses with the true ones.

    Parameters
    ----------
    estimates, ground_truth : array_like of shape (n, 3)
        ``[x, y, heading]`` of the same steps, in the same world. NaN rows of the ground truth
        give NaN; NaN rows of the estimates give infinite distances and a heading error of pi.

    Returns
    -------
    TrajectoryErrors

    Raises
    ------
    ValueError
        If the shapes differ or are others.
    """
    estimate = np.asarray(estimates, dtype=np.float64)
    truth = np.asarray(ground_truth, dtype=np.float64)
    if estimate.ndim != 2 or estimate.shape[1] != 3 or estimate.shape != truth.shape:
        raise ValueError(
            "estimates, ground_truth: expected the same shape (n, 3), got "
            f"{estimate.shape} and {truth.shape}"
        )
    dx, dy = (estimate - truth)[:, :2].T
    cos, sin = np.cos(truth[:, 2]), np.sin(truth[:, 2])
    errors = np.stack(
        [
            np.hypot(dx, dy),
            wrap_to_pi(estimate[:, 2] - truth[:, 2]),
            cos * dx + sin * dy,
            cos * dy - sin * dx,
        ]
    )
    missing = ~np.isfinite(estimate).all(axis=1)
    errors[:, missing] = np.array([np.inf, np.pi, np.inf, np.inf])[:, None]
    errors[:, ~np.isfinite(truth).all(axis=1)] = np.nan
    return TrajectoryErrors(*errors)


def relative_pose_errors(
    heading_l: ArrayLike, heading_r: ArrayLike, true_heading_l: ArrayLike, true_heading_r: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Compare estimated relative poses with the true ones, as Booij et al. 2010 do.

    Parameters
    ----------
    heading_l, heading_r : array_like of shape (n,)
        The estimated theta and phi, radians; NaN where the estimator failed.
    true_heading_l, true_heading_r : array_like of shape (n,)
        The true ones.

    Returns
    -------
    heading_error : ndarray of shape (n,)
        Absolute error of theta, radians in [0, pi]; pi where the estimator failed.
    rotation_error : ndarray of shape (n,)
        Absolute error of psi = theta - phi + pi, likewise.
    """
    theta, phi = np.asarray(heading_l, dtype=np.float64), np.asarray(heading_r, dtype=np.float64)
    true_theta = np.asarray(true_heading_l, dtype=np.float64)
    psi = rotation_from_headings(theta, phi)
    true_psi = rotation_from_headings(true_theta, true_heading_r)
    heading_error = np.abs(wrap_to_pi(theta - true_theta))
    rotation_error = np.abs(wrap_to_pi(psi - true_psi))
    failed = np.isnan(theta) | np.isnan(phi)
    return np.where(failed, np.pi, heading_error), np.where(failed, np.pi, rotation_error)


def near_truth(
    position: ArrayLike,
    heading: ArrayLike,
    max_position: float = CONVERGED_POSITION,
    max_heading: float = CONVERGED_HEADING,
) -> NDArray[np.bool_]:
    """Say which errors are below a distance and an angle; none that is NaN.

    Parameters
    ----------
    position, heading : array_like of shape (n,)
        Metres; radians, signed or not.
    max_position, max_heading : float

    Returns
    -------
    ndarray of shape (n,), bool
    """
    near = np.asarray(position) < max_position
    return np.asarray(near & (np.abs(heading) < max_heading))


def convergence_index(
    position: ArrayLike,
    heading: ArrayLike,
    *,
    max_position: float = CONVERGED_POSITION,
    max_heading: float = CONVERGED_HEADING,
) -> int | None:
    """Give the first step from which on the errors stay small until the end.

    Parameters
    ----------
    position : array_like of shape (n,)
        Metres. NaN steps (no ground truth) are passed over.
    heading : array_like of shape (n,)
        Radians, signed or not.
    max_position, max_heading : float
        What counts as small: below these.

    Returns
    -------
    int or None
        ``None`` if the last known step is not good, or none is known.
    """
    distance = np.asarray(position, dtype=np.float64)
    angle = np.abs(np.asarray(heading, dtype=np.float64))
    known = np.flatnonzero(~(np.isnan(distance) | np.isnan(angle)))
    good = near_truth(distance[known], angle[known], max_position, max_heading)
    bad = np.flatnonzero(~good)
    first = int(bad[-1]) + 1 if bad.size else 0
    return int(known[first]) if first < len(known) else None
