"""Trajectories: interpolation, association, and the TUM and KITTI files, good and bad."""

from __future__ import annotations

import numpy as np
import pytest

from pflut.geometry import wrap_to_pi
from pflut.trajectory import (
    Trajectory,
    associate,
    read_kitti,
    read_kitti_poses,
    read_tum,
    write_kitti,
    write_tum,
)


def random_trajectory(n=50, seed=0):
    rng = np.random.default_rng(seed)
    stamps = 1.7e9 + np.cumsum(rng.uniform(0.01, 0.2, n))
    return Trajectory(stamps, np.column_stack([rng.normal(0, 30, (n, 2)), rng.uniform(-9, 9, n)]))


def test_trajectory_wraps_headings_and_leaves_the_callers_array_alone():
    poses = np.array([[1.0, 2.0, 4.0]])
    trajectory = Trajectory([0], poses)
    assert trajectory.poses[0, 2] == pytest.approx(4.0 - 2 * np.pi)
    assert poses[0, 2] == 4.0
    assert len(Trajectory([], np.empty((0, 3)))) == 0


@pytest.mark.parametrize(
    ("stamps", "poses", "message"),
    [
        ([0, 1], [[0, 0, 0]], "one for each pose"),
        ([0, np.nan], np.zeros((2, 3)), "value 1 is not finite"),
        ([0, 1], [[0, 0, 0], [0, np.inf, 0]], "row 1 is not finite"),
        ([1, 0], np.zeros((2, 3)), "not after the one before"),
        ([1, 1], np.zeros((2, 3)), "not after the one before"),
    ],
)
def test_trajectory_refuses(stamps, poses, message):
    with pytest.raises(ValueError, match=message):
        Trajectory(stamps, poses)


def test_interpolate_takes_the_short_way_round():
    trajectory = Trajectory([0.0, 2.0], [[0, 0, np.radians(170)], [4, -2, np.radians(-170)]])
    middle = trajectory.interpolate([0.0, 0.5, 1.0, 2.0])
    np.testing.assert_allclose(middle[:, :2], [[0, 0], [1, -0.5], [2, -1], [4, -2]])
    np.testing.assert_allclose(np.degrees(middle[:, 2]), [170, 175, 180, -170])


def test_interpolate_is_nan_outside_and_in_gaps_and_exact_at_stamps():
    trajectory = random_trajectory()
    assert np.array_equal(trajectory.interpolate(trajectory.stamps), trajectory.poses)
    t = trajectory.stamps
    assert np.isnan(trajectory.interpolate([t[0] - 1e-3, t[-1] + 1e-3])).all()
    gap = Trajectory([0, 1, 10, 11], np.zeros((4, 3)))
    known = np.isfinite(gap.interpolate([0.5, 1, 1.5, 9.9, 10, 10.5], max_gap=2)[:, 0])
    assert known.tolist() == [True, True, False, False, True, True]
    assert np.isnan(Trajectory([], []).interpolate([0.0])).all()


def test_associate_is_the_naive_mutual_nearest():
    rng = np.random.default_rng(1)
    a, b = np.sort(rng.uniform(0, 10, 80)), np.sort(rng.uniform(0, 10, 130))
    distance = np.abs(a[:, None] - b)
    naive = [
        (i, j)
        for i in range(len(a))
        for j in range(len(b))
        if distance[i, j] <= 0.05
        and distance[i, j] == distance[i].min()
        and distance[i, j] == distance[:, j].min()
    ]
    i, j = associate(a, b, max_difference=0.05)
    assert list(zip(i.tolist(), j.tolist(), strict=True)) == naive
    assert 20 < len(naive) < 80
    assert len(associate([], b)[0]) == len(associate(a, [])[1]) == 0
    assert associate([1.0], [1.01])[1].tolist() == [0]


def test_tum_round_trip_keeps_every_digit(tmp_path):
    trajectory = random_trajectory()
    write_tum(tmp_path / "a.tum", trajectory, height=0.3)
    back = read_tum(tmp_path / "a.tum")
    assert np.array_equal(back.stamps, trajectory.stamps)
    assert np.array_equal(back.poses[:, :2], trajectory.poses[:, :2])
    assert np.abs(wrap_to_pi(back.poses[:, 2] - trajectory.poses[:, 2])).max() < 1e-15
    assert [p.name for p in tmp_path.iterdir()] == ["a.tum"]


