"""Relative-pose estimators beside each other: on the same pairs, by the same clock.

An estimator is any callable that takes a sequence of `Correspondences` and gives for each something
that has a ``heading_l`` and a ``heading_r``, so that one's own is compared by wrapping it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import process_time
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.correspondences import Correspondences
from pflut.evaluation import relative_pose_errors
from pflut.geometry import TWO_PI, FloatArray
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.table import LikelihoodTable
from pflut.relpose.estimate import estimate_relative_pose
from pflut.relpose.ransac import ransac_relative_poses
from pflut.relpose.result import RelativePose
from pflut.relpose.search import estimate_relative_poses


class HasHeadings(Protocol):
    """What a `RelativePose` has at least: radians, NaN where nothing was found."""

    @property
    def heading_l(self) -> float:
        """Direction from L to R in L's frame."""

    @property
    def heading_r(self) -> float:
        """Direction from R to L in R's frame."""


class Headings(NamedTuple):
    """The least that an estimator answers with, radians; NaN where it finds nothing."""

    heading_l: float = np.nan
    heading_r: float = np.nan


Estimator = Callable[[Sequence[Correspondences]], Sequence[HasHeadings]]
OwnEstimator = Callable[[Sequence[Correspondences]], Sequence[RelativePose]]

#: A pose is found if both headings are within it, radians.
MAX_HEADING_ERROR = 0.1
#: The paper's RANSAC: 100 samples of all correspondences, inliers counted, nothing optimised before
#: the M-estimator.
PAPER_RANSAC = {
    "max_iterations": 100,
    "scoring": "inliers",
    "local_optimization": False,
    "gate_samples": False,
}


@dataclass(frozen=True, eq=False)
class PairErrors:
    """Errors of one estimator's relative poses, one a pair, all found or not.

    Parameters
    ----------
    heading_l, heading_r : ndarray of shape (n,)
        Absolute errors of theta and phi, radians.
    rotation : ndarray of shape (n,)
        Absolute error of psi, radians.
    seconds : float
        CPU time a pair.
    """

    heading_l: FloatArray
    heading_r: FloatArray
    rotation: FloatArray
    seconds: float

    @classmethod
    def of(cls, poses: Sequence[HasHeadings], truth: ArrayLike, seconds: float) -> PairErrors:
        """Compare an estimator's answers with the true ``[heading_l, heading_r]`` (n, 2), radians.

        Where nothing was found (NaN, or a `RelativePose` that nothing agrees with) the errors are
        pi.
        """
        found = np.array([_headings(pose) for pose in poses], dtype=np.float64).reshape(-1, 2)
        headings = np.asarray(truth, dtype=np.float64)
        heading_l, rotation = relative_pose_errors(*found.T, *headings.T)
        heading_r, _ = relative_pose_errors(*found.T[::-1], *headings.T[::-1])
        return cls(heading_l, heading_r, rotation, seconds)

    @classmethod
    def together(cls, parts: Sequence[PairErrors]) -> PairErrors:
        """Put the pairs of several sets into one; the time is that of the mean pair."""
        return cls(
            np.concatenate([part.heading_l for part in parts]),
            np.concatenate([part.heading_r for part in parts]),
            np.concatenate([part.rotation for part in parts]),
            float(np.average([p.seconds for p in parts], weights=[len(p) for p in parts])),
        )

    def __len__(self) -> int:
        """Return the number of pairs."""
        return len(self.rotation)

    def __getitem__(self, index: slice | NDArray[Any]) -> PairErrors:
        """Select pairs by a slice, an index array or a mask."""
        return PairErrors(
            self.heading_l[index], self.heading_r[index], self.rotation[index], self.seconds
        )

    @property
    def heading(self) -> FloatArray:
        """The larger error of the two headings, radians."""
        return np.maximum(self.heading_l, self.heading_r)

    @property
    def found(self) -> NDArray[np.bool_]:
        """Which pairs have both headings within 0.1 rad."""
        return self.heading < MAX_HEADING_ERROR


def compare_estimators(
    estimators: Mapping[str, Estimator],
    pairs: Sequence[Correspondences],
    headings: ArrayLike,
    *,
    progress: Callable[[str], None] | None = None,
) -> dict[str, PairErrors]:
    """Run estimators on the same pairs, and compare what they find with the truth.

    Parameters
    ----------
    estimators : mapping of str to callable
        By name. Each is called with two of the pairs first, so that nothing is compiled on the
        clock.
    pairs : sequence of Correspondences
    headings : array_like of shape (n, 2)
        The true ``[heading_l, heading_r]``, radians.
    progress : callable, optional
        Called with the name of each estimator that is done.

    Returns
    -------
    dict of str to PairErrors

    Raises
    ------
    ValueError
        If there are not as many headings as pairs.
    """
    truth = np.asarray(headings, dtype=np.float64)
    if truth.shape != (len(pairs), 2):
        raise ValueError(f"headings: expected shape ({len(pairs)}, 2), got {truth.shape}")
    if not np.isfinite(truth).all():
        raise ValueError("headings: expected finite radians")
    compared = {}
    for name, estimate in estimators.items():
        estimate(pairs[:2])
        start = process_time()
        poses = estimate(pairs)
        seconds = (process_time() - start) / max(len(pairs), 1)
        if len(poses) != len(pairs):
            raise ValueError(f"{name}: expected {len(pairs)} poses, one a pair, got {len(poses)}")
        compared[name] = PairErrors.of(poses, truth, seconds)
        if progress is not None:
            progress(name)
    return compared


def _headings(pose: HasHeadings) -> tuple[float, float]:
    """Give the headings of an answer, NaN of a `RelativePose` that nothing agrees with."""
    if isinstance(pose, RelativePose) and pose.num_inliers == 0 and not pose.success:
        return np.nan, np.nan
    return pose.heading_l, pose.heading_r


def by_table(table: LikelihoodTable | DenseTable, **options: Any) -> OwnEstimator:
    """Make an estimator of a table: the maximum of its likelihood, polished.

    Parameters
    ----------
    table : LikelihoodTable or DenseTable
    **options
        Of `estimate_relative_poses`, or with the paper's table of `estimate_relative_pose`;
        ``polish=False`` is the paper's own.

    Returns
    -------
    callable
    """
    if isinstance(table, DenseTable):
        return lambda pairs: [estimate_relative_pose(pair, table, **options) for pair in pairs]
    return lambda pairs: estimate_relative_poses(pairs, table, **options)


def by_maximum(table: DenseTable) -> Estimator:
    """Make the paper's estimator: the centre of the highest cell, and nothing else.

    Parameters
    ----------
    table : DenseTable

    Returns
    -------
    callable
    """

    def estimate(pairs: Sequence[Correspondences]) -> list[Headings]:
        width = TWO_PI / table.bins
        cells = [divmod(int(table.log_likelihood_grid(p).argmax()), table.bins) for p in pairs]
        return [Headings((row + 0.5) * width, (column + 0.5) * width) for row, column in cells]

    return estimate


def by_ransac(**options: Any) -> OwnEstimator:
    """Make an estimator of a RANSAC.

    Parameters
    ----------
    **options
        Of `ransac_relative_poses`; ``**PAPER_RANSAC`` are the paper's.

    Returns
    -------
    callable
    """
    return lambda pairs: ransac_relative_poses(pairs, **options)
