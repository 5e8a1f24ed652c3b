"""The general 8-point RANSAC, of which the planar headings are given."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray, wrap_to_pi
from pflut.relpose.eight_point_kernels import SAMPLE_SIZE, estimate_many
from pflut.relpose.judge_kernels import log_false_alarms
from pflut.relpose.judgement import LOG_FALSE_ALARMS, SHIFTS
from pflut.relpose.refine import CUTOFFS, DEFAULT_LOSS, LOSSES, STEPS_PER_CUTOFF
from pflut.relpose.result import UNIFORM_VARIANCE, RelativePose, no_pose

DEGREES_OF_FREEDOM = 5


def eight_point_poses(
    columns: FloatArray,
    first: NDArray[np.int64],
    seed: NDArray[np.uint64],
    options: tuple[float, int, bool, bool, float, bool],
    loss: str | None,
    noise: float,
) -> list[RelativePose]:
    """Estimate the poses of many pairs by samples of eight, and polish all five angles.

    Parameters
    ----------
    columns : ndarray of shape (8, n)
        Sines and cosines of all pairs' bearings, see `bearing_columns`.
    first : ndarray of shape (p + 1,)
        Where each pair's columns begin, and the last one's end.
    seed : ndarray of shape (1,)
    options : tuple
        Of `ransac_kernels.search`.
    loss : str, optional
        The M-estimator's; ``None`` for none.
    noise : float
        Standard deviation of the bearings, radians.

    Returns
    -------
    list of RelativePose
        ``success`` is False where fewer agree than a sample has, or no more than coincidence would
        bring to a pose of five angles.
    """
    pairs, chosen = len(first) - 1, LOSSES[loss or DEFAULT_LOSS]
    # without a loss the same kernel, standing still, counts the inliers and weighs them
    cutoffs = noise * (CUTOFFS if loss else CUTOFFS[-1:])
    steps = STEPS_PER_CUTOFF if loss else 0
    headings = np.empty((pairs, 2))
    counts = np.empty((3, pairs), np.int64)
    squares = np.empty(pairs)
    information, slopes = np.empty((pairs, 5, 5)), np.empty((pairs, 2, 5))
    estimate_many(
        columns,
        first,
        seed,
        options,
        (chosen.code, chosen.knee * noise, cutoffs, steps),
        SHIFTS,
        headings,
        (*counts, squares, information, slopes),
    )
    headings = wrap_to_pi(headings)
    poses = []
    for k in range(pairs):
        iterations, inliers, agreeing = counts[:, k].tolist()
        if iterations <= 0 or inliers == 0:
            poses.append(no_pose())
            continue
        total = int(first[k + 1] - first[k])
        share = agreeing / (total * min(SHIFTS, total - 1))
        alarms = log_false_alarms(inliers, total, share, float(cutoffs[-1]), DEGREES_OF_FREEDOM)
        redundancy = chosen.spread * (inliers - DEGREES_OF_FREEDOM)
        covariance: FloatArray = np.eye(2) * UNIFORM_VARIANCE
        if redundancy > 0.0:
            variance = max(squares[k] / redundancy, noise**2)
            spread = variance * np.linalg.pinv(information[k], hermitian=True)
            known = np.linalg.inv(slopes[k] @ spread @ slopes[k].T + 1e-18 * np.eye(2))
            covariance = np.asarray(np.linalg.inv(known + np.eye(2) / UNIFORM_VARIANCE))
        success = inliers > SAMPLE_SIZE and alarms < LOG_FALSE_ALARMS
        heading_l, heading_r = headings[k].tolist()
        poses.append(
            RelativePose(heading_l, heading_r, covariance, 0.0, 0.0, inliers, bool(success))
        )
    return poses
