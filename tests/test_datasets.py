"""Datasets: the folder format, the two public sets, and what is refused by name."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pflut.camera import EquirectangularPanorama, Perspective
from pflut.datasets import (
    Dataset,
    data_root,
    load_dataset,
    load_folder,
    load_kitti_odometry,
    load_zind,
    write_folder,
)
from pflut.geometry import compose, wrap_to_pi
from pflut.trajectory import Trajectory, read_tum, write_kitti, write_tum

CAMERA = EquirectangularPanorama(64, 32)
N = 12
GOOD_POSE = "0 0 0 0 0 0 1\n"


def needs(name):
    root = data_root()
    folder = None if root is None else root / name
    if folder is None or not folder.is_dir():
        pytest.skip(f"the dataset {name} is not on this machine (PFLUT_DATA names its folder)")
    return folder


def parts(seed=0):
    rng = np.random.default_rng(seed)
    poses = np.column_stack([rng.normal(0, 3, (N, 2)), rng.uniform(-np.pi, np.pi, N)])
    odometry = compose([1.0, 2.0, 3.0], poses)
    odometry[:4] = np.nan
    return {
        "camera": CAMERA,
        "stamps": 1.7e9 + np.cumsum(rng.uniform(2, 3, N)),
        "images": list(rng.integers(0, 256, (N, 32, 64), dtype=np.uint8)),
        "ground_truth": poses,
        "odometry": odometry,
        "reference_indices": [0, 1, 2, 3],
        "floor_plan": rng.normal(0, 3, (5, 2, 2)),
        "mask_elevation": (-1.0, 1.5),
        "mask": rng.random((32, 64)) < 0.8,
        "name": 'the "old" flat, Zürich',
    }


@pytest.fixture
def folder(tmp_path):
    return write_folder(tmp_path / "flat", **parts())


def test_folder_round_trip(folder):
    expected, dataset = parts(), load_folder(folder)
    assert dataset.name == expected["name"]
    assert dataset.camera == CAMERA
    assert len(dataset) == N
    assert np.array_equal(dataset.stamps, expected["stamps"])
    assert np.array_equal(dataset.floor_plan, expected["floor_plan"])
    np.testing.assert_allclose(dataset.ground_truth, expected["ground_truth"], rtol=0, atol=1e-15)
    np.testing.assert_allclose(dataset.odometry, expected["odometry"], rtol=0, atol=1e-15)
    np.testing.assert_allclose(dataset.mask_elevation, expected["mask_elevation"], atol=1e-15)
    assert dataset.mask.dtype == bool and np.array_equal(dataset.mask, expected["mask"])
    assert dataset.reference_indices.tolist() == [0, 1, 2, 3]
    assert dataset.query_indices.tolist() == list(range(4, N))
    assert not dataset.leave_one_out
    for i, image in enumerate(expected["images"]):
        assert np.array_equal(dataset.image(i), image)
    assert sorted(p.name for p in folder.parent.iterdir()) == ["flat"]
    assert load_dataset(folder).name == dataset.name


def test_minimal_folder_takes_stamps_from_names_and_every_tenth(tmp_path):
    (tmp_path / "images").mkdir()
    for i in range(25):
        cv2.imwrite(str(tmp_path / "images" / f"{i * 0.5:.1f}.png"), parts()["images"][0])
    CAMERA.save(tmp_path / "camera.toml")
    write_tum(tmp_path / "groundtruth.tum", Trajectory([0, 12], [[0, 0, 0], [24, 0, 0]]))
    dataset = load_folder(tmp_path, max_pose_gap=12)
    assert dataset.stamps.tolist() == [i * 0.5 for i in range(25)]
    assert dataset.ground_truth[:, 0].tolist() == list(range(25))
    assert dataset.reference_indices.tolist() == [0, 10, 20]
    assert dataset.odometry is dataset.floor_plan is dataset.mask_elevation is None
    assert dataset.mask is None
    # the poses are 12 s apart: by default nothing is made up between them
    sparse = load_folder(tmp_path)
    assert np.flatnonzero(np.isfinite(sparse.ground_truth[:, 0])).tolist() == [0, 24]
    assert sparse.reference_indices.tolist() == [0]


def test_rounded_stamps_find_their_poses(folder):
    # the poses are 2 to 3 s apart, so nothing is interpolated: each is found by its stamp
    expected, stamps = load_folder(folder), parts()["stamps"]
    rounded = Trajectory(np.round(stamps, 2), parts()["ground_truth"])
    write_tum(folder / "groundtruth.tum", rounded)
    np.testing.assert_allclose(load_folder(folder).ground_truth, expected.ground_truth, atol=1e-15)
    write_tum(folder / "groundtruth.tum", Trajectory(stamps + 0.03, parts()["ground_truth"]))
    with pytest.raises(ValueError, match="no image has a pose"):
        load_folder(folder)


def test_odometry_between_is_the_motion_in_the_first_frame(folder):
    dataset, truth = load_folder(folder), parts()["ground_truth"]
    np.testing.assert_allclose(
        wrap_to_pi(compose(truth[5], dataset.odometry_between(5, 9)) - truth[9]), 0, atol=1e-12
    )
    with pytest.raises(ValueError, match=r"000002\.png: no odometry at its stamp"):
        dataset.odometry_between(2, 9)
    other = dataset.with_odometry(truth)
    assert np.isfinite(other.odometry_between(2, 9)).all()


def test_some_images_by_themselves(folder):
    whole = load_dataset(folder)
    chosen = np.array([1, 2, 4])
    part = whole.select(chosen)
    assert len(part) == 3 and part.name == whole.name
    assert part.image_paths == tuple(whole.image_paths[k] for k in chosen)
    for name in ("stamps", "ground_truth", "odometry"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[chosen])
    assert not len(part.reference_indices) and part.query_indices.tolist() == [0, 1, 2]
    assert replace(whole, odometry=None).select(chosen).odometry is None
    for wrong, message in (
        ([2, 1], "ascend"),
        ([1, 1], "ascend"),
        ([-1], "of 12"),
        ([12], "of 12"),
    ):
        with pytest.raises(ValueError, match=f"indices: expected .*{message}"):
            whole.select(wrong)


def test_references_can_be_chosen(folder, tmp_path):
    assert load_folder(folder, references="every:5").reference_indices.tolist() == [0, 5, 10]
    assert load_folder(folder, references=[7, 3]).reference_indices.tolist() == [7, 3]
    listing = tmp_path / "mine.txt"
    listing.write_text("# mine\n000004.png\nimages/000006.png\n")
    chosen = load_folder(folder, references=listing)
    assert chosen.reference_indices.tolist() == [4, 6]
    assert chosen.query_indices.tolist() == [0, 1, 2, 3, 5, 7, 8, 9, 10, 11]
    everything = load_folder(folder, references="all")
    assert everything.leave_one_out
    assert everything.query_indices.tolist() == list(range(N))
    assert everything.reference_indices.tolist() == list(range(N))


@pytest.mark.parametrize(
    ("references", "message"),
    [
        ("every:0", "expected 'every:N'"),
        ("every:x", "expected 'every:N'"),
        ("nowhere.txt", r"nowhere\.txt is no file"),
        ([0, 99], "expected indices of 12 images"),
        ([0.5], "expected indices of images"),
    ],
)
def test_references_refused(folder, references, message):
    with pytest.raises((ValueError, OSError), match=message):
        load_folder(folder, references=references)


def pose_line(stamp, rest=GOOD_POSE):
    return f"{stamp!r} {rest}"


def bad_poses(folder, text):
    (folder / "groundtruth.tum").write_text(text)


def break_listing(folder, text):
    (folder / "images.txt").write_text(text)


BROKEN = {
    "pose with NaN": (
        lambda f: bad_poses(f, pose_line(0.0) + "1 nan 0 0 0 0 0 1\n"),
        r"groundtruth\.tum:2: a value is not finite",
    ),
    "unsorted poses": (
        lambda f: bad_poses(f, pose_line(2.0) + pose_line(1.0)),
        r"groundtruth\.tum:2: stamp 1\.0 is not after",
    ),
    "missing stamps": (
        lambda f: bad_poses(f, GOOD_POSE),
        r"groundtruth\.tum:1: 7 columns \(is the timestamp missing\?\)",
    ),
    "stamps of another clock": (
        lambda f: bad_poses(f, pose_line(0.0) + pose_line(9.0)),
        r"groundtruth\.tum: no image has a pose: the images' stamps span",
    ),
    "no poses": (
        lambda f: [(f / n).unlink() for n in ("groundtruth.tum", "odometry.tum")],
        r"no poses, expected groundtruth\.tum or odometry\.tum",
    ),
    "references without poses": (
        lambda f: (f / "groundtruth.tum").unlink(),
        "references, but no ground truth poses",
    ),
    "image listed, missing": (
        lambda f: (f / "images" / "000005.png").unlink(),
        r"images\.txt:7: the image .*000005\.png is missing",
    ),
    "listing without names": (
        lambda f: break_listing(f, "0.5\n"),
        r"images\.txt:1: expected `stamp images/name\.png`",
    ),
    "listing unsorted": (
        lambda f: break_listing(f, "1 images/000000.png\n0 images/000001.png\n"),
        r"images\.txt:2: stamp 0\.0 is not after",
    ),
    "listing empty": (lambda f: break_listing(f, "# none\n"), r"images\.txt: no images"),
    "unknown reference": (
        lambda f: (f / "references.txt").write_text("000000.png\n000099.png\n"),
        r"references\.txt:2: no image '000099\.png'",
    ),
    "reference twice": (
        lambda f: (f / "references.txt").write_text("000000.png\n000000.png\n"),
        r"references\.txt:2: .* listed twice",
    ),
    "name is no stamp": (
        lambda f: [
            (f / "images.txt").unlink(),
            (f / "images" / "000000.png").rename(f / "images" / "front.png"),
        ],
        r"front\.png: the name is no stamp",
    ),
    "no camera": (lambda f: (f / "camera.toml").unlink(), r"no camera\.toml"),
    "unknown camera key": (
        lambda f: (f / "camera.toml").write_text((f / "camera.toml").read_text() + "zoom = 2\n"),
        r"camera\.toml.*zoom",
    ),
    "unknown setting": (
        lambda f: (f / "dataset.toml").write_text("mask = 1\n"),
        r"dataset\.toml: unknown key 'mask', expected name or mask_elevation_deg",
    ),
    "mask the wrong way round": (
        lambda f: (f / "dataset.toml").write_text("mask_elevation_deg = [50, -50]\n"),
        r"dataset\.toml: mask_elevation_deg: expected \[lowest, highest\]",
    ),
    "mask of another size": (
        lambda f: cv2.imwrite(str(f / "mask.png"), np.full((20, 30), 255, np.uint8)),
        r"mask\.png: 30 x 20 pixels, expected the camera's 64 x 32",
    ),
    "mask that is no image": (
        lambda f: (f / "mask.png").write_bytes(b"no image"),
        r"mask\.png: does not decode as an image",
    ),
    "mask of zeros and ones": (
        lambda f: cv2.imwrite(str(f / "mask.png"), np.ones((32, 64), np.uint8)),
        r"mask\.png: all black, expected white where",
    ),
    "floor plan": (
        lambda f: (f / "floorplan.csv").write_text("0,0,1,1\n0,0,1\n"),
        r"floorplan\.csv:2: 3 columns, expected 4: x1,y1,x2,y2",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_folders_are_refused_in_one_line(folder, case):
    damage, message = BROKEN[case]
    damage(folder)
    with pytest.raises((ValueError, OSError), match=message) as error:
        load_folder(folder)
    assert "\n" not in str(error.value)
    assert str(folder) in str(error.value) or case == "references without poses"


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no camera\.toml"):
        load_folder(tmp_path)
    with pytest.raises(ValueError, match="not recognized, expected"):
        load_dataset(tmp_path)
    with pytest.raises(FileNotFoundError, match="no such dataset"):
        load_dataset("no-such-dataset")
    CAMERA.save(tmp_path / "camera.toml")
    with pytest.raises(FileNotFoundError, match=r"no \.png or \.jpg image"):
        load_folder(tmp_path)


def test_images_that_do_not_fit_the_camera(folder):
    dataset = load_folder(folder)
    cv2.imwrite(str(dataset.image_paths[1]), np.zeros((20, 30), np.uint8))
    with pytest.raises(ValueError, match=r"000001\.png: 30 x 20 pixels, expected .* 64 x 32"):
        dataset.image(1)
    dataset.image_paths[2].write_bytes(b"no image")
    with pytest.raises(ValueError, match=r"000002\.png"):
        dataset.image(2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"images": parts()["images"][:5]}, "only 5 for 12 stamps"),
        ({"images": parts()["images"] * 2}, "more than the 12 stamps"),
        ({"images": [np.zeros((8, 8), np.uint8)]}, "image 0 is uint8 of shape"),
        ({"images": [np.zeros((32, 64))]}, "image 0 is float64"),
        ({"stamps": np.zeros(N)}, "is not after the one before it"),
        ({"ground_truth": np.zeros((3, 3))}, r"ground_truth: expected shape \(12, 3\)"),
        ({"reference_indices": [12]}, "expected indices of 12 images"),
        ({"suffix": ".gif"}, "suffix"),
        ({"ground_truth": np.full((N, 3), np.nan)}, "reference without a ground truth"),
        ({"ground_truth": None, "odometry": None, "reference_indices": None}, "one of them"),
    ],
)
def test_write_folder_refuses_and_leaves_nothing(tmp_path, change, message):
    with pytest.raises(ValueError, match=message):
        write_folder(tmp_path / "flat", **(parts() | change))
    assert list(tmp_path.iterdir()) == []


def test_write_folder_is_interrupted_cleanly_and_never_overwrites(tmp_path):
    def interrupted():
        yield from parts()["images"][:3]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_folder(tmp_path / "flat", **(parts() | {"images": interrupted()}))
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "flat").mkdir()
    done = []
    progress = {"progress": lambda *step: done.append(step)}
    write_folder(tmp_path / "flat", **(parts() | progress))  # an empty folder is filled
    assert done == [(i, N) for i in range(1, N + 1)]
    with pytest.raises(FileExistsError, match="exists already"):
        write_folder(tmp_path / "flat", **parts())


def test_dataset_checks_its_parts():
    good = {"name": "x", "camera": CAMERA, "stamps": [0.0], "image_paths": ("a.png",)}
    assert len(Dataset(**good)) == 1
    with pytest.raises(ValueError, match="stamps"):
        Dataset(**(good | {"stamps": [np.nan]}))
    with pytest.raises(ValueError, match="floor_plan"):
        Dataset(**good, floor_plan=np.zeros((2, 4)))
    with pytest.raises(ValueError, match=r"mask: expected shape \(32, 64\), got \(64, 32\)"):
        Dataset(**good, mask=np.ones((64, 32)))
    with pytest.raises(ValueError, match="mask: no pixel to use"):
        Dataset(**good, mask=np.zeros((32, 64)))
    with pytest.raises(ValueError, match="has no odometry"):
        Dataset(**good).odometry_between(0, 0)


def test_zind_poses_agree_with_those_converted_by_others():
    folder = needs("zind_home000")
    dataset, other = load_zind(folder), read_tum(folder / "poses.txt")
    assert len(dataset) == 32
    assert np.array_equal(dataset.stamps, other.stamps)
    np.testing.assert_allclose(dataset.ground_truth, other.poses, atol=1e-6)
    assert dataset.camera.mount.height == pytest.approx(1.435, abs=1e-3)
    assert dataset.leave_one_out
    assert len(dataset.reference_indices) == 32
    assert dataset.image(0).shape == (1024, 2048)
    assert load_dataset("zind_home000", references="every:2").reference_indices.size == 16


def test_zind_walls_enclose_the_panoramas():
    dataset = load_zind(needs("zind_home000"))
    low, high = dataset.floor_plan.min(axis=(0, 1)), dataset.floor_plan.max(axis=(0, 1))
    assert ((dataset.ground_truth[:, :2] > low) & (dataset.ground_truth[:, :2] < high)).all()
    # nobody stands in a wall, though some tripods stand in the doors of closets
    start, along = dataset.floor_plan[:, 0], np.diff(dataset.floor_plan, axis=1)[:, 0]
    offset = dataset.ground_truth[:, None, :2] - start
    t = np.clip((offset * along).sum(axis=2) / (along**2).sum(axis=1), 0, 1)
    distance = np.linalg.norm(offset - t[..., None] * along, axis=2)
    assert distance.min() > 0.05
    assert np.median(distance.min(axis=1)) > 0.4


def zind_home(rotation=0.0):
    """Make a room of 4 x 2 camera heights with a door in the wall y = 1, in ZInD's words."""
    panorama = {
        "is_primary": True,
        "camera_height": 1,
        "image_path": "panos/p.jpg",
        "floor_plan_transformation": {
            "translation": [0.5, 0.25],
            "rotation": rotation,
            "scale": 0.5,
        },
        "layout_complete": {
            "vertices": [[-2, -1], [2, -1], [2, 1], [-2, 1]],
            "doors": [[-0.5, 1], [0.5, 1], [-1, 0.4]],
            "openings": [],
        },
    }
    return {
        "scale_meters_per_coordinate": {"floor_01": 2.0},
        "merger": {"floor_01": {"complete_room_01": {"partial_room_01": {"pano_7": panorama}}}},
    }


