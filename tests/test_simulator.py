"""The simulator of pairs: its naive twin draw by draw, and its statistics at 5 standard errors."""

from __future__ import annotations

import dataclasses

import naive
import numpy as np
import pytest

from pflut.geometry import bearing_vectors, wrap_to_pi
from pflut.simulation.correspondence_kernels import _ball_point, _box_point, _scene
from pflut.simulation.correspondences import CorrespondenceSimulator

SIGMAS = 5.0
FIELD = (np.radians(90), np.radians(70))
# what a pair may be made of besides the paper's
VARIATIONS = [
    {},
    {"scene": "box"},
    {"field_of_view": FIELD},
    {"field_of_view": FIELD, "scene": "box", "max_turn": 0.8},
]


def uniform_share(values: np.ndarray, bins: int, total: float) -> None:
    """Assert that values are uniform over [0, total): every bin within 5 standard errors."""
    counts = np.histogram(values, bins, (0.0, total))[0]
    expected = len(values) / bins
    assert counts.sum() == len(values)
    assert np.abs(counts - expected).max() < SIGMAS * np.sqrt(expected)


@pytest.mark.parametrize(
    "options",
    [
        {"mismatch": 0.0, "noise": 0.0},
        {"mismatch": 0.5, "noise": 0.01},
        {"mismatch": 1.0, "noise": 0.3, "max_tilt": 0.25, "radius": 5.0},
        {"mismatch": 0.5, "max_tilt": 0.25, "scene": "box"},
        {"mismatch": 0.5, "noise": 0.002, "field_of_view": FIELD},
        {"mismatch": 0.5, "max_tilt": 0.25, "field_of_view": FIELD, "radius": 3.0, "max_turn": 2.0},
        {"mismatch": 0.5, "max_tilt": 0.25, "field_of_view": FIELD, "scene": "box"},
        # so narrow that some pairs are drawn anew
        {"mismatch": 0.5, "noise": 0.0, "field_of_view": (0.7, 0.5), "scene": "box"},
    ],
)
def test_equals_its_naive_twin(options: dict) -> None:
    simulator = CorrespondenceSimulator(**options)
    headings, bearings = simulator.sample_slopes(20, 7, 42)
    state = np.random.default_rng(42).integers(0, 2**64, size=1, dtype=np.uint64)[0]
    settings = dataclasses.asdict(simulator)
    expected_headings, expected = naive.simulate(state, 20, 7, **settings)
    assert np.abs(wrap_to_pi(headings - expected_headings)).max() < 1e-8
    assert np.abs(wrap_to_pi(bearings[..., ::2] - expected[..., ::2])).max() < 1e-8
    assert np.arctan(bearings[..., 1::2]) == pytest.approx(np.arctan(expected[..., 1::2]), abs=1e-8)


def test_samples_of_a_seed_stay_what_they_were() -> None:
    """Tables are learned again, and published numbers move, when a stream of draws changes."""
    headings, bearings = CorrespondenceSimulator().sample_slopes(8, 25, 123)
    assert headings[0] == pytest.approx([4.03908293, 1.27065412], abs=1e-7)
    first = [2.21633012, -1.78810537, 2.57560972, -0.8672046]
    last = [3.05855179, 1.2657668, 1.05700376, 1.37327823]
    assert bearings[0, 0] == pytest.approx(first, abs=1e-7)
    assert bearings[-1, -1] == pytest.approx(last, abs=1e-7)
    assert (headings.sum(), bearings.sum()) == pytest.approx((45.0471547288, -34.7625177396))
    other = CorrespondenceSimulator(mismatch=0.5, max_tilt=0.2, noise=0.02, radius=3.0)
    headings, bearings = other.sample_slopes(8, 25, 123)
    assert (headings.sum(), bearings.sum()) == pytest.approx((52.7900025763, -19.8202155324))


def test_angles_are_those_of_the_slopes() -> None:
    simulator = CorrespondenceSimulator(max_tilt=0.2)
    headings, slopes = simulator.sample_slopes(50, 9, 1)
    same, angles = simulator.sample(50, 9, 1)
    assert (same == headings).all()
    assert np.abs(wrap_to_pi(angles[..., ::2] - slopes[..., ::2])).max() < 1e-12
    assert np.tan(angles[..., 1::2]) == pytest.approx(slopes[..., 1::2])
    for values in (headings, angles[..., ::2]):
        assert (values >= 0).all()
        assert (values < 2 * np.pi).all()


