"""Errors of relative poses against the distance of the views, on images: Figures 6c and 6g.

    python sims/distance_errors.py [DATASET ...] [--quick] [--max-distance 3]
        [--contrast-threshold 0.02] [--max-features N] [--output DIR]

A DATASET is a folder or a name that `pflut.load_dataset` knows, or the seed of a rendered home;
without any it is the rendered home 3. Every pair of images nearer than ``--max-distance`` is
estimated by the paper's table and by RANSAC + M-estimator as the paper has them, by pflut's tables
(the default, and that for homes) and by RANSAC at its best (two points, MSAC, local optimization,
1,000 samples); the rotation also by the median of the matches' azimuth differences, which is what
one would try first.

Each RANSAC gets the one of `NOISES` that is best for it in another rendered home, home 0: the real
home has too few pairs to choose by. Of pflut's the table for homes was chosen there, too. Prints
two tables a dataset (medians, 95 % intervals by bootstrap over pairs), writes a CSV (with the MADs)
and two figures a dataset.

Errors grow with the distance, and beyond some 2 m much of what is found is by chance. The paper
found its table best beyond 1.5 m, then three points, then two.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from pflut import Correspondences, FeatureExtractor, LikelihoodTable, load_dataset
from pflut._files import write_csv
from pflut.comparison import (
    PAPER_RANSAC,
    Estimator,
    PairErrors,
    by_maximum,
    by_ransac,
    by_table,
    compare_estimators,
)
from pflut.datasets import Dataset, load_simulated_home
from pflut.evaluation import bootstrap_median, summarize
from pflut.features import FeatureCache
from pflut.geometry import rotation_from_headings, wrap_to_pi
from pflut.likelihood.dense import DenseTable
from pflut.pairs import ImagePair, dataset_pairs, near_pairs
from pflut.plot import plot_medians, save_figure

NOISES = (0.002, 0.005, 0.01, 0.02)
LUT, OURS, HOME, AZIMUTH = "LUT 128", "pflut", "pflut, home", "median azimuth"
LO_RANSAC, THREE_POINT = "2-point LO-RANSAC", "3-point RANSAC"
#: Options of RANSACs by name: the paper's, and the best.
RANSACS: Mapping[str, Mapping[str, Any]] = {
    "8-point RANSAC": {"solver": "8pt", **PAPER_RANSAC},
    THREE_POINT: {"solver": "3pt", **PAPER_RANSAC},
    "2-point RANSAC": {"solver": "2pt", **PAPER_RANSAC},
    LO_RANSAC: {},
}
FIGURES = {
    "paper": (LUT, "8-point RANSAC", THREE_POINT, "2-point RANSAC"),
    # the table and three points in the same colors as above
    "pflut": (LUT, OURS, THREE_POINT, LO_RANSAC, AZIMUTH, HOME),
}
#: Where noises are chosen, by all of its pairs (by a quarter of them luck has its say).
OTHER_HOME = 0
ALL = slice(None)
STEP = 0.5  # metres
LEAST_DRAWN = 5  # pairs
COLUMNS = ["dataset", "estimator", "distance_from_m", "distance_to_m", "pairs"]
COLUMNS += [
    f"{name}_{statistic}_deg"
    for name in ("heading", "rotation")
    for statistic in ("median", "mad", "low", "high")
]
COLUMNS += ["found"]


def load(name: str) -> Dataset:
    """Load a dataset by its path, its name, or the seed of a rendered home."""
    return load_simulated_home(seed=int(name)) if name.isdecimal() else load_dataset(name)


def image_pairs(
    dataset: Dataset,
    *,
    max_distance: float = 3.0,
    images: slice = ALL,
    **features: Any,
) -> list[ImagePair]:
    """Match the near pairs of a dataset, or of some of its images; with options of features."""
    some = replace(
        dataset,
        stamps=dataset.stamps[images],
        image_paths=dataset.image_paths[images],
        ground_truth=None if dataset.ground_truth is None else dataset.ground_truth[images],
        odometry=None,
        reference_indices=np.empty(0, np.intp),
        query_indices=np.empty(0, np.intp),
    )
    extractor = FeatureExtractor(
        dataset.camera, mask_elevation=dataset.mask_elevation, mask=dataset.mask, **features
    )
    pairs = dataset_pairs(some, extractor, max_distance=max_distance, cache=FeatureCache())
    total = len(near_pairs(some, max_distance))
    return list(tqdm(pairs, desc=dataset.name, total=total, unit="pair", disable=None))


def measure(
    estimators: Mapping[str, Estimator], pairs: Sequence[ImagePair], description: str
) -> dict[str, PairErrors]:
    """Run estimators on pairs."""
    with tqdm(desc=description, total=len(estimators), unit="estimator", disable=None) as bar:
        return compare_estimators(
            estimators,
            [pair.correspondences for pair in pairs],
            [[pair.heading_l, pair.heading_r] for pair in pairs],
            progress=lambda _: bar.update(),
        )


def ransacs() -> dict[str, dict[float, Estimator]]:
    """Make families of estimators that differ in the noise they expect: the RANSACs."""
    return {
        name: {noise: by_ransac(noise=noise, **options) for noise in NOISES}
        for name, options in RANSACS.items()
    }


def best_noises(
    families: Mapping[str, Mapping[float, Estimator]], others: Sequence[ImagePair]
) -> dict[str, Estimator]:
    """Take of each family the one with the least median heading error on other pairs."""
    chosen, noises = {}, []
    for name, family in families.items():
        known = {f"{noise:g}": estimate for noise, estimate in family.items()}
        errors = measure(known, others, f"noise of {name}")
        best = min(errors, key=lambda noise: float(np.median(errors[noise].heading_l)))
        chosen[name] = known[best]
        noises.append(f"{name} {best}")
    print(f"noise [rad] that is best on {len(others)} other pairs: {', '.join(noises)}")
    return chosen


def median_azimuth(pairs: Sequence[ImagePair]) -> PairErrors:
    """Take the circular median of azimuth_l - azimuth_r: R's rotation, were all landmarks far."""

    def turn(correspondences: Correspondences) -> float:
        turns = correspondences.azimuth_l - correspondences.azimuth_r
        # the angle that has the least sum of distances to the others is one of them
        distances = np.abs(wrap_to_pi(turns[:, None] - turns[None, :])).sum(axis=1)
        return float(turns[np.argmin(distances)]) if len(turns) else 0.0

    truth = np.array([rotation_from_headings(pair.heading_l, pair.heading_r) for pair in pairs])
    found = np.array([turn(pair.correspondences) for pair in pairs])
    unknown = np.full(len(pairs), np.nan)
    return PairErrors(unknown, unknown, np.abs(wrap_to_pi(found - truth)), np.nan)


