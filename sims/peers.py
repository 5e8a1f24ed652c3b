"""pflut beside the relative-pose estimators that people use now, on the same simulated pairs.

    pip install "pflut[peers]"
    OMP_NUM_THREADS=1 python sims/peers.py [--quick] [--programs DIR] [--output DIR]
    OMP_NUM_THREADS=1 python sims/peers.py --tune

Panoramas and perspective cameras (90 by 70 degrees) of the paper's simulator, 25 and 100
correspondences, 0 to 95 % of mismatches. Of each peer its defaults and its best settings, which
``--tune`` shows on other pairs (seed 2).

`pip` installs PoseLib, pycolmap and OpenCV; all they have for two views estimates six degrees of
freedom, and is then asked for the two headings. PoseLib has minimal solvers for the plane, too, but
no robust estimator around them: one in Python is measured here, whose time says nothing. To be
built (sims/cpp): PoseLib's own LO-RANSAC around its planar solvers, and OpenGV; ``--programs`` says
where they are. What is missing is left out and named.

Prints a table a kind of camera and number of correspondences: share of pairs with both headings
within 0.1 rad, median of the larger error, CPU time a pair, one thread, in one run; then the cells
in which pflut is not the best. A CSV and a figure are written.
"""

from __future__ import annotations

import argparse
import os
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import cv2
import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from pflut import Correspondences, CorrespondenceSimulator, LikelihoodTable, refine_relative_pose
from pflut._files import write_csv
from pflut.comparison import Estimator, Headings, by_ransac, by_table
from pflut.likelihood.table import bearing_columns
from pflut.pair_errors import PairErrors
from pflut.plot import save_figure
from pflut.plot.style import CYCLE, new_figure, tidy
from pflut.relpose.ransac_kernels import BLOCK, NUM_ROWS, model_cost, prepare
from pflut.statistics import bootstrap_median_ratio, success_rate

try:
    import poselib
except ImportError:
    poselib = None
try:
    import pycolmap
except ImportError:
    pycolmap = None

SHARES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95)
COUNTS = (25, 100)
FOCAL = 500.0
PIXEL = 1.0 / FOCAL
WIDTH, HEIGHT = 1000, 700
CONDITIONS = {
    "panoramas": CorrespondenceSimulator(noise=0.01),
    "perspective": CorrespondenceSimulator(
        field_of_view=(np.radians(90), np.radians(70)), noise=PIXEL
    ),
}
FEWEST = 20
"""Pairs of a cell, however slow an estimator is."""
CLOSE = 0.05
"""A peer whose success comes within this share of pflut's is as good."""
FASTER = 5.0
"""How many times as fast as it pflut is to be then."""
CAMERA = {
    "model": "SIMPLE_PINHOLE",
    "width": WIDTH,
    "height": HEIGHT,
    "params": [FOCAL, WIDTH / 2, HEIGHT / 2],
}


TRIED = (0.33, 0.67, 1.0, 1.5, 2.0)
"""Factors of the thresholds that are reported."""


Measure = Callable[[Sequence[Correspondences], np.ndarray], PairErrors]
"""Takes pairs and true headings (n, 2), and gives the errors and the time."""
Settings = Callable[[float], Measure]
"""Takes a threshold."""


@dataclass(frozen=True)
class Peer:
    """An estimator.

    Parameters
    ----------
    name : str
    origin : str
        Where it comes from.
    measure : callable
    """

    name: str
    origin: str
    measure: Measure


def timed(
    estimate: Estimator, pairs: Sequence[Correspondences], headings: np.ndarray
) -> PairErrors:
    """Run an estimator in this process."""
    start = process_time()
    poses = estimate(pairs)
    return PairErrors.of(poses, headings, (process_time() - start) / len(pairs))


def one_by_one(
    estimate: Callable[[Correspondences], Headings],
    pairs: Sequence[Correspondences],
    headings: np.ndarray,
) -> PairErrors:
    """Run a function of one pair in this process."""
    return timed(lambda some: [estimate(pair) for pair in some], pairs, headings)


