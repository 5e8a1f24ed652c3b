"""The factor graph for GTSAM: the same cost, the same optimum. Skipped where GTSAM is not."""

from __future__ import annotations

import numpy as np
import pytest
from graphs import loop, simulated_graph
from test_graph_optimizer import error, with_false

from pflut.mapping.graph_optimizer import optimize_graph
from pflut.mapping.graph_system import GraphSystem
from pflut.mapping.gtsam_graph import gtsam_graph, poses_of

gtsam = pytest.importorskip("gtsam")


def test_its_error_is_the_cost_of_max_mixtures() -> None:
    truth = loop()
    graph = with_false(simulated_graph(truth, np.random.default_rng(0)), truth, 20, 0)
    factors, values = gtsam_graph(graph)
    system = GraphSystem(graph, "max-mixture", 0.01, 0.01)
    least = system.terms.lowest(system.constant).sum()
    # the odometry fits exactly where it put the nodes: nothing but the links is left
    expected = system.shares(graph.poses)[1] - least
    assert factors.error(values) == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(poses_of(values, graph)[:, :2], graph.poses[:, :2], atol=1e-12)


def test_its_derivatives_are_those_of_its_error() -> None:
    graph = simulated_graph(loop(8), np.random.default_rng(1))
    factors, values = gtsam_graph(graph)
    rng = np.random.default_rng(2)
    linear = factors.linearize(values)
    for _ in range(5):
        step = gtsam.VectorValues()
        for key in range(8):
            step.insert(key, rng.normal(0.0, 1e-5, 3))
        moved = factors.error(values.retract(step))
        assert moved == pytest.approx(linear.error(step), rel=1e-4)


def test_it_finds_the_same_poses() -> None:
    truth = loop(32)
    graph = with_false(simulated_graph(truth, np.random.default_rng(3)), truth, 30, 3)
    found = optimize_graph(graph, loss="max-mixture")
    factors, values = gtsam_graph(found.graph)
    result = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
    poses = poses_of(result, graph)
    # its odometry errors are logarithms of poses, those of g2o and of pflut are not
    np.testing.assert_allclose(poses[:, :2], found.poses[:, :2], atol=5e-3)
    assert error(poses, truth) < 0.05
