"""The extended Kalman filter on relative poses, made with filterpy."""

from __future__ import annotations

import numpy as np

from pflut.geometry import FloatArray, wrap_to_pi
from pflut.localization.kalman_filter import KalmanFilter
from pflut.localization.stacked_fixes import StackedFixes


class ExtendedKalmanFilter(KalmanFilter):
    """An extended Kalman filter on relative poses, iterated: see `KalmanFilter` for its options."""

    def _corrected(
        self, measured: StackedFixes, around: FloatArray
    ) -> tuple[FloatArray, FloatArray, float]:
        """Correct by filterpy's filter with the measurements' derivative at another pose."""
        from filterpy import kalman

        kf = kalman.ExtendedKalmanFilter(dim_x=3, dim_z=len(measured.residuals))
        kf.x, kf.P = self.pose, self._covariance
        offset = around - self.pose
        offset[2] = wrap_to_pi(offset[2])
        # the innovation of the pose that is corrected, seen from the one linearised around
        innovation = measured.residuals + measured.jacobian @ offset
        kf.update(
            innovation,
            HJacobian=lambda _: measured.jacobian,
            Hx=lambda _: np.zeros_like(innovation),
            R=measured.noise,
        )
        return kf.x, kf.P, float(kf.log_likelihood)
