"""Features: where they are found, files, cache, and what is refused."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from pflut.camera import EquirectangularPanorama, Mount, Perspective
from pflut.features import (
    FeatureCache,
    FeatureExtractor,
    Features,
    match_indices,
    read_image,
)
from pflut.geometry import wrap_to_pi

# uint64 products wrap in the bit count; NumPy says so where NUMBA_DISABLE_JIT is set
pytestmark = pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")

PANORAMA = EquirectangularPanorama(512, 256)
DETECTORS = ("sift", "orb")


def texture(width: int, height: int, seed: int = 0, smooth: float = 2.5) -> np.ndarray:
    """Smooth noise that continues over the left and right border."""
    rng = np.random.default_rng(seed)
    noise = np.pad(rng.normal(size=(height, width)), ((0, 0), (64, 64)), mode="wrap")
    noise = cv2.GaussianBlur(noise, (0, 0), smooth)[:, 64:-64]
    noise = (noise - noise.min()) / np.ptp(noise)
    return (255 * noise).astype(np.uint8)


def blobs(width: int, height: int, centers: np.ndarray, sigma: float) -> np.ndarray:
    """Bright Gaussian blobs on gray; columns wrap around."""
    v, u = np.mgrid[:height, :width].astype(float)
    image = np.full((height, width), 60.0)
    for cu, cv in centers:
        du = (u - cu + width / 2) % width - width / 2
        image += 150.0 * np.exp(-(du**2 + (v - cv) ** 2) / (2 * sigma**2))
    return np.clip(image, 0, 255).round().astype(np.uint8)


def test_pixels_are_where_the_thing_is() -> None:
    """A blob's bearing is that of its centre, below a tenth of a pixel and without bias."""
    rng = np.random.default_rng(0)
    camera = Perspective(320, 240, 200.0, 200.0, 159.5, 119.5)
    offsets = []
    for sigma in (2.5, 4.0, 5.0, 6.0):
        grid = np.stack(np.meshgrid([60, 130, 200, 260], [60, 120, 180]), axis=-1).reshape(-1, 2)
        centers = grid + rng.uniform(-0.5, 0.5, grid.shape)
        found = FeatureExtractor(camera, similarity_threshold=0)(blobs(320, 240, centers, sigma))
        distance = np.linalg.norm(centers[:, None] - found.pixels[None], axis=2)
        assert (distance.min(axis=1) < 0.3).all()
        nearest = distance.argmin(axis=1)
        offsets.append(found.pixels[nearest] - centers)
        expected = camera.bearings(centers)
        assert np.abs(wrap_to_pi(found.azimuth[nearest] - expected[0])).max() < 0.3 / 200
        assert np.abs(found.elevation[nearest] - expected[1]).max() < 0.3 / 200
    offset = np.concatenate(offsets)
    assert np.abs(offset.mean(axis=0)).max() < 0.05
    assert np.abs(offset).mean() < 0.1


def test_orb_has_no_bias() -> None:
    """The image turned by half a turn has the same features, turned."""
    camera = Perspective(653, 487, 400.0, 400.0, 326.0, 243.0)
    image = texture(653, 487, smooth=4.0)
    extractor = FeatureExtractor(camera, detector="orb", similarity_threshold=0)
    there = extractor(image).pixels
    back = np.array([652.0, 486.0]) - extractor(image[::-1, ::-1].copy()).pixels
    distance = np.abs(there[:, None] - back[None]).max(axis=2).min(axis=1)
    assert len(there) > 300
    assert (distance < 1e-3).mean() > 0.9


