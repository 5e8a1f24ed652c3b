"""The figures of campaigns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from pflut.campaign.outcome import DriveOutcome
from pflut.campaign.summary import calibration_curve
from pflut.plot.style import CYCLE, GREY, new_figure, tidy

Group = Mapping[str, Sequence[DriveOutcome]]
"""Drives by a name: of a filter, or of a campaign."""


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
    panels = [("images from the start", [o.converged_at for some in group.values() for o in some])]
    axes = figure.subplots(1, 2 if carried else 1, sharey=True, squeeze=False)[0]
    if carried:
        panels.append(("images after the robot was carried away", []))
    for panel, (label, _) in zip(axes, panels, strict=True):
        for color, (name, some) in zip(CYCLE * len(group), group.items(), strict=False):
            late = panel is not axes[0]
            found = [o.recovered_at if late else o.converged_at for o in some]
            total = sum(o.kidnapped_at is not None for o in some) if late else len(some)
            _draw_shares(panel, found, total, name, color)
        panel.set(xlabel=label, ylim=(0.0, 1.02), xlim=(0.0, None))
        tidy(panel)
    axes[0].set_ylabel("share of drives localized from there on")
    axes[0].legend(frameon=False, fontsize=9, loc="lower right")
    figure.suptitle(f"{scenario}: {max(map(len, group.values()))} drives")
    return figure


def _draw_shares(panel, found: Sequence[int | None], total: int, name: str, color: str) -> None:  # type: ignore[no-untyped-def]
    """Draw the distribution function of the images that it took."""
    images = np.sort([index + 1 for index in found if index is not None])
    share = np.arange(1, len(images) + 1) / max(total, 1)
    end = max(20.0, 1.05 * float(images.max(initial=1)))
    x = np.concatenate([[0.0], images, [end]])
    y = np.concatenate([[0.0], share, share[-1:] if len(share) else [0.0]])
    panel.step(x, y, where="post", color=color, linewidth=1.4, label=name)


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
    figure = new_figure(2.5 + 1.1 * len(scenarios), 8.0)
    rows = figure.subplots(3, 1, sharex=True)
    width = 0.8 / len(names)
    for k, (color, name) in enumerate(zip(CYCLE * len(names), names, strict=False)):
        for at, scenario in enumerate(scenarios):
            some = group.get((scenario, name), ())
            if not some:
                continue
            x = at + width * (k + 0.5) - 0.4
            share = np.mean([bool(o.localized[-1]) for o in some])
            rows[0].bar(x, share, 0.9 * width, color=color, label=name if at == 0 else None)
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
    figure.legend(*_unique(rows[0]), loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    figure.suptitle("median errors of localized drives: median, and the middle 80 % of drives")
    return figure


def _unique(panel) -> tuple[list, list]:  # type: ignore[no-untyped-def,type-arg]
    """Give one handle a label, also of those that the first scenario lacks."""
    handles, labels = panel.get_legend_handles_labels()
    by_label = dict(zip(labels, handles, strict=True))
    return list(by_label.values()), list(by_label)


def confidence_figure(group: Group, *, title: str | None = None) -> Figure:
    """Draw the calibration curve of the confidences: predicted against observed.

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
    axes.plot([0, 100], [0, 100], color=GREY, linewidth=0.8)
    for color, (name, some) in zip(CYCLE * len(group), group.items(), strict=False):
        curve = calibration_curve(some)
        x = 100.0 * np.array([part.predicted for part in curve])
        y = 100.0 * np.array([part.observed for part in curve])
        low = y - 100.0 * np.array([part.low for part in curve])
        high = 100.0 * np.array([part.high for part in curve]) - y
        spread = np.maximum([low, high], 0.0)
        axes.errorbar(x, y, spread, color=color, marker="o", markersize=4, lw=1.2, label=name)
    axes.set(
        xlim=(0, 100),
        ylim=(0, 102),
        aspect="equal",
        xlabel="confidence [%]",
        ylabel="estimates within 0.5 m and 10 degrees [%]",
    )
    tidy(axes)
    axes.legend(frameon=False, fontsize=9, loc="upper left")
    if title:
        axes.set_title(title)
    return figure