def rows(
    name: str, errors: Mapping[str, PairErrors], distance: np.ndarray, edges: np.ndarray
) -> Iterator[list[Any]]:
    """Give the rows of the CSV: each estimator at each distance, and at all of them."""
    for estimator, error in errors.items():
        for low, high in [*pairwise(edges), (edges[0], edges[-1])]:
            chosen = (distance >= low) & (distance < high)
            row = [name, estimator, low, high, int(chosen.sum())]
            for angles in (error.heading_l, error.rotation):
                degrees = np.degrees(angles[chosen])
                known = summarize(degrees)
                row += [known.median, known.mad, *bootstrap_median(degrees, rng=0)]
            known_headings = chosen & np.isfinite(error.heading)
            yield [*row, error.found[known_headings].mean() if known_headings.any() else np.nan]


def print_tables(table: Sequence[Sequence[Any]]) -> None:
    """Print medians and their intervals, an estimator a line, a distance a column."""
    spans = list(dict.fromkeys((row[2], row[3], row[4]) for row in table))
    for title, column in (("heading", 5), ("rotation", 9)):
        print(f"{title} error [deg], median (95 % interval)")
        print(f"{'':19}" + "".join(f"{f'{low:g} to {high:g} m':>22}" for low, high, _ in spans))
        print(f"{'pairs':19}" + "".join(f"{count:22}" for *_, count in spans))
        for estimator in dict.fromkeys(row[1] for row in table):
            cells = [row[column : column + 4] for row in table if row[1] == estimator]
            if np.isfinite([median for median, *_ in cells]).any():
                texts = (f"{m:.2f} ({low:.2f}-{high:.2f})" for m, _, low, high in cells)
                print(f"{estimator:19}" + "".join(f"{text:>22}" for text in texts))


