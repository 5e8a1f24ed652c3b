"""What robust estimators have in common, for kernels: seeds, numbers of samples, weights.

As with `_trig`, whoever edits this file deletes Numba's cache.
"""

from __future__ import annotations

import numpy as np

from pflut._jit import inline, jit

TUKEY, HUBER, CAUCHY = range(3)
"""The losses."""
CHEIRALITY_SLACK = 1e-3
"""Near the base line the signs of depths are noise: so far behind a view still counts as before."""


@jit
def seed_of(columns, seed):  # type: ignore[no-untyped-def]
    """Give a pair's own seed: of the user's, and of its bearings (8, n).

    Pairs whose true matches stand at the same places must not have the same samples, or luck would
    decide for all of them at once; and one pair has the same ones alone and among others.
    """
    total = 0.0
    for i in range(columns.shape[1]):
        for k in range(8):
            total += (k + 1.0) * columns[k, i]
    total = abs(total) * 1e6
    return seed + np.uint64((total - np.floor(total)) * 9007199254740992.0)


@jit
def iterations_needed(inliers, pool_size, sample_size, confidence):  # type: ignore[no-untyped-def]
    """Give the iterations after which a sample of inliers has been drawn with confidence."""
    share = 1.0
    for k in range(sample_size):
        share *= max(inliers - k, 0.0) / (pool_size - k)
    if share <= 0.0:
        return np.inf
    return np.log1p(-confidence) / np.log1p(-share) if share < 1.0 else 1.0


@inline
def robust_weight(residual, loss, knee, cutoff):  # type: ignore[no-untyped-def]
    """Give the weight of a residual below the cut-off, in least squares that minimise a loss.

    ``knee`` is the residual at which Huber's loss turns linear, or Cauchy's scale. Tukey's biweight
    has the cut-off alone: there its weight is zero. P. Huber, "Robust statistics", 1981; Z. Zhang,
    "Parameter estimation techniques: a tutorial with application to conic fitting", 1997, table 1.
    """
    if loss == TUKEY:
        ratio = residual / cutoff
        left = 1.0 - ratio * ratio
        return left * left
    if loss == HUBER:
        size = abs(residual)
        return 1.0 if size <= knee else knee / size
    ratio = residual / knee
    return 1.0 / (1.0 + ratio * ratio)
