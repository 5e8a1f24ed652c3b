"""The folder format: images, a camera file and text files of poses.

``camera.toml`` and ``images/`` are needed, and ``groundtruth.tum`` or ``odometry.tum``. Optional
are ``images.txt`` (lines of ``stamp images/name.png``; without it the stem of an image's name is
its stamp), ``references.txt`` (image names, one a line), ``floorplan.csv`` (walls, ``x1,y1,x2,y2``
in metres), ``mask.png`` (white where the images show the world, black what to ignore) and
``dataset.toml`` (``name``, ``mask_elevation_deg``).
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut._files import read_table, read_text, write_text
from pflut.camera.base import Camera
from pflut.camera.files import load_camera
from pflut.datasets.base import Dataset, References
from pflut.geometry import FloatArray
from pflut.trajectory import Trajectory, associate, read_tum, write_tum

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")
_SAME_TIME = 0.02  # seconds
_KEYS = ("name", "mask_elevation_deg")


def load_folder(
    path: str | os.PathLike[str],
    *,
    references: References | None = None,
    max_pose_gap: float = 1.0,
) -> Dataset:
    """Load a folder dataset. The images themselves are read when asked for.

    Parameters
    ----------
    path : path
        The folder.
    references : str, path or sequence of int, optional
        See `Dataset.with_references`. Without it ``references.txt`` decides, and without that
        file every tenth image with a ground truth pose is a reference.
    max_pose_gap : float
        An image between two poses gets the interpolated pose, unless the poses are further apart
        than this, in seconds. It then gets the nearest pose if that is within 0.02 s.

    Returns
    -------
    Dataset

    Raises
    ------
    FileNotFoundError
        Naming the file that is missing, or file and line of an image that is.
    ValueError
        Naming the file, and the line, of what is wrong in it; or if no image has a pose.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder")
    if not (folder / "camera.toml").is_file():
        raise FileNotFoundError(f"{folder}: no camera.toml, expected a folder dataset")
    stamps, image_paths = _list_images(folder)
    ground_truth = _poses_at(folder / "groundtruth.tum", stamps, max_pose_gap)
    odometry = _poses_at(folder / "odometry.tum", stamps, max_pose_gap)
    if ground_truth is None and odometry is None:
        raise FileNotFoundError(
            f"{folder}: no poses, expected groundtruth.tum or odometry.tum (or both)"
        )
    settings = _read_settings(folder / "dataset.toml")
    camera = load_camera(folder / "camera.toml")
    dataset = Dataset(
        name=settings.get("name", folder.resolve().name),
        camera=camera,
        stamps=stamps,
        image_paths=image_paths,
        ground_truth=ground_truth,
        odometry=odometry,
        floor_plan=_read_floor_plan(folder / "floorplan.csv"),
        mask_elevation=settings.get("mask_elevation_deg"),
        mask=_read_mask(folder / "mask.png", camera),
    )
    if references is None:
        listed = folder / "references.txt"
        references = listed if listed.is_file() else "every:10"
    return dataset.with_references(references)


