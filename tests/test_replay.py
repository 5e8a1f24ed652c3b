"""The replay pipeline on a small rendered room: it localizes, repeats itself, and says why not."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import room

from pflut.datasets import Dataset, load_folder
from pflut.features import FeatureCache, match
from pflut.geometry import compose, relative_headings, wrap_to_pi
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.table import LikelihoodTable
from pflut.reference_map import ReferenceMap
from pflut.relpose.estimate import estimate_relative_pose
from pflut.replay import ReplayOptions, ReplayResult, prepare_dataset, replay_dataset
from pflut.replay.each import localize_each
from pflut.replay.figures import draw_figures
from pflut.replay.filters import make_motion
from pflut.replay.pipeline import make_extractor

OPTIONS = ReplayOptions(num_particles=2000)


@pytest.fixture(scope="module")
def replay(
    room_dataset: Dataset, small_table: LikelihoodTable, room_cache: FeatureCache
) -> Callable[..., ReplayResult]:
    """Replay the room, features from the cache."""

    def run(dataset: Dataset = room_dataset, **more: object) -> ReplayResult:
        options = dataclasses.replace(OPTIONS, **more.pop("options", {}))  # type: ignore[arg-type]
        more = {"table": small_table, "cache": room_cache, **more}
        return replay_dataset(dataset, options, **more)  # type: ignore[arg-type]

    return run


@pytest.fixture(scope="module")
def lost(replay: Callable[..., ReplayResult]) -> ReplayResult:
    return replay(keep_particles=range(-1, 100))


def test_a_lost_robot_is_localized(lost: ReplayResult) -> None:
    assert lost.errors is not None and len(lost) == 12
    assert lost.errors.converged_at is not None and lost.errors.converged_at <= 3
    after = lost.errors[lost.errors.converged_at :]
    # a 32-bin table: 11 degrees a cell
    assert np.median(after.position) < 0.15
    assert np.degrees(np.median(np.abs(after.heading))) < 2.0


def test_steps_know_their_image_truth_and_matches(lost: ReplayResult) -> None:
    dataset = lost.dataset
    assert [step.index for step in lost.steps] == dataset.query_indices.tolist()
    assert dataset.ground_truth is not None and lost.ground_truth is not None
    np.testing.assert_array_equal(lost.ground_truth, dataset.ground_truth[dataset.query_indices])
    assert all(step.num_references > 3 and step.num_matches > 20 for step in lost.steps)
    stages = {"image", "features", "predict", "match", "likelihood", "weights"}
    assert all(set(step.timings) == stages for step in lost.steps)
    assert all(seconds >= 0.0 for step in lost.steps for seconds in step.timings.values())


def test_particles_are_kept_where_asked_for(lost: ReplayResult) -> None:
    assert sorted(lost.snapshots) == [-1, *range(12)]
    start, _ = lost.snapshots[-1]
    low, high = start[:, :2].min(axis=0), start[:, :2].max(axis=0)
    # uniform over the references' rectangle and the margin
    np.testing.assert_allclose([*low, *high], [0.0, 0.0, 6.0, 5.0], atol=0.05)
    assert all(len(poses) == len(weights) == 2000 for poses, weights in lost.snapshots.values())


def test_the_best_pair_has_the_most_matches_of_all(
    lost: ReplayResult, room_cache: FeatureCache
) -> None:
    """Every reference of the room is in range, so every pair was compared."""
    extractor = make_extractor(lost.dataset, OPTIONS)
    features = [room_cache(extractor, lost.dataset.image(i)) for i in range(len(lost.dataset))]
    counts = {
        (int(r), int(q)): len(match(features[r], features[q], ratio=0.8, mutual=True))
        for r in lost.dataset.reference_indices
        for q in lost.dataset.query_indices
    }
    assert lost.pair is not None
    assert counts[lost.pair.reference, lost.pair.query] == max(counts.values())
    assert len(lost.pair.correspondences) == max(counts.values())


def test_the_same_seed_gives_the_same_poses(
    replay: Callable[..., ReplayResult], lost: ReplayResult
) -> None:
    again = replay()
    assert again.estimates.tobytes() == lost.estimates.tobytes()
    assert again.metrics() == lost.metrics()
    other = replay(options={"seed": 1}, max_images=3)
    assert other.estimates.tobytes() != lost.estimates[:3].tobytes()


def test_known_starts(replay: Callable[..., ReplayResult], lost: ReplayResult) -> None:
    assert lost.ground_truth is not None
    pose = tuple(lost.ground_truth[0])
    for start in ("truth", pose):
        result = replay(options={"start": start}, max_images=2, keep_particles=[-1])
        cloud, _ = result.snapshots[-1]
        # 2000 draws of standard deviation 0.2 m: five standard errors
        np.testing.assert_allclose(cloud[:, :2].mean(axis=0), pose[:2], atol=5 * 0.2 / 2000**0.5)
        assert result.errors is not None and result.errors.position.max() < 0.3


def test_the_table_is_the_one_that_the_options_name(
    replay: Callable[..., ReplayResult],
    small_dense_table: DenseTable,
    tmp_path: Path,
    lost: ReplayResult,
) -> None:
    small_dense_table.save(tmp_path / "table.npz")
    named = {"table": str(tmp_path / "table.npz")}
    result = replay(options=named, table=None, max_images=4)
    given = replay(table=small_dense_table, max_images=4)
    assert result.estimates.tobytes() == given.estimates.tobytes()
    assert result.errors is not None and result.errors.position[-1] < 0.3
    # the fixture's is the default one of 32 bins
    same = replay(options={"bins": 32}, table=None, max_images=4)
    assert same.estimates.tobytes() == lost.estimates[:4].tobytes()
    assert same.estimates.tobytes() != result.estimates.tobytes()


def test_figures_of_either_table(
    lost: ReplayResult,
    small_table: LikelihoodTable,
    small_dense_table: DenseTable,
    tmp_path: Path,
) -> None:
    for table in (small_table, small_dense_table):
        paths = draw_figures(tmp_path / type(table).__name__, lost, table)
        assert [path.stem for path in paths] == ["trajectory", "errors", "posterior"]
        assert all(path.is_file() for path in paths)


def test_odometry_alone_starts_at_the_truth(lost: ReplayResult) -> None:
    assert lost.odometry_errors is not None
    assert lost.odometry_errors.position[0] == pytest.approx(0.0, abs=1e-12)
    assert lost.odometry_errors.heading[0] == pytest.approx(0.0, abs=1e-12)
    assert lost.odometry_errors.position[1:].min() > 0.0


def test_odometry_alone_does_not_depend_on_the_odometrys_own_frame(lost: ReplayResult) -> None:
    moved = dataclasses.replace(
        lost,
        steps=tuple(
            dataclasses.replace(step, odometry=compose([1.0, 2.0, 3.0], step.odometry))
            for step in lost.steps
        ),
    )
    assert moved.odometry_alone is not None and lost.odometry_alone is not None
    difference = moved.odometry_alone - lost.odometry_alone
    difference[:, 2] = wrap_to_pi(difference[:, 2])
    np.testing.assert_allclose(difference, 0.0, atol=1e-12)


def test_leave_one_out_compares_an_image_with_all_but_itself(
    replay: Callable[..., ReplayResult], room_dataset: Dataset
) -> None:
    every = room_dataset.with_references("all")
    options = {"search_spacing": 0.25, "search_headings": 60}
    result = replay(every, options=options, max_images=5)
    assert result.each_on_its_own and len(result) == 5
    assert result.errors is not None
    assert result.success()["successes"] >= 4
    assert result.odometry_alone is None and "odometry_alone" not in result.metrics()
    again = replay(room_dataset, options=options, max_images=5, leave_one_out=True)
    assert again.estimates.tobytes() == result.estimates.tobytes()


def test_the_image_itself_is_not_among_its_references(
    room_dataset: Dataset, small_table: LikelihoodTable, room_cache: FeatureCache
) -> None:
    """The pairs' estimated headings are those to the references that the indices name."""
    dataset = dataclasses.replace(
        room_dataset.with_references("all"), query_indices=np.array([5, 14])
    )
    options = dataclasses.replace(OPTIONS, search_spacing=0.5, search_headings=12)
    extractor = make_extractor(dataset, options)
    reference_map = ReferenceMap.from_dataset(dataset, extractor, cache=room_cache)
    located = localize_each(
        dataset, reference_map, small_table, extractor, options, cache=room_cache
    )
    truth = dataset.ground_truth
    assert truth is not None
    for step, matches in located:
        indices = [int(dataset.reference_indices[m.index]) for m in matches]
        assert step.index not in indices and len(set(indices)) == len(indices) > 4
        for index, found in zip(indices[:3], matches, strict=False):
            pose = estimate_relative_pose(found.correspondences, small_table)
            _, _, distance = relative_headings(truth[index], truth[step.index])
            rotation = truth[step.index, 2] - truth[index, 2]
            assert distance > 0.0 and pose.success
            assert abs(wrap_to_pi(pose.rotation - rotation)) < np.radians(3.0)


