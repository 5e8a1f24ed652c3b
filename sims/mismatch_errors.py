"""Errors against the share of mismatches: Figures 6a and 6e.

    python sims/mismatch_errors.py [--quick] [--correspondences 100 25] [--output DIR]

Pairs of the paper's simulator. The paper's estimators: RANSAC + M-estimator with eight, three and
two points, and its table, with its simulated mismatches and with uniform ones, not polished. Ours:
the default table, and the 2-point RANSAC at its best. Prints medians and MADs of the heading and
the rotation error, the share of pairs with both headings within 0.1 rad, and from which share of
mismatches on an estimator finds less than nine in ten, and less than half. Writes a CSV and a
figure a number of correspondences.

To expect: the 8-point is the first to fail, the default table the last; below 60 % the paper's
tables are less accurate than the RANSACs, by their cells, and the default table is not.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from tqdm import tqdm

from pflut import CorrespondenceSimulator, DenseTable, LikelihoodTable
from pflut._files import write_csv
from pflut.comparison import PAPER_RANSAC, Estimator, by_ransac, by_table, compare_estimators
from pflut.evaluation import median_absolute_deviation
from pflut.pair_errors import PairErrors
from pflut.plot import plot_medians, save_figure

MISMATCHES = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.99)
COLUMNS = ("correspondences", "mismatch", "estimator", "pairs", "heading_median_deg")
COLUMNS += ("heading_mad_deg", "rotation_median_deg", "rotation_mad_deg", "found", "ms_a_pair")
Row = tuple[int, float, str, int, float, float, float, float, float, float]


def estimators(quick: bool) -> dict[str, Estimator]:
    """Give what is compared."""
    samples = 16_000_000 if quick else 64_000_000
    simulated = DenseTable.from_simulation(num_samples=samples, mismatches="simulated")
    return {
        **{
            f"paper's {size}-point RANSAC": by_ransac(solver=f"{size}pt", **PAPER_RANSAC)
            for size in (8, 3, 2)
        },
        "paper's table": by_table(simulated, polish=False),
        "paper's table, uniform mismatches": by_table(DenseTable.default(), polish=False),
        "default table": by_table(LikelihoodTable.default()),
        "2-point RANSAC at its best": by_ransac(),
    }


def row(count: int, mismatch: float, name: str, errors: PairErrors) -> Row:
    """Give the row of the CSV."""
    heading, rotation = np.degrees(errors.heading_l), np.degrees(errors.rotation)
    return (
        count,
        mismatch,
        name,
        len(heading),
        float(np.median(heading)),
        median_absolute_deviation(heading),
        float(np.median(rotation)),
        median_absolute_deviation(rotation),
        float(np.mean(errors.found)),
        1e3 * errors.seconds,
    )


def report(rows: list[Row], names: list[str]) -> None:
    """Print medians, MADs and shares of one number of correspondences, and where each fails."""
    print(f"\n{rows[0][0]} correspondences, {rows[0][3]} pairs a share, seed 1")
    for title, column in (("heading", 4), ("rotation", 6), ("found", 8)):
        unit = "share of pairs" if title == "found" else "error_deg, median (MAD)"
        print(f"{f'{title}, {unit}':34}" + "".join(f"{share:>13.0%}" for share in MISMATCHES))
        for name in names:
            own = [one for one in rows if one[2] == name]
            if title == "found":
                cells = [f"{one[column]:.3f}" for one in own]
            else:
                cells = [f"{one[column]:.2f} ({one[column + 1]:.2f})" for one in own]
            print(f"{name:34}" + "".join(f"{cell:>13}" for cell in cells))
    for name in names:
        lost = (
            next((f"{one[1]:.0%}" for one in rows if one[2] == name and one[8] < share), "nowhere")
            for share in (0.9, 0.5)
        )
        print(f"{name:34}finds less than 9 in 10 from {', less than half from '.join(lost)}")


def main() -> None:
    """Compare at all shares, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="200 pairs a share instead of 1,000")
    parser.add_argument("--correspondences", type=int, nargs="+", default=[100, 25])
    parser.add_argument("--output", type=Path, default=Path("results/mismatch_errors"))
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    pairs = 200 if arguments.quick else 1_000
    compared_ones = estimators(arguments.quick)
    names = list(compared_ones)
    rows = []
    steps = len(arguments.correspondences) * len(MISMATCHES) * len(names)
    with tqdm(total=steps, unit="estimator", disable=None) as bar:
        for count in arguments.correspondences:
            by_share = []
            for mismatch in MISMATCHES:
                simulator = CorrespondenceSimulator(mismatch=mismatch)
                made, headings = simulator.pairs(pairs, count, rng=1)
                by_share.append(
                    compare_estimators(
                        compared_ones, made, headings, progress=lambda _: bar.update()
                    )
                )
                rows += [row(count, mismatch, *item) for item in by_share[-1].items()]
            panels = {
                f"{kind} error [deg]": {
                    name: [np.degrees(getattr(one[name], field)) for one in by_share]
                    for name in names
                }
                for kind, field in (("heading", "heading_l"), ("rotation", "rotation"))
            }
            # at even distances, so that what stands beside each other does not meet its neighbours
            places = np.arange(len(MISMATCHES))
            figure = plot_medians(
                places,
                panels,
                xlabel="mismatches [%]",
                title=f"{count} correspondences, {pairs:,} pairs a share",
            )
            for axes in figure.axes:
                axes.set_xticks(places, [f"{100.0 * share:g}" for share in MISMATCHES])
            save_figure(figure, arguments.output / f"mismatch_errors_{count}.png")
    for count in arguments.correspondences:
        report([one for one in rows if one[0] == count], names)
    write_csv(arguments.output / "mismatch_errors.csv", COLUMNS, rows)
    print(f"written: {arguments.output}")


if __name__ == "__main__":
    main()
