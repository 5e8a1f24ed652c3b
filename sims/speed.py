"""Time the likelihood against its peers and bounds, everything in one run on one core, as ratios.

    OMP_NUM_THREADS=1 python sims/speed.py [--quick] [--output DIR]

1. The 128 x 128 posterior grid of the residual table, against the paper's table, and that against
   adding contiguous arrays of its own type and size in NumPy; on the same pairs.
2. The polished maximum-likelihood estimate with its covariance, in a batch, against the planar
   2-point LO-RANSAC (MSAC, cheirality) with 1,000 and 100 iterations and with adaptive stopping.
3. How the grid's time grows with correspondences and with bins: a figure.
4. Pairs a second, with one thread and with all cores.
5. Learning the tables, correspondences a second on one core.
6. `log_likelihood` of 10,000 poses against 10 references with the matches given, against features
   and matching of the same image of the simulated home.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from matplotlib.figure import Figure

from pflut import (
    Correspondences,
    CorrespondenceSimulator,
    DenseTable,
    FeatureExtractor,
    LikelihoodTable,
    ReferenceImageModel,
    ReferenceMap,
    estimate_relative_poses,
    load_dataset,
)
from pflut.comparison import by_ransac, by_table, compare_estimators
from pflut.likelihood import dense_learning, learning
from pflut.likelihood.sampling import available_cores
from pflut.plot import save_figure

CELLS = [(n, share) for n in (25, 100) for share in (0.5, 0.8, 0.9)]


def seconds(*functions: Callable[[], object], repeats: int = 15) -> list[float]:
    """Call functions in turn, many times; give the median of each."""
    for function in functions:
        function()
    times = np.empty((repeats, len(functions)))
    for row in times:
        for column, function in enumerate(functions):
            start = perf_counter()
            function()
            row[column] = perf_counter() - start
    return [float(value) for value in np.median(times, axis=0)]


def simulated(count: int, share: float, pairs: int) -> tuple[np.ndarray, list[Correspondences]]:
    """Give true headings (pairs, 2) and correspondences, with seed 1."""
    made, headings = CorrespondenceSimulator(mismatch=share).pairs(pairs, count, rng=1)
    return headings, made


def posterior_grids(table: LikelihoodTable, dense: DenseTable, pairs: int) -> None:
    """Compare the ridges with Algorithm 1, and that with additions of contiguous arrays."""
    print("posterior grid, 128 x 128, us a pair")
    print(f"{'correspondences':>16}{'mismatches':>12}{'residual':>10}{'dense':>8}{'ratio':>8}")
    for count, share in CELLS:
        _, made = simulated(count, share, pairs)
        ours, theirs = seconds(
            lambda made=made: [table.log_likelihood_grid(pair) for pair in made],
            lambda made=made: [dense.log_likelihood_grid(pair) for pair in made],
        )
        print(
            f"{count:16}{share:12.0%}{1e6 * ours / pairs:10.1f}{1e6 * theirs / pairs:8.1f}"
            f"   1/{theirs / ours:.2f}"
        )
    arrays = [dense.log_ratio[i].copy() for i in np.linspace(0, 127, 25).astype(int)]

    def add() -> np.ndarray:
        total = np.zeros_like(arrays[0])
        for array in arrays:
            total += array
        return total

    pair = simulated(25, 0.8, 1)[1][0]
    bound, theirs = seconds(add, lambda: dense.log_likelihood_grid(pair), repeats=60)
    print(
        f"dense, 25 correspondences of one pair: {1e6 * theirs:.0f} us, NumPy additions "
        f"{1e6 * bound:.0f} us, ratio {theirs / bound:.2f}"
    )


def estimates(table: LikelihoodTable, pairs: int) -> None:
    """Compare the estimate with RANSAC: time and success on the same pairs."""
    estimators = {
        "likelihood": by_table(table),
        "2-point x1000": by_ransac(),
        "2-point x100": by_ransac(max_iterations=100),
        "2-point adaptive": by_ransac(confidence=0.999),
    }
    print("\npolished estimate with covariance, us a pair (share of pairs within 0.1 rad)")
    names = "".join(f"{name:>22}" for name in estimators)
    print(f"{'correspondences':>16}{'mismatches':>12}{names}")
    for count, share in CELLS:
        headings, made = simulated(count, share, pairs)
        calls = [lambda e=estimate, made=made: e(made) for estimate in estimators.values()]
        times = seconds(*calls, repeats=5)
        found = compare_estimators(estimators, made, headings)
        line = f"{count:16}{share:12.0%}"
        for time, errors in zip(times, found.values(), strict=True):
            line += f"{f'{1e6 * time / pairs:.0f} ({errors.found.mean():.3f})':>22}"
        print(line)


def throughput(table: LikelihoodTable, pairs: int) -> None:
    """Estimate many pairs of 25 correspondences with one thread and with all cores."""
    cores = available_cores()
    for share in (0.5, 0.8, 0.9):
        _, made = simulated(25, share, pairs)
        one, all_cores = seconds(
            lambda made=made: estimate_relative_poses(made, table),
            lambda made=made: estimate_relative_poses(made, table, num_threads=cores),
            repeats=5,
        )
        print(
            f"25 correspondences, {share:.0%} mismatches: {pairs / one:,.0f} pairs a second with "
            f"one thread, {pairs / all_cores:,.0f} with {cores}"
        )


def growth(table: LikelihoodTable, pairs: int, output: Path) -> None:
    """Draw the grid's time against correspondences and against bins."""
    counts, bins = (12, 25, 50, 100, 200, 400), (32, 64, 96, 128, 192, 256, 384)
    made = {count: simulated(count, 0.8, pairs)[1] for count in counts}
    by_count = [
        seconds(lambda pair=made[count]: [table.log_likelihood_grid(p) for p in pair], repeats=7)[0]
        for count in counts
    ]
    by_bins = [
        seconds(lambda b=b: [table.log_likelihood_grid(p, b) for p in made[100]], repeats=7)[0]
        for b in bins
    ]
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for axes, x, times, label in (
        (left, counts, by_count, "correspondences, 128 bins"),
        (right, bins, by_bins, "bins an axis, 100 correspondences"),
    ):
        time = 1e6 * np.array(times) / pairs
        axes.plot(x, time, "o-", label="grid of the residual table")
        slope = time[-1] / x[-1]
        axes.plot(x, slope * np.array(x), "--", color="0.5", label="linear")
        axes.set(xlabel=label, ylabel="time a pair [us]", xlim=(0, None), ylim=(0, None))
        axes.legend()
        axes.grid(alpha=0.3)
    save_figure(figure, output / "growth.png")
    print(f"written: {output / 'growth.png'}")


