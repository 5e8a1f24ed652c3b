"""Kalman filters against exact answers, at the seam of the angles, gated, lost, and driven."""

from dataclasses import replace

import numpy as np
import pytest
from fixes import REFERENCES, ToldFixes, measured

from pflut.geometry import compose, relative_pose, wrap_to_pi
from pflut.localization.dead_reckoning import DeadReckoning
from pflut.localization.extended_kalman_filter import ExtendedKalmanFilter
from pflut.localization.localizer import Localizer
from pflut.localization.motion import DifferentialDrive, Omnidirectional
from pflut.localization.unscented_kalman_filter import UnscentedKalmanFilter

pytest.importorskip("filterpy")

FILTERS = [ExtendedKalmanFilter, UnscentedKalmanFilter]
BOUNDS = (-4.0, -3.0, 4.0, 3.0)


def make(kind, pose=(0.4, -0.5, 1.0), std=(0.05, 0.05, 0.05), *, motion=None, **options):
    kf = kind(motion or DifferentialDrive(), ToldFixes(), **options)
    kf.initialize_gaussian(pose, np.diag(np.square(std)))
    return kf


def difference(a, b):
    d = np.asarray(a) - b
    d[2] = wrap_to_pi(d[2])
    return d


def derivative(function, pose, step=1e-6):
    columns = []
    for k in range(3):
        ahead, behind = np.array(pose, float), np.array(pose, float)
        ahead[k] += step
        behind[k] -= step
        columns.append(wrap_to_pi(function(ahead) - function(behind)) / (2 * step))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("kind", FILTERS)
def test_equals_the_exact_answer_where_all_is_as_good_as_linear(kind):
    """The information form of linear least squares, its derivatives by differences."""
    rng = np.random.default_rng(1)
    truth, stds = np.array([0.4, -0.5, 1.0]), 1e-4 * np.array([1.0, 2.0, 3.0])
    prior = truth + stds * rng.standard_normal(3)
    kf = make(kind, prior, stds, gate=1 - 1e-9)
    fixes = measured(truth, std=2e-4, rng=rng)
    estimate = kf.update(fixes, stamp=3.5)

    information, gradient = np.diag(stds**-2.0), np.zeros(3)
    joint, residuals = [], []
    for fix in fixes:
        slope = derivative(fix.expected, prior)
        weight = np.linalg.inv(fix.covariance)
        information = information + slope.T @ weight @ slope
        gradient = gradient + slope.T @ weight @ fix.residuals(prior)
        joint.append(slope)
        residuals.append(fix.residuals(prior))
    exact = np.linalg.inv(information)
    np.testing.assert_allclose(estimate.covariance, exact, rtol=2e-3, atol=1e-13)
    np.testing.assert_allclose(
        estimate.pose - prior, exact @ gradient, rtol=2e-3, atol=2e-3 * np.sqrt(exact.max())
    )
    # the log-likelihood is that of all measurements before the correction
    slope, residual = np.concatenate(joint), np.concatenate(residuals)
    spread = slope @ np.diag(stds**2) @ slope.T + np.kron(np.eye(len(fixes)), fixes[0].covariance)
    expected = -0.5 * (
        residual @ np.linalg.solve(spread, residual)
        + np.linalg.slogdet(spread)[1]
        + len(residual) * np.log(2 * np.pi)
    )
    assert estimate.log_mean_likelihood == pytest.approx(expected, abs=0.05)
    assert estimate.stamp == 3.5 and not estimate.degenerate
    assert estimate.confidence == 1.0


def test_the_iterated_filter_finds_the_most_probable_pose():
    """Where the prior is so wide that one linearisation is not enough."""
    rng = np.random.default_rng(2)
    truth = np.array([0.4, -0.5, 1.0])
    prior, stds = np.add(truth, [0.35, -0.3, 0.25]), np.array([0.4, 0.4, 0.4])
    fixes = measured(truth, std=0.03, rng=rng)

    def slope_of_cost(pose):
        total = -difference(pose, prior) / stds**2
        for fix in fixes:
            total = total + fix.jacobian(pose).T @ np.linalg.solve(
                fix.covariance, fix.residuals(pose)
            )
        return total

    spread = np.diag(stds**2)
    size = {}
    for iterations in (1, 20):
        kf = make(ExtendedKalmanFilter, prior, stds, gate=1 - 1e-9, iterations=iterations)
        found = kf.update(fixes)
        size[iterations] = np.abs(slope_of_cost(found.pose) @ np.linalg.cholesky(spread)).max()
    assert size[20] < 1e-3 < 0.1 < size[1]


