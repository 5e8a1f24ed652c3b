"""The figures of campaigns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pflut.campaign.outcome import DriveOutcome
from pflut.campaign.summary import calibration_curve
from pflut.plot.reliability import draw_reliability
from pflut.plot.style import CYCLE, GREY, new_figure, tidy

COLORS = (*CYCLE, GREY)
"""As many as there are filters."""
Group = Mapping[str, Sequence[DriveOutcome]]
"""Drives by a name: of a filter, or of a campaign."""
FEWEST = 10  # images of a class whose share is drawn


def convergence_figure(group: Group, *, scenario: str) -> Figure:
    """Draw after how many images drives are localized, and again after a kidnapping.

    Parameters
    ----------
    group : mapping of str to sequence of DriveOutcome
        Of one scenario.
    scenario : str
        For the title.

    Returns
    -------
    Figure
    """
    carried = any(o.kidnapped_at is not None for some in group.values() for o in some)
    figure = new_figure(9.0 if carried else 5.4, 3.8)
    axes = figure.subplots(1, 2 if carried else 1, sharey=True, squeeze=False)[0]
    converged = {name: [o.converged_at for o in some] for name, some in group.items()}
    _draw_shares(axes[0], converged, "images from the start")
    if carried:
        recovered = {
            name: [o.recovered_at for o in some if o.kidnapped_at is not None]
            for name, some in group.items()
        }
        _draw_shares(axes[1], recovered, "images after the robot was carried away")
    axes[0].set_ylabel("share of drives localized from there on")
    _legend_below(figure, axes[0])
    figure.suptitle(f"{scenario}: {max(map(len, group.values()))} drives")
    return figure


def _draw_shares(panel: Axes, group: Mapping[str, Sequence[int | None]], label: str) -> None:
    """Draw the distribution functions of the images that it took, None where it never came."""
    taken = {
        name: np.sort([index + 1 for index in found if index is not None])
        for name, found in group.items()
    }
    end = max(20.0, *(1.05 * float(images.max(initial=1)) for images in taken.values()))
    # narrower and narrower, so that curves that coincide are all seen
    widths = np.linspace(1.4 + 0.8 * min(len(taken) - 1, 3), 1.4, len(taken))
    styles = zip(COLORS * len(taken), widths, taken.items(), strict=False)
    for color, width, (name, images) in styles:
        share = np.arange(len(images) + 1) / max(len(group[name]), 1)
        x, y = [0.0, *images, end], [*share, share[-1]]
        panel.step(x, y, where="post", color=color, linewidth=width, label=name)
    panel.set(xlabel=label, ylim=(-0.03, 1.03), xlim=(0.0, end))
    panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    tidy(panel)


def errors_figure(group: Mapping[tuple[str, str], Sequence[DriveOutcome]]) -> Figure:
    """Draw the drives' median errors once localized, and how many are, by scenario and name.

    Parameters
    ----------
    group : mapping of (str, str) to sequence of DriveOutcome
        By scenario and a name.

    Returns
    -------
    Figure
    """
    scenarios = list(dict.fromkeys(scenario for scenario, _ in group))
    names = list(dict.fromkeys(name for _, name in group))
    figure = new_figure(max(6.0, 2.5 + 1.1 * len(scenarios)), 8.0)
    rows = figure.subplots(3, 1, sharex=True)
    width = 0.8 / len(names)
    for k, (color, name) in enumerate(zip(COLORS * len(names), names, strict=False)):
        for at, scenario in enumerate(scenarios):
            some = group.get((scenario, name), ())
            if not some:
                continue
            x = at + width * (k + 0.5) - 0.4
            share = np.mean([bool(o.localized[-1]) for o in some])
            rows[0].bar(x, share, 0.9 * width, color=color, label=name)
            done = [o for o in some if o.localized.any()]
            for panel, field in ((rows[1], "position_m"), (rows[2], "heading_deg")):
                medians = [
                    np.median(np.abs(np.asarray(getattr(o, field))[o.localized])) for o in done
                ]
                if medians:
                    low, middle, high = np.quantile(medians, (0.1, 0.5, 0.9))
                    panel.plot([x, x], [low, high], color=color, linewidth=1.2)
                    panel.plot(x, middle, "o", color=color, markersize=4)
    rows[0].set(ylabel="share localized at the end", ylim=(0.0, 1.02))
    rows[1].set(ylabel="position error [m]", yscale="log")
    rows[2].set(ylabel="heading error [deg]", yscale="log")
    rows[2].set_xticks(range(len(scenarios)), scenarios)
    for panel in rows:
        tidy(panel)
        panel.set_xlim(-0.5, len(scenarios) - 0.5)
    _legend_below(figure, rows[0])
    figure.suptitle(
        "drives' median errors once localized:\ntheir median, and the middle 80 % of them"
    )
    return figure


def _legend_below(figure: Figure, panel: Axes) -> None:
    """Explain a panel's colors below all panels, each once, in as many columns as there is room."""
    handles, labels = panel.get_legend_handles_labels()
    by_label = dict(zip(labels, handles, strict=True))
    columns = int(12.0 * figure.get_figwidth() / (max(map(len, by_label)) + 7))
    figure.legend(
        by_label.values(),
        by_label,
        loc="outside lower center",
        ncols=max(columns, 1),
        frameon=False,
        fontsize=9,
    )


def confidence_figure(group: Group, *, title: str | None = None) -> Figure:
    """Draw the calibration curve of the confidences: predicted against observed.

    Classes of fewer than ten images are left out.

    Parameters
    ----------
    group : mapping of str to sequence of DriveOutcome
    title : str, optional

    Returns
    -------
    Figure
    """
    figure = new_figure(5.6, 5.4)
    axes = figure.add_subplot()
    curves = {
        name: [part for part in calibration_curve(some) if part.count >= FEWEST]
        for name, some in group.items()
    }
    draw_reliability(axes, curves, COLORS)
    axes.set(
        aspect="equal",
        xlabel="confidence [%]",
        ylabel="estimates within 0.5 m and 10 degrees [%]",
    )
    tidy(axes)
    _legend_below(figure, axes)
    if title:
        axes.set_title(title)
    return figure
