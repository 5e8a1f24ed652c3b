"""A folder of fisheye images becomes one of panoramas that shows, and masks, the same world."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pflut.camera import EquirectangularPanorama, Fisheye, Mount, Perspective, Unwrapper
from pflut.datasets import Dataset, load_folder, unwrap_folder, write_folder
from pflut.replay import ReplayOptions
from pflut.replay.pipeline import make_extractor

LENS = Fisheye(
    500, 500, 110.0, 110.0, 249.5, 249.5, max_angle=2.2, looks="up",
    mount=Mount(yaw=0.4, pitch=0.06, height=1.2),
)  # fmt: skip


@pytest.fixture(scope="module")
def fisheye_folder(tmp_path_factory: pytest.TempPathFactory, room_dataset: Dataset) -> Path:
    """Four images of the room through a tilted fisheye lens, masked where the room's are cut."""
    look = Unwrapper(room_dataset.camera, LENS, margin=2)
    assert room_dataset.odometry is not None
    odometry = room_dataset.odometry[12:16].copy()
    odometry[1] = np.nan
    return write_folder(
        tmp_path_factory.mktemp("data") / "fisheye",
        camera=LENS,
        stamps=[0.5, 1.0, 1.5, 3.0],
        images=[look(room_dataset.image(i)) for i in range(12, 16)],
        ground_truth=room_dataset.ground_truth[12:16],
        odometry=odometry,
        reference_indices=[0, 2],
        floor_plan=room_dataset.floor_plan,
        mask_elevation=(-0.6, 1.5),
        mask=look.mask,
        name="through a lens",
        suffix=".jpg",
    )


def test_all_but_the_images_is_carried_along(fisheye_folder: Path, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    out = unwrap_folder(
        fisheye_folder, tmp_path / "out", width=512, progress=lambda *step: seen.append(step)
    )
    assert seen == [(i, 4) for i in (1, 2, 3, 4)]
    old, new = load_folder(fisheye_folder), load_folder(out)
    assert new.name == "through a lens"
    assert new.camera.width == 512 and new.camera.mount == Mount(height=1.2)
    for name in ("stamps", "ground_truth", "odometry", "floor_plan", "mask_elevation"):
        np.testing.assert_allclose(getattr(new, name), getattr(old, name), rtol=0, atol=1e-12)
    assert new.reference_indices.tolist() == [0, 2]
    assert [path.suffix for path in new.image_paths] == [".jpg"] * 4
    assert (new.image(3) != new.image(0)).any()


def test_panoramas_show_what_the_mask_says(
    fisheye_folder: Path, tmp_path: Path, room_dataset: Dataset
) -> None:
    unwrapped = load_folder(unwrap_folder(fisheye_folder, tmp_path / "out"))
    camera, mask = unwrapped.camera, unwrapped.mask
    assert mask is not None and mask.shape == (camera.height, camera.width)
    # above 0.7 rad the room's images end, and so does the lens's own mask
    _, elevation = camera.bearings(np.argwhere(mask)[:, ::-1].astype(float))
    assert 0.6 < elevation.max() <= 0.71 and elevation.min() < -0.5
    assert np.pi / 2 - camera.elevation_max < 0.02  # type: ignore[attr-defined]
    expected = Unwrapper(room_dataset.camera, camera)(room_dataset.image(13))
    difference = np.abs(unwrapped.image(1).astype(int) - expected)[mask]
    assert np.median(difference) <= 6  # two interpolations and two JPEGs
    shuffled = np.abs(unwrapped.image(1).astype(int) - np.roll(expected, 40, axis=1))[mask]
    assert np.median(shuffled) > 20

    extractor = make_extractor(unwrapped, ReplayOptions())
    features = extractor(unwrapped.image(1))
    assert len(features) > 100
    u, v = features.pixels.round().astype(int).T
    assert mask[v, u].all()
    bare = make_extractor(replace(unwrapped, mask=None), ReplayOptions())
    assert extractor.settings != bare.settings  # the key of the features' cache
    u, v = bare(unwrapped.image(1)).pixels.round().astype(int).T
    assert not mask[v, u].all()


def test_without_a_mask_and_references_of_its_own(fisheye_folder: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(fisheye_folder, tmp_path / "plain"))
    for name in ("mask.png", "references.txt", "groundtruth.tum", "dataset.toml"):
        (folder / name).unlink()
    unwrapped = load_folder(unwrap_folder(folder, tmp_path / "out", width=256))
    assert unwrapped.name == "plain"
    assert unwrapped.ground_truth is None and not len(unwrapped.reference_indices)
    assert unwrapped.mask is not None
    assert (unwrapped.mask == Unwrapper(LENS, unwrapped.camera).mask).all()


def test_refusals_leave_nothing(fisheye_folder: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(fisheye_folder, tmp_path / "spoilt"))
    (folder / "images" / "000002.jpg").write_bytes(b"no image")
    with pytest.raises(ValueError, match=r"000002\.jpg: does not decode"):
        unwrap_folder(folder, tmp_path / "out")
    with pytest.raises(FileExistsError, match="spoilt: exists already"):
        unwrap_folder(fisheye_folder, folder)
    (folder / "mask.png").unlink()
    Perspective(500, 500, 300.0, 300.0, 249.5, 249.5).save(folder / "camera.toml")
    with pytest.raises(ValueError, match=r"camera\.toml: Perspective: does not see all around"):
        unwrap_folder(folder, tmp_path / "out")
    with pytest.raises(FileNotFoundError, match="no such folder"):
        unwrap_folder(tmp_path / "nowhere", tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["spoilt"]


def test_a_panorama_is_levelled(room_dataset: Dataset, tmp_path: Path) -> None:
    tilted = EquirectangularPanorama(256, 128, mount=Mount(roll=0.2))
    look = Unwrapper(room_dataset.camera, tilted)
    folder = write_folder(
        tmp_path / "tilted",
        camera=tilted,
        stamps=[0.0],
        images=[look(room_dataset.image(0))],
        ground_truth=[[0.0, 0.0, 0.0]],
    )
    level = load_folder(unwrap_folder(folder, tmp_path / "level", width=256))
    assert level.camera == EquirectangularPanorama(256, 128)
    assert level.mask is not None and level.mask.all()
