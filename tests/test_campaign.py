"""Campaigns: many simulated drives, kept one by one and gone on with."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pflut._files import write_json
from pflut.campaign import FILTERS, Campaign, DriveOutcome, run_campaign, run_drive
from pflut.campaign.course import RENDERED, RENDERED_PEOPLE, apart, landmark_course, rendered_course
from pflut.campaign.drives import outcome_file
from pflut.datasets.simulated_home import RENDERER_VERSION
from pflut.features import FeatureCache
from pflut.geometry import relative_pose, wrap_to_pi
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.table import LikelihoodTable
from pflut.replay.options import ReplayOptions
from pflut.simulation.scenarios import SCENARIOS

OPTIONS = ReplayOptions(num_particles=300, bins=32)
SHORT = Campaign(options=OPTIONS, max_images=2, home_seed=0)


@pytest.fixture
def rendered(room_home_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the rendered homes 0 to 2 be the room, and home 0 with people, too."""
    monkeypatch.setenv("PFLUT_CACHE", str(room_home_cache))
    homes = room_home_cache / "simulated-home"
    crowded = homes / f"v{RENDERER_VERSION}-seed0-people{RENDERED_PEOPLE}-blur0"
    if not crowded.exists():
        crowded.symlink_to(homes / f"v{RENDERER_VERSION}-seed0-people0-blur0")


def timeless(outcome: DriveOutcome) -> dict[str, Any]:
    """Give all that must be the same at every call."""
    return {**asdict(outcome), "seconds": len(outcome.seconds)}


def by_name(outcomes: list[DriveOutcome]) -> dict[tuple[str, str, int], dict[str, Any]]:
    return {(o.scenario, o.filter, o.seed): timeless(o) for o in outcomes}


# --- one drive ---------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_numbers() -> None:
    campaign = replace(SHORT, max_images=3, options=replace(OPTIONS, num_particles=2000))
    first = run_drive(campaign, "tracking", "pflut", 1)
    assert (first.scenario, first.filter, first.seed, first.home_seed) == (
        "tracking",
        "pflut",
        1,
        0,
    )
    assert len(first) == 3 and first.converged_at == 0 and first.degenerate == 0
    assert first.num_particles == [2000] * 3 and min(first.seconds) > 0.0
    assert timeless(run_drive(campaign, "tracking", "pflut", 1)) == timeless(first)
    assert run_drive(campaign, "tracking", "pflut", 2).position_m != first.position_m
    other = replace(campaign, options=replace(campaign.options, seed=9))  # the drive's counts
    assert timeless(run_drive(other, "tracking", "pflut", 1)) == timeless(first)


@pytest.mark.parametrize("name", FILTERS)
def test_every_filter_follows_a_robot(
    name: str, small_dense_table: DenseTable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(DenseTable, "default", lambda **_: small_dense_table)
    campaign = replace(SHORT, max_images=4, options=replace(OPTIONS, num_particles=1000))
    outcome = run_drive(campaign, "tracking", name, 0)
    assert len(outcome) == 4 and outcome.good.all()
    assert all(0.0 <= confidence <= 1.0 for confidence in outcome.confidence)


@pytest.mark.parametrize("name", ["pflut", "odometry", "ekf-ransac"])
def test_filters_follow_a_robot_by_images(name: str, rendered: None) -> None:
    campaign = Campaign(
        world="rendered", options=replace(OPTIONS, num_particles=1000), home_seed=0, max_images=4
    )
    outcome = run_drive(campaign, "tracking", name, 0)
    assert len(outcome) == 4 and outcome.good.all()


def test_a_drive_that_stops_before_the_kidnapping_has_none() -> None:
    outcome = run_drive(SHORT, "kidnapped", "odometry", 0)
    assert outcome.kidnapped_at is None
    whole = run_drive(replace(SHORT, max_images=None), "kidnapped", "odometry", 0)
    at = whole.kidnapped_at
    assert at is not None and at == landmark_course("kidnapped", 0, home_seed=0).kidnapped_at
    assert max(whole.position_m[:at]) < 2.0 < min(whole.position_m[at : at + 2])


# --- the campaign's folder ---------------------------------------------------------------------


def test_done_drives_are_not_done_again(tmp_path: Path) -> None:
    campaign = replace(SHORT, filters=("odometry",))
    first = list(run_campaign(campaign, range(2), tmp_path / "new" / "runs"))
    folder = tmp_path / "new" / "runs"
    assert [o.seed for o in first] == [0, 1]
    path = outcome_file(folder, "global", "odometry", 0)
    other = replace(first[0], degenerate=99)
    other.save(path)
    more = replace(campaign, scenarios=("global", "tracking"), filters=("odometry", "ekf-ransac"))
    again = list(run_campaign(more, range(3), folder))
    assert again[:2] == [other, first[1]] and len(again) == 12
    assert len(by_name(again)) == 12 and len(list(folder.glob("*/*/seed_*.json"))) == 12
    assert DriveOutcome.load(path) == other


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"options": replace(OPTIONS, temperature=0.5)}, "temperature"),
        ({"options": replace(OPTIONS, bins=16)}, "bins, table"),
        ({"max_images": 3}, "max_images"),
        ({"home_seed": 1}, "home_seed"),
        ({"world": "rendered"}, "world"),
    ],
)
def test_drives_of_other_options_are_not_mixed(
    tmp_path: Path, change: dict[str, Any], name: str
) -> None:
    campaign = replace(SHORT, filters=("odometry",))
    list(run_campaign(campaign, range(1), tmp_path))
    with pytest.raises(ValueError, match=f"holds drives with another {name}, expected a new"):
        list(run_campaign(replace(campaign, **change), range(1), tmp_path))
    starts = replace(campaign, options=replace(OPTIONS, seed=7, start="truth"))
    assert len(list(run_campaign(starts, range(1), tmp_path))) == 1  # the drives have their own


