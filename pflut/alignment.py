"""Trajectories laid over the truth before they are compared: a map's frame is its own."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import FloatArray, as_poses, compose, relative_pose, wrap_to_pi


def align_poses(
    estimates: ArrayLike, ground_truth: ArrayLike, *, scale: bool = False
) -> FloatArray:
    """Move estimated poses as a whole so that their positions fit the true ones best.

    Parameters
    ----------
    estimates, ground_truth : array_like of shape (n, 3)
        ``[x, y, heading]`` of the same images, metres and radians; what is NaN in either of them
        is not looked at.
    scale : bool
        Whether they are also made larger or smaller: images do not tell the size of a map.

    Returns
    -------
    ndarray of shape (n, 3)
        The estimates, turned and shifted.

    Raises
    ------
    ValueError
        If the shapes differ or fewer than two poses are known in both.

    References
    ----------
    Umeyama, "Least-squares estimation of transformation parameters between two point patterns",
    IEEE Transactions on Pattern Analysis and Machine Intelligence 13 (1991), on the plane.
    """
    estimate = np.asarray(estimates, dtype=np.float64)
    truth = np.asarray(ground_truth, dtype=np.float64)
    if estimate.ndim != 2 or estimate.shape[1] != 3 or estimate.shape != truth.shape:
        raise ValueError(
            f"estimates, ground_truth: expected the same shape (n, 3), got {estimate.shape} and "
            f"{truth.shape}"
        )
    known = np.isfinite(estimate).all(axis=1) & np.isfinite(truth).all(axis=1)
    if known.sum() < 2:
        raise ValueError(f"ground_truth: expected 2 known poses at least, got {known.sum()}")
    middle, true_middle = estimate[known, :2].mean(axis=0), truth[known, :2].mean(axis=0)
    a, b = estimate[known, :2] - middle, truth[known, :2] - true_middle
    turn = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    cos, sin = np.cos(turn), np.sin(turn)
    size = 1.0
    if scale and (a**2).sum() > 0.0:
        size = float((b * (a @ np.array([[cos, sin], [-sin, cos]]))).sum() / (a**2).sum())
    moved = estimate.copy()
    turned = (estimate[:, :2] - middle) @ np.array([[cos, sin], [-sin, cos]])
    moved[:, :2] = size * turned + true_middle
    moved[:, 2] = wrap_to_pi(estimate[:, 2] + turn)
    return moved


def relative_errors(
    estimates: ArrayLike, ground_truth: ArrayLike, *, steps: int = 1
) -> tuple[FloatArray, FloatArray]:
    """Compare estimated motions with the true ones; needs no alignment.

    Parameters
    ----------
    estimates, ground_truth : array_like of shape (n, 3)
        Of the same images in the order of time.
    steps : int
        Images from the beginning of a motion to its end.

    Returns
    -------
    position : ndarray of shape (n - steps,)
        Distance between the ends of both motions when they begin in one pose, metres.
    heading : ndarray of shape (n - steps,)
        Estimated turn minus the true one, radians in (-pi, pi].

    Raises
    ------
    ValueError
        If the poses are malformed, or there are too few of them for one motion.
    """
    estimate, truth = as_poses(estimates, "estimates"), as_poses(ground_truth, "ground_truth")
    if estimate.shape != truth.shape or not 1 <= steps < len(truth):
        raise ValueError(
            f"steps: expected 1 to less than the number of poses, got {steps} with "
            f"{len(estimate)} and {len(truth)} poses"
        )
    ends = (poses[:-steps] for poses in (estimate, truth))
    motion, true_motion = (
        relative_pose(before, after)
        for before, after in zip(ends, (estimate[steps:], truth[steps:]), strict=True)
    )
    error = compose(relative_pose(true_motion, np.zeros(3)), motion)
    return np.hypot(error[:, 0], error[:, 1]), np.asarray(error[:, 2])