def write_zind(folder, data):
    (folder / "panos").mkdir(exist_ok=True)
    (folder / "panos" / "p.jpg").touch()
    (folder / "zind_data.json").write_text(json.dumps(data))


def test_zind_by_hand(tmp_path):
    write_zind(tmp_path, zind_home())
    dataset = load_dataset(tmp_path)
    np.testing.assert_allclose(dataset.ground_truth, [[-1, 0.5, np.pi / 2]])
    assert dataset.stamps.tolist() == [7]
    walls = dataset.floor_plan - dataset.ground_truth[0, :2]
    expected = [
        [[2, -1], [-2, -1]],
        [[-2, -1], [-2, 1]],
        [[-2, 1], [-0.5, 1]],
        [[0.5, 1], [2, 1]],
        [[2, 1], [2, -1]],
    ]
    np.testing.assert_allclose(walls, expected, atol=1e-12)
    # turned by 90 deg: the image's centre, the local y axis, looks along the world's x axis
    write_zind(tmp_path, zind_home(90.0))
    turned = load_zind(tmp_path)
    assert turned.ground_truth[0, 2] == pytest.approx(0)
    door = turned.floor_plan[2:4] - turned.ground_truth[0, :2]
    np.testing.assert_allclose(door, [[[1, 2], [1, 0.5]], [[1, -0.5], [1, -2]]], atol=1e-12)


