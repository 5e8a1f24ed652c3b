"""The unscented Kalman filter on relative poses, made with filterpy."""

from __future__ import annotations

from typing import Any

import numpy as np

from pflut.geometry import FloatArray, wrap_to_pi
from pflut.localization.gaussian import square_root
from pflut.localization.kalman_filter import KalmanFilter
from pflut.localization.motion import Increment
from pflut.localization.stacked_fixes import StackedFixes


class UnscentedKalmanFilter(KalmanFilter):
    """An unscented Kalman filter on relative poses: see `KalmanFilter` for its options.

    The sigma points are Merwe's, sqrt(3) standard deviations from the mean.

    References
    ----------
    R. van der Merwe, "Sigma-point Kalman filters for probabilistic inference in dynamic state-space
    models", 2004.
    """

    def _moved(self, increment: Increment) -> tuple[FloatArray, FloatArray]:
        """Move by filterpy's filter: each sigma point, and the noise as it is at the mean."""
        kf = self._filter(1)
        kf.Q = increment.linearized(self.pose)[2]
        kf.predict(fx=lambda pose, _: increment.linearized(pose)[0])
        return kf.x, kf.P

    def _corrected(
        self, measured: StackedFixes, around: FloatArray
    ) -> tuple[FloatArray, FloatArray, float]:
        """Correct by filterpy's filter; what the pose around which says is the choice alone."""
        kf = self._filter(len(measured.residuals))
        kf.sigmas_f = kf.points_fn.sigma_points(kf.x, kf.P)
        kf.update(measured.measured(), R=measured.noise, hx=measured.expected)
        return kf.x, kf.P, float(kf.log_likelihood)

    def _filter(self, size: int) -> Any:
        """Make filterpy's filter at the pose, with angles wherever they are."""
        from filterpy import kalman

        points = kalman.MerweScaledSigmaPoints(
            3, alpha=1.0, beta=0.0, kappa=0.0, sqrt_method=square_root
        )
        kf = kalman.UnscentedKalmanFilter(
            dim_x=3,
            dim_z=size,
            dt=1.0,
            hx=None,
            fx=None,
            points=points,
            x_mean_fn=_mean_pose,
            z_mean_fn=_mean_angles,
            residual_x=_pose_difference,
            residual_z=lambda a, b: wrap_to_pi(a - b),
        )
        kf.x, kf.P = self.pose, self._covariance
        return kf


def _pose_difference(a: FloatArray, b: FloatArray) -> FloatArray:
    """Subtract poses, headings wrapped."""
    difference = a - b
    difference[2] = wrap_to_pi(difference[2])
    return difference


def _mean_pose(poses: FloatArray, weights: FloatArray) -> FloatArray:
    """Average sigma points (n, 3) around the first of them."""
    offsets = poses - poses[0]
    offsets[:, 2] = wrap_to_pi(offsets[:, 2])
    return np.asarray(poses[0] + weights @ offsets)


def _mean_angles(angles: FloatArray, weights: FloatArray) -> FloatArray:
    """Average angles (n, k) around the first row of them."""
    return np.asarray(angles[0] + weights @ wrap_to_pi(angles - angles[0]))
