"""Homes of landmarks: what is seen from where, and what is matched with what."""

from __future__ import annotations

import naive
import numpy as np
import pytest

from pflut.geometry import relative_headings, wrap_to_pi
from pflut.simulation.corridor import LENGTH, SEGMENT
from pflut.simulation.crowd import Crowd
from pflut.simulation.landmark_home import LandmarkHome, landmark_home
from pflut.simulation.landmark_images import (
    DISTANCE_SCALE,
    VIEW_SCALE,
    LandmarkImages,
    LandmarkMatcher,
    expected_matches,
)
from pflut.simulation.landmark_kernels import see
from pflut.simulation.landmarks import LandmarkBuilder, Landmarks, scatter

SIGMAS = 5.0
NOBODY = np.empty((0, 3))


@pytest.fixture(scope="module")
def home() -> LandmarkHome:
    return landmark_home("home", 0)


@pytest.fixture(scope="module")
def corridor() -> LandmarkHome:
    return landmark_home("corridor", 0)


def some_of(landmarks: Landmarks, step: int) -> Landmarks:
    return Landmarks(landmarks.points[::step], landmarks.facing[::step], landmarks.looks[::step])


def images_at(
    poses: np.ndarray,
    home: LandmarkHome,
    *,
    landmarks: Landmarks | None = None,
    noise: float = 0.0,
    detected: float = 1.0,
    people: np.ndarray = NOBODY,
    seed: int = 0,
) -> LandmarkImages:
    there = home.landmarks if landmarks is None else landmarks
    images = LandmarkImages.empty(np.atleast_2d(poses), len(there))
    for i in range(len(images)):
        rng = np.random.default_rng([seed, i])
        images.take(i, there, home.walls, people, noise=noise, detected=detected, rng=rng)
    return images


def as_dict(images: LandmarkImages, i: int) -> dict:
    columns = (images.azimuth, images.elevation, images.view, images.log_distance)
    return {int(k): tuple(float(c[i, k]) for c in columns) for k in np.flatnonzero(images.seen[i])}


