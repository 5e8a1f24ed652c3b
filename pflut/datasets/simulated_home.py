"""The simulated home: rendered once, then a folder dataset like any other."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pflut._cache import cache_dir as user_cache_dir
from pflut.camera.equirectangular import EquirectangularPanorama
from pflut.camera.mount import Mount
from pflut.datasets.base import Dataset
from pflut.datasets.folder import load_folder, write_folder
from pflut.geometry import FloatArray
from pflut.simulation.drive import Drive, plan_mapping_drive, plan_test_drive
from pflut.simulation.home import Home, check_seed
from pflut.simulation.lighting import Lighting, LightMap, make_light_map
from pflut.simulation.odometry import simulate_odometry
from pflut.simulation.people import Walkers
from pflut.simulation.renderer import render_panorama

#: Counts the changes that make other pictures; a part of the cache folder's name.
RENDERER_VERSION = 2

CAMERA = EquirectangularPanorama(
    768,
    192,
    elevation_min=float(np.radians(-40.0)),
    elevation_max=float(np.radians(50.0)),
    mount=Mount(height=1.2),
)
# the mapping drive: a bright day, the lamps are off
MAPPING_LIGHT = Lighting(sky=1.0, lamps=(0.0,), exposure=1.0)
DAY = 86400.0  # seconds between the two drives
BLUR_SAMPLES = 5  # views that a blurred image is the mean of


def load_simulated_home(
    seed: int = 0,
    *,
    people: int = 0,
    motion_blur: float = 0.0,
    cache_dir: str | os.PathLike[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Load the drives through a simulated home; they are rendered at the first call.

    The references are the images of a mapping drive through all rooms on a bright day. The
    queries are those of a test drive on another day: some small objects have moved, lamps are
    on, there is less daylight, and the camera is exposed otherwise.

    Parameters
    ----------
    seed : int
        Of the home and everything in it; not negative.
    people : int
        How many people walk about during the test drive.
    motion_blur : float
        Exposure of the test drive's images in seconds; 0 is no blur.
    cache_dir : path, optional
        Where rendered homes are kept; the user's cache folder if not given.
    progress : callable, optional
        Called as ``progress(images rendered, images)`` while rendering.

    Returns
    -------
    Dataset
        With ground truth for all images and odometry for the test drive.

    Raises
    ------
    ValueError
        If a number is malformed or negative.
    """
    check_seed(seed, "seed")
    check_seed(people, "people")
    blur = float(motion_blur)
    if not 0.0 <= blur < 1.0:
        raise ValueError(f"motion_blur: expected seconds in [0, 1), got {motion_blur!r}")
    folder = _folder(seed, people, blur, cache_dir)
    if not folder.is_dir():
        try:
            render_simulated_home(folder, seed, people=people, motion_blur=blur, progress=progress)
        except OSError:
            # another process may have been faster: its pictures are the same
            if not folder.is_dir():
                raise
    return load_folder(folder)


def is_rendered(seed: int = 0) -> bool:
    """Say whether a home without people and blur is in the user's cache folder."""
    return _folder(seed, 0, 0.0, None).is_dir()


def _folder(seed: int, people: int, blur: float, cache_dir: str | os.PathLike[str] | None) -> Path:
    root = (user_cache_dir() if cache_dir is None else Path(cache_dir)) / "simulated-home"
    return root / f"v{RENDERER_VERSION}-seed{seed}-people{people}-blur{blur:g}"