@pytest.mark.parametrize("motion", [DifferentialDrive(), Omnidirectional(position_noise=0.03)])
@pytest.mark.parametrize("kind", [DeadReckoning, *FILTERS])
def test_prediction_has_the_moments_of_the_particles(kind, motion):
    rng = np.random.default_rng(3)
    mean, stds, odometry = np.array([1.0, -2.0, 3.0]), [0.05, 0.1, 0.04], [0.3, 0.05, 0.4]
    kf = kind(motion) if kind is DeadReckoning else kind(motion, ToldFixes())
    kf.initialize_gaussian(mean, np.diag(np.square(stds)))
    kf.predict(odometry)
    n = 200_000
    poses = motion.sample(mean + stds * rng.standard_normal((n, 3)), odometry, rng)
    offsets = np.array([poses[:, 0], poses[:, 1], wrap_to_pi(poses[:, 2] - kf.pose[2])]).T
    offsets[:, :2] -= kf.pose[:2]
    sampled = np.cov(offsets.T)
    scale = np.sqrt(np.diag(sampled))
    # what a linearisation leaves out is of the order of the heading's variance, 0.01
    assert (np.abs(offsets.mean(axis=0)) <= 5 * scale / np.sqrt(n) + 0.005 * 0.3).all()
    error = np.abs(kf.covariance - sampled) / np.outer(scale, scale)
    assert error.max() <= 5 * np.sqrt(2 / n) + 0.01
    assert -np.pi < kf.pose[2] <= np.pi


@pytest.mark.parametrize("heading", [0.0, np.pi, -3.1])
def test_linearised_motion_is_the_derivative(heading):
    pose, odometry = np.array([1.0, 2.0, heading]), np.array([0.3, 0.1, 0.5])
    increment = DifferentialDrive(position_noise=0.02).increment(odometry)
    moved, jacobian, noise = increment.linearized(pose)
    assert np.abs(difference(moved, compose(pose, odometry))).max() < 1e-12
    numeric = derivative(lambda p: increment.linearized(p)[0], pose)
    np.testing.assert_allclose(jacobian, numeric, atol=1e-8)
    assert np.linalg.eigvalsh(noise)[0] > 0


@pytest.mark.parametrize("kind", FILTERS)
@pytest.mark.parametrize("turn", [0.0, np.pi / 2, np.pi, 3.0])
def test_the_world_may_be_turned(kind, turn):
    """Headings across the seam at pi change nothing but the frame."""
    truth, prior = np.array([0.4, -0.5, 0.1]), np.array([0.46, -0.55, 0.13])
    answers = []
    for angle in (0.0, turn):
        frame = np.array([0.0, 0.0, angle])
        references = compose(frame, REFERENCES)
        kf = kind(DifferentialDrive(), ToldFixes(references))
        kf.initialize_gaussian(compose(frame, prior), np.diag([0.01, 0.01, 0.01]))
        kf.predict([0.1, 0.02, 0.05])
        moved = compose(truth, [0.1, 0.02, 0.05])
        estimate = kf.update(measured(compose(frame, moved), references=references))
        answers.append(relative_pose(frame, estimate.pose))
        assert -np.pi < estimate.pose[2] <= np.pi
    assert np.abs(difference(*answers)).max() < 1e-6


@pytest.mark.parametrize("kind", FILTERS)
def test_what_contradicts_is_gated_out(kind):
    truth = np.array([0.4, -0.5, 1.0])
    good = measured(truth)
    bad = [replace(f, headings=np.add(f.headings, [0.5, -0.7])) for f in measured(truth)[:2]]
    kept, all_of_them = make(kind).update(good[2:]), make(kind).update(bad + good[2:])
    np.testing.assert_array_equal(all_of_them.pose, kept.pose)
    np.testing.assert_array_equal(all_of_them.covariance, kept.covariance)
    pulled = make(kind, gate=1 - 1e-16, iterations=1)
    pulled._limits = {1: np.inf, 2: np.inf}  # without a gate
    assert np.abs(pulled.update(bad + good[2:]).pose - truth).max() > 0.05


@pytest.mark.parametrize("kind", FILTERS)
def test_the_gate_lets_in_what_it_says(kind):
    """Of right measurements the share that is told, within 5 standard errors."""
    rng = np.random.default_rng(5)
    truth, gate, n = np.array([0.4, -0.5, 1.0]), 0.9, 400
    passed = 0
    for _ in range(n):
        prior = truth + 0.01 * rng.standard_normal(3)
        kf = make(kind, prior, (0.01, 0.01, 0.01), gate=gate)
        passed += len(kf._passing(measured(truth, std=0.02, rng=rng), kf.pose, kf.covariance))
    size = n * len(REFERENCES)
    # those of one prior depend on each other: at most as if there were n of them
    assert abs(passed / size - gate) < 5 * np.sqrt(gate * (1 - gate) / n)
    assert passed < size


