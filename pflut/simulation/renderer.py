"""Panoramas of a home."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.camera.equirectangular import EquirectangularPanorama
from pflut.geometry import TWO_PI, FloatArray, as_poses
from pflut.simulation.home import Home, is_inside
from pflut.simulation.layout import CEILING
from pflut.simulation.lighting import Lighting, LightMap, make_light_map
from pflut.simulation.raster import draw_columns, surface_spans
from pflut.simulation.sensor import blurred, develop

LENS_BLUR = 1.1  # pixels
CAMERA_HEIGHT = 1.2  # metres above the floor where the camera's mount says nothing


def render_panorama(
    home: Home,
    pose: ArrayLike,
    camera: EquirectangularPanorama,
    lighting: Lighting | None = None,
    *,
    light_map: LightMap | None = None,
    blur_poses: ArrayLike | None = None,
    lens_blur: float = LENS_BLUR,
    supersampling: int = 2,
    rng: np.random.Generator | int | None = None,
) -> NDArray[np.uint8]:
    """Render what a camera sees at a pose in a home.

    Parameters
    ----------
    home : Home
    pose : array_like of shape (3,)
        The robot's x, y and heading in metres and radians.
    camera : EquirectangularPanorama
        All around, upright (its mount may have a yaw). Its height is 1.2 m if the mount has none.
    lighting : Lighting, optional
        A bright day if not given.
    light_map : LightMap, optional
        Of this home and lighting, made by ``make_light_map``; made here if not given, which takes
        longer than the picture.
    blur_poses : array_like of shape (k, 3), optional
        Where the robot is during the exposure: the picture is the mean over them instead of the
        one at ``pose``.
    lens_blur : float
        Standard deviation in pixels of the lens's point spread function; 0 is a perfect lens.
    supersampling : int
        Samples along each side of a pixel.
    rng : Generator, int or None
        Of the sensor noise.

    Returns
    -------
    ndarray of shape (height, width, 3) uint8
        Red, green, blue.

    Raises
    ------
    ValueError
        If a pose lies in a wall or outside the home, or the camera is no upright panorama inside
        the room.
    """
    light = Lighting() if lighting is None else lighting
    lights = make_light_map(home, light) if light_map is None else light_map
    poses = as_poses(pose if blur_poses is None else blur_poses, "pose")
    linear = np.mean(
        [render_linear(home, row, camera, lights, supersampling=supersampling) for row in poses],
        axis=0,
    )
    if lens_blur > 0.0:
        linear = blurred(linear, lens_blur)
    noise = np.random.default_rng(rng).standard_normal(linear.shape, dtype=np.float32)
    image = np.empty(linear.shape, dtype=np.uint8)
    develop(linear, light.gain(), light.shot_noise, light.read_noise, noise, image)
    return image


def render_linear(
    home: Home,
    pose: FloatArray,
    camera: EquirectangularPanorama,
    light_map: LightMap,
    *,
    supersampling: int = 2,
) -> NDArray[np.float32]:
    """Render linear light without noise; see ``render_panorama``.

    Returns
    -------
    ndarray of shape (height, width, 3) float32
    """
    lens = _lens(home, pose, camera)
    if supersampling < 1:
        raise ValueError(f"supersampling: expected an integer >= 1, got {supersampling}")
    azimuths, elevations = _sampled_directions(camera, float(pose[2]), supersampling)
    spans = np.empty((len(light_map.surfaces), 3))
    surface_spans(light_map.surfaces, lens, spans)
    order = np.flatnonzero(spans[:, 1] >= 0.0)
    order = order[np.argsort(spans[order, 2], kind="stable")]
    image = np.empty((camera.height, camera.width, 3), dtype=np.float32)
    draw_columns(
        light_map.surfaces,
        spans,
        order,
        np.array([0.0, CEILING]),
        home.scene.atlas.texels,
        home.scene.atlas.levels,
        light_map.values,
        light_map.emission,
        lens,
        azimuths,
        elevations,
        supersampling,
        np.empty((supersampling, elevations.size)),
        np.empty((supersampling, elevations.size), dtype=np.int64),
        image,
    )
    return image


def _lens(home: Home, pose: FloatArray, camera: EquirectangularPanorama) -> FloatArray:
    """Give the lens's position, shape (3,), after checking that it is inside."""
    if not isinstance(camera, EquirectangularPanorama) or not camera.horizontally_periodic:
        raise ValueError(f"camera: expected an EquirectangularPanorama all around, got {camera!r}")
    if camera.mount.pitch != 0.0 or camera.mount.roll != 0.0:
        raise ValueError("camera: the renderer draws upright panoramas, got a mount with a tilt")
    height = camera.mount.height or CAMERA_HEIGHT
    if not 0.0 < height < CEILING:
        raise ValueError(f"camera: its height is {height} m, expected less than {CEILING} m")
    if not is_inside(home, float(pose[0]), float(pose[1])):
        raise ValueError(
            f"pose: ({pose[0]:.3f}, {pose[1]:.3f}) lies in a wall or outside the home, "
            f"expected a point inside a room"
        )
    return np.array([pose[0], pose[1], height])


def _sampled_directions(
    camera: EquirectangularPanorama, heading: float, supersampling: int
) -> tuple[FloatArray, FloatArray]:
    """Give the world azimuths of the sampled columns and the elevations of the sampled rows."""
    columns = (np.arange(camera.width * supersampling) + 0.5) / supersampling
    rows = (np.arange(camera.height * supersampling) + 0.5) / supersampling
    forward = heading + camera.mount.yaw + camera.azimuth_center
    azimuths = forward + np.pi - columns / camera.width * TWO_PI
    span = camera.elevation_max - camera.elevation_min
    return azimuths, camera.elevation_max - rows / camera.height * span
