"""How much an image may tell hypotheses apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray
from pflut.localization.hypotheses import take_clusters
from pflut.localization.weights import Weights

MAX_CLUSTERS = 8
LEAST_SHARE = 0.01
"""Of the weight: a smaller cluster is part of the rest, and one that fits is not made smaller."""
ENOUGH = 5.0
"""Nats of evidence that an image fits in a place."""
SURE = 0.999
"""So much weight in one cluster, and there is nothing to tell apart."""


def temper_hypotheses(
    poses: FloatArray, before: Weights, after: Weights, temperature: float
) -> Weights:
    """Flatten what an image says of places against each other where it fits in several.

    The evidence of a cluster of particles is their mean likelihood. Up to ``ENOUGH`` it counts as
    it is: an image tells a place where it fits from one where it does not. Beyond, it counts by the
    power ``temperature``: how well it fits in one place and in another that looks alike is mostly
    chance, and a sensor model that adds up matches as if they were independent is right about where
    in a place the robot is, and far too sure about the place: the same furniture is matched, or
    not, in one reference after the other. Within a cluster the weights are by Bayes' rule. A
    hypothesis where the image fits is never given up: it keeps a hundredth of the weight.

    Parameters
    ----------
    poses : ndarray of shape (N, 3)
    before, after : Weights
        Before the image and, by `Weights.times`, after it; likelihoods are ratios against an image
        that says nothing.
    temperature : float
        In (0, 1]: 1 is Bayes' rule.

    Returns
    -------
    Weights
        ``after`` where there is but one hypothesis.
    """
    if temperature == 1.0:
        return after
    # of the weight before as well: a hypothesis that an image all but ruled out is one, too
    mixed = 0.5 * (before.linear + after.linear)
    clusters, owners = take_clusters(poses, mixed, max_count=MAX_CLUSTERS, least=LEAST_SHARE)
    if clusters and clusters[0].share >= SURE:
        return after
    number = len(clusters)
    owners[owners < 0] = number
    prior, posterior = (_log_sums(weights.log, owners, number + 1) for weights in (before, after))
    # a cluster without weight stays without
    there = posterior > -np.inf
    evidence = np.where(there, posterior, 0.0) - np.where(there, prior, 0.0) + after.log_mean
    excess = np.where(there, np.maximum(evidence - ENOUGH, 0.0), 0.0)
    flat = posterior + (temperature - 1.0) * excess
    flat -= np.logaddexp.reduce(flat)
    fits = there & (excess > 0.0) & (np.arange(number + 1) < number)
    flat[fits] = np.maximum(flat[fits], np.log(LEAST_SHARE))
    factor = np.where(there, flat, 0.0) - np.where(there, posterior, 0.0)
    return Weights.from_log(after.log + factor[owners])


def _log_sums(log: FloatArray, owners: NDArray[np.int64], count: int) -> FloatArray:
    """Give the logarithm of each cluster's weight, which may be far too small for a number."""
    highest = np.full(count, -np.inf)
    np.maximum.at(highest, owners, log)
    base = np.where(highest > -np.inf, highest, 0.0)
    sums = np.bincount(owners, np.exp(log - base[owners]), minlength=count)
    with np.errstate(divide="ignore"):
        return np.asarray(base + np.log(sums))
