"""Odometry motion models: particles moved by what the wheels say, with noise."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut._jit import jit
from pflut._random import normals
from pflut.geometry import TWO_PI, FloatArray, as_poses, wrap_to_pi

HALF_PI = 0.5 * np.pi
BLOCK = 512
"""Poses at a time, whose normal numbers stay in the first cache."""
SingleArray = NDArray[np.float32]


class MotionModel(Protocol):
    """What the particle filter asks of a motion model."""

    def sample(
        self, poses: FloatArray, odometry: ArrayLike, rng: np.random.Generator | int | None = None
    ) -> FloatArray:
        """Move each pose by the odometry and by noise of its own.

        Parameters
        ----------
        poses : ndarray of shape (N, 3)
            ``[x, y, heading]``; left as they are.
        odometry : array_like of shape (3,)
            The motion in the robot's own old frame, ``geometry.relative_pose(before, after)``.
        rng : numpy.random.Generator or int, optional

        Returns
        -------
        ndarray of shape (N, 3)
            A new array.
        """
        ...  # pragma: no cover


@jit
def _move(
    poses: FloatArray,
    direction_normals: SingleArray,
    along_normals: SingleArray,
    lateral_normals: SingleArray,
    heading_normals: SingleArray,
    motion: FloatArray,
    stds: FloatArray,
    out: FloatArray,
) -> None:
    """Translate along a noisy direction, then turn: O(N).

    ``motion`` is ``[direction, translation, rotation]`` in the robot's frame, ``stds`` those of
    direction, along, lateral and heading. The noise of the direction turns the robot as well.
    The sine and cosine are written out (Taylor on [-pi/4, pi/4], to the last bit or two of an
    angle in (-2 pi, 2 pi)) because the library's are calls, and the compiler vectorises no loop
    with a call: three times faster.
    """
    direction, translation, rotation = motion[0], motion[1], motion[2]
    std_direction, std_along, std_lateral, std_heading = stds[0], stds[1], stds[2], stds[3]
    for i in range(poses.shape[0]):
        turned = poses[i, 2] + direction_normals[i] * std_direction
        along = translation + along_normals[i] * std_along
        lateral = lateral_normals[i] * std_lateral

        angle = turned + direction
        quarter_turns = np.rint(angle * (2.0 / np.pi))
        a = angle - quarter_turns * HALF_PI
        a2 = a * a
        s = -1.0 / 39916800.0 + a2 * (1.0 / 6227020800.0 - a2 / 1307674368000.0)
        s = -1.0 / 6.0 + a2 * (1.0 / 120.0 + a2 * (-1.0 / 5040.0 + a2 * (1.0 / 362880.0 + a2 * s)))
        s = a + a * a2 * s
        c = 1.0 / 479001600.0 + a2 * (-1.0 / 87178291200.0 + a2 / 20922789888000.0)
        c = -1.0 / 720.0 + a2 * (1.0 / 40320.0 + a2 * (-1.0 / 3628800.0 + a2 * c))
        c = 1.0 - a2 * (0.5 - a2 * (1.0 / 24.0 + a2 * c))
        quadrant = int(quarter_turns)
        odd = (quadrant & 1) != 0
        sin = c if odd else s
        cos = s if odd else c
        sin = -sin if (quadrant & 2) != 0 else sin
        cos = -cos if ((quadrant + 1) & 2) != 0 else cos

        out[i, 0] = poses[i, 0] + along * cos - lateral * sin
        out[i, 1] = poses[i, 1] + along * sin + lateral * cos
        heading = turned + rotation + heading_normals[i] * std_heading
        wrapped = heading - TWO_PI * np.ceil((heading - np.pi) * (0.5 / np.pi))
        out[i, 2] = heading if (heading > -np.pi) & (heading <= np.pi) else wrapped


@jit
def _sample(
    poses: FloatArray, key: np.uint64, motion: FloatArray, stds: FloatArray, out: FloatArray
) -> None:
    """Move each pose as `_move` does, with normal numbers of the key's sequence: O(N)."""
    count = poses.shape[0]
    work, drawn = np.empty((4, BLOCK), np.float32), np.empty((4, BLOCK), np.float32)
    bits = work.view(np.int32)
    for first in range(0, count, BLOCK):
        last = min(first + BLOCK, count)
        # whole blocks, which are contiguous; of the last one the rest is not used
        normals(key, first, work, bits, drawn[0], drawn[1])
        normals(key, count + first, work, bits, drawn[2], drawn[3])
        _move(
            poses[first:last], drawn[0], drawn[1], drawn[2], drawn[3], motion, stds, out[first:last]
        )


