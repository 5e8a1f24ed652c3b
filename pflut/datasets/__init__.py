"""Datasets: the folder format, public sets, the simulated home."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pflut._lazy import lazy

if TYPE_CHECKING:
    from pflut.datasets.base import Dataset as Dataset
    from pflut.datasets.folder import load_folder as load_folder
    from pflut.datasets.folder import write_folder as write_folder
    from pflut.datasets.kitti import load_kitti_odometry as load_kitti_odometry
    from pflut.datasets.registry import data_root as data_root
    from pflut.datasets.registry import load_dataset as load_dataset
    from pflut.datasets.simulated_home import load_simulated_home as load_simulated_home
    from pflut.datasets.unwrap import unwrap_folder as unwrap_folder
    from pflut.datasets.zind import load_zind as load_zind

_NAMES = {
    "Dataset": "base",
    "data_root": "registry",
    "load_dataset": "registry",
    "load_folder": "folder",
    "load_kitti_odometry": "kitti",
    "load_simulated_home": "simulated_home",
    "load_zind": "zind",
    "unwrap_folder": "unwrap",
    "write_folder": "folder",
}

__getattr__, __dir__, __all__ = lazy(__name__, _NAMES)
