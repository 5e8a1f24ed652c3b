"""Small pose graphs for the tests: a drive round a room, and links as sure as they should be."""

from __future__ import annotations

import numpy as np

from pflut.geometry import FloatArray, compose, relative_headings
from pflut.mapping.constraint import PoseConstraint
from pflut.mapping.links import Links
from pflut.mapping.pose_graph import PoseGraph
from pflut.von_mises.mixture import VonMisesMixture

CONCENTRATION = 2500.0  # 0.02 rad


def loop(count: int = 24) -> FloatArray:
    """Poses round a circle of 2 m, twice, looking ahead."""
    angle = np.linspace(0.0, 4.0 * np.pi, count, endpoint=False)
    radius = np.where(angle < 2.0 * np.pi, 2.0, 1.6)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), angle + 0.5 * np.pi], axis=1)


def mode(headings: FloatArray, weight: float = 1.0, uniform: float = 0.0) -> VonMisesMixture:
    """A mixture of one mode."""
    return VonMisesMixture(
        weights=np.array([weight]),
        means=np.array([headings]),
        concentrations=np.full((1, 2), CONCENTRATION),
        couplings=np.array([0.3 * CONCENTRATION]),
        uniform_weight=uniform,
    )


def links_of(pairs: FloatArray, mixtures: list[VonMisesMixture], probability: float = 0.9) -> Links:
    """Links between images."""
    count = len(mixtures)
    return Links.of(
        np.asarray(pairs),
        np.full(count, 30),
        np.full(count, 20.0),
        np.full(count, probability),
        [PoseConstraint("pose", mixture, 0.0, 0.0) for mixture in mixtures],
    )


def near_pairs(truth: FloatArray, reach: float = 2.5) -> FloatArray:
    """All pairs of images nearer than that."""
    left, right = np.triu_indices(len(truth), 1)
    distance = np.hypot(*(truth[left] - truth[right])[:, :2].T)
    near = (distance < reach) & (distance > 0.1)
    return np.stack([left[near], right[near]], axis=1)


def simulated_graph(
    truth: FloatArray, rng: np.random.Generator | None, *, probability: float = 0.9
) -> PoseGraph:
    """A graph of a drive whose errors are those it is told of; without ``rng`` none."""
    covariance = np.linalg.inv(np.array([[1.0, -0.3], [-0.3, 1.0]]) * CONCENTRATION)
    exact = PoseGraph.from_odometry(truth)
    motions = exact.odometry
    pairs = near_pairs(truth)
    theta, phi, _ = relative_headings(truth[pairs[:, 0]], truth[pairs[:, 1]])
    headings = np.stack([theta, phi], axis=1)
    if rng is not None:
        headings += rng.multivariate_normal(np.zeros(2), covariance, len(pairs))
        noise = np.linalg.inv(exact.odometry_information)
        errors = np.array([rng.multivariate_normal(np.zeros(3), c) for c in noise])
        motions = compose(motions, errors)
    poses = [truth[0]]
    for motion in motions:
        poses.append(compose(poses[-1], motion))
    return PoseGraph(
        np.array(poses),
        exact.odometry_nodes,
        motions,
        exact.odometry_information,
        links_of(pairs, [mode(heading) for heading in headings], probability),
    )
