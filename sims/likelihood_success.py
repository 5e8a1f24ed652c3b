"""How many relative poses of simulated pairs are found: tables, RANSACs, and the search itself.

    python sims/likelihood_success.py [--quick] [--parts accuracy ...] [--output DIR]

Four parts, all on pairs of the paper's simulator and its variations, seeds fixed:

accuracy     panoramas, by the share of mismatches (the paper's Figure 6a and 6e): the default
             table, the paper's own table, planar RANSACs, and the *residual alone*, a table that
             knows of no depths: the best that a robust score reaches
robustness   the default table where the scene, the share of mismatches or the noise is another
             than it has learned, beside the residual alone on the same pairs
perspective  cameras of 90 by 70 degrees: which table, and which coarse grid
search       how often the search from coarse to fine finds what an exhaustive one finds

A success has both headings within 0.1 rad. Prints tables, writes a CSV and a figure a part.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from pflut import Correspondences, CorrespondenceSimulator, LikelihoodTable
from pflut._files import write_csv
from pflut._robust import TUKEY
from pflut.comparison import Estimator, by_ransac, by_table, compare_estimators
from pflut.geometry import wrap_to_pi
from pflut.likelihood.axes import parallax_edges
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.residual_kernels import PairArrays, maximize
from pflut.likelihood.table import bearing_columns
from pflut.pair_errors import MAX_HEADING_ERROR
from pflut.plot import save_figure
from pflut.plot.style import CYCLE, GREY, new_figure, tidy
from pflut.relpose.refine_kernels import refine_many
from pflut.relpose.search import CUTOFFS, STEPS_PER_CUTOFF, estimate_relative_poses
from pflut.statistics import success_rate

SEED = 1
MISMATCHES = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.93, 0.95)
#: What was aimed at: well above what robust scores reach.
TARGETS = {
    (25, 0.8): 0.75,
    (25, 0.85): 0.60,
    (25, 0.9): 0.32,
    (100, 0.85): 0.96,
    (100, 0.9): 0.90,
    (100, 0.93): 0.66,
    (100, 0.95): 0.42,
}
HARD = ((25, 0.5), (25, 0.8), (25, 0.9), (100, 0.5), (100, 0.8), (100, 0.9), (100, 0.95))
IMAGE_NOISE = 0.002
IMAGES = CorrespondenceSimulator(field_of_view=(np.radians(90), np.radians(70)), noise=IMAGE_NOISE)
PERSPECTIVE_TARGETS = {(25, 0.8): 0.76, (100, 0.8): 0.99}
SEARCH_BINS, SEARCH_CANDIDATES = (64, 80, 128), (3, 5, 8, 16, 32)
SEARCHED = tuple(sorted({*TARGETS, *((n, share) for n in (25, 100) for share in (0.0, 0.5))}))
ALIKE = 0.02
"""Radians within which two poses are the same."""
ALMOST = 0.01
"""Nats by which a pose may be less probable and still as good."""
CLIMBED = (4, 30)
"""Steps that the exhaustive search climbs: from every maximum, and on from those not given up."""
GIVEN_UP = 15.0
"""Nats below the highest at which it gives one up, after its first steps."""


@dataclass(frozen=True)
class Cell:
    """Larger heading errors of one estimator on the pairs of one cell, radians."""

    condition: str
    estimator: str
    count: int
    mismatch: float
    errors: np.ndarray

    @property
    def found(self) -> np.ndarray:
        """Which pairs are successes."""
        return self.errors < MAX_HEADING_ERROR

    def row(self) -> tuple[Any, ...]:
        """Give the row of the CSV."""
        rate = success_rate(self.found)
        row = (self.condition, self.estimator, self.count, self.mismatch, len(self.errors))
        return (*row, rate.rate, rate.low, rate.high, float(np.median(self.errors)))


def residual_alone(table: LikelihoodTable) -> LikelihoodTable:
    """Make a table of the same residuals that knows of no depths: the best robust score.

    Wherever a landmark may be at all, that is where the lines of sight do not diverge by more than
    three standard deviations, it is taken to be as probable as anywhere else. The scale is that of
    a likelihood ratio: its mean over mismatches at random poses is one.
    """
    upper = np.append(-np.inf, parallax_edges()[1:])
    possible = (upper > -3.0 * table.noise).astype(np.float32)
    density = np.broadcast_to(possible[:, None, None], (*table.density.shape[:2], 1))
    flat = replace(table, density=density, mismatch=0.5)
    rng = np.random.default_rng(0)
    _, bearings = CorrespondenceSimulator(mismatch=1.0).sample(2000, 1, rng)
    # at even odds the likelihood ratio of one correspondence is log((1 + ratio) / 2)
    ratios = [
        2.0 * np.exp(flat.log_likelihood(Correspondences(*pair.T), rng.uniform(0, 7e3, (500, 2))))
        - 1.0
        for pair in bearings
    ]
    return replace(flat, density=density / np.mean(ratios), mismatch=table.mismatch)


def measure(
    condition: str,
    simulator: CorrespondenceSimulator,
    cells: Iterable[tuple[int, float]],
    estimators: dict[str, Estimator],
    pairs: int,
) -> list[Cell]:
    """Run estimators on the same pairs of each cell (correspondences, share of mismatches)."""
    measured = []
    for count, share in tqdm(list(cells), desc=condition, unit="cell", disable=None):
        made, headings = replace(simulator, mismatch=share).pairs(pairs, count, rng=SEED)
        for name, errors in compare_estimators(estimators, made, headings).items():
            measured.append(Cell(condition, name, count, share, errors.heading))
    return measured


def difference(cell: Cell, other: Cell) -> tuple[float, float]:
    """Give the difference of two successes on the same pairs, and half its 95 % interval."""
    gained = cell.found.astype(float) - other.found
    return float(gained.mean()), 1.96 * float(gained.std() / np.sqrt(len(gained)))


def print_cells(cells: Sequence[Cell], targets: dict[tuple[int, float], float]) -> None:
    """Print success and interval, the target if there is one, and the median error."""
    print(
        f"{'condition':24}{'estimator':28}{'n':>4}{'mismatch':>10}{'success':>9}"
        f"{'95 % interval':>16}{'target':>8}{'median [rad]':>14}"
    )
    for cell in cells:
        *_, rate, low, high, median = cell.row()
        target = targets.get((cell.count, cell.mismatch))
        print(
            f"{cell.condition:24}{cell.estimator:28}{cell.count:4}{cell.mismatch:10.2f}{rate:9.3f}"
            f"{f'{low:.3f} to {high:.3f}':>16}{'' if target is None else f'{target:.2f}':>8}"
            f"{median:14.4f}"
        )


def places(cells: Sequence[Cell]) -> dict[float, int]:
    """Give the shares of mismatches places at even distances: the hard ones are close by."""
    return {share: k for k, share in enumerate(sorted({cell.mismatch for cell in cells}))}


def draw_success(axes: Axes, cells: Sequence[Cell]) -> None:
    """Draw success over the share of mismatches, a curve an estimator, the first one on top."""
    x = places(cells)
    names = list(dict.fromkeys(cell.estimator for cell in cells))
    for k, (color, name) in enumerate(zip(CYCLE * 2, names, strict=False)):
        rows = np.array([cell.row()[3:] for cell in cells if cell.estimator == name])
        share, _, rate, low, high, _ = rows.T
        axes.errorbar(
            [x[value] for value in share],
            rate,
            (rate - low, high - rate),
            fmt=".-" if k < len(CYCLE) else ".--",
            color=color,
            lw=1.2,
            label=name,
            zorder=3.0 - 0.1 * k,
        )
    axes.set(xlabel="mismatches [%]", ylabel="success", ylim=(0.0, 1.02))
    axes.set_xticks(list(x.values()), [f"{100 * share:.0f}" for share in x])
    tidy(axes)


def finish(figure: Figure, axes: Axes, path: Path, *, columns: int = 4) -> None:
    """Put a legend below the figure, and save it."""
    handles = axes.get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)
    save_figure(figure, path)


def accuracy(pairs: int, quick: bool, output: Path) -> list[Cell]:
    """Measure the panoramas of the paper's simulator."""
    table = LikelihoodTable.default()
    samples = 16_000_000 if quick else 64_000_000
    paper = DenseTable.from_simulation(mismatches="simulated", num_samples=samples)
    three = {"solver": "3pt", "scoring": "inliers", "local_optimization": False}
    more = "2-point LO-RANSAC x10,000"
    estimators = {
        "default table": by_table(table),
        "residual alone": by_table(residual_alone(table)),
        "dense table": by_table(DenseTable.default()),
        "dense, paper's mismatches": by_table(paper),
        "2-point LO-RANSAC x1000": by_ransac(),
        more: by_ransac(max_iterations=10_000),
        "3-point RANSAC x10,000": by_ransac(max_iterations=10_000, **three),
    }
    wanted = [(count, share) for count in (25, 100) for share in MISMATCHES]
    cells = measure("ball", CorrespondenceSimulator(), wanted, estimators, pairs)
    print_cells(cells, TARGETS)
    figure = new_figure(9.0, 6.4)
    axes = figure.subplots(2, 2, sharex=True)
    worst = 0.0
    for column, count in zip(axes.T, (25, 100), strict=True):
        some = [cell for cell in cells if cell.count == count]
        # more samples change nothing, and would hide the curve of fewer
        drawn = [cell for cell in some if cell.estimator != more]
        draw_success(column[0], drawn)
        column[0].set(title=f"{count} correspondences", xlabel="")
        x = places(some)
        aims = [(x[share], aim) for (n, share), aim in TARGETS.items() if n == count]
        column[0].plot(*zip(*aims, strict=True), "_", color="black", ms=14, label="target")
        names = dict.fromkeys(cell.estimator for cell in drawn)
        for k, (color, name) in enumerate(zip(CYCLE, names, strict=False)):
            degrees = [np.degrees(cell.row()[-1]) for cell in drawn if cell.estimator == name]
            column[1].plot(x.values(), degrees, ".-", color=color, lw=1.2, zorder=3.0 - 0.1 * k)
        column[1].set(yscale="log", xlabel="mismatches [%]", ylabel="median heading error [deg]")
        tidy(column[1])
        for share in (share for share in MISMATCHES if share <= 0.6):
            medians = {cell.estimator: cell.row()[-1] for cell in some if cell.mismatch == share}
            worst = max(worst, medians["default table"] / min(medians.values()))
    print(f"\nmedian error, default table over the best of all, 0 to 60 %: at most {worst:.3f}")
    print_differences(cells, "default table", "residual alone")
    finish(figure, axes[0, 0], output / "accuracy.png")
    return cells


