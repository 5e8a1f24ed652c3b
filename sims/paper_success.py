"""Find relative poses in the paper's simulator: success and error against the mismatch rate.

    python sims/paper_success.py [--quick] [--output DIR]

Two tables of 128 bins on the same pairs, each with the polish: one whose mismatches have uniform
azimuths (the default), one with the paper's simulated mismatches. Success: both headings within
0.1 rad. Prints the table, writes a CSV and a figure.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
from tqdm import tqdm

from pflut import Correspondences, CorrespondenceSimulator, LikelihoodTable, estimate_relative_pose
from pflut.evaluation import relative_pose_errors, success_rate
from pflut.plot import plot_error_against, save_figure

MISMATCHES = (0.0, 0.5, 0.7, 0.8, 0.85, 0.9, 0.93, 0.95)
SUCCESS = 0.1
COLUMNS = ("table", "correspondences", "mismatch", "success", "low", "high")
COLUMNS += ("median_rad", "rotation_rad")


def run(table: LikelihoodTable, count: int, mismatch: float, pairs: int) -> np.ndarray:
    """Give the heading errors of R and L and the rotation errors of some pairs, (pairs, 3)."""
    simulator = CorrespondenceSimulator(mismatch=mismatch)
    headings, bearings = simulator.sample(pairs, count, rng=1)
    estimates = [estimate_relative_pose(Correspondences(*pair.T), table) for pair in bearings]
    theta = np.array([estimate.heading_l for estimate in estimates])
    phi = np.array([estimate.heading_r for estimate in estimates])
    error_l, rotation = relative_pose_errors(theta, phi, *headings.T)
    error_r, _ = relative_pose_errors(phi, theta, *headings.T[::-1])
    return np.stack([error_l, error_r, rotation], axis=1)


def main() -> None:
    """Run all cells."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="200 pairs a cell instead of 2,000")
    parser.add_argument("--output", type=Path, default=Path("results/paper_success"))
    arguments = parser.parse_args()
    pairs = 200 if arguments.quick else 2000
    tables = {
        "uniform mismatches": LikelihoodTable.default(),
        "the paper's mismatches": LikelihoodTable.from_simulation(mismatches="simulated"),
    }
    arguments.output.mkdir(parents=True, exist_ok=True)
    cells = [(n, share) for n in (25, 100) for share in MISMATCHES]
    rows, drawn = [], {n: {name: [] for name in tables} for n in (25, 100)}
    for count, share in tqdm(cells, unit="cell", disable=None):
        for name, table in tables.items():
            errors = run(table, count, share, pairs)
            larger = errors[:, :2].max(axis=1)
            rate = success_rate(larger < SUCCESS)
            row = (name, count, share, rate.rate, rate.low, rate.high)
            rows.append((*row, np.median(larger), np.median(errors[:, 2])))
            drawn[count][name].append(np.degrees(errors[:, 0]))
    print(f"{pairs} pairs a cell, seed 1; success: both headings within {SUCCESS} rad")
    print("table                       n  mismatch  success  95 % interval   median [rad]")
    for name, count, share, value, low, high, median, _ in rows:
        interval = f"{low:.3f} to {high:.3f}"
        print(f"{name:24}{count:5}{share:10.2f}{value:9.3f}  {interval} {median:13.4f}")
    with (arguments.output / "success.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows(rows)
    for count, methods in drawn.items():
        x = np.repeat(np.arange(len(MISMATCHES)), pairs)
        figure = plot_error_against(
            x,
            {name: np.concatenate(errors) for name, errors in methods.items()},
            xlabel="mismatches [%]",
            bins=np.arange(len(MISMATCHES) + 1) - 0.5,
            logarithmic=True,
            title=f"{count} correspondences, {pairs} pairs a point",
        )
        figure.axes[0].set_xticks(
            range(len(MISMATCHES)), [f"{100 * share:.0f}" for share in MISMATCHES]
        )
        save_figure(figure, arguments.output / f"error_{count}.png")
    print(f"written: {arguments.output}")


if __name__ == "__main__":
    main()
