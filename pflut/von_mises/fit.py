"""Fitting a mixture to the probabilities of a grid."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import TWO_PI, FloatArray
from pflut.von_mises import fit_kernels as kernels
from pflut.von_mises.mixture import MAX_COMPONENTS, VonMisesMixture
from pflut.von_mises.point_kernels import BLOCK, LEVELS, TILES, make_points

TARGET = 0.035
"""Nats of divergence at which nothing is added any more."""
LEAST_GAIN = 0.0003
"""Nats by which a component must lower the divergence."""
ADDED = 4
"""Modes are added so many at once, or as many as there are."""
STEPS = 4
"""Of expectation maximization after modes were added."""
WORTH = 0.001
"""Nats that a tile of the torus must lack for a mode to be added there."""
LEAST_WEIGHT = 1e-4
"""Components with less are left out in the end."""


def fit_mixture(
    log_prob: FloatArray, prob: FloatArray, *, max_components: int = MAX_COMPONENTS
) -> tuple[VonMisesMixture, float]:
    """Fit a mixture to a grid of probabilities by expectation maximization.

    Parameters
    ----------
    log_prob, prob : ndarray of shape (B, B)
        Of cells centred on ((i + 1/2) 2 pi / B, (j + 1/2) 2 pi / B); the sum of ``prob`` is one.
    max_components : int
        Modes and bands at most; positive.

    Returns
    -------
    mixture : VonMisesMixture
    divergence : float
        Kullback-Leibler divergence of the grid from the mixture's `cell_probabilities`, nats, to
        some thousandths.

    Raises
    ------
    ValueError
        If the number is not positive, or a shape is not square.

    Notes
    -----
    **How many components?** It starts with the uniform density, and a band if one rotation holds
    much. Then, until the divergence falls to 0.035 nats, modes are added where the mixture lacks
    most, and all are improved by four steps; it stops early when twice in a row a new component has
    gained less than 0.0003 nats. Criteria such as BIC weigh the number of samples, and a grid has
    none. Most posteriors need one component; what many crossing ridges are needs more than a map
    can use, and there the limit decides.
    """
    if max_components < 1:
        raise ValueError(f"max_components: expected a positive number, got {max_components}")
    bins = len(prob)
    if log_prob.shape != (bins, bins) or prob.shape != (bins, bins):
        raise ValueError(
            f"log_prob, prob: expected shape (B, B), got {log_prob.shape}, {prob.shape}"
        )
    # arrays that must not be written are another type to Numba
    log_prob = np.require(log_prob, np.float64, ["C", "W"])
    prob = np.require(prob, np.float64, ["C", "W"])
    points = np.empty((5, bins * bins), dtype=np.float32)
    start = np.empty(LEVELS * TILES**2 + 1, dtype=np.int64)
    diagonals = np.empty(bins)
    kinds = np.empty((bins, bins), dtype=np.int8)
    information = make_points(log_prob, prob, _axes(bins), kinds, diagonals, points, start)
    size = int(start[-1])
    components = np.zeros((max_components, kernels.COLUMNS))
    given = int(kernels.find_band(prob, diagonals, components[0]))
    count, uniform, divergence = kernels.fit(
        information,
        TWO_PI / bins,
        points,
        start,
        np.empty((max_components, kernels.MAX_RUNS, 3), dtype=np.int64),
        np.empty(max_components, dtype=np.int64),
        np.empty((max_components, size), dtype=np.float32),
        np.empty(size, dtype=np.float32),
        components,
        given,
        (TARGET, LEAST_GAIN, float(ADDED), float(STEPS), WORTH),
    )
    return _mixture(components[:count], float(uniform)), float(divergence)


def _mixture(components: FloatArray, uniform: float) -> VonMisesMixture:
    """Make a mixture of the kernels' rows."""
    weight = components[:, kernels.WEIGHT]
    kept = components[weight > LEAST_WEIGHT]
    kept[:, kernels.WEIGHT] /= kept[:, kernels.WEIGHT].sum() + uniform
    band = kept[:, kernels.KIND] == kernels.BAND
    modes, bands = kept[~band], kept[band]
    means = [kernels.MEAN_1, kernels.MEAN_2]
    concentrations = [kernels.K_1, kernels.K_2]
    return VonMisesMixture(
        weights=modes[:, kernels.WEIGHT],
        means=modes[:, means],
        concentrations=modes[:, concentrations],
        couplings=modes[:, kernels.COUPLING],
        rotation_weights=bands[:, kernels.WEIGHT],
        rotation_means=bands[:, kernels.MEAN_1],
        rotation_concentrations=bands[:, kernels.K_1],
        uniform_weight=max(1.0 - float(kept[:, kernels.WEIGHT].sum()), 0.0),
        rotation_headings=bands[:, kernels.MEAN_2],
        rotation_heading_concentrations=bands[:, kernels.K_2],
    )


@lru_cache(maxsize=8)
def _axes(bins: int) -> NDArray[np.float32]:
    """Give the sines and cosines of the places of blocks and cells."""
    axes = np.zeros((LEVELS, 2, bins), dtype=np.float32)
    for level, number in enumerate((bins // BLOCK, bins)):
        places = (np.arange(number) + 0.5) * (TWO_PI / max(number, 1))
        axes[level, :, :number] = np.sin(places), np.cos(places)
    return axes