def print_differences(cells: Sequence[Cell], name: str, other: str) -> None:
    """Print the differences of success of two estimators on the same pairs, and the worst."""
    index = {(c.condition, c.count, c.mismatch, c.estimator): c for c in cells}
    differences = {
        key: difference(cell, index[*key[:3], other])
        for key, cell in index.items()
        if key[3] == name
    }
    print(f"\nsuccess of {name!r} less that of {other!r}, same pairs:")
    for (condition, count, share, _), (value, half) in differences.items():
        print(f"  {condition:32}{count:4}{share:8.2f}{value:+9.3f} +- {half:.3f}")
    (condition, count, share, _), (value, half) = min(differences.items(), key=lambda x: x[1][0])
    print(f"  worst: {value:+.3f} +- {half:.3f} ({condition}, {count}, {share:.0%})")


def robustness(pairs: int, quick: bool, output: Path) -> list[Cell]:
    """Measure the default table where the world is another than it has learned."""
    table = LikelihoodTable.default()
    alone = residual_alone(table)
    # the share of mismatches is all that learning with another one changes
    few, few_alone = (replace(known, mismatch=0.5) for known in (table, alone))
    runs: list[tuple[str, CorrespondenceSimulator, Any, Any, dict[str, float]]] = [
        ("room with walls", CorrespondenceSimulator(scene="box"), table, alone, {}),
        ("learned with 90 %", CorrespondenceSimulator(), table, alone, {}),
        ("learned with 50 %", CorrespondenceSimulator(), few, few_alone, {}),
    ]
    for noise in (0.005, 0.02):
        simulator = CorrespondenceSimulator(noise=noise)
        runs.append((f"noise {noise}", simulator, table, alone, {}))
        runs.append((f"noise {noise}, told", simulator, table, alone, {"noise": noise}))
    cells = []
    for condition, simulator, known, unknown, options in runs:
        told = options.get("noise", 0.01)
        estimators = {
            "default table": by_table(known, **options),
            "residual alone": by_table(unknown, **options),
            "2-point LO-RANSAC x1000": by_ransac(noise=told),
        }
        cells += measure(condition, simulator, HARD, estimators, pairs)
    print_cells(cells, {})
    print_differences(cells, "default table", "residual alone")
    print_differences(cells, "default table", "2-point LO-RANSAC x1000")
    conditions = [run[0] for run in runs]
    index = {(c.condition, c.count, c.mismatch, c.estimator): c for c in cells}
    figure = new_figure(9.0, 5.0)
    axes = figure.subplots(1, 2, sharey=True)
    for panel, other in zip(axes, ("residual alone", "2-point LO-RANSAC x1000"), strict=True):
        for k, (color, key) in enumerate(zip(CYCLE, HARD, strict=True)):
            values = [
                difference(index[name, *key, "default table"], index[name, *key, other])
                for name in conditions
            ]
            value, half = np.array(values).T
            y = np.arange(len(conditions)) + 0.1 * (k - 3)
            label = f"{key[0]} correspondences, {key[1]:.0%}"
            panel.errorbar(value, y, xerr=half, fmt="o", ms=4, color=color, lw=1.0, label=label)
        panel.axvline(0.0, color=GREY, lw=0.8)
        panel.axvline(-0.02, color=GREY, lw=0.8, ls=":")
        panel.set(xlabel="difference of success", title=f"default table less\n{other}")
        panel.set_yticks(range(len(conditions)), conditions)
        tidy(panel)
    axes[0].invert_yaxis()
    finish(figure, axes[0], output / "robustness.png")
    return cells


