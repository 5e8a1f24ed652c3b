"""A textured room, rendered by ray casting in plain NumPy: small images with exact ground truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pflut.camera.equirectangular import EquirectangularPanorama
from pflut.camera.mount import Mount
from pflut.datasets.folder import write_folder
from pflut.simulation.odometry import simulate_odometry

WIDTH, DEPTH, HEIGHT, EYE = 6.0, 5.0, 2.6, 1.2
CAMERA = EquirectangularPanorama(
    512, 128, elevation_min=-0.7, elevation_max=0.7, mount=Mount(height=EYE)
)
CELLS = 40.0  # texels a metre


def textures(seed: int) -> np.ndarray:
    """Make six textures (walls, floor, ceiling) of rectangles on rectangles, (6, 300, 300)."""
    rng = np.random.default_rng(seed)
    maps = np.full((6, 300, 300), 128.0)
    for face in maps:
        for _ in range(500):
            u, v = rng.integers(0, 290, 2)
            a, b = rng.integers(3, 22, 2)
            face[v : v + b, u : u + a] = rng.uniform(20, 235)
    return maps


def render(pose: np.ndarray, maps: np.ndarray) -> np.ndarray:
    """Render what the camera sees at a pose."""
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    azimuth, elevation = CAMERA.bearings(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    azimuth = azimuth + pose[2]
    ray = np.stack(
        [
            np.cos(azimuth) * np.cos(elevation),
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ]
    )
    eye = np.array([pose[0], pose[1], EYE])
    with np.errstate(divide="ignore"):
        to_high = (np.array([WIDTH, DEPTH, HEIGHT])[:, None] - eye[:, None]) / ray
        to_low = -eye[:, None] / ray
    distance = np.where(ray > 0, to_high, to_low)
    axis = distance.argmin(axis=0)
    hit = eye[:, None] + distance.min(axis=0) * ray
    columns = np.arange(ray.shape[1])
    face = 2 * axis + (ray[axis, columns] > 0)
    row = np.where(axis == 2, hit[1], hit[2]) * CELLS
    column = np.where(axis == 0, hit[1], hit[0]) * CELLS
    image = maps[face, row.astype(int) % 300, column.astype(int) % 300]
    return image.reshape(CAMERA.height, CAMERA.width).astype(np.uint8)


def drive(count: int) -> np.ndarray:
    """Give poses along an ellipse in the room, (count, 3)."""
    t = np.linspace(0.3, 4.2, count)
    poses = np.column_stack([3.0 + 1.5 * np.cos(t), 2.5 + 1.0 * np.sin(t), np.zeros(count)])
    poses[:, 2] = np.arctan2(1.0 * np.cos(t), -1.5 * np.sin(t))
    return poses


def write_room(path: Path, *, seed: int = 0, queries: int = 12, name: str = "room") -> Path:
    """Write a folder dataset: a lattice of references, then a drive with odometry."""
    rng = np.random.default_rng(seed)
    maps = textures(seed)
    x, y = np.meshgrid([1.0, 2.3, 3.7, 5.0], [1.0, 2.5, 4.0])
    references = np.column_stack([x.ravel(), y.ravel(), rng.uniform(-np.pi, np.pi, x.size)])
    driven = drive(queries)
    poses = np.concatenate([references, driven])
    odometry = np.full((len(poses), 3), np.nan)
    odometry[len(references) :] = simulate_odometry(driven, rng=rng)
    corners = np.array([[0, 0], [WIDTH, 0], [WIDTH, DEPTH], [0, DEPTH]])
    return write_folder(
        path,
        camera=CAMERA,
        stamps=np.arange(len(poses), dtype=float),
        images=(render(pose, maps) for pose in poses),
        ground_truth=poses,
        odometry=odometry,
        reference_indices=np.arange(len(references)),
        floor_plan=np.stack([corners, np.roll(corners, -1, axis=0)], axis=1),
        name=name,
    )
