"""``pflut map localize``: where a robot is in a topological map, image by image."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from pflut.cli.arguments import (
    Subparsers,
    above_zero,
    add_cache,
    add_output,
    add_overwrite,
    add_replay_options,
    add_verb,
    refuse_as_output,
    replay_options,
)
from pflut.cli.map_folder import MapImages, add_images, needs, open_folder, write_run
from pflut.cli.map_links import image_features, residual_table
from pflut.replay.options import ReplayOptions

if TYPE_CHECKING:
    from pflut.cli.progress import Bars
    from pflut.datasets.base import Dataset
    from pflut.geometry import FloatArray
    from pflut.likelihood.table import LikelihoodTable
    from pflut.mapping.node_errors import NodeErrors
    from pflut.mapping.node_localizer import NodeEstimate, NodeLocalizer
    from pflut.mapping.topological_map import TopologicalMap

NODE_OPTIONS = (
    "detector",
    "contrast_threshold",
    "max_features",
    "ratio",
    "mutual",
    "link_probability",
    "table",
    "bins",
    "kidnap_probability",
)
"""Those of `ReplayOptions` that count."""

_DETAILS = """\
Takes the topological map of a folder that pflut map places wrote, and localizes the images of its
dataset, or of another one, that are not in the map: at which node, and in which place. The robot
may be anywhere at first. It needs no pose; odometry, where there is some, says how far it went.
True poses, where they are known of images and nodes, say in the end how often it was right.

Results: steps.csv (a row an image, written as it goes), metrics.json, run.json, figures/nodes.png.

Needs pip install "pflut[mapping]"."""

_EXAMPLES = """\
  pflut map places simulated-home --images references --output results/places
  pflut map localize results/places
  pflut map localize results/places next_day/ --max-images 100
