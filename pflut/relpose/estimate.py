"""The maximum-likelihood relative pose: the grid's maximum, polished."""

from __future__ import annotations

from math import log

import numpy as np

from pflut.correspondences import Correspondences
from pflut.geometry import TWO_PI, FloatArray, wrap_to_pi
from pflut.likelihood.table import LikelihoodTable, bearing_columns
from pflut.posterior import GridPosterior, Likelihood, pose_posterior
from pflut.relpose.kernels import judge, refine
from pflut.relpose.result import UNIFORM_VARIANCE, RelativePose
from pflut.relpose.search import MAX_FALSE_ALARMS, MIN_INLIERS, SHIFTS, estimate_relative_poses

CUTOFFS = np.array([6.0, 4.0, 3.0])
"""The biweight's cut-offs in standard deviations, from the grid's accuracy down to the noise's."""
STEPS_PER_CUTOFF = 8
DEFAULT_NOISE = 0.01
BIWEIGHT_SPREAD = 0.52
"""Mean of w e^2 over sigma^2 for normal residuals e and the biweight w cut off at 3 sigma."""
BAND = np.arange(-2, 3)
"""Cells on both sides of the poses of one rotation that count to its band."""
BASIN = 4
"""Cells around the estimate along the band that its own covariance speaks for."""


def estimate_relative_pose(
    correspondences: Correspondences,
    likelihood: Likelihood,
    *,
    noise: float | None = None,
    polish: bool = True,
    posterior: GridPosterior | None = None,
) -> RelativePose:
    """Estimate the relative pose of two views by maximum likelihood.

    With a `LikelihoodTable`, `estimate_relative_poses` of the one pair. With the paper's table, or
    where a posterior is given, the maximum of the posterior's grid, interpolated between the cells
    and polished with an M-estimator (Tukey's biweight on the planar epipolar residual, positive
    depths only), which removes the discretization error.

    Parameters
    ----------
    correspondences : Correspondences
        Between the reference view L and the query view R.
    likelihood : LikelihoodTable or DenseTable
    noise : float, optional
        Standard deviation of the bearings, radians; it sets the M-estimator's cut-offs. Where the
        real one is larger the cut-offs hide it, and the covariance is too small. Default: as the
        table has learned it; 0.01 with the paper's table, which does not tell it.
    polish : bool
        Whether to polish the grid's maximum.
    posterior : GridPosterior, optional
        Of these correspondences; its maximum is then the starting point.

    Returns
    -------
    RelativePose
        ``success`` is False where the correspondences do not determine a pose.

    Raises
    ------
    ValueError
        If the noise is not positive.

    References
    ----------
    O. Booij, B. Krose, Z. Zivkovic, "Efficient probabilistic planar robot motion estimation given
    pairs of images", RSS 2010, sections III and IV. Z. Zhang, "Parameter estimation techniques: a
    tutorial with application to conic fitting", 1997 (the biweight).
    """
    if isinstance(likelihood, LikelihoodTable):
        if polish and posterior is None:
            return estimate_relative_poses([correspondences], likelihood, noise=noise)[0]
        noise = likelihood.noise if noise is None else noise
    noise = DEFAULT_NOISE if noise is None else noise
    if not 0.0 < noise < np.pi / 2:
        raise ValueError(f"noise: expected radians in (0, pi/2), got {noise}")
    if posterior is None:
        posterior = pose_posterior(correspondences, likelihood)
    headings = np.array(posterior.mode())
    information = np.zeros(4)
    # without polish the same kernel, standing still, counts the inliers and weighs them
    moved = headings.copy()
    cutoffs = noise * (CUTOFFS if polish else CUTOFFS[:1])
    steps = STEPS_PER_CUTOFF if polish else 1
    columns = bearing_columns(correspondences)
    inliers = refine(columns, cutoffs, steps, moved, information)
    if polish:
        headings = moved
    log_evidence = posterior.log_evidence
    counted, alarms = np.empty(1, np.int64), np.empty(1)
    first = np.array([0, len(correspondences)])
    judge(columns, first, headings[None], cutoffs[-1], SHIFTS, counted, alarms)
    return RelativePose(
        heading_l=float(wrap_to_pi(headings[0])),
        heading_r=float(wrap_to_pi(headings[1])),
        covariance=_widened(
            _covariance(information, inliers, noise), band_variance(posterior, headings)
        ),
        log_likelihood=float(posterior.log_prob.max())
        + log_evidence
        + 2.0 * float(np.log(posterior.bins)),
        log_evidence=log_evidence,
        num_inliers=int(counted[0]),
        success=bool(counted[0] >= MIN_INLIERS and alarms[0] < log(MAX_FALSE_ALARMS)),
    )


def band_variance(posterior: GridPosterior, headings: FloatArray) -> float:
    """Return the variance of both headings along the band of poses of one rotation.

    On a turn on the spot the poses of the right rotation are all alike, and yet noise makes some
    place of that band look best and its surroundings worse, so that the M-estimator's information
    would know the headings to a few degrees. The posterior knows of the rest of the band.

    Parameters
    ----------
    posterior : GridPosterior
    headings : ndarray of shape (2,)
        The estimate, radians.

    Returns
    -------
    float
        Radians squared, of the mass on the band and beyond the estimate's own basin; about zero
        where the posterior has one mode.
    """
    bins = posterior.bins
    cell = TWO_PI / bins
    columns = np.arange(bins)
    shift = int(np.rint((headings[0] - headings[1]) / cell))
    band = posterior.log_prob[(columns + shift + BAND[:, None]) % bins, columns]
    weight = np.exp(band - band.max()).sum(axis=0)
    away = wrap_to_pi(posterior.centers - headings[1])
    away[np.abs(away) < BASIN * cell] = 0.0
    return float(weight @ away**2 / weight.sum())


def _widened(covariance: FloatArray, band: float) -> FloatArray:
    """Add the variance along the band, bounded by that of uniform angles."""
    return covariance + min(band, UNIFORM_VARIANCE - float(covariance.diagonal().max()))


def _covariance(information: FloatArray, inliers: int, noise: float) -> FloatArray:
    """Invert the information at the residuals' spread, bounded by that of uniform angles."""
    prior = np.eye(2) / UNIFORM_VARIANCE
    if inliers <= 2:
        return np.eye(2) * UNIFORM_VARIANCE
    a, b, c, squares = information
    # noise is a floor: few inliers may agree by luck
    variance = max(squares / (BIWEIGHT_SPREAD * (inliers - 2)), noise**2)
    covariance: FloatArray = np.linalg.inv(np.array([[a, b], [b, c]]) / variance + prior)
    return covariance
