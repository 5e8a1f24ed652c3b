"""Images along a line through a room, linked here or by a Python of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from world import World

from pflut.features import Features

COUNT = 14
PAIRS = COUNT * (COUNT - 1) // 2
BATCHES = -(-PAIRS // 8)


def unit(features: Features) -> Features:
    """Make the descriptors as long as those of the extractor."""
    length = np.linalg.norm(features.descriptors, axis=1, keepdims=True)
    return replace(features, descriptors=features.descriptors / length)


def seen_along_a_line(count: int = COUNT) -> list[Features]:
    """Features of images along a line through a room, the first of them in another room."""
    rooms = [World(seed=1), World(seed=0)]
    places = np.linspace(-3.0, 3.0, count)
    return [
        unit(rooms[k > 0].look(np.array([x, 0.3 * x, 0.4 * k]), seed=k))
        for k, x in enumerate(places)
    ]


class StopError(Exception):
    """Raised by a progress bar, as Ctrl-C would be."""


def stop_after(pairs: int) -> Callable[[int, int], None]:
    def progress(done: int, total: int) -> None:
        if done >= pairs:
            raise StopError

    return progress


SCRIPT = """
import sys, time
from along_a_line import seen_along_a_line
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.all_pairs import all_pairs
from pflut.mapping.pair_linker import LinkOptions, PairLinker

folder, jobs, size, pause = sys.argv[1], *map(float, sys.argv[2:])
call = PairLinker.__call__

def slowly(*arguments):
    time.sleep(pause)
    return call(*arguments)

PairLinker.__call__ = slowly
"""
GUARDED = """
if __name__ == "__main__":
    table = LikelihoodTable.default(bins=32)
    all_pairs(seen_along_a_line(), folder, table, jobs=int(jobs), batch_size=int(size))
"""
# few kernels are needed, those that are slow to compile are not
UNGUARDED = """
options = LinkOptions(min_matches=1000)
all_pairs(seen_along_a_line(4), folder, jobs=int(jobs), batch_size=int(size), options=options)
"""


def start_alone(
    folder: Path, jobs: int, size: int, *, pause: float = 0.0, then: str = GUARDED, **more: str
) -> subprocess.Popen[str]:
    """Start another Python that links the same images."""
    script = folder.with_suffix(".py")
    script.write_text(SCRIPT + then)
    path = os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])
    return subprocess.Popen(
        [sys.executable, str(script), str(folder), str(jobs), str(size), str(pause)],
        env={**os.environ, "PYTHONPATH": path, **more},
        stderr=subprocess.PIPE,
        text=True,
    )
