"""Camera models: pixels to bearings in the robot frame and back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pflut._lazy import lazy

if TYPE_CHECKING:
    from pflut.camera.base import Camera as Camera
    from pflut.camera.cylindrical import CylindricalPanorama as CylindricalPanorama
    from pflut.camera.equirectangular import EquirectangularPanorama as EquirectangularPanorama
    from pflut.camera.files import load_camera as load_camera
    from pflut.camera.files import save_camera as save_camera
    from pflut.camera.fisheye import Fisheye as Fisheye
    from pflut.camera.hyperbolic import HyperbolicMirror as HyperbolicMirror
    from pflut.camera.mount import Mount as Mount
    from pflut.camera.ocamcalib import OcamCalib as OcamCalib
    from pflut.camera.perspective import Perspective as Perspective
    from pflut.camera.unwrap import Unwrapper as Unwrapper
    from pflut.camera.unwrap import default_panorama as default_panorama
    from pflut.camera.unwrap import unwrap_maps as unwrap_maps

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

__getattr__, __dir__, __all__ = lazy(__name__, _NAMES)
