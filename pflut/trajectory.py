"""Planar trajectories, and the text formats of TUM and KITTI.

A TUM file holds one pose a line, ``timestamp tx ty tz qx qy qz qw`` in seconds and metres; a KITTI
file holds the upper 3 x 4 of a pose matrix a line, without stamps. Both are read with their planar
part: x, y and the heading of the body's x axis. Lines that start with ``#`` are comments.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut._files import read_table, refuse_rows, write_text
from pflut.geometry import FloatArray, as_poses, wrap_to_pi

# Decimals cut off by other programs are forgiven, a matrix or quaternion that is none is not.
_UNIT_TOLERANCE = 1e-2
_TUM_COLUMNS = "timestamp tx ty tz qx qy qz qw"
# robot axes (x forward, y left, z up) from optical axes (x right, y down, z forward)
_ROBOT_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses on the plane with their times.

    Parameters
    ----------
    stamps : array_like of shape (n,)
        Seconds, strictly increasing.
    poses : array_like of shape (n, 3)
        ``[x, y, heading]`` in metres and radians; headings are wrapped to (-pi, pi].

    Raises
    ------
    ValueError
        If the shapes do not fit, a value is not finite, or the stamps do not increase.
    """

    stamps: FloatArray
    poses: FloatArray

    def __post_init__(self) -> None:
        stamps = np.ascontiguousarray(self.stamps, dtype=np.float64)
        empty = np.size(self.poses) == 0
        poses = np.empty((0, 3)) if empty else as_poses(self.poses).copy()
        if stamps.shape != (len(poses),):
            raise ValueError(
                f"stamps: expected shape ({len(poses)},), one for each pose, got {stamps.shape}"
            )
        if not np.isfinite(stamps).all():
            row = int(np.flatnonzero(~np.isfinite(stamps))[0])
            raise ValueError(f"stamps: value {row} is not finite")
        if (np.diff(stamps) <= 0).any():
            row = int(np.flatnonzero(np.diff(stamps) <= 0)[0]) + 1
            raise ValueError(
                f"stamps: value {row} is {stamps[row]}, not after the one before it, "
                f"{stamps[row - 1]}"
            )
        poses[:, 2] = wrap_to_pi(poses[:, 2])
        object.__setattr__(self, "stamps", stamps)
        object.__setattr__(self, "poses", poses)

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.stamps)

    def interpolate(self, stamps: ArrayLike, *, max_gap: float = np.inf) -> FloatArray:
        """Give the poses at other times: linear in position, the short way round in heading.

        Parameters
        ----------
        stamps : array_like of shape (k,)
            Seconds, in any order.
        max_gap : float
            Two neighbouring poses further apart than this, in seconds, are not interpolated.

        Returns
        -------
        ndarray of shape (k, 3)
            NaN rows before the first pose, after the last, and inside a gap. A stamp that the
            trajectory has gets exactly its pose.
        """
        times = np.atleast_1d(np.asarray(stamps, dtype=np.float64))
        out = np.full((len(times), 3), np.nan)
        if not len(self):
            return out
        after = np.searchsorted(self.stamps, times)
        exact = (after < len(self)) & (self.stamps[np.minimum(after, len(self) - 1)] == times)
        out[exact] = self.poses[after[exact]]
        inside = ~exact & (after > 0) & (after < len(self))
        end = after[inside]
        span = self.stamps[end] - self.stamps[end - 1]
        fraction = ((times[inside] - self.stamps[end - 1]) / span)[:, None]
        step = self.poses[end] - self.poses[end - 1]
        step[:, 2] = wrap_to_pi(step[:, 2])
        poses = self.poses[end - 1] + fraction * step
        poses[:, 2] = wrap_to_pi(poses[:, 2])
        poses[span > max_gap] = np.nan
        out[inside] = poses
        return out


