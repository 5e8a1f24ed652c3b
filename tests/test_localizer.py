"""The replay of a dataset, on a small fake one."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from pflut.geometry import compose, relative_pose
from pflut.localization.filter_state import FilterState
from pflut.localization.localizer import Localizer
from pflut.localization.motion import DifferentialDrive
from pflut.localization.particle_filter import ParticleFilter


def circle(n, step=(0.3, 0.0, 0.1)):
    poses = [np.zeros(3)]
    for _ in range(n - 1):
        poses.append(compose(poses[-1], step))
    return np.array(poses)


@dataclass
class FakeDrive:
    """An image holds its number."""

    name: str = "fake"
    ground_truth: np.ndarray | None = field(default_factory=lambda: circle(20))
    odometry: np.ndarray | None = field(
        default_factory=lambda: compose([5.0, 1.0, 2.0], circle(20))
    )
    query_indices: np.ndarray = field(default_factory=lambda: np.arange(1, 20, 2))
    asked: list = field(default_factory=list)

    @property
    def stamps(self):
        return np.arange(20) * 0.5

    def image(self, i):
        self.asked.append(i)
        return np.full((4, 8), i, dtype=np.uint8)

    def odometry_between(self, i, j):
        return relative_pose(self.odometry[i], self.odometry[j])


class PlaceSensor:
    """Knows the true place of each image."""

    def __init__(self, std=0.1):
        self.std = std
        self.seen = []

    def log_likelihood(self, poses, observation):
        number = int(np.ravel(observation)[0])
        self.seen.append(number)
        return -0.5 * ((poses[:, :2] - circle(20)[number, :2]) ** 2).sum(axis=1) / self.std**2


class ObservingSensor(PlaceSensor):
    def observe(self, image):
        return ("observed", *np.unique(image))[1:]


def make(sensor, truth=None):
    pf = ParticleFilter(DifferentialDrive(), sensor, num_particles=1000, rng=0)
    start = circle(20)[1] if truth is None else truth
    pf.initialize_gaussian(start, np.diag([0.1, 0.1, 0.1]) ** 2)
    return pf


@pytest.mark.parametrize("sensor", [PlaceSensor, ObservingSensor])
def test_follows_the_drive(sensor):
    drive, model = FakeDrive(), sensor()
    localizer = Localizer(drive, make(model))
    steps = list(localizer)
    assert len(localizer) == len(steps) == 10
    assert [s.index for s in steps] == drive.asked == model.seen == list(range(1, 20, 2))
    assert localizer.skipped == ()
    for step in steps:
        assert step.stamp == step.index * 0.5 == step.estimate.stamp
        np.testing.assert_array_equal(step.ground_truth, circle(20)[step.index])
        np.testing.assert_array_equal(step.odometry, drive.odometry[step.index])
        assert np.hypot(*(step.estimate.pose - step.ground_truth)[:2]) < 0.2
        assert set(step.timings) == {"image", "features", "predict", "update"}
        assert all(seconds >= 0 for seconds in step.timings.values())
        assert step.timings["update"] > 0


def test_equals_the_calls_made_by_hand():
    drive = FakeDrive()
    steps = Localizer(drive, make(PlaceSensor())).run()
    pf = make(PlaceSensor())
    estimate = pf.update(drive.image(1))
    np.testing.assert_array_equal(steps[0].estimate.pose, estimate.pose)
    for k, i in enumerate(range(3, 20, 2)):
        estimate = pf.step(drive.odometry_between(i - 2, i), drive.image(i))
        np.testing.assert_array_equal(steps[k + 1].estimate.pose, estimate.pose)
        assert steps[k + 1].estimate.resampled == estimate.resampled


def test_observations_of_ones_own():
    drive, model = FakeDrive(), PlaceSensor()
    calls = []
    steps = Localizer(drive, make(model), observations=lambda i: [i]).run(
        progress=lambda done, total: calls.append((done, total))
    )
    assert drive.asked == []
    assert model.seen == list(range(1, 20, 2))
    assert calls == [(k + 1, 10) for k in range(10)]
    assert len(steps) == 10
    assert steps[0].timings["image"] == 0.0


def test_frames_without_odometry_are_left_out_and_bridged():
    drive = FakeDrive()
    drive.odometry[[5, 7]] = np.nan
    localizer = Localizer(drive, make(PlaceSensor()))
    steps = localizer.run()
    assert localizer.skipped == (5, 7)
    assert [s.index for s in steps] == [1, 3, 9, 11, 13, 15, 17, 19]
    assert np.hypot(*(steps[-1].estimate.pose - steps[-1].ground_truth)[:2]) < 0.2


def test_without_ground_truth():
    drive = FakeDrive()
    drive.ground_truth[3] = np.nan
    steps = Localizer(drive, make(PlaceSensor()), indices=[1, 3]).run()
    assert steps[0].ground_truth is not None
    assert steps[1].ground_truth is None
    drive.ground_truth = None
    assert Localizer(drive, make(PlaceSensor())).run()[0].ground_truth is None


def test_two_halves_are_the_whole(tmp_path):
    drive = FakeDrive()
    whole = Localizer(drive, make(PlaceSensor())).run()
    first = make(PlaceSensor())
    half = Localizer(drive, first, indices=range(1, 11, 2)).run()
    first.state().save(tmp_path / "filter.npz")
    second = make(PlaceSensor())
    second.restore(FilterState.load(tmp_path / "filter.npz"))
    rest = Localizer(drive, second, indices=range(11, 20, 2), resume_from=half[-1].index).run()
    for step, expected in zip(half + rest, whole, strict=True):
        assert step.estimate.pose.tobytes() == expected.estimate.pose.tobytes()


@pytest.mark.parametrize("resume_from", [-1, 1, 20])
def test_a_frame_to_resume_from_is_before_the_others(resume_from):
    with pytest.raises(ValueError, match=r"^resume_from: expected a frame with odometry"):
        Localizer(FakeDrive(), make(PlaceSensor()), resume_from=resume_from)


def test_misuse_is_refused():
    drive = FakeDrive(odometry=None)
    with pytest.raises(ValueError, match="'fake': has no odometry"):
        Localizer(drive, make(PlaceSensor()))
    with pytest.raises(ValueError, match="increasing"):
        Localizer(FakeDrive(), make(PlaceSensor()), indices=[3, 1])
    pf = ParticleFilter(DifferentialDrive(), PlaceSensor())
    with pytest.raises(ValueError, match="not initialised"):
        Localizer(FakeDrive(), pf).run()
