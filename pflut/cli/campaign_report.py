"""What ``pflut simulate`` and ``pflut compare`` print and draw of many drives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pflut._files import write_json
from pflut.campaign.drives import Campaign, outcome_file
from pflut.campaign.filters import FILTERS
from pflut.campaign.outcome import DriveOutcome
from pflut.campaign.summary import (
    calibration_curve,
    groups,
    read_campaign,
    summarize_outcomes,
)
from pflut.simulation.scenarios import SCENARIOS

_HEAD = (
    f"{'scenario':12}{'filter':12}{'drives':>7}{'converged':>19}{'recovered':>19}"
    f"{'position [m]':>23}{'heading [deg]':>21}{'held':>9}{'sure and wrong':>16}{'ms':>7}"
)


def kept(folder: Path, campaign: Campaign, seeds: range) -> int:
    """Count the drives of a campaign that a folder holds."""
    return sum(
        outcome_file(folder, scenario, name, seed).is_file()
        for scenario in campaign.scenarios
        for name in campaign.filters
        for seed in seeds
    )


def in_order(outcomes: Sequence[DriveOutcome]) -> list[DriveOutcome]:
    """Sort drives as scenarios and filters are listed, then by seed."""
    rank = {name: place for place, name in enumerate((*SCENARIOS, *FILTERS))}
    last = len(rank)
    return sorted(
        outcomes, key=lambda o: (rank.get(o.scenario, last), rank.get(o.filter, last), o.seed)
    )


def write_report(
    folder: Path,
    outcomes: Sequence[DriveOutcome],
    record: Mapping[str, Any],
    *,
    within: int,
    recovered_within: int,
    figures: bool,
) -> None:
    """Write metrics, the record and figures of a campaign into its folder, and print the table.

    The table has the drives that were asked for, metrics and figures all that the folder holds.

    Parameters
    ----------
    folder : Path
    outcomes : sequence of DriveOutcome
        That were asked for.
    record : mapping
        For ``run.json``.
    within, recovered_within : int
        Images.
    figures : bool
    """
    images = {"within": within, "recovered_within": recovered_within}
    found = groups(in_order(read_campaign(folder)))
    curves = {
        "/".join(key): [vars(part) for part in calibration_curve(some)]
        for key, some in found.items()
    }
    summaries = [summarize_outcomes(some, **images) for some in found.values()]
    write_json(folder / "metrics.json", {"groups": summaries, "calibration": curves})
    write_json(folder / "run.json", dict(record))
    if figures:
        draw(folder / "figures", found)
    asked = groups(in_order(outcomes)).values()
    print_table([summarize_outcomes(some, **images) for some in asked])
    print(f"results: {folder}")


def print_table(summaries: Sequence[Mapping[str, Any]], labels: Sequence[str] = ()) -> None:
    """Print a line a scenario and filter.

    Parameters
    ----------
    summaries : sequence of mapping
        Of `summarize_outcomes`.
    labels : sequence of str, optional
        What stands at the end of each line.
    """
    print(_HEAD)
    for k, summary in enumerate(summaries):
        wrong = summary["sure_and_wrong"]
        print(
            f"{summary['scenario']:12}{summary['filter']:12}{summary['drives']:>7}"
            f"{_rate(summary['converged']):>19}{_rate(summary['recovered']):>19}"
            f"{_median(summary['position_m'], 3):>23}{_median(summary['heading_deg'], 2):>21}"
            f"{100 * summary['held']['share']:>7.1f} %{100 * wrong['share']:>14.2f} %"
            f"{summary['ms_per_image']:>7.1f}" + (f"  {labels[k]}" if labels else "")
        )
    first = summaries[0]
    print(
        f"converged within {first['within_images']} images and recovered within "
        f"{first['recovered_within_images']}, in % of the drives (95 % interval); errors once "
        "localized: medians of drives, their median (interval);\nheld: images with the truth among "
        "the hypotheses; sure and wrong: those with a confidence above 0.9 that are not within "
        "0.5 m and 10 degrees; ms an image, without features"
    )


def draw(folder: Path, found: Mapping[tuple[str, str], Sequence[DriveOutcome]]) -> None:
    """Write the figures of a campaign.

    Parameters
    ----------
    folder : Path
        Made if missing.
    found : mapping of (scenario, filter) to sequence of DriveOutcome
    """
    from pflut.campaign.figures import confidence_figure, convergence_figure, errors_figure
    from pflut.plot import save_figure

    folder.mkdir(exist_ok=True)
    scenarios = list(dict.fromkeys(scenario for scenario, _ in found))
    for scenario in scenarios:
        group = {name: some for (where, name), some in found.items() if where == scenario}
        save_figure(convergence_figure(group, scenario=scenario), folder / f"{scenario}.png")
    save_figure(errors_figure(found), folder / "errors.png")
    names = dict.fromkeys(name for _, name in found)
    by_filter = {
        name: [outcome for (_, of), some in found.items() if of == name for outcome in some]
        for name in names
    }
    title = scenarios[0] if len(scenarios) == 1 else "all scenarios"
    save_figure(confidence_figure(by_filter, title=title), folder / "confidence.png")


def _rate(rate: Mapping[str, Any] | None) -> str:
    """Write a rate with its interval, in percent."""
    if rate is None:
        return "-"
    return f"{100 * rate['rate']:.1f} ({100 * rate['low']:.0f} to {100 * rate['high']:.0f})"


def _median(numbers: Mapping[str, Any], digits: int) -> str:
    """Write a median with its interval."""
    if numbers["median_low"] is None:
        return "-"
    values = (numbers[name] for name in ("median", "median_low", "median_high"))
    return "{} ({} to {})".format(*(f"{value:.{digits}f}" for value in values))
