"""Measure how wrong maps of drives are, before and after, and with false links among the true.

    python sims/map_error.py [--quick] [--homes N,N ...] [--landmark-homes N] [--no-homes]
                             [--output DIR]

Pose graphs of odometry and links, of drives through rendered homes and homes of landmarks: the test
drive of some 17 m, and the mapping drive of some 60 m through all rooms. Odometry is that of
`simulate_odometry` at its defaults. False links are added until they are 20 or 40 % of all that are
more probable than not; they are as sure as true ones, and say something random, or what another
pair says, or that a place is another one (see `with_false_links`). Optimised

mixture      with the mixtures of the links, as pflut does by default
             (the others in three of the five cases)
no-search    the same, descending from odometry at once
max-mixture  with the best component of each
cauchy, huber, gaussian
             with the heaviest component of each link and a robust kernel, or none
gtsam        by GTSAM, with max-mixtures, from where odometry puts the images

Prints medians and ranges of the error of positions (root mean square, metres, after the best
fitting shift and turn) and of its ratio to odometry's; writes a CSV and a figure. Links are kept in
DIR, and not computed again.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from pflut import LikelihoodTable
from pflut._files import write_csv
from pflut.datasets import load_simulated_home
from pflut.features import FeatureCache
from pflut.geometry import FloatArray
from pflut.mapping.all_pairs import all_pairs
from pflut.mapping.drive_images import drive_images
from pflut.mapping.false_links import with_false_links
from pflut.mapping.graph_optimizer import optimize_graph
from pflut.mapping.gtsam_graph import gtsam_graph, poses_of
from pflut.mapping.link_model import LinkModel
from pflut.mapping.links import Links
from pflut.mapping.map_errors import MapErrors
from pflut.mapping.pair_linker import LinkOptions, PairLinker
from pflut.mapping.pose_graph import PoseGraph
from pflut.plot import save_figure
from pflut.plot.style import CYCLE, new_figure, tidy
from pflut.replay.options import ReplayOptions
from pflut.replay.pipeline import make_extractor
from pflut.simulation.landmark_drive import simulate_drive
from pflut.simulation.landmark_pairs import drive_pairs
from pflut.simulation.odometry import simulate_odometry

DRIVES = ("test drive", "mapping drive")
FALSE = (("none", 0.0), ("random", 0.2), ("random", 0.4), ("pair", 0.2), ("place", 0.2))
COMPARED = (("none", 0.0), ("random", 0.2), ("place", 0.2))  # with all methods
METHODS = ("mixture", "no-search", "max-mixture", "cauchy", "huber", "gaussian", "gtsam")
COLUMNS = ("world", "drive", "home", "odometry_seed", "false", "share", "method", "position_m")
COLUMNS += ("odometry_position_m", "scaled_m", "odometry_scaled_m")
COLUMNS += ("from_start_m", "odometry_from_start_m", "heading_deg")


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive with its links."""

    world: str
    name: str
    home: int
    truth: FloatArray
    links: Links


