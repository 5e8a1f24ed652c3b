"""Fisheye, mirror and polynomial cameras against oracles, and unwrapping."""

from __future__ import annotations

import cv2
import naive
import numpy as np
import pytest

from pflut.camera import (
    CylindricalPanorama,
    EquirectangularPanorama,
    Fisheye,
    HyperbolicMirror,
    Mount,
    OcamCalib,
    Perspective,
    Unwrapper,
    default_panorama,
    unwrap_maps,
)
from pflut.features import FeatureExtractor
from pflut.geometry import bearing_angles, bearing_vectors

DOWN, UP = -np.pi / 2, np.pi / 2


def test_fisheye_projects_as_opencv() -> None:
    k = (-0.02, 0.004, -0.002, 2e-4)
    camera = Fisheye(640, 480, 200.0, 201.0, 318.0, 243.0, k)
    rng = np.random.default_rng(0)
    points = np.column_stack([np.ones(800), rng.uniform(-3, 3, 800), rng.uniform(-2, 2, 800)])
    opencv_points = np.column_stack([-points[:, 1], -points[:, 2], points[:, 0]])
    matrix = np.array([[200.0, 0.0, 318.0], [0.0, 201.0, 243.0], [0.0, 0.0, 1.0]])
    expected, _ = cv2.fisheye.projectPoints(
        opencv_points[:, None], np.zeros(3), np.zeros(3), matrix, np.array(k)
    )
    pixels = camera.project(*bearing_angles(points))
    seen = np.isfinite(pixels[:, 0])
    assert seen.sum() > 400
    assert np.abs(pixels - expected[:, 0])[seen].max() < 1e-9


def test_fisheye_sees_behind() -> None:
    camera = Fisheye(1000, 1000, 150.0, 150.0, 499.5, 499.5, max_angle=np.deg2rad(110))
    azimuth = np.deg2rad([100.0, -109.0, 111.0, 180.0])
    pixels = camera.project(azimuth, np.zeros(4))
    assert pixels[0] == pytest.approx([499.5 - 150.0 * np.deg2rad(100.0), 499.5])
    assert pixels[1] == pytest.approx([499.5 + 150.0 * np.deg2rad(109.0), 499.5])
    assert np.isnan(pixels[2:]).all()
    assert np.isnan(camera.bearings([[0.0, 0.0]])[0]).all()


def test_fisheye_ends_where_the_polynomial_folds() -> None:
    camera = Fisheye(1000, 1000, 150.0, 150.0, 499.5, 499.5, (-0.1, 0.0, 0.0, 0.0))
    fold = np.sqrt(1.0 / 0.3)
    pixels = camera.project([fold - 0.01, fold + 0.01], [0.0, 0.0])
    assert np.isfinite(pixels[0]).all()
    assert np.isnan(pixels[1]).all()


@pytest.mark.parametrize("xi", [0.6, 0.97, 1.0, 1.6])
def test_mirror_as_naive(xi: float) -> None:
    k = (-0.05, 0.01, 1e-3, -5e-4)
    camera = HyperbolicMirror(640, 480, xi, 260.0, 261.0, 322.0, 238.0, k)
    rng = np.random.default_rng(1)
    vectors = rng.normal(size=(400, 3))
    pixels = camera.project(*bearing_angles(vectors))
    seen = np.isfinite(pixels[:, 0])
    assert seen.sum() > 60
    for (x, y, z), pixel in zip(vectors[seen], pixels[seen], strict=True):
        # in the image: right is the robot's left, the lower border behind, the middle below
        px, py = naive.unified_projection((y, -x, -z), xi, k)
        assert pixel == pytest.approx((260.0 * px + 322.0, 261.0 * py + 238.0), abs=1e-9)


def test_mirror_convention() -> None:
    """Forward at the upper border, left at the right border, the robot in the middle."""
    camera = HyperbolicMirror(401, 401, 0.9, 200.0, 200.0, 200.0, 200.0, elevation_max=0.3)
    azimuth, elevation = camera.bearings([[200.0, 40.0], [360.0, 200.0], [200.0, 200.0]])
    assert azimuth[:2] == pytest.approx([0.0, np.pi / 2])
    assert elevation[0] == pytest.approx(elevation[1])
    assert elevation[2] == pytest.approx(DOWN)
    flipped = HyperbolicMirror(401, 401, 0.9, 200.0, 200.0, 200.0, 200.0, mirrored=False)
    assert flipped.bearings([[360.0, 200.0]])[0] == pytest.approx([3 * np.pi / 2])
    assert np.isnan(camera.project([0.0], [0.31])).all()
    # the projection is at infinity where sin(elevation) = xi, whatever the ring
    flat = HyperbolicMirror(10**9, 10**9, 0.9, 1.0, 1.0, 5e8, 5e8)
    limit = np.arcsin(0.9)
    seen = np.isfinite(flat.project([0.0, 0.0], [limit - 0.01, limit + 0.01])[:, 0])
    assert seen.tolist() == [True, False]


