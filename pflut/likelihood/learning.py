"""Learn the residual table: correspondences at their true poses against mismatches at random ones.

The quotient of the two densities is the likelihood ratio of a true match to a mismatch. It is
learned as a product: the density ratio of all that agree with the pose over (depth class,
parallax, ratio, elevation), times the profile of the residual. No noise level enters; the profile
is the noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pflut.geometry import FloatArray
from pflut.likelihood.axes import parallax_lookup, residual_nodes
from pflut.likelihood.counts import BAND_PER_MEDIAN, FAR, Counts, class_edges
from pflut.likelihood.residual_kernels import count_true
from pflut.likelihood.sampling import Progress, count_blocks
from pflut.simulation.correspondences import CorrespondenceSimulator

PAIRS_PER_BLOCK = 512
CORRESPONDENCES_PER_PAIR = 64
BLOCK = PAIRS_PER_BLOCK * CORRESPONDENCES_PER_PAIR
PILOT_BLOCKS = 16
"""Blocks that settle the band and the depth classes before the counting."""
DRAWS = 4
"""Random poses at which a mismatch is met."""


def count_simulated(
    simulator: CorrespondenceSimulator,
    num_samples: int,
    *,
    num_classes: int,
    seed: int = 0,
    num_threads: int | None = None,
    progress: Progress | None = None,
) -> Counts:
    """Count simulated correspondences, half of them true matches and half mismatches.

    Every block has a random stream of its own and counts are whole numbers, so the result depends
    on the seed and the number of samples, never on the threads.

    Parameters
    ----------
    simulator : CorrespondenceSimulator
        Its mismatch share is not used here.
    num_samples : int
        Rounded up to whole blocks.
    num_classes : int
        Depth classes.
    seed : int
    num_threads : int, optional
    progress : callable, optional
        Called as ``progress(samples_done, samples_total)``.

    Returns
    -------
    Counts
    """
    lookup = parallax_lookup()
    true, false = (replace(simulator, mismatch=share) for share in (0.0, 1.0))
    weights = np.ones(PAIRS_PER_BLOCK)
    pilot = [
        true.sample_slopes(
            PAIRS_PER_BLOCK, CORRESPONDENCES_PER_PAIR, np.random.default_rng([seed, 1, i])
        )
        for i in range(PILOT_BLOCKS)
    ]
    band = _band_of(pilot)
    pairs = (pair for block in pilot for pair in zip(*block, strict=True))
    edges = class_edges(pairs, band, num_classes)

    def work(block: int, counts: Counts) -> None:
        stream = np.random.default_rng([seed, 0, block])
        headings, slopes = true.sample_slopes(PAIRS_PER_BLOCK, CORRESPONDENCES_PER_PAIR, stream)
        bearings = np.empty((CORRESPONDENCES_PER_PAIR, 8))
        count_true(
            slopes,
            headings,
            weights,
            lookup,
            band,
            edges,
            bearings,
            counts.inside,
            counts.profile,
            counts.seen,
        )
        _, slopes = false.sample_slopes(PAIRS_PER_BLOCK // DRAWS, CORRESPONDENCES_PER_PAIR, stream)
        slopes = slopes.reshape(-1, 4)
        counts.add_chance(slopes, stream, DRAWS, lookup, band)

    num_blocks = -(-int(num_samples) // (2 * BLOCK))
    counted = count_blocks(
        num_blocks,
        lambda: Counts.zeros(num_classes),
        work,
        num_threads=num_threads,
        progress=None
        if progress is None
        else lambda done, total: progress(2 * done * BLOCK, 2 * total * BLOCK),
    )
    total = Counts.zeros(num_classes)
    for counts in counted:
        total.add(counts)
    return total


def _residuals(headings: FloatArray, slopes: FloatArray) -> FloatArray:
    """Give the profile counts of pairs at their true poses, all elevations together."""
    counts = Counts.zeros(1)
    count_true(
        slopes,
        headings,
        np.ones(len(slopes)),
        parallax_lookup(),
        0.0,
        np.empty(0),
        np.empty((slopes.shape[1], 8)),
        counts.inside,
        counts.profile,
        counts.seen,
    )
    return np.asarray(counts.profile.sum(axis=0))


def _band_of(pairs: list[tuple[FloatArray, FloatArray]]) -> float:
    """Give the band from the median residual of true matches, radians."""
    counted = sum(_residuals(*pair) for pair in pairs)
    return _band_from_residuals(np.asarray(counted))


def _band_from_residuals(counts: FloatArray) -> float:
    cumulative = np.cumsum(counts)
    median = np.interp(0.5 * cumulative[-1], cumulative[:-1], residual_nodes()[1:])
    return float(min(BAND_PER_MEDIAN * median, FAR))
