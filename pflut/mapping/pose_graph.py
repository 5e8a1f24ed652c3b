"""Pose graphs on the plane: odometry from image to image, and links between images."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.geometry import FloatArray, as_poses, relative_pose
from pflut.localization.motion import DifferentialDrive, Omnidirectional
from pflut.mapping.links import Links

IndexArray = NDArray[np.int64]

ODOMETRY_NOISE = DifferentialDrive(
    rotation_noise_from_rotation=0.005625,
    rotation_noise_from_translation=0.0009,
    translation_noise_from_translation=0.002025,
    translation_noise_from_rotation=0.000225,
    position_noise=0.005,
    heading_noise=0.002,
)
"""What odometry is believed by default: rotations to 7.5 % and 0.03 rad a metre, translations to
4.5 % and 1.5 cm a radian, each step to 5 mm and 0.002 rad. One and a half times the noise of
`simulate_odometry`, whose scale and drift are no noise."""


def _no_links() -> Links:
    return Links.concatenate([])


def _no_ids() -> IndexArray:
    return np.empty(0, np.int64)


@dataclass(frozen=True, eq=False)
class PoseGraph:
    """Where images were taken, and what is known of that.

    Parameters
    ----------
    poses : array_like of shape (n, 3)
        The nodes: ``[x, y, heading]`` as they are supposed at first, metres and radians.
    odometry_nodes : array_like of shape (k, 2), int
        The node before and the one after each measured motion, from 0 to n - 1.
    odometry : array_like of shape (k, 3)
        The motions in the robot's frame before.
    odometry_information : array_like of shape (k, 3, 3)
        Inverse covariances of ``(x, y, heading)`` in the frame *after* the measured motion, as
        g2o and GTSAM take them.
    links : Links
        Between images: their indices are ids of nodes.
    ids : array_like of shape (n,), int, optional
        The image of each node, ascending. Default: 0, 1, ...
    fixed : int
        The node that stays where it is: the graph tells nothing of where all of it lies.

    Raises
    ------
    ValueError
        If shapes do not fit, an index is none, the ids do not ascend, or an information matrix is
        not symmetric and positive definite.
    """

    poses: FloatArray
    odometry_nodes: IndexArray
    odometry: FloatArray
    odometry_information: FloatArray
    links: Links = field(default_factory=_no_links)
    ids: IndexArray = field(default_factory=_no_ids)
    fixed: int = 0

    def __post_init__(self) -> None:
        poses = as_poses(self.poses)
        n, k = len(poses), len(self.odometry)
        motions = as_poses(self.odometry, "odometry") if k else np.empty((0, 3))
        ids = np.ascontiguousarray(self.ids, dtype=np.int64)
        if not ids.size:
            ids = np.arange(n)
        nodes = np.ascontiguousarray(self.odometry_nodes, dtype=np.int64)
        information = np.ascontiguousarray(self.odometry_information, dtype=np.float64)
        for name, value, shape in (
            ("odometry_nodes", nodes, (k, 2)),
            ("odometry_information", information, (k, 3, 3)),
            ("ids", ids, (n,)),
        ):
            if value.shape != shape:
                raise ValueError(f"{name}: expected shape {shape}, got {value.shape}")
        if k and (nodes.min() < 0 or nodes.max() >= n):
            raise ValueError(f"odometry_nodes: expected numbers below {n}, got {nodes.max()}")
        if (np.diff(ids) <= 0).any():
            raise ValueError("ids: expected numbers that ascend")
        if not 0 <= self.fixed < n:
            raise ValueError(f"fixed: expected one of {n} nodes, got {self.fixed}")
        unknown = ~np.isin(self.links.indices, ids)
        if unknown.any():
            raise ValueError(f"links: no node has the id {self.links.indices[unknown][0]}")
        symmetric = np.allclose(information, information.transpose(0, 2, 1), rtol=1e-6)
        if not symmetric or (np.linalg.eigvalsh(information) <= 0.0).any():
            raise ValueError("odometry_information: expected symmetric positive definite matrices")
        for name, array in (
            ("poses", poses),
            ("odometry_nodes", nodes),
            ("odometry", motions),
            ("odometry_information", information),
            ("ids", ids),
        ):
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        """Return the number of nodes."""
        return len(self.poses)

    @property
    def link_nodes(self) -> IndexArray:
        """The nodes L and R of each link, from 0 to n - 1, of shape (m, 2)."""
        return np.asarray(np.searchsorted(self.ids, self.links.indices), dtype=np.int64)

    @classmethod
    def from_odometry(
        cls,
        odometry: ArrayLike,
        links: Links | None = None,
        *,
        noise: DifferentialDrive | Omnidirectional = ODOMETRY_NOISE,
        ids: ArrayLike | None = None,
    ) -> PoseGraph:
        """Make a graph of a drive: its nodes lie where odometry alone puts them.

        Parameters
        ----------
        odometry : array_like of shape (n, 3)
            Poses in a frame of the odometry's own, one an image, in the order of time.
        links : Links, optional
            Those with an image that is no node are left out.
        noise : DifferentialDrive or Omnidirectional
            Gives the variances of each motion.
        ids : array_like of shape (n,), int, optional
            The image of each pose. Default: 0, 1, ...

        Returns
        -------
        PoseGraph
            With its first node fixed.

        Raises
        ------
        ValueError
            If the poses are malformed, or the noise leaves a motion without variance.
        """
        poses = as_poses(odometry, "odometry")
        before = np.arange(len(poses) - 1)
        motions = relative_pose(poses[:-1], poses[1:])
        information = [motion_information(motion, noise) for motion in motions]
        images = np.arange(len(poses)) if ids is None else np.asarray(ids, dtype=np.int64)
        between = _no_links() if links is None else links
        return cls(
            poses,
            np.stack([before, before + 1], axis=1),
            motions,
            np.array(information).reshape(-1, 3, 3),
            between[np.flatnonzero(np.isin(between.indices, images).all(axis=1))],
            images,
        )

    def with_links(self, links: Links) -> PoseGraph:
        """Return the same graph with other links."""
        return replace(self, links=links)

    def with_poses(self, poses: ArrayLike) -> PoseGraph:
        """Return the same graph with its nodes elsewhere, (n, 3)."""
        return replace(self, poses=np.asarray(poses, dtype=np.float64))


def motion_information(
    motion: ArrayLike, noise: DifferentialDrive | Omnidirectional = ODOMETRY_NOISE
) -> FloatArray:
    """Give the information of an odometry increment, to first order.

    Parameters
    ----------
    motion : array_like of shape (3,)
        ``[dx, dy, dheading]`` in the robot's own old frame.
    noise : DifferentialDrive or Omnidirectional

    Returns
    -------
    ndarray of shape (3, 3)
        Inverse covariance of ``(x, y, heading)`` in the frame after the motion.

    Raises
    ------
    ValueError
        If the noise leaves a direction without variance.
    """
    moved, _, covariance = noise.increment(motion).linearized(np.zeros(3))
    cos, sin = np.cos(moved[2]), np.sin(moved[2])
    to_new = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    covariance = to_new @ covariance @ to_new.T
    if np.linalg.eigvalsh(covariance)[0] <= 1e-12:
        raise ValueError(
            f"noise: expected some in every direction, got none for the motion {np.asarray(motion)}"
            " (position_noise and heading_noise are floors)"
        )
    information = np.linalg.inv(covariance)
    return np.asarray(0.5 * (information + information.T))
