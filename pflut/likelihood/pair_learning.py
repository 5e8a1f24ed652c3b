"""Count the correspondences of real pairs with known relative pose."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pflut.correspondences import Correspondences
from pflut.geometry import FloatArray, wrap_to_2pi
from pflut.likelihood.axes import parallax_lookup
from pflut.likelihood.counts import BAND_PER_MEDIAN, FAR, Counts, far_cells
from pflut.likelihood.residual_kernels import coordinates, count_true, describe, mean_parallax

Pair = tuple[Correspondences, float, float]

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
        If there is not one correspondence.
    """
    kept = [pair for pair in pairs if len(pair[0])]
    if not kept:
        raise ValueError("pairs: expected at least one pair with at least one correspondence")
    lookup = parallax_lookup()
    for _, *pose in kept:
        if not np.isfinite(pose).all():
            raise ValueError(f"pairs: expected finite headings, got {pose}")
    headings = np.array([[wrap_to_2pi(left), wrap_to_2pi(right)] for _, left, right in kept])
    lengths = np.array([len(correspondences) for correspondences, _, _ in kept])
    weights = pose_weights(headings, lengths) if compensate else np.ones(len(kept))
    slopes = [as_slopes(correspondences) for correspondences, _, _ in kept]
    band = BAND_PER_MEDIAN * 0.6745 * noise
    means = []
    for pair, pose in zip(slopes, headings, strict=True):
        bearings = np.empty((len(pair), 8))
        describe(pair, bearings)
        means.append(mean_parallax(bearings, pose[0], pose[1], lookup, band))
    edges = np.quantile(means, np.arange(1, num_classes) / num_classes)
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


def pose_weights(headings: FloatArray, lengths: FloatArray) -> FloatArray:
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
    cells = np.minimum((headings / (2 * np.pi) * POSE_CELLS).astype(np.int64), POSE_CELLS - 1)
    frequency = np.zeros((POSE_CELLS, POSE_CELLS))
    np.add.at(frequency, (cells[:, 0], cells[:, 1]), lengths)
    # a pair, its mirror image and its exchange are counted alike, so their poses are alike
    frequency = frequency + frequency.T
    frequency = frequency + frequency[::-1, ::-1]
    weights = 1.0 / frequency[cells[:, 0], cells[:, 1]]
    return np.asarray(weights * (lengths.sum() / (weights @ lengths)))


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
