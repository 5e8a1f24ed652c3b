"""Optimised pose graphs: exact where nothing is wrong, as sure as they should be, not fooled."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from graphs import CONCENTRATION, links_of, loop, mode, near_pairs, simulated_graph

from pflut.alignment import align_poses
from pflut.evaluation import root_mean_square, trajectory_errors
from pflut.geometry import FloatArray, relative_headings, relative_pose, wrap_to_pi
from pflut.mapping.constraint import KINDS, PoseConstraint
from pflut.mapping.graph_optimizer import optimize_graph
from pflut.mapping.graph_residuals import headings, odometry_residuals
from pflut.mapping.graph_system import GraphSystem
from pflut.mapping.links import Links
from pflut.mapping.pose_graph import PoseGraph
from pflut.von_mises.mixture import VonMisesMixture

pytest.importorskip("scipy")
LOSSES = ("mixture", "max-mixture", "cauchy", "huber", "gaussian")
EXACT = {"heading_noise": 1e-4, "position_noise": 1e-4}


def error(poses: FloatArray, truth: FloatArray) -> float:
    """Root mean square of the positions' errors, from the start."""
    return root_mean_square(trajectory_errors(poses, truth).position)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("fixed", [0, 7])
def test_without_noise_the_truth_comes_back(loss: str, fixed: int) -> None:
    truth = loop()
    graph = replace(simulated_graph(truth, None), fixed=fixed)
    rng = np.random.default_rng(0)
    disturbed = truth + rng.normal(0.0, 0.05, truth.shape)
    disturbed[fixed] = truth[fixed]
    found = optimize_graph(graph.with_poses(disturbed), loss=loss)
    difference = found.poses - truth
    difference[:, 2] = wrap_to_pi(difference[:, 2])
    np.testing.assert_allclose(difference, 0.0, atol=2e-4)
    assert found.converged and (found.link_probability > 0.9).all()


def test_the_optimum_is_that_of_scipy() -> None:
    from scipy.optimize import least_squares

    graph = simulated_graph(loop(16), np.random.default_rng(1))
    found = optimize_graph(graph, loss="gaussian", **EXACT)
    covariance = np.linalg.inv(np.array([[1.0, -0.3], [-0.3, 1.0]]) * CONCENTRATION)
    covariance += EXACT["heading_noise"] ** 2 * np.eye(2)
    root = np.linalg.cholesky(np.linalg.inv(covariance)).T
    means = graph.links.means

    def residuals(free: FloatArray) -> FloatArray:
        poses = np.concatenate([graph.poses[:1], free.reshape(-1, 3)])
        of_odometry, _ = odometry_residuals(poses, graph.odometry_nodes, graph.odometry)
        whitened = [
            np.linalg.cholesky(information).T @ one
            for information, one in zip(graph.odometry_information, of_odometry, strict=True)
        ]
        angles, _ = headings(poses, graph.link_nodes)
        chords = 2.0 * np.sin(0.5 * wrap_to_pi(angles - means))
        return np.concatenate([np.ravel(whitened), (chords @ root.T).ravel()])

    expected = least_squares(residuals, graph.poses[1:].ravel(), xtol=1e-12, ftol=1e-12)
    difference = found.poses[1:] - expected.x.reshape(-1, 3)
    difference[:, 2] = wrap_to_pi(difference[:, 2])
    # the position noise over the distance is not in SciPy's problem, and is next to nothing
    np.testing.assert_allclose(difference, 0.0, atol=1e-4)


def test_covariances_are_those_of_the_errors() -> None:
    truth, chi2 = loop(12), []
    for seed in range(30):
        graph = simulated_graph(truth, np.random.default_rng(seed), probability=1.0)
        found = optimize_graph(graph, **EXACT)
        difference = found.poses - truth
        difference[:, 2] = wrap_to_pi(difference[:, 2])
        covariances = found.covariances()
        np.testing.assert_array_equal(covariances[0], 0.0)
        last = len(truth) // 2
        chi2.append(difference[last] @ np.linalg.solve(covariances[last], difference[last]))
    # of three degrees of freedom: mean 3, variance 6
    assert abs(np.mean(chi2) - 3.0) < 5.0 * np.sqrt(6.0 / len(chi2))


