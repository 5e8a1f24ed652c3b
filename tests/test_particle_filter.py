"""The filter against exact answers (Kalman filter, numerical integration) and at its edges."""

import numpy as np
import pytest

from pflut.geometry import circular_mean, wrap_to_pi
from pflut.localization.motion import DifferentialDrive
from pflut.localization.particle_filter import ParticleFilter
from pflut.localization.proposals import UniformProposal
from pflut.localization.recovery import Recovery
from pflut.localization.resampling import RESAMPLERS
from pflut.localization.resampling_policy import EffectiveSizeBelow


class Shift:
    """x and y move by the odometry and normal noise: linear and Gaussian."""

    def __init__(self, std):
        self.std = np.asarray(std)

    def sample(self, poses, odometry, rng=None):
        noise = np.random.default_rng(rng).standard_normal(poses.shape) * self.std
        return poses + odometry + noise


class Position:
    """The position is seen with normal noise."""

    def __init__(self, std):
        self.std = np.asarray(std)

    def log_likelihood(self, poses, observation):
        z = (poses[:, :2] - observation) / self.std
        return -0.5 * (z**2).sum(axis=1) - np.log(2 * np.pi * self.std.prod())


class Fixed:
    """The observation is the log-likelihood."""

    def log_likelihood(self, poses, observation):
        return np.broadcast_to(np.asarray(observation, dtype=float), len(poses))


def standing(n=100, sensor=None, **options):
    pf = ParticleFilter(
        DifferentialDrive(), sensor or Fixed(), num_particles=n, **{"rng": 0, **options}
    )
    pf.initialize_uniform((-1, -1, 1, 1))
    return pf


@pytest.mark.parametrize("resampling", sorted(RESAMPLERS))
def test_equals_the_kalman_filter_where_that_is_exact(resampling):
    kalman = pytest.importorskip("filterpy.kalman")
    motion_std, sensor_std = np.array([0.1, 0.2, 0.0]), np.array([0.3, 0.2])
    prior_std, steps, runs = np.array([0.5, 0.4]), 8, 60
    rng = np.random.default_rng(11)
    odometry = [0.3, -0.1, 0.0]
    observations = rng.normal(0, 0.3, (steps, 2)) + np.outer(np.arange(1, steps + 1), odometry[:2])

    kf = kalman.KalmanFilter(dim_x=2, dim_z=2)
    kf.x, kf.P = np.array([1.0, -1.0]), np.diag(prior_std**2)
    kf.F, kf.H, kf.B = np.eye(2), np.eye(2), np.eye(2)
    kf.Q, kf.R = np.diag(motion_std[:2] ** 2), np.diag(sensor_std**2)
    log_evidence = 0.0
    for z in observations:
        kf.predict(u=np.array(odometry[:2]))
        kf.update(z)
        log_evidence += kf.log_likelihood

    means, variances, evidences = [], [], []
    for seed in range(runs):
        pf = ParticleFilter(
            Shift(motion_std),
            Position(sensor_std),
            num_particles=3000,
            resampling=resampling,
            estimate_method="mean",
            rng=seed,
        )
        pf.initialize_gaussian([1.0, -1.0, 0.0], np.diag([*prior_std**2, 0.0]))
        estimates = [pf.step(odometry, z) for z in observations]
        means.append(estimates[-1].pose[:2])
        variances.append(estimates[-1].covariance.diagonal()[:2])
        evidences.append(np.exp(sum(e.log_mean_likelihood for e in estimates) - log_evidence))
        assert any(e.resampled for e in estimates)
        assert not all(e.resampled for e in estimates)

    for values, exact in (
        (np.array(means), kf.x),
        (np.array(variances), np.diag(kf.P)),
        (np.array(evidences), 1.0),
    ):
        error = values.std(axis=0, ddof=1) / np.sqrt(runs)
        assert (np.abs(values.mean(axis=0) - exact) <= 5 * error).all()
        # and the bound is tight enough to mean something
        assert (error < 0.05).all()


