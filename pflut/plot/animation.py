"""An animation of the particles, as a GIF."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numpy.typing import ArrayLike
from PIL import Image

from pflut._files import replacing
from pflut.datasets.base import Dataset
from pflut.plot.map import draw_arrows, draw_map, legend_outside, map_figure
from pflut.plot.style import BLACK, COLORMAP, VERMILION

_COLORS = 96  # flat colors without dither: small files
_LAST_MS = 2000  # how long the last frame stays


@dataclass(frozen=True, eq=False)
class ParticleFrame:
    """What one frame of the animation shows.

    Parameters
    ----------
    particles : array_like of shape (N, 3)
        ``[x, y, heading]``, metres and radians.
    log_weights : array_like of shape (N,), optional
        Color the particles, heavy ones dark; all alike if not given.
    estimate, ground_truth : array_like of shape (3,), optional
        Drawn as arrows.
    title : str
    """

    particles: ArrayLike
    log_weights: ArrayLike | None = None
    estimate: ArrayLike | None = None
    ground_truth: ArrayLike | None = None
    title: str = ""


def animate_particles(
    dataset: Dataset,
    frames: Sequence[ParticleFrame],
    path: str | os.PathLike[str],
    *,
    fps: int = 4,
    size: float = 7.0,
    dpi: int = 80,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write an animated GIF of the particles over the map, atomically.

    Parameters
    ----------
    dataset : Dataset
        Gives walls and references.
    frames : sequence of ParticleFrame
        At least one; the last one stays for two seconds.
    path : path
        Ends in ``.gif``.
    fps : int
        Frames a second.
    size : float
        The map's longer side in inches; times ``dpi`` it is pixels.
    dpi : int
    progress : callable, optional
        Called as ``progress(frames drawn, all)``.

    Raises
    ------
    ValueError
        If there are no frames, or the path does not end in ``.gif``.
    """
    if not frames:
        raise ValueError("frames: expected at least one")
    if Path(path).suffix.lower() != ".gif":
        raise ValueError(f"{os.fspath(path)}: expected a name that ends in .gif")
    figure, axes = map_figure(dataset, side=size)
    draw_map(axes, dataset)
    length = 0.05 * max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
    nowhere = np.zeros((1, 3))
    cloud = axes.scatter([], [], s=6, linewidths=0, alpha=0.7, zorder=3, label="particles")
    truth = draw_arrows(axes, nowhere, length, BLACK, label="ground truth", zorder=4)
    estimate = draw_arrows(axes, nowhere, length, VERMILION, label="estimate", zorder=5)
    title = axes.set_title(" ")
    legend_outside(figure)
    colormap = matplotlib.colormaps[COLORMAP + "_r"]  # the heavy ones dark
    canvas = FigureCanvasAgg(figure)
    figure.set_dpi(dpi)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # as it is now, for every frame
    drawn: list[Image.Image] = []
    for done, frame in enumerate(frames, start=1):
        poses = np.asarray(frame.particles, dtype=np.float64).reshape(-1, 3)
        order = np.arange(len(poses))
        shade = np.full(len(poses), 0.5)
        if frame.log_weights is not None:
            weights = np.asarray(frame.log_weights, dtype=np.float64)
            order = np.argsort(weights)  # the heavy ones on top
            if np.isfinite(weights.max(initial=-np.inf)):
                shade = np.exp(weights[order] - weights.max())
        cloud.set_offsets(poses[order, :2])
        cloud.set_facecolor([tuple(rgba) for rgba in colormap(0.1 + 0.9 * shade)])
        for arrow, pose in ((truth, frame.ground_truth), (estimate, frame.estimate)):
            known = pose is not None and bool(np.isfinite(pose).all())
            arrow.set_visible(known)
            if known:
                x, y, heading = np.asarray(pose, dtype=np.float64)
                arrow.set_offsets([[x, y]])
                arrow.set_UVC(np.cos(heading), np.sin(heading))
        title.set_text(frame.title or " ")
        canvas.draw()
        image = Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3].copy())
        drawn.append(image.quantize(_COLORS, dither=Image.Dither.NONE))
        if progress is not None:
            progress(done, len(frames))
    duration = [round(1000 / fps)] * (len(drawn) - 1) + [_LAST_MS]
    with replacing(path) as temporary:
        drawn[0].save(temporary, save_all=True, append_images=drawn[1:], duration=duration, loop=0)
