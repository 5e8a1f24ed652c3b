"""Landmarks: points on surfaces that an image can show, some of which look alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Points on vertical surfaces.

    Attributes
    ----------
    points : ndarray of shape (n, 3)
        Metres; z is the height above the floor.
    facing : ndarray of shape (n,)
        Direction in which the surface looks, radians.
    looks : ndarray of shape (n,) int
        Landmarks with the same number look the same.
    """

    points: FloatArray
    facing: FloatArray
    looks: NDArray[np.int64]

    def __len__(self) -> int:
        """Return the number of landmarks."""
        return len(self.looks)

    @property
    def copies(self) -> NDArray[np.int64]:
        """The next landmark that looks like each, shape (n,): a ring; itself where it is alone."""
        order = np.argsort(self.looks, kind="stable")
        _, start, count = np.unique(self.looks[order], return_index=True, return_counts=True)
        follower = np.arange(1, len(order) + 1)
        follower[start + count - 1] = start
        copies = np.empty(len(order), dtype=np.int64)
        copies[order] = order[follower]
        return copies

    @classmethod
    def join(cls, parts: list[Landmarks]) -> Landmarks:
        """Put the landmarks of several surfaces together."""
        return cls(
            np.concatenate([part.points for part in parts]),
            np.concatenate([part.facing for part in parts]),
            np.concatenate([part.looks for part in parts]),
        )


@dataclass
class LandmarkBuilder:
    """Puts landmarks on surfaces; numbers what they look like.

    Parameters
    ----------
    parts : list of Landmarks
        What is there so far.
    used : int
        So many looks are given away.
    """

    parts: list[Landmarks]
    used: int = 0

    def new_looks(self, count: int) -> NDArray[np.int64]:
        """Give numbers to as many landmarks that look like no other, shape (count,)."""
        self.used += count
        return np.arange(self.used - count, self.used)

    def add(
        self,
        pattern: FloatArray,
        start: tuple[float, float],
        yaw: float,
        looks: NDArray[np.int64] | None = None,
    ) -> None:
        """Put landmarks on a surface that runs from a point in a direction and looks to the right.

        Parameters
        ----------
        pattern : ndarray of shape (k, 2)
            How far along the surface, and how high, each stands; metres.
        start : tuple (x, y)
            Metres.
        yaw : float
            Radians.
        looks : ndarray of shape (k,) int, optional
            By default new ones.
        """
        along, height = pattern.T
        points = np.column_stack(
            [start[0] + along * np.cos(yaw), start[1] + along * np.sin(yaw), height]
        )
        self.parts.append(
            Landmarks(
                points,
                np.full(len(points), yaw - 0.5 * np.pi),
                self.new_looks(len(points)) if looks is None else looks,
            )
        )

    def finish(self) -> Landmarks:
        """Give all landmarks."""
        return Landmarks.join(self.parts)


def scatter(
    rng: np.random.Generator, count: int, length: float, low: float, high: float
) -> FloatArray:
    """Draw a pattern of landmarks that is uniform on a rectangle.

    Parameters
    ----------
    rng : Generator
    count : int
    length : float
        Of the surface, metres.
    low, high : float
        Heights in metres.

    Returns
    -------
    ndarray of shape (count, 2)
        Along the surface and height.
    """
    return rng.uniform([0.0, low], [length, high], size=(count, 2))
