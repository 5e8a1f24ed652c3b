from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from naive import cheapest_way, enters_box, first_surface

from pflut.camera.equirectangular import EquirectangularPanorama
from pflut.camera.mount import Mount
from pflut.datasets import simulated_home
from pflut.datasets.simulated_home import load_simulated_home, render_simulated_home
from pflut.geometry import bearing_vectors, wrap_to_pi
from pflut.simulation import raster
from pflut.simulation.drive import RADIUS, cost_to_go, plan_mapping_drive, plan_test_drive
from pflut.simulation.free_space import FreeSpace, free_space_of_walls
from pflut.simulation.home import Home, free_space, is_inside
from pflut.simulation.layout import CEILING, DEPTH, WIDTH
from pflut.simulation.light_points import light_points
from pflut.simulation.lighting import Lighting, LightMap, make_light_map
from pflut.simulation.odometry import simulate_odometry
from pflut.simulation.people import Walkers
from pflut.simulation.renderer import render_linear, render_panorama
from pflut.simulation.scene import Material, SceneBuilder
from pflut.simulation.sensor import develop
from pflut.simulation.shadows import bake, directions_around, grid_of_solids
from pflut.simulation.textures import TextureAtlas, noise

TINY = EquirectangularPanorama(
    96, 24, elevation_min=np.radians(-40), elevation_max=np.radians(50), mount=Mount(height=1.2)
)


@pytest.fixture(scope="module")
def home() -> Home:
    return Home.generate(0)


@pytest.fixture(scope="module")
def light_map(home: Home) -> LightMap:
    return make_light_map(home, Lighting())


def a_free_pose(home: Home, seed: int = 0) -> np.ndarray:
    space = free_space(home)
    cells = np.argwhere(space.clearance > 0.4)
    rng = np.random.default_rng(seed)
    return np.array([*space.points(cells[rng.integers(len(cells))]), rng.uniform(-3.0, 3.0)])


