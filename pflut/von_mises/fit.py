"""Fitting a mixture to the probabilities of a grid."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pflut.geometry import TWO_PI, FloatArray
from pflut.von_mises import fit_kernels as kernels
from pflut.von_mises.mixture import VonMisesMixture
from pflut.von_mises.point_kernels import BLOCK, LEVELS, TILES, make_points


@lru_cache(maxsize=8)
def _axes(bins: int) -> np.ndarray:
    """Give the sines and cosines of the places of blocks and cells."""
    axes = np.zeros((LEVELS, 2, bins), dtype=np.float32)
    for level, number in enumerate((bins // BLOCK, bins)):
        places = (np.arange(number) + 0.5) * (TWO_PI / max(number, 1))
        axes[level, :, :number] = np.sin(places), np.cos(places)
    return axes


def fit_mixture(
    log_prob: FloatArray, prob: FloatArray, *, max_components: int = 16, target=0.02, least_gain=0.001, added=4, steps=5, worth=.002
) -> tuple[VonMisesMixture, float]:
    bins = len(prob)
    size = bins * bins
    points = np.empty((5, size), dtype=np.float32)
    start = np.empty(LEVELS * TILES**2 + 1, dtype=np.int64)
    diagonals = np.empty(bins)
    information = make_points(log_prob, prob, _axes(bins), np.empty((bins, bins), np.int8), diagonals, points, start)
    size = int(start[-1])
    scratch = np.empty((max_components, size), dtype=np.float32)
    total = np.empty(size, dtype=np.float32)
    components = np.zeros((max_components, kernels.COLUMNS))
    runs = np.empty((max_components, kernels.MAX_RUNS, 3), dtype=np.int64)
    num_runs = np.empty(max_components, dtype=np.int64)
    result = np.zeros(3)
    count = kernels.fit(information, TWO_PI / bins, points, start, runs, num_runs, scratch, total, components, 0, target, least_gain, added, steps, worth, result)
    result[2] = size
    return components[:count], result