def test_zind_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"zind_data\.json"):
        load_zind(tmp_path)
    (tmp_path / "zind_data.json").write_text("{")
    with pytest.raises(ValueError, match=r"zind_data\.json"):
        load_zind(tmp_path)
    write_zind(tmp_path, {"merger": {}})
    with pytest.raises(ValueError, match="not as ZInD describes it"):
        load_zind(tmp_path)
    write_zind(tmp_path, zind_home())
    with pytest.raises(ValueError, match=r"'attic' with a scale in metres, .* floor_01"):
        load_zind(tmp_path, floor="attic")
    (tmp_path / "panos" / "p.jpg").unlink()
    with pytest.raises(FileNotFoundError, match=r"p\.jpg: the panorama is missing"):
        load_zind(tmp_path)


def test_kitti_sequence():
    folder = needs("kitti07_first160")
    dataset = load_dataset(folder)
    planar = np.loadtxt(folder / "poses_planar.txt")
    np.testing.assert_allclose(dataset.ground_truth, planar[:, 1:4], atol=1e-6)
    assert len(dataset) == 160
    assert dataset.reference_indices.tolist() == list(range(0, 160, 10))
    assert len(dataset.query_indices) == 144
    assert isinstance(dataset.camera, Perspective)
    assert (dataset.camera.fx, dataset.camera.cx) == (707.0912, 601.8873)
    assert dataset.image(3).shape == (370, 1226)
    assert dataset.odometry is None


