"""``pflut map links``: which images of a dataset are linked, and how they stand to each other."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from pflut.cli.arguments import (
    Subparsers,
    add_cache,
    add_dataset,
    add_replay_options,
    add_verb,
    as_json,
    command_line,
    feature_cache,
    natural,
    positive,
    replay_options,
)
from pflut.replay.options import ReplayOptions

if TYPE_CHECKING:
    from pflut.cli.progress import Bars
    from pflut.datasets.base import Dataset
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
where it was interrupted. Neither that, nor the number of processes, nor a cluster changes a byte
of links.npz.

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
    parser.add_argument(
        "--output",
        metavar="DIR",
        type=Path,
        help="folder of the results (default: results/<date>_<time>_<dataset>-links)",
    )
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
        default=1,
        help="and in any case with the N images before and after it (default: %(default)s)",
    )
    parser.add_argument(
        "--link-model",
        metavar="FILE",
        type=Path,
        help="what judges whether images are linked (default: that of the table and the camera)",
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
    options = replay_options(arguments)

    from pflut._files import write_json
    from pflut.cli.loading import load
    from pflut.cli.progress import Bars
    from pflut.results import create_results_folder, run_record

    with Bars() as bars:
        dataset = load(arguments.dataset, None, progress=bars)
        begun = arguments.output is not None and _begun(arguments.output)
        folder = create_results_folder(arguments.output, f"{dataset.name} links", overwrite=begun)
        links = linked(arguments, dataset, options, folder, bars)
    record = run_record(
        command_line(),
        dataset=dataset.name,
        images=[path.name for path in dataset.image_paths],
        arguments=as_json(arguments),
    )
    write_json(folder / "run.json", record)
    print(_report(dataset, links))
    print(f"results: {folder}")


def _begun(folder: Path) -> bool:
    """Whether a folder holds pairs of a former run, or nothing but its features."""
    if (folder / "settings.json").is_file():
        return True
    return folder.is_dir() and [path.name for path in folder.iterdir()] == ["work"]


def linked(
    arguments: argparse.Namespace,
    dataset: Dataset,
    options: ReplayOptions,
    folder: Path,
    bars: Bars,
) -> Links:
    """Link the images of a dataset as the arguments of `add_link_options` say.

    Parameters
    ----------
    arguments : argparse.Namespace
    dataset : Dataset
    options : ReplayOptions
        Of the features and the likelihood table.
    folder : Path
        Gets ``links.npz``; what it holds of it already is not done again.
    bars : Bars

    Returns
    -------
    Links

    Raises
    ------
    KeyboardInterrupt
        Saying how many pairs are kept.
    """
    from pflut.likelihood.sampling import available_cores
    from pflut.likelihood.table import LikelihoodTable
    from pflut.mapping.all_pairs import all_pairs, dataset_features
    from pflut.mapping.pair_linker import LinkOptions
    from pflut.replay.pipeline import make_extractor
    from pflut.replay.tables import choose_table

    table = choose_table(
        options.table, bins=options.bins, camera=dataset.camera, progress=bars.stage("table")
    )
    if not isinstance(table, LikelihoodTable):
        raise ValueError(f"{options.table}: a dense table, expected a residual one")
    model = _link_model(arguments.link_model, options.table, dataset)
    counted = (0, 0)

    def progress(done: int, total: int) -> None:
        nonlocal counted
        counted = (done, total)
        bars("pairs", done, total)

    try:
        return all_pairs(
            dataset_features(
                dataset,
                make_extractor(dataset, options),
                cache=feature_cache(arguments),
                progress=bars.stage("features"),
            ),
            folder,
            table,
            max_candidates=arguments.max_candidates,
            neighbours=arguments.neighbours,
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
    except ImportError as error:
        raise ValueError(str(error)) from None
    except KeyboardInterrupt:
        done = f"{counted[0]} of {counted[1]} pairs are" if counted[1] else "no pair is"
        raise KeyboardInterrupt(
            f"{done} kept in {folder}; the same command with --output {folder} goes on"
        ) from None


def _link_model(path: Path | None, table: str, dataset: Dataset) -> LinkModel:
    """Load the model that judges evidence of a table, or that of a file."""
    from pflut.mapping.link_model import LinkModel, link_model_name

    if path is not None:
        return LinkModel.load(path)
    name = link_model_name(table, dataset.camera)
    if name is None:
        raise ValueError(
            f"{dataset.name}: no link model comes with pflut for the table {table!r} and this "
            "camera, expected --link-model"
        )
    return LinkModel.default(name)


def _report(dataset: Dataset, links: Links) -> str:
    """Count pairs and probable links, by what their constraints say."""
    import numpy as np

    from pflut.mapping.constraint import KINDS

    lines = [
        f"{dataset.name}: {len(dataset)} images, {len(links)} pairs",
        "",
        f"{'constraint':<12}{'pairs':>9}{'linked':>9}",
    ]
    probable = links.probability > 0.5
    for code, kind in enumerate(KINDS):
        those = links.kind == code
        lines.append(f"{kind:<12}{those.sum():>9}{(those & probable).sum():>9}")
    lines.append(f"{'all':<12}{len(links):>9}{probable.sum():>9}")
    images = len(np.unique(links.indices[probable]))
    lines += ["", f"linked: probability above 0.5; {images} images have such links"]
    return "\n".join(lines)


def share(text: str) -> float:
    """Parse a share between 0 and 1."""
    value = float(text)
    if not 0.0 < value < 1.0:
        raise argparse.ArgumentTypeError(f"expected a number in (0, 1), got {text}")
    return value