"""


def add_parser(actions: Subparsers) -> None:
    """Add the action."""
    parser = add_verb(
        actions,
        "localize",
        "localize a robot in a topological map: at which node, in which place",
        usage="[options] PLACES [DATASET]",
        details=_DETAILS,
        examples=_EXAMPLES,
    )
    parser.add_argument("places", metavar="PLACES", type=Path, help="a folder of pflut map places")
    parser.add_argument(
        "dataset",
        metavar="DATASET",
        nargs="?",
        help="a name or a folder, as those of the other verbs (default: that of the map)",
    )
    add_output(parser, "<dataset>-nodes")
    add_overwrite(parser)
    add_images(parser, ", those that are not in the map")
    parser.add_argument(
        "--hop-length",
        metavar="METRES",
        type=above_zero,
        default=1.0,
        help="that a robot goes from one node to another: about the distance of images that are "
        "next to each other (default: %(default)s)",
    )
    parser.add_argument(
        "--temperature",
        metavar="X",
        type=_temperature,
        default=0.1,
        help="factor on the evidence: the share of the matches that are independent "
        "(default: %(default)s)",
    )
    parser.add_argument("--no-figures", action="store_true", help="write no figures")
    add_cache(parser)
    add_replay_options(
        parser,
        leave_out=[item.name for item in fields(ReplayOptions) if item.name not in NODE_OPTIONS],
    )
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> None:
    """Localize the images, write the results and print how good they are."""
    refuse_as_output(arguments, str(arguments.places), arguments.dataset)
    options = replay_options(arguments)
    needs("networkx", extra="mapping", what="pflut map localize")

    import numpy as np

    from pflut._files import write_json
    from pflut.cli.progress import Bars
    from pflut.mapping.node_errors import NodeErrors

    made, of = _map_of(arguments.places)
    refuse_as_output(arguments, of.source)
    with Bars() as bars:
        nodes = of.dataset(bars)
        drive = _drive_of(arguments, of, nodes, bars)
        table = residual_table(options, nodes, bars)
        folder = open_folder(arguments, f"{drive.name} nodes")
        robot = _localizer(arguments, options, made, nodes, table, bars)
        poses = _truth(nodes)
        estimates, probabilities = _localize(arguments, options, robot, drive, poses, folder, bars)
    errors = NodeErrors.of(made, estimates, poses, _truth(drive))
    metrics = {"images": len(drive), "nodes": len(made), "places": made.num_places}
    write_json(folder / "metrics.json", metrics | errors.as_dict())
    if not arguments.no_figures:
        _draw(folder, made, probabilities, errors, drive.name)
    names = [path.name for path in drive.image_paths]
    write_run(folder, arguments, drive.name, names, of if arguments.dataset is None else None)
    if arguments.dataset is not None and np.isfinite(errors.distance).any():
        print("note: the true poses of the map and of the dataset are taken to be of one frame")
    print(_report(made, drive, errors))
    print(f"results: {folder}")


def _temperature(text: str) -> float:
    """Parse a number in (0, 1]."""
    value = float(text)
    if not 0.0 < value <= 1.0:
        raise argparse.ArgumentTypeError(f"expected a number in (0, 1], got {text}")
    return value


def _map_of(folder: Path) -> tuple[TopologicalMap, MapImages]:
    """Read a map, and which images it is of."""
    from pflut.mapping.topological_map import TopologicalMap

    path = folder / "topological_map.graphml"
    if not path.is_file():
        raise ValueError(f"{folder}: no topological map, expected a folder of pflut map places")
    made = TopologicalMap.load(path)
    of = MapImages.read(folder, len(made))
    if of.images != made.names:
        raise ValueError(f"{folder}: run.json names other images than topological_map.graphml")
    return made, of


def _drive_of(arguments: argparse.Namespace, of: MapImages, nodes: Dataset, bars: Bars) -> Dataset:
    """Take the images that are localized."""
    import numpy as np

    from pflut.cli.loading import load
    from pflut.mapping.drive_images import image_indices

    if arguments.dataset is None:
        dataset = of.whole_dataset(bars)
    else:
        dataset = load(arguments.dataset, None, progress=bars)
    # another dataset may have images of the same names
    known = {path.resolve() for path in nodes.image_paths}
    new = [path.resolve() not in known for path in dataset.image_paths]
    chosen = image_indices(dataset, arguments.images or "all")
    chosen = chosen[np.array(new, dtype=np.bool_)[chosen]][: arguments.max_images]
    if not len(chosen):
        raise ValueError(f"{dataset.name}: expected images that are not in the map, got none")
    return dataset.select(chosen)


def _localizer(
    arguments: argparse.Namespace,
    options: ReplayOptions,
    made: TopologicalMap,
    nodes: Dataset,
    table: LikelihoodTable,
    bars: Bars,
) -> NodeLocalizer:
    """Make the filter, with the features of the nodes."""
    from pflut.mapping.node_localizer import NodeLocalizer
    from pflut.mapping.node_model import NodeModel
    from pflut.mapping.node_walk import NodeWalk

    features = image_features(arguments, nodes, options, bars.stage("features"))
    sensor = NodeModel(
        made,
        list(features),
        table,
        temperature=arguments.temperature,
        link_probability=options.link_probability,
        ratio=options.ratio,
        mutual=options.mutual,
    )
    walk = NodeWalk(
        hop_length=arguments.hop_length,
        carried_away=options.kidnap_probability,
    )
    return NodeLocalizer(made, sensor, walk=walk)


def _localize(
    arguments: argparse.Namespace,
    options: ReplayOptions,
    robot: NodeLocalizer,
    drive: Dataset,
    nodes: FloatArray,
    folder: Path,
    bars: Bars,
) -> tuple[list[NodeEstimate], FloatArray]:
    """Localize image by image; gives estimates, and the probabilities of nodes, (T, N)."""
    import numpy as np

    from pflut.mapping.node_errors import NodeErrors
    from pflut.results import StepsWriter

    observations = image_features(arguments, drive, options, bars.stage("images"))
    made, truth = robot.topological_map, _truth(drive)
    estimates, probabilities = [], []
    with StepsWriter(folder / "steps.csv") as writer:
        try:
            for number, observation in enumerate(observations):
                if number:
                    robot.predict(_odometry(drive, number))
                estimates.append(robot.update(observation))
                probabilities.append(robot.probabilities)
                errors = NodeErrors.of(made, estimates[-1:], nodes, truth[number : number + 1])
                writer.add(_row(drive, number, made, estimates[-1]) | _judged(errors))
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"images done: {len(estimates)}, kept in {folder}") from None
    return estimates, np.array(probabilities)


def _odometry(drive: Dataset, number: int) -> FloatArray | None:
    """Give the motion that led to an image, None where it was not measured."""
    import numpy as np

    poses = drive.odometry
    if poses is None or not np.isfinite(poses[number - 1 : number + 1]).all():
        return None
    return drive.odometry_between(number - 1, number)


def _row(
    drive: Dataset, number: int, made: TopologicalMap, estimate: NodeEstimate
) -> dict[str, float | int | str | None]:
    """Give an image's row of ``steps.csv``."""
    return {
        "step": number,
        "image": drive.image_paths[number].name,
        "stamp": float(drive.stamps[number]),
        "node": estimate.node,
        "node_image": made.names[estimate.node],
        "probability": estimate.probability,
        "place": estimate.place,
        "place_probability": estimate.place_probability,
        "effective_nodes": estimate.effective_nodes,
        "degenerate": int(estimate.degenerate),
    }


