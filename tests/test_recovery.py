"""Recovery: Bayes' rule with a robot that may be carried away, augmented MCL, proposals."""

from __future__ import annotations

import numpy as np
import pytest
from test_particle_filter import Fixed, Position
from world import REFERENCES, World

from pflut.likelihood.table import LikelihoodTable
from pflut.localization.motion import DifferentialDrive
from pflut.localization.particle_filter import ParticleFilter
from pflut.localization.proposals import ReferenceProposal, UniformProposal
from pflut.localization.recovery import LikelihoodAverages, Recovery
from pflut.localization.reference_image_model import ReferenceImageModel
from pflut.localization.resampling_policy import EffectiveSizeBelow

SQUARE = (-2.0, -2.0, 2.0, 2.0)
STILL = [0.0, 0.0, 0.0]


def recovering(seed: int = 0, n: int = 2000, sensor=None, **options) -> ParticleFilter:
    recovery = Recovery(proposal=UniformProposal(SQUARE), **options)
    return ParticleFilter(
        DifferentialDrive(),
        sensor or Position([0.3, 0.3]),
        num_particles=n,
        recovery=recovery,
        resample_when=EffectiveSizeBelow(0.0),
        rng=seed,
    )


def test_the_share_of_the_carried_away_is_bayes_rule() -> None:
    """Exact: a robot known to be at one pose, or with probability p anywhere in the square."""
    p, z, std = 0.2, np.array([0.6, 0.3]), np.array([0.3, 0.3])

    def density(x, y):
        return np.exp(-0.5 * (((x - z[0]) / std[0]) ** 2 + ((y - z[1]) / std[1]) ** 2))

    axis = np.linspace(-2, 2, 2001)
    anywhere = density(axis[:, None], axis[None, :]).mean()
    here = density(0.0, 0.0)
    exact = p * anywhere / (p * anywhere + (1 - p) * here)
    exact_mean = np.log((1 - p) * here + p * anywhere) - np.log(2 * np.pi * 0.09)
    shares, totals = [], []
    for seed in range(80):
        pf = recovering(seed, probability=p, share=0.5)
        pf.initialize(np.zeros((2000, 3)))
        estimate = pf.update(z)
        shares.append(estimate.proposed_share)
        # the mean over the particles alone is exact; that over both follows from the share
        assert estimate.log_mean_likelihood == pytest.approx(
            np.log(here) - np.log(2 * np.pi * 0.09), abs=0.05
        )
        totals.append(
            np.exp(estimate.log_mean_likelihood) * (1 - p) / (1 - estimate.proposed_share)
        )
    for values, truth in ((shares, exact), (totals, np.exp(exact_mean))):
        error = np.std(values, ddof=1) / np.sqrt(len(values))
        assert abs(np.mean(values) - truth) <= 5 * error + 1e-3 * truth
        assert error < 0.02 * truth


def test_proposals_where_nothing_speaks_for_them_cost_nothing() -> None:
    plain = ParticleFilter(DifferentialDrive(), Position([0.05, 0.05]), num_particles=2000, rng=0)
    helped = recovering(sensor=Position([0.05, 0.05]), probability=1e-3)
    errors = []
    for pf in (plain, helped):
        pf.initialize_gaussian(STILL, np.diag([0.01, 0.01, 0.01]))
        for k in range(1, 10):
            estimate = pf.step([0.1, 0.0, 0.0], [0.1 * k, 0.0])
            assert len(pf.poses) == 2000
        errors.append(np.hypot(*(estimate.pose[:2] - [0.9, 0.0])))
    assert max(errors) < 0.03
    assert estimate.proposed_share < 1e-3


