"""Tests of the exponent that keeps enough effective particles."""

from __future__ import annotations

import numpy as np
import pytest

from pflut.localization.motion import DifferentialDrive
from pflut.localization.particle_filter import ParticleFilter
from pflut.localization.tempering import MAX_LOOKED_AT, tempering_exponent
from pflut.localization.weights import Weights


def size_after(weights: Weights, log_likelihood: np.ndarray, exponent: float) -> float:
    after = weights.times(exponent * log_likelihood)
    assert after is not None
    return after.effective_sample_size


@pytest.mark.parametrize("share", [0.01, 0.1, 0.5, 0.9])
def test_leaves_just_enough_effective_particles(share: float) -> None:
    rng = np.random.default_rng(1)
    log_likelihood = 200.0 * rng.standard_normal(1000)
    weights = Weights.from_log(0.1 * rng.standard_normal(1000))
    exponent = tempering_exponent(weights, log_likelihood, share)
    assert 0.0 < exponent < 1.0
    assert size_after(weights, log_likelihood, exponent) >= share * weights.effective_sample_size
    # an exponent larger by a hundredth would leave too few
    assert size_after(weights, log_likelihood, 1.012 * exponent) < share * 1000


def test_a_blunt_likelihood_is_left_alone() -> None:
    log_likelihood = 0.1 * np.random.default_rng(2).standard_normal(500)
    assert tempering_exponent(Weights.uniform(500), log_likelihood, 0.5) == 1.0


def test_a_share_of_zero_is_bayes_rule() -> None:
    log_likelihood = -1000.0 * np.arange(500.0)
    assert tempering_exponent(Weights.uniform(500), log_likelihood, 0.0) == 1.0


def test_gaussian_against_the_exact_answer() -> None:
    # Uniform particles over a long line, a normal likelihood of width s raised to b: the
    # effective share is sqrt(4 pi) s / sqrt(b) / length.
    x = np.linspace(-50.0, 50.0, 10_001)
    s, share = 0.01, 0.05
    exponent = tempering_exponent(Weights.uniform(x.size), -0.5 * (x / s) ** 2, share)
    expected = 4.0 * np.pi * (s / (share * 100.0)) ** 2
    # the bisection ends within 3/4 of 2^-8 of the larger end, which is up to four times larger
    assert 1.0 - 0.012 < exponent / expected < 1.0 + 1e-3


def test_ruled_out_particles_stay_ruled_out() -> None:
    log_likelihood = np.where(np.arange(100) < 50, -np.inf, np.linspace(0.0, 500.0, 100))
    exponent = tempering_exponent(Weights.uniform(100), log_likelihood, 0.3)
    after = Weights.uniform(100).times(exponent * log_likelihood)
    assert after is not None
    assert (after.linear[:50] == 0.0).all()
    assert after.effective_sample_size >= 30.0


def test_more_ruled_out_than_the_share_ends_at_the_smallest_exponent() -> None:
    log_likelihood = np.where(np.arange(100) < 95, -np.inf, np.arange(100.0))
    exponent = tempering_exponent(Weights.uniform(100), log_likelihood, 0.3)
    assert exponent < 1e-12
    assert size_after(Weights.uniform(100), log_likelihood, exponent) > 4.999


def test_many_particles_are_looked_at_in_part() -> None:
    rng = np.random.default_rng(3)
    n = 20 * MAX_LOOKED_AT
    log_likelihood = 50.0 * rng.standard_normal(n)
    exponent = tempering_exponent(Weights.uniform(n), log_likelihood, 0.1)
    # exp(b g) of a normal g leaves exp(-b^2 sd^2) of the particles: within the sample's noise
    assert size_after(Weights.uniform(n), log_likelihood, exponent) == pytest.approx(
        0.1 * n, rel=0.2
    )


class Sharp:
    """A sensor much sharper than the particles' distances."""

    def log_likelihood(self, poses: np.ndarray, observation: float) -> np.ndarray:
        return -0.5 * ((poses[:, 0] - observation) / 1e-4) ** 2


def test_the_filter_keeps_particles_and_says_so() -> None:
    def after(share: float) -> tuple[float, float]:
        pf = ParticleFilter(
            DifferentialDrive(), Sharp(), num_particles=1000, min_effective_share=share, rng=0
        )
        pf.initialize_uniform((-1.0, -1.0, 1.0, 1.0))
        estimate = pf.update(0.25)
        return estimate.effective_sample_size, estimate.likelihood_exponent

    size, exponent = after(0.1)
    assert size >= 99.9
    assert exponent < 1.0
    size, exponent = after(0.0)
    assert size < 3.0
    assert exponent == 1.0


def test_share_out_of_range_is_refused() -> None:
    with pytest.raises(ValueError, match="min_effective_share"):
        ParticleFilter(DifferentialDrive(), Sharp(), min_effective_share=1.0)


def test_proposals_do_not_count() -> None:
    """Proposals of hardly any weight must not make every exponent too large."""
    rng = np.random.default_rng(0)
    log = np.concatenate([np.zeros(1000), np.full(4000, -20.0)])
    log_likelihood = np.concatenate([rng.normal(0.0, 3.0, 1000), np.zeros(4000)])
    alone = tempering_exponent(Weights.uniform(1000), log_likelihood[:1000], 0.5)
    together = tempering_exponent(Weights.from_log(log), log_likelihood, 0.5, proposed=4000)
    assert together == pytest.approx(alone, rel=0.02)


def test_particles_without_weight_are_not_looked_at() -> None:
    log = np.where(np.arange(60_000) % 3 == 0, -np.inf, 0.0)
    weights = Weights.from_log(log)
    log_likelihood = 50.0 * np.random.default_rng(0).standard_normal(60_000)
    exponent = tempering_exponent(weights, log_likelihood, 0.1)
    assert 0.0 < exponent < 1.0
    assert size_after(weights, log_likelihood, exponent) == pytest.approx(4000, rel=0.2)
