"""Run many drives, in processes; what a folder holds already is not done again."""

from __future__ import annotations

import os
from collections.abc import Generator
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from pflut._jobs import in_processes, same_settings
from pflut.campaign.course import Course, check_scenario, landmark_course, rendered_course
from pflut.campaign.filters import FILTERS, make_named_filter
from pflut.campaign.outcome import DriveOutcome
from pflut.evaluation import trajectory_errors
from pflut.geometry import FloatArray
from pflut.localization.localizer import Filter, Localizer, Step
from pflut.localization.particle_filter import ParticleFilter
from pflut.replay.options import ReplayOptions
from pflut.replay.tables import choose_table, table_record

MAX_HYPOTHESES = 8
LEAST_WEIGHT = 0.005
"""Of a hypothesis."""


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """Which drives are simulated, and how.

    Parameters
    ----------
    world : {"landmarks", "rendered"}
        Homes of landmarks give matches at once, rendered ones images.
    scenarios : tuple of str
        See `pflut.simulation.scenarios.SCENARIOS`.
    filters : tuple of str
        See `FILTERS`.
    options : ReplayOptions
        Of the filters; their seed and start do not count.
    home_seed : int, optional
        One home for all drives.
    motion_blur : float
        Seconds, of rendered images.
    max_images : int, optional
        Stop each drive after so many images.

    Raises
    ------
    ValueError
        If the world does not have a scenario, there is no such filter, or the exposure is none
        that the world has.
    """

    world: str = "landmarks"
    scenarios: tuple[str, ...] = ("global",)
    filters: tuple[str, ...] = ("pflut",)
    options: ReplayOptions = field(default_factory=ReplayOptions)
    home_seed: int | None = None
    motion_blur: float = 0.0
    max_images: int | None = None

    def __post_init__(self) -> None:
        for scenario in self.scenarios:
            check_scenario(self.world, scenario)
        for name in self.filters:
            if name not in FILTERS:
                raise ValueError(f"filter: expected one of {', '.join(FILTERS)}, got {name!r}")
        if not 0.0 <= self.motion_blur < 1.0:
            raise ValueError(f"motion_blur: expected seconds in [0, 1), got {self.motion_blur}")
        if self.motion_blur and self.world != "rendered":
            raise ValueError("motion_blur: expected rendered homes with it, landmarks do not blur")

    def course(self, scenario: str, seed: int, *, cached: bool = True) -> Course:
        """Make the drive of a scenario and a seed."""
        if self.world == "landmarks":
            return landmark_course(scenario, seed, home_seed=self.home_seed)
        return rendered_course(
            scenario,
            seed,
            options=self.options,
            home_seed=self.home_seed,
            motion_blur=self.motion_blur,
            cached=cached,
        )

    def record(self) -> dict[str, Any]:
        """Give what makes drives comparable, for ``settings.json``: not which ones there are."""
        options = self.options.as_dict()
        for name in ("seed", "start"):  # the drives' own
            options.pop(name)
        table = choose_table(self.options.table, bins=self.options.bins)
        return {
            "world": self.world,
            "options": options,
            "table": table_record(self.options.table, table),
            "home_seed": self.home_seed,
            "motion_blur": self.motion_blur,
            "max_images": self.max_images,
        }


def run_drive(
    campaign: Campaign, scenario: str, name: str, seed: int, *, cached: bool = True
) -> DriveOutcome:
    """Localize a robot along one drive with one filter.

    Parameters
    ----------
    campaign : Campaign
    scenario, name : str
        Of the scenario and of the filter.
    seed : int
        Of the drive and the filter.
    cached : bool
        Whether features of rendered images are looked up in, and added to, the user's cache.

    Returns
    -------
    DriveOutcome
        The same at every call, its times aside.
    """
    course = campaign.course(scenario, seed, cached=cached)
    pf = make_named_filter(name, course, replace(campaign.options, seed=seed))
    indices = course.drive.query_indices[: campaign.max_images].tolist()
    kidnapped_at = course.kidnapped_at
    if kidnapped_at is not None and kidnapped_at >= len(indices):
        kidnapped_at = None
    steps, places = [], []
    for step in Localizer(course.drive, pf, observations=course.observations, indices=indices):
        steps.append(step)
        places.append(_places(pf, step))
    truth = np.array([step.ground_truth for step in steps])
    errors = trajectory_errors([step.estimate.pose for step in steps], truth)
    taken = [sum(step.timings[part] for part in ("predict", "update")) for step in steps]
    return DriveOutcome(
        scenario=scenario,
        filter=name,
        seed=seed,
        home_seed=course.home_seed,
        kidnapped_at=kidnapped_at,
        position_m=[round(float(value), 6) for value in errors.position],
        heading_deg=[round(float(value), 6) for value in np.degrees(errors.heading)],
        confidence=[round(step.estimate.confidence, 6) for step in steps],
        hypotheses=[max(len(some) - 1, 1) for some in places],
        held=[
            int(trajectory_errors(some, np.tile(pose, (len(some), 1))).good.any())
            for some, pose in zip(places, truth, strict=True)
        ],
        seconds=[round(value, 6) for value in taken],
        num_particles=[step.estimate.num_particles for step in steps],
        degenerate=sum(step.estimate.degenerate for step in steps),
    )


def _places(pf: Filter, step: Step) -> FloatArray:
    """Give the poses that a filter thinks possible, (k, 3), the estimate among them."""
    poses = [step.estimate.pose]
    if isinstance(pf, ParticleFilter):
        found = pf.hypotheses(max_count=MAX_HYPOTHESES, min_weight=LEAST_WEIGHT)
        poses += [hypothesis.pose for hypothesis in found]
    return np.array(poses)


def outcome_file(folder: Path, scenario: str, name: str, seed: int) -> Path:
    """Name the file that keeps a drive's outcome."""
    return folder / scenario / name / f"seed_{seed}.json"


def run_campaign(
    campaign: Campaign,
    seeds: range,
    folder: str | os.PathLike[str],
    *,
    jobs: int = 1,
    cached: bool = True,
) -> Generator[DriveOutcome, None, None]:
    """Run all drives of a campaign.

    Parameters
    ----------
    campaign : Campaign
    seeds : range
        A drive each, of every scenario and filter.
    folder : path
        Gets ``<scenario>/<filter>/seed_<n>.json`` for each drive as soon as it is done, and
        ``settings.json``.
    jobs : int
        Processes; 1 works in this one. With more, a script that calls this needs the usual
        ``if __name__ == "__main__":``.
    cached : bool
        See `run_drive`.

    Yields
    ------
    DriveOutcome
        Those of the folder first, the others as they are done.

    Raises
    ------
    ValueError
        If the folder holds drives with other options or another likelihood table.
    """
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    same_settings(target / "settings.json", campaign.record(), "drives")
    if "paper" in campaign.filters:
        # learned here once: it is then in the cache before processes ask for it
        choose_table("dense", bins=campaign.options.bins)
    missing = []
    for seed, scenario, name in product(seeds, campaign.scenarios, campaign.filters):
        path = outcome_file(target, scenario, name, seed)
        if path.is_file():
            yield DriveOutcome.load(path)
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            missing.append((scenario, name, seed))
    work = partial(_run_and_keep, campaign=campaign, folder=target, cached=cached)
    yield from in_processes(work, missing, jobs=jobs)


def _run_and_keep(
    drive: tuple[str, str, int], *, campaign: Campaign, folder: Path, cached: bool
) -> DriveOutcome:
    """Run one drive and write its file."""
    outcome = run_drive(campaign, *drive, cached=cached)
    outcome.save(outcome_file(folder, *drive))
    return outcome
