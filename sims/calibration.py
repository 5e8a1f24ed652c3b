"""Check whether posteriors are as sure as they may be, with the temperature that fits and without.

    python sims/calibration.py [--quick] [--no-homes] [--output DIR]

For each group of pairs with known poses: the temperature fitted on other pairs, how often the
credible regions of 50, 80, 95 and 99 % hold the true pose, and the log score (nat; -3.68 where
nothing is known), at temperature 1 and at the fitted one. Simulated pairs of 25 and 100
correspondences; two rendered homes, each with the temperature of the other; a real home, with the
temperature of the rendered ones and with that of its own other half. Prints tables, writes a CSV
and two figures. What is not there (the real home) is skipped, and said so.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path

import numpy as np
from tqdm import tqdm

from pflut import (
    Correspondences,
    CorrespondenceSimulator,
    Coverage,
    DenseTable,
    LikelihoodTable,
    coverage,
    fit_temperature,
    load_dataset,
)
from pflut._files import write_csv
from pflut.datasets.base import Dataset
from pflut.datasets.simulated_home import load_simulated_home
from pflut.features import FeatureCache
from pflut.geometry import TWO_PI
from pflut.likelihood.known_pairs import Pair
from pflut.pairs import dataset_pairs
from pflut.plot import plot_calibration, save_figure

REAL_HOME = "zind_home000"
MAX_DISTANCE = 3.0
DEPTH = 25.0  # nat
DISTANCES = (0.0, 1.0, 2.0, 3.0)
LEVELS = (0.5, 0.8, 0.95, 0.99)
# a dense table of 512 bins has 134 million cells, a gigabyte with its transpose, and two for each
# of the 64 million correspondences that it is learned from: it would be noise
TABLES = {"default": (128, 256, 512), "points": (512,), "dense": (128, 256)}
HOME_TABLES = {"default": (128, 192, 256), "dense": (128, 256)}
HOME_BINS = 192  # of replays, by default
COLUMNS = ["group", "table", "bins", "fitted_pairs", "checked_pairs", "temperature", "at"]
COLUMNS += [f"{name}_{level}" for level in LEVELS for name in ("rate", "low", "high")]
COLUMNS += ["log_score", "least_log_density"]


@dataclass
class Result:
    """A temperature, and what it does to pairs that it was not fitted on."""

    group: str
    table: str
    bins: int
    fitted: int
    temperature: float
    before: Coverage
    after: Coverage

    def rows(self) -> Iterator[list[object]]:
        """Give the rows of the CSV."""
        for at, found in ((1.0, self.before), (self.temperature, self.after)):
            rates = np.stack([found.rates, found.low, found.high], axis=1).ravel()
            pairs = (self.group, self.table, self.bins, self.fitted, found.num_pairs)
            least = found.log_densities.min()
            yield [*pairs, self.temperature, at, *rates, found.log_score, least]

    def __str__(self) -> str:
        sides = (
            " ".join(f"{rate:5.3f}" for rate in found.rates) + f"{found.log_score:8.3f}"
            for found in (self.before, self.after)
        )
        return (
            f"{self.group:32}{self.table:8}{self.bins:5}{self.fitted:7}{self.before.num_pairs:7}"
            f"{self.temperature:7.3f}   " + "   ".join(sides)
        )


class Points:
    """The default table at the cells' centres, with no ridges in between, in its depth classes."""

    def __init__(self, bins: int) -> None:
        self.bins = bins
        self.table = LikelihoodTable.default(bins=bins)

    def log_likelihood_grid(
        self,
        correspondences: Correspondences,
        bins: int | None = None,
        *,
        window: np.ndarray | None = None,
    ) -> np.ndarray:
        """Compute what is not improbable; the rest would take hours."""
        rough = self.table.log_likelihood_grid(correspondences, bins)
        cells = np.argwhere(rough > rough.max() - DEPTH)
        exact = self.table.log_likelihood(correspondences, (cells + 0.5) * (TWO_PI / len(rough)))
        grid = rough + np.float32(exact.max() - rough.max())
        grid[tuple(cells.T)] = exact
        return grid


def simulated(num_pairs: int, count: int, mismatch: float, seed: int) -> list[Pair]:
    """Simulate pairs."""
    simulator = CorrespondenceSimulator(mismatch=mismatch)
    headings, bearings = simulator.sample(num_pairs, count, seed)
    return [
        (Correspondences(*views.T), *map(float, pose))
        for pose, views in zip(headings, bearings, strict=True)
    ]


