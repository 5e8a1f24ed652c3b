"""Localize one image in the whole map, with no idea of where the robot is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pflut.correspondences import ReferenceMatch
from pflut.geometry import TWO_PI, FloatArray, wrap_to_pi
from pflut.likelihood.table import bearing_columns
from pflut.localization.estimate import Estimate, estimate_from_particles
from pflut.localization.initial_poses import Bounds, check_bounds
from pflut.localization.reference_image_model import ReferenceImageModel
from pflut.relpose.refine import CUTOFFS, STEPS_PER_CUTOFF
from pflut.relpose.refine_kernels import refine_pose


def pose_lattice(
    bounds: tuple[float, float, float, float], *, spacing: float, num_headings: int
) -> FloatArray:
    """Return poses on a regular lattice.

    Parameters
    ----------
    bounds : tuple (xmin, ymin, xmax, ymax)
        Metres.
    spacing : float
        Metres between positions.
    num_headings : int
        Headings at every position, over the whole circle.

    Returns
    -------
    ndarray of shape (N, 3)

    Raises
    ------
    ValueError
        If the bounds are empty or the spacing is not positive.
    """
    check_bounds(bounds)
    low_x, low_y, high_x, high_y = bounds
    if not spacing > 0.0 or num_headings < 1:
        raise ValueError(
            f"expected a positive spacing and at least one heading, got {spacing}, {num_headings}"
        )

    def axis_to(low: float, high: float) -> FloatArray:
        # the step that just reaches the end, not one more for a rounding
        steps = int(np.ceil((high - low) / spacing - 1e-9))
        return low + spacing * np.arange(steps + 1, dtype=np.float64)

    x, y = axis_to(low_x, high_x), axis_to(low_y, high_y)
    heading = wrap_to_pi(np.arange(num_headings) * (TWO_PI / num_headings))
    grid = np.meshgrid(x, y, heading, indexing="ij")
    return np.stack([axis.ravel() for axis in grid], axis=1)


@dataclass(frozen=True)
class GlobalSearch:
    """Localize single images: the sensor model on a lattice of poses, then polished.

    Parameters
    ----------
    sensor : ReferenceImageModel
    bounds : tuple (xmin, ymin, xmax, ymax), optional
        Metres; by default the references' rectangle and ``margin``.
    margin : float
        Metres.
    spacing : float
        Metres between positions of the lattice.
    num_headings : int
        Headings of the lattice.
    noise : float
        Standard deviation of the bearings, radians, for the polish.
    """

    sensor: ReferenceImageModel
    bounds: Bounds | None = None
    margin: float = 1.0
    spacing: float = 0.1
    num_headings: int = 120
    noise: float = 0.01

    def localize(self, observation: Any) -> Estimate:
        """Find the pose that an image was taken at.

        Parameters
        ----------
        observation : Features or image

        Returns
        -------
        Estimate
            Its ``confidence`` is the share of the posterior within 0.5 m and 10 degrees: low
            where several places look alike, or nothing was recognised.
        """
        bounds = self.bounds or self.sensor.reference_map.bounds(self.margin)
        lattice = pose_lattice(bounds, spacing=self.spacing, num_headings=self.num_headings)
        matches = self.sensor.match(lattice, observation)
        log_likelihood = self.sensor.log_likelihood_of_matches(lattice, matches)
        estimate = estimate_from_particles(lattice, log_likelihood)
        return replace(estimate, pose=self._polished(estimate.pose, matches))

    def _polished(self, pose: FloatArray, matches: list[ReferenceMatch]) -> FloatArray:
        """Polish a pose with all matches; keep it where they pull it out of its own cluster."""
        if not matches:
            return pose
        bearings = np.ascontiguousarray(
            np.concatenate([bearing_columns(m.correspondences) for m in matches], axis=1).T
        )
        owners = np.repeat(np.arange(len(matches)), [len(m.correspondences) for m in matches])
        references = self.sensor.reference_map.poses[[m.index for m in matches]]
        polished = pose.copy()
        refine_pose(
            bearings,
            owners,
            references,
            self.noise * CUTOFFS,
            STEPS_PER_CUTOFF,
            polished,
            np.zeros((3, 3)),
        )
        polished[2] = wrap_to_pi(polished[2])
        moved = np.hypot(*(polished[:2] - pose[:2]))
        turned = abs(wrap_to_pi(polished[2] - pose[2]))
        return polished if moved < 0.5 and turned < np.deg2rad(10.0) else pose
