"""Time a pair of 25 matches, and what it buys: Table I.

    python sims/time_per_pair.py [--quick] [--output DIR]

CPU time on one core of the paper's table with 128, 64, 32 and 16 bins (the highest cell, no more),
its RANSAC + M-estimator with eight, three and two points, the default table's estimate, and the
2-point RANSAC at its best, with 1,000 iterations and with as many as it needs (confidence 0.999).
All estimate the same pairs of the paper's simulator, 80 % mismatches, in turn, many times; times
are medians. Beside them the paper's own times, on a Pentium of 2 GHz, the ratios to the table of
128 bins and to the 3-point RANSAC, here and there, and what is found: the median error of the
heading, and the share of pairs with both headings within 0.1 rad. Prints a table, writes a CSV and
a figure of both against time.

To expect: halving the bins takes a third of the time from 128 to 64, and less below, where a call a
pair is most of what remains. The planar RANSACs, all pairs in one call, gained more than the table
of 128 bins since the paper, which had the 3-point three times slower than it: here it is four to
five times faster. The default estimate takes little more than half the time of that table and finds
most.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from pflut import (
    CorrespondenceSimulator,
    DenseTable,
    LikelihoodTable,
)
from pflut._files import write_csv
from pflut.comparison import (
    PAPER_RANSAC,
    Estimator,
    by_maximum,
    by_ransac,
    by_table,
    compare_estimators,
)
from pflut.evaluation import median_absolute_deviation
from pflut.pair_errors import PairErrors
from pflut.plot import save_figure
from pflut.plot.style import CYCLE, new_figure, tidy

COUNT, MISMATCH = 25, 0.8
BINS = (128, 64, 32, 16)
TABLE, RANSAC = "paper's table, 128 bins", "paper's RANSAC, 3 points"
DEFAULT, BEST, ADAPTIVE = "default table", "2-point at its best", "2-point, adaptive"
TICKS_US, TICKS_DEG = (10, 20, 50, 100, 200, 500), (1, 2, 5, 10, 20, 50, 100)
#: Milliseconds of the paper's Table I.
PAPER_MS = {
    **dict(
        zip([f"paper's table, {bins} bins" for bins in BINS], (1.3, 0.28, 0.07, 0.036), strict=True)
    ),
    **dict(zip([f"paper's RANSAC, {n} points" for n in (8, 3, 2)], (3.6, 3.8, 0.68), strict=True)),
}
COLUMNS = ("estimator", "ms", "least_ms", "paper_ms", "ratio_to_table", "ratio_to_3pt")
COLUMNS += ("heading_median_deg", "heading_mad_deg", "found")


def learned(bins: int, quick: bool) -> DenseTable:
    """Learn the paper's table; one of fewer cells from fewer samples."""
    samples = (16_000_000 if quick else 64_000_000) * bins // max(BINS)
    return DenseTable.from_simulation(bins=bins, num_samples=samples)


def estimators(quick: bool) -> dict[str, Estimator]:
    """Give what is compared."""
    found = {
        f"paper's table, {bins} bins": by_maximum(learned(bins, quick))
        for bins in tqdm(BINS, desc="learning", unit="table", disable=None)
    }
    for size in (8, 3, 2):
        found[f"paper's RANSAC, {size} points"] = by_ransac(solver=f"{size}pt", **PAPER_RANSAC)
    found[DEFAULT] = by_table(LikelihoodTable.default())
    found[BEST] = by_ransac()
    found[ADAPTIVE] = by_ransac(confidence=0.999)
    return found


