"""Kernels of the reference-image model: posteriors of image pairs, looked up at particles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pflut._jit import jit
from pflut._trig import arctan_ratio, polynomial
from pflut.geometry import TWO_PI, FloatArray
from pflut.posterior import diagonals

BLOCK = 256
"""Poses at a time: what is known of them stays in the first cache."""
CHUNK = 32 * BLOCK
"""Poses for one reference after the other: they stay in the second cache."""
FARTHEST = 1e15
LARGEST = 24.0
"""Nats from which on a softplus is a straight line, for a float32."""


def rotation_curve(grid: NDArray[np.float32], temperature: float, linked: float) -> FloatArray:
    """Say what a particle that stands on the reference is worth at each rotation.

    NumPy: of few pairs in an image it is needed.

    Parameters
    ----------
    grid : ndarray of shape (B, B)
        Log-likelihood ratios.
    temperature, linked : float
        Factor on them; prior probability that the pair shows one scene.

    Returns
    -------
    ndarray of shape (B + 1,)
        log((1 - linked) + linked mean exp(temperature grid)), the mean over the cells of one
        rotation: entry k is for heading_l - heading_r = k cells, the first is repeated.
    """
    turned = diagonals(np.float32(temperature) * grid)
    highest = turned.max(axis=1)
    means = np.exp(turned - highest[:, None]).mean(axis=1, dtype=np.float64)
    there = np.log(means) + highest + np.log(linked)
    curve = np.logaddexp(np.log1p(-linked), there)
    return np.append(curve, curve[0])


@jit
def _offsets(x, y, heading, reference, dx, dy, turned):  # type: ignore[no-untyped-def]
    """See poses from a reference; in float32 from here on: a robot is metres from it.

    Of headings of many turns an even number is taken away; what is farther than float32 can
    square is not nearer for being cut off.
    """
    reference_x, reference_y, reference_heading = reference[0], reference[1], reference[2]
    for n in range(dx.size):
        dx[n] = min(max(x[n] - reference_x, -FARTHEST), FARTHEST)
        dy[n] = min(max(y[n] - reference_y, -FARTHEST), FARTHEST)
        turn = heading[n] - reference_heading
        turned[n] = turn - 2.0 * TWO_PI * np.trunc(turn * (0.5 / TWO_PI))


# both to 2e-7
_A0, _A1, _A2, _A3, _A4, _A5, _A6, _A7 = map(np.float32, polynomial(arctan_ratio, 7))
_L0, _L1, _L2, _L3, _L4, _L5, _L6, _L7 = map(np.float32, polynomial(lambda t: np.log1p(t) / t, 7))
_ZERO, _ONE, _HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)
_PI, _HALF_PI, _TINY = np.float32(np.pi), np.float32(0.5 * np.pi), np.float32(1e-30)
_SIXTH, _SIXTYFOURTH = np.float32(1.0 / 6.0), np.float32(1.0 / 64.0)


@jit
def _polar(dx, dy, away, direction):  # type: ignore[no-untyped-def]
    """Write distances in metres and directions in (-pi, pi]."""
    for n in range(away.size):
        away[n] = np.sqrt(dx[n] * dx[n] + dy[n] * dy[n])
        across, along = abs(dy[n]), abs(dx[n])
        t = min(across, along) / (max(across, along) + _TINY)
        q = t * t
        p = _A7 * q + _A6
        p = p * q + _A5
        p = p * q + _A4
        p = p * q + _A3
        p = p * q + _A2
        p = p * q + _A1
        angle = (p * q + _A0) * t
        angle = _HALF_PI - angle if across > along else angle
        angle = _PI - angle if dx[n] < _ZERO else angle
        direction[n] = -angle if dy[n] < _ZERO else angle


@jit
def _cells(direction, turned, heading, bins, across, along):  # type: ignore[no-untyped-def]
    """Write both headings as cell coordinates in [0, B]; cell centres lie at half cells.

    ``direction`` from the reference in the world, ``turned`` by which the robot's heading differs
    from the reference's, ``heading`` of the reference.
    """
    cells, turn, width = np.float32(bins / TWO_PI), np.float32(1.0 / bins), np.float32(bins)
    for n in range(across.size):
        heading_l = direction[n] - heading
        u = heading_l * cells - _HALF
        across[n] = u - np.floor(u * turn) * width
        u = (heading_l + _PI - turned[n]) * cells - _HALF
        along[n] = u - np.floor(u * turn) * width


@jit
def _interpolate(flat, bins, across, along, value):  # type: ignore[no-untyped-def]
    """Write the periodic grid's bilinear values."""
    top, width, one = np.int32(bins - 1), np.int32(bins), np.int32(1)
    for n in range(value.size):
        i = max(min(np.int32(across[n]), top), np.int32(0))
        j = max(min(np.int32(along[n]), top), np.int32(0))
        s, t = across[n] - np.float32(i), along[n] - np.float32(j)
        row = i * width
        next_row = np.int32(0) if i == top else row + width
        k = np.int32(0) if j == top else j + one
        low = flat[np.uintp(row + j)]
        low += t * (flat[np.uintp(row + k)] - low)
        high = flat[np.uintp(next_row + j)]
        high += t * (flat[np.uintp(next_row + k)] - high)
        value[n] = low + s * (high - low)


