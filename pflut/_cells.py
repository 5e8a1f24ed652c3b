"""Hash tables of cells of (x, y, heading): only the occupied ones cost, however large the map is.

Whoever edits this file deletes Numba's cache: it does not notice that kernels of other files call
these (``find pflut -name "*.nb[ci]" -delete``).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pflut._jit import jit

EMPTY = -1
COORDINATE_MASK = 0x3FFFFFF
"""x and y have 26 bits of a key, the heading has 8."""


def empty_table(entries: int) -> NDArray[np.int64]:
    """Give an empty table, a power of two in size, that stays sparse with so many entries.

    Parameters
    ----------
    entries : int

    Returns
    -------
    ndarray of int64
    """
    return np.full(1 << (4 * entries).bit_length(), EMPTY, dtype=np.int64)


@jit
def cell_key(x: int, y: int, h: int) -> int:
    """Pack a cell's coordinates, none of them negative, into one number."""
    return (((x << 26) | y) << 8) | h


@jit
def find_cell(x: int, y: int, h: int, keys: NDArray[np.int64]) -> int:
    """Give a cell's place in a hash table, or the empty place where it belongs."""
    key = cell_key(x, y, h)
    mask = keys.shape[0] - 1
    place: int = ((x * 73856093) ^ (y * 19349663) ^ (h * 83492791)) & mask
    while keys[place] != EMPTY and keys[place] != key:
        place = (place + 1) & mask
    return place


@jit
def heading_cell(heading: float, cells: int) -> int:
    """Give the sector, of so many equal ones, that an angle in radians lies in."""
    turn = heading * (1.0 / (2.0 * np.pi))
    turn -= np.floor(turn)
    return min(int(turn * cells), cells - 1)