def as_odometry(odometry: ArrayLike) -> tuple[float, float, float]:
    """Check an odometry increment and give its three numbers."""
    motion = np.asarray(odometry, dtype=np.float64)
    if motion.shape != (3,) or not np.isfinite(motion).all():
        raise ValueError(f"odometry: expected 3 finite numbers [dx, dy, dheading], got {motion}")
    return float(motion[0]), float(motion[1]), float(motion[2])


def _check_parameters(model: DifferentialDrive | Omnidirectional) -> None:
    """Refuse parameters that are negative or not finite."""
    for field in fields(model):
        value = getattr(model, field.name)
        if not (np.isfinite(value) and value >= 0.0):
            raise ValueError(f"{field.name}: expected a finite number >= 0, got {value}")


@dataclass(frozen=True)
class Increment:
    """A motion and the variances of its noise: translate along a direction, then turn.

    Parameters
    ----------
    direction, translation, rotation : float
        Of the translation in the robot's old frame (radians, metres); the change of heading.
    variances : tuple of 4 floats
        Of independent normal noise: of the direction, which turns the robot as well; along the
        translation and across it; of the heading.
    """

    direction: float
    translation: float
    rotation: float
    variances: tuple[float, float, float, float]

    def sample(self, poses: ArrayLike, rng: np.random.Generator | int | None = None) -> FloatArray:
        """Move poses by it, each with noise of its own.

        Parameters
        ----------
        poses : array_like of shape (N, 3)
        rng : numpy.random.Generator or int, optional

        Returns
        -------
        ndarray of shape (N, 3)
            Headings in (-pi, pi].
        """
        particles = as_poses(poses)
        key = np.random.default_rng(rng).integers(2**64, dtype=np.uint64)
        out = np.empty_like(particles)
        motion = np.array([self.direction, self.translation, self.rotation])
        _sample(particles, key, motion, np.sqrt(np.array(self.variances)), out)
        return out

    def linearized(self, pose: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Move one pose without noise, and say to first order what comes of its uncertainty.

        Parameters
        ----------
        pose : ndarray of shape (3,)

        Returns
        -------
        moved : ndarray of shape (3,)
            Heading in (-pi, pi].
        jacobian : ndarray of shape (3, 3)
            Of the new pose with respect to the old one.
        covariance : ndarray of shape (3, 3)
            Of the new pose where the old one is known: the four noises, seen in the world.
        """
        angle = pose[2] + self.direction
        cos, sin, d = np.cos(angle), np.sin(angle), self.translation
        moved = np.add(pose, [d * cos, d * sin, self.rotation])
        moved[2] = wrap_to_pi(moved[2])
        jacobian = np.array([[1.0, 0.0, -d * sin], [0.0, 1.0, d * cos], [0.0, 0.0, 1.0]])
        noise = np.array([[-d * sin, cos, -sin, 0.0], [d * cos, sin, cos, 0.0], [1.0, 0, 0, 1.0]])
        return moved, jacobian, (noise * self.variances) @ noise.T


@dataclass(frozen=True, kw_only=True)
class DifferentialDrive:
    """Rotate, translate, rotate: the odometry model of a robot that cannot move sideways.

    The increment is split into a first rotation (towards where it went), a translation, and a
    second rotation (to where it looks now); each gets normal noise of its own, with variances

        first        rotation_noise_from_rotation first^2  + rotation_noise_from_translation d^2
        translation  translation_noise_from_translation d^2
                     + translation_noise_from_rotation (first^2 + second^2)
        second       rotation_noise_from_rotation second^2 + rotation_noise_from_translation d^2

    Parameters
    ----------
    rotation_noise_from_rotation : float
        alpha1 (AMCL's ``odom_alpha1``), no unit: 0.02 is a standard deviation of 14 %.
    rotation_noise_from_translation : float
        alpha2, rad^2 / m^2.
    translation_noise_from_translation : float
        alpha3, no unit.
    translation_noise_from_rotation : float
        alpha4, m^2 / rad^2.
    position_noise, heading_noise : float
        Standard deviations (metres on each axis, radians) added to every step, moved or not:
        a floor that keeps particles apart when the odometry claims to be perfect.
    min_translation : float
        Metres. Below it the direction of the translation is taken for noise of the encoders:
        there is no first rotation to add noise for.

    Raises
    ------
    ValueError
        If a parameter is negative or not finite.

    Notes
    -----
    As in nav2_amcl and beluga, driving backwards is no turn: for the noise a rotation counts by
    how far it is from 0 or from pi, whichever is nearer. Unlike there, the mean motion is the
    odometry itself also below ``min_translation`` (they then drive straight on).

    The standard deviations, not the variances, grow with the distance: noise of a drive cut
    into n steps is sqrt(n) times smaller than that of one step (it averages out). Choose
    parameters for the step length in use.

    References
    ----------
    Thrun, Burgard, Fox, "Probabilistic Robotics" (2005), section 5.4.2, table 5.6 (where the
    last two are numbered as here).
    """

    rotation_noise_from_rotation: float = 0.02
    rotation_noise_from_translation: float = 0.005
    translation_noise_from_translation: float = 0.02
    translation_noise_from_rotation: float = 0.002
    position_noise: float = 0.0
    heading_noise: float = 0.0
    min_translation: float = 0.01

    def __post_init__(self) -> None:
        _check_parameters(self)

    def sample(
        self, poses: ArrayLike, odometry: ArrayLike, rng: np.random.Generator | int | None = None
    ) -> FloatArray:
        """Move each pose by the odometry and by noise of its own (table 5.6).

        Parameters
        ----------
        poses : array_like of shape (N, 3)
            ``[x, y, heading]``; left as they are.
        odometry : array_like of shape (3,)
            ``[dx, dy, dheading]``, the motion in the robot's own old frame.
        rng : numpy.random.Generator or int, optional

        Returns
        -------
        ndarray of shape (N, 3)
            Headings in (-pi, pi].

        Raises
        ------
        ValueError
            If the poses or the odometry have another shape or are not finite.
        """
        return self.increment(odometry).sample(poses, rng)

    def increment(self, odometry: ArrayLike) -> Increment:
        """Split an odometry increment and give each part its noise.

        Parameters
        ----------
        odometry : array_like of shape (3,)
            ``[dx, dy, dheading]``, the motion in the robot's own old frame.

        Returns
        -------
        Increment

        Raises
        ------
        ValueError
            If it is not three finite numbers.
        """
        dx, dy, rotation = as_odometry(odometry)
        translation = float(np.hypot(dx, dy))
        first = float(np.arctan2(dy, dx)) if translation > 0.0 else 0.0
        if translation >= self.min_translation:
            first2 = _from_a_line(first) ** 2
            second2 = _from_a_line(rotation - first) ** 2
        else:
            first2, second2 = 0.0, _from_zero(rotation) ** 2
        rotated, moved = self.rotation_noise_from_rotation, self.rotation_noise_from_translation
        floor = self.position_noise**2  # isotropic: the same along and across the motion
        variances = (
            rotated * first2 + moved * translation**2,
            self.translation_noise_from_translation * translation**2
            + self.translation_noise_from_rotation * (first2 + second2)
            + floor,
            floor,
            rotated * second2 + moved * translation**2 + self.heading_noise**2,
        )
        return Increment(first, translation, rotation, variances)


@dataclass(frozen=True, kw_only=True)
class Omnidirectional:
    """Translate in any direction while turning: a holonomic robot, noise also sideways.

    With the translation d and the rotation r of the increment, the variances are

        along    translation_noise_from_translation d^2 + translation_noise_from_rotation r^2
        sideways strafe_noise_from_translation d^2      + translation_noise_from_rotation r^2
        heading  rotation_noise_from_rotation r^2       + rotation_noise_from_translation d^2

    Parameters
    ----------
    rotation_noise_from_rotation : float
        alpha1, no unit.
    rotation_noise_from_translation : float
        alpha2, rad^2 / m^2.
    translation_noise_from_translation : float
        alpha3, no unit.
    translation_noise_from_rotation : float
        alpha4, m^2 / rad^2.
    strafe_noise_from_translation : float
        alpha5, no unit: noise across the direction of motion.
    position_noise, heading_noise : float
        Standard deviations (metres on each axis, radians) added to every step.

    Raises
    ------
    ValueError
        If a parameter is negative or not finite.

    Notes
    -----
    The words say what each parameter does, as in beluga. nav2_amcl's model of the same name uses
    alpha1 for the translation's noise from rotation and alpha4 for the rotation's.
    """

    rotation_noise_from_rotation: float = 0.02
    rotation_noise_from_translation: float = 0.005
    translation_noise_from_translation: float = 0.02
    translation_noise_from_rotation: float = 0.002
    strafe_noise_from_translation: float = 0.02
    position_noise: float = 0.0
    heading_noise: float = 0.0

    def __post_init__(self) -> None:
        _check_parameters(self)

    def sample(
        self, poses: ArrayLike, odometry: ArrayLike, rng: np.random.Generator | int | None = None
    ) -> FloatArray:
        """Move each pose by the odometry and by noise of its own.

        Parameters
        ----------
        poses : array_like of shape (N, 3)
            ``[x, y, heading]``; left as they are.
        odometry : array_like of shape (3,)
            ``[dx, dy, dheading]``, the motion in the robot's own old frame.
        rng : numpy.random.Generator or int, optional

        Returns
        -------
        ndarray of shape (N, 3)
            Headings in (-pi, pi].

        Raises
        ------
        ValueError
            If the poses or the odometry have another shape or are not finite.
        """
        return self.increment(odometry).sample(poses, rng)

    def increment(self, odometry: ArrayLike) -> Increment:
        """Split an odometry increment and give each part its noise.

        Parameters
        ----------
        odometry : array_like of shape (3,)
            ``[dx, dy, dheading]``, the motion in the robot's own old frame.

        Returns
        -------
        Increment

        Raises
        ------
        ValueError
            If it is not three finite numbers.
        """
        dx, dy, rotation = as_odometry(odometry)
        translation = float(np.hypot(dx, dy))
        direction = float(np.arctan2(dy, dx)) if translation > 0.0 else 0.0
        moved2, turned2 = translation**2, _from_zero(rotation) ** 2
        from_turning = self.translation_noise_from_rotation * turned2 + self.position_noise**2
        variances = (
            0.0,
            self.translation_noise_from_translation * moved2 + from_turning,
            self.strafe_noise_from_translation * moved2 + from_turning,
            self.rotation_noise_from_rotation * turned2
            + self.rotation_noise_from_translation * moved2
            + self.heading_noise**2,
        )
        return Increment(direction, translation, rotation, variances)


def _from_zero(angle: float) -> float:
    """Give how far an angle is from no turn at all, in [0, pi]."""
    return abs(np.pi - (np.pi - angle) % TWO_PI)


def _from_a_line(angle: float) -> float:
    """Give how far an angle is from 0 or from pi, in [0, pi/2]: backwards is no turn."""
    turn = _from_zero(angle)
    return min(turn, np.pi - turn)
