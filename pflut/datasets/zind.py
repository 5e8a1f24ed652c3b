"""The Zillow Indoor Dataset (ZInD): panoramas of unfurnished homes with a floor plan.

S. Cruz et al., "Zillow Indoor Dataset: annotated floor plans with 360 degree panoramas and 3D room
layouts", CVPR 2021. A home is a folder with ``zind_data.json`` and its panoramas. The poses were
annotated by hand; the panoramas have no order in time, and no odometry.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pflut._files import read_text
from pflut.camera.equirectangular import EquirectangularPanorama
from pflut.camera.mount import Mount
from pflut.datasets.base import Dataset, References
from pflut.geometry import FloatArray, wrap_to_pi

WIDTH, HEIGHT = 2048, 1024
# The tripod shows below 80 % of the image's height.
MASK_ELEVATION = (np.pi / 2 - 0.8 * np.pi, np.pi / 2)
# Doors end on their wall up to the annotation's rounding (camera heights).
_ON_WALL = 0.02
# What remains between a corner and a door beside it, by rounding, is no wall.
_SHORTEST = 1e-3


def load_zind(
    path: str | os.PathLike[str],
    *,
    floor: str | None = None,
    references: References | None = None,
) -> Dataset:
    """Load one floor of a home of ZInD.

    The world is the floor plan's frame with its mirroring undone (ZInD's x axis is reversed, so
    that the world is right-handed) and in metres. A stamp is the panorama's number. ZInD counts
    azimuth as ``u / (width - 1) 2 pi - pi``, clockwise, so that both outer columns lie on the
    seam; the camera class uses pixel centres. They differ by at most half a pixel, 0.09 degrees.

    Parameters
    ----------
    path : path
        The folder with ``zind_data.json``. The panoramas lie where the file says, or as
        ``images/NNN.jpg`` by their number.
    floor : str, optional
        Which floor, as ``"floor_01"``; the first that has a scale if not given.
    references : str, path or sequence of int, optional
        See `Dataset.with_references`; ``"all"`` if not given, each panorama is then localized
        against all others.

    Returns
    -------
    Dataset
        With the walls of the room layouts as floor plan, cut where doors and openings are.

    Raises
    ------
    FileNotFoundError
        If the file or a panorama is missing.
    ValueError
        If the file is no ZInD file, or the floor has no scale in metres.
    """
    folder = Path(path)
    source = folder / "zind_data.json"
    if not source.is_file():
        raise FileNotFoundError(f"{source}: no such file, expected a home of ZInD")
    try:
        data = json.loads(read_text(source))
        floor, scale = _floor(source, data, floor)
        rooms = data["merger"][floor].values()
        panoramas = sorted((number, p) for room in rooms for number, p in _panoramas(room))
        poses = [_pose(panorama, scale) for _, panorama in panoramas]
        heights = [
            p["camera_height"] * p["floor_plan_transformation"]["scale"] for _, p in panoramas
        ]
        walls = [wall for room in rooms for wall in _room_walls(room, scale)]
    except json.JSONDecodeError as error:
        raise ValueError(f"{source}: {error}") from None
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        raise ValueError(f"{source}: not as ZInD describes it ({error!r})") from None
    dataset = Dataset(
        name=f"{folder.resolve().name}/{floor}"
        if len(data["merger"]) > 1
        else folder.resolve().name,
        camera=EquirectangularPanorama(
            WIDTH, HEIGHT, mount=Mount(height=float(np.median(heights)) * scale)
        ),
        stamps=np.array([number for number, _ in panoramas], dtype=np.float64),
        image_paths=tuple(_image(folder, number, p) for number, p in panoramas),
        ground_truth=np.array(poses),
        floor_plan=np.array(walls),
        mask_elevation=MASK_ELEVATION,
    )
    return dataset.with_references("all" if references is None else references)


def _floor(source: Path, data: dict[str, Any], floor: str | None) -> tuple[str, float]:
    """Choose the floor, and give its metres per unit of the floor plan."""
    scales = {name: scale for name, scale in data["scale_meters_per_coordinate"].items() if scale}
    chosen = next(iter(scales), None) if floor is None else floor
    if chosen is None or chosen not in scales:
        raise ValueError(
            f"{source}: {'no floor' if floor is None else repr(floor)} with a scale in metres, "
            f"expected one of {', '.join(scales) or 'none'}"
        )
    return chosen, float(scales[chosen])


def _panoramas(room: dict[str, Any]) -> Iterator[tuple[int, dict[str, Any]]]:
    """Give the panoramas of a complete room with their numbers."""
    for part in room.values():
        for name, panorama in part.items():
            yield int(name.rsplit("_", 1)[1]), panorama


def _image(folder: Path, number: int, panorama: dict[str, Any]) -> Path:
    for candidate in (folder / panorama["image_path"], folder / "images" / f"{number:03d}.jpg"):
        if candidate.is_file():
            return candidate
    raise FileNotFoundError(f"{folder / panorama['image_path']}: the panorama is missing")


def _pose(panorama: dict[str, Any], scale: float) -> tuple[float, float, float]:
    """Give a panorama's pose in the world: its image's centre looks along its own y axis."""
    placed = panorama["floor_plan_transformation"]
    x, y = placed["translation"]
    return -x * scale, y * scale, float(wrap_to_pi(np.pi / 2 - np.radians(placed["rotation"])))


def _room_walls(room: dict[str, Any], scale: float) -> list[FloatArray]:
    """Give the wall segments (2, 2) of a complete room in the world."""
    # every panorama of the room repeats its layout; the first primary one annotated it
    panorama = next((p for _, p in _panoramas(room) if p["is_primary"]), None)
    if panorama is None or "layout_complete" not in panorama:
        return []
    layout = panorama["layout_complete"]
    corners = np.array(layout["vertices"], dtype=np.float64)
    # triples: one end, the other end, the heights of sill and top
    gaps = [
        np.array(layout[kind][i : i + 2], dtype=np.float64)
        for kind in ("doors", "openings")
        for i in range(0, len(layout[kind]), 3)
    ]
    placed = panorama["floor_plan_transformation"]
    angle = np.radians(placed["rotation"])
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    walls = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        for piece in _cut(start, end, gaps):
            placed_piece = piece @ rotation * placed["scale"] + np.array(placed["translation"])
            walls.append(placed_piece * [-scale, scale])
    return walls


def _cut(start: FloatArray, end: FloatArray, gaps: list[FloatArray]) -> Iterator[FloatArray]:
    """Give what is left of a wall (pieces of shape (2, 2)) beside the gaps that lie on it."""
    along = end - start
    length = float(np.hypot(*along))
    if length < _SHORTEST:
        return
    direction = along / length
    normal = np.array([-direction[1], direction[0]])
    taken = []
    for gap in gaps:
        position = np.sort((gap - start) @ direction)
        if np.abs((gap - start) @ normal).max() < _ON_WALL:
            taken.append(np.clip(position, 0.0, length))
    reached = 0.0
    for low, high in [*sorted(map(tuple, taken)), (length, length)]:
        if low - reached > _SHORTEST:
            yield start + np.outer([reached, low], direction)
        reached = max(reached, high)
