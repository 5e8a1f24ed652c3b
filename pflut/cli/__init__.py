"""The command line: one verb, one file. Printing, progress bars and exit codes live here alone.

Exit codes: 0 done, 1 bad input (one line on stderr), 2 wrong usage, 130 interrupted.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

import pflut
from pflut.cli import compare, dataset, info, lut, map, relpose, replay, simulate

INTERRUPTED = 130

_EPILOG = """\
examples:
  pflut replay                            the simulated home, globally lost (rendered once)
  pflut replay DRIVE --start truth        a folder dataset, KITTI odometry or a home of ZInD
  pflut simulate --seeds 20               twenty simulated drives, globally lost
  pflut relpose a.png b.png --camera camera.toml
  pflut map links DRIVE                   which of its images show one place?
  pflut info                              versions, folders, datasets that are there

Every verb has its own --help. Results go to a new folder in results/; what is computed once
(features, rendered homes, the paper's table) to the cache folder, see pflut info.
"""


def make_parser() -> argparse.ArgumentParser:
    """Make the parser of all verbs; it imports nothing heavy."""
    parser = argparse.ArgumentParser(
        prog="pflut",
        description="Visual Monte Carlo localization on the plane, with a learned look-up table.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"pflut {pflut.__version__}")
    verbs = parser.add_subparsers(title="verbs", dest="verb", metavar="VERB", required=True)
    for verb in (replay, simulate, compare, relpose, map, lut, dataset, info):
        verb.add_parser(verbs)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments; those of the process if not given.

    Returns
    -------
    int
        The exit code.
    """
    arguments, unknown = make_parser().parse_known_args(argv)
    if unknown:
        # with the usage of the verb, not of pflut
        arguments.parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    # an image that does not decode is told by one line of ours, not by several of OpenCV's
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    try:
        arguments.run(arguments)
        sys.stdout.flush()
    except KeyboardInterrupt as interrupt:
        print(f"\npflut: interrupted{f': {interrupt}' if interrupt.args else ''}", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # the reader of our output has enough (head, a pager): nothing is wrong, say nothing more
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (ValueError, OSError) as error:
        print(f"pflut: error: {_one_line(error)}", file=sys.stderr)
        return 1
    return 0


def _one_line(error: Exception) -> str:
    """Say what was wrong in one line, the file first."""
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return " ".join(str(error).split()) or type(error).__name__
