"""The maximum-likelihood relative pose, from coarse to fine, of many pairs at once."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from pflut._robust import TUKEY
from pflut.correspondences import Correspondences
from pflut.geometry import TWO_PI, FloatArray, rotation_from_headings, wrap_to_pi
from pflut.likelihood.residual_kernels import PairArrays, maximize, score
from pflut.likelihood.table import LikelihoodTable, pair_columns
from pflut.relpose.judge_kernels import choose
from pflut.relpose.judgement import covariances, judged, widened
from pflut.relpose.refine_kernels import refine_many
from pflut.relpose.result import RelativePose

COARSE = {0.005: (80, 5), 0.0: (128, 8)}
"""Cells an axis of the grid in which candidates are looked for, and how many of them there are, by
the table's least noise."""
MARGIN = 10.0
"""Nats below a coarse grid's maximum at which a candidate is given up."""
CUTOFFS = (6.0, 3.0)
"""The biweight's cut-offs in standard deviations, from the grid's accuracy down to the noise's."""
STEPS_PER_CUTOFF = 2
CLIMBS = ((3, 2), (1, 8))
"""After a first step of all candidates, so many best ones of a pair climb so many steps."""
BAND = 0.04
"""Radians of the rotation within which poses count as one turn on the spot."""
BAND_MARGIN = 3.0
"""Nats below the estimate within which another pose makes its rotation's band worth a look."""
BAND_POSES = 24
PAIRS_A_TASK = 128


def estimate_relative_poses(
    pairs: Sequence[Correspondences],
    table: LikelihoodTable,
    *,
    noise: float | None = None,
    bins: int | None = None,
    candidates: int | None = None,
    num_threads: int = 1,
) -> list[RelativePose]:
    """Estimate the relative poses of many pairs of views by maximum likelihood.

    1. A coarse grid of log-likelihoods, in which a cell is much wider than the noise but knows of
       it: its highest local maxima are the candidates.
    2. Each candidate moves to the nearest minimum of the biweight of residuals.
    3. The likelihood is climbed from there by expectation maximization: least squares, weighted
       with the probability that a correspondence is a true match. The better a candidate, the
       farther it climbs; the highest one is the estimate.

    Parameters
    ----------
    pairs : sequence of Correspondences
        Each between a reference view L and a query view R.
    table : LikelihoodTable
    noise : float, optional
        Standard deviation of the bearings, radians. Default: as the table has learned it.
    bins : int, optional
        Cells an axis of the coarse grid. Default: 80, or 128 where the table's noise is below
        0.005 rad.
    candidates : int, optional
        Candidates a pair, at most. Default: 5, or 8 with such a table. How often a better pose is
        missed: docs/results.md.
    num_threads : int
        Threads over which pairs are spread.

    Returns
    -------
    list of RelativePose
        One a pair; ``success`` is False where the correspondences do not determine a pose.

    Raises
    ------
    ValueError
        If a parameter is out of its range.

    References
    ----------
    O. Booij, B. Krose, Z. Zivkovic, "Efficient probabilistic planar robot motion estimation given
    pairs of images", RSS 2010, section VI: multi-resolution. A. Dempster, N. Laird, D. Rubin,
    "Maximum likelihood from incomplete data via the EM algorithm", JRSS B 39(1), 1977.
    """
    noise = table.noise if noise is None else noise
    if not 0.0 < noise < np.pi / 2:
        raise ValueError(f"noise: expected radians in (0, pi/2), got {noise}")
    coarse, most = next(pair for least, pair in COARSE.items() if table.noise >= least)
    bins = coarse if bins is None else bins
    candidates = most if candidates is None else candidates
    for name, value in (("candidates", candidates), ("num_threads", num_threads)):
        if value < 1:
            raise ValueError(f"{name}: expected at least 1, got {value}")
    table.ridges(bins)  # made before threads would make them twice
    tasks = [pairs[i : i + PAIRS_A_TASK] for i in range(0, len(pairs), PAIRS_A_TASK)]

    def solve(task: Sequence[Correspondences]) -> list[RelativePose]:
        return _solve(task, table, noise, bins, candidates)

    if num_threads == 1 or len(tasks) <= 1:
        solved = [solve(task) for task in tasks]
    else:
        with ThreadPoolExecutor(num_threads) as pool:
            solved = list(pool.map(solve, tasks))
    return [pose for poses in solved for pose in poses]