def test_drives_of_other_tables_are_not_mixed(
    tmp_path: Path, small_table: LikelihoodTable, small_dense_table: DenseTable
) -> None:
    name = tmp_path / "table.npz"
    small_table.save(name)
    campaign = replace(SHORT, options=replace(OPTIONS, table=str(name), bins=None))
    (outcome,) = run_campaign(campaign, range(1), tmp_path / "runs")
    # the default table of 32 bins, by a file
    assert timeless(outcome) == timeless(run_drive(SHORT, "global", "pflut", 0))
    assert list(run_campaign(campaign, range(1), tmp_path / "runs")) == [outcome]
    small_dense_table.save(name)  # another one by the same name
    with pytest.raises(ValueError, match="drives with another table, expected a new folder"):
        list(run_campaign(campaign, range(1), tmp_path / "runs"))


def test_processes_give_the_same_drives(tmp_path: Path, small_dense_table: DenseTable) -> None:
    small_dense_table.save(tmp_path / "table.npz")
    options = replace(OPTIONS, table=str(tmp_path / "table.npz"), bins=None)
    campaign = replace(SHORT, options=options, filters=("pflut", "odometry"))
    alone = list(run_campaign(campaign, range(2), tmp_path / "a"))
    together = list(run_campaign(campaign, range(2), tmp_path / "b", jobs=2))
    assert by_name(together) == by_name(alone) and len(together) == 4


