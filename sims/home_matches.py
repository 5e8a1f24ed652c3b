"""Show that the simulated home's pictures behave like a home's: features, and matches by distance.

    python sims/home_matches.py [--seeds 0 1 2] [--out figures/home_matches.png]

Counts the SIFT features of each image and matches every image of the test drive with the
references within 5 m (ratio test at 0.8, no other filter). A match is a mismatch when its planar
epipolar residual at the true pose, over its gradient (the angle that bearings would have to move),
exceeds 1 degree, or when the two rays meet behind a camera. Expected, about a minute a seed:
150-600 features by OpenCV's own settings, and 30-90 % mismatches between 0.2 and 3 m, growing.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from pflut.correspondences import Correspondences
from pflut.datasets.base import Dataset
from pflut.datasets.simulated_home import load_simulated_home
from pflut.features import FeatureExtractor, match
from pflut.geometry import relative_headings, wrap_to_pi

EDGES = np.array([0.0, 0.2, 0.4, 0.7, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0])
TOLERANCE = np.radians(1.0)


def mismatched(corr: Correspondences, theta: float, phi: float) -> np.ndarray:
    """Say which correspondences contradict the true headings (METHOD: the planar constraint)."""
    u, v = wrap_to_pi(theta - corr.azimuth_l), wrap_to_pi(phi - corr.azimuth_r)
    sin_l, cos_l = np.sin(corr.elevation_l), np.cos(corr.elevation_l)
    sin_r, cos_r = np.sin(corr.elevation_r), np.cos(corr.elevation_r)
    residual = sin_r * cos_l * np.sin(u) + sin_l * cos_r * np.sin(v)
    gradient = np.sqrt(
        (sin_r * cos_l * np.cos(u)) ** 2
        + (sin_l * cos_r * np.cos(v)) ** 2
        + (cos_l * cos_r * np.sin(v) - sin_r * sin_l * np.sin(u)) ** 2
        + (cos_r * cos_l * np.sin(u) - sin_l * sin_r * np.sin(v)) ** 2
    )
    # near the baseline's direction, and for points far away, the sign of an angle is noise
    slack = 2.0 * TOLERANCE
    opposite = (u > slack) & (v > slack) | (u < -slack) & (v < -slack)
    behind = opposite | (np.abs(u) + np.abs(v) > np.pi + 2.0 * slack)
    return (np.abs(residual) > TOLERANCE * np.maximum(gradient, 1e-9)) | behind


def statistics(dataset: Dataset, contrast: float) -> tuple[list[int], list[int], np.ndarray]:
    """Give feature counts (OpenCV's, pflut's) and rows of (distance, matches, mismatches)."""
    extractor = FeatureExtractor(dataset.camera, contrast_threshold=contrast)
    images = [dataset.image(k) for k in range(len(dataset))]
    features = [extractor(image) for image in images]
    sift = cv2.SIFT_create()
    truth = dataset.ground_truth
    assert truth is not None
    rows = []
    for query in dataset.query_indices[::2]:
        for reference in dataset.reference_indices:
            theta, phi, distance = relative_headings(truth[reference], truth[query])
            if distance < EDGES[-1]:
                corr = match(features[reference], features[query], ratio=0.8)
                wrong = mismatched(corr, float(theta), float(phi))
                rows.append((float(distance), len(corr), int(wrong.sum())))
    own = [len(f.azimuth) for f in features]
    return [len(sift.detect(image)) for image in images], own, np.array(rows)


def draw(panorama: np.ndarray, counts: list[int], rows: np.ndarray, path: Path) -> None:
    """Draw a panorama, the histogram of features and the mismatches by distance."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 6.2), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=[1.0, 1.35])
    top = figure.add_subplot(grid[0, :])
    top.imshow(panorama[..., ::-1])
    top.set_axis_off()
    left, right = figure.add_subplot(grid[1, 0]), figure.add_subplot(grid[1, 1])
    left.hist(counts, bins=np.arange(0, 1001, 50), color="tab:blue")
    left.axvspan(150, 600, color="tab:green", alpha=0.15, lw=0)
    left.set(xlabel="SIFT features a panorama (OpenCV's defaults)", ylabel="images")
    distance, matches, wrong = rows.T
    share = wrong[matches > 0] / matches[matches > 0]
    right.plot(distance[matches > 0], share, ".", ms=2, alpha=0.25, color="gray")
    middle = 0.5 * (EDGES[1:] + EDGES[:-1])
    chosen = np.digitize(distance, EDGES) - 1
    pooled = []
    for k in range(len(middle)):
        some = chosen == k
        pooled.append(wrong[some].sum() / max(matches[some].sum(), 1))
    right.plot(middle, pooled, "o-", color="tab:red", label="all matches of a distance")
    right.axhspan(0.3, 0.9, color="tab:green", alpha=0.15, lw=0)
    right.set(
        xlabel="distance between the views [m]", ylabel="share of mismatches", ylim=(0.0, 1.0)
    )
    right.legend(loc="lower right")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)


def main() -> None:
    """Measure, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--contrast", type=float, default=0.02, help="of pflut's extractor")
    parser.add_argument("--out", type=Path, default=Path("figures/home_matches.png"))
    args = parser.parse_args()
    datasets = [load_simulated_home(seed) for seed in args.seeds]
    parts = [statistics(dataset, args.contrast) for dataset in datasets]
    counts = [n for part in parts for n in part[0]]
    own = [n for part in parts for n in part[1]]
    rows = np.concatenate([part[2] for part in parts])
    for name, values in (("OpenCV", counts), ("pflut", own)):
        low, median, high = np.percentile(values, [5, 50, 95])
        print(f"SIFT features, {name:6s}  median {median:4.0f}, 5-95 % {low:.0f}-{high:.0f}")
    print(f"{'distance [m]':>14s} {'pairs':>6s} {'matches':>8s} {'mismatches':>11s}")
    for low, high in pairwise(EDGES):
        some = rows[(rows[:, 0] >= low) & (rows[:, 0] < high)]
        if len(some):
            middle, share = np.median(some[:, 1]), some[:, 2].sum() / max(some[:, 1].sum(), 1)
            print(f"{low:6.1f} - {high:4.1f} {len(some):7d} {middle:8.0f} {share:10.0%}")
    query = int(datasets[0].query_indices[12])
    draw(cv2.imread(str(datasets[0].image_paths[query])), counts, rows, args.out)
    print(f"figure: {args.out}")


if __name__ == "__main__":
    main()
