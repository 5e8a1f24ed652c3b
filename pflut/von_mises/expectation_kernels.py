"""Kernels of the expectation: the density of each component at the points, and of their sum.

At a block of cells, see `point_kernels`, a component is evaluated as if blurred; and it is
evaluated in the chunks of points where it is not negligible only.
"""

from __future__ import annotations

import numpy as np

from pflut._jit import inline, jit
from pflut.von_mises._components import (
    COUPLING,
    K_1,
    K_2,
    KIND,
    MEAN_1,
    MEAN_2,
    MODE,
    TWO_PI,
    WEIGHT,
    i0e,
    is_sharp,
    is_short,
    log_normalizer,
    sum_over_cells,
    sum_over_diagonals,
)
from pflut.von_mises.point_kernels import BLOCK_VARIANCE, CHUNK

NEGLIGIBLE = 7.0
"""Nats below its maximum at which a component has ended."""

_F0, _F1, _F2, _F3, _F4, _F5 = (
    np.float32(c)
    for c in np.polynomial.Chebyshev.interpolate(lambda t: 2.0**t, 5, domain=[-0.5, 0.5])
    .convert(kind=np.polynomial.Polynomial)
    .coef
)
_LOG2E, _HALF, _ONE = np.float32(np.log2(np.e)), np.float32(0.5), np.float32(1.0)
_LOWEST = np.float32(-40.0)
_BIAS, _SHIFT = np.int32(127), np.int32(23)


@inline
def _exp(x):  # type: ignore[no-untyped-def]
    """Exponential of a float32 below 80, to 4e-6; at least e^-40. A loop over it is vectorised."""
    z = max(x, _LOWEST) * _LOG2E
    whole = np.floor(z + _HALF)
    f = z - whole
    p = _F5 * f + _F4
    p = p * f + _F3
    p = p * f + _F2
    p = p * f + _F1
    p = p * f + _F0
    return p * np.int32((np.int32(whole) + _BIAS) << _SHIFT).view(np.float32)


@inline
def _mode_reach(chunks, first, last, s, out):  # type: ignore[no-untyped-def]
    """Write the log-density of a mode, blurred as much as chunks are large, at their centers."""
    sin_1, cos_1, sin_2, cos_2, k_1, k_2, coupling, determinant = s
    for n in range(first, last):
        s1 = chunks[0, n] * cos_1 - chunks[1, n] * sin_1
        c1 = chunks[1, n] * cos_1 + chunks[0, n] * sin_1
        s2 = chunks[2, n] * cos_2 - chunks[3, n] * sin_2
        c2 = chunks[3, n] * cos_2 + chunks[2, n] * sin_2
        v_1, v_2 = chunks[4, n], chunks[5, n]
        below = (k_1 + v_2 * determinant) * (c1 - _ONE) + (k_2 + v_1 * determinant) * (c2 - _ONE)
        wider = _ONE + v_1 * k_1 + v_2 * k_2 + v_1 * v_2 * determinant
        out[n] = (below + coupling * s1 * s2) / wider


@inline
def _band_reach(chunks, first, last, s, out):  # type: ignore[no-untyped-def]
    """As `_mode_reach`, of a band."""
    sin_1, cos_1, sin_2, cos_2, across, along = s
    for n in range(first, last):
        sin_psi = chunks[1, n] * chunks[2, n] - chunks[0, n] * chunks[3, n]
        cos_psi = -chunks[1, n] * chunks[3, n] - chunks[0, n] * chunks[2, n]
        c1 = cos_psi * cos_1 + sin_psi * sin_1
        c2 = chunks[1, n] * cos_2 + chunks[0, n] * sin_2
        v_1, v_2 = chunks[4, n], chunks[5, n]
        narrow = across * (c1 - _ONE) / (_ONE + across * (v_1 + v_2))
        out[n] = narrow + along * (c2 - _ONE) / (_ONE + along * v_1)


