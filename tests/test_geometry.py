"""Angles, SE(2), bearings and the two headings: exact answers and identities."""

from __future__ import annotations

import numpy as np
import pytest
from naive import rotation as rotation_matrix

from pflut.geometry import (
    as_poses,
    bearing_angles,
    bearing_vectors,
    circular_mean,
    compose,
    inverse,
    relative_headings,
    relative_pose,
    rotation_from_headings,
    wrap_to_2pi,
    wrap_to_pi,
)


def random_poses(n: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-5, 5, (n, 2)), rng.uniform(-np.pi, np.pi, n)])


def matrices(poses: np.ndarray) -> np.ndarray:
    """Homogeneous matrices of poses, the readable way to compose them."""
    out = []
    for x, y, heading in poses:
        matrix = rotation_matrix("z", heading)
        matrix[:2, 2] = x, y
        out.append(matrix)
    return np.array(out)


def same_pose(a: np.ndarray, b: np.ndarray) -> None:
    assert np.abs(a[..., :2] - b[..., :2]).max() < 1e-12
    assert np.abs(wrap_to_pi(a[..., 2] - b[..., 2])).max() < 1e-12


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(np.pi, np.pi), (-np.pi, np.pi), (3 * np.pi, np.pi), (0.0, 0.0), (-0.5, -0.5), (7.0, 0.7168)],
)
def test_wrap_to_pi_by_hand(angle: float, expected: float) -> None:
    assert wrap_to_pi(angle) == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(("wrap", "low"), [(wrap_to_pi, -np.pi), (wrap_to_2pi, 0.0)])
def test_wrap_stays_in_its_half_open_range(wrap, low: float) -> None:
    """Also a few roundings beside the ends, where the remainder rounds up to a whole turn."""
    rng = np.random.default_rng(0)
    ends = np.pi * rng.integers(-6, 7, 20000)
    angle = np.concatenate([ends + rng.normal(0, 1e-15, 20000), rng.normal(0, 50, 20000)])
    wrapped = wrap(angle)
    if wrap is wrap_to_pi:
        assert (wrapped > low).all()
        assert (wrapped <= np.pi).all()
    else:
        assert (wrapped >= low).all()
        assert (wrapped < 2 * np.pi).all()
    turns = (wrapped - angle) / (2 * np.pi)
    assert np.abs(turns - np.rint(turns)).max() < 1e-12
    assert isinstance(wrap(np.nextafter(np.pi, 4.0)), float)
    assert wrap(np.zeros((2, 0))).shape == (2, 0)


def test_compose_inverse_and_relative_pose_are_matrix_products() -> None:
    a, b = random_poses(300, 1), random_poses(300, 2)
    products = matrices(a) @ matrices(b)
    composed = compose(a, b)
    assert np.abs(matrices(composed) - products).max() < 1e-12
    assert np.abs(matrices(inverse(a)) - np.linalg.inv(matrices(a))).max() < 1e-12
    same_pose(compose(a, relative_pose(a, b)), b)
    assert (np.abs(composed[:, 2]) <= np.pi).all()


def test_compose_broadcasts() -> None:
    a, b = random_poses(1, 3)[0], random_poses(40, 4)
    same_pose(compose(a, b), compose(np.tile(a, (40, 1)), b))
    assert relative_pose(b[:, None], b[None, :]).shape == (40, 40, 3)


def test_relative_headings_point_at_the_other_view() -> None:
    left, right = random_poses(300, 5), random_poses(300, 6)
    heading_l, heading_r, distance = relative_headings(left, right)
    for pose, other, heading in ((left, right, heading_l), (right, left, heading_r)):
        towards = np.column_stack(
            [distance * np.cos(heading), distance * np.sin(heading), np.zeros(300)]
        )
        assert np.abs(compose(pose, towards)[:, :2] - other[:, :2]).max() < 1e-12
        assert (heading >= 0).all()
        assert (heading < 2 * np.pi).all()
    rotation = rotation_from_headings(heading_l, heading_r)
    assert np.abs(wrap_to_pi(rotation - (right[:, 2] - left[:, 2]))).max() < 1e-12