def _solve(
    pairs: Sequence[Correspondences],
    table: LikelihoodTable,
    noise: float,
    bins: int,
    most: int,
) -> list[RelativePose]:
    """Estimate the poses of some pairs; see `estimate_relative_poses`."""
    columns, first = pair_columns(pairs)
    odds = _odds(pairs, table)
    shapes = table.shapes(columns)
    arrays = PairArrays(columns, shapes, odds, first)
    poses, _, owners, evidence = table.ridges(bins).candidates(
        columns, shapes, odds, first, margin=MARGIN, most=most
    )
    cutoffs, scratch = noise * np.array(CUTOFFS), np.empty((len(poses), 4))
    agreeing = np.empty(len(poses), np.int64)
    refine_many(
        columns, first, TUKEY, 0.0, cutoffs, STEPS_PER_CUTOFF, poses, owners, scratch, agreeing
    )
    values = np.empty(len(poses))
    information = np.empty((len(poses), 5))
    for count, steps in ((most, 1), *CLIMBS):
        chosen = np.arange(len(poses)) if count == most else _best(values, owners, count)
        climbing, found, known = poses[chosen], np.empty(len(chosen)), np.empty((len(chosen), 5))
        maximize(arrays, climbing, owners[chosen], steps, table.arrays, found, known)
        poses[chosen], values[chosen], information[chosen] = climbing, found, known
    # the last of them are one a pair, in the pairs' order
    headings = wrap_to_pi(poses[chosen])
    inliers, success = judged(columns, first, headings, noise)
    owner = np.repeat(np.arange(len(pairs)), np.diff(first))
    constant = np.bincount(owner, np.log1p(odds), minlength=len(pairs))
    known = information[chosen]
    covariance = covariances(known, known[:, 3], known[:, 4] - 2.0, noise)
    covariance = widened(covariance, _band_variances(arrays, table, poses, values, owners, chosen))
    return [
        RelativePose(*row)
        for row in zip(
            headings[:, 0].tolist(),
            headings[:, 1].tolist(),
            covariance,
            (values[chosen] - constant).tolist(),
            evidence.tolist(),
            inliers.tolist(),
            success.tolist(),
            strict=True,
        )
    ]


def _odds(pairs: Sequence[Correspondences], table: LikelihoodTable) -> FloatArray:
    """Give the odds (n,) of all pairs' correspondences."""
    if table.quality is not None and any(pair.quality is not None for pair in pairs):
        return np.concatenate([table.odds(pair) for pair in pairs])
    return np.full(sum(map(len, pairs)), table.prior_odds)


def _best(values: FloatArray, owners: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Choose the ``count`` candidates of highest value of each pair, in the pairs' order."""
    out = np.empty(len(values), np.int64)
    return out[: choose(values, owners, count, out)]


def _band_variances(
    pairs: PairArrays,
    table: LikelihoodTable,
    poses: FloatArray,
    values: FloatArray,
    owners: NDArray[np.int64],
    chosen: NDArray[np.int64],
) -> FloatArray:
    """Give the variance of both headings over the poses of the estimate's own rotation.

    On a turn on the spot the poses of the right rotation are all alike, and yet noise makes some
    place of that band look best and its surroundings worse, so that the information would know the
    headings to a few degrees. Where another candidate lies in the band, the likelihood is looked at
    all along it.
    """
    best = poses[chosen][owners]
    rotation = rotation_from_headings(poses[:, 0], poses[:, 1])
    turned = wrap_to_pi(rotation - rotation_from_headings(best[:, 0], best[:, 1]))
    beside = (np.abs(turned) < BAND) & (values > values[chosen][owners] - BAND_MARGIN)
    beside[chosen] = False
    out = np.zeros(len(chosen))
    banded = np.flatnonzero(np.bincount(owners[beside], minlength=len(chosen)))
    if banded.size:
        away = np.arange(-BAND_POSES // 2, BAND_POSES // 2) * (TWO_PI / BAND_POSES)
        along = (poses[chosen[banded], None] + away[:, None]).reshape(-1, 2)
        scores = np.empty(len(along))
        score(pairs, along, np.repeat(banded, BAND_POSES), table.arrays, scores)
        rows = scores.reshape(-1, BAND_POSES)
        weight = np.exp(rows - rows.max(axis=1, keepdims=True))
        out[banded] = (weight * away**2).sum(axis=1) / weight.sum(axis=1)
    return out
