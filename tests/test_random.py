"""Normal numbers of a counter: their naive twin, their distribution, their far ends."""

from __future__ import annotations

import naive
import numpy as np
import pytest
from scipy import stats

from pflut._random import _box_muller, _exponents, normals

SIGMAS = 5.0


def drawn(key: int, first: int, n: int) -> np.ndarray:
    work, out = np.empty((4, n), np.float32), np.empty((2, n), np.float32)
    normals(np.uint64(key), first, work, work.view(np.int32), out[0], out[1])
    return out


@pytest.mark.parametrize("key", [0, 1, 2**63 + 12345, 2**64 - 1])
@pytest.mark.parametrize("first", [0, 1000, 10**9])
def test_equal_their_naive_twins(key: int, first: int) -> None:
    expected = naive.normals(key, first, 700)
    # where u is near one its logarithm is that of a float32 near one
    assert drawn(key, first, 700) == pytest.approx(expected, rel=2e-5, abs=1e-4)


def test_a_sequence_may_be_cut_anywhere() -> None:
    whole = drawn(7, 0, 1000)
    parts = [drawn(7, first, 100) for first in range(0, 1000, 100)]
    assert (np.concatenate(parts, axis=1) == whole).all()


def test_moments_of_many_keys() -> None:
    rng = np.random.default_rng(0)
    n, keys = 200_000, 20
    scores = []
    for key in rng.integers(2**64, size=keys, dtype=np.uint64):
        a, b = drawn(int(key), 0, n).astype(float)
        for x in (a, b):
            scores += [
                x.mean() * np.sqrt(n),
                (x.var() - 1.0) * np.sqrt(n / 2),
                (x**3).mean() * np.sqrt(n / 15),
                ((x**4).mean() - 3.0) * np.sqrt(n / 96),
                (x[1:] * x[:-1]).mean() * np.sqrt(n),
            ]
        scores.append((a * b).mean() * np.sqrt(n))
    assert np.abs(scores).max() < SIGMAS
    # and all of them together are what scores should be
    assert abs(np.mean(np.square(scores)) - 1.0) < SIGMAS * np.sqrt(2 / len(scores))


def test_distribution() -> None:
    x = np.sort(drawn(99, 0, 500_000).ravel().astype(float))
    steps = (np.arange(x.size) + 0.5) / x.size
    # Kolmogorov's bound for 5 standard errors
    assert np.abs(stats.norm.cdf(x) - steps).max() * np.sqrt(x.size) < 2.8
    for far in (3.0, 4.0):
        expected = x.size * 2 * stats.norm.sf(far)
        assert abs((np.abs(x) > far).sum() - expected) < SIGMAS * np.sqrt(expected)


def test_the_ends_of_the_uniforms_are_finite() -> None:
    u = np.array([0.5 * 2.0**-31, 1.5 * 2.0**-31, 1.0 - 2.0**-24, 1.0], np.float32)
    v = np.array([-0.5, 0.5, 0.0, 0.25], np.float32)
    work = np.empty((2, 4), np.float32)
    a, b = np.empty(4, np.float32), np.empty(4, np.float32)
    _exponents(u.view(np.int32), work[0], work[1].view(np.int32))
    _box_muller(work[0], work[1], v, a, b)
    assert np.hypot(a, b) == pytest.approx(np.sqrt(-2 * np.log(u.astype(float))), abs=1e-4)
    assert a[:2] == pytest.approx(-np.sqrt(-2 * np.log(u[:2].astype(float))), rel=1e-5)
