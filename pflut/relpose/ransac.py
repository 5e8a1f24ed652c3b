"""RANSAC and an M-estimator: the baselines that the likelihood is compared with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pflut.correspondences import Correspondences
from pflut.likelihood.table import pair_columns
from pflut.relpose.eight_point import eight_point_poses
from pflut.relpose.judgement import INLIER_CUTOFF
from pflut.relpose.ransac_kernels import search_many
from pflut.relpose.refine import DEFAULT_LOSS, check_loss, refined_poses
from pflut.relpose.result import RelativePose, no_pose

SAMPLE_SIZES = {"2pt": 2, "3pt": 3, "8pt": 8}
SCORINGS = ("msac", "inliers")

Options = tuple[float, int, bool, bool, float, bool]


def ransac_relative_pose(
    correspondences: Correspondences,
    *,
    solver: str = "2pt",
    threshold: float | None = None,
    max_iterations: int = 1000,
    scoring: str = "msac",
    local_optimization: bool = True,
    confidence: float | None = None,
    gate_samples: bool = True,
    loss: str | None = DEFAULT_LOSS,
    noise: float = 0.01,
    rng: np.random.Generator | int | None = 0,
) -> RelativePose:
    """Estimate the relative pose of two views by a RANSAC and an M-estimator.

    Samples of a few correspondences give poses; the one that most correspondences agree with, with
    positive depths, is polished by iteratively reweighted least squares. It needs no table and
    knows no posterior: of a scene with two answers it gives one.

    The planar solvers take each correspondence for one constraint that is linear in the sines and
    cosines of both headings. Two of them leave a plane of solutions, which meets the headings' two
    unit circles in up to two points: the curves of two correspondences cross twice. The depths'
    signs tell most, not all, of the second answers. Where there are fewer pairs of correspondences
    than ``max_iterations``, "2pt" tries every pair once.

    Parameters
    ----------
    correspondences : Correspondences
        Between the reference view L and the query view R.
    solver : {"2pt", "3pt", "8pt"}
        Correspondences a sample: two, which determine the planar pose, three, whose linear solution
        ignores that sine and cosine belong together, or eight, which determine a pose that need not
        be planar: views may roll and pitch, and it is polished in all its five angles. Of it the
        headings are given.
    threshold : float, optional
        Largest residual of a correspondence that agrees, radians. Default: three times the noise.
    max_iterations : int
        Samples to draw.
    scoring : {"msac", "inliers"}
        What agreeing is worth: less for a larger residual (truncated squares), or all the same.
    local_optimization : bool
        Whether to move each new best pose to the minimum near it before the next sample.
    confidence : float, optional
        Stop when a sample without a mismatch has been drawn with this probability, judged by the
        best pose so far. By default all iterations are made.
    gate_samples : bool
        Whether planar samples hold only correspondences whose bearings lie on one side of the
        horizon: others agree with no pose, and of mismatches they are half.
    loss : {"cauchy", "huber", "tukey"}, optional
        The M-estimator's, see `refine_relative_pose`. ``None`` for none: the pose stays as it is,
        and its covariance is of what agrees with it within three standard deviations.
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
    estimation under planar motion", IVC 69, 2018 (the planar solvers). R. Hartley, "In defense of
    the eight-point algorithm", PAMI 19(6), 1997.
    """
    return ransac_relative_poses(
        [correspondences],
        solver=solver,
        threshold=threshold,
        max_iterations=max_iterations,
        scoring=scoring,
        local_optimization=local_optimization,
        confidence=confidence,
        gate_samples=gate_samples,
        loss=loss,
        noise=noise,
        rng=rng,
    )[0]


def ransac_relative_poses(
    pairs: Sequence[Correspondences],
    *,
    solver: str = "2pt",
    threshold: float | None = None,
    max_iterations: int = 1000,
    scoring: str = "msac",
    local_optimization: bool = True,
    confidence: float | None = None,
    gate_samples: bool = True,
    loss: str | None = DEFAULT_LOSS,
    noise: float = 0.01,
    rng: np.random.Generator | int | None = 0,
) -> list[RelativePose]:
    """Estimate the relative poses of many pairs of views, each as `ransac_relative_pose` does.

    Parameters
    ----------
    pairs : sequence of Correspondences
        Each between a reference view L and a query view R.
    solver, threshold, max_iterations, scoring, local_optimization, confidence, gate_samples, loss
        See `ransac_relative_pose`.
    noise, rng
        See `ransac_relative_pose`. Each pair has random numbers of its own: of the seed, and of
        its bearings.

    Returns
    -------
    list of RelativePose
        One a pair.

    Raises
    ------
    ValueError
        As `ransac_relative_pose`.
    """
    if isinstance(pairs, Correspondences):
        raise ValueError("pairs: expected a sequence of Correspondences, got those of one pair")
    sample_size = SAMPLE_SIZES.get(solver, 0)
    options = _checked(
        solver,
        threshold,
        max_iterations,
        scoring,
        local_optimization,
        confidence,
        gate_samples,
        loss,
        noise,
    )
    seed = np.random.default_rng(rng).integers(0, 2**64, size=1, dtype=np.uint64)
    columns, first = pair_columns(pairs)
    # the kernels' counter wraps around on purpose; without the compiler NumPy would warn of it
    with np.errstate(over="ignore"):
        if solver == "8pt":
            return eight_point_poses(columns, first, seed, options, loss, noise)
        headings, iterations = np.empty((len(pairs), 2)), np.empty(len(pairs), np.int64)
        search_many(columns, first, seed, sample_size, options, headings, iterations)
    poses = refined_poses(columns, first, headings, loss, noise)
    return [pose if found > 0 else no_pose() for pose, found in zip(poses, iterations, strict=True)]


def _checked(
    solver: str,
    threshold: float | None,
    max_iterations: int,
    scoring: str,
    local_optimization: bool,
    confidence: float | None,
    gate_samples: bool,
    loss: str | None,
    noise: float,
) -> Options:
    """Refuse options out of range, and give the kernels'."""
    for name, value, known in (("solver", solver, SAMPLE_SIZES), ("scoring", scoring, SCORINGS)):
        if value not in known:
            raise ValueError(f"{name}: expected one of {', '.join(known)}, got {value!r}")
    check_loss(loss or DEFAULT_LOSS, noise)
    threshold = INLIER_CUTOFF * noise if threshold is None else threshold
    if not 0.0 < threshold < np.pi / 2:
        raise ValueError(f"threshold: expected radians in (0, pi/2), got {threshold}")
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
        bool(gate_samples),
    )
