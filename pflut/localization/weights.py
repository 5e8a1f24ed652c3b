"""The weights of particles: kept as logarithms, normalised in one place."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from pflut._jit import jit
from pflut.geometry import FloatArray


@jit
def _sums(values: FloatArray) -> tuple[float, float]:
    """Sum the values and their squares, in an order that no thread count changes: O(N)."""
    total, squares = 0.0, 0.0
    for i in range(values.shape[0]):
        total += values[i]
        squares += values[i] * values[i]
    return total, squares


@dataclass(frozen=True, eq=False)
class Weights:
    """Normalised weights of N particles. Make them with `uniform`, `from_log` or `times`.

    Parameters
    ----------
    count : int
        N.
    effective_sample_size : float
        ``1 / sum(linear**2)``, in [1, N] (Kong, Liu, Wong 1994).
    log_mean : float
        Logarithm of the sum they were divided by. After `times` this is the log of the mean
        likelihood under the weights before: how well the observation was expected.
    arrays : tuple of two ndarrays of shape (N,), optional
        `log` and `linear`. Without them all are equal, and the arrays are made when asked for: a
        million particles that were resampled do not need them.
    """

    count: int
    effective_sample_size: float
    log_mean: float = 0.0
    arrays: tuple[FloatArray, FloatArray] | None = None

    def __len__(self) -> int:
        """Return the number of particles."""
        return self.count

    @cached_property
    def log(self) -> FloatArray:
        """Their logarithms (N,); -inf is a particle that is ruled out."""
        return np.full(self.count, -np.log(self.count)) if self.arrays is None else self.arrays[0]

    @cached_property
    def linear(self) -> FloatArray:
        """The weights (N,); they sum to one."""
        return np.full(self.count, 1.0 / self.count) if self.arrays is None else self.arrays[1]

    @classmethod
    def uniform(cls, n: int) -> Weights:
        """Give n >= 1 equal weights."""
        if n < 1:
            raise ValueError(f"weights: expected those of at least one particle, got {n}")
        return cls(n, float(n))

    @classmethod
    def from_log(cls, log_weights: ArrayLike) -> Weights:
        """Normalise log-weights.

        Parameters
        ----------
        log_weights : array_like of shape (N,)
            -inf is allowed, NaN and +inf are not.

        Returns
        -------
        Weights

        Raises
        ------
        ValueError
            If the shape is another, a value is NaN or +inf, or all are -inf.
        """
        values = np.ascontiguousarray(log_weights, dtype=np.float64)
        if values.ndim != 1 or values.size == 0:
            raise ValueError(f"log_weights: expected shape (N,) with N >= 1, got {values.shape}")
        weights = _normalize(np.zeros_like(values), values)
        if weights is None:
            raise ValueError(
                "log_weights: expected numbers below +inf, at least one above -inf; "
                f"got NaN or +inf {int((~(values < np.inf)).sum())} times in {values.size}"
            )
        return weights

    @classmethod
    def of_poses(cls, n: int, log_weights: ArrayLike | None) -> Weights:
        """Give the weights of n poses: equal ones where none are given.

        Parameters
        ----------
        n : int
            How many poses there are.
        log_weights : array_like of shape (n,) or None
            As in `from_log`.

        Raises
        ------
        ValueError
            As `from_log`, or if there are not n of them, or no pose at all.
        """
        weights = cls.uniform(n) if log_weights is None else cls.from_log(log_weights)
        if len(weights) != n:
            raise ValueError(f"log_weights: expected {n}, one a pose, got {len(weights)}")
        return weights

    def share_of_last(self, count: int) -> float:
        """Give the share of the weight that the last ``count`` particles have."""
        return min(float(self.linear[len(self) - count :].sum()), 1.0) if count else 0.0

    def times(self, log_likelihood: FloatArray) -> Weights | None:
        """Multiply by likelihoods and normalise.

        Parameters
        ----------
        log_likelihood : ndarray of shape (N,)
            float64, contiguous.

        Returns
        -------
        Weights or None
            None where no weights would be left: a likelihood is NaN or +inf, or it rules out
            every particle.
        """
        equal = self.arrays is None
        return _normalize(-np.log(self.count) if equal else self.log, log_likelihood)


def _normalize(log_weights: FloatArray | float, log_likelihood: FloatArray) -> Weights | None:
    """Add, subtract the highest before exp so that nothing overflows, divide by the sum."""
    # a sum of -inf and +inf is the NaN that is looked for
    with np.errstate(invalid="ignore", over="ignore"):
        log = log_weights + log_likelihood
    highest = log.max()
    # a NaN is the highest of all, whatever else there is
    if not -np.inf < highest < np.inf:
        return None
    log -= highest
    linear = np.exp(log)
    total, squares = _sums(linear)
    log -= np.log(total)
    linear /= total
    log_mean = float(highest + np.log(total))
    return Weights(len(log), total * total / squares, log_mean, (log, linear))