def test_tum_heading_is_the_x_axis_on_the_floor(tmp_path):
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(2)
    rotation = Rotation.from_euler(
        "ZYX", np.column_stack([rng.uniform(-3, 3, 20), rng.normal(0, 0.3, (20, 2))])
    )
    rows = [
        f"{t} 1 2 3 " + " ".join(map(repr, (s * q).tolist()))
        for t, (s, q) in enumerate(zip([1, -1] * 10, rotation.as_quat(), strict=True))
    ]
    path = tmp_path / "a.tum"
    path.write_text("# comment\n\n" + "\n".join(rows) + "\n")
    forward = rotation.apply([1, 0, 0])
    expected = np.arctan2(forward[:, 1], forward[:, 0])
    np.testing.assert_allclose(read_tum(path).poses[:, 2], expected, atol=1e-12)


GOOD = "0 0 0 0 0 0 0 1\n"


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (GOOD + "1 0 nan 0 0 0 0 1\n", 2, "not finite"),
        (GOOD + "1 0 inf 0 0 0 0 1\n", 2, "not finite"),
        ("# c\n" + GOOD + "-1 0 0 0 0 0 0 1\n", 3, "not after the one before it"),
        (GOOD + GOOD, 2, "not after the one before it"),
        ("0 0 0 0 0 0 1\n", 1, r"7 columns \(is the timestamp missing\?\), expected 8"),
        (GOOD + "1 0 0\n", 2, "3 columns, expected 8: timestamp tx ty tz qx qy qz qw"),
        ("0,0,0,0,0,0,0,1\n", 1, "1 columns"),
        (GOOD + "1 0 0 0 0 0 0 one\n", 2, "not all numbers"),
        (GOOD + "1 0 0 0 0 0 0 0\n", 2, "quaternion of length 0"),
        (GOOD + "1 0 0 0 0 0 1 1\n", 2, "quaternion of length 1.414"),
    ],
)
def test_tum_refuses_by_file_and_line(tmp_path, text, line, message):
    path = tmp_path / "bad.tum"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        read_tum(path)
    assert str(error.value).startswith(f"{path}:{line}: ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("content", [b"", b"# nothing\n\n", b"\xff\xfe\x00binary"])
def test_tum_refuses_a_file_without_poses(tmp_path, content):
    path = tmp_path / "bad.tum"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"bad\.tum"):
        read_tum(path)
    with pytest.raises(FileNotFoundError):
        read_tum(tmp_path / "absent.tum")


@pytest.mark.parametrize("axes", ["optical", "robot"])
def test_kitti_round_trip(tmp_path, axes):
    trajectory = random_trajectory()
    write_kitti(tmp_path / "a.txt", trajectory, height=1.5, axes=axes)
    back = read_kitti(tmp_path / "a.txt", stamps=trajectory.stamps, axes=axes)
    assert np.array_equal(back.stamps, trajectory.stamps)
    assert np.array_equal(back.poses[:, :2], trajectory.poses[:, :2])
    assert np.abs(wrap_to_pi(back.poses[:, 2] - trajectory.poses[:, 2])).max() < 1e-15
    assert np.all(read_kitti_poses(tmp_path / "a.txt", axes=axes)[:, 2, 3] == 1.5)
    assert read_kitti(tmp_path / "a.txt", axes=axes).stamps[-1] == len(trajectory) - 1


def test_kitti_optical_axes_by_hand(tmp_path):
    # one metre ahead of the first frame (z), 2 m to the right (x), turned 90 deg to the right
    path = tmp_path / "a.txt"
    path.write_text("0 0 1 2 0 1 0 0 -1 0 0 1\n")
    np.testing.assert_allclose(read_kitti(path).poses, [[1, -2, -np.pi / 2]], atol=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 0 0 0 0 1 0 0 0 0 1\n", "11 columns, expected 12"),
        ("2 0 0 0 0 1 0 0 0 0 1 0\n", "no rotation"),
        ("-1 0 0 0 0 1 0 0 0 0 1 0\n", "no rotation"),
        ("1 0 0 nan 0 1 0 0 0 0 1 0\n", "not finite"),
    ],
)
def test_kitti_refuses(tmp_path, text, message):
    path = tmp_path / "a.txt"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"a\.txt:1: .*{message}"):
        read_kitti(path)
    path.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    with pytest.raises(ValueError, match="stamps of shape"):
        read_kitti(path, stamps=[0, 1])
    with pytest.raises(ValueError, match="axes"):
        read_kitti(path, axes="ros")


def test_a_write_that_fails_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.tum"
    write_tum(path, random_trajectory(3))
    before = path.read_bytes()

    def full_disk(*_args, **_kwargs):
        raise OSError("No space left on device")

    monkeypatch.setattr("pathlib.Path.replace", full_disk)
    with pytest.raises(OSError, match="No space"):
        write_tum(path, random_trajectory(4))
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.tum"]
    monkeypatch.undo()
    with pytest.raises(FileNotFoundError, match="folder does not exist"):
        write_tum(tmp_path / "absent" / "a.tum", random_trajectory(3))