@jit
def _find_runs(component, cell, chunks, blocks, reach, runs):  # type: ignore[no-untyped-def]
    """List the points where a component is, [first, last] a row; return how many rows.

    ``reach`` is scratch; ``blocks``: chunks that hold blocks.
    """
    number = np.uint64(reach.shape[0])
    sin_1, cos_1 = np.float32(np.sin(component[MEAN_1])), np.float32(np.cos(component[MEAN_1]))
    sin_2, cos_2 = np.float32(np.sin(component[MEAN_2])), np.float32(np.cos(component[MEAN_2]))
    k1, k2, c = component[K_1], component[K_2], component[COUPLING]
    first = np.uint64(0)
    if component[KIND] == MODE:
        # what is sharp does not lie on blocks
        if is_sharp(component, cell) and is_short(component, cell):
            first = np.uint64(blocks)
        determinant = np.float32(k1 * k2 - c * c)
        k_1, k_2 = np.float32(k1), np.float32(k2)
        mode = (sin_1, cos_1, sin_2, cos_2, k_1, k_2, np.float32(c), determinant)
        _mode_reach(chunks, first, number, mode, reach)
    else:
        band = (sin_1, cos_1, sin_2, cos_2, np.float32(k1), np.float32(k2))
        _band_reach(chunks, first, number, band, reach)
    n, inside = 0, False
    for chunk in range(first, number):
        near = reach[chunk] > -NEGLIGIBLE
        # blocks and cells are not in one run
        if inside and (not near or chunk == blocks):
            runs[n, 1] = chunk * CHUNK
            n += 1
            inside = False
        if near and not inside:
            runs[n, 0] = chunk * CHUNK
            inside = True
    if inside:
        runs[n, 1] = number * CHUNK
        n += 1
    return n


@inline
def _mode_run(points, first, last, s, out, at):  # type: ignore[no-untyped-def]
    """Write a mode's density at points."""
    sin_1, cos_1, sin_2, cos_2, k_1, k_2, coupling, scale = s
    shift = at - first
    for n in range(first, last):
        s1 = points[0, n] * cos_1 - points[1, n] * sin_1
        c1 = points[1, n] * cos_1 + points[0, n] * sin_1
        s2 = points[2, n] * cos_2 - points[3, n] * sin_2
        c2 = points[3, n] * cos_2 + points[2, n] * sin_2
        value = _exp(k_1 * (c1 - _ONE) + k_2 * (c2 - _ONE) + coupling * s1 * s2 + scale)
        out[n + shift] = value


@inline
def _band_run(points, first, last, s, out, at):  # type: ignore[no-untyped-def]
    """As `_mode_run`, of a band."""
    sin_1, cos_1, sin_2, cos_2, across, along, scale = s
    shift = at - first
    for n in range(first, last):
        # psi = heading_l - heading_r + pi: its sine and cosine are those of the difference, negated
        sin_psi = points[1, n] * points[2, n] - points[0, n] * points[3, n]
        cos_psi = -points[1, n] * points[3, n] - points[0, n] * points[2, n]
        c1 = cos_psi * cos_1 + sin_psi * sin_1
        c2 = points[1, n] * cos_2 + points[0, n] * sin_2
        value = _exp(across * (c1 - _ONE) + along * (c2 - _ONE) + scale)
        out[n + shift] = value


