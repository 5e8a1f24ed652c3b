"""The sensor model: its kernels' naive twins, what is undefined, and a synthetic world."""

from __future__ import annotations

import naive
import numpy as np
import pytest
from test_posterior import turn_on_the_spot
from world import REFERENCES, World

from pflut.correspondences import Correspondences, ReferenceMatch
from pflut.features import Features
from pflut.geometry import compose, wrap_to_pi
from pflut.likelihood.table import LikelihoodTable
from pflut.localization.reference_image_model import ReferenceImageModel
from pflut.localization.sensor_kernels import add_reference, rotation_curve
from pflut.reference_map import ReferenceMap
from pflut.simulation.correspondences import CorrespondenceSimulator

POSE = np.array([0.6, 0.2, 0.8])


def random_poses(n: int, seed: int = 0, reach: float = 6.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform([-reach, -reach, -7.0], [reach, reach, 7.0], (n, 3))


@pytest.fixture(scope="module")
def world() -> World:
    return World()


@pytest.fixture(scope="module")
def reference_map(world: World) -> ReferenceMap:
    return world.map(REFERENCES)


@pytest.fixture(scope="module")
def model(reference_map: ReferenceMap, default_table: LikelihoodTable) -> ReferenceImageModel:
    return ReferenceImageModel(reference_map, default_table, max_range=5.0)


def around(pose: np.ndarray, n: int = 4000, seed: int = 1) -> np.ndarray:
    """The pose itself, then others in all of the room."""
    rng = np.random.default_rng(seed)
    others = rng.uniform([-3.5, -2.5, -np.pi], [3.5, 2.5, np.pi], (n, 3))
    return np.concatenate([pose[None], others])


# --- kernels --------------------------------------------------------------------------------------


def added(
    poses: np.ndarray,
    reference: np.ndarray,
    grid: np.ndarray,
    *,
    temperature: float = 1.0,
    share: float = 0.5,
    near: float = 0.0,
) -> np.ndarray:
    """What a reference adds to particles, of which it fades out from 3 to 4 m."""
    out = np.zeros(len(poses))
    columns = np.ascontiguousarray(poses.T)
    curve = rotation_curve(grid, temperature, share)
    add_reference(*columns, reference, grid, temperature, share, curve, near, 3.0, 4.0, out)
    return out


@pytest.mark.parametrize("scale", [0.0, 1.0, 20.0, 900.0])
@pytest.mark.parametrize(("temperature", "share"), [(1.0, 0.5), (0.3, 0.9), (0.05, 0.01)])
def test_rotation_curve_equals_its_naive_twin(
    scale: float, temperature: float, share: float
) -> None:
    grid = (scale * np.random.default_rng(0).normal(size=(12, 12))).astype(np.float32)
    curve = rotation_curve(grid, temperature, share)
    expected = naive.rotation_curve(grid, temperature, share)
    assert curve[:12] == pytest.approx(expected, rel=1e-5, abs=2e-5)
    assert curve[12] == curve[0]


@pytest.mark.parametrize("n", [0, 1, 255, 256, 257, 700])
@pytest.mark.parametrize(("scale", "temperature", "share"), [(1.0, 1.0, 0.5), (300.0, 0.3, 0.9)])
def test_add_reference_equals_its_naive_twin(
    n: int, scale: float, temperature: float, share: float
) -> None:
    rng = np.random.default_rng(2)
    grid = (scale * rng.normal(size=(10, 10))).astype(np.float32)
    poses, reference = random_poses(n, 3), np.array([0.3, -0.2, 2.5])
    poses[n // 2 :, :2] *= 0.1  # near ones, too
    got = added(poses, reference, grid, temperature=temperature, share=share, near=0.5)
    for pose, value in zip(poses, got, strict=True):
        expected = naive.reference_log_likelihood(
            pose, reference, grid, temperature, share, 0.5, 3.0, 4.0
        )
        # a cell's place is good to 1e-5
        assert value == pytest.approx(expected, abs=1e-4 * max(1.0, temperature * scale))


def test_add_reference_adds() -> None:
    rng = np.random.default_rng(3)
    grid = rng.normal(size=(10, 10)).astype(np.float32)
    poses, reference = random_poses(300, 3), np.array([0.3, -0.2, 2.5])
    curve, out = rotation_curve(grid, 1.0, 0.5), rng.normal(size=300)
    before = out.copy()
    add_reference(*poses.T.copy(), reference, grid, 1.0, 0.5, curve, 0.0, 3.0, 4.0, out)
    assert out - before == pytest.approx(added(poses, reference, grid), abs=1e-12)


def test_add_reference_wraps_around() -> None:
    """Both sides of every seam: the atan2's, the headings', the grid's own."""
    grid = np.random.default_rng(4).normal(size=(8, 8)).astype(np.float32)
    eps = 1e-9
    reference = np.array([0.0, 0.0, 0.0])
    cases = []
    for k in range(-16, 17):
        angle = k * np.pi / 8
        for heading in (angle, angle + np.pi, 0.3):
            cases += [
                [np.cos(angle - eps), np.sin(angle - eps), heading - eps],
                [np.cos(angle + eps), np.sin(angle + eps), heading + eps],
            ]
    poses = np.array(cases)
    out = added(poses, reference, grid)
    assert np.abs(out[::2] - out[1::2]).max() < 2e-5
    turned = poses + np.array([0.0, 0.0, 4 * np.pi])
    assert added(turned, reference, grid) == pytest.approx(out, abs=2e-5)


def test_cell_centres_give_the_cells_own_values() -> None:
    bins = 16
    grid = np.random.default_rng(5).normal(size=(bins, bins)).astype(np.float32)
    centers = (np.arange(bins) + 0.5) * 2 * np.pi / bins
    reference = np.array([1.0, 2.0, 0.7])
    for i, theta in enumerate(centers):
        direction = theta + reference[2]
        x, y = reference[0] + np.cos(direction), reference[1] + np.sin(direction)
        poses = np.array([[x, y, direction + np.pi - phi] for phi in centers])
        expected = naive.linked(grid[i].astype(float), 1.0, 0.5)
        assert added(poses, reference, grid) == pytest.approx(expected, abs=1e-4)


# --- what is undefined ----------------------------------------------------------------------------


def test_nothing_said_where_nothing_is_known(model: ReferenceImageModel, world: World) -> None:
    observation = world.look(POSE, 0)
    far = random_poses(50) + np.array([100.0, 0.0, 0.0])
    assert (model.log_likelihood(far, observation) == 0).all()
    assert model.match(far, observation) == []
    assert (model.log_likelihood(random_poses(50), observation[:0]) == 0).all()
    assert model.log_likelihood(np.zeros((0, 3)), observation).shape == (0,)
    assert (model.log_likelihood_of_matches(random_poses(9), []) == 0).all()


def test_features_that_match_nothing(model: ReferenceImageModel) -> None:
    foreign = World(seed=77).look(POSE, 0)
    values = model.log_likelihood(around(POSE), foreign)
    assert np.isfinite(values).all()
    # a few coincidences may match; they cost a bounded amount and convince nobody
    assert np.ptp(values) < 6.0


def test_references_without_features_are_neutral(
    reference_map: ReferenceMap, default_table: LikelihoodTable, world: World
) -> None:
    observation = world.look(POSE, 0)
    poses = around(POSE, 500)
    empty = reference_map.features[0][:0]
    more = reference_map.add([0.0, 0.0, 0.0], empty, "black")
    with_empty = ReferenceImageModel(more, default_table, max_range=5.0)
    without = ReferenceImageModel(reference_map, default_table, max_range=5.0)
    assert with_empty.log_likelihood(poses, observation) == pytest.approx(
        without.log_likelihood(poses, observation)
    )


def test_a_particle_on_a_reference(model: ReferenceImageModel, world: World) -> None:
    """Its direction is undefined, its rotation is not: finite, and the right heading is best."""
    observation = world.look(REFERENCES[2], 5)
    headings = np.linspace(-np.pi, np.pi, 181)[:-1]
    poses = np.tile(REFERENCES[2], (180, 1))
    poses[:, 2] = headings
    values = model.log_likelihood(poses, observation)
    assert np.isfinite(values).all()
    best = headings[np.argmax(values)]
    assert abs(wrap_to_pi(best - REFERENCES[2, 2])) < 0.08
    assert values.max() - np.median(values) > 5.0


def test_no_step_around_a_reference(default_table: LikelihoodTable, world: World) -> None:
    """Standing on a reference is no worse than standing at the edge of its near range.

    Also where the posterior is so sharp that its exponentials do not fit a number.
    """
    one = world.map(REFERENCES[:1])
    for temperature in (0.3, 1.0):
        sensor = ReferenceImageModel(one, default_table, temperature=temperature, max_range=5.0)
        match = ReferenceMatch(0, turn_on_the_spot(0.4, 400, 0))
        angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
        rows = []
        for distance in (0.0, 0.05, 0.15, 0.29, 0.31):
            poses = np.column_stack(
                [
                    REFERENCES[0, 0] + distance * np.cos(angle),
                    REFERENCES[0, 1] + distance * np.sin(angle),
                    np.full(720, REFERENCES[0, 2] + 0.4),
                ]
            )
            rows.append(sensor.log_likelihood_of_matches(poses, [match]))
        on_it, edge = rows[0].mean(), rows[-1]
        assert np.ptp(rows[0]) < 1e-6
        # a mean over all directions lies between the worst and the best of these
        assert edge.min() - 6 < on_it < edge.max() + 6
        assert on_it > 200 * temperature


@pytest.mark.parametrize("near", [0.3, 0.35, 0.7])
def test_finite_on_the_edge_of_the_near_range(
    default_table: LikelihoodTable, world: World, near: float
) -> None:
    """Where the kernel's float32 and the box's float64 may see it differently."""
    one = world.map(REFERENCES[:1])
    sensor = ReferenceImageModel(one, default_table, near_range=near, max_range=5.0)
    match = ReferenceMatch(0, CorrespondenceSimulator().pair(50, 0)[0])
    for angle in np.radians(np.arange(360)):
        x, y, heading = REFERENCES[0]
        pose = [x + near * np.cos(angle), y + near * np.sin(angle), heading]
        assert np.isfinite(sensor.log_likelihood_of_matches(pose, [match])).all()


@pytest.mark.parametrize("turns", [1, 1000, 10**6])
def test_headings_of_many_turns(default_table: LikelihoodTable, world: World, turns: int) -> None:
    match = ReferenceMatch(0, CorrespondenceSimulator(mismatch=0.5).pair(100, 0)[0])
    poses = around(POSE, 300)
    values = []
    for on_poses, on_reference in ((0, 0), (turns, 0), (0, turns), (-turns, turns)):
        references = REFERENCES[:1] + np.array([0.0, 0.0, 2 * np.pi * on_reference])
        sensor = ReferenceImageModel(
            ReferenceMap.of_poses(references), default_table, max_range=8.0
        )
        turned = poses + np.array([0.0, 0.0, 2 * np.pi * on_poses])
        values.append(sensor.log_likelihood_of_matches(turned, [match]))
    assert np.ptp(values[0]) > 5.0
    for value in values[1:]:
        assert value == pytest.approx(values[0], abs=2e-3)


def test_poses_far_beyond_a_float(default_table: LikelihoodTable) -> None:
    match = ReferenceMatch(0, CorrespondenceSimulator().pair(50, 0)[0])
    sensor = ReferenceImageModel(ReferenceMap.of_poses(REFERENCES[:1]), default_table)
    poses = [[1e39, 1e39, 0.0], [-1e200, 0.0, 1e17], [0.0, 1e16, -1e9]]
    assert (sensor.log_likelihood_of_matches(poses, [match]) == 0.0).all()


class Guarded:
    """A table whose grids are NaN in all cells that were not asked for; or that ignores that."""

    def __init__(self, table: LikelihoodTable, *, ignores: bool = False) -> None:
        self.table, self.bins, self.ignores, self.spared = table, table.bins, ignores, 0

    def log_likelihood_grid(
        self,
        c: Correspondences,
        bins: int | None = None,
        *,
        window: np.ndarray | None = None,
    ) -> np.ndarray:
        grid = self.table.log_likelihood_grid(c, bins)
        if window is None or self.ignores:
            return np.asfortranarray(grid)
        asked = np.zeros(grid.shape, bool)
        rows, columns = ((first + np.arange(n)) % self.bins for first, n in window)
        asked[np.ix_(rows, columns)] = True
        self.spared += int((~asked).sum())
        return np.where(asked, grid, np.float32(np.nan))


@pytest.mark.parametrize("spread", [0.02, 0.3, 2.0])
def test_what_is_not_computed_is_not_needed(default_table: LikelihoodTable, spread: float) -> None:
    rng = np.random.default_rng(0)
    references = rng.uniform([-4, -4, -np.pi], [4, 4, np.pi], (12, 3))
    pairs, _ = CorrespondenceSimulator(mismatch=0.5).pairs(12, 50, rng=1)
    matches = [ReferenceMatch(k, pair) for k, pair in enumerate(pairs)]
    guarded = Guarded(default_table)
    for _ in range(20):
        center = rng.uniform([-4, -4, -np.pi], [4, 4, np.pi])
        poses = rng.normal(center, [spread, spread, spread], (300, 3))
        values = [
            ReferenceImageModel(
                ReferenceMap.of_poses(references), likelihood, max_range=6.0
            ).log_likelihood_of_matches(poses, matches)
            for likelihood in (guarded, Guarded(default_table, ignores=True))
        ]
        assert (values[0] == values[1]).all()
    assert guarded.spared > 0


def test_likelihood_fades_with_the_distance(default_table: LikelihoodTable, world: World) -> None:
    one = world.map(REFERENCES[:1])
    sensor = ReferenceImageModel(one, default_table, max_range=4.0)
    pair, theta, phi = CorrespondenceSimulator(mismatch=0.3).pair(60, 0)
    match = ReferenceMatch(0, pair)
    distance = np.array([1.0, 2.0, 2.99, 3.5, 3.9, 3.999, 4.0, 4.1])
    direction = theta + REFERENCES[0, 2]
    poses = np.column_stack(
        [
            REFERENCES[0, 0] + distance * np.cos(direction),
            REFERENCES[0, 1] + distance * np.sin(direction),
            np.full(8, direction + np.pi - phi),
        ]
    )
    values = sensor.log_likelihood_of_matches(poses, [match])
    assert values[1:3] == pytest.approx(values[0], rel=1e-3)
    assert values[3] == pytest.approx(values[0] / 2, rel=1e-3)
    assert (np.diff(values[2:7]) < 0).all()
    assert (values[6:] == 0).all()


# --- a synthetic world ----------------------------------------------------------------------------


def test_the_true_pose_is_best(model: ReferenceImageModel, world: World) -> None:
    rng = np.random.default_rng(3)
    for seed in range(8):
        pose = rng.uniform([-1.8, -1.2, -np.pi], [1.8, 1.2, np.pi])
        poses = around(pose, seed=seed)
        values = model.log_likelihood(poses, world.look(pose, seed))
        away = np.hypot(*(poses[:, :2] - pose[:2]).T)
        turned = np.abs(wrap_to_pi(poses[:, 2] - pose[2]))
        wrong = (away > 0.4) | (turned > np.deg2rad(15))
        assert values[0] > values[wrong].max()
        best = np.argmax(values)
        assert away[best] < 0.4
        assert turned[best] < np.deg2rad(15)


def test_matches_are_the_landmarks_of_both_views(model: ReferenceImageModel, world: World) -> None:
    """Nothing is exchanged on the way: L is the reference, R the image."""
    matches = model.match(POSE[None], world.look(POSE, 1, noise=0.0))
    assert 3 <= len(matches) <= model.max_references
    counts = [len(m.correspondences) for m in matches]
    assert counts == sorted(counts, reverse=True)
    for match in matches:
        reference = REFERENCES[match.index]
        c = match.correspondences
        dx, dy = POSE[:2] - reference[:2]
        theta, phi = np.arctan2(dy, dx) - reference[2], np.arctan2(-dy, -dx) - POSE[2]
        bearings = np.stack([c.azimuth_l, c.elevation_l, c.azimuth_r, c.elevation_r], 1)
        residuals = [abs(naive.epipolar_residual(b, theta, phi)[0]) for b in bearings]
        assert np.mean(np.array(residuals) < 0.03) > 0.8


def test_more_references_make_it_sharper(
    reference_map: ReferenceMap, default_table: LikelihoodTable, world: World
) -> None:
    observation, poses = world.look(POSE, 2), around(POSE, 20_000)
    shares = []
    for count in (1, 2, 6):
        sensor = ReferenceImageModel(
            reference_map, default_table, max_references=count, max_range=5.0
        )
        assert len(sensor.match(poses, observation)) == count
        values = sensor.log_likelihood(poses, observation)
        weights = np.exp(values - values.max())
        shares.append(weights.sum() ** 2 / (weights**2).sum())
    assert shares[0] > 3 * shares[1] > 3 * shares[2]


def test_temperature_flattens_and_the_floor_bounds(
    reference_map: ReferenceMap, default_table: LikelihoodTable, world: World
) -> None:
    observation, poses = world.look(POSE, 2), around(POSE)
    ranges = []
    for temperature in (1.0, 0.3, 0.05):
        sensor = ReferenceImageModel(
            reference_map, default_table, temperature=temperature, max_range=5.0
        )
        values = sensor.log_likelihood(poses, observation)
        ranges.append(np.ptp(values))
        # each of six references costs a wrong pose at most the log of 1 - link_probability
        assert values.min() >= 6 * np.log(0.5) - 1e-3
    assert ranges[0] > ranges[1] > ranges[2] > 0


def test_likelihoods_add_up(model: ReferenceImageModel, world: World) -> None:
    poses = around(POSE, 300)
    matches = model.match(poses, world.look(POSE, 4))
    parts = [model.log_likelihood_of_matches(poses, [m]) for m in matches]
    total = model.log_likelihood_of_matches(poses, matches)
    assert total == pytest.approx(np.sum(parts, axis=0))
    assert model.log_likelihood(poses, world.look(POSE, 4)) == pytest.approx(total)


def test_moving_the_whole_map_moves_the_likelihood(
    model: ReferenceImageModel, default_table: LikelihoodTable, world: World
) -> None:
    frame = np.array([5.0, -3.0, 2.2])
    moved = ReferenceMap(
        compose(frame, REFERENCES), model.reference_map.features, model.reference_map.names
    )
    sensor = ReferenceImageModel(moved, default_table, max_range=5.0)
    poses, observation = around(POSE, 300), world.look(POSE, 4)
    expected = model.log_likelihood(poses, observation)
    assert sensor.log_likelihood(compose(frame, poses), observation) == pytest.approx(
        expected, abs=1e-3
    )


def test_min_matches_silences_a_reference(
    reference_map: ReferenceMap, default_table: LikelihoodTable, world: World
) -> None:
    observation = world.look(POSE, 4)
    usual = ReferenceImageModel(reference_map, default_table).match(POSE[None], observation)
    counts = [len(m.correspondences) for m in usual]
    strict = ReferenceImageModel(reference_map, default_table, min_matches=counts[0])
    assert [m.index for m in strict.match(POSE[None], observation)] == [usual[0].index]
    silent = ReferenceImageModel(reference_map, default_table, min_matches=counts[0] + 1)
    assert not silent.log_likelihood(around(POSE, 9), observation).any()


def test_matches_of_ones_own(model: ReferenceImageModel, world: World) -> None:
    """What a matcher of one's own found counts as what the model finds, without any feature."""
    pose = np.array([1.5, 1.0, 0.4])
    poses = around(pose)
    found = model.match(poses, world.look(pose, 1))
    bare = ReferenceImageModel(ReferenceMap.of_poses(REFERENCES), model.likelihood, max_range=5.0)
    assert len(found) > 1
    np.testing.assert_array_equal(
        bare.log_likelihood(poses, found[::-1]), model.log_likelihood(poses, found)
    )
    np.testing.assert_array_equal(
        model.log_likelihood(poses, found), model.log_likelihood(poses, world.look(pose, 1))
    )
    assert bare.match(poses + np.array([100.0, 0.0, 0.0]), found) == []
    assert not bare.log_likelihood(poses, ()).any()
    with pytest.raises(ValueError, match="observation: expected matches with references 0 to"):
        bare.match(poses, [ReferenceMatch(len(REFERENCES), found[0].correspondences)])


def test_images_need_an_extractor(
    reference_map: ReferenceMap, default_table: LikelihoodTable, world: World
) -> None:
    image = np.zeros((4, 8), np.uint8)
    without = ReferenceImageModel(reference_map, default_table)
    with pytest.raises(ValueError, match="made without an extractor"):
        without.log_likelihood(POSE[None], image)
    features = world.look(POSE, 3)
    sensor = ReferenceImageModel(reference_map, default_table, extractor=lambda _: features)
    expected = sensor.log_likelihood(POSE[None], features)
    assert sensor.log_likelihood(POSE[None], image) == expected


def test_features_of_another_kind(model: ReferenceImageModel) -> None:
    binary = Features([0.1], [0.2], np.zeros((1, 32), np.uint8), np.zeros((1, 2)), np.ones(1))
    with pytest.raises(ValueError, match="descriptors: expected one kind"):
        model.log_likelihood(POSE[None], binary)


@pytest.mark.parametrize("poses", [np.zeros((3, 2)), [[0.0, np.nan, 0.0]]])
def test_poses_that_are_none(model: ReferenceImageModel, world: World, poses) -> None:
    with pytest.raises(ValueError, match="poses: "):
        model.log_likelihood(poses, world.look(POSE, 3))


@pytest.mark.parametrize(
    "options",
    [
        {"temperature": 0.0},
        {"temperature": 2.0},
        {"link_probability": 0.0},
        {"link_probability": 1.0},
        {"max_references": 0},
        {"max_candidates": 0},
        {"min_matches": 0},
        {"near_range": -0.1},
        {"near_range": 3.0, "max_range": 2.0},
        {"ratio": 0.0},
        {"ratio": 1.5},
    ],
)
def test_misuse_names_the_option(
    reference_map: ReferenceMap, small_table: LikelihoodTable, options: dict
) -> None:
    with pytest.raises(ValueError, match=f"^{next(iter(options))}: expected"):
        ReferenceImageModel(reference_map, small_table, **options)


def test_range_by_default(world: World, small_table: LikelihoodTable) -> None:
    """Six times the spacing; with references side by side it is still a range."""
    spread = ReferenceImageModel(world.map(REFERENCES), small_table)
    assert spread.max_range == pytest.approx(6 * spread.reference_map.spacing)
    assert ReferenceImageModel(world.map(REFERENCES[:1]), small_table).max_range == 5.0
    beside = np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 1.0]])
    assert ReferenceImageModel(world.map(beside), small_table).max_range == pytest.approx(1.2)


def test_one_match_is_finite(model: ReferenceImageModel) -> None:
    match = ReferenceMatch(0, Correspondences([1.0], [np.pi / 2], [2.0], [-np.pi / 2]))
    assert np.isfinite(model.log_likelihood_of_matches(random_poses(200), [match])).all()
