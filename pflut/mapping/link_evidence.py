"""What the matches of two images say about whether they show one place at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut.correspondences import Correspondences
from pflut.geometry import TWO_PI, FloatArray
from pflut.likelihood.table import LikelihoodTable, pair_columns
from pflut.relpose.judgement import judged
from pflut.relpose.result import RelativePose
from pflut.relpose.search import estimate_relative_poses

DIRECTIONS = 16
"""Sectors of azimuth that agreeing matches are counted in."""
_SIGNED = ("log_evidence", "rotation")


@dataclass(frozen=True, eq=False)
class LinkEvidence:
    """What the matches of pairs of images say for and against a link, one value a pair.

    Parameters
    ----------
    log_evidence : array_like of shape (n,)
        Log of the probability of the matches given that the views are linked by some pose, over
        that given that all of them are mismatches, in nats, at temperature 1: that of a
        `GridPosterior` or a `RelativePose`.
    num_matches : array_like of int, shape (n,)
        Correspondences.
    num_inliers : array_like of int, shape (n,)
        Of these, such that agree with the maximum-likelihood pose.
    num_directions : array_like of int, shape (n,)
        Sectors of 22.5 degrees, of 16, that hold correspondences that agree, in the view where
        they are fewer. All that agree may show one window, and such a window is in another room,
        too.
    spread : array_like of shape (n,)
        Root mean square chord between the azimuths of correspondences that agree and their mean
        direction, in [0, sqrt(2)], in the view where it is less: within a narrow field of view the
        standard deviation, radians.
    rotation : array_like of shape (n,)
        Of the second view relative to the first, radians.
    rotation_std : array_like of shape (n,)
        Its standard deviation, radians.

    Raises
    ------
    ValueError
        If the shapes differ, or a number is not finite or out of its range.
    """

    log_evidence: FloatArray
    num_matches: NDArray[np.int64]
    num_inliers: NDArray[np.int64]
    num_directions: NDArray[np.int64]
    spread: FloatArray
    rotation: FloatArray
    rotation_std: FloatArray

    def __post_init__(self) -> None:
        length = np.size(self.log_evidence)
        for item in fields(self):
            kind = np.int64 if item.name.startswith("num_") else np.float64
            values = np.array(getattr(self, item.name), dtype=np.float64, ndmin=1)
            if values.shape != (length,):
                raise ValueError(f"{item.name}: expected shape ({length},), got {values.shape}")
            if not np.isfinite(values).all():
                raise ValueError(f"{item.name}: expected finite numbers")
            if item.name not in _SIGNED and (values < 0.0).any():
                raise ValueError(f"{item.name}: expected none below zero, got {values.min():g}")
            object.__setattr__(self, item.name, values.astype(kind))

    def __len__(self) -> int:
        """Return the number of pairs."""
        return len(self.log_evidence)

    def __getitem__(self, index: slice | NDArray[Any]) -> LinkEvidence:
        """Select pairs by a slice, an index array or a mask."""
        return LinkEvidence(*(getattr(self, item.name)[index] for item in fields(self)))

    @classmethod
    def concatenate(cls, parts: Sequence[LinkEvidence]) -> LinkEvidence:
        """Join the evidence of several sets of pairs, at least one."""
        return cls(
            *(np.concatenate([getattr(part, item.name) for part in parts]) for item in fields(cls))
        )


def link_evidence(
    pairs: Sequence[Correspondences],
    table: LikelihoodTable,
    *,
    poses: Sequence[RelativePose] | None = None,
    noise: float | None = None,
    num_threads: int = 1,
) -> LinkEvidence:
    """Collect the evidence for links of many pairs of images.

    Parameters
    ----------
    pairs : sequence of Correspondences
    table : LikelihoodTable
        That of the model that is to judge the evidence.
    poses : sequence of RelativePose, optional
        What `estimate_relative_poses` found in these pairs with this table; found here if not
        given. Of a `GridPosterior` it is ``estimate_relative_pose(..., posterior=posterior)``.
    noise : float, optional
        Standard deviation of the bearings, radians; three of them are forgiven. Default: as the
        table has learned it.
    num_threads : int
        Threads over which pairs are spread.

    Returns
    -------
    LinkEvidence

    Raises
    ------
    ValueError
        If there are not as many poses as pairs, or the noise is not positive.
    """
    noise = table.noise if noise is None else noise
    if poses is None:
        poses = estimate_relative_poses(pairs, table, noise=noise, num_threads=num_threads)
    if len(poses) != len(pairs):
        raise ValueError(f"poses: expected {len(pairs)}, one a pair, got {len(poses)}")
    if not 0.0 < noise < np.pi / 2:
        raise ValueError(f"noise: expected radians in (0, pi/2), got {noise}")
    columns, first = pair_columns(pairs)
    headings = np.array([[pose.heading_l, pose.heading_r] for pose in poses]).reshape(-1, 2)
    counts = np.diff(first)
    # each correspondence is a pair of views by itself
    agree, _ = judged(columns, np.arange(first[-1] + 1), np.repeat(headings, counts, axis=0), noise)
    chosen = np.flatnonzero(agree)
    owner = np.repeat(np.arange(len(pairs)), counts)[chosen]
    # the columns are sines and cosines of azimuth_l, elevation_l, azimuth_r, elevation_r
    views = [(columns[k, chosen], columns[k + 1, chosen]) for k in (0, 4)]
    return LinkEvidence(
        np.array([pose.log_evidence for pose in poses]),
        counts,
        np.bincount(owner, minlength=len(pairs)),
        np.minimum(*(_sectors(np.arctan2(*view), owner, len(pairs)) for view in views)),
        np.minimum(*(_spread(*view, owner, len(pairs)) for view in views)),
        np.array([pose.rotation for pose in poses]),
        np.array([pose.rotation_std for pose in poses]),
    )


def _sectors(azimuth: FloatArray, owner: NDArray[np.intp], number: int) -> NDArray[np.int64]:
    """Count the sectors that each owner's azimuths lie in, shape (number,)."""
    sector = np.floor(azimuth * (DIRECTIONS / TWO_PI)).astype(np.int64) % DIRECTIONS
    met = np.zeros((number, DIRECTIONS), np.bool_)
    met[owner, sector] = True
    return np.asarray(met.sum(axis=1))


def _spread(
    sine: FloatArray, cosine: FloatArray, owner: NDArray[np.intp], number: int
) -> FloatArray:
    """Measure how far each owner's azimuths lie apart, shape (number,); zero where none are."""
    count = np.bincount(owner, minlength=number)
    length = np.hypot(*(np.bincount(owner, part, minlength=number) for part in (sine, cosine)))
    shares = np.divide(length, count, out=np.ones(number), where=count > 0)
    # the mean squared chord to the mean direction of unit vectors whose mean has this length
    return np.sqrt(2.0 * np.maximum(1.0 - shares, 0.0))
