"""g2o files: written and read back, read by GTSAM, and refused in one line."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from graphs import links_of, loop, simulated_graph
from test_links import random_links

from pflut.geometry import relative_headings, relative_pose, wrap_to_pi
from pflut.mapping.constraint import KINDS
from pflut.mapping.g2o import as_pose_edge, read_g2o, write_g2o
from pflut.mapping.graph_system import GraphSystem
from pflut.mapping.pose_graph import PoseGraph
from pflut.von_mises.mixture import VonMisesMixture


def graph_of_everything() -> PoseGraph:
    """Forty nodes of odd ids, and links of all kinds between them."""
    links, _ = random_links(60, 2)
    links = replace(links, indices=3 * links.indices + 5)
    rng = np.random.default_rng(0)
    odometry = np.cumsum(rng.normal(0.0, 0.3, (40, 3)), axis=0)
    graph = PoseGraph.from_odometry(odometry, links, ids=3 * np.arange(40) + 5)
    return replace(graph, fixed=4)


def mode_of(concentrations: list[float], coupling: float) -> VonMisesMixture:
    """A mixture of one mode."""
    return VonMisesMixture(
        weights=np.ones(1),
        means=np.array([[0.4, -2.6]]),
        concentrations=np.array([concentrations]),
        couplings=np.array([coupling]),
    )


def test_a_graph_comes_back_with_all_digits(tmp_path: Path) -> None:
    graph = graph_of_everything()
    write_g2o(tmp_path / "map.g2o", graph)
    again = read_g2o(tmp_path / "map.g2o")
    for name in ("poses", "odometry_nodes", "odometry", "odometry_information", "ids", "fixed"):
        np.testing.assert_array_equal(getattr(again, name), getattr(graph, name))
    unknown = ("num_matches", "log_evidence", "entropy", "divergence")
    for item in fields(graph.links):
        if item.name not in unknown:
            ours, theirs = getattr(graph.links, item.name), getattr(again.links, item.name)
            np.testing.assert_array_equal(theirs, ours, err_msg=item.name)


def test_the_lines_are_those_of_the_format(tmp_path: Path) -> None:
    graph = simulated_graph(loop(4), None)
    write_g2o(tmp_path / "map.g2o", graph, edges=np.array([0]))
    lines = [line.split() for line in (tmp_path / "map.g2o").read_text().splitlines()]
    tags = [words[0] for words in lines]
    links = len(graph.links)
    assert tags == [
        *["VERTEX_SE2"] * 4,
        *["EDGE_SE2"] * 3,
        *["EDGE_SE2_HEADINGS"] * links,
        "EDGE_SE2",
        "FIX",  # GTSAM reads nothing after it
    ]
    assert {len(words) for words in lines if words[0] == "EDGE_SE2"} == {12}
    assert lines[-1] == ["FIX", "0"]
    write_g2o(tmp_path / "plain.g2o", graph, mixtures=False)
    assert "HEADINGS" not in (tmp_path / "plain.g2o").read_text()


def test_a_link_as_a_plain_edge_fits_where_the_headings_do() -> None:
    truth = loop(12)
    graph = simulated_graph(truth, np.random.default_rng(1))
    for link, (left, right) in enumerate(graph.link_nodes):
        motion, information = as_pose_edge(graph, link)
        *_, distance = relative_headings(graph.poses[left], graph.poses[right])
        mean = graph.links.means[link]
        assert np.hypot(*motion[:2]) == pytest.approx(distance)
        direction = np.arctan2(motion[1], motion[0]) - mean[0]
        turn = motion[2] - mean[0] + mean[1] - np.pi
        np.testing.assert_allclose(wrap_to_pi([direction, turn]), 0.0, atol=1e-9)
        # a small turn of the headings costs what the mixture says; of the distance, little
        step = 1e-4
        covariance = graph.links.mixture(link).covariances()[0]
        for turns in ([step, 0.0], [0.0, step], [step, step]):
            heading = mean[0] + turns[0]
            moved = [distance * np.cos(heading), distance * np.sin(heading)]
            moved.append(motion[2] + turns[0] - turns[1])
            error = relative_pose(motion, np.array(moved))
            expected = turns @ np.linalg.solve(covariance, turns)
            assert error @ information @ error == pytest.approx(expected, rel=2e-3)
        longer = motion * [1.01, 1.01, 1.0]
        error = relative_pose(motion, longer)
        assert error @ information @ error == pytest.approx(1e-4, rel=1e-3)


def test_a_rotation_as_a_plain_edge_leaves_the_position_alone() -> None:
    graph = graph_of_everything()
    links = graph.links
    band = next(
        k
        for k in range(len(links))
        if len(links.mixture(k).rotation_weights)
        and not len(links.mixture(k).weights)
        and links.kind[k] != KINDS.index("none")
    )
    motion, information = as_pose_edge(graph, band)
    assert information[0, 0] < 1e-3 and np.count_nonzero(information) == 3
    assert motion[2] in links.mixture(band).rotation_means
    nothing = links.kind == KINDS.index("none")
    silent = [k for k in range(len(links)) if nothing[k] or not links.mixture(k).num_components]
    assert nothing.any() and all(as_pose_edge(graph, k) is None for k in silent)


@pytest.mark.parametrize(
    "mixture",
    [
        # as sharp along the rotation as can be, and as broad
        mode_of([400.0, 400.0], 400.0),
        mode_of([900.0, 4.0], -60.0),
        mode_of([0.0, 0.0], 0.0),
        mode_of([0.0, 50.0], 0.0),
        VonMisesMixture(
            rotation_weights=np.ones(1),
            rotation_means=np.array([0.4]),
            rotation_concentrations=np.zeros(1),
        ),
    ],
)
def test_the_limits_of_a_mixture_make_an_edge_that_is_read_again(
    tmp_path: Path, mixture: VonMisesMixture
) -> None:
    poses = np.array([[0.0, 0.0, 0.1], [1.0, 0.5, 0.3]])
    graph = PoseGraph.from_odometry(poses, links_of(np.array([[0, 1]]), [mixture]))
    motion, information = as_pose_edge(graph, 0)
    assert np.isfinite(motion).all() and np.isfinite(information).all()
    assert np.linalg.eigvalsh(information)[0] > 0.0
    write_g2o(tmp_path / "map.g2o", graph, edges=np.array([0]))
    assert len(read_g2o(tmp_path / "map.g2o").odometry) == 2


def test_gtsam_reads_the_same(tmp_path: Path) -> None:
    gtsam = pytest.importorskip("gtsam")
    graph = simulated_graph(loop(), np.random.default_rng(2))
    chosen = np.arange(0, len(graph.links), 3)
    moved = graph.with_poses(graph.poses + np.random.default_rng(3).normal(0, 0.003, (24, 3)))
    write_g2o(tmp_path / "odometry.g2o", moved)
    factors, values = gtsam.readG2o(str(tmp_path / "odometry.g2o"), False)
    assert (factors.size(), values.size()) == (23, 24)
    # and means the same by it, to first order: its errors are logarithms of poses
    system = GraphSystem(moved.with_links(moved.links[:0]), "mixture", 0.01, 0.01)
    assert factors.error(values) == pytest.approx(system.shares(moved.poses)[1], rel=1e-2)
    write_g2o(tmp_path / "links.g2o", moved, edges=chosen)
    factors, values = gtsam.readG2o(str(tmp_path / "links.g2o"), False)
    assert (factors.size(), values.size()) == (23 + len(chosen), 24)


HEAD = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\n"
LINK = "EDGE_SE2_HEADINGS 0 1 0.9"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no VERTEX_SE2"),
        ("VERTEX_SE2 0 0 0", ":1: 3 values, expected 4"),
        ("VERTEX_SE2 0 0 0 north", ":1: not all numbers"),
        ("VERTEX_SE2 0 0 0 nan", ":1: a value is not finite"),
        ("VERTEX_SE2 0.5 0 0 0", ":1: not all numbers"),
        (HEAD + "VERTEX_SE2 1 1 0 0", ":3: a second VERTEX_SE2 1"),
        ("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1", ":1: tag 'VERTEX_SE3:QUAT', expected VERTEX_SE2"),
        (HEAD + "EDGE_SE2 0 2 1 0 0 1 0 0 1 0 1", ":3: no VERTEX_SE2 2"),
        (HEAD + "EDGE_SE2 0 1 1 0 0 1 0 0 1 0", ":3: 10 values, expected 11"),
        (HEAD + "EDGE_SE2 0 1 1 0 0 1 0 0 -1 0 1", ":3: the information is not positive definite"),
        (HEAD + "FIX 5", ":3: no VERTEX_SE2 5"),
        (HEAD + "FIX 0\nFIX 1", "2 nodes are fixed, expected one"),
        (HEAD + f"{LINK} 0.1 nonsense 0 0", ":3: expected l r probability uniform kind"),
        (HEAD + f"{LINK}", ":3: expected l r probability uniform kind"),
        (HEAD + f"{LINK} 1.0 none 1 0", ":3: fewer values than"),
        (HEAD + f"{LINK} 1.0 none 0 -1", ":3: fewer values than"),
        (HEAD + f"{LINK} 1.0 none 0 0 7", ":3: more values than"),
        (HEAD + f"{LINK} 0.5 none 0 0", ":3: weights: expected a sum of one"),
        (HEAD + "EDGE_SE2_HEADINGS 1 0 0.9 1 none 0 0", ":3: expected l < r"),
        (HEAD + "EDGE_SE2_HEADINGS 0 1 1.9 1 none 0 0", ":3: expected l < r and a probability"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.g2o"
    path.write_text(text)
    with pytest.raises(ValueError) as refusal:
        read_g2o(path)
    words = str(refusal.value)
    assert words.startswith(str(path)) and message in words and "\n" not in words


def test_comments_and_files_of_others_without_a_fixed_node(tmp_path: Path) -> None:
    path = tmp_path / "other.g2o"
    path.write_text(f"# a comment\n\n{HEAD}EDGE_SE2 0 1 1 0 0 100 0 0 100 0 400\n")
    graph = read_g2o(path)
    assert graph.fixed == 0 and len(graph.links) == 0
    np.testing.assert_array_equal(graph.odometry_information[0], np.diag([100.0, 100.0, 400.0]))
    assert set(KINDS) == {"pose", "headings", "rotation", "none"}