def test_kitti_benchmark_layout(tmp_path):
    """The benchmark's own files give the same planar poses as the other layout's."""
    folder = needs("kitti07_first160")
    sequence = tmp_path / "sequences" / "07"
    (sequence / "image_0").mkdir(parents=True)
    (tmp_path / "poses").mkdir()
    lines = (folder / "poses_kitti_original.txt").read_text().splitlines(keepends=True)
    (tmp_path / "poses" / "07.txt").write_text("".join(lines))
    for i in range(160):
        (sequence / "image_0" / f"{i:06d}.png").symlink_to(folder / "images" / f"{i:06d}.png")
    (sequence / "times.txt").write_text("".join(f"{i * 0.1:e}\n" for i in range(160)))
    numbers = "7.070912e+02 0 6.018873e+02 0 0 7.070912e+02 1.831104e+02 0 0 0 1 0"
    (sequence / "calib.txt").write_text(f"P0: {numbers}\nTr: {numbers}\n")
    dataset, other = load_dataset(sequence), load_dataset(folder)
    assert dataset.camera == other.camera
    assert dataset.name == "kitti-07"
    np.testing.assert_allclose(dataset.ground_truth, other.ground_truth, atol=2e-5)


def kitti_folder(tmp_path, n=3):
    (tmp_path / "images").mkdir()
    for i in range(n):
        cv2.imwrite(str(tmp_path / "images" / f"{i}.png"), np.zeros((10, 20), np.uint8))
    (tmp_path / "calib.txt").write_text("fx 10\nfy 10\ncx 9.5\ncy 4.5\n")
    write_tum(tmp_path / "poses.txt", Trajectory(np.arange(n), np.zeros((n, 3))))
    return tmp_path


