"""KITTI odometry: a car's drive with a forward-looking perspective camera.

A. Geiger, P. Lenz, R. Urtasun, "Are we ready for autonomous driving? The KITTI vision benchmark
suite", CVPR 2012. Two layouts are read: the benchmark's own (``sequences/NN`` with ``image_0``,
``calib.txt``, ``times.txt``, and ``poses/NN.txt`` beside ``sequences``), and a single folder of
``images``, ``calib.txt`` (lines of ``fx``, ``fy``, ``cx``, ``cy``) and ``poses.txt`` (TUM, one
pose an image, x forward, y left, z up).
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from pflut._files import read_table, read_text
from pflut.camera.mount import Mount
from pflut.camera.perspective import Perspective
from pflut.datasets.base import Dataset, References
from pflut.geometry import FloatArray
from pflut.trajectory import Trajectory, read_kitti_poses, read_tum

# The camera above the road, metres.
_CAMERA_HEIGHT = 1.65


def load_kitti_odometry(
    path: str | os.PathLike[str],
    *,
    poses: str | os.PathLike[str] | None = None,
    references: References | None = None,
) -> Dataset:
    """Load a sequence of KITTI odometry: the left grey camera and the planar part of its poses.

    The robot frame is the camera's place with the axes x forward, y left, z up; the plane is the
    one whose normal is the mean up-vector of the sequence. The car's own roll and pitch, about a
    degree, are left out, as everything planar does. There is no odometry.

    Parameters
    ----------
    path : path
        The folder of the sequence.
    poses : path, optional
        The file of poses, in KITTI's format, of a sequence in the benchmark's own layout;
        ``poses/NN.txt`` beside ``sequences`` if not given.
    references : str, path or sequence of int, optional
        See `Dataset.with_references`; ``"every:10"`` if not given.

    Returns
    -------
    Dataset

    Raises
    ------
    FileNotFoundError
        Naming what is missing.
    ValueError
        Naming the file, and the line, of what is wrong in it; or if the numbers of images, poses
        and times differ.
    """
    folder = Path(path)
    if (folder / "image_0").is_dir():
        image_paths = _images(folder / "image_0")
        drive = _benchmark_poses(folder, None if poses is None else Path(poses))
    else:
        image_paths = _images(folder / "images")
        drive = read_tum(folder / "poses.txt" if poses is None else poses)
    if len(drive) != len(image_paths):
        raise ValueError(f"{folder}: {len(image_paths)} images, but {len(drive)} poses")
    fx, fy, cx, cy = _read_calibration(folder / "calib.txt")
    height, width = _size(image_paths[0])
    dataset = Dataset(
        name=f"kitti-{folder.resolve().name}" if folder.name.isdecimal() else folder.resolve().name,
        camera=Perspective(
            width, height, fx=fx, fy=fy, cx=cx, cy=cy, mount=Mount(height=_CAMERA_HEIGHT)
        ),
        stamps=drive.stamps,
        image_paths=image_paths,
        ground_truth=drive.poses,
    )
    return dataset.with_references("every:10" if references is None else references)


def level_poses(matrices: FloatArray) -> FloatArray:
    """Give the planar part of poses, on the plane normal to their mean up-vector.

    Parameters
    ----------
    matrices : ndarray of shape (n, 3, 4)
        Body to world, x forward, y left, z up; the world's axes may be those of any camera.

    Returns
    -------
    ndarray of shape (n, 3)
        ``[x, y, heading]``; the first pose's x axis, on the plane, is the x axis.
    """
    up = matrices[:, :, 2].mean(axis=0)
    up /= np.linalg.norm(up)
    forward = matrices[0, :, 0] - up * (up @ matrices[0, :, 0])
    forward /= np.linalg.norm(forward)
    level = np.stack([forward, np.cross(up, forward), up])
    position = (matrices[:, :, 3] - matrices[0, :, 3]) @ level.T
    axis = matrices[:, :, 0] @ level.T
    return np.column_stack([position[:, :2], np.arctan2(axis[:, 1], axis[:, 0])])


def _benchmark_poses(folder: Path, poses: Path | None) -> Trajectory:
    if poses is None:
        sequence = folder.resolve()
        poses = sequence.parent.parent / "poses" / f"{sequence.name}.txt"
    if not poses.is_file():
        raise FileNotFoundError(f"{poses}: no such file of poses (sequences 11 to 21 have none)")
    times, _ = read_table(folder / "times.txt", 1, "seconds")
    matrices = read_kitti_poses(poses)
    if len(times) != len(matrices):
        raise ValueError(f"{poses}: {len(matrices)} poses, but {len(times)} times")
    return Trajectory(times[:, 0], level_poses(matrices))


def _images(folder: Path) -> tuple[Path, ...]:
    images = tuple(sorted(folder.glob("*.png"))) if folder.is_dir() else ()
    if not images:
        raise FileNotFoundError(f"{folder}: no .png images, expected a sequence of KITTI odometry")
    return images


def _read_calibration(path: Path) -> tuple[float, float, float, float]:
    """Give fx, fy, cx, cy from the benchmark's ``P0:`` line or from lines of their own."""
    values: dict[str, list[float]] = {}
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.replace(":", " ").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            values[words[0]] = [float(word) for word in words[1:]]
        except ValueError:
            raise ValueError(f"{path}:{number}: expected a name and numbers") from None
    if len(values.get("P0", [])) == 12:
        projection = values["P0"]
        return projection[0], projection[5], projection[2], projection[6]
    try:
        fx, fy, cx, cy = (values[name][0] for name in ("fx", "fy", "cx", "cy"))
    except (KeyError, IndexError):
        raise ValueError(
            f"{path}: expected `P0:` and 12 numbers, or lines of fx, fy, cx and cy"
        ) from None
    return fx, fy, cx, cy


def _size(image: Path) -> tuple[int, int]:
    """Give height and width of an image; those of KITTI differ from sequence to sequence."""
    from pflut.features.image import read_image

    height, width = read_image(image).shape
    return int(height), int(width)