def distance_figure(
    errors: Mapping[str, PairErrors], distance: np.ndarray, edges: np.ndarray, *, title: str
) -> Figure:
    """Draw the errors over the distances that have a few pairs."""
    place = np.digitize(distance, edges) - 1
    kept = [i for i in range(len(edges) - 1) if np.count_nonzero(place == i) >= LEAST_DRAWN]
    panels = {
        f"{angle} error [deg]": {
            name: [np.degrees(getattr(error, field)[place == i]) for i in kept]
            for name, error in errors.items()
        }
        for angle, field in (("heading", "heading_l"), ("rotation", "rotation"))
    }
    centers = ((edges[:-1] + edges[1:]) / 2.0)[kept].tolist()
    return plot_medians(centers, panels, xlabel="distance between the views [m]", title=title)


def main() -> None:
    """Run all datasets."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("datasets", nargs="*", default=["3"], help="paths, names, seeds of homes")
    parser.add_argument("--quick", action="store_true", help="every third image of drives")
    parser.add_argument("--max-distance", type=float, default=3.0, help="metres")
    parser.add_argument("--contrast-threshold", type=float, default=0.02, help="SIFT's")
    parser.add_argument("--max-features", type=int, help="of an image; the paper has about 240")
    parser.add_argument("--output", type=Path, default=Path("results/distance_errors"))
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    # sets of single images are small as they are
    drive = slice(None, None, 3) if arguments.quick else ALL
    features = {
        "contrast_threshold": arguments.contrast_threshold,
        "max_features": arguments.max_features,
    }
    other = image_pairs(load_simulated_home(seed=OTHER_HOME), images=drive, **features)
    estimators = {
        LUT: by_maximum(DenseTable.default()),
        OURS: by_table(LikelihoodTable.default()),
        HOME: by_table(LikelihoodTable.default("home")),
        **best_noises(ransacs(), other),
    }
    edges = np.arange(0.0, arguments.max_distance + STEP / 2, STEP)
    written: list[list[Any]] = []
    for name in arguments.datasets:
        dataset = load(name)
        pairs = image_pairs(
            dataset,
            max_distance=arguments.max_distance,
            images=ALL if dataset.leave_one_out else drive,
            **features,
        )
        distance = np.array([pair.distance for pair in pairs])
        matches = [len(pair.correspondences) for pair in pairs]
        print(f"\n{dataset.name}: {len(pairs)} pairs, {np.median(matches):g} matches (median)")
        errors = measure(estimators, pairs, dataset.name)
        errors[AZIMUTH] = median_azimuth(pairs)
        table = list(rows(dataset.name, errors, distance, edges))
        print_tables(table)
        written += table
        for title, names in FIGURES.items():
            some = {name: errors[name] for name in names}
            figure = distance_figure(
                some, distance, edges, title=f"{dataset.name}, {len(pairs)} pairs"
            )
            stem = dataset.name.replace("/", "_").replace(" ", "_").lower()
            save_figure(figure, arguments.output / f"{stem}_{title}.png")
    write_csv(arguments.output / "distances.csv", COLUMNS, written)
    print(f"\nwritten: {arguments.output}")


if __name__ == "__main__":
    main()
