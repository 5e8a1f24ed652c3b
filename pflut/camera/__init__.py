"""Camera models: pixels to bearings in the robot frame and back."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_NAMES = {
    "Camera": "base",
    "CylindricalPanorama": "cylindrical",
    "EquirectangularPanorama": "equirectangular",
    "Fisheye": "fisheye",
    "HyperbolicMirror": "hyperbolic",
    "Mount": "mount",
    "OcamCalib": "ocamcalib",
    "Perspective": "perspective",
    "Unwrapper": "unwrap",
    "default_panorama": "unwrap",
    "load_camera": "files",
    "save_camera": "files",
    "unwrap_maps": "unwrap",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_NAMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(_NAMES)
