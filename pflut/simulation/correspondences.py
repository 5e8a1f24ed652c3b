"""The paper's simulator: two cameras on a circle around a ball of landmarks.

Landmarks are uniform in a ball of radius 2 around the origin; both cameras stand on the unit
circle of the plane with random headings; every bearing gets isotropic normal noise on the
sphere; a share of the correspondences are mismatches, each made of the projections of two
different landmarks (Booij et al. 2010, section IV-A).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pflut._jit import jit
from pflut._trig import fast_arctan2
from pflut.correspondences import Correspondences
from pflut.geometry import TWO_PI, FloatArray, wrap_to_2pi


@jit
def _uniform(state):  # type: ignore[no-untyped-def]
    """Draw from [0, 1): splitmix64, a counter with a mixing function, cheap to start anywhere."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return (z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@jit
def _two_normals(state):  # type: ignore[no-untyped-def]
    """Draw two independent standard normals (Marsaglia's polar method)."""
    while True:
        a = 2.0 * _uniform(state) - 1.0
        b = 2.0 * _uniform(state) - 1.0
        s = a * a + b * b
        if 0.0 < s < 1.0:
            scale = np.sqrt(-2.0 * np.log(s) / s)
            return scale * a, scale * b


@jit
def _ball_point(state, radius):  # type: ignore[no-untyped-def]
    """Draw a point uniform in a ball by rejection from the cube."""
    while True:
        x = 2.0 * _uniform(state) - 1.0
        y = 2.0 * _uniform(state) - 1.0
        z = 2.0 * _uniform(state) - 1.0
        if x * x + y * y + z * z <= 1.0:
            return radius * x, radius * y, radius * z


@jit
def _noisy_bearing(state, x, y, z, noise, cos_roll, sin_roll, cos_pitch, sin_pitch):  # type: ignore[no-untyped-def]
    """Project a point given in the camera's frame: tilt, noise, then azimuth and slope."""
    y, z = cos_roll * y - sin_roll * z, sin_roll * y + cos_roll * z
    x, z = cos_pitch * x + sin_pitch * z, cos_pitch * z - sin_pitch * x
    planar = np.sqrt(x * x + y * y)
    # The noise lies in the sphere's tangent plane: across, and towards the zenith. Everything is
    # scaled by the landmark's distance, which cancels in both angles.
    across, upward = _two_normals(state)
    across *= noise * np.sqrt(planar * planar + z * z)
    radial = planar - noise * upward * z
    height = z + noise * upward * planar
    azimuth = fast_arctan2(y * radial + x * across, x * radial - y * across)
    return azimuth, height / np.sqrt(radial * radial + across * across)


@jit
def _simulate(state, mismatch, noise, max_tilt, radius, headings, bearings):  # type: ignore[no-untyped-def]
    """Fill headings (pairs, 2) and bearings (pairs, n, 4: azimuth and slope of L, then of R)."""
    pairs, n, _ = bearings.shape
    num_mismatches = int(np.round(mismatch * n))
    for p in range(pairs):
        angle_l = TWO_PI * _uniform(state)
        angle_r = TWO_PI * _uniform(state)
        x_l, y_l = np.cos(angle_l), np.sin(angle_l)
        x_r, y_r = np.cos(angle_r), np.sin(angle_r)
        yaw_l = TWO_PI * _uniform(state)
        yaw_r = TWO_PI * _uniform(state)
        cos_l, sin_l = np.cos(yaw_l), np.sin(yaw_l)
        cos_r, sin_r = np.cos(yaw_r), np.sin(yaw_r)
        roll = max_tilt * (2.0 * _uniform(state) - 1.0)
        pitch = max_tilt * (2.0 * _uniform(state) - 1.0)
        cos_roll, sin_roll = np.cos(roll), np.sin(roll)
        cos_pitch, sin_pitch = np.cos(pitch), np.sin(pitch)
        direction = np.arctan2(y_r - y_l, x_r - x_l)
        headings[p, 0] = (direction - yaw_l) % TWO_PI
        headings[p, 1] = (direction + np.pi - yaw_r) % TWO_PI
        for i in range(n):
            x, y, z = _ball_point(state, radius)
            dx, dy = x - x_l, y - y_l
            bearings[p, i, 0], bearings[p, i, 1] = _noisy_bearing(
                state,
                cos_l * dx + sin_l * dy,
                cos_l * dy - sin_l * dx,
                z,
                noise,
                1.0,
                0.0,
                1.0,
                0.0,
            )
            if i < num_mismatches:
                x, y, z = _ball_point(state, radius)
            dx, dy = x - x_r, y - y_r
            bearings[p, i, 2], bearings[p, i, 3] = _noisy_bearing(
                state,
                cos_r * dx + sin_r * dy,
                cos_r * dy - sin_r * dx,
                z,
                noise,
                cos_roll,
                sin_roll,
                cos_pitch,
                sin_pitch,
            )


@dataclass(frozen=True)
class CorrespondenceSimulator:
    """Pairs of views with known relative pose and simulated correspondences.

    Parameters
    ----------
    mismatch : float
        Share of the correspondences whose two bearings show different landmarks, in [0, 1].
    noise : float
        Standard deviation of the bearing noise, radians, isotropic on the sphere.
    max_tilt : float
        The view R gets a roll and a pitch uniform in [-max_tilt, max_tilt], radians.
    radius : float
        Radius of the ball of landmarks; the cameras stand on the unit circle.

    References
    ----------
    O. Booij, B. Krose, Z. Zivkovic, "Efficient probabilistic planar robot motion estimation given
    pairs of images", RSS 2010, section IV-A.
    """

    mismatch: float = 0.9
    noise: float = 0.01
    max_tilt: float = 0.0
    radius: float = 2.0

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
        """
        headings = np.empty((num_pairs, 2))
        bearings = np.empty((num_pairs, num_correspondences, 4))
        state = np.random.default_rng(rng).integers(0, 2**64, size=1, dtype=np.uint64)
        # the counter wraps around on purpose; without the compiler NumPy would warn of it
        with np.errstate(over="ignore"):
            _simulate(
                state,
                float(self.mismatch),
                float(self.noise),
                float(self.max_tilt),
                float(self.radius),
                headings,
                bearings,
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