@jit
def _link(value, temperature, odds, floor):  # type: ignore[no-untyped-def]
    """Write log((1 - linked) + linked exp(temperature value)), to 1e-5 or a float32's last digit.

    That is ``floor`` + softplus(temperature value + ``odds``), with the logarithms of 1 - linked
    and of the odds of being linked; exp(-y) is (1 - y/64 + ...) ** 64.
    """
    for n in range(value.size):
        x = temperature * value[n] + odds
        z = min(abs(x), np.float32(LARGEST)) * _SIXTYFOURTH
        e = _ONE - z * (_ONE - z * (_HALF - z * _SIXTH))
        e = e * e
        e = e * e
        e = e * e
        e = e * e
        e = e * e
        e = e * e
        p = _L7 * e + _L6
        p = p * e + _L5
        p = p * e + _L4
        p = p * e + _L3
        p = p * e + _L2
        p = p * e + _L1
        value[n] = floor + max(x, _ZERO) + (p * e + _L0) * e


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
def _add(away, value, ramp, reach, total):  # type: ignore[no-untyped-def]
    """Add values that fade from ``ramp`` to ``reach`` metres."""
    end, slope = np.float32(reach), np.float32(1.0 / (reach - ramp))
    for n in range(value.size):
        total[n] += min(max((end - away[n]) * slope, _ZERO), _ONE) * value[n]


@jit
def add_reference(  # type: ignore[no-untyped-def]
    x, y, heading, reference, grid, temperature, linked, rotation, near, ramp, reach, out
):
    """Add one reference's log-likelihood to the particles': O(N).

    ``x``, ``y`` and ``heading`` (N,) of the particles, ``reference`` (3,), ``grid`` (B, B) float32,
    ``temperature`` and ``linked`` of `rotation_curve`, of which ``rotation`` (B + 1,) is, ``out``
    (N,). Within ``near`` metres the direction to the reference fades out of the likelihood and only
    the rotation stays; from ``ramp`` to ``reach`` metres all of it fades.
    """
    bins = grid.shape[0]
    flat = grid.reshape(-1)
    toward = np.float32(reference[2] - 2.0 * TWO_PI * np.trunc(reference[2] * (0.5 / TWO_PI)))
    factor, floor = np.float32(temperature), np.float32(np.log1p(-linked))
    odds = np.float32(np.log(linked) - np.log1p(-linked))
    work = np.empty((7, BLOCK), np.float32)
    for first in range(0, out.size, BLOCK):
        last = min(first + BLOCK, out.size)
        size = last - first
        dx, dy, turned = work[0, :size], work[1, :size], work[2, :size]
        away, direction = work[3, :size], work[4, :size]
        across, along, value = work[5, :size], work[6, :size], work[0, :size]
        _offsets(x[first:last], y[first:last], heading[first:last], reference, dx, dy, turned)
        _polar(dx, dy, away, direction)
        _cells(direction, turned, toward, bins, across, along)
        _interpolate(flat, bins, across, along, value)
        _link(value, factor, odds, floor)
        if away.min() < near:
            _nearby(away, across, along, rotation, near, value)
        _add(away, value, ramp, reach, out[first:last])
