"""Scenarios, and the drives that they make."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pflut.geometry import relative_pose, wrap_to_pi
from pflut.likelihood.table import LikelihoodTable
from pflut.localization.localizer import Localizer
from pflut.localization.motion import DifferentialDrive
from pflut.localization.particle_filter import ParticleFilter
from pflut.localization.reference_image_model import ReferenceImageModel
from pflut.reference_map import ReferenceMap
from pflut.simulation.landmark_drive import LandmarkDrive, scenario_named, simulate_drive
from pflut.simulation.landmark_images import LandmarkImages, expected_matches
from pflut.simulation.scenarios import SCENARIOS, Scenario

SIGMAS = 5.0
NEAR = 5.0


def true_and_all(drive: LandmarkDrive, i: int) -> tuple[int, int]:
    """Count an image's true matches, and all, with the references within 5 m."""
    counts, pairs = drive.matches(i)
    near = np.hypot(*(drive.reference_poses - drive.ground_truth[i])[:, :2].T) < NEAR
    there = np.repeat(near, counts)
    still = pairs[:, 0] < len(drive.home.landmarks)
    return int((there & still & (pairs[:, 0] == pairs[:, 1])).sum()), int(there.sum())


def bytes_of(drive: LandmarkDrive, i: int) -> bytes:
    parts = []
    for match in drive.observation(i):
        pair = match.correspondences
        parts += [np.array([match.index]), pair.azimuth_l, pair.elevation_l]
        parts += [pair.azimuth_r, pair.elevation_r]
    return b"".join(part.tobytes() for part in parts)


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_scenario_makes_a_drive(name: str) -> None:
    drive = simulate_drive(name, 1, home_seed=0)
    n = len(drive)
    assert 40 <= n <= 80
    assert drive.ground_truth.shape == drive.odometry.shape == (n, 3)
    assert drive.query_indices.tolist() == list(range(n))
    assert (np.diff(drive.stamps) > 0).all()
    assert name in drive.name
    steps = np.hypot(*np.diff(drive.ground_truth[:, :2], axis=0).T)
    assert 0.2 < np.median(steps) < 0.4
    low, high = np.array(drive.bounds).reshape(2, 2)
    assert ((drive.ground_truth[:, :2] > low) & (drive.ground_truth[:, :2] < high)).all()
    between = drive.odometry_between(3, 7)
    assert between == pytest.approx(relative_pose(drive.odometry[3], drive.odometry[7]))
    for i in (0, n - 1):
        observation = drive.observation(i)
        indices = [match.index for match in observation]
        assert indices == sorted(set(indices)) and len(indices) <= 32
        assert indices[0] >= 0 and indices[-1] < len(drive.reference_poses)
    offsets = drive.reference_poses[:, None, :2] - drive.reference_poses[:, :2]
    distance = np.hypot(offsets[..., 0], offsets[..., 1])
    nearest = (distance + np.diag(np.full(len(distance), np.inf))).min(axis=1)
    spacing = drive.scenario.reference_spacing
    assert nearest.min() >= spacing - 1e-9
    assert np.median(nearest) < 1.4 * spacing


def test_the_same_seed_gives_the_same_bytes_in_any_order() -> None:
    drive, again = (simulate_drive("crowded", 4, home_seed=0) for _ in range(2))
    for name in ("stamps", "ground_truth", "odometry"):
        assert getattr(drive, name).tobytes() == getattr(again, name).tobytes()
    forward = [bytes_of(drive, i) for i in range(5)]
    assert [bytes_of(again, i) for i in range(4, -1, -1)] == forward[::-1]
    assert len(set(forward)) == 5
    other = simulate_drive("crowded", 5, home_seed=0)
    assert other.ground_truth.tobytes() != drive.ground_truth.tobytes()
    # the map is the home's, not the drive's
    assert other.references is drive.references


def test_scenarios_of_a_seed_share_their_path() -> None:
    drives = [simulate_drive(name, 2, home_seed=0) for name in ("global", "dark", "odometry")]
    assert len({drive.ground_truth.tobytes() for drive in drives}) == 1
    assert len({bytes_of(drive, 0) for drive in drives[:2]}) == 2


