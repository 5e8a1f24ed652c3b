"""The M-estimator: the relative pose polished by iteratively reweighted least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pflut._robust import CAUCHY, HUBER, TUKEY
from pflut.correspondences import Correspondences
from pflut.geometry import FloatArray, wrap_to_pi
from pflut.likelihood.table import bearing_columns
from pflut.relpose.judgement import covariances, judged
from pflut.relpose.refine_kernels import refine_many
from pflut.relpose.result import RelativePose


@dataclass(frozen=True)
class Loss:
    """A loss of the M-estimator; angles in standard deviations of the noise.

    Parameters
    ----------
    code : int
        The kernels'.
    knee : float
        See `robust_weight`.
    spread : float
        Mean of w e^2 over sigma^2 for normal residuals e, of weight w, below the last cut-off.
    """

    code: int
    knee: float
    spread: float


CUTOFFS = np.array([6.0, 4.0, 3.0])
"""Standard deviations beyond which a residual counts nothing, from a first guess's accuracy down to
the noise's: at many mismatches a loss that lets all of them pull, be it ever so little, is lost."""
STEPS_PER_CUTOFF = 8
LOSSES = {
    "tukey": Loss(TUKEY, 0.0, 0.52),
    "huber": Loss(HUBER, 1.345, 0.81),
    "cauchy": Loss(CAUCHY, 2.385, 0.69),
}
"""The knees are those of 95 % efficiency with normal residuals."""
DEFAULT_LOSS = "cauchy"


def refine_relative_pose(
    correspondences: Correspondences,
    heading_l: float,
    heading_r: float,
    *,
    loss: str = DEFAULT_LOSS,
    noise: float = 0.01,
) -> RelativePose:
    """Polish a relative pose that is about right, by an M-estimator.

    Iteratively reweighted least squares on the planar epipolar residual: Gauss-Newton steps over
    both headings. Correspondences that would lie behind a view count nothing, nor do residuals
    beyond a cut-off that goes down to three standard deviations.

    Parameters
    ----------
    correspondences : Correspondences
        Between the reference view L and the query view R.
    heading_l, heading_r : float
        Where to start, radians: of odometry, or of another estimator. It finds its way from up to
        about six standard deviations of the noise.
    loss : {"cauchy", "huber", "tukey"}
        What a residual costs.
    noise : float
        Standard deviation of the bearings, radians; it sets the cut-offs and the knees.

    Returns
    -------
    RelativePose
        As of `ransac_relative_pose`.

    Raises
    ------
    ValueError
        If an option is none of those named or out of its range, or a heading is not finite.

    References
    ----------
    Z. Zhang, "Parameter estimation techniques: a tutorial with application to conic fitting", Image
    and Vision Computing 15(1), 1997.
    """
    check_loss(loss, noise)
    start = np.array([[heading_l, heading_r]], dtype=np.float64)
    if not np.isfinite(start).all():
        raise ValueError(f"heading_l, heading_r: expected finite radians, got {start[0].tolist()}")
    columns, first = bearing_columns(correspondences), np.array([0, len(correspondences)])
    return refined_poses(columns, first, start, loss, noise)[0]


def check_loss(loss: str, noise: float) -> None:
    """Refuse an unknown loss, and noise out of range."""
    if loss not in LOSSES:
        raise ValueError(f"loss: expected one of {', '.join(LOSSES)}, got {loss!r}")
    if not 0.0 < noise < np.pi / 2:
        raise ValueError(f"noise: expected radians in (0, pi/2), got {noise}")


def refine_headings(
    columns: FloatArray,
    first: NDArray[np.int64],
    headings: FloatArray,
    loss: str | None,
    noise: float,
) -> tuple[FloatArray, FloatArray]:
    """Polish a pose of each pair, see `refine_relative_pose`.

    Parameters
    ----------
    columns, first
        See `judged`.
    headings : ndarray of shape (p, 2)
        Where to start, radians.
    loss : str, optional
        ``None`` leaves the headings where they are, and weighs what agrees with them as the default
        loss does.
    noise : float

    Returns
    -------
    headings : ndarray of shape (p, 2)
    covariance : ndarray of shape (p, 2, 2)
    """
    chosen = LOSSES[loss or DEFAULT_LOSS]
    moved, pairs = headings.copy(), len(headings)
    information, inliers = np.empty((pairs, 4)), np.empty(pairs, np.int64)
    # without a loss the same kernel, standing still, weighs what agrees
    cutoffs = noise * (CUTOFFS if loss else CUTOFFS[-1:])
    steps = STEPS_PER_CUTOFF if loss else 1
    knee, owners = chosen.knee * noise, np.arange(pairs)
    refine_many(
        columns, first, chosen.code, knee, cutoffs, steps, moved, owners, information, inliers
    )
    redundancy = np.asarray(chosen.spread * (inliers - 2), dtype=np.float64)
    covariance = covariances(information, information[:, 3], redundancy, noise)
    return moved if loss else headings, covariance


def refined_poses(
    columns: FloatArray,
    first: NDArray[np.int64],
    headings: FloatArray,
    loss: str | None,
    noise: float,
) -> list[RelativePose]:
    """Polish a pose of each pair and judge it; of a likelihood it knows nothing."""
    headings, covariance = refine_headings(columns, first, headings, loss, noise)
    headings = wrap_to_pi(headings)
    inliers, success = judged(columns, first, headings, noise)
    rows = zip(headings.tolist(), covariance, inliers.tolist(), success.tolist(), strict=True)
    return [
        RelativePose(heading_l, heading_r, known, 0.0, 0.0, count, found)
        for (heading_l, heading_r), known, count, found in rows
    ]
