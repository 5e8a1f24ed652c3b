"""Speed: times with ``--benchmark-enable``, and ratios within one run that must hold anywhere.

A ratio is of the best times of two functions called in turn. It is tried again while it is too
large: a busy machine slows one of them now and then, a real regression slows it every time.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numba
import numpy as np
import pytest
from world import REFERENCES, World

from pflut.correspondences import Correspondences
from pflut.likelihood import dense_learning, learning
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.table import LikelihoodTable
from pflut.localization.reference_image_model import ReferenceImageModel
from pflut.localization.sensor_kernels import add_reference
from pflut.posterior import pose_posterior
from pflut.relpose.estimate import estimate_relative_pose
from pflut.relpose.ransac import ransac_relative_poses
from pflut.relpose.search import estimate_relative_poses
from pflut.simulation.correspondences import CorrespondenceSimulator

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="the compiler is off")


def ratio_of_best(
    ours: Callable[[], object], bound: Callable[[], object], limit: float, *, tries: int = 12
) -> float:
    """The ratio of the best times, measured until it is within the limit or the tries are over."""
    best = np.full(2, np.inf)
    for _ in range(tries):
        for _ in range(40):
            for i, function in enumerate((ours, bound)):
                start = perf_counter()
                function()
                best[i] = min(best[i], perf_counter() - start)
        if best[0] <= limit * best[1]:
            break
    return float(best[0] / best[1])


@pytest.fixture(scope="module")
def pair() -> Correspondences:
    return CorrespondenceSimulator(mismatch=0.8).pair(25, 0)[0]


def additions_of(table: DenseTable) -> Callable[[], np.ndarray]:
    """Add contiguous slices of the paper's table, one a correspondence: the least it can do."""
    arrays = [table.log_ratio[i].copy() for i in np.linspace(0, 127, 25).astype(int)]

    def additions() -> np.ndarray:
        total = np.zeros((128, 128), np.float32)
        for array in arrays:
            total += array
        return total

    return additions


@pytest.mark.parametrize("kind", ["dense_table", "default_table"])
def test_posterior_grid_costs_about_the_additions(
    kind: str, dense_table: DenseTable, pair: Correspondences, request: pytest.FixtureRequest
) -> None:
    """Shifting, wrapping and choosing the slices may cost half of adding contiguous arrays.

    A ridge is few cells a row instead of all of them, but has to be found.
    """
    table = request.getfixturevalue(kind)
    ratio = ratio_of_best(lambda: table.log_likelihood_grid(pair), additions_of(dense_table), 1.5)
    assert ratio <= 1.5


def test_estimate_costs_less_than_a_ransac_of_many_iterations(
    default_table: LikelihoodTable,
) -> None:
    """The best planar RANSAC, with as many samples as it needs for nearly the same success."""
    _, angles = CorrespondenceSimulator(mismatch=0.9).sample(64, 100, 0)
    pairs = [Correspondences(*a.T) for a in angles]
    ratio = ratio_of_best(
        lambda: estimate_relative_poses(pairs, default_table),
        lambda: ransac_relative_poses(pairs),
        1.0,
        tries=3,
    )
    assert ratio <= 1.0


def test_a_look_up_costs_less_than_twice_its_parts(default_table: LikelihoodTable) -> None:
    """A particle in a reference's grid: one direction and four cells, when NumPy gets them."""
    poses = np.random.default_rng(0).uniform([-2, -2, -3], [2, 2, 3], (10_000, 3))
    x, y, heading = np.ascontiguousarray(poses.T)
    grid = default_table.log_likelihood_grid(CorrespondenceSimulator().pair(50, 0)[0])
    reference, curve, out = np.zeros(3), np.zeros(len(grid) + 1), np.zeros(len(poses))
    cells = np.random.default_rng(1).integers(grid.size, size=(4, len(poses)))

    def look_up() -> None:
        add_reference(x, y, heading, reference, grid, 0.3, 0.5, curve, 0.0, 15.0, 20.0, out)

    def parts() -> None:
        np.arctan2(y, x)
        for corner in cells:
            grid.take(corner)

    assert ratio_of_best(look_up, parts, 2.0) <= 2.0


# --- times ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [25, 100])
def test_time_of_the_posterior_grid(benchmark, default_table: LikelihoodTable, n: int) -> None:
    c = CorrespondenceSimulator(mismatch=0.8).pair(n, 0)[0]
    benchmark(default_table.log_likelihood_grid, c)


def test_time_of_the_posterior(
    benchmark, default_table: LikelihoodTable, pair: Correspondences
) -> None:
    benchmark(pose_posterior, pair, default_table)


def test_time_of_the_estimate(
    benchmark, default_table: LikelihoodTable, pair: Correspondences
) -> None:
    benchmark(estimate_relative_pose, pair, default_table)


def test_time_of_the_paper_s_grid(
    benchmark, dense_table: DenseTable, pair: Correspondences
) -> None:
    benchmark(dense_table.log_likelihood_grid, pair)


@pytest.mark.parametrize(("n", "mismatch"), [(25, 0.8), (100, 0.9)])
def test_time_of_many_estimates(
    benchmark, default_table: LikelihoodTable, n: int, mismatch: float
) -> None:
    """Of 100 pairs."""
    _, angles = CorrespondenceSimulator(mismatch=mismatch).sample(100, n, 0)
    benchmark(estimate_relative_poses, [Correspondences(*a.T) for a in angles], default_table)


def test_time_of_learning(benchmark) -> None:
    """Correspondences a second on one core: the extra column of the report."""
    blocks = 8 * 2 * learning.BLOCK
    benchmark.extra_info["correspondences"] = blocks
    simulator = CorrespondenceSimulator()
    benchmark(learning.count_simulated, simulator, blocks, num_classes=4, num_threads=1)


def test_time_of_learning_the_paper_s(benchmark) -> None:
    block = dense_learning.BLOCK
    benchmark.extra_info["correspondences"] = block
    simulator = CorrespondenceSimulator(mismatch=0.0)
    benchmark(dense_learning.count_simulated, simulator, 128, block, num_threads=1)


def test_time_of_weighting_particles(benchmark, default_table: LikelihoodTable) -> None:
    world = World()
    model = ReferenceImageModel(world.map(REFERENCES), default_table, max_range=20.0)
    poses = np.random.default_rng(0).uniform([-2, -2, -3], [2, 2, 3], (10_000, 3))
    matches = model.match(poses, world.look(np.zeros(3), 0))
    benchmark(model.log_likelihood_of_matches, poses, matches)
