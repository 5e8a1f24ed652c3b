"""Algorithm 2: learn the density of (r, u, v) from simulated or real pairs of known pose."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray
from pflut.likelihood.dense_kernels import count
from pflut.likelihood.known_pairs import Pair, as_slopes, known_pairs, pose_frequencies
from pflut.likelihood.sampling import Progress, count_blocks
from pflut.simulation.correspondences import CorrespondenceSimulator

PAIRS_PER_BLOCK = 4096
CORRESPONDENCES_PER_PAIR = 16
BLOCK = PAIRS_PER_BLOCK * CORRESPONDENCES_PER_PAIR


def count_simulated(
    simulator: CorrespondenceSimulator,
    bins: int,
    num_samples: int,
    *,
    seed: int = 0,
    num_threads: int | None = None,
    progress: Progress | None = None,
) -> NDArray[np.int64]:
    """Histogram simulated correspondences over (r, u, v).

    Every block of samples has a random stream of its own and the counts are integers, so the
    result depends on the seed and the number of samples, never on the threads.

    Parameters
    ----------
    simulator : CorrespondenceSimulator
    bins : int
        Cells an axis.
    num_samples : int
        Correspondences, rounded up to whole blocks of 65,536.
    seed : int
    num_threads : int, optional
        Default: every core that the process may use.
    progress : callable, optional
        Called as ``progress(samples_done, samples_total)``.

    Returns
    -------
    ndarray of shape (bins, bins, bins)
        Counts over (r, u, v).
    """
    num_blocks = -(-int(num_samples) // BLOCK)
    unit = np.ones(PAIRS_PER_BLOCK, np.uint32)

    def work(block: int, histogram: NDArray[np.uint32]) -> None:
        stream = np.random.default_rng([seed, block])
        headings, bearings = simulator.sample_slopes(
            PAIRS_PER_BLOCK, CORRESPONDENCES_PER_PAIR, stream
        )
        count(headings, bearings, unit, histogram)

    counted = count_blocks(
        num_blocks,
        lambda: np.zeros((bins, bins, bins), np.uint32),
        work,
        num_threads=num_threads,
        progress=None
        if progress is None
        else lambda done, total: progress(done * BLOCK, total * BLOCK),
    )
    total = np.zeros((bins, bins, bins), np.int64)
    for histogram in counted:
        total += histogram
    return total


def count_pairs(
    pairs: Iterable[Pair], bins: int, *, compensate: bool = True
) -> tuple[FloatArray, int]:
    """Histogram the correspondences of real pairs over (r, u, v), each pose counting the same.

    Real data has some relative poses more often than others; each sample is weighted by one over
    the frequency of its pose's cell (Algorithm 2).

    Parameters
    ----------
    pairs : iterable of (Correspondences, heading_l, heading_r)
        With the true headings, radians.
    bins : int
        Cells an axis.
    compensate : bool
        Whether to weight by the pose's frequency.

    Returns
    -------
    histogram : ndarray of shape (bins, bins, bins)
    num_samples : int
        Correspondences used.

    Raises
    ------
    ValueError
        If there is not one correspondence, or a heading is not finite.
    """
    kept, headings, lengths = known_pairs(pairs)
    weights = 1.0 / pose_frequencies(headings, lengths, bins) if compensate else np.ones(len(kept))
    histogram = np.zeros((bins, bins, bins))
    for (correspondences, _, _), pose, weight in zip(kept, headings, weights, strict=True):
        count(pose[None], as_slopes(correspondences)[None], np.array([weight]), histogram)
    return histogram, int(lengths.sum())


def log_ratio_from_counts(
    histogram: NDArray[np.int64] | FloatArray, *, uniform: float, blur: float = 0.0
) -> NDArray[np.float32]:
    """Turn a histogram into the table: log of p(u, v | r) over the uniform density.

    Parameters
    ----------
    histogram : ndarray of shape (R, B, B)
        Counts over (r, u, v).
    uniform : float
        Share in (0, 1) of correspondences that say nothing about the pose, their azimuths being
        uniform: it keeps empty cells from being impossible.
    blur : float
        Standard deviation in cells of a periodic Gaussian over (u, v), for small training sets.

    Returns
    -------
    ndarray of shape (R, B, B), float32
        Mirror-symmetric; a cell with the value 0 is as likely as if the azimuths were uniform.
    """
    bins = histogram.shape[1]
    density = np.asarray(histogram, dtype=np.float64)
    # a mirrored scene is as likely: (u, v) and (-u, -v) are one sample
    density = density + np.roll(density[:, ::-1, ::-1], (1, 1), axis=(1, 2))
    if blur > 0.0:
        response = np.exp(-2.0 * (np.pi * blur * np.fft.fftfreq(bins)) ** 2)
        spectrum = np.fft.fft2(density) * response[:, None] * response[None, :]
        density = np.maximum(np.fft.ifft2(spectrum).real, 0.0)
    total = density.sum(axis=(1, 2), keepdims=True)
    ratio = density / np.where(total > 0.0, total, 1.0) * bins**2
    mixed = np.where(total > 0.0, (1.0 - uniform) * ratio + uniform, 1.0)
    return np.log(mixed).astype(np.float32)