def test_a_kidnapped_robot_is_found_with_recovery_and_not_without() -> None:
    found = {}
    for name, options in (
        ("none", None),
        ("proposals", {}),
        ("augmented", {"probability": 1e-12, "alpha_slow": 0.05, "alpha_fast": 0.5}),
    ):
        hits = 0
        for seed in range(20):
            rng = np.random.default_rng([seed, 1])
            recovery = options is not None and Recovery(proposal=UniformProposal(SQUARE), **options)
            pf = ParticleFilter(
                DifferentialDrive(position_noise=0.03, heading_noise=0.02),
                Position([0.1, 0.1]),
                num_particles=1000,
                min_effective_share=0.05,
                recovery=recovery or None,
                rng=seed,
            )
            pf.initialize_gaussian([-1.0, -1.0, 0.0], np.diag([0.01, 0.01, 0.1]))
            for _ in range(8):
                pf.step(STILL, [-1.0, -1.0] + 0.1 * rng.standard_normal(2))
            for _ in range(10):
                estimate = pf.step(STILL, [1.0, 1.2] + 0.1 * rng.standard_normal(2))
            hits += np.hypot(*(estimate.pose[:2] - [1.0, 1.2])) < 0.2
        found[name] = hits
    assert found["none"] == 0
    assert found["proposals"] == 20
    assert found["augmented"] == 20


def test_augmented_mcl_looks_at_likelihoods_before_normalisation() -> None:
    """Table 8.3: after a fall the probability is 1 - w_fast / w_slow; a rise does nothing."""
    recovery = Recovery(
        proposal=UniformProposal(SQUARE), probability=1e-6, alpha_slow=0.1, alpha_fast=0.5
    )
    slow = fast = np.nan
    averages = LikelihoodAverages()
    for likelihood in (1.0, 0.8, 1.2, 0.1, 0.01, 2.0):
        first = np.isnan(slow)
        slow = likelihood if first else slow + 0.1 * (likelihood - slow)
        fast = likelihood if first else fast + 0.5 * (likelihood - fast)
        averages = averages.after(np.log(likelihood), 0.1, 0.5)
        assert averages.slow == pytest.approx(np.log(slow))
        assert averages.fast == pytest.approx(np.log(fast))
        expected = max(1e-6, 1 - fast / slow)
        assert recovery.probability_after(averages) == pytest.approx(expected)
    assert recovery.probability_after(LikelihoodAverages()) == 1e-6


def test_off_by_default() -> None:
    recovery = Recovery(proposal=UniformProposal(SQUARE))
    averages = LikelihoodAverages()
    for log_mean in (0.0, -50.0, -800.0):
        averages = averages.after(log_mean, recovery.alpha_slow, recovery.alpha_fast)
        assert recovery.probability_after(averages) == recovery.probability


def test_an_observation_that_rules_out_all_but_proposals() -> None:
    class Far:
        def log_likelihood(self, poses, observation):
            return np.where(poses[:, 0] > 1.0, 0.0, -np.inf)

    pf = recovering(sensor=Far())
    pf.initialize(np.zeros((2000, 3)))
    estimate = pf.update(None)
    assert not estimate.degenerate
    assert estimate.proposed_share == 1.0
    assert estimate.log_mean_likelihood is None  # the particles have none
    assert len(pf.poses) == 2000
    assert (pf.poses[:, 0] > 1.0).all()


def test_a_degenerate_observation_leaves_no_proposals() -> None:
    pf = recovering(sensor=Fixed(), probability=0.5)
    pf.initialize(np.zeros((2000, 3)))
    assert pf.update(np.nan).degenerate
    assert pf.poses.shape == (2000, 3)
    assert not pf.poses.any()


# --- proposals from references --------------------------------------------------------------------


@pytest.fixture(scope="module")
def world() -> World:
    return World()


@pytest.fixture(scope="module")
def sensor(world: World, default_table: LikelihoodTable) -> ReferenceImageModel:
    return ReferenceImageModel(world.map(REFERENCES), default_table, max_range=5.0)