def perspective(pairs: int, quick: bool, output: Path) -> list[Cell]:
    """Measure perspective cameras: by table and by coarse grid."""
    samples = 4_000_000 if quick else 16_000_000
    panoramas = LikelihoodTable.from_simulation(
        simulator=CorrespondenceSimulator(noise=IMAGE_NOISE), num_samples=samples
    )
    tables = {
        "perspective": LikelihoodTable.default("perspective"),
        "default": LikelihoodTable.default(),
        "panoramas, 0.002": panoramas,
    }
    sharp = {"noise": IMAGE_NOISE}
    estimators = {
        f"{name}, {bins} bins": by_table(table, bins=bins)
        for name, table in tables.items()
        for bins in (64, 128, 256)
    }
    estimators |= {
        "default, told, 256 bins": by_table(tables["default"], bins=256, noise=IMAGE_NOISE),
        "residual alone, 256 bins": by_table(residual_alone(panoramas), bins=256),
        "2-point LO-RANSAC x1000": by_ransac(**sharp),
        "2-point LO-RANSAC x10,000": by_ransac(max_iterations=10_000, **sharp),
    }
    cells = measure("90 by 70 degrees", IMAGES, HARD, estimators, pairs)
    print_cells(cells, PERSPECTIVE_TARGETS)
    print_differences(cells, "perspective, 128 bins", "residual alone, 256 bins")
    print_differences(cells, "perspective, 128 bins", "2-point LO-RANSAC x10,000")
    figure = new_figure(10.0, 4.6)
    axes = figure.subplots(1, 2, sharey=True)
    shown = [f"perspective, {bins} bins" for bins in (64, 128, 256)]
    shown += ["default, 128 bins", "panoramas, 0.002, 128 bins", "residual alone, 256 bins"]
    shown.append("2-point LO-RANSAC x1000")
    for panel, count in zip(axes, (25, 100), strict=True):
        draw_success(panel, [c for c in cells if c.count == count and c.estimator in shown])
        panel.set_title(f"{count} correspondences")
    finish(figure, axes[0], output / "perspective.png")
    return cells


