"""What a relative pose to a reference says about where the robot is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pflut.geometry import FloatArray, wrap_to_pi
from pflut.relpose.result import RelativePose

TINY = 1e-12
"""Square metres: so near to a reference is on it, and the directions have no derivative."""


@dataclass(frozen=True, eq=False)
class RelativePoseFix:
    """Both headings between a reference and the robot, measured in one pair of images.

    Parameters
    ----------
    index : int
        Of the reference in the map.
    reference : ndarray of shape (3,)
        Its pose ``[x, y, heading]`` in the map's frame.
    headings : ndarray of shape (2,)
        The direction from the reference to the robot in the reference's frame (``heading_l``), and
        the direction from the robot to the reference in the robot's (``heading_r``), radians.
    covariance : ndarray of shape (2, 2)
        Of both, radians squared.
    """

    index: int
    reference: FloatArray
    headings: FloatArray
    covariance: FloatArray

    @classmethod
    def of(
        cls,
        index: int,
        reference: FloatArray,
        pose: RelativePose,
        *,
        inflation: float = 1.0,
        min_std: float = 0.0,
    ) -> RelativePoseFix:
        """Make one of an estimated relative pose.

        Parameters
        ----------
        index : int
        reference : ndarray of shape (3,)
        pose : RelativePose
        inflation : float
            Factor on the estimated covariance.
        min_std : float
            Radians: independent noise added to either heading after that.

        Returns
        -------
        RelativePoseFix
        """
        headings = np.array([pose.heading_l, pose.heading_r])
        covariance = inflation * pose.covariance + min_std**2 * np.eye(2)
        return cls(index, reference, headings, covariance)

    def distance(self, poses: FloatArray) -> FloatArray:
        """Give the distance of poses (..., 3) to the reference, metres."""
        offset = poses[..., :2] - self.reference[:2]
        return np.asarray(np.hypot(offset[..., 0], offset[..., 1]))

    def residuals(self, poses: FloatArray) -> FloatArray:
        """Give measured less expected headings at poses.

        Parameters
        ----------
        poses : ndarray of shape (..., 3)

        Returns
        -------
        ndarray of shape (..., 2)
            Radians in (-pi, pi].
        """
        return np.asarray(wrap_to_pi(self.headings - self.expected(poses)))

    def expected(self, poses: FloatArray) -> FloatArray:
        """Give the headings that a robot at poses (..., 3) would see, (..., 2), not wrapped."""
        dx = poses[..., 0] - self.reference[0]
        dy = poses[..., 1] - self.reference[1]
        direction = np.arctan2(dy, dx)
        return np.stack([direction - self.reference[2], direction + np.pi - poses[..., 2]], axis=-1)

    def jacobian(self, pose: FloatArray) -> FloatArray:
        """Give the derivative of the expected headings with respect to a pose.

        Parameters
        ----------
        pose : ndarray of shape (3,)

        Returns
        -------
        ndarray of shape (2, 3)
            The rows' difference, that of the rotation, is right on the reference itself, too.
        """
        dx, dy = pose[:2] - self.reference[:2]
        squared = max(dx * dx + dy * dy, TINY)
        across = [-dy / squared, dx / squared]
        return np.array([[*across, 0.0], [*across, -1.0]])
