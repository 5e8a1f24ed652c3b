"""The result of every relative-pose estimator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pflut.geometry import FloatArray, rotation_from_headings

UNIFORM_VARIANCE = float(np.pi**2 / 3.0)
"""Of an angle of which nothing is known, radians squared."""


@dataclass(frozen=True, eq=False)
class RelativePose:
    """A relative pose on the plane, up to the distance.

    Parameters
    ----------
    heading_l : float
        Direction from L to R in L's frame (theta), radians in (-pi, pi].
    heading_r : float
        Direction from R to L in R's frame (phi), radians in (-pi, pi].
    covariance : ndarray of shape (2, 2)
        Of (heading_l, heading_r), radians squared: the inverse of the M-estimator's information
        at the residuals' own spread; where a table was asked, with the posterior's spread over the
        poses of the same rotation. Never larger than that of uniform angles; on a turn on the spot
        the headings have some of that, and their difference, the rotation, a small one.
    log_likelihood : float
        Log-likelihood ratio of the highest cell against uniform azimuths.
    log_evidence : float
        Log of the evidence that the views are linked at all, see `GridPosterior`.
    num_inliers : int
        Correspondences that agree with the pose, with positive depths.
    success : bool
        False where the correspondences do not determine a pose: fewer than three agree (with the
        8-point RANSAC no more than eight), or no more than coincidence would bring. The headings
        are then the best guess, zero where there is none.
    """

    heading_l: float
    heading_r: float
    covariance: FloatArray
    log_likelihood: float
    log_evidence: float
    num_inliers: int
    success: bool

    @property
    def rotation(self) -> float:
        """R's rotation relative to L (psi), radians in (-pi, pi]."""
        return float(rotation_from_headings(self.heading_l, self.heading_r))

    @property
    def rotation_std(self) -> float:
        """Standard deviation of the rotation, radians."""
        c = self.covariance
        return float(np.sqrt(max(c[0, 0] - 2.0 * c[0, 1] + c[1, 1], 0.0)))


def no_pose() -> RelativePose:
    """Return the result of a pair of which nothing is known."""
    return RelativePose(0.0, 0.0, np.eye(2) * UNIFORM_VARIANCE, 0.0, 0.0, 0, False)
