"""Errors over time, and against anything else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from pflut.evaluation import CONVERGED_HEADING, CONVERGED_POSITION, TrajectoryErrors
from pflut.pair_errors import PairErrors
from pflut.plot.style import CYCLE, GREY, new_figure, tidy
from pflut.statistics import bin_indices, summarize

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


def plot_pair_errors(
    x: ArrayLike,
    errors: Mapping[str, PairErrors],
    *,
    xlabel: str,
    edges: ArrayLike,
    least: int = 5,
    title: str | None = None,
) -> Figure:
    """Draw errors of relative poses in bins of what they depend on: headings, and rotations.

    Parameters
    ----------
    x : array_like of shape (n,)
        Of each pair, for example the distance between its views.
    errors : mapping of str to PairErrors
        Of n pairs each, by estimator.
    xlabel : str
        With unit.
    edges : array_like of shape (b + 1,)
        Increasing, see `bin_indices`.
    least : int
        Pairs in a bin that is drawn.
    title : str, optional

    Returns
    -------
    Figure
        Of `plot_medians`.

    Raises
    ------
    ValueError
        If no bin holds as many pairs.
    """
    place, border = bin_indices(x, edges), np.asarray(edges, dtype=np.float64)
    kept = [k for k in range(len(border) - 1) if np.count_nonzero(place == k) >= least]
    panels = {
        f"{angle} error [deg]": {
            name: [np.degrees(getattr(error, field)[place == k]) for k in kept]
            for name, error in errors.items()
        }
        for angle, field in (("heading", "heading_l"), ("rotation", "rotation"))
    }
    centers = ((border[1:] + border[:-1]) / 2.0)[kept].tolist()
    return plot_medians(centers, panels, xlabel=xlabel, title=title)
