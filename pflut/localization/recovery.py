"""Recovery: a robot that was carried away, or is lost, is found again."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, log, log1p, nan
from typing import Any, NamedTuple

import numpy as np

from pflut.geometry import FloatArray, as_poses
from pflut.localization.proposals import PoseProposal


class LikelihoodAverages(NamedTuple):
    """Logarithms of the mean likelihoods of recent images, averaged over few and over many.

    Parameters
    ----------
    slow, fast : float
        log(w_slow) and log(w_fast) of table 8.3; NaN before the first image.
    """

    slow: float = nan
    fast: float = nan

    def after(self, log_mean: float, alpha_slow: float, alpha_fast: float) -> LikelihoodAverages:
        """Take one more image into the averages: table 8.3, lines 10 and 11."""
        return LikelihoodAverages(
            _average(self.slow, log_mean, alpha_slow), _average(self.fast, log_mean, alpha_fast)
        )


def _average(before: float, log_value: float, alpha: float) -> float:
    """Give log((1 - alpha) exp(before) + alpha exp(log_value))."""
    if before != before or alpha == 1.0:
        return log_value
    if alpha == 0.0:
        return before
    return float(np.logaddexp(log1p(-alpha) + before, log(alpha) + log_value))


@dataclass(frozen=True, kw_only=True, eq=False)
class Recovery:
    """Take into account that the robot may have been carried away since the last image.

    Bayes' rule with a motion model of two parts: with the probability ``1 - p`` the robot moved as
    the odometry says, with ``p`` it is anywhere. Each part is sampled in its own way, the first by
    the particles, the second by importance sampling: poses drawn from a proposal weigh
    ``p u(pose) / q(pose)``, with u the uniform density and q that of the proposal. All are then
    weighted by the image together. So poses proposed where the robot is not cost a tracked robot
    nothing, and a lost one is found as soon as the images speak clearly enough for it.

    Parameters
    ----------
    proposal : PoseProposal
        Where the robot may be: `ReferenceProposal` asks the references that look like the image,
        `UniformProposal` draws blindly.
    probability : float
        p in (0, 1): that the robot was carried away between two images.
    share : float
        So many proposals an image, as a share of the present particles, in (0, 1].
    alpha_slow, alpha_fast : float
        In [0, 1], ``alpha_fast`` the larger one. Augmented MCL: p is raised to 1 - w_fast / w_slow
        where that is more, the averages of the mean likelihoods of the images by these decay rates
        (AMCL's ``recovery_alpha_slow`` and ``_fast``). Both 0 turn it off. The likelihoods are
        those before normalisation: after it their mean is constant and nothing would be noticed.

    Raises
    ------
    ValueError
        If an option is out of its range.

    References
    ----------
    S. Thrun, D. Fox, W. Burgard, F. Dellaert, "Robust Monte Carlo localization for mobile robots",
    Artificial Intelligence 128, 2001 (mixture proposals). "Probabilistic Robotics" (2005), table
    8.3 (augmented MCL).
    """

    proposal: PoseProposal
    probability: float = 0.001
    share: float = 0.1
    alpha_slow: float = 0.0
    alpha_fast: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.probability < 1.0:
            raise ValueError(f"probability: expected in (0, 1), got {self.probability}")
        if not 0.0 < self.share <= 1.0:
            raise ValueError(f"share: expected in (0, 1], got {self.share}")
        if not 0.0 <= self.alpha_slow <= self.alpha_fast <= 1.0:
            raise ValueError(
                "alpha_slow: expected 0 <= alpha_slow <= alpha_fast <= 1, got "
                f"{self.alpha_slow} and {self.alpha_fast}"
            )

    def probability_after(self, averages: LikelihoodAverages) -> float:
        """Give the probability that the robot was carried away: table 8.3, line 13.

        Parameters
        ----------
        averages : LikelihoodAverages
            Of the images before.

        Returns
        -------
        float
            In (0, 1).
        """
        fall = averages.fast - averages.slow
        risen = 1.0 - exp(fall) if -inf < fall < 0.0 else 0.0
        return min(max(self.probability, risen), 0.999)

    def propose(
        self,
        observation: Any,
        num_particles: int,
        averages: LikelihoodAverages,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray, float]:
        """Draw poses that the robot may have been carried to.

        Parameters
        ----------
        observation : object
            Handed to the proposal.
        num_particles : int
            That there are.
        averages : LikelihoodAverages
        rng : numpy.random.Generator

        Returns
        -------
        poses : ndarray of shape (M, 3)
        log_weights : ndarray of shape (M,)
            log of p u / (q M), of the particles' scale: these sum to 1 - p then.
        probability : float
            p.
        """
        count = max(round(self.share * num_particles), 1)
        probability = self.probability_after(averages)
        drawn, log_ratio = self.proposal.propose(observation, count, rng)
        poses, log_ratio = as_poses(drawn, "proposal"), np.asarray(log_ratio, dtype=np.float64)
        if len(poses) != count or log_ratio.shape != (count,) or np.isnan(log_ratio).any():
            raise ValueError(f"proposal: expected {count} poses and as many numbers, none NaN")
        return poses, log_ratio + (log(probability) - log(count)), probability
