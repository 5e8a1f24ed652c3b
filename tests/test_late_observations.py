"""Stamps: images that come late, too late, between two motions; a clock that goes back."""

from __future__ import annotations

import numpy as np
import pytest
from test_particle_filter import Position, Shift

from pflut.localization.history import History
from pflut.localization.motion import DifferentialDrive
from pflut.localization.particle_filter import ParticleFilter
from pflut.localization.proposals import UniformProposal
from pflut.localization.recovery import Recovery
from pflut.localization.resampling_policy import EffectiveSizeBelow
from pflut.localization.sample_size import KLDSampling


def filter_of(n: int = 200, history: int = 4, seed: int = 0, **options) -> ParticleFilter:
    pf = ParticleFilter(
        Shift([0.1, 0.1, 0.05]),
        Position([0.3, 0.3]),
        num_particles=n,
        history=history,
        rng=seed,
        **options,
    )
    pf.initialize_gaussian([0.0, 0.0, 3.0], np.diag([0.25, 0.25, 0.1]))
    return pf


def test_a_late_image_weighs_particles_by_where_they_were() -> None:
    pf = filter_of()
    pf.predict([1.0, 0.0, 0.0], stamp=1.0)
    then = pf.poses
    pf.predict([0.0, 1.0, 0.0], stamp=2.0)
    estimate = pf.update([1.0, 0.2], stamp=1.0)
    assert estimate.delay == 1.0
    assert not estimate.dropped
    assert estimate.stamp == 2.0  # the pose is that of now
    log = -0.5 * (((then[:, :2] - [1.0, 0.2]) / 0.3) ** 2).sum(axis=1)
    weights = np.exp(log - log.max())
    expected = weights / weights.sum()
    if not estimate.resampled:
        np.testing.assert_allclose(pf.weights, expected, rtol=1e-9)
    assert estimate.effective_sample_size == pytest.approx(1 / (expected**2).sum())


def test_late_is_what_in_time_would_have_been() -> None:
    """Exact: the posterior of now given an image of then, by a Kalman smoother's formulas."""
    prior, step, sensor = 0.25, 0.01, 0.09
    z = np.array([1.3, -0.2])
    # x1 = x0 + 1 + v, z of x1, x2 = x1 + noise: the gain reaches x2 through x1 alone
    variance1 = prior + step
    gain = variance1 / (variance1 + sensor)
    mean1 = np.array([1.0, 0.0]) + gain * (z - [1.0, 0.0])
    exact_mean, exact_variance = mean1 + np.array([0.0, 1.0]), (1 - gain) * variance1 + step
    means, variances = [], []
    for seed in range(60):
        pf = filter_of(3000, seed=seed, estimate_method="mean")
        pf.predict([1.0, 0.0, 0.0], stamp=1.0)
        pf.predict([0.0, 1.0, 0.0], stamp=2.0)
        estimate = pf.update(z, stamp=1.0)
        means.append(estimate.pose[:2])
        variances.append(estimate.covariance.diagonal()[:2])
    for values, exact in ((means, exact_mean), (variances, exact_variance)):
        error = np.std(values, axis=0, ddof=1) / np.sqrt(60)
        assert (np.abs(np.mean(values, axis=0) - exact) <= 5 * error).all()
        assert (error < 0.005).all()


def test_ancestry_goes_through_resampling() -> None:
    """Weights sharp enough to resample, then an image of before: only ancestors count."""
    pf = filter_of(500)
    pf.predict([0.0, 0.0, 0.0], stamp=1.0)
    before = pf.poses
    assert pf.update([0.4, 0.4], stamp=1.0).resampled
    survivors = {tuple(row) for row in pf.poses}
    assert survivors < {tuple(row) for row in before}
    pf.predict([5.0, 5.0, 0.0], stamp=2.0)
    then = pf._particles.history.at(1.0)
    assert {tuple(row) for row in then} == survivors
    # each particle of now stands where its own ancestor's motion brought it
    assert np.abs(pf.poses[:, :2] - then[:, :2] - 5.0).max() < 6 * 0.1


