"""Relative poses of one image as one measurement: what a Kalman filter corrects with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pflut.geometry import FloatArray, wrap_to_pi
from pflut.localization.relative_pose_fix import RelativePoseFix

BOTH = np.eye(2)
ROTATION = np.array([[1.0, -1.0]])
"""What is taken of the headings: both, or near a reference their difference alone."""


@dataclass(frozen=True, eq=False)
class StackedFixes:
    """Relative poses as one vector of k angles, linearised around a pose.

    Parameters
    ----------
    fixes : tuple of RelativePoseFix
    taken : tuple of ndarray of shape (1 or 2, 2)
        What of the headings of each of them is in the vector.
    residuals : ndarray of shape (k,)
        Measured less expected at the pose, radians in (-pi, pi].
    jacobian : ndarray of shape (k, 3)
        Of what is expected, with respect to the pose.
    noise : ndarray of shape (k, k)
        Covariance of what is measured.
    """

    fixes: tuple[RelativePoseFix, ...]
    taken: tuple[FloatArray, ...]
    residuals: FloatArray
    jacobian: FloatArray
    noise: FloatArray

    @classmethod
    def of(cls, fixes: Sequence[RelativePoseFix], pose: FloatArray, *, near: float) -> StackedFixes:
        """Stack at least one relative pose.

        Parameters
        ----------
        fixes : sequence of RelativePoseFix
        pose : ndarray of shape (3,)
        near : float
            Metres: of references nearer than this to the pose the rotation alone is taken.

        Returns
        -------
        StackedFixes
        """
        taken = tuple(ROTATION if fix.distance(pose) < near else BOTH for fix in fixes)
        pairs = list(zip(fixes, taken, strict=True))
        size = sum(len(part) for part in taken)
        noise, start = np.zeros((size, size)), 0
        for fix, part in pairs:
            block = slice(start, start + len(part))
            noise[block, block] = part @ fix.covariance @ part.T
            start += len(part)
        return cls(
            tuple(fixes),
            taken,
            np.concatenate([wrap_to_pi(part @ fix.residuals(pose)) for fix, part in pairs]),
            np.concatenate([part @ fix.jacobian(pose) for fix, part in pairs]),
            noise,
        )

    def measured(self) -> FloatArray:
        """Give what was measured, (k,), not wrapped."""
        pairs = zip(self.fixes, self.taken, strict=True)
        return np.concatenate([part @ fix.headings for fix, part in pairs])

    def expected(self, pose: FloatArray) -> FloatArray:
        """Give what would be measured at another pose (3,), (k,), not wrapped."""
        pairs = zip(self.fixes, self.taken, strict=True)
        return np.concatenate([part @ fix.expected(pose) for fix, part in pairs])