def test_the_same_seed_gives_the_same_pairs() -> None:
    simulator = CorrespondenceSimulator()
    first, again, other = (simulator.sample(3, 4, seed)[1] for seed in (5, 5, 6))
    assert (first == again).all()
    assert (first != other).all()
    generator = np.random.default_rng(5)
    assert (simulator.sample(3, 4, generator)[1] == first).all()
    assert (simulator.sample(3, 4, generator)[1] != first).all()


@pytest.mark.parametrize("scene", ["ball", "box"])
def test_headings_of_panoramas_are_uniform(scene: str) -> None:
    headings, _ = CorrespondenceSimulator(scene=scene).sample(40_000, 1, 0)
    for values in headings.T:
        uniform_share(values, 32, 2 * np.pi)
    # and independent of each other: so is their sum
    uniform_share(headings.sum(axis=1) % (2 * np.pi), 32, 2 * np.pi)


@pytest.mark.parametrize("options", VARIATIONS)
def test_noise_free_matches_fulfil_the_geometry(options: dict) -> None:
    simulator = CorrespondenceSimulator(mismatch=0.0, noise=0.0, **options)
    headings, angles = simulator.sample(400, 10, 2)
    for pose, pair in zip(headings, angles, strict=True):
        for bearing in pair:
            assert abs(naive.epipolar_value(bearing, *pose)) < 1e-8
            assert (naive.planar_depths(bearing, *pose) > 0).all()


def test_ball_points_are_uniform_in_the_ball() -> None:
    state = np.array([7], dtype=np.uint64)
    with np.errstate(over="ignore"):
        points = np.array([_ball_point(state, 2.0) for _ in range(20_000)])
    distance = np.linalg.norm(points, axis=1)
    uniform_share((distance / 2) ** 3, 20, 1.0)
    uniform_share(0.5 + 0.5 * points[:, 2] / distance, 20, 1.0)
    uniform_share(np.arctan2(points[:, 1], points[:, 0]) % (2 * np.pi), 20, 2 * np.pi)


def test_box_points_are_uniform_on_the_area_of_the_walls() -> None:
    lower, upper = np.array([-1.5, -2.5, -0.5]), np.array([3.0, 1.2, 1.1])
    room = tuple(float(edge) for edge in np.stack([lower, upper], 1).ravel())
    state = np.array([8], dtype=np.uint64)
    with np.errstate(over="ignore"):
        points = np.array([_box_point(state, room) for _ in range(30_000)])
    assert (points > lower - 1e-9).all()
    assert (points < upper + 1e-9).all()
    on = np.concatenate([np.abs(points - face) < 1e-9 for face in (lower, upper)], axis=1)
    assert (on.sum(axis=1) == 1).all()
    size = upper - lower
    area = np.tile(size.prod() / size, 2)
    expected = len(points) * area / area.sum()
    assert np.abs(on.sum(axis=0) - expected).max() < SIGMAS * np.sqrt(expected.max())
    for face in range(6):
        along = np.delete((points[on[:, face]] - lower) / size, face % 3, axis=1)
        for values in along.T:
            uniform_share(values, 8, 1.0)
        assert abs(np.corrcoef(along.T)[0, 1]) < SIGMAS / np.sqrt(len(along))


def test_rooms_and_the_cameras_in_them() -> None:
    state = np.array([9], dtype=np.uint64)
    with np.errstate(over="ignore"):
        scenes = [_scene(state, True) for _ in range(20_000)]
    rooms = np.array([scene[0] for scene in scenes])
    distance = rooms * [-1, 1, -1, 1, -1, 1]
    for walls, nearest, farthest in ((distance[:, :4], 1.2, 3.0), (distance[:, 4:], 0.4, 1.2)):
        for values in walls.T:
            uniform_share(values - nearest, 16, farthest - nearest)
    positions = np.array([scene[1:] for scene in scenes])
    low = np.tile(rooms[:, [0, 2]], 2) + 0.2
    high = np.tile(rooms[:, [1, 3]], 2) - 0.2
    shares = (positions - low) / (high - low)
    for values in shares.T:
        uniform_share(values, 16, 1.0)
    # everything is drawn by itself
    mixed = np.corrcoef(np.hstack([distance, shares]).T) - np.eye(10)
    assert np.abs(mixed).max() < SIGMAS / np.sqrt(len(scenes))


