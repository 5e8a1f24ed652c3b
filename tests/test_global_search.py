"""The search in the whole map: its lattice, and single images of a synthetic world."""

from __future__ import annotations

import numpy as np
import pytest
from world import REFERENCES, World

from pflut.geometry import wrap_to_pi
from pflut.likelihood.table import LikelihoodTable
from pflut.localization.global_search import GlobalSearch, pose_lattice
from pflut.localization.reference_image_model import ReferenceImageModel


def test_lattice_by_hand() -> None:
    lattice = pose_lattice((0.0, -1.0, 1.0, 0.0), spacing=0.5, num_headings=4)
    assert lattice.shape == (3 * 3 * 4, 3)
    assert sorted(set(lattice[:, 0])) == [0.0, 0.5, 1.0]
    assert sorted(set(lattice[:, 1])) == [-1.0, -0.5, 0.0]
    assert sorted(set(lattice[:, 2])) == pytest.approx([-np.pi / 2, 0.0, np.pi / 2, np.pi])
    assert len({tuple(row) for row in lattice}) == len(lattice)


def test_lattice_reaches_to_the_bounds() -> None:
    lattice = pose_lattice((0.0, 0.0, 1.0, 0.0), spacing=0.3, num_headings=1)
    assert lattice[:, 0].min() == 0.0
    assert 1.0 <= lattice[:, 0].max() <= 1.3
    assert pose_lattice((2.0, 3.0, 2.0, 3.0), spacing=0.1, num_headings=5)[:, 0] == pytest.approx(2)


@pytest.mark.parametrize(
    ("bounds", "spacing", "num_headings"),
    [
        ((1.0, 0.0, 0.0, 1.0), 0.1, 8),
        ((0.0, 0.0, np.nan, 1.0), 0.1, 8),
        ((0.0, 0.0, 1.0, 1.0), 0.0, 8),
        ((0.0, 0.0, 1.0, 1.0), np.nan, 8),
        ((0.0, 0.0, 1.0, 1.0), 0.1, 0),
    ],
)
def test_lattice_misuse(bounds, spacing: float, num_headings: int) -> None:
    with pytest.raises(ValueError, match="expected"):
        pose_lattice(bounds, spacing=spacing, num_headings=num_headings)


@pytest.fixture(scope="module")
def search(default_table: LikelihoodTable) -> GlobalSearch:
    sensor = ReferenceImageModel(World().map(REFERENCES), default_table, max_range=5.0)
    return GlobalSearch(sensor, spacing=0.2, num_headings=72)


def test_single_images_are_localized(search: GlobalSearch) -> None:
    world, rng = World(), np.random.default_rng(0)
    for seed in range(6):
        pose = rng.uniform([-1.8, -1.2, -np.pi], [1.8, 1.2, np.pi])
        estimate = search.localize(world.look(pose, seed))
        error = estimate.pose - pose
        # the lattice's steps are 0.2 m and 5 degrees: the polish is what makes it exact
        assert np.hypot(error[0], error[1]) < 0.03
        assert abs(wrap_to_pi(error[2])) < np.deg2rad(0.5)
        assert estimate.confidence > 0.5


def test_a_pose_on_a_reference(search: GlobalSearch) -> None:
    estimate = search.localize(World().look(REFERENCES[3], 9))
    assert np.hypot(*(estimate.pose[:2] - REFERENCES[3, :2])) < 0.1
    assert abs(wrap_to_pi(estimate.pose[2] - REFERENCES[3, 2])) < np.deg2rad(2)


@pytest.mark.parametrize("kept", [0, 40])
def test_what_is_not_recognised_is_not_trusted(search: GlobalSearch, kept: int) -> None:
    """No features, or those of another place: a pose, but a confidence near nothing."""
    estimate = search.localize(World(seed=5).look(np.zeros(3), 0)[:kept])
    assert np.isfinite(estimate.pose).all()
    assert estimate.confidence < 0.2


def test_bounds_are_kept(search: GlobalSearch) -> None:
    inside = GlobalSearch(search.sensor, bounds=(1.0, -1.0, 1.4, -0.6), spacing=0.2)
    x, y, _ = inside.localize(World(seed=5).look(np.zeros(3), 0)).pose
    assert 0.5 < x < 2.1
    assert -1.6 < y < 0.1
