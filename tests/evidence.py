"""Evidence for links as the tests need it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pflut.mapping.link_evidence import LinkEvidence


def some_evidence(
    log_evidence: ArrayLike,
    num_matches: ArrayLike,
    num_directions: ArrayLike = 4,
    *,
    num_inliers: ArrayLike = 0,
    spread: ArrayLike = 0.3,
    rotation: ArrayLike = 0.0,
    rotation_std: ArrayLike = 0.01,
) -> LinkEvidence:
    """Evidence of as many pairs as there are values; what is one number is that of all pairs."""
    values = (log_evidence, num_matches, num_inliers, num_directions, spread, rotation)
    return LinkEvidence(*np.broadcast_arrays(*values, rotation_std))  # type: ignore[arg-type]
