"""``pflut lut``: learn likelihood tables, and look at them."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pflut.cli import calibrate
from pflut.cli.arguments import Subparsers, add_references, add_verb, natural, positive

if TYPE_CHECKING:
    from pflut.cli.progress import Bars
    from pflut.likelihood.dense import DenseTable
    from pflut.likelihood.table import LikelihoodTable
    from pflut.simulation.correspondences import CorrespondenceSimulator

_BUILD_DETAILS = """\
The table is learned from the simulator (two cameras on a circle around a ball of landmarks), or
with --from-dataset from the matches of a dataset's image pairs with their true poses. It is the
table of residuals that pflut uses by default, or with --dense the paper's. The same seed gives the
same table, whatever the number of threads."""

_BUILD_EXAMPLES = """\
  pflut lut build table.npz                                the table that comes with pflut
  pflut lut build tilted.npz --max-tilt-deg 14 --mismatch 0.6
  pflut lut build narrow.npz --field-of-view-deg 90,70 --noise 0.002 --bins 256
  pflut lut build home.npz --from-dataset zind/            from real pairs
  pflut lut build paper.npz --dense --mismatches simulated
"""


class _Way(NamedTuple):
    """One of the four ways to learn a table."""

    dense: bool
    real: bool

    def __str__(self) -> str:
        return f"a {'dense' if self.dense else 'residual'} table from " + (
            "a dataset" if self.real else "the simulator"
        )


_RESIDUAL, _RESIDUAL_REAL = _Way(False, False), _Way(False, True)
_DENSE, _DENSE_REAL = _Way(True, False), _Way(True, True)

# in which ways an option counts, and its value where it does; arguments are None unless given
_OPTIONS: dict[str, Mapping[_Way, Any]] = {
    "bins": {_RESIDUAL: 128, _RESIDUAL_REAL: None, _DENSE: 128, _DENSE_REAL: 32},
    "seed": dict.fromkeys((_RESIDUAL, _RESIDUAL_REAL, _DENSE), 0),
    "samples": dict.fromkeys((_RESIDUAL, _DENSE), 64_000_000),
    "mismatch": dict.fromkeys((_RESIDUAL, _DENSE), 0.9),
    "noise": dict.fromkeys((_RESIDUAL, _DENSE), 0.01),
    "max_tilt_deg": dict.fromkeys((_RESIDUAL, _DENSE), 0.0),
    "threads": dict.fromkeys((_RESIDUAL, _DENSE)),
    "classes": {_RESIDUAL: 4},
    "scene": {_RESIDUAL: "ball"},
    "field_of_view_deg": {_RESIDUAL: None},
    "max_turn_deg": {_RESIDUAL: 30.0},
    "mismatches": {_DENSE: "uniform"},
    "prior": {_RESIDUAL_REAL: "default"},
    "max_distance": dict.fromkeys((_RESIDUAL_REAL, _DENSE_REAL), 3.0),
    "references": dict.fromkeys((_RESIDUAL_REAL, _DENSE_REAL)),
}


def add_parser(verbs: Subparsers) -> None:
    """Add the verb and its three actions."""
    parser = add_verb(
        verbs,
        "lut",
        "learn a likelihood table (build), describe one (info), or calibrate its posteriors",
        usage="{build,info,calibrate} ...",
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
    build.add_argument("--dense", action="store_true", help="learn the paper's table")
    build.add_argument(
        "--bins",
        metavar="N",
        type=positive,
        help="cells of each axis: of the grids that the table makes unless told otherwise "
        "(default: 128; of a dataset the prior's); with --dense of the table itself, 4 to 512 "
        "(default: 128; 32 of a dataset)",
    )
    build.add_argument("--seed", metavar="N", type=natural, help="(default: 0)")
    simulator = build.add_argument_group("from the simulator")
    simulator.add_argument(
        "--samples",
        metavar="N",
        type=positive,
        help="simulated correspondences (default: 64000000)",
    )
    simulator.add_argument(
        "--mismatch",
        metavar="SHARE",
        type=float,
        help="of mismatches among the correspondences (default: 0.9)",
    )
    simulator.add_argument(
        "--noise",
        metavar="RADIANS",
        type=float,
        help="of the bearings, standard deviation; with --field-of-view-deg in the image plane "
        "at unit focal length (default: 0.01)",
    )
    simulator.add_argument(
        "--max-tilt-deg",
        metavar="X",
        type=float,
        help="degrees of random roll and pitch of one view (default: 0; the paper's LUT rot: 14.3)",
    )
    simulator.add_argument("--threads", metavar="N", type=positive, help="(default: all cores)")
    simulator.add_argument(
        "--classes", metavar="N", type=positive, help="depth classes, 1 to 32 (default: 4)"
    )
    simulator.add_argument(
        "--scene",
        choices=("ball", "box"),
        help="where landmarks are: the paper's ball, or the walls of rooms (default: ball)",
    )
    simulator.add_argument(
        "--field-of-view-deg",
        metavar="H,V",
        type=_angles,
        help="degrees that perspective cameras see (default: panoramas, which see everything)",
    )
    simulator.add_argument(
        "--max-turn-deg",
        metavar="X",
        type=float,
        help="degrees between the headings of their two views, at most (default: 30)",
    )
    simulator.add_argument(
        "--mismatches",
        choices=("uniform", "simulated"),
        help="with --dense, how mismatches enter: uniform azimuths, or simulated as in the paper "
        "(default: uniform)",
    )
    real = build.add_argument_group("from real pairs")
    real.add_argument(
        "--from-dataset",
        metavar="DATASET",
        help="learn from the image pairs of a dataset with ground truth instead",
    )
    real.add_argument(
        "--prior",
        metavar="NAME|FILE",
        help="the residual table that fills what the pairs do not say: default, home, perspective "
        "or a file (default: default)",
    )
    real.add_argument(
        "--max-distance",
        metavar="METRES",
        type=float,
        help="between the images of a pair (default: 3)",
    )
    add_references(real)
    build.set_defaults(run=run_build, parser=build)
    info = add_verb(
        actions,
        "info",
        "say what a likelihood table holds, and how it was learned",
        usage="[NAME|FILE]",
        examples="  pflut lut info\n  pflut lut info dense\n  pflut lut info table.npz\n",
    )
    info.add_argument(
        "table",
        metavar="NAME|FILE",
        nargs="?",
        default="default",
        help="default, home and perspective come with pflut, dense is the paper's; or a table's "
        "file (default: %(default)s)",
    )
    info.set_defaults(run=run_info, parser=info)
    calibrate.add_parser(actions)


def run_build(arguments: argparse.Namespace) -> None:
    """Learn a table and write it."""
    from time import perf_counter

    from pflut.cli.progress import Bars

    _complete(arguments)
    # before minutes of work, not after
    if arguments.out.suffix != ".npz":
        raise ValueError(f"{arguments.out}: expected a name that ends in .npz")
    if not arguments.out.parent.is_dir():
        raise ValueError(f"{arguments.out}: its folder does not exist")
    start = perf_counter()
    with Bars() as bars:
        if arguments.from_dataset is None:
            table = _from_simulation(arguments, bars)
        else:
            table = _from_dataset(arguments, bars)
    seconds = perf_counter() - start
    table.save(arguments.out)
    samples = table.learned_from["num_samples"]
    print(
        f"{arguments.out}: {_kind(table)} table from {samples:,} correspondences in "
        f"{seconds:.1f} s, {samples / seconds / 1e6:.2f} million a second"
    )


def run_info(arguments: argparse.Namespace) -> None:
    """Describe a table."""
    from pflut.cli.progress import Bars
    from pflut.likelihood.table import LikelihoodTable
    from pflut.replay.tables import choose_table

    with Bars() as bars:
        table = choose_table(arguments.table, progress=bars.stage("table"))
    rows = _residual_rows(table) if isinstance(table, LikelihoodTable) else _dense_rows(table)
    for name, value in [("kind", _kind(table)), *rows, ("learned from", "")]:
        print(f"{name:<14}{value}".rstrip())
    _print_nested(table.learned_from, "  ")


def _complete(arguments: argparse.Namespace) -> None:
    """Fill in the defaults; end as wrong usage where an argument would not count."""
    parser: argparse.ArgumentParser = arguments.parser
    way = _Way(arguments.dense, arguments.from_dataset is not None)
    ignored = []
    for name, values in _OPTIONS.items():
        if getattr(arguments, name) is None:
            setattr(arguments, name, values.get(way))
        elif way not in values:
            ignored.append(f"--{name.replace('_', '-')}")
        elif name == "max_turn_deg" and arguments.field_of_view_deg is None:
            parser.error("argument --max-turn-deg: only allowed with --field-of-view-deg")
    if ignored:
        plural = "s" * (len(ignored) > 1)
        parser.error(f"argument{plural} {', '.join(ignored)}: without effect on {way}")


def _from_simulation(arguments: argparse.Namespace, bars: Bars) -> LikelihoodTable | DenseTable:
    from pflut.likelihood.dense import DenseTable
    from pflut.likelihood.table import LikelihoodTable

    common: dict[str, Any] = {
        "bins": arguments.bins,
        "num_samples": arguments.samples,
        "simulator": _simulator(arguments),
        "seed": arguments.seed,
        "num_threads": arguments.threads,
        "progress": bars.stage("table"),
    }
    if arguments.dense:
        return DenseTable.from_simulation(mismatches=arguments.mismatches, **common)
    return LikelihoodTable.from_simulation(num_classes=arguments.classes, **common)


def _simulator(arguments: argparse.Namespace) -> CorrespondenceSimulator:
    """Make the simulator that the arguments ask for."""
    from pflut.simulation.correspondences import CorrespondenceSimulator

    more: dict[str, Any] = {}
    if arguments.scene is not None:
        more["scene"] = arguments.scene
    if arguments.field_of_view_deg is not None:
        more["field_of_view"] = tuple(map(radians, arguments.field_of_view_deg))
        more["max_turn"] = radians(arguments.max_turn_deg)
    return CorrespondenceSimulator(
        noise=arguments.noise,
        mismatch=arguments.mismatch,
        max_tilt=radians(arguments.max_tilt_deg),
        **more,
    )


def _from_dataset(arguments: argparse.Namespace, bars: Bars) -> LikelihoodTable | DenseTable:
    from pflut.cli.loading import load
    from pflut.features import FeatureCache
    from pflut.likelihood.dense import DenseTable
    from pflut.likelihood.table import LikelihoodTable
    from pflut.pairs import dataset_pairs
    from pflut.replay.options import ReplayOptions
    from pflut.replay.pipeline import make_extractor

    prior = None if arguments.dense else _prior(arguments.prior)
    dataset = load(arguments.from_dataset, arguments.references, progress=bars)
    found = dataset_pairs(
        dataset,
        make_extractor(dataset, ReplayOptions()),
        max_distance=arguments.max_distance,
        cache=FeatureCache(),
        progress=bars.stage("pairs"),
    )
    pairs = (pair.known for pair in found)
    source = f"{dataset.name}, pairs within {arguments.max_distance:g} m"
    if prior is None:
        return DenseTable.from_pairs(pairs, bins=arguments.bins, source=source)
    return LikelihoodTable.from_pairs(
        pairs, prior=prior, bins=arguments.bins, source=source, seed=arguments.seed
    )


def _prior(name: str) -> LikelihoodTable:
    """Load the table that fills what real pairs do not say."""
    from pflut.likelihood.table import DEFAULT_BINS, LikelihoodTable
    from pflut.replay.tables import choose_table

    table = choose_table(name, bins=DEFAULT_BINS if name == "default" else None)
    if not isinstance(table, LikelihoodTable):
        raise ValueError(f"{name}: a dense table, expected a residual one")
    return table


def _kind(table: LikelihoodTable | DenseTable) -> str:
    from pflut.likelihood import dense
    from pflut.likelihood import table as residual

    return residual.KIND if isinstance(table, residual.LikelihoodTable) else dense.KIND


def _residual_rows(table: LikelihoodTable) -> list[tuple[str, str]]:
    """Say what a residual table holds."""
    quality = "not looked at"
    if table.quality is not None:
        best, worst = table.quality[0], table.quality[-1]
        quality = f"multiplies the odds of a true match by {best:.2f} at best, {worst:.2f} at worst"
    parts = [a for a in (table.density, table.profile, table.quality) if a is not None]
    return [
        ("classes", f"{table.num_classes} of depth"),
        ("noise", f"{table.noise:.4f} rad, of the residuals of true matches"),
        ("mismatch", f"{100 * table.mismatch:.1f} % of the correspondences, beforehand"),
        ("quality", quality),
        ("bins", f"{table.bins} of heading_l and of heading_r, or any other number"),
        ("memory", f"{sum(part.nbytes for part in parts) / 1e6:.2f} MB as {table.density.dtype}"),
    ]


def _dense_rows(table: DenseTable) -> list[tuple[str, str]]:
    """Say what a dense table holds."""
    cells = table.log_ratio
    above = 100 * float((cells > 0).mean())
    return [
        ("bins", f"{len(cells)} of r, {table.bins} of theta - alpha_l and of phi - alpha_r"),
        ("memory", f"{cells.nbytes / 1e6:.2f} MB as {cells.dtype}"),
        (
            "log-ratio",
            f"{cells.min():.2f} to {cells.max():.2f} nat against uniform azimuths, "
            f"{above:.1f} % of the cells above",
        ),
    ]


def _print_nested(entries: Mapping[str, Any], indent: str) -> None:
    """Print a table's provenance; the simulator's settings, and a prior's, are below their name."""
    width = max(map(len, entries), default=0) + 2
    for name, value in entries.items():
        if isinstance(value, dict):
            print(f"{indent}{name}")
            _print_nested(value, indent + "  ")
        else:
            print(f"{indent}{name:<{width}}{value}")


def _angles(text: str) -> tuple[float, float]:
    """Parse --field-of-view-deg: two numbers."""
    try:
        horizontal, vertical = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected H,V, got {text!r}") from None
    return horizontal, vertical