@pytest.mark.parametrize("detector", DETECTORS)
def test_seam_is_like_any_column(detector: str) -> None:
    """A panorama and the same turned by half a turn have the same features once."""
    image = texture(512, 256)
    extractor = FeatureExtractor(
        PANORAMA, detector=detector, similarity_threshold=0, max_features=4000
    )
    here, turned = extractor(image), extractor(np.roll(image, 256, axis=1))
    assert ((here.pixels[:, 0] >= -0.5) & (here.pixels[:, 0] < 511.5)).all()
    moved = turned.pixels.copy()
    moved[:, 0] = (moved[:, 0] - 256 + 0.5) % 512 - 0.5
    shift = here.pixels[:, None] - moved[None]
    shift[..., 0] = (shift[..., 0] + 256) % 512 - 256
    distance = np.hypot(shift[..., 0], shift[..., 1])
    near = np.abs((here.pixels[:, 0] + 256.5) % 512 - 256) < 20
    assert near.sum() > 15
    # ORB's keypoints lie on whole pixels of a level, whose raster begins at the image's border
    tolerance = 0.05 if detector == "sift" else 2.0
    assert (distance.min(axis=1)[near] < tolerance).mean() > 0.9
    near_moved = np.abs((moved[:, 0] + 256.5) % 512 - 256) < 20
    # none twice: as many on the seam as where it is a column like any other
    slack = 0.05 if detector == "sift" else 0.1
    assert abs(int(near.sum()) - int(near_moved.sum())) <= slack * near.sum()


@pytest.mark.parametrize("u", np.linspace(-2.0, 1.0, 13))
def test_blob_on_the_seam_is_found_once(u: float) -> None:
    image = blobs(512, 256, np.array([[u, 128.0]]), 4.0)
    found = FeatureExtractor(PANORAMA, similarity_threshold=0)(image)
    inside = FeatureExtractor(PANORAMA, similarity_threshold=0)(np.roll(image, 128, axis=1))
    centers = np.unique(np.round(found.pixels, 1), axis=0)
    centers_inside = np.unique(np.round(inside.pixels, 1), axis=0)
    assert len(found) == len(inside) > 0
    assert len(centers) == len(centers_inside)
    error = wrap_to_pi(found.azimuth - PANORAMA.bearings([[u, 128.0]])[0])
    assert np.abs(error).min() < 0.1 * 2 * np.pi / 512


def test_tilted_camera_gives_robot_bearings() -> None:
    image = texture(320, 240)
    straight = Perspective(320, 240, 300.0, 300.0, 159.5, 119.5)
    tilted = Perspective(320, 240, 300.0, 300.0, 159.5, 119.5, mount=Mount(pitch=-0.4, yaw=1.0))
    a, b = FeatureExtractor(straight)(image), FeatureExtractor(tilted)(image)
    assert len(a) == len(b) > 50
    expected = tilted.bearings(a.pixels.astype(float))
    assert b.azimuth == pytest.approx(expected[0], abs=1e-6)
    assert b.elevation == pytest.approx(expected[1], abs=1e-6)
    assert b.elevation.mean() > 0.3


@pytest.mark.parametrize("detector", DETECTORS)
def test_masks(detector: str) -> None:
    image = texture(512, 256)
    # more than there are: ORB's limit would take others instead of those masked
    options = {"detector": detector, "max_features": 5000}
    plain = FeatureExtractor(PANORAMA, **options)(image)
    assert plain.elevation.max() > 0.5
    banded = FeatureExtractor(PANORAMA, **options, mask_elevation=(-0.3, 0.4))(image)
    assert 20 < len(banded) < len(plain)
    assert -0.3 <= banded.elevation.min() < -0.2
    assert 0.3 < banded.elevation.max() <= 0.4
    mask = np.zeros((256, 512), dtype=bool)
    mask[:, 100:300] = True
    half = FeatureExtractor(PANORAMA, **options, mask=mask)(image)
    assert len(half) > 20
    assert ((half.pixels[:, 0] > 99) & (half.pixels[:, 0] < 300)).all()
    nowhere = FeatureExtractor(PANORAMA, **options, mask=np.zeros_like(mask))(image)
    assert len(nowhere) == 0


