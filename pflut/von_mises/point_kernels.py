"""The points at which a mixture is compared with a grid: its cells, and blocks of them.

Most of a posterior is nearly even. Blocks of 4 x 4 cells that are so are one point, all other cells
are one each. Points are sorted by size, then by the tile of the torus they lie in, so that a
component is evaluated where it is at all.
"""

from __future__ import annotations

import numpy as np

from pflut._jit import jit

BLOCK = 4
"""Cells of a block's side."""
LEVELS = 2
"""Sizes of points: blocks, then cells."""
TILES = 16
"""Tiles a side of the torus."""
EVEN = 1e-5
"""A block is one point if that costs fewer nats."""
TINY = np.float32(1e-12)
"""No point holds less: products of smaller numbers take the processor many times as long."""


@jit
def _edge(tile, bins):  # type: ignore[no-untyped-def]
    """Give a tile's first cell; blocks lie in one tile each."""
    if bins % BLOCK == 0:
        return tile * (bins // BLOCK) // TILES * BLOCK
    return tile * bins // TILES


@jit
def make_points(log_prob, prob, axes, kinds, diagonals, points, start):  # type: ignore[no-untyped-def]
    """Choose the points of a grid; return its sum of p log p.

    Parameters
    ----------
    log_prob, prob : ndarray of shape (B, B)
    axes : ndarray of shape (LEVELS, 2, B), float32
        Sines and cosines of the places of blocks and cells along one angle.
    kinds : ndarray of shape (B, B), int8
        Scratch.
    diagonals : ndarray of shape (B,)
        Receives the probability of each rotation: of (i - j) % B.
    points : ndarray of shape (5, n), float32
        Receives sines and cosines of both headings and the probability.
    start : ndarray of shape (LEVELS * TILES^2 + 1,)
        Receives where the points of each size and tile start.
    """
    bins = prob.shape[0]
    information = 0.0
    diagonals[:] = 0.0
    kinds[:] = 1
    for i in range(bins):
        for j in range(i + 1):
            diagonals[i - j] += prob[i, j]
        for j in range(i + 1, bins):
            diagonals[i - j + bins] += prob[i, j]
    side = BLOCK if bins % BLOCK == 0 else 1
    for i in range(0, bins, side):
        for j in range(0, bins, side):
            mass, inner = 0.0, 0.0
            for a in range(i, i + side):
                for b in range(j, j + side):
                    if prob[a, b] > 0.0:
                        mass += prob[a, b]
                        inner += prob[a, b] * log_prob[a, b]
            information += inner
            if side > 1 and (mass <= 0.0 or inner - mass * np.log(mass / side**2) < EVEN):
                kinds[i : i + side, j : j + side] = -1
                kinds[i, j] = 0
    n, segment = 0, 0
    for level in range(LEVELS):
        stride = side if level == 0 else 1
        for x in range(TILES):
            for y in range(TILES):
                start[segment] = n
                segment += 1
                for i in range(_edge(x, bins), _edge(x + 1, bins), stride):
                    for j in range(_edge(y, bins), _edge(y + 1, bins), stride):
                        if kinds[i, j] != level:
                            continue
                        mass, u, v = prob[i, j], i, j
                        if level == 0:
                            mass, u, v = 0.0, i // BLOCK, j // BLOCK
                            for a in range(i, i + BLOCK):
                                for b in range(j, j + BLOCK):
                                    mass += prob[a, b]
                        points[0, n], points[1, n] = axes[level, 0, u], axes[level, 1, u]
                        points[2, n], points[3, n] = axes[level, 0, v], axes[level, 1, v]
                        points[4, n] = max(np.float32(mass), TINY)
                        n += 1
    start[segment] = n
    return information