def draw(
    surfaces: np.ndarray, colors: np.ndarray, lens: np.ndarray, azimuths: np.ndarray,
    elevations: np.ndarray, samples: int = 1,
) -> np.ndarray:  # fmt: skip
    """Draw each surface in its own plain color."""
    atlas = TextureAtlas.from_images([np.full((2, 2, 3), 255, dtype=np.uint8)])
    surfaces = surfaces.copy()
    surfaces[:, raster.TEXTURE] = 0
    surfaces[:, raster.CUTOUT] = 0
    surfaces[:, raster.LIGHT] = np.arange(len(surfaces))
    surfaces[:, raster.LIGHT_U : raster.LIGHT_V + 1] = 1
    spans = np.empty((len(surfaces), 3))
    raster.surface_spans(surfaces, lens, spans)
    order = np.flatnonzero(spans[:, 1] >= 0.0)
    order = order[np.argsort(spans[order, 2], kind="stable")]
    shape = (elevations.size // samples, azimuths.size // samples, 3)
    image = np.empty(shape, dtype=np.float32)
    raster.draw_columns(
        surfaces, spans, order, np.array([0.0, CEILING]), atlas.texels, atlas.levels,
        colors.astype(np.float32), np.zeros(len(surfaces)), lens, azimuths, elevations, samples,
        np.empty((samples, elevations.size)), np.empty((samples, elevations.size), dtype=np.int64),
        image,
    )  # fmt: skip
    return image


def test_the_renderer_sees_what_single_rays_meet(home: Home) -> None:
    surfaces = home.scene.surfaces
    rng = np.random.default_rng(1)
    colors = np.repeat(np.arange(len(surfaces))[:, None], 3, axis=1) + 1.0
    agree, kinds = [], set()
    for trial in range(2):
        x, y, _ = a_free_pose(home, trial)
        lens = np.array([x, y, rng.uniform(0.7, 1.8)])
        azimuths = np.sort(rng.uniform(-np.pi, np.pi, 8))[::-1].copy()
        elevations = np.radians(np.linspace(48.0, -40.0, 5)) + rng.uniform(0.0, 0.01)
        image = draw(surfaces, colors, lens, azimuths, elevations)
        for column, azimuth in enumerate(azimuths):
            for row, elevation in enumerate(elevations):
                ray = bearing_vectors(azimuth, elevation)
                expected, t = first_surface(surfaces, lens, ray)
                found = round(float(image[row, column, 0])) - 1
                if found != expected:  # two surfaces in one place: either may be drawn
                    t_found = first_surface(surfaces[found : found + 1], lens, ray)[1]
                    agree.append(abs(t_found - t) < 1e-6)
                else:
                    agree.append(True)
                kinds.add(int(surfaces[expected, raster.KIND]))
    assert np.all(agree)
    assert {raster.QUAD, raster.RECTANGLE} <= kinds


def test_round_surfaces_against_single_rays() -> None:
    rng = np.random.default_rng(2)
    builder = SceneBuilder()
    plain = Material(0)
    for k in range(12):
        x, y = rng.uniform(-3.0, 3.0, 2)
        if k % 2:
            builder.cylinder(
                (x, y), rng.uniform(0.1, 0.6), tuple(np.sort(rng.uniform(0, 2.4, 2))), plain
            )
        else:
            builder.sphere(
                (x, y, rng.uniform(0.5, 2)), rng.uniform(0.2, 0.6), plain, flattening=0.7
            )
    builder.rectangle((-5.0, -5.0), (10.0, 10.0), 0.0, plain)
    surfaces = builder.rows()
    lens = np.array([0.1, 4.5, 1.2])
    azimuths = np.linspace(-0.2, -3.0, 60)
    elevations = np.radians(np.linspace(45.0, -45.0, 40))
    colors = np.repeat(np.arange(len(surfaces))[:, None], 3, axis=1) + 1.0
    image = draw(surfaces, colors, lens, azimuths, elevations)
    expected = [
        [first_surface(surfaces, lens, bearing_vectors(a, e))[0] + 1 for a in azimuths]
        for e in elevations
    ]
    np.testing.assert_array_equal(np.rint(image[..., 0]), expected)
    assert len(np.unique(expected)) > 12


def test_supersampling_is_the_mean_of_its_samples(home: Home) -> None:
    surfaces = home.scene.surfaces
    colors = np.random.default_rng(3).uniform(0.0, 1.0, (len(surfaces), 3))
    lens = np.array([*a_free_pose(home)[:2], 1.2])
    azimuths = np.linspace(3.0, -3.0, 60)
    elevations = np.radians(np.linspace(45.0, -40.0, 40))
    fine = draw(surfaces, colors, lens, azimuths, elevations)
    coarse = draw(surfaces, colors, lens, azimuths, elevations, samples=2)
    mean = fine.reshape(20, 2, 30, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(coarse, mean, atol=1e-5)


def test_a_known_corner_appears_at_its_bearing(home: Home, light_map: LightMap) -> None:
    # a small bright quad is hung into the room; the middle of its picture is where it should be
    pose = a_free_pose(home)
    camera = EquirectangularPanorama(
        720, 180, elevation_min=np.radians(-40), elevation_max=np.radians(50),
        mount=Mount(height=1.2, yaw=0.3), azimuth_center=0.5,
    )  # fmt: skip
    for bearing in (0.4, 2.0, -2.5):
        world = pose[2] + bearing
        x, y = pose[:2] + 0.25 * np.array([np.cos(world), np.sin(world)])
        builder = SceneBuilder()
        with builder.placed(float(x), float(y), float(world - 0.5 * np.pi)):
            builder.quad((-0.01, 0.0), (0.01, 0.0), 1.28, 1.30, Material(0), two_sided=True)
        plain = render_linear(home, pose, camera, light_map)
        marked = render_linear(home, pose, camera, light_map.with_surfaces(builder.rows()))
        v, u = np.nonzero(np.abs(marked - plain).sum(axis=2) > 1e-6)
        azimuth, elevation = camera.bearings([[u.mean(), v.mean()]])
        assert abs(wrap_to_pi(azimuth[0] - bearing)) < np.radians(0.3)
        assert abs(elevation[0] - np.arctan2(0.09, 0.25)) < np.radians(0.3)


def test_textures_read_from_left_to_right_and_down() -> None:
    image = np.zeros((64, 64, 3), dtype=np.uint8)
    image[:32, :32] = 255, 0, 0  # red: top left
    image[:32, 32:] = 0, 255, 0
    image[32:, :32] = 0, 0, 255
    builder = SceneBuilder()
    material = builder.material(image)
    builder.quad((2.0, 1.0), (2.0, -1.0), 0.2, 2.2, material)  # seen looking along +x
    surfaces, points, _ = light_points(builder.rows())
    spans = np.empty((1, 3))
    lens = np.array([0.0, 0.0, 1.2])
    raster.surface_spans(surfaces, lens, spans)
    atlas = TextureAtlas.from_images(builder.images)
    picture = np.empty((40, 40, 3), dtype=np.float32)
    angles = np.linspace(0.3, -0.3, 40)
    raster.draw_columns(
        surfaces, spans, np.array([0]), np.array([0.0, 2.6]), atlas.texels, atlas.levels,
        np.ones((len(points), 3), dtype=np.float32), np.zeros(1), lens, angles, angles, 1,
        np.empty((1, 40)), np.empty((1, 40), dtype=np.int64), picture,
    )  # fmt: skip
    np.testing.assert_allclose(picture[8, [8, 31]], [[1, 0, 0], [0, 1, 0]], atol=1e-6)
    np.testing.assert_allclose(picture[31, [8, 31]], [[0, 0, 1], [0, 0, 0]], atol=1e-6)


def test_far_textures_are_averaged() -> None:
    cells = np.indices((64, 64)).sum(axis=0) % 2 * 255
    atlas = TextureAtlas.from_images([np.repeat(cells[..., None], 3, axis=2).astype(np.uint8)])
    assert atlas.levels[0, 1].tolist() == [64 * 64, 5, 5]
    assert atlas.levels[0, -1].tolist() == atlas.levels[0, 6].tolist()
    assert 127 <= atlas.texels[64 * 64 :, :3].min() <= atlas.texels[64 * 64 :, :3].max() <= 128


@pytest.mark.parametrize(
    "image", [np.zeros((3, 4, 3), np.uint8), np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3))]
)
def test_textures_of_other_shapes_are_refused(image: np.ndarray) -> None:
    with pytest.raises(ValueError, match="texture 0"):
        TextureAtlas.from_images([image])


