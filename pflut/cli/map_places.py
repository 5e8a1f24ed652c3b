"""``pflut map places``: a topological map of linked images, and its places."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pflut.cli.arguments import (
    Subparsers,
    above_zero,
    add_output,
    add_overwrite,
    add_verb,
    natural,
    refuse_as_output,
    replay_options,
)
from pflut.cli.map_folder import (
    FoundLinks,
    add_images,
    add_source,
    chosen_images,
    needs,
    open_folder,
    write_run,
)
from pflut.cli.map_links import add_link_options, linked, refuse_link_options, share

if TYPE_CHECKING:
    from pflut.datasets.base import Dataset
    from pflut.geometry import FloatArray
    from pflut.mapping.links import Links
    from pflut.mapping.topological_map import TopologicalMap
    from pflut.replay.options import ReplayOptions

_DETAILS = """\
Takes the links of a folder that pflut map links (or map build) wrote, or links a dataset's images
first, as pflut map links does with the same options. Images are the nodes, probable links the
edges; places are groups of images that are linked with each other more than with others. No pose is
used but to draw the map over the floor plan.

Results: places.json, topological_map.graphml (for Gephi, Cytoscape, networkx and pflut),
figures/places.png, run.json.

Needs pip install "pflut[mapping]"."""

_EXAMPLES = """\
  pflut map links simulated-home --output results/links
  pflut map places results/links
  pflut map places drive/ --resolution 2            more and smaller places
"""
SHOWN = 12
"""Places that are printed, at most."""


def add_parser(actions: Subparsers) -> None:
    """Add the action."""
    parser = add_verb(
        actions,
        "places",
        "make a topological map of linked images, and find its places",
        usage="[options] LINKS|DATASET",
        details=_DETAILS,
        examples=_EXAMPLES,
    )
    add_source(parser)
    add_output(parser, "<dataset>-places")
    add_overwrite(parser)
    add_images(parser)
    parser.add_argument(
        "--min-probability",
        metavar="P",
        type=share,
        default=0.5,
        help="leave out links that are less probable (default: %(default)s)",
    )
    parser.add_argument(
        "--resolution",
        metavar="X",
        type=above_zero,
        default=1.0,
        help="more makes more and smaller places (default: %(default)s)",
    )
    parser.add_argument(
        "--seed",
        metavar="N",
        type=natural,
        default=0,
        help="of the search for places (default: %(default)s)",
    )
    parser.add_argument("--no-figures", action="store_true", help="write no figures")
    add_link_options(parser)
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> None:
    """Make the map, write it and print its places."""
    refuse_as_output(arguments, arguments.dataset)
    options = replay_options(arguments)
    needs("networkx", extra="mapping", what="pflut map places")
    # which draws large maps with it
    needs("scipy", extra="mapping", what="pflut map places")

    from pflut._files import write_json
    from pflut.mapping.topological_map import TopologicalMap

    found = FoundLinks.read(Path(arguments.dataset))
    if found is None:
        links, names, dataset, name, folder = _of_dataset(arguments, options)
    else:
        links, names, dataset, name, folder = _of_folder(arguments, found)
    made = TopologicalMap.from_links(
        links,
        len(names),
        min_probability=arguments.min_probability,
        resolution=arguments.resolution,
        names=names,
        rng=arguments.seed,
    )
    made.save(folder / "topological_map.graphml")
    positions, over, note = _positions(made, dataset)
    write_json(folder / "places.json", _content(made, len(links)))
    if not arguments.no_figures:
        _draw(folder, made, positions, over, name, note)
    write_run(folder, arguments, name, names, None if found is None else found.of)
    print(_report(name, made, len(links), note))
    print(f"results: {folder}")


Found = tuple["Links", tuple[str, ...], "Dataset | None", str, Path]
"""Links, the names of their images, the dataset of these images, its name, and the results."""


def _of_folder(arguments: argparse.Namespace, found: FoundLinks) -> Found:
    """Take the links of a folder, and the dataset that they are of, if it is there still."""
    from pflut.cli.progress import Bars

    refuse_link_options(arguments)
    refuse_as_output(arguments, found.of.source)
    with Bars() as bars:
        dataset = found.of.dataset_if_there(bars)
    folder = open_folder(arguments, f"{found.of.name} places")
    return found.links, found.of.images, dataset, found.of.name, folder


def _of_dataset(arguments: argparse.Namespace, options: ReplayOptions) -> Found:
    """Link the images of a dataset."""
    from pflut.cli.loading import load
    from pflut.cli.progress import Bars

    with Bars() as bars:
        dataset = chosen_images(load(arguments.dataset, None, progress=bars), arguments)
        links, folder = linked(arguments, dataset, options, f"{dataset.name} places", bars)
    return links, tuple(path.name for path in dataset.image_paths), dataset, dataset.name, folder


def _positions(
    made: TopologicalMap, dataset: Dataset | None
) -> tuple[FloatArray, Dataset | None, str | None]:
    """Say where to draw the images and over what, and a note if not where they were taken."""
    import numpy as np

    from pflut.cli.map_frame import WITHOUT_TRUTH, truth_known, without_plan

    if dataset is not None:
        odometry = dataset.odometry
        if truth_known(dataset):
            return dataset.ground_truth, dataset, None  # type: ignore[return-value]
        if odometry is not None and np.isfinite(odometry).all(axis=1).any():
            return odometry, without_plan(dataset, odometry), WITHOUT_TRUTH
    why = "the dataset was not found" if dataset is None else "no poses are known"
    return made.layout(), None, f"{why}: linked images are drawn near each other"


def _content(made: TopologicalMap, pairs: int) -> dict[str, Any]:
    """Give what places.json says."""
    import numpy as np

    places = made.places[made.edges]
    within = places[:, 0] == places[:, 1]
    return {
        "images": len(made),
        "pairs": pairs,
        "links": len(made.edges),
        "links_between_places": int((~within).sum()),
        "places": [
            {
                "place": place,
                "images": [made.names[image] for image in made.members(place)],
                "linked_places": sorted(
                    {int(p) for p in np.unique(places[(places == place).any(axis=1)])} - {place}
                ),
            }
            for place in range(made.num_places)
        ],
    }


def _draw(
    folder: Path,
    made: TopologicalMap,
    positions: FloatArray,
    over: Dataset | None,
    name: str,
    note: str | None,
) -> None:
    """Write the figure."""
    from pflut.plot import plot_places, save_figure

    figure = plot_places(
        positions,
        made.places,
        made.edges,
        made.probability,
        over,
        title=f"{name}: {len(made)} images, {len(made.edges)} links, {made.num_places} places",
        note=note,
    )
    (folder / "figures").mkdir(exist_ok=True)
    save_figure(figure, folder / "figures" / "places.png")


def _report(name: str, made: TopologicalMap, pairs: int, note: str | None) -> str:
    """Say what the map is made of."""
    content = _content(made, pairs)
    lines = [
        f"{name}: {len(made)} images, {pairs} pairs, {len(made.edges)} links, "
        f"{made.num_places} places",
        *([f"note: {note}"] if note else []),
        "",
        f"{'place':>5}{'images':>9}  linked with",
    ]
    for about in content["places"][:SHOWN]:
        others = ", ".join(map(str, about["linked_places"])) or "none"
        lines.append(f"{about['place']:>5}{len(about['images']):>9}  {others}")
    if made.num_places > SHOWN:
        lines.append(f"and {made.num_places - SHOWN} smaller ones, see places.json")
    return "\n".join(lines)
