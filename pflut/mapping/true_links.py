"""Which images are truly linked: they show one scene, from places near each other.

Two views are *linked* if they stand no farther apart than a distance, and if of all the floor that
either of them sees both see a share. What a view sees is the floor within a view distance, within
its camera's field of view, that no wall of the floor plan hides; doors are gaps in walls. So most
panoramas of one room are linked, one in each of two rooms only near the door between them, and two
views along a road are while they look the same way. Furniture hides nothing here, and what looks
the same in another place is no link: this is about places, not about looks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.camera.base import Camera
from pflut.datasets.base import Dataset
from pflut.geometry import TWO_PI, FloatArray, as_poses, wrap_to_pi

CELLS = 80
"""Cells of the floor along the view distance."""


@dataclass(frozen=True, kw_only=True)
class LinkRule:
    """When two images count as linked.

    Parameters
    ----------
    max_distance : float
        Between the cameras, metres.
    view_distance : float
        As far as a view is looked at, metres.
    min_overlap : float
        The floor that both see over the floor that either sees, in [0, 1].

    Raises
    ------
    ValueError
        If a number is out of its range.
    """

    max_distance: float = 3.0
    view_distance: float = 10.0
    min_overlap: float = 0.5

    def __post_init__(self) -> None:
        for name in ("max_distance", "view_distance"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name}: expected positive metres, got {getattr(self, name)}")
        if not 0.0 <= self.min_overlap <= 1.0:
            raise ValueError(f"min_overlap: expected 0 to 1, got {self.min_overlap}")


INDOORS = LinkRule()
"""Of cameras in rooms: within 3 m, the half of the view in common."""
ON_ROADS = LinkRule(max_distance=15.0, view_distance=40.0, min_overlap=0.3)
"""Of cameras that look ahead on a road: within 15 m while they look the same way."""


def true_links(
    poses: ArrayLike,
    indices: ArrayLike,
    walls: FloatArray | None = None,
    *,
    rule: LinkRule = INDOORS,
    field_of_view: float = TWO_PI,
) -> NDArray[np.bool_]:
    """Say which pairs of images are linked.

    Parameters
    ----------
    poses : array_like of shape (m, 3)
        Of the images in the world.
    indices : array_like of int, shape (n, 2)
        The images of each pair.
    walls : ndarray of shape (s, 2, 2), optional
        Segments that hide what is behind them, metres; without them nothing is hidden.
    rule : LinkRule
    field_of_view : float
        Of the camera, radians, centred on the heading.

    Returns
    -------
    ndarray of shape (n,), bool

    Raises
    ------
    ValueError
        If a pose is not known, or a number is out of its range.
    """
    views = as_poses(poses)
    left, right = np.asarray(indices, dtype=np.intp).reshape(-1, 2).T
    overlap = view_overlap(
        views, walls, view_distance=rule.view_distance, field_of_view=field_of_view
    )
    dx, dy = (views[left] - views[right])[:, :2].T
    near = np.hypot(dx, dy) <= rule.max_distance
    return np.asarray(near & (overlap[left, right] >= rule.min_overlap))


def dataset_links(
    dataset: Dataset, indices: ArrayLike, rule: LinkRule | None = None
) -> NDArray[np.bool_]:
    """Say which pairs of a dataset's images are linked, by its true poses and its floor plan.

    Parameters
    ----------
    dataset : Dataset
        With ground truth.
    indices : array_like of int, shape (n, 2)
        The images of each pair.
    rule : LinkRule, optional
        Default: `INDOORS` for a camera that looks all around, else `ON_ROADS`.

    Returns
    -------
    ndarray of shape (n,), bool

    Raises
    ------
    ValueError
        If one of the images has no true pose.
    """
    if dataset.ground_truth is None:
        raise ValueError(f"{dataset.name}: expected ground truth, to know what is linked")
    if rule is None:
        rule = INDOORS if dataset.camera.horizontally_periodic else ON_ROADS
    images, place = np.unique(np.asarray(indices), return_inverse=True)
    return true_links(
        dataset.ground_truth[images],
        place.reshape(-1, 2),
        dataset.floor_plan,
        rule=rule,
        field_of_view=field_of_view(dataset.camera),
    )


def view_overlap(
    poses: ArrayLike,
    walls: FloatArray | None = None,
    *,
    view_distance: float,
    field_of_view: float = TWO_PI,
) -> FloatArray:
    """Compute how much of the floor that two views see both of them see.

    Parameters
    ----------
    poses : array_like of shape (n, 3)
    walls : ndarray of shape (s, 2, 2), optional
        Segments that hide what is behind them, metres.
    view_distance : float
        Metres.
    field_of_view : float
        Radians, centred on the heading.

    Returns
    -------
    ndarray of shape (n, n)
        The area that both see over the area that either sees, in [0, 1]; symmetric, one on the
        diagonal. Areas are counted in cells of 1/80 of the view distance.

    Raises
    ------
    ValueError
        If a pose is not known, or a number is out of its range.
    """
    views = as_poses(poses)
    if not 0.0 < view_distance < np.inf:
        raise ValueError(f"view_distance: expected positive metres, got {view_distance}")
    if not 0.0 < field_of_view <= TWO_PI:
        raise ValueError(f"field_of_view: expected radians in (0, 2 pi], got {field_of_view}")
    cell = view_distance / CELLS
    low = np.floor((views[:, :2].min(axis=0) - view_distance) / cell)
    high = np.ceil((views[:, :2].max(axis=0) + view_distance) / cell)
    x, y = (cell * (np.arange(a, b) + 0.5) for a, b in zip(low, high, strict=True))
    floor = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    seen = np.zeros((len(views), len(floor)), np.float32)
    for row, (px, py, heading) in zip(seen, views, strict=True):
        offset = floor - (px, py)
        off_axis = np.abs(wrap_to_pi(np.arctan2(offset[:, 1], offset[:, 0]) - heading))
        near = np.hypot(offset[:, 0], offset[:, 1]) <= view_distance
        chosen = np.flatnonzero(near & (off_axis <= 0.5 * field_of_view))
        if walls is not None:
            chosen = chosen[~_hidden(np.array([px, py]), offset[chosen], walls)]
        row[chosen] = 1.0
    both = (seen @ seen.T).astype(np.float64)
    area = np.diag(both)
    either = area[:, None] + area[None, :] - both
    return np.divide(both, either, out=np.eye(len(both)), where=either > 0.0)


def field_of_view(camera: Camera) -> float:
    """Return the angle between the bearings of a camera's left and right border, radians."""
    if camera.horizontally_periodic:
        return TWO_PI
    middle = 0.5 * (camera.height - 1)
    azimuth, _ = camera.bearings(np.array([[0.0, middle], [camera.width - 1.0, middle]]))
    return float((azimuth[0] - azimuth[1]) % TWO_PI)


def _hidden(eye: FloatArray, offsets: FloatArray, walls: FloatArray) -> NDArray[np.bool_]:
    """Say which places, at offsets (m, 2) from the eye, a wall hides."""
    hidden = np.zeros(len(offsets), np.bool_)
    for start, end in walls:
        toward, along = start - eye, end - start
        # where the line of sight meets the wall: eye + t offset = start + s along
        across = offsets[:, 0] * along[1] - offsets[:, 1] * along[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (toward[0] * along[1] - toward[1] * along[0]) / across
            s = (toward[0] * offsets[:, 1] - toward[1] * offsets[:, 0]) / across
        hidden |= (t > 0.0) & (t < 1.0) & (s >= 0.0) & (s <= 1.0)
    return hidden
