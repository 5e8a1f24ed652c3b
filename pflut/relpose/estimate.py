"""The maximum-likelihood relative pose: the grid's maximum, polished."""

from __future__ import annotations

import numpy as np

from pflut.correspondences import Correspondences
from pflut.geometry import TWO_PI, FloatArray, wrap_to_pi
from pflut.likelihood.table import LikelihoodTable, bearing_columns
from pflut.posterior import GridPosterior, Likelihood, pose_posterior
from pflut.relpose.judgement import judged, widened
from pflut.relpose.refine import DEFAULT_LOSS, refine_headings
from pflut.relpose.result import RelativePose
from pflut.relpose.search import estimate_relative_poses

DEFAULT_NOISE = 0.01
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
    and polished with an M-estimator (`refine_relative_pose`: the planar epipolar residual, positive
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
    tutorial with application to conic fitting", 1997.
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
    columns, first = bearing_columns(correspondences), np.array([0, len(correspondences)])
    loss = DEFAULT_LOSS if polish else None
    headings = np.array([posterior.mode()])
    headings, covariance = refine_headings(columns, first, headings, loss, noise)
    inliers, success = judged(columns, first, headings, noise)
    log_evidence = posterior.log_evidence
    return RelativePose(
        heading_l=float(wrap_to_pi(headings[0, 0])),
        heading_r=float(wrap_to_pi(headings[0, 1])),
        covariance=widened(covariance, np.array([band_variance(posterior, headings[0])]))[0],
        log_likelihood=float(posterior.log_prob.max())
        + log_evidence
        + 2.0 * float(np.log(posterior.bins)),
        log_evidence=log_evidence,
        num_inliers=int(inliers[0]),
        success=bool(success[0]),
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
