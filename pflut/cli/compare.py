"""``pflut compare``: campaigns side by side."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from pflut.cli.arguments import Subparsers, add_verb, positive

_DETAILS = """\
RUN is a folder that pflut simulate has written. All scenarios and filters of all of them are
printed together, those of one scenario one after the other, the same drives of each where they
have others, too: a difference is then one of the filters."""

_EXAMPLES = """\
  pflut compare results/one results/other
  pflut compare results/* --figure comparison.png
"""


def add_parser(verbs: Subparsers) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "compare",
        "compare campaigns of simulated drives",
        usage="[options] RUN...",
        details=_DETAILS,
        examples=_EXAMPLES,
    )
    parser.add_argument("runs", metavar="RUN", nargs="+", type=Path, help="folder of a campaign")
    parser.add_argument("--figure", metavar="FILE", type=Path, help="draw errors and successes")
    for name, default in (("within", 6), ("recovered-within", 15)):
        parser.add_argument(
            f"--{name}",
            metavar="N",
            type=positive,
            default=default,
            help="images, as in pflut simulate (default: %(default)s)",
        )
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> None:
    """Read, sum up and print."""
    from pflut.campaign.figures import errors_figure
    from pflut.campaign.summary import groups, read_campaign, summarize_outcomes
    from pflut.cli.campaign_report import print_table
    from pflut.plot import save_figure
    from pflut.plot.style import check_figure_path

    if arguments.figure is not None:
        check_figure_path(arguments.figure)
    folders = list(dict.fromkeys(arguments.runs))
    found = {}
    for folder in folders:
        for (scenario, name), some in groups(read_campaign(folder)).items():
            found[scenario, name, str(folder)] = some
    _same_drives(folders)
    # the drives that all runs of a scenario have
    shared = {
        scenario: set.intersection(
            *({o.seed for o in some} for key, some in found.items() if key[0] == scenario)
        )
        for scenario, _, _ in found
    }
    kept = {
        key: [o for o in some if o.seed in shared[key[0]]]
        for key, some in sorted(found.items())
        if shared[key[0]]
    }
    if not kept:
        raise ValueError("runs: no drive is in all of them, expected seeds in common")
    for scenario in (name for name, seeds in shared.items() if not seeds):
        print(f"{scenario}: left out, no drive is in all runs")
    summaries = [
        summarize_outcomes(
            some, within=arguments.within, recovered_within=arguments.recovered_within
        )
        for some in kept.values()
    ]
    several = len(folders) > 1
    print_table(summaries, [run for _, _, run in kept] if several else ())
    if arguments.figure is not None:
        named = {
            (scenario, f"{name}, {run}" if several else name): some
            for (scenario, name, run), some in kept.items()
        }
        save_figure(errors_figure(named), arguments.figure)
        print(f"figure: {arguments.figure}")


def _same_drives(folders: Sequence[Path]) -> None:
    """Refuse runs whose seeds are other drives: what differed would not be the filters."""
    from pflut._files import read_json

    settings = [read_json(folder / "settings.json") for folder in folders]
    for folder, other in zip(folders, settings, strict=True):
        for name in ("world", "home_seed", "motion_blur", "max_images"):
            if other.get(name) != settings[0].get(name):
                raise ValueError(
                    f"{folder}: drives with another {name} than in {folders[0]}, expected the same"
                )
