"""What stays and what changes in a home between two days."""

from __future__ import annotations

import numpy as np

CHANGED = 0.5  # share of the things that can change that do


class Changes:
    """Gives a Generator for each thing that somebody may have moved.

    The n-th thing gets the same Generator on every day, but on other days than that of the
    mapping about half of the things get one of that day's own.

    Parameters
    ----------
    seed : int
        Of the home.
    day : int
        0 is the day of the mapping.
    """

    def __init__(self, seed: int, day: int) -> None:
        self._seed, self._day, self._things = seed, day, 0

    def __call__(self) -> np.random.Generator:
        """Give the next thing's Generator."""
        self._things += 1
        key = [self._seed, 2, self._things]
        if self._day:
            of_day = np.random.default_rng([*key, self._day])
            if of_day.random() < CHANGED:
                return of_day
        return np.random.default_rng(key)
