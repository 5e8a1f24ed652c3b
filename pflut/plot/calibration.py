"""How often credible regions hold the truth, against how often they should."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import NormalDist

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from pflut.plot.style import CYCLE, GREY, new_figure, tidy


def plot_calibration(
    masses: Mapping[str, ArrayLike], *, level: float = 0.95, title: str | None = None
) -> Figure:
    """Draw the share of true poses in the credible regions of every mass.

    Calibrated posteriors follow the diagonal; below it they are surer than they may be.

    Parameters
    ----------
    masses : mapping of str to array_like of shape (n,)
        By name: the mass of the smallest credible region that reaches the true pose, for each pair
        (`pflut.calibration.Coverage.masses`).
    level : float
        Of the band around the diagonal in which a calibrated posterior's share would be, at each
        mass by itself, with so many pairs as the shortest curve has.
    title : str, optional

    Returns
    -------
    Figure

    Raises
    ------
    ValueError
        If a curve has no pairs, or there is no curve.
    """
    curves = {name: np.sort(np.asarray(values, np.float64)) for name, values in masses.items()}
    fewest = min((len(values) for values in curves.values()), default=0)
    if not fewest:
        raise ValueError("masses: expected at least one pair in every curve")
    figure = new_figure(5.6, 5.4)
    axes = figure.add_subplot()
    expected = np.linspace(0.0, 100.0, 201)
    # the shares that the Wilson interval would not tell from the expected one
    deviations = NormalDist().inv_cdf(0.5 + level / 2.0)
    spread = deviations * np.sqrt(expected * (100.0 - expected) / fewest)
    axes.fill_between(
        expected,
        np.maximum(expected - spread, 0.0),
        np.minimum(expected + spread, 100.0),
        color=GREY,
        alpha=0.25,
        linewidth=0,
        label=f"calibrated: {100 * level:g} % band of {fewest} pairs",
    )
    axes.plot(expected, expected, color=GREY, linewidth=0.8)
    for color, (name, values) in zip(CYCLE * len(curves), curves.items(), strict=False):
        shares = np.append(np.arange(len(values) + 1), len(values)) * (100.0 / len(values))
        x = 100.0 * np.concatenate([[0.0], values, [1.0]])
        axes.step(x, shares, where="post", color=color, linewidth=1.4, label=name)
    axes.set(
        xlim=(0.0, 100.0),
        ylim=(0.0, 100.0),
        aspect="equal",
        xlabel="mass of the credible region [%]",
        ylabel="regions that hold the true pose [%]",
    )
    tidy(axes)
    if title:
        axes.set_title(title)
    axes.legend(frameon=False, fontsize=9, loc="upper left")
    return figure
