"""Kernels of the reference-image model: posteriors of image pairs, looked up at particles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pflut._jit import jit
from pflut._trig import fast_arctan2
from pflut.geometry import TWO_PI

LARGEST = 60.0
"""Beyond e^60 the floor has no part in the sum any more; float32 overflows at e^88."""


def link(
    grid: NDArray[np.float32],
    temperature: float,
    linked: float,
    table: NDArray[np.float32],
    rotation: NDArray[np.float32],
) -> None:
    """Turn a pair's log-likelihood grid into what a particle is worth at each relative pose.

    NumPy, whose float32 `exp` and `log` are vectorised where a kernel's are not.

    Parameters
    ----------
    grid : ndarray of shape (B, B)
        Log-likelihood ratios.
    temperature, linked : float
        Factor on them; prior probability that the pair shows one scene.
    table : ndarray of shape (B + 1, B + 1), out
        log((1 - linked) + linked exp(temperature grid)), the first row and column repeated.
    rotation : ndarray of shape (B + 1,), out
        The same for the mean of exp over the cells of one rotation: entry k is for
        heading_l - heading_r = k cells, the first is repeated.
    """
    bins = grid.shape[0]
    tempered = np.float32(temperature) * grid
    excess = np.maximum(tempered - np.float32(LARGEST), np.float32(0.0))
    value = np.exp(tempered - excess)
    value *= np.float32(linked)
    value += np.float32(1.0 - linked)
    np.add(np.log(value), excess, out=table[:bins, :bins])
    mean_over_diagonals(value, rotation)
    np.log(rotation, out=rotation)
    top = excess.max()
    if top > 0.0:
        # beyond the bound only the diagonals near the top count
        high = np.empty_like(rotation)
        mean_over_diagonals(value * np.exp(excess - top), high)
        with np.errstate(divide="ignore"):
            np.maximum(rotation, np.log(high) + top, out=rotation)
    table[:bins, bins] = table[:bins, 0]
    table[bins] = table[0]


@jit
def mean_over_diagonals(value, out):  # type: ignore[no-untyped-def]
    """Average ``value`` (B, B) over the cells i - j = k with wrap-around; ``out`` (B + 1,)."""
    bins = value.shape[0]
    out[:] = 0.0
    for i in range(bins):
        for k in range(i + 1):
            out[k] += value[i, i - k]
        for k in range(i + 1, bins):
            out[k] += value[i, i - k + bins]
    for k in range(bins):
        out[k] /= bins
    out[bins] = out[0]


BLOCK = 256


@jit
def _cells(poses, first, reference, bins, across, along, away):  # type: ignore[no-untyped-def]
    """Write where a block of poses lies in a reference's table; a loop that is vectorised.

    ``across`` and ``along`` (BLOCK,) cell coordinates of heading_l and heading_r in [0, B],
    ``away`` (BLOCK,) distances in metres.
    """
    cells = bins / TWO_PI
    turn = 1.0 / bins
    for n in range(away.size):
        dx = poses[first + n, 0] - reference[0]
        dy = poses[first + n, 1] - reference[1]
        direction = fast_arctan2(dy, dx)
        away[n] = np.sqrt(dx * dx + dy * dy)
        # cell centres lie at half cells
        u = (direction - reference[2]) * cells - 0.5
        v = (direction + np.pi - poses[first + n, 2]) * cells - 0.5
        across[n] = u - np.floor(u * turn) * bins
        along[n] = v - np.floor(v * turn) * bins


@jit
def add_reference(poses, reference, table, rotation, near, ramp, reach, out):  # type: ignore[no-untyped-def]
    """Add one reference's log-likelihood to the particles': O(N).

    ``poses`` (N, 3), ``reference`` (3,), ``table`` and ``rotation`` from `link`, ``out`` (N,).
    Within ``near`` metres the direction to the reference fades out of the likelihood and only
    the rotation stays; from ``ramp`` to ``reach`` metres all of it fades.
    """
    bins = table.shape[0] - 1
    across, along, away = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    for first in range(0, poses.shape[0], BLOCK):
        size = min(BLOCK, poses.shape[0] - first)
        _cells(poses, first, reference, bins, across[:size], along[:size], away[:size])
        for n in range(size):
            distance = away[n]
            if distance >= reach:
                continue
            i = min(int(across[n]), bins - 1)
            j = min(int(along[n]), bins - 1)
            s = across[n] - i
            t = along[n] - j
            value = (1.0 - s) * ((1.0 - t) * table[i, j] + t * table[i, j + 1])
            value += s * ((1.0 - t) * table[i + 1, j] + t * table[i + 1, j + 1])
            if distance < near:
                k = across[n] - along[n]
                k = k + bins if k < 0.0 else k
                m = min(int(k), bins - 1)
                turned = (1.0 - (k - m)) * rotation[m] + (k - m) * rotation[m + 1]
                share = distance / near
                share = share * share * (3.0 - 2.0 * share)
                value = share * value + (1.0 - share) * turned
            if distance > ramp:
                value *= (reach - distance) / (reach - ramp)
            out[first + n] += value
