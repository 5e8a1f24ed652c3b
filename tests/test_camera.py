"""Cameras: the way there and back, OpenCV as the oracle, conventions, files."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from pflut.camera import (
    Camera,
    CylindricalPanorama,
    EquirectangularPanorama,
    Fisheye,
    HyperbolicMirror,
    Mount,
    OcamCalib,
    Perspective,
    load_camera,
)
from pflut.geometry import bearing_vectors, wrap_to_pi

TILTED = Mount(yaw=0.4, pitch=0.15, roll=-0.1, height=1.2)
DISTORTION = (-0.28, 0.09, 0.0012, -0.0007, -0.01)

OCAM_LENS = (-280.5, 0.0, 9.1e-4, -8.0e-7, 1.9e-9)
OCAM_MIRROR = (-250.0, 0.0, 1.5e-3, 1.0e-7)

CAMERAS: dict[str, Camera] = {
    "sphere": EquirectangularPanorama(1024, 512),
    "turned sphere": EquirectangularPanorama(1000, 500, azimuth_center=2.0, mount=TILTED),
    "band": EquirectangularPanorama(800, 200, elevation_min=-0.5, elevation_max=0.3),
    "arc": EquirectangularPanorama(300, 200, -0.5, 0.4, azimuth_center=3.0, azimuth_span=1.5),
    "cylinder": CylindricalPanorama(720, 200, -0.6, 0.5, mount=TILTED),
    "pinhole": Perspective(640, 480, 500.0, 510.0, 321.5, 238.25),
    "lens": Perspective(640, 480, 400.0, 405.0, 321.5, 238.25, DISTORTION, mount=TILTED),
    "fisheye": Fisheye(640, 480, 200.0, 201.0, 318.0, 243.0, (-0.02, 0.004, -0.002, 2e-4)),
    "ceiling": Fisheye(600, 600, 150.0, 150.0, 299.5, 300.0, max_angle=2.0, looks="up"),
    "ocam lens": OcamCalib(
        752, 480, 370.2, 236.7, OCAM_LENS, 1.0004, 2e-4, -3e-4, max_angle=1.7, mount=TILTED
    ),
    "ocam mirror": OcamCalib(
        1024, 768, 515.3, 385.1, OCAM_MIRROR, looks="down", mirrored=True, max_angle=1.9
    ),
    "mirror": HyperbolicMirror(
        640,
        480,
        0.97,
        260.0,
        261.0,
        322.0,
        238.0,
        (-0.05, 0.01, 1e-3, -5e-4),
        elevation_min=-1.4,
        elevation_max=0.5,
        mount=Mount(pitch=0.05, yaw=3.0),
    ),
    "parabola": HyperbolicMirror(640, 480, 1.0, 180.0, 180.0, 319.5, 239.5, mirrored=False),
    "wide": HyperbolicMirror(640, 480, 1.6, 700.0, 700.0, 319.5, 239.5),
}


@pytest.fixture(params=CAMERAS.values(), ids=CAMERAS.keys())
def camera(request: pytest.FixtureRequest) -> Camera:
    return request.param  # type: ignore[no-any-return]


def pixels_in(camera: Camera, n: int = 2000, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    size = (camera.width, camera.height)
    pixels = rng.uniform(0.0, 1.0, (n, 2)) * size - 0.5
    corners = np.array([[-0.5, -0.5], [size[0] - 0.5, size[1] - 0.5], [0.0, 0.0]])
    return np.concatenate([pixels, corners])


def test_bearings_come_back(camera: Camera) -> None:
    azimuth, elevation = camera.bearings(pixels_in(camera))
    seen = np.isfinite(azimuth)
    assert seen.mean() > 0.4
    assert np.array_equal(seen, np.isfinite(elevation))
    assert ((azimuth[seen] >= 0.0) & (azimuth[seen] < 2 * np.pi)).all()
    azimuth, elevation = azimuth[seen], elevation[seen]
    pixels = camera.project(azimuth, elevation)
    again = camera.bearings(pixels)
    error = bearing_vectors(*again) - bearing_vectors(azimuth, elevation)
    assert np.abs(error).max() < 1e-9


def test_pixels_come_back(camera: Camera) -> None:
    pixels = pixels_in(camera)[:2000]  # without the corners: at a pole any column is right
    azimuth, elevation = camera.bearings(pixels)
    seen = np.isfinite(azimuth)
    difference = camera.project(azimuth[seen], elevation[seen]) - pixels[seen]
    if camera.horizontally_periodic:
        period = camera.width
        difference[:, 0] = (difference[:, 0] + period / 2) % period - period / 2
    assert seen.mean() > 0.4
    assert np.abs(difference).max() < 1e-6


def test_bearings_from_anywhere_are_seen_or_nan(camera: Camera) -> None:
    """Over the whole sphere: what is projected lies in the image and comes back."""
    rng = np.random.default_rng(1)
    vectors = rng.normal(size=(20000, 3))
    azimuth = np.arctan2(vectors[:, 1], vectors[:, 0])
    elevation = np.arctan2(vectors[:, 2], np.hypot(vectors[:, 0], vectors[:, 1]))
    pixels = camera.project(azimuth, elevation)
    seen = np.isfinite(pixels).all(axis=1)
    assert seen.any()
    assert np.isnan(pixels[~seen]).all()
    again = camera.bearings(pixels[seen])
    expected = bearing_vectors(azimuth[seen], elevation[seen])
    assert np.abs(bearing_vectors(*again) - expected).max() < 1e-9


def test_full_panorama_convention() -> None:
    camera = EquirectangularPanorama(8, 4)
    assert camera.horizontally_periodic
    azimuth, elevation = camera.bearings([[3.5, 1.5], [1.5, 1.5], [5.5, 1.5], [3.5, -0.5]])
    assert azimuth == pytest.approx([0.0, np.pi / 2, 3 * np.pi / 2, 0.0], abs=1e-12)
    assert elevation == pytest.approx([0.0, 0.0, 0.0, np.pi / 2], abs=1e-12)
    first, _ = camera.bearings([[0.0, 2.0]])
    assert first == pytest.approx([np.pi - np.pi / 8])
    # columns beyond a side continue on the other
    beyond, _ = camera.bearings([[8.0, 2.0]])
    assert beyond == pytest.approx(first)
    assert CylindricalPanorama(8, 4).bearings([[3.5, -0.5]])[1] == pytest.approx([np.pi / 4])


def test_partial_panorama_has_sides() -> None:
    camera = EquirectangularPanorama(100, 50, -0.4, 0.4, azimuth_span=2.0)
    assert not camera.horizontally_periodic
    assert np.isnan(camera.project([1.1, -1.1, np.pi], [0.0, 0.0, 0.0])).all()
    assert np.isnan(camera.project([0.0, 0.0], [0.41, -0.41])).all()
    assert np.isnan(camera.bearings([[100.0, 20.0], [20.0, 50.0]])[0]).all()


def test_pinhole_convention() -> None:
    camera = Perspective(1226, 370, 707.0912, 707.0912, 601.8873, 183.1104)
    pixels = np.array([[0.0, 0.0], [601.8873, 183.1104], [1225.0, 369.0]])
    vectors = bearing_vectors(*camera.bearings(pixels))
    expected = np.stack(
        [np.ones(3), -(pixels[:, 0] - 601.8873) / 707.0912, -(pixels[:, 1] - 183.1104) / 707.0912],
        axis=1,
    )
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    assert np.abs(vectors - expected).max() < 1e-12


def test_perspective_projects_as_opencv() -> None:
    camera = Perspective(640, 480, 400.0, 405.0, 321.5, 238.25, DISTORTION)
    rng = np.random.default_rng(2)
    points = np.stack(
        [np.ones(500), rng.uniform(-0.6, 0.6, 500), rng.uniform(-0.5, 0.5, 500)], axis=1
    )
    opencv_points = np.stack([-points[:, 1], -points[:, 2], points[:, 0]], axis=1)
    matrix = np.array([[400.0, 0.0, 321.5], [0.0, 405.0, 238.25], [0.0, 0.0, 1.0]])
    expected, _ = cv2.projectPoints(
        opencv_points, np.zeros(3), np.zeros(3), matrix, np.array(DISTORTION)
    )
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    elevation = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
    pixels = camera.project(azimuth, elevation)
    seen = np.isfinite(pixels[:, 0])
    assert seen.sum() > 300
    assert np.abs(pixels - expected[:, 0])[seen].max() < 1e-9


def test_behind_the_camera_or_the_fold_is_nothing() -> None:
    camera = Perspective(640, 480, 400.0, 400.0, 319.5, 239.5, (-0.4, 0.0, 0.0, 0.0))
    # the radial distortion turns back at sqrt(1 / 1.2); farther out would fall inside again
    azimuth = np.arctan([0.5, 0.9, 0.95, 1.5, 1e9])
    seen = np.isfinite(camera.project(azimuth, np.zeros(5))[:, 0])
    assert seen.tolist() == [True, True, False, False, False]
    assert np.isnan(camera.project([np.pi], [0.0])).all()


def test_mount_turns_the_camera() -> None:
    pixel = [[1.5, 1.5]]
    for mount, azimuth, elevation in [
        (Mount(yaw=0.3), 0.3, 0.0),
        (Mount(pitch=0.3), 0.0, -0.3),
        (Mount(roll=0.3), 0.0, 0.0),
        (Mount(yaw=0.2, pitch=-0.1, roll=1.0, height=2.0), 0.2, 0.1),
    ]:
        got = Perspective(4, 4, 2.0, 2.0, 1.5, 1.5, mount=mount).bearings(pixel)
        assert np.ravel(wrap_to_pi(got)) == pytest.approx([azimuth, elevation], abs=1e-12)
    rolled = Perspective(4, 4, 2.0, 2.0, 1.5, 1.5, mount=Mount(roll=np.pi / 2))
    # leaning to the right by a quarter turn, the image's left points up
    azimuth, elevation = rolled.bearings([[-0.5, 1.5]])
    assert (azimuth[0], elevation[0]) == pytest.approx((0.0, np.pi / 4), abs=1e-12)
    rotation = TILTED.rotation()
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-15
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_file_round_trip(camera: Camera, tmp_path: Path) -> None:
    path = tmp_path / "camera.toml"
    camera.save(path)
    assert [item.name for item in tmp_path.iterdir()] == ["camera.toml"]
    again = load_camera(path)
    assert type(again) is type(camera)
    assert again.horizontally_periodic == camera.horizontally_periodic
    pixels = pixels_in(camera, 50)
    before, after = camera.bearings(pixels), again.bearings(pixels)
    for a, b in zip(before, after, strict=True):
        assert np.abs(wrap_to_pi(a - b))[np.isfinite(a)].max() < 1e-12
    assert again.mount.height == camera.mount.height


PINHOLE = """\
model = "perspective"
width = 640
height = 480
fx = 500
fy = 510.5
cx = 320.0
cy = 240.0
"""


def test_file_by_hand(tmp_path: Path) -> None:
    path = tmp_path / "camera.toml"
    path.write_text(PINHOLE + "[mount]\npitch_deg = 90\n")
    camera = load_camera(path)
    assert camera == Perspective(
        640, 480, 500.0, 510.5, 320.0, 240.0, mount=Mount(pitch=math.pi / 2)
    )


@pytest.mark.parametrize(
    ("text", "key", "wanted"),
    [
        (PINHOLE + "fokal = 3\n", "fokal", "allowed: model, width, height, fx"),
        (PINHOLE + "fokal = 3\n", "fokal", ", [mount])"),
        (
            PINHOLE + "[mount]\npitch = 3\n",
            "mount.pitch",
            "(allowed: mount.yaw_deg, mount.pitch_deg",
        ),
        (PINHOLE.replace("fx = 500\n", ""), "fx", "missing key"),
        (PINHOLE.replace("500", "nan"), "fx", "finite"),
        (PINHOLE.replace("500", "inf"), "fx", "finite"),
        (PINHOLE.replace("500", '"500"'), "fx", "number"),
        (PINHOLE.replace("500", "true"), "fx", "number"),
        (PINHOLE.replace("500", "-1"), "fx", "more than 0"),
        (PINHOLE.replace("640", "640.0"), "width", "positive integer"),
        (PINHOLE.replace("640", "0"), "width", "positive integer"),
        (PINHOLE + "distortion = [1, 2, 3]\n", "distortion", "5 or 4 numbers"),
        (PINHOLE + "distortion = [1, 2, 3, nan]\n", "distortion", "finite"),
        (PINHOLE + "distortion = 0.1\n", "distortion", "list"),
        (PINHOLE + "mount = 3\n", "mount", "table"),
        (PINHOLE + "[mount]\nheight = nan\n", "mount.height", "finite"),
        (PINHOLE.replace("perspective", "pinhole"), "model", "perspective"),
        ("width = 3\n", "model", "no such key"),
        ("width = \n", "TOML", "line 1"),
        (
            'model = "equirectangular"\nwidth = 4\nheight = 2\nelevation_min_deg = 95\n',
            "elevation_min",
            "min < max",
        ),
        (
            'model = "equirectangular"\nwidth = 4\nheight = 2\nazimuth_span_deg = 361\n',
            "azimuth_span",
            "2 pi",
        ),
        (
            'model = "cylindrical"\nwidth = 4\nheight = 2\nelevation_max_deg = 90\n',
            "elevation_max",
            "less than pi/2",
        ),
    ],
)
def test_bad_file(tmp_path: Path, text: str, key: str, wanted: str) -> None:
    path = tmp_path / "camera.toml"
    path.write_text(text)
    with pytest.raises(ValueError) as caught:
        load_camera(path)
    message = str(caught.value)
    assert str(path) in message
    assert key in message
    assert wanted in message
    assert "\n" not in message


def test_file_that_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "camera.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match="not a TOML file"):
        load_camera(path)
    with pytest.raises(OSError, match="nothing"):
        load_camera(tmp_path / "nothing.toml")


def test_misuse_in_python() -> None:
    with pytest.raises(ValueError, match="width: expected a positive integer"):
        EquirectangularPanorama(0, 10)
    with pytest.raises(ValueError, match="azimuth_center: expected a finite"):
        EquirectangularPanorama(20, 10, azimuth_center=float("nan"))
    with pytest.raises(ValueError, match="mount: expected a Mount"):
        EquirectangularPanorama(20, 10, mount=0.3)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="Mount: yaw"):
        Mount(yaw=float("inf"))
    camera = EquirectangularPanorama(np.int64(20), 10, azimuth_center=np.float64(0.5))
    assert type(camera.width) is int
    assert type(camera.azimuth_center) is float
    with pytest.raises(ValueError, match=r"expected shape \(n, 2\)"):
        camera.bearings([1.0, 2.0])
    with pytest.raises(ValueError, match="expected two arrays"):
        camera.project([1.0, 2.0], [1.0])
    azimuth, elevation = camera.bearings(np.empty((0, 2)))
    assert azimuth.size == elevation.size == 0
    assert camera.project([], []).shape == (0, 2)