def test_kitti_refused(tmp_path):
    folder = kitti_folder(tmp_path)
    assert len(load_kitti_odometry(folder)) == 3
    (folder / "calib.txt").write_text("fx 10\nfy 10\n")
    with pytest.raises(ValueError, match=r"calib\.txt: expected `P0:`"):
        load_kitti_odometry(folder)
    (folder / "calib.txt").write_text("fx ten\n")
    with pytest.raises(ValueError, match=r"calib\.txt:1: expected a name and numbers"):
        load_kitti_odometry(folder)
    (folder / "images" / "2.png").unlink()
    with pytest.raises(ValueError, match="2 images, but 3 poses"):
        load_kitti_odometry(folder)
    for image in (folder / "images").iterdir():
        image.unlink()
    with pytest.raises(FileNotFoundError, match=r"no \.png images"):
        load_kitti_odometry(folder)


def test_kitti_benchmark_without_poses(tmp_path):
    sequence = tmp_path / "sequences" / "11"
    (sequence / "image_0").mkdir(parents=True)
    cv2.imwrite(str(sequence / "image_0" / "000000.png"), np.zeros((10, 20), np.uint8))
    with pytest.raises(FileNotFoundError, match=r"11\.txt: no such file of poses"):
        load_kitti_odometry(sequence)
    write_kitti(tmp_path / "own.txt", Trajectory([0], [[0, 0, 0]]))
    (sequence / "times.txt").write_text("0.0\n0.1\n")
    with pytest.raises(ValueError, match="1 poses, but 2 times"):
        load_kitti_odometry(sequence, poses=tmp_path / "own.txt")


def test_data_root_is_named_by_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("PFLUT_DATA", str(tmp_path))
    assert data_root() == tmp_path
    kitti = tmp_path / "drive"
    kitti.mkdir()
    kitti_folder(kitti)
    assert load_dataset("drive").name == "drive"
    monkeypatch.setenv("PFLUT_DATA", str(tmp_path / "absent"))
    assert data_root() is None