def learn() -> None:
    """Count simulated correspondences on one core."""
    simulator = CorrespondenceSimulator()
    for name, samples, count in (
        (
            "residual table",
            16_000_000,
            lambda n: learning.count_simulated(simulator, n, num_classes=4, num_threads=1),
        ),
        (
            "dense table, 128 bins",
            10_000_000,
            lambda n: dense_learning.count_simulated(simulator, 128, n, num_threads=1),
        ),
    ):
        count(100_000)
        start = process_time()
        count(samples)
        spent = process_time() - start
        print(f"learning, {name}: {samples / spent / 1e6:.2f} million correspondences/s a core")


def sensor(table: LikelihoodTable) -> None:
    """Compare weighting 10,000 particles with making the correspondences."""
    dataset = load_dataset("simulated-home")
    extractor = FeatureExtractor(dataset.camera, mask_elevation=dataset.mask_elevation)
    model = ReferenceImageModel(
        ReferenceMap.from_dataset(dataset, extractor),
        table,
        extractor=extractor,
        max_references=10,
        max_candidates=10,
    )
    index = int(dataset.query_indices[20])
    image, truth = dataset.image(index), dataset.ground_truth[index]
    poses = truth + np.random.default_rng(0).normal(0, [0.3, 0.3, 0.2], (10_000, 3))
    features = model.observe(image)
    matches = model.match(poses, features)
    extract, match, weigh = seconds(
        lambda: model.observe(image),
        lambda: model.match(poses, features),
        lambda: model.log_likelihood_of_matches(poses, matches),
    )
    count = sum(len(m.correspondences) for m in matches)
    print(
        f"10,000 poses against {len(matches)} references, {count} matches, {table.bins} bins: "
        f"{1e3 * weigh:.1f} ms; features {1e3 * extract:.0f} ms, matching {1e3 * match:.0f} ms; "
        f"ratio 1/{(extract + match) / weigh:.0f}"
    )


def main() -> None:
    """Time everything."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer pairs, no simulated home")
    parser.add_argument("--output", type=Path, default=Path("results/speed"))
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    pairs = 64 if arguments.quick else 256
    table, dense = LikelihoodTable.default(), DenseTable.default()
    posterior_grids(table, dense, pairs)
    estimates(table, 4 * pairs)
    throughput(table, 16 * pairs)
    growth(table, pairs // 4, arguments.output)
    learn()
    if not arguments.quick:
        sensor(table)
        sensor(table.with_bins(192))


if __name__ == "__main__":
    main()
