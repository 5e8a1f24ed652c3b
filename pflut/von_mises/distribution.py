"""The von Mises distribution: the normal distribution of an angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import TWO_PI, FloatArray, circular_mean
from pflut.von_mises.bessel import bessel_ratio, log_i0

MAX_CONCENTRATION = 1e8
"""Angles that are all the same have no finite one; its deviation is 0.1 mrad."""


@dataclass(frozen=True)
class VonMises:
    """A density over an angle, exp(k cos(angle - mean)) / (2 pi I0(k)).

    Parameters
    ----------
    mean : float
        Radians in (-pi, pi].
    concentration : float
        k, not negative; zero is uniform, for large ones it is one over the variance.

    References
    ----------
    K. V. Mardia, P. E. Jupp, "Directional Statistics", 2000, section 3.5.4.
    """

    mean: float
    concentration: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.mean):
            raise ValueError(f"mean: expected radians, got {self.mean}")
        if not 0.0 <= self.concentration < np.inf:
            raise ValueError(
                f"concentration: expected a number not negative, got {self.concentration}"
            )

    @classmethod
    def fit(cls, angles: ArrayLike, weights: ArrayLike | None = None) -> VonMises:
        """Fit by moments, which is maximum likelihood: the mean direction and its length are kept.

        Parameters
        ----------
        angles : array_like of shape (n,)
            Radians.
        weights : array_like of shape (n,), optional
            Not negative, of any sum.

        Returns
        -------
        VonMises

        Raises
        ------
        ValueError
            If there is no angle, or the weights do not fit.
        """
        a = np.asarray(angles, dtype=np.float64)
        w = np.ones(a.shape) if weights is None else np.asarray(weights, dtype=np.float64)
        if a.ndim != 1 or w.shape != a.shape or not w.sum() > 0.0 or (w < 0.0).any():
            raise ValueError(
                f"angles, weights: expected shape (n,) and a positive sum, got {a.shape}, {w.shape}"
            )
        mean = circular_mean(a, w)
        # one minus the length, without the difference of nearly equal numbers
        spread = float(w @ (2.0 * np.sin(0.5 * (a - mean)) ** 2) / w.sum())
        return cls(mean, concentration_of_spread(spread))

    @classmethod
    def of_components(
        cls, weights: ArrayLike, means: ArrayLike, concentrations: ArrayLike
    ) -> VonMises:
        """Merge distributions into one with their mean direction and its length.

        Parameters
        ----------
        weights, means, concentrations : array_like of shape (n,)
            Weights of any positive sum; means in radians.

        Returns
        -------
        VonMises
        """
        lengths = bessel_ratio(concentrations)
        w = np.asarray(weights, dtype=np.float64)
        a = np.asarray(means, dtype=np.float64)
        mean = circular_mean(a, w * lengths)
        # 1 - length cos(difference), in two parts that are not negative
        spreads = (1.0 - lengths) + lengths * 2.0 * np.sin(0.5 * (a - mean)) ** 2
        return cls(mean, concentration_of_spread(float(w @ spreads / w.sum())))

    def log_density(self, angles: ArrayLike) -> FloatArray:
        """Return the log of the density, per radian, in the shape of the angles.

        Parameters
        ----------
        angles : array_like
            Radians.

        Returns
        -------
        ndarray
        """
        # k (cos - 1) and log(I0) - k instead of two large numbers that cancel
        below = -2.0 * np.sin(0.5 * (np.asarray(angles, dtype=np.float64) - self.mean)) ** 2
        k = self.concentration
        return np.asarray(k * below - (log_i0(k) - k) - np.log(TWO_PI))

    @property
    def deviation(self) -> float:
        """The circular standard deviation sqrt(-2 log E cos), radians."""
        return float(np.sqrt(-2.0 * np.log(np.maximum(bessel_ratio(self.concentration), 1e-300))))

    def entropy(self) -> float:
        """Return the differential entropy in nats; log(2 pi) = 1.84 where nothing is known."""
        k = self.concentration
        return float(np.log(TWO_PI) + (log_i0(k) - k) + k * (1.0 - bessel_ratio(k)))

    def divergence(self, other: VonMises) -> float:
        """Return the Kullback-Leibler divergence from another, in nats.

        Parameters
        ----------
        other : VonMises

        Returns
        -------
        float
            The mean of log(self / other) over self.
        """
        ratio = float(bessel_ratio(self.concentration))
        # of the mean cosine about the other's mean
        cosine = ratio * np.cos(self.mean - other.mean)
        k = other.concentration
        cross = np.log(TWO_PI) + (log_i0(k) - k) + k * (1.0 - cosine)
        return float(cross - self.entropy())


def concentration_of_spread(spread: float) -> float:
    """Give the concentration at which the mean cosine is one minus a spread.

    Parameters
    ----------
    spread : float
        1 - E cos(angle - mean), in [0, 1].

    Returns
    -------
    float
        At most `MAX_CONCENTRATION`.
    """
    if spread >= 1.0:
        return 0.0
    if spread <= 0.5 / MAX_CONCENTRATION:
        return MAX_CONCENTRATION
    length = 1.0 - spread
    # D. J. Best, N. I. Fisher, Communications in Statistics B 10 (1981) 493, then Newton's steps
    if length < 0.53:
        k = length * (2.0 + length**2 + 5.0 / 6.0 * length**4)
    elif length < 0.85:
        k = -0.4 + 1.39 * length + 0.43 / spread
    else:
        k = 1.0 / (spread * (2.0 - length) * (1.0 + spread**2)) if length < 0.98 else 0.5 / spread
    for _ in range(6):
        ratio = float(bessel_ratio(k))
        slope = 1.0 - ratio / k - ratio * ratio
        if not slope > 0.0:
            break
        k = max(k - (ratio - length) / slope, 0.5 * k)
    return float(k)
