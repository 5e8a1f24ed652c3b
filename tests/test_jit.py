"""The decorator of kernels: what it keeps of IEEE arithmetic, and where no cache can be written."""

from __future__ import annotations

import importlib

import numba
import numpy as np
import pytest

jit_module = importlib.import_module("pflut._jit")
compiled = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="the compiler is off")


@compiled
def test_nothing_is_compiled_before_the_first_call() -> None:
    kernel = jit_module.jit(lambda x: x + 1)
    assert not kernel.signatures
    assert kernel(1) == 2
    assert len(kernel.signatures) == 1


def test_nan_infinity_and_division_keep_their_meaning() -> None:
    """The fast-math flags must leave out nnan and ninf; a division by zero raises nothing."""

    @jit_module.jit
    def kernel(x, out):
        out[0] = np.log(x[0])
        out[1] = 1.0 if np.isnan(x[1]) else 0.0
        out[2] = 1.0 if np.isinf(x[2]) else 0.0
        out[3] = x[3] / x[0]

    out = np.zeros(4)
    with np.errstate(divide="ignore"):
        kernel(np.array([0.0, np.nan, -np.inf, 1.0]), out)
    assert out.tolist() == [-np.inf, 1.0, 1.0, np.inf]
    assert not jit_module.FASTMATH & {"nnan", "ninf", "fast"}


@compiled
def test_without_a_cache_folder_kernels_still_compile(monkeypatch: pytest.MonkeyPatch) -> None:
    njit = numba.njit

    def read_only(*args, cache=False, **options):
        if cache:

            def refuse(function):
                raise RuntimeError("cannot cache function: no locator available")

            return refuse
        return njit(*args, **options)

    monkeypatch.setattr(numba, "njit", read_only)
    assert jit_module.jit(lambda x: 2 * x)(21) == 42
