"""Errors of the relative pose against the distance of the views, on a dataset's own pairs.

    python sims/real_home_pairs.py DATASET [--max-distance 3] [--contrast-threshold 0.01]

The paper's Figure 6c and g on any dataset with ground truth: every pair of images nearer than
``--max-distance``. The rotation is compared with the median of the matches' azimuth differences,
which is what one would try first. Prints a table, writes a CSV and two figures.
"""

from __future__ import annotations

import argparse
import csv
from itertools import pairwise
from pathlib import Path

import numpy as np
from tqdm import tqdm

from pflut import (
    Correspondences,
    FeatureExtractor,
    LikelihoodTable,
    estimate_relative_pose,
    load_dataset,
)
from pflut.evaluation import bootstrap_median, relative_pose_errors
from pflut.features import FeatureCache
from pflut.geometry import rotation_from_headings, wrap_to_pi
from pflut.pairs import dataset_pairs
from pflut.plot import plot_error_against, save_figure


def median_rotation(correspondences: Correspondences) -> float:
    """Give the circular median of azimuth_l - azimuth_r: R's rotation, were all landmarks far."""
    turns = correspondences.azimuth_l - correspondences.azimuth_r
    # the angle that has the least sum of distances to the others is one of them
    distances = np.abs(wrap_to_pi(turns[:, None] - turns[None, :])).sum(axis=1)
    return float(turns[np.argmin(distances)]) if len(turns) else 0.0


def main() -> None:
    """Run all pairs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", help="path or name")
    parser.add_argument("--max-distance", type=float, default=3.0, help="metres")
    parser.add_argument("--contrast-threshold", type=float, default=0.01, help="SIFT's")
    parser.add_argument("--output", type=Path, default=Path("results/real_home_pairs"))
    arguments = parser.parse_args()
    dataset = load_dataset(arguments.dataset)
    extractor = FeatureExtractor(
        dataset.camera,
        contrast_threshold=arguments.contrast_threshold,
        mask_elevation=dataset.mask_elevation,
        mask=dataset.mask,
    )
    table = LikelihoodTable.default()
    rows = []
    with tqdm(unit="pair", disable=None) as bar:
        for pair in dataset_pairs(
            dataset, extractor, max_distance=arguments.max_distance, cache=FeatureCache()
        ):
            estimate = estimate_relative_pose(pair.correspondences, table)
            heading, rotation = relative_pose_errors(
                estimate.heading_l, estimate.heading_r, pair.heading_l, pair.heading_r
            )
            truth = rotation_from_headings(pair.heading_l, pair.heading_r)
            simple = abs(wrap_to_pi(median_rotation(pair.correspondences) - truth))
            rows.append(
                (
                    pair.index_l,
                    pair.index_r,
                    pair.distance,
                    len(pair.correspondences),
                    *np.degrees([float(heading), float(rotation), simple]),
                    estimate.success,
                )
            )
            bar.update()
    arguments.output.mkdir(parents=True, exist_ok=True)
    with (arguments.output / "pairs.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        names = "heading_deg,rotation_deg,median_azimuth_rotation_deg,success"
        writer.writerow(f"index_l,index_r,distance_m,matches,{names}".split(","))
        writer.writerows(rows)
    values = np.array(rows, dtype=float)
    distance, found = values[:, 2], values[:, 7] > 0
    print(
        f"{dataset.name}: {len(values)} pairs within {arguments.max_distance:g} m, "
        f"{int(values[:, 3].sum())} matches"
    )
    print(f"{'distance [m]':14}{'pairs':>6}{'found':>7}   median error [deg] of all pairs")
    print(f"{'':27}{'heading':>10}{'rotation':>10}{'median azimuth':>16}")
    edges = np.arange(0.0, arguments.max_distance + 0.5, 0.5)
    for low, high in pairwise(edges):
        chosen = (distance >= low) & (distance < high)
        if chosen.any():
            medians = np.median(values[chosen, 4:7], axis=0)
            print(
                f"{low:4.1f} to {high:3.1f}  {chosen.sum():9}{found[chosen].sum():7}"
                f"{medians[0]:10.2f}{medians[1]:10.2f}{medians[2]:16.2f}"
            )
    for name, chosen in (("all", np.ones(len(values), bool)), ("success", found)):
        for column, label in ((5, "maximum likelihood"), (6, "median azimuth")):
            median = np.median(values[chosen, column])
            low, high = bootstrap_median(values[chosen, column], rng=0)
            print(
                f"rotation error, {name:8}{label:20} median {median:6.2f} deg, "
                f"95 % interval {low:.2f} to {high:.2f}"
            )
    title = f"{dataset.name}, {len(values)} pairs"
    save_figure(
        plot_error_against(
            distance,
            {"maximum likelihood": values[:, 4]},
            xlabel="distance between the views [m]",
            bins=edges,
            title=title,
        ),
        arguments.output / "heading.png",
    )
    save_figure(
        plot_error_against(
            distance,
            {"maximum likelihood": values[:, 5], "median of azimuth differences": values[:, 6]},
            xlabel="distance between the views [m]",
            ylabel="rotation error [deg]",
            bins=edges,
            title=title,
        ),
        arguments.output / "rotation.png",
    )
    print(f"written: {arguments.output}")


if __name__ == "__main__":
    main()
