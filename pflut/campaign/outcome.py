"""What became of one drive."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pflut._files import read_json, write_json
from pflut.evaluation import convergence_index, near_truth
from pflut.geometry import FloatArray

_LISTS = (
    "position_m",
    "heading_deg",
    "confidence",
    "hypotheses",
    "held",
    "seconds",
    "num_particles",
)


@dataclass(frozen=True)
class DriveOutcome:
    """The outcome of one simulated drive with one filter.

    Parameters
    ----------
    scenario, filter : str
    seed, home_seed : int
        Of the drive and the filter; of the home.
    kidnapped_at : int or None
        The first image after the robot was carried away.
    position_m, heading_deg : list of float
        Errors of the estimates, an image each; headings with their sign.
    confidence : list of float
        In [0, 1].
    hypotheses : list of int
        How many places the filter thinks possible; 1 for filters that have but one.
    held : list of int
        1 where one of them is within 0.5 m and 10 degrees of the truth.
    seconds : list of float
        Of each image: prediction, matching, likelihood and filter.
    num_particles : list of int
    degenerate : int
        Images that were ignored.
    """

    scenario: str
    filter: str
    seed: int
    home_seed: int
    kidnapped_at: int | None
    position_m: list[float]
    heading_deg: list[float]
    confidence: list[float]
    hypotheses: list[int]
    held: list[int]
    seconds: list[float]
    num_particles: list[int]
    degenerate: int

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self.position_m)

    @cached_property
    def good(self) -> NDArray[np.bool_]:
        """Which estimates are within 0.5 m and 10 degrees."""
        return near_truth(self.position_m, self._heading)

    @cached_property
    def _heading(self) -> FloatArray:
        return np.radians(self.heading_deg)

    @property
    def converged_at(self) -> int | None:
        """The image, from 0, from which on all are good, before the robot is carried away."""
        end = self.kidnapped_at
        return convergence_index(self.position_m[:end], self._heading[:end])

    @property
    def recovered_at(self) -> int | None:
        """The image, from 0 after the robot was carried away, from which on all are good."""
        if self.kidnapped_at is None:
            return None
        return convergence_index(
            self.position_m[self.kidnapped_at :], self._heading[self.kidnapped_at :]
        )

    @cached_property
    def localized(self) -> NDArray[np.bool_]:
        """Which images come after convergence, and after recovery if there was need of it."""
        end = len(self) if self.kidnapped_at is None else self.kidnapped_at
        found = np.zeros(len(self), bool)
        if self.converged_at is not None:
            found[self.converged_at : end] = True
        if self.kidnapped_at is not None and self.recovered_at is not None:
            found[end + self.recovered_at :] = True
        return found

    def save(self, path: Path) -> None:
        """Write the outcome to a JSON file, atomically."""
        write_json(path, asdict(self))

    @classmethod
    def load(cls, path: Path) -> DriveOutcome:
        """Read an outcome's file.

        Raises
        ------
        ValueError
            Naming the file, if it is none.
        """
        content = read_json(path)
        names = {item.name for item in fields(cls)}
        if set(content) != names:
            raise ValueError(f"{path}: expected a drive's outcome with {', '.join(sorted(names))}")
        made = cls(**content)
        whole = [made.seed, made.home_seed, made.degenerate]
        if made.kidnapped_at is not None:
            whole.append(made.kidnapped_at)
        if not all(type(value) is int and value >= 0 for value in whole):
            raise ValueError(f"{path}: expected whole numbers as seeds and counts")
        if {type(made.scenario), type(made.filter)} != {str}:
            raise ValueError(f"{path}: expected names of a scenario and a filter")
        lists = [getattr(made, name) for name in _LISTS]
        if not all(isinstance(some, list) and some and len(some) == len(made) for some in lists):
            raise ValueError(f"{path}: expected lists of one length, an entry an image")
        if not all(type(value) in (int, float) for some in lists for value in some):
            raise ValueError(f"{path}: expected lists of numbers")
        return made
