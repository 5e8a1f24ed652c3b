"""Courses: a drive to be localized, through a home of landmarks or a rendered one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pflut.datasets.base import Dataset
from pflut.datasets.simulated_home import load_simulated_home
from pflut.features import FeatureCache, FeatureExtractor
from pflut.geometry import FloatArray, compose, relative_pose
from pflut.localization.initial_poses import Bounds
from pflut.localization.localizer import Drive
from pflut.reference_map import ReferenceMap
from pflut.replay.options import ReplayOptions
from pflut.replay.pipeline import make_extractor
from pflut.simulation.drive import apart
from pflut.simulation.landmark_drive import ODOMETRY_NOISE, scenario_named, simulate_drive
from pflut.simulation.odometry import simulate_odometry
from pflut.simulation.scenarios import SCENARIOS, Scenario

WORLDS = ("landmarks", "rendered")
RENDERED = ("tracking", "global", "kidnapped", "crowded", "sparse", "odometry")
"""The scenarios that a rendered home has."""
RENDERED_PEOPLE = 4
CARRIED = 3.0  # metres that a kidnapped robot is carried at least
IMAGES_AFTER = 20  # that it is given to find itself


@dataclass(frozen=True, eq=False)
class Course:
    """A drive and what a filter is given for it.

    Parameters
    ----------
    drive : Drive
        With ground truth and odometry.
    reference_map : ReferenceMap
    bounds : tuple (xmin, ymin, xmax, ymax)
        Metres: where the robot may be.
    start : str
        "truth" or "lost".
    home_seed : int
    kidnapped_at : int or None
        The first step after the robot was carried away.
    observations : callable, optional
        ``(index) -> observation``; by default the drive's images.
    extractor : FeatureExtractor, optional
        Of the images.
    cache : FeatureCache, optional
    """

    drive: Drive
    reference_map: ReferenceMap
    bounds: Bounds
    start: str
    home_seed: int
    kidnapped_at: int | None = None
    observations: Callable[[int], Any] | None = None
    extractor: FeatureExtractor | None = None
    cache: FeatureCache | None = None


def check_scenario(world: str, scenario: str) -> None:
    """Refuse a scenario that a world does not have.

    Raises
    ------
    ValueError
    """
    if world not in WORLDS:
        raise ValueError(f"world: expected one of {', '.join(WORLDS)}, got {world!r}")
    known = SCENARIOS if world == "landmarks" else RENDERED
    if scenario not in known:
        raise ValueError(
            f"scenario: expected one of {', '.join(known)} ({world}), got {scenario!r}"
        )


def landmark_course(scenario: str, seed: int, *, home_seed: int | None = None) -> Course:
    """Make a drive through a home of landmarks, see `simulate_drive`.

    Parameters
    ----------
    scenario : str
    seed : int
    home_seed : int, optional
    """
    drive = simulate_drive(scenario, seed, home_seed=home_seed)
    return Course(
        drive=drive,
        reference_map=ReferenceMap.of_poses(drive.reference_poses),
        bounds=drive.bounds,
        start=drive.scenario.start,
        home_seed=drive.home.seed,
        kidnapped_at=drive.kidnapped_at,
        observations=drive.observation,
    )


def rendered_course(
    scenario: str,
    seed: int,
    *,
    options: ReplayOptions,
    home_seed: int | None = None,
    motion_blur: float = 0.0,
    cached: bool = True,
) -> Course:
    """Make a drive through a rendered home, which is rendered if it was not before.

    Parameters
    ----------
    scenario : str
        One of `RENDERED`: what a scenario says of the matches the images decide here.
    seed : int
        Of the odometry; of the home and its drives too, without ``home_seed``.
    options : ReplayOptions
        Of the features.
    home_seed : int, optional
    motion_blur : float
        Seconds.
    cached : bool
        Whether features are looked up in, and added to, the user's cache.
    """
    check_scenario("rendered", scenario)
    chosen = scenario_named(scenario)
    home = seed if home_seed is None else home_seed
    people = RENDERED_PEOPLE if chosen.people else 0
    dataset = load_simulated_home(home, people=people, motion_blur=motion_blur)
    rng = np.random.default_rng([seed, 2])
    dataset, kidnapped_at = _driven(dataset, chosen, rng)
    extractor = make_extractor(dataset, options)
    cache = FeatureCache() if cached else None
    references = ReferenceMap.from_dataset(dataset, extractor, cache=cache)
    if chosen.reference_spacing > 1.0:
        references = references.subset(apart(references.poses, chosen.reference_spacing))
    return Course(
        drive=dataset,
        reference_map=references,
        bounds=references.bounds(options.start_margin),
        start=chosen.start,
        home_seed=home,
        kidnapped_at=kidnapped_at,
        extractor=extractor,
        cache=cache,
    )


def _driven(
    dataset: Dataset, scenario: Scenario, rng: np.random.Generator
) -> tuple[Dataset, int | None]:
    """Measure the test drive by wheels; a kidnapped robot leaves out images in the middle."""
    assert dataset.ground_truth is not None
    queries, kidnapped_at = dataset.query_indices, None
    if scenario.kidnapped:
        kidnapped_at, first = _carried(dataset.ground_truth[queries])
        queries = np.concatenate([queries[:kidnapped_at], queries[first:]])
    driven = dataset.ground_truth[queries]
    if kidnapped_at is not None:
        k = kidnapped_at
        rest = compose(driven[k - 1], relative_pose(driven[k], driven[k:]))
        driven = np.concatenate([driven[:k], rest])
    measured = np.full((len(dataset), 3), np.nan)
    measured[queries] = simulate_odometry(
        driven,
        scale=scenario.odometry_scale,
        heading_drift=scenario.odometry_drift,
        rng=rng,
        **{name: scenario.odometry_noise**2 * value for name, value in ODOMETRY_NOISE.items()},
    )
    return replace(dataset.with_odometry(measured), query_indices=queries), kidnapped_at


def _carried(poses: FloatArray) -> tuple[int, int]:
    """Choose from which image of a drive the robot is carried to which later one.

    From the one nearest to the middle from which one that is far enough leaves enough of the drive;
    where there is none, from the middle to the farthest.
    """
    middle = len(poses) // 2
    for k in sorted(range(1, len(poses)), key=lambda k: abs(k - middle)):
        away = np.hypot(*(poses[k:, :2] - poses[k - 1, :2]).T)
        far = np.flatnonzero(away >= CARRIED)
        if len(far) and len(poses) - (k + far[0]) >= IMAGES_AFTER:
            return k, k + int(far[0])
    away = np.hypot(*(poses[middle:, :2] - poses[middle - 1, :2]).T)
    return middle, middle + int(np.argmax(away))
