"""A corridor of segments that look the same: its landmarks, and drives along it."""

from __future__ import annotations

import numpy as np

from pflut.geometry import FloatArray
from pflut.simulation.drive import Drive, drive_along
from pflut.simulation.landmarks import LandmarkBuilder, Landmarks, scatter
from pflut.simulation.layout import CEILING

SEGMENTS = 8
SEGMENT = 3.0  # metres
LENGTH, BREADTH = SEGMENTS * SEGMENT, 2.2
WALL_LANDMARKS, END_LANDMARKS = 60, 60  # on each wall of a segment, and at each end
POSTER_LANDMARKS, POSTER_WIDTH = 25, 1.2  # the one object that is nowhere else
TURNING = 0.9  # metres from an end where the robot turns
SWAY = 0.2  # metres to either side of the middle


def corridor_outline() -> tuple[FloatArray, tuple[float, float, float, float]]:
    """Give the walls (4, 2, 2) and the bounds (xmin, ymin, xmax, ymax) of the corridor, metres."""
    corners = np.array([[0.0, 0.0], [LENGTH, 0.0], [LENGTH, BREADTH], [0.0, BREADTH]])
    walls = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    return walls, (0.0, 0.0, LENGTH, BREADTH)


def corridor_landmarks(rng: np.random.Generator) -> Landmarks:
    """Put the same landmarks into all segments, others at the ends, and a poster somewhere.

    Parameters
    ----------
    rng : Generator

    Returns
    -------
    Landmarks
    """
    builder = LandmarkBuilder([])
    for y, yaw in ((0.0, np.pi), (BREADTH, 0.0)):
        pattern = scatter(rng, WALL_LANDMARKS, SEGMENT, 0.1, CEILING)
        looks = builder.new_looks(WALL_LANDMARKS)
        for k in range(SEGMENTS):
            builder.add(pattern, ((k + (y == 0.0)) * SEGMENT, y), yaw, looks)
    for x, y, yaw in ((0.0, 0.0, 0.5 * np.pi), (LENGTH, BREADTH, -0.5 * np.pi)):
        builder.add(scatter(rng, END_LANDMARKS, BREADTH, 0.1, CEILING), (x, y), yaw)
    segment = int(rng.integers(1, SEGMENTS - 1))
    poster = scatter(rng, POSTER_LANDMARKS, POSTER_WIDTH, 0.8, 2.0)
    builder.add(poster, (segment * SEGMENT + 0.5, BREADTH), 0.0)
    return builder.finish()


def plan_corridor_mapping(rng: np.random.Generator) -> Drive:
    """Plan a drive from one end of the corridor to the other.

    Parameters
    ----------
    rng : Generator

    Returns
    -------
    Drive
    """
    line = _line(TURNING, LENGTH - TURNING, rng)
    return drive_along([line], spacing=0.72, turn=np.inf, rng=rng)


def plan_corridor_drive(
    *, length: float = 17.0, spacing: float = 0.35, rng: np.random.Generator | int | None = None
) -> Drive:
    """Plan a drive from the middle of the corridor to an end, and back.

    Parameters
    ----------
    length : float
        Metres to drive.
    spacing : float
        Metres between images, up to an eighth more or less.
    rng : Generator, int or None

    Returns
    -------
    Drive
    """
    generator = np.random.default_rng(rng)
    start = float(generator.uniform(0.35, 0.65)) * LENGTH
    end, far = (TURNING, LENGTH - TURNING)[:: 1 if generator.random() < 0.5 else -1]
    out, back = _line(start, end, generator), _line(end, far, generator)
    back[0] = out[-1]
    drive = drive_along([out, back], spacing=spacing, turn=0.5, rng=generator)
    steps = np.hypot(*np.diff(drive.path.poses[:, :2], axis=0).T)
    last = int(np.searchsorted(np.cumsum(steps), length))
    return Drive(drive.path, drive.images[drive.images <= last])


def _line(start: float, end: float, rng: np.random.Generator) -> FloatArray:
    """Sway along the middle of the corridor, shape (k, 2)."""
    x = np.linspace(start, end, max(int(abs(end - start) / 0.02), 2))
    wave = np.sin(2.0 * np.pi * (x / rng.uniform(5.0, 8.0) + rng.random()))
    return np.column_stack([x, 0.5 * BREADTH + SWAY * wave])
