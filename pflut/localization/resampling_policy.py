"""When to resample: policies, and their combinations with ``&``, ``|`` and ``~``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SinceResampling:
    """What has happened since the particles were resampled last.

    Parameters
    ----------
    effective_share : float
        Effective sample size over the number of particles, in (0, 1].
    updates : int
        Observations, the one that is being applied included.
    translation : float
        Metres that odometry has moved, all steps added.
    rotation : float
        Radians that it has turned, all turns added without their signs.
    """

    effective_share: float = 1.0
    updates: int = 0
    translation: float = 0.0
    rotation: float = 0.0


class ResamplingPolicy:
    """Says whether to resample; asked after each observation that has counted.

    A policy of one's own is a subclass with ``__call__``. ``a & b`` resamples when both say so,
    ``a | b`` when one does, ``~a`` when ``a`` does not.
    """

    def __call__(self, since: SinceResampling) -> bool:
        """Decide.

        Parameters
        ----------
        since : SinceResampling

        Returns
        -------
        bool
        """
        raise NotImplementedError

    def __and__(self, other: ResamplingPolicy) -> ResamplingPolicy:
        """Resample when both say so."""
        return _Combined("and", (self, other), all)

    def __or__(self, other: ResamplingPolicy) -> ResamplingPolicy:
        """Resample when one says so."""
        return _Combined("or", (self, other), any)

    def __invert__(self) -> ResamplingPolicy:
        """Resample when this one does not say so."""
        return _Combined("not", (self,), lambda answers: not any(answers))


@dataclass(frozen=True)
class _Combined(ResamplingPolicy):
    word: str
    policies: tuple[ResamplingPolicy, ...]
    decide: Callable[[list[bool]], bool]

    def __call__(self, since: SinceResampling) -> bool:
        return self.decide([policy(since) for policy in self.policies])

    def __repr__(self) -> str:
        texts = [repr(policy) for policy in self.policies]
        return f"(not {texts[0]})" if len(texts) == 1 else f"({f' {self.word} '.join(texts)})"


@dataclass(frozen=True)
class EffectiveSizeBelow(ResamplingPolicy):
    """Resample when few particles carry the weight.

    Parameters
    ----------
    share : float
        In [0, 1]: of the particles. 1 resamples after every observation that tells them apart, 0
        never.

    Raises
    ------
    ValueError
        If the share is out of its range.
    """

    share: float = 0.5

    def __post_init__(self) -> None:
        if not 0.0 <= self.share <= 1.0:
            raise ValueError(f"share: expected in [0, 1], got {self.share}")

    def __call__(self, since: SinceResampling) -> bool:
        """Compare the effective sample size."""
        return since.effective_share < self.share


@dataclass(frozen=True)
class EveryUpdates(ResamplingPolicy):
    """Resample at every n-th observation, as AMCL's ``resample_interval``.

    Parameters
    ----------
    n : int
        At least 1.

    Raises
    ------
    ValueError
        If it is less.
    """

    n: int = 1

    def __post_init__(self) -> None:
        if self.n < 1:
            raise ValueError(f"n: expected at least 1, got {self.n}")

    def __call__(self, since: SinceResampling) -> bool:
        """Count the observations."""
        return since.updates >= self.n


@dataclass(frozen=True)
class Moved(ResamplingPolicy):
    """Resample only after a motion: a robot that stands sees the same image again and again.

    The images count nevertheless. A robot that ought to look only after a motion, as AMCL's with
    ``update_min_d`` and ``update_min_a``, calls `ParticleFilter.update` only then.

    Parameters
    ----------
    translation : float
        Metres, all steps added.
    rotation : float
        Radians, all turns added; one of the two suffices.

    Raises
    ------
    ValueError
        If one is negative or no number.
    """

    translation: float = 0.25
    rotation: float = 0.2

    def __post_init__(self) -> None:
        for name in ("translation", "rotation"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise ValueError(f"{name}: expected a finite number >= 0, got {value}")

    def __call__(self, since: SinceResampling) -> bool:
        """Compare the way."""
        return since.translation >= self.translation or since.rotation >= self.rotation