def render_simulated_home(
    path: str | os.PathLike[str],
    seed: int = 0,
    *,
    people: int = 0,
    motion_blur: float = 0.0,
    camera: EquirectangularPanorama = CAMERA,
    max_images: int | None = None,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Render the drives through a simulated home into a new folder.

    Parameters
    ----------
    path : path
        The folder to create. It appears when everything is rendered.
    seed, people, motion_blur, progress
        See ``load_simulated_home``.
    camera : EquirectangularPanorama
        All around and upright.
    max_images : int, optional
        Of each drive, the first ones: for a quick look.
    threads : int, optional
        All cores if not given. The pictures do not depend on it.

    Returns
    -------
    Path
        The folder.
    """
    mapped = Home.generate(seed)
    later = Home.generate(seed, rearrangement=1)
    mapping = plan_mapping_drive(mapped, rng=np.random.default_rng([seed, 10]))
    test = plan_test_drive(later, rng=np.random.default_rng([seed, 11]))
    rng = np.random.default_rng([seed, 12])
    evening = test_light(rng)
    walkers = Walkers.plan(later, people, rng=np.random.default_rng([seed, 13]))
    references, queries = mapping.images[:max_images], test.images[:max_images]
    odometry = simulate_odometry(test.path.poses[queries], rng=np.random.default_rng([seed, 14]))

    def jobs() -> Iterator[Callable[[], NDArray[np.uint8]]]:
        light_map = make_light_map(mapped, MAPPING_LIGHT)
        for k, point in enumerate(references):
            pose = mapping.path.poses[point]
            yield _job(mapped, pose[None], camera, MAPPING_LIGHT, light_map, [seed, 20, k])
        light_map = make_light_map(later, evening)
        for k, point in enumerate(queries):
            poses = _poses_of_exposure(test, int(point), motion_blur)
            with_people = walkers.light_map(
                light_map, float(test.path.stamps[point]), test.path.poses[point]
            )
            yield _job(later, poses, camera, evening, with_people, [seed, 21, k])

    truth = np.concatenate([mapping.path.poses[references], test.path.poses[queries]])
    unknown = np.full((len(references), 3), np.nan)
    return write_folder(
        path,
        camera=camera,
        stamps=np.concatenate([mapping.path.stamps[references], DAY + test.path.stamps[queries]]),
        images=_in_order(jobs(), threads or os.cpu_count() or 1),
        ground_truth=truth,
        odometry=np.concatenate([unknown, odometry]),
        reference_indices=np.arange(len(references)),
        floor_plan=mapped.walls,
        name=f"Simulated home {seed}",
        suffix=".jpg",
        progress=progress,
    )


def test_light(rng: np.random.Generator) -> Lighting:
    """Draw the light of the other day: less daylight, some lamps on, another exposure.

    Parameters
    ----------
    rng : Generator

    Returns
    -------
    Lighting
    """
    lamps = np.where(rng.random(24) < 0.7, rng.uniform(0.7, 1.0, 24), 0.0)
    return Lighting(
        sky=float(rng.uniform(0.05, 0.35)),
        lamps=tuple(float(v) for v in lamps),
        exposure=float(rng.uniform(0.9, 1.4)),
        warmth=float(rng.uniform(-0.03, 0.08)),
        shot_noise=6e-3,
    )


def _job(
    home: Home,
    poses: FloatArray,
    camera: EquirectangularPanorama,
    lighting: Lighting,
    light_map: LightMap,
    key: list[int],
) -> Callable[[], NDArray[np.uint8]]:
    """Make the task of rendering one image, in the channel order that is written."""

    def render() -> NDArray[np.uint8]:
        image = render_panorama(
            home,
            poses[0],
            camera,
            lighting,
            light_map=light_map,
            blur_poses=poses,
            rng=np.random.default_rng(key),
        )
        return np.ascontiguousarray(image[..., ::-1])

    return render


def _poses_of_exposure(drive: Drive, point: int, exposure: float) -> FloatArray:
    """Give the poses during an exposure around a point of a path, shape (k, 3)."""
    if exposure == 0.0:
        return np.asarray(drive.path.poses[point][None])
    times = drive.path.stamps[point] + np.linspace(-0.5, 0.5, BLUR_SAMPLES) * exposure
    return drive.path.interpolate(np.clip(times, drive.path.stamps[0], drive.path.stamps[-1]))


def _in_order(
    jobs: Iterator[Callable[[], NDArray[np.uint8]]], threads: int
) -> Iterator[NDArray[np.uint8]]:
    """Run tasks on threads and give their results in order, never far ahead."""
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[NDArray[np.uint8]]] = deque()
        for job in jobs:
            waiting.append(pool.submit(job))
            if len(waiting) > 2 * threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