def test_equals_numerical_integration_over_headings():
    """A robot turns on the spot; a bimodal sensor; the posterior on 720 headings."""
    variance_share, floor, turn, steps = 0.02, 0.1, 1.2, 5
    grid = wrap_to_pi(np.arange(720) * (2 * np.pi / 720))

    def log_likelihood(headings, z):
        return 1.5 * np.cos(2 * (headings - z)) + 0.4 * np.cos(headings - z)

    class Compass:
        def log_likelihood(self, poses, observation):
            return log_likelihood(poses[:, 2], observation)

    std = np.sqrt(variance_share * turn**2 + floor**2)
    step = wrap_to_pi(grid[:, None] - grid[None, :] - turn)
    transition = sum(np.exp(-0.5 * ((step + 2 * np.pi * k) / std) ** 2) for k in (-1, 0, 1))
    transition /= transition.sum(axis=0)
    observations = [0.5 + turn * (k + 1) + 0.1 * (-1) ** k for k in range(steps)]
    density = np.exp(-0.5 * (wrap_to_pi(grid - 2.5) / 1.0) ** 2)
    density /= density.sum()
    prior = density
    for z in observations:
        density = transition @ density * np.exp(log_likelihood(grid, z))
        density /= density.sum()

    motion = DifferentialDrive(
        rotation_noise_from_rotation=variance_share,
        translation_noise_from_rotation=0.0,
        heading_noise=floor,
    )
    sectors = np.linspace(-np.pi, np.pi, 13)
    exact = np.histogram(grid, sectors, weights=density)[0]
    shares = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        pf = ParticleFilter(motion, Compass(), num_particles=2000, rng=rng)
        headings = rng.choice(grid, 2000, p=prior) + rng.uniform(-0.5, 0.5, 2000) * np.pi / 360
        pf.initialize(np.column_stack([np.zeros((2000, 2)), headings]))
        for z in observations:
            pf.step([0.0, 0.0, turn], z)
        shares.append(np.histogram(pf.poses[:, 2], sectors, weights=pf.weights)[0])
    error = np.std(shares, axis=0, ddof=1) / np.sqrt(60)
    # half a degree of the grid's own at each edge of a sector
    assert (np.abs(np.mean(shares, axis=0) - exact) <= 5 * error + 0.003).all()
    assert exact.max() > 0.2
    assert np.sort(exact)[-3] > 0.05  # two modes


def test_step_is_predict_and_update():
    one, other = (standing(sensor=Position([0.3, 0.3])) for _ in range(2))
    for _ in range(5):
        first = one.step([0.2, 0.0, 0.3], [0.3, 0.2], stamp=7.5)
        other.predict([0.2, 0.0, 0.3])
        second = other.update([0.3, 0.2], stamp=7.5)
        np.testing.assert_array_equal(first.pose, second.pose)
        assert first.stamp == 7.5
    assert one.poses.tobytes() == other.poses.tobytes()


def test_the_same_seed_gives_the_same_bytes():
    def drive(seed):
        pf = standing(sensor=Position([0.2, 0.2]), rng=seed)
        estimates = [pf.step([0.1, 0.0, 0.2], [0.1 * k, 0.0]) for k in range(10)]
        return b"".join([pf.poses.tobytes(), pf.log_weights.tobytes()]), estimates[-1]

    first, estimate = drive(5)
    second, again = drive(5)
    assert first == second
    assert estimate.covariance.tobytes() == again.covariance.tobytes()
    assert first != drive(6)[0]


@pytest.mark.parametrize(
    "bad",
    [
        np.full(100, -np.inf),
        np.full(100, np.nan),
        np.full(100, np.inf),
        np.where(np.arange(100) == 99, np.nan, 0.0),
        np.where(np.arange(100) == 0, np.inf, -5.0),
        np.where(np.arange(100) == 50, np.nan, -np.inf),
    ],
)
def test_degenerate_observations_are_ignored_and_counted(bad):
    pf = standing()
    pf.update(np.linspace(0.0, -2.0, 100))
    poses, log_weights = pf.poses.copy(), pf.log_weights.copy()
    for count in (1, 2):
        estimate = pf.update(bad)
        assert estimate.degenerate
        assert estimate.degenerate_updates == pf.degenerate_updates == count
        assert estimate.log_mean_likelihood is None
        assert np.isfinite(estimate.pose).all()
        assert np.isfinite(estimate.covariance).all()
        np.testing.assert_array_equal(pf.poses, poses)
        np.testing.assert_array_equal(pf.log_weights, log_weights)
    estimate = pf.update(0.0)
    assert not estimate.degenerate
    assert estimate.degenerate_updates == 2
    pf.initialize_uniform((0, 0, 1, 1))
    assert pf.update(0.0).degenerate_updates == 0