@pytest.mark.parametrize("kind", FILTERS)
def test_on_a_reference_only_the_rotation_counts(kind):
    pose = REFERENCES[0] + [0.02, -0.05, 0.1]
    fix = measured(pose)[0]
    turned = replace(fix, headings=fix.headings + 1.0)  # another direction, the same rotation
    answers = [make(kind, pose, (0.05, 0.05, 0.1)).update([f]) for f in (fix, turned)]
    np.testing.assert_allclose(answers[0].pose, answers[1].pose, atol=1e-12)
    variance = 1 / (1 / 0.01 + 1 / (1e-4 * (1.0 - 0.6 + 1.5)))
    np.testing.assert_allclose(
        answers[0].covariance, np.diag([0.0025, 0.0025, variance]), rtol=1e-6, atol=1e-12
    )
    # where the robot may be on either side of it that is so, too
    wide = make(kind, REFERENCES[0] + [0.5, 0.0, 0.1], (0.4, 0.4, 0.1)).update([fix])
    assert wide.covariance[0, 0] == pytest.approx(0.16)


@pytest.mark.parametrize("kind", FILTERS)
def test_without_measurements_the_estimate_is_the_prediction(kind):
    kf, other = make(kind), make(kind)
    truth = np.array([0.4, -0.5, 1.0])
    far = [replace(f, headings=f.headings + 2.0) for f in measured(truth)]
    for number, observation in enumerate(([], far), start=1):
        kf.predict([0.2, 0.0, 0.1])
        other.predict([0.2, 0.0, 0.1])
        estimate = kf.update(observation)
        np.testing.assert_array_equal(estimate.pose, other.pose)
        np.testing.assert_array_equal(estimate.covariance, other.covariance)
        assert estimate.degenerate and estimate.log_mean_likelihood is None
        assert estimate.degenerate_updates == number
    assert kf.estimate().degenerate_updates == 2
    kf.initialize_gaussian(truth, np.eye(3))
    assert kf.estimate().degenerate_updates == 0


@pytest.mark.parametrize("kind", FILTERS)
def test_a_pose_known_exactly_stays(kind):
    kf = make(kind, std=(0.0, 0.0, 0.0))
    estimate = kf.update(measured(np.array([0.4, -0.5, 1.0])))
    np.testing.assert_allclose(estimate.pose, [0.4, -0.5, 1.0], atol=1e-12)
    assert np.abs(estimate.covariance).max() < 1e-15


@pytest.mark.parametrize("kind", FILTERS)
def test_lost_start(kind):
    rng = np.random.default_rng(7)
    kf = kind(DifferentialDrive(), ToldFixes(), min_fixes=3)
    kf.initialize_lost(BOUNDS)
    nothing = kf.update([])
    assert kf.lost and nothing.degenerate and nothing.confidence < 0.05
    np.testing.assert_allclose(nothing.pose, np.zeros(3), atol=1e-12)
    kf.predict([1.0, 0.0, 0.0])
    truth = np.array([1.63, -1.17, 2.9])
    wrong = [replace(f, headings=rng.uniform(-np.pi, np.pi, 2)) for f in measured(truth)[:1]]
    few = kf.update(measured(truth)[:2])
    assert kf.lost and few.degenerate
    found = kf.update(wrong + measured(truth, rng=rng)[1:])
    assert not kf.lost and not found.degenerate
    assert np.abs(difference(found.pose, truth)).max() < 0.05
    assert found.confidence > 0.99


@pytest.mark.parametrize("kind", FILTERS)
def test_a_lost_robot_puts_several_images_together(kind):
    """Each shows one or two references, too few to say where it is."""
    rng = np.random.default_rng(8)
    kf = kind(DifferentialDrive(), ToldFixes(), min_fixes=4)
    kf.initialize_lost(BOUNDS)
    truth, lost = np.array([-1.63, 0.8, 0.4]), []
    for shown in ([0], [], [2, 3], [1]):
        estimate = kf.update([measured(truth, std=0.02, rng=rng)[i] for i in shown])
        lost.append(kf.lost)
        assert estimate.degenerate == kf.lost
        kf.predict([0.3, 0.02, 0.2])
        truth = compose(truth, [0.3, 0.02, 0.2])
    assert lost == [True, True, True, False]
    assert np.abs(difference(kf.pose, truth)).max() < 0.15
    # and remembers nothing of it once it is found
    assert len(kf._clues) == 0


def test_old_images_are_forgotten():
    kf = make(ExtendedKalmanFilter, min_fixes=30)
    kf.initialize_lost(BOUNDS)
    for _ in range(12):
        kf.update(measured(np.array([0.4, -0.5, 1.0]))[:2])
    assert kf.lost and len(kf._clues) == 20


@pytest.mark.parametrize("kind", FILTERS)
@pytest.mark.parametrize("after", [1, 3, None])
def test_a_robot_that_was_carried_off_is_found_again(kind, after):
    truth = np.array([-1.5, 1.2, -2.0])
    kf = make(kind, relocalize_after=after)
    near = [np.hypot(*(kf.update(measured(truth)).pose[:2] - truth[:2])) < 0.05 for _ in range(4)]
    assert near == [after is not None and number >= after for number in (1, 2, 3, 4)]


