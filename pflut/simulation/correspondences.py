"""The paper's simulator: two cameras on a circle around a ball of landmarks, and variations of it.

Landmarks are uniform in a ball of radius 2 around the origin; both cameras stand on the unit
circle of the plane with random headings; every bearing gets isotropic normal noise on the
sphere; a share of the correspondences are mismatches, each made of the projections of two
different landmarks (Booij et al. 2010, section IV-A).

The variations are a room with its landmarks on the walls, to test elsewhere what was learned in
the ball, and perspective cameras with a limited field of view.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, radians, tan
from typing import Literal

import numpy as np

from pflut.correspondences import Correspondences
from pflut.geometry import FloatArray, wrap_to_2pi
from pflut.simulation.correspondence_kernels import (
    PAIRS_TRIED,
    simulate_images,
    simulate_panoramas,
)


@dataclass(frozen=True)
class CorrespondenceSimulator:
    """Pairs of views with known relative pose and simulated correspondences.

    Parameters
    ----------
    mismatch : float
        Share of the correspondences whose two bearings show different landmarks, in [0, 1].
    noise : float
        Standard deviation of the noise: of panoramas in radians, isotropic on the sphere; of a
        limited field of view in the image plane at unit focal length, isotropic there, so that
        one pixel at a focal length of 500 pixels is 0.002.
    max_tilt : float
        The view R gets a roll and a pitch uniform in [-max_tilt, max_tilt], radians.
    radius : float
        Radius of the ball of landmarks; the cameras stand on the unit circle.
    scene : {"ball", "box"}
        "ball" is the paper's scene. "box" is a room of its own for every pair, with the landmarks
        uniform on the area of its walls, floor and ceiling; see the notes.
    field_of_view : (float, float), optional
        Horizontal and vertical angle in (0, pi) of perspective cameras that look along the x axes
        of their frames, radians. Default: panoramas, which see everything.
    max_turn : float
        With a limited field of view R's heading differs from L's by an angle uniform in
        [-max_turn, max_turn], radians, at most pi.

    Notes
    -----
    **The room.** In the units of the unit circle, its four walls are 1.2 to 3 away from the
    origin, its floor and its ceiling 0.4 to 1.2 below and above the cameras' plane, each drawn by
    itself. Both cameras stand anywhere in it, uniform on the plane and 0.2 or more from the walls,
    so baselines are of any length, from 0 to nearly the room's diagonal.

    **Uniform headings.** Panoramas have uniform and independent ``heading_l`` and ``heading_r`` in
    both scenes, as Algorithm 2 asks for. With a limited field of view they are *not* uniform: the
    two views look roughly the same way, so that heading_l - heading_r is near pi, and the pairs
    that share landmarks are kept. Learn from those with weights against the poses' frequencies,
    as from real pairs.

    **What a limited field of view sees.** Every landmark, those of mismatches too, lies inside the
    images of *both* cameras, before noise. A pair for which one cannot be found in 2000 tries, each
    a point of the room's surface or of the cube around the ball, is drawn anew.

    References
    ----------
    O. Booij, B. Krose, Z. Zivkovic, "Efficient probabilistic planar robot motion estimation given
    pairs of images", RSS 2010, section IV-A.
    """

    mismatch: float = 0.9
    noise: float = 0.01
    max_tilt: float = 0.0
    radius: float = 2.0
    scene: Literal["ball", "box"] = "ball"
    field_of_view: tuple[float, float] | None = None
    max_turn: float = radians(30)

    def __post_init__(self) -> None:
        if not 0.0 <= self.mismatch <= 1.0:
            raise ValueError(f"mismatch: expected a share in [0, 1], got {self.mismatch}")
        for name in ("noise", "max_tilt"):
            if not 0.0 <= getattr(self, name) < np.pi / 2:
                raise ValueError(
                    f"{name}: expected radians in [0, pi/2), got {getattr(self, name)}"
                )
        if not 0.0 < self.radius < np.inf:
            raise ValueError(f"radius: expected a positive number, got {self.radius}")
        if self.scene not in ("ball", "box"):
            raise ValueError(f"scene: expected 'ball' or 'box', got {self.scene!r}")
        if self.scene == "box" and self.radius != type(self).radius:
            raise ValueError(f"radius: expected scene 'ball' with it, got {self.scene!r}")
        if not 0.0 <= self.max_turn <= pi:
            raise ValueError(f"max_turn: expected radians in [0, pi], got {self.max_turn}")
        field = self.field_of_view
        if field is None:
            if self.max_turn != type(self).max_turn:
                raise ValueError("max_turn: expected a field_of_view with it, got None")
        elif np.shape(field) != (2,) or not all(0.0 < angle < pi for angle in field):
            raise ValueError(f"field_of_view: expected two angles in (0, pi), got {field}")

    def sample_slopes(
        self, num_pairs: int, num_correspondences: int, rng: np.random.Generator | int | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Simulate pairs, with the slopes tan(elevation) that the table's r is made of.

        Parameters
        ----------
        num_pairs, num_correspondences : int
            How many pairs, and how many correspondences each.
        rng : numpy.random.Generator or int, optional

        Returns
        -------
        headings : ndarray of shape (num_pairs, 2)
            ``[heading_l, heading_r]`` of each pair, radians in [0, 2 pi).
        bearings : ndarray of shape (num_pairs, num_correspondences, 4)
            ``[azimuth_l, slope_l, azimuth_r, slope_r]``, azimuths in (-pi, pi]. The mismatches
            come first in each pair.

        Raises
        ------
        ValueError
            If a limited field of view is so small that pairs share no landmarks.
        """
        headings = np.empty((num_pairs, 2))
        bearings = np.empty((num_pairs, num_correspondences, 4))
        state = np.random.default_rng(rng).integers(0, 2**64, size=1, dtype=np.uint64)
        box = self.scene == "box"
        mismatch, noise = float(self.mismatch), float(self.noise)
        tilt, radius, turn = float(self.max_tilt), float(self.radius), float(self.max_turn)
        shared = True
        # the counter wraps around on purpose; without the compiler NumPy would warn of it
        with np.errstate(over="ignore"):
            if self.field_of_view is None:
                simulate_panoramas(state, box, mismatch, noise, tilt, radius, headings, bearings)
            else:
                width, height = (tan(0.5 * angle) for angle in self.field_of_view)
                shared = simulate_images(
                    state,
                    box,
                    mismatch,
                    noise,
                    tilt,
                    radius,
                    width,
                    height,
                    turn,
                    headings,
                    bearings,
                )
        if not shared:
            raise ValueError(
                "field_of_view: expected views that share landmarks, "
                f"got none from {PAIRS_TRIED} pairs in a row"
            )
        return headings, bearings

    def sample(
        self, num_pairs: int, num_correspondences: int, rng: np.random.Generator | int | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Simulate pairs as arrays.

        Parameters
        ----------
        num_pairs, num_correspondences : int
            How many pairs, and how many correspondences each.
        rng : numpy.random.Generator or int, optional

        Returns
        -------
        headings : ndarray of shape (num_pairs, 2)
            ``[heading_l, heading_r]`` of each pair, radians in [0, 2 pi).
        bearings : ndarray of shape (num_pairs, num_correspondences, 4)
            ``[azimuth_l, elevation_l, azimuth_r, elevation_r]``, radians, azimuths in [0, 2 pi).
            The mismatches come first in each pair.
        """
        headings, bearings = self.sample_slopes(num_pairs, num_correspondences, rng)
        bearings[..., 0::2] = wrap_to_2pi(bearings[..., 0::2])
        bearings[..., 1::2] = np.arctan(bearings[..., 1::2])
        return headings, bearings

    def pairs(
        self, num_pairs: int, num_correspondences: int, rng: np.random.Generator | int | None = None
    ) -> tuple[list[Correspondences], FloatArray]:
        """Simulate pairs for experiments with estimators: those of `sample`, in no order.

        An estimator that starts with the same random numbers for every pair would else draw true
        matches of all pairs or of none.

        Parameters
        ----------
        num_pairs, num_correspondences : int
            How many pairs, and how many correspondences each.
        rng : numpy.random.Generator or int, optional

        Returns
        -------
        pairs : list of Correspondences
        headings : ndarray of shape (num_pairs, 2)
            The true ``[heading_l, heading_r]``, radians in [0, 2 pi).
        """
        generator = np.random.default_rng(rng)
        headings, bearings = self.sample(num_pairs, num_correspondences, generator)
        order = generator.random(bearings.shape[:2]).argsort(axis=1)
        mixed = np.take_along_axis(bearings, order[..., None], axis=1)
        return [Correspondences(*pair.T) for pair in mixed], headings

    def pair(
        self, num_correspondences: int, rng: np.random.Generator | int | None = None
    ) -> tuple[Correspondences, float, float]:
        """Simulate one pair.

        Parameters
        ----------
        num_correspondences : int
        rng : numpy.random.Generator or int, optional

        Returns
        -------
        correspondences : Correspondences
            The mismatches come first.
        heading_l, heading_r : float
            The true headings, radians in [0, 2 pi).
        """
        headings, bearings = self.sample(1, num_correspondences, rng)
        return Correspondences(*bearings[0].T), float(headings[0, 0]), float(headings[0, 1])