def exhaustive(
    pairs: Sequence[Correspondences], table: LikelihoodTable, bins: int
) -> tuple[np.ndarray, np.ndarray]:
    """Find the maxima of the likelihood from every local maximum of a fine grid.

    Each is climbed from twice, as it is and polished. Gives poses (pairs, 2) and log-likelihoods.
    """
    columns = np.concatenate([bearing_columns(pair) for pair in pairs], axis=1)
    odds = np.full(columns.shape[1], table.prior_odds)
    first = np.cumsum([0, *map(len, pairs)])
    arrays = PairArrays(columns, table.shapes(columns), odds, first)
    starts, _, owners, _ = table.ridges(bins).candidates(
        columns, arrays.shapes, odds, first, margin=1e9, most=1024
    )
    polished = starts.copy()
    cutoffs = table.noise * np.array(CUTOFFS)
    scratch = np.empty((len(polished), 4)), np.empty(len(polished), np.int64)
    refine_many(columns, first, TUKEY, 0.0, cutoffs, STEPS_PER_CUTOFF, polished, owners, *scratch)
    poses, owners = np.concatenate([starts, polished]), np.concatenate([owners, owners])
    for steps in CLIMBED:
        values, information = np.empty(len(poses)), np.empty((len(poses), 5))
        maximize(arrays, poses, owners, steps, table.arrays, values, information)
        highest = np.full(len(pairs), -np.inf)
        np.maximum.at(highest, owners, values)
        hopeful = values > highest[owners] - GIVEN_UP
        poses, owners, values = poses[hopeful], owners[hopeful], values[hopeful]
    order = np.lexsort((-values, owners))
    best = order[np.unique(owners[order], return_index=True)[1]]
    return poses[best], values[best] - np.diff(first) * np.log1p(table.prior_odds)


