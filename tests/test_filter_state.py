"""A filter's state: saved, loaded and resumed to the last bit; damaged files are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_particle_filter import Fixed, Position, standing

from pflut.localization.estimate import Estimate
from pflut.localization.filter_state import FilterState
from pflut.localization.motion import DifferentialDrive
from pflut.localization.particle_filter import ParticleFilter
from pflut.localization.proposals import UniformProposal
from pflut.localization.recovery import Recovery
from pflut.localization.resampling import RESAMPLERS
from pflut.localization.resampling_policy import EffectiveSizeBelow, EveryUpdates, Moved
from pflut.localization.sample_size import KLDSampling

ODOMETRY = [0.1, 0.02, 0.05]


def moving(rng: np.random.Generator | int, resampling: str = "systematic") -> ParticleFilter:
    pf = ParticleFilter(
        DifferentialDrive(), Position([0.3, 0.2]), num_particles=300, rng=rng, resampling=resampling
    )
    pf.initialize_uniform((-1, -1, 1, 1))
    return pf


def drive(pf: ParticleFilter, first: int, last: int) -> list[Estimate]:
    return [pf.step(ODOMETRY, [0.1 * k, 0.02 * k]) for k in range(first, last)]


def same(one: Estimate, other: Estimate) -> bool:
    return all(np.array_equal(getattr(one, n), getattr(other, n)) for n in vars(one))


@pytest.mark.parametrize("resampling", sorted(RESAMPLERS))
def test_a_resumed_drive_is_the_uninterrupted_one_to_the_last_bit(
    tmp_path: Path, resampling: str
) -> None:
    path = tmp_path / "filter.npz"
    whole = drive(moving(3, resampling), 0, 12)
    first = moving(3, resampling)
    drive(first, 0, 5)
    first.state().save(path)
    drive(first, 5, 7)  # what it does afterwards is not in the file
    second = moving(99, resampling)
    second.restore(FilterState.load(path))
    for estimate, expected in zip(drive(second, 5, 12), whole[5:], strict=True):
        assert same(estimate, expected)
    assert any(estimate.resampled for estimate in whole[5:])


def everything(rng: int) -> ParticleFilter:
    """A filter that has all there is: history, proposals, averages, a changing size, a policy."""
    pf = ParticleFilter(
        DifferentialDrive(),
        Position([0.3, 0.2]),
        num_particles=KLDSampling(min_particles=50, max_particles=400),
        resample_when=EveryUpdates(3) & Moved(0.2, 9.0),
        recovery=Recovery(
            proposal=UniformProposal((-1, -1, 1, 1)),
            probability=0.1,
            alpha_slow=0.05,
            alpha_fast=0.5,
        ),
        history=3,
        min_effective_share=0.1,
        rng=rng,
    )
    pf.initialize_uniform((-1, -1, 1, 1))
    return pf


def late_drive(pf: ParticleFilter, first: int, last: int) -> list[Estimate]:
    found = []
    for k in range(first, last):
        pf.predict(ODOMETRY, stamp=float(k))
        # every third image is one step old, every seventh older than the history
        stamp = k - 1.0 if k % 3 == 2 else k - 5.0 if k % 7 == 6 else float(k)
        found.append(pf.update([0.1 * k, 0.02 * k], stamp=stamp))
    return found


@pytest.mark.parametrize("stop", [1, 4, 7])
def test_everything_is_resumed_to_the_last_bit(tmp_path: Path, stop: int) -> None:
    whole = late_drive(everything(4), 0, 14)
    first, second = everything(4), everything(5)
    late_drive(first, 0, stop)
    first.state().save(tmp_path / "filter.npz")
    second.restore(FilterState.load(tmp_path / "filter.npz"))
    for estimate, expected in zip(late_drive(second, stop, 14), whole[stop:], strict=True):
        assert same(estimate, expected)
    assert whole[-1].dropped_updates > 0
    assert any(estimate.delay == 1.0 and not estimate.dropped for estimate in whole)
    assert len({estimate.num_particles for estimate in whole}) > 2


@pytest.mark.parametrize("name", ["PCG64", "PCG64DXSM", "MT19937", "Philox", "SFC64"])
def test_any_of_numpy_s_generators_goes_on(tmp_path: Path, name: str) -> None:
    generator = np.random.Generator(getattr(np.random, name)(5))
    pf = moving(generator)
    drive(pf, 0, 2)
    pf.state().save(tmp_path / "a.npz")
    expected = drive(pf, 2, 4)
    other = moving(0)
    other.restore(FilterState.load(tmp_path / "a.npz"))
    assert all(map(same, drive(other, 2, 4), expected))


def test_weights_that_rule_out_and_counts_are_kept(tmp_path: Path) -> None:
    pf = standing(50, resample_when=EffectiveSizeBelow(0.0))
    pf.update(np.where(np.arange(50) % 3, 0.1 * np.arange(50), -np.inf))
    pf.update(np.nan)
    assert pf.degenerate_updates == 1
    pf.state().save(tmp_path / "a.npz")
    other = standing(7)
    other.restore(FilterState.load(tmp_path / "a.npz"))
    assert np.array_equal(other.poses, pf.poses)
    assert np.array_equal(other.log_weights, pf.log_weights)
    assert np.isneginf(other.log_weights).sum() == 17
    assert other.degenerate_updates == 1
    assert same(other.estimate(), pf.estimate())
    # the number of particles is the new filter's at its next resampling
    assert other.update(0.0).resampled
    assert len(other.poses) == 7


def test_a_state_is_not_changed_by_what_the_filter_does_next() -> None:
    pf = moving(1)
    state = pf.state()
    poses, generator = state.particles.poses.copy(), dict(state.generator)
    drive(pf, 0, 3)
    assert np.array_equal(state.particles.poses, poses)
    assert state.generator == generator
    first, second = moving(2), moving(2)
    first.restore(state)
    second.restore(state)
    assert all(map(same, drive(first, 0, 3), drive(second, 0, 3)))


def test_the_same_state_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        pf = moving(1)
        drive(pf, 0, 2)
        pf.state().save(tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_a_filter_without_particles_has_no_state() -> None:
    with pytest.raises(ValueError, match="not initialised"):
        ParticleFilter(DifferentialDrive(), Fixed()).state()


def test_damaged_and_foreign_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "filter.npz"
    moving(0).state().save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"filter\.npz: not a particle filter's state of pflut"):
        FilterState.load(path)
    path.write_bytes(whole)
    with np.load(path) as file:
        stored = dict(file)
    for change, message in (
        ({"poses": stored["poses"] + 1e-12}, "checksum does not match"),
        ({"version": np.array(1)}, "version 1, expected 2"),
        ({"format": np.array("a table")}, "not the state of a pflut particle filter"),
        ({"generator": np.array("{}")}, "checksum does not match"),
    ):
        np.savez(path, **(stored | change))
        with pytest.raises(ValueError, match=rf"filter\.npz: .*{message}"):
            FilterState.load(path)
    del stored["poses"]
    np.savez(path, **stored)
    with pytest.raises(ValueError, match="checksum does not match"):
        FilterState.load(path)
    with pytest.raises(FileNotFoundError):
        FilterState.load(tmp_path / "nothing.npz")
    with pytest.raises(FileNotFoundError):
        moving(0).state().save(tmp_path / "no" / "folder.npz")


def test_a_generator_that_is_not_numpy_s() -> None:
    state = moving(0).state()
    foreign = FilterState(state.particles, state.averages, {"bit_generator": "mine"}, 0, 0)
    pf = moving(1)
    with pytest.raises(ValueError, match=r"generator: expected one of PCG64, .*, got mine"):
        pf.restore(foreign)
    assert len(drive(pf, 0, 1)) == 1
