"""Kernels of the paper's table: Algorithm 2 fills it, Algorithm 1 evaluates it.

A correspondence is described by three cell numbers and a flag: the cell of r, the cells of the two
azimuths, and whether the views were exchanged to have |r| <= 1. The cells of u = theta - alpha_l
and v = phi - alpha_r are differences of cells, in learning as in evaluation, so that the table has
seen the discretization that it will meet.
"""

from __future__ import annotations

import numpy as np

from pflut._jit import jit
from pflut.geometry import TWO_PI

ROWS = 8
"""Rows of the grid that stay in the first-level cache while all correspondences are added."""


@jit
def _cell(angle, bins):  # type: ignore[no-untyped-def]
    """Give the cell of an angle in [-2 pi, 2 pi)."""
    turns = angle * (1.0 / TWO_PI)
    turns = turns - np.floor(turns)
    return min(int(turns * bins), bins - 1)


@jit
def _ratio(slope_l, slope_r):  # type: ignore[no-untyped-def]
    """Give r with |r| <= 1 and whether the views were exchanged for that (equations 2 and 10)."""
    if abs(slope_r) <= abs(slope_l):
        if slope_l == 0.0:
            return 0.0, 0  # both exactly on the horizon, which measured points never are
        return slope_r / slope_l, 0
    return slope_l / slope_r, 1


@jit
def _ratio_cell(r, bins):  # type: ignore[no-untyped-def]
    """Give the cell of r in [-1, 1]."""
    return min(int(0.5 * (r + 1.0) * bins), bins - 1)


@jit
def discretize(azimuth_l, elevation_l, azimuth_r, elevation_r, bins, ratio_bins, out):  # type: ignore[no-untyped-def]
    """Describe correspondences by cells.

    Four arrays (n,) of radians; ``out`` (n, 4) int64: cell of r, cell of azimuth_l, cell of
    azimuth_r, exchanged.
    """
    for i in range(azimuth_l.size):
        r, exchanged = _ratio(np.tan(elevation_l[i]), np.tan(elevation_r[i]))
        out[i, 0] = _ratio_cell(r, ratio_bins)
        out[i, 1] = _cell(azimuth_l[i], bins)
        out[i, 2] = _cell(azimuth_r[i], bins)
        out[i, 3] = exchanged


@jit
def count(headings, bearings, weights, histogram):  # type: ignore[no-untyped-def]
    """Algorithm 2's second loop: add correspondences of known pose to the histogram.

    ``headings`` (p, 2), ``bearings`` (p, n, 4) [azimuth_l, slope_l, azimuth_r, slope_r],
    ``weights`` (p,) one over the frequency of the pair's pose, ``histogram`` (R, B, B) over
    (r, u, v), integer or float.
    """
    ratio_bins, bins, _ = histogram.shape
    for p in range(headings.shape[0]):
        theta = _cell(headings[p, 0], bins)
        phi = _cell(headings[p, 1], bins)
        weight = weights[p]
        for i in range(bearings.shape[1]):
            r, exchanged = _ratio(bearings[p, i, 1], bearings[p, i, 3])
            u = theta - _cell(bearings[p, i, 0], bins)
            v = phi - _cell(bearings[p, i, 2], bins)
            if u < 0:
                u += bins
            if v < 0:
                v += bins
            if exchanged:
                u, v = v, u
            histogram[_ratio_cell(r, ratio_bins), u, v] += weight


@jit
def add_slices(slices, cells, wide, out):  # type: ignore[no-untyped-def]
    """Algorithm 1: add each correspondence's slice, shifted by its azimuths with wrap-around.

    ``slices`` (2, R, B, B) the table and its transpose over (u, v), ``cells`` (n, 4) from
    `discretize`, ``wide`` (ROWS, 2 B) scratch, ``out`` (B, B) over (heading_l, heading_r).
    n B^2 additions: a shifted row is added to a row twice as wide, folded once at the end.
    """
    bins = out.shape[0]
    for first in range(0, bins, ROWS):
        last = min(first + ROWS, bins)
        wide[:] = 0.0
        for k in range(cells.shape[0]):
            table = slices[cells[k, 3], cells[k, 0]]
            shift = cells[k, 2]
            for i in range(first, last):
                u = i - cells[k, 1]
                row = table[u + bins if u < 0 else u]
                total = wide[i - first, shift : shift + bins]
                for j in range(bins):
                    total[j] += row[j]
        for i in range(first, last):
            total = wide[i - first]
            for j in range(bins):
                out[i, j] = total[j] + total[bins + j]
