"""Replay a recorded or simulated drive against reference images: the pipeline of the library."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_NAMES = {
    "ReplayOptions": "options",
    "ReplayResult": "result",
    "ReplayStep": "result",
    "SeedRun": "seeds",
    "prepare_dataset": "prepare",
    "replay_dataset": "pipeline",
    "replay_seed": "seeds",
    "replay_seeds": "seeds",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_NAMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(_NAMES)