@pytest.mark.parametrize("detector", DETECTORS)
def test_what_comes_out(detector: str) -> None:
    image = texture(512, 256)
    extractor = FeatureExtractor(PANORAMA, detector=detector)
    found = extractor(image)
    assert found.is_binary == (detector == "orb")
    assert (np.diff(found.response) <= 0).all()
    assert found.descriptors.shape == (len(found), 32 if detector == "orb" else 128)
    again = extractor(np.repeat(image[:, :, None], 3, axis=2))
    assert np.array_equal(again.pixels, found.pixels)
    assert np.array_equal(again.descriptors, found.descriptors)
    few = FeatureExtractor(PANORAMA, detector=detector, max_features=30)(image)
    assert 0 < len(few) <= 30
    if detector == "sift":
        assert np.array_equal(few.pixels, found.pixels[:30])
        assert found.squared_norms == pytest.approx(1.0, abs=1e-5)
        plain = FeatureExtractor(PANORAMA, root_sift=False, similarity_threshold=0)(image)
        rooted = FeatureExtractor(PANORAMA, similarity_threshold=0)(image)
        squares = rooted.descriptors**2
        ratio = squares / np.linalg.norm(squares, axis=1, keepdims=True)
        assert np.abs(ratio - plain.descriptors).max() < 1e-5