@pytest.mark.parametrize("eccentricity", [1.1, 1.25, 2.0])
def test_mirror_is_a_hyperbola_seen_by_a_pinhole(eccentricity: float) -> None:
    """The rays reflected at the mirror itself, up to the focal length."""
    e = eccentricity
    # the upper focus at the origin, the pinhole in the lower one, half axis 1
    elevation = np.linspace(-1.3, np.arcsin(1.0 / e) - 0.1, 20)
    radius = (e * e - 1.0) / (1.0 - e * np.sin(elevation))
    ideal = radius * np.cos(elevation) / (radius * np.sin(elevation) + 2.0 * e)
    xi = 2.0 * e / (1.0 + e * e)
    camera = HyperbolicMirror(4001, 4001, xi, 300.0, 300.0, 2000.0, 2000.0)
    pixels = camera.project(np.full(20, np.pi), elevation) - 2000.0
    assert np.abs(pixels[:, 0]).max() < 1e-9
    assert pixels[:, 1] / ideal == pytest.approx(pixels[0, 1] / ideal[0], rel=1e-12)


def test_ocam_as_naive() -> None:
    polynomial = (-280.5, 0.0, 9.1e-4, -8.0e-7, 1.9e-9)
    c, d, e = 1.0004, 2e-4, -3e-4
    camera = OcamCalib(752, 480, 370.2, 236.7, polynomial, c, d, e)
    rng = np.random.default_rng(2)
    pixels = rng.uniform((0, 0), (751, 479), (300, 2))
    vectors = bearing_vectors(*camera.bearings(pixels))
    for (u, v), vector in zip(pixels, vectors, strict=True):
        row, column, depth = naive.ocam_ray(u, v, (370.2, 236.7), polynomial, (c, d, e))
        expected = np.array([-depth, -column, -row])
        assert vector == pytest.approx(expected / np.linalg.norm(expected), abs=1e-12)


