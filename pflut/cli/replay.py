"""``pflut replay``: localize a robot along a recorded drive."""

from __future__ import annotations

import argparse

from pflut.cli.arguments import (
    Subparsers,
    add_cache,
    add_dataset,
    add_output,
    add_overwrite,
    add_references,
    add_replay_options,
    add_verb,
    as_json,
    command_line,
    feature_cache,
    positive,
    refuse_as_output,
    replay_options,
)

_DETAILS = """\
The reference images make the map; the others are localized in it by a particle filter that is
moved by odometry and weighted by each image. A dataset whose images are all references and which
has no odometry (a home of ZInD) is localized image by image, leaving each one out of the map.
Where odometry is missing it is simulated from the ground truth, and the output says so.

Results: poses.tum, groundtruth.tum, odometry.tum (from the true start, for comparison), steps.csv
(a row an image, written as the replay goes), metrics.json, timings.json, run.json, figures/. An
interrupted replay leaves the steps and trajectories of the images that were done.
The same seed gives the same poses.tum and metrics.json."""

_EXAMPLES = """\
  pflut replay                                     the simulated home, globally lost
  pflut replay drive/ --start truth                known start
  pflut replay drive/ --start=-1.5,2,90            x, y in metres, heading in degrees
  pflut replay kitti/ --references every:10 --start truth
  pflut replay zind/ --leave-one-out
  pflut replay --animate --output results/home     with particles.gif
"""


def add_parser(verbs: Subparsers) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "replay",
        "localize a robot along a recorded drive, against reference images",
        usage="[options] [DATASET]",
        examples=_EXAMPLES,
        details=_DETAILS,
    )
    add_dataset(parser, default="simulated-home")
    add_references(parser)
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument(
        "--leave-one-out",
        action="store_true",
        help="localize each image on its own, anywhere in the map, against all others",
    )
    mode.add_argument(
        "--simulate-odometry",
        action="store_true",
        help="simulate odometry from the ground truth, even where the dataset has some",
    )
    parser.add_argument(
        "--max-images", metavar="N", type=positive, help="stop after N images (default: all)"
    )
    add_output(parser, "<dataset>")
    add_overwrite(parser)
    parser.add_argument(
        "--animate", action="store_true", help="write figures/particles.gif as well"
    )
    parser.add_argument("--no-figures", action="store_true", help="write no figures")
    add_cache(parser)
    add_replay_options(parser)
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> None:
    """Replay, write the results and print a table."""
    options = replay_options(arguments)
    refuse_as_output(arguments, arguments.dataset)

    from pflut._files import write_json
    from pflut.cli.loading import load
    from pflut.cli.progress import Bars
    from pflut.cli.report import replay_report
    from pflut.replay.figures import SHOWN_STEPS, animate, draw_figures
    from pflut.replay.pipeline import replay_dataset
    from pflut.replay.prepare import prepare_dataset
    from pflut.replay.result import ReplayResult, ReplayStep
    from pflut.replay.tables import choose_table, table_record
    from pflut.results import (
        StepsWriter,
        create_results_folder,
        remove_results,
        run_record,
        step_row,
        write_results,
        write_trajectories,
    )

    how = {
        "leave_one_out": arguments.leave_one_out or None,
        "simulated_odometry": arguments.simulate_odometry or None,
        "max_images": arguments.max_images,
    }
    with Bars() as bars:
        dataset = load(arguments.dataset, arguments.references, progress=bars)
        table = choose_table(
            options.table,
            bins=options.bins,
            camera=dataset.camera,
            progress=bars.stage("table"),
        )
        plan = prepare_dataset(dataset, options, **how)
        for note in plan.notes:
            print(f"note: {note}")
        folder = create_results_folder(
            arguments.output,
            dataset.name,
            overwrite=arguments.overwrite,
            expected="a new folder or --overwrite",
        )
        remove_results(folder)
        record = run_record(
            command_line(),
            dataset=dataset.name,
            notes=list(plan.notes),
            arguments=as_json(arguments),
            options=options.as_dict(),
            seed=options.seed,
            table=table_record(options.table, table),
        )
        write_json(folder / "run.json", {**record, "finished": False})
        done: list[ReplayStep] = []
        with StepsWriter(folder / "steps.csv") as writer:

            def keep(number: int, step: ReplayStep) -> None:
                writer.add(step_row(number, step))
                done.append(step)

            try:
                result = replay_dataset(
                    dataset,
                    options,
                    **how,
                    table=table,
                    cache=feature_cache(arguments),
                    keep_particles=range(-1, len(dataset)) if arguments.animate else SHOWN_STEPS,
                    on_step=keep,
                    progress=bars,
                )
            except KeyboardInterrupt:
                if done:
                    write_trajectories(
                        folder,
                        ReplayResult(plan.dataset, options, plan.each_on_its_own, tuple(done)),
                    )
                raise KeyboardInterrupt(f"images done: {len(done)}, kept in {folder}") from None
        write_results(folder, result)
        if not arguments.no_figures:
            draw_figures(folder / "figures", result, table)
        if arguments.animate and result.snapshots:
            (folder / "figures").mkdir(exist_ok=True)
            animate(folder / "figures" / "particles.gif", result, progress=bars.stage("animation"))
        write_json(folder / "run.json", {**record, "finished": True})
    print(replay_report(result))
    print(f"results: {folder}")