def draw(times: dict[str, float], errors: dict[str, PairErrors]) -> Figure:
    """Draw error and share found against time; bins and points are written beside the marks."""
    families = (
        ("paper's table, bins", [name for name in times if name.startswith("paper's table")], "D-"),
        ("paper's RANSAC, points", [name for name in times if "paper's RANSAC" in name], "s"),
        ("2-point RANSAC at its best", [BEST], "^"),
        ("the same, adaptive", [ADAPTIVE], "v"),
        ("default table", [DEFAULT], "*"),
    )
    figure = new_figure(10.0, 4.8)
    left, right = figure.subplots(1, 2)
    error = {name: float(np.degrees(np.median(one.heading_l))) for name, one in errors.items()}
    found = {name: float(np.mean(one.found)) for name, one in errors.items()}
    for axes, values in ((left, error), (right, found)):
        for color, (label, names, style) in zip(CYCLE, families, strict=False):
            x, y = [1e3 * times[name] for name in names], [values[name] for name in names]
            size = 12 if style == "*" else 6
            axes.plot(x, y, style, color=color, markersize=size, linewidth=1.0, label=label)
            for name, place in zip(names, zip(x, y, strict=True), strict=True):
                number = "".join(filter(str.isdigit, name)) if len(names) > 1 else ""
                # beside its mark, or off the line, which falls on the left and rises on the right
                offset = (9, -3) if style != "D-" else (-9 if axes is left else 9, -9)
                axes.annotate(
                    number, place, offset, textcoords="offset points", ha="center", fontsize=8
                )
        axes.set(xlabel="CPU time a pair [µs]", xscale="log", xlim=(8, 500))
        axes.set_xticks(TICKS_US, [str(tick) for tick in TICKS_US])
        axes.set_xticks([], minor=True)
        tidy(axes)
    left.set(ylabel="median heading error [deg]", yscale="log", ylim=(0.7, 100))
    left.set_yticks(TICKS_DEG, [str(tick) for tick in TICKS_DEG])
    left.set_yticks([], minor=True)
    right.set(ylabel="pairs found: both headings within 0.1 rad", ylim=(-0.02, 1))
    handles = left.get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def main() -> None:
    """Time, compare, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer samples, pairs and repeats")
    parser.add_argument("--output", type=Path, default=Path("results/time_per_pair"))
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    pairs, repeats = (300, 15) if arguments.quick else (2_000, 31)
    compared = estimators(arguments.quick)
    made, headings = CorrespondenceSimulator(mismatch=MISMATCH).pairs(pairs, COUNT, rng=1)
    # in turn, so that what else the machine does meets all of them
    runs = [
        compare_estimators(compared, made, headings)
        for _ in tqdm(range(repeats), desc="timing", unit="round", disable=None)
    ]
    errors = runs[0]
    seconds = {name: [run[name].seconds for run in runs] for name in compared}
    times = {name: 1e3 * float(np.median(values)) for name, values in seconds.items()}
    rows = []
    print(
        f"{pairs} pairs of {COUNT} correspondences, {MISMATCH:.0%} mismatches, seed 1; "
        f"{repeats} rounds\n{'':28}{'ms a pair':>20}{'to 128 bins':>18}{'to 3 points':>18}"
        f"{'heading error_deg':>20}\n{'estimator':28}{'here':>10}{'paper':>10}"
        f"{'here':>10}{'paper':>8}{'here':>10}{'paper':>8}{'median (MAD)':>20}{'found':>8}"
    )
    for name, time in times.items():
        theirs = PAPER_MS.get(name)
        to_table, to_ransac = time / times[TABLE], time / times[RANSAC]
        heading = np.degrees(errors[name].heading_l)
        median, mad = float(np.median(heading)), median_absolute_deviation(heading)
        found = float(np.mean(errors[name].found))
        least = 1e3 * min(seconds[name])
        rows.append((name, time, least, theirs, to_table, to_ransac, median, mad, found))
        paper = [
            f"{theirs / one:.3g}" if theirs else ""
            for one in (1.0, PAPER_MS[TABLE], PAPER_MS[RANSAC])
        ]
        print(
            f"{name:28}{time:10.4f}{paper[0]:>10}{to_table:10.3f}{paper[1]:>8}"
            f"{to_ransac:10.2f}{paper[2]:>8}{f'{median:.2f} ({mad:.2f})':>20}{found:8.3f}"
        )
    write_csv(arguments.output / "time_per_pair.csv", COLUMNS, rows)
    save_figure(draw(times, errors), arguments.output / "time_per_pair.png")
    print(f"written: {arguments.output}")


if __name__ == "__main__":
    main()