def main() -> None:
    """Run the experiment."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two homes of landmarks")
    parser.add_argument(
        "--homes",
        type=lambda text: [int(number) for number in text.split(",")],
        default=list(range(200, 210)),
        help="seeds of rendered homes, N,N (default: 200 to 209)",
    )
    parser.add_argument("--landmark-homes", type=int, default=10, help="(default: %(default)s)")
    parser.add_argument("--no-homes", action="store_true", help="no rendered homes")
    parser.add_argument(
        "--methods",
        type=lambda text: text.split(","),
        default=list(METHODS[:-1]),
        help="of those above, the first of them in all cases (default: all but gtsam)",
    )
    parser.add_argument("--odometries", type=int, default=2, help="a drive (default: %(default)s)")
    parser.add_argument("--output", type=Path, default=Path("results/map_error"))
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    landmarks = 2 if arguments.quick else arguments.landmark_homes
    rendered = [] if arguments.quick or arguments.no_homes else arguments.homes
    rows = []
    for drive in drives(rendered, landmarks, arguments.output):
        for seed in range(arguments.odometries):
            rows += measured(drive, seed, arguments.methods)
        write_csv(arguments.output / "map_error.csv", COLUMNS, rows)
    report(rows)
    figure(rows, arguments.output / "map_error.png")


def drives(rendered: list[int], landmarks: int, folder: Path) -> Iterator[Drive]:
    """Give the drives of all homes."""
    table = LikelihoodTable.default()
    linker = PairLinker(table=table, options=LinkOptions(), link_model=LinkModel.default())
    for home in tqdm(range(landmarks), desc="homes of landmarks", disable=not landmarks):
        simulated = simulate_drive("tracking", home)
        for name, poses in zip(
            DRIVES, (simulated.ground_truth, simulated.home.mapping.poses), strict=True
        ):
            pairs, matches = drive_pairs(simulated, poses, rng=[home, 40])
            yield Drive("landmarks", name, home, poses, linker.of_matches(matches, pairs))
    for home in tqdm(rendered, desc="rendered homes", disable=not rendered):
        dataset = load_simulated_home(home)
        for name, choice in zip(DRIVES, ("queries", "references"), strict=True):
            images = drive_images(dataset, choice, simulate=True)
            extractor, cache = make_extractor(images, ReplayOptions()), FeatureCache()
            features = (cache(extractor, images.image(i)) for i in range(len(images)))
            links = all_pairs(features, folder / f"links-{home}-{choice}", table)
            yield Drive("rendered", name, home, images.ground_truth, links)


def measured(drive: Drive, seed: int, methods: list[str]) -> list[list[object]]:
    """Optimise the graphs of a drive with one odometry."""
    odometry = simulate_odometry(drive.truth, rng=np.random.default_rng([drive.home, 14, seed]))
    before = MapErrors.of(odometry, drive.truth)
    rows = []
    for kind, share in FALSE:
        links = drive.links
        if share:
            links = with_false_links(links, drive.truth, share, kind, rng=[drive.home, 41, seed])
        graph = PoseGraph.from_odometry(odometry, links)
        for method in methods if (kind, share) in COMPARED else methods[:1]:
            after = MapErrors.of(optimized(graph, method), drive.truth)
            rows.append(
                [
                    *(drive.world, drive.name, drive.home, seed, kind, share, method),
                    *(after.position, before.position),
                    *(after.position_scaled, before.position_scaled),
                    *(after.position_from_start, before.position_from_start),
                    np.degrees(after.heading),
                ]
            )
    return rows


def optimized(graph: PoseGraph, method: str) -> FloatArray:
    """Give the poses that a method finds."""
    if method == "no-search":
        return optimize_graph(graph, search=False).poses
    if method != "gtsam":
        return optimize_graph(graph, loss=method).poses
    import gtsam

    factors, values = gtsam_graph(graph)
    return poses_of(gtsam.LevenbergMarquardtOptimizer(factors, values).optimize(), graph)


def report(rows: list[list[object]]) -> None:
    """Print medians and ranges over homes and odometries.

    The last columns count the graphs whose error is at most a quarter of odometry's, and at most
    one and a half times that of the same graph without false links.
    """
    print(f"{'':<36}{'position [m]':>22}{'of odometry':>24}{'<= 1/4':>10}", end="")
    print(f"{'of no false':>24}{'<= 1.5':>10}")
    for world, name in sorted({(row[0], row[1]) for row in rows}):
        those = [row for row in rows if row[:2] == [world, name]]
        plain = [row for row in those if row[4] == "none" and row[6] == those[0][6]]
        odometry, scaled = (np.array([row[column] for row in plain]) for column in (8, 9))
        start, odometry_start = (np.array([row[column] for row in plain]) for column in (11, 12))
        print(f"\n{world}, {name}: {len(odometry)} graphs, odometry {_range(odometry)} m")
        print(
            f"  no false links, {those[0][6]}: but for the size {_range(scaled)} m; from the start"
        )
        print(f"  {_range(start)} m, odometry {_range(odometry_start)} m")
        for method in METHODS:
            clean = {}
            for kind, share in FALSE:
                chosen = [r for r in those if r[4:7] == [kind, share, method]]
                if not chosen:
                    continue
                position = np.array([row[7] for row in chosen])
                ratio = position / np.array([row[8] for row in chosen])
                clean = clean or {tuple(row[2:4]): row[7] for row in chosen}
                times = position / np.array([clean[tuple(row[2:4])] for row in chosen])
                what = "no false links" if not share else f"{100 * share:.0f} % {kind}"
                print(
                    f"  {method:<16}{what:<18}{_range(position):>22}{_range(ratio):>24}"
                    f"{(ratio <= 0.25).sum():>4} of {len(ratio):<2}"
                    f"{_range(times):>24}{(times <= 1.5).sum():>4} of {len(ratio):<2}"
                )


def _range(values: FloatArray) -> str:
    return f"{np.median(values):.3f} ({values.min():.3f}-{values.max():.3f})"


def figure(rows: list[list[object]], path: Path) -> None:
    """Draw the errors, one panel a kind of drive."""
    kinds = sorted({(row[0], row[1]) for row in rows})
    drawn = new_figure(4.6 * len(kinds), 4.2)
    panels = drawn.subplots(1, len(kinds), sharey=True, squeeze=False)[0]
    labels = ["odometry"] + [
        "no false\nlinks" if not share else f"{100 * share:.0f} %\n{kind}" for kind, share in FALSE
    ]
    for axes, (world, name) in zip(panels, kinds, strict=True):
        those = [row for row in rows if row[:2] == [world, name]]
        odometry = [row[8] for row in those if row[4] == "none" and row[6] == those[0][6]]
        _dots(axes, 0.0, np.array(odometry), "0.35", None)
        for number, method in enumerate(METHODS):
            for place, (kind, share) in enumerate(FALSE, start=1):
                values = np.array([r[7] for r in those if r[4:7] == [kind, share, method]])
                if not len(values):
                    continue
                at = place + 0.12 * (number - 3)
                _dots(axes, at, values, CYCLE[number], method if place == 1 else None)
        axes.set(yscale="log", title=f"{world}, {name}", xticks=range(len(labels)))
        axes.set_xticklabels(labels, fontsize=8)
        tidy(axes)
    panels[0].set_ylabel("position error, root mean square [m]")
    drawn.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=7)
    save_figure(drawn, path)


def _dots(axes: object, at: float, values: FloatArray, color: str, label: str | None) -> None:
    """Draw single values and their median."""
    axes.plot(np.full(len(values), at), values, ".", color=color, alpha=0.35, markersize=4)
    axes.plot(at, np.median(values), "D", color=color, markersize=5, label=label)


if __name__ == "__main__":
    main()
