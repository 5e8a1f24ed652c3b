"""What the Kalman filters on relative poses have in common: the gate, and finding a lost robot."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import FloatArray, wrap_to_pi
from pflut.localization.clues import Clues
from pflut.localization.dead_reckoning import DeadReckoning, GaussianMotion
from pflut.localization.estimate import Estimate
from pflut.localization.global_search import pose_lattice
from pflut.localization.initial_poses import Bounds, check_bounds
from pflut.localization.relative_pose_fix import RelativePoseFix
from pflut.localization.relative_pose_model import RelativePoseModel
from pflut.localization.stacked_fixes import StackedFixes
from pflut.relpose.result import UNIFORM_VARIANCE

SPACING = 0.2
NUM_HEADINGS = 72
SEARCH_STD = 0.05
"""The lattice that a lost robot is looked for on (metres, headings on the circle), and the noise
in radians that makes relative poses as blunt as the lattice is coarse."""
MARGIN = 1.0
"""Metres around the references, where a robot that got lost is looked for."""


class KalmanFilter(DeadReckoning, ABC):
    """What the extended and the unscented Kalman filter have in common.

    It has the interface of `ParticleFilter`, and the motion model with its parameters; of an image
    it hears one relative pose a reference. Those that contradict the prediction are left out (the
    gate, by the Mahalanobis distance), the others correct it all at once. The gate is then looked
    at again from the corrected pose, and so on: a relative pose that was let in by a wide
    prediction may contradict the others, and one that was left out may agree.

    Near a reference the direction to it is meaningless: within the sensor's ``near_range``, or two
    standard deviations of the position if that is more, only the rotation is used.

    Parameters
    ----------
    motion : DifferentialDrive or Omnidirectional
    sensor : RelativePoseModel
        Gives the relative poses with their covariances.
    gate : float
        In (0, 1): the probability that a right relative pose is let in, chi-square with two
        degrees of freedom, or one of the rotation alone.
    iterations : int
        How often an image is corrected with, at most: 1 is the textbook's filter. The extended
        filter linearises around the corrected pose, too.
    min_agreeing : float
        In [0, 1]: an image of which a smaller share of relative poses passes the gate contradicts
        the filter.
    relocalize_after : int or None
        After so many contradicting images in a row the robot is looked for everywhere; None never
        does. Images without relative poses say nothing.
    min_fixes : int
        At least 2: so many relative poses must agree on a pose for a lost robot to start there.

    Raises
    ------
    ValueError
        If an option is out of its range.

    References
    ----------
    Thrun, Burgard, Fox, "Probabilistic Robotics" (2005), tables 3.3 and 3.4, section 7.5. B. Bell,
    F. Cathey, "The iterated Kalman filter update as a Gauss-Newton method", IEEE Transactions on
    Automatic Control 38(2), 1993.
    """

    sensor: RelativePoseModel

    def __init__(
        self,
        motion: GaussianMotion,
        sensor: RelativePoseModel,
        *,
        gate: float = 0.99,
        iterations: int = 5,
        min_agreeing: float = 0.5,
        relocalize_after: int | None = 2,
        min_fixes: int = 2,
    ) -> None:
        if not 0.0 < gate < 1.0:
            raise ValueError(f"gate: expected a probability in (0, 1), got {gate}")
        if iterations < 1:
            raise ValueError(f"iterations: expected at least 1, got {iterations}")
        if not 0.0 <= min_agreeing <= 1.0:
            raise ValueError(f"min_agreeing: expected a share in [0, 1], got {min_agreeing}")
        if relocalize_after is not None and relocalize_after < 1:
            raise ValueError(f"relocalize_after: expected at least 1, got {relocalize_after}")
        if min_fixes < 2:
            raise ValueError(f"min_fixes: expected at least 2, got {min_fixes}")
        super().__init__(motion)
        self.sensor = sensor
        self.gate = gate
        self.iterations = iterations
        self.min_agreeing = min_agreeing
        self.relocalize_after = relocalize_after
        self.min_fixes = min_fixes
        # the chi-square distribution's quantiles, by degrees of freedom
        one = NormalDist().inv_cdf(0.5 - 0.5 * gate) ** 2
        self._limits = {1: one, 2: -2.0 * float(np.log1p(-gate))}
        self._bounds = sensor.reference_map.bounds(MARGIN)
        self._lost = False
        self._contradictions = 0
        self._clues = Clues()

    @property
    def lost(self) -> bool:
        """Whether the filter was started lost and no image has told yet where the robot is."""
        return self._lost

    def initialize_gaussian(self, mean: ArrayLike, covariance: ArrayLike) -> None:
        """Start from a pose that is known up to a covariance, see `DeadReckoning`."""
        super().initialize_gaussian(mean, covariance)
        self._lost, self._contradictions = False, 0
        self._clues.forget()

    def initialize_lost(self, bounds: Bounds) -> None:
        """Start lost: the first images that tell where the robot is start the filter.

        Until then the estimate is the middle of the bounds with a covariance to match, and is
        flagged as degenerate.

        Parameters
        ----------
        bounds : tuple (xmin, ymin, xmax, ymax)
            Metres: where to look for the robot, now and whenever it gets lost.

        Raises
        ------
        ValueError
            If the bounds are not finite or the wrong way round.
        """
        check_bounds(bounds)
        low_x, low_y, high_x, high_y = bounds
        variances = [(high_x - low_x) ** 2 / 12.0, (high_y - low_y) ** 2 / 12.0, UNIFORM_VARIANCE]
        middle = [0.5 * (low_x + high_x), 0.5 * (low_y + high_y), 0.0]
        self.initialize_gaussian(middle, np.diag(variances))
        self._bounds, self._lost = bounds, True

    def predict(self, odometry: ArrayLike, *, stamp: float | None = None) -> None:
        """Move the pose by the odometry, see `DeadReckoning`; a lost robot stays lost."""
        increment = self.motion.increment(odometry)
        self._clues.move(increment)
        if not self._lost:
            self._set(*self._moved(increment))

    def update(self, observation: Any, *, stamp: float | None = None) -> Estimate:
        """Correct the pose with an observation.

        Parameters
        ----------
        observation : Features, image or sequence of ReferenceMatch
            As the sensor takes it.
        stamp : float, optional
            Seconds; handed on to the estimate.

        Returns
        -------
        Estimate
            Where no relative pose was usable that is the prediction, flagged as degenerate.
            ``log_mean_likelihood`` is the log-likelihood of the innovation of those that were.

        Raises
        ------
        ValueError
            If the filter is not initialised.
        """
        found: float | None = None
        if not self._lost:
            fixes = self.sensor.fixes(self.pose[None], observation)
            agreeing, found = self._correct(fixes)
            if fixes:
                contradicts = agreeing < max(self.min_agreeing * len(fixes), 1)
                self._contradictions = self._contradictions + 1 if contradicts else 0
        gone = self.relocalize_after is not None and self._contradictions >= self.relocalize_after
        if self._lost or gone:
            elsewhere = self._search(observation)
            found = elsewhere if elsewhere is not None else found
        else:
            self._clues.forget()
        if found is None:
            self.degenerate_updates += 1
        return replace(
            self.estimate(), log_mean_likelihood=found, degenerate=found is None, stamp=stamp
        )

    def _correct(self, fixes: Sequence[RelativePoseFix]) -> tuple[int, float | None]:
        """Correct with what passes the gate; say how many do, and the innovation's likelihood."""
        around, spread = self.pose, self._covariance
        chosen: list[int] = []
        log_likelihood: float | None = None
        for _ in range(self.iterations):
            before, chosen = chosen, self._passing(fixes, around, spread)
            if not chosen:
                return 0, None
            measured = StackedFixes.of([fixes[i] for i in chosen], around, near=self._near(spread))
            moved, spread, log_likelihood = self._corrected(measured, around)
            change = np.abs([*(moved[:2] - around[:2]), wrap_to_pi(moved[2] - around[2])]).max()
            around = moved
            if chosen == before and change < 1e-6:
                break
        self._set(around, spread)
        return len(chosen), log_likelihood

    def _passing(
        self, fixes: Sequence[RelativePoseFix], pose: FloatArray, covariance: FloatArray
    ) -> list[int]:
        """Say which relative poses agree with a Gaussian pose, by the Mahalanobis distance."""
        passing, near = [], self._near(covariance)
        for i, fix in enumerate(fixes):
            one = StackedFixes.of([fix], pose, near=near)
            spread = one.jacobian @ covariance @ one.jacobian.T + one.noise
            squared = one.residuals @ np.linalg.solve(spread, one.residuals)
            if squared <= self._limits[len(one.residuals)]:
                passing.append(i)
        return passing

    def _near(self, covariance: FloatArray) -> float:
        """Give the distance to a reference, metres, below which only the rotation is used."""
        widest = float(np.linalg.eigvalsh(covariance[:2, :2])[1])
        return max(2.0 * float(np.sqrt(max(widest, 0.0))), self.sensor.near_range)

    def _search(self, observation: Any) -> float | None:
        """Look for the robot everywhere; None where too few relative poses agree on a pose.

        The likelihood of the last images is highest somewhere on a lattice of poses of the first
        of them; from there the filter goes through them all.
        """
        lattice = pose_lattice(self._bounds, spacing=SPACING, num_headings=NUM_HEADINGS)
        fixes = self.sensor.fixes(lattice, observation)
        self._clues.see(fixes)
        if not fixes or len(self._clues) < self.min_fixes:
            return None
        before = self.pose, self._covariance
        values = self._clues.log_likelihood(self.sensor, lattice, std=SEARCH_STD)
        spread = np.diag(np.square([SPACING, SPACING, 2.0 * np.pi / NUM_HEADINGS]))
        self._set(lattice[values.argmax()], spread)
        agreeing = 0
        for fixes, increments in self._clues:
            passing, log_likelihood = self._correct(fixes)
            agreeing += passing
            for increment in increments:
                self._set(*self._moved(increment))
        if agreeing < max(self.min_agreeing * len(self._clues), self.min_fixes):
            self._set(*before)
            return None
        self._lost, self._contradictions = False, 0
        self._clues.forget()
        return log_likelihood

    @abstractmethod
    def _corrected(
        self, measured: StackedFixes, around: FloatArray
    ) -> tuple[FloatArray, FloatArray, float]:
        """Correct the filter's pose with all measurements, linearised around another pose.

        Returns the pose, the covariance and the innovation's log-likelihood.
        """