def test_noise_is_isotropic_and_as_large_as_said() -> None:
    """Along either tangent of the sphere; the same stream without noise has the true bearings."""
    noise = 0.01
    clean = CorrespondenceSimulator(mismatch=0.0, noise=0.0).sample(5000, 8, 4)[1]
    noisy = CorrespondenceSimulator(mismatch=0.0, noise=noise).sample(5000, 8, 4)[1]
    for side in (0, 2):
        azimuth, elevation = clean[..., side], clean[..., side + 1]
        away = np.abs(elevation) < 1.2  # near the zenith the two tangents turn with the azimuth
        across = wrap_to_pi(noisy[..., side] - azimuth)[away] * np.cos(elevation[away])
        upward = (noisy[..., side + 1] - elevation)[away]
        n = away.sum()
        assert n > 30_000
        for moved in (across, upward):
            assert abs(moved.mean()) < SIGMAS * noise / np.sqrt(n) + 1e-4
            # second-order terms of the projection: below 1 % here
            assert abs(moved.std() / noise - 1) < SIGMAS / np.sqrt(2 * n) + 0.01
        assert abs(np.corrcoef(across, upward)[0, 1]) < SIGMAS / np.sqrt(n)
        steep = ~away
        angle = np.arccos(
            (
                bearing_vectors(azimuth[steep], elevation[steep])
                * bearing_vectors(noisy[..., side][steep], noisy[..., side + 1][steep])
            )
            .sum(axis=-1)
            .clip(-1, 1)
        )
        # the squared angle is noise^2 times a chi-square of two degrees
        mean = (angle**2).mean() / noise**2
        assert abs(mean - 2) < SIGMAS * 2 / np.sqrt(steep.sum()) + 0.01


@pytest.mark.parametrize("options", VARIATIONS)
def test_share_and_place_of_the_mismatches(options: dict) -> None:
    for mismatch, n, expected in ((0.0, 40, 0), (0.25, 40, 10), (0.9, 25, 22), (1.0, 7, 7)):
        simulator = CorrespondenceSimulator(mismatch=mismatch, noise=0.0, **options)
        headings, angles = simulator.sample(100, n, 5)
        wrong = np.array(
            [
                [abs(naive.epipolar_value(b, *pose)) > 1e-8 for b in pair]
                for pose, pair in zip(headings, angles, strict=True)
            ]
        )
        assert wrong[:, :expected].all()
        assert not wrong[:, expected:].any()


def test_tilt_is_uniform_and_moves_one_view_only() -> None:
    tilt = 0.25
    level = CorrespondenceSimulator(mismatch=0.0, noise=0.0)
    tilted = CorrespondenceSimulator(mismatch=0.0, noise=0.0, max_tilt=tilt)
    headings, flat = level.sample(4000, 5, 6)
    same, turned = tilted.sample(4000, 5, 6)
    assert (headings == same).all()
    assert (flat[..., :2] == turned[..., :2]).all()
    roll, pitch = [], []
    for before, after in zip(flat[..., 2:], turned[..., 2:], strict=True):
        # Kabsch: the rotation between the two bundles, pitch about y after roll about x
        a, b = bearing_vectors(*before.T), bearing_vectors(*after.T)
        u, _, vt = np.linalg.svd(b.T @ a)
        matrix = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
        roll.append(np.arctan2(-matrix[1, 2], matrix[1, 1]))
        pitch.append(np.arctan2(-matrix[2, 0], matrix[0, 0]))
        rebuilt = naive.rotation("y", pitch[-1]) @ naive.rotation("x", roll[-1])
        assert np.abs(rebuilt - matrix).max() < 1e-6
    for angles in (np.array(roll), np.array(pitch)):
        assert np.abs(angles).max() < tilt
        uniform_share(angles + tilt, 10, 2 * tilt)


def image_points(angles: np.ndarray) -> np.ndarray:
    """Left and up at unit focal length of L, then of R."""
    left = np.tan(angles[..., ::2])
    up = np.tan(angles[..., 1::2]) * np.hypot(1.0, left)
    return np.stack([left, up], axis=-1)


@pytest.mark.parametrize("scene", ["ball", "box"])
@pytest.mark.parametrize("max_tilt", [0.0, 0.25])
def test_field_of_view_holds_in_both_views(scene: str, max_tilt: float) -> None:
    """Of matches and mismatches alike; and the images are filled to their edges."""
    simulator = CorrespondenceSimulator(
        mismatch=0.5, noise=0.0, max_tilt=max_tilt, scene=scene, field_of_view=FIELD
    )
    angles = simulator.sample(2000, 10, 3)[1]
    assert (np.cos(angles[..., ::2]) > 0).all()
    share = image_points(angles) / np.tan(np.array(FIELD) / 2)
    assert np.abs(share).max() <= 1 + 1e-7
    for side in (0, 1):
        for way in (-1, 1):
            assert (way * share[..., side, :] > 0.95).any(axis=(0, 1)).all()


