"""pflut beside the relative-pose estimators that people use now, on the same simulated pairs.

    pip install "pflut[peers]"
    OMP_NUM_THREADS=1 python sims/peers.py [--quick] [--pairs N] [--output DIR]

Panoramas and perspective cameras (90 by 70 degrees) of the paper's simulator, 25 and 100
correspondences, 0 to 95 % of mismatches. Peers that `pip` installs: PoseLib, pycolmap, OpenCV;
those that are missing are left out and named. PoseLib has minimal solvers for the plane but no
robust estimator around them, so they run in a RANSAC in NumPy here, whose time says nothing of
PoseLib's; pflut's own planar LO-RANSAC is what such a loop comes to when it is compiled. All others
estimate all six degrees of freedom and are then asked for the two headings.

Prints a table a kind of camera: share of pairs with both headings within 0.1 rad, median of the
larger error, and the CPU time a pair, of one thread, in one run. A CSV and a figure are written.
"""

from __future__ import annotations

import argparse
import csv
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

import cv2
import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from pflut import Correspondences, CorrespondenceSimulator, LikelihoodTable, estimate_relative_poses
from pflut.geometry import wrap_to_pi
from pflut.plot import save_figure
from pflut.relpose.ransac import ransac_headings

try:
    import poselib
except ImportError:
    poselib = None
try:
    import pycolmap
except ImportError:
    pycolmap = None

SUCCESS = 0.1
SHARES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95)
COUNTS = (25, 100)
FOCAL = 500.0
PIXEL = 1.0 / FOCAL
WIDTH, HEIGHT = 1000, 700
PANORAMAS = CorrespondenceSimulator(noise=0.01)
IMAGES = CorrespondenceSimulator(field_of_view=(np.radians(90), np.radians(70)), noise=PIXEL)
SLOW = 2000.0
"""Microseconds; an estimator that takes longer gets a tenth of the pairs."""

Estimator = Callable[[np.ndarray], np.ndarray]
"""Takes bearings (pairs, n, 4) and gives headings (pairs, 2), radians."""


@dataclass(frozen=True)
class Peer:
    """An estimator.

    Parameters
    ----------
    name : str
    estimate : callable
    origin : str
        Where it comes from.
    """

    name: str
    estimate: Estimator
    origin: str