def test_lower_contrast_finds_more() -> None:
    image = (texture(512, 256) // 8 + 100).astype(np.uint8)
    counts = [
        len(FeatureExtractor(PANORAMA, contrast_threshold=t)(image)) for t in (0.005, 0.02, 0.08)
    ]
    assert counts[0] > counts[1] > counts[2]


@pytest.mark.parametrize("detector", DETECTORS)
def test_repeated_things_are_dropped(detector: str) -> None:
    """Two copies of a patch leave one image's matches to itself, not to its copy."""
    image = texture(512, 256)
    image[60:190, 300:430] = image[60:190, 50:180]
    keep_all = FeatureExtractor(
        PANORAMA, detector=detector, similarity_threshold=0, max_features=3000
    )(image)
    some = FeatureExtractor(PANORAMA, detector=detector, max_features=3000)(image)

    def in_patch(found: Features, left: int) -> int:
        u, v = found.pixels.T
        return int(((u > left + 35) & (u < left + 95) & (v > 95) & (v < 155)).sum())

    assert in_patch(keep_all, 50) > 10
    # ORB's levels sample the two copies differently
    share = 0.1 if detector == "sift" else 0.6
    both = in_patch(keep_all, 50) + in_patch(keep_all, 300)
    assert in_patch(some, 50) + in_patch(some, 300) <= share * both
    elsewhere = keep_all.pixels[:, 0] < 30
    assert (some.pixels[:, 0] < 30).sum() >= 0.8 * elsewhere.sum()


def test_turned_panorama_matches_itself() -> None:
    image = texture(512, 256)
    extractor = FeatureExtractor(PANORAMA)
    here, turned = extractor(image), extractor(np.roll(image, -128, axis=1))
    i, j, _ = match_indices(here, turned)
    assert len(i) > 0.8 * len(here)
    # columns to the left by a quarter: everything appears a quarter turn farther left
    turn = wrap_to_pi(turned.azimuth[j] - here.azimuth[i])
    assert np.median(turn) == pytest.approx(np.pi / 2, abs=1e-3)
    assert (np.abs(turn - np.pi / 2) < 0.01).mean() > 0.97


@pytest.mark.parametrize("detector", DETECTORS)
def test_images_with_nothing(detector: str) -> None:
    for value in (0, 128, 255):
        image = np.full((256, 512), value, dtype=np.uint8)
        found = FeatureExtractor(PANORAMA, detector=detector)(image)
        assert len(found) == 0
        assert found.is_binary == (detector == "orb")
        i, j, _ = match_indices(found, found)
        assert i.size == j.size == 0


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((256, 511), np.uint8), "camera's size 512 x 256, got 511 x 256"),
        (np.zeros((256, 512), np.float32), "expected an array of uint8, got float32"),
        (np.zeros((256, 512), np.uint16), "uint16"),
        (np.zeros((256, 512, 4), np.uint8), "expected shape"),
        (np.zeros(512, np.uint8), "expected shape"),
        ([[0]], "got list"),
    ],
)
def test_bad_image(image: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        FeatureExtractor(PANORAMA)(image)


@pytest.mark.parametrize(
    "options",
    [
        {"detector": "surf"},
        {"contrast_threshold": -0.1},
        {"contrast_threshold": float("nan")},
        {"max_features": 0},
        {"similarity_threshold": -1.0},
        {"mask_elevation": (0.3, 0.1)},
        {"mask": np.ones((3, 3))},
    ],
)
def test_bad_option(options: dict) -> None:
    with pytest.raises(ValueError, match=next(iter(options))):
        FeatureExtractor(PANORAMA, **options)


def test_read_image(tmp_path: Path) -> None:
    image = texture(64, 32)
    path = tmp_path / "größe.png"
    path.write_bytes(cv2.imencode(".png", image)[1].tobytes())
    assert np.array_equal(read_image(path), image)
    color = tmp_path / "color.png"
    color.write_bytes(cv2.imencode(".png", np.repeat(image[:, :, None], 3, 2))[1].tobytes())
    assert read_image(color).shape == (32, 64)
    for content in (b"", b"not an image", path.read_bytes()[:40]):
        broken = tmp_path / "broken.png"
        broken.write_bytes(content)
        with pytest.raises(ValueError, match=r"broken\.png: does not decode"):
            read_image(broken)
    with pytest.raises(OSError, match="nothing"):
        read_image(tmp_path / "nothing.png")


def some_features() -> Features:
    return FeatureExtractor(PANORAMA, max_features=20)(texture(512, 256))


def equal(a: Features, b: Features) -> bool:
    names = ("azimuth", "elevation", "descriptors", "pixels", "response")
    return all(
        np.array_equal(getattr(a, n), getattr(b, n)) and getattr(a, n).dtype == getattr(b, n).dtype
        for n in names
    )


def test_feature_file(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    features = some_features()
    features.save(path)
    assert equal(Features.load(path), features)
    Features.empty(binary=True).save(path)
    assert Features.load(path).is_binary
    with pytest.raises(ValueError, match=r"ends in \.npz"):
        features.save(tmp_path / "a.txt")
    with pytest.raises(OSError, match="nothing"):
        Features.load(tmp_path / "nothing.npz")


def test_broken_feature_file(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    some_features().save(path)
    content = path.read_bytes()
    flipped = bytearray(content)
    flipped[len(content) // 2] ^= 0xFF
    broken = [content[:n] for n in (0, 1, 50, len(content) // 2, len(content) - 1)]
    for data in [*broken, bytes(flipped), b"text"]:
        path.write_bytes(data)
        with pytest.raises(ValueError, match=r"a\.npz"):
            Features.load(path)
    np.savez(path, format_version=99)
    with pytest.raises(ValueError, match="format version 99, expected 1"):
        Features.load(path)
    np.savez(path, format_version=1, azimuth=np.zeros(3))
    with pytest.raises(ValueError, match="elevation"):
        Features.load(path)
    np.save(tmp_path / "b.npy", np.zeros(3))
    with pytest.raises(ValueError, match=r"b\.npy"):
        Features.load(tmp_path / "b.npy")
    np.savez(path, format_version=np.array([{"a": 1}], dtype=object))
    with pytest.raises(ValueError, match=r"a\.npz"):
        Features.load(path)


def test_bad_features() -> None:
    good = {
        "azimuth": np.zeros(2),
        "elevation": np.zeros(2),
        "descriptors": np.zeros((2, 32), np.uint8),
        "pixels": np.zeros((2, 2)),
        "response": np.zeros(2),
    }
    assert len(Features(**good)) == 2
    for name, value in [
        ("elevation", np.zeros(3)),
        ("azimuth", np.array([0.0, np.nan])),
        ("pixels", np.zeros((2, 3))),
        ("response", np.array([0.0, np.inf])),
        ("descriptors", np.zeros((3, 32), np.uint8)),
        ("descriptors", np.zeros((2, 30), np.uint8)),
        ("descriptors", np.zeros((2, 32))),
        ("descriptors", np.full((2, 32), np.nan, np.float32)),
    ]:
        with pytest.raises(ValueError, match=name):
            Features(**{**good, name: value})


def test_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = FeatureCache(tmp_path / "deep" / "cache")
    extractor = FeatureExtractor(PANORAMA, max_features=20)
    image = texture(512, 256)
    first = cache(extractor, image)
    assert equal(first, extractor(image))
    entry = cache.path(extractor, image)
    assert list(cache.folder.iterdir()) == [entry]

    # a corrupt entry is computed again and replaced
    entry.write_bytes(entry.read_bytes()[:100])
    assert equal(cache(extractor, image), first)
    assert equal(Features.load(entry), first)

    other = image.copy()
    other[0, 0] ^= 1
    keys = {
        entry,
        cache.path(extractor, other),
        cache.path(FeatureExtractor(PANORAMA, max_features=21), image),
        cache.path(FeatureExtractor(PANORAMA, max_features=20, detector="orb"), image),
        cache.path(FeatureExtractor(PANORAMA, max_features=20, mask=np.ones((256, 512))), image),
        cache.path(
            FeatureExtractor(
                EquirectangularPanorama(512, 256, mount=Mount(yaw=0.1)), max_features=20
            ),
            image,
        ),
    }
    assert len(keys) == 6
    assert cache.path(FeatureExtractor(PANORAMA, max_features=20), image.copy()) == entry

    def fail(self: FeatureExtractor, image: np.ndarray) -> Features:
        raise AssertionError("computed again")

    monkeypatch.setattr(FeatureExtractor, "__call__", fail)
    assert equal(cache(extractor, image), first)


def test_interrupted_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An interrupt while writing leaves neither an entry nor a temporary file."""
    cache = FeatureCache(tmp_path)
    extractor = FeatureExtractor(PANORAMA, max_features=20)
    image = texture(512, 256)

    def interrupted(path: Path, **arrays: np.ndarray) -> None:
        Path(path).write_bytes(b"half")
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(np, "savez", interrupted)
        with pytest.raises(KeyboardInterrupt):
            cache(extractor, image)
    assert list(tmp_path.iterdir()) == []
    assert len(cache(extractor, image)) == 20


def test_default_cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PFLUT_CACHE", str(tmp_path))
    assert FeatureCache().folder == tmp_path / "features"


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("keep", [0.3, 0.5, 0.9])
def test_an_image_cut_short_is_one_error_and_nothing_on_stderr(
    tmp_path: Path, suffix: str, keep: float, capfd: pytest.CaptureFixture[str]
) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (120, 160)).astype(np.uint8)
    whole = cv2.imencode(suffix, noise)[1].tobytes()
    path = tmp_path / f"image{suffix}"
    path.write_bytes(whole)
    assert read_image(path).shape == (120, 160)
    path.write_bytes(whole[: int(keep * len(whole))])
    with pytest.raises(ValueError, match=f"image{suffix}: (does not decode|damaged image)"):
        read_image(path)
    assert capfd.readouterr().err == ""


def test_a_damaged_jpeg_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(1)
    whole = bytearray(cv2.imencode(".jpg", rng.integers(0, 256, (120, 160)).astype(np.uint8))[1])
    middle = len(whole) // 2
    whole[middle : middle + 200] = rng.bytes(200)
    path = tmp_path / "image.jpg"
    path.write_bytes(whole)
    with pytest.raises(ValueError, match=r"image.jpg: damaged image \(Corrupt JPEG data"):
        read_image(path)
    assert capfd.readouterr().err == ""
