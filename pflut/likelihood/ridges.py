"""The profiles that a correspondence adds to the grid, made from a residual table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pflut._lanes import LANES
from pflut.geometry import TWO_PI, FloatArray
from pflut.likelihood.axes import (
    ELEVATION_CELLS,
    NEGATIVE_CELLS,
    PARALLAX_CELLS,
    RATIO_CELLS,
    RESIDUAL_CELLS,
    parallax_edges,
    residual_nodes,
)
from pflut.likelihood.ridge_kernels import (
    BLOCKS,
    COLUMN_BITS,
    GROWTH_OCTAVES,
    LEVEL_FROM,
    LEVEL_MIN,
    LEVEL_STEP,
    LEVEL_STEPS,
    MIDDLE,
    NATS,
    NUM_GROWTHS,
    NUM_LEVELS,
    NUM_SLOPES,
    STEP_BITS,
    SUBCELLS,
    Candidates,
    RidgeArrays,
    ridge_candidates,
    ridge_grid,
)

NEGLIGIBLE = 0.05
TYPICAL_RATIO = 20.0
"""Where the log-likelihood ratio of a landmark so probable is negligible, its profile ends."""
SLOPES = (0.2, 0.6, 0.95)
"""Columns a row by which the curves of a class rise."""
BOTH_WIDTH = 0.71
"""Half-width of the box that stands for a cell where both headings count alike, in cells."""
PLATEAU = 0.04
"""Radians of parallax from which on noise does not matter."""
TOLERANCE = 0.06
"""Radians by which lines of sight may diverge more than in the simulator: real cameras are not
quite level, nor do they quite look where they should, which far landmarks would take for a pose."""
ELEVATIONS_A_KIND = 6
FINE = 4096
RISES = 8
"""Rows of a cell over which is averaged."""


@dataclass(frozen=True, eq=False)
class Ridges:
    """A table's profiles, for grids of so many bins.

    Parameters
    ----------
    bins : int
        Cells an axis.
    arrays : RidgeArrays
    """

    bins: int
    arrays: RidgeArrays

    def grid(
        self,
        columns: FloatArray,
        shapes: NDArray[np.int64],
        odds: FloatArray,
        window: NDArray[np.int64] | None = None,
    ) -> NDArray[np.float32]:
        """Sum correspondences' log-likelihood ratios over the grid of poses.

        Parameters
        ----------
        columns : ndarray of shape (8, n)
            Sines and cosines of azimuth_l, elevation_l, azimuth_r, elevation_r.
        shapes : ndarray of shape (n,), int64
        odds : ndarray of shape (n,)
            True match to mismatch.
        window : ndarray of shape (2, 2), int64, optional
            The first cell, and how many, of heading_l and of heading_r: the others are not asked
            for.

        Returns
        -------
        ndarray of shape (bins, bins), float32
            Over (heading_l, heading_r).
        """
        if window is None:
            window = np.array([[0, self.bins], [0, self.bins]])
        out = np.empty(self.bins * self.bins, np.float32)
        ridge_grid(columns, shapes, odds, 0, len(odds), self.arrays, window, out)
        return out.reshape(self.bins, self.bins)

    def candidates(
        self,
        columns: FloatArray,
        shapes: NDArray[np.int64],
        odds: FloatArray,
        first: NDArray[np.int64],
        *,
        margin: float,
        most: int,
    ) -> Candidates:
        """Find the highest local maxima of the grids of many pairs.

        Parameters
        ----------
        columns, shapes, odds
            As `grid`, of all pairs one after the other.
        first : ndarray of shape (pairs + 1,)
            The row of each pair's first correspondence, and the number of them all.
        margin : float
            Nats below a grid's maximum.
        most : int
            Candidates a pair.

        Returns
        -------
        Candidates
        """
        pairs = len(first) - 1
        out = Candidates(
            np.empty((pairs * most, 2)),
            np.empty(pairs * most),
            np.empty(pairs * most, np.int64),
            np.empty(pairs),
        )
        count = ridge_candidates(
            columns,
            shapes,
            odds,
            first,
            margin,
            self.arrays,
            np.empty((most, 3)),
            out,
        )
        return Candidates(out.poses[:count], out.values[:count], out.owners[:count], out.evidence)


def make_ridges(density: NDArray[np.floating], profile: NDArray[np.floating], bins: int) -> Ridges:
    """Make the profiles of a table for grids of so many bins.

    Parameters
    ----------
    density : ndarray of shape (PARALLAX_CELLS, shapes)
        Density ratio, all depth classes together.
    profile : ndarray of shape (ELEVATION_CELLS, residual nodes)
    bins : int

    Returns
    -------
    Ridges
    """
    kinds = ELEVATION_CELLS // ELEVATIONS_A_KIND
    height = profile[:, : profile.shape[1] // 8].mean(axis=1)
    # elevations that were hardly met have no profile of their own
    met = height > 1e-3 * height.max()
    height = np.maximum(height, 1e-9)
    shapes = (profile / height[:, None] * met[:, None]).reshape(kinds, ELEVATIONS_A_KIND, -1)
    of_kind = np.maximum(met.reshape(kinds, ELEVATIONS_A_KIND).sum(axis=1), 1)
    kind_profiles = shapes.sum(axis=1) / of_kind[:, None]
    elevation = np.arange(density.shape[1]) % ELEVATION_CELLS
    steps = LEVEL_FROM + (np.arange(LEVEL_STEPS + 1) + 0.5) * ((np.pi - LEVEL_FROM) / LEVEL_STEPS)
    edges = parallax_edges()
    centers = 0.5 * (edges[1:] + edges[:-1])
    # what diverges is cut off, cell by cell; up to there the landmark is as probable as a little on
    places = np.interp(np.maximum(steps, PLATEAU), centers, np.arange(1, PARALLAX_CELLS))
    cells = places.astype(np.int64)
    share = (places - cells)[:, None]
    between = (1.0 - share) * density[cells] + share * density[
        np.minimum(cells + 1, PARALLAX_CELLS - 1)
    ]
    level_table = _levels(between * height[elevation]).T
    # on different sides of the horizon the curve is where lines of sight are on different sides
    apart = np.repeat(np.arange(RATIO_CELLS) < NEGATIVE_CELLS, ELEVATION_CELLS)
    level_table[apart] = _levels((density[0] * height[elevation])[apart])[:, None]
    level_table[:, 0] = -128

    cell = TWO_PI / bins
    ratios = np.exp(LEVEL_MIN + LEVEL_STEP * np.arange(NUM_LEVELS))
    lanes = np.arange(LANES) + LANES * np.array([0, -1, 1])[:, None]
    offsets = lanes[:, None] - MIDDLE - np.arange(SUBCELLS)[:, None] / SUBCELLS
    # four classes an octave, even in a float's mantissa: their middles
    octave, quarter = np.divmod(np.arange(NUM_GROWTHS), 4)
    least = 2.0 ** (octave - GROWTH_OCTAVES)
    growths = least * (1.0 + (quarter + 0.5) / 4.0)
    shape = (BLOCKS, NUM_LEVELS, kinds, NUM_GROWTHS, NUM_SLOPES, SUBCELLS, LANES)
    profiles = np.empty(shape, np.uint16)
    integrals = _integrals(kind_profiles)
    for k, growth in enumerate(growths):
        for m, slope in enumerate(SLOPES):
            mean = _cell_mean(integrals, offsets, growth * cell, slope)
            values = np.log1p(ratios[:, None, None, None, None] * mean) / NATS
            profiles[:, :, :, k, m] = np.rint(values).transpose(2, 0, 1, 3, 4)
    # what an address has bits for
    assert profiles[0, 0].size // LANES <= 1 << (31 - STEP_BITS - 1 - COLUMN_BITS)
    assert bins < 1 << COLUMN_BITS and len(steps) < 1 << STEP_BITS
    angles = (np.arange(bins) + 0.5) * cell
    classes = NUM_SLOPES * SUBCELLS
    # a block has as many cells on the near side
    near_by = _extent(kind_profiles, TYPICAL_RATIO) / (MIDDLE * cell)
    return Ridges(
        bins,
        RidgeArrays(
            turns=np.stack([np.sin(angles), np.cos(angles)]).astype(np.float32),
            levels=np.ascontiguousarray(level_table),
            highest=level_table.max(axis=1).astype(np.int64),
            bases=(elevation // ELEVATIONS_A_KIND * (NUM_GROWTHS * classes)).astype(np.int32),
            wide=int(np.searchsorted(least, near_by)) * classes,
            near=int(np.searchsorted(steps, (MIDDLE + 2) * cell)),
            far=int(np.searchsorted(steps, (MIDDLE + 2 + LANES) * cell)),
            noise=np.float32(_half_height(kind_profiles)),
            extent=np.float32(_extent(kind_profiles, TYPICAL_RATIO)),
            shares=_shares(
                density[1:, ~apart].sum(axis=1, dtype=np.float64), centers, steps, lanes, cell
            ),
            peaks=profiles.max(axis=(0, 2, 3, 4, 5, 6)).astype(np.int64),
            size=profiles[0, 0].size,
            profiles=profiles.ravel(),
        ),
    )


def _levels(ratio: FloatArray) -> NDArray[np.int8]:
    """Give the levels of odds ratios, at even odds; far below zero where there is none."""
    with np.errstate(divide="ignore"):
        levels = np.rint((np.log(ratio) - LEVEL_MIN) / LEVEL_STEP)
    return np.asarray(levels.clip(-128, NUM_LEVELS - 1), dtype=np.int8)


def _shares(
    density: FloatArray,
    centers: FloatArray,
    steps: NDArray[np.floating],
    lanes: NDArray[np.int64],
    cell: float,
) -> NDArray[np.uint16]:
    """Give the shares of cells where the lines of sight do not diverge; see `RidgeArrays`.

    ``density`` over the parallaxes ``centers``; ``steps`` (s,) the parallaxes of the middle lane.
    """
    gammas = np.linspace(-1.0, 1.0, FINE)
    rise = np.interp(np.minimum(gammas + TOLERANCE, PLATEAU), centers, density)
    rise = (np.maximum.accumulate(rise) / max(rise[-1], 1e-9)).clip(0.0, 1.0)
    integral = np.append(0.0, np.cumsum(0.5 * (rise[1:] + rise[:-1]))) * (gammas[1] - gammas[0])
    signs = np.array([-1.0, 1.0])
    away = (lanes - MIDDLE) * cell
    middle = steps[None, :, None, None] - signs[:, None, None, None] * away
    half = BOTH_WIDTH * cell
    inside = [
        np.interp(x, gammas, integral) + np.maximum(x - gammas[-1], 0.0)
        for x in (middle - half, middle + half)
    ]
    mean = ((inside[1] - inside[0]) / (2.0 * half)).clip(0.0, 1.0)
    shares = np.zeros((2, 1 << STEP_BITS, *lanes.shape))
    # of a logarithm that is so high
    shares[:, : len(steps)] = np.log1p(TYPICAL_RATIO * mean) / np.log1p(TYPICAL_RATIO)
    return np.asarray(np.rint(shares * 65535), dtype=np.uint16).ravel()


def _half_height(profiles: FloatArray) -> float:
    """Give the residual at which the profiles' mean falls to half its height, radians."""
    above = int((profiles.mean(axis=0) > 0.5 * profiles.mean(axis=0)[0]).sum())
    return float(residual_nodes()[min(above, RESIDUAL_CELLS)])


