"""Topological maps: places of small graphs, directions, ways, the file, and the figure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import networkx
import numpy as np
import pytest

from pflut.geometry import relative_headings, wrap_to_pi
from pflut.mapping.constraint import PoseConstraint
from pflut.mapping.links import Links
from pflut.mapping.topological_map import TopologicalMap
from pflut.plot import plot_places
from pflut.simulation.home import Home, rooms_at
from pflut.von_mises.mixture import VonMisesMixture

NOTHING = PoseConstraint("none", VonMisesMixture(uniform_weight=1.0), 3.68, 0.0)
# two triangles with a bridge, and an image without a link
EDGES = [[0, 1], [0, 2], [1, 2], [2, 3], [3, 4], [3, 5], [4, 5]]


def known(*means: tuple[float, float], kind: str = "pose") -> PoseConstraint:
    """A constraint of modes at these headings, the first one the heaviest."""
    weights = np.linspace(2.0, 1.0, len(means))
    mixture = VonMisesMixture(
        weights=weights / weights.sum(),
        means=np.array(means),
        concentrations=np.full((len(means), 2), 50.0),
        couplings=np.zeros(len(means)),
    )
    return PoseConstraint(kind, mixture, 0.0, 0.0)


def links_of(
    indices: list[list[int]],
    probability: list[float] | None = None,
    constraints: list[PoseConstraint] | None = None,
) -> Links:
    count = len(indices)
    return Links.of(
        np.array(indices, np.int64).reshape(-1, 2),
        np.full(count, 9),
        np.zeros(count),
        np.full(count, 0.9) if probability is None else np.array(probability),
        constraints or [NOTHING] * count,
    )


def same(a: TopologicalMap, b: TopologicalMap) -> bool:
    arrays = ("places", "edges", "probability", "headings", "rotation")
    return a.names == b.names and all(
        np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True) for name in arrays
    )


def test_places_of_two_triangles_and_a_lonely_image() -> None:
    made = TopologicalMap.from_links(links_of(EDGES), 7)
    assert made.places.tolist() == [0, 0, 0, 1, 1, 1, 2]
    assert (len(made), made.num_places) == (7, 3)
    assert made.members(1).tolist() == [3, 4, 5]
    assert made.neighbours(6).tolist() == [] and set(made.neighbours(2).tolist()) == {0, 1, 3}


def test_places_do_not_depend_on_the_order_of_links() -> None:
    links = links_of(EDGES, np.linspace(0.6, 0.99, len(EDGES)).tolist())
    shuffled = links[np.random.default_rng(1).permutation(len(EDGES))]
    assert same(TopologicalMap.from_links(shuffled, 7), TopologicalMap.from_links(links, 7))


def test_improbable_links_are_left_out() -> None:
    # without the links of the bridge's end there are three pieces
    links = links_of(EDGES, [0.9, 0.9, 0.9, 0.4, 0.9, 0.49, 0.2])
    made = TopologicalMap.from_links(links, 6)
    assert made.edges.tolist() == [[0, 1], [0, 2], [1, 2], [3, 4]]
    assert made.places.tolist() == [0, 0, 0, 1, 1, 2]
    assert len(TopologicalMap.from_links(links, 6, min_probability=0.1).edges) == 7


def test_resolution_makes_places_smaller() -> None:
    links = links_of(EDGES)
    coarse = TopologicalMap.from_links(links, 6, resolution=0.05)
    fine = TopologicalMap.from_links(links, 6, resolution=20.0)
    assert (coarse.num_places, fine.num_places) == (1, 6)
    assert same(coarse.with_places(resolution=20.0), fine)


def test_headings_lead_from_one_image_to_the_next() -> None:
    poses = np.array([[0.0, 0.0, 0.3], [1.0, 2.0, -2.0]])
    heading_l, heading_r, _ = (float(v[0]) for v in relative_headings(poses[:1], poses[1:]))
    constraint = known((heading_l, heading_r), (0.0, 0.0))
    made = TopologicalMap.from_links(links_of([[0, 1]], constraints=[constraint]), 2)
    toward = poses[0, 2] + made.heading(0, 1)
    assert wrap_to_pi(toward - np.arctan2(2.0, 1.0)) == pytest.approx(0.0, abs=1e-9)
    back = poses[1, 2] + made.heading(1, 0)
    assert wrap_to_pi(back - np.arctan2(-2.0, -1.0)) == pytest.approx(0.0, abs=1e-9)


def test_only_what_a_constraint_knows_is_told() -> None:
    turned = VonMisesMixture(
        rotation_weights=np.array([1.0]),
        rotation_means=np.array([0.7]),
        rotation_concentrations=np.array([90.0]),
    )
    two = known((0.5, 0.5 + np.pi), (0.5 + np.pi, 0.5), kind="headings")
    constraints = [known((1.0, 2.0)), two, PoseConstraint("rotation", turned, 1.0, 0.0), NOTHING]
    made = TopologicalMap.from_links(
        links_of([[0, 1], [0, 2], [0, 3], [0, 4]], constraints=constraints), 5
    )
    assert np.isfinite(made.headings).all(axis=1).tolist() == [True, False, False, False]
    assert np.isfinite(made.rotation).tolist() == [True, True, True, False]
    assert made.rotation[0] == pytest.approx(1.0 - 2.0 + np.pi)
    assert made.rotation[2] == pytest.approx(0.7)
    assert np.isnan(made.heading(0, 2))
    with pytest.raises(ValueError, match="1 and 2 are not linked"):
        made.heading(1, 2)


def test_headings_and_rotation_are_of_one_mode() -> None:
    # the heaviest component stands alone, two beside each other are heavier, a band is between
    mixture = VonMisesMixture(
        weights=np.array([0.36, 0.24, 0.2]),
        means=np.array([[2.0, 0.0], [1.0, -2.0], [1.1, -2.02]]),
        concentrations=np.full((3, 2), 900.0),
        couplings=np.zeros(3),
        rotation_weights=np.array([0.2]),
        rotation_means=np.array([-0.7]),
        rotation_concentrations=np.array([90.0]),
    )
    constraint = PoseConstraint("pose", mixture, 1.0, 0.0)
    made = TopologicalMap.from_links(links_of([[0, 1]], constraints=[constraint]), 2)
    shares = np.array([0.24, 0.2]) / 0.44
    np.testing.assert_allclose(made.headings[0], shares @ mixture.means[1:])
    turn = made.headings[0, 0] - made.headings[0, 1] + np.pi
    assert wrap_to_pi(made.rotation[0] - turn) == pytest.approx(0.0, abs=1e-12)


def test_the_most_probable_way() -> None:
    indices = [[0, 1], [0, 2], [1, 2], [3, 4]]
    made = TopologicalMap.from_links(links_of(indices, [0.95, 0.6, 0.9, 0.9]), 5)
    assert made.shortest_path(2, 0) == [2, 1, 0]  # 0.855 beats 0.6
    assert made.shortest_path(1, 1) == [1]
    assert made.shortest_path(0, 3) == []
    # of ways that are sure the shorter
    sure = TopologicalMap.from_links(links_of(indices, [1.0, 1.0, 1.0, 1.0]), 5)
    assert sure.shortest_path(0, 2) == [0, 2]
    with pytest.raises(ValueError, match="image: expected 0 to 4, got 5"):
        made.shortest_path(0, 5)


def test_neighbours_come_the_most_probable_first() -> None:
    made = TopologicalMap.from_links(links_of([[0, 2], [1, 2], [2, 3]], [0.6, 0.8, 0.7]), 4)
    assert made.neighbours(2).tolist() == [1, 3, 0]


def test_the_file(tmp_path: Path) -> None:
    constraints = [known((0.1, 1 / 3)), NOTHING, NOTHING, known((-1.0, 2.0)), *[NOTHING] * 3]
    probability = np.linspace(0.5, 1.0, 7).tolist()
    made = TopologicalMap.from_links(
        links_of(EDGES, probability, constraints), 7, names=[f"image {k} & <ü>" for k in range(7)]
    )
    path = tmp_path / "map.graphml"
    made.save(path)
    assert same(TopologicalMap.load(path), made)
    made.save(tmp_path / "again.graphml")
    assert path.read_bytes() == (tmp_path / "again.graphml").read_bytes()
    # any program reads it
    graph = networkx.read_graphml(path)
    assert graph.nodes["3"] == {"name": "image 3 & <ü>", "place": 1}
    assert graph.edges["0", "1"]["heading_l"] == made.headings[0, 0]
    assert "rotation" not in graph.edges["0", "2"]
    alone = TopologicalMap.from_links(links_of([]), 1)
    alone.save(path)
    assert same(TopologicalMap.load(path), alone)


def test_files_that_are_none(tmp_path: Path) -> None:
    path = tmp_path / "map.graphml"
    with pytest.raises(FileNotFoundError):
        TopologicalMap.load(path)
    TopologicalMap.from_links(links_of(EDGES), 7).save(path)
    text = path.read_text()
    for change, words in (
        (text[: len(text) // 2], "no GraphML, or damaged"),
        ("", "no GraphML, or damaged"),
        (text.replace("pflut topological map", "another"), "not a pflut topological map"),
        (text.replace('"d1">1<', '"d1">2<'), "version 2, expected 1"),
        (text.replace('<node id="6">', '<node id="7">'), "expected nodes 0 to 6"),
        (text.replace(">0.9<", ">1.9<", 1), "probability: expected numbers in"),
        (text.replace('"d3">2<', '"d3">9<', 1), "places: expected all numbers"),
    ):
        assert change != text, words
        path.write_text(change)
        with pytest.raises(ValueError, match=words):
            TopologicalMap.load(path)


def test_wrong_values() -> None:
    links = links_of(EDGES)
    for options, words in (
        ({"min_probability": 0.0}, "min_probability"),
        ({"resolution": 0.0}, "resolution"),
        ({"names": ["one"]}, "names: expected 7, one an image, got 1"),
    ):
        with pytest.raises(ValueError, match=words):
            TopologicalMap.from_links(links, 7, **options)
    with pytest.raises(ValueError, match="num_images: 5, but image 5 is linked"):
        TopologicalMap.from_links(links, 5)
    made = TopologicalMap.from_links(links, 7)
    for changes, words in (
        ({"edges": made.edges[:, ::-1]}, "edges: expected two of 7 images"),
        ({"edges": made.edges[[0, 0, 1, 2, 3, 4, 5]]}, "edges: expected each link once"),
        ({"headings": made.rotation}, "headings: expected shape"),
        ({"rotation": np.full(7, np.inf)}, "radians, or NaN"),
        ({"places": np.arange(7) + 1}, "places: expected all numbers"),
        ({"places": np.empty(0)}, "places: expected those of at least one image"),
    ):
        with pytest.raises(ValueError, match=words):
            replace(made, **changes)


def test_without_networkx(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "networkx", None)
    with pytest.raises(ImportError, match=r"pip install 'pflut\[mapping\]'"):
        TopologicalMap.from_links(links_of(EDGES), 7)


def test_the_figure() -> None:
    made = TopologicalMap.from_links(links_of(EDGES, np.linspace(0.5, 1.0, 7).tolist()), 7)
    positions = made.layout()
    assert positions.shape == (7, 2) and np.array_equal(positions, made.layout())
    # linked images are nearer to each other than others
    distance = np.hypot(*(positions[:, None] - positions).transpose(2, 0, 1))
    linked = np.zeros((7, 7), np.bool_)
    linked[tuple(made.edges.T)] = True
    assert distance[linked].mean() < distance[~(linked | linked.T | np.eye(7, dtype=bool))].mean()
    positions[6] = np.nan
    figure = plot_places(positions, made.places, made.edges, made.probability, title="box")
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "links: the more probable, the darker",
        "place 0: 3 images",
        "place 1: 3 images",
        "images of 1 smaller places",
    ]
    lines = figure.axes[0].collections[0]
    assert len(lines.get_segments()) == 7 and (np.diff(lines.get_colors()[:, 3]) > 0).all()
    with pytest.raises(ValueError, match="positions: expected 7, one an image, got 6"):
        plot_places(positions[:6], made.places, made.edges, made.probability)


def test_rooms_of_points() -> None:
    home = Home.generate(0)
    centers = np.array([[0.5 * (r.x0 + r.x1), 0.5 * (r.y0 + r.y1)] for r in home.rooms])
    assert rooms_at(home, centers).tolist() == list(range(len(home.rooms)))
    first = home.rooms[0]
    beside = [[0.5 * (first.x0 + first.x1), first.y0 - 0.02, 0.0]]
    assert rooms_at(home, beside).tolist() == [0]