def draw_search(rows: Sequence[tuple[Any, ...]], path: Path) -> None:
    """Draw the shares over the number of candidates, a panel a kind of pairs."""
    figure = new_figure(9.0, 8.0)
    axes = figure.subplots(2, 2, sharey=True, sharex=True)
    for (name, count), panel in zip(dict.fromkeys(row[:2] for row in rows), axes.flat, strict=True):
        shares = sorted({row[2] for row in rows if row[:2] == (name, count)})
        for color, share in zip(CYCLE, shares, strict=False):
            for bins, style in zip(SEARCH_BINS, (".-", ".--", ".:"), strict=True):
                some = [row[4:9] for row in rows if row[:4] == (name, count, share, bins)]
                x, _, rate, low, high = np.array(some).T
                bars = (rate - low, high - rate)
                label = f"{share:.0%}, {bins} bins"
                panel.errorbar(x, rate, bars, fmt=style, color=color, lw=1.2, label=label)
        panel.set(xscale="log", ylim=(0.2, 1.02), title=f"{name}, {count} correspondences")
        panel.set_xticks(SEARCH_CANDIDATES, [str(c) for c in SEARCH_CANDIDATES])
        panel.minorticks_off()
        panel.legend(frameon=False, fontsize=8, ncols=2, loc="lower right")
        tidy(panel)
    for panel in axes[:, 0]:
        panel.set_ylabel("share equal to the exhaustive search")
    for panel in axes[1]:
        panel.set_xlabel("candidates")
    save_figure(figure, path)


