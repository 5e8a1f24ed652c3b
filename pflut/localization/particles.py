"""The particles of a filter: poses, weights, where they come from, what happened to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray, wrap_to_pi
from pflut.localization.history import NO_ANCESTOR, History
from pflut.localization.hypothesis_weights import temper_hypotheses
from pflut.localization.resampling import take
from pflut.localization.resampling_policy import SinceResampling
from pflut.localization.tempering import tempered
from pflut.localization.weights import Weights


class Particles:
    """Weighted poses, with their history. No call changes an array: each makes new ones.

    Parameters
    ----------
    poses : ndarray of shape (N, 3)
    weights : Weights
        N of them.
    history : History
    since : SinceResampling, optional
    stamp : float, optional
        Seconds: when they were there.
    clocked : bool
        Whether odometry said so; images do not put the clock on then.
    """

    def __init__(
        self,
        poses: FloatArray,
        weights: Weights,
        history: History,
        since: SinceResampling | None = None,
        stamp: float | None = None,
        clocked: bool = False,
    ) -> None:
        self.poses = poses
        self.weights = weights
        self.history = history
        self.since = SinceResampling() if since is None else since
        self.stamp = stamp
        self.clocked = clocked

    def __len__(self) -> int:
        """Return the number of particles."""
        return len(self.weights)

    def copy(self, *, history: int | None = None) -> Particles:
        """Give particles that go another way from here.

        Parameters
        ----------
        history : int, optional
            So many moments are kept from now on; by default as many as now.
        """
        length = self.history.length if history is None else history
        moments = self.history.moments[-length - 1 :] if length else ()
        past = History(length, moments)
        return Particles(self.poses, self.weights, past, self.since, self.stamp, self.clocked)

    def delay(self, stamp: float | None) -> float:
        """Say how many seconds before the particles' own time another time was, at least 0."""
        if stamp is None or self.stamp is None:
            return 0.0
        return max(self.stamp - stamp, 0.0)

    def weigh(
        self,
        weights: Weights,
        log_likelihood: FloatArray,
        *,
        min_effective_share: float,
        hypothesis_temperature: float,
        proposed: int = 0,
    ) -> float:
        """Take new weights, flattened where they are too sharp.

        Parameters
        ----------
        weights : Weights
            By Bayes' rule.
        log_likelihood : ndarray of shape (N,)
            That made them of the present ones.
        min_effective_share : float
            See `tempering_exponent`.
        hypothesis_temperature : float
            See `temper_hypotheses`.
        proposed : int
            So many of the last ones are proposals.

        Returns
        -------
        float
            The exponent that the likelihood was flattened with.
        """
        after, exponent = tempered(
            self.weights, weights, log_likelihood, min_effective_share, proposed=proposed
        )
        self.weights = temper_hypotheses(self.poses, self.weights, after, hypothesis_temperature)
        return exponent

    def count_update(self, counted: bool) -> None:
        """Count an observation, if it did, for the resampling policy."""
        self.since = replace(
            self.since,
            updates=self.since.updates + counted,
            effective_share=self.weights.effective_sample_size / len(self),
        )

    def move(
        self, poses: FloatArray, odometry: tuple[float, float, float], stamp: float | None
    ) -> None:
        """Take the poses after a motion, and count the way.

        Parameters
        ----------
        poses : ndarray of shape (N, 3)
        odometry : tuple (dx, dy, dheading)
        stamp : float or None
            Seconds: when the motion ended.
        """
        self.clocked |= stamp is not None
        self.poses = poses
        self.since = replace(
            self.since,
            translation=self.since.translation + float(np.hypot(odometry[0], odometry[1])),
            rotation=self.since.rotation + abs(float(wrap_to_pi(odometry[2]))),
        )
        self._note(stamp)

    def see(self, stamp: float | None) -> None:
        """Note the time of an image, where odometry has none.

        Parameters
        ----------
        stamp : float or None
            Seconds.
        """
        if not self.clocked:
            self._note(stamp)

    def _note(self, stamp: float | None) -> None:
        """Note that the particles are there at this time, if it is known."""
        if stamp is not None:
            self.stamp = stamp
            self.history.add(stamp, self.poses)

    def append(self, poses: FloatArray, log_weights: FloatArray, probability: float) -> None:
        """Add particles that come from nowhere.

        Parameters
        ----------
        poses : ndarray of shape (M, 3)
        log_weights : ndarray of shape (M,)
            On the scale on which those of the present ones sum to ``1 - probability``.
        probability : float
            What the new ones stand for.
        """
        stay = self.weights.log + np.log1p(-probability)
        self.poses = np.concatenate([self.poses, poses])
        self.weights = Weights.from_log(np.concatenate([stay, log_weights]))
        if self.history.moments:
            new = np.full(len(poses), NO_ANCESTOR, np.int32)
            self.history.resample(np.concatenate([np.arange(len(stay), dtype=np.int32), new]))

    def forget_last(self, count: int, weights: Weights | None = None) -> None:
        """Take the last particles away.

        Parameters
        ----------
        count : int
        weights : Weights, optional
            Of the others; by default as they are, some of them not zero.
        """
        kept = len(self) - count
        self.poses = self.poses[:kept]
        self.weights = Weights.from_log(self.weights.log[:kept]) if weights is None else weights
        if self.history.moments:
            self.history.resample(np.arange(kept, dtype=np.int32))

    def select(self, indices: NDArray[np.int32]) -> None:
        """Resample: go on with copies of the chosen ones, all of one weight.

        Parameters
        ----------
        indices : ndarray of shape (n,), int32
        """
        self.poses = take(self.poses, indices)
        self.weights = Weights.uniform(len(indices))
        self.history.resample(indices)
        self.since = SinceResampling()