def test_noise_repeats_without_a_seam() -> None:
    values = noise(np.random.default_rng(0), 64, 128, (4, 8))
    inside = np.abs(np.diff(values, axis=1)).max()
    assert np.abs(values[:, 0] - values[:, -1]).max() <= inside
    assert abs(values.std() - 1.0) < 1e-3


def test_rays_are_stopped_where_single_boxes_stop_them() -> None:
    rng = np.random.default_rng(4)
    angle = rng.uniform(0.0, 6.0, 30)
    boxes = np.column_stack(
        [rng.uniform(-2, 2, (30, 2)), np.cos(angle), np.sin(angle), rng.uniform(0.1, 0.5, (30, 2)),
         rng.uniform(0.0, 0.8, 30), rng.uniform(1.0, 2.0, 30)]
    )  # fmt: skip
    cells, members, grid = grid_of_solids(boxes)
    points = np.column_stack([rng.uniform(-2, 2, (200, 2)), rng.uniform(0.0, 2.0, 200)])
    lamp = np.array([[0.3, -0.4, 2.3, 1.0]])
    values = np.empty((200, 3), dtype=np.float32)
    bake(
        points, np.zeros((200, 3)), np.zeros((200, 3)), boxes, cells, members, grid, lamp,
        np.empty((0, 7)), np.ones(3), np.ones(3), directions_around(8), values,
    )  # fmt: skip
    lit = []
    for point in points:
        ray = lamp[0, :3] - point
        reach = np.linalg.norm(ray)
        lit.append(min(enters_box(box, point, ray / reach) for box in boxes) >= reach)
    np.testing.assert_array_equal(values[:, 0] > 0.0, lit)
    assert 20 < np.sum(lit) < 180


def test_lamps_and_daylight_brighten(home: Home) -> None:
    night = make_light_map(home, Lighting(sky=0.0)).values.mean()
    lamps = make_light_map(home, Lighting(sky=0.0, lamps=(1.0,))).values.mean()
    day = make_light_map(home, Lighting(sky=1.0)).values.mean()
    assert night < 0.1 * lamps
    assert night < 0.1 * day


def test_ways_are_the_cheapest() -> None:
    rng = np.random.default_rng(5)
    cost = np.where(rng.random((20, 30)) < 0.25, np.inf, rng.uniform(1.0, 5.0, (20, 30)))
    cost[7, 9] = 1.0
    total = np.empty_like(cost)
    cost_to_go(cost, 7, 9, total)
    np.testing.assert_allclose(total, cheapest_way(cost, (7, 9)), atol=1e-6)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_home_is_a_home(seed: int) -> None:
    home = Home.generate(seed)
    assert 4 <= len(home.rooms) <= 6
    assert sum(room.area for room in home.rooms) > 0.93 * WIDTH * DEPTH
    assert sum(not o.is_door for o in home.openings) >= len(home.rooms)
    assert len(home.footprints) > 20
    assert len(home.walls) > 4 * len(home.rooms)
    # the same pictures hang in several places
    hung = home.scene.surfaces[:, raster.TEXTURE].astype(int)
    prints = [material.texture for material in home.stock.pictures]
    assert max(np.count_nonzero(hung == texture) for texture in prints) >= 2


