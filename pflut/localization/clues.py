"""What a lost robot has seen lately, how it moved between, and where that may have begun."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pflut.geometry import FloatArray, compose
from pflut.localization.motion import Increment
from pflut.localization.relative_pose_fix import RelativePoseFix
from pflut.localization.relative_pose_model import RelativePoseModel

LONGEST = 10
"""Images: what was seen earlier is forgotten."""

Clue = tuple[list[RelativePoseFix], list[Increment]]


class Clues:
    """Relative poses of the last images, in their order, with the motions after each of them.

    One image may show too little to tell where the robot is; several together do.
    """

    def __init__(self) -> None:
        self._clues: deque[Clue] = deque(maxlen=LONGEST)

    def __iter__(self) -> Iterator[Clue]:
        """Give the relative poses of each image and the motions that followed."""
        return iter(self._clues)

    def __len__(self) -> int:
        """Return the number of relative poses."""
        return sum(len(fixes) for fixes, _ in self._clues)

    def see(self, fixes: list[RelativePoseFix]) -> None:
        """Add an image; one without relative poses is no clue."""
        if fixes:
            self._clues.append((fixes, []))

    def move(self, increment: Increment) -> None:
        """Add a motion."""
        if self._clues:
            self._clues[-1][1].append(increment)

    def forget(self) -> None:
        """Forget all."""
        self._clues.clear()

    def log_likelihood(
        self, sensor: RelativePoseModel, poses: FloatArray, *, std: float
    ) -> FloatArray:
        """Say how well the first image was taken at poses, by all that was seen since.

        Parameters
        ----------
        sensor : RelativePoseModel
        poses : ndarray of shape (N, 3)
        std : float
            Radians of noise to make relative poses as blunt as the poses are coarse; its variance
            is added once more for each later image, whose place the odometry tells.

        Returns
        -------
        ndarray of shape (N,)
        """
        total = np.zeros(len(poses))
        for age, (fixes, increments) in enumerate(self._clues, start=1):
            noise = age * std**2 * np.eye(2)
            blunt = [replace(fix, covariance=fix.covariance + noise) for fix in fixes]
            total += sensor.log_likelihood_of_fixes(poses, blunt)
            for step in increments:
                forward = [np.cos(step.direction), np.sin(step.direction)]
                poses = compose(poses, [*np.multiply(step.translation, forward), step.rotation])
        return total