def rays(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """Give unit vectors in a camera's frame: x right, y down, z where the robot looks."""
    along = np.cos(elevation)
    return np.stack(
        [-along * np.sin(azimuth), -np.sin(elevation), along * np.cos(azimuth)], axis=-1
    )


def pixels(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """Give the places in the image of a perspective camera."""
    x, y, z = np.moveaxis(rays(azimuth, elevation), -1, 0)
    return np.stack([x / z * FOCAL + WIDTH / 2, y / z * FOCAL + HEIGHT / 2], axis=-1)


def headings_of(rotation: np.ndarray, translation: np.ndarray) -> tuple[float, float]:
    """Give the planar headings of x_r = R x_l + t, in cameras' frames."""
    center = -rotation.T @ np.ravel(translation)
    other = np.ravel(translation)
    return float(np.arctan2(-center[0], center[2])), float(np.arctan2(-other[0], other[2]))


def each(estimate: Callable[[np.ndarray], tuple[float, float] | None]) -> Estimator:
    """Make an estimator of one that takes one pair (n, 4); without an answer it guesses zeros."""

    def estimate_all(bearings: np.ndarray) -> np.ndarray:
        return np.array([estimate(pair) or (0.0, 0.0) for pair in bearings])

    return estimate_all


# --- pflut ----------------------------------------------------------------------------------------


def likelihood(table: LikelihoodTable) -> Estimator:
    """Make pflut's default estimator, in a batch."""

    def estimate(bearings: np.ndarray) -> np.ndarray:
        pairs = [Correspondences(*pair.T) for pair in bearings]
        found = estimate_relative_poses(pairs, table)
        return np.array([[pose.heading_l, pose.heading_r] for pose in found])

    return estimate


def ransac(**options: object) -> Estimator:
    """Make pflut's planar RANSAC."""
    return lambda bearings: ransac_headings(bearings, **options)[0]


# --- PoseLib --------------------------------------------------------------------------------------


def residuals(poses: np.ndarray, pair: np.ndarray) -> np.ndarray:
    """Give the planar epipolar residuals (m, n) at poses, radians; infinite behind a view."""
    theta, phi = poses[:, 0, None], poses[:, 1, None]
    u, v = theta - pair[:, 0], phi - pair[:, 2]
    sin_l, cos_l = np.sin(pair[:, 1]), np.cos(pair[:, 1])
    sin_r, cos_r = np.sin(pair[:, 3]), np.cos(pair[:, 3])
    value = sin_r * cos_l * np.sin(u) + sin_l * cos_r * np.sin(v)
    square = (sin_r * np.cos(u)) ** 2 + (cos_l * cos_r * np.sin(v) - sin_r * sin_l * np.sin(u)) ** 2
    square += (sin_l * np.cos(v)) ** 2
    square += (cos_r * cos_l * np.sin(u) - sin_l * sin_r * np.sin(v)) ** 2
    # depths along the lines of sight, of which the baseline is the third side
    apex = np.sin(u - v)
    behind = (np.sin(v) * apex > 0.0) | (np.sin(u) * apex < 0.0)
    return np.where(behind, np.inf, np.abs(value) / np.sqrt(square + 1e-24))


def planar_solver(
    solver: Callable[..., list], size: int, iterations: int, threshold: float
) -> Estimator:
    """Make a RANSAC in NumPy of one of PoseLib's minimal solvers: truncated squares, cheirality.

    The best pose is polished by Gauss-Newton on what agrees.
    """

    def estimate(pair: np.ndarray) -> tuple[float, float] | None:
        drawn = np.random.default_rng(0).random((iterations, len(pair)))
        samples = np.argpartition(drawn, size - 1, axis=1)[:, :size]
        left, right = rays(pair[:, 0], pair[:, 1]), rays(pair[:, 2], pair[:, 3])
        poses = []
        for sample in samples:
            poses += [headings_of(p.R, p.t) for p in solver(left[sample], right[sample])]
        if not poses:
            return None
        candidates = np.array(poses)
        cost = np.minimum(residuals(candidates, pair) ** 2, threshold**2).sum(axis=1)
        return polished(candidates[cost.argmin()], pair, threshold)

    return each(estimate)


def polished(pose: np.ndarray, pair: np.ndarray, threshold: float) -> tuple[float, float]:
    """Give the least-squares pose of what agrees: six steps, with a numerical gradient."""
    step = 1e-6
    for _ in range(6):
        around = pose + step * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        errors = residuals(around, pair)
        agree = (errors < threshold).all(axis=0)
        if agree.sum() < 2:
            break
        u, v = pose[0] - pair[agree, 0], pose[1] - pair[agree, 2]
        p = np.sin(pair[agree, 3]) * np.cos(pair[agree, 1])
        q = np.sin(pair[agree, 1]) * np.cos(pair[agree, 3])
        sign = np.sign(p * np.sin(u) + q * np.sin(v))
        slopes = sign * (errors[1::2, agree] - errors[2::2, agree]) / (2.0 * step)
        pose = pose - np.linalg.lstsq(slopes.T, sign * errors[0, agree], rcond=None)[0]
    return float(pose[0]), float(pose[1])


def poselib_five_point(pair: np.ndarray) -> tuple[float, float] | None:
    """Run PoseLib's own LO-RANSAC of the five-point solver, with its refinement; images only."""
    camera = {
        "model": "SIMPLE_PINHOLE",
        "width": WIDTH,
        "height": HEIGHT,
        "params": [FOCAL, WIDTH / 2, HEIGHT / 2],
    }
    options = {"max_iterations": 10_000, "max_epipolar_error": 3.0}
    points = pixels(pair[:, 0], pair[:, 1]), pixels(pair[:, 2], pair[:, 3])
    pose, _ = poselib.estimate_relative_pose(*points, camera, camera, options, {})
    return headings_of(pose.R, pose.t)


# --- pycolmap -------------------------------------------------------------------------------------


def colmap_rays(pair: np.ndarray) -> tuple[float, float] | None:
    """Run COLMAP's LO-RANSAC on rays, which it takes of any camera."""
    options = pycolmap.RANSACOptions(
        max_error=0.03, max_num_trials=10_000, min_num_trials=1000, random_seed=0
    )
    left, right = rays(pair[:, 0], pair[:, 1]), rays(pair[:, 2], pair[:, 3])
    return colmap_answer(pycolmap.estimate_relative_pose(left, right, options))


def colmap_pixels(pair: np.ndarray) -> tuple[float, float] | None:
    """Run COLMAP's LO-RANSAC on pixels, and its refinement."""
    camera = pycolmap.Camera(
        model="SIMPLE_PINHOLE", width=WIDTH, height=HEIGHT, params=[FOCAL, WIDTH / 2, HEIGHT / 2]
    )
    options = pycolmap.RANSACOptions(
        max_error=3.0, max_num_trials=10_000, min_num_trials=1000, random_seed=0
    )
    left, right = pixels(pair[:, 0], pair[:, 1]), pixels(pair[:, 2], pair[:, 3])
    return colmap_answer(pycolmap.estimate_essential_matrix(left, right, camera, camera, options))


def colmap_answer(answer: dict | None) -> tuple[float, float] | None:
    """Give the headings of what COLMAP found."""
    if answer is None:
        return None
    pose = answer["cam2_from_cam1"]
    return headings_of(pose.rotation.matrix(), np.array(pose.translation))


# --- OpenCV ---------------------------------------------------------------------------------------


def opencv(method: int, iterations: int, threshold: float) -> Estimator:
    """Make OpenCV's five-point RANSAC of a method, and its decomposition with cheirality."""
    matrix = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])

    def estimate(pair: np.ndarray) -> tuple[float, float] | None:
        left, right = pixels(pair[:, 0], pair[:, 1]), pixels(pair[:, 2], pair[:, 3])
        try:
            essential, mask = cv2.findEssentialMat(
                left, right, matrix, method, 0.999, threshold, iterations
            )
            if essential is None or essential.shape != (3, 3):
                return None
            _, rotation, translation, _ = cv2.recoverPose(
                essential, left, right, matrix, mask=mask.copy()
            )
        except cv2.error:
            return None
        return headings_of(rotation, translation)

    return each(estimate)


