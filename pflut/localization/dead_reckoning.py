"""Odometry alone, in the place of a filter: what localization has to be better than."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import FloatArray, wrap_to_pi
from pflut.localization.estimate import Estimate
from pflut.localization.gaussian import as_gaussian, mass_nearby
from pflut.localization.motion import Increment


class GaussianMotion(Protocol):
    """What is asked of a motion model: `DifferentialDrive` and `Omnidirectional` have it."""

    def increment(self, odometry: ArrayLike) -> Increment:
        """Give an odometry increment (3,) with the variances of its noise."""
        ...  # pragma: no cover


class DeadReckoning:
    """A Gaussian pose that moves with the odometry and sees nothing.

    It has the interface of `ParticleFilter`, so a `Localizer` drives it: `predict` moves the pose
    and lets its covariance grow, `update` gives it back whatever the observation is.

    Parameters
    ----------
    motion : DifferentialDrive or Omnidirectional

    References
    ----------
    Thrun, Burgard, Fox, "Probabilistic Robotics" (2005), table 3.3, lines 2 and 3.
    """

    sensor: Any = None

    def __init__(self, motion: GaussianMotion) -> None:
        self.motion = motion
        self.degenerate_updates = 0
        self._pose: FloatArray | None = None
        self._covariance = np.eye(3)

    def initialize_gaussian(self, mean: ArrayLike, covariance: ArrayLike) -> None:
        """Start from a pose that is known up to a covariance.

        Parameters
        ----------
        mean : array_like of shape (3,)
            ``[x, y, heading]``.
        covariance : array_like of shape (3, 3)
            Symmetric, no eigenvalue below zero; zeros are allowed.

        Raises
        ------
        ValueError
            If the covariance is none.
        """
        pose, matrix = as_gaussian(mean, covariance)
        self._set(pose, matrix)
        self.degenerate_updates = 0

    def predict(self, odometry: ArrayLike, *, stamp: float | None = None) -> None:
        """Move the pose by the odometry, and let its covariance grow.

        Parameters
        ----------
        odometry : array_like of shape (3,)
            The motion since the last call in the robot's own old frame.
        stamp : float, optional
            Not looked at; as `ParticleFilter.predict` has it.

        Raises
        ------
        ValueError
            If the filter is not initialised, or the odometry is not three finite numbers.
        """
        self._set(*self._moved(self.motion.increment(odometry)))

    def update(self, observation: Any, *, stamp: float | None = None) -> Estimate:
        """Give the pose; the observation is not looked at.

        Parameters
        ----------
        observation : object
        stamp : float, optional
            Seconds; handed on to the estimate.

        Returns
        -------
        Estimate

        Raises
        ------
        ValueError
            If the filter is not initialised.
        """
        return replace(self.estimate(), stamp=stamp)

    def step(
        self, odometry: ArrayLike, observation: Any, *, stamp: float | None = None
    ) -> Estimate:
        """Predict, then update: one turn of the loop.

        Parameters
        ----------
        odometry : array_like of shape (3,)
            As in `predict`.
        observation : object
            As in `update`.
        stamp : float, optional
            Seconds; handed on to the estimate.

        Returns
        -------
        Estimate
        """
        self.predict(odometry)
        return self.update(observation, stamp=stamp)

    def estimate(self) -> Estimate:
        """Give the pose as it is now, as after a `predict`.

        Returns
        -------
        Estimate
            Its confidence is the Gaussian's mass within 0.5 m and 10 degrees. There are no
            particles: it says that there is one, with all the weight.

        Raises
        ------
        ValueError
            If the filter is not initialised.
        """
        return Estimate(
            pose=self.pose.copy(),
            covariance=self._covariance.copy(),
            confidence=mass_nearby(self._covariance),
            cluster_weight=1.0,
            effective_sample_size=1.0,
            num_particles=1,
            degenerate_updates=self.degenerate_updates,
        )

    @property
    def pose(self) -> FloatArray:
        """The pose, ``(3,)``: the filter's own array; do not write to it."""
        if self._pose is None:
            raise ValueError("the filter is not initialised: call one of its initialize methods")
        return self._pose

    @property
    def covariance(self) -> FloatArray:
        """Its covariance, ``(3, 3)``; not a copy, as with `pose`."""
        return self._covariance

    def _moved(self, increment: Increment) -> tuple[FloatArray, FloatArray]:
        """Give the pose and the covariance after a motion."""
        moved, jacobian, noise = increment.linearized(self.pose)
        return moved, jacobian @ self._covariance @ jacobian.T + noise

    def _set(self, pose: FloatArray, covariance: FloatArray) -> None:
        """Keep a pose and its covariance, made symmetric again, as new arrays."""
        self._pose = np.array([pose[0], pose[1], wrap_to_pi(pose[2])])
        self._covariance = 0.5 * (covariance + covariance.T)
