"""Features of one image that resemble each other, and copies of one feature."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pflut.features.features import Features
from pflut.features.matching import similarity_scores

BLOCK = 512
SAME_PLACE = 3.0


def distinct(features: Features, threshold: float) -> NDArray[np.bool_]:
    """Say which features of an image resemble no other one.

    Where two descriptors are nearer than the threshold, a match to either could as well be one
    to the other: both go. Where the two lie within 3 pixels they are one point found twice,
    at neighboring scales or with two orientations: the stronger stays.

    Parameters
    ----------
    features : Features
        Of one image, n of them.
    threshold : float
        A distance of descriptors: Euclidean, or for bits the share of bits that differ. Zero
        keeps all.

    Returns
    -------
    ndarray of shape (n,), bool

    Notes
    -----
    Booij et al. 2010, section IV: "If two features in the same image have a small distance in
    descriptor space then they are removed."
    """
    keep = np.ones(len(features), dtype=np.bool_)
    if threshold <= 0.0:
        return keep
    limit = threshold * 8 * features.descriptors.shape[1] if features.is_binary else threshold**2
    norms, pixels, response = features.squared_norms, features.pixels, features.response
    for start in range(0, len(features), BLOCK):
        # the block's rows against itself and what follows: every pair once
        rows = features[start : start + BLOCK]
        scores = similarity_scores(rows, features[start:])
        squared = rows.squared_norms[:, None] + norms[None, start:] - 2.0 * scores
        i, j = np.nonzero(squared < limit)
        i, j = i[i < j] + start, j[i < j] + start
        near = np.hypot(*(pixels[i] - pixels[j]).T) < SAME_PLACE
        weaker = np.where(response[i] < response[j], i, j)
        keep[weaker[near]] = False
        keep[i[~near]] = False
        keep[j[~near]] = False
    return keep


def unique_at_seam(
    pixels: NDArray[np.float64],
    likeness: NDArray[np.float64],
    width: int,
    margin: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Say which keypoints to keep of those found on both copies of a panorama's seam.

    Parameters
    ----------
    pixels : ndarray of shape (n, 2)
        In the coordinates of the image, some beyond its left or right border.
    likeness : ndarray of shape (n, 2)
        The logarithm of the size, and the orientation in radians: copies agree in both.
    width : int
        Of the image.
    margin : ndarray of shape (n,)
        How far each keypoint's copies may lie apart, in pixels: one on the seam itself can fall
        on either side of it in either copy.

    Returns
    -------
    ndarray of shape (n,), bool
        True for the keypoints between the borders, none of them twice; of copies the right
        one, which may lie beyond the border by less than its margin.
    """
    u = pixels[:, 0]
    keep = (u >= -0.5) & (u < width - 0.5)
    left = np.flatnonzero(np.abs(u + 0.5) < margin)
    right = np.flatnonzero(np.abs(u + 0.5 - width) < margin)
    if left.size == 0 or right.size == 0:
        return keep
    shift = pixels[left, None] + (width, 0.0) - pixels[None, right]
    distance = np.hypot(shift[..., 0], shift[..., 1])
    difference = likeness[left, None] - likeness[None, right]
    turn = np.abs(np.angle(np.exp(1j * difference[..., 1])))
    same = (distance < margin[left, None]) & (np.abs(difference[..., 0]) < 0.2) & (turn < 0.2)
    # a pair of copies stays once, wherever the two lie; what has no copy, if it is inside
    found = same.any(axis=1)
    partner = right[np.where(same, distance, np.inf).argmin(axis=1)]
    keep[left[found]] = False
    keep[partner[found]] = True
    return keep
