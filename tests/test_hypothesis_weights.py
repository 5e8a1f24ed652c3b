"""How much an image may tell hypotheses apart."""

from __future__ import annotations

import naive
import numpy as np
import pytest
from test_hypotheses import around
from test_particle_filter import Position

from pflut.localization.hypotheses import _claim
from pflut.localization.hypothesis_weights import ENOUGH, LEAST_SHARE, temper_hypotheses
from pflut.localization.motion import DifferentialDrive
from pflut.localization.particle_filter import ParticleFilter
from pflut.localization.weights import Weights

HERE, THERE = [0.0, 0.0, 0.0], [3.0, 0.0, 0.0]
POSES = np.concatenate([around(HERE, 600, seed=1), around(THERE, 400, seed=2)])
FIRST = np.arange(1000) < 600


def weighed(here: float, there: float, temperature: float) -> tuple[Weights, Weights]:
    """By Bayes' rule and flattened, where the image's log-likelihoods at the places are these."""
    # a likelihood that is not the same all over a place
    shape = -0.5 * (POSES[:, 1] / 0.1) ** 2
    for place in (FIRST, ~FIRST):
        shape[place] -= np.log(np.exp(shape[place]).mean())
    before = Weights.uniform(1000)
    after = before.times(np.where(FIRST, here, there) + shape)
    assert after is not None
    return after, temper_hypotheses(POSES, before, after, temperature)


def test_where_both_fit_evidence_counts_by_a_power() -> None:
    after, flat = weighed(ENOUGH + 10.0, ENOUGH + 30.0, 0.05)
    assert after.linear[FIRST].sum() < 1e-8
    ratio = flat.linear[FIRST].sum() / flat.linear[~FIRST].sum()
    assert ratio == pytest.approx(600 / 400 * np.exp(-0.05 * 20.0), rel=1e-6)
    assert flat.linear.sum() == pytest.approx(1.0)


def test_where_one_does_not_fit_it_counts_as_it_is() -> None:
    _, flat = weighed(-1.0, ENOUGH + 20.0, 0.05)
    ratio = flat.linear[FIRST].sum() / flat.linear[~FIRST].sum()
    assert ratio == pytest.approx(600 / 400 * np.exp(-1.0 - ENOUGH - 0.05 * 20.0), rel=1e-6)


def test_what_fits_badly_everywhere_is_left_to_bayes() -> None:
    after, flat = weighed(-3.0, ENOUGH - 1.0, 0.05)
    np.testing.assert_allclose(flat.linear, after.linear, rtol=1e-9)


def test_evidence_too_large_for_numbers() -> None:
    after, flat = weighed(ENOUGH + 40.0, ENOUGH + 2000.0, 0.05)
    assert after.linear[FIRST].sum() == 0.0
    assert flat.linear[FIRST].sum() == pytest.approx(LEAST_SHARE, rel=0.02)
    ratio = weighed(ENOUGH, ENOUGH + 2000.0, 0.001)[1]
    assert ratio.linear[FIRST].sum() / ratio.linear[~FIRST].sum() == pytest.approx(
        1.5 * np.exp(-2.0), rel=1e-6
    )


def test_within_a_place_the_weights_are_those_of_bayes() -> None:
    after, flat = weighed(20.0, 15.0, 0.1)
    for place in (FIRST, ~FIRST):
        expected = after.linear[place] / after.linear[place].sum()
        np.testing.assert_allclose(flat.linear[place] / flat.linear[place].sum(), expected)


def test_a_place_that_fits_is_never_given_up_and_one_that_does_not_is() -> None:
    _, flat = weighed(ENOUGH + 1.0, ENOUGH + 300.0, 0.05)
    assert flat.linear[FIRST].sum() == pytest.approx(LEAST_SHARE, rel=0.02)
    _, flat = weighed(-20.0, ENOUGH + 300.0, 0.05)
    assert flat.linear[FIRST].sum() < 1e-9


