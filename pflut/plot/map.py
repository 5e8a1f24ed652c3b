"""The map from above: walls, references, trajectories and particles."""

from __future__ import annotations

from collections.abc import Mapping

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver
from numpy.typing import ArrayLike

from pflut.datasets.base import Dataset
from pflut.geometry import FloatArray
from pflut.plot.style import BLACK, COLORMAP, CYCLE, GREY, VERMILION, new_figure, tidy

_MARGIN = 0.04  # of the map's larger side
_SIDE = 9.0  # inches
_NARROW = 0.7  # width over height
_ABREAST = 4  # entries of a row of the legend below a map
_ROW = 0.25  # inches


def draw_map(axes: Axes, dataset: Dataset, *, references: bool = True) -> None:
    """Draw the walls and the references of a dataset, and set the limits to them.

    Parameters
    ----------
    axes : Axes
        In metres, equal in x and y.
    dataset : Dataset
    references : bool
        Whether the references are drawn, as small arrows.
    """
    if dataset.floor_plan is not None:
        walls = LineCollection(list(dataset.floor_plan), colors="0.35", linewidths=1.4, zorder=1)
        axes.add_collection(walls)
    if references and dataset.ground_truth is not None and len(dataset.reference_indices):
        poses = dataset.ground_truth[dataset.reference_indices]
        draw_arrows(axes, poses, _size(dataset) * 0.022, GREY, label="references", zorder=2)
    x, y = _extent(dataset)
    axes.set(xlim=x, ylim=y, aspect="equal", xlabel="x [m]", ylabel="y [m]")
    tidy(axes, grid=False)


def draw_arrows(
    axes: Axes,
    poses: ArrayLike,
    length: float,
    color: str,
    *,
    label: str | None = None,
    width: float = 0.2,
    zorder: float = 3,
) -> Quiver:
    """Draw poses as arrows that start where the robot stands.

    Parameters
    ----------
    axes : Axes
    poses : array_like of shape (n, 3)
    length : float
        Metres.
    color : str
    label : str, optional
        For the legend.
    width : float
        Of the shaft, in lengths.
    zorder : float

    Returns
    -------
    Quiver
    """
    x, y, heading = np.asarray(poses, dtype=np.float64).reshape(-1, 3).T
    return axes.quiver(
        x,
        y,
        np.cos(heading),
        np.sin(heading),
        angles="xy",
        scale_units="xy",
        units="xy",
        scale=1.0 / length,
        width=width * length,
        headwidth=2.6,
        headlength=3.0,
        headaxislength=2.8,
        color=color,
        label=label,
        zorder=zorder,
    )


def map_figure(dataset: Dataset, *, side: float = _SIDE) -> tuple[Figure, Axes]:
    """Return a figure of the map's proportions, its longer side in inches, and its axes."""
    (x0, x1), (y0, y1) = _extent(dataset)
    scale = side / max(x1 - x0, y1 - y0)
    width, height = max((x1 - x0) * scale, 3.0) + 0.8, max((y1 - y0) * scale, 2.0) + 0.7
    # room for the legend, below the map or beside a narrow one
    narrow = width < _NARROW * height
    figure = new_figure(width + 2.2 * narrow, height + 0.7 * (not narrow))
    return figure, figure.add_subplot()


