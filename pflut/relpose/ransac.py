"""The planar RANSAC: the baseline that the likelihood is compared with."""

from __future__ import annotations

from math import log

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.correspondences import Correspondences
from pflut.geometry import FloatArray, wrap_to_pi
from pflut.likelihood.table import bearing_columns
from pflut.relpose.estimate import BIWEIGHT_SPREAD, CUTOFFS, STEPS_PER_CUTOFF
from pflut.relpose.kernels import judge
from pflut.relpose.ransac_kernels import ransac_batch
from pflut.relpose.result import UNIFORM_VARIANCE, RelativePose
from pflut.relpose.search import MAX_FALSE_ALARMS, MIN_INLIERS, SHIFTS

SAMPLE_SIZES = {"2pt": 2, "3pt": 3}
SCORINGS = ("msac", "inliers")

Options = tuple[float, int, bool, bool, float]


def ransac_relative_pose(
    correspondences: Correspondences,
    *,
    solver: str = "2pt",
    threshold: float = 0.03,
    max_iterations: int = 1000,
    scoring: str = "msac",
    local_optimization: bool = True,
    confidence: float | None = None,
    noise: float = 0.01,
    rng: np.random.Generator | int | None = 0,
) -> RelativePose:
    """Estimate the relative pose of two views by a planar RANSAC and an M-estimator.

    Samples of two or three correspondences give poses; the one that most correspondences agree
    with, with positive depths, is polished as `estimate_relative_pose` does. It needs no table and
    knows no posterior: of a scene with two answers it gives one.

    Correspondences whose bearings lie on different sides of the horizon agree with no pose and are
    not drawn. Where there are fewer pairs of the others than ``max_iterations``, "2pt" tries every
    pair once.

    Parameters
    ----------
    correspondences : Correspondences
        Between the reference view L and the query view R.
    solver : {"2pt", "3pt"}
        Correspondences a sample: two, which determine the pose, or three, whose linear solution
        ignores that sine and cosine belong together.
    threshold : float
        Largest residual of a correspondence that agrees, radians; three times the noise is best.
    max_iterations : int
        Samples to draw.
    scoring : {"msac", "inliers"}
        What agreeing is worth: less for a larger residual (truncated squares), or all the same.
    local_optimization : bool
        Whether to move each new best pose to the minimum near it before the next sample.
    confidence : float, optional
        Stop when a sample without a mismatch has been drawn with this probability, judged by the
        best pose so far. By default all iterations are made.
    noise : float
        Standard deviation of the bearings, radians; it sets the M-estimator's cut-offs.
    rng : numpy.random.Generator or int, optional
        The samples' random numbers.

    Returns
    -------
    RelativePose
        ``success`` is False where no more correspondences agree than coincidence would bring. The
        covariance is that of the M-estimator alone: on a turn on the spot, where the headings are
        not determined, it is too small. There is no likelihood: ``log_likelihood`` and
        ``log_evidence`` are 0, which speaks neither for nor against.

    Raises
    ------
    ValueError
        If an option is none of those named, or out of its range.

    References
    ----------
    M. Fischler, R. Bolles, "Random sample consensus", CACM 24(6), 1981. P. Torr, A. Zisserman,
    "MLESAC", CVIU 78(1), 2000 (truncated squares). O. Chum, J. Matas, J. Kittler, "Locally
    optimized RANSAC", DAGM 2003. S. Choi, J.-H. Kim, "Fast and reliable minimal relative pose
    estimation under planar motion", IVC 69, 2018 (the planar solvers).
    """
    options = _checked(
        solver, threshold, max_iterations, scoring, local_optimization, confidence, noise
    )
    columns = bearing_columns(correspondences)
    bearings = np.ascontiguousarray(columns.T)
    headings, information, counts = _run(bearings[None], SAMPLE_SIZES[solver], options, noise, rng)
    inliers, alarms = counts[0, :1].copy(), np.empty(1)
    cutoff = noise * float(CUTOFFS[-1])
    if inliers[0]:  # else there is no model, and on the horizon any pose agrees
        judge(columns, np.array([0, len(bearings)]), headings, cutoff, SHIFTS, inliers, alarms)
    return RelativePose(
        heading_l=float(wrap_to_pi(headings[0, 0])),
        heading_r=float(wrap_to_pi(headings[0, 1])),
        covariance=_covariance(information[0], int(inliers[0]), noise),
        log_likelihood=0.0,
        log_evidence=0.0,
        num_inliers=int(inliers[0]),
        success=bool(inliers[0] >= MIN_INLIERS and alarms[0] < log(MAX_FALSE_ALARMS)),
    )


