"""Random numbers for kernels: counter-based, of a state or a key that the caller owns.

As with `_trig`, whoever edits this file deletes Numba's cache.
"""

from __future__ import annotations

import math

import numpy as np

from pflut._jit import inline, jit

_STEP = np.uint64(0x9E3779B97F4A7C15)


@inline
def _mixed(z):  # type: ignore[no-untyped-def]
    """Mix the bits of a number of splitmix64's counter."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@jit
def uniform(state):  # type: ignore[no-untyped-def]
    """Draw from [0, 1): splitmix64, a counter with a mixing function, cheap to start anywhere.

    ``state`` (1,) uint64, in and out.
    """
    state[0] += _STEP
    return (_mixed(state[0]) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


_ONE, _HALF, _TWO = np.float32(1.0), np.float32(0.5), np.float32(2.0)
_SPLIT = np.float32(2.0**-31)
_LN2, _QUARTER = np.float32(math.log(2.0)), np.float32(0.5 * math.pi)
_EXPONENT_BITS, _BIAS, _MANTISSA = np.int32(23), np.int32(127), np.int32(0x7FFFFF)
_BITS_OF_ONE, _MANTISSA_OF_SQRT2 = np.int32(0x3F800000), np.int32(0x3504F3)
# 2 artanh(s) = log((1 + s) / (1 - s)); sine and cosine: Taylor, to 4e-7 on an eighth of a turn
_L2, _L4, _L6, _L8 = (np.float32(1.0 / k) for k in (3, 5, 7, 9))
_S2, _S4, _S6 = (np.float32(c) for c in (-1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0))
_C2, _C4, _C6, _C8 = (np.float32(c) for c in (-0.5, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40320.0))


@jit
def _uniforms(key, first, u, v):  # type: ignore[no-untyped-def]
    """Draw u from (0, 1], down to 2 ** -32, and v from [-1/2, 1/2]: splitmix64's two halves."""
    for i in range(u.size):
        z = _mixed(key + np.uint64(first + i) * _STEP)
        # as signed numbers, whose conversion is vectorised
        u[i] = (np.float32(np.int32(z >> np.uint64(33))) + _HALF) * _SPLIT
        v[i] = np.float32(np.int32(np.uint32(z))) * (_HALF * _SPLIT)


@jit
def _exponents(bits, exponent, mantissa_bits):  # type: ignore[no-untyped-def]
    """Part floats, given as their bits, into exponent and mantissa in [sqrt(1/2), sqrt(2))."""
    for i in range(bits.size):
        mantissa = bits[i] & _MANTISSA
        large = np.int32(mantissa > _MANTISSA_OF_SQRT2)
        mantissa_bits[i] = mantissa | (_BITS_OF_ONE - (large << _EXPONENT_BITS))
        exponent[i] = np.float32((bits[i] >> _EXPONENT_BITS) - _BIAS + large)


@jit
def _box_muller(exponent, mantissa, v, a, b):  # type: ignore[no-untyped-def]
    """Turn a radius sqrt(-2 log u) by v turns."""
    for i in range(v.size):
        s = (mantissa[i] - _ONE) / (mantissa[i] + _ONE)
        q = s * s
        artanh = s * (_ONE + q * (_L2 + q * (_L4 + q * (_L6 + q * _L8))))
        log = exponent[i] * _LN2 + _TWO * artanh
        radius = np.sqrt(max(-_TWO * log, np.float32(0.0)))
        quarters = v[i] * np.float32(4.0)
        quarter = np.floor(quarters + _HALF)
        y = (quarters - quarter) * _QUARTER
        q = y * y
        s = y * (_ONE + q * (_S2 + q * (_S4 + q * _S6)))
        c = _ONE + q * (_C2 + q * (_C4 + q * (_C6 + q * _C8)))
        odd, behind = abs(quarter) == _ONE, abs(quarter) == _TWO
        sine, cosine = (c, s) if odd else (s, c)
        sine = -sine if behind or quarter == -_ONE else sine
        cosine = -cosine if behind or quarter == _ONE else cosine
        a[i] = radius * cosine
        b[i] = radius * sine


@jit
def normals(key, first, work, bits, a, b):  # type: ignore[no-untyped-def]
    """Draw two arrays of independent standard normal numbers, as far as 6.6; vectorised.

    A tenth of the time of NumPy's, for noise that float32 suffices for. ``key`` uint64; ``first``
    the number in the key's sequence of the first pair; ``work`` (4, n) float32, with its ``bits``
    the same memory as int32, to work in; out, ``a`` and ``b`` (n,) float32.
    """
    _uniforms(key, first, work[0], work[1])
    _exponents(bits[0], work[2], bits[3])
    _box_muller(work[2], work[3], work[1], a, b)