def test_relative_headings_of_one_place_keep_the_rotation() -> None:
    left = random_poses(50, 7)
    right = left.copy()
    right[:, 2] += np.linspace(-3, 3, 50)
    heading_l, heading_r, distance = relative_headings(left, right)
    assert (distance == 0).all()
    rotation = rotation_from_headings(heading_l, heading_r)
    assert np.abs(wrap_to_pi(rotation - np.linspace(-3, 3, 50))).max() < 1e-12


def test_headings_fulfil_the_constraint_of_method() -> None:
    """Equation 4: sin(phi - alpha_r) = -r sin(theta - alpha_l), for a landmark of any height."""
    left, right = random_poses(200, 8), random_poses(200, 9)
    landmark = np.random.default_rng(10).uniform(-5, 5, (200, 3))
    bearings = []
    for pose in (left, right):
        vector = np.column_stack([landmark[:, :2] - pose[:, :2], landmark[:, 2]])
        azimuth, elevation = bearing_angles(vector)
        bearings.append((wrap_to_2pi(azimuth - pose[:, 2]), elevation))
    (azimuth_l, elevation_l), (azimuth_r, elevation_r) = bearings
    theta, phi, _ = relative_headings(left, right)
    r = np.tan(elevation_r) / np.tan(elevation_l)
    near = np.abs(r) < 100
    error = np.sin(phi - azimuth_r) + r * np.sin(theta - azimuth_l)
    assert near.sum() > 150
    assert np.abs(error[near]).max() < 1e-9


def test_bearings_by_hand() -> None:
    """x forward, y left, z up; counter-clockwise azimuths."""
    vectors = [[2, 0, 0], [0, 3, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 5], [0, 0, -1], [1, 0, 1]]
    azimuth, elevation = bearing_angles(vectors)
    assert azimuth == pytest.approx([0, np.pi / 2, np.pi, 1.5 * np.pi, 0, 0, 0])
    assert elevation == pytest.approx([0, 0, 0, 0, np.pi / 2, -np.pi / 2, np.pi / 4])


def test_bearings_and_vectors_are_inverse() -> None:
    rng = np.random.default_rng(11)
    vectors = rng.normal(size=(4, 100, 3))
    unit = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    assert np.abs(bearing_vectors(*bearing_angles(vectors)) - unit).max() < 1e-12


def test_as_poses_takes_one_or_many_and_refuses_the_rest() -> None:
    assert as_poses([1, 2, 3]).shape == (1, 3)
    assert as_poses(np.zeros((0, 3))).shape == (0, 3)
    assert as_poses(np.ones((6, 3))[::2]).flags.c_contiguous
    for wrong in (np.zeros((3, 2)), np.zeros(4), np.zeros((1, 2, 3)), [], 1.0):
        with pytest.raises(ValueError, match="start: expected shape"):
            as_poses(wrong, "start")
    with pytest.raises(ValueError, match="poses: row 1 is not finite"):
        as_poses([[0, 0, 0], [0, np.nan, 0], [np.inf, 0, 0]])
    with pytest.raises(ValueError, match="poses: row 0 is not finite"):
        as_poses([[np.inf, -np.inf, 0]])
    # a sum that overflows is none of them
    assert as_poses(np.full((3, 3), 1e308)).shape == (3, 3)


def test_circular_mean_wraps_and_weighs() -> None:
    assert circular_mean([np.pi - 0.1, -np.pi + 0.3]) == pytest.approx(-np.pi + 0.1)
    assert circular_mean([0.0, np.pi / 2], [3.0, 0.0]) == pytest.approx(0.0)
    assert circular_mean([0.0, np.pi / 2], [2.0, 2.0]) == pytest.approx(np.pi / 4)