def _judged(errors: NodeErrors) -> dict[str, float | int | str | None]:
    """Give the columns that the truth fills, of one image."""
    known = errors.nearest[0] >= 0
    return {
        "nearest_node": int(errors.nearest[0]) if known else None,
        "nearest_distance_m": float(errors.nearest_distance[0]) if known else None,
        "distance_m": float(errors.distance[0]) if errors.distance[0] >= 0.0 else None,
        "place_right": int(errors.place_right[0]) if known else None,
    }


def _truth(dataset: Dataset) -> FloatArray:
    """Give the true poses, NaN where they are not known."""
    import numpy as np

    truth = dataset.ground_truth
    return np.full((len(dataset), 3), np.nan) if truth is None else truth


def _draw(
    folder: Path,
    made: TopologicalMap,
    probabilities: FloatArray,
    errors: NodeErrors,
    name: str,
) -> None:
    """Write the figure."""
    from pflut.plot import plot_node_probabilities, save_figure

    figure = plot_node_probabilities(
        probabilities,
        made.places,
        nearest=errors.nearest,
        right=errors.near,
        title=f"{name}: {len(probabilities)} images in a map of {len(made)}",
    )
    (folder / "figures").mkdir(exist_ok=True)
    save_figure(figure, folder / "figures" / "nodes.png")


def _report(made: TopologicalMap, drive: Dataset, errors: NodeErrors) -> str:
    """Say where the robot was found, and how often that was right."""
    import numpy as np

    from pflut.mapping.node_errors import NEAR, SURE

    known = errors.as_dict()
    measured = sum(_odometry(drive, number) is not None for number in range(1, len(drive)))
    lines = [f"{drive.name}: {len(drive)} images, {len(made)} nodes, {made.num_places} places"]
    if measured < len(drive) - 1:
        lines.append(f"note: odometry leads to {measured} of {len(drive) - 1} images")
    lines += [
        "",
        f"{'':<8}{'probability':>12}{'right':>10}{f'above {SURE:g}':>12}{'and wrong':>11}",
    ]
    for name, values, right, sure in (
        ("node", errors.probability, "near_node", "sure"),
        ("place", errors.place_probability, "place", "place_sure"),
    ):
        share = f"{100 * known[right]:.1f} %" if right in known else "unknown"
        counts = f"{known[sure]:>12}{known[f'{sure}_and_wrong']:>11}" if right in known else ""
        lines.append(f"{name:<8}{np.median(values):>12.3f}{share:>10}{counts}")
    if "near_node" not in known:
        return "\n".join([*lines, "", "note: no true poses of images and nodes are known"])
    return "\n".join(
        [
            *lines,
            "",
            f"probability: the median; right of {known['judged']} images: a node within "
            f"{NEAR:g} m, the place of the nearest node",
            f"the most probable node is {known['distance_median_m']:.2f} m away in the median, "
            f"{known['distance_90_m']:.2f} m at 90 %; the nearest "
            f"{known['nearest_distance_median_m']:.2f} m",
        ]
    )
