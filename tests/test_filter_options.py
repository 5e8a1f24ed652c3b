"""The particle filter that options describe."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pflut.likelihood.table import LikelihoodTable
from pflut.localization.motion import DifferentialDrive, Omnidirectional
from pflut.localization.proposals import ReferenceProposal, UniformProposal
from pflut.localization.reference_image_model import ReferenceImageModel
from pflut.localization.resampling_policy import SinceResampling
from pflut.localization.sample_size import KLDSampling
from pflut.reference_map import ReferenceMap
from pflut.replay.filters import make_filter, make_motion, start_covariance
from pflut.replay.options import ReplayOptions

BOUNDS = (0.0, 0.0, 4.0, 3.0)
FEW = SinceResampling(effective_share=0.1, updates=1, translation=0.0, rotation=0.0)


class Blind:
    """A sensor without references."""

    def log_likelihood(self, poses: np.ndarray, observation: Any) -> np.ndarray:
        return np.zeros(len(poses))


@pytest.fixture
def sensor(small_table: LikelihoodTable) -> ReferenceImageModel:
    return ReferenceImageModel(ReferenceMap.of_poses([[1.0, 1.0, 0.0]]), small_table)


def test_always_so_many_particles_or_as_many_as_are_needed() -> None:
    options = ReplayOptions(num_particles=800)
    assert make_filter(Blind(), options, BOUNDS).num_particles == 800
    size = make_filter(
        Blind(), replace(options, min_particles=50, kld_error=0.2), BOUNDS
    ).num_particles
    assert size == KLDSampling(min_particles=50, max_particles=800, error=0.2)
    more = make_filter(Blind(), replace(options, min_particles=5000), BOUNDS).num_particles
    assert more == KLDSampling(min_particles=800, max_particles=800)


@pytest.mark.parametrize(
    ("changes", "since", "resampled"),
    [
        ({}, FEW, True),
        ({}, replace(FEW, effective_share=0.6), False),
        ({"ess_threshold": 0.7}, replace(FEW, effective_share=0.6), True),
        ({"resample_interval": 3}, FEW, False),
        ({"resample_interval": 3}, replace(FEW, updates=3), True),
        ({"resample_distance": 0.5, "resample_angle": 1.0}, FEW, False),
        ({"resample_distance": 0.5, "resample_angle": 1.0}, replace(FEW, translation=0.6), True),
        ({"resample_distance": 0.5, "resample_angle": 1.0}, replace(FEW, rotation=1.1), True),
        ({"resample_distance": 0.5, "resample_angle": 1.0},
         replace(FEW, translation=0.6, effective_share=0.9), False),
    ],
)  # fmt: skip
def test_when_to_resample(changes: dict[str, Any], since: SinceResampling, resampled: bool) -> None:
    assert make_filter(Blind(), ReplayOptions(**changes), BOUNDS).resample_when(since) == resampled


def test_one_limit_of_the_motion_is_enough() -> None:
    """The other one is off, not always reached."""
    still = replace(FEW, translation=0.1, rotation=0.1)
    far = make_filter(Blind(), ReplayOptions(resample_distance=0.5), BOUNDS).resample_when
    assert not far(still) and far(replace(still, translation=0.6))
    turned = make_filter(Blind(), ReplayOptions(resample_angle=0.5), BOUNDS).resample_when
    assert not turned(still) and turned(replace(still, rotation=0.6))


def test_where_to_look_for_a_robot_that_was_carried_away(sensor: ReferenceImageModel) -> None:
    options = ReplayOptions(
        kidnap_probability=0.02,
        proposal_share=0.3,
        recovery_alpha_slow=0.01,
        recovery_alpha_fast=0.1,
    )
    recovery = make_filter(sensor, options, BOUNDS).recovery
    assert recovery is not None and isinstance(recovery.proposal, ReferenceProposal)
    assert (recovery.probability, recovery.share) == (0.02, 0.3)
    assert (recovery.alpha_slow, recovery.alpha_fast) == (0.01, 0.1)
    uniform = make_filter(sensor, replace(options, recovery="uniform"), BOUNDS).recovery
    assert uniform is not None and isinstance(uniform.proposal, UniformProposal)
    assert make_filter(sensor, replace(options, recovery="none"), BOUNDS).recovery is None


def test_a_sensor_without_references_asks_those_of_another(sensor: ReferenceImageModel) -> None:
    alone = make_filter(Blind(), ReplayOptions(), BOUNDS).recovery
    assert alone is not None and isinstance(alone.proposal, UniformProposal)
    helped = make_filter(Blind(), ReplayOptions(), BOUNDS, proposing=sensor).recovery
    assert helped is not None and isinstance(helped.proposal, ReferenceProposal)


def test_motion_and_start() -> None:
    options = ReplayOptions(
        rotation_noise_from_rotation=0.5,
        strafe_noise_from_translation=0.7,
        start_position_std=0.3,
        start_heading_std=0.1,
    )
    drive = make_motion(options)
    assert isinstance(drive, DifferentialDrive) and drive.rotation_noise_from_rotation == 0.5
    sideways = make_motion(replace(options, motion="omnidirectional"))
    assert isinstance(sideways, Omnidirectional)
    assert sideways.strafe_noise_from_translation == 0.7
    assert start_covariance(options) == pytest.approx(np.diag([0.09, 0.09, 0.01]))
