"""What every dataset is once it is loaded: images with stamps, poses and a camera."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut._files import read_text
from pflut.camera.base import Camera
from pflut.geometry import FloatArray, relative_pose

IndexArray = NDArray[np.intp]
#: ``"every:N"``, ``"all"``, a file of image names, or the indices themselves
References = str | os.PathLike[str] | Sequence[int] | NDArray[np.integer]


def _no_indices() -> IndexArray:
    return np.empty(0, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Dataset:
    """A drive, or a set of images, with what is known about it.

    Parameters
    ----------
    name : str
        For titles and tables.
    camera : Camera
        It took every image.
    stamps : ndarray of shape (n,)
        Seconds, strictly increasing.
    image_paths : tuple of n paths
        Read when asked for.
    ground_truth : ndarray of shape (n, 3), optional
        ``[x, y, heading]`` in the world, metres and radians; NaN rows where unknown.
    odometry : ndarray of shape (n, 3), optional
        Poses in a frame of the odometry's own, drifting; NaN rows where there is none.
    reference_indices, query_indices : ndarray of int
        Which images make the map and which are localized in it. An image may be both (leave one
        out): it must then be kept out of the map that it is compared with.
    floor_plan : ndarray of shape (s, 2, 2), optional
        Wall segments for drawing: segment, end, ``[x, y]`` in metres in the world.
    mask_elevation : (float, float), optional
        The lowest and the highest elevation in radians that show the world and not the robot or
        its tripod.
    mask : ndarray of shape (height, width), optional
        True (or not zero) at the pixels of every image that show the world; kept as bool.

    Raises
    ------
    ValueError
        If the shapes do not fit each other, the stamps do not increase, an index is none, the
        mask leaves nothing, or a reference has no ground truth.
    """

    name: str
    camera: Camera
    stamps: FloatArray
    image_paths: tuple[Path, ...]
    ground_truth: FloatArray | None = None
    odometry: FloatArray | None = None
    reference_indices: IndexArray = field(default_factory=_no_indices)
    query_indices: IndexArray = field(default_factory=_no_indices)
    floor_plan: FloatArray | None = None
    mask_elevation: tuple[float, float] | None = None
    mask: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        n = len(self.image_paths)
        stamps = np.ascontiguousarray(self.stamps, dtype=np.float64)
        if stamps.shape != (n,) or not np.isfinite(stamps).all():
            raise ValueError(f"stamps: expected {n} finite numbers, one an image")
        if (np.diff(stamps) <= 0).any():
            row = int(np.flatnonzero(np.diff(stamps) <= 0)[0]) + 1
            raise ValueError(
                f"stamps: image {self.image_paths[row].name} at {stamps[row]} is not after "
                f"the one before it, at {stamps[row - 1]}"
            )
        object.__setattr__(self, "stamps", stamps)
        for name, shape in (("ground_truth", (n, 3)), ("odometry", (n, 3))):
            self._set_array(name, shape)
        if self.floor_plan is not None:
            self._set_array("floor_plan", (len(self.floor_plan), 2, 2))
        if self.mask is not None:
            size = (self.camera.height, self.camera.width)
            if np.shape(self.mask) != size:
                raise ValueError(f"mask: expected shape {size}, got {np.shape(self.mask)}")
            object.__setattr__(self, "mask", np.asarray(self.mask) != 0)
            if not np.any(self.mask):
                raise ValueError("mask: no pixel to use, expected some that are not zero")
        for name in ("reference_indices", "query_indices"):
            indices = np.ascontiguousarray(getattr(self, name), dtype=np.intp)
            if indices.ndim != 1 or ((indices < 0) | (indices >= n)).any():
                raise ValueError(f"{name}: expected indices of {n} images")
            object.__setattr__(self, name, indices)
        self._check_references()

    def _set_array(self, name: str, shape: tuple[int, ...]) -> None:
        value = getattr(self, name)
        if value is None:
            return
        array = np.ascontiguousarray(value, dtype=np.float64)
        if array.shape != shape:
            raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
        object.__setattr__(self, name, array)

    def _check_references(self) -> None:
        references = self.reference_indices
        if not len(references):
            return
        if self.ground_truth is None:
            raise ValueError(f"{self.name}: references, but no ground truth poses to map them")
        unknown = references[~np.isfinite(self.ground_truth[references]).all(axis=1)]
        if len(unknown):
            path = self.image_paths[unknown[0]]
            raise ValueError(f"{path}: a reference without a ground truth pose at its stamp")

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self.image_paths)

    def image(self, index: int) -> NDArray[np.uint8]:
        """Read an image.

        Parameters
        ----------
        index : int
            Of the image.

        Returns
        -------
        ndarray of shape (height, width), uint8
            Grey.

        Raises
        ------
        ValueError
            Naming the file: it does not decode, or is of another size than the camera's.
        """
        from pflut.features.image import read_image

        image: NDArray[np.uint8] = read_image(self.image_paths[index])
        expected = (self.camera.height, self.camera.width)
        if image.shape != expected:
            raise ValueError(
                f"{self.image_paths[index]}: {image.shape[1]} x {image.shape[0]} pixels, "
                f"expected the camera's {expected[1]} x {expected[0]}"
            )
        return image

    def odometry_between(self, first: int, second: int) -> FloatArray:
        """Give the measured motion from one image to another.

        Parameters
        ----------
        first, second : int
            Indices of images.

        Returns
        -------
        ndarray of shape (3,)
            ``[x, y, heading]`` of the second in the robot's frame at the first.

        Raises
        ------
        ValueError
            If one of the images has no odometry.
        """
        if self.odometry is None:
            raise ValueError(f"{self.name}: the dataset has no odometry")
        poses = self.odometry[[first, second]]
        if not np.isfinite(poses).all():
            row = first if not np.isfinite(poses[0]).all() else second
            raise ValueError(f"{self.image_paths[row]}: no odometry at its stamp")
        return relative_pose(poses[0], poses[1])

    @property
    def leave_one_out(self) -> bool:
        """Whether images are both references and queries."""
        return bool(np.intersect1d(self.reference_indices, self.query_indices).size)

    def with_references(self, references: References) -> Dataset:
        """Return the same dataset with other references.

        Parameters
        ----------
        references : str, path or sequence of int
            ``"every:N"``: every Nth of the images that have a ground truth pose, the others are
            queries. ``"all"``: every image with a pose, and every image is a query (leave one
            out). A path: a file with one image name a line. Integers: the indices. The images
            that are not references are the queries.

        Returns
        -------
        Dataset

        Raises
        ------
        ValueError
            Naming what was not understood, or file and line of an image that is not there.
        """
        chosen = self._choose(references)
        everything = isinstance(references, str) and references == "all"
        queries = np.arange(len(self), dtype=np.intp)
        return replace(
            self,
            reference_indices=chosen,
            query_indices=queries if everything else np.setdiff1d(queries, chosen),
        )

    def select(self, indices: ArrayLike) -> Dataset:
        """Return some of the images by themselves, with what is known of them.

        Parameters
        ----------
        indices : array_like of int
            Of the images, ascending.

        Returns
        -------
        Dataset
            None of its images is a reference, and all are queries.

        Raises
        ------
        ValueError
            If an index is none, or they do not ascend.
        """
        chosen = np.asarray(indices, dtype=np.intp)
        if chosen.ndim != 1 or ((chosen < 0) | (chosen >= len(self))).any():
            raise ValueError(f"indices: expected those of {len(self)} images, got {indices!r}")
        if (np.diff(chosen) <= 0).any():
            raise ValueError(f"indices: expected numbers that ascend, got {indices!r}")
        truth, odometry = self.ground_truth, self.odometry
        return replace(
            self,
            stamps=self.stamps[chosen],
            image_paths=tuple(self.image_paths[index] for index in chosen.tolist()),
            ground_truth=None if truth is None else truth[chosen],
            odometry=None if odometry is None else odometry[chosen],
            reference_indices=_no_indices(),
            query_indices=np.arange(len(chosen), dtype=np.intp),
        )

    def with_odometry(self, odometry: ArrayLike) -> Dataset:
        """Return the same dataset with other odometry, (n, 3)."""
        return replace(self, odometry=np.asarray(odometry, dtype=np.float64))

    def _choose(self, references: References) -> IndexArray:
        if isinstance(references, str | os.PathLike):
            text = os.fspath(references)
            if text == "all" or text.startswith("every:"):
                step = 1 if text == "all" else _step(text)
                return self._posed()[::step]
            return self._read_references(Path(text))
        chosen = np.asarray(references)
        if chosen.ndim != 1 or (chosen.size and not np.issubdtype(chosen.dtype, np.integer)):
            raise ValueError(f"references: expected indices of images, got {references!r}")
        return chosen.astype(np.intp)

    def _posed(self) -> IndexArray:
        if self.ground_truth is None:
            return _no_indices()
        return np.flatnonzero(np.isfinite(self.ground_truth).all(axis=1))

    def _read_references(self, path: Path) -> IndexArray:
        if not path.is_file():
            raise FileNotFoundError(
                f"references: {path} is no file, expected 'every:N', 'all' or a file of image names"
            )
        index_of = {image.name: i for i, image in enumerate(self.image_paths)}
        chosen: list[int] = []
        for number, line in enumerate(read_text(path).splitlines(), start=1):
            name = line.strip()
            if not name or name.startswith("#"):
                continue
            index = index_of.get(Path(name).name)
            if index is None:
                raise ValueError(f"{path}:{number}: no image {name!r} in {self.name}")
            if index in chosen:
                raise ValueError(f"{path}:{number}: {name!r} is listed twice")
            chosen.append(index)
        return np.array(chosen, dtype=np.intp)


def _step(text: str) -> int:
    digits = text.removeprefix("every:")
    if not digits.isdecimal() or int(digits) < 1:
        raise ValueError(f"references: expected 'every:N' with N of at least 1, got {text!r}")
    return int(digits)
