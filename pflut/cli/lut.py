"""``pflut lut``: learn likelihood tables, and look at them."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pflut.cli.arguments import Subparsers, add_references, add_verb, natural, positive

if TYPE_CHECKING:
    from pflut.cli.progress import Bars
    from pflut.likelihood.table import LikelihoodTable

_BUILD_DETAILS = """\
The table is learned from the simulator (two cameras on a circle around a ball of landmarks), or
with --from-dataset from the matches of a dataset's image pairs with their true poses. The same
seed gives the same table, whatever the number of threads."""

_BUILD_EXAMPLES = """\
  pflut lut build table.npz                                   as the default table
  pflut lut build small.npz --bins 32 --samples 5000000
  pflut lut build tilted.npz --max-tilt-deg 14 --mismatch 0.6
  pflut lut build home.npz --from-dataset zind/ --bins 32     from real pairs
"""

# what counts in one of the two ways to learn only; their arguments are None unless given
_OF_SIMULATION: dict[str, Any] = {
    "samples": 64_000_000,
    "mismatch": 0.9,
    "noise": 0.01,
    "max_tilt_deg": 0.0,
    "mismatches": "uniform",
    "seed": 0,
    "threads": None,
}
_OF_PAIRS: dict[str, Any] = {"max_distance": 3.0, "references": None}


def add_parser(verbs: Subparsers) -> None:
    """Add the verb and its two actions."""
    parser = add_verb(
        verbs,
        "lut",
        "learn a likelihood table (build), or describe one (info)",
        usage="{build,info} ...",
    )
    actions = parser.add_subparsers(
        title="actions", metavar="ACTION", required=True, prog=parser.prog
    )
    build = add_verb(
        actions,
        "build",
        "learn a likelihood table",
        usage="[options] OUT.npz",
        details=_BUILD_DETAILS,
        examples=_BUILD_EXAMPLES,
    )
    build.add_argument("out", metavar="OUT.npz", type=Path, help="the file to write")
    build.add_argument(
        "--bins",
        metavar="N",
        type=positive,
        help="cells of each axis, 4 to 512 (default: 128; 32 of a dataset)",
    )
    build.add_argument(
        "--samples",
        metavar="N",
        type=positive,
        help=f"simulated correspondences (default: {_OF_SIMULATION['samples']})",
    )
    build.add_argument(
        "--mismatch",
        metavar="SHARE",
        type=float,
        help=f"of mismatches among them (default: {_OF_SIMULATION['mismatch']})",
    )
    build.add_argument(
        "--noise",
        metavar="RADIANS",
        type=float,
        help=f"of the bearings, standard deviation (default: {_OF_SIMULATION['noise']})",
    )
    build.add_argument(
        "--max-tilt-deg",
        metavar="X",
        type=float,
        help="degrees of random roll and pitch of one view "
        f"(default: {_OF_SIMULATION['max_tilt_deg']}; the paper's LUT rot: 14.3)",
    )
    build.add_argument(
        "--mismatches",
        choices=("uniform", "simulated"),
        help="how mismatches enter: uniform azimuths, or simulated as in the paper "
        f"(default: {_OF_SIMULATION['mismatches']})",
    )
    build.add_argument(
        "--seed", metavar="N", type=natural, help=f"(default: {_OF_SIMULATION['seed']})"
    )
    build.add_argument("--threads", metavar="N", type=positive, help="(default: all cores)")
    build.add_argument(
        "--from-dataset",
        metavar="DATASET",
        help="learn from the image pairs of a dataset with ground truth instead",
    )
    build.add_argument(
        "--max-distance",
        metavar="METRES",
        type=float,
        help=f"between the images of a pair (default: {_OF_PAIRS['max_distance']})",
    )
    add_references(build)
    build.set_defaults(run=run_build, parser=build)
    info = add_verb(
        actions,
        "info",
        "say how a likelihood table was learned",
        usage="FILE|default",
        examples="  pflut lut info default\n  pflut lut info table.npz\n",
    )
    info.add_argument(
        "file",
        metavar="FILE|default",
        nargs="?",
        default="default",
        help="a table's file (default: the default table)",
    )
    info.set_defaults(run=run_info, parser=info)


def run_build(arguments: argparse.Namespace) -> None:
    """Learn a table and write it."""
    from time import perf_counter

    from pflut.cli.progress import Bars

    if arguments.from_dataset is None:
        _refuse(arguments, _OF_PAIRS, "only allowed with argument --from-dataset")
    else:
        _refuse(arguments, _OF_SIMULATION, "not allowed with argument --from-dataset")
    for name, value in (_OF_SIMULATION | _OF_PAIRS).items():
        if getattr(arguments, name) is None:
            setattr(arguments, name, value)
    # before minutes of work, not after
    if arguments.out.suffix != ".npz":
        raise ValueError(f"{arguments.out}: expected a name that ends in .npz")
    if not arguments.out.parent.is_dir():
        raise ValueError(f"{arguments.out}: its folder does not exist")
    start = perf_counter()
    with Bars() as bars:
        learn = _from_simulation if arguments.from_dataset is None else _from_dataset
        table = learn(arguments, bars)
    seconds = perf_counter() - start
    table.save(arguments.out)
    samples = table.learned_from["num_samples"]
    print(
        f"{arguments.out}: {table.bins} bins from {samples:,} correspondences in "
        f"{seconds:.1f} s, {samples / seconds / 1e6:.2f} million a second"
    )


def run_info(arguments: argparse.Namespace) -> None:
    """Describe a table."""
    import numpy as np

    from pflut.cli.loading import load_table
    from pflut.cli.progress import Bars
    from pflut.replay.pipeline import COMMON_BINS

    named = None if arguments.file == "default" else Path(arguments.file)
    with Bars() as bars:
        table = load_table(named, COMMON_BINS, progress=bars)
    cells = table.log_ratio
    print(
        f"bins        {cells.shape[0]} of r, {cells.shape[1]} of theta - alpha_l and of "
        "phi - alpha_r"
    )
    print(f"memory      {cells.nbytes / 1e6:.1f} MB as {cells.dtype}")
    print(
        f"log-ratio   {cells.min():.2f} to {cells.max():.2f} nat against uniform azimuths, "
        f"{100 * float(np.mean(cells > 0)):.1f} % of the cells above"
    )
    for name, value in _flat(table.learned_from):
        print(f"{name:<12}{value}")


def _from_simulation(arguments: argparse.Namespace, bars: Bars) -> LikelihoodTable:
    from math import radians

    from pflut.likelihood.table import LikelihoodTable
    from pflut.simulation.correspondences import CorrespondenceSimulator

    return LikelihoodTable.from_simulation(
        bins=arguments.bins or 128,
        num_samples=arguments.samples,
        simulator=CorrespondenceSimulator(
            noise=arguments.noise,
            mismatch=arguments.mismatch,
            max_tilt=radians(arguments.max_tilt_deg),
        ),
        mismatches=arguments.mismatches,
        seed=arguments.seed,
        num_threads=arguments.threads,
        progress=bars.stage("table"),
    )


def _from_dataset(arguments: argparse.Namespace, bars: Bars) -> LikelihoodTable:
    from pflut.cli.loading import load
    from pflut.features import FeatureCache
    from pflut.likelihood.table import LikelihoodTable
    from pflut.pairs import dataset_pairs
    from pflut.replay.options import ReplayOptions
    from pflut.replay.pipeline import make_extractor

    dataset = load(arguments.from_dataset, arguments.references, progress=bars)
    pairs = dataset_pairs(
        dataset,
        make_extractor(dataset, ReplayOptions()),
        max_distance=arguments.max_distance,
        cache=FeatureCache(),
        progress=bars.stage("pairs"),
    )
    return LikelihoodTable.from_pairs(
        ((pair.correspondences, pair.heading_l, pair.heading_r) for pair in pairs),
        bins=arguments.bins or 32,
        source=f"{dataset.name}, pairs within {arguments.max_distance:g} m",
    )


def _refuse(arguments: argparse.Namespace, names: Iterable[str], why: str) -> None:
    """End as wrong usage where an argument was given that would be ignored."""
    given = [
        f"--{name.replace('_', '-')}" for name in names if getattr(arguments, name) is not None
    ]
    if given:
        parser: argparse.ArgumentParser = arguments.parser
        parser.error(f"argument{'s' * (len(given) > 1)} {', '.join(given)}: {why}")


def _flat(learned_from: dict[str, object]) -> list[tuple[str, object]]:
    """Give the entries of a table's provenance, the simulator's among them."""
    rows: list[tuple[str, object]] = []
    for name, value in learned_from.items():
        rows += _flat(value) if isinstance(value, dict) else [(name, value)]
    return rows
