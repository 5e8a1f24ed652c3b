"""The sensor of relative poses against its readable twin, and the parts it is made of."""

from dataclasses import replace

import naive
import numpy as np
import pytest
from fixes import REFERENCES, Matcher, ToldFixes, measured
from world import REFERENCES as PLACES
from world import World

from pflut.correspondences import Correspondences, ReferenceMatch
from pflut.geometry import relative_headings, wrap_to_pi
from pflut.likelihood.table import LikelihoodTable
from pflut.localization.motion import DifferentialDrive
from pflut.localization.particle_filter import ParticleFilter
from pflut.localization.reference_image_model import ReferenceImageModel
from pflut.localization.relative_pose_fix import RelativePoseFix
from pflut.localization.relative_pose_model import RelativePoseModel
from pflut.reference_map import ReferenceMap
from pflut.relpose.ransac import ransac_relative_poses
from pflut.relpose.result import RelativePose, no_pose
from pflut.relpose.search import estimate_relative_poses
from pflut.simulation.correspondences import CorrespondenceSimulator


def relative(headings, covariance, success=True):
    return RelativePose(*headings, np.array(covariance), 0.0, 0.0, 20, success)


@pytest.mark.parametrize(("near", "reach"), [(0.5, 4.0), (0.0, 2.0), (1.0, 20.0)])
def test_equals_its_naive_twin(near, reach):
    rng = np.random.default_rng(0)
    sensor = ToldFixes(link_probability=0.8)
    sensor.matcher.near_range, sensor.matcher.max_range = near, reach
    fixes = measured(np.array([-2.0, -1.0, 0.5]), std=0.1, rng=rng)
    poses = rng.uniform([-4, -4, -9], [4, 4, 9], (300, 3))
    poses[:60, :2] = REFERENCES[0, :2] + rng.normal(0, 0.4, (60, 2))
    poses[0], poses[1] = [-2.0, -1.0, 0.5], REFERENCES[0]
    plain = [(fix.reference, fix.headings, fix.covariance) for fix in fixes]
    expected = [naive.relative_pose_log_likelihood(pose, plain, 0.8, near, reach) for pose in poses]
    np.testing.assert_allclose(sensor.log_likelihood(poses, fixes), expected, atol=1e-9)
    assert np.ptp(expected) > 5


def test_is_highest_at_the_truth_and_zero_where_nothing_is_said():
    truth = np.array([0.4, -0.5, 1.0])
    sensor = ToldFixes()
    poses = truth + np.vstack([np.zeros(3), np.random.default_rng(1).normal(0, 0.2, (99, 3))])
    assert sensor.log_likelihood(poses, measured(truth)).argmax() == 0
    np.testing.assert_array_equal(sensor.log_likelihood(poses, []), np.zeros(100))
    far = np.add(poses, [100.0, 0.0, 0.0])
    np.testing.assert_array_equal(sensor.log_likelihood(far, measured(truth)), np.zeros(100))


def test_a_wrong_relative_pose_costs_a_bounded_amount():
    sensor = ToldFixes(link_probability=0.9)
    truth = np.array([0.4, -0.5, 1.0])
    wrong = [replace(fix, headings=fix.headings + 2.0) for fix in measured(truth)]
    values = sensor.log_likelihood([truth], wrong)
    assert values[0] == pytest.approx(len(wrong) * np.log(0.1))


def test_jacobian_is_the_derivative():
    pose, step = np.array([0.4, -0.5, 3.1]), 1e-6
    for fix in measured(pose):
        for k in range(3):
            change = np.zeros(3)
            change[k] = step
            slope = wrap_to_pi(fix.expected(pose + change) - fix.expected(pose - change))
            np.testing.assert_allclose(fix.jacobian(pose)[:, k], slope / (2 * step), atol=1e-8)
        # the convention is that of the geometry
        heading_l, heading_r, distance = relative_headings(fix.reference, pose)
        expected = wrap_to_pi(fix.expected(pose) - [heading_l, heading_r])
        np.testing.assert_allclose(expected, 0.0, atol=1e-12)
        assert fix.distance(pose) == pytest.approx(float(distance))
    on_it = fix.jacobian(np.array([*fix.reference[:2], 1.0]))
    np.testing.assert_array_equal(on_it[0] - on_it[1], [0.0, 0.0, 1.0])


