"""Motion models: exact means and variances, the cases that odometry models get wrong."""

import naive
import numpy as np
import pytest

from pflut.geometry import compose, wrap_to_pi
from pflut.localization import motion
from pflut.localization.motion import DifferentialDrive, Omnidirectional

MODELS = [
    DifferentialDrive(),
    DifferentialDrive(position_noise=0.03, heading_noise=0.02),
    Omnidirectional(),
    Omnidirectional(position_noise=0.03, heading_noise=0.02),
]
SILENT = {
    "rotation_noise_from_rotation": 0.0,
    "rotation_noise_from_translation": 0.0,
    "translation_noise_from_translation": 0.0,
    "translation_noise_from_rotation": 0.0,
}


def some_poses(n, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform([-5, -5, -np.pi], [5, 5, np.pi], (n, 3))


@pytest.mark.parametrize("turns", [1.0, 1e3])
def test_kernel_equals_its_naive_twin(turns):
    rng = np.random.default_rng(3)
    poses = some_poses(500) * [1, 1, turns]
    normals = rng.standard_normal((4, 500))
    moved = np.array([0.7, 0.4, -2.0])
    stds = np.array([0.5, 0.1, 0.2, 2.0])
    out = np.empty_like(poses)
    motion._move(poses, *normals, moved, stds, out)
    expected = naive.move(poses, normals, moved, stds)
    np.testing.assert_allclose(out[:, :2], expected[:, :2], atol=1e-14 * turns)
    assert (np.abs(out[:, 2]) <= np.pi).all()
    np.testing.assert_allclose(wrap_to_pi(out[:, 2] - expected[:, 2]), 0, atol=1e-14 * turns)


def test_sine_and_cosine_to_the_last_bits():
    angles = np.concatenate([np.linspace(-20, 20, 100_001), np.arange(-40, 41) * np.pi / 4])
    poses = np.column_stack([np.zeros_like(angles), np.zeros_like(angles), angles])
    silent = DifferentialDrive(**SILENT)
    out = silent.sample(poses, [1.0, 0.0, 0.0])
    allowed = 4e-16 + 2e-16 * np.abs(angles)  # no worse than the rounding of the angle
    assert (np.abs(out[:, 0] - np.cos(angles)) <= allowed).all()
    assert (np.abs(out[:, 1] - np.sin(angles)) <= allowed).all()


@pytest.mark.parametrize("model", MODELS)
def test_without_noise_it_is_the_composition_of_poses(model):
    silent = type(model)(
        **SILENT, **({"strafe_noise_from_translation": 0.0} if "Omni" in repr(model) else {})
    )
    poses = some_poses(100)
    for odometry in ([0.3, 0.1, 0.2], [-0.3, 0.0, -3.0], [0.002, -0.004, 0.1], [0.0, 0.0, 1.0]):
        out = silent.sample(poses, odometry, 0)
        expected = compose(poses, odometry)
        np.testing.assert_allclose(out[:, :2], expected[:, :2], atol=1e-14)
        np.testing.assert_allclose(wrap_to_pi(out[:, 2] - expected[:, 2]), 0, atol=1e-14)


def test_zero_motion_moves_nothing_not_by_one_bit():
    poses = some_poses(1000)
    poses[0, 2] = np.pi
    before = poses.copy()
    for model in (DifferentialDrive(), Omnidirectional()):
        np.testing.assert_array_equal(model.sample(poses, [0.0, 0.0, 0.0], 1), before)
    np.testing.assert_array_equal(poses, before)


@pytest.mark.parametrize("model", MODELS)
def test_the_same_seed_gives_the_same_bytes(model):
    poses = some_poses(1000)
    first = model.sample(poses, [0.3, 0.1, 0.2], 42)
    assert first.tobytes() == model.sample(poses, [0.3, 0.1, 0.2], 42).tobytes()
    assert first.tobytes() != model.sample(poses, [0.3, 0.1, 0.2], 43).tobytes()


def check_moments(samples, mean, std):
    """Compare mean and variance at 5 standard errors, the samples being normal."""
    n = len(samples)
    assert abs(samples.mean() - mean) <= 5 * std / np.sqrt(n) + 1e-12
    assert abs(samples.var() - std**2) <= 5 * std**2 * np.sqrt(2 / n) + 1e-12


@pytest.mark.parametrize("floor", [0.0, 0.04])
def test_differential_drive_has_the_variances_of_table_5_6(floor):
    a1, a2, a3, a4 = 0.03, 0.02, 0.05, 0.04
    model = DifferentialDrive(
        rotation_noise_from_rotation=a1,
        rotation_noise_from_translation=a2,
        translation_noise_from_translation=a3,
        translation_noise_from_rotation=a4,
        position_noise=floor,
        heading_noise=2 * floor,
    )
    first, distance, second = 0.6, 0.5, -0.3
    odometry = [distance * np.cos(first), distance * np.sin(first), first + second]
    n = 200_000
    out = model.sample(np.zeros((n, 3)), odometry, 8)
    var_first = a1 * first**2 + a2 * distance**2
    var_along = a3 * distance**2 + a4 * (first**2 + second**2) + floor**2
    var_second = a1 * second**2 + a2 * distance**2 + 4 * floor**2
    check_moments(out[:, 2], first + second, np.sqrt(var_first + var_second))
    # E[(d + n) cos(first + m)] = d cos(first) exp(-var/2), likewise for the sine
    shrink = np.exp(-var_first / 2)
    for k, component in enumerate((np.cos(first), np.sin(first))):
        error = out[:, k].std() / np.sqrt(n)
        assert abs(out[:, k].mean() - distance * component * shrink) <= 5 * error
    squares = (out[:, :2] ** 2).sum(axis=1)
    expected = distance**2 + var_along + floor**2  # the floor is isotropic
    assert abs(squares.mean() - expected) <= 5 * squares.std() / np.sqrt(n)
    # the first rotation turns both where it goes and where it looks
    bearing = np.arctan2(out[:, 1], out[:, 0]) - first
    product = bearing * (out[:, 2] - first - second)
    if floor == 0.0:
        assert abs(product[np.abs(bearing) < 1].mean() - var_first) <= 0.05 * var_first


def test_omnidirectional_has_noise_along_across_and_in_heading():
    a1, a2, a3, a4, a5, position, heading = 0.03, 0.02, 0.05, 0.04, 0.06, 0.05, 0.07
    model = Omnidirectional(
        rotation_noise_from_rotation=a1,
        rotation_noise_from_translation=a2,
        translation_noise_from_translation=a3,
        translation_noise_from_rotation=a4,
        strafe_noise_from_translation=a5,
        position_noise=position,
        heading_noise=heading,
    )
    d, r = 0.5, 0.4
    out = model.sample(np.zeros((200_000, 3)), [0.0, d, r], 9)  # sideways: y is along
    check_moments(out[:, 1], d, np.sqrt(a3 * d**2 + a4 * r**2 + position**2))
    check_moments(out[:, 0], 0.0, np.sqrt(a5 * d**2 + a4 * r**2 + position**2))
    check_moments(out[:, 2], r, np.sqrt(a1 * r**2 + a2 * d**2 + heading**2))
    assert abs(np.corrcoef(out.T)[0, 1]) < 5 / np.sqrt(200_000)


def test_driving_backwards_is_no_turn():
    model = DifferentialDrive(**{**SILENT, "rotation_noise_from_rotation": 0.2})
    out = model.sample(np.zeros((1000, 3)), [-0.5, 0.0, 0.0], 0)
    np.testing.assert_allclose(out, [[-0.5, 0.0, 0.0]] * 1000, atol=1e-12)
    # nor does a slight curve backwards make more noise than the same forwards
    forwards = model.sample(np.zeros((50_000, 3)), [0.5, 0.05, 0.2], 1)
    backwards = model.sample(np.zeros((50_000, 3)), [-0.5, -0.05, 0.2], 1)
    np.testing.assert_allclose(backwards[:, 2].std(), forwards[:, 2].std(), rtol=1e-6)


def test_a_tiny_translation_sideways_is_no_first_rotation():
    model = DifferentialDrive(**{**SILENT, "rotation_noise_from_rotation": 0.2})
    out = model.sample(np.zeros((1000, 3)), [0.0, 0.001, 0.0], 0)
    np.testing.assert_allclose(out, [[0.0, 0.001, 0.0]] * 1000, atol=1e-12)
    out = model.sample(np.zeros((1000, 3)), [0.0, 0.1, 0.0], 0)
    assert out[:, 2].std() > 0.5  # above the threshold it is one, of 90 degrees


def test_the_floor_moves_a_robot_that_stands():
    for model in (
        DifferentialDrive(position_noise=0.02, heading_noise=0.01),
        Omnidirectional(position_noise=0.02, heading_noise=0.01),
    ):
        out = model.sample(np.zeros((100_000, 3)), [0, 0, 0], 4)
        for column, std in zip(out.T, (0.02, 0.02, 0.01), strict=True):
            check_moments(column, 0.0, std)


@pytest.mark.parametrize("model", [DifferentialDrive, Omnidirectional])
def test_bad_parameters_are_refused(model):
    for value in (-0.1, np.nan, np.inf):
        with pytest.raises(ValueError, match="translation_noise_from_rotation: expected"):
            model(translation_noise_from_rotation=value)
    with pytest.raises(ValueError, match="position_noise"):
        model(position_noise=-1.0)


@pytest.mark.parametrize("model", MODELS)
def test_bad_input_is_refused(model):
    poses = some_poses(3)
    for odometry in ([1.0, 2.0], [[1.0, 2.0, 3.0]], [np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0]):
        with pytest.raises(ValueError, match="odometry: expected 3 finite numbers"):
            model.sample(poses, odometry, 0)
    with pytest.raises(ValueError, match="poses: expected shape"):
        model.sample(poses[:, :2], [0.1, 0.0, 0.0], 0)
    poses[1, 0] = np.nan
    with pytest.raises(ValueError, match="row 1 is not finite"):
        model.sample(poses, [0.1, 0.0, 0.0], 0)
    assert model.sample([1.0, 2.0, 3.0], [0.1, 0.0, 0.0], 0).shape == (1, 3)


@pytest.mark.parametrize("n", [0, 1, 511, 512, 513, 1300])
def test_sampled_motion_equals_its_naive_twin(n):
    poses = some_poses(n)
    moved, stds = np.array([0.7, 0.4, -2.0]), np.array([0.5, 0.1, 0.2, 2.0])
    out = np.empty_like(poses)
    key = 2**63 + 11
    motion._sample(poses, np.uint64(key), moved, stds, out)
    if not n:
        return
    normals = np.concatenate([naive.normals(key, 0, n), naive.normals(key, n, n)])
    expected = naive.move(poses, normals, moved, stds)
    np.testing.assert_allclose(out[:, :2], expected[:, :2], atol=2e-4)
    np.testing.assert_allclose(wrap_to_pi(out[:, 2] - expected[:, 2]), 0, atol=2e-4)


def test_noises_are_independent_of_each_other():
    n = 100_000
    out = np.empty((n, 3))
    # along, across and heading; the direction's turns the robot with the heading's
    motion._sample(np.zeros((n, 3)), np.uint64(5), np.zeros(3), np.array([0.0, 1, 1, 0.1]), out)
    correlations = np.corrcoef(out.T)[np.triu_indices(3, 1)]
    assert np.abs(correlations).max() * np.sqrt(n) < 5
    turned = np.empty((n, 3))
    motion._sample(np.zeros((n, 3)), np.uint64(5), np.zeros(3), np.array([0.1, 0, 0, 0]), turned)
    for column in out.T:
        assert abs(np.corrcoef(column, turned[:, 2])[0, 1]) * np.sqrt(n) < 5