@pytest.mark.parametrize("kind", FILTERS)
def test_a_search_that_finds_nothing_changes_nothing(kind):
    """All contradict the filter, and each other."""
    kf = make(kind, relocalize_after=1, min_fixes=4)
    rng = np.random.default_rng(4)
    fixes = measured(kf.pose, std=1e-3)
    wild = [replace(f, headings=f.headings + rng.uniform(1.0, 5.0, 2)) for f in fixes]
    estimate = kf.update(wild)
    assert len(kf._clues) == len(wild)  # it did search
    assert estimate.degenerate
    np.testing.assert_array_equal(estimate.pose, make(kind).pose)
    np.testing.assert_array_equal(estimate.covariance, make(kind).covariance)


@pytest.mark.parametrize("kind", FILTERS)
def test_covariance_tells_the_error(kind):
    """The normalised squared errors of a drive average to three, within 5 standard errors."""
    rng = np.random.default_rng(9)
    runs, motion, squares = 80, DifferentialDrive(), []
    for _ in range(runs):
        start = np.array([0.5, -1.0, 0.3])
        kf = make(kind, start, (0.05, 0.05, 0.03), motion=motion, gate=1 - 1e-9)
        truth = start + [0.05, 0.05, 0.03] * rng.standard_normal(3)
        for _ in range(6):
            odometry = np.array([0.25, 0.0, 0.3])
            truth = motion.sample(truth, odometry, rng)[0]
            estimate = kf.step(odometry, measured(truth, std=0.02, rng=rng))
        error = difference(estimate.pose, truth)
        squares.append(error @ np.linalg.solve(estimate.covariance, error))
    assert abs(np.mean(squares) - 3.0) < 5 * np.sqrt(6.0 / runs)


class Drive:
    """A drive on a circle; an image holds its number."""

    name = "drive"
    ground_truth = None
    stamps = np.arange(12) * 0.5
    query_indices = np.arange(12)

    def __init__(self):
        poses = [np.array([1.0, -1.0, 0.5])]
        for _ in range(11):
            poses.append(compose(poses[-1], [0.25, 0.0, 0.3]))
        self.odometry = np.array(poses)

    def image(self, i):
        return np.full((4, 8), i, dtype=np.uint8)

    def odometry_between(self, i, j):
        return relative_pose(self.odometry[i], self.odometry[j])


class Seeing(ToldFixes):
    """Makes measurements of a drive's images."""

    def observe(self, image):
        return measured(Drive().odometry[image[0, 0]])


@pytest.mark.parametrize("kind", [DeadReckoning, *FILTERS])
def test_localizer_drives_it(kind):
    motion = DifferentialDrive()
    pf = kind(motion) if kind is DeadReckoning else kind(motion, Seeing())
    pf.initialize_gaussian(Drive().odometry[0], np.diag([0.01, 0.01, 0.01]))
    steps = Localizer(Drive(), pf).run()
    assert [step.index for step in steps] == list(range(12))
    for step in steps:
        assert step.estimate.stamp == step.stamp
        assert np.abs(difference(step.estimate.pose, step.odometry)).max() < 1e-3
        assert step.estimate.num_particles == step.estimate.effective_sample_size == 1
    spread = steps[-1].estimate.position_std
    assert spread > 0.1 if kind is DeadReckoning else spread < 0.03


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda k: make(k, gate=1.0), "gate: expected a probability"),
        (lambda k: make(k, iterations=0), "iterations: expected at least 1, got 0"),
        (lambda k: make(k, min_agreeing=1.5), "min_agreeing: expected a share"),
        (lambda k: make(k, relocalize_after=0), "relocalize_after: expected at least 1"),
        (lambda k: make(k, min_fixes=1), "min_fixes: expected at least 2"),
        (lambda k: make(k).initialize_lost((1, 0, 0, 0)), "bounds: expected finite"),
        (lambda k: make(k).initialize_gaussian([0, 0], np.eye(3)), "mean: expected shape"),
        (lambda k: make(k).initialize_gaussian([0, 0, 0], -np.eye(3)), "eigenvalue below 0"),
        (lambda k: make(k).predict([0.0, np.nan, 0.0]), "odometry: expected 3 finite"),
        (lambda k: k(DifferentialDrive(), ToldFixes()).update([]), "not initialised"),
        (lambda k: k(DifferentialDrive(), ToldFixes()).predict([0, 0, 0]), "not initialised"),
    ],
)
@pytest.mark.parametrize("kind", FILTERS)
def test_misuse_is_told(kind, call, message):
    with pytest.raises(ValueError, match=message):
        call(kind)
