"""The decorators of compiled kernels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])

# STUMPY's set: everything that lets a sum be vectorised, without `nnan` and `ninf`,
# because log(0) = -inf and isnan() must keep their meaning.
FASTMATH = {"nsz", "arcp", "contract", "afn", "reassoc"}

_kernels: list[Any] = []


def jit(function: F, **more: Any) -> F:
    """Compile a kernel: cached on disk, GIL released, IEEE division, serial.

    Parameters
    ----------
    function : callable
        The kernel: arrays and scalars in, caller-allocated arrays out, no Python objects.
        It may call kernels of its own file, and those of `_trig`, `_lanes`, `_random`,
        `_robust`, `_cells` and `von_mises._components`, only: Numba's cache does not notice a
        change in a callee of another file (numba#1833).
    **more
        Further options of `numba.njit`.

    Returns
    -------
    callable
        The dispatcher; it compiles at its first call, never at import.
    """
    options = {"nogil": True, "fastmath": FASTMATH, "error_model": "numpy", **more}
    try:
        compiled: F = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # no folder for the cache can be written: a read-only install
        compiled = numba.njit(**options)(function)
    _kernels.append(compiled)
    return compiled


def compiled_here() -> bool:
    """Say whether this process has compiled a kernel, instead of reading it from the cache.

    The last digits of what such a kernel computes may be others. It calls the copies of its callees
    that were compiled by themselves; one that is read from the cache brings its own copies, which
    were optimized together with it.

    Returns
    -------
    bool
    """
    return any(sum(kernel.stats.cache_misses.values()) for kernel in _kernels)


def inline(function: F) -> F:
    """Compile a kernel into the loop of the kernel that calls it.

    Parameters
    ----------
    function : callable
        As of `jit`. Many arrays are passed by many numbers, which costs more than a short loop.

    Returns
    -------
    callable
        The dispatcher.
    """
    return jit(function, forceinline=True)
