"""``pflut map links``: which images of a dataset are linked, and how they stand to each other."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from pflut.cli.arguments import (
    Subparsers,
    add_cache,
    add_dataset,
    add_output,
    add_overwrite,
    add_replay_options,
    add_verb,
    feature_cache,
    natural,
    positive,
    refuse_as_output,
    replay_options,
)
from pflut.cli.map_folder import add_images, chosen_images, needs, open_folder, write_run
from pflut.replay.options import ReplayOptions

if TYPE_CHECKING:
    from pflut.cli.progress import Bars
    from pflut.datasets.base import Dataset
    from pflut.features import Features
    from pflut.likelihood.table import LikelihoodTable
    from pflut.mapping.link_model import LinkModel
    from pflut.mapping.links import Links

LINK_OPTIONS = (
    "detector",
    "contrast_threshold",
    "max_features",
    "ratio",
    "mutual",
    "temperature",
    "min_matches",
    "table",
    "bins",
)
"""Those of `ReplayOptions` that count."""

_DETAILS = """\
Matches every two images (or with --max-candidates those that look alike), and writes links.npz:
for each pair the probability that it is linked, that is, shows one place, and the constraint that
its matches put on the relative pose, a mixture of von Mises distributions.

Pairs are kept in the output folder in batches, as soon as they are done: the same command goes on
where it was interrupted, and with --overwrite it begins anew. Neither an interruption, nor the
number of processes, nor a cluster of workers with nannies that are there at the start changes a
byte of links.npz; but where the kernels are not compiled yet, as after an installation, --jobs 1
may change last digits.

A cluster needs pip install "pflut[cluster]" here, and pflut on its workers:
dask scheduler; dask worker ADDRESS; pflut map links DATASET --scheduler ADDRESS"""

_EXAMPLES = """\
  pflut map links simulated-home --output results/links
  pflut map links drive/ --max-candidates 20        of a long drive, not all pairs
  pflut map links drive/ --scheduler tcp://10.0.0.1:8786
"""


def add_parser(actions: Subparsers) -> None:
    """Add the action."""
    parser = add_verb(
        actions,
        "links",
        "say which images of a dataset are linked, and how they stand to each other",
        usage="[options] DATASET",
        details=_DETAILS,
        examples=_EXAMPLES,
    )
    add_dataset(parser)
    add_output(parser, "<dataset>-links")
    add_overwrite(parser)
    add_images(parser)
    add_link_options(parser)
    parser.set_defaults(run=run, parser=parser)


def add_link_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that say which images are linked, how, and where the work is done."""
    parser.add_argument(
        "--max-candidates",
        metavar="N",
        type=positive,
        help="match an image with the N that look most like it (default: all)",
    )
    parser.add_argument(
        "--neighbours",
        metavar="N",
        type=natural,
        help="with --max-candidates: and in any case with the N images before and after it "
        "(default: 1)",
    )
    parser.add_argument(
        "--link-model",
        metavar="NAME|FILE",
        help="what judges whether images are linked: panorama, home, perspective (for cameras in "
        "rooms; far too sure on a road), or a file (default: that of the table and the camera)",
    )
    parser.add_argument(
        "--prior",
        metavar="SHARE",
        type=share,
        help="of linked pairs among those that are matched: about one in five of all pairs of a "
        "home, one in thousands of a town, most of those that look alike (default: as where the "
        "model was learned)",
    )
    parser.add_argument("--jobs", metavar="N", type=positive, help="processes (default: all cores)")
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="let the workers of a dask cluster do it: tcp://HOST:PORT of its scheduler",
    )
    add_cache(parser)
    add_replay_options(
        parser,
        leave_out=[item.name for item in fields(ReplayOptions) if item.name not in LINK_OPTIONS],
    )


def run(arguments: argparse.Namespace) -> None:
    """Link the pairs, and print what there is."""
    refuse_as_output(arguments, arguments.dataset)
    options = replay_options(arguments)

    from pflut.cli.loading import load
    from pflut.cli.progress import Bars

    with Bars() as bars:
        dataset = chosen_images(load(arguments.dataset, None, progress=bars), arguments)
        links, folder = linked(arguments, dataset, options, f"{dataset.name} links", bars)
    write_run(folder, arguments, dataset.name, [path.name for path in dataset.image_paths])
    print(_report(dataset, links))
    print(f"results: {folder}")


def refuse_link_options(arguments: argparse.Namespace) -> None:
    """End as wrong usage where arguments of `add_images` or `add_link_options` would not count."""
    names = ["images", "max_images", "max_candidates", "neighbours", "link_model", "prior"]
    names += ["jobs", "scheduler"]
    given = [name for name in names if getattr(arguments, name) is not None]
    given += [name for name in LINK_OPTIONS if hasattr(arguments, name)]
    given += ["no_cache"] * arguments.no_cache
    if given:
        flags = ", ".join(f"--{name.replace('_', '-')}" for name in given)
        plural = "s" * (len(given) > 1)
        parser: argparse.ArgumentParser = arguments.parser
        parser.error(f"argument{plural} {flags}: without effect on links that are there")