def test_between_two_moments_particles_moved_evenly() -> None:
    history = History(3)
    history.add(1.0, np.array([[0.0, 0.0, 3.0], [1.0, 1.0, 0.0]]))
    history.add(3.0, np.array([[2.0, 0.0, -3.0], [1.0, 2.0, 1.0]]))
    np.testing.assert_allclose(
        history.at(1.5), [[0.5, 0.0, 3.0 + (2 * np.pi - 6) / 4], [1.0, 1.25, 0.25]]
    )
    np.testing.assert_array_equal(history.at(3.0), [[2.0, 0.0, -3.0], [1.0, 2.0, 1.0]])
    assert history.at(0.9) is None
    assert history.at(3.1) is None


def test_history_is_bounded_and_keeps_the_last_of_one_time() -> None:
    history = History(2)
    for stamp in (1.0, 2.0, 2.0, 3.0):
        history.add(stamp, np.full((1, 3), stamp))
    assert [moment.stamp for moment in history.moments] == [1.0, 2.0, 3.0]
    history.add(4.0, np.full((1, 3), 4.0))
    assert [moment.stamp for moment in history.moments] == [2.0, 3.0, 4.0]
    assert History(0).at(1.0) is None


@pytest.mark.parametrize("history", [0, 2])
def test_what_comes_too_late_is_dropped_counted_and_told(history: int) -> None:
    pf = filter_of(history=history)
    for stamp in (1.0, 2.0, 3.0):
        pf.predict([0.1, 0.0, 0.0], stamp=stamp)
    poses, log_weights = pf.poses, pf.log_weights
    for count in (1, 2):
        estimate = pf.update([0.3, 0.0], stamp=0.5)
        assert estimate.dropped
        assert estimate.delay == 2.5
        assert estimate.dropped_updates == pf.dropped_updates == count
        assert estimate.log_mean_likelihood is None
    assert pf.poses is poses
    assert pf.log_weights is log_weights
    assert not pf.update([0.3, 0.0], stamp=3.0).dropped
    assert pf.update([0.3, 0.0], stamp=4.0).dropped_updates == 2
    pf.initialize([0.0, 0.0, 0.0])
    assert pf.dropped_updates == 0
    assert pf.stamp is None
    assert not pf.update([0.0, 0.0], stamp=0.5).dropped


def test_odometry_that_goes_back_is_refused() -> None:
    pf = filter_of()
    pf.predict([0.1, 0.0, 0.0], stamp=2.0)
    before = pf.poses
    with pytest.raises(ValueError, match=r"^stamp: expected odometry after 2\.0+ s, got 1\.5"):
        pf.predict([0.1, 0.0, 0.0], stamp=1.5)
    assert pf.poses is before
    pf.predict([0.1, 0.0, 0.0], stamp=2.0)  # two parts of one motion
    pf.predict([0.1, 0.0, 0.0])


def test_proposals_have_no_past() -> None:
    """A late image leaves the weight of those that were not there yet as it is, on the average."""
    recovery = Recovery(proposal=UniformProposal((-1, -1, 1, 1)), probability=0.5, share=0.5)
    pf = filter_of(400, recovery=recovery)
    pf.predict([0.0, 0.0, 0.0], stamp=1.0)
    pf.predict([0.0, 0.0, 0.0], stamp=2.0)
    pf.update([0.95, -0.95], stamp=2.0)
    then = pf._particles.history.at(1.0)
    new = np.isnan(then[:, 0])
    assert 0 < new.sum() < len(new)
    before = pf.weights[new].sum()
    estimate = pf.update([0.2, 0.2], stamp=1.0)
    assert estimate.delay == 1.0
    assert not estimate.degenerate
    if not estimate.resampled:
        assert pf.weights[new].sum() == pytest.approx(before, rel=1e-9)


def test_images_slower_than_odometry() -> None:
    """Odometry at 10 Hz, images at 3 Hz that take 0.25 s: as good as images in time."""
    errors = {}
    for latency in (0.0, 0.25):
        rng = np.random.default_rng(3)
        pf = ParticleFilter(
            DifferentialDrive(position_noise=0.02),
            Position([0.1, 0.1]),
            num_particles=2000,
            history=8,
            rng=0,
        )
        pf.initialize_gaussian([0, 0, 0], np.diag([0.5, 0.5, 0.01]))
        waiting, found = [], []
        for tick in range(1, 60):
            now = tick / 10
            pf.predict([0.05, 0.0, 0.0], stamp=now)
            if tick % 3 == 0:
                waiting.append((now, [0.05 * tick, 0.0] + 0.1 * rng.standard_normal(2)))
            while waiting and waiting[0][0] + latency <= now + 1e-9:
                stamp, image = waiting.pop(0)
                estimate = pf.update(image, stamp=stamp)
                found.append(np.hypot(*(estimate.pose[:2] - [0.05 * tick, 0.0])))
        errors[latency] = np.median(found[5:])
        assert pf.dropped_updates == 0
    assert errors[0.25] < 1.5 * errors[0.0]


