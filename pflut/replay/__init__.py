"""Replay a recorded or simulated drive against reference images: the pipeline of the library."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pflut._lazy import lazy

if TYPE_CHECKING:
    from pflut.replay.options import ReplayOptions as ReplayOptions
    from pflut.replay.pipeline import replay_dataset as replay_dataset
    from pflut.replay.prepare import prepare_dataset as prepare_dataset
    from pflut.replay.result import ReplayResult as ReplayResult
    from pflut.replay.result import ReplayStep as ReplayStep

_NAMES = {
    "ReplayOptions": "options",
    "ReplayResult": "result",
    "ReplayStep": "result",
    "prepare_dataset": "prepare",
    "replay_dataset": "pipeline",
}

__getattr__, __dir__, __all__ = lazy(__name__, _NAMES)
