"""``pflut map build``: from a drive with odometry to a map of where its images were taken."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pflut.cli.arguments import (
    Subparsers,
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
    needs,
    open_folder,
    write_run,
)
from pflut.cli.map_links import add_link_options, linked, refuse_link_options

if TYPE_CHECKING:
    from pflut.cli.progress import Bars
    from pflut.datasets.base import Dataset
    from pflut.mapping.graph_optimizer import OptimizedGraph
    from pflut.mapping.links import Links
    from pflut.mapping.map_errors import MapErrors
    from pflut.mapping.pose_graph import PoseGraph

_DETAILS = """\
Links the images (as pflut map links, whose options it takes), or takes the links of a folder that
pflut map links wrote; makes a pose graph of odometry and links, and finds the most probable poses;
false links let go by themselves. No true pose is used but to say in the end how wrong the map is.

Results: map.g2o (for g2o, GTSAM and pflut), poses.tum, odometry.tum and groundtruth.tum where it is
known, links.npz, metrics.json, run.json, figures/map.png. Interrupted while it links, the same
command with the same --output goes on.

Needs pip install "pflut[mapping]"."""

_EXAMPLES = """\
  pflut map build simulated-home --output results/map
  pflut map build simulated-home --images references --simulate-odometry   its longer drive
  pflut map build results/links                     of links that are there
  pflut map build drive/ --max-candidates 20 --plain-links