def test_an_observation_that_rules_out_the_particles_left_is_degenerate():
    pf = standing(resample_when=EffectiveSizeBelow(0.0))
    left = np.arange(100) < 50
    assert not pf.update(np.where(left, 0.0, -np.inf)).degenerate
    assert pf.update(np.where(left, -np.inf, 0.0)).degenerate
    assert pf.weights[left].sum() == pytest.approx(1.0)


def test_hostile_sensors_never_get_a_nan_out():
    rng = np.random.default_rng(0)
    pf = standing(50)
    values = np.array([0.0, -1e300, 1e300, -np.inf, np.inf, np.nan, -745.0, 5e-324])
    for _ in range(300):
        chances = [0.4, 0.1, 0.05, 0.2, 0.001, 0.001, 0.2, 0.048]
        estimate = pf.step(rng.normal(0, 0.1, 3), rng.choice(values, 50, p=chances))
        assert np.isfinite(estimate.pose).all()
        assert np.isfinite(estimate.covariance).all()
        assert 0.0 <= estimate.confidence <= 1.0
        assert 1.0 <= estimate.effective_sample_size <= 50.0 * (1 + 1e-12)
        assert np.isfinite(pf.poses).all()
        assert not np.isnan(pf.log_weights).any()
        assert pf.weights.sum() == pytest.approx(1.0)
    assert pf.degenerate_updates > 0


def test_one_particle():
    pf = ParticleFilter(DifferentialDrive(), Position([0.1, 0.1]), num_particles=1, rng=0)
    pf.initialize([1.0, 2.0, 3.0])
    for _ in range(3):
        estimate = pf.step([0.1, 0.0, 0.0], [5.0, 5.0])
        assert estimate.effective_sample_size == pytest.approx(1.0)
        assert not estimate.resampled
        np.testing.assert_allclose(estimate.pose, pf.poses[0], atol=1e-12)
        np.testing.assert_array_equal(estimate.covariance, np.zeros((3, 3)))


def test_zero_motion_keeps_every_particle():
    pf = standing()
    before = pf.poses.copy()
    for _ in range(10):
        pf.step([0.0, 0.0, 0.0], 0.0)
    np.testing.assert_array_equal(pf.poses, before)


def test_a_million_particles():
    pf = ParticleFilter(DifferentialDrive(), Position([0.2, 0.2]), num_particles=1_000_000, rng=0)
    pf.initialize_uniform((-10, -10, 10, 10))
    estimate = pf.step([0.1, 0.0, 0.0], [3.0, 4.0])
    assert estimate.resampled
    assert len(pf.poses) == 1_000_000
    np.testing.assert_allclose(estimate.pose[:2], [3.0, 4.0], atol=0.02)
    # a posterior of 0.2 m over 400 m^2: N * 4 pi s^2 / area particles count
    assert estimate.effective_sample_size == pytest.approx(1e6 * 4 * np.pi * 0.04 / 400, rel=0.05)


@pytest.mark.parametrize(
    "threshold,expected", [(0.0, False), (0.5, False), (0.7, True), (1.0, True)]
)
def test_resamples_below_the_threshold(threshold, expected):
    pf = standing(resample_when=EffectiveSizeBelow(threshold))
    estimate = pf.update(np.where(np.arange(100) < 60, 0.0, -np.inf))
    assert estimate.effective_sample_size == pytest.approx(60)
    assert estimate.resampled is expected
    assert (pf.weights == 0.01).all() == expected


