"""Pose graphs: what they take, and how sure they believe odometry to be."""

from __future__ import annotations

import numpy as np
import pytest
from graphs import links_of, loop, mode, simulated_graph

from pflut.geometry import compose, relative_pose
from pflut.localization.motion import DifferentialDrive, Omnidirectional
from pflut.mapping.pose_graph import ODOMETRY_NOISE, PoseGraph, motion_information


def test_a_drive_becomes_a_chain() -> None:
    truth = loop()
    graph = PoseGraph.from_odometry(truth)
    assert len(graph) == len(truth)
    assert graph.odometry_nodes.tolist() == [[k, k + 1] for k in range(len(truth) - 1)]
    again = compose(graph.poses[:-1], graph.odometry)
    np.testing.assert_allclose(again[:, :2], truth[1:, :2], atol=1e-12)
    assert len(graph.links) == 0


@pytest.mark.parametrize("noise", [ODOMETRY_NOISE, Omnidirectional(position_noise=0.01)])
@pytest.mark.parametrize("motion", [[0.4, 0.02, 0.1], [0.0, 0.0, 0.5], [0.3, 0.1, -0.4]])
def test_information_is_that_of_the_motion_model(
    noise: DifferentialDrive | Omnidirectional, motion: list[float]
) -> None:
    rng = np.random.default_rng(1)
    count = 20_000
    # small enough for the first order
    small = type(noise)(**{k: v * 0.01 for k, v in vars(noise).items() if k != "min_translation"})
    moved = small.sample(np.zeros((count, 3)), motion, rng)
    error = relative_pose(np.array(motion), moved)  # in the frame after the motion
    whitened = error @ np.linalg.cholesky(motion_information(motion, small))
    covariance = whitened.T @ whitened / count
    # of the entries of a sample covariance: 1 or sqrt(2) over sqrt(count)
    np.testing.assert_allclose(covariance, np.eye(3), atol=5.0 * np.sqrt(2.0 / count) + 0.01)


def test_links_between_images_that_are_no_nodes_are_left_out() -> None:
    truth = loop()[:4]
    links = links_of(np.array([[10, 20], [20, 99]]), [mode(np.zeros(2)), mode(np.ones(2))])
    graph = PoseGraph.from_odometry(truth, links, ids=[10, 20, 30, 40])
    assert graph.links.indices.tolist() == [[10, 20]]
    assert graph.link_nodes.tolist() == [[0, 1]]
    elsewhere = graph.with_poses(truth + 1.0)
    np.testing.assert_array_equal(elsewhere.poses, truth + 1.0)
    assert len(elsewhere.with_links(links[:0]).links) == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"poses": np.zeros((24, 2))}, r"poses: expected shape \(N, 3\)"),
        ({"odometry_nodes": np.zeros((3, 2))}, r"odometry_nodes: expected shape \(23, 2\)"),
        ({"odometry_nodes": np.full((23, 2), 24)}, "odometry_nodes: expected numbers below 24"),
        ({"odometry_information": np.zeros((23, 3, 3))}, "positive definite"),
        ({"odometry_information": np.tile([[1, 2, 0], [0, 1, 0], [0, 0, 1]], (23, 1, 1))}, "symm"),
        ({"ids": np.zeros(24)}, "ids: expected numbers that ascend"),
        ({"ids": np.arange(3)}, r"ids: expected shape \(24,\)"),
        ({"fixed": 24}, "fixed: expected one of 24 nodes, got 24"),
        ({"ids": np.arange(24) + 5}, "links: no node has the id 0"),
    ],
)
def test_what_does_not_fit_is_refused(change: dict[str, object], message: str) -> None:
    graph = simulated_graph(loop(), None)
    with pytest.raises(ValueError, match=message):
        PoseGraph(**{**vars(graph), **change})


def test_odometry_without_noise_is_refused() -> None:
    with pytest.raises(ValueError, match="noise: expected some in every direction"):
        PoseGraph.from_odometry(np.zeros((2, 3)), noise=DifferentialDrive())