def residuals(
    left: LandmarkImages, right: LandmarkImages, pairs: np.ndarray, pose: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The planar epipolar constraint and the sines whose signs tell the depths."""
    theta, phi, _ = relative_headings(left.poses[0], pose)
    u, v = theta - left.azimuth[0, pairs[:, 0]], phi - right.azimuth[0, pairs[:, 1]]
    tan_l = np.tan(left.elevation[0, pairs[:, 0]])
    tan_r = np.tan(right.elevation[0, pairs[:, 1]])
    return tan_r * np.sin(u) + tan_l * np.sin(v), -np.sin(u) * np.sin(v)


@pytest.mark.parametrize("detected, noise", [(1.0, 0.0), (0.6, 0.01), (0.5, 0.3)])
def test_seeing_equals_its_naive_twin(home: LandmarkHome, detected: float, noise: float) -> None:
    landmarks = some_of(home.landmarks, 4)
    rng = np.random.default_rng(1)
    for pose in home.mapping.poses[rng.permutation(len(home.mapping.poses))[:4]]:
        around, apart = rng.uniform([0.0, 0.7], [2.0 * np.pi, 3.0], (10, 2)).T
        beside = np.column_stack([apart * np.cos(around), apart * np.sin(around), around])
        people = pose * [1.0, 1.0, 0.0] + beside
        n = len(landmarks)
        seen, columns = np.empty(n, bool), np.zeros((4, n))
        args = (pose, landmarks.points, landmarks.facing, home.walls, people, detected, noise)
        see(*args, np.array([7], np.uint64), seen, *columns)
        expected = naive.landmark_image(*args, naive.SplitMix(7))
        assert len(expected) > 10
        assert np.flatnonzero(seen).tolist() == list(expected)
        difference = columns.T[seen] - np.array(list(expected.values()))
        difference[:, 0] = wrap_to_pi(difference[:, 0])
        assert np.abs(difference).max() < 1e-9
        # some are hidden by the people alone
        see(*args[:4], NOBODY, *args[5:], np.array([7], np.uint64), seen, *columns)
        assert seen.sum() > len(expected)


def test_matching_equals_its_naive_twin(corridor: LandmarkHome) -> None:
    landmarks = some_of(corridor.landmarks, 3)
    poses = np.array([[7.0, 1.0, 0.3], [7.5, 1.2, 2.0], [10.2, 1.0, 0.0], [22.0, 1.1, 0.0]])
    references = images_at(poses, corridor, landmarks=landmarks, detected=0.6)
    image = images_at(np.array([7.3, 1.3, -1.0]), corridor, landmarks=landmarks, detected=0.6)
    matcher = LandmarkMatcher(landmarks.copies, 0.8, 5.0)
    counts, pairs = matcher.match(references, image, rng=np.random.default_rng(3))
    rng = np.random.default_rng(3)
    wrong = rng.poisson(5.0, 4)
    random = naive.SplitMix(rng.integers(2**64, size=1, dtype=np.uint64)[0])
    dicts = [as_dict(references, i) for i in range(4)]
    shown = as_dict(image, 0)
    scales = VIEW_SCALE, DISTANCE_SCALE
    expected = naive.match_landmarks(
        dicts, shown, landmarks.looks, 0.8, *scales, wrong.tolist(), random
    )
    assert counts.tolist() == [len(some) for some in expected]
    assert [tuple(pair) for pair in pairs.tolist()] == [pair for some in expected for pair in some]
    # the last reference is farther than 5 m
    near = [(j, d) for d in dicts[:3] for j in shown]
    best = [(j, *naive.most_alike(j, shown, d, landmarks.looks, *scales)) for j, d in near]
    own = [lead for j, k, lead in best if k == j]
    copied = [lead for j, k, lead in best if k not in (j, -1)]
    assert len(own) > 10 and len(copied) > 10
    found = expected_matches(references, image, landmarks.copies)
    assert found == pytest.approx([sum(own) / 3, sum(copied) / 3], rel=1e-9)


def test_copies_are_a_ring_through_what_looks_alike() -> None:
    looks = np.array([4, 0, 4, 1, 4, 0])
    copies = Landmarks(np.zeros((6, 3)), np.zeros(6), looks).copies
    assert copies.tolist() == [2, 5, 4, 3, 0, 1]


def test_surfaces_look_to_the_right() -> None:
    builder = LandmarkBuilder([])
    builder.add(np.array([[1.0, 0.5]]), (2.0, 3.0), 0.5 * np.pi)
    builder.add(np.array([[1.0, 0.5], [0.0, 1.0]]), (0.0, 0.0), 0.0)
    landmarks = builder.finish()
    assert landmarks.points == pytest.approx(
        np.array([[2.0, 4.0, 0.5], [1.0, 0.0, 0.5], [0.0, 0.0, 1.0]])
    )
    assert landmarks.facing == pytest.approx([0.0, -0.5 * np.pi, -0.5 * np.pi])
    assert landmarks.looks.tolist() == [0, 1, 2]


def test_walls_hide_the_other_rooms(home: LandmarkHome) -> None:
    """What is seen has no wall in between, and what is not seen though it might be has one."""
    images = images_at(home.mapping.poses, home)
    blocked = 0
    for i in range(0, len(images), 20):
        pose = images.poses[i]
        for k in np.flatnonzero(images.seen[i])[::5]:
            point = home.landmarks.points[k, :2]
            assert not any(naive.crosses(pose[:2], point, wall) for wall in home.walls)
        offsets = home.landmarks.points[:, :2] - pose[:2]
        distance = np.hypot(offsets[:, 0], offsets[:, 1])
        facing = np.column_stack([np.cos(home.landmarks.facing), np.sin(home.landmarks.facing)])
        front = -(facing * offsets).sum(axis=1) > 0.2 * distance
        low = np.abs(home.landmarks.points[:, 2] - 1.2) < 0.5 * distance
        hidden = front & low & (distance > 0.4) & (distance < 5.9) & ~images.seen[i]
        for k in np.flatnonzero(hidden)[::5]:
            point = home.landmarks.points[k, :2]
            assert any(naive.crosses(pose[:2], point, wall) for wall in home.walls)
            blocked += 1
    assert blocked > 100


@pytest.mark.parametrize("plan", ["home", "corridor"])
def test_landmarks_stand_between_floor_and_ceiling_inside(plan: str) -> None:
    home = landmark_home(plan, 1)  # type: ignore[arg-type]
    low, high = np.array(home.bounds).reshape(2, 2)
    points = home.landmarks.points
    assert (points[:, :2] > low - 1e-9).all() and (points[:, :2] < high + 1e-9).all()
    assert points[:, 2].min() > 0.0 and points[:, 2].max() < 2.6
    assert points[:, 2].min() < 0.2 and points[:, 2].max() > 2.4
    for poses in (home.mapping.poses, home.plan_drive(rng=3).poses):
        assert (poses[:, :2] > low).all() and (poses[:, :2] < high).all()
        # from everywhere there is enough to see
        assert images_at(poses, home).seen.sum(axis=1).min() > 50


def test_a_match_without_noise_fits_the_true_pose(home: LandmarkHome) -> None:
    poses = home.mapping.poses
    left, right = images_at(poses[10], home), images_at(poses[12], home)
    both = np.flatnonzero(left.seen[0] & right.seen[0])
    assert len(both) > 100
    pairs = np.column_stack([both, both])
    planar, depths = residuals(left, right, pairs, poses[12])
    assert np.abs(planar).max() < 1e-9
    assert depths.min() > -1e-12 and np.median(depths) > 0.01
    wrong = np.column_stack([both, np.roll(both, 5)])
    assert np.median(np.abs(residuals(left, right, wrong, poses[12])[0])) > 0.05


def test_noise_is_isotropic_on_the_sphere(home: LandmarkHome) -> None:
    pose, noise = home.mapping.poses[20], 0.01
    exact = images_at(pose, home)
    noisy = images_at(np.repeat(pose[None], 40, axis=0), home, noise=noise)
    seen = exact.seen[0]
    across = wrap_to_pi(noisy.azimuth[:, seen] - exact.azimuth[0, seen])
    across = (across * np.cos(exact.elevation[0, seen])).ravel()
    up = (noisy.elevation[:, seen] - exact.elevation[0, seen]).ravel()
    n = len(up)
    for errors in (across, up):
        assert abs(errors.mean()) < SIGMAS * noise / np.sqrt(n)
        assert abs(errors.std() - noise) < SIGMAS * noise / np.sqrt(2 * n)
    assert abs((across * up).mean()) < SIGMAS * noise**2 / np.sqrt(n)


def test_detection_takes_its_share(home: LandmarkHome) -> None:
    poses = home.mapping.poses
    visible = images_at(poses, home).seen
    found = images_at(poses, home, detected=0.3).seen
    assert not (found & ~visible).any()
    n = visible.sum()
    assert abs(found.sum() - 0.3 * n) < SIGMAS * np.sqrt(n * 0.3 * 0.7)


def test_matches_become_fewer_with_distance_as_in_the_rendered_home(home: LandmarkHome) -> None:
    """`python sims/home_matches.py`: 37 true matches at 0.3 m, 11 at 1.25 m, 3 at 2.25 m."""
    references = images_at(home.mapping.poses, home, detected=0.6)
    queries = images_at(home.plan_drive(rng=0).poses, home, detected=0.6, seed=1)
    matcher = LandmarkMatcher(home.landmarks.copies, 0.35, 0.0)
    distance, true = [], []
    for i in range(len(queries)):
        image = images_at(queries.poses[i], home, detected=0.6, seed=100 + i)
        counts, pairs = matcher.match(references, image, rng=np.random.default_rng(i))
        which = np.repeat(np.arange(len(counts)), counts)
        true.append(np.bincount(which[pairs[:, 0] == pairs[:, 1]], minlength=len(counts)))
        distance.append(np.hypot(*(references.poses - image.poses[0])[:, :2].T))
    apart, number = np.concatenate(distance), np.concatenate(true)
    for low, high, expected in ((0.2, 0.4, 37), (1.0, 1.5, 11), (2.0, 2.5, 3.1)):
        mean = number[(apart >= low) & (apart < high)].mean()
        assert 0.6 * expected < mean < 1.6 * expected


def test_a_segment_of_the_corridor_passes_for_the_next(corridor: LandmarkHome) -> None:
    """A reference one segment farther agrees with a place one segment farther than the truth."""
    pose = np.array([9.5, 1.0, 0.4])
    reference = np.array([9.9 + SEGMENT, 1.2, 0.1])
    left, right = images_at(reference, corridor), images_at(pose, corridor)
    matcher = LandmarkMatcher(corridor.landmarks.copies, 1.0, 0.0)
    _, pairs = matcher.match(left, right, rng=np.random.default_rng(0))
    there = residuals(left, right, pairs, pose + np.array([SEGMENT, 0.0, 0.0]))
    here = residuals(left, right, pairs, pose)
    assert len(pairs) > 20
    # what stands at the true place, seen from both, is matched with itself where it is alone
    assert np.mean((np.abs(there[0]) < 1e-9) & (there[1] > -1e-12)) > 0.8
    assert np.mean(np.abs(here[0]) < 1e-6) < 0.2
    # an end is nowhere else
    near, end = (images_at(np.array([LENGTH - x, 1.0, 0.0]), corridor) for x in (2.3, 2.0))
    _, pairs = matcher.match(near, end, rng=np.random.default_rng(0))
    alone = np.bincount(corridor.landmarks.looks)[corridor.landmarks.looks[pairs[:, 1]]] == 1
    assert alone.any() and (pairs[alone, 0] == pairs[alone, 1]).all()


def test_people_are_seen_where_they_stand_and_keep_away(home: LandmarkHome) -> None:
    crowd = Crowd.gather(home.mapping.path, 3, np.random.default_rng(0))
    robot = home.mapping.poses[5]
    poses = crowd.poses(10.0, robot)
    assert poses.shape == (3, 3)
    assert crowd.poses(10.0, poses[1])[1, 0] > 1e5
    among = crowd.among(home.landmarks, poses)
    n = len(home.landmarks)
    worn = among.points[n:].reshape(3, -1, 3)
    assert np.hypot(*(worn[..., :2] - poses[:, None, :2]).T) == pytest.approx(0.2)
    assert len(np.unique(among.looks[n:])) == worn.shape[0] * worn.shape[1]
    assert among.looks[n:].min() > home.landmarks.looks.max()
    # somebody 1 m ahead shows a side and hides what is behind
    close = np.array([[robot[0] + np.cos(robot[2]), robot[1] + np.sin(robot[2]), 0.5]])
    alone = Crowd(crowd.path, crowd.delays[:1], crowd.patterns[:1])
    everything = alone.among(home.landmarks, close)
    image = images_at(robot, home, landmarks=everything, people=close)
    shown = image.seen[0, n:]
    assert 5 < shown.sum() < 25
    assert np.abs(wrap_to_pi(image.azimuth[0, n:][shown])).max() < 0.21
    hidden = images_at(robot, home).seen[0] & ~image.seen[0, :n]
    assert hidden.any()
    assert crowd.among(home.landmarks, poses).copies[n:].tolist() == list(range(n, len(among)))


def test_furniture_of_a_size_and_doors_look_alike(home: LandmarkHome) -> None:
    looks, number = np.unique(home.landmarks.looks, return_counts=True)
    assert (number == 1).sum() > 500 and (number > 1).sum() > 100
    for look in looks[number > 1][::40]:
        alike = home.landmarks.points[home.landmarks.looks == look]
        assert np.ptp(alike[:, 2]) < 1e-9
        assert np.hypot(*np.ptp(alike[:, :2], axis=0)) > 0.1


def test_scatter_is_uniform_on_its_rectangle() -> None:
    pattern = scatter(np.random.default_rng(0), 10_000, 3.0, 0.5, 2.5)
    assert pattern.min(axis=0) == pytest.approx([0.0, 0.5], abs=0.01)
    assert pattern.max(axis=0) == pytest.approx([3.0, 2.5], abs=0.01)
    spread = np.array([3.0, 2.0]) / np.sqrt(12 * 10_000)
    assert (np.abs(pattern.mean(axis=0) - [1.5, 1.5]) < SIGMAS * spread).all()


def test_a_home_is_made_once() -> None:
    assert landmark_home("corridor", 3) is landmark_home("corridor", 3)
    landmark_home.cache_clear()
    again = landmark_home("corridor", 3)
    landmark_home.cache_clear()
    assert (
        again.landmarks.points.tobytes() == landmark_home("corridor", 3).landmarks.points.tobytes()
    )


@pytest.mark.parametrize(
    "plan, seed, message",
    [("castle", 0, "plan: expected"), ("home", -1, "seed: expected"), ("home", 0.5, "seed: ")],
)
def test_misuse_is_refused(plan, seed, message) -> None:
    with pytest.raises(ValueError, match=message):
        landmark_home(plan, seed)
