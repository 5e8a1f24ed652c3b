"""The ratio test: which features of two images may show the same landmark."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut.correspondences import Correspondences
from pflut.features.features import Features
from pflut.features.kernels import best_in_row, best_two, hamming_scores

Indices = NDArray[np.intp]
Scores = NDArray[np.float32]


def similarity_scores(left: Features, right: Features, buffer: Scores | None = None) -> Scores:
    """Compare all descriptors of two images.

    Parameters
    ----------
    left, right : Features
        Of n and m features with the same kind of descriptor.
    buffer : ndarray of shape (at least n m,), float32, optional
        Where the result goes: memory that was used before, which saves a quarter of the time.

    Returns
    -------
    ndarray of shape (n, m), float32
        Products s of the descriptors, for bits minus half the Hamming distance: either way
        ``left.squared_norms + right.squared_norms - 2 s`` is the squared Euclidean or the
        Hamming distance.

    Raises
    ------
    ValueError
        If the descriptors are of different kinds.
    """
    a, b = left.descriptors, right.descriptors
    if a.dtype != b.dtype or a.shape[1] != b.shape[1]:
        raise ValueError(
            f"descriptors: expected one kind, got {a.shape[1]} x {a.dtype} "
            f"and {b.shape[1]} x {b.dtype}"
        )
    size = len(a) * len(b)
    memory = np.empty(size, dtype=np.float32) if buffer is None else buffer[:size]
    scores = memory.reshape(len(a), len(b))
    if left.is_binary:
        hamming_scores(a.view(np.uint64), b.view(np.uint64), scores)
    else:
        np.matmul(a, b.T, out=scores)
    return scores


def match_indices(
    reference: Features, query: Features, *, ratio: float = 0.8, mutual: bool = False
) -> tuple[Indices, Indices, NDArray[np.float64]]:
    """Match the features of a query image to those of a reference image.

    A query feature takes the reference feature with the nearest descriptor if that is nearer
    than ``ratio`` times the second-nearest. Where several query features take the same
    reference feature, the one with the best ratio keeps it.

    Parameters
    ----------
    reference, query : Features
        With the same kind of descriptor, or without any.
    ratio : float
        In (0, 1]. Lowe's 0.8 keeps some 90 % of the true matches.
    mutual : bool
        Demand also that the query feature is the reference feature's nearest.

    Returns
    -------
    reference_index, query_index : ndarray of shape (n,)
        In the order of the query's features; none appears twice. Empty if the reference has
        less than two features, which leave nothing to compare with.
    score : ndarray of shape (n,)
        Distance of the nearest over distance of the second-nearest, in [0, ratio).

    Raises
    ------
    ValueError
        If ``ratio`` is out of range or the descriptors are of different kinds.

    References
    ----------
    D. Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 2004, section 7.1.
    """
    return _matched(reference, query, ratio, mutual, None)


def _matched(
    reference: Features, query: Features, ratio: float, mutual: bool, buffer: Scores | None
) -> tuple[Indices, Indices, NDArray[np.float64]]:
    """Do what `match_indices` says, in memory that the caller may have."""
    if not 0.0 < ratio <= 1.0:
        raise ValueError(f"ratio: expected a number in (0, 1], got {ratio!r}")
    if not len(reference) or not len(query):
        # an image without features has descriptors of no kind
        none = np.empty(0, dtype=np.intp)
        return none, none, np.empty(0)
    scores = similarity_scores(reference, query, buffer)
    n, m = scores.shape
    if n < 2:
        none = np.empty(0, dtype=np.intp)
        return none, none, np.empty(0)
    nearest, second = np.empty(m, dtype=np.float32), np.empty(m, dtype=np.float32)
    index = np.empty(m, dtype=np.int32)
    best_two(scores, 0.5 * reference.squared_norms, nearest, second, index)
    distances = query.squared_norms - 2.0 * np.stack([nearest, second])
    score = _ratio_scores(np.maximum(distances, 0.0), reference.is_binary)
    chosen = np.flatnonzero(score < ratio)
    if mutual and chosen.size:
        back = np.empty(chosen.size, dtype=np.int32)
        best_in_row(scores, 0.5 * query.squared_norms, index[chosen], back)
        chosen = chosen[back == chosen]
    chosen = chosen[_best_takers(index[chosen], score[chosen])]
    return index[chosen].astype(np.intp), chosen, score[chosen].astype(np.float64)


def _ratio_scores(distances: NDArray[Any], binary: bool) -> NDArray[Any]:
    """Divide nearest by second-nearest; 1 where both are zero, which tells nothing."""
    nearest, second = distances
    quotient = np.divide(nearest, second, out=np.ones_like(nearest), where=second > 0.0)
    return np.asarray(quotient if binary else np.sqrt(quotient))


def _best_takers(taken: NDArray[Any], score: NDArray[Any]) -> Indices:
    """Of the takers of each reference feature select the one with the smallest score."""
    by_score = np.argsort(score, kind="stable")
    _, first = np.unique(taken[by_score], return_index=True)
    return np.sort(by_score[first])


def match(
    features_l: Features, features_r: Features, *, ratio: float = 0.8, mutual: bool = False
) -> Correspondences:
    """Match a query image to a reference image; the rules are those of `match_indices`.

    Parameters
    ----------
    features_l : Features
        Of the reference view L.
    features_r : Features
        Of the query view R.
    ratio : float
        Of the ratio test, in (0, 1].
    mutual : bool
        Demand that each is the other's nearest.

    Returns
    -------
    Correspondences
        ``quality`` is the score of the ratio test, small is good.

    Raises
    ------
    ValueError
        If ``ratio`` is out of range or the descriptors are of different kinds.
    """
    return match_many([features_l], features_r, ratio=ratio, mutual=mutual)[0]


def match_many(
    references: Sequence[Features], query: Features, *, ratio: float = 0.8, mutual: bool = False
) -> list[Correspondences]:
    """Match a query image to many reference images, each by a ratio test of its own.

    One matrix product and one pass of a compiled kernel a reference, while the products are
    still in the processor's cache: faster than one product of all stacked descriptors, which
    has to be written to memory and read again.

    Parameters
    ----------
    references : sequence of Features
        The reference views L.
    query : Features
        The query view R.
    ratio, mutual
        As for `match`.

    Returns
    -------
    list of Correspondences
        One for each reference.
    """
    largest = max((len(reference) for reference in references), default=0)
    buffer = np.empty(largest * len(query), dtype=np.float32)
    correspondences = []
    for reference in references:
        left, right, score = _matched(reference, query, ratio, mutual, buffer)
        correspondences.append(
            Correspondences(
                reference.azimuth[left],
                reference.elevation[left],
                query.azimuth[right],
                query.elevation[right],
                score,
            )
        )
    return correspondences
