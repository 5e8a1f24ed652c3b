"""Errors against roll and pitch, with tables learned with and without them: Figures 6b and 6f.

    python sims/tilt.py [--quick] [--output DIR]

100 correspondences, 60 % of them mismatches. "con" is learned on the level floor, "rot" with a roll
and pitch up to 0.25 rad; each with the residual table and with the paper's. The estimates of the
paper's "rot" are not polished: the polish believes in the plane. Prints a table, writes a CSV and a
figure.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from pflut import (
    Correspondences,
    CorrespondenceSimulator,
    DenseTable,
    LikelihoodTable,
    estimate_relative_pose,
    estimate_relative_poses,
)
from pflut.evaluation import relative_pose_errors
from pflut.plot import save_figure

TILTS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25)
SUCCESS = 0.1


def main() -> None:
    """Run all tilts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="100 pairs a tilt instead of 400")
    parser.add_argument("--output", type=Path, default=Path("results/tilt"))
    arguments = parser.parse_args()
    pairs = 100 if arguments.quick else 400
    tilted = CorrespondenceSimulator(max_tilt=0.25)
    tables = {
        "con": LikelihoodTable.default(),
        "rot": LikelihoodTable.from_simulation(simulator=tilted),
        "the paper's, con": DenseTable.default(),
        "the paper's, rot": DenseTable.from_simulation(simulator=tilted),
    }
    arguments.output.mkdir(parents=True, exist_ok=True)
    rows = []
    for tilt in tqdm(TILTS, unit="tilt", disable=None):
        simulator = CorrespondenceSimulator(mismatch=0.6, max_tilt=tilt)
        headings, bearings = simulator.sample(pairs, 100, rng=1)
        made = [Correspondences(*pair.T) for pair in bearings]
        for name, table in tables.items():
            if isinstance(table, LikelihoodTable):
                found = estimate_relative_poses(made, table)
            else:
                polish = not name.endswith("rot")
                found = [estimate_relative_pose(pair, table, polish=polish) for pair in made]
            poses = np.array([[pose.heading_l, pose.heading_r] for pose in found])
            error_l, rotation = relative_pose_errors(*poses.T, *headings.T)
            error_r, _ = relative_pose_errors(*poses.T[::-1], *headings.T[::-1])
            rate = float(np.mean(np.maximum(error_l, error_r) < SUCCESS))
            rows.append((tilt, name, *np.degrees([np.median(error_l), np.median(rotation)]), rate))
    print(f"{pairs} pairs a tilt, seed 1; success: both headings within {SUCCESS} rad")
    print(
        f"{'tilt [rad]':>10}  {'table':18}{'heading [deg]':>14}{'rotation [deg]':>15}{'success':>9}"
    )
    for tilt, name, heading, rotation, rate in rows:
        print(f"{tilt:10.2f}  {name:18}{heading:14.2f}{rotation:15.2f}{rate:9.3f}")
    with (arguments.output / "tilt.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("tilt_rad", "table", "heading_deg", "rotation_deg", "success"))
        writer.writerows(rows)
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    for axes, column, label in zip(
        figure.subplots(1, 2), (2, 3), ("heading error [deg]", "rotation error [deg]"), strict=True
    ):
        for name in tables:
            own = [row for row in rows if row[1] == name]
            axes.plot([row[0] for row in own], [row[column] for row in own], "o-", label=name)
        axes.set(xlabel="largest roll and pitch [rad]", ylabel=f"median {label}", yscale="log")
        axes.grid(alpha=0.3)
        axes.legend()
    save_figure(figure, arguments.output / "tilt.png")
    print(f"written: {arguments.output}")


if __name__ == "__main__":
    main()
