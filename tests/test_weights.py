"""Weights: normalised without overflow, refused or None where none are left."""

import naive
import numpy as np
import pytest

from pflut.localization.weights import Weights


def check(weights, log_weights):
    linear, logs, size, log_mean = naive.normalize(np.asarray(log_weights, dtype=float))
    np.testing.assert_allclose(weights.linear, linear, rtol=1e-12)
    np.testing.assert_allclose(weights.log, logs, atol=1e-12)
    np.testing.assert_allclose(weights.effective_sample_size, size)
    np.testing.assert_allclose(weights.log_mean, log_mean, atol=1e-12)


def test_equals_its_naive_twin():
    rng = np.random.default_rng(0)
    for size in (1, 2, 1000):
        log_weights = rng.normal(0, 3, size)
        check(Weights.from_log(log_weights), log_weights)
        log_likelihood = rng.normal(-50, 10, size)
        prior = Weights.from_log(log_weights)
        check(prior.times(log_likelihood), prior.log + log_likelihood)


def test_no_overflow_and_no_underflow():
    for offset in (-1e6, 1e6):
        weights = Weights.from_log(np.array([0.0, -1.0, -np.inf]) + offset)
        check(weights, np.array([0.0, -1.0, -np.inf]) + offset)
        assert weights.linear[2] == 0.0
        assert weights.log[2] == -np.inf


def test_a_far_weight_comes_back():
    # exp(-2000) is 0.0, but its logarithm is kept
    weights = Weights.from_log([0.0, -2000.0])
    assert weights.linear[1] == 0.0
    back = weights.times(np.array([-2000.0, 0.0]))
    np.testing.assert_allclose(back.linear, [0.5, 0.5])


def test_uniform():
    weights = Weights.uniform(4)
    check(weights, np.full(4, -np.log(4.0)))
    assert len(weights) == 4


@pytest.mark.parametrize(
    "log_likelihood",
    [
        [-np.inf, -np.inf, -np.inf],
        [0.0, np.nan, 0.0],
        [np.nan, -1.0, -2.0],
        [0.0, 0.0, np.nan],
        [np.inf, 0.0, 0.0],
        [-np.inf, np.nan, -np.inf],
        [-np.inf, np.inf, 0.0],
        [0.0, 0.0, -np.inf],  # rules out the one particle left
    ],
)
def test_none_where_no_weights_are_left(log_likelihood):
    prior = Weights.from_log([-np.inf, -np.inf, 0.0])
    assert prior.times(np.array(log_likelihood)) is None


@pytest.mark.parametrize("bad", [[], [[0.0]], [np.nan, 0.0], [np.inf, 0.0], [-np.inf, -np.inf]])
def test_bad_log_weights_are_refused(bad):
    with pytest.raises(ValueError, match="log_weights: expected"):
        Weights.from_log(bad)
