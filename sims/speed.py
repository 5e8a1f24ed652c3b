"""Time the likelihood against its bounds, everything in one run on one core, as ratios.

    OMP_NUM_THREADS=1 python sims/speed.py

1. The 128 x 128 posterior grid of 25 correspondences, against adding 25 contiguous arrays of the
   table's own type and size in NumPy.
2. Learning the table, correspondences a second on one core.
3. `log_likelihood` of 10,000 poses against 10 references with the matches given, against features
   and matching of the same image of the simulated home.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter, process_time

import numpy as np

from pflut import (
    CorrespondenceSimulator,
    FeatureExtractor,
    LikelihoodTable,
    ReferenceImageModel,
    ReferenceMap,
    estimate_relative_pose,
    load_dataset,
)
from pflut.likelihood.learning import count_simulated

REPEATS = 30


def seconds(*functions: Callable[[], object]) -> list[float]:
    """Call functions in turn, many times; give the median of each."""
    for function in functions:
        function()
    times = np.empty((REPEATS, len(functions)))
    for row in times:
        for column, function in enumerate(functions):
            start = perf_counter()
            function()
            row[column] = perf_counter() - start
    return [float(value) for value in np.median(times, axis=0)]


def posterior_grid(table: LikelihoodTable) -> None:
    """Compare Algorithm 1 with additions of contiguous arrays."""
    for n in (25, 100):
        correspondences, _, _ = CorrespondenceSimulator(mismatch=0.8).pair(n, rng=0)
        arrays = [table.log_ratio[i].copy() for i in np.linspace(0, 127, n).astype(int)]

        def add(arrays: list[np.ndarray] = arrays) -> np.ndarray:
            total = np.zeros_like(arrays[0])
            for array in arrays:
                total += array
            return total

        def grid(correspondences=correspondences) -> object:
            return table.log_likelihood_grid(correspondences)

        def estimate(correspondences=correspondences) -> object:
            return estimate_relative_pose(correspondences, table)

        bound, ours, whole = seconds(add, grid, estimate)
        print(
            f"posterior grid, {n:3} correspondences  {1e6 * ours:7.0f} us, NumPy additions "
            f"{1e6 * bound:5.0f} us, ratio {ours / bound:.2f}; polished estimate "
            f"{1e6 * whole:.0f} us"
        )


def learning() -> None:
    """Count simulated correspondences on one core."""
    count_simulated(CorrespondenceSimulator(mismatch=0.0), 128, 100_000, num_threads=1)
    samples = 10_000_000
    start = process_time()
    count_simulated(CorrespondenceSimulator(mismatch=0.0), 128, samples, num_threads=1)
    spent = process_time() - start
    print(f"learning, 128 bins: {samples / spent / 1e6:.2f} million correspondences/s a core")


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
        f"10,000 poses against {len(matches)} references, {count} matches: "
        f"{1e3 * weigh:.1f} ms; features {1e3 * extract:.0f} ms, matching {1e3 * match:.0f} ms; "
        f"ratio 1/{(extract + match) / weigh:.0f}"
    )


if __name__ == "__main__":
    default = LikelihoodTable.default()
    posterior_grid(default)
    learning()
    sensor(default)
