"""A synthetic world: landmarks with descriptors, seen from poses without any image."""

from __future__ import annotations

import numpy as np

from pflut.features import Features
from pflut.geometry import bearing_angles, wrap_to_2pi
from pflut.reference_map import ReferenceMap


def unit_rows(n: int, size: int, rng: np.random.Generator) -> np.ndarray:
    rows = rng.normal(size=(n, size))
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


class World:
    """A room of 8 x 6 m whose landmarks have random unit vectors as descriptors."""

    def __init__(self, *, landmarks: int = 150, size: int = 32, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        low, high = [-4.0, -3.0, -1.2], [4.0, 3.0, 1.3]
        self.landmarks = rng.uniform(low, high, (landmarks, 3))
        self.descriptors = unit_rows(landmarks, size, rng)

    def look(
        self,
        pose: np.ndarray,
        seed: int,
        *,
        noise: float = 0.005,
        seen: float = 0.5,
        clutter: int = 40,
    ) -> Features:
        """Features at a pose: a share of the landmarks, among others that nobody saw before."""
        rng = np.random.default_rng(seed)
        shown = rng.uniform(size=len(self.landmarks)) < seen
        offset = self.landmarks[shown] - [pose[0], pose[1], 0.0]
        azimuth, elevation = bearing_angles(offset)
        n = len(azimuth)
        azimuth = azimuth - pose[2] + noise * rng.normal(size=n) / np.cos(elevation)
        elevation = elevation + noise * rng.normal(size=n)
        descriptors = self.descriptors[shown] + 0.05 * rng.normal(
            size=(n, self.descriptors.shape[1])
        ).astype(np.float32)
        azimuth = np.concatenate([azimuth, rng.uniform(0, 6, clutter)])
        elevation = np.concatenate([elevation, rng.uniform(-0.6, 0.6, clutter)])
        rows = np.concatenate(
            [descriptors, unit_rows(clutter, self.descriptors.shape[1], rng)], dtype=np.float32
        )
        order = rng.permutation(len(azimuth))
        return Features(
            wrap_to_2pi(azimuth)[order],
            elevation.clip(-1.5, 1.5)[order],
            rows[order],
            rng.uniform(0, 500, (len(order), 2)),
            np.ones(len(order)),
        )

    def map(self, poses: np.ndarray, **options: float) -> ReferenceMap:
        """References at poses."""
        features = [self.look(pose, 1000 + i, **options) for i, pose in enumerate(poses)]
        return ReferenceMap(poses, tuple(features), tuple(f"{i}.png" for i in range(len(poses))))


REFERENCES = np.array(
    [
        [-2.0, -1.5, 0.3],
        [-2.0, 1.5, 2.0],
        [0.0, -1.4, -1.0],
        [0.1, 1.5, 3.0],
        [2.0, -1.5, 1.2],
        [2.0, 1.6, -2.2],
    ]
)