def test_many_particles_at_the_start():
    pf = standing(100, sensor=Position([0.3, 0.3]))
    pf.initialize(np.random.default_rng(0).uniform(-3, 3, (5000, 3)), np.zeros(5000))
    assert len(pf.poses) == 5000
    estimate = pf.update([1.0, 1.0])
    assert estimate.resampled
    assert estimate.num_particles == 5000
    assert pf.poses.shape == (100, 3)
    assert pf.update([1.0, 1.0]).num_particles == 100
    # even where all weigh the same
    pf.initialize(np.zeros((50, 3)))
    pf.sensor = Fixed()
    assert pf.update(0.0).resampled
    assert len(pf.poses) == 100
    assert not pf.update(0.0).resampled


def test_initialize_wraps_headings_and_copies():
    pf = standing()
    given = np.array([[0.0, 0.0, 4.0], [0.0, 0.0, -np.pi]])
    pf.initialize(given, [0.0, np.log(3.0)])
    np.testing.assert_allclose(pf.poses[:, 2], [4.0 - 2 * np.pi, np.pi])
    np.testing.assert_allclose(pf.weights, [0.25, 0.75])
    np.testing.assert_array_equal(given[:, 2], [4.0, -np.pi])


def test_any_function_resamples():
    def first(weights, n, rng=None):
        return np.zeros(n, dtype=np.int32)

    pf = standing(resampling=first, resample_when=EffectiveSizeBelow(1.0))
    chosen = pf.poses[0].copy()
    pf.update(-np.arange(100.0))
    np.testing.assert_array_equal(pf.poses, np.tile(chosen, (100, 1)))


def test_initialize_uniform():
    pf = standing(20_000)
    pf.initialize_uniform((1.0, -2.0, 3.0, 5.0))
    assert (pf.poses.min(axis=0) >= [1, -2, -np.pi]).all()
    assert (pf.poses.max(axis=0) <= [3, 5, np.pi]).all()
    error = 5 * np.array([2, 7, 2 * np.pi]) / np.sqrt(12 * 20_000)
    assert (np.abs(pf.poses.mean(axis=0) - [2, 1.5, 0]) <= error).all()
    pf.initialize_uniform((1, 1, 1, 1), heading=np.pi)
    np.testing.assert_array_equal(pf.poses, np.tile([1, 1, np.pi], (20_000, 1)))
    pf.initialize_uniform((0, 0, 1, 1), heading=(3.0, 3.5))
    assert (np.abs(pf.poses[:, 2]) >= 2.7).all()
    assert circular_mean(pf.poses[:, 2]) == pytest.approx(3.25 - 2 * np.pi, abs=0.01)


def test_initialize_gaussian():
    pf = standing(100_000)
    covariance = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.02], [0.0, 0.02, 0.01]])
    pf.initialize_gaussian([1.0, 2.0, np.pi], covariance)
    spread = pf.poses - [1, 2, np.pi]
    spread[:, 2] = wrap_to_pi(spread[:, 2])
    variances = covariance.diagonal()
    assert (np.abs(spread.mean(axis=0)) <= 5 * np.sqrt(variances / 1e5)).all()
    error = np.sqrt((np.outer(variances, variances) + covariance**2) / 1e5)
    assert (np.abs(np.cov(spread.T) - covariance) <= 5 * error).all()
    pf.initialize_gaussian([1.0, 2.0, 3.0], np.zeros((3, 3)))
    np.testing.assert_array_equal(pf.poses, np.tile([1, 2, 3], (100_000, 1)))


