"""Count the correspondences of real pairs with known relative pose."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray
from pflut.likelihood.axes import parallax_lookup
from pflut.likelihood.counts import BAND_PER_MEDIAN, FAR, Counts, class_edges, far_cells
from pflut.likelihood.known_pairs import Pair, as_slopes, known_pairs, pose_frequencies
from pflut.likelihood.residual_kernels import coordinates, count_true

CHANCE_SAMPLES = 8_000_000
"""Random poses at which the mismatches of real pairs are met, all together."""
POSE_CELLS = 16
"""Cells of each heading in which the frequency of poses is counted."""


def count_pairs(
    pairs: Iterable[Pair],
    *,
    num_classes: int,
    noise: float,
    compensate: bool = True,
    quality_cells: int = 0,
    seed: int = 0,
) -> tuple[Counts, float, int]:
    """Count the correspondences of real pairs, each pose counting the same.

    Mismatches are made of the pairs' own bearings: the points of L with points of R that belong to
    other correspondences.

    Parameters
    ----------
    pairs : iterable of (Correspondences, heading_l, heading_r)
        With the true headings, radians.
    num_classes : int
        Depth classes.
    noise : float
        Standard deviation of the residuals, radians, about: of a table that is near.
    compensate : bool
        Whether to weight by one over the pose's frequency.
    quality_cells : int
        Cells of the quality's axis.
    seed : int

    Returns
    -------
    counts : Counts
    mismatch : float
        Share of mismatches.
    num_samples : int
        Correspondences used.

    Raises
    ------
    ValueError
        If there is not one correspondence, or a heading is not finite.
    """
    kept, headings, lengths = known_pairs(pairs)
    lookup = parallax_lookup()
    weights = pose_weights(headings, lengths) if compensate else np.ones(len(kept))
    slopes = [as_slopes(correspondences) for correspondences, _, _ in kept]
    band = BAND_PER_MEDIAN * 0.6745 * noise
    edges = class_edges(zip(headings, slopes, strict=True), band, num_classes)
    counts = Counts.zeros(num_classes, quality_cells)
    stream = np.random.default_rng(seed)
    total = sum(lengths)
    draws = int(np.ceil(CHANCE_SAMPLES / total))
    for (correspondences, _, _), pair, pose, weight in zip(
        kept, slopes, headings, weights, strict=True
    ):
        bearings = np.empty((len(pair), 8))
        count_true(
            pair[None],
            pose[None],
            np.array([weight]),
            lookup,
            band,
            edges,
            bearings,
            counts.inside,
            counts.profile,
            counts.seen,
        )
        if correspondences.quality is not None and quality_cells:
            _count_quality(correspondences.quality, bearings, pose, band, weight, counts.quality)
        mixed = pair.copy()
        mixed[:, 2:] = np.roll(pair[:, 2:], int(stream.integers(1, max(len(pair), 2))), axis=0)
        if len(pair) > 1:
            counts.add_chance(mixed, stream, draws, lookup, band)
    far = far_cells()
    share = counts.profile[:, far].sum() / counts.profile.sum()
    by_chance = counts.chance_profile[:, far].sum() / max(counts.chance_profile.sum(), 1.0)
    mismatch = float(np.clip(share / max(by_chance, 1e-9), 0.02, 0.98))
    return counts, mismatch, int(total)


def pose_weights(headings: FloatArray, lengths: NDArray[np.int64]) -> FloatArray:
    """Weigh pairs by one over the frequency of their relative pose (Algorithm 2).

    Parameters
    ----------
    headings : ndarray of shape (p, 2)
        Radians in [0, 2 pi).
    lengths : ndarray of shape (p,)
        Correspondences of each pair.

    Returns
    -------
    ndarray of shape (p,)
        The weighted number of correspondences is the number of them.
    """
    weights = 1.0 / pose_frequencies(headings, lengths, POSE_CELLS)
    return np.asarray(weights * (lengths.sum() / (weights @ lengths)))


def _count_quality(
    quality: FloatArray,
    bearings: FloatArray,
    pose: FloatArray,
    band: float,
    weight: float,
    out: FloatArray,
) -> None:
    """Count the quality of what agrees with the true pose, and of what is far from it."""
    slopes = np.empty(2)
    sines = np.sin(pose[0]), np.cos(pose[0]), np.sin(pose[1]), np.cos(pose[1])
    cells = out.shape[1]
    for bearing, value in zip(bearings, quality, strict=True):
        residual, _ = coordinates(bearing, *sines, slopes)
        cell = min(int(value * cells), cells - 1)
        if abs(residual) < band:
            out[0, cell] += weight
        elif abs(residual) > FAR:
            out[1, cell] += weight
