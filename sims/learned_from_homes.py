"""Tables learned from rendered homes, with and without match quality, used in homes not seen.

    python sims/learned_from_homes.py [--train 0 1] [--test 3] [--real DATASET] [--output DIR]

Compares the default table, the same with what the homes tell of mismatches and of quality, and the
table learned from the homes, on the pairs of another rendered home and of a real one. Prints a
table, writes a CSV.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from pflut import LikelihoodTable, load_dataset
from pflut._files import write_csv
from pflut.comparison import by_table, compare_estimators
from pflut.datasets import Dataset, load_simulated_home
from pflut.features import FeatureCache
from pflut.pairs import ImagePair, correspondences_and_headings, dataset_pairs

MAX_ERRORS = np.radians([20.0, 5.0])  # of the headings, of the rotation


def matched(dataset: Dataset, max_distance: float) -> Iterator[ImagePair]:
    """Match the near pairs of a dataset."""
    pairs = dataset_pairs(dataset, max_distance=max_distance, cache=FeatureCache())
    yield from tqdm(pairs, desc=dataset.name, unit="pair", disable=None)


def main() -> None:
    """Learn and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--train", type=int, nargs="+", default=[0, 1], help="seeds of homes")
    parser.add_argument("--test", type=int, default=3, help="seed of a home")
    parser.add_argument("--real", help="a dataset with true poses")
    parser.add_argument("--output", type=Path, default=Path("results/learned_from_homes"))
    arguments = parser.parse_args()
    train = [
        pair.known
        for seed in arguments.train
        for pair in matched(load_simulated_home(seed=seed), 2.5)
    ]
    default = LikelihoodTable.default()
    learned = LikelihoodTable.from_pairs(train, source=f"homes {arguments.train}")
    print(
        f"learned from {len(train)} pairs, {learned.learned_from['num_samples']} matches: "
        f"{learned.mismatch:.0%} mismatches, noise {learned.noise:.4f} rad"
    )
    tables = {
        "default": default,
        "default, mismatch share": replace(default, mismatch=learned.mismatch),
        "default, share and quality": replace(
            default, mismatch=learned.mismatch, quality=learned.quality
        ),
        "learned": learned,
        "learned, no quality": replace(learned, quality=None),
    }
    sets = {f"home {arguments.test}": (load_simulated_home(seed=arguments.test), 2.5)}
    if arguments.real is not None:
        sets["real"] = (load_dataset(arguments.real), 3.0)
    estimators = {name: by_table(table) for name, table in tables.items()}
    print("right: rotation within 5 deg, both headings within 20 deg")
    rows = []
    for name, (dataset, distance) in sets.items():
        pairs = correspondences_and_headings(matched(dataset, distance))
        for label, errors in compare_estimators(estimators, *pairs).items():
            within = np.stack([errors.heading, errors.rotation], axis=1) < MAX_ERRORS
            right = float(within.all(axis=1).mean())
            rotation = float(np.degrees(np.median(errors.rotation)))
            rows.append((name, label, len(errors), right, rotation))
            print(
                f"{name:10}{label:28}{len(errors):6} pairs, right {right:.3f}, "
                f"rotation {rotation:6.2f} deg"
            )
    arguments.output.mkdir(parents=True, exist_ok=True)
    columns = ("set", "table", "pairs", "right", "rotation_deg")
    write_csv(arguments.output / "tables.csv", columns, rows)
    print(f"written: {arguments.output}")


if __name__ == "__main__":
    main()
