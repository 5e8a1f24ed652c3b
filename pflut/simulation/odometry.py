"""What wheels would have measured along a known trajectory."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import FloatArray, as_poses, compose, relative_pose, wrap_to_pi

MIN_TRANSLATION = 1e-3  # metres: below it a step is a turn on the spot


def odometry_stream(seed: int) -> np.random.Generator:
    """Give the random numbers of the odometry that is simulated along a dataset's true poses.

    Parameters
    ----------
    seed : int
        That of whatever simulates it, which has other streams for all else: a replay and a map of
        the same images get the same noise.

    Returns
    -------
    Generator
    """
    return np.random.default_rng([seed, 1])


def simulate_odometry(
    poses: ArrayLike,
    *,
    rotation_noise_from_rotation: float = 0.0025,
    rotation_noise_from_translation: float = 0.0004,
    translation_noise_from_translation: float = 0.0009,
    translation_noise_from_rotation: float = 0.0001,
    scale: float = 1.01,
    heading_drift: float = 0.005,
    rng: np.random.Generator | int | None = None,
) -> FloatArray:
    """Simulate the odometry of a differential drive.

    Each step between two poses is split into a rotation, a translation and a rotation. Each of
    them gets normal noise with a variance that grows with the motion, and the translation a
    scale and a drift of the heading that stay the same over the drive, as those of wheels of a
    slightly wrong and slightly different diameter.

    Parameters
    ----------
    poses : array_like of shape (n, 3)
        True ``[x, y, heading]`` in metres and radians, in the order of time.
    rotation_noise_from_rotation : float
        alpha1 of AMCL's model: variance of a rotation per squared radian; 0.0025 is 5 %.
    rotation_noise_from_translation : float
        alpha2: variance of a rotation in rad^2 per squared metre of translation.
    translation_noise_from_translation : float
        alpha3: variance of the translation per squared metre; 0.0009 is 3 %.
    translation_noise_from_rotation : float
        alpha4: variance of the translation in m^2 per squared radian.
    scale : float
        Measured metres per true metre.
    heading_drift : float
        Radians that the heading is wrongly measured to turn per metre.
    rng : Generator, int or None
        Of the noise.

    Returns
    -------
    ndarray of shape (n, 3)
        Measured poses in a frame that starts at the first pose: the first row is zero.

    Raises
    ------
    ValueError
        If a noise is negative, a parameter is not finite, the scale is not positive, or the poses
        are malformed.

    References
    ----------
    Thrun, Burgard, Fox, "Probabilistic Robotics" (2005), section 5.4.
    """
    alphas = np.array(
        [
            rotation_noise_from_rotation,
            rotation_noise_from_translation,
            translation_noise_from_translation,
            translation_noise_from_rotation,
        ]
    )
    if not np.isfinite([*alphas, scale, heading_drift]).all() or (alphas < 0).any() or scale <= 0:
        raise ValueError(
            "odometry: expected finite noises >= 0, a finite drift and a scale > 0, got "
            f"{alphas.tolist()}, drift {heading_drift}, scale {scale}"
        )
    true = as_poses(poses)
    steps = relative_pose(true[:-1], true[1:])
    normals = np.random.default_rng(rng).standard_normal((len(steps), 3))
    translation = np.hypot(steps[:, 0], steps[:, 1])
    moved = translation > MIN_TRANSLATION
    first = np.where(moved, np.arctan2(steps[:, 1], steps[:, 0]), 0.0)
    second = wrap_to_pi(steps[:, 2] - first)
    # driving backwards is no turn by half a revolution
    turn_1, turn_2 = (np.minimum(np.abs(a), np.pi - np.abs(a)) for a in (first, second))
    rotation = alphas[0] * np.stack([turn_1, turn_2]) ** 2 + alphas[1] * translation**2
    along = alphas[2] * translation**2 + alphas[3] * (turn_1**2 + turn_2**2)
    noisy_first = first + np.sqrt(rotation[0]) * normals[:, 0]
    length = scale * translation + np.sqrt(along) * normals[:, 1]
    noisy_second = second + np.sqrt(rotation[1]) * normals[:, 2] + heading_drift * translation
    measured = np.zeros_like(true)
    for k in range(len(steps)):
        direction = noisy_first[k]
        step = [length[k] * np.cos(direction), length[k] * np.sin(direction)]
        measured[k + 1] = compose(measured[k], [*step, direction + noisy_second[k]])
    return measured
