"""What matches say for a link: against the estimates, and counted by hand."""

from __future__ import annotations

import numpy as np
import pytest
from evidence import some_evidence

from pflut.correspondences import Correspondences
from pflut.geometry import TWO_PI
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.link_evidence import DIRECTIONS, LinkEvidence, link_evidence
from pflut.pairs import agreeing
from pflut.posterior import pose_posterior
from pflut.relpose.estimate import estimate_relative_pose
from pflut.relpose.search import estimate_relative_poses
from pflut.simulation.correspondences import CorrespondenceSimulator

TABLE = LikelihoodTable.default()


def simulated(number: int, count: int, mismatch: float, seed: int) -> list[Correspondences]:
    _, bearings = CorrespondenceSimulator(mismatch=mismatch).sample(number, count, seed)
    return [Correspondences(*views.T) for views in bearings]


def test_evidence_is_that_of_the_estimates() -> None:
    pairs = [*simulated(5, 40, 0.5, 0), *simulated(5, 20, 0.9, 1), Correspondences.empty()]
    poses = estimate_relative_poses(pairs, TABLE)
    evidence = link_evidence(pairs, TABLE)
    assert evidence.log_evidence.tolist() == [pose.log_evidence for pose in poses]
    assert evidence.num_matches.tolist() == [40] * 5 + [20] * 5 + [0]
    assert evidence.num_inliers.tolist() == [pose.num_inliers for pose in poses]
    assert evidence.rotation.tolist() == [pose.rotation for pose in poses]
    assert evidence.rotation_std.tolist() == [pose.rotation_std for pose in poses]
    for k, (pair, pose) in enumerate(zip(pairs, poses, strict=True)):
        chosen = agreeing(pair, pose, noise=TABLE.noise)
        views = [azimuth[chosen] for azimuth in (pair.azimuth_l, pair.azimuth_r)]
        sectors = [{int(angle // (TWO_PI / DIRECTIONS)) for angle in view} for view in views]
        assert evidence.num_directions[k] == min(map(len, sectors))
        assert evidence.spread[k] == pytest.approx(min(map(chords, views)), abs=1e-7)
    given = link_evidence(pairs, TABLE, poses=poses)
    assert (given.num_directions == evidence.num_directions).all()


def chords(azimuth: np.ndarray) -> float:
    """The root mean square chord from directions to their mean one."""
    if not len(azimuth):
        return 0.0
    points = np.exp(1j * azimuth)
    middle = points.mean() / abs(points.mean())
    return float(np.sqrt(np.mean(np.abs(points - middle) ** 2)))


def test_evidence_of_a_pair_does_not_depend_on_the_others() -> None:
    pairs = simulated(6, 30, 0.7, 2)
    together, threads = link_evidence(pairs, TABLE), link_evidence(pairs, TABLE, num_threads=2)
    for k, pair in enumerate(pairs):
        for found in (link_evidence([pair], TABLE), threads[k : k + 1]):
            assert vars(found) == vars(together[k : k + 1])
    assert len(link_evidence([], TABLE)) == 0


def test_a_posterior_has_the_same_evidence() -> None:
    pairs = simulated(4, 30, 0.6, 3)
    poses = [
        estimate_relative_pose(pair, TABLE, posterior=pose_posterior(pair, TABLE, bins=128))
        for pair in pairs
    ]
    by_grid, searched = link_evidence(pairs, TABLE, poses=poses), link_evidence(pairs, TABLE)
    # grids of 80 and of 128 bins, whose ridges are as wide as their cells: to a fifth
    assert by_grid.log_evidence == pytest.approx(searched.log_evidence, rel=0.2, abs=0.5)
    assert (by_grid.num_directions == searched.num_directions).all()


def test_agreeing_matches_of_one_window_are_one_direction() -> None:
    # all landmarks stand far away in a window of 10 degrees, seen without noise by a turned view
    rng = np.random.default_rng(4)
    azimuth = np.radians(5.0 + 10.0 * rng.random(40))
    elevation = np.radians(rng.uniform(-20.0, 20.0, 40))
    window = Correspondences(azimuth, elevation, azimuth + 1.0, elevation)
    around = Correspondences(
        *(TWO_PI / 40 * np.arange(40), elevation), TWO_PI / 40 * np.arange(40) + 1.0, elevation
    )
    found = link_evidence([window, around], TABLE)
    assert (found.log_evidence > 20.0).all()
    assert found.num_directions[0] == 1
    assert found.num_directions[1] == DIRECTIONS
    # the standard deviation of a narrow window, and all around the circle's
    assert found.spread[0] == pytest.approx(np.std(azimuth), rel=0.01)
    assert found.spread[1] == pytest.approx(np.sqrt(2.0), abs=0.05)
    assert found.num_inliers.tolist() == [40, 40]
    assert found.rotation == pytest.approx([-1.0, -1.0], abs=0.02)


def test_true_matches_have_evidence_and_chance_has_none() -> None:
    true, false = simulated(200, 30, 0.5, 5), simulated(200, 30, 1.0, 6)
    linked, not_linked = (link_evidence(pairs, TABLE).log_evidence for pairs in (true, false))
    # of mismatches a likelihood ratio has the mean one: exceeding log(k) is rarer than 1 / k
    assert (not_linked > np.log(100.0)).mean() < 0.01 + 5.0 * np.sqrt(0.01 * 0.99 / 200)
    assert (linked > np.log(100.0)).mean() > 0.95


def test_evidence_is_checked() -> None:
    one = some_evidence([3.0], 10)
    both = LinkEvidence.concatenate([one[:0], one, some_evidence([-1.0, 2.0], [5, 6])])
    assert both.num_matches.tolist() == [10, 5, 6] and len(both[1:]) == 2
    with pytest.raises(ValueError, match=r"num_matches: expected shape \(1,\), got \(2,\)"):
        LinkEvidence([3.0], [10, 11], [4], [4], [0.1], [0.0], [0.1])  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="log_evidence: expected finite numbers"):
        some_evidence([np.nan], 10)
    with pytest.raises(ValueError, match="num_directions: expected none below zero, got -4"):
        some_evidence([3.0], 10, -4)
    with pytest.raises(ValueError, match=r"rotation_std: expected none below zero, got -0\.1"):
        some_evidence([3.0], 10, rotation_std=-0.1)
    assert some_evidence([3.0], 10, rotation=-3.0).rotation.tolist() == [-3.0]
    pair = simulated(1, 10, 0.5, 7)
    with pytest.raises(ValueError, match="poses: expected 1, one a pair, got 0"):
        link_evidence(pair, TABLE, poses=[])
    with pytest.raises(ValueError, match="noise"):
        link_evidence(pair, TABLE, noise=0.0)