def test_success_counts_and_confidences(lost: ReplayResult) -> None:
    """Made by hand: position errors, confidences."""
    cases = [(0.1, 0.9), (0.2, 0.8), (0.24, 0.6), (0.26, 0.7), (1.0, 0.75), (3.0, 0.85)]
    cases.append((np.nan, 0.99))
    steps = []
    for step, (error, confidence) in zip(lost.steps, cases, strict=False):
        estimate = dataclasses.replace(
            step.estimate, pose=np.array([error, 0.0, 0.0]), confidence=confidence
        )
        truth = None if np.isnan(error) else np.zeros(3)
        if truth is None:
            estimate = dataclasses.replace(estimate, pose=np.zeros(3))
        steps.append(dataclasses.replace(step, estimate=estimate, ground_truth=truth))
    success = dataclasses.replace(lost, steps=tuple(steps), each_on_its_own=True).success()
    assert (success["successes"], success["count"], success["rate"]) == (3, 6, 0.5)
    assert success["confidence_of_successes"] == 0.8
    assert success["confidence_of_failures"] == 0.75
    assert success["unsure_failures"] == 2


def test_missing_odometry_is_simulated_and_said_so(
    replay: Callable[..., ReplayResult], room_dataset: Dataset
) -> None:
    bare = dataclasses.replace(room_dataset, odometry=None)
    plan = prepare_dataset(bare, OPTIONS)
    assert not plan.each_on_its_own and any("simulated" in note for note in plan.notes)
    assert plan.dataset.odometry is not None
    result = replay(bare, options={"start": "truth"}, max_images=4)
    assert result.errors is not None and result.errors.position.max() < 0.3
    # an own odometry is left alone, unless another is asked for
    assert prepare_dataset(room_dataset, OPTIONS).dataset.odometry is room_dataset.odometry
    other = prepare_dataset(room_dataset, OPTIONS, simulated_odometry=True)
    assert other.dataset.odometry is not room_dataset.odometry and other.notes