# --- the experiment -------------------------------------------------------------------------------


def peers_of_panoramas() -> list[Peer]:
    """Give what takes bearings all around."""
    found = [
        Peer("pflut, default table", likelihood(LikelihoodTable.default()), "pflut"),
        Peer("planar 2-point LO-RANSAC x1000", ransac(), "pflut"),
        Peer("planar 2-point LO-RANSAC x100", ransac(max_iterations=100), "pflut"),
        Peer("planar 2-point LO-RANSAC, adaptive", ransac(confidence=0.999), "pflut"),
        Peer(
            "planar 3-point RANSAC x1000, inlier counts (the paper's)",
            ransac(solver="3pt", scoring="inliers", local_optimization=False),
            "pflut",
        ),
    ]
    if poselib is not None:
        two, three = poselib.relpose_upright_planar_2pt, poselib.relpose_upright_planar_3pt
        found += [
            Peer("planar 2-point in a NumPy RANSAC x1000", planar_solver(two, 2, 1000, 0.03), POSE),
            Peer(
                "planar 3-point in a NumPy RANSAC x1000", planar_solver(three, 3, 1000, 0.03), POSE
            ),
            Peer(
                "5-point in a NumPy RANSAC x1000",
                planar_solver(poselib.relpose_5pt, 5, 1000, 0.03),
                POSE,
            ),
        ]
    if pycolmap is not None:
        found.append(Peer("5-point LO-RANSAC on rays x10,000", each(colmap_rays), COLMAP))
    return found


def peers_of_images() -> list[Peer]:
    """Give what takes pixels, or bearings."""
    sharp = {"threshold": 3.0 * PIXEL, "noise": PIXEL}
    table = LikelihoodTable.default("perspective")
    found = [
        Peer('pflut, default("perspective")', likelihood(table), "pflut"),
        Peer("planar 2-point LO-RANSAC x1000", ransac(**sharp), "pflut"),
        Peer("planar 2-point LO-RANSAC x100", ransac(max_iterations=100, **sharp), "pflut"),
        Peer("planar 2-point LO-RANSAC, adaptive", ransac(confidence=0.999, **sharp), "pflut"),
        Peer(
            "planar 3-point RANSAC x1000, inlier counts (the paper's)",
            ransac(solver="3pt", scoring="inliers", local_optimization=False, **sharp),
            "pflut",
        ),
        Peer("findEssentialMat RANSAC", opencv(cv2.RANSAC, 1000, 1.0), "OpenCV, defaults"),
        Peer("USAC_MAGSAC x10,000", opencv(cv2.USAC_MAGSAC, 10_000, 3.0), "OpenCV"),
        Peer("USAC_ACCURATE x10,000", opencv(cv2.USAC_ACCURATE, 10_000, 3.0), "OpenCV"),
    ]
    if poselib is not None:
        two = poselib.relpose_upright_planar_2pt
        solver = planar_solver(two, 2, 1000, 3.0 * PIXEL)
        found += [
            Peer("planar 2-point in a NumPy RANSAC x1000", solver, POSE),
            Peer("estimate_relative_pose, 5-point LO x10,000", each(poselib_five_point), POSE),
        ]
    if pycolmap is not None:
        found.append(Peer("estimate_essential_matrix x10,000", each(colmap_pixels), COLMAP))
    return found


POSE = f"PoseLib {poselib.__version__}" if poselib is not None else ""
COLMAP = f"pycolmap {pycolmap.__version__}" if pycolmap is not None else ""