def test_an_observation_is_what_was_matched() -> None:
    drive = simulate_drive("global", 0, home_seed=0)
    counts, pairs = drive.matches(8)
    image = drive.view(8)
    ends = np.cumsum(counts)
    observation = drive.observation(8)
    fewest = min(len(match.correspondences) for match in observation)
    listed = [match.index for match in observation]
    assert np.delete(counts, listed).max() <= fewest
    for match in observation:
        left, right = pairs[ends[match.index] - counts[match.index] : ends[match.index]].T
        pair = match.correspondences
        assert np.abs(wrap_to_pi(pair.azimuth_r - image.azimuth[0, right])).max() < 1e-12
        assert (pair.elevation_l == drive.references.elevation[match.index, left]).all()
    everything = drive.correspondences(8)
    assert [len(pair) for pair in everything] == counts.tolist()
    for match in observation:
        assert (everything[match.index].azimuth_l == match.correspondences.azimuth_l).all()
        assert (everything[match.index].elevation_r == match.correspondences.elevation_r).all()
    # references that share nothing with the image have mismatches all the same
    shared = (drive.references.seen & image.seen[0]).sum(axis=1)
    assert (shared == 0).any() and counts[shared == 0].min() > 0


@pytest.mark.parametrize("name", ["global", "dark", "mismatches", "corridor"])
def test_the_share_of_true_matches_is_the_scenarios(name: str) -> None:
    """Of ten drives, against a gain that was measured on eight others."""
    rows = []
    for seed in range(10):
        drive = simulate_drive(name, seed, home_seed=0)
        found = np.array([true_and_all(drive, i) for i in range(0, len(drive), 2)])
        rows.append(found.sum(axis=0))
    true, total = np.array(rows, dtype=float).T
    share = true.sum() / total.sum()
    spread = (true - share * total).std(ddof=1) / total.mean()
    assert abs(share - SCENARIOS[name].true_share) < SIGMAS * spread * np.sqrt(1 / 10 + 1 / 8)
    # a test that says something: this is less than 40 % of the share
    assert SIGMAS * spread * np.sqrt(1 / 10 + 1 / 8) < 0.4 * share


def test_true_matches_are_as_many_as_expected() -> None:
    """Of given images each match is a coin of known probability."""
    drive = simulate_drive("global", 3, home_seed=0)
    views = [drive.view(i) for i in range(len(drive))]
    parts = (
        np.concatenate([getattr(view, name) for view in views])
        for name in ("poses", "seen", "azimuth", "elevation", "view", "log_distance")
    )
    images = LandmarkImages(*parts)
    near = sum(
        int((np.hypot(*(drive.reference_poses - pose)[:, :2].T) < NEAR).sum())
        for pose in drive.ground_truth
    )
    mean, _ = expected_matches(drive.references, images, drive.matcher.copies)
    expected = drive.matcher.gain * mean * near
    found = sum(true_and_all(drive, i)[0] for i in range(len(drive)))
    assert expected > 1000
    assert abs(found - expected) < SIGMAS * np.sqrt(expected)


def test_a_kidnapped_robot_is_elsewhere_and_odometry_does_not_tell() -> None:
    for seed in range(8):
        drive = simulate_drive("kidnapped", seed, home_seed=0)
        k = drive.kidnapped_at
        assert k is not None and 15 < k < len(drive) - 15
        moved = np.hypot(*(drive.ground_truth[k] - drive.ground_truth[k - 1])[:2])
        assert moved >= 3.0
        assert np.hypot(*drive.odometry_between(k - 1, k)[:2]) < 0.05
        # before and after the odometry is as good as ever
        for i in (k - 2, k):
            true = relative_pose(drive.ground_truth[i], drive.ground_truth[i + 1])
            measured = drive.odometry_between(i, i + 1)
            assert np.hypot(*(measured - true)[:2]) < 0.1
    assert simulate_drive("global", 0, home_seed=0).kidnapped_at is None


def test_odometry_has_the_scenarios_scale_and_drift() -> None:
    scenario = replace(SCENARIOS["odometry"], odometry_noise=0.0)
    drive = simulate_drive(scenario, 0, home_seed=0)
    for i in range(0, len(drive) - 1, 5):
        true = relative_pose(drive.ground_truth[i], drive.ground_truth[i + 1])
        measured = drive.odometry_between(i, i + 1)
        metres = np.hypot(*true[:2])
        if metres > 0.01:
            assert np.hypot(*measured[:2]) == pytest.approx(1.15 * metres)
            assert wrap_to_pi(measured[2] - true[2]) == pytest.approx(0.03 * metres)


