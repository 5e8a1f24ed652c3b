"""``pflut dataset``: describe a dataset, render a simulated home, unwrap a folder."""

from __future__ import annotations

import argparse
from pathlib import Path

from pflut.cli.arguments import Subparsers, add_dataset, add_references, add_verb, natural, positive


def add_parser(verbs: Subparsers) -> None:
    """Add the verb and its actions."""
    parser = add_verb(
        verbs,
        "dataset",
        "describe a dataset (info), render a simulated home into a folder (render), or unwrap a\n"
        "folder of mirror or fisheye images to panoramas (unwrap)",
        usage="{info,render,unwrap} ...",
    )
    actions = parser.add_subparsers(
        title="actions", metavar="ACTION", required=True, prog=parser.prog
    )
    info = add_verb(
        actions,
        "info",
        "say what a dataset holds",
        usage="[options] [DATASET]",
        examples="  pflut dataset info simulated-home\n  pflut dataset info drive/ --check\n",
    )
    add_dataset(info, default="simulated-home")
    add_references(info)
    info.add_argument(
        "--check", action="store_true", help="read every image: does it decode, is its size right"
    )
    info.set_defaults(run=run_info, parser=info)
    render = add_verb(
        actions,
        "render",
        "render the drives through a simulated home into a new folder",
        usage="[options] OUT",
        details="OUT becomes a folder dataset, as from a real robot: images, camera.toml, "
        "groundtruth.tum,\nodometry.tum, references.txt, floorplan.csv. The same seed gives the "
        "same bytes.",
        examples="  pflut dataset render home7 --seed 7\n"
        "  pflut dataset render party --people 3 --motion-blur 0.03\n",
    )
    render.add_argument("out", metavar="OUT", type=Path, help="the folder to create")
    render.add_argument(
        "--seed", metavar="N", type=natural, default=0, help="of the home (default: %(default)s)"
    )
    render.add_argument(
        "--people",
        metavar="N",
        type=natural,
        default=0,
        help="walking about during the test drive (default: %(default)s)",
    )
    render.add_argument(
        "--motion-blur",
        metavar="SECONDS",
        type=float,
        default=0.0,
        help="exposure of the test drive's images (default: %(default)s, sharp)",
    )
    render.add_argument(
        "--max-images", metavar="N", type=positive, help="of each drive (default: all)"
    )
    render.add_argument("--threads", metavar="N", type=positive, help="(default: all cores)")
    render.set_defaults(run=run_render, parser=render)
    unwrap = add_verb(
        actions,
        "unwrap",
        "unwrap a folder of mirror or fisheye images to a new folder of panoramas",
        usage="[options] IN OUT",
        details="OUT becomes a folder dataset with the panoramas' camera.toml and a mask.png of "
        "what the\ncamera saw. Poses, references, floor plan and settings are carried along.",
        examples="  pflut dataset unwrap drive/ panoramas/\n"
        "  pflut dataset unwrap drive/ panoramas/ --width 2048\n",
    )
    unwrap.add_argument("source", metavar="IN", type=Path, help="a folder dataset")
    unwrap.add_argument("out", metavar="OUT", type=Path, help="the folder to create")
    unwrap.add_argument(
        "--width",
        metavar="N",
        type=positive,
        default=1024,
        help="of the panoramas in pixels (default: %(default)s)",
    )
    unwrap.set_defaults(run=run_unwrap, parser=unwrap)


def run_info(arguments: argparse.Namespace) -> None:
    """Describe a dataset."""
    import numpy as np

    from pflut.cli.loading import load
    from pflut.cli.progress import Bars

    with Bars() as bars:
        dataset = load(arguments.dataset, arguments.references, progress=bars)
        if arguments.check:
            for index in range(len(dataset)):
                dataset.image(index)
                bars("images", index + 1, len(dataset))
    camera = dataset.camera
    rows = [
        ("name", dataset.name),
        ("folder", str(dataset.image_paths[0].parent.parent)),
        ("camera", f"{camera.model}, {camera.width} x {camera.height} pixels"),
        ("images", f"{len(dataset)}{', all decode' if arguments.check else ''}"),
        ("stamps", f"{dataset.stamps[0]:g} to {dataset.stamps[-1]:g} s"),
        ("references", str(len(dataset.reference_indices))),
        ("queries", str(len(dataset.query_indices))),
    ]
    if dataset.leave_one_out:
        rows[-1] = ("queries", f"{len(dataset.query_indices)}, references as well: leave one out")
    for name, poses in (("truth", dataset.ground_truth), ("odometry", dataset.odometry)):
        if poses is None:
            rows.append((name, "none"))
            continue
        known = np.isfinite(poses).all(axis=1)
        low, high = poses[known, :2].min(axis=0), poses[known, :2].max(axis=0)
        text = f"poses of {int(known.sum())} images"
        if name == "truth":
            size = high - low
            text += f" in {size[0]:.1f} x {size[1]:.1f} m"
        rows.append((name, text))
    walls = 0 if dataset.floor_plan is None else len(dataset.floor_plan)
    rows.append(("floor plan", f"{walls} walls" if walls else "none"))
    if dataset.mask_elevation is not None:
        limits = np.degrees(dataset.mask_elevation)
        rows.append(("mask", f"features from {limits[0]:.1f} to {limits[1]:.1f} deg of elevation"))
    if dataset.mask is not None:
        rows.append(("mask.png", f"{100.0 * dataset.mask.mean():.1f} % of the pixels are used"))
    for name, text in rows:
        print(f"{name:<12}{text}")


def run_render(arguments: argparse.Namespace) -> None:
    """Render a home."""
    from pflut.cli.progress import Bars
    from pflut.datasets.simulated_home import render_simulated_home

    out: Path = arguments.out
    # before minutes of rendering, not after
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise FileExistsError(f"{out}: exists already and is not an empty folder")
    with Bars() as bars:
        render_simulated_home(
            out,
            arguments.seed,
            people=arguments.people,
            motion_blur=arguments.motion_blur,
            max_images=arguments.max_images,
            threads=arguments.threads,
            progress=bars.stage("rendering"),
        )
    print(f"{out}: rendered; replay it with: pflut replay {out}")


def run_unwrap(arguments: argparse.Namespace) -> None:
    """Unwrap a folder."""
    from pflut.cli.progress import Bars
    from pflut.datasets.unwrap import unwrap_folder

    out: Path = arguments.out
    with Bars() as bars:
        unwrap_folder(
            arguments.source, out, width=arguments.width, progress=bars.stage("unwrapping")
        )
    print(f"{out}: unwrapped; replay it with: pflut replay {out}")
