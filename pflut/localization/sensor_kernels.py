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
    top = tempered.max()
    bounded = top > LARGEST
    if bounded:
        excess = np.maximum(tempered - np.float32(LARGEST), np.float32(0.0))
        tempered -= excess
    value = np.exp(tempered, out=tempered)
    value *= np.float32(linked)
    value += np.float32(1.0 - linked)
    np.log(value, out=table[:bins, :bins])
    mean_over_diagonals(value, rotation)
    np.log(rotation, out=rotation)
    if bounded:
        table[:bins, :bins] += excess
        # beyond the bound only the diagonals near the top count
        high = np.empty_like(rotation)
        mean_over_diagonals(value * np.exp(excess - excess.max()), high)
        with np.errstate(divide="ignore"):
            np.maximum(rotation, np.log(high) + excess.max(), out=rotation)
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
"""Poses at a time: what is known of them stays in the first cache."""


@jit
def _offsets(poses, first, reference, dx, dy, heading):  # type: ignore[no-untyped-def]
    """Take a block of poses apart: what lies side by side is computed several at a time."""
    for n in range(dx.size):
        dx[n] = poses[first + n, 0] - reference[0]
        dy[n] = poses[first + n, 1] - reference[1]
        heading[n] = poses[first + n, 2]


@jit
def _distances(dx, dy, away):  # type: ignore[no-untyped-def]
    """Write distances in metres."""
    for n in range(away.size):
        away[n] = np.sqrt(dx[n] * dx[n] + dy[n] * dy[n])


@jit
def _directions(dx, dy, direction):  # type: ignore[no-untyped-def]
    """Write directions from the reference, radians."""
    for n in range(direction.size):
        direction[n] = fast_arctan2(dy[n], dx[n])


@jit
def _cells(angle, bins, cell):  # type: ignore[no-untyped-def]
    """Write cell coordinates in [0, B] of angles in radians; cell centres lie at half cells."""
    cells = bins / TWO_PI
    turn = 1.0 / bins
    for n in range(cell.size):
        u = angle[n] * cells - 0.5
        cell[n] = u - np.floor(u * turn) * bins


@jit
def _corners(across, along, bins, corner):  # type: ignore[no-untyped-def]
    """Write where in the flat table the first corner of each pose's cell lies."""
    top = bins - 1
    for n in range(corner.size):
        corner[n] = min(int(across[n]), top) * (bins + 1) + min(int(along[n]), top)


@jit
def _interpolate(flat, corner, across, along, bins, value):  # type: ignore[no-untyped-def]
    """Write the table's bilinear values."""
    width = bins + 1
    top = float(bins - 1)
    for n in range(value.size):
        c = corner[n]
        s = across[n] - min(np.floor(across[n]), top)
        t = along[n] - min(np.floor(along[n]), top)
        low = flat[c] + t * (flat[c + 1] - flat[c])
        high = flat[c + width] + t * (flat[c + width + 1] - flat[c + width])
        value[n] = low + s * (high - low)


@jit
def _nearby(away, across, along, rotation, near, value):  # type: ignore[no-untyped-def]
    """Let the direction to the reference fade out of the values of poses that are near to it."""
    bins = rotation.size - 1
    for n in range(value.size):
        if away[n] < near:
            k = across[n] - along[n]
            k = k + bins if k < 0.0 else k
            m = min(int(k), bins - 1)
            turned = (1.0 - (k - m)) * rotation[m] + (k - m) * rotation[m + 1]
            part = away[n] / near
            part = part * part * (3.0 - 2.0 * part)
            value[n] = part * value[n] + (1.0 - part) * turned


@jit
def add_reference(poses, reference, table, rotation, near, ramp, reach, out):  # type: ignore[no-untyped-def]
    """Add one reference's log-likelihood to the particles': O(N).

    ``poses`` (N, 3), ``reference`` (3,), ``table`` and ``rotation`` from `link`, ``out`` (N,).
    Within ``near`` metres the direction to the reference fades out of the likelihood and only
    the rotation stays; from ``ramp`` to ``reach`` metres all of it fades.
    """
    bins = table.shape[0] - 1
    flat = table.reshape(-1)
    slope = 1.0 / (reach - ramp)
    work, corners = np.empty((8, BLOCK)), np.empty(BLOCK, np.int32)
    for first in range(0, poses.shape[0], BLOCK):
        size = min(BLOCK, poses.shape[0] - first)
        dx, dy, heading = work[0, :size], work[1, :size], work[2, :size]
        away, direction, value = work[3, :size], work[4, :size], work[5, :size]
        across, along, corner = work[6, :size], work[7, :size], corners[:size]
        _offsets(poses, first, reference, dx, dy, heading)
        _distances(dx, dy, away)
        _directions(dx, dy, direction)
        for n in range(size):
            heading[n] = direction[n] + np.pi - heading[n]
        for n in range(size):
            direction[n] -= reference[2]
        _cells(direction, bins, across)
        _cells(heading, bins, along)
        _corners(across, along, bins, corner)
        _interpolate(flat, corner, across, along, bins, value)
        _nearby(away, across, along, rotation, near, value)
        for n in range(size):
            out[first + n] += min(max((reach - away[n]) * slope, 0.0), 1.0) * value[n]