def search(pairs: int, quick: bool, output: Path) -> list[tuple[Any, ...]]:
    """Measure how often the search from coarse to fine finds the exhaustive one's pose."""
    pairs = pairs // 4 if quick else pairs
    tried = [(bins, candidates) for bins in SEARCH_BINS for candidates in SEARCH_CANDIDATES]
    runs = [
        ("panoramas", LikelihoodTable.default(), CorrespondenceSimulator(), SEARCHED, 256),
        ("90 by 70 degrees", LikelihoodTable.default("perspective"), IMAGES, HARD, 512),
    ]
    cells = [(*run[:3], *cell, run[4]) for run in runs for cell in run[3]]
    rows = []
    for name, table, simulator, count, share, fine in tqdm(cells, desc="search", disable=None):
        given, headings = replace(simulator, mismatch=share).pairs(pairs, count, rng=SEED)
        best, highest = exhaustive(given, table, fine)
        reachable = (np.abs(wrap_to_pi(best - headings)).max(axis=1) < MAX_HEADING_ERROR).mean()
        for bins, candidates in tried:
            found = estimate_relative_poses(given, table, bins=bins, candidates=candidates)
            poses = np.array([[pose.heading_l, pose.heading_r] for pose in found])
            values = np.array([pose.log_likelihood for pose in found])
            equal = np.abs(wrap_to_pi(poses - best)).max(axis=1) < ALIKE
            equal |= values > highest - ALMOST
            rate = success_rate(equal)
            success = (np.abs(wrap_to_pi(poses - headings)).max(axis=1) < MAX_HEADING_ERROR).mean()
            row = (name, count, share, bins, candidates, pairs, rate.rate, rate.low, rate.high)
            rows.append((*row, float(success), float(reachable)))
    print(f"\n{'condition':20}{'n':>4}{'mismatch':>10}{'bins':>6}{'candidates':>12}", end="")
    print(f"{'equal':>8}{'95 % interval':>16}{'success':>9}{'exhaustive':>12}")
    for name, count, share, bins, candidates, _, rate, low, high, success, reachable in rows:
        print(
            f"{name:20}{count:4}{share:10.2f}{bins:6}{candidates:12}{rate:8.3f}"
            f"{f'{low:.3f} to {high:.3f}':>16}{success:9.3f}{reachable:12.3f}"
        )
    draw_search(rows, output / "search.png")
    return rows


COLUMNS = ("condition", "estimator", "correspondences", "mismatch", "pairs")
COLUMNS += ("success", "low", "high", "median_rad")
SEARCH_COLUMNS = ("condition", "correspondences", "mismatch", "bins", "candidates", "pairs")
SEARCH_COLUMNS += ("equal", "low", "high", "success", "success_exhaustive")
PARTS = {
    "accuracy": accuracy,
    "robustness": robustness,
    "perspective": perspective,
    "search": search,
}


def main() -> None:
    """Run the parts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--quick",
        action="store_true",
        help="200 pairs a cell, 50 in the last part, instead of 2,000",
    )
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--output", type=Path, default=Path("results/likelihood_success"))
    arguments = parser.parse_args()
    pairs = 200 if arguments.quick else 2000
    arguments.output.mkdir(parents=True, exist_ok=True)
    for name in arguments.parts:
        print(f"\n{name}: {pairs} pairs a cell, seed {SEED}, found within {MAX_HEADING_ERROR} rad")
        rows: Any = PARTS[name](pairs, arguments.quick, arguments.output)
        if name == "search":
            write_csv(arguments.output / "search.csv", SEARCH_COLUMNS, rows)
        else:
            write_csv(arguments.output / f"{name}.csv", COLUMNS, [cell.row() for cell in rows])
    print(f"\nwritten: {arguments.output}")


if __name__ == "__main__":
    main()