def test_an_image_ahead_of_odometry_does_not_put_the_clock_on() -> None:
    pf = filter_of()
    pf.predict([0.1, 0.0, 0.0], stamp=1.0)
    assert pf.update([0.1, 0.0], stamp=1.03).delay == 0.0
    assert pf.stamp == 1.0
    pf.predict([0.1, 0.0, 0.0], stamp=1.02)
    # where nobody stamps odometry, images are the clock
    pf = filter_of()
    pf.update([0.1, 0.0], stamp=1.0)
    pf.predict([0.1, 0.0, 0.0])
    assert pf.update([0.1, 0.0], stamp=2.0).stamp == 2.0
    assert pf.update([0.1, 0.0], stamp=1.0).delay == 1.0


def test_history_of_one_is_the_last_motion_and_the_start_has_a_stamp() -> None:
    pf = filter_of(history=1)
    pf.initialize(pf.poses, stamp=0.0)
    pf.predict([0.1, 0.0, 0.0], stamp=1.0)
    assert not pf.update([0.05, 0.0], stamp=0.5).dropped
    pf.predict([0.1, 0.0, 0.0], stamp=2.0)
    assert not pf.update([0.15, 0.0], stamp=1.5).dropped
    assert pf.update([0.05, 0.0], stamp=0.5).dropped


@pytest.mark.parametrize("stamp", [np.nan, np.inf])
def test_a_stamp_that_is_none(stamp: float) -> None:
    pf = filter_of()
    for call in (
        lambda: pf.predict([0.1, 0.0, 0.0], stamp=stamp),
        lambda: pf.update([0.1, 0.0], stamp=stamp),
        lambda: pf.initialize([0.0, 0.0, 0.0], stamp=stamp),
    ):
        with pytest.raises(ValueError, match=r"^stamp: expected finite seconds"):
            call()


def test_recovery_from_late_images() -> None:
    """All images are late; a robot that was carried away is found, where it is now."""
    recovery = Recovery(proposal=UniformProposal((-1, -1, 5, 5)), share=0.5)
    pf = ParticleFilter(
        DifferentialDrive(position_noise=0.02, heading_noise=0.02),
        Position([0.1, 0.1]),
        num_particles=1000,
        min_effective_share=0.05,
        recovery=recovery,
        history=4,
        rng=0,
    )
    pf.initialize_gaussian([0.0, 0.0, 0.0], np.diag([0.01, 0.01, 0.001]))
    rng = np.random.default_rng(1)
    x = 0.0
    for k in range(30):
        before = x
        x += 0.02 + 3.0 * (k == 10)  # and is carried 3 m, which odometry does not tell
        pf.predict([0.02, 0.0, 0.0], stamp=0.1 * k)
        if k:
            place = before if k != 10 else x - 0.02
            estimate = pf.update([place, 0.0] + 0.1 * rng.standard_normal(2), stamp=0.1 * (k - 1))
    assert estimate.delay == pytest.approx(0.1)
    assert np.hypot(estimate.pose[0] - x, estimate.pose[1]) < 0.3


def test_a_late_image_where_nobody_with_a_past_has_weight_is_ignored() -> None:
    class Right:
        def log_likelihood(self, poses, observation):
            return np.where(poses[:, 0] > 0.5, 0.0, -np.inf)

    pf = ParticleFilter(
        DifferentialDrive(),
        Right(),
        num_particles=KLDSampling(min_particles=100, max_particles=1000),
        resample_when=EffectiveSizeBelow(0.0),
        recovery=Recovery(proposal=UniformProposal((-1, -1, 1, 1)), share=0.5),
        history=3,
        rng=0,
    )
    pf.initialize(np.zeros((400, 3)))
    pf.predict([0.0, 0.0, 0.0], stamp=1.0)
    pf.predict([0.0, 0.0, 0.0], stamp=2.0)
    assert pf.update(None, stamp=2.0).proposed_share == 1.0
    assert pf.update(None, stamp=1.0).degenerate
    assert np.isfinite(pf.weights).all()


def test_negative_history() -> None:
    with pytest.raises(ValueError, match=r"^history: expected"):
        History(-1)
