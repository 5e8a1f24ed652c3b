"""Pairs of a dataset's images with their matches and true relative pose."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pflut.correspondences import Correspondences
from pflut.datasets.base import Dataset
from pflut.features import FeatureCache, FeatureExtractor, match
from pflut.geometry import relative_headings
from pflut.likelihood.table import bearing_columns
from pflut.relpose.judgement import judged
from pflut.relpose.result import RelativePose


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


def dataset_pairs(
    dataset: Dataset,
    extractor: FeatureExtractor,
    *,
    max_distance: float = 3.0,
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
    extractor : FeatureExtractor
    max_distance : float
        Metres.
    across : bool
        Only a reference image with a query image, as they meet in localization.
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
        If no two images with a true pose are so near.
    """
    chosen = near_pairs(dataset, max_distance, across=across)
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


def near_pairs(dataset: Dataset, max_distance: float, *, across: bool = False) -> NDArray[np.intp]:
    """Find the pairs of images with true poses that are near each other, but not in one place.

    Parameters
    ----------
    dataset : Dataset
    max_distance : float
        Metres.
    across : bool
        Only a reference image with a query image.

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
        near = (distance > 0.0) & (distance <= max_distance)
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
        raise ValueError(
            f"{dataset.name}: no {what} with true poses within {max_distance:g} m of each other"
        )
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
