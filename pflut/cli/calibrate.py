"""``pflut lut calibrate``: fit and check how sure posteriors may be."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pflut.cli.arguments import Subparsers, add_references, add_verb, natural, positive

if TYPE_CHECKING:
    from pflut.calibration import Coverage
    from pflut.camera.base import Camera
    from pflut.cli.progress import Bars
    from pflut.likelihood.known_pairs import Pair

_DETAILS = """\
Posteriors are calibrated if their credible regions of mass p hold the true pose in a share p of the
pairs. Correspondences are not independent, so a likelihood that multiplies them is too sure; the
temperature, a factor on its logarithm, makes up for it. It is fitted on every second pair and
checked on the others. The pairs are those of a reference and a query image of DATASET that are near
each other, or simulated ones; the log score is the mean of the log-density at the true poses."""

_EXAMPLES = """\
  pflut lut calibrate                          the simulated home's pairs
  pflut lut calibrate drive/ --references every:5 --figure calibration.png
  pflut lut calibrate --simulate 1000 --correspondences 100 --mismatch 0.5 --bins 512
  pflut lut calibrate --simulate 1000 --table dense
"""

SIMULATED_HOME = "simulated-home"
# what counts for the one or the other source of pairs only; arguments are None unless given
_OF_DATASET: dict[str, Any] = {"max_distance": 3.0, "references": None}
_OF_SIMULATION: dict[str, Any] = {"correspondences": 100, "mismatch": 0.9, "seed": 0}


def add_parser(actions: Subparsers) -> None:
    """Add the action to those of ``pflut lut``."""
    parser = add_verb(
        actions,
        "calibrate",
        "fit the temperature of posteriors to pairs with known poses, and check it",
        usage="[options] [DATASET | --simulate N]",
        details=_DETAILS,
        examples=_EXAMPLES,
    )
    # no default here: it would look as if it was given beside --simulate
    parser.add_argument(
        "dataset",
        metavar="DATASET",
        nargs="?",
        help=f"a name or a folder, with true poses (default: {SIMULATED_HOME})",
    )
    parser.add_argument(
        "--table",
        metavar="NAME|FILE",
        default="default",
        help="likelihood table: default; home, sharper and for rooms; perspective, for such "
        "cameras as sharp as a pixel; dense, the paper's; or a file of pflut lut build "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--bins",
        metavar="N",
        type=positive,
        help="cells of each axis of the posteriors; cells wider than the posteriors cost "
        "calibration (default: a file's own, or what suits the camera)",
    )
    parser.add_argument(
        "--figure",
        metavar="FILE",
        type=Path,
        help="draw the shares of all masses to FILE (.png, .pdf, .svg)",
    )
    real = parser.add_argument_group("pairs of a dataset")
    real.add_argument(
        "--max-distance",
        metavar="METRES",
        type=float,
        help=f"between the images of a pair (default: {_OF_DATASET['max_distance']:g})",
    )
    add_references(real)
    simulated = parser.add_argument_group("simulated pairs")
    simulated.add_argument(
        "--simulate", metavar="N", type=positive, help="so many pairs, instead of DATASET"
    )
    simulated.add_argument(
        "--correspondences",
        metavar="N",
        type=positive,
        help=f"of a pair (default: {_OF_SIMULATION['correspondences']})",
    )
    simulated.add_argument(
        "--mismatch",
        metavar="SHARE",
        type=float,
        help=f"of mismatches among them (default: {_OF_SIMULATION['mismatch']})",
    )
    simulated.add_argument(
        "--seed", metavar="N", type=natural, help=f"(default: {_OF_SIMULATION['seed']})"
    )
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> None:
    """Fit on one half of the pairs, check on the other, and print."""
    _complete(arguments)

    from pflut.calibration import coverage, fit_temperature
    from pflut.cli.progress import Bars
    from pflut.replay.tables import choose_table

    if arguments.figure is not None:
        from pflut.plot.style import check_figure_path

        check_figure_path(arguments.figure)
    with Bars() as bars:
        source, pairs, camera = _pairs(arguments, bars)
        if len(pairs) < 2:
            raise ValueError(f"{source}: to fit and to check takes two pairs, got {len(pairs)}")
        table = choose_table(
            arguments.table, bins=arguments.bins, camera=camera, progress=bars.stage("table")
        )
        fitted, checked = pairs[::2], pairs[1::2]
        shown = _counted(bars.stage("posteriors"), len(fitted) + 2 * len(checked))
        temperature = fit_temperature(shown(fitted), table)
        before = coverage(shown(checked), table)
        after = coverage(shown(checked), table, temperature=temperature)
    print(f"{source}; table {arguments.table}, {table.bins} bins")
    print(_report(temperature, len(fitted), before, after))
    if arguments.figure is not None:
        from pflut.plot import plot_calibration, save_figure

        curves = {"temperature 1": before.masses, f"temperature {temperature:.2f}": after.masses}
        save_figure(plot_calibration(curves, title=source), arguments.figure)
        print(f"figure: {arguments.figure}")


def _complete(arguments: argparse.Namespace) -> None:
    """Fill in the defaults; end as wrong usage where an argument would not count."""
    parser: argparse.ArgumentParser = arguments.parser
    if arguments.simulate is None:
        ignored, why = _OF_SIMULATION, "only allowed with argument --simulate"
    else:
        ignored, why = {"dataset": None, **_OF_DATASET}, "not allowed with argument --simulate"
    for name in ignored:
        if getattr(arguments, name) is not None:
            flag = "DATASET" if name == "dataset" else f"--{name.replace('_', '-')}"
            parser.error(f"argument {flag}: {why}")
    defaults = {"dataset": SIMULATED_HOME, **_OF_DATASET, **_OF_SIMULATION}
    for name, value in defaults.items():
        if getattr(arguments, name) is None:
            setattr(arguments, name, value)


def _pairs(arguments: argparse.Namespace, bars: Bars) -> tuple[str, list[Pair], Camera | None]:
    """Say which pairs are meant, and give them, with the camera that took them."""
    if arguments.simulate is not None:
        return (*_simulated(arguments), None)

    from pflut.cli.loading import load
    from pflut.features import FeatureCache
    from pflut.pairs import dataset_pairs
    from pflut.replay.options import ReplayOptions
    from pflut.replay.pipeline import make_extractor

    options = ReplayOptions()
    dataset = load(arguments.dataset, arguments.references, progress=bars)
    found = dataset_pairs(
        dataset,
        make_extractor(dataset, options),
        max_distance=arguments.max_distance,
        across=True,
        ratio=options.ratio,
        mutual=options.mutual,
        cache=FeatureCache(),
        progress=bars.stage("pairs"),
    )
    pairs = [pair.known for pair in found]
    source = f"{dataset.name}, {len(pairs)} pairs within {arguments.max_distance:g} m"
    return source, pairs, dataset.camera


def _simulated(arguments: argparse.Namespace) -> tuple[str, list[Pair]]:
    """Simulate pairs."""
    from pflut.correspondences import Correspondences
    from pflut.simulation.correspondences import CorrespondenceSimulator

    count, mismatch = arguments.correspondences, arguments.mismatch
    simulator = CorrespondenceSimulator(mismatch=mismatch)
    headings, bearings = simulator.sample(arguments.simulate, count, arguments.seed)
    source = (
        f"{arguments.simulate} simulated pairs of {count} correspondences, "
        f"{100 * mismatch:g} % mismatches"
    )
    pairs = [
        (Correspondences(*views.T), float(theta), float(phi))
        for (theta, phi), views in zip(headings, bearings, strict=True)
    ]
    return source, pairs


def _counted(
    progress: Callable[[int, int], None], total: int
) -> Callable[[Sequence[Pair]], Iterator[Pair]]:
    """Give an iterator over pairs that moves a bar on, over all that it is called with."""
    done = 0

    def count(pairs: Sequence[Pair]) -> Iterator[Pair]:
        nonlocal done
        for pair in pairs:
            yield pair
            done += 1
            progress(done, total)

    return count


def _report(temperature: float, fitted: int, before: Coverage, after: Coverage) -> str:
    """Write the temperature, and what it does, as plain text."""
    from pflut.calibration import LEAST_TEMPERATURE

    note = {1.0: "; a higher one is not tried", LEAST_TEMPERATURE: "; a lower one is not tried"}
    columns = ("temperature 1", f"temperature {temperature:.3f}")
    lines = [
        f"temperature {temperature:.3f}, fitted on {fitted} pairs{note.get(temperature, '')}",
        "",
        f"share of the other {before.num_pairs} pairs with the true pose in the credible region, "
        "95 % interval",
        f"{'mass':<12}{columns[0]:<26}{columns[1]}",
    ]
    for k, level in enumerate(before.levels):
        first, second = (
            f"{c.rates[k]:.3f} ({c.low[k]:.3f} to {c.high[k]:.3f})" for c in (before, after)
        )
        lines.append(f"{level:<12g}{first:<26}{second}")
    lines.append(f"{'log score':<12}{before.log_score:<26.3f}{after.log_score:.3f}")
    lines.append("(nat; -3.676 where nothing is known)")
    return "\n".join(lines)