"""


def add_parser(actions: Subparsers) -> None:
    """Add the action."""
    parser = add_verb(
        actions,
        "build",
        "make a map of a drive: a pose graph of odometry and links, optimised",
        usage="[options] LINKS|DATASET",
        details=_DETAILS,
        examples=_EXAMPLES,
    )
    add_source(parser)
    add_output(parser, "<dataset>-map")
    add_overwrite(parser)
    add_images(parser, ", those with odometry")
    parser.add_argument(
        "--simulate-odometry",
        action="store_true",
        help="simulate odometry from the ground truth, even where the dataset has some",
    )
    parser.add_argument(
        "--seed", metavar="N", type=natural, help="of --simulate-odometry (default: 0)"
    )
    parser.add_argument(
        "--plain-links",
        action="store_true",
        help="write the links that are believed to map.g2o as EDGE_SE2, too, for programs that "
        "do not know pflut's own tag",
    )
    parser.add_argument("--no-figures", action="store_true", help="write no figures")
    add_link_options(parser)
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> None:
    """Build the map, write it and print how good it is."""
    refuse_as_output(arguments, arguments.dataset)
    if arguments.seed is not None and not arguments.simulate_odometry:
        arguments.parser.error("argument --seed: only allowed with --simulate-odometry")
    arguments.seed = arguments.seed or 0
    options = replay_options(arguments)
    needs("scipy.sparse", extra="mapping", what="pflut map build")

    from pflut.cli.loading import load
    from pflut.cli.progress import Bars
    from pflut.mapping.graph_optimizer import optimize_graph
    from pflut.mapping.pose_graph import PoseGraph

    given = FoundLinks.read(Path(arguments.dataset))
    with Bars() as bars:
        if given is None:
            drive = _drive_of(load(arguments.dataset, None, progress=bars), arguments)
            links, folder = linked(arguments, drive, options, f"{drive.name} map", bars)
        else:
            drive, links, folder = _of_folder(arguments, given, bars)
    graph = PoseGraph.from_odometry(drive.odometry, links)  # type: ignore[arg-type]
    found = optimize_graph(graph)
    errors = _errors(drive, graph, found)
    _write(folder, drive, graph, found, errors, arguments)
    names = [path.name for path in drive.image_paths]
    write_run(folder, arguments, drive.name, names, None if given is None else given.of)
    if arguments.simulate_odometry:
        print("note: odometry is simulated from the ground truth")
    print(_report(drive, found, errors))
    print(f"results: {folder}")


def _drive_of(dataset: Dataset, arguments: argparse.Namespace) -> Dataset:
    """Take the images that become nodes."""
    from pflut.mapping.drive_images import drive_images

    if dataset.odometry is None and not arguments.simulate_odometry:
        hint = "" if dataset.ground_truth is None else ", or --simulate-odometry"
        raise ValueError(f"{dataset.name}: expected odometry{hint}, the dataset has none")
    return drive_images(
        dataset,
        arguments.images or "all",
        simulate=arguments.simulate_odometry,
        max_images=arguments.max_images,
        seed=arguments.seed,
    )


def _of_folder(
    arguments: argparse.Namespace, given: FoundLinks, bars: Bars
) -> tuple[Dataset, Links, Path]:
    """Take the links of a folder between images with odometry, and write them by themselves."""
    from dataclasses import replace

    import numpy as np

    refuse_link_options(arguments)
    refuse_as_output(arguments, given.of.source)
    drive = _drive_of(given.of.dataset(bars), arguments)
    number = {path.name: k for k, path in enumerate(drive.image_paths)}
    renumbered = np.array([number.get(name, -1) for name in given.of.images])
    rows = np.flatnonzero((renumbered[given.links.indices] >= 0).all(axis=1))
    links = given.links[rows]
    links = replace(links, indices=renumbered[links.indices])
    folder = open_folder(arguments, f"{drive.name} map")
    links.save(folder / "links.npz")
    return drive, links, folder


def _errors(drive: Dataset, graph: PoseGraph, found: OptimizedGraph) -> dict[str, MapErrors]:
    """Compare odometry and the map with the truth, where two true poses at least are known."""
    from pflut.cli.map_frame import truth_known
    from pflut.mapping.map_errors import MapErrors

    if not truth_known(drive):
        return {}
    trajectories = {"odometry": graph.poses, "pose_graph": found.poses}
    return {
        name: MapErrors.of(poses, drive.ground_truth)  # type: ignore[arg-type]
        for name, poses in trajectories.items()
    }


def _write(
    folder: Path,
    drive: Dataset,
    graph: PoseGraph,
    found: OptimizedGraph,
    errors: dict[str, MapErrors],
    arguments: argparse.Namespace,
) -> None:
    """Write the map and what is known of it."""
    import numpy as np

    from pflut._files import write_json
    from pflut.mapping.g2o import write_g2o
    from pflut.mapping.links import LINKED
    from pflut.trajectory import Trajectory, write_tum

    edges = found.believed if arguments.plain_links else None
    write_g2o(folder / "map.g2o", found.graph, edges=edges)
    truth = drive.ground_truth
    trajectories = {"poses": found.poses, "odometry": graph.poses, "groundtruth": truth}
    for name, poses in trajectories.items():
        if poses is not None:
            known = np.isfinite(poses).all(axis=1)
            write_tum(folder / f"{name}.tum", Trajectory(drive.stamps[known], poses[known]))
    metrics: dict[str, Any] = {
        "images": len(drive),
        "pairs": len(graph.links),
        "linked": int((graph.links.probability >= LINKED).sum()),
        "believed": len(found.believed),
        "converged": found.converged,
        **{name: those.as_dict() for name, those in errors.items()},
    }
    write_json(folder / "metrics.json", metrics)
    if arguments.no_figures:
        return
    title = f"{drive.name}: {len(drive)} images, {len(found.believed)} links"
    _draw(folder, drive, graph, found, title)


def _draw(
    folder: Path, drive: Dataset, graph: PoseGraph, found: OptimizedGraph, title: str
) -> None:
    """Write the figure: over the floor plan only where the truth says how the map lies in it."""
    from pflut.alignment import align_poses
    from pflut.cli.map_frame import WITHOUT_TRUTH, truth_known, without_plan
    from pflut.plot import save_figure
    from pflut.plot.pose_graph import plot_pose_graph

    shown, truth, note = [found.poses, graph.poses], drive.ground_truth, None
    if truth_known(drive):
        shown = [align_poses(poses, truth) for poses in shown]  # type: ignore[arg-type]
    else:
        drive, truth, note = without_plan(drive, found.poses), None, WITHOUT_TRUTH
    (folder / "figures").mkdir(exist_ok=True)
    save_figure(
        plot_pose_graph(
            drive,
            shown[0],
            graph.link_nodes[found.believed],
            found.link_probability[found.believed],
            odometry=shown[1],
            ground_truth=truth,
            note=note,
            title=title,
        ),
        folder / "figures" / "map.png",
    )


def _report(drive: Dataset, found: OptimizedGraph, errors: dict[str, MapErrors]) -> str:
    """Say what the map is made of and how wrong it is."""
    from pflut.cli.map_frame import WITHOUT_TRUTH
    from pflut.mapping.links import LINKED

    links = found.graph.links
    linked_pairs = int((links.probability >= LINKED).sum())
    lines = [
        f"{drive.name}: {len(drive)} images, {len(links)} pairs, {linked_pairs} linked, "
        f"{len(found.believed)} believed"
    ]
    if not found.converged:
        lines.append("note: the poses still moved by more than a millimetre when the search ended")
    if not errors:
        lines.append(f"note: {WITHOUT_TRUTH}")
    else:
        lines += [
            "",
            f"{'':<12}{'position':>10}{'largest':>10}{'from start':>12}{'heading':>10}",
        ]
        for name, those in errors.items():
            values = those.as_dict()
            lines.append(
                f"{name.replace('_', ' '):<12}{values['position_m']:>8.3f} m"
                f"{values['position_largest_m']:>8.3f} m"
                f"{values['position_from_start_m']:>10.3f} m{values['heading_deg']:>6.2f} deg"
            )
        ratio = errors["pose_graph"].position / max(errors["odometry"].position, 1e-12)
        lines += ["", f"position error, root mean square, {ratio:.2f} of odometry's"]
    return "\n".join(lines)
