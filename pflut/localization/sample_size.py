"""How many particles: as many as the posterior is wide (KLD sampling)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import pi
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from pflut._cells import COORDINATE_MASK, cell_key, empty_table, find_cell, heading_cell
from pflut._jit import jit
from pflut.geometry import TWO_PI, FloatArray
from pflut.localization.resampling import systematic_indices

GOLDEN = 0.6180339887498949


@jit
def _bound(occupied: int, error: float, quantile: float) -> float:
    """Give the number of draws for so many occupied cells: Fox 2003, equation (7)."""
    if occupied <= 1:
        return 0.0
    free = occupied - 1.0
    share = 2.0 / (9.0 * free)
    draws: float = free / (2.0 * error) * (1.0 - share + np.sqrt(share) * quantile) ** 3
    return draws


@jit
def _draws_needed(
    poses: FloatArray,
    indices: NDArray[np.int32],
    stride: int,
    fewest: int,
    cell: float,
    headings: int,
    error: float,
    quantile: float,
    keys: NDArray[np.int64],
) -> int:
    """Go through draws in a scattered order until there are enough of them: O(the answer).

    ``stride`` has no divisor in common with their number, so that each is seen once. ``keys`` is an
    empty hash table for as many cells.
    """
    n: int = indices.shape[0]
    occupied, at = 0, 0
    for seen in range(n):
        if seen >= fewest and seen >= _bound(occupied, error, quantile):
            return seen
        pose = poses[indices[at]]
        x = (int(np.floor(pose[0] / cell)) + (COORDINATE_MASK >> 1)) & COORDINATE_MASK
        y = (int(np.floor(pose[1] / cell)) + (COORDINATE_MASK >> 1)) & COORDINATE_MASK
        h = heading_cell(pose[2], headings)
        place = find_cell(x, y, h, keys)
        if keys[place] != cell_key(x, y, h):
            keys[place] = cell_key(x, y, h)
            occupied += 1
        at = (at + stride) % n
    return n


@dataclass(frozen=True, kw_only=True)
class KLDSampling:
    """As many particles as keep the sample close to the posterior: many if lost, few if not.

    Draws from the posterior are counted with the cells of a histogram that they fall in; there are
    enough of them when, with the given probability, the Kullback-Leibler distance between the
    sample and the posterior, both as histograms over the occupied cells, is below ``error``.

    Parameters
    ----------
    min_particles, max_particles : int
        Never fewer, never more.
    error : float
        Of the histogram, in nats; AMCL's ``kld_err``.
    probability : float
        In (0, 1), that the error is not exceeded; AMCL's ``kld_z`` is its normal quantile.
    cell_size : float
        Metres, of the histogram's cells.
    cell_angle : float
        Radians; rounded so that a circle has a whole number of cells, at most 256.

    Raises
    ------
    ValueError
        If an option is out of its range.

    References
    ----------
    D. Fox, "Adapting the sample size in particle filters through KLD-sampling", IJRR 22(12), 2003.
    Thrun, Burgard, Fox, "Probabilistic Robotics" (2005), table 8.4.
    """

    min_particles: int = 500
    max_particles: int = 5000
    error: float = 0.05
    probability: float = 0.99
    cell_size: float = 0.5
    cell_angle: float = pi / 18

    def __post_init__(self) -> None:
        if not 1 <= self.min_particles <= self.max_particles:
            raise ValueError(
                "min_particles: expected 1 <= min_particles <= max_particles, got "
                f"{self.min_particles} and {self.max_particles}"
            )
        for name in ("error", "cell_size"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name}: expected a positive number, got {getattr(self, name)}")
        if not 0.0 < self.probability < 1.0:
            raise ValueError(f"probability: expected in (0, 1), got {self.probability}")
        if not TWO_PI / 256 <= self.cell_angle <= TWO_PI:
            raise ValueError(
                f"cell_angle: expected radians in [2 pi / 256, 2 pi], got {self.cell_angle}"
            )

    @cached_property
    def _quantile(self) -> float:
        return NormalDist().inv_cdf(self.probability)

    @cached_property
    def _stride(self) -> int:
        """Visit every n-th draw, n prime to their number and near the golden section of it."""
        stride = max(int(GOLDEN * self.max_particles), 1)
        while np.gcd(stride, self.max_particles) != 1:
            stride += 1
        return stride

    def bound(self, occupied: int) -> int:
        """Give the number of particles for so many occupied cells, within the limits.

        Parameters
        ----------
        occupied : int

        Returns
        -------
        int
            Fox's equation (7), the chi-square quantile by Wilson and Hilferty, rounded up.
        """
        wanted = _bound(occupied, self.error, self._quantile)
        return int(np.clip(np.ceil(wanted), self.min_particles, self.max_particles))

    def sample_size(self, poses: FloatArray, weights: FloatArray) -> int:
        """Say how many particles weighted poses need.

        Parameters
        ----------
        poses : ndarray of shape (N, 3)
            float64, contiguous, finite.
        weights : ndarray of shape (N,)
            float64, >= 0, not all zero.

        Returns
        -------
        int
            In [min_particles, max_particles]; the same for the same input.
        """
        # the comb's draws in a scattered order stand for independent ones
        indices = systematic_indices(weights, self.max_particles, 0.5)
        headings = max(round(TWO_PI / self.cell_angle), 1)
        return _draws_needed(
            poses,
            indices,
            self._stride,
            self.min_particles,
            self.cell_size,
            headings,
            self.error,
            self._quantile,
            empty_table(self.max_particles),
        )
