"""The paper's simulator: its naive twin draw by draw, and its statistics at 5 standard errors."""

from __future__ import annotations

import naive
import numpy as np
import pytest

from pflut.geometry import bearing_vectors, wrap_to_pi
from pflut.simulation.correspondences import CorrespondenceSimulator, _ball_point

SIGMAS = 5.0


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
    ],
)
def test_equals_its_naive_twin(options: dict) -> None:
    simulator = CorrespondenceSimulator(**options)
    headings, bearings = simulator.sample_slopes(20, 7, 42)
    state = np.random.default_rng(42).integers(0, 2**64, size=1, dtype=np.uint64)[0]
    settings = {
        name: getattr(simulator, name) for name in ("mismatch", "noise", "max_tilt", "radius")
    }
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


def test_headings_are_uniform() -> None:
    headings, _ = CorrespondenceSimulator().sample(40_000, 1, 0)
    for values in headings.T:
        uniform_share(values, 32, 2 * np.pi)
    # and independent of each other: so is their sum
    uniform_share(headings.sum(axis=1) % (2 * np.pi), 32, 2 * np.pi)


def test_noise_free_matches_fulfil_the_geometry() -> None:
    headings, angles = CorrespondenceSimulator(mismatch=0.0, noise=0.0).sample(400, 10, 2)
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


def test_share_and_place_of_the_mismatches() -> None:
    for mismatch, n, expected in ((0.0, 40, 0), (0.25, 40, 10), (0.9, 25, 22), (1.0, 7, 7)):
        headings, angles = CorrespondenceSimulator(mismatch=mismatch, noise=0.0).sample(200, n, 5)
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
    ],
)
def test_misuse_names_the_option(options: dict) -> None:
    with pytest.raises(ValueError, match=f"^{next(iter(options))}: expected"):
        CorrespondenceSimulator(**options)
