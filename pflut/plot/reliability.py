"""How good probabilities and scores of yes-or-no questions are: two curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from pflut.plot.style import CYCLE, GREY, new_figure, tidy
from pflut.reliability import CalibrationBin


def draw_reliability(
    axes: Axes, curves: Mapping[str, Sequence[CalibrationBin]], colors: Sequence[str]
) -> None:
    """Draw shares against probabilities, in percent, with their intervals and the diagonal.

    Parameters
    ----------
    axes : Axes
    curves : mapping of str to sequence of CalibrationBin
        By name, for a legend.
    colors : sequence of str
        Of the curves, in turn.
    """
    axes.plot([0, 100], [0, 100], color=GREY, linewidth=0.8)
    for color, (name, curve) in zip([*colors] * len(curves), curves.items(), strict=False):
        rows = [(part.predicted, part.observed, part.low, part.high) for part in curve]
        x, y, low, high = 100.0 * np.array(rows).reshape(-1, 4).T
        spread = np.maximum([y - low, high - y], 0.0)
        axes.errorbar(
            *(x, y, spread), color=color, marker="o", markersize=4, lw=1.2, label=name, zorder=3
        )
    axes.set(xlim=(-2, 102), ylim=(-2, 102))


def plot_reliability(
    curves: Mapping[str, Sequence[CalibrationBin]],
    *,
    what: str = "events that happened",
    title: str | None = None,
) -> Figure:
    """Draw how often it happened against the probabilities, with how many events there are.

    Calibrated probabilities follow the diagonal.

    Parameters
    ----------
    curves : mapping of str to sequence of CalibrationBin
        By name, see `pflut.reliability.reliability_curve`.
    what : str
        What the share is of.
    title : str, optional

    Returns
    -------
    Figure

    Raises
    ------
    ValueError
        If there is no curve, or one without events.
    """
    if not curves or not all(curves.values()):
        raise ValueError("curves: expected at least one, each with events")
    figure = new_figure(5.6, 8.0)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    draw_reliability(upper, curves, CYCLE)
    for color, curve in zip(CYCLE * len(curves), curves.values(), strict=False):
        predicted = [100.0 * part.predicted for part in curve]
        counts = [part.count for part in curve]
        lower.plot(predicted, counts, color=color, marker="o", markersize=4, lw=1.2)
    upper.set(ylabel=f"{what} [%]")
    lower.set(yscale="log", xlabel="probability [%]", ylabel="how many")
    for axes in (upper, lower):
        tidy(axes)
    handles = upper.get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", frameon=False, fontsize=9)
    if title:
        upper.set_title(title)
    return figure


def plot_precision_recall(
    curves: Mapping[str, tuple[ArrayLike, ArrayLike]], *, title: str | None = None
) -> Figure:
    """Draw precision over recall.

    Parameters
    ----------
    curves : mapping of str to (precision, recall)
        By name, see `pflut.reliability.precision_recall`.
    title : str, optional

    Returns
    -------
    Figure

    Raises
    ------
    ValueError
        If there is no curve, or one without a threshold.
    """
    if not curves or not all(np.size(recall) for _, recall in curves.values()):
        raise ValueError("curves: expected at least one, each with thresholds")
    figure = new_figure(5.6, 4.8)
    axes = figure.add_subplot()
    for color, (name, (precision, recall)) in zip(
        CYCLE * len(curves), curves.items(), strict=False
    ):
        x = 100.0 * np.append(0.0, np.asarray(recall, dtype=np.float64))
        y = 100.0 * np.asarray(precision, dtype=np.float64)
        axes.step(x, np.append(y[0], y), where="pre", color=color, linewidth=1.4, label=name)
    axes.set(xlim=(0, 100), ylim=(0, 102), xlabel="recall [%]", ylabel="precision [%]")
    tidy(axes)
    axes.legend(frameon=False, fontsize=9, loc="lower left")
    if title:
        axes.set_title(title)
    return figure
