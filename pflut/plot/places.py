"""A topological map over the floor plan: its images by place, and their links."""

from __future__ import annotations

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from pflut.datasets.base import Dataset
from pflut.geometry import FloatArray
from pflut.plot.map import draw_map, legend_outside, map_figure
from pflut.plot.style import GREY, new_figure

NAMED = 12
"""Places that the legend names; the others are those of few images."""
_LINK = (0.1, 0.1, 0.1)
_DARKEST = 0.45  # opacity of a sure link


def plot_places(
    positions: ArrayLike,
    places: ArrayLike,
    edges: ArrayLike,
    probability: ArrayLike,
    dataset: Dataset | None = None,
    *,
    note: str | None = None,
    title: str | None = None,
) -> Figure:
    """Draw the images of a topological map, coloured by place, and their links.

    Parameters
    ----------
    positions : array_like of shape (N, 2) or (N, 3)
        Where the images are drawn, metres; NaN rows are left out.
    places : array_like of shape (N,), int
        Numbers from 0, as in a `TopologicalMap`.
    edges : array_like of shape (m, 2), int
        The images of each link.
    probability : array_like of shape (m,)
        Of the links: the more probable, the darker.
    dataset : Dataset, optional
        Gives the floor plan. Without it the positions have no unit, as those of a layout.
    note : str, optional
        Below the title.
    title : str, optional

    Returns
    -------
    Figure

    Raises
    ------
    ValueError
        If there are not as many positions as places.
    """
    points, of = np.asarray(positions, dtype=np.float64)[:, :2], np.asarray(places)
    if len(points) != len(of):
        raise ValueError(f"positions: expected {len(of)}, one an image, got {len(points)}")
    if dataset is None:
        figure = new_figure(9.0, 8.0)
        axes = figure.add_subplot()
        axes.set_aspect("equal")
        axes.set_axis_off()
    else:
        figure, axes = map_figure(dataset)
        draw_map(axes, dataset, references=False)
    _draw_links(axes, points, np.asarray(edges), np.asarray(probability, dtype=np.float64))
    count = np.bincount(of)
    colors = place_colors(len(count))
    named = np.flatnonzero(count > 1)[:NAMED]
    for place in named:
        axes.scatter(
            points[of == place, 0],
            points[of == place, 1],
            s=42,
            color=colors[place],
            edgecolors="white",
            zorder=4,
            label=f"place {place}: {count[place]} images",
        )
    small = ~np.isin(of, named)
    if small.any():
        label = f"images of {len(np.unique(of[small]))} smaller places"
        x, y = points[small].T
        axes.scatter(x, y, s=26, color=GREY, edgecolors="white", zorder=3, label=label)
    if title or note:
        axes.set_title("\n".join(text for text in (title, note) if text))
    legend_outside(figure)
    return figure


def place_colors(count: int) -> list[tuple[float, float, float, float]]:
    """Return the colours of the places that legends name, the same in every figure."""
    colors = matplotlib.colormaps["tab10" if count <= 10 else "tab20"]
    return [colors(place) for place in range(min(count, colors.N))]


def _draw_links(
    axes: Axes, points: FloatArray, edges: NDArray[np.integer], probability: FloatArray
) -> None:
    ends = points[edges.reshape(-1, 2)]
    known = np.isfinite(ends).all(axis=(1, 2))
    if not known.any():
        return
    colors = [(*_LINK, _DARKEST * alpha) for alpha in probability[known].tolist()]
    lines = LineCollection(list(ends[known]), colors=colors, linewidths=0.8, zorder=2)
    lines.set_label("links: the more probable, the darker")
    axes.add_collection(lines)