def test_ocam_mirror_convention() -> None:
    camera = OcamCalib(1024, 768, 511.5, 383.5, (-250.0, 0.0, 1.5e-3), looks="down", mirrored=True)
    azimuth, elevation = camera.bearings([[511.5, 83.5], [811.5, 383.5], [511.5, 383.5]])
    assert azimuth[:2] == pytest.approx([0.0, np.pi / 2])
    assert elevation[:2] == pytest.approx(np.arctan2(-250.0 + 1.5e-3 * 9e4, 300.0))
    assert elevation[2] == pytest.approx(DOWN)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: OcamCalib(10, 10, 5.0, 5.0, (3.0, 0.0)), "negative first"),
        (lambda: OcamCalib(10, 10, 5.0, 5.0, ()), "at least 1 numbers"),
        (lambda: OcamCalib(10, 10, 5.0, 5.0, (-3.0,), c=0.0), "c - d e"),
        (lambda: OcamCalib(10, 10, 5.0, 5.0, (-3.0,), looks="left"), "forward, down, up"),
        (lambda: Fisheye(10, 10, 5.0, 5.0, 5.0, 5.0, looks="left"), "forward, down, up"),
        (lambda: Fisheye(10, 10, 5.0, 5.0, 5.0, 5.0, max_angle=0.0), "max_angle"),
        (lambda: HyperbolicMirror(10, 10, -1.0, 5.0, 5.0, 5.0, 5.0), "xi"),
        (
            lambda: HyperbolicMirror(
                10, 10, 1.0, 5.0, 5.0, 5.0, 5.0, elevation_min=1.0, elevation_max=0.0
            ),
            "min < max",
        ),
        (
            lambda: HyperbolicMirror(10, 10, 1.0, 5.0, 5.0, 5.0, 5.0, mirrored=1),  # type: ignore
            "true or false",
        ),
    ],
)
def test_bad_parameters(make: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()  # type: ignore[operator]


def scene(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """A smooth gray value for every bearing, in the robot frame."""
    x, y, z = bearing_vectors(azimuth, elevation).T
    waves = np.sin(9 * x + 2) * np.sin(8 * y + 1) + np.sin(7 * z + 4 * x * y)
    return np.clip(127.5 + 60.0 * waves, 0, 255)


def picture(camera) -> np.ndarray:
    """What the camera sees of the scene; black where it sees nothing."""
    v, u = np.mgrid[: camera.height, : camera.width]
    azimuth, elevation = camera.bearings(np.column_stack([u.ravel(), v.ravel()]))
    seen = np.isfinite(azimuth)
    gray = np.where(seen, scene(np.nan_to_num(azimuth), np.nan_to_num(elevation)), 0.0)
    return gray.round().astype(np.uint8).reshape(u.shape)


@pytest.mark.parametrize(
    ("source", "target"),
    [
        (
            HyperbolicMirror(
                800,
                800,
                0.95,
                270.0,
                270.0,
                399.5,
                399.5,
                elevation_min=-1.3,
                mount=Mount(pitch=0.1),
            ),
            EquirectangularPanorama(512, 96, -0.9, 0.2),
        ),
        (
            OcamCalib(900, 900, 449.5, 449.5, (-250.0, 0.0, 1.5e-3), looks="down", mirrored=True),
            CylindricalPanorama(600, 120, -0.8, 0.2, azimuth_center=1.0),
        ),
        (
            EquirectangularPanorama(1024, 512, mount=Mount(pitch=0.2, roll=-0.1, yaw=0.5)),
            EquirectangularPanorama(512, 256),
        ),
        (
            Fisheye(800, 800, 220.0, 220.0, 399.5, 399.5, looks="up"),
            EquirectangularPanorama(512, 128, 0.1, 1.3),
        ),
    ],
)
def test_unwrapped_is_what_the_panorama_would_see(source, target) -> None:
    unwrapper = Unwrapper(source, target)
    assert unwrapper.panorama is target
    assert unwrapper.mask.mean() > 0.5
    got, expected = unwrapper(picture(source)), picture(target)
    assert got.shape == expected.shape
    difference = np.abs(got.astype(int) - expected)[unwrapper.mask]
    assert np.median(difference) <= 1
    assert np.percentile(difference, 99.5) <= 3
    map_u, map_v = source.unwrap_maps(target)
    again = unwrap_maps(source, target)
    assert np.array_equal(map_u, again[0], equal_nan=True)
    assert np.array_equal(map_v, again[1], equal_nan=True)
    assert map_u.dtype == np.float32


def test_unseen_is_black_and_masked() -> None:
    source = Perspective(320, 240, 200.0, 200.0, 159.5, 119.5)
    unwrapper = Unwrapper(source, EquirectangularPanorama(360, 180), margin=3)
    image = unwrapper(np.full((240, 320), 200, np.uint8))
    azimuth, _ = unwrapper.panorama.bearings([[0.0, 90.0], [180.0, 90.0]])
    assert image[90, 0] == 0 and image[90, 180] == 200
    assert abs(azimuth[0]) > 3.0
    assert (image[unwrapper.mask] == 200).all()
    assert 0 < unwrapper.mask.sum() < (image > 0).sum()
    # where stripes meet the border there are features, unless they are masked
    stripes = np.repeat(np.where(np.arange(320) // 20 % 2, 80, 200)[None], 240, axis=0)
    image = unwrapper(stripes.astype(np.uint8))
    options = {"similarity_threshold": 0, "contrast_threshold": 0.01}
    border = cv2.dilate((image == 0).astype(np.uint8), np.ones((7, 7))) > 0

    def on_border(**mask: np.ndarray) -> int:
        found = FeatureExtractor(unwrapper.panorama, **options, **mask)(image)
        u, v = found.pixels.round().astype(int).T
        return int(border[v, u].sum())

    assert on_border() > 0
    assert on_border(mask=unwrapper.mask) == 0
    color = unwrapper(np.zeros((240, 320, 3), np.uint8))
    assert color.shape == (180, 360, 3)
    with pytest.raises(ValueError, match="image: expected shape"):
        unwrapper(np.zeros((10, 10), np.uint8))


def test_default_panorama() -> None:
    ring = {"elevation_min": -1.0, "elevation_max": 0.3}
    mirror = HyperbolicMirror(800, 800, 0.95, 230.0, 230.0, 399.5, 399.5, **ring)
    panorama = default_panorama(mirror, width=720)
    assert panorama.horizontally_periodic
    assert panorama.elevation_min == pytest.approx(-1.0, abs=0.02)
    assert panorama.elevation_max == pytest.approx(0.3, abs=0.02)
    assert panorama.height == pytest.approx(720 * 1.3 / (2 * np.pi), abs=3)
    assert Unwrapper(mirror).panorama.width == 1024
    whole = default_panorama(EquirectangularPanorama(64, 32))
    assert (whole.elevation_min, whole.elevation_max) == pytest.approx((DOWN, UP))
    with pytest.raises(ValueError, match="Perspective: does not see all around"):
        default_panorama(Perspective(320, 240, 200.0, 200.0, 159.5, 119.5))
