"""Localization in a topological map: the walk, the evidence, and the filter by enumeration."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from evidence import some_evidence

from pflut.features import FeatureCache, Features
from pflut.likelihood.table import LikelihoodTable
from pflut.localization.particle_filter import ParticleFilter
from pflut.mapping.all_pairs import dataset_features
from pflut.mapping.node_localizer import NodeLocalizer
from pflut.mapping.node_model import NodeMatches, NodeModel
from pflut.mapping.node_walk import NodeWalk
from pflut.mapping.topological_map import TopologicalMap

EDGES = np.array([[0, 1], [0, 2], [1, 2], [2, 3], [3, 4]])
PROBABILITY = np.array([0.9, 0.6, 0.8, 0.7, 1.0])


def small_map(count: int = 6) -> TopologicalMap:
    """A triangle with a tail, and images without a link."""
    return TopologicalMap(
        places=np.array([0, 0, 0, 1, 1, *range(2, count - 3)]),
        edges=EDGES,
        probability=PROBABILITY,
        headings=np.full((5, 2), np.nan),
        rotation=np.full(5, np.nan),
    )


class Given:
    """A sensor whose observations are log-likelihoods."""

    def log_likelihood(self, probabilities: np.ndarray, observation: Any) -> np.ndarray:
        return np.asarray(observation, dtype=np.float64)


def hop_matrix(made: TopologicalMap) -> np.ndarray:
    """Column a: where a hop from a leads."""
    hop = np.zeros((len(made), len(made)))
    for (a, b), p in zip(made.edges, made.probability, strict=True):
        hop[a, b] = hop[b, a] = p
    for a in range(len(made)):
        hop[:, a] = hop[:, a] / hop[:, a].sum() if hop[:, a].any() else np.eye(len(made))[a]
    return hop


def walk_matrix(made: TopologicalMap, hops: float, carried_away: float = 0.0) -> np.ndarray:
    """The walk's, by the exponential of a matrix: hops that are Poisson many."""
    from scipy.linalg import expm

    moved = expm(hops * (hop_matrix(made) - np.eye(len(made))))
    return (1.0 - carried_away) * moved + carried_away / len(made)


@pytest.mark.parametrize("hops", [0.0, 0.3, 1.0, 7.0, 60.0, 1000.0])
def test_the_walk_is_the_exponential_of_its_matrix(hops: float) -> None:
    made = small_map()
    walk = NodeWalk(hops=hops, carried_away=0.01)
    expected = walk_matrix(made, hops, 0.01)
    for node in range(len(made)):
        moved = walk.predict(made, np.eye(len(made))[node])
        np.testing.assert_allclose(moved, expected[:, node], atol=1e-10)


def test_a_walk_without_end_spreads_over_what_is_linked() -> None:
    made = small_map()
    moved = NodeWalk(carried_away=0.0).predict(made, np.eye(6)[0], [1e9, 0.0, 0.0])
    leaving = np.bincount(made.edges.ravel(), np.repeat(made.probability, 2), 6)
    np.testing.assert_allclose(moved, leaving / leaving.sum(), atol=1e-9)


def test_odometry_says_how_many_hops() -> None:
    walk = NodeWalk(hops=0.4, hop_length=2.0)
    assert walk.expected_hops() == 0.4
    assert walk.expected_hops([3.0, 4.0, 1.0]) == pytest.approx(2.5)
    assert walk.expected_hops([0.0, 0.0, 3.0]) == 0.0
    made, start = small_map(), np.eye(6)[0]
    still = NodeWalk(carried_away=0.0)
    np.testing.assert_array_equal(still.predict(made, start, [0.0, 0.0, 1.0]), start)
    # who has no neighbour stays
    np.testing.assert_allclose(still.predict(made, np.eye(6)[5], [9.0, 0.0, 0.0]), np.eye(6)[5])
    with pytest.raises(ValueError, match="odometry: expected 3 finite numbers"):
        walk.expected_hops([np.nan, 0.0, 0.0])


