"""Kernels of the reference-image model: posteriors of image pairs, looked up at particles."""

from __future__ import annotations

import numpy as np

from pflut._jit import jit
from pflut._trig import fast_arctan2
from pflut.geometry import TWO_PI


@jit
def link(grid, temperature, linked, table, rotation):  # type: ignore[no-untyped-def]
    """Turn a pair's log-likelihood grid into what a particle is worth at each relative pose.

    ``grid`` (B, B) log-likelihood ratios; ``table`` (B + 1, B + 1) out, the first row and column
    repeated at the end: log((1 - linked) + linked exp(temperature grid)); ``rotation`` (B + 1,)
    out: the same for the mean of exp over the cells of one rotation, the difference of cell
    numbers k meaning heading_l - heading_r = k cells.
    """
    bins = grid.shape[0]
    unlinked = 1.0 - linked
    for k in range(bins):
        total = 0.0
        for j in range(bins):
            i = j + k
            if i >= bins:
                i -= bins
            # beyond e^60 the constant beside it has no part in the sum any more
            value = unlinked + linked * np.exp(min(temperature * grid[i, j], 60.0))
            total += value
            table[i, j] = np.log(value) + max(temperature * grid[i, j] - 60.0, 0.0)
        rotation[k] = np.log(total / bins)
    rotation[bins] = rotation[0]
    for i in range(bins):
        table[i, bins] = table[i, 0]
    for j in range(bins + 1):
        table[bins, j] = table[0, j]


@jit
def add_reference(poses, reference, table, rotation, near, ramp, reach, out):  # type: ignore[no-untyped-def]
    """Add one reference's log-likelihood to the particles': O(N).

    ``poses`` (N, 3), ``reference`` (3,), ``table`` and ``rotation`` from `link`, ``out`` (N,).
    Within ``near`` metres the direction to the reference fades out of the likelihood and only
    the rotation stays; from ``ramp`` to ``reach`` metres all of it fades.
    """
    bins = table.shape[0] - 1
    cells = bins / TWO_PI
    for n in range(poses.shape[0]):
        dx = poses[n, 0] - reference[0]
        dy = poses[n, 1] - reference[1]
        distance = np.sqrt(dx * dx + dy * dy)
        if distance >= reach:
            continue
        direction = fast_arctan2(dy, dx)
        # cell centres lie at half cells
        u = (direction - reference[2]) * cells - 0.5
        v = (direction + np.pi - poses[n, 2]) * cells - 0.5
        u -= np.floor(u / bins) * bins
        v -= np.floor(v / bins) * bins
        i = min(int(u), bins - 1)
        j = min(int(v), bins - 1)
        s = u - i
        t = v - j
        value = (1.0 - s) * ((1.0 - t) * table[i, j] + t * table[i, j + 1])
        value += s * ((1.0 - t) * table[i + 1, j] + t * table[i + 1, j + 1])
        if distance < near:
            k = u - v
            k -= np.floor(k / bins) * bins
            m = min(int(k), bins - 1)
            turned = (1.0 - (k - m)) * rotation[m] + (k - m) * rotation[m + 1]
            share = distance / near
            share = share * share * (3.0 - 2.0 * share)
            value = share * value + (1.0 - share) * turned
        if distance > ramp:
            value *= (reach - distance) / (reach - ramp)
        out[n] += value
