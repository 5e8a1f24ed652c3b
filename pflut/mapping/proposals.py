"""Which pairs of images are worth matching: all, or those that look alike and neighbours."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pflut.retrieval import Vocabulary

ROWS = 256
"""Images whose similarities to all others are in memory at a time."""
LEARNED_FROM = 128
"""Images that visual words are learned from, at most."""

Descriptors = Callable[[int], NDArray[np.generic]]


def all_of(num_images: int) -> NDArray[np.int64]:
    """Give all pairs of images.

    Parameters
    ----------
    num_images : int

    Returns
    -------
    ndarray of shape (num_images (num_images - 1) / 2, 2)
        The smaller index first, in order.
    """
    return np.column_stack(np.triu_indices(num_images, 1)).astype(np.int64)


def alike(
    signatures: NDArray[np.float32], max_candidates: int, *, neighbours: int = 1
) -> NDArray[np.int64]:
    """Propose for each image those that look most like it, and its neighbours in time.

    Parameters
    ----------
    signatures : ndarray of shape (N, S), float32
        Of the images in the order of time, of length one; see `image_signatures`.
    max_candidates : int
        Images that an image proposes. It may be proposed by more.
    neighbours : int
        The images so many before and after it are proposed as well.

    Returns
    -------
    ndarray of shape (n, 2)
        Each pair once, the smaller index first, in order.

    Raises
    ------
    ValueError
        If a number is negative.
    """
    for name, value in (("max_candidates", max_candidates), ("neighbours", neighbours)):
        if value < 0:
            raise ValueError(f"{name}: expected at least 0, got {value}")
    count = len(signatures)
    images = np.arange(count)
    found = [np.column_stack([images[:-gap], images[gap:]]) for gap in range(1, neighbours + 1)]
    best = min(max_candidates, count - 1)
    for start in range(0, count, ROWS):
        rows = images[start : start + ROWS]
        similar = signatures[rows] @ signatures.T
        similar[rows - start, rows] = -np.inf
        chosen = np.argsort(-similar, axis=1, kind="stable")[:, :best].ravel()
        proposing = np.repeat(rows, best)
        found.append(
            np.column_stack([np.minimum(proposing, chosen), np.maximum(proposing, chosen)])
        )
    pairs = np.concatenate([*found, np.empty((0, 2), np.int64)]).astype(np.int64)
    return np.unique(pairs, axis=0)


def image_signatures(descriptors: Descriptors, num_images: int) -> NDArray[np.float32]:
    """Compute the signatures of images with visual words of their own.

    Parameters
    ----------
    descriptors : callable
        Number of an image -> its descriptors, (m, D), as `Vocabulary` takes them. Asked for in
        the order of the images, three times at most.
    num_images : int

    Returns
    -------
    ndarray of shape (num_images, S), float32
    """
    # those of a dark stretch have no descriptors, and may be all of every tenth
    seen = [image for image in range(num_images) if len(descriptors(image))]
    learned = seen[:: max(1, -(-len(seen) // LEARNED_FROM))]
    vocabulary = Vocabulary.learn([descriptors(image) for image in learned])
    return vocabulary.signatures(map(descriptors, range(num_images)))
