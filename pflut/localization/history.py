"""Where the particles of today were a moment ago, for images that come late."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray, wrap_to_pi

NO_ANCESTOR = -1


@dataclass(frozen=True, eq=False)
class Moment:
    """The particles at some time.

    Parameters
    ----------
    stamp : float
        Seconds.
    poses : ndarray of shape (M, 3)
        As they were then.
    ancestors : ndarray of shape (N,), int32, or None
        Which of them each particle of today comes from, -1 where it was not there yet; None if
        nothing was resampled since.
    """

    stamp: float
    poses: FloatArray
    ancestors: NDArray[np.int32] | None = None

    def resampled(self, indices: NDArray[np.int32]) -> Moment:
        """Follow the particles through a resampling.

        Parameters
        ----------
        indices : ndarray of shape (n,), int32
            Which of the particles each new one is a copy of, -1 for one that is new.
        """
        if self.ancestors is None:
            return replace(self, ancestors=indices)
        before = np.append(self.ancestors, np.int32(NO_ANCESTOR))  # what -1 picks
        return replace(self, ancestors=before[indices])

    def of_today(self) -> FloatArray:
        """Give where each particle of today was, (N, 3): NaN for one that was not there yet."""
        if self.ancestors is None:
            return self.poses
        poses = self.poses[self.ancestors]
        poses[self.ancestors == NO_ANCESTOR] = np.nan
        return poses


class History:
    """The last few moments of a filter.

    Parameters
    ----------
    length : int
        How many are kept, besides the present one; each takes 28 bytes a particle.
    moments : sequence of Moment
        In the order of time.

    Raises
    ------
    ValueError
        If the length is negative.
    """

    def __init__(self, length: int, moments: Sequence[Moment] = ()) -> None:
        if length < 0:
            raise ValueError(f"history: expected a number of moments >= 0, got {length}")
        self.length = length
        self.moments = tuple(moments)

    def add(self, stamp: float, poses: FloatArray) -> None:
        """Keep the particles of now, and forget the oldest ones; of one time the latest count.

        Parameters
        ----------
        stamp : float
            Seconds, not before the last one.
        poses : ndarray of shape (N, 3)
            Not copied: nobody may write to it.
        """
        if self.length:
            before = tuple(moment for moment in self.moments if moment.stamp < stamp)
            self.moments = (*before, Moment(stamp, poses))[-self.length - 1 :]

    def resample(self, indices: NDArray[np.int32]) -> None:
        """Follow the particles through a resampling, see `Moment.resampled`."""
        self.moments = tuple(moment.resampled(indices) for moment in self.moments)

    def at(self, stamp: float) -> FloatArray | None:
        """Say where the particles of today were at some time.

        Parameters
        ----------
        stamp : float
            Seconds.

        Returns
        -------
        ndarray of shape (N, 3) or None
            Between two moments as if they had moved evenly; NaN rows for particles that were not
            there yet. None before the first moment, and after the last one.
        """
        times = [moment.stamp for moment in self.moments]
        if not times or not times[0] <= stamp <= times[-1]:
            return None
        after = int(np.searchsorted(times, stamp))
        poses = self.moments[after].of_today()
        if times[after] == stamp:
            return poses
        earlier = self.moments[after - 1].of_today()
        share = (stamp - times[after - 1]) / (times[after] - times[after - 1])
        offset = poses - earlier
        offset[:, 2] = wrap_to_pi(offset[:, 2])
        between = earlier + share * offset
        between[:, 2] = wrap_to_pi(between[:, 2])
        return between
