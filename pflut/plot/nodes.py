"""Localization in a topological map over time: the probabilities of its nodes and places."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from pflut.geometry import FloatArray
from pflut.plot.places import NAMED, place_colors
from pflut.plot.style import BLUE, GREY, VERMILION, new_figure, tidy


def plot_node_probabilities(
    probabilities: ArrayLike,
    places: ArrayLike,
    *,
    nearest: ArrayLike | None = None,
    right: ArrayLike | None = None,
    title: str | None = None,
) -> Figure:
    """Draw how probable the nodes and the places of a topological map are at each image.

    Parameters
    ----------
    probabilities : array_like of shape (T, N)
        Of the N nodes at T images.
    places : array_like of shape (N,), int
        Numbers from 0, as in a `TopologicalMap`.
    nearest : array_like of shape (T,), int, optional
        The node nearest to the truth, ringed; -1 where it is not known. Images at which its place
        is not the most probable one are marked.
    right : array_like of shape (T,), bool, optional
        Whether the most probable node is right, for the colours of the rings. By default where it
        is the nearest.
    title : str, optional

    Returns
    -------
    Figure

    Raises
    ------
    ValueError
        If the shapes do not fit.
    """
    shares, of = np.asarray(probabilities, dtype=np.float64), np.asarray(places)
    if shares.ndim != 2 or shares.shape[1] != len(of) or not len(shares):
        raise ValueError(f"probabilities: expected shape (T, {len(of)}), got {shares.shape}")
    true = np.full(len(shares), -1) if nearest is None else np.asarray(nearest)
    good = shares.argmax(axis=1) == true if right is None else np.asarray(right)
    for name, values in (("nearest", true), ("right", good)):
        if values.shape != (len(shares),):
            raise ValueError(f"{name}: expected {len(shares)}, one an image, got {values.shape}")
    figure = new_figure(10.0, 7.0)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    _draw_nodes(upper, shares, of, true, good)
    _draw_places(lower, shares, of, true)
    if title:
        upper.set_title(title)
    handles = [axes.get_legend_handles_labels() for axes in (upper, lower)]
    figure.legend(
        *(first + second for first, second in zip(*handles, strict=True)),
        loc="outside lower center",
        ncols=4,
        frameon=False,
        fontsize=9,
    )
    return figure


def _draw_nodes(
    axes: Axes,
    shares: FloatArray,
    of: NDArray[np.integer],
    true: NDArray[np.integer],
    good: NDArray[np.bool_],
) -> None:
    """Draw a row a node, those of a place below each other."""
    order = np.argsort(of, kind="stable")
    row = np.empty(len(of), np.int64)
    row[order] = np.arange(len(of))
    # the root, so that a few per cent are seen
    shown = axes.pcolormesh(
        np.arange(len(shares) + 1) - 0.5,
        np.arange(len(of) + 1) - 0.5,
        shares[:, order].T,
        cmap="Greys",
        norm=PowerNorm(0.5, 0.0, 1.0),
        rasterized=True,
    )
    assert axes.figure is not None
    axes.figure.colorbar(shown, ax=axes, label="probability", pad=0.01)
    known = true >= 0
    for chosen, color, text in (
        (known & good, BLUE, "nearest node: the most probable one is right"),
        (known & ~good, VERMILION, "nearest node: it is wrong"),
    ):
        if chosen.any():
            axes.scatter(
                np.flatnonzero(chosen),
                row[true[chosen]],
                s=34,
                facecolors="none",
                edgecolors=color,
                linewidths=1.1,
                label=text,
            )
    ends = np.flatnonzero(np.diff(of[order])) + 0.5
    for end in ends:
        axes.axhline(end, color=GREY, linewidth=0.6)
    begins, lasts = np.concatenate([[-0.5], ends]), np.concatenate([ends, [len(of) - 0.5]])
    named = min(len(begins), NAMED)
    axes.set_yticks(
        ((begins + lasts) / 2.0)[:named], [f"place {place}" for place in range(named)], fontsize=9
    )
    axes.tick_params(axis="y", length=0)
    axes.set(ylabel="nodes", ylim=(len(of) - 0.5, -0.5))


def _draw_places(
    axes: Axes, shares: FloatArray, of: NDArray[np.integer], true: NDArray[np.integer]
) -> None:
    """Draw the probabilities of the places upon each other."""
    count = int(of.max()) + 1
    summed = np.stack([shares[:, of == place].sum(axis=1) for place in range(count)])
    steps, colors, below = np.arange(len(shares)), place_colors(count), np.zeros(len(shares))
    for place in range(min(count, NAMED)):
        axes.bar(steps, summed[place], 1.0, below, color=colors[place], label=f"place {place}")
        below += summed[place]
    if count > NAMED:
        rest = summed[NAMED:].sum(axis=0)
        axes.bar(steps, rest, 1.0, below, color=GREY, label="smaller places")
    wrong = np.flatnonzero((true >= 0) & (summed.argmax(axis=0) != of[true]))
    if len(wrong):
        y = np.full(len(wrong), 1.04)
        axes.scatter(wrong, y, s=26, marker="v", color=VERMILION, label="place is wrong")
    axes.set(xlabel="image", ylabel="probability", ylim=(0.0, 1.1))
    axes.set_xlim(-0.5, len(shares) - 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    tidy(axes, grid=False)
