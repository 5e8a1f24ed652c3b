"""The points at which a mixture is compared with a grid: its cells, and blocks of them.

Most of a posterior is nearly even. Blocks of 4 x 4 cells that are so are one point, all other cells
are one each. Points are sorted by size, then by the tile of the torus they lie in. Those that
follow each other are therefore near each other, and chunks of them tell where a component is.
"""

from __future__ import annotations

import numpy as np

from pflut._jit import jit

BLOCK = 4
"""Cells of a block's side."""
BLOCK_VARIANCE = (BLOCK**2 - 1.0) / 12.0
"""Of the centres of a block's cells along an axis, in squared cells."""
LEVELS = 2
"""Sizes of points: blocks, then cells."""
TILES = 16
"""Tiles a side of the torus."""
CHUNK = 16
"""Points in a row that a component is evaluated at, or not; so many a loop works on at once."""
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
def make_points(log_prob, prob, axes, kinds, diagonals, points, start, chunks):  # type: ignore[no-untyped-def]
    """Choose the points of a grid; return its sum of p log p, and how many chunks there are.

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
        Receives sines and cosines of both headings and the probability. The last chunk of a size is
        filled up with points without probability.
    start : ndarray of shape (LEVELS, TILES^2 + 1)
        Receives where the points of each size and tile start, and where those of a size end.
    chunks : ndarray of shape (6, n / CHUNK), float32
        Receives of each chunk sines and cosines of its center and the variances of a box about it.

    Returns
    -------
    information : float
    blocks, number : int
        Chunks of blocks, and of all points.
    """
    bins = prob.shape[0]
    cell = 2.0 * np.pi / bins
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
    n, blocks = 0, 0
    for level in range(LEVELS):
        stride = side if level == 0 else 1
        low_i, high_i, low_j, high_j = bins, 0, bins, 0
        for x in range(TILES):
            for y in range(TILES):
                start[level, x * TILES + y] = n
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
                        low_i, high_i = min(low_i, i), max(high_i, i + stride)
                        low_j, high_j = min(low_j, j), max(high_j, j + stride)
                        n += 1
                        if n % CHUNK == 0:
                            _set_chunk(low_i, high_i, low_j, high_j, cell, chunks, n // CHUNK - 1)
                            low_i, high_i, low_j, high_j = bins, 0, bins, 0
        start[level, TILES * TILES] = n
        if n % CHUNK != 0:
            _set_chunk(low_i, high_i, low_j, high_j, cell, chunks, n // CHUNK)
            last = n - 1
            while n % CHUNK != 0:
                for row in range(4):
                    points[row, n] = points[row, last]
                points[4, n] = 0.0
                n += 1
        if level == 0:
            blocks = n // CHUNK
    return information, blocks, n // CHUNK


@jit
def _set_chunk(low_i, high_i, low_j, high_j, cell, chunks, n):  # type: ignore[no-untyped-def]
    """Write the center and the variances of a box of cells."""
    low_l, high_l, low_r, high_r = low_i * cell, high_i * cell, low_j * cell, high_j * cell
    chunks[0, n], chunks[1, n] = np.sin(0.5 * (low_l + high_l)), np.cos(0.5 * (low_l + high_l))
    chunks[2, n], chunks[3, n] = np.sin(0.5 * (low_r + high_r)), np.cos(0.5 * (low_r + high_r))
    chunks[4, n], chunks[5, n] = (high_l - low_l) ** 2 / 12.0, (high_r - low_r) ** 2 / 12.0
