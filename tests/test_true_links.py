"""Which images are linked: overlaps that are known exactly, walls, fields of view."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pflut.camera import EquirectangularPanorama, Perspective
from pflut.datasets import Dataset
from pflut.mapping.true_links import (
    INDOORS,
    ON_ROADS,
    LinkRule,
    dataset_links,
    field_of_view,
    true_links,
    view_overlap,
)

# two rooms of 4 x 4 m, side by side, with a door of 0.8 m in between
OUTLINE = [[[0, 0], [8, 0]], [[8, 0], [8, 4]], [[8, 4], [0, 4]], [[0, 4], [0, 0]]]
CLOSED = np.array([*OUTLINE, [[4, 0], [4, 4]]], dtype=float)
WITH_DOOR = np.array([*OUTLINE, [[4, 0], [4, 1.6]], [[4, 2.4], [4, 4]]], dtype=float)


def disc_overlap(distance: float, radius: float) -> float:
    half = distance / (2.0 * radius)
    lens = 2.0 * radius**2 * (np.arccos(half) - half * np.sqrt(1.0 - half**2))
    return float(lens / (2.0 * np.pi * radius**2 - lens))


@pytest.mark.parametrize("distance", [0.0, 1.0, 3.0, 5.0, 9.0])
def test_discs_overlap_as_geometry_says(distance: float) -> None:
    overlap = view_overlap([[0, 0, 0], [distance, 0, 2]], view_distance=5.0)
    # the border's cells are 1/80 of the radius
    assert overlap[0, 1] == pytest.approx(disc_overlap(distance, 5.0), abs=0.01)
    assert (overlap == overlap.T).all() and (np.diag(overlap) == 1.0).all()
    assert view_overlap([[0, 0, 0], [10.1, 0, 0]], view_distance=5.0)[0, 1] == 0.0


@pytest.mark.parametrize("turn", [0.0, 0.5, 1.0, 2.0, 3.0])
def test_sectors_overlap_as_geometry_says(turn: float) -> None:
    field = 1.5
    overlap = view_overlap(
        [[1, 2, 0.3], [1, 2, 0.3 + turn]], view_distance=5.0, field_of_view=field
    )
    expected = max(field - turn, 0.0) / (field + min(turn, field))
    assert overlap[0, 1] == pytest.approx(expected, abs=0.01)


def test_walls_hide_and_doors_do_not() -> None:
    here, there, beside = [1, 1, 0], [3, 3, 1], [6, 2, 0]
    overlap = view_overlap([here, there, beside], CLOSED, view_distance=10.0)
    assert overlap[0, 1] == 1.0  # a convex room is seen from everywhere in it
    assert overlap[0, 2] == overlap[1, 2] == 0.0
    opened = view_overlap([here, [2, 2, 0], beside], WITH_DOOR, view_distance=10.0)
    assert 0.0 < opened[0, 2] < opened[1, 2] < 0.5
    # from the middle of a room the door's wedge opens 0.8 m at 2 m to 2.4 m at the far wall: what
    # both see is both wedges
    wedge = 0.5 * (0.8 + 2.4) * 4.0
    assert opened[1, 2] == pytest.approx(2.0 * wedge / 32.0, abs=0.01)


def test_links_are_near_and_see_the_same() -> None:
    poses = [[1, 1, 0], [3, 3, 0], [6, 2, 0]]
    pairs = [(0, 1), (0, 2), (1, 2)]
    assert true_links(poses, pairs, CLOSED).tolist() == [True, False, False]
    assert true_links(poses, pairs, CLOSED, rule=LinkRule(max_distance=2.0)).tolist() == [False] * 3
    assert true_links(poses, pairs, rule=LinkRule(max_distance=9.0)).all()
    assert true_links(poses, np.empty((0, 2), int)).shape == (0,)
    with pytest.raises(ValueError, match="row 1 is not finite"):
        true_links([[0, 0, 0], [np.nan, 0, 0]], [(0, 1)])


def test_a_dataset_brings_its_walls_and_its_camera() -> None:
    paths = tuple(Path(f"{i}.png") for i in range(3))
    poses = np.array([[1, 1, 0], [3, 3, np.pi], [6, 2, 0]], dtype=float)
    panorama = EquirectangularPanorama(360, 180)
    rooms = Dataset("rooms", panorama, np.arange(3.0), paths, poses, floor_plan=CLOSED)
    pairs = [(0, 1), (1, 2)]
    assert dataset_links(rooms, pairs).tolist() == [True, False]
    assert dataset_links(rooms, [(1, 2), (0, 1)]).tolist() == [False, True]
    assert field_of_view(panorama) == pytest.approx(2 * np.pi)
    camera = Perspective(200, 100, fx=100.0, fy=100.0, cx=99.5, cy=49.5)
    # from the centre of the first column to that of the last
    assert field_of_view(camera) == pytest.approx(2 * np.arctan(0.995))
    road = Dataset("road", camera, np.arange(3.0), paths, poses * [5, 0, 0])
    assert dataset_links(road, [(0, 1), (0, 2)]).tolist() == [True, False]  # 10 and 25 m
    assert dataset_links(road, [(0, 1)], INDOORS).tolist() == [False]
    assert ON_ROADS.max_distance == 15.0
    unknown = Dataset("unknown", camera, np.arange(3.0), paths)
    with pytest.raises(ValueError, match="unknown: expected ground truth"):
        dataset_links(unknown, [(0, 1)])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"max_distance": 0.0}, "max_distance: expected positive metres"),
        ({"view_distance": np.inf}, "view_distance: expected positive metres"),
        ({"min_overlap": 1.1}, "min_overlap: expected 0 to 1"),
    ],
)
def test_rules_are_checked(options: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        LinkRule(**options)


def test_views_are_checked() -> None:
    with pytest.raises(ValueError, match="view_distance"):
        view_overlap([[0, 0, 0]], view_distance=0.0)
    with pytest.raises(ValueError, match="field_of_view"):
        view_overlap([[0, 0, 0]], view_distance=1.0, field_of_view=7.0)
