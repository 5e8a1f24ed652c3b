"""Kernels that find where a mixture needs more components."""

from __future__ import annotations

import numpy as np

from pflut._jit import inline, jit
from pflut.von_mises._components import (
    BAND,
    COUPLING,
    K_1,
    K_2,
    KIND,
    MEAN_1,
    MEAN_2,
    MODE,
    TWO_PI,
    WEIGHT,
    concentration,
    set_covariance,
    sharpen,
)
from pflut.von_mises.point_kernels import BLOCK, BLOCK_VARIANCE, LEVELS, TILES

BAND_SHARE, BAND_LENGTH = 0.3, 0.8
"""A band is tried if three diagonals hold so much, at headings whose mean vector is no longer."""
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_PER_OCTAVE = np.float32(np.log(2.0) / 2**23)
_ONE_BITS = np.int32(127 << 23)


@inline
def _rough_log(x):  # type: ignore[no-untyped-def]
    """Logarithm of a positive float32, to 0.06: the exponent's bits, and those behind them."""
    return np.float32(np.float32(x).view(np.int32) - _ONE_BITS) * _PER_OCTAVE


@jit
def find_band(prob, diagonals, component):  # type: ignore[no-untyped-def]
    """Make a band of the rotation that holds most; return whether it holds much, at many headings.

    ``diagonals`` (B,): the probability of each (i - j) % B.
    """
    bins = prob.shape[0]
    cell = TWO_PI / bins
    most, peak = 0.0, 0
    for k in range(bins):
        near = diagonals[k - 1] + diagonals[k] + diagonals[(k + 1) % bins]
        if near > most:
            most, peak = near, k
    if most < BAND_SHARE:
        return False
    mass, m1, s11, sine, cosine = 0.0, 0.0, 0.0, 0.0, 0.0
    for offset in range(-3, 4):
        for i in range(bins):
            value = prob[i, (i - peak - offset) % bins]
            mass += value
            m1 += value * offset
            s11 += value * offset * offset
            sine += value * np.sin((i + 0.5) * cell)
            cosine += value * np.cos((i + 0.5) * cell)
    length = np.sqrt(sine * sine + cosine * cosine) / mass
    if length > BAND_LENGTH:
        return False
    m1 /= mass
    component[KIND] = BAND
    component[WEIGHT] = 0.5 * mass
    component[MEAN_1] = np.pi + (peak + m1) * cell
    component[MEAN_2] = np.arctan2(sine, cosine)
    component[K_1] = 1.0 / (max(s11 / mass - m1 * m1, 0.25) * cell * cell)
    component[K_2] = concentration(1.0 - length)
    component[COUPLING] = 0.0
    return True


@jit
def _find_missing(points, start, cell, total, gains, best):  # type: ignore[no-untyped-def]
    """Sum, over each tile, the nats that the mixture lacks; and find its worst point."""
    gains[:] = _ZERO
    best[:] = -1
    for level in range(LEVELS):
        area = np.float32((cell * BLOCK if level == 0 else cell) ** 2)
        for tile in range(TILES * TILES):
            worst, place, sum_ = _ZERO, -1, _ZERO
            for n in range(start[level, tile], start[level, tile + 1]):
                ratio = points[4, n] / (total[n] * area)
                if ratio > _ONE:
                    gain = points[4, n] * _rough_log(ratio)
                    sum_ += gain
                    if gain > worst:
                        worst, place = gain, n
            if sum_ > _ZERO:
                if best[tile] < 0 or worst > gains[TILES * TILES + tile]:
                    best[tile] = place
                    gains[TILES * TILES + tile] = worst
                gains[tile] += sum_


@jit
def _seed(points, start, cell, total, nearby, center, tile, component):  # type: ignore[no-untyped-def]
    """Make a mode of what the mixture lacks around a point; return its weight."""
    sin_1, cos_1 = points[0, center], points[1, center]
    sin_2, cos_2 = points[2, center], points[3, center]
    nearest = np.float32(np.cos(nearby))
    x, y = tile // TILES, tile % TILES
    mass, m1, m2, s11, s22, s12, blur = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for level in range(LEVELS):
        area = np.float32((cell * BLOCK if level == 0 else cell) ** 2)
        for a in range(x + TILES - 1, x + TILES + 2):
            for b in range(y + TILES - 1, y + TILES + 2):
                near = a % TILES * TILES + b % TILES
                for n in range(start[level, near], start[level, near + 1]):
                    excess = points[4, n] - total[n] * area
                    if excess <= 0.0:
                        continue
                    c1 = points[1, n] * cos_1 + points[0, n] * sin_1
                    c2 = points[3, n] * cos_2 + points[2, n] * sin_2
                    if c1 < nearest or c2 < nearest:
                        continue
                    s1 = points[0, n] * cos_1 - points[1, n] * sin_1
                    s2 = points[2, n] * cos_2 - points[3, n] * sin_2
                    mass += excess
                    m1 += excess * s1
                    m2 += excess * s2
                    s11 += excess * s1 * s1
                    s22 += excess * s2 * s2
                    s12 += excess * s1 * s2
                    if level == 0:
                        blur += excess * BLOCK_VARIANCE * cell * cell
    if mass < 1e-7:
        return 0.0
    m1, m2 = m1 / mass, m2 / mass
    sharp = np.empty(3)
    s11, s22, s12 = s11 / mass - m1 * m1, s22 / mass - m2 * m2, s12 / mass - m1 * m2
    sharpen(s11, s22, s12, 0.0, max((0.4 * cell) ** 2, 3.0 * blur / mass), sharp)
    component[WEIGHT] = mass
    component[MEAN_1] = np.arctan2(sin_1, cos_1) + m1
    component[MEAN_2] = np.arctan2(sin_2, cos_2) + m2
    set_covariance(sharp, component)
    component[KIND] = MODE
    return mass


@jit
def add_modes(points, start, cell, total, nearby, components, count, room, worth, gains, best):  # type: ignore[no-untyped-def]
    """Add modes where a mixture lacks most; return how many.

    Parameters
    ----------
    points, start
        As of `point_kernels.make_points`.
    cell : float
        Side of a cell, radians.
    total : ndarray of shape (n,), float32
        The mixture's density at the points.
    nearby : float
        Radians about the worst point within which what is missing makes one mode.
    components : ndarray of shape (limit, COLUMNS)
        ``count`` of them are given; the next ``room`` rows, at most, are set.
    worth : float
        Nats that a tile must lack.
    gains, best : ndarray of shape (2 * TILES^2,), float32, and (TILES^2,), int64
        Scratch.
    """
    _find_missing(points, start, cell, total, gains, best)
    fresh = 0
    tiles = TILES * TILES
    while fresh < room:
        tile = int(np.argmax(gains[:tiles]))
        gain = gains[tile]
        if gain <= worth:
            break
        # the neighbours share what is missing here
        x, y = tile // TILES, tile % TILES
        for a in range(x + TILES - 1, x + TILES + 2):
            for b in range(y + TILES - 1, y + TILES + 2):
                gains[a % TILES * TILES + b % TILES] = _ZERO
        mass = _seed(
            points, start, cell, total, nearby, best[tile], tile, components[count + fresh]
        )
        if mass > 0.0:
            fresh += 1
    return fresh
