"""``pflut simulate``: many simulated drives, and how many of them are localized."""

from __future__ import annotations

import argparse
from contextlib import closing

from pflut.cli.arguments import (
    Subparsers,
    add_output,
    add_replay_options,
    add_verb,
    as_json,
    command_line,
    natural,
    positive,
    replay_options,
)

_DETAILS = """\
Homes of landmarks (--world landmarks) give the filter matches at once: a drive takes about a
second. Rendered homes give it images: each takes about half a minute at its first use. Every seed
is another drive.

Scenarios: tracking, global (starts lost), kidnapped, dark, crowded, corridor, sparse, odometry,
mismatches; rendered homes have tracking, global, kidnapped, crowded, sparse and odometry.
Filters: pflut, paper (the paper's table), ransac (RANSAC's poses as Gaussians), ekf-ransac, ekf-ml,
ukf-ransac, ukf-ml (Kalman filters), odometry. "all" are all of them.

Each drive's outcome is kept in the output folder as soon as it is done: the same command goes on
where it was interrupted, and further scenarios and filters are added to it."""

_EXAMPLES = """\
  pflut simulate                                        20 drives, globally lost
  pflut simulate --scenario kidnapped --seeds 200       is it found again?
  pflut simulate --scenario all --filter all            the whole table
  pflut simulate --world rendered --scenario tracking --seeds 3..10
  pflut simulate --home-seed 0 --seeds 50               one home
  pflut simulate --seeds 200 --output results/lost      again: goes on, or sums up
"""


def add_parser(verbs: Subparsers) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "simulate",
        "localize robots along many simulated drives and count successes",
        usage="[options]",
        details=_DETAILS,
        examples=_EXAMPLES,
    )
    parser.add_argument(
        "--world",
        choices=("landmarks", "rendered"),
        default="landmarks",
        help="homes of landmarks, or of images (default: %(default)s)",
    )
    parser.add_argument(
        "--scenario",
        metavar="NAME[,NAME]",
        type=_names,
        default="global",
        help="what is hard about the drives (default: %(default)s)",
    )
    parser.add_argument(
        "--filter",
        metavar="NAME[,NAME]",
        type=_names,
        default="pflut",
        help="what localizes the robot (default: %(default)s)",
    )
    parser.add_argument(
        "--seeds",
        metavar="N|A..B",
        type=_seeds,
        default="20",
        help="how many, from 0; or from A to B (default: %(default)s)",
    )
    parser.add_argument(
        "--home-seed", metavar="N", type=natural, help="one home for all (default: several)"
    )
    parser.add_argument(
        "--motion-blur",
        metavar="SECONDS",
        type=float,
        default=0.0,
        help="exposure of rendered images (default: %(default)s)",
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
        default=6,
        help="a success converges within N images (default: %(default)s)",
    )
    parser.add_argument(
        "--recovered-within",
        metavar="N",
        type=positive,
        default=15,
        help="and is found again within N images (default: %(default)s)",
    )
    parser.add_argument("--jobs", metavar="N", type=positive, help="processes (default: all cores)")
    add_output(parser, "simulate")
    parser.add_argument("--no-figures", action="store_true", help="write no figure")
    parser.add_argument(
        "--no-cache", action="store_true", help="keep no features (they take some 40 MB a home)"
    )
    add_replay_options(
        parser,
        leave_out=(
            "seed",
            "start",
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
    """Run the drives, sum up and print."""
    options = replay_options(arguments)
    parser: argparse.ArgumentParser = arguments.parser

    from pflut.campaign.course import RENDERED
    from pflut.campaign.drives import Campaign, run_campaign
    from pflut.campaign.filters import FILTERS
    from pflut.cli.campaign_report import kept, write_report
    from pflut.cli.progress import Bars
    from pflut.likelihood.sampling import available_cores
    from pflut.replay.tables import choose_table
    from pflut.results import create_results_folder, run_record
    from pflut.simulation.scenarios import SCENARIOS

    known = tuple(SCENARIOS) if arguments.world == "landmarks" else RENDERED
    try:
        campaign = Campaign(
            world=arguments.world,
            scenarios=known if arguments.scenario == ("all",) else arguments.scenario,
            filters=tuple(FILTERS) if arguments.filter == ("all",) else arguments.filter,
            options=options,
            home_seed=arguments.home_seed,
            motion_blur=arguments.motion_blur,
            max_images=arguments.max_images,
        )
    except ValueError as error:
        name, _, text = str(error).partition(":")
        parser.error(f"argument --{name.replace('_', '-')}:{text}")
    with Bars() as bars:
        # before the folder is there, and with a bar where it is learned
        tables = {options.table, *(("dense",) if "paper" in campaign.filters else ())}
        for table in sorted(tables):
            choose_table(table, bins=options.bins, progress=bars.stage("table"))
    begun = arguments.output is not None and (arguments.output / "settings.json").is_file()
    folder = create_results_folder(arguments.output, "simulate", overwrite=begun)
    record = run_record(command_line(), arguments=as_json(arguments), **campaign.record())
    done = []
    total = len(arguments.seeds) * len(campaign.scenarios) * len(campaign.filters)
    with Bars() as bars:
        try:
            bars("drives", 0, total)
            # closed, so that no process goes on while the drives are counted
            with closing(
                run_campaign(
                    campaign,
                    arguments.seeds,
                    folder,
                    jobs=arguments.jobs or available_cores(),
                    cached=not arguments.no_cache,
                )
            ) as drives:
                for drive in drives:
                    done.append(drive)
                    bars("drives", len(done), total)
        except KeyboardInterrupt:
            # a drive is kept before it is handed on: the files count
            raise KeyboardInterrupt(
                f"{kept(folder, campaign, arguments.seeds)} of {total} drives are kept in "
                f"{folder}; the same command with --output {folder} goes on"
            ) from None
    write_report(
        folder,
        done,
        record,
        within=arguments.within,
        recovered_within=arguments.recovered_within,
        figures=not arguments.no_figures,
    )


def _names(text: str) -> tuple[str, ...]:
    """Parse names between commas."""
    names = tuple(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))
    if not names or ("all" in names and len(names) > 1):
        raise argparse.ArgumentTypeError(f"expected names, or all, got {text!r}")
    return names


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