def test_one_place_and_temperature_one_are_bayes() -> None:
    after, same = weighed(20.0, 10.0, 1.0)
    assert same is after
    poses = around(HERE, 1000)
    before = Weights.uniform(1000)
    after = before.times(poses[:, 0].copy())
    assert after is not None
    assert temper_hypotheses(poses, before, after, 0.05) is after


def test_a_place_that_is_ruled_out_stays_out() -> None:
    before = Weights.uniform(1000)
    after = before.times(np.where(FIRST, -np.inf, 20.0))
    assert after is not None
    flat = temper_hypotheses(POSES, before, after, 0.05)
    assert flat.linear[FIRST].sum() == 0.0
    assert np.isfinite(flat.linear).all()


def test_claim_equals_its_naive_twin() -> None:
    rng = np.random.default_rng(0)
    poses = rng.uniform([-2, -2, -np.pi], [2, 2, np.pi], (3000, 3))
    center = np.array([0.3, -0.2, 3.0])  # its window wraps around
    owners = np.where(rng.random(3000) < 0.3, 1, -1)
    left = rng.random(3000)
    expected_owners, expected_left = naive.claim(poses, center, 1.1, 0.6, 4, owners, left)
    _claim(poses, center, 1.1, 0.6, 4, owners, left)
    np.testing.assert_array_equal(owners, expected_owners)
    np.testing.assert_array_equal(left, expected_left)
    assert (owners == 4).sum() > 50


class TwoPlaces:
    """An image that fits in two places 4 m apart, at one of them somewhat better by chance."""

    def log_likelihood(self, poses: np.ndarray, observation: float) -> np.ndarray:
        here = -0.5 * ((poses[:, :2] / 0.2) ** 2).sum(axis=1)
        there = -0.5 * (((poses[:, :2] - [4.0, 0.0]) / 0.2) ** 2).sum(axis=1)
        return np.logaddexp(20.0 + observation + here, 20.0 - observation + there)


@pytest.mark.parametrize(("temperature", "held"), [(1.0, False), (0.05, True)])
def test_two_hypotheses_are_kept_until_an_image_tells_them_apart(
    temperature: float, held: bool
) -> None:
    chance = np.random.default_rng(3).normal(0.0, 6.0, 30)
    pf = ParticleFilter(
        DifferentialDrive(position_noise=0.02),
        TwoPlaces(),
        num_particles=2000,
        hypothesis_temperature=temperature,
        rng=0,
    )
    pf.initialize(np.concatenate([around([0, 0, 0], 1000, 0.2), around([4, 0, 0], 1000, 0.2)]))
    for luck in chance:
        estimate = pf.step([0.0, 0.0, 0.0], luck)
    found = pf.hypotheses(min_weight=0.005)
    assert (len(found) == 2) == held
    if held:
        places = sorted(round(float(hypothesis.pose[0])) for hypothesis in found)
        assert places == [0, 4]
        pf.sensor = Position([0.3, 0.3])
        for _ in range(3):
            estimate = pf.step([0.0, 0.0, 0.0], [4.0, 0.0])
        assert estimate.cluster_weight > 0.99
        assert abs(estimate.pose[0] - 4.0) < 0.1


def test_the_confidence_hears_what_an_image_says_at_once() -> None:
    """Flattened, the old place keeps the weight; Bayes' rule says that the robot is elsewhere."""
    pf = ParticleFilter(
        DifferentialDrive(),
        Position([0.1, 0.1]),
        num_particles=1000,
        min_effective_share=0.5,
        rng=0,
    )
    pf.initialize(np.concatenate([around([0, 0, 0], 990), around([3, 0, 0], 10)]))
    estimate = pf.update([3.0, 0.0])
    assert estimate.likelihood_exponent < 0.1
    assert np.hypot(*estimate.pose[:2]) < 0.5
    assert estimate.confidence < 0.01


@pytest.mark.parametrize("temperature", [0.0, 1.1, np.nan])
def test_misuse_names_the_option(temperature: float) -> None:
    with pytest.raises(ValueError, match=r"^hypothesis_temperature: expected"):
        ParticleFilter(
            DifferentialDrive(), Position([1.0, 1.0]), hypothesis_temperature=temperature
        )
