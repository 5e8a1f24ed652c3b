"""People among landmarks: they hide what is behind them, and carry landmarks about."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pflut.geometry import FloatArray
from pflut.simulation.landmark_kernels import PERSON_RADIUS
from pflut.simulation.landmarks import Landmarks, scatter
from pflut.trajectory import Trajectory

POLITENESS = 0.7  # metres: nobody comes closer to the robot
PACE = 1.6  # how much faster than the robot they walk
WORN = 30  # landmarks on a person
ELSEWHERE = 1e6  # metres: where who would stand on the robot is put


@dataclass(frozen=True, eq=False)
class Crowd:
    """People who walk along a path, each from another place on.

    Attributes
    ----------
    path : Trajectory
        Walked again from its start when it ends.
    delays : ndarray of shape (k,)
        When each was at the start, seconds.
    patterns : ndarray of shape (k, 30, 2)
        The landmarks on each: direction in radians and height in metres.
    """

    path: Trajectory
    delays: FloatArray
    patterns: FloatArray

    @classmethod
    def gather(cls, path: Trajectory, count: int, rng: np.random.Generator) -> Crowd:
        """Send people along a path.

        Parameters
        ----------
        path : Trajectory
        count : int
            How many.
        rng : Generator

        Returns
        -------
        Crowd
        """
        patterns = [scatter(rng, WORN, 2.0 * np.pi, 0.3, 1.7) for _ in range(count)]
        delays = rng.uniform(0.0, path.stamps[-1], count)
        return cls(path, delays, np.array(patterns).reshape(-1, WORN, 2))

    def __len__(self) -> int:
        """Return the number of people."""
        return len(self.delays)

    def poses(self, stamp: float, robot: FloatArray) -> FloatArray:
        """Give where everybody is, shape (k, 3); who would stand on the robot is far away.

        Parameters
        ----------
        stamp : float
            Seconds.
        robot : ndarray of shape (3,)
            Its pose.
        """
        times = (stamp * PACE + self.delays) % self.path.stamps[-1]
        poses = self.path.interpolate(times)
        distance = np.hypot(poses[:, 0] - robot[0], poses[:, 1] - robot[1])
        poses[distance < POLITENESS, :2] = ELSEWHERE
        return poses

    def among(self, landmarks: Landmarks, poses: FloatArray) -> Landmarks:
        """Add the people's landmarks to those that stand still.

        Parameters
        ----------
        landmarks : Landmarks
        poses : ndarray of shape (k, 3)
            Of the people.

        Returns
        -------
        Landmarks
            First those that stand still.
        """
        if not len(self):
            return landmarks
        facing = (poses[:, None, 2] + self.patterns[..., 0]).ravel()
        centers = np.repeat(poses[:, :2], WORN, axis=0)
        points = np.column_stack(
            [
                centers + PERSON_RADIUS * np.column_stack([np.cos(facing), np.sin(facing)]),
                self.patterns[..., 1].ravel(),
            ]
        )
        looks = landmarks.looks.max() + 1 + np.arange(len(points))
        return Landmarks.join([landmarks, Landmarks(points, facing, looks)])
