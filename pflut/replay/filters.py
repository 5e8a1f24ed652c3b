"""The particle filter that the options of a replay describe."""

from __future__ import annotations

import numpy as np

from pflut.geometry import FloatArray
from pflut.localization.initial_poses import Bounds
from pflut.localization.motion import DifferentialDrive, Omnidirectional
from pflut.localization.particle_filter import ParticleFilter
from pflut.localization.proposals import PoseProposal, ReferenceProposal, UniformProposal
from pflut.localization.recovery import Recovery
from pflut.localization.reference_image_model import ReferenceImageModel
from pflut.localization.resampling_policy import (
    EffectiveSizeBelow,
    EveryUpdates,
    Moved,
    ResamplingPolicy,
)
from pflut.localization.sample_size import KLDSampling
from pflut.localization.sensor_model import SensorModel
from pflut.replay.options import ReplayOptions

_NEVER = 1e9  # metres or radians


def make_motion(options: ReplayOptions) -> DifferentialDrive | Omnidirectional:
    """Make the motion model.

    Parameters
    ----------
    options : ReplayOptions

    Returns
    -------
    DifferentialDrive or Omnidirectional
    """
    noise = {
        name: getattr(options, name)
        for name in (
            "rotation_noise_from_rotation",
            "rotation_noise_from_translation",
            "translation_noise_from_translation",
            "translation_noise_from_rotation",
            "position_noise",
            "heading_noise",
        )
    }
    if options.motion == "differential":
        return DifferentialDrive(**noise)
    return Omnidirectional(
        **noise, strafe_noise_from_translation=options.strafe_noise_from_translation
    )


def make_filter(
    sensor: SensorModel,
    options: ReplayOptions,
    bounds: Bounds,
    *,
    proposing: ReferenceImageModel | None = None,
) -> ParticleFilter:
    """Make the particle filter, not started yet.

    Parameters
    ----------
    sensor : SensorModel
    options : ReplayOptions
    bounds : tuple (xmin, ymin, xmax, ymax)
        Metres: where the robot may be.
    proposing : ReferenceImageModel, optional
        Whose references recovery asks; by default the sensor's. Without any, poses are drawn
        blindly.

    Returns
    -------
    ParticleFilter
    """
    size: int | KLDSampling = options.num_particles
    if options.min_particles is not None:
        size = KLDSampling(
            min_particles=min(options.min_particles, options.num_particles),
            max_particles=options.num_particles,
            error=options.kld_error,
        )
    return ParticleFilter(
        make_motion(options),
        sensor,
        num_particles=size,
        resampling=options.resampling,
        resample_when=_resample_when(options),
        min_effective_share=options.min_effective_share,
        hypothesis_temperature=options.hypothesis_temperature,
        recovery=_recovery(proposing or sensor, options, bounds),
        rng=options.seed,
    )


def _resample_when(options: ReplayOptions) -> ResamplingPolicy:
    policy = EffectiveSizeBelow(options.ess_threshold) & EveryUpdates(options.resample_interval)
    limits = (options.resample_distance, options.resample_angle)
    if any(limits):
        # 0 turns one off: it would be reached at once, and the other one never asked
        policy &= Moved(*(limit or _NEVER for limit in limits))
    return policy


def _recovery(sensor: SensorModel, options: ReplayOptions, bounds: Bounds) -> Recovery | None:
    if options.recovery == "none":
        return None
    proposal: PoseProposal = UniformProposal(bounds)
    if options.recovery == "references" and isinstance(sensor, ReferenceImageModel):
        proposal = ReferenceProposal(sensor, bounds=bounds)
    return Recovery(
        proposal=proposal,
        probability=options.kidnap_probability,
        share=options.proposal_share,
        alpha_slow=options.recovery_alpha_slow,
        alpha_fast=options.recovery_alpha_fast,
    )


def start_covariance(options: ReplayOptions) -> FloatArray:
    """Give how well a known start is known.

    Parameters
    ----------
    options : ReplayOptions

    Returns
    -------
    ndarray of shape (3, 3)
    """
    position, heading = options.start_position_std, options.start_heading_std
    return np.diag(np.square([position, position, heading]))
