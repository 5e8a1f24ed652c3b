"""Sum up many drives: how many were localized, how soon, how well, and whether they knew it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pflut.campaign.outcome import DriveOutcome
from pflut.evaluation import bootstrap_median, success_rate, summarize
from pflut.reliability import CalibrationBin, reliability_curve, share_interval

WITHIN = 6
RECOVERED_WITHIN = 15
SURE = 0.9


def read_campaign(folder: Path) -> list[DriveOutcome]:
    """Read all outcomes that a campaign has kept.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    list of DriveOutcome
        By scenario, filter and seed.

    Raises
    ------
    ValueError
        If the folder holds no campaign, or a file in it is damaged.
    """
    if not (folder / "settings.json").is_file():
        raise ValueError(f"{folder}: expected a folder of pflut simulate, with settings.json")
    files = sorted(folder.glob("*/*/seed_*.json"))
    if not files:
        raise ValueError(f"{folder}: no drive is done yet")
    return sorted(map(DriveOutcome.load, files), key=lambda o: (o.scenario, o.filter, o.seed))


def groups(outcomes: Iterable[DriveOutcome]) -> dict[tuple[str, str], list[DriveOutcome]]:
    """Sort drives by scenario and filter, in the order in which they come first."""
    sorted_out: dict[tuple[str, str], list[DriveOutcome]] = {}
    for outcome in outcomes:
        sorted_out.setdefault((outcome.scenario, outcome.filter), []).append(outcome)
    return sorted_out


def summarize_outcomes(
    outcomes: Sequence[DriveOutcome],
    *,
    within: int = WITHIN,
    recovered_within: int = RECOVERED_WITHIN,
) -> dict[str, Any]:
    """Sum up drives of one scenario and filter.

    Parameters
    ----------
    outcomes : sequence of DriveOutcome
        At least one.
    within, recovered_within : int
        A drive is a success if it converges within so many images, and after the robot was carried
        away within so many more.

    Returns
    -------
    dict
        Rates with Wilson intervals; images until convergence and recovery; the drives' median
        errors on the images after it, their median with a bootstrap interval; the share of images
        that are sure (confidence above 0.9) and wrong, and of those that hold the truth among their
        hypotheses, with intervals by bootstrap over drives;
        milliseconds an image, without features.
    """
    ordered = sorted(outcomes, key=lambda outcome: outcome.seed)
    carried = [outcome for outcome in ordered if outcome.kidnapped_at is not None]
    converged = [_soon(outcome.converged_at, within) for outcome in ordered]
    recovered = [_soon(outcome.recovered_at, recovered_within) for outcome in carried]
    localized = [outcome for outcome in ordered if outcome.localized.any()]
    summary: dict[str, Any] = {
        "scenario": ordered[0].scenario,
        "filter": ordered[0].filter,
        "drives": len(ordered),
        "images": sum(map(len, ordered)),
        "within_images": within,
        "converged": success_rate(converged).as_dict(),
        "failed_seeds": [o.seed for o, ok in zip(ordered, converged, strict=True) if not ok],
        "images_to_convergence": _count_to(o.converged_at for o in ordered),
        "recovered_within_images": recovered_within,
        "recovered": success_rate(recovered).as_dict() if carried else None,
        "unrecovered_seeds": [o.seed for o, ok in zip(carried, recovered, strict=True) if not ok],
        "images_to_recovery": _count_to(o.recovered_at for o in carried),
    }
    for name in ("position_m", "heading_deg"):
        medians = [summarize(np.asarray(getattr(o, name))[o.localized]).median for o in localized]
        low, high = bootstrap_median(medians, rng=0) if medians else (None, None)
        summary[name] = {
            **summarize(medians).as_dict(),
            "median_low": low,
            "median_high": high,
            "all_images": summarize(
                np.concatenate([np.asarray(getattr(o, name)) for o in ordered])
            ).as_dict()["median"],
        }
    sure = [np.array(outcome.confidence) > SURE for outcome in ordered]
    wrong = [int((s & ~o.good).sum()) for s, o in zip(sure, ordered, strict=True)]
    summary["held"] = _share([sum(o.held) for o in ordered], list(map(len, ordered)))
    summary["sure"] = sum(map(np.count_nonzero, sure)) / summary["images"]
    summary["sure_and_wrong"] = _share(wrong, list(map(len, ordered)))
    milliseconds = 1e3 * np.concatenate([outcome.seconds for outcome in ordered])
    summary["ms_per_image"] = summarize(milliseconds).as_dict()["median"]
    summary["particles"] = float(np.mean(np.concatenate([o.num_particles for o in ordered])))
    summary["degenerate"] = sum(outcome.degenerate for outcome in ordered)
    return summary


def calibration_curve(
    outcomes: Sequence[DriveOutcome], *, edges: Sequence[float] | None = None
) -> list[CalibrationBin]:
    """Compare the confidences with how often the estimates were right.

    Parameters
    ----------
    outcomes : sequence of DriveOutcome
    edges : sequence of float, optional
        Of the classes of confidence. By default tenths, and finer ones near one.

    Returns
    -------
    list of CalibrationBin
        Classes without images are left out. Happened means within 0.5 m and 10 degrees of the
        truth; intervals are by bootstrap over drives, the images of one being dependent.
    """
    bounds = [*np.arange(0.0, 0.85, 0.1), 0.9, 0.95, 0.99, 1.0] if edges is None else edges
    if not outcomes:
        return []
    return reliability_curve(
        np.concatenate([outcome.confidence for outcome in outcomes]),
        np.concatenate([outcome.good for outcome in outcomes]),
        edges=bounds,
        groups=np.repeat(np.arange(len(outcomes)), [len(outcome) for outcome in outcomes]),
    )


def _soon(index: int | None, within: int) -> bool:
    return index is not None and index < within


def _count_to(indices: Iterable[int | None]) -> dict[str, Any]:
    """Sum up how many images it took, where it happened."""
    return summarize([index + 1 for index in indices if index is not None]).as_dict()


def _share(hits: Sequence[int], counts: Sequence[int]) -> dict[str, float]:
    """Give the share of hits and its interval, by bootstrap over drives."""
    low, high = share_interval(hits, counts)
    return {"share": sum(hits) / sum(counts), "low": low, "high": high}