@pytest.mark.parametrize(
    "call,message",
    [
        (lambda pf: pf.initialize_gaussian([0, 0, 0], np.diag([1, -1, 1])), "eigenvalue below 0"),
        (lambda pf: pf.initialize_gaussian([0, 0, 0], [[1, 1, 0], [0, 1, 0], [0, 0, 1]]), "symm"),
        (lambda pf: pf.initialize_gaussian([0, 0, 0], np.eye(2)), "covariance: expected 3 x 3"),
        (lambda pf: pf.initialize_gaussian([0, 0, 0], np.eye(3) * np.nan), "finite"),
        (lambda pf: pf.initialize_gaussian(np.zeros((2, 3)), np.eye(3)), "mean: expected shape"),
        (lambda pf: pf.initialize_gaussian([0, np.nan, 0], np.eye(3)), "not finite"),
        (lambda pf: pf.initialize_uniform((0, 0, -1, 1)), "bounds: expected"),
        (lambda pf: pf.initialize_uniform((0, 0, np.nan, 1)), "bounds: expected"),
        (lambda pf: pf.initialize_uniform((0, 0, 1, 1), heading=np.nan), "heading: expected"),
        (lambda pf: pf.initialize_uniform((0, 0, 1, 1), heading=(1, 0)), "heading: expected"),
        (lambda pf: pf.initialize([[0, 0, np.inf]]), "row 0 is not finite"),
        (lambda pf: pf.initialize(np.empty((0, 3))), "at least one"),
        (lambda pf: pf.initialize(np.zeros((2, 3)), np.zeros(3)), "expected 2, one a pose, got 3"),
        (lambda pf: pf.initialize(np.zeros((2, 3)), [np.nan, 0]), "log_weights: expected"),
        (lambda pf: pf.predict([1, 2]), "odometry"),
        (lambda pf: pf.update(np.zeros(3)), "broadcast|sensor.log_likelihood: expected shape"),
    ],
)
def test_misuse_is_refused_and_changes_nothing(call, message):
    pf = standing()
    before = pf.poses.copy()
    with pytest.raises(ValueError, match=message):
        call(pf)
    np.testing.assert_array_equal(pf.poses, before)
    np.testing.assert_allclose(pf.weights, 0.01)


def test_models_that_answer_with_another_shape_are_named():
    class Loses:
        def sample(self, poses, odometry, rng=None):
            return poses[1:]

        def log_likelihood(self, poses, observation):
            return np.zeros(len(poses) - 1)

    pf = ParticleFilter(Loses(), Loses(), num_particles=10, rng=0)
    pf.initialize_uniform((0, 0, 1, 1))
    with pytest.raises(ValueError, match=r"motion.sample: expected 10 poses, got 9"):
        pf.predict([0, 0, 0])
    with pytest.raises(ValueError, match=r"sensor.log_likelihood: expected shape \(10,\)"):
        pf.update(None)


def test_bad_options_are_refused():
    for options, message in (
        ({"num_particles": 0}, "num_particles"),
        ({"resampling": "best"}, "resampling"),
        ({"estimate_method": "best"}, "estimate_method"),
    ):
        with pytest.raises(ValueError, match=message):
            ParticleFilter(DifferentialDrive(), Fixed(), **options)
    pf = ParticleFilter(DifferentialDrive(), Fixed())
    for call in (lambda: pf.predict([0, 0, 0]), lambda: pf.update(0), lambda: pf.poses):
        with pytest.raises(ValueError, match="not initialised"):
            call()
    with pytest.raises(ValueError, match="not initialised"):
        pf.estimate()


def test_an_array_held_on_to_stays_as_it_was():
    pf = standing(sensor=Position([0.2, 0.2]))
    held = [pf.poses, pf.log_weights, pf.weights]
    copies = [array.copy() for array in held]
    for _ in range(3):
        pf.step([0.1, 0.0, 0.1], [0.0, 0.0])
    for array, copy in zip(held, copies, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_a_sensor_that_fails_leaves_the_filter_as_it_was():
    class Failing:
        broken = False

        def log_likelihood(self, poses, observation):
            if self.broken:
                raise OSError("no image")
            return -(poses[:, 0] ** 2)

    recovery = Recovery(proposal=UniformProposal((-1, -1, 1, 1)))
    pf = standing(sensor=Failing(), recovery=recovery, history=3)
    pf.step([0.1, 0.0, 0.0], None, stamp=1.0)
    poses, log_weights = pf.poses, pf.log_weights
    pf.sensor.broken = True
    for stamp in (2.0, 1.0):
        with pytest.raises(OSError, match="no image"):
            pf.update(None, stamp=stamp)
        assert pf.poses is poses
        assert pf.log_weights is log_weights
        assert pf.stamp == 1.0
    pf.sensor.broken = False
    assert len(pf.poses) == pf.update(None, stamp=2.0).num_particles == 100
