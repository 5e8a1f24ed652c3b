"""Pairs of a dataset's images with their matches and true relative pose."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pflut.correspondences import Correspondences
from pflut.datasets.base import Dataset
from pflut.features import FeatureCache, FeatureExtractor, match
from pflut.geometry import FloatArray, relative_headings
from pflut.likelihood.known_pairs import Pair
from pflut.likelihood.table import bearing_columns
from pflut.relpose.judgement import judged
from pflut.relpose.result import RelativePose

ALL_IMAGES = slice(None)


@dataclass(frozen=True, eq=False)
class ImagePair:
    """Two images of a dataset.

    Parameters
    ----------
    index_l, index_r : int
        Of the reference and the query image.
    correspondences : Correspondences
    heading_l, heading_r : float
        The true ones, radians in [0, 2 pi).
    distance : float
        Between the images, metres.
    """

    index_l: int
    index_r: int
    correspondences: Correspondences
    heading_l: float
    heading_r: float
    distance: float

    @property
    def known(self) -> Pair:
        """The correspondences and both true headings, as tables are learned from."""
        return self.correspondences, self.heading_l, self.heading_r


def correspondences_and_headings(
    pairs: Iterable[ImagePair],
) -> tuple[list[Correspondences], FloatArray]:
    """Take pairs apart, for `compare_estimators`.

    Parameters
    ----------
    pairs : iterable of ImagePair

    Returns
    -------
    correspondences : list of Correspondences
        One a pair.
    headings : ndarray of shape (n, 2)
        The true ``[heading_l, heading_r]``, radians.
    """
    listed = list(pairs)
    headings = np.array([[pair.heading_l, pair.heading_r] for pair in listed], dtype=np.float64)
    return [pair.correspondences for pair in listed], headings.reshape(-1, 2)


def dataset_pairs(
    dataset: Dataset,
    extractor: FeatureExtractor | None = None,
    *,
    max_distance: float = 3.0,
    min_distance: float = 0.0,
    max_gap: int | None = None,
    images: slice | NDArray[np.intp] = ALL_IMAGES,
    across: bool = False,
    ratio: float = 0.8,
    mutual: bool = True,
    cache: FeatureCache | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[ImagePair]:
    """Match every two images of a dataset that are near each other.

    Parameters
    ----------
    dataset : Dataset
        With ground truth.
    extractor : FeatureExtractor, optional
        Default: `FeatureExtractor` of the dataset's camera and masks.
    max_distance, min_distance, max_gap, images, across
        Which pairs, see `near_pairs`.
    ratio : float
        Of the ratio test.
    mutual : bool
        Whether matches must be each other's nearest.
    cache : FeatureCache, optional
    progress : callable, optional
        Called as ``progress(pairs matched, pairs)``.

    Yields
    ------
    ImagePair
        Each pair once, the earlier image as reference; with ``across`` the dataset's reference.

    Raises
    ------
    ValueError
        If there is no such pair.
    """
    chosen = near_pairs(
        dataset,
        max_distance,
        min_distance=min_distance,
        max_gap=max_gap,
        images=images,
        across=across,
    )
    if extractor is None:
        extractor = FeatureExtractor(
            dataset.camera, mask_elevation=dataset.mask_elevation, mask=dataset.mask
        )
    features = {
        index: extractor(image) if cache is None else cache(extractor, image)
        for index in sorted(set(chosen.ravel().tolist()))
        for image in [dataset.image(index)]
    }
    assert dataset.ground_truth is not None  # near_pairs has looked
    poses = dataset.ground_truth
    for done, (left, right) in enumerate(chosen.tolist(), start=1):
        theta, phi, distance = relative_headings(poses[left], poses[right])
        yield ImagePair(
            left,
            right,
            match(features[left], features[right], ratio=ratio, mutual=mutual),
            float(theta),
            float(phi),
            float(distance),
        )
        if progress is not None:
            progress(done, len(chosen))


def near_pairs(
    dataset: Dataset,
    max_distance: float,
    *,
    min_distance: float = 0.0,
    max_gap: int | None = None,
    images: slice | NDArray[np.intp] = ALL_IMAGES,
    across: bool = False,
) -> NDArray[np.intp]:
    """Find the pairs of images with true poses that are near each other, but not in one place.

    Parameters
    ----------
    dataset : Dataset
    max_distance, min_distance : float
        Metres.
    max_gap : int, optional
        How many images later in the dataset the other one may be: in a drive that comes back to a
        place it tells pairs of one pass.
    images : slice or ndarray of int
        Of which both are to be; default all.
    across : bool
        Only a reference image with a query image, as they meet in localization.

    Returns
    -------
    ndarray of shape (k, 2)
        Indices of images, at least one pair: the smaller one first, with ``across`` the reference.

    Raises
    ------
    ValueError
        If there is none.
    """
    poses = np.full((len(dataset), 3), np.nan)
    if dataset.ground_truth is not None:
        poses = dataset.ground_truth
    offsets = poses[:, None, :2] - poses[None, :, :2]
    distance = np.hypot(offsets[..., 0], offsets[..., 1])
    with np.errstate(invalid="ignore"):
        near = (distance > 0.0) & (distance >= min_distance) & (distance <= max_distance)
    indices = np.arange(len(dataset))
    chosen = np.isin(indices, indices[images])
    near &= chosen[:, None] & chosen[None, :]
    if max_gap is not None:
        near &= np.abs(indices[:, None] - indices[None, :]) <= max_gap
    if across:
        linked = np.zeros_like(near)
        linked[np.ix_(dataset.reference_indices, dataset.query_indices)] = True
        # where all images are both, each pair once
        near &= linked & ~np.tril(linked.T)
    else:
        near = np.triu(near)
    pairs = np.argwhere(near)
    if not len(pairs):
        what = "reference and query" if across else "two images"
        span = f"{min_distance:g} to {max_distance:g} m"
        raise ValueError(f"{dataset.name}: no {what} with true poses {span} apart")
    return pairs


def agreeing(
    correspondences: Correspondences, pose: RelativePose, *, noise: float = 0.01
) -> NDArray[np.bool_]:
    """Say which correspondences agree with a relative pose, with positive depths.

    Parameters
    ----------
    correspondences : Correspondences
    pose : RelativePose
    noise : float
        Standard deviation of the bearings, radians; three of them are forgiven. A
        `LikelihoodTable` has its own.

    Returns
    -------
    ndarray of shape (n,), bool
    """
    count = len(correspondences)
    columns = bearing_columns(correspondences)
    headings = np.tile([pose.heading_l, pose.heading_r], (count, 1))
    # each one is a pair of views by itself
    inliers, _ = judged(columns, np.arange(count + 1), headings, noise)
    return inliers.astype(bool)
