"""The one decorator of every compiled kernel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])

# STUMPY's set: everything that lets a sum be vectorised, without `nnan` and `ninf`,
# because log(0) = -inf and isnan() must keep their meaning.
FASTMATH = {"nsz", "arcp", "contract", "afn", "reassoc"}


def jit(function: F) -> F:
    """Compile a kernel: cached on disk, GIL released, IEEE division, serial.

    Parameters
    ----------
    function : callable
        The kernel: arrays and scalars in, caller-allocated arrays out, no Python objects.
        It may call kernels of its own file only, because Numba's cache does not notice a
        change in a callee of another file (numba#1833).

    Returns
    -------
    callable
        The dispatcher; it compiles at its first call, never at import.
    """
    options = {"nogil": True, "fastmath": FASTMATH, "error_model": "numpy"}
    try:
        compiled: F = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # no folder for the cache can be written: a read-only install
        compiled = numba.njit(**options)(function)
    return compiled