def rays(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """Give unit vectors in a camera's frame: x right, y down, z where the robot looks."""
    along = np.cos(elevation)
    return np.stack(
        [-along * np.sin(azimuth), -np.sin(elevation), along * np.cos(azimuth)], axis=-1
    )


def rays_of(pair: Correspondences) -> tuple[np.ndarray, np.ndarray]:
    """Give the rays of both views."""
    return rays(pair.azimuth_l, pair.elevation_l), rays(pair.azimuth_r, pair.elevation_r)


def pixels_of(pair: Correspondences) -> tuple[np.ndarray, np.ndarray]:
    """Give the places in both images of a perspective camera."""
    center = np.array([WIDTH / 2, HEIGHT / 2])
    left, right = (view[:, :2] / view[:, 2:] * FOCAL + center for view in rays_of(pair))
    return left, right


def headings_of(rotation: np.ndarray, translation: np.ndarray) -> Headings:
    """Give the planar headings of x_r = R x_l + t, in cameras' frames."""
    center, other = -rotation.T @ np.ravel(translation), np.ravel(translation)
    return Headings(
        float(np.arctan2(-center[0], center[2])), float(np.arctan2(-other[0], other[2]))
    )


# --- PoseLib --------------------------------------------------------------------------------------


def planar_loop(pair: Correspondences, *, iterations: int, threshold: float) -> Headings:
    """Run a RANSAC in Python around PoseLib's planar 2-point solver: MSAC with cheirality.

    The best pose is polished by the M-estimator.
    """
    columns, n = bearing_columns(pair), len(pair)
    rows = np.empty((NUM_ROWS, -(-n // BLOCK) * BLOCK))
    prepare(columns, np.zeros(1, np.uint64), rows, np.empty(n, np.int64), True)
    left, right = rays_of(pair)
    rng, cheapest, best = np.random.default_rng(0), float(n), Headings()
    for _ in range(iterations):
        sample = rng.choice(n, 2, replace=False)
        for pose in poselib.relpose_upright_planar_2pt(left[sample], right[sample]):
            found = headings_of(pose.R, pose.t)
            model = np.stack([np.sin(found), np.cos(found)], axis=1).ravel()
            cost = model_cost(rows, model, threshold, True, cheapest)
            if cost < cheapest:
                cheapest, best = cost, found
    if np.isnan(best.heading_l):
        return best
    polished = refine_relative_pose(pair, *best, noise=threshold / 3.0)
    return Headings(polished.heading_l, polished.heading_r)


def poselib_images(pair: Correspondences, **options: Any) -> Headings:
    """Run PoseLib's LO-RANSAC of the five-point solver, with its refinement; pixels."""
    pose, _ = poselib.estimate_relative_pose(*pixels_of(pair), CAMERA, CAMERA, options, {})
    return headings_of(pose.R, pose.t)


# --- pycolmap -------------------------------------------------------------------------------------


def colmap(pair: Correspondences, *, on_rays: bool, **options: Any) -> Headings:
    """Run COLMAP's LO-RANSAC on rays, which it takes of any camera, or on pixels."""
    chosen = pycolmap.RANSACOptions(random_seed=0, **options)
    if on_rays:
        answer = pycolmap.estimate_relative_pose(*rays_of(pair), chosen)
    else:
        camera = pycolmap.Camera(**CAMERA)
        answer = pycolmap.estimate_essential_matrix(*pixels_of(pair), camera, camera, chosen)
    if answer is None:
        return Headings()
    pose = answer["cam2_from_cam1"]
    return headings_of(pose.rotation.matrix(), np.array(pose.translation))


# --- OpenCV ---------------------------------------------------------------------------------------


def opencv(pair: Correspondences, *, method: int, iterations: int, threshold: float) -> Headings:
    """Run OpenCV's five-point RANSAC of a method, and its decomposition with cheirality."""
    matrix = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])
    left, right = pixels_of(pair)
    try:
        essential, mask = cv2.findEssentialMat(
            left, right, matrix, method, 0.999, threshold, iterations
        )
        if essential is None or essential.shape != (3, 3):
            return Headings()
        _, rotation, translation, _ = cv2.recoverPose(essential, left, right, matrix, mask=mask)
    except cv2.error:
        return Headings()
    return headings_of(rotation, translation)


# --- programs -------------------------------------------------------------------------------------


def program(
    path: Path, arguments: Sequence[str], pairs: Sequence[Correspondences], headings: np.ndarray
) -> PairErrors:
    """Run a program of sims/cpp, which takes its own time."""
    angles = [
        np.stack([c.azimuth_l, c.elevation_l, c.azimuth_r, c.elevation_r], axis=1) for c in pairs
    ]
    given = f"{len(pairs)} {len(pairs[0])}\n".encode() + np.array(angles).tobytes()
    done = subprocess.run([path, *arguments], input=given, stdout=subprocess.PIPE, check=True)
    found = np.frombuffer(done.stdout).reshape(-1, 3)
    poses = [Headings(*row) for row in found[:, :2]]
    return PairErrors.of(poses, headings, 1e-6 * float(found[:, 2].mean()))


# --- who takes part -------------------------------------------------------------------------------


def own(condition: str) -> list[Peer]:
    """Give pflut's estimators; the first one is what the others are compared with."""
    noise = CONDITIONS[condition].noise
    camera = "perspective" if condition == "perspective" else "panorama"
    counting = {"scoring": "inliers", "local_optimization": False}
    estimators = {
        f'likelihood, default("{camera}")': by_table(LikelihoodTable.default(camera)),
        "planar 2-point LO-RANSAC x1000": by_ransac(noise=noise),
        "planar 2-point LO-RANSAC, adaptive": by_ransac(noise=noise, confidence=0.999),
        "planar 3-point RANSAC x1000, inlier counts": by_ransac(
            noise=noise, solver="3pt", **counting
        ),
        "8-point LO-RANSAC x1000": by_ransac(noise=noise, solver="8pt"),
    }
    return [Peer(name, "pflut", partial(timed, each)) for name, each in estimators.items()]


def at_their_best(condition: str, folder: Path) -> dict[tuple[str, str], tuple[Settings, float]]:
    """Give the peers whose threshold is a setting, each as a function of it, and the best one.

    By name, with a place for the threshold, and origin.
    """
    found: dict[tuple[str, str], tuple[Settings, float]] = {}

    def alone(estimate: Callable[..., Headings], key: str, **options: Any) -> Settings:
        return lambda x: partial(one_by_one, partial(estimate, **{key: x}, **options))

    def run(file: str, *arguments: str) -> Settings:
        return lambda x: partial(program, folder / file, [*arguments, str(x)])

    limit = 3.0 * CONDITIONS[condition].noise
    trials = {"max_num_trials": 10_000}
    if poselib is not None:
        origin = f"PoseLib {poselib.__version__}"
        solver = alone(planar_loop, "threshold", iterations=1000)
        found["planar 2-point in a Python loop x1000", origin] = solver, limit
        if condition == "perspective":
            images = alone(poselib_images, "max_epipolar_error", max_iterations=10_000)
            found["estimate_relative_pose x10,000, {:g} px", origin] = images, 3.0
    if pycolmap is not None:
        origin = f"pycolmap {pycolmap.__version__}"
        if condition == "panoramas":
            on_rays = alone(colmap, "max_error", on_rays=True, **trials)
            found["on rays x10,000, {:g} rad", origin] = on_rays, 0.03
        else:
            images = alone(colmap, "max_error", on_rays=False, **trials)
            found["estimate_essential_matrix x10,000, {:g} px", origin] = images, 3.0
    if condition == "perspective":
        for name in ("RANSAC", "USAC_MAGSAC", "USAC_ACCURATE"):
            method = alone(opencv, "threshold", method=getattr(cv2, name), iterations=10_000)
            found[f"{name} x10,000, {{:g}} px", f"OpenCV {cv2.__version__}"] = method, 3.0
    if (folder / "poselib_planar").is_file():
        for times in ("x100", "x1000", "adaptive"):
            planar = run("poselib_planar", "2pt", times.removeprefix("x"))
            found[f"planar 2-point LO-RANSAC {times}", "PoseLib, built"] = planar, limit
        planar = run("poselib_planar", "3pt", "1000")
        found["planar 3-point LO-RANSAC x1000", "PoseLib, built"] = planar, limit
    if (folder / "opengv_peers").is_file():
        for solver, points in (("stewenius", "5-point"), ("eightpt", "8-point")):
            general = run("opengv_peers", solver, "1000")
            found[f"{points} RANSAC x1000", "OpenGV, built"] = general, 1.5 * limit
    return found


def at_their_defaults(condition: str) -> list[Peer]:
    """Give what is called with nothing but the points: only images have defaults that make sense.

    (On rays COLMAP's default threshold of 4 would call everything an inlier.)
    """
    if condition != "perspective":
        return []
    found = [
        Peer(f"{name}, defaults", f"OpenCV {cv2.__version__}", partial(one_by_one, estimate))
        for name, estimate in (
            (name, partial(opencv, method=getattr(cv2, name), iterations=1000, threshold=1.0))
            for name in ("RANSAC", "USAC_MAGSAC", "USAC_ACCURATE")
        )
    ]
    if poselib is not None:
        origin, name = f"PoseLib {poselib.__version__}", "estimate_relative_pose, defaults"
        found.append(Peer(name, origin, partial(one_by_one, poselib_images)))
    if pycolmap is not None:
        origin, name = f"pycolmap {pycolmap.__version__}", "estimate_essential_matrix, defaults"
        found.append(Peer(name, origin, partial(one_by_one, partial(colmap, on_rays=False))))
    return found


def everybody(condition: str, folder: Path) -> list[Peer]:
    """Give all who take part: pflut first, then peers at their defaults and at their best."""
    best = [
        Peer(name.format(threshold), origin, settings(threshold))
        for (name, origin), (settings, threshold) in at_their_best(condition, folder).items()
    ]
    return [*own(condition), *at_their_defaults(condition), *best]


# --- the experiment -------------------------------------------------------------------------------

COLUMNS = ("condition", "origin", "estimator", "correspondences", "mismatch", "pairs")
COLUMNS += (
    "success",
    "low",
    "high",
    "median_rad",
    "heading_l_rad",
    "heading_r_rad",
    "microseconds",
)


class Row(NamedTuple):
    """One estimator in one cell, as in the CSV."""

    condition: str
    origin: str
    name: str
    count: int
    share: float
    pairs: int
    success: float
    low: float
    high: float
    median: float
    heading_l: float
    heading_r: float
    microseconds: float

    @property
    def label(self) -> str:
        """Name and origin."""
        return self.name if self.origin == "pflut" else f"{self.name} ({self.origin})"


def run_cell(
    condition: str, peer: Peer, count: int, share: float, pairs: int, budget: float, seed: int = 1
) -> tuple[Row, PairErrors]:
    """Run one estimator on the pairs of one cell, on as many as it can in so many seconds."""
    simulator = replace(CONDITIONS[condition], mismatch=share)
    made, headings = simulator.pairs(pairs, count, rng=seed)
    peer.measure(made[:1], headings[:1])  # compiles
    seconds = peer.measure(made[:1], headings[:1]).seconds
    fewest = min(FEWEST, pairs // 6)
    used = int(min(max(budget / max(seconds, 1e-9), fewest), pairs))
    errors = peer.measure(made[:used], headings[:used])
    rate = success_rate(errors.found)
    medians = [float(np.median(e)) for e in (errors.heading, errors.heading_l, errors.heading_r)]
    cell = (condition, peer.origin, peer.name, count, share, used, rate.rate, rate.low, rate.high)
    return Row(*cell, *medians, 1e6 * errors.seconds), errors


def show(rows: Sequence[Row]) -> None:
    """Print a table a camera and number of correspondences."""
    for condition, count in dict.fromkeys((row.condition, row.count) for row in rows):
        some = [row for row in rows if (row.condition, row.count) == (condition, count)]
        print(f"\n{condition}, {count} correspondences: success / median [rad] / us by mismatches")
        print(f"{'':72}" + "".join(f"{share:>22.0%}" for share in SHARES))
        for label in dict.fromkeys(row.label for row in some):
            cells = [row for row in some if row.label == label]
            line = (f"{c.success:.2f} / {c.median:.4f} / {c.microseconds:.0f}" for c in cells)
            print(f"{label:72}" + "".join(f"{cell:>22}" for cell in line))


def show_where_not_best(measured: Sequence[tuple[Row, PairErrors]]) -> None:
    """Name the cells in which a peer is more accurate, or as good and not much slower.

    On the pairs that both were run on, and beyond what these can tell: 95 % intervals. Errors are
    compared where most of the pairs are found, and twenty have been run.
    """
    print("\nwhere pflut's likelihood is not the best, of peers that are not pflut's:")
    for key in dict.fromkeys((row.condition, row.count, row.share) for row, _ in measured):
        (mine, own), *others = ((r, e) for r, e in measured if (r[0], r.count, r.share) == key)
        for row, errors in others:
            if row.origin == "pflut":
                continue
            same = slice(row.pairs)
            gained = errors.found.astype(float) - own.found[same]
            half = 1.96 * float(gained.std()) / np.sqrt(row.pairs)
            said = [f"finds {gained.mean():+.3f}"] if gained.mean() > half else []
            told = row.pairs >= 20 and mine.success > 0.5
            for name in ("heading", "heading_l", "heading_r") if told else ():
                theirs, ours = getattr(errors, name), getattr(own, name)[same]
                if bootstrap_median_ratio(theirs, ours, rng=0)[1] < 1.0:
                    said.append(f"{name} error {np.median(theirs) / np.median(ours):.2f}")
            ratio = row.microseconds / mine.microseconds
            if gained.mean() > -CLOSE and ratio < FASTER:
                said.append(f"{row.success:.3f} for {mine.success:.3f} in {ratio:.2f} of its time")
            if said:
                where = f"{key[0]}, {key[1]}, {key[2]:.0%}"
                print(f"  {where:24}{row.label:64}{', '.join(said)}")


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw success over the mismatches, a panel a camera and number of correspondences."""
    figure: Figure = new_figure(11.0, 11.5)
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    conditions = list(dict.fromkeys(row.condition for row in rows))
    for across, condition in zip(axes.T, conditions, strict=True):
        for panel, count in zip(across, COUNTS, strict=True):
            own = [row for row in rows if row.condition == condition and row.count == count]
            for k, label in enumerate(dict.fromkeys(row.label for row in own)):
                cells = [row for row in own if row.label == label]
                panel.plot(
                    [100 * cell.share for cell in cells],
                    [cell.success for cell in cells],
                    "-" if cells[0].origin == "pflut" else "--",
                    marker="os^Dvx+<>p*"[k % 11],
                    ms=4,
                    color="k" if k == 0 else CYCLE[(k - 1) % (len(CYCLE) - 1)],
                    lw=2.5 if k == 0 else 1.1,
                    label=label,
                )
            panel.set(title=f"{condition}, {count} correspondences", ylim=(0, 1.02))
            tidy(panel)
        across[-1].set_xlabel("mismatches [%]")
        across[-1].legend(
            fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.14), frameon=False
        )
    for panel in axes[:, 0]:
        panel.set_ylabel("share of pairs within 0.1 rad")
    save_figure(figure, path)


def tune(pairs: int, folder: Path) -> None:
    """Show which thresholds are best, on other pairs than those that are reported."""
    cells = ((25, 0.5), (100, 0.5), (100, 0.8))
    print(f"success at 25, 50 % / 100, 50 % / 100, 80 %; {pairs} pairs, seed 2; * as reported")
    for condition in CONDITIONS:
        for (name, origin), (settings, best) in at_their_best(condition, folder).items():
            for factor in TRIED:
                peer = Peer(name, origin, settings(factor * best))
                runs = [run_cell(condition, peer, *cell, pairs, np.inf, seed=2) for cell in cells]
                found = " / ".join(f"{row.success:.2f}" for row, _ in runs)
                mark = "*" if factor == 1.0 else " "
                print(f"{condition:13}{origin:18}{name.format(factor * best):44}{mark} {found}")


def main() -> None:
    """Run everything."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="12 pairs a cell")
    parser.add_argument("--pairs", type=int, default=1000, help="a cell, at most")
    parser.add_argument(
        "--seconds", type=float, default=5.0, help="a cell; who is slower gets fewer pairs"
    )
    parser.add_argument(
        "--programs", type=Path, default=Path("build"), help="where sims/cpp was built"
    )
    parser.add_argument("--tune", action="store_true", help="try thresholds on 40 pairs a cell")
    parser.add_argument("--output", type=Path, default=Path("results/peers"))
    arguments = parser.parse_args()
    if os.environ.get("OMP_NUM_THREADS") != "1":
        print("note: with OMP_NUM_THREADS=1 all run on one core")
    cv2.setNumThreads(1)
    for name, module in (("poselib", poselib), ("pycolmap", pycolmap)):
        if module is None:
            print(f"left out: {name} is not installed (pip install {name})")
    for file in ("poselib_planar", "opengv_peers"):
        if not (arguments.programs / file).is_file():
            print(f"left out: {arguments.programs / file} is not there (sims/cpp/CMakeLists.txt)")
    if arguments.tune:
        tune(40, arguments.programs)
        return
    pairs = 12 if arguments.quick else arguments.pairs
    budget = 0.1 if arguments.quick else arguments.seconds
    arguments.output.mkdir(parents=True, exist_ok=True)
    cells = [
        (condition, peer, count, share)
        for condition in CONDITIONS
        for count in COUNTS
        for share in SHARES
        for peer in everybody(condition, arguments.programs)
    ]
    measured = [run_cell(*cell, pairs, budget) for cell in tqdm(cells, unit="cell", disable=None)]
    rows = [row for row, _ in measured]
    show(rows)
    show_where_not_best(measured)
    write_csv(arguments.output / "peers.csv", COLUMNS, rows)
    draw(rows, arguments.output / "peers.png")
    print(f"\nwritten: {arguments.output}")


if __name__ == "__main__":
    main()
