"""The maximum-likelihood relative pose: the grid's maximum, polished."""

from __future__ import annotations

from math import exp, lgamma, log, log1p

import numpy as np

from pflut.correspondences import Correspondences
from pflut.geometry import TWO_PI, FloatArray, wrap_to_pi
from pflut.posterior import GridPosterior, Likelihood, pose_posterior
from pflut.relpose.kernels import chance_share, refine
from pflut.relpose.result import RelativePose

CUTOFFS = np.array([6.0, 4.0, 3.0])
"""The biweight's cut-offs in standard deviations, from the grid's accuracy down to the noise's."""
STEPS_PER_CUTOFF = 8
MIN_INLIERS = 3
UNIFORM_VARIANCE = np.pi**2 / 3.0
BIWEIGHT_SPREAD = 0.52
"""Mean of w e^2 over sigma^2 for normal residuals e and the biweight w cut off at 3 sigma."""
SHIFTS = 16
"""Certain mismatches looked at a correspondence, to measure what coincidence brings."""
MAX_FALSE_ALARMS = 0.01
BAND = np.arange(-2, 3)
"""Cells on both sides of the poses of one rotation that count to its band."""
BASIN = 4
"""Cells around the estimate along the band that its own covariance speaks for."""


def bearing_table(correspondences: Correspondences) -> FloatArray:
    """Return (n, 8): sine and cosine of azimuth_l, elevation_l, azimuth_r, elevation_r."""
    angles = (
        correspondences.azimuth_l,
        correspondences.elevation_l,
        correspondences.azimuth_r,
        correspondences.elevation_r,
    )
    return np.stack([f(a) for a in angles for f in (np.sin, np.cos)], axis=1)


def estimate_relative_pose(
    correspondences: Correspondences,
    likelihood: Likelihood,
    *,
    noise: float = 0.01,
    polish: bool = True,
    posterior: GridPosterior | None = None,
) -> RelativePose:
    """Estimate the relative pose of two views by maximum likelihood.

    The maximum of the posterior's grid, interpolated between the cells and polished with an
    M-estimator (Tukey's biweight on the planar epipolar residual, positive depths only), which
    removes the discretization error.

    Parameters
    ----------
    correspondences : Correspondences
        Between the reference view L and the query view R.
    likelihood : LikelihoodTable
    noise : float
        Standard deviation of the bearings, radians; it sets the M-estimator's cut-offs. Where the
        real one is larger the cut-offs hide it, and the covariance is too small.
    polish : bool
        Whether to polish.
    posterior : GridPosterior, optional
        Of these correspondences, where it is known already.

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
    bearings = bearing_table(correspondences)
    inliers = refine(bearings, cutoffs, steps, moved, information)
    if polish:
        headings = moved
    log_evidence = posterior.log_evidence
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
        num_inliers=int(inliers),
        success=inliers >= MIN_INLIERS
        and _is_no_coincidence(bearings, headings, inliers, cutoffs[-1]),
    )


def _is_no_coincidence(
    bearings: FloatArray, headings: FloatArray, inliers: int, cutoff: float
) -> bool:
    """Tell whether coincidence would not bring as many inliers to any pose."""
    total = len(bearings)
    share = chance_share(bearings, cutoff, headings[0], headings[1], min(SHIFTS, total - 1))
    return log_false_alarms(inliers, total, share, cutoff) < log(MAX_FALSE_ALARMS)


def log_false_alarms(inliers: int, total: int, share: float, cutoff: float) -> float:
    """Return the log of the number of poses expected to have as many inliers by coincidence.

    The a-contrario test: the binomial tail of ``inliers`` out of ``total`` at the chance
    ``share``, times the number of poses that differ, one every ``2 cutoff`` along each heading.

    Parameters
    ----------
    inliers, total : int
    share : float
        Probability that a mismatch agrees with a pose.
    cutoff : float
        Largest residual of an inlier, radians.

    Returns
    -------
    float
        Below zero, coincidence would bring less than one such pose.

    References
    ----------
    L. Moisan, B. Stival, "A probabilistic criterion to detect rigid point matches between two
    images and estimate the fundamental matrix", IJCV 57(3), 2004.
    """
    poses = 2.0 * log(np.pi / cutoff)
    share = min(max(share, 1.0 / (SHIFTS * max(total, 1))), 1.0 - 1e-9)
    terms = [
        lgamma(total + 1)
        - lgamma(k + 1)
        - lgamma(total - k + 1)
        + k * log(share)
        + (total - k) * log1p(-share)
        for k in range(inliers, total + 1)
    ]
    largest = max(terms)
    return poses + largest + log(sum(exp(term - largest) for term in terms))


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
