"""Flatten a likelihood that is too sharp for the particles that are there."""

from __future__ import annotations

import numpy as np

from pflut.geometry import FloatArray
from pflut.localization.weights import Weights

BISECTIONS = 8
SMALLEST = 1e-12
MAX_LOOKED_AT = 20_000


def tempering_exponent(
    weights: Weights, log_likelihood: FloatArray, min_share: float, *, proposed: int = 0
) -> float:
    """Find the largest exponent on a likelihood that leaves enough effective particles.

    Particles are a sample: where a likelihood is much narrower than their distances, the one that
    happens to be nearest takes all the weight, right or wrong. Raised to a power below one the
    likelihood chooses among many; the next images say the rest.

    Parameters
    ----------
    weights : Weights
        Before the observation.
    log_likelihood : ndarray of shape (N,)
        Below +inf, not all -inf.
    min_share : float
        In [0, 1): of the particles that were effective before, so many shall be left.
    proposed : int
        The last particles are proposals of so many, which nobody relies on: they do not count.

    Returns
    -------
    float
        In (0, 1]; 1 where the observation as it is leaves as many.

    References
    ----------
    E. Herbst, F. Schorfheide, "Tempered particle filtering", Journal of Econometrics 210, 2019;
    without its repeated moves.
    """
    before, seen = weights, log_likelihood
    if len(weights) > MAX_LOOKED_AT:
        alive = np.flatnonzero(weights.log > -np.inf)
        chosen = alive[:: max(1, len(alive) // MAX_LOOKED_AT)]
        before = Weights.from_log(weights.log[chosen])
        seen = np.ascontiguousarray(log_likelihood[chosen])
    if not (seen > -np.inf).any():
        return 1.0
    own = len(before) * (1.0 - proposed / len(weights))
    needed = min_share * min(own, before.effective_sample_size)

    def enough(exponent: float) -> bool:
        after = before.times(exponent * seen)
        return after is not None and after.effective_sample_size >= needed

    if min_share <= 0.0 or enough(1.0):
        return 1.0
    # down in powers of four till enough are left, then bisect the last step
    high = 1.0
    while high > SMALLEST and not enough(0.25 * high):
        high *= 0.25
    low = 0.25 * high
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if enough(middle) else (low, middle)
    return low


def tempered(
    before: Weights,
    after: Weights,
    log_likelihood: FloatArray,
    min_share: float,
    *,
    proposed: int = 0,
) -> tuple[Weights, float]:
    """Flatten an observation where it leaves too few effective particles.

    Parameters
    ----------
    before, after : Weights
        By Bayes' rule.
    log_likelihood : ndarray of shape (N,)
        Of the observation.
    min_share, proposed
        As in `tempering_exponent`.

    Returns
    -------
    weights : Weights
        ``after`` where it leaves enough.
    exponent : float
    """
    if after.effective_sample_size >= min_share * len(after):
        return after, 1.0
    exponent = tempering_exponent(before, log_likelihood, min_share, proposed=proposed)
    if exponent == 1.0:
        return after, 1.0
    flattened = before.times(exponent * log_likelihood)
    return (after, exponent) if flattened is None else (flattened, exponent)
