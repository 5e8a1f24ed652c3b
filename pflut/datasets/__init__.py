"""Datasets: the folder format, public sets, the simulated home."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_NAMES = {
    "Dataset": "base",
    "data_root": "registry",
    "load_dataset": "registry",
    "load_folder": "folder",
    "load_kitti_odometry": "kitti",
    "load_simulated_home": "simulated_home",
    "load_zind": "zind",
    "write_folder": "folder",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_NAMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(_NAMES)