def test_another_day_moves_small_things_only(home: Home) -> None:
    later = Home.generate(0, rearrangement=1)
    assert later.rooms == home.rooms
    assert later.openings == home.openings

    def fixed(of: Home) -> set[tuple[float, ...]]:
        chairs = np.isclose(of.footprints[:, 3:], 0.21).all(axis=1)
        return {tuple(row) for row in of.footprints[~chairs]}

    assert fixed(later) == fixed(home)
    a = {tuple(row) for row in home.scene.surfaces.round(6)}
    b = {tuple(row) for row in later.scene.surfaces.round(6)}
    assert 0.6 < len(a & b) / len(a) < 0.98


@pytest.mark.parametrize("seed", range(4))
def test_drives_cover_the_rooms_and_touch_nothing(seed: int) -> None:
    home = Home.generate(seed)
    space = free_space(home)
    mapping = plan_mapping_drive(home, rng=seed)
    test = plan_test_drive(home, rng=seed)
    assert 65 <= len(mapping.images) <= 115
    assert 40 <= len(test.images) <= 75
    for drive in (mapping, test):
        path = drive.path.poses
        # the grid's cells are 5 cm wide
        assert space.at(path[:, :2]).min() > RADIUS - 0.04
        # it drives where it looks, and never jumps
        step = np.diff(path[:, :2], axis=0)
        moved = np.hypot(*step.T) > 0.01
        slip = wrap_to_pi(np.arctan2(step[:, 1], step[:, 0]) - path[:-1, 2])
        assert np.abs(slip[moved]).max() < 0.6
        assert np.hypot(*step.T).max() < 0.05
        assert np.abs(wrap_to_pi(np.diff(path[:, 2]))).max() < 0.6
    # each free place has a reference nearby
    free = space.points(np.argwhere(space.clearance > RADIUS + 0.06))
    gaps = np.hypot(*(free[:, None] - mapping.poses[None, :, :2]).transpose(2, 0, 1)).min(axis=1)
    assert np.quantile(gaps, 0.95) < 1.1
    rooms = {
        k
        for x, y, _ in mapping.poses
        for k, room in enumerate(home.rooms)
        if room.x0 < x < room.x1 and room.y0 < y < room.y1
    }
    assert len(rooms) == len(home.rooms)
    spacing = np.hypot(*np.diff(test.poses[:, :2], axis=0).T)
    assert spacing.max() < 0.45


def test_free_space_knows_walls_and_furniture(home: Home) -> None:
    space = free_space(home)
    assert space.at([[-0.3, 4.0]])[0] == 0.0
    x, y = home.footprints[0, :2]
    assert space.at([[x, y]])[0] == 0.0
    assert is_inside(home, x, y)
    assert not is_inside(home, 11.0, 4.0)
    empty = free_space_of_walls(home.rooms, home.openings)
    assert isinstance(empty, FreeSpace)
    assert (empty.clearance >= space.clearance).all()


