"""Errors over time, and against anything else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from pflut.evaluation import CONVERGED_HEADING, CONVERGED_POSITION, TrajectoryErrors
from pflut.plot.style import CYCLE, GREY, new_figure, tidy
from pflut.statistics import binned_medians, summarize

# Nothing below these is worth a decade of the axis: a tenth of a millimetre and of a millidegree.
_LEAST = 1e-4


def plot_errors(
    errors: TrajectoryErrors | Mapping[str, TrajectoryErrors],
    *,
    x: ArrayLike | None = None,
    xlabel: str = "image",
    title: str | None = None,
) -> Figure:
    """Draw position and heading error over time, and mark where each method has converged.

    Parameters
    ----------
    errors : TrajectoryErrors, or mapping of str to TrajectoryErrors
        Of one method, or of several by name, all of the same steps.
    x : array_like of shape (n,), optional
        What the steps are drawn over, for example stamps; their numbers if not given.
    xlabel : str
        What x is, with its unit.
    title : str, optional

    Returns
    -------
    Figure
    """
    methods = {"": errors} if isinstance(errors, TrajectoryErrors) else dict(errors)
    figure = new_figure(8.0, 5.0)
    upper, lower = figure.subplots(2, 1, sharex=True)
    limits = (CONVERGED_POSITION, np.degrees(CONVERGED_HEADING))
    for axes, limit in zip((upper, lower), limits, strict=True):
        axes.axhline(limit, color=GREY, linewidth=0.8, linestyle=":")
        axes.set_yscale("log")
        tidy(axes)
    for color, (name, error) in zip(CYCLE * 9, methods.items(), strict=False):
        steps = np.arange(len(error)) if x is None else np.asarray(x, dtype=np.float64)
        curves = (error.position, np.degrees(np.abs(error.heading)))
        for axes, values in zip((upper, lower), curves, strict=True):
            shown = np.where(np.isfinite(values), np.maximum(values, _LEAST), np.nan)
            axes.plot(steps, shown, ".-", color=color, linewidth=1.2, markersize=4, label=name)
        start = error.converged_at
        if start is not None:
            label = f"converged at {steps[start]:g}" + (f" ({name})" if name else "")
            upper.axvline(steps[start], color=color, linestyle="--", linewidth=1, label=label)
            lower.axvline(steps[start], color=color, linestyle="--", linewidth=1)
    upper.set_ylabel("position error [m]")
    lower.set_ylabel("heading error [deg]")
    lower.set_xlabel(xlabel)
    if title:
        upper.set_title(title)
    handles, labels = upper.get_legend_handles_labels()
    shown_labels = [(h, text) for h, text in zip(handles, labels, strict=True) if text]
    if shown_labels:
        figure.legend(
            *zip(*shown_labels, strict=True),
            loc="outside lower center",
            ncols=3,
            frameon=False,
            fontsize=9,
        )
    return figure


def plot_medians(
    x: Sequence[float] | Sequence[str],
    panels: Mapping[str, Mapping[str, Sequence[ArrayLike]]],
    *,
    xlabel: str,
    logarithmic: bool = True,
    title: str | None = None,
) -> Figure:
    """Draw medians and MADs of errors over the settings of an experiment, a curve a method.

    Parameters
    ----------
    x : sequence of float, or of str
        The settings, in order; names are placed at even distances, without a line between them.
    panels : mapping of str to mapping of str to sequence of array_like
        By the label of a panel's axis of errors, with unit, then by method: the absolute errors at
        each setting.
    xlabel : str
        With unit.
    logarithmic : bool
        Whether the axes of errors are.
    title : str, optional

    Returns
    -------
    Figure

    Raises
    ------
    ValueError
        If there is no setting or no panel.
    """
    if not len(x) or not panels:
        raise ValueError("x, panels: expected at least one setting and one panel, got none")
    figure = new_figure(5.0 * len(panels), 4.4)
    named = isinstance(x[0], str)
    places = np.arange(len(x)) if named else np.asarray(x, dtype=np.float64)
    # bars of one setting stand beside each other, apart from those of the next one
    gap = float(np.diff(places).min()) if len(x) > 1 else 1.0
    step = min(0.01 * (float(np.ptp(places)) or 1.0), 0.06 * gap)
    for axes, (label, errors) in zip(
        figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True
    ):
        for i, (name, samples) in enumerate(errors.items()):
            known = [summarize(values) for values in samples]
            median = np.array([summary.median for summary in known])
            mad = np.array([summary.mad for summary in known])
            axes.errorbar(
                places + step * (i - (len(errors) - 1) / 2.0),
                median,
                (np.minimum(mad, 0.9 * median) if logarithmic else mad, mad),
                linestyle="none" if named else ("-", "--")[i // len(CYCLE) % 2],
                marker="os^Dvx+"[i % 7],
                color=CYCLE[i % len(CYCLE)],
                linewidth=1.3,
                elinewidth=0.7,
                markersize=4,
                label=name,
            )
        if logarithmic:
            axes.set_yscale("log")
        if named:
            axes.set_xticks(places, [str(value) for value in x])
        axes.set(xlabel=xlabel, ylabel=f"{label}, median and MAD")
        tidy(axes)
    handles = axes.get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    if title:
        figure.suptitle(title)
    return figure


def plot_error_against(
    x: ArrayLike,
    errors: Mapping[str, ArrayLike],
    *,
    xlabel: str,
    ylabel: str = "heading error [deg]",
    bins: int | ArrayLike = 8,
    logarithmic: bool = False,
    title: str | None = None,
) -> Figure:
    """Draw the medians of errors in bins of x, with a band of one MAD, for several methods.

    Parameters
    ----------
    x : array_like of shape (n,)
        What the errors depend on, for example the distance between the views.
    errors : mapping of str to array_like of shape (n,)
        By method, in the unit of ``ylabel``; absolute values are taken, NaN are left out.
    xlabel, ylabel : str
        With units.
    bins : int or array_like of shape (b + 1,)
        The number of equal bins between the least and the largest x, or their edges.
    logarithmic : bool
        Whether the axis of the errors is.
    title : str, optional

    Returns
    -------
    Figure
    """
    position = np.asarray(x, dtype=np.float64)
    edges = (
        np.linspace(position.min(), position.max(), bins + 1)
        if isinstance(bins, int)
        else np.asarray(bins, dtype=np.float64)
    )
    centers = (edges[1:] + edges[:-1]) / 2.0
    figure = new_figure(7.0, 4.2)
    axes = figure.add_subplot()
    for i, (name, values) in enumerate(errors.items()):
        median, mad, _ = binned_medians(position, values, edges)
        color = CYCLE[i % len(CYCLE)]
        axes.plot(
            centers,
            median,
            marker="os^Dvx+"[i % 7],
            color=color,
            linewidth=1.4,
            markersize=5,
            label=name,
        )
        low = np.maximum(median - mad, _LEAST if logarithmic else 0.0)
        axes.fill_between(centers, low, median + mad, color=color, alpha=0.15, linewidth=0)
    if logarithmic:
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0.0)
    axes.set(xlabel=xlabel, ylabel=f"{ylabel}, median and MAD", xlim=(edges[0], edges[-1]))
    tidy(axes)
    if title:
        axes.set_title(title)
    axes.legend(frameon=False, fontsize=9)
    return figure
