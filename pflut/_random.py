"""Random numbers for kernels: counter-based, of a state that the caller owns.

As with `_trig`, whoever edits this file deletes Numba's cache.
"""

from __future__ import annotations

import numpy as np

from pflut._jit import jit


@jit
def uniform(state):  # type: ignore[no-untyped-def]
    """Draw from [0, 1): splitmix64, a counter with a mixing function, cheap to start anywhere.

    ``state`` (1,) uint64, in and out.
    """
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return (z >> np.uint64(11)) * (1.0 / 9007199254740992.0)