def test_panoramas_repeat_with_the_seed(home: Home, light_map: LightMap) -> None:
    pose = a_free_pose(home)
    first, again, other = (
        render_panorama(home, pose, TINY, light_map=light_map, rng=rng) for rng in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert first.shape == (24, 96, 3)
    assert first.std() > 15.0
    assert (first != other).any()
    assert np.abs(first.astype(int) - other).mean() < 10.0


def test_turning_the_robot_turns_the_panorama(home: Home, light_map: LightMap) -> None:
    pose = a_free_pose(home)
    turned = pose + np.array([0.0, 0.0, 2.0 * np.pi / 8.0])
    a = render_linear(home, pose, TINY, light_map)
    b = render_linear(home, turned, TINY, light_map)
    np.testing.assert_allclose(np.roll(a, 96 // 8, axis=1), b, atol=2e-2)


def test_blur_is_the_mean_of_views(home: Home, light_map: LightMap) -> None:
    pose = a_free_pose(home)
    poses = pose + np.outer(np.linspace(-0.5, 0.5, 5), [0.0, 0.0, 0.3])
    quiet = Lighting(shot_noise=0.0, read_noise=0.0)
    sharp = render_panorama(home, pose, TINY, quiet, light_map=light_map, rng=0)
    soft = render_panorama(home, pose, TINY, quiet, light_map=light_map, blur_poses=poses, rng=0)
    gradient = [np.abs(np.diff(i.astype(float), axis=1)).mean() for i in (sharp, soft)]
    assert gradient[1] < 0.9 * gradient[0]


def test_noise_has_the_variance_asked_for() -> None:
    linear = np.full((200, 300, 3), 0.4, dtype=np.float32)
    rng = np.random.default_rng(6)
    image = np.empty(linear.shape, dtype=np.uint8)
    normals = rng.standard_normal(linear.shape, dtype=np.float32)
    develop(linear, np.ones(3), 2e-3, 1e-2, normals, image)
    value = -np.log(1.0 - (image / 255.0) ** 2)
    sd = np.sqrt(2e-3 * 0.4 + 1e-4)
    assert abs(value.std() - sd) < 0.03 * sd  # 180,000 samples, and the steps of 1/255
    assert abs(value.mean() - 0.4) < 5.0 * sd / np.sqrt(linear.size) + 1e-3


@pytest.mark.parametrize("pose", [[-1.0, 4.0, 0.0], [0.0, np.nan, 0.0], [1.0, 2.0]])
def test_poses_outside_are_refused(home: Home, light_map: LightMap, pose: list[float]) -> None:
    with pytest.raises(ValueError, match="pose"):
        render_panorama(home, pose, TINY, light_map=light_map)


def test_a_pose_in_a_wall_is_refused(home: Home, light_map: LightMap) -> None:
    room = next(room for room in home.rooms if room.x1 < WIDTH)
    doors = [o for o in home.openings if o.is_door]
    middle = next(
        y for y in np.linspace(room.y0 + 0.1, room.y1 - 0.1, 40)
        if not is_inside(home, room.x1 + 0.06, y)
    )  # fmt: skip
    assert doors
    with pytest.raises(ValueError, match="wall"):
        render_panorama(home, [room.x1 + 0.06, middle, 0.0], TINY, light_map=light_map)


@pytest.mark.parametrize(
    "camera",
    [
        EquirectangularPanorama(96, 24, mount=Mount(pitch=0.1)),
        EquirectangularPanorama(96, 24, mount=Mount(height=3.0)),
        "camera",
    ],
)
def test_other_cameras_are_refused(home: Home, light_map: LightMap, camera: object) -> None:
    with pytest.raises(ValueError, match="camera"):
        render_panorama(home, a_free_pose(home), camera, light_map=light_map)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", [-1, 1.5, "0", True, None])
def test_a_seed_that_is_none_is_refused(seed: object, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="seed: expected an integer"):
        Home.generate(seed)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="seed: expected an integer"):
        load_simulated_home(seed, cache_dir=tmp_path)  # type: ignore[arg-type]


@pytest.mark.parametrize("options", [{"people": -1}, {"motion_blur": -0.1}, {"motion_blur": 2.0}])
def test_options_that_make_no_sense_are_refused(options: dict[str, float], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=next(iter(options))):
        load_simulated_home(0, cache_dir=tmp_path, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("values", [{"sky": -1.0}, {"lamps": ()}, {"exposure": np.nan}])
def test_light_that_is_none_is_refused(values: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="Lighting"):
        Lighting(**values)  # type: ignore[arg-type]


def test_people_are_seen_but_not_on_the_robot(home: Home, light_map: LightMap) -> None:
    walkers = Walkers.plan(home, 2, rng=np.random.default_rng(0))
    where = walkers.poses(3.0)
    assert where.shape == (2, 3)
    far = walkers.light_map(light_map, 3.0, np.array([100.0, 0.0, 0.0]))
    assert len(far.surfaces) > len(light_map.surfaces) + 20
    near = walkers.light_map(light_map, 3.0, where[0])
    assert len(near.surfaces) < len(far.surfaces)
    assert np.isfinite(far.values).all()


made_before = cache(Home.generate)


@pytest.fixture
def coarse_light(monkeypatch: pytest.MonkeyPatch) -> None:
    """Homes made before, with a tenth of the light: where it is not about the pictures."""
    monkeypatch.setattr("pflut.simulation.light_points.TEXEL", 1.5)
    monkeypatch.setattr(Home, "generate", made_before)


@pytest.mark.usefixtures("coarse_light")
def test_the_dataset_does_not_depend_on_threads(tmp_path: Path) -> None:
    folders = [
        render_simulated_home(
            tmp_path / str(threads), 0, people=1, motion_blur=0.05, camera=TINY, max_images=3,
            threads=threads,
        )
        for threads in (1, 3)
    ]  # fmt: skip
    names = sorted(p.relative_to(folders[0]) for p in folders[0].rglob("*") if p.is_file())
    assert len(names) >= 11
    for name in names:
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes()


@pytest.mark.usefixtures("coarse_light")
def test_a_home_is_rendered_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[int, int]] = []

    def small(path: Path, seed: int, **options: object) -> Path:
        return render_simulated_home(path, seed, camera=TINY, max_images=4, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(simulated_home, "render_simulated_home", small)
    dataset = load_simulated_home(0, cache_dir=tmp_path, progress=lambda a, b: calls.append((a, b)))
    assert calls == [(k, 8) for k in range(1, 9)]
    again = load_simulated_home(0, cache_dir=tmp_path, progress=lambda a, b: calls.append((a, b)))
    assert len(calls) == 8
    assert again.image_paths == dataset.image_paths
    assert dataset.reference_indices.tolist() == [0, 1, 2, 3]
    assert dataset.query_indices.tolist() == [4, 5, 6, 7]
    assert dataset.ground_truth is not None and np.isfinite(dataset.ground_truth).all()
    assert dataset.odometry is not None
    assert np.isnan(dataset.odometry[:4]).all() and np.isfinite(dataset.odometry[4:]).all()
    assert dataset.floor_plan is not None
    assert dataset.image(5).shape == (24, 96)
    assert dataset.camera == TINY


@pytest.mark.usefixtures("coarse_light")
def test_an_interrupted_rendering_starts_again(tmp_path: Path) -> None:
    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    target = tmp_path / "home"
    with pytest.raises(KeyboardInterrupt):
        render_simulated_home(target, 0, camera=TINY, max_images=2, progress=interrupt)
    assert not target.exists()
    assert render_simulated_home(target, 0, camera=TINY, max_images=2).is_dir()


def test_odometry_without_noise_is_exact() -> None:
    poses = np.cumsum(np.random.default_rng(7).normal(0.0, 0.3, (30, 3)), axis=0)
    measured = simulate_odometry(
        poses, rotation_noise_from_rotation=0.0, rotation_noise_from_translation=0.0,
        translation_noise_from_translation=0.0, translation_noise_from_rotation=0.0, scale=1.0,
        heading_drift=0.0,
    )  # fmt: skip
    from pflut.geometry import relative_pose

    np.testing.assert_allclose(measured, relative_pose(poses[0], poses), atol=1e-9)


def test_odometry_noise_has_the_variances_of_the_model() -> None:
    # the same step many times, each from the origin of its own
    n = 20_000
    steps = np.tile([0.4, 0.0, 0.3], (n, 1))
    poses = np.zeros((2 * n, 3))
    poses[1::2] = steps
    measured = simulate_odometry(
        poses, rotation_noise_from_rotation=0.01, rotation_noise_from_translation=0.02,
        translation_noise_from_translation=0.005, translation_noise_from_rotation=0.003,
        scale=1.1, heading_drift=0.05, rng=8,
    )  # fmt: skip
    from pflut.geometry import relative_pose

    out = relative_pose(measured[0::2], measured[1::2])
    length = np.hypot(out[:, 0], out[:, 1])
    first = np.arctan2(out[:, 1], out[:, 0])
    second = wrap_to_pi(out[:, 2] - first)
    along = np.sqrt(0.005 * 0.16 + 0.003 * 0.09)
    expected = [
        (length, 0.44, along),
        (first, 0.0, np.sqrt(0.02 * 0.16)),
        (second, 0.3 + 0.05 * 0.4, np.sqrt(0.01 * 0.09 + 0.02 * 0.16)),
    ]
    for values, mean, sd in expected:
        assert abs(values.mean() - mean) < 5.0 * sd / np.sqrt(n)
        assert abs(values.std() - sd) < 5.0 * sd / np.sqrt(2.0 * n)


@pytest.mark.parametrize("options", [{"scale": 0.0}, {"heading_drift": np.inf}])
def test_odometry_parameters_that_make_no_sense_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="odometry"):
        simulate_odometry(np.zeros((2, 3)), **options)  # type: ignore[arg-type]