def _extent(profiles: FloatArray, ratio: float) -> float:
    """Give the residual beyond which no profile matters, radians."""
    matters = (np.log1p(ratio * profiles) > NEGLIGIBLE).any(axis=0)
    return float(residual_nodes()[np.flatnonzero(matters).max(initial=0)])


def _integrals(profiles: FloatArray) -> FloatArray:
    """Integrate profiles from no residual on: (kinds, FINE), up to the largest node."""
    nodes = residual_nodes()
    fine = np.linspace(0.0, nodes[-1], FINE)
    values = np.stack([np.interp(fine, nodes, profile) for profile in profiles])
    sums = np.cumsum(0.5 * (values[:, 1:] + values[:, :-1]), axis=1)
    return np.asarray(np.pad(sums, ((0, 0), (1, 0))) * fine[1])


def _cell_mean(
    integrals: FloatArray, offsets: FloatArray, growth: float, slope: float
) -> FloatArray:
    """Average profiles over cells, through which the curve rises by ``slope`` of their width.

    ``integrals`` of `_integrals`, ``offsets`` in cells from the curve, ``growth`` radians of
    residual a cell.
    """
    rises = slope * (np.arange(RISES) + 0.5) / RISES - 0.5 * slope
    boxes = [_box_mean(integrals, (offsets + rise) * growth, 0.5 * growth) for rise in rises]
    return np.asarray(np.mean(boxes, axis=0))


def _box_mean(integrals: FloatArray, residuals: FloatArray, half: float) -> FloatArray:
    """Average profiles over [residual - half, residual + half]; (kinds, *residuals.shape)."""
    fine = np.linspace(0.0, residual_nodes()[-1], FINE)

    def below(x: FloatArray) -> FloatArray:
        return np.stack([np.sign(x) * np.interp(np.abs(x), fine, row) for row in integrals])

    return (below(residuals + half) - below(residuals - half)) / (2.0 * half)
