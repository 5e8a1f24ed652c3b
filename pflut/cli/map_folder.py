"""What the actions of ``pflut map`` share: their folders, and links that another one has made."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pflut.cli.arguments import as_json, command_line, positive

if TYPE_CHECKING:
    from pflut.cli.progress import Bars
    from pflut.datasets.base import Dataset
    from pflut.mapping.links import Links

_FILES = (
    "map.g2o",
    "poses.tum",
    "odometry.tum",
    "groundtruth.tum",
    "metrics.json",
    "topological_map.graphml",
    "places.json",
    "steps.csv",
    "figures/map.png",
    "figures/places.png",
    "figures/nodes.png",
    "run.json",
)
"""What the actions write but for the links."""


def add_source(parser: argparse.ArgumentParser) -> None:
    """Add the argument LINKS|DATASET."""
    parser.add_argument(
        "dataset",
        metavar="LINKS|DATASET",
        help="a folder of pflut map links, or a dataset: simulated-home, a folder, ...",
    )


def add_images(parser: argparse.ArgumentParser, which: str = "") -> None:
    """Add --images and --max-images; ``which`` says what else the images must have."""
    parser.add_argument(
        "--images",
        choices=("all", "references", "queries"),
        help=f"of the dataset{which} (default: all)",
    )
    parser.add_argument(
        "--max-images", metavar="N", type=positive, help="the first N images (default: all)"
    )


def chosen_images(dataset: Dataset, arguments: argparse.Namespace) -> Dataset:
    """Take the images that the arguments of `add_images` say, two at least."""
    from pflut.mapping.drive_images import choose_images

    return choose_images(dataset, arguments.images or "all", max_images=arguments.max_images)


def needs(module: str, *, extra: str, what: str) -> None:
    """End before the work where a package is missing that is needed after it.

    Raises
    ------
    ValueError
        Naming the extra that brings it.
    """
    from pflut._extras import require

    try:
        require(module, extra=extra, what=what)
    except ImportError as error:
        raise ValueError(str(error)) from None


def has_begun(folder: Path) -> bool:
    """Whether a folder holds pairs of a former run, or nothing but its features."""
    from pflut._files import read_json

    settings = folder / "settings.json"
    if settings.is_file():
        # other programs have files of this name, too
        try:
            return {"features", "num_images", "batch_size"} <= read_json(settings).keys()
        except ValueError:
            return False
    return folder.is_dir() and [path.name for path in folder.iterdir()] == ["work"]


def open_folder(arguments: argparse.Namespace, name: str, *, go_on: bool = False) -> Path:
    """Create the folder of the results, as --output and --overwrite say.

    Parameters
    ----------
    arguments : argparse.Namespace
    name : str
        What a new folder is named after.
    go_on : bool
        Whether it may be that of a run that was interrupted, whose links are gone on with.

    Returns
    -------
    Path

    Raises
    ------
    FileExistsError
        If it holds something else.
    """
    from pflut.results import create_results_folder

    output: Path | None = arguments.output
    if output is not None and arguments.overwrite:
        _remove(output)
    return create_results_folder(
        output,
        name,
        overwrite=arguments.overwrite or (go_on and output is not None and has_begun(output)),
        expected="a new folder or --overwrite",
    )


def _remove(folder: Path) -> None:
    """Delete what a former run wrote, links that were only begun too."""
    from pflut.results import remove_results

    work = folder / "work"
    begun = [folder / "settings.json", *work.glob("*.np[yz]")] if has_begun(folder) else []
    # links without settings, as of another folder, would pass for those that are asked for
    for path in [*begun, folder / "links.npz"]:
        path.unlink(missing_ok=True)
    if begun and work.is_dir() and not any(work.iterdir()):
        work.rmdir()
    remove_results(folder, _FILES)


def write_run(
    folder: Path,
    arguments: argparse.Namespace,
    dataset: str,
    images: Sequence[str],
    found: MapImages | None = None,
) -> None:
    """Write ``run.json``: the command, the images' names, and where they are.

    Parameters
    ----------
    folder : Path
    arguments : argparse.Namespace
    dataset : str
        Its name.
    images : sequence of str
        Names of the images that are linked, or localized, in their order.
    found : MapImages, optional
        Where they were given instead of the dataset, with their links or as nodes.
    """
    from pflut._files import write_json
    from pflut.results import run_record

    if found is None:
        folder_of = Path(arguments.dataset)
        # it is found from another working directory, too
        source = str(folder_of.resolve()) if folder_of.is_dir() else arguments.dataset
    else:
        source = found.source
    record = run_record(
        command_line(),
        dataset=dataset,
        source=source,
        images=list(images),
        arguments=as_json(arguments),
    )
    write_json(folder / "run.json", record)


@dataclass(frozen=True, eq=False)
class MapImages:
    """The images that the links or the nodes of a folder are of.

    Parameters
    ----------
    name : str
        Of the dataset.
    images : tuple of str
        Their names.
    source : str or None
        The dataset, as `load` takes it, where it is known.
    """

    name: str
    images: tuple[str, ...]
    source: str | None

    @classmethod
    def read(cls, folder: Path, least: int) -> MapImages:
        """Read them from the folder's ``run.json``.

        Without it, as `pflut.all_pairs` leaves it, the images are named by their numbers.

        Parameters
        ----------
        folder : Path
        least : int
            How many there are at least.

        Returns
        -------
        MapImages

        Raises
        ------
        ValueError
            If ``run.json`` names fewer.
        """
        from pflut._files import read_json

        about = folder / "run.json"
        if not about.is_file():
            return cls(folder.resolve().name, tuple(map(str, range(least))), None)
        record = read_json(about)
        images, source = record.get("images"), record.get("source")
        if not isinstance(images, list) or len(images) < max(2, least):
            raise ValueError(f"{about}: names no images, expected that of pflut map")
        known = source if isinstance(source, str) else None
        return cls(str(record.get("dataset")), tuple(map(str, images)), known)

    def whole_dataset(self, bars: Bars) -> Dataset:
        """Load the dataset that they are of.

        Parameters
        ----------
        bars : Bars

        Returns
        -------
        Dataset

        Raises
        ------
        OSError, ValueError
            If it is not there.
        """
        from pflut.cli.loading import load

        if self.source is None:
            raise ValueError(f"{self.name}: nothing says of which dataset its images are")
        return load(self.source, None, progress=bars)

    def dataset(self, bars: Bars) -> Dataset:
        """Load these images of it.

        Parameters
        ----------
        bars : Bars

        Returns
        -------
        Dataset

        Raises
        ------
        OSError, ValueError
            If they are not there.
        """
        import numpy as np

        dataset = self.whole_dataset(bars)
        number = {path.name: k for k, path in enumerate(dataset.image_paths)}
        if len(number) < len(dataset) or not number.keys() >= set(self.images):
            raise ValueError(f"{self.source}: holds other images than those of the map")
        return dataset.select(np.array([number[name] for name in self.images]))

    def dataset_if_there(self, bars: Bars) -> Dataset | None:
        """Load them where they are there still; nothing is rendered for that.

        Parameters
        ----------
        bars : Bars

        Returns
        -------
        Dataset or None
        """
        from pflut.datasets.registry import SIMULATED_HOME
        from pflut.datasets.simulated_home import is_rendered

        if self.source == SIMULATED_HOME and not is_rendered():
            return None
        try:
            return self.dataset(bars)
        except (OSError, ValueError):
            return None  # links of images that are elsewhere have places all the same


@dataclass(frozen=True, eq=False)
class FoundLinks:
    """Links of a folder.

    Parameters
    ----------
    links : Links
    of : MapImages
        What they link.
    """

    links: Links
    of: MapImages

    @classmethod
    def read(cls, folder: Path) -> FoundLinks | None:
        """Read the links of a folder.

        Parameters
        ----------
        folder : Path

        Returns
        -------
        FoundLinks or None
            None if the folder is none of links.

        Raises
        ------
        ValueError
            If the links are not finished or damaged, or ``run.json`` does not fit them.
        """
        from pflut.mapping.links import Links

        if not (folder / "links.npz").is_file():
            if has_begun(folder):
                raise ValueError(
                    f"{folder}: the links are not finished, expected links.npz; the command that "
                    "began them goes on"
                )
            return None
        links = Links.load(folder / "links.npz")
        return cls(links, MapImages.read(folder, int(links.indices.max(initial=0)) + 1))
