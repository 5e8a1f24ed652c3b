"""The polynomial model of OCamCalib, for fisheye lenses and mirrors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from pflut.camera.axes import image_axes
from pflut.camera.base import Camera
from pflut.camera.fields import angle, check_positive, coefficients
from pflut.camera.radial import first_positive_root, invert_increasing
from pflut.geometry import FloatArray, bearing_angles, bearing_vectors


@dataclass(frozen=True)
class OcamCalib(Camera):
    """An omnidirectional camera as the OCamCalib toolbox calibrates it.

    A pixel at ``(row, column)`` from the center, after the affine correction, looks along
    ``(row, column, a0 + a1 rho + a2 rho^2 + ...)`` with ``rho = hypot(row, column)``. The
    third axis points away from what the middle of the image shows: a0 is negative.

    Parameters
    ----------
    width, height : int
        Of the image in pixels.
    cx, cy : float
        The center's column and row in pixels, integers are pixel centers, counted from 0.
        OCamCalib's text file has them as row (its ``xc``), then column (``yc``).
    polynomial : tuple of floats
        ``a0, a1, a2, ...``, OCamCalib's ``ss``: the line of the direct mapping function.
    c, d, e : float
        The affine correction
        ``[row', column'] = [[c, d], [e, 1]] [row, column] + center``.
    max_angle : float
        Radians from the image's middle direction to the border of what is shown; pi by
        default. The model also ends where the polynomial folds.
    looks : {"forward", "down", "up"}
        Where the middle of the image looks in the camera's frame: "forward" for a lens, "down"
        for a camera below a mirror, which sees itself in the middle. The upper border of the
        image looks up for a camera that looks forward, else forward.
    mirrored : bool
        Whether left and right are exchanged: True for a camera with one mirror, unless its
        driver has flipped the image.
    mount : Mount
        How the camera sits on the robot.

    Raises
    ------
    ValueError
        If a parameter is out of range or not finite.

    References
    ----------
    D. Scaramuzza, A. Martinelli, R. Siegwart, "A toolbox for easily calibrating omnidirectional
    cameras", IROS 2006.

    Notes
    -----
    The toolbox's inverse polynomial is an approximation and is not used: the direct one is
    inverted by Newton's method.
    """

    model: ClassVar[str] = "ocamcalib"

    cx: float
    cy: float
    polynomial: tuple[float, ...] = coefficients()
    c: float = 1.0
    d: float = 0.0
    e: float = 0.0
    max_angle: float = angle(np.pi)
    looks: str = "forward"
    mirrored: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "max_angle")
        if not self.polynomial[0] < 0.0:
            raise ValueError(
                f"OcamCalib: polynomial: expected a negative first coefficient, "
                f"got {self.polynomial[0]!r}"
            )
        if self.c - self.d * self.e == 0.0:
            raise ValueError("OcamCalib: c, d, e: expected c - d e not to be 0")
        try:
            image_axes(self.looks, self.mirrored)
        except ValueError as error:
            raise ValueError(f"OcamCalib: {error}") from None

    @cached_property
    def _axes(self) -> FloatArray:
        return image_axes(self.looks, self.mirrored)

    @cached_property
    def _affine(self) -> FloatArray:
        """Column and row from corrected column and row."""
        return np.array([[1.0, self.e], [self.d, self.c]])

    @cached_property
    def _limit(self) -> float:
        """The largest radius in pixels that the model maps one to one."""
        corners = np.array([(u, v) for u in (-0.5, self.width) for v in (-0.5, self.height)])
        corners = np.linalg.solve(self._affine, (corners - (self.cx, self.cy)).T)
        farthest = float(np.linalg.norm(corners, axis=0).max()) + 1.0
        a = np.array(self.polynomial)
        # the angle grows with rho while f - rho f' < 0
        turn = first_positive_root(a * (1.0 - np.arange(len(a))))
        return min(farthest, turn * (1.0 - 1e-6))

    def _depth(self, rho: FloatArray) -> FloatArray:
        """Give the component along the image's middle direction."""
        return -np.asarray(np.polyval(self.polynomial[::-1], rho))

    def _angle(self, rho: FloatArray) -> FloatArray:
        return np.asarray(np.arctan2(rho, self._depth(rho)))

    def _slope(self, rho: FloatArray) -> FloatArray:
        depth = self._depth(rho)
        depth_slope = -np.polyval(np.polyder(np.array(self.polynomial[::-1])), rho)
        return np.asarray((depth - rho * depth_slope) / (rho * rho + depth * depth))

    def _pixels_to_angles(self, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        points = np.linalg.solve(self._affine, (pixels - (self.cx, self.cy)).T).T
        rho = np.hypot(points[:, 0], points[:, 1])
        seen = (rho <= self._limit) & (self._angle(rho) <= self.max_angle)
        rays = np.column_stack([points, self._depth(rho)])
        return bearing_angles(np.where(seen[:, None], rays, np.nan) @ self._axes.T)

    def _angles_to_pixels(self, azimuth: FloatArray, elevation: FloatArray) -> FloatArray:
        rays = bearing_vectors(azimuth, elevation) @ self._axes
        sideways = np.hypot(rays[:, 0], rays[:, 1])
        a = np.arctan2(sideways, rays[:, 2])
        rho = invert_increasing(self._angle, self._slope, a, self._limit)
        points = rays[:, :2] * (rho / np.where(sideways > 0.0, sideways, 1.0))[:, None]
        pixels = points @ self._affine.T + (self.cx, self.cy)
        return np.where((a <= self.max_angle)[:, None], pixels, np.nan)