def plot_trajectory(
    dataset: Dataset,
    estimates: ArrayLike,
    ground_truth: ArrayLike | None = None,
    *,
    particles: Mapping[str, ArrayLike] | None = None,
    others: Mapping[str, ArrayLike] | None = None,
    connected: bool | None = None,
    title: str | None = None,
) -> Figure:
    """Draw estimated poses over the map.

    Parameters
    ----------
    dataset : Dataset
        Gives walls and references.
    estimates : array_like of shape (n, 3)
        ``[x, y, heading]``, metres and radians; NaN rows are left out.
    ground_truth : array_like of shape (n, 3), optional
        The truth of the same steps.
    particles : mapping of str to array_like of shape (N, 3), optional
        Particles at chosen steps, in their order in time, by the step's name in the legend.
    others : mapping of str to array_like of shape (n, 3), optional
        Trajectories to compare with, as odometry alone.
    connected : bool, optional
        Whether the poses follow each other in time and are joined by a line. Without order,
        each estimate is joined with its truth instead. Not if the dataset leaves one out, if
        not given.
    title : str, optional

    Returns
    -------
    Figure
    """
    estimate = np.asarray(estimates, dtype=np.float64).reshape(-1, 3)
    joined = not dataset.leave_one_out if connected is None else connected
    figure, axes = map_figure(dataset)
    # where each image is also a reference, the truth shows where they are
    draw_map(axes, dataset, references=joined or ground_truth is None)
    clouds = particles or {}
    colors = matplotlib.colormaps[COLORMAP](np.linspace(0.9, 0.1, max(len(clouds), 1)))
    for color, (name, cloud) in zip(colors, clouds.items(), strict=False):
        x, y = np.asarray(cloud, dtype=np.float64).reshape(-1, 3)[:, :2].T
        axes.scatter(
            x, y, s=5, color=color, alpha=0.5, linewidths=0, zorder=2.5, label=f"particles, {name}"
        )
    for color, (name, poses) in zip(CYCLE[2:], (others or {}).items(), strict=False):
        x, y = np.asarray(poses, dtype=np.float64).reshape(-1, 3)[:, :2].T
        axes.plot(x, y, color=color, linewidth=1.2, linestyle="--", label=name, zorder=3)
    length = _size(dataset) * 0.03
    if ground_truth is not None:
        truth = np.asarray(ground_truth, dtype=np.float64).reshape(-1, 3)
        if joined:
            axes.plot(*truth[:, :2].T, color=BLACK, linewidth=1.6, label="ground truth", zorder=4)
        else:
            ends = np.stack([truth[:, :2], estimate[:, :2]], axis=1)
            known = np.isfinite(ends).all(axis=(1, 2))
            errors = LineCollection(list(ends[known]), colors=VERMILION, linewidths=0.8, zorder=3)
            axes.add_collection(errors)
            draw_arrows(axes, truth, length, BLACK, label="ground truth", zorder=4)
    if joined:
        axes.plot(
            *estimate[:, :2].T,
            "o-",
            color=VERMILION,
            markersize=3.0 if len(estimate) < 60 else 1.5,
            linewidth=0.8,
            label="estimate",
            zorder=5,
        )
    else:
        known = np.isfinite(estimate).all(axis=1)
        draw_arrows(
            axes, estimate[known], length, VERMILION, label="estimate", width=0.12, zorder=5
        )
    if title:
        axes.set_title(title)
    legend_outside(figure)
    return figure


def legend_outside(figure: Figure) -> None:
    """Put a legend of all that has a label beside the map, its dots large enough to be seen."""
    narrow = figure.get_figwidth() - 2.2 < _NARROW * figure.get_figheight()
    if narrow:
        legend = figure.legend(loc="outside right upper", frameon=False, fontsize=9)
    else:
        legend = figure.legend(
            loc="outside lower center", ncols=_ABREAST, frameon=False, fontsize=9
        )
        rows = -(-len(legend.legend_handles) // _ABREAST)
        # the figure has room for one; others would push the title out of it
        figure.set_figheight(figure.get_figheight() + _ROW * max(rows - 1, 0))
    for handle in legend.legend_handles:
        if isinstance(handle, PathCollection):
            handle.set_alpha(1.0)
            handle.set_sizes([30.0])


def _extent(dataset: Dataset) -> tuple[tuple[float, float], tuple[float, float]]:
    """Give the limits of the map, with a margin."""
    points = [np.empty((0, 2))]
    if dataset.floor_plan is not None:
        points.append(dataset.floor_plan.reshape(-1, 2))
    if dataset.ground_truth is not None:
        points.append(dataset.ground_truth[:, :2])
    known: FloatArray = np.concatenate(points)
    known = known[np.isfinite(known).all(axis=1)]
    if not len(known):
        return (-1.0, 1.0), (-1.0, 1.0)
    low, high = known.min(axis=0), known.max(axis=0)
    margin = max(_MARGIN * float((high - low).max()), 0.1)
    return (
        (float(low[0]) - margin, float(high[0]) + margin),
        (float(low[1]) - margin, float(high[1]) + margin),
    )


def _size(dataset: Dataset) -> float:
    (x0, x1), (y0, y1) = _extent(dataset)
    return max(x1 - x0, y1 - y0)
