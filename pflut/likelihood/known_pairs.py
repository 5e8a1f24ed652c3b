"""Pairs of views with known relative pose, of which tables of either kind are learned."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pflut.correspondences import Correspondences
from pflut.geometry import FloatArray, wrap_to_2pi

Pair = tuple[Correspondences, float, float]
"""Correspondences with the true heading_l and heading_r, radians."""


def known_pairs(pairs: Iterable[Pair]) -> tuple[list[Pair], FloatArray, NDArray[np.int64]]:
    """Keep the pairs that have correspondences.

    Parameters
    ----------
    pairs : iterable of (Correspondences, heading_l, heading_r)

    Returns
    -------
    kept : list of the same
    headings : ndarray of shape (p, 2)
        Radians in [0, 2 pi).
    lengths : ndarray of shape (p,)
        Correspondences of each.

    Raises
    ------
    ValueError
        If there is not one correspondence, or a heading is not finite.
    """
    kept = [pair for pair in pairs if len(pair[0])]
    if not kept:
        raise ValueError("pairs: expected at least one pair with at least one correspondence")
    for _, *pose in kept:
        if not np.isfinite(pose).all():
            raise ValueError(f"pairs: expected finite headings, got {pose}")
    headings = np.array([[wrap_to_2pi(left), wrap_to_2pi(right)] for _, left, right in kept])
    return kept, headings, np.array([len(correspondences) for correspondences, _, _ in kept])


def pose_frequencies(headings: FloatArray, lengths: NDArray[np.int64], cells: int) -> FloatArray:
    """Count how many correspondences the relative pose of each pair has (Algorithm 2).

    Parameters
    ----------
    headings : ndarray of shape (p, 2)
        Radians in [0, 2 pi).
    lengths : ndarray of shape (p,)
        Correspondences of each pair.
    cells : int
        Of each heading, in which poses are alike.

    Returns
    -------
    ndarray of shape (p,)
        Of the cell, its mirror image and their exchanges, which tables count alike.
    """
    cell = np.minimum((headings / (2 * np.pi) * cells).astype(np.int64), cells - 1)
    frequency = np.zeros((cells, cells))
    np.add.at(frequency, (cell[:, 0], cell[:, 1]), lengths)
    frequency = frequency + frequency.T
    frequency = frequency + frequency[::-1, ::-1]
    return np.asarray(frequency[cell[:, 0], cell[:, 1]])


def as_slopes(correspondences: Correspondences) -> FloatArray:
    """Return correspondences as (n, 4): azimuth and tan(elevation) of L, then of R."""
    return np.stack(
        [
            correspondences.azimuth_l,
            np.tan(correspondences.elevation_l),
            correspondences.azimuth_r,
            np.tan(correspondences.elevation_r),
        ],
        axis=1,
    )
