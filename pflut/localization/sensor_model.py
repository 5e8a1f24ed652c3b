"""What the particle filter asks of a sensor model."""

from __future__ import annotations

from typing import Any, Protocol

from numpy.typing import ArrayLike

from pflut.geometry import FloatArray


class SensorModel(Protocol):
    """What the particle filter asks of a sensor model."""

    def log_likelihood(self, poses: FloatArray, observation: Any) -> ArrayLike:
        """Give the observation's log-likelihood at each of the poses.

        Parameters
        ----------
        poses : ndarray of shape (N, 3)
            ``[x, y, heading]``; not to be changed.
        observation : object
            Whatever `ParticleFilter.update` was handed.

        Returns
        -------
        array_like of shape (N,)
            Up to a constant; -inf rules a pose out.
        """
        ...  # pragma: no cover