def write_folder(
    path: str | os.PathLike[str],
    *,
    camera: Camera,
    stamps: ArrayLike,
    images: Iterable[NDArray[np.uint8]],
    ground_truth: ArrayLike | None = None,
    odometry: ArrayLike | None = None,
    reference_indices: ArrayLike | None = None,
    floor_plan: ArrayLike | None = None,
    mask_elevation: tuple[float, float] | None = None,
    mask: ArrayLike | None = None,
    name: str | None = None,
    suffix: str = ".png",
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a folder dataset, which `load_folder` reads back.

    Everything goes to a temporary folder beside ``path`` that is renamed at the end: a run that
    is interrupted leaves no half dataset.

    Parameters
    ----------
    path : path
        The folder to create; it must not exist, or be empty.
    camera : Camera
        It took the images.
    stamps : array_like of shape (n,)
        Seconds, strictly increasing.
    images : iterable of n ndarrays, (height, width) or (height, width, 3), uint8
        Grey or BGR; may be a generator, one image is held at a time.
    ground_truth, odometry : array_like of shape (n, 3), optional
        NaN rows are left out.
    reference_indices : array_like of int, optional
        Which images are references.
    floor_plan : array_like of shape (s, 2, 2), optional
        Wall segments, metres.
    mask_elevation : (float, float), optional
        Radians, see `Dataset`.
    mask : array_like of shape (height, width), optional
        Zero (or False) at the pixels to ignore.
    name : str, optional
        The folder's name if not given.
    suffix : {".png", ".jpg", ".jpeg"}
        The format of the images.
    progress : callable, optional
        Called as ``progress(images written, n)``.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    FileExistsError
        If the folder holds something already.
    ValueError
        If the parts do not fit each other, or an image has another size than the camera's.
    """
    target = Path(path)
    if suffix not in IMAGE_SUFFIXES:
        raise ValueError(f"suffix: expected one of {', '.join(IMAGE_SUFFIXES)}, got {suffix!r}")
    if target.exists() and not (target.is_dir() and not any(target.iterdir())):
        raise FileExistsError(f"{target}: exists already and is not an empty folder")
    times = np.atleast_1d(np.asarray(stamps, dtype=np.float64))
    names = tuple(Path(f"{i:06d}{suffix}") for i in range(len(times)))
    # the dataset's own checks, before anything is written
    dataset = Dataset(
        name=target.name if name is None else name,
        camera=camera,
        stamps=times,
        image_paths=names,
        ground_truth=None if ground_truth is None else np.asarray(ground_truth, dtype=np.float64),
        odometry=None if odometry is None else np.asarray(odometry, dtype=np.float64),
        reference_indices=np.atleast_1d(
            np.asarray([] if reference_indices is None else reference_indices, dtype=np.intp)
        ),
        floor_plan=None if floor_plan is None else np.asarray(floor_plan, dtype=np.float64),
        mask_elevation=mask_elevation,
        mask=None if mask is None else np.asarray(mask) != 0,
    )
    if dataset.ground_truth is None and dataset.odometry is None:
        raise ValueError("ground_truth, odometry: expected one of them or both")
    target.parent.mkdir(parents=True, exist_ok=True)
    staging = target.with_name(f".{target.name}.{secrets.token_hex(4)}")
    (staging / "images").mkdir(parents=True)
    try:
        _write_images(staging / "images", dataset, images, progress)
        if dataset.mask is not None:
            _write_image(staging / "mask.png", np.where(dataset.mask, 255, 0).astype(np.uint8))
        _write_texts(staging, dataset, listed=reference_indices is not None)
        if target.is_dir():
            target.rmdir()
        staging.rename(target)
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return target


def _write_images(
    folder: Path,
    dataset: Dataset,
    images: Iterable[NDArray[np.uint8]],
    progress: Callable[[int, int], None] | None,
) -> None:
    size = (dataset.camera.height, dataset.camera.width)
    written = 0
    for image in images:
        if written == len(dataset):
            raise ValueError(f"images: more than the {len(dataset)} stamps")
        if image.dtype != np.uint8 or image.shape not in (size, (*size, 3)):
            raise ValueError(
                f"images: image {written} is {image.dtype} of shape {image.shape}, expected "
                f"uint8 of shape {size}"
            )
        _write_image(folder / dataset.image_paths[written], image)
        written += 1
        if progress is not None:
            progress(written, len(dataset))
    if written != len(dataset):
        raise ValueError(f"images: only {written} for {len(dataset)} stamps")


def _write_image(path: Path, image: NDArray[np.uint8]) -> None:
    import cv2

    ok, encoded = cv2.imencode(path.suffix, image)
    if not ok:
        raise ValueError(f"{path.name}: cannot be encoded as {path.suffix}")
    path.write_bytes(encoded.tobytes())


def _write_texts(folder: Path, dataset: Dataset, *, listed: bool) -> None:
    dataset.camera.save(folder / "camera.toml")
    stamped = zip(dataset.stamps.tolist(), dataset.image_paths, strict=True)
    lines = "".join(f"{stamp!r} images/{name}\n" for stamp, name in stamped)
    write_text(folder / "images.txt", "# stamp file\n" + lines)
    for name in ("ground_truth", "odometry"):
        poses = getattr(dataset, name)
        if poses is not None:
            known = np.isfinite(poses).all(axis=1)
            if not known.any():
                raise ValueError(f"{name}: every row is NaN")
            trajectory = Trajectory(dataset.stamps[known], poses[known])
            write_tum(folder / f"{name.replace('_', '')}.tum", trajectory)
    if listed:
        names = "".join(f"{dataset.image_paths[i]}\n" for i in dataset.reference_indices)
        write_text(folder / "references.txt", names)
    if dataset.floor_plan is not None:
        walls = dataset.floor_plan.reshape(-1, 4).tolist()
        rows = "".join(",".join(map(repr, wall)) + "\n" for wall in walls)
        write_text(folder / "floorplan.csv", "# x1,y1,x2,y2\n" + rows)
    # a JSON string is a TOML string
    settings = f"name = {json.dumps(dataset.name, ensure_ascii=False)}\n"
    if dataset.mask_elevation is not None:
        low, high = np.degrees(dataset.mask_elevation).tolist()
        settings += f"mask_elevation_deg = [{low!r}, {high!r}]\n"
    write_text(folder / "dataset.toml", settings)


def _list_images(folder: Path) -> tuple[FloatArray, tuple[Path, ...]]:
    """Give the stamps and paths of the images, by images.txt or by their names."""
    listing = folder / "images.txt"
    if listing.is_file():
        return _read_listing(listing)
    found = [p for p in (folder / "images").glob("*") if p.suffix.lower() in IMAGE_SUFFIXES]
    if not found:
        raise FileNotFoundError(f"{folder / 'images'}: no .png or .jpg image")
    stamped = []
    for image in found:
        try:
            stamped.append((float(image.stem), image))
        except ValueError:
            raise ValueError(
                f"{image}: the name is no stamp, expected seconds or an images.txt of "
                "`stamp images/name.png`"
            ) from None
    stamped.sort()
    return np.array([stamp for stamp, _ in stamped]), tuple(image for _, image in stamped)


def _read_listing(listing: Path) -> tuple[FloatArray, tuple[Path, ...]]:
    stamps: list[float] = []
    paths: list[Path] = []
    for number, line in enumerate(read_text(listing).splitlines(), start=1):
        words = line.split(maxsplit=1)
        if not words or words[0].startswith("#"):
            continue
        where = f"{listing}:{number}"
        try:
            stamp, name = float(words[0]), words[1].strip()
        except (ValueError, IndexError):
            raise ValueError(f"{where}: expected `stamp images/name.png`") from None
        if not np.isfinite(stamp) or (stamps and stamp <= stamps[-1]):
            raise ValueError(f"{where}: stamp {stamp} is not after the one before it")
        image = listing.parent / name
        if not image.is_file():
            raise FileNotFoundError(f"{where}: the image {image} is missing")
        stamps.append(stamp)
        paths.append(image)
    if not paths:
        raise ValueError(f"{listing}: no images, expected lines of `stamp images/name.png`")
    return np.array(stamps), tuple(paths)


def _poses_at(path: Path, stamps: FloatArray, max_gap: float) -> FloatArray | None:
    """Give the poses of a file at the images' stamps, NaN rows where it has none."""
    if not path.is_file():
        return None
    trajectory = read_tum(path)
    poses = trajectory.interpolate(stamps, max_gap=max_gap)
    # at the ends and in gaps: stamps that were rounded, or of two clocks that agree as well as that
    unknown = np.flatnonzero(np.isnan(poses[:, 0]))
    image, pose = associate(stamps[unknown], trajectory.stamps, max_difference=_SAME_TIME)
    poses[unknown[image]] = trajectory.poses[pose]
    if np.isnan(poses).all():
        raise ValueError(
            f"{path}: no image has a pose: the images' stamps span {stamps[0]} to {stamps[-1]}, "
            f"the poses' {trajectory.stamps[0]} to {trajectory.stamps[-1]}"
        )
    return poses


def _read_floor_plan(path: Path) -> FloatArray | None:
    if not path.is_file():
        return None
    walls, _ = read_table(path, 4, "x1,y1,x2,y2", separator=",")
    return walls.reshape(-1, 2, 2)


def _read_mask(path: Path, camera: Camera) -> NDArray[np.bool_] | None:
    """Read mask.png: the lighter half of the gray values is white."""
    if not path.is_file():
        return None
    from pflut.features.image import read_image

    image = read_image(path)
    if image.shape != (camera.height, camera.width):
        raise ValueError(
            f"{path}: {image.shape[1]} x {image.shape[0]} pixels, expected the camera's "
            f"{camera.width} x {camera.height}"
        )
    mask = image >= 128
    if not mask.any():
        raise ValueError(f"{path}: all black, expected white where the images show the world")
    return np.asarray(mask)


def _read_settings(path: Path) -> dict[str, Any]:
    """Read dataset.toml, the elevations in radians."""
    if not path.is_file():
        return {}
    try:
        settings = tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}: {error}") from None
    for key in settings:
        if key not in _KEYS:
            raise ValueError(f"{path}: unknown key {key!r}, expected {' or '.join(_KEYS)}")
    if not isinstance(settings.get("name", ""), str):
        raise ValueError(f"{path}: name: expected a string")
    limits = settings.get("mask_elevation_deg")
    if limits is not None:
        try:
            low, high = (float(np.radians(limit)) for limit in limits)
        except (TypeError, ValueError):
            low = high = np.nan
        if not low < high:
            raise ValueError(
                f"{path}: mask_elevation_deg: expected [lowest, highest], got {limits!r}"
            )
        settings["mask_elevation_deg"] = (low, high)
    return settings
