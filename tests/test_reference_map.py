"""The map: building, storing, and which references are worth comparing."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from world import REFERENCES, World

from pflut.features import Features
from pflut.reference_map import FEATURE_FIELDS, FORMAT, VERSION, ReferenceMap


@pytest.fixture(scope="module")
def world() -> World:
    return World()


@pytest.fixture(scope="module")
def reference_map(world: World) -> ReferenceMap:
    return world.map(REFERENCES)


def same_features(a: Features, b: Features) -> bool:
    return all((getattr(a, name) == getattr(b, name)).all() for name in FEATURE_FIELDS)


def extractor(image: np.ndarray) -> Features:
    """As many features as the image has rows."""
    n = len(image)
    return Features(
        np.zeros(n), np.zeros(n), np.ones((n, 8), np.float32), np.zeros((n, 2)), np.ones(n)
    )


def test_build_reads_one_image_after_the_other() -> None:
    seen = []
    images = (np.zeros((n + 1, 2), np.uint8) for n in range(4))
    poses = np.arange(12.0).reshape(4, 3)
    built = ReferenceMap.build(images, poses, extractor, progress=lambda *d: seen.append(d))
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert [len(f) for f in built.features] == [1, 2, 3, 4]
    assert built.names == ("0", "1", "2", "3")
    assert len(built) == 4
    assert (built.poses == poses).all()


def test_from_dataset_takes_its_references() -> None:
    dataset = SimpleNamespace(
        name="flat",
        reference_indices=np.array([1, 3]),
        ground_truth=np.arange(15.0).reshape(5, 3),
        image_paths=[Path(f"images/{i}.png") for i in range(5)],
        image=lambda i: np.zeros((i, 2), np.uint8),
    )
    built = ReferenceMap.from_dataset(dataset, extractor)
    assert [len(f) for f in built.features] == [1, 3]
    assert built.names == ("1.png", "3.png")
    assert built.poses.tolist() == [[3, 4, 5], [9, 10, 11]]
    seen = []
    cached = ReferenceMap.from_dataset(
        dataset,
        None,
        cache=lambda _, image: extractor(image[1:]),
        progress=lambda *d: seen.append(d),
    )
    assert [len(f) for f in cached.features] == [0, 2]
    assert seen == [(1, 2), (2, 2)]
    for change in ({"reference_indices": np.array([], int)}, {"ground_truth": None}):
        wrong = SimpleNamespace(**(vars(dataset) | change))
        with pytest.raises(ValueError, match="flat: no reference images; expected"):
            ReferenceMap.from_dataset(wrong, extractor)


def test_add_and_subset(reference_map: ReferenceMap, world: World) -> None:
    pose = np.array([0.5, 0.5, 0.5])
    more = reference_map.add(pose, world.look(pose, 3), "new")
    assert len(more) == 7
    assert len(reference_map) == 6
    assert more.names[-1] == "new"
    assert (more.poses[-1] == pose).all()
    some = more.subset([6, 0])
    assert some.names == ("new", "0.png")
    assert same_features(some.features[1], reference_map.features[0])


def test_bounds_and_spacing(reference_map: ReferenceMap) -> None:
    assert reference_map.bounds(0.5) == pytest.approx((-2.5, -2.0, 2.5, 2.1))
    square = reference_map.subset([0, 1, 2, 3])
    poses = np.array([[0, 0, 0], [0, 0, 1], [3, 0, 0], [3, 4, 0]], float)
    assert ReferenceMap(poses, square.features, square.names).spacing == pytest.approx(3.0)
    one = reference_map.subset([0])
    assert one.spacing == np.inf


def test_similarity_finds_the_view(reference_map: ReferenceMap, world: World) -> None:
    """Every image shows the same landmarks here, so each reference with a world of its own."""
    worlds = [World(seed=seed) for seed in range(5)]
    features = [w.look(REFERENCES[0], 0, clutter=5) for w in worlds]
    apart = ReferenceMap(REFERENCES[:5], tuple(features), ("a", "b", "c", "d", "e"))
    for i, w in enumerate(worlds):
        similarity = apart.similarity(w.look(REFERENCES[0], 9, clutter=5))
        assert similarity.argmax() == i
        assert (np.abs(similarity) <= 1 + 1e-5).all()
    none = Features.empty()
    assert not reference_map.similarity(none).any()


def candidates(reference_map: ReferenceMap, poses: np.ndarray, **options) -> list[int]:
    features = reference_map.features[0]
    settings = {"max_range": 3.0, "max_candidates": 4} | options
    return list(reference_map.candidates(features, poses, **settings))


def test_candidates_are_the_near_ones(reference_map: ReferenceMap) -> None:
    assert candidates(reference_map, REFERENCES[:1] + 0.01, max_range=1.0) == [0]
    near = candidates(reference_map, REFERENCES[4:5] + 0.01, max_candidates=6, max_range=3.5)
    distance = np.hypot(*(REFERENCES[:, :2] - REFERENCES[4, :2]).T)
    assert near == list(np.argsort(distance)[: len(near)])
    assert len(near) == (distance < 3.5).sum()


def test_candidates_out_of_range_and_of_no_poses(reference_map: ReferenceMap) -> None:
    assert candidates(reference_map, np.array([[100.0, 0.0, 0.0]])) == []
    assert candidates(reference_map, np.zeros((0, 3))) == []


def test_candidates_are_limited_by_similarity(world: World) -> None:
    """A lost robot: all are near some pose, and the ones that look alike are kept."""
    other = World(seed=9)
    poses = np.tile(REFERENCES, (2, 1))
    features = [world.look(p, i) for i, p in enumerate(REFERENCES)]
    features += [other.look(p, i) for i, p in enumerate(REFERENCES)]
    both = ReferenceMap(poses, tuple(features), tuple(map(str, range(12))))
    lost = np.random.default_rng(0).uniform([-3, -2, -3], [3, 2, 3], (2000, 3))
    for image, expected in ((world, range(6)), (other, range(6, 12))):
        chosen = both.candidates(image.look(np.zeros(3), 77), lost, max_range=5.0, max_candidates=6)
        assert sorted(chosen) == list(expected)


def test_candidates_of_features_without_any(reference_map: ReferenceMap) -> None:
    empty = reference_map.features[0][:0]
    chosen = reference_map.candidates(empty, REFERENCES, max_range=9.0, max_candidates=3)
    assert len(chosen) == 3


def test_a_stored_map_comes_back(reference_map: ReferenceMap, tmp_path: Path) -> None:
    empty = reference_map.add([0, 0, 0], reference_map.features[0][:0], "leer \u00e4.png")
    empty.save(tmp_path / "map.npz")
    loaded = ReferenceMap.load(tmp_path / "map.npz")
    assert (loaded.poses == empty.poses).all()
    assert loaded.names == empty.names
    for a, b in zip(loaded.features, empty.features, strict=True):
        assert same_features(a, b)
    assert [p.name for p in tmp_path.iterdir()] == ["map.npz"]


def stored(path: Path, reference_map: ReferenceMap, **changes) -> Path:
    entries = {
        "format": np.array(FORMAT),
        "version": np.array(VERSION),
        "poses": reference_map.poses,
        "names": np.array(reference_map.names),
        "counts": np.array([len(f) for f in reference_map.features]),
    }
    for name in FEATURE_FIELDS:
        entries[name] = np.concatenate([getattr(f, name) for f in reference_map.features])
    entries |= changes
    np.savez(path, **{k: v for k, v in entries.items() if v is not None})
    return path


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": np.array(VERSION + 1)}, f"map version {VERSION + 1}, expected"),
        ({"format": np.array("pflut likelihood table")}, "not a pflut reference map"),
        ({"format": None}, "not a pflut reference map"),
        ({"counts": None}, "without counts"),
        ({"azimuth": None}, "without azimuth"),
        ({"counts": np.array([1, 2, 3, 4, 5, 6])}, "numbers of features do not fit"),
        ({"counts": np.array([0.5] * 6)}, "numbers of features do not fit"),
        ({"poses": np.full((6, 3), np.nan)}, "row 0 is not finite"),
        ({"poses": np.zeros((5, 3))}, "expected as many poses"),
        ({"azimuth": np.zeros(3)}, "numbers of features do not fit"),
        ({"names": np.array([{}], dtype=object)}, "reference map of pflut, or damaged"),
    ],
)
def test_a_bad_file_is_refused_by_name(
    reference_map: ReferenceMap, tmp_path: Path, changes: dict, message: str
) -> None:
    path = stored(tmp_path / "bad.npz", reference_map, **changes)
    with pytest.raises(ValueError, match=message) as error:
        ReferenceMap.load(path)
    assert str(path) in str(error.value)


def test_truncated_or_no_map_at_all(reference_map: ReferenceMap, tmp_path: Path) -> None:
    path = stored(tmp_path / "map.npz", reference_map)
    content = path.read_bytes()
    for broken in (b"", b"hello", content[:100], content[: len(content) // 2], content[:-1]):
        path.write_bytes(broken)
        with pytest.raises(ValueError, match=r"map\.npz"):
            ReferenceMap.load(path)
    with pytest.raises(FileNotFoundError):
        ReferenceMap.load(tmp_path / "none.npz")


def test_misuse(reference_map: ReferenceMap) -> None:
    features, names = reference_map.features, reference_map.names
    with pytest.raises(ValueError, match="at least one reference"):
        ReferenceMap(np.empty((0, 3)), (), ())
    with pytest.raises(ValueError, match="expected as many poses as features and names"):
        ReferenceMap(REFERENCES, features, names[:-1])
    with pytest.raises(ValueError, match="poses: row 2 is not finite"):
        ReferenceMap(np.where(np.arange(6)[:, None] == 2, np.nan, REFERENCES), features, names)
    binary = (*features[:-1], Features.empty(binary=True))
    with pytest.raises(ValueError, match="descriptors of different kinds"):
        ReferenceMap(REFERENCES, binary, names)
