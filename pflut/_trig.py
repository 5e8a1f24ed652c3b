"""A fast arctangent for kernels.

The one kernel that other files' kernels call. Numba's cache does not notice a change in a callee
of another file (numba#1833), so whoever edits this file deletes the cache (``NUMBA_CACHE_DIR`` or
``__pycache__``).
"""

from __future__ import annotations

import numpy as np

from pflut._jit import jit

HALF_PI = 0.5 * np.pi


def _arctan_coefficients(degree: int = 9) -> tuple[float, ...]:
    """Fit arctan(t) / t as a polynomial in t^2 on [0, 1], at Chebyshev nodes."""
    nodes = 0.5 - 0.5 * np.cos(np.pi * (np.arange(200) + 0.5) / 200)
    t = np.sqrt(nodes)
    fit = np.polynomial.Chebyshev.fit(nodes, np.arctan(t) / t, degree, domain=[0, 1])
    return tuple(float(c) for c in fit.convert(kind=np.polynomial.Polynomial).coef)


_C0, _C1, _C2, _C3, _C4, _C5, _C6, _C7, _C8, _C9 = _arctan_coefficients()


@jit
def fast_arctan2(y, x):  # type: ignore[no-untyped-def]
    """Arctangent of y / x in (-pi, pi] without a branch, to 2e-9 rad; 0 at the origin.

    A loop over it is vectorised: about a tenth of the time of the C library's.
    """
    across, along = abs(y), abs(x)
    larger = max(across, along)
    t = min(across, along) / larger if larger > 0.0 else 0.0
    q = t * t
    p = _C9 * q + _C8
    p = p * q + _C7
    p = p * q + _C6
    p = p * q + _C5
    p = p * q + _C4
    p = p * q + _C3
    p = p * q + _C2
    p = p * q + _C1
    angle = (p * q + _C0) * t
    angle = HALF_PI - angle if across > along else angle
    angle = np.pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle
