"""Errors of relative poses on many pairs, and what a table says of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.evaluation import relative_pose_errors
from pflut.geometry import FloatArray
from pflut.relpose.result import RelativePose
from pflut.statistics import bin_indices, bootstrap_median, success_rate, summarize

#: A pose is found if both headings are within it, radians.
MAX_HEADING_ERROR = 0.1


class HasHeadings(Protocol):
    """What a `RelativePose` has at least: radians, NaN where nothing was found."""

    @property
    def heading_l(self) -> float:
        """Direction from L to R in L's frame."""

    @property
    def heading_r(self) -> float:
        """Direction from R to L in R's frame."""


class ErrorSummary(NamedTuple):
    """What a table says of an estimator's errors on some pairs; its fields are columns of a CSV.

    Attributes
    ----------
    pairs : int
    heading_median_deg, heading_mad_deg, heading_low_deg, heading_high_deg : float
        Of heading_l: median, MAD, and the median's 95 % interval by bootstrap over pairs; degrees.
    rotation_median_deg, rotation_mad_deg, rotation_low_deg, rotation_high_deg : float
        The same of the rotation.
    found, found_low, found_high : float
        Share of pairs with both headings within 0.1 rad, and its 95 % interval.
    cpu_us : float
        CPU time a pair, microseconds.
    """

    pairs: int
    heading_median_deg: float
    heading_mad_deg: float
    heading_low_deg: float
    heading_high_deg: float
    rotation_median_deg: float
    rotation_mad_deg: float
    rotation_low_deg: float
    rotation_high_deg: float
    found: float
    found_low: float
    found_high: float
    cpu_us: float

    def __str__(self) -> str:
        """Give one line: medians and the share found with their intervals, and the time."""
        angles = (
            f"{name} {median:5.2f} deg {f'({low:.2f} to {high:.2f})':18}"
            for name, (median, _, low, high) in (
                ("heading", self[1:5]),
                ("rotation", self[5:9]),
            )
        )
        share = f"found {self.found:.3f} ({self.found_low:.3f} to {self.found_high:.3f})"
        return f"{''.join(angles)}{share}{self.cpu_us:8.0f} us"


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
    def concatenate(cls, parts: Sequence[PairErrors]) -> PairErrors:
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

    def summary(self) -> ErrorSummary:
        """Give medians, MADs, the share found, all with their intervals, and the time."""
        found = success_rate(self.found)
        return ErrorSummary(
            len(self),
            *_median_in_degrees(self.heading_l),
            *_median_in_degrees(self.rotation),
            found.rate,
            found.low,
            found.high,
            1e6 * self.seconds,
        )


def binned_summaries(
    x: ArrayLike, errors: Mapping[str, PairErrors], edges: ArrayLike
) -> Iterator[tuple[float, float, str, ErrorSummary]]:
    """Summarize errors by what they depend on: in bins of it, and over all bins.

    Parameters
    ----------
    x : array_like of shape (n,)
        Of each pair, for example the distance between its views.
    errors : mapping of str to PairErrors
        Of n pairs each, by estimator.
    edges : array_like of shape (b + 1,)
        Increasing, see `bin_indices`.

    Yields
    ------
    low, high : float
        Edges of the bin.
    name : str
    summary : ErrorSummary
        Bin after bin, all of them last; bins without a pair are left out.
    """
    place, limits = bin_indices(x, edges), np.asarray(edges, dtype=np.float64).tolist()
    bins = [(place == k, *span) for k, span in enumerate(pairwise(limits))]
    for chosen, low, high in [*bins, (place >= 0, limits[0], limits[-1])]:
        if chosen.any():
            for name, error in errors.items():
                yield low, high, name, error[chosen].summary()


def _median_in_degrees(errors: FloatArray) -> tuple[float, float, float, float]:
    """Give the median, the MAD and the median's 95 % interval of errors in radians."""
    degrees = np.degrees(errors)
    known = summarize(degrees)
    return known.median, known.mad, *bootstrap_median(degrees, rng=0)


def _headings(pose: HasHeadings) -> tuple[float, float]:
    """Give the headings of an answer, NaN of a `RelativePose` that nothing agrees with."""
    if isinstance(pose, RelativePose) and pose.num_inliers == 0 and not pose.success:
        return np.nan, np.nan
    return pose.heading_l, pose.heading_r
