"""``pflut simulate``: many simulated drives, and how many of them are localized."""

from __future__ import annotations

import argparse
from contextlib import closing
from pathlib import Path

from pflut.cli.arguments import (
    Subparsers,
    add_replay_options,
    add_verb,
    as_json,
    command_line,
    natural,
    positive,
    replay_options,
)

_DETAILS = """\
Each seed is a home of its own with a mapping drive, a later test drive and odometry; it is
rendered at its first use (about half a minute). The test drive is replayed, by default globally
lost. With --home-seed the home is one and the same, and the seeds vary filter and odometry.

Each drive's result is kept in the output folder as soon as it is done: the same command goes on
where it was interrupted."""

_EXAMPLES = """\
  pflut simulate --seeds 20                         seeds 0 to 19, globally lost
  pflut simulate --seeds 3..10 --start truth        seeds 3 to 10, known start
  pflut simulate --seeds 50 --home-seed 0           one home, fifty filters
  pflut simulate --seeds 20 --output results/lost   again: goes on, or sums up
"""


def add_parser(verbs: Subparsers) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "simulate",
        "replay many simulated drives and count how many are localized",
        usage="[options]",
        details=_DETAILS,
        examples=_EXAMPLES,
    )
    parser.add_argument(
        "--seeds",
        metavar="N|A..B",
        type=_seeds,
        default="20",
        help="how many, from 0; or from A to B (default: %(default)s)",
    )
    parser.add_argument(
        "--home-seed", metavar="N", type=natural, help="one home for all (default: one a seed)"
    )
    parser.add_argument(
        "--people",
        metavar="N",
        type=natural,
        default=0,
        help="walking about during the test drive (default: %(default)s)",
    )
    parser.add_argument(
        "--motion-blur",
        metavar="SECONDS",
        type=float,
        default=0.0,
        help="exposure of its images (default: %(default)s)",
    )
    parser.add_argument(
        "--max-images",
        metavar="N",
        type=positive,
        help="stop each drive after N images (default: all)",
    )
    parser.add_argument(
        "--within",
        metavar="N",
        type=positive,
        default=10,
        help="a success converges within N images (default: %(default)s)",
    )
    parser.add_argument("--jobs", metavar="N", type=positive, help="processes (default: all cores)")
    parser.add_argument(
        "--output",
        metavar="DIR",
        type=Path,
        help="folder of the results (default: results/<date>_<time>_simulate)",
    )
    parser.add_argument("--no-figures", action="store_true", help="write no figure")
    parser.add_argument(
        "--no-cache", action="store_true", help="keep no features (they take some 40 MB a home)"
    )
    add_replay_options(
        parser,
        leave_out=(
            "seed",
            "search_spacing",
            "search_headings",
            "search_noise",
            "odometry_noise",
            "odometry_scale",
            "odometry_drift",
        ),
    )
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> None:
    """Replay, sum up and print."""
    options = replay_options(arguments)

    from pflut._files import write_json
    from pflut.cli.progress import Bars
    from pflut.likelihood.sampling import available_cores
    from pflut.replay.seeds import drive_file, replay_seeds, summarize_seeds
    from pflut.replay.tables import choose_table, table_record
    from pflut.results import create_results_folder, run_record

    with Bars() as bars:
        # before the folder is there, and with a bar where it is learned
        table = choose_table(options.table, bins=options.bins, progress=bars.stage("table"))
    begun = arguments.output is not None and (arguments.output / "settings.json").is_file()
    folder = create_results_folder(arguments.output, "simulate", overwrite=begun)
    record = run_record(
        command_line(),
        arguments=as_json(arguments),
        options=options.as_dict(),
        table=table_record(options.table, table),
    )
    runs = []
    with Bars() as bars:
        try:
            bars("drives", 0, len(arguments.seeds))
            # closed, so that no process goes on while the drives are counted
            with closing(
                replay_seeds(
                    arguments.seeds,
                    folder,
                    options,
                    jobs=arguments.jobs or available_cores(),
                    home_seed=arguments.home_seed,
                    people=arguments.people,
                    motion_blur=arguments.motion_blur,
                    max_images=arguments.max_images,
                    cached=not arguments.no_cache,
                )
            ) as drives:
                for drive in drives:
                    runs.append(drive)
                    bars("drives", len(runs), len(arguments.seeds))
        except KeyboardInterrupt:
            # a drive is kept before it is handed on: the files count
            kept = sum(drive_file(folder, seed).is_file() for seed in arguments.seeds)
            raise KeyboardInterrupt(
                f"{kept} of {len(arguments.seeds)} drives are kept in {folder}; the same "
                f"command with --output {folder} goes on"
            ) from None
    runs.sort(key=lambda drive: drive.seed)
    summary = summarize_seeds(runs, within=arguments.within)
    write_json(folder / "metrics.json", summary)
    write_json(folder / "run.json", record)
    if not arguments.no_figures:
        from pflut.plot import save_figure
        from pflut.replay.figures import seeds_figure

        (folder / "figures").mkdir(exist_ok=True)
        save_figure(seeds_figure(runs, within=arguments.within), folder / "figures" / "drives.png")

    print(f"{'seed':>6}{'images':>8}{'converged at':>14}{'position [m]':>14}{'heading [deg]':>15}")
    for drive in runs:
        at = "-" if drive.converged_at is None else str(drive.converged_at + 1)
        errors = (
            f"{'-':>14}{'-':>15}"
            if drive.position_m is None or drive.heading_deg is None
            else f"{drive.position_m:>14.3f}{drive.heading_deg:>15.3f}"
        )
        print(f"{drive.seed:>6}{drive.images:>8}{at:>14}{errors}")
    success = summary["success"]
    print(
        f"\nconverged within {arguments.within} images: {success['successes']} of "
        f"{success['count']} drives ({100 * success['rate']:.0f} %, 95 % interval "
        f"{100 * success['low']:.0f} to {100 * success['high']:.0f} %)"
    )
    if summary["converged_ever"]:
        images = summary["images_to_convergence"]
        print(
            f"images until convergence: median {images['median']:g}, at most {images['maximum']:g}"
        )
        for name, unit, key in (("position", "m", "position_m"), ("heading", "deg", "heading_deg")):
            s = summary[key]
            print(
                f"{name} error afterwards, medians of drives: median {s['median']:.3f} {unit} "
                f"(95 % interval {s['median_low']:.3f} to {s['median_high']:.3f}), worst "
                f"{s['maximum']:.3f}; odometry alone {s['odometry_alone']:.3f}"
            )
    print(f"results: {folder}")


def _seeds(text: str) -> range:
    """Parse --seeds: a number of them, or A..B with both ends."""
    first, dots, last = text.partition("..")
    try:
        seeds = range(int(first), int(last) + 1) if dots else range(int(first))
    except ValueError:
        seeds = range(0)
    if not len(seeds) or seeds[0] < 0:
        raise argparse.ArgumentTypeError(f"expected a number or A..B, got {text!r}")
    return seeds
