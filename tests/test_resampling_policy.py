"""When to resample: each policy, their combinations, and that the filter asks them rightly."""

from __future__ import annotations

import numpy as np
import pytest
from test_particle_filter import Fixed

from pflut.localization.motion import DifferentialDrive
from pflut.localization.particle_filter import ParticleFilter
from pflut.localization.resampling_policy import (
    EffectiveSizeBelow,
    EveryUpdates,
    Moved,
    ResamplingPolicy,
    SinceResampling,
)

FEW, MANY = SinceResampling(0.2, 3, 1.0, 0.0), SinceResampling(0.9, 1, 0.0, 0.3)
UNEVEN = np.linspace(0.0, -0.1, 100)


def filter_with(policy: ResamplingPolicy) -> ParticleFilter:
    pf = ParticleFilter(
        DifferentialDrive(), Fixed(), num_particles=100, resample_when=policy, rng=0
    )
    pf.initialize_uniform((-1, -1, 1, 1))
    return pf


def test_effective_size() -> None:
    assert EffectiveSizeBelow(0.5)(FEW)
    assert not EffectiveSizeBelow(0.5)(MANY)
    assert not EffectiveSizeBelow(0.2)(FEW)  # below, not at
    assert not EffectiveSizeBelow(0.0)(FEW)


def test_every_n_updates() -> None:
    pf = filter_with(EveryUpdates(3))
    assert [pf.update(UNEVEN).resampled for _ in range(7)] == [False, False, True] * 2 + [False]
    # an observation that is ignored does not count
    pf = filter_with(EveryUpdates(2))
    said = [pf.update(z).resampled for z in (UNEVEN, np.full(100, np.nan), UNEVEN, UNEVEN)]
    assert said == [False, False, True, False]


def test_motion() -> None:
    pf = filter_with(Moved(0.5, 1.0))
    steps = [([0.3, 0.0, 0.0], False), ([-0.3, 0.0, 0.0], True), ([0.0, 0.0, 0.0], False)]
    steps += [([0.1, 0.0, 0.6], False), ([0.1, 0.0, -0.6], True), ([0.1, 0.0, 0.0], False)]
    assert [pf.step(odometry, UNEVEN).resampled for odometry, _ in steps] == [e for _, e in steps]


def test_motion_without_images_adds_up() -> None:
    pf = filter_with(Moved(0.5, 9.0))
    for _ in range(4):
        pf.predict([0.0, 0.15, 0.0])
    assert pf.update(UNEVEN).resampled
    assert not pf.update(UNEVEN).resampled


@pytest.mark.parametrize("since", [FEW, MANY, SinceResampling(0.2, 1, 0.0, 0.0)])
def test_combinations_are_those_of_logic(since: SinceResampling) -> None:
    a, b = EffectiveSizeBelow(0.5), Moved(0.5, 5.0)
    assert (a & b)(since) == (a(since) and b(since))
    assert (a | b)(since) == (a(since) or b(since))
    assert (~a)(since) == (not a(since))
    assert (~a & ~b)(since) == (not (a | b)(since))


def test_combinations_say_what_they_are() -> None:
    policy = (EffectiveSizeBelow(0.5) & Moved(0.2, 0.1)) | ~EveryUpdates(4)
    assert repr(policy) == (
        "((EffectiveSizeBelow(share=0.5) and Moved(translation=0.2, rotation=0.1)) or "
        "(not EveryUpdates(n=4)))"
    )


def test_a_policy_of_ones_own() -> None:
    class Odd(ResamplingPolicy):
        def __call__(self, since: SinceResampling) -> bool:
            return since.updates % 2 == 1

    pf = filter_with(Odd() & EveryUpdates(3))
    assert [pf.update(UNEVEN).resampled for _ in range(4)] == [False, False, True, False]


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: EffectiveSizeBelow(1.1), "share"),
        (lambda: EffectiveSizeBelow(np.nan), "share"),
        (lambda: EveryUpdates(0), "n"),
        (lambda: Moved(-0.1, 0.0), "translation"),
        (lambda: Moved(0.1, np.inf), "rotation"),
    ],
)
def test_misuse_names_the_option(make, named: str) -> None:
    with pytest.raises(ValueError, match=f"^{named}: expected"):
        make()
