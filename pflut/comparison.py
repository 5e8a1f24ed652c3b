"""Relative-pose estimators beside each other: on the same pairs, by the same clock.

An estimator is any callable that takes a sequence of `Correspondences` and gives for each something
that has a ``heading_l`` and a ``heading_r``, so that one's own is compared by wrapping it.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from time import process_time
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from pflut.correspondences import Correspondences
from pflut.geometry import TWO_PI
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.table import LikelihoodTable
from pflut.pair_errors import HasHeadings, PairErrors
from pflut.relpose.estimate import estimate_relative_pose
from pflut.relpose.ransac import ransac_relative_poses
from pflut.relpose.result import RelativePose
from pflut.relpose.search import estimate_relative_poses


class Headings(NamedTuple):
    """The least that an estimator answers with, radians; NaN where it finds nothing."""

    heading_l: float = np.nan
    heading_r: float = np.nan


Key = TypeVar("Key", bound=Hashable)
Estimator = Callable[[Sequence[Correspondences]], Sequence[HasHeadings]]
OwnEstimator = Callable[[Sequence[Correspondences]], Sequence[RelativePose]]

#: The paper's RANSAC: 100 samples of all correspondences, inliers counted, nothing optimised before
#: the M-estimator.
PAPER_RANSAC = {
    "max_iterations": 100,
    "scoring": "inliers",
    "local_optimization": False,
    "gate_samples": False,
}
#: Noises to choose a RANSAC's from, radians.
NOISES = (0.002, 0.005, 0.01, 0.02)
#: Options of RANSACs by name, but the noise: the paper's, and the best one.
RANSACS: Mapping[str, Mapping[str, Any]] = {
    "8-point RANSAC": {"solver": "8pt", **PAPER_RANSAC},
    "3-point RANSAC": {"solver": "3pt", **PAPER_RANSAC},
    "2-point RANSAC": {"solver": "2pt", **PAPER_RANSAC},
    "2-point LO-RANSAC": {"solver": "2pt"},
}


def compare_estimators(
    estimators: Mapping[Key, Estimator],
    pairs: Sequence[Correspondences],
    headings: ArrayLike,
    *,
    progress: Callable[[Key], None] | None = None,
) -> dict[Key, PairErrors]:
    """Run estimators on the same pairs, and compare what they find with the truth.

    Parameters
    ----------
    estimators : mapping to callable
        By name, or by what tells them apart. Each is called with two of the pairs first, so that
        nothing is compiled on the clock.
    pairs : sequence of Correspondences
    headings : array_like of shape (n, 2)
        The true ``[heading_l, heading_r]``, radians.
    progress : callable, optional
        Called with the name of each estimator that is done.

    Returns
    -------
    dict of PairErrors
        By the same keys.

    Raises
    ------
    ValueError
        If there are not as many headings as pairs, or poses of an estimator.
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


def best_estimator(
    family: Mapping[Key, Estimator], pairs: Sequence[Correspondences], headings: ArrayLike
) -> Key:
    """Choose of estimators that differ in a setting the one that is best on some pairs.

    To be compared fairly with others afterwards, on pairs that nothing was chosen by.

    Parameters
    ----------
    family : mapping to callable
        Estimators by their setting, for example the noise that a RANSAC expects.
    pairs, headings
        See `compare_estimators`.

    Returns
    -------
    key
        Of the estimator with the least median error of heading_l; of equals the first one.

    Raises
    ------
    ValueError
        As `compare_estimators`, or if there is no estimator or no pair.
    """
    if not family or not len(pairs):
        raise ValueError("family, pairs: expected at least one estimator and one pair, got none")
    errors = compare_estimators(family, pairs, headings)
    return min(errors, key=lambda key: float(np.median(errors[key].heading_l)))


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
