"""Are posteriors as sure as they may be? Coverage of true poses, and the temperature that fits.

A posterior is calibrated if its credible region of mass p holds the true pose in a share p of the
pairs. Correspondences that are not independent make posteriors too narrow; the temperature, a
factor on the log-likelihood, widens them, and pairs with known poses tell which one is right.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pflut.geometry import FloatArray
from pflut.likelihood.known_pairs import Pair
from pflut.posterior import GridPosterior, Likelihood, check_temperature, pose_posterior
from pflut.statistics import success_rate

LEAST_TEMPERATURE = 0.02
_STEP = 0.05  # nat: log-likelihoods so near each other are taken together, by their mean
_TIES_SEED = 0


@dataclass(frozen=True, eq=False)
class Coverage:
    """How often credible regions hold the true pose, and how probable they find it.

    Parameters
    ----------
    levels : ndarray of shape (k,)
        Masses of credible regions.
    rates, low, high : ndarray of shape (k,)
        Share of the pairs whose region holds the true pose, with the 95 % Wilson interval. It
        takes the pairs for independent, which those that share images are not quite.
    masses : ndarray of shape (n,)
        Mass of the smallest credible region that reaches the true pose, for each pair; uniform
        over [0, 1] if the posteriors are calibrated.
    log_densities : ndarray of shape (n,)
        Log of the probability density at the true pose for each pair, nats, a squared radian.
    """

    levels: FloatArray
    rates: FloatArray
    low: FloatArray
    high: FloatArray
    masses: FloatArray
    log_densities: FloatArray

    @property
    def num_pairs(self) -> int:
        """How many pairs were looked at."""
        return len(self.masses)

    @property
    def log_score(self) -> float:
        """The mean of `log_densities`: a proper score, the higher the better.

        Where nothing is known it is -2 log(2 pi) = -3.68.
        """
        return float(self.log_densities.mean())

    @classmethod
    def of(cls, masses: FloatArray, log_densities: FloatArray, levels: Sequence[float]) -> Coverage:
        """Count the coverage of some pairs, for example of a part of those of another coverage.

        Parameters
        ----------
        masses, log_densities : ndarray of shape (n,)
            Of the pairs.
        levels : sequence of float
            Masses of credible regions.

        Returns
        -------
        Coverage
        """
        rates = [success_rate(masses <= level) for level in levels]
        return cls(
            np.array(levels, dtype=np.float64),
            np.array([rate.rate for rate in rates]),
            np.array([rate.low for rate in rates]),
            np.array([rate.high for rate in rates]),
            masses,
            log_densities,
        )


def coverage(
    pairs: Iterable[Pair],
    likelihood: Likelihood,
    *,
    temperature: float = 1.0,
    bins: int | None = None,
    levels: Sequence[float] = (0.5, 0.8, 0.95, 0.99),
) -> Coverage:
    """Count how often the posteriors' credible regions hold the true poses.

    The truth's own cell is in the region by the share of it that the region still needs: a region
    of whole cells holds more than its mass, and the truth more often, the more so the coarser the
    grid. Which truths are in is drawn, always the same way.

    Parameters
    ----------
    pairs : iterable of (Correspondences, heading_l, heading_r)
        With the true headings, radians.
    likelihood : LikelihoodTable or DenseTable
    temperature : float
        Of the posteriors, in (0, 1].
    bins : int, optional
        Cells an axis; default: the table's own. They should be narrower than the posteriors: a
        cell has one likelihood, wherever in it the truth lies.
    levels : sequence of float
        Masses of credible regions, in (0, 1).

    Returns
    -------
    Coverage

    Raises
    ------
    ValueError
        If there are no pairs, or a parameter is out of its range.
    """
    check_temperature(temperature)
    if not all(0.0 < level < 1.0 for level in levels):
        raise ValueError(f"levels: expected shares in (0, 1), got {tuple(levels)}")
    shares = np.random.default_rng(_TIES_SEED)
    masses, log_densities = [], []
    for posterior, theta, phi in _posteriors(pairs, likelihood, temperature, bins):
        level = posterior.log_prob[posterior.cell(theta, phi)]
        above = float(posterior.prob[posterior.log_prob > level].sum())
        equal = float(posterior.prob[posterior.log_prob == level].sum())
        masses.append(min(1.0, above + shares.uniform() * equal))
        log_densities.append(posterior.log_density(theta, phi))
    return Coverage.of(np.array(masses), np.array(log_densities), levels)


def fit_temperature(
    pairs: Iterable[Pair], likelihood: Likelihood, *, bins: int | None = None
) -> float:
    """Find the temperature at which the true poses are the most probable.

    That of the highest mean log-probability of the truth's cell. Temperatures are tried from
    `LEAST_TEMPERATURE` to 1; the mean is concave over them, so there is one maximum.

    Parameters
    ----------
    pairs : iterable of (Correspondences, heading_l, heading_r)
        With the true headings, radians.
    likelihood : LikelihoodTable or DenseTable
    bins : int, optional
        Cells an axis; default: the table's own.

    Returns
    -------
    float
        1 where the posteriors are not too narrow; they may then be too wide.

    Raises
    ------
    ValueError
        If there are no pairs.
    """
    spectra = [_spectrum(*known) for known in _posteriors(pairs, likelihood, 1.0, bins)]

    def slope(temperature: float) -> float:
        """Give the derivative of the mean: the truth's log-likelihood above the expected one."""
        expected = 0.0
        for levels, log_counts in spectra:
            weights = temperature * levels + log_counts
            weights = np.exp(weights - weights.max())
            expected += float(weights @ levels / weights.sum())
        return -expected / len(spectra)

    low, high = LEAST_TEMPERATURE, 1.0
    if slope(high) > -1e-9:  # or where no pair says anything
        return high
    if slope(low) <= 0.0:
        return low
    while high > 1.0001 * low:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if slope(middle) > 0.0 else (low, middle)
    return float(np.sqrt(low * high))


def _posteriors(
    pairs: Iterable[Pair], likelihood: Likelihood, temperature: float, bins: int | None
) -> Iterator[tuple[GridPosterior, float, float]]:
    """Give the posterior of each pair with its true pose; refuse to have none."""
    number = -1
    for number, (correspondences, theta, phi) in enumerate(pairs):
        if not np.isfinite([theta, phi]).all():
            raise ValueError(f"pairs: the true headings of pair {number} are not finite")
        posterior = pose_posterior(correspondences, likelihood, bins=bins, temperature=temperature)
        yield posterior, float(theta), float(phi)
    if number < 0:
        raise ValueError("pairs: expected at least one, got none")


def _spectrum(posterior: GridPosterior, theta: float, phi: float) -> tuple[FloatArray, FloatArray]:
    """Give the cells' log-likelihoods above the truth's, and the logs of how many cells have them.

    All that a temperature needs, in a fraction of the grid's memory: the error of the normalizer
    is of the second order in the step.
    """
    above = posterior.log_prob.ravel() - posterior.log_prob[posterior.cell(theta, phi)]
    steps = ((above.max() - above) / _STEP).astype(np.int64)
    counts = np.bincount(steps)
    met = counts > 0
    return np.bincount(steps, weights=above)[met] / counts[met], np.log(counts[met])
