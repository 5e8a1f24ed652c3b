"""Arguments that several verbs share, and those made from `ReplayOptions`."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Collection
from dataclasses import Field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pflut.replay.options import ReplayOptions

if TYPE_CHECKING:
    from pflut.features import FeatureCache

Subparsers = Any  # argparse keeps the type of what add_subparsers returns to itself


def add_verb(
    verbs: Subparsers,
    name: str,
    text: str,
    *,
    usage: str,
    examples: str = "",
    details: str = "",
) -> argparse.ArgumentParser:
    """Add a verb with its help text and examples; ``usage`` are its arguments, for short."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        name,
        help=text,
        usage=f"%(prog)s {usage}",
        description=f"{text[0].upper()}{text[1:]}.\n\n{details}".strip(),
        epilog=f"examples:\n{examples}" if examples else None,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    return parser


def add_dataset(parser: argparse.ArgumentParser, *, default: str | None = None) -> None:
    """Add the argument DATASET."""
    text = "a name or a folder: simulated-home, a folder dataset, KITTI odometry, a home of ZInD"
    parser.add_argument(
        "dataset",
        metavar="DATASET",
        nargs="?" if default else None,
        default=default,
        help=text + (" (default: %(default)s)" if default else ""),
    )


def add_references(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """Add --references."""
    parser.add_argument(
        "--references",
        metavar="every:N|all|FILE",
        help="which images make the map: every Nth, all (leave one out) or a file of image names "
        "(default: what the dataset says)",
    )


def add_output(parser: argparse.ArgumentParser, name: str) -> None:
    """Add --output; ``name`` is how the folder ends that is made without it."""
    parser.add_argument(
        "--output",
        metavar="DIR",
        type=Path,
        help=f"folder of the results (default: results/<date>_<time>_{name})",
    )


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Add --overwrite."""
    parser.add_argument(
        "--overwrite",
        action="store_true",
        help="let --output be a folder that holds files: the results of a former run are deleted, "
        "other files stay",
    )


def refuse_as_output(arguments: argparse.Namespace, *sources: str | None) -> None:
    """End as wrong usage where results would go among, and replace, the files that are read."""
    output: Path | None = arguments.output
    if output is None or not output.is_dir():
        return
    for source in sources:
        if source is not None and Path(source).is_dir() and output.samefile(source):
            parser: argparse.ArgumentParser = arguments.parser
            parser.error(f"argument --output: expected another folder than {source}, which is read")


def add_cache(parser: argparse.ArgumentParser) -> None:
    """Add --no-cache."""
    parser.add_argument(
        "--no-cache",
        action="store_true",
        help="compute all features anew, and keep none (the times then tell what they cost)",
    )


def feature_cache(arguments: argparse.Namespace) -> FeatureCache | None:
    """Give the cache of features that the arguments ask for."""
    from pflut.features import FeatureCache

    return None if arguments.no_cache else FeatureCache()


def positive(text: str) -> int:
    """Parse a whole number of at least 1."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"expected at least 1, got {text}")
    return value


def natural(text: str) -> int:
    """Parse a whole number of at least 0."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"expected at least 0, got {text}")
    return value


def above_zero(text: str) -> float:
    """Parse a number above zero."""
    value = float(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"expected a number above 0, got {text}")
    return value


def start(text: str) -> str | tuple[float, float, float]:
    """Parse --start: lost, truth or X,Y,HEADING_DEG."""
    if text in ("lost", "truth"):
        return text
    try:
        x, y, heading = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"expected lost, truth or X,Y,HEADING_DEG, got {text!r}"
        ) from None
    return x, y, math.radians(heading)


def add_replay_options(parser: argparse.ArgumentParser, *, leave_out: Collection[str] = ()) -> None:
    """Add an argument for each field of `ReplayOptions`, in their groups."""
    groups: dict[str, Any] = {}
    for item in fields(ReplayOptions):
        if item.name in leave_out:
            continue
        name = item.metadata["group"]
        if name not in groups:
            groups[name] = parser.add_argument_group(name)
        _add_option(groups[name], item)


def replay_options(arguments: argparse.Namespace) -> ReplayOptions:
    """Make the options from the arguments; what is out of range ends as wrong usage."""
    values: dict[str, Any] = {}
    for item in fields(ReplayOptions):
        if hasattr(arguments, item.name):
            value = getattr(arguments, item.name)
            values[item.name] = math.radians(value) if item.metadata.get("angle") else value
    try:
        return ReplayOptions(**values)
    except ValueError as error:
        name, _, text = str(error).partition(":")
        wrong = next((item for item in fields(ReplayOptions) if item.name == name), None)
        flag = name if wrong is None else _flag(wrong)
        text += " radians" if wrong is not None and wrong.metadata.get("angle") else ""
        parser: argparse.ArgumentParser = arguments.parser
        parser.error(f"argument {flag}:{text}")


def command_line() -> list[str]:
    """Give the command as it was typed, for ``run.json``."""
    return ["pflut", *sys.argv[1:]]


def as_json(arguments: argparse.Namespace) -> dict[str, Any]:
    """Give the arguments for ``run.json``."""
    plain = (bool, int, float, list, tuple, type(None))
    return {
        name: value if isinstance(value, plain) else str(value)
        for name, value in vars(arguments).items()
        if name not in ("run", "parser", "verb")
    }


def _flag(item: Field[Any]) -> str:
    name = item.metadata.get("flag", item.name).replace("_", "-")
    return f"--{name}-deg" if item.metadata.get("angle") else f"--{name}"


def _add_option(group: Any, item: Field[Any]) -> None:
    """Add an option's argument; it sets nothing unless it is given."""
    about = item.metadata
    default: Any = item.default
    text = about["help"].replace("%", "%%")
    if about.get("angle"):
        default, text = math.degrees(default), f"degrees, {text}"
    if isinstance(default, bool):
        shown = "yes" if default else "no"
    else:
        shown = f"{default:g}" if isinstance(default, float) else str(default)
    if default is not None:
        text += f" (default: {shown})"
    common = {"dest": item.name, "default": argparse.SUPPRESS, "help": text}
    if isinstance(default, bool):
        group.add_argument(_flag(item), action=argparse.BooleanOptionalAction, **common)
        return
    kind = start if item.name == "start" else about.get("type", type(default))
    metavar = about.get("metavar", {start: "START", int: "N", float: "X"}.get(kind))
    group.add_argument(
        _flag(item), type=kind, choices=about.get("choices"), metavar=metavar, **common
    )