def test_the_filter_by_enumeration() -> None:
    """Sum over all paths through the map, each weighed by its steps and its images."""
    made, steps = small_map(), 3
    observations = np.random.default_rng(2).normal(0.0, 1.5, (steps, 6))
    moves = [walk_matrix(made, hops, 0.02) for hops in (0.5, 1.2)]
    joint = np.zeros(6)
    evidence = 0.0
    for path in product(range(6), repeat=steps):
        weight = np.exp(sum(observations[k, node] for k, node in enumerate(path))) / 6
        for move, before, after in zip(moves, path, path[1:], strict=False):
            weight *= move[after, before]
        joint[path[-1]] += weight
        evidence += weight
    pf = NodeLocalizer(made, Given(), walk=NodeWalk(hops=0.5, carried_away=0.02))
    logs = [pf.update(observations[0]).log_mean_likelihood]
    logs.append(pf.step(None, observations[1]).log_mean_likelihood)
    estimate = pf.step([0.0, 1.2, 0.0], observations[2])
    np.testing.assert_allclose(pf.probabilities, joint / evidence, rtol=1e-9)
    assert logs[0] + logs[1] + estimate.log_mean_likelihood == pytest.approx(np.log(evidence))
    assert estimate.node == np.argmax(joint)
    assert estimate.probability == pytest.approx(joint.max() / evidence)
    places = np.array([joint[:3].sum(), joint[3:5].sum(), joint[5]]) / evidence
    np.testing.assert_allclose(pf.place_probabilities, places, rtol=1e-9)
    assert (estimate.place, estimate.place_probability) == (
        np.argmax(places),
        pytest.approx(places.max()),
    )
    assert estimate.effective_nodes == pytest.approx(1.0 / (pf.probabilities**2).sum())


