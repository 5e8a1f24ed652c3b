"""Tests of the table's size by the camera's sharpness."""

from __future__ import annotations

import pytest

from pflut.camera import (
    Camera,
    EquirectangularPanorama,
    Fisheye,
    HyperbolicMirror,
    Mount,
    Perspective,
)
from pflut.replay.pipeline import COMMON_BINS, SHARP_BINS, camera_bins

MIRROR = HyperbolicMirror(1024, 768, 0.97, 350, 350, 511, 383, elevation_min=-0.8)


@pytest.mark.parametrize(
    ("camera", "bins"),
    [
        (EquirectangularPanorama(1024, 512), COMMON_BINS),
        (EquirectangularPanorama(4096, 2048), SHARP_BINS),
        (MIRROR, COMMON_BINS),
        (Fisheye(1000, 1000, 300, 300, 500, 500, looks="up"), COMMON_BINS),
        (Perspective(1226, 370, 707, 707, 602, 183), SHARP_BINS),
        (Perspective(320, 240, 180, 180, 160, 120), COMMON_BINS),
        (Perspective(1226, 370, 707, 707, 602, 183, mount=Mount(pitch=0.3)), SHARP_BINS),
    ],
    ids=lambda value: getattr(value, "width", value),
)
def test_sharp_cameras_have_more_bins(camera: Camera, bins: int) -> None:
    assert camera_bins(camera) == bins