def test_people_add_mismatches_that_move_together() -> None:
    crowded = simulate_drive("crowded", 0, home_seed=0)
    n = len(crowded.home.landmarks)
    worn = 0
    for i in range(len(crowded)):
        _, pairs = crowded.matches(i)
        of_people = (pairs >= n).all(axis=1) & (pairs[:, 0] == pairs[:, 1])
        worn += int(of_people.sum())
    assert worn > 100
    alone = simulate_drive(replace(crowded.scenario, people=0), 0, home_seed=0)
    assert crowded.references.seen[:, :n].sum() < 0.99 * alone.references.seen.sum()


@pytest.mark.parametrize("name, reached", [("tracking", 0.1), ("global", 0.1), ("sparse", 0.3)])
def test_a_drive_is_localized(name: str, reached: float, default_table: LikelihoodTable) -> None:
    drive = simulate_drive(name, 0, home_seed=0)
    sensor = ReferenceImageModel(ReferenceMap.of_poses(drive.reference_poses), default_table)
    pf = ParticleFilter(
        DifferentialDrive(), sensor, num_particles=4000, min_effective_share=0.1, rng=0
    )
    if drive.scenario.start == "truth":
        pf.initialize_gaussian(drive.ground_truth[0], np.diag([0.01, 0.01, 0.002]))
    else:
        pf.initialize_uniform(drive.bounds)
    steps = Localizer(drive, pf, observations=drive.observation).run()
    poses = np.array([step.estimate.pose for step in steps])
    errors = np.hypot(*(poses - drive.ground_truth)[:, :2].T)
    assert np.median(errors[-20:]) < reached


def test_scenarios_are_named_and_described() -> None:
    assert len(SCENARIOS) == 9
    for name, scenario in SCENARIOS.items():
        assert scenario.name == name
        assert scenario.description.endswith(".") and ". " not in scenario.description
    assert scenario_named("dark") is SCENARIOS["dark"]
    own = Scenario(name="mine", description="My own.")
    assert scenario_named(own) is own


@pytest.mark.parametrize(
    "change, message",
    [
        ({"plan": "castle"}, "plan: expected one of"),
        ({"start": "here"}, "start: expected one of"),
        ({"true_share": 1.0}, r"true_share: expected in \(0, 1\)"),
        ({"true_share": 0.0}, r"true_share: expected in \(0, 1\)"),
        ({"noise": -0.1}, "noise: expected radians"),
        ({"matches": 0.0}, "matches: expected a positive number"),
        ({"reference_spacing": np.nan}, "reference_spacing: expected a positive number"),
        ({"odometry_scale": -1.0}, "odometry_scale: expected a positive number"),
        ({"odometry_drift": np.inf}, "odometry_drift: expected a number"),
        ({"odometry_noise": -1.0}, "odometry_noise: expected at least 0"),
        ({"people": -1}, "people: expected a whole number"),
        ({"people": 1.5}, "people: expected a whole number"),
    ],
)
def test_a_scenario_out_of_range_is_refused(change, message) -> None:
    with pytest.raises(ValueError, match=message):
        Scenario(name="x", description="x.", **change)


def test_misuse_is_refused() -> None:
    with pytest.raises(ValueError, match="scenario: expected one of tracking, global"):
        simulate_drive("party", 0)
    with pytest.raises(ValueError, match="seed: expected an integer"):
        simulate_drive("corridor", -1)
    with pytest.raises(ValueError, match="seed: expected an integer"):
        simulate_drive("corridor", 0, home_seed=-1)
    with pytest.raises(ValueError, match="matches: expected at most"):
        simulate_drive(replace(SCENARIOS["corridor"], matches=500.0), 0)
    drive = simulate_drive("corridor", 0)
    for i in (-1, len(drive)):
        with pytest.raises(ValueError, match="image: expected 0 to"):
            drive.observation(i)
    with pytest.raises(ValueError, match=r"image 3: .* expected its observation\(3\)"):
        drive.image(3)
