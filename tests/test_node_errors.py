"""Localization in a topological map, judged by true poses, and its figure."""

from __future__ import annotations

import numpy as np
import pytest

from pflut.mapping.node_errors import NodeErrors
from pflut.mapping.node_localizer import NodeEstimate
from pflut.mapping.topological_map import TopologicalMap
from pflut.plot import plot_node_probabilities

MADE = TopologicalMap(
    places=np.array([0, 0, 1, 1]),
    edges=np.array([[0, 1], [1, 2], [2, 3]]),
    probability=np.full(3, 0.9),
    headings=np.full((3, 2), np.nan),
    rotation=np.full(3, np.nan),
)
NODES = np.column_stack([[0.0, 2.0, 4.0, 6.0], np.zeros(4), [0.0, 1.0, 2.0, 3.0]])


def estimate(node: int, probability: float, place: int, place_probability: float) -> NodeEstimate:
    return NodeEstimate(node, probability, place, place_probability, 1.0)


def test_nodes_and_places_beside_the_truth() -> None:
    truth = np.array([[0.3, 0.4, 9.0], [2.9, 0.0, 9.0], [2.9, 0.0, 9.0], [np.nan, 0.0, 0.0]])
    estimates = [
        estimate(0, 0.95, 0, 0.99),
        estimate(1, 0.6, 1, 0.95),  # the nearest, but the other place
        estimate(2, 0.99, 1, 0.99),  # farther than a metre
        estimate(3, 1.0, 1, 1.0),  # nobody knows
    ]
    errors = NodeErrors.of(MADE, estimates, NODES, truth)
    assert errors.nearest.tolist() == [0, 1, 1, -1]
    np.testing.assert_allclose(errors.nearest_distance, [0.5, 0.9, 0.9, np.nan])
    np.testing.assert_allclose(errors.distance, [0.5, 0.9, 1.1, np.nan])
    assert errors.near.tolist() == [True, True, False, False]
    assert errors.place_right.tolist() == [True, False, False, False]
    known = errors.as_dict()
    assert known["judged"] == 3 and known["sure"] == 2 and known["sure_and_wrong"] == 1
    assert known["place_sure"] == 3 and known["place_sure_and_wrong"] == 2
    for name, expected in (
        ("nearest_node", 2 / 3),
        ("near_node", 2 / 3),
        ("place", 1 / 3),
        ("distance_median_m", 0.9),
        ("distance_90_m", 1.06),
        ("nearest_distance_median_m", 0.9),
    ):
        assert known[name] == pytest.approx(expected)


def test_nodes_whose_poses_are_not_known() -> None:
    nodes = np.where(np.arange(4)[:, None] == 1, np.nan, NODES)
    estimates = [estimate(1, 0.9, 0, 0.9), estimate(0, 0.9, 0, 0.9)]
    errors = NodeErrors.of(MADE, estimates, nodes, np.array([[1.8, 0.0, 0.0]] * 2))
    assert errors.nearest.tolist() == [0, 0] and errors.place_right.all()
    np.testing.assert_allclose(errors.distance, [np.nan, 1.8])
    assert errors.as_dict()["judged"] == 1
    nowhere = NodeErrors.of(MADE, estimates, NODES, np.full((2, 3), np.nan))
    assert nowhere.nearest.tolist() == [-1, -1] and not nowhere.place_right.any()
    assert set(nowhere.as_dict().values()) == {0}


def test_the_figure() -> None:
    # places that are not in the order of nodes, one of them too small for a name
    places = np.array([1, 0, *range(2, 14), 0])
    probabilities = np.zeros((3, len(places)))
    probabilities[0, 0] = probabilities[2, 13] = 1.0
    probabilities[1, [1, 0]] = 0.75, 0.25
    figure = plot_node_probabilities(
        probabilities, places, nearest=[0, 0, -1], right=[True, False, False], title="drive"
    )
    upper, lower = figure.axes[:2]
    cells = upper.collections[0].get_array()
    # rows are nodes, those of place 0 first
    assert cells.shape == (15, 3)
    assert cells[:, 1].tolist() == [0.75, 0.0, 0.25, *[0.0] * 12]
    rings = [c.get_offsets().tolist() for c in upper.collections[1:]]
    assert rings == [[[0.0, 2.0]], [[1.0, 2.0]]]
    bars = [[bar.get_height() for bar in those] for those in lower.containers]
    assert len(bars) == 13
    assert bars[0] == [0.0, 0.75, 0.0] and bars[1] == [1.0, 0.25, 0.0]
    assert bars[-1] == [0.0, 0.0, 1.0]
    (wrong,) = lower.collections
    assert wrong.get_offsets()[:, 0].tolist() == [1.0]
    # images are counted, however few they are
    assert all(tick == round(tick) for tick in lower.get_xticks())
    # without truth nothing is judged
    plain = plot_node_probabilities(probabilities, places)
    assert len(plain.axes[0].collections) == 1 and not plain.axes[1].collections
    for wrong_input, name in (
        ({"probabilities": probabilities[:, :4], "places": places}, "probabilities"),
        ({"probabilities": probabilities, "places": places, "nearest": [0]}, "nearest"),
    ):
        with pytest.raises(ValueError, match=name):
            plot_node_probabilities(**wrong_input)