def met(dataset: Dataset, limit: int | None) -> tuple[list[Pair], np.ndarray]:
    """Give the pairs of a reference and a query of a dataset, and their distances."""
    pairs = dataset_pairs(dataset, max_distance=MAX_DISTANCE, across=True, cache=FeatureCache())
    found = list(tqdm(pairs, desc=dataset.name, unit="pair", disable=None))
    if limit is not None:
        found = found[:: -(-len(found) // limit)]
    return [pair.known for pair in found], np.array([pair.distance for pair in found])


def check(group: str, name: str, bins: int, fitted: list[Pair], checked: list[Pair]) -> Result:
    """Fit on some pairs, and look at others."""
    table = {"default": LikelihoodTable.default, "dense": DenseTable.default, "points": Points}[
        name
    ](bins=bins)
    shown = tqdm(unit="pair", disable=None, leave=False, total=len(fitted) + 2 * len(checked))

    def counted(pairs: list[Pair]) -> Iterable[Pair]:
        for pair in pairs:
            yield pair
            shown.update()

    with shown:
        temperature = fit_temperature(counted(fitted), table)
        before = coverage(counted(checked), table, levels=LEVELS)
        after = coverage(counted(checked), table, temperature=temperature, levels=LEVELS)
    return Result(group, name, bins, len(fitted), temperature, before, after)


def header(title: str) -> None:
    """Print the names of a table's columns."""
    regions = " ".join(f"{level:5g}" for level in LEVELS) + "   score"
    print(f"\n{title}\n{'':66}{'temperature 1':35}fitted temperature")
    print(f"{'pairs':32}{'table':8}{'bins':>5}{'fitted':>7}{'check':>7}{'T':>7}   ", end="")
    print(f"{regions}   {regions}")


def simulations(num_pairs: int) -> list[Result]:
    """Look at simulated pairs; their own are fitted and checked."""
    header(f"simulated pairs, {num_pairs} to fit and {num_pairs} to check")
    results = []
    for count, mismatch in product((25, 100), (0.5, 0.8, 0.9)):
        pairs = simulated(2 * num_pairs, count, mismatch, seed=1)
        group = f"{count}, {100 * mismatch:.0f} % mismatches"
        for name, sizes in TABLES.items():
            if name == "points" and count < 100 and mismatch > 0.5:
                continue  # such wide posteriors would take an hour
            for bins in sizes:
                results.append(check(group, name, bins, pairs[::2], pairs[1::2]))
                print(results[-1], flush=True)
    return results


def homes(limit: int | None) -> list[Result]:
    """Look at rendered homes and the real one."""
    (one, one_far), (two, two_far) = (met(load_simulated_home(seed), limit) for seed in (0, 1))
    plan = [("home 0, fitted on home 1", two, one), ("home 1, fitted on home 0", one, two)]
    try:
        real, _ = met(load_dataset(REAL_HOME), limit)
    except FileNotFoundError as error:
        print(f"skipped: {error}")
    else:
        plan += [
            ("real home, fitted on homes 0, 1", one + two, real),
            ("real home, fitted on even pairs", real[::2], real[1::2]),
            ("real home, fitted on odd pairs", real[1::2], real[::2]),
        ]
    header(f"pairs of images within {MAX_DISTANCE:g} m")
    results = []
    for group, fitted, checked in plan:
        for name, sizes in HOME_TABLES.items():
            for bins in sizes:
                results.append(check(group, name, bins, fitted, checked))
                print(results[-1], flush=True)
    header("both homes by distance, each with the temperature of the other")
    first, second = [r for r in results if (r.table, r.bins) == ("default", HOME_BINS)][:2]
    for low, high in pairwise(DISTANCES):
        chosen = [(low < far) & (far <= high) for far in (one_far, two_far)]
        before, after = (
            part([getattr(first, side), getattr(second, side)], chosen)
            for side in ("before", "after")
        )
        temperature = float(np.sqrt(first.temperature * second.temperature))
        fitted = first.fitted + second.fitted
        group = f"homes, {low:g} to {high:g} m"
        results.append(Result(group, "default", HOME_BINS, fitted, temperature, before, after))
        print(results[-1], flush=True)
    return results


def part(found: list[Coverage], chosen: list[np.ndarray]) -> Coverage:
    """Take some pairs of several groups together."""
    masses, densities = (
        np.concatenate([getattr(c, name)[some] for c, some in zip(found, chosen, strict=True)])
        for name in ("masses", "log_densities")
    )
    return Coverage.of(masses, densities, LEVELS)


def draw(results: list[Result], wanted: dict[str, tuple[str, int]], title: str, path: Path) -> None:
    """Draw some results, before and after."""
    curves = {}
    for result in results:
        if wanted.get(result.group) == (result.table, result.bins):
            curves[f"{result.group}: temperature 1"] = result.before.masses
            curves[f"{result.group}: {result.temperature:.2f}"] = result.after.masses
    if curves:
        save_figure(plot_calibration(curves, title=title), path)


def main() -> None:
    """Run all groups."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="100 pairs a group instead of 1,000")
    parser.add_argument("--no-homes", action="store_true", help="simulated pairs only")
    parser.add_argument("--output", type=Path, default=Path("results/calibration"))
    arguments = parser.parse_args()
    results = simulations(50 if arguments.quick else 500)
    if not arguments.no_homes:
        results += homes(100 if arguments.quick else None)
    arguments.output.mkdir(parents=True, exist_ok=True)
    rows = (row for result in results for row in result.rows())
    write_csv(arguments.output / "calibration.csv", COLUMNS, rows)
    for name, wanted in (
        ("simulated", {"100, 50 % mismatches": 512, "100, 90 % mismatches": 512}),
        ("homes", {"home 0, fitted on home 1": 192, "real home, fitted on odd pairs": 192}),
    ):
        chosen = {group: ("default", bins) for group, bins in wanted.items()}
        draw(results, chosen, f"{name}, default table", arguments.output / f"{name}.png")
    print(f"\nwritten: {arguments.output}")


if __name__ == "__main__":
    main()
