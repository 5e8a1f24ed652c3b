"""Point correspondences between two views, as bearings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray, wrap_to_2pi


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Pairs of bearings that may show the same landmark.

    Parameters
    ----------
    azimuth_l, elevation_l : array_like of shape (n,)
        Bearings in the reference view L, radians in L's robot frame. Azimuths are wrapped to
        [0, 2 pi); elevations lie in [-pi/2, pi/2].
    azimuth_r, elevation_r : array_like of shape (n,)
        Bearings in the query view R, likewise in R's robot frame.
    quality : array_like of shape (n,), optional
        The ratio-test score of the match in [0, 1]: distance of the best over distance of the
        second-best descriptor. Small is good.

    Raises
    ------
    ValueError
        If the arrays differ in length, are not one-dimensional, or hold values that are not
        finite.
    """

    azimuth_l: FloatArray
    elevation_l: FloatArray
    azimuth_r: FloatArray
    elevation_r: FloatArray
    quality: FloatArray | None = None

    def __post_init__(self) -> None:
        names = ["azimuth_l", "elevation_l", "azimuth_r", "elevation_r"]
        if self.quality is not None:
            names.append("quality")
        length = np.size(self.azimuth_l)
        for name in names:
            values = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            if values.shape != (length,):
                raise ValueError(f"{name}: expected shape ({length},), got {values.shape}")
            if not np.isfinite(values).all():
                row = int(np.flatnonzero(~np.isfinite(values))[0])
                raise ValueError(f"{name}: value {row} is not finite")
            if name.startswith("azimuth"):
                values = np.ascontiguousarray(wrap_to_2pi(values))
            elif name.startswith("elevation") and (np.abs(values) > np.pi / 2).any():
                row = int(np.flatnonzero(np.abs(values) > np.pi / 2)[0])
                raise ValueError(
                    f"{name}: value {row} is {values[row]:.6g}, expected radians in [-pi/2, pi/2]"
                )
            elif name == "quality" and ((values < 0.0) | (values > 1.0)).any():
                row = int(np.flatnonzero((values < 0.0) | (values > 1.0))[0])
                raise ValueError(f"{name}: value {row} is {values[row]:.6g}, expected 0 to 1")
            object.__setattr__(self, name, values)

    def __len__(self) -> int:
        """Return the number of correspondences."""
        return int(self.azimuth_l.size)

    def __getitem__(self, index: slice | NDArray[Any]) -> Correspondences:
        """Select correspondences by a slice, an index array or a mask."""
        return Correspondences(
            self.azimuth_l[index],
            self.elevation_l[index],
            self.azimuth_r[index],
            self.elevation_r[index],
            None if self.quality is None else self.quality[index],
        )

    def exchanged(self) -> Correspondences:
        """Return the same correspondences with the views L and R exchanged."""
        return Correspondences(
            self.azimuth_r, self.elevation_r, self.azimuth_l, self.elevation_l, self.quality
        )

    @classmethod
    def empty(cls) -> Correspondences:
        """Return zero correspondences."""
        none = np.empty(0)
        return cls(none, none, none, none)


@dataclass(frozen=True, eq=False)
class ReferenceMatch:
    """A reference image and its correspondences with the robot's image.

    Parameters
    ----------
    index : int
        Of the reference in the map.
    correspondences : Correspondences
        L is the reference, R the robot's image.
    """

    index: int
    correspondences: Correspondences