def test_covariances_of_pairs_are_those_of_the_dense_inverse(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pflut.mapping.graph_system.BLOCK", 5)  # several blocks, the last not full
    graph = replace(simulated_graph(loop(12), np.random.default_rng(3)), fixed=4)
    system = GraphSystem(graph, "mixture", 0.01, 0.01)
    shares, _ = system.shares(graph.poses)
    nodes = np.array([[0, 3], [4, 11], [11, 2]])
    _, jacobian = system.linearized(graph.poses, shares)
    dense = np.zeros((36, 36))
    dense[np.ix_(system.free, system.free)] = np.linalg.inv((jacobian.T @ jacobian).toarray())
    for pair, covariance in zip(
        nodes, system.pair_covariances(graph.poses, shares, nodes), strict=True
    ):
        rows = (3 * pair[:, None] + np.arange(3)).ravel()
        np.testing.assert_allclose(covariance, dense[np.ix_(rows, rows)], rtol=1e-5, atol=1e-9)


def with_false(graph: PoseGraph, truth: FloatArray, count: int, seed: int) -> PoseGraph:
    """Add links between images far apart that say something random, as sure as the others."""
    rng = np.random.default_rng(seed)
    left, right = np.triu_indices(len(truth), 1)
    far = np.flatnonzero(np.hypot(*(truth[left] - truth[right])[:, :2].T) > 2.5)
    chosen = rng.choice(far, count, replace=False)
    pairs = np.stack([left[chosen], right[chosen]], axis=1)
    mixtures = [mode(angles) for angles in rng.uniform(-np.pi, np.pi, (count, 2))]
    return graph.with_links(Links.concatenate([graph.links, links_of(pairs, mixtures)]))


@pytest.mark.parametrize("loss", ["mixture", "max-mixture"])
def test_false_links_let_go(loss: str) -> None:
    truth = loop(32)
    for seed in range(5):
        graph = simulated_graph(truth, np.random.default_rng(seed))
        true = len(graph.links)
        fooled = with_false(graph, truth, true // 2, seed)
        clean, found = (optimize_graph(g, loss=loss) for g in (graph, fooled))
        assert (found.link_probability[:true] > 0.5).mean() > 0.97
        assert (found.link_probability[true:] < 0.01).all()
        assert error(found.poses, truth) < 1.2 * error(clean.poses, truth) + 0.002


def test_without_robustness_they_do_harm() -> None:
    truth = loop(32)
    graph = with_false(simulated_graph(truth, np.random.default_rng(0)), truth, 20, 0)
    plain, robust = (
        error(optimize_graph(graph, loss=loss).poses, truth) for loss in ("gaussian", "mixture")
    )
    assert plain > 5.0 * robust


def test_drift_does_not_make_true_links_look_false() -> None:
    truth = loop(32)
    for seed in range(5):
        graph = simulated_graph(truth, np.random.default_rng(seed))
        # each step turns too far: in the end by 90 degrees
        motions = graph.odometry + np.array([0.0, 0.0, np.radians(90.0) / len(graph.odometry)])
        poses = [truth[0]]
        for motion in motions:
            poses.append(np.asarray(relative_pose(relative_pose(poses[-1], np.zeros(3)), motion)))
        drifted = replace(graph, odometry=motions, poses=np.array(poses))
        found = optimize_graph(drifted)
        before = error(align_poses(drifted.poses, truth), truth)
        after = error(align_poses(found.poses, truth), truth)
        assert before > 0.5 and after < 0.1 * before
        assert (found.link_probability > 0.5).mean() > 0.95


def test_of_two_modes_the_right_one_is_found_though_it_is_lighter() -> None:
    truth = loop()
    graph = simulated_graph(truth, None)
    means = graph.links.means
    opposite = [
        VonMisesMixture(
            weights=np.array([0.6, 0.4]),
            means=np.stack([mean + np.pi, mean]),
            concentrations=np.full((2, 2), CONCENTRATION),
            couplings=np.zeros(2),
        )
        for mean in means
    ]
    found = optimize_graph(graph.with_links(links_of(graph.links.indices, opposite)))
    assert error(found.poses, truth) < 0.01
    of_right = found.shares[1::2]
    assert (of_right > 0.95).all()


def test_a_band_constrains_the_rotation_only() -> None:
    truth = loop(4)
    theta, phi, _ = relative_headings(truth[0], truth[3])
    psi = float(theta - phi + np.pi)
    band = VonMisesMixture(
        rotation_weights=np.ones(1),
        rotation_means=np.array([psi + 0.05]),
        rotation_concentrations=np.array([1e8]),
    )
    constraint = PoseConstraint("rotation", band, 0.0, 0.0)
    links = Links.of(np.array([[0, 3]]), [9], [9.0], [0.99], [constraint])
    graph = PoseGraph.from_odometry(truth, links)
    found = optimize_graph(graph, **EXACT)
    turn = wrap_to_pi(found.poses[3, 2] - found.poses[0, 2] - psi - 0.05)
    assert abs(turn) < 1e-3 and found.link_probability[0] > 0.9
    system = GraphSystem(graph, "mixture", 1e-4, 1e-4)
    _, jacobian = system.linearized(graph.poses, np.ones(1))
    of_link = jacobian.toarray()[-2:]
    assert np.abs(of_link[:, [0, 1, 3, 4, 6, 7]]).max() < 1e-9  # no position
    assert abs(of_link[0, 8]) > 1e3 and np.abs(of_link[1]).max() == 0.0


def test_links_that_say_nothing_change_nothing() -> None:
    truth = loop()
    pairs = near_pairs(truth)
    nothing = links_of(pairs, [VonMisesMixture(uniform_weight=1.0)] * len(pairs))
    found = optimize_graph(PoseGraph.from_odometry(truth, nothing))
    np.testing.assert_allclose(found.poses[:, :2], truth[:, :2], atol=1e-9)
    assert not found.link_probability.any()


def test_links_of_the_kind_none_count_by_what_their_mixtures_say() -> None:
    truth = loop()
    graph = simulated_graph(truth, np.random.default_rng(6))
    silent = replace(graph.links, kind=np.full(len(graph.links), KINDS.index("none")))
    found, expected = optimize_graph(graph.with_links(silent)), optimize_graph(graph)
    np.testing.assert_array_equal(found.poses, expected.poses)
    # but none of them is believed to tell a pose, and nor are the methods to compare with
    assert len(expected.believed) and not len(found.believed)
    for loss in ("gaussian", "huber", "cauchy"):
        without = optimize_graph(graph.with_links(silent), loss=loss).poses
        odometry = optimize_graph(graph.with_links(graph.links[:0]), loss=loss).poses
        np.testing.assert_allclose(without, odometry, atol=1e-6)


def test_a_graph_of_one_node_or_without_links() -> None:
    assert len(optimize_graph(PoseGraph.from_odometry(np.zeros((1, 3)))).poses) == 1
    truth = loop()
    found = optimize_graph(PoseGraph.from_odometry(truth))
    np.testing.assert_allclose(found.poses[:, :2], truth[:, :2], atol=1e-9)
    # odometry alone: each step adds to what is not known
    spread = np.trace(found.covariances()[:, :2, :2], axis1=1, axis2=2)
    assert spread[0] == 0.0 and spread[8] > spread[2] > 0.0


def test_the_cost_falls_and_the_search_finds_no_higher_one() -> None:
    truth = loop(32)
    graph = with_false(simulated_graph(truth, np.random.default_rng(5)), truth, 40, 5)
    system = GraphSystem(graph, "mixture", 0.01, 0.01)
    _, before = system.shares(graph.poses)
    there = optimize_graph(graph, search=False)
    searched = optimize_graph(graph)
    assert there.cost < before and searched.cost <= there.cost


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"loss": "tukey"}, "loss: expected one of mixture, .*, got 'tukey'"),
        ({"heading_noise": 0.0}, "heading_noise: expected a number above 0, got 0.0"),
        ({"position_noise": np.nan}, "position_noise: expected a number above 0, got nan"),
    ],
)
def test_what_is_out_of_range_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        optimize_graph(simulated_graph(loop(), None), **options)


def test_without_scipy_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "scipy.sparse", None)
    with pytest.raises(ImportError, match=r"pip install 'pflut\[mapping\]'"):
        optimize_graph(simulated_graph(loop(), None))