def test_fixes_are_the_successes_with_widened_covariances():
    told = [
        relative([0.3, -0.2], [[0.01, 0.002], [0.002, 0.02]]),
        no_pose(),
        relative([1.0, 3.0], [[0.01, 0.0], [0.0, 0.02]], success=False),
    ]
    simulated = CorrespondenceSimulator().pair(10, rng=0)[0]
    matches = [ReferenceMatch(i, simulated) for i in (4, 1, 2)]
    matcher = Matcher(ReferenceMap.of_poses(REFERENCES))
    sensor = RelativePoseModel(matcher, lambda pairs: told, inflation=3.0, min_std=0.1)
    (fix,) = sensor.fixes([[0, 0, 0]], matches)
    assert isinstance(fix, RelativePoseFix) and fix.index == 4
    np.testing.assert_array_equal(fix.reference, REFERENCES[4])
    np.testing.assert_array_equal(fix.headings, [0.3, -0.2])
    np.testing.assert_allclose(fix.covariance, [[0.04, 0.006], [0.006, 0.07]])
    assert sensor.fixes([[0, 0, 0]], []) == []
    with pytest.raises(ValueError, match="estimator: expected 2 poses, got 3"):
        sensor.fixes([[0, 0, 0]], matches[:2])


def test_covariances_of_ransac_and_of_the_likelihood_tell_the_noise():
    """Right poses lie within what the covariance says, most of the time, and it is not huge."""
    table = LikelihoodTable.default()
    headings, bearings = CorrespondenceSimulator(mismatch=0.5).sample(150, 60, rng=3)
    pairs = [Correspondences(*pair.T) for pair in bearings]
    for found in (ransac_relative_poses(pairs), estimate_relative_poses(pairs, table)):
        squares = []
        for pose, truth in zip(found, headings, strict=True):
            error = wrap_to_pi(np.array([pose.heading_l, pose.heading_r]) - truth)
            if pose.success and np.abs(error).max() < 0.3:
                squares.append(error @ np.linalg.solve(pose.covariance, error))
        assert len(squares) > 100
        # the median of chi-square with two degrees of freedom is 1.39
        assert 0.5 < np.median(squares) < 3.0


@pytest.mark.parametrize("observed", ["matches", "features"])
def test_localizes_in_a_room(observed):
    world = World(landmarks=300)
    reference_map = world.map(PLACES)
    matcher = ReferenceImageModel(reference_map, LikelihoodTable.default())
    sensor = RelativePoseModel(matcher)
    truth = np.array([0.7, 0.2, 2.5])
    observation = world.look(truth, 7)
    if observed == "matches":
        observation = matcher.match([truth], observation)
    pf = ParticleFilter(
        DifferentialDrive(position_noise=0.02, heading_noise=0.01),
        sensor,
        num_particles=3000,
        min_effective_share=0.1,
        rng=0,
    )
    # many at first: the peaks of a Gaussian are narrow, and between them nothing leads there
    low, high = [-3, -2.5, -np.pi], [3, 2.5, np.pi]
    pf.initialize(np.random.default_rng(1).uniform(low, high, (50_000, 3)))
    for _ in range(8):
        estimate = pf.step([0.0, 0.0, 0.0], observation)
    error = estimate.pose - truth
    assert np.hypot(*error[:2]) < 0.1 and abs(wrap_to_pi(error[2])) < 0.05


def test_observe_is_that_of_the_matcher():
    assert ToldFixes().observe("image") == "image"

    class Seeing(Matcher):
        def observe(self, image):
            return image.upper()

    sensor = RelativePoseModel(Seeing(ReferenceMap.of_poses(REFERENCES)))
    assert sensor.observe("image") == "IMAGE"
    assert sensor.near_range == 0.3 and len(sensor.reference_map) == len(REFERENCES)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"inflation": 0.0}, "inflation: expected a positive factor, got 0.0"),
        ({"inflation": np.inf}, "inflation: expected a positive factor"),
        ({"min_std": -0.1}, "min_std: expected radians"),
        ({"link_probability": 1.0}, "link_probability: expected in"),
    ],
)
def test_misuse_is_told(options, message):
    with pytest.raises(ValueError, match=message):
        ToldFixes(**options)