@jit
def _evaluate(points, runs, count, cell, blocks, component, out):  # type: ignore[no-untyped-def]
    """Write a component's weighted density at its points."""
    k1, k2, c = component[K_1], component[K_2], component[COUPLING]
    weight = max(component[WEIGHT], 1e-30)
    peak = np.log(weight)
    sums = np.empty(6)
    measured = False
    if component[KIND] == MODE:
        if not is_sharp(component, cell):
            peak -= log_normalizer(k1, k2, c)
        elif is_short(component, cell):
            sum_over_cells(component, cell, sums)
            peak -= sums[0]
        else:
            peak, measured = 0.0, True
    else:
        peak -= np.log(TWO_PI * i0e(k2))
        if is_sharp(component, cell):
            sum_over_diagonals(component, cell, sums)
            peak -= sums[0]
        else:
            peak -= np.log(TWO_PI * i0e(k1))
    sin_1, cos_1 = np.float32(np.sin(component[MEAN_1])), np.float32(np.cos(component[MEAN_1]))
    sin_2, cos_2 = np.float32(np.sin(component[MEAN_2])), np.float32(np.cos(component[MEAN_2]))
    at = np.uint64(0)
    for r in range(count):
        first, last = runs[r, 0], runs[r, 1]
        # tails of what is narrower than a block do not reach into it
        blur = 0.0
        if first < blocks * CHUNK and max(k1, k2) * (2.0 * cell) ** 2 < 1.0:
            blur = BLOCK_VARIANCE * cell * cell
        if component[KIND] == MODE:
            # the inverse of (inverse of the precision + blur)
            determinant = k1 * k2 - c * c
            wider = 1.0 + blur * (k1 + k2) + blur * blur * determinant
            blurred = (
                sin_1,
                cos_1,
                sin_2,
                cos_2,
                np.float32((k1 + blur * determinant) / wider),
                np.float32((k2 + blur * determinant) / wider),
                np.float32(c / wider),
                np.float32(peak - 0.5 * np.log(wider)),
            )
            _mode_run(points, first, last, blurred, out, at)
        else:
            wider = 1.0 + 2.0 * blur * k1
            band = (
                sin_1,
                cos_1,
                sin_2,
                cos_2,
                np.float32(k1 / wider),
                np.float32(k2),
                np.float32(peak - 0.5 * np.log(wider)),
            )
            _band_run(points, first, last, band, out, at)
        at += last - first
    if measured:
        # a sharp ridge bends between the cells: no formula tells their sum
        mass, at = np.float32(0.0), np.uint64(0)
        for r in range(count):
            length = runs[r, 1] - runs[r, 0]
            if runs[r, 0] >= blocks * CHUNK:
                for n in range(at, at + length):
                    mass += out[n]
            at += length
        scale = np.float32(weight / (max(mass, 1e-12) * cell * cell))
        for n in range(at):
            out[n] *= scale


@jit
def expect(  # type: ignore[no-untyped-def]
    points, chunks, blocks, cell, components, first, uniform, reach, runs, num_runs, scratch, total
):
    """Evaluate the components from a first one on, and the sum of all.

    Parameters
    ----------
    points, chunks, blocks
        As of `point_kernels.make_points`.
    cell : float
        Side of a cell, radians.
    components : ndarray of shape (K, COLUMNS)
    first : int
        Those before it are as they were evaluated the last time.
    uniform : float
        Weight of the uniform density.
    reach : ndarray of shape (chunks,), float32
        Scratch.
    runs : ndarray of shape (K, R, 2), uint64
        Receives the first and the last point of each run in which a component is; an index that
        might be below zero would keep loops from being vectorised.
    num_runs : ndarray of shape (K,), int64
        Receives how many runs those are.
    scratch : ndarray of shape (K, n), float32
        Receives each component's weighted density in its runs, one after the other.
    total : ndarray of shape (n,), float32
        Receives the density of the mixture.
    """
    base = np.float32(uniform / (TWO_PI * TWO_PI))
    for n in range(total.shape[0]):
        total[n] = base
    for k in range(components.shape[0]):
        if k >= first:
            num_runs[k] = _find_runs(components[k], cell, chunks, blocks, reach, runs[k])
            _evaluate(points, runs[k], num_runs[k], cell, blocks, components[k], scratch[k])
        at = np.uint64(0)
        for r in range(num_runs[k]):
            start, end = runs[k, r, 0], runs[k, r, 1]
            shift = at - start
            for n in range(start, end):
                total[n] += scratch[k, n + shift]
            at += end - start


@jit
def cross_entropy(points, total):  # type: ignore[no-untyped-def]
    """Mean of minus the log of the density over the grid's probability."""
    value = 0.0
    for n in range(total.shape[0]):
        value -= np.float64(points[4, n]) * np.log(np.float64(total[n]))
    return value
