"""The axes of the residual table: how a correspondence and a pose become cells.

Seen from a pose, a correspondence is four angles: u, v and the two elevations. The table knows
them by four others that say the same, up to a mirror image, and in which what it has learned is
smooth:

- the *residual* e, the distance of the bearings to the planar epipolar constraint in radians;
- the *parallax* gamma, the angle between the two lines of sight seen from above: the triangle's
  third angle, pi - |u| - |v|. Large: the landmark is near the baseline. About zero: far away.
  Negative: the lines of sight diverge. Its axis is sin(gamma / 2);
- the *ratio* r = tan(elevation_r) / tan(elevation_l) or its inverse, |r| <= 1, which with the
  parallax makes up the triangle's shape;
- the *elevation* of the view that is nearer to the landmark, the larger one of the two.

The constants below are the cells; `residual_kernels` computes them.
"""

from __future__ import annotations

import numpy as np

from pflut.geometry import FloatArray

#: Cells of the parallax; the first is for lines of sight on different sides of the baseline.
PARALLAX_CELLS = 32
#: Steps of sin(gamma / 2) over [-1, 1] in which a cell is looked up.
PARALLAX_STEPS = 4096
#: Radians; below this the lines of sight diverge by more than any noise makes them.
PARALLAX_MIN = -0.3
#: Radians; cells grow linearly beyond.
PARALLAX_FINE = 0.03

#: Edges of the ratio's cells: for points on different sides of the horizon, then even ones.
RATIO_EDGES = np.concatenate([[-1.0, -0.3, -0.1, -0.03], np.arange(17) / 16.0])
RATIO_CELLS = len(RATIO_EDGES) - 1

#: The ratios of the first cells are negative.
NEGATIVE_CELLS = 4

#: Cells of the larger elevation, finer near the horizon.
ELEVATION_CELLS = 12
RESIDUAL_CELLS = 64
#: Radians; beyond, all residuals are alike.
RESIDUAL_MAX = 0.25


def elevation_edges() -> FloatArray:
    """Return the edges of the elevation's cells, radians, of shape (ELEVATION_CELLS + 1,)."""
    return np.asarray(0.5 * np.pi * (np.arange(ELEVATION_CELLS + 1) / ELEVATION_CELLS) ** 2)


def residual_nodes() -> FloatArray:
    """Return the residuals at the profile's nodes, radians, of shape (RESIDUAL_CELLS + 1,)."""
    return np.asarray(RESIDUAL_MAX * (np.arange(RESIDUAL_CELLS + 1) / RESIDUAL_CELLS) ** 2)


def parallax_edges() -> FloatArray:
    """Return the edges of the parallax's cells but the first one, radians.

    Returns
    -------
    ndarray of shape (PARALLAX_CELLS,)
        From ``PARALLAX_MIN`` to pi; below the first edge belongs to the first cell too.
    """
    low, high = np.arcsinh(np.array([PARALLAX_MIN, np.pi]) / PARALLAX_FINE)
    return np.asarray(PARALLAX_FINE * np.sinh(np.linspace(low, high, PARALLAX_CELLS)))


def parallax_lookup() -> np.ndarray:
    """Return the parallax's cell at steps of sin(gamma / 2).

    Returns
    -------
    ndarray of shape (PARALLAX_STEPS + 1,), uint8
        Step i covers sin(gamma / 2) from i 2 / PARALLAX_STEPS - 1 on.
    """
    middle = (np.arange(PARALLAX_STEPS + 1) + 0.5) * (2.0 / PARALLAX_STEPS) - 1.0
    gamma = 2.0 * np.arcsin(np.minimum(middle, 1.0))
    cells = np.searchsorted(parallax_edges(), gamma, side="right")
    return np.asarray(cells.clip(0, PARALLAX_CELLS - 1), dtype=np.uint8)


def parallax_positions() -> np.ndarray:
    """Return where the steps of sin(gamma / 2) lie between the middles of the parallax's cells.

    Returns
    -------
    ndarray of shape (PARALLAX_STEPS + 1,), float64
        1.25 is a quarter of the way from the middle of cell 1 to that of cell 2; 0 belongs to the
        first cell, which is no neighbour of the others.
    """
    middle = (np.arange(PARALLAX_STEPS + 1) + 0.5) * (2.0 / PARALLAX_STEPS) - 1.0
    gamma = 2.0 * np.arcsin(np.minimum(middle, 1.0))
    edges = parallax_edges()
    centers = 0.5 * (edges[1:] + edges[:-1])
    positions = np.interp(gamma, centers, np.arange(1, PARALLAX_CELLS))
    return np.where(gamma < edges[0], 0.0, positions)