def test_weights_of_proposals_are_unbiased(world: World, sensor: ReferenceImageModel) -> None:
    """E[u / q] = 1 over the rectangle, and the mean position under these weights is its centre."""
    proposal = ReferenceProposal(sensor, bounds=(-3.0, -2.0, 3.0, 2.5))
    image = world.look(np.array([1.0, 0.5, 2.0]), 3)
    poses, log_ratio = proposal.propose(image, 400_000, np.random.default_rng(0))
    ratio = np.exp(log_ratio)
    assert ratio.max() <= 1 / proposal.uniform_share + 1e-9
    for values, exact in (
        (np.ones(len(ratio)), 1.0),
        (poses[:, 0], 0.0),
        (poses[:, 1], 0.25),
        (np.cos(poses[:, 2]), 0.0),
        (poses[:, 0] ** 2, 3.0),
        (np.cos(poses[:, 2] - poses[:, 0]), 0.0),
    ):
        weighted = ratio * values
        error = weighted.std(ddof=1) / np.sqrt(len(ratio))
        assert abs(weighted.mean() - exact) <= 5 * error
        assert error < 0.02


def test_proposals_gather_where_the_robot_is(world: World, sensor: ReferenceImageModel) -> None:
    pose = np.array([1.0, 0.5, 2.0])
    proposal = ReferenceProposal(sensor)
    rng = np.random.default_rng(0)
    poses, _ = proposal.propose(world.look(pose, 3), 20_000, rng)
    blind, _ = UniformProposal(proposal.bounds).propose(None, 20_000, rng)

    def share(poses: np.ndarray) -> float:
        turn = np.abs((poses[:, 2] - pose[2] + np.pi) % (2 * np.pi) - np.pi)
        return ((np.hypot(*(poses[:, :2] - pose[:2]).T) < 0.3) & (turn < 0.1)).mean()

    assert share(poses) > 30 * share(blind)


def test_an_image_that_matches_nothing_is_proposed_blindly(
    world: World, sensor: ReferenceImageModel
) -> None:
    nothing = World(seed=9).look(np.zeros(3), 0)
    poses, log_ratio = ReferenceProposal(sensor).propose(nothing, 1000, np.random.default_rng(0))
    assert poses.shape == (1000, 3)
    assert not log_ratio.any()


def test_lost_and_kidnapped_among_references(world: World, sensor: ReferenceImageModel) -> None:
    errors = []
    for seed in range(8):
        pf = ParticleFilter(
            DifferentialDrive(),
            sensor,
            num_particles=1000,
            min_effective_share=0.1,
            recovery=Recovery(proposal=ReferenceProposal(sensor)),
            rng=seed,
        )
        # far too few particles to find anything blindly, all of them at a wrong place
        pf.initialize_gaussian([-3.0, 2.0, 0.0], np.diag([0.01, 0.01, 0.01]))
        for k, pose in enumerate(([1.0, 0.5, 2.0], [-2.0, -1.0, -1.0])):
            for i in range(6):
                estimate = pf.step(STILL, world.look(np.array(pose), 10 * k + i))
            errors.append(np.hypot(*(estimate.pose[:2] - pose[:2])))
            assert estimate.confidence > 0.9
    assert np.median(errors) < 0.08
    assert max(errors) < 0.2


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"probability": 0.0}, "probability"),
        ({"probability": 1.0}, "probability"),
        ({"share": 0.0}, "share"),
        ({"alpha_slow": 0.5, "alpha_fast": 0.1}, "alpha_slow"),
        ({"alpha_slow": np.nan}, "alpha_slow"),
    ],
)
def test_misuse_names_the_option(options: dict[str, float], named: str) -> None:
    with pytest.raises(ValueError, match=f"^{named}: expected"):
        Recovery(proposal=UniformProposal(SQUARE), **options)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"max_references": 0}, "max_references"),
        ({"flattening": 0.0}, "flattening"),
        ({"uniform_share": 0.0}, "uniform_share"),
        ({"bounds": (1.0, 0.0, 0.0, 1.0)}, "bounds"),
    ],
)
def test_misuse_of_a_proposal(sensor: ReferenceImageModel, options: dict, named: str) -> None:
    with pytest.raises(ValueError, match=f"^{named}: expected"):
        ReferenceProposal(sensor, **options)
