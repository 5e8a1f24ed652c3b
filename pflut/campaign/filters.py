"""The filters that campaigns compare: pflut's, and the baselines at their best."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from pflut.campaign.course import Course
from pflut.likelihood.table import LikelihoodTable
from pflut.localization.dead_reckoning import DeadReckoning
from pflut.localization.extended_kalman_filter import ExtendedKalmanFilter
from pflut.localization.localizer import Filter
from pflut.localization.particle_filter import ParticleFilter
from pflut.localization.relative_pose_model import RelativePoseModel
from pflut.localization.unscented_kalman_filter import UnscentedKalmanFilter
from pflut.relpose.search import estimate_relative_poses
from pflut.replay.filters import make_filter, make_motion, start_covariance
from pflut.replay.options import ReplayOptions
from pflut.replay.sensor import ReplaySensor
from pflut.replay.tables import choose_table

#: By name, with what each is.
FILTERS = {
    "pflut": "the particle filter with the likelihood table of the options",
    "paper": "the particle filter with the paper's table",
    "ransac": "the particle filter with RANSAC's relative poses as Gaussians",
    "ekf-ransac": "an extended Kalman filter on RANSAC's relative poses",
    "ekf-ml": "the same on relative poses of maximum likelihood",
    "ukf-ransac": "an unscented Kalman filter on RANSAC's relative poses",
    "ukf-ml": "the same on relative poses of maximum likelihood",
    "odometry": "odometry alone, from the true start",
}


def make_named_filter(name: str, course: Course, options: ReplayOptions) -> Filter:
    """Make a filter, and start it as the course says.

    Parameters
    ----------
    name : str
        One of `FILTERS`.
    course : Course
    options : ReplayOptions
        With the seed.

    Returns
    -------
    Filter

    Raises
    ------
    ValueError
        If there is no such filter.
    """
    if name not in FILTERS:
        raise ValueError(f"filter: expected one of {', '.join(FILTERS)}, got {name!r}")
    if name == "odometry":
        return _started(DeadReckoning(make_motion(options)), course, options, known=True)
    table_name = "dense" if name == "paper" else options.table
    camera = None if course.extractor is None else course.extractor.camera
    table = choose_table(table_name, bins=options.bins, camera=camera)
    sensor = ReplaySensor(
        course.reference_map, table, course.extractor, options, cache=course.cache
    )
    if name in ("pflut", "paper"):
        return _started(make_filter(sensor, options, course.bounds), course, options)
    kind, _, estimator = name.rpartition("-")
    model = RelativePoseModel(sensor)
    if estimator == "ml":
        if not isinstance(table, LikelihoodTable):
            raise ValueError(f"filter: {name} expects a residual table, got {options.table}")
        model = RelativePoseModel(sensor, partial(estimate_relative_poses, table=table))
    if not kind:
        # recovery asks the references by the table here, too: better than anything of its own
        pf = make_filter(model, options, course.bounds, proposing=sensor)
        return _started(pf, course, options)
    kalman = {"ekf": ExtendedKalmanFilter, "ukf": UnscentedKalmanFilter}[kind]
    return _started(kalman(make_motion(options), model), course, options)


def _started(pf: Any, course: Course, options: ReplayOptions, *, known: bool = False) -> Filter:
    """Start a filter at the truth, about, or lost."""
    if not known and course.start == "lost":
        lost = pf.initialize_uniform if isinstance(pf, ParticleFilter) else pf.initialize_lost
        lost(course.bounds)
        return pf  # type: ignore[no-any-return]
    assert course.drive.ground_truth is not None
    covariance = start_covariance(options)
    truth = course.drive.ground_truth[course.drive.query_indices[0]]
    # as well known as it is said to be
    rng = np.random.default_rng([options.seed, 3])
    offset = rng.standard_normal(3) * np.sqrt(covariance.diagonal())
    pf.initialize_gaussian(truth if known else truth + offset, covariance)
    return pf  # type: ignore[no-any-return]
