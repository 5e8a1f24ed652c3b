"""A pair of images: its correspondences and its posterior."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from pflut.geometry import wrap_to_2pi
from pflut.plot.style import BLUE, COLORMAP, VERMILION, new_figure

# A panorama is wide: two of them are stacked; photographs of less are put side by side.
_WIDE = 1.6


def plot_posterior(
    log_prob: ArrayLike,
    *,
    mode: ArrayLike | None = None,
    truth: ArrayLike | None = None,
    title: str | None = None,
) -> Figure:
    """Draw the posterior of a pair over both headings.

    Parameters
    ----------
    log_prob : array_like of shape (B, B)
        Log-probability over (heading_l, heading_r); bin i covers ``[i, i + 1) 2 pi / B``.
    mode, truth : array_like of shape (2,), optional
        ``(heading_l, heading_r)`` in radians to mark.
    title : str, optional

    Returns
    -------
    Figure

    Raises
    ------
    ValueError
        If ``log_prob`` is not square, or nowhere finite.
    """
    grid = np.asarray(log_prob, dtype=np.float64)
    if grid.ndim != 2 or grid.shape[0] != grid.shape[1] or not np.isfinite(grid).any():
        raise ValueError(f"log_prob: expected finite values of shape (B, B), got {grid.shape}")
    figure = new_figure(6.4, 5.4)
    axes = figure.add_subplot()
    finite = np.where(np.isfinite(grid), grid, np.nan)
    below = finite - np.nanmax(finite)
    image = axes.imshow(
        below.T,
        origin="lower",
        extent=(0.0, 360.0, 0.0, 360.0),
        cmap=COLORMAP,
        # the emptiest corner must not use up the colors
        vmin=float(np.nanpercentile(below, 2)),
        vmax=0.0,
        interpolation="nearest",
    )
    figure.colorbar(image, ax=axes, label="log-probability below the maximum [nat]", shrink=0.9)
    marks = (("truth", truth, "o", "white", 13), ("mode", mode, "x", VERMILION, 9))
    for name, point, marker, color, size in marks:
        if point is not None:
            theta, phi = np.degrees(wrap_to_2pi(point))
            axes.plot(
                theta,
                phi,
                marker,
                markersize=size,
                markerfacecolor="none",
                markeredgecolor=color,
                markeredgewidth=2,
                linestyle="none",
                label=name,
            )
    ticks = np.arange(0, 361, 60)
    axes.set(
        xlim=(0, 360),
        ylim=(0, 360),
        xticks=ticks,
        yticks=ticks,
        xlabel="heading_l: to the query, seen by the reference [deg]",
        ylabel="heading_r: to the reference, seen by the query [deg]",
    )
    if title:
        axes.set_title(title)
    if mode is not None or truth is not None:
        axes.legend(facecolor="0.25", labelcolor="white", framealpha=0.8, fontsize=9)
    return figure


def plot_correspondences(
    image_l: ArrayLike,
    image_r: ArrayLike,
    pixels_l: ArrayLike,
    pixels_r: ArrayLike,
    *,
    inliers: ArrayLike | None = None,
    quality: ArrayLike | None = None,
    title: str | None = None,
) -> Figure:
    """Draw the matches of two images as lines between them.

    Parameters
    ----------
    image_l, image_r : array_like of shape (height, width) or (height, width, 3), uint8
        Reference and query; grey or RGB. Panoramas are stacked, other images put side by side.
    pixels_l, pixels_r : array_like of shape (n, 2)
        ``[u, v]`` of the matches.
    inliers : array_like of bool, shape (n,), optional
        Matches that agree with a pose are drawn over the others and in another color.
    quality : array_like of shape (n,), optional
        Colors the matches where no inliers are given, for example by the ratio-test score.
    title : str, optional

    Returns
    -------
    Figure

    Raises
    ------
    ValueError
        If the numbers of pixels, or of what colors them, differ.
    """
    left, right = np.asarray(image_l), np.asarray(image_r)
    start = np.asarray(pixels_l, dtype=np.float64).reshape(-1, 2)
    end = np.asarray(pixels_r, dtype=np.float64).reshape(-1, 2)
    n = len(start)
    if len(end) != n or any(o is not None and np.shape(o) != (n,) for o in (inliers, quality)):
        raise ValueError(f"pixels_l, pixels_r, inliers, quality: expected {n} values each")
    stacked = left.shape[1] > _WIDE * left.shape[0]
    axis = 0 if stacked else 1
    gap = max(left.shape[axis] // 40, 4)
    offset = np.array([0, left.shape[0] + gap] if stacked else [left.shape[1] + gap, 0])
    canvas = _side_by_side(left, right, offset)
    width = 10.0
    shown = (
        width if quality is None or inliers is not None else 0.86 * width
    )  # a colorbar beside it
    figure = new_figure(width, shown * canvas.shape[0] / canvas.shape[1] + 0.7)
    axes = figure.add_subplot()
    axes.imshow(canvas, cmap="gray", vmin=0, vmax=255)
    axes.set_axis_off()
    lines = np.stack([start, end + offset], axis=1)
    if inliers is not None:
        good = np.asarray(inliers, dtype=bool)
        groups = ((~good, VERMILION, 0.5, "mismatches"), (good, BLUE, 0.9, "agree with the pose"))
        for chosen, color, alpha, name in groups:
            label = f"{name}: {int(chosen.sum())}"
            _draw_lines(figure, lines[chosen], color, alpha, label)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2, frameon=False)
    elif quality is not None:
        drawn = LineCollection(list(lines), cmap=COLORMAP + "_r", linewidths=0.8, alpha=0.8)
        drawn.set_array(np.asarray(quality, dtype=np.float64))
        axes.add_collection(drawn, autolim=False)
        figure.colorbar(drawn, ax=axes, label="ratio of descriptor distances", shrink=0.7)
    else:
        _draw_lines(figure, lines, BLUE, 0.8, f"{n} matches")
    if title:
        axes.set_title(title)
    return figure


def _draw_lines(figure: Figure, lines: np.ndarray, color: str, alpha: float, label: str) -> None:
    axes = figure.axes[0]
    axes.add_collection(
        LineCollection(list(lines), colors=color, linewidths=0.8, alpha=alpha, label=label),
        autolim=False,
    )
    points = lines.reshape(-1, 2)
    axes.scatter(points[:, 0], points[:, 1], s=6, color=color, alpha=alpha, linewidths=0)


def _side_by_side(left: np.ndarray, right: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Put both images on one white canvas, the right one at an offset [u, v]."""
    color = left.ndim == 3 or right.ndim == 3
    u, v = offset
    height = max(left.shape[0], v + right.shape[0])
    width = max(left.shape[1], u + right.shape[1])
    canvas = np.full((height, width, 3) if color else (height, width), 255, dtype=np.uint8)
    for image, (x, y) in ((left, (0, 0)), (right, (u, v))):
        shown = np.repeat(image[:, :, None], 3, axis=2) if color and image.ndim == 2 else image
        canvas[y : y + image.shape[0], x : x + image.shape[1]] = shown
    return canvas
