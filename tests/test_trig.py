"""The fast trigonometry against the C library's."""

from __future__ import annotations

import numpy as np
import pytest

from pflut._jit import jit
from pflut._trig import fast_arctan2, fast_sincos

ACCURACY = 2e-9


@jit
def over(y, x, out):
    for i in range(y.size):
        out[i] = fast_arctan2(y[i], x[i])


def fast(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    out = np.empty(y.size)
    over(np.ascontiguousarray(y, float), np.ascontiguousarray(x, float), out)
    return out


def test_accurate_all_around_at_any_length() -> None:
    angle = np.linspace(-np.pi, np.pi, 400_001)[1:-1]
    for length in (1e-200, 1e-9, 1.0, 3e7, 1e200):
        y, x = length * np.sin(angle), length * np.cos(angle)
        assert np.abs(fast(y, x) - np.arctan2(y, x)).max() < ACCURACY


def test_accurate_beside_the_axes_and_the_diagonals() -> None:
    tiny = np.logspace(-18, -1, 500)
    one = np.ones(500)
    for y, x in ((tiny, one), (one, tiny), (one, one - tiny)):
        for sign_y in (-1, 1):
            for sign_x in (-1, 1):
                error = fast(sign_y * y, sign_x * x) - np.arctan2(sign_y * y, sign_x * x)
                assert np.abs(error).max() < ACCURACY


@pytest.mark.parametrize(
    ("y", "x", "expected"),
    [
        (0.0, 0.0, 0.0),
        (-0.0, -0.0, 0.0),
        (-0.0, 0.0, 0.0),
        (0.0, 2.0, 0.0),
        (-0.0, 2.0, 0.0),
        (3.0, 0.0, np.pi / 2),
        (3.0, -0.0, np.pi / 2),
        (-3.0, 0.0, -np.pi / 2),
        (0.0, -1.0, np.pi),
        (-0.0, -1.0, np.pi),
    ],
)
def test_axes_are_exact_and_the_range_is_half_open(y: float, x: float, expected: float) -> None:
    """-pi is left out, unlike in the C library, where the sign of a zero chooses."""
    assert fast_arctan2(y, x) == expected
    assert fast(np.array([y]), np.array([x]))[0] == expected


def test_odd_in_y() -> None:
    y, x = np.random.default_rng(0).normal(size=(2, 1000))
    assert (fast(-y, x) == -fast(y, x)).all()


@jit
def sincos_over(angles, out):
    for i in range(angles.size):
        out[0, i], out[1, i] = fast_sincos(angles[i])


def test_sine_and_cosine_are_accurate_over_some_turns() -> None:
    quarters = np.arange(-20, 21) * np.pi / 2
    for angles in (
        np.linspace(-30.0, 30.0, 400_001),
        np.concatenate([quarters, np.nextafter(quarters, 99.0), np.nextafter(quarters, -99.0)]),
        quarters / 2,
    ):
        out = np.empty((2, angles.size))
        sincos_over(angles, out)
        # the angles' own rounding, a ulp, is at most as large
        assert np.abs(out - [np.sin(angles), np.cos(angles)]).max() < 4e-15
    out = np.empty((2, 1))
    sincos_over(np.zeros(1), out)
    assert out.tolist() == [[0.0], [1.0]]
