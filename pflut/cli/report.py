"""The table that a replay ends with."""

from __future__ import annotations

import numpy as np

from pflut.evaluation import CONVERGED_HEADING, CONVERGED_POSITION, TrajectoryErrors
from pflut.geometry import FloatArray
from pflut.replay.result import ReplayResult
from pflut.statistics import summarize

_STAGES = {
    "image": "reading the image",
    "features": "features",
    "predict": "moving particles",
    "match": "matching references",
    "likelihood": "likelihoods",
    "weights": "weights, estimate, resampling",
    "search": "search of all poses",
}


def replay_report(result: ReplayResult) -> str:
    """Write a replay's outcome as plain text.

    Parameters
    ----------
    result : ReplayResult

    Returns
    -------
    str
        Several lines.
    """
    dataset, options = result.dataset, result.options
    lines = [
        "",
        f"{dataset.name}: {len(result)} images, {len(dataset.reference_indices)} references, "
        + (
            "each image on its own"
            if result.each_on_its_own
            else f"{options.num_particles} particles, {_start(result)}, seed {options.seed}"
        ),
    ]
    if result.skipped:
        lines.append(f"{len(result.skipped)} images without odometry were left out")
    if result.errors is None:
        lines.append("no ground truth: no errors")
    else:
        lines += ["", _row("", "median", "MAD", "RMSE", "90 %", "max")]
        start = result.errors.converged_at
        if result.each_on_its_own:
            lines += _errors("all images", result.errors)
            lines += ["", _success(result)]
        else:
            if start is None or start > 0:
                lines += _errors("all images", result.errors)
            if start is not None:
                after = "all images" if start == 0 else f"from image {start + 1} on"
                lines += _errors(after, result.errors[start:])
            if result.odometry_errors is not None:
                lines += _errors(
                    "odometry alone, from the true start", result.odometry_errors, track=False
                )
            lines += ["", _convergence(result, start)]
    lines += ["", *_health(result), "", *_times(result)]
    return "\n".join(lines)


def _row(name: str, *values: str) -> str:
    return f"{name:<32}" + "".join(f"{value:>10}" for value in values)


def _number(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "-"


def _errors(title: str, errors: TrajectoryErrors, *, track: bool = True) -> list[str]:
    """Give the rows of one group of errors."""
    rows: list[tuple[str, FloatArray]] = [
        ("position error [m]", errors.position),
        ("heading error [deg]", np.degrees(errors.heading)),
    ]
    if track:
        rows += [("  along track [m]", errors.along_track)]
        rows += [("  across track [m]", errors.cross_track)]
    lines = [title]
    for name, values in rows:
        s = summarize(values)
        numbers = (s.median, s.mad, s.rmse, s.percentile_90, s.maximum)
        lines.append(_row(f"  {name}", *map(_number, numbers)))
    return lines


def _start(result: ReplayResult) -> str:
    start = result.options.start
    if isinstance(start, str):
        return "globally lost" if start == "lost" else "started at the truth"
    x, y, heading = start
    return f"started at {x:g}, {y:g}, {np.degrees(heading):g} deg"


def _convergence(result: ReplayResult, start: int | None) -> str:
    assert result.errors is not None
    limit = f"{CONVERGED_POSITION:g} m and {np.degrees(CONVERGED_HEADING):g} deg"
    known = result.errors[~np.isnan(result.errors.position)]
    share = known.within(CONVERGED_POSITION, CONVERGED_HEADING).mean()
    text = f"{100 * share:.0f} % of the images are within {limit}"
    if start is None:
        return f"{text}; not converged, for the last one is not"
    lost = result.options.start == "lost"
    return f"{text}; {'converged' if lost else 'all'} from image {start + 1} of {len(result)} on"


def _success(result: ReplayResult) -> str:
    s = result.success()
    text = (
        f"within {s['within_m']:g} m and {s['within_deg']:g} deg: {s['successes']} of {s['count']}"
        f" ({100 * s['rate']:.0f} %, 95 % interval {100 * s['low']:.0f} to {100 * s['high']:.0f} %)"
        if s["count"]
        else "no image has a true pose"
    )
    failures = s["count"] - s["successes"]
    if failures and s["successes"]:
        text += (
            f"\n{s['unsure_failures']} of the {failures} others are less confident than the "
            f"median of these ({s['confidence_of_failures']:.2f} against "
            f"{s['confidence_of_successes']:.2f} in the median)"
        )
    return text


def _health(result: ReplayResult) -> list[str]:
    """Say how sure the estimates are, and how the filter fared."""
    matches = summarize([step.num_matches for step in result.steps])
    references = summarize([step.num_references for step in result.steps])
    confidence = summarize(result.confidence)
    lines = [
        f"confidence {confidence.median:.3f} in the median, {result.confidence.min():.3f} at least",
        f"{matches.median:.0f} matches with {references.median:.0f} references an image "
        "in the median",
    ]
    estimates = [step.estimate for step in result.steps]
    if not result.each_on_its_own:
        effective = summarize([estimate.effective_sample_size for estimate in estimates])
        lines.append(
            f"effective sample size {effective.median:.0f} in the median, "
            f"resampled {sum(e.resampled for e in estimates)} times, "
            f"{sum(e.degenerate for e in estimates)} images ignored as degenerate"
        )
    return lines


def _times(result: ReplayResult) -> list[str]:
    """Give the time of each stage."""
    lines = [_row("time per image [ms]", "median", "90 %")]
    for stage, seconds in result.timings().items():
        numbers = (1e3 * seconds["median"], 1e3 * seconds["percentile_90"])
        lines.append(_row(f"  {_STAGES.get(stage, stage)}", *(f"{n:.2f}" for n in numbers)))
    total = summarize([sum(step.timings.values()) for step in result.steps])
    lines.append(_row("  all", f"{1e3 * total.median:.2f}", f"{1e3 * total.percentile_90:.2f}"))
    return lines