def test_particles_that_walk_the_map_find_the_same() -> None:
    """The particle filter with nodes for poses is the same filter, but for chance."""
    made = small_map()
    observations = np.random.default_rng(4).normal(0.0, 1.0, (3, 6))
    move = np.cumsum(walk_matrix(made, 0.8), axis=0)

    class Walk:
        def sample(self, poses: np.ndarray, odometry: Any, rng: Any = None) -> np.ndarray:
            moved = np.array(poses)
            drawn = np.random.default_rng(rng).random(len(poses))
            columns = move[:, poses[:, 0].astype(int)]
            moved[:, 0] = np.minimum((drawn > columns).sum(axis=0), 5)
            return moved

    class OfNodes:
        def log_likelihood(self, poses: np.ndarray, observation: Any) -> np.ndarray:
            return observation[poses[:, 0].astype(int)]

    count = 40_000
    particles = ParticleFilter(Walk(), OfNodes(), num_particles=count, rng=5)
    nodes = np.repeat(np.arange(6.0), count // 6)
    particles.initialize(np.column_stack([nodes, 0.0 * nodes, 0.0 * nodes]))
    exact = NodeLocalizer(made, Given(), walk=NodeWalk(carried_away=0.0))
    particles.update(observations[0])
    exact.update(observations[0])
    for observation in observations[1:]:
        particles.step([0.8, 0.0, 0.0], observation)
        exact.step([0.8, 0.0, 0.0], observation)
    found = np.bincount(particles.poses[:, 0].astype(int), particles.weights, minlength=6)
    # three resamplings and weights within e^3 of each other: a fourth of them count at least
    error = 5.0 * np.sqrt(3.0 * exact.probabilities / (count / 4.0))
    assert (np.abs(found - exact.probabilities) < error).all()


def test_start_and_degenerate_observations() -> None:
    pf = NodeLocalizer(small_map(), Given())
    assert pf.estimate().effective_nodes == pytest.approx(6.0)
    pf.initialize([0.0, 3.0, 1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(pf.probabilities, [0.0, 0.75, 0.25, 0.0, 0.0, 0.0])
    for bad in (np.full(6, np.nan), np.full(6, -np.inf), [0.0, -np.inf, -np.inf, 0.0, 0.0, 0.0]):
        estimate = pf.update(bad)
        assert estimate.degenerate and estimate.log_mean_likelihood is None
        np.testing.assert_allclose(pf.probabilities[:3], [0.0, 0.75, 0.25])
    assert not pf.update(np.zeros(6)).degenerate
    pf.probabilities[:] = 9.0  # a copy
    assert pf.probabilities.sum() == pytest.approx(1.0)
    pf.initialize()
    np.testing.assert_allclose(pf.probabilities, 1 / 6)
    for bad_start in ([1.0], np.zeros(6), np.full(6, np.nan), -np.ones(6)):
        with pytest.raises(ValueError, match=r"weights|probabilities"):
            pf.initialize(bad_start)
    with pytest.raises(ValueError, match=r"log_likelihood: expected shape \(6,\), got \(5,\)"):
        pf.update(np.zeros(5))


@pytest.mark.parametrize(
    "options", [{"hops": -1.0}, {"hop_length": 0.0}, {"carried_away": 1.0}, {"hops": np.inf}]
)
def test_wrong_walks(options: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(options))):
        NodeWalk(**options)


def images(count: int, seed: int = 0) -> list[Features]:
    """Features of images that have nothing in common; the last one has none."""
    rng = np.random.default_rng(seed)
    counts = [60] * (count - 1) + [0]
    return [
        Features(
            rng.uniform(0.0, 6.28, n),
            rng.uniform(-0.5, 0.5, n),
            np.abs(rng.normal(size=(n, 16))).astype(np.float32),
            np.zeros((n, 2), np.float32),
            np.ones(n, np.float32),
        )
        for n in counts
    ]


def test_the_likelihood_is_tempered_evidence_above_a_floor(small_table: LikelihoodTable) -> None:
    model = NodeModel(small_map(), images(6), small_table, temperature=0.5, link_probability=0.8)
    matches = NodeMatches(np.array([1, 4]), some_evidence([6.0, -40.0], 9, 4))
    found = model.log_likelihood(None, matches)
    expected = np.zeros(6)
    expected[1], expected[4] = np.log(0.8 * np.exp(3.0) + 0.2), np.log(0.2 + 0.8 * np.exp(-20.0))
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_which_nodes_are_matched(small_table: LikelihoodTable) -> None:
    features = images(6)
    model = NodeModel(small_map(), features, small_table, max_candidates=1, max_neighbours=3)
    assert model.candidates(None, features[4]).tolist() == [4]
    # the robot is at 3: its neighbours are 2 and 4
    assert model.candidates(np.eye(6)[3], features[0]).tolist() == [0, 2, 3, 4]
    # nowhere in particular: the neighbourhood of all nodes says nothing
    assert model.candidates(np.full(6, 1 / 6), features[0]).tolist() == [0]


def test_an_image_is_most_probable_at_its_own_node(small_table: LikelihoodTable) -> None:
    features = images(6)
    model = NodeModel(small_map(), features, small_table)
    for node in range(5):
        found = model.log_likelihood(None, features[node])
        assert np.argmax(found) == node and found[node] > 5.0
        # what is remembered of the image is the same
        np.testing.assert_array_equal(model.log_likelihood(None, features[node]), found)
    np.testing.assert_array_equal(model.log_likelihood(None, features[5]), np.zeros(6))


def test_wrong_models(small_table: LikelihoodTable) -> None:
    features = images(6)
    for options, words in (
        ({"temperature": 0.0}, "temperature"),
        ({"ratio": 1.1}, "ratio"),
        ({"link_probability": 1.0}, "link_probability"),
        ({"max_candidates": 0}, "max_candidates"),
    ):
        with pytest.raises(ValueError, match=words):
            NodeModel(small_map(), features, small_table, **options)
    with pytest.raises(ValueError, match="features: expected 6, one an image, got 5"):
        NodeModel(small_map(), features[:5], small_table)
    model = NodeModel(small_map(), features, small_table)
    with pytest.raises(ValueError, match="without an extractor"):
        model.log_likelihood(None, np.zeros((8, 8), np.uint8))
    beyond = NodeMatches(np.array([6]), some_evidence([0.0], 0, 0))
    with pytest.raises(ValueError, match="nodes 0 to 5"):
        model.log_likelihood(None, beyond)
    with pytest.raises(ValueError, match="expected each once"):
        NodeMatches(np.array([1, 1]), some_evidence([0.0, 0.0], 0, 0))
    with pytest.raises(ValueError, match="expected 2 pairs"):
        NodeMatches(np.array([1, 2]), some_evidence([0.0], 0, 0))


def test_a_drive_through_a_room(
    room_dataset: Any, room_cache: FeatureCache, small_table: LikelihoodTable
) -> None:
    """Each image of the drive is at one of the nodes nearest to it."""
    features = list(dataset_features(room_dataset, cache=room_cache))
    references, queries = room_dataset.reference_indices, room_dataset.query_indices
    nodes = room_dataset.ground_truth[references, :2]
    distance = np.hypot(*(nodes[:, None] - nodes).transpose(2, 0, 1))
    spacing = np.where(distance > 0.0, distance, np.inf).min(axis=1).max()
    edges = np.argwhere(np.triu(distance < 1.5 * spacing, 1))
    made = TopologicalMap(
        places=np.zeros(len(nodes), np.int64),
        edges=edges,
        probability=np.full(len(edges), 0.9),
        headings=np.full((len(edges), 2), np.nan),
        rotation=np.full(len(edges), np.nan),
    )
    model = NodeModel(made, [features[k] for k in references], small_table)
    pf = NodeLocalizer(made, model, walk=NodeWalk(hop_length=float(spacing)))
    beyond = []
    for before, query in zip([None, *queries], queries, strict=False):
        odometry = None if before is None else room_dataset.odometry_between(before, query)
        estimate = pf.step(odometry, features[query])
        away = np.hypot(*(nodes - room_dataset.ground_truth[query, :2]).T)
        beyond.append(away[estimate.node] - away.min())
    assert len(nodes) > 5 and np.mean(np.array(beyond) < 0.5 * spacing) > 0.8