def linked(
    arguments: argparse.Namespace,
    dataset: Dataset,
    options: ReplayOptions,
    name: str,
    bars: Bars,
) -> tuple[Links, Path]:
    """Link the images of a dataset as the arguments of `add_link_options` say.

    Parameters
    ----------
    arguments : argparse.Namespace
    dataset : Dataset
    options : ReplayOptions
        Of the features and the likelihood table.
    name : str
        What a new folder is named after.
    bars : Bars

    Returns
    -------
    Links
    Path
        The folder that holds them; what it held already is not done again.

    Raises
    ------
    KeyboardInterrupt
        Saying how many pairs are kept.
    """
    from pflut.likelihood.sampling import available_cores
    from pflut.mapping.all_pairs import all_pairs
    from pflut.mapping.pair_linker import LinkOptions

    table = residual_table(options, dataset, bars)
    model = _link_model(arguments.link_model, options.table, dataset)
    if arguments.scheduler is not None:
        needs("distributed", extra="cluster", what="--scheduler")
        # what happens to the cluster is told in one line of ours, not in tracebacks; the levels of
        # some of distributed's loggers are their own
        for logger in [name for name in logging.root.manager.loggerDict if "distributed" in name]:
            logging.getLogger(logger).setLevel(logging.CRITICAL + 1)
    folder = open_folder(arguments, name, go_on=True)
    counted = (0, 0)

    def progress(done: int, total: int) -> None:
        nonlocal counted
        counted = (done, total)
        bars("pairs", done, total)

    try:
        links = all_pairs(
            image_features(arguments, dataset, options, bars.stage("features")),
            folder,
            table,
            max_candidates=arguments.max_candidates,
            neighbours=1 if arguments.neighbours is None else arguments.neighbours,
            options=LinkOptions(
                ratio=options.ratio,
                mutual=options.mutual,
                min_matches=options.min_matches,
                prior=arguments.prior,
                temperature=options.temperature,
            ),
            link_model=model,
            jobs=arguments.jobs or available_cores(),
            scheduler=arguments.scheduler,
            progress=progress,
        )
    except KeyboardInterrupt:
        done = f"{counted[0]} of {counted[1]} pairs are" if counted[1] else "no pair is"
        how = f"--output {folder}" + ", without --overwrite," * arguments.overwrite
        raise KeyboardInterrupt(
            f"{done} kept in {folder}; the same command with {how} goes on"
        ) from None
    except (OSError, ValueError):
        # nothing has been kept: leave nothing
        if not any(folder.iterdir()):
            folder.rmdir()
        raise
    return links, folder


def image_features(
    arguments: argparse.Namespace,
    dataset: Dataset,
    options: ReplayOptions,
    progress: Callable[[int, int], None],
) -> Iterator[Features]:
    """Give the features of the images one by one, as --no-cache and the options say."""
    from pflut.mapping.all_pairs import dataset_features
    from pflut.replay.pipeline import make_extractor

    extractor, cache = make_extractor(dataset, options), feature_cache(arguments)
    return dataset_features(dataset, extractor, cache=cache, progress=progress)


def residual_table(options: ReplayOptions, dataset: Dataset, bars: Bars) -> LikelihoodTable:
    """Load the table that was named, with the bins that suit the camera; a dense one is refused."""
    from pflut.likelihood.table import LikelihoodTable
    from pflut.replay.tables import choose_table

    table = choose_table(
        options.table, bins=options.bins, camera=dataset.camera, progress=bars.stage("table")
    )
    if not isinstance(table, LikelihoodTable):
        raise ValueError(f"{options.table}: a dense table, expected a residual one")
    return table


def _link_model(chosen: str | None, table: str, dataset: Dataset) -> LinkModel:
    """Load the model that was named, or that which judges evidence of a table."""
    from pflut.mapping.link_model import SHIPPED, LinkModel, link_model_name

    if chosen is not None and chosen not in SHIPPED:
        return LinkModel.load(chosen)
    name = chosen or link_model_name(table, dataset.camera)
    if name is None:
        raise ValueError(
            f"{dataset.name}: no link model comes with pflut for the table {table!r} and this "
            "camera, expected --link-model: perspective (with the default table, for cameras that "
            "look ahead in rooms; far too sure on a road), or a file"
        )
    return LinkModel.default(name)  # type: ignore[arg-type]


def _report(dataset: Dataset, links: Links) -> str:
    """Count pairs and probable links, by what their constraints say."""
    import numpy as np

    from pflut.mapping.constraint import KINDS
    from pflut.mapping.links import LINKED

    lines = [
        f"{dataset.name}: {len(dataset)} images, {len(links)} pairs",
        "",
        f"{'constraint':<12}{'pairs':>9}{'linked':>9}",
    ]
    probable = links.probability >= LINKED
    for code, kind in enumerate(KINDS):
        those = links.kind == code
        lines.append(f"{kind:<12}{those.sum():>9}{(those & probable).sum():>9}")
    lines.append(f"{'all':<12}{len(links):>9}{probable.sum():>9}")
    images = len(np.unique(links.indices[probable]))
    lines += ["", f"linked: probability of at least {LINKED}; {images} images have such links"]
    return "\n".join(lines)


def share(text: str) -> float:
    """Parse a share between 0 and 1."""
    value = float(text)
    if not 0.0 < value < 1.0:
        raise argparse.ArgumentTypeError(f"expected a number in (0, 1), got {text}")
    return value
