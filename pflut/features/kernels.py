"""Kernels of matching: the best two of a column, and Hamming distances."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut._jit import jit

Array = NDArray[Any]

# the constants of the bit-count below; LLVM recognizes the pattern as one instruction
_ODD = np.uint64(0x5555555555555555)
_PAIRS = np.uint64(0x3333333333333333)
_NIBBLES = np.uint64(0x0F0F0F0F0F0F0F0F)
_BYTES = np.uint64(0x0101010101010101)
_ONE, _TWO, _FOUR, _TOP = np.uint64(1), np.uint64(2), np.uint64(4), np.uint64(56)


@jit
def best_two(scores: Array, penalty: Array, best: Array, second: Array, index: Array) -> None:
    """Find each query feature's best two reference features; O(n m), rows streamed once.

    Parameters
    ----------
    scores : ndarray of shape (n, m), float32
        Reference features by query features; large is similar.
    penalty : ndarray of shape (n,), float32
        Taken off every score of a row: half the squared length of the row's descriptor.
    best, second : ndarray of shape (m,), float32
        Out: the largest and second-largest penalized scores; -inf where there is none.
    index : ndarray of shape (m,), int32
        Out: the row of the largest; of equal ones the first. -1 where there is none.
    """
    n, m = scores.shape
    best[:] = -np.inf
    second[:] = -np.inf
    index[:] = -1
    for i in range(n):
        off = penalty[i]
        for j in range(m):
            score = scores[i, j] - off
            # selections instead of branches, so that the loop is vectorized
            old = best[j]
            better = score > old
            second[j] = max(second[j], min(score, old))
            index[j] = np.int32(i) if better else index[j]
            best[j] = score if better else old


@jit
def best_in_row(scores: Array, penalty: Array, rows: Array, index: Array) -> None:
    """Find the best query feature of some reference features; O(k m).

    Parameters
    ----------
    scores : ndarray of shape (n, m), float32
        Reference features by query features.
    penalty : ndarray of shape (m,), float32
        Taken off every score of a column.
    rows : ndarray of shape (k,), int
        The reference features.
    index : ndarray of shape (k,), int32
        Out: the column of the largest penalized score; of equal ones the first.
    """
    for k in range(rows.size):
        row = scores[rows[k]]
        best, where = row[0] - penalty[0], 0
        for j in range(1, row.size):
            score = row[j] - penalty[j]
            if score > best:
                best, where = score, j
        index[k] = where


@jit
def hamming_scores(left: Array, right: Array, scores: Array) -> None:
    """Give minus half the Hamming distances, so that 0 - 2 score is the distance; O(n m w).

    Parameters
    ----------
    left : ndarray of shape (n, w), uint64
    right : ndarray of shape (m, w), uint64
    scores : ndarray of shape (n, m), float32
        Out.
    """
    for i in range(left.shape[0]):
        for j in range(right.shape[0]):
            count = np.uint64(0)
            for k in range(left.shape[1]):
                x = left[i, k] ^ right[j, k]
                x = x - ((x >> _ONE) & _ODD)
                x = (x & _PAIRS) + ((x >> _TWO) & _PAIRS)
                x = (x + (x >> _FOUR)) & _NIBBLES
                count += (x * _BYTES) >> _TOP
            scores[i, j] = np.float32(-0.5) * np.float32(count)