def measure(
    condition: str, peers: list[Peer], simulator: CorrespondenceSimulator, pairs: int, bar: tqdm
) -> list[tuple]:
    """Run all peers on the same pairs: success, median error and time of each cell."""
    rows = []
    for count in COUNTS:
        for share in SHARES:
            cell = replace(simulator, mismatch=share)
            headings, bearings = cell.sample(pairs, count, rng=1)
            for peer in peers:
                peer.estimate(bearings[:2])
                start = process_time()
                peer.estimate(bearings[:3])
                slow = (process_time() - start) / 3 > SLOW * 1e-6
                used = max(pairs // 10, 8) if slow else pairs
                start = process_time()
                found = peer.estimate(bearings[:used])
                spent = process_time() - start
                error = np.abs(wrap_to_pi(found - headings[:used])).max(axis=1)
                rate, median = float((error < SUCCESS).mean()), float(np.median(error))
                cell_of = (condition, peer.origin, peer.name, count, share)
                rows.append((*cell_of, used, rate, median, 1e6 * spent / used))
                bar.update()
    return rows


def show(condition: str, rows: list[tuple]) -> None:
    """Print a table a number of correspondences."""
    for count in COUNTS:
        print(f"\n{condition}, {count} correspondences: success / median [rad] by mismatches")
        names = dict.fromkeys((row[1], row[2]) for row in rows)
        shares = "".join(f"{share:>15.0%}" for share in SHARES)
        print(f"{'':72}{shares}{'us at 80 %':>12}")
        for origin, name in names:
            cells = {row[4]: row for row in rows if row[1:4] == (origin, name, count)}
            line = "".join(f"{f'{cells[s][6]:.2f} / {cells[s][7]:.4f}':>15}" for s in SHARES)
            print(f"{name:56}{origin:16}{line}{cells[0.8][8]:12.0f}")


def draw(rows: list[tuple], path: Path) -> None:
    """Draw success over the mismatch share, a panel a camera and number of correspondences."""
    figure = Figure(figsize=(10.0, 10.5), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    for across, condition in zip(axes.T, dict.fromkeys(row[0] for row in rows), strict=True):
        for panel, count in zip(across, COUNTS, strict=True):
            own = [row for row in rows if row[0] == condition and row[3] == count]
            for k, (origin, name) in enumerate(dict.fromkeys((row[1], row[2]) for row in own)):
                x = [100 * row[4] for row in own if row[1:3] == (origin, name)]
                y = [row[6] for row in own if row[1:3] == (origin, name)]
                style = {"lw": 2.5, "color": "k"} if k == 0 else {"lw": 1.2}
                dashed = "-" if origin == "pflut" else "--"
                label = f"{name} ({origin})" if origin != "pflut" else name
                panel.plot(x, y, dashed, marker=".", label=label, **style)
            panel.set(title=f"{condition}, {count} correspondences", ylim=(0, 1.02))
            panel.grid(alpha=0.3)
        across[-1].set_xlabel("mismatches [%]")
        across[-1].legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.16))
    for panel in axes[:, 0]:
        panel.set_ylabel("share of pairs within 0.1 rad")
    save_figure(figure, path)


def main() -> None:
    """Run everything."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="20 pairs a cell")
    parser.add_argument("--pairs", type=int, default=1000, help="a cell; slow peers get a tenth")
    parser.add_argument("--output", type=Path, default=Path("results/peers"))
    arguments = parser.parse_args()
    if os.environ.get("OMP_NUM_THREADS") != "1":
        print("note: with OMP_NUM_THREADS=1 all run on one core")
    cv2.setNumThreads(1)
    pairs = 20 if arguments.quick else arguments.pairs
    arguments.output.mkdir(parents=True, exist_ok=True)
    for name, module in (("poselib", poselib), ("pycolmap", pycolmap)):
        if module is None:
            print(f"left out: {name} is not installed (pip install {name})")
    conditions = {
        "panoramas": (peers_of_panoramas(), PANORAMAS),
        "perspective": (peers_of_images(), IMAGES),
    }
    rows = []
    total = sum(len(peers) for peers, _ in conditions.values()) * len(COUNTS) * len(SHARES)
    with tqdm(total=total, unit="cell", disable=None) as bar:
        for condition, (peers, simulator) in conditions.items():
            rows += measure(condition, peers, simulator, pairs, bar)
    for condition in conditions:
        show(condition, [row for row in rows if row[0] == condition])
    columns = ("condition", "origin", "estimator", "correspondences", "mismatch", "pairs")
    with (arguments.output / "peers.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow((*columns, "success", "median_rad", "microseconds"))
        writer.writerows(rows)
    draw(rows, arguments.output / "peers.png")
    print(f"\nwritten: {arguments.output}")


if __name__ == "__main__":
    main()
