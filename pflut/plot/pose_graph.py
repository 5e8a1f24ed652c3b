"""A pose graph over the floor plan: before, after, the truth, and the links between images."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from pflut.datasets.base import Dataset
from pflut.plot.map import draw_map, legend_outside, map_figure
from pflut.plot.style import BLACK, COLORMAP, GREY, VERMILION

FAINT = 0.5
"""Links of a smaller probability are not drawn."""


def plot_pose_graph(
    dataset: Dataset,
    poses: ArrayLike,
    links: ArrayLike,
    probability: ArrayLike,
    *,
    odometry: ArrayLike | None = None,
    ground_truth: ArrayLike | None = None,
    note: str | None = None,
    title: str | None = None,
) -> Figure:
    """Draw the nodes of a pose graph and its links.

    Parameters
    ----------
    dataset : Dataset
        Gives the walls, if it knows them.
    poses : array_like of shape (n, 3)
        The nodes in the order of time, in the frame of the floor plan; metres and radians.
    links : array_like of shape (m, 2), int
        The nodes of each link.
    probability : array_like of shape (m,)
        Of the links: their color.
    odometry, ground_truth : array_like of shape (n, 3), optional
        The same images' poses, for comparison.
    note : str, optional
        Below the title.
    title : str, optional

    Returns
    -------
    Figure
    """
    nodes = np.asarray(poses, dtype=np.float64)
    shares = np.asarray(probability, dtype=np.float64)
    figure, axes = map_figure(dataset)
    draw_map(axes, dataset, references=False)
    shown = np.flatnonzero(shares >= FAINT)
    shown = shown[np.argsort(shares[shown], kind="stable")]  # the probable ones on top
    segments = nodes[np.asarray(links, dtype=np.intp).reshape(-1, 2)[shown], :2]
    lines = LineCollection(
        list(segments), array=shares[shown], cmap=COLORMAP, linewidths=0.7, alpha=0.7, zorder=2
    )
    lines.set_clim(FAINT, 1.0)
    axes.add_collection(lines)
    figure.colorbar(lines, ax=axes, label="probability of a link", shrink=0.6, pad=0.02)
    trajectories = (
        ("ground truth", ground_truth, BLACK, "-", 1.6),
        ("odometry", odometry, GREY, "--", 1.4),
    )
    drawn = [nodes[:, :2]]
    for label, trajectory, color, style, width in trajectories:
        if trajectory is not None:
            xy = np.asarray(trajectory, dtype=np.float64)[:, :2]
            drawn.append(xy)
            axes.plot(*xy.T, style, color=color, linewidth=width, label=label, zorder=3)
    axes.plot(
        *nodes[:, :2].T,
        "o-",
        color=VERMILION,
        markersize=3.0,
        linewidth=0.9,
        label="pose graph",
        zorder=4,
    )
    points = np.concatenate(drawn)
    low, high = np.nanmin(points, axis=0) - 0.2, np.nanmax(points, axis=0) + 0.2
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    axes.set_xlim(min(x0, low[0]), max(x1, high[0]))
    axes.set_ylim(min(y0, low[1]), max(y1, high[1]))
    if title or note:
        axes.set_title("\n".join(text for text in (title, note) if text))
    legend_outside(figure)
    return figure