def associate(
    stamps_a: ArrayLike, stamps_b: ArrayLike, *, max_difference: float = 0.02
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pair the entries of two series of stamps that are each other's nearest.

    Parameters
    ----------
    stamps_a, stamps_b : array_like of shape (n,), (m,)
        Seconds, increasing.
    max_difference : float
        Pairs further apart than this, in seconds, are left out.

    Returns
    -------
    index_a, index_b : ndarray of shape (k,)
        Increasing; no index occurs twice.
    """
    a = np.asarray(stamps_a, dtype=np.float64)
    b = np.asarray(stamps_b, dtype=np.float64)
    if not len(a) or not len(b):
        return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
    b_of_a, a_of_b = _nearest(a, b), _nearest(b, a)
    index_a = np.arange(len(a), dtype=np.intp)
    keep = (a_of_b[b_of_a] == index_a) & (np.abs(b[b_of_a] - a) <= max_difference)
    return index_a[keep], b_of_a[keep]


def read_tum(path: str | os.PathLike[str]) -> Trajectory:
    """Read a TUM file's planar part.

    Parameters
    ----------
    path : path
        Lines of ``timestamp tx ty tz qx qy qz qw``. The body's axes are taken as x forward,
        y left, z up, and the world's z as up: the heading is the direction of the body's x axis
        on the world's x-y plane.

    Returns
    -------
    Trajectory

    Raises
    ------
    ValueError
        Naming file and line: another number of columns, a value that is no finite number, a
        quaternion that is not of unit length, a stamp not after the one before it, no pose.
    """
    rows, lines = read_table(path, 8, _TUM_COLUMNS)
    norms = np.linalg.norm(rows[:, 4:], axis=1)
    refuse_rows(
        path,
        lines,
        np.abs(norms - 1.0) > _UNIT_TOLERANCE,
        lambda i: f"quaternion of length {norms[i]:.6g}, expected 1",
    )
    late = np.concatenate([[False], np.diff(rows[:, 0]) <= 0])
    refuse_rows(
        path,
        lines,
        late,
        lambda i: f"stamp {rows[i, 0]} is not after the one before it, {rows[i - 1, 0]}",
    )
    x, y, z, w = (rows[:, 4:] / norms[:, None]).T
    heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return Trajectory(rows[:, 0], np.column_stack([rows[:, 1:3], heading]))


def write_tum(path: str | os.PathLike[str], trajectory: Trajectory, *, height: float = 0.0) -> None:
    """Write a TUM file, atomically and with all digits.

    Parameters
    ----------
    path : path
        The file to write; read back, stamps and positions are the same numbers.
    trajectory : Trajectory
        The poses.
    height : float
        Their z, metres.
    """
    half = trajectory.poses[:, 2] / 2.0
    rows = zip(
        trajectory.stamps.tolist(),
        trajectory.poses.tolist(),
        np.sin(half).tolist(),
        np.cos(half).tolist(),
        strict=True,
    )
    lines = [f"# {_TUM_COLUMNS}"]
    lines += [
        f"{t!r} {p[0]!r} {p[1]!r} {float(height)!r} 0 0 {qz!r} {qw!r}" for t, p, qz, qw in rows
    ]
    write_text(path, "\n".join(lines) + "\n")


def read_kitti_poses(
    path: str | os.PathLike[str], *, axes: Literal["optical", "robot"] = "optical"
) -> FloatArray:
    """Read a KITTI pose file as matrices, with all six degrees of freedom.

    Parameters
    ----------
    path : path
        Twelve numbers a line, the upper 3 x 4 of the matrix that takes body to world.
    axes : {"optical", "robot"}
        The axes in the file, of body and world alike: KITTI's own, x right, y down, z forward;
        or x forward, y left, z up. The result is in robot axes either way.

    Returns
    -------
    ndarray of shape (n, 3, 4)
        Body to world, x forward, y left, z up.

    Raises
    ------
    ValueError
        Naming file and line: another number of columns, a value that is no finite number, a
        matrix that is no rotation, no pose.
    """
    _check_axes(axes)
    rows, lines = read_table(path, 12, "the 12 numbers of a 3 x 4 matrix")
    matrices = rows.reshape(-1, 3, 4)
    rotation = matrices[:, :, :3]
    error = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    mirrored = np.linalg.det(rotation) < 0
    refuse_rows(
        path,
        lines,
        (error > _UNIT_TOLERANCE) | mirrored,
        lambda i: "the left 3 x 3 of the matrix is no rotation",
    )
    return _change_axes(matrices, _ROBOT_FROM_OPTICAL) if axes == "optical" else matrices


def read_kitti(
    path: str | os.PathLike[str],
    *,
    stamps: ArrayLike | None = None,
    axes: Literal["optical", "robot"] = "optical",
) -> Trajectory:
    """Read a KITTI pose file's planar part.

    Parameters
    ----------
    path : path
        As `read_kitti_poses`.
    stamps : array_like of shape (n,), optional
        Seconds; the row's number, counted from 0, if not given.
    axes : {"optical", "robot"}
        As `read_kitti_poses`.

    Returns
    -------
    Trajectory

    Raises
    ------
    ValueError
        As `read_kitti_poses`; or if the number of stamps is another than that of poses.
    """
    matrices = read_kitti_poses(path, axes=axes)
    times = np.asarray(np.arange(len(matrices)) if stamps is None else stamps, dtype=np.float64)
    if times.shape != (len(matrices),):
        raise ValueError(f"{path}: {len(matrices)} poses, but stamps of shape {times.shape}")
    heading = np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0])
    return Trajectory(times, np.column_stack([matrices[:, :2, 3], heading]))


def write_kitti(
    path: str | os.PathLike[str],
    trajectory: Trajectory,
    *,
    height: float = 0.0,
    axes: Literal["optical", "robot"] = "optical",
) -> None:
    """Write a KITTI pose file, atomically and with all digits. It has no stamps.

    Parameters
    ----------
    path : path
        The file to write.
    trajectory : Trajectory
        The poses.
    height : float
        How far up they are, metres.
    axes : {"optical", "robot"}
        The axes written, of body and world alike; see `read_kitti`.
    """
    _check_axes(axes)
    matrices = np.zeros((len(trajectory), 3, 4))
    cos, sin = np.cos(trajectory.poses[:, 2]), np.sin(trajectory.poses[:, 2])
    matrices[:, 0, 0] = matrices[:, 1, 1] = cos
    matrices[:, 1, 0], matrices[:, 0, 1] = sin, -sin
    matrices[:, 2, 2] = 1.0
    matrices[:, :2, 3] = trajectory.poses[:, :2]
    matrices[:, 2, 3] = height
    if axes == "optical":
        matrices = _change_axes(matrices, _ROBOT_FROM_OPTICAL.T)
    # adding 0.0 turns the exchange of axes' -0.0 into 0.0
    rows = (matrices.reshape(-1, 12) + 0.0).tolist()
    write_text(path, "".join(" ".join(map(repr, row)) + "\n" for row in rows))


def _nearest(of: FloatArray, among: FloatArray) -> NDArray[np.intp]:
    """Give, for each stamp, the index of the nearest among others, all increasing."""
    after = np.clip(np.searchsorted(among, of), 1, max(len(among) - 1, 1))
    after = np.minimum(after, len(among) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(of - among[before] <= among[after] - of, before, after)


def _check_axes(axes: str) -> None:
    if axes not in ("optical", "robot"):
        raise ValueError(f"axes: expected 'optical' or 'robot', got {axes!r}")


def _change_axes(matrices: FloatArray, change: FloatArray) -> FloatArray:
    """Express (n, 3, 4) poses in other axes, of body and world alike."""
    return np.concatenate(
        [change @ matrices[:, :, :3] @ change.T, change @ matrices[:, :, 3:]], axis=2
    )
