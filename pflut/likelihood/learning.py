"""Learn the residual table: correspondences at their true poses against mismatches at random ones.

The quotient of the two densities is the likelihood ratio of a true match to a mismatch. It is
learned as a product: the density ratio of all that agree with the pose over (depth class,
parallax, ratio, elevation), times the profile of the residual. No noise level enters; the profile
is the noise.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from pflut.correspondences import Correspondences
from pflut.geometry import FloatArray, wrap_to_2pi
from pflut.likelihood.axes import (
    ELEVATION_CELLS,
    PARALLAX_CELLS,
    RATIO_CELLS,
    RESIDUAL_CELLS,
    parallax_lookup,
    residual_nodes,
)
from pflut.likelihood.residual_kernels import (
    coordinates,
    count_chance,
    count_true,
    describe,
    mean_parallax,
)
from pflut.likelihood.sampling import Progress, count_blocks
from pflut.simulation.correspondences import CorrespondenceSimulator

Pair = tuple[Correspondences, float, float]

SHAPE_CELLS = RATIO_CELLS * ELEVATION_CELLS
PAIRS_PER_BLOCK = 512
CORRESPONDENCES_PER_PAIR = 64
BLOCK = PAIRS_PER_BLOCK * CORRESPONDENCES_PER_PAIR
PILOT_BLOCKS = 16
"""Blocks that settle the band and the depth classes before the counting."""
DRAWS = 4
"""Random poses at which a mismatch is met."""
BAND_PER_MEDIAN = 4.0
"""The band reaches to so many median residuals: 2.7 standard deviations of normal noise."""
FAR = 0.15
"""Radians; so large a residual is a mismatch's."""
PSEUDO_COUNT = 4.0
"""Mismatches added to every cell: what was hardly ever met is taken as no evidence."""
CHANCE_SAMPLES = 8_000_000
"""Random poses at which the mismatches of real pairs are met, all together."""
QUALITY_PRIOR = 50.0
"""Samples of neither kind that are added to the quality's counts."""
POSE_CELLS = 16
"""Cells of each heading in which the frequency of poses is counted."""


@dataclass(eq=False)
class Counts:
    """What was counted.

    Parameters
    ----------
    inside : ndarray of shape (C, PARALLAX_CELLS, SHAPE_CELLS)
        Samples at true poses with a residual within the band, by depth class.
    profile : ndarray of shape (ELEVATION_CELLS, RESIDUAL_CELLS + 1)
        Residuals of all of them; the last cell holds those beyond the axis.
    seen : ndarray of shape (C,)
        Samples of each depth class, within the band or not.
    chance_inside, chance_profile : ndarray
        The same of mismatches at random poses, without depth classes.
    quality : ndarray of shape (2, Q)
        Quality of the samples within the band, and of those far from it.
    """

    inside: FloatArray
    profile: FloatArray
    seen: FloatArray
    chance_inside: FloatArray
    chance_profile: FloatArray
    quality: FloatArray

    @classmethod
    def zeros(cls, num_classes: int, quality_cells: int = 0) -> Counts:
        """Return empty counts."""
        return cls(
            np.zeros((num_classes, PARALLAX_CELLS, SHAPE_CELLS)),
            np.zeros((ELEVATION_CELLS, RESIDUAL_CELLS + 1)),
            np.zeros(num_classes),
            np.zeros((PARALLAX_CELLS, SHAPE_CELLS)),
            np.zeros((ELEVATION_CELLS, RESIDUAL_CELLS + 1)),
            np.zeros((2, quality_cells)),
        )

    def add(self, other: Counts) -> None:
        """Add other counts to these."""
        for name, value in vars(other).items():
            getattr(self, name).__iadd__(value)


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
    edges = _class_edges(pilot, band, num_classes)

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
        _count_chance(slopes, stream, DRAWS, lookup, band, counts)

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


def _count_chance(
    slopes: FloatArray,
    stream: np.random.Generator,
    draws: int,
    lookup: np.ndarray,
    band: float,
    counts: Counts,
) -> None:
    state = stream.integers(0, 2**64, size=1, dtype=np.uint64)
    with np.errstate(over="ignore"):
        count_chance(
            slopes,
            state,
            draws,
            lookup,
            band,
            np.empty((len(slopes), 8)),
            counts.chance_inside,
            counts.chance_profile,
        )


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


def _class_edges(
    pairs: list[tuple[FloatArray, FloatArray]], band: float, num_classes: int
) -> FloatArray:
    """Give the quantiles of the pairs' mean parallax between the depth classes."""
    lookup = parallax_lookup()
    means = []
    for headings, slopes in pairs:
        bearings = np.empty((slopes.shape[1], 8))
        for pose, pair in zip(headings, slopes, strict=True):
            describe(pair, bearings)
            means.append(mean_parallax(bearings, pose[0], pose[1], lookup, band))
    return np.asarray(np.quantile(means, np.arange(1, num_classes) / num_classes))


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
            _count_chance(mixed, stream, draws, lookup, band, counts)
    far = _far_cells()
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
    mismatches = far.sum() / max(counts.chance_profile[:, _far_cells()].sum(), 1.0)
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


def _far_cells() -> np.ndarray:
    """Say which cells of the residual are far from any pose that is right."""
    return np.append(residual_nodes()[:-1] >= FAR, True)


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
