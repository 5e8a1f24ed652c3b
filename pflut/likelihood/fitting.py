"""Turn counts into the densities of the residual table."""

from __future__ import annotations

import numpy as np

from pflut.geometry import FloatArray
from pflut.likelihood.axes import ELEVATION_CELLS, RATIO_CELLS, RESIDUAL_CELLS
from pflut.likelihood.counts import Counts, far_cells

PSEUDO_COUNT = 4.0
"""Mismatches added to every cell: what was hardly ever met is taken as no evidence."""
QUALITY_PRIOR = 50.0
"""Samples of neither kind that are added to the quality's counts."""


def fit(
    counts: Counts,
    mismatch: float = 0.0,
    *,
    prior: tuple[np.ndarray, np.ndarray] | None = None,
    prior_samples: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Turn counts into densities.

    Parameters
    ----------
    counts : Counts
    mismatch : float
        Share of the samples at true poses that are mismatches after all.
    prior : (density, profile), optional
        Of a table that fills what the counts do not say.
    prior_samples : float
        True matches that the prior counts as.

    Returns
    -------
    density : ndarray of shape (PARALLAX_CELLS, SHAPE_CELLS, C), float32
        In each depth class, how many times as often a true match within the band falls into the
        cell as a mismatch at a random pose does.
    profile : ndarray of shape (ELEVATION_CELLS, RESIDUAL_CELLS + 1), float32
        How many times as often a true match of the cell has the residual, at
        `axes.residual_nodes`; so scaled that its mean within the band is that of chance.
    """
    # pairs of one correspondence each have no mismatches to be made of them
    num_chance = max(counts.chance_profile.sum(), 1.0)
    chance = (counts.chance_inside + PSEUDO_COUNT) / num_chance
    true = counts.inside - mismatch * counts.seen[:, None, None] * counts.chance_inside / num_chance
    true = np.moveaxis(np.maximum(true, 0.0), 0, -1)
    num_true = (1.0 - mismatch) * counts.seen
    if prior is not None:
        # the share of true matches within the band is the prior's if nothing else is known
        true = true + prior_samples * prior[0] * chance[:, :, None]
        num_true = num_true + prior_samples
    density = true / np.maximum(num_true, 1.0) / chance[:, :, None]

    by_chance = counts.chance_profile / num_chance
    residuals = counts.profile - mismatch * counts.profile.sum() * by_chance
    residuals = np.maximum(residuals, 0.0)
    inside = _by_elevation(counts.inside.sum(axis=0))
    chance_inside = _by_elevation(counts.chance_inside) / num_chance
    inside = np.maximum(inside - mismatch * counts.profile.sum() * chance_inside, 0.0)
    if prior is not None:
        # the bearings of a few pairs do not meet every residual: chance spreads as it does in all
        by_chance = chance_inside[:, None] * by_chance.sum(axis=0) / max(chance_inside.sum(), 1e-12)
        residuals = np.where(far_cells(), 0.0, residuals)
    scale = chance_inside / np.maximum(inside, 1e-9)
    cells = residuals / np.maximum(by_chance, 0.5 / num_chance) * scale[:, None]
    cells = np.where(inside[:, None] > 0.0, cells, 0.0)[:, :RESIDUAL_CELLS]
    nodes = np.zeros((ELEVATION_CELLS, RESIDUAL_CELLS + 1))
    nodes[:, 0] = cells[:, 0]
    nodes[:, 1:-1] = 0.5 * (cells[:, 1:] + cells[:, :-1])
    if prior is not None:
        # few samples of one elevation: all elevations together, and then the prior
        weight = inside / (inside + prior_samples / ELEVATION_CELLS)
        together = (inside @ nodes) / max(inside.sum(), 1e-9)
        known = inside.sum() / (inside.sum() + prior_samples / ELEVATION_CELLS)
        filled = known * together + (1.0 - known) * prior[1]
        nodes = weight[:, None] * nodes + (1.0 - weight[:, None]) * filled
    return density.astype(np.float32), nodes.astype(np.float32)


def _by_elevation(counts: FloatArray) -> FloatArray:
    """Sum counts (PARALLAX_CELLS, SHAPE_CELLS) but for the elevation."""
    together = counts.sum(axis=0).reshape(RATIO_CELLS, ELEVATION_CELLS).sum(axis=0)
    return np.asarray(together, dtype=np.float64)


def quality_ratio(counts: Counts) -> np.ndarray | None:
    """Turn the counts of qualities into the ratio of true matches to mismatches.

    Parameters
    ----------
    counts : Counts

    Returns
    -------
    ndarray of shape (Q,), float32, or None
        None if nothing had a quality. Never increasing: a better score is no worse evidence.
    """
    inside, far = counts.quality
    if not inside.sum() or not far.sum():
        return None
    # mismatches that are within the band by chance
    by_chance = counts.chance_inside.sum() / max(counts.chance_profile.sum(), 1.0)
    mismatches = far.sum() / max(counts.chance_profile[:, far_cells()].sum(), 1.0)
    mismatches *= counts.chance_profile.sum()
    true = np.maximum(inside - mismatches * by_chance * far / far.sum(), 0.0)
    prior = (true + far) / (true + far).sum() * QUALITY_PRIOR
    met = np.flatnonzero(prior)
    ratio = ((true + prior) / (true.sum() + QUALITY_PRIOR))[met]
    ratio /= ((far + prior) / (far.sum() + QUALITY_PRIOR))[met]
    # a score that was never met, as beyond the ratio test's limit, is worth what those near it are
    ratio = np.interp(np.arange(len(far)), met, ratio)
    return _decreasing(ratio, true + far + prior + 1e-9).astype(np.float32)


def _decreasing(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Give the nearest sequence that never increases: pool adjacent violators."""
    blocks: list[list[float]] = []
    for value, weight in zip(values, weights, strict=True):
        blocks.append([value, weight, 1.0])
        while len(blocks) > 1 and blocks[-1][0] > blocks[-2][0]:
            value_b, weight_b, count_b = blocks.pop()
            value_a, weight_a, count_a = blocks[-1]
            both = weight_a + weight_b
            mean = (value_a * weight_a + value_b * weight_b) / max(both, 1e-300)
            blocks[-1] = [mean, both, count_a + count_b]
    return np.concatenate([np.full(int(count), value) for value, _, count in blocks])