def test_simulated_odometry_has_the_noise_asked_for(room_dataset: Dataset) -> None:
    poses = np.zeros((4000, 3))
    poses[:, 0] = np.arange(4000) * 0.5
    drive = dataclasses.replace(
        room_dataset,
        stamps=np.arange(4000.0),
        image_paths=room_dataset.image_paths[:1] * 4000,
        ground_truth=poses,
        odometry=None,
        reference_indices=np.arange(0),
        query_indices=np.arange(4000),
    )
    options = dataclasses.replace(OPTIONS, odometry_noise=0.08, odometry_scale=1.1)
    measured = prepare_dataset(drive, options).dataset.odometry
    assert measured is not None
    steps = np.hypot(*np.diff(measured[:, :2], axis=0).T)
    error = 0.08 * 0.5 / np.sqrt(4000)
    assert steps.mean() == pytest.approx(0.55, abs=5 * error)
    assert steps.std() == pytest.approx(0.04, rel=5 / np.sqrt(2 * 4000) + 0.01)


def test_images_without_ground_truth_have_no_errors(
    replay: Callable[..., ReplayResult], room_dataset: Dataset
) -> None:
    assert room_dataset.ground_truth is not None
    truth = room_dataset.ground_truth.copy()
    truth[room_dataset.query_indices] = np.nan
    result = replay(dataclasses.replace(room_dataset, ground_truth=truth), max_images=2)
    assert result.errors is None and result.odometry_errors is None
    assert "errors" not in result.metrics()


def test_a_black_image_changes_no_weight(
    replay: Callable[..., ReplayResult], tmp_path: Path
) -> None:
    import cv2

    folder = room.write_room(tmp_path / "room")
    cv2.imwrite(str(folder / "images" / "000013.png"), np.zeros((128, 512), np.uint8))
    result = replay(load_folder(folder), max_images=3)
    black = result.steps[1]
    assert black.num_references == black.num_matches == 0
    assert not black.estimate.degenerate and np.isfinite(black.estimate.pose).all()
    assert result.errors is not None and result.errors.position[2] < 0.3


def test_images_of_another_place_are_no_catastrophe(
    replay: Callable[..., ReplayResult], room_dataset: Dataset, tmp_path: Path
) -> None:
    """All mismatches: every query shows a room that is not in the map."""
    elsewhere = load_folder(room.write_room(tmp_path / "other", seed=9))
    mixed = dataclasses.replace(
        room_dataset, image_paths=(*room_dataset.image_paths[:12], *elsewhere.image_paths[12:])
    )
    result = replay(mixed, max_images=3)
    assert np.isfinite(result.estimates).all()


@pytest.mark.parametrize(
    ("change", "how", "message"),
    [
        ({"odometry": None, "ground_truth": None, "reference_indices": []}, {}, "no reference"),
        ({"query_indices": []}, {}, "none is left to localize"),
        ({}, {"max_images": 0}, "max_images: expected at least 1"),
        ({"query_indices": np.arange(24)}, {"leave_one_out": False}, "both references and queries"),
    ],
)
def test_datasets_that_cannot_be_replayed(
    replay: Callable[..., ReplayResult],
    room_dataset: Dataset,
    change: dict[str, object],
    how: dict[str, object],
    message: str,
) -> None:
    dataset = dataclasses.replace(room_dataset, **change)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=message):
        replay(dataset, **how)


def test_a_start_without_truth_is_refused(
    replay: Callable[..., ReplayResult], room_dataset: Dataset
) -> None:
    assert room_dataset.ground_truth is not None
    truth = room_dataset.ground_truth.copy()
    truth[room_dataset.query_indices[0]] = np.nan
    dataset = dataclasses.replace(room_dataset, ground_truth=truth)
    with pytest.raises(ValueError, match="no true pose to start from"):
        replay(dataset, options={"start": "truth"})


def test_options_reach_extractor_and_motion(room_dataset: Dataset) -> None:
    options = ReplayOptions(
        motion="omnidirectional", strafe_noise_from_translation=0.5, detector="orb", max_features=9
    )
    motion = make_motion(options)
    assert getattr(motion, "strafe_noise_from_translation") == 0.5  # noqa: B009
    extractor = make_extractor(room_dataset, options)
    assert extractor.detector == "orb" and extractor.max_features == 9
