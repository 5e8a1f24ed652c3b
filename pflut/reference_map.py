"""The map: reference images as features with poses, and which of them are worth comparing."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut._files import read_arrays, replacing
from pflut.features import Features
from pflut.geometry import FloatArray, as_poses
from pflut.retrieval import Gallery

if TYPE_CHECKING:
    from pflut.datasets.base import Dataset
    from pflut.features import FeatureCache, FeatureExtractor

FORMAT = "pflut reference map"
VERSION = 1
FEATURE_FIELDS = ("azimuth", "elevation", "descriptors", "pixels", "response")

NO_FEATURES = Features(
    np.empty(0),
    np.empty(0),
    np.empty((0, 1), np.float32),
    np.empty((0, 2), np.float32),
    np.empty(0, np.float32),
)
"""Of an image that nobody looked at."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class ReferenceMap:
    """Reference images taken at known poses.

    Parameters
    ----------
    poses : array_like of shape (m, 3)
        ``[x, y, heading]`` in the map's frame, metres and radians.
    features : sequence of m Features
        Of one kind all of them (the same descriptor).
    names : sequence of m str
        Of the images, for reports.

    Raises
    ------
    ValueError
        If the lengths differ, there is no reference, or the descriptors are of different kinds.
    """

    poses: FloatArray
    features: tuple[Features, ...]
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        poses = as_poses(self.poses, "poses") if np.size(self.poses) else np.empty((0, 3))
        object.__setattr__(self, "poses", poses)
        object.__setattr__(self, "features", tuple(self.features))
        object.__setattr__(self, "names", tuple(str(name) for name in self.names))
        if not len(poses):
            raise ValueError("a reference map needs at least one reference image with a pose")
        if not len(poses) == len(self.features) == len(self.names):
            raise ValueError(
                f"expected as many poses as features and names, got {len(poses)}, "
                f"{len(self.features)} and {len(self.names)}"
            )
        kinds = {(f.descriptors.dtype.str, f.descriptors.shape[1]) for f in self.features}
        if len(kinds) > 1:
            raise ValueError(f"features: descriptors of different kinds: {sorted(kinds)}")

    def __len__(self) -> int:
        """Return the number of references."""
        return len(self.features)

    @classmethod
    def build(
        cls,
        images: Iterable[NDArray[np.uint8]],
        poses: ArrayLike,
        extractor: FeatureExtractor,
        *,
        names: Sequence[str] | None = None,
        cache: FeatureCache | None = None,
        progress: Progress | None = None,
    ) -> ReferenceMap:
        """Build a map from images and their poses.

        Parameters
        ----------
        images : iterable of m images
            uint8, of the extractor's camera; read one at a time.
        poses : array_like of shape (m, 3)
        extractor : FeatureExtractor
        names : sequence of str, optional
            By default the numbers.
        cache : FeatureCache, optional
            Features are looked up there, and kept.
        progress : callable, optional
            Called as ``progress(images_done, images_total)``.

        Returns
        -------
        ReferenceMap
        """
        checked = as_poses(poses, "poses")
        features = []
        for image in images:
            features.append(extractor(image) if cache is None else cache(extractor, image))
            if progress is not None:
                progress(len(features), len(checked))
        return cls(checked, tuple(features), tuple(names or map(str, range(len(features)))))

    @classmethod
    def from_dataset(
        cls,
        dataset: Dataset,
        extractor: FeatureExtractor,
        *,
        cache: FeatureCache | None = None,
        progress: Progress | None = None,
    ) -> ReferenceMap:
        """Build the map of a dataset's reference images.

        Parameters
        ----------
        dataset : Dataset
            With ground truth at its references.
        extractor : FeatureExtractor
        cache : FeatureCache, optional
            Features are looked up there, and kept.
        progress : callable, optional
            Called as ``progress(images_done, images_total)``.

        Returns
        -------
        ReferenceMap

        Raises
        ------
        ValueError
            If the dataset has no references, or an image does not decode.
        """
        indices = dataset.reference_indices
        if not len(indices) or dataset.ground_truth is None:
            raise ValueError(
                f"{dataset.name}: no reference images; expected a references file or an option "
                "such as references='every:10'"
            )
        return cls.build(
            (dataset.image(int(i)) for i in indices),
            dataset.ground_truth[indices],
            extractor,
            names=[dataset.image_paths[i].name for i in indices],
            cache=cache,
            progress=progress,
        )

    @classmethod
    def of_poses(cls, poses: ArrayLike) -> ReferenceMap:
        """Make a map of poses alone, for observations whose matches come from elsewhere.

        Parameters
        ----------
        poses : array_like of shape (m, 3)

        Returns
        -------
        ReferenceMap
            Its references have no features.
        """
        checked = as_poses(poses, "poses")
        return cls(checked, (NO_FEATURES,) * len(checked), tuple(map(str, range(len(checked)))))

    def add(self, pose: ArrayLike, features: Features, name: str) -> ReferenceMap:
        """Return a map with one more reference.

        Parameters
        ----------
        pose : array_like of shape (3,)
        features : Features
        name : str

        Returns
        -------
        ReferenceMap
        """
        poses = np.vstack([self.poses, as_poses(pose, "pose")])
        return ReferenceMap(poses, (*self.features, features), (*self.names, name))

    def subset(self, indices: ArrayLike) -> ReferenceMap:
        """Return a map of some of the references, with the visual words of the whole.

        Parameters
        ----------
        indices : array_like of int

        Returns
        -------
        ReferenceMap
        """
        chosen = np.asarray(indices, dtype=np.intp)
        some = ReferenceMap(
            self.poses[chosen],
            tuple(self.features[i] for i in chosen),
            tuple(self.names[i] for i in chosen),
        )
        # the words of the whole map serve its parts: leave-one-out need not learn them each time
        vars(some)["_gallery"] = self._gallery[chosen]
        return some

    def bounds(self, margin: float = 1.0) -> tuple[float, float, float, float]:
        """Return the rectangle around the references.

        Parameters
        ----------
        margin : float
            Metres added on every side.

        Returns
        -------
        tuple (xmin, ymin, xmax, ymax)
            Metres.
        """
        low = self.poses[:, :2].min(axis=0) - margin
        high = self.poses[:, :2].max(axis=0) + margin
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    @cached_property
    def spacing(self) -> float:
        """Median distance in metres from a reference to the nearest one at another place.

        Infinite for a map of one place.
        """
        offsets = self.poses[:, None, :2] - self.poses[None, :, :2]
        distance = np.hypot(offsets[..., 0], offsets[..., 1])
        nearest = np.where(distance > 0.0, distance, np.inf).min(axis=1)
        return float(np.median(nearest))

    @cached_property
    def _gallery(self) -> Gallery:
        """Made when first asked for."""
        return Gallery.learn([f.descriptors for f in self.features])

    def similarity(self, features: Features) -> NDArray[np.float32]:
        """Compare an image with all references by their visual words, without matching.

        Parameters
        ----------
        features : Features

        Returns
        -------
        ndarray of shape (m,)
            Cosines in [-1, 1]; zero for an image without features.
        """
        return self._gallery.similarity(features.descriptors)

    def candidates(
        self,
        features: Features,
        poses: FloatArray | None,
        *,
        max_range: float,
        max_candidates: int,
        max_poses: int = 256,
    ) -> NDArray[np.intp]:
        """Choose the references worth comparing with an image taken at one of some poses.

        A reference counts by how near it is to the poses, on the average, and by its similarity.

        Parameters
        ----------
        features : Features
            Of the image.
        poses : ndarray of shape (N, 3) or None
            Where the robot may be, all as probable; None is anywhere.
        max_range : float
            Metres: references farther from every pose are left out.
        max_candidates : int
            At most so many.
        max_poses : int
            Of the poses, evenly taken, so many are looked at.

        Returns
        -------
        ndarray of int
            Indices of references, the most promising first; empty if all are out of range.
        """
        weight = np.ones(len(self))
        if poses is not None:
            weight = self.nearness(poses, max_range=max_range, max_poses=max_poses)
        eligible = np.flatnonzero(weight > 0.0)
        if len(eligible) > max_candidates:
            weight = weight * np.maximum(self.similarity(features), 1e-3)
        order = np.argsort(-weight[eligible], kind="stable")
        chosen: NDArray[np.intp] = eligible[order][:max_candidates]
        return chosen

    def nearness(self, poses: FloatArray, *, max_range: float, max_poses: int = 256) -> FloatArray:
        """Say how near the references are to some poses, on the average.

        Parameters
        ----------
        poses : ndarray of shape (N, 3)
        max_range : float
            Metres.
        max_poses : int
            Of the poses, evenly taken, so many are looked at.

        Returns
        -------
        ndarray of shape (m,)
            The mean of exp(-2 distance / max_range) in [0, 1]; zero of references that are farther
            than ``max_range`` from every pose.
        """
        if not len(poses):
            return np.zeros(len(self))
        seen = poses[:: max(1, -(-len(poses) // max_poses)), :2]
        offsets = seen[:, None, :] - self.poses[None, :, :2]
        distance = np.hypot(offsets[..., 0], offsets[..., 1])
        near = np.where(distance < max_range, np.exp(-2.0 * distance / max_range), 0.0)
        mean: FloatArray = near.mean(axis=0)
        return mean

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the map to a `.npz` file without pickle, atomically.

        Parameters
        ----------
        path : path
        """
        stacked: dict[str, Any] = {
            field: np.concatenate([getattr(f, field) for f in self.features])
            for field in FEATURE_FIELDS
        }
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(
                file,
                format=np.array(FORMAT),
                version=np.array(VERSION),
                poses=self.poses,
                names=np.array(self.names, dtype=np.str_),
                counts=np.array([len(f) for f in self.features]),
                **stacked,
            )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> ReferenceMap:
        """Read a map from its file.

        Parameters
        ----------
        path : path

        Returns
        -------
        ReferenceMap

        Raises
        ------
        ValueError
            If the file is none, of another version, or damaged.
        FileNotFoundError
            If there is no such file.
        """
        stored = read_arrays(path, "reference map")
        if str(stored.get("format")) != FORMAT:
            raise ValueError(f"{path}: not a {FORMAT}")
        if str(stored.get("version")) != str(VERSION):
            raise ValueError(f"{path}: map version {stored.get('version')}, expected {VERSION}")
        missing = {"poses", "names", "counts", *FEATURE_FIELDS} - stored.keys()
        if missing:
            raise ValueError(f"{path}: damaged {FORMAT}, without {', '.join(sorted(missing))}")
        try:
            counts = stored["counts"]
            lengths = {len(stored[field]) for field in FEATURE_FIELDS}
            if counts.dtype.kind != "i" or counts.min() < 0 or lengths != {int(counts.sum())}:
                raise ValueError("the numbers of features do not fit")
            columns = [np.split(stored[field], np.cumsum(counts)[:-1]) for field in FEATURE_FIELDS]
            features = tuple(Features(*row) for row in zip(*columns, strict=True))
            return cls(stored["poses"], features, tuple(stored["names"].tolist()))
        except (ValueError, TypeError) as error:
            raise ValueError(f"{path}: {error}") from error