def test_noise_of_images_is_isotropic_in_the_image_plane() -> None:
    """The same stream without noise has the true image points."""
    pixel = 0.002
    options = {"mismatch": 0.5, "field_of_view": FIELD, "scene": "box", "max_tilt": 0.1}
    clean = CorrespondenceSimulator(noise=0.0, **options).sample(3000, 10, 4)[1]
    noisy = CorrespondenceSimulator(noise=pixel, **options).sample(3000, 10, 4)[1]
    moved = (image_points(noisy) - image_points(clean)).reshape(-1, 4) / pixel
    n = len(moved)
    assert np.abs(moved.mean(axis=0)).max() < SIGMAS / np.sqrt(n)
    assert np.abs(moved.std(axis=0) - 1).max() < SIGMAS / np.sqrt(2 * n)
    assert np.abs(np.corrcoef(moved.T) - np.eye(4)).max() < SIGMAS / np.sqrt(n)
    # near the edges of the image as in its middle
    left = np.abs(image_points(clean)[..., 0, 0].ravel())
    for where in (left > 0.7, left < 0.3):
        assert abs(moved[where, 0].std() - 1) < SIGMAS / np.sqrt(2 * where.sum())


def test_views_with_a_field_look_roughly_the_same_way() -> None:
    for max_turn in (0.0, 0.3, np.pi):
        # of a field so wide that hardly a pair is drawn anew
        simulator = CorrespondenceSimulator(field_of_view=(3.1, 3.1), max_turn=max_turn)
        headings, _ = simulator.sample(5000, 1, 5)
        turn = wrap_to_pi(headings[:, 0] - headings[:, 1] + np.pi)
        assert np.abs(turn).max() <= max_turn + 1e-9
        if 0.0 < max_turn < 1.0:
            uniform_share(turn + max_turn, 16, 2 * max_turn)
        uniform_share(headings[:, 0], 16, 2 * np.pi)


def test_a_field_that_shares_nothing_is_told() -> None:
    simulator = CorrespondenceSimulator(field_of_view=(1e-6, 1e-6))
    with pytest.raises(ValueError, match=r"^field_of_view: expected views that share landmarks"):
        simulator.sample(2, 3, 0)
    assert simulator.sample(2, 0, 0)[1].shape == (2, 0, 4)


def test_pair_is_a_sample() -> None:
    simulator = CorrespondenceSimulator(mismatch=0.5)
    headings, angles = simulator.sample(1, 12, 9)
    c, heading_l, heading_r = simulator.pair(12, 9)
    assert (heading_l, heading_r) == tuple(headings[0])
    assert (np.stack([c.azimuth_l, c.elevation_l, c.azimuth_r, c.elevation_r], 1) == angles).all()
    assert len(simulator.pair(0, 9)[0]) == 0


@pytest.mark.parametrize(
    "options",
    [
        {"mismatch": -0.1},
        {"mismatch": 1.5},
        {"mismatch": np.nan},
        {"noise": -0.01},
        {"noise": np.nan},
        {"max_tilt": 2.0},
        {"radius": 0.0},
        {"radius": np.inf},
        {"radius": 3.0, "scene": "box"},
        {"scene": "cube"},
        {"field_of_view": (1.0, np.pi)},
        {"field_of_view": (0.0, 1.0)},
        {"field_of_view": (1.0, np.nan)},
        {"field_of_view": (1.0,)},
        {"field_of_view": 1.0},
        {"max_turn": -0.1, "field_of_view": FIELD},
        {"max_turn": 4.0, "field_of_view": FIELD},
        {"max_turn": np.nan, "field_of_view": FIELD},
        {"max_turn": 0.1},
    ],
)
def test_misuse_names_the_option(options: dict) -> None:
    with pytest.raises(ValueError, match=f"^{next(iter(options))}: expected"):
        CorrespondenceSimulator(**options)


def test_pairs_are_the_samples_in_no_order() -> None:
    simulator = CorrespondenceSimulator(mismatch=0.5)
    headings, bearings = simulator.sample(200, 10, rng=3)
    pairs, truth = simulator.pairs(200, 10, rng=3)
    np.testing.assert_array_equal(truth, headings)
    places = []
    for c, rows in zip(pairs, bearings, strict=True):
        found = np.stack([c.azimuth_l, c.elevation_l, c.azimuth_r, c.elevation_r], axis=1)
        order = [int(np.abs(rows - row).sum(axis=1).argmin()) for row in found]
        assert sorted(order) == list(range(10))
        places += [k for k, place in enumerate(order) if place < 5]
    # mismatches stand anywhere: five standard deviations of a binomial at each of ten places
    assert np.abs(np.bincount(places, minlength=10) - 100).max() < 5 * np.sqrt(200 * 0.25)
    assert simulator.pairs(0, 10)[0] == []