def ransac_headings(
    bearings: ArrayLike,
    *,
    solver: str = "2pt",
    threshold: float = 0.03,
    max_iterations: int = 1000,
    scoring: str = "msac",
    local_optimization: bool = True,
    confidence: float | None = None,
    noise: float = 0.01,
    rng: np.random.Generator | int | None = 0,
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Estimate the headings of many pairs of views at once, for experiments and timing.

    As `ransac_relative_pose`, whose options it takes, without covariance and test of success.

    Parameters
    ----------
    bearings : array_like of shape (pairs, n, 4)
        ``[azimuth_l, elevation_l, azimuth_r, elevation_r]``, radians, as
        `CorrespondenceSimulator.sample` gives them.
    solver, threshold, max_iterations, scoring, local_optimization, confidence, noise, rng
        See `ransac_relative_pose`.

    Returns
    -------
    headings : ndarray of shape (pairs, 2)
        ``[heading_l, heading_r]``, radians in (-pi, pi]; 0 where there is no model.
    counts : ndarray of shape (pairs, 2)
        Numbers of inliers and of iterations.

    Raises
    ------
    ValueError
        As `ransac_relative_pose`, or if the bearings have another shape or are not finite.
    """
    options = _checked(
        solver, threshold, max_iterations, scoring, local_optimization, confidence, noise
    )
    angles = np.asarray(bearings, dtype=np.float64)
    if angles.ndim != 3 or angles.shape[2] != 4:
        raise ValueError(f"bearings: expected shape (pairs, n, 4), got {angles.shape}")
    if not np.isfinite(angles).all():
        raise ValueError("bearings: expected finite numbers")
    table = np.stack([np.sin(angles), np.cos(angles)], axis=3).reshape(*angles.shape[:2], 8)
    headings, _, counts = _run(table, SAMPLE_SIZES[solver], options, noise, rng)
    return wrap_to_pi(headings), counts


def _checked(
    solver: str,
    threshold: float,
    max_iterations: int,
    scoring: str,
    local_optimization: bool,
    confidence: float | None,
    noise: float,
) -> Options:
    """Refuse options out of range, and give the kernel's."""
    for name, value, known in (("solver", solver, SAMPLE_SIZES), ("scoring", scoring, SCORINGS)):
        if value not in known:
            raise ValueError(f"{name}: expected one of {', '.join(known)}, got {value!r}")
    for name, angle in (("threshold", threshold), ("noise", noise)):
        if not 0.0 < angle < np.pi / 2:
            raise ValueError(f"{name}: expected radians in (0, pi/2), got {angle}")
    if not 1 <= max_iterations < 2**31 or max_iterations != int(max_iterations):
        raise ValueError(f"max_iterations: expected a positive integer, got {max_iterations}")
    if confidence is not None and not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence: expected a probability in (0, 1), got {confidence}")
    return (
        float(threshold),
        int(max_iterations),
        scoring == "msac",
        bool(local_optimization),
        float(confidence or 0.0),
    )


def _run(
    bearings: FloatArray,
    sample_size: int,
    options: Options,
    noise: float,
    rng: np.random.Generator | int | None,
) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """Give the headings, the information and the counts of all pairs."""
    pairs = len(bearings)
    headings, information = np.empty((pairs, 2)), np.empty((pairs, 4))
    counts = np.empty((pairs, 2), np.int64)
    state = np.random.default_rng(rng).integers(0, 2**64, size=1, dtype=np.uint64)
    # the counter wraps around on purpose; without the compiler NumPy would warn of it
    with np.errstate(over="ignore"):
        ransac_batch(
            bearings,
            sample_size,
            options,
            noise * CUTOFFS,
            STEPS_PER_CUTOFF,
            state,
            headings,
            information,
            counts,
        )
    return headings, information, counts


def _covariance(information: FloatArray, inliers: int, noise: float) -> FloatArray:
    """Invert the M-estimator's information, bounded by the covariance of uniform angles."""
    if inliers < MIN_INLIERS:
        return np.eye(2) * UNIFORM_VARIANCE
    a, b, c, squares = information
    variance = max(squares / (BIWEIGHT_SPREAD * (inliers - 2)), noise**2)
    prior = np.eye(2) / UNIFORM_VARIANCE
    covariance: FloatArray = np.linalg.inv(np.array([[a, b], [b, c]]) / variance + prior)
    return covariance
