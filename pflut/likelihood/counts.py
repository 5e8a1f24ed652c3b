"""What is counted of correspondences to learn the residual table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from pflut.geometry import FloatArray
from pflut.likelihood.axes import (
    ELEVATION_CELLS,
    PARALLAX_CELLS,
    RATIO_CELLS,
    RESIDUAL_CELLS,
    parallax_lookup,
    residual_nodes,
)
from pflut.likelihood.residual_kernels import count_chance, describe, mean_parallax

SHAPE_CELLS = RATIO_CELLS * ELEVATION_CELLS
BAND_PER_MEDIAN = 4.0
"""The band reaches to so many median residuals: 2.7 standard deviations of normal noise."""
FAR = 0.15
"""Radians; so large a residual is a mismatch's."""


@dataclass(eq=False)
class Counts:
    """What was counted.

    Parameters
    ----------
    inside : ndarray of shape (C, PARALLAX_CELLS, SHAPE_CELLS)
        Samples at true poses with a residual within the band, by depth class.
    profile : ndarray of shape (ELEVATION_CELLS, RESIDUAL_CELLS + 1)
        Residuals of all of them; the last cell holds those beyond the axis.
    seen : ndarray of shape (C,)
        Samples of each depth class, within the band or not.
    chance_inside, chance_profile : ndarray
        The same of mismatches at random poses, without depth classes.
    quality : ndarray of shape (2, Q)
        Quality of the samples within the band, and of those far from it.
    """

    inside: FloatArray
    profile: FloatArray
    seen: FloatArray
    chance_inside: FloatArray
    chance_profile: FloatArray
    quality: FloatArray

    @classmethod
    def zeros(cls, num_classes: int, quality_cells: int = 0) -> Counts:
        """Return empty counts."""
        return cls(
            np.zeros((num_classes, PARALLAX_CELLS, SHAPE_CELLS)),
            np.zeros((ELEVATION_CELLS, RESIDUAL_CELLS + 1)),
            np.zeros(num_classes),
            np.zeros((PARALLAX_CELLS, SHAPE_CELLS)),
            np.zeros((ELEVATION_CELLS, RESIDUAL_CELLS + 1)),
            np.zeros((2, quality_cells)),
        )

    def add(self, other: Counts) -> None:
        """Add other counts to these."""
        for name, value in vars(other).items():
            getattr(self, name).__iadd__(value)

    def add_chance(
        self,
        slopes: FloatArray,
        stream: np.random.Generator,
        draws: int,
        lookup: np.ndarray,
        band: float,
    ) -> None:
        """Meet mismatches ``slopes`` (p, n, 4) at ``draws`` random poses each."""
        state = stream.integers(0, 2**64, size=1, dtype=np.uint64)
        with np.errstate(over="ignore"):
            count_chance(
                slopes,
                state,
                draws,
                lookup,
                band,
                np.empty((len(slopes), 8)),
                self.chance_inside,
                self.chance_profile,
            )


def class_edges(
    pairs: Iterable[tuple[FloatArray, FloatArray]], band: float, num_classes: int
) -> FloatArray:
    """Give the quantiles of the pairs' mean parallax between the depth classes.

    Each pair is its headings (2,) and its correspondences (n, 4), with slopes for elevations.
    """
    lookup = parallax_lookup()
    means = []
    for pose, slopes in pairs:
        bearings = np.empty((len(slopes), 8))
        describe(slopes, bearings)
        means.append(mean_parallax(bearings, pose[0], pose[1], lookup, band))
    return np.asarray(np.quantile(means, np.arange(1, num_classes) / num_classes))


def far_cells() -> np.ndarray:
    """Say which cells of the residual are far from any pose that is right."""
    return np.append(residual_nodes()[:-1] >= FAR, True)