def test_settings_that_are_none_are_refused(tmp_path: Path) -> None:
    (tmp_path / "settings.json").write_text("{")
    with pytest.raises(ValueError, match=r"settings\.json: not a JSON file"):
        list(run_campaign(SHORT, range(1), tmp_path))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"world": "mars"}, "world: expected one of landmarks, rendered, got 'mars'"),
        ({"scenarios": ("global", "hard")}, "scenario: expected one of tracking.*got 'hard'"),
        ({"world": "rendered", "scenarios": ("dark",)}, r"scenario: .*\(rendered\), got 'dark'"),
        ({"filters": ("best",)}, "filter: expected one of pflut, .*, got 'best'"),
        ({"motion_blur": 0.1}, "motion_blur: expected rendered homes"),
        ({"motion_blur": -0.1, "world": "rendered"}, "motion_blur: expected seconds"),
        ({"motion_blur": float("nan")}, "motion_blur: expected seconds"),
    ],
)
def test_campaigns_of_what_is_not_there(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        Campaign(**options)


def test_maximum_likelihood_asks_for_a_residual_table(
    tmp_path: Path, small_dense_table: DenseTable
) -> None:
    small_dense_table.save(tmp_path / "dense.npz")
    options = replace(OPTIONS, table=str(tmp_path / "dense.npz"))
    with pytest.raises(ValueError, match=r"ekf-ml expects a residual table, got .*dense\.npz"):
        run_drive(replace(SHORT, options=options), "tracking", "ekf-ml", 0)


# --- courses of rendered homes -----------------------------------------------------------------


def test_every_rendered_scenario_makes_a_course(rendered: None) -> None:
    assert set(RENDERED) <= set(SCENARIOS)
    for scenario in RENDERED:
        course = rendered_course(scenario, 5, options=OPTIONS, home_seed=0)
        assert course.start == SCENARIOS[scenario].start and course.home_seed == 0
        assert (course.kidnapped_at is not None) == (scenario == "kidnapped")
        xmin, ymin, xmax, ymax = course.bounds
        x, y = course.reference_map.poses[:, :2].T
        assert xmin == pytest.approx(x.min() - OPTIONS.start_margin) and xmax > x.max()
        assert ymin < y.min() and ymax > y.max()


def test_a_seed_is_a_home_and_its_odometry(rendered: None) -> None:
    courses = [
        rendered_course("tracking", seed, options=OPTIONS, home_seed=home)
        for seed, home in ((1, None), (1, 0), (2, 0))
    ]
    assert [course.home_seed for course in courses] == [1, 0, 0]
    moved = [course.drive.odometry_between(12, 23) for course in courses]
    assert moved[0] == pytest.approx(moved[1])  # both homes are the room
    assert not np.allclose(moved[1], moved[2])


def test_odometry_does_not_tell_that_the_robot_was_carried_away(rendered: None) -> None:
    """It measures every other step as it was. (The room has no two places 3 m apart.)"""
    course = rendered_course("kidnapped", 3, options=OPTIONS, home_seed=0)
    queries, at = course.drive.query_indices, course.kidnapped_at
    assert course.drive.ground_truth is not None
    truth = course.drive.ground_truth[queries]
    assert at == 6 and len(queries) < 12
    true = [relative_pose(a, b) for a, b in pairwise(truth)]
    measured = [course.drive.odometry_between(a, b) for a, b in pairwise(queries)]
    jump = np.hypot(*true[at - 1][:2])
    assert jump > 1.5 and np.hypot(*measured[at - 1][:2]) < 0.05
    for k in set(range(len(true))) - {at - 1}:
        assert measured[k][:2] == pytest.approx(true[k][:2], abs=0.1)
        assert wrap_to_pi(measured[k][2] - true[k][2]) == pytest.approx(0.0, abs=0.2)


def test_odometry_that_is_wrong_measures_too_much(rendered: None) -> None:
    lengths = {}
    for scenario in ("tracking", "odometry"):
        drive = rendered_course(scenario, 1, options=OPTIONS, home_seed=0).drive
        steps = [drive.odometry_between(k, k + 1) for k in range(12, 23)]
        lengths[scenario] = sum(np.hypot(*step[:2]) for step in steps)
    assert lengths["odometry"] > 1.08 * lengths["tracking"]


def test_sparse_references_are_apart(rendered: None) -> None:
    sparse, dense = (
        rendered_course(scenario, 0, options=OPTIONS, home_seed=0).reference_map.poses[:, :2]
        for scenario in ("sparse", "tracking")
    )
    assert len(dense) == 12 and 2 <= len(sparse) < 6
    gaps = np.hypot(*np.moveaxis(sparse[:, None] - sparse, -1, 0))
    assert gaps[~np.eye(len(sparse), dtype=bool)].min() >= 2.5
    # and none is left out that could be there
    assert np.hypot(*np.moveaxis(dense[:, None] - sparse, -1, 0)).min(axis=1).max() < 2.5


def test_apart_takes_the_first_of_those_that_are_near() -> None:
    poses = np.array([[0.0, 0, 0], [0.5, 0, 1], [1.0, 0, 2], [1.9, 0, 3], [2.0, 0, 4]])
    assert apart(poses, 1.0) == [0, 2, 4]


def test_features_are_kept_only_if_asked_for(rendered: None) -> None:
    course = rendered_course("tracking", 0, options=OPTIONS, home_seed=0, cached=False)
    assert course.cache is None
    kept = rendered_course("tracking", 0, options=OPTIONS, home_seed=0)
    assert isinstance(kept.cache, FeatureCache)


def test_a_drives_file_is_json(tmp_path: Path) -> None:
    outcome = run_drive(SHORT, "tracking", "odometry", 0)
    outcome.save(tmp_path / "drive.json")
    content = json.loads((tmp_path / "drive.json").read_text())
    assert content["filter"] == "odometry" and len(content["position_m"]) == 2
    write_json(tmp_path / "copy.json", content)
    assert DriveOutcome.load(tmp_path / "copy.json") == outcome
