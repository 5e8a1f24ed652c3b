"""Measure the filter's parts in ns a particle, beside filterpy, particles and NumPy, in one run.

    python sims/filter_speed.py [N ...]

Each figure is the median of several runs in this process, on one core. A whole step is motion,
weights, estimate and resampling, with a sensor that costs nothing; the last lines are those of an
image with matches given, of particles that are spread over 0.3 m, and over 0.1 m. `particles` is
measured where it is installed.

Of a million particles the system's zeroing of fresh pages is a good part; memory that is kept costs
none: MALLOC_TRIM_THRESHOLD_=4000000000 MALLOC_MMAP_THRESHOLD_=4000000000 (glibc).
"""

from __future__ import annotations

import argparse
import tracemalloc
from collections.abc import Callable
from time import perf_counter

import numpy as np

from pflut import (
    CorrespondenceSimulator,
    LikelihoodTable,
    ReferenceImageModel,
    ReferenceMap,
    ReferenceMatch,
)
from pflut.localization.estimate import summarize
from pflut.localization.motion import DifferentialDrive
from pflut.localization.particle_filter import ParticleFilter
from pflut.localization.resampling import RESAMPLERS
from pflut.localization.resampling_policy import EffectiveSizeBelow
from pflut.localization.weights import Weights

try:
    from particles import resampling as theirs
except ImportError:
    theirs = None

ODOMETRY = np.array([0.3, 0.05, 0.1])
REFERENCES = 10


def median_ns(function: Callable[[], object], n: int) -> float:
    """Call a function some times; give the median in ns a particle."""
    function()
    times = []
    for _ in range(max(5, min(100, 500_000 // n))):
        start = perf_counter()
        function()
        times.append(perf_counter() - start)
    return float(np.median(times)) / n * 1e9


def numpy_move(poses: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Move particles as in table 5.6, with NumPy alone."""
    n = len(poses)
    first, distance = np.arctan2(ODOMETRY[1], ODOMETRY[0]), np.hypot(*ODOMETRY[:2])
    turned = poses[:, 2] + first + 0.05 * rng.standard_normal(n)
    along = distance + 0.03 * rng.standard_normal(n)
    heading = turned + ODOMETRY[2] - first + 0.05 * rng.standard_normal(n)
    x = poses[:, 0] + along * np.cos(turned)
    y = poses[:, 1] + along * np.sin(turned)
    return np.column_stack([x, y, (heading + np.pi) % (2 * np.pi) - np.pi])


def numpy_systematic(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Resample with NumPy alone."""
    n = len(weights)
    return np.searchsorted(np.cumsum(weights), (np.arange(n) + rng.random()) / n)


def numpy_step(
    poses: np.ndarray, log_likelihood: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Make the whole step with NumPy alone: move, weights, mean and covariance, resampling."""
    poses = numpy_move(poses, rng)
    weights = np.exp(log_likelihood - log_likelihood.max())
    weights /= weights.sum()
    mean = weights @ poses
    mean[2] = np.arctan2(weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2]))
    spread = poses - mean
    spread[:, 2] = (spread[:, 2] + np.pi) % (2 * np.pi) - np.pi
    (spread * weights[:, None]).T @ spread
    return poses[np.minimum(numpy_systematic(weights, rng), len(poses) - 1)]


class FreeSensor:
    """A sensor that answers at once."""

    def log_likelihood(self, poses: np.ndarray, observation: np.ndarray) -> np.ndarray:
        """Give the observation: it is the answer."""
        return observation


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sizes", nargs="*", type=int, default=[1_000, 10_000, 100_000, 1_000_000])
    sizes = parser.parse_args().sizes
    rows: dict[str, list[float]] = {}
    for n in sizes:
        measure(n, lambda name, value: rows.setdefault(name, []).append(value))
    print(f"{'ns a particle':<46}" + "".join(f"{n:>10,}" for n in sizes))
    for name, values in rows.items():
        print(f"{name:<46}" + "".join(f"{value:>10.1f}" for value in values))
    print()
    for name, ours, theirs in (
        ("systematic: filterpy / pflut", "systematic", "filterpy systematic"),
        ("systematic: NumPy / pflut", "systematic", "NumPy systematic"),
        ("systematic: particles / pflut", "systematic", "particles systematic"),
        ("motion: NumPy / pflut", "motion, differential", "NumPy motion"),
        ("whole step: NumPy / pflut", "whole step, always resampling", "NumPy whole step"),
    ):
        if theirs not in rows:
            continue
        ratios = (b / a for a, b in zip(rows[ours], rows[theirs], strict=True))
        print(f"{name:<46}" + "".join(f"{ratio:>9.1f}x" for ratio in ratios))


def measure(n: int, report: Callable[[str, float], None]) -> None:
    """Measure every part with n particles."""
    from filterpy.monte_carlo import systematic_resample

    rng = np.random.default_rng(0)
    poses = rng.normal([1.0, 2.0, 3.0], [0.3, 0.3, 0.1], (n, 3))
    log_likelihood = -0.5 * ((poses[:, :2] - [1.0, 2.0]) ** 2).sum(axis=1) / 0.2**2
    # branches learn what is repeated: many sets of weights, taken in turn
    many = [Weights.from_log(rng.permutation(log_likelihood)) for _ in range(max(1, 200_000 // n))]
    turn = iter(range(10**9))

    def some() -> Weights:
        return many[next(turn) % len(many)]

    for name, resample in RESAMPLERS.items():
        report(name, median_ns(lambda resample=resample: resample(some().linear, n, rng), n))
    report("filterpy systematic", median_ns(lambda: systematic_resample(some().linear), n))
    report("NumPy systematic", median_ns(lambda: numpy_systematic(some().linear, rng), n))
    if theirs is not None:
        report("particles systematic", median_ns(lambda: theirs.systematic(some().linear, n), n))

    drive = DifferentialDrive()
    floor = DifferentialDrive(position_noise=0.01, heading_noise=0.01)
    report("motion, differential", median_ns(lambda: drive.sample(poses, ODOMETRY, rng), n))
    report(
        "motion, with a floor of noise", median_ns(lambda: floor.sample(poses, ODOMETRY, rng), n)
    )
    report("NumPy motion", median_ns(lambda: numpy_move(poses, rng), n))
    report("NumPy, three normals alone", median_ns(lambda: rng.standard_normal((3, n)), n))

    weights = many[0]
    report("weights", median_ns(lambda: weights.times(log_likelihood), n))
    report("estimate, tracking", median_ns(lambda: summarize(poses, weights), n))
    lost = rng.uniform([-20, -20, -np.pi], [20, 20, np.pi], (n, 3))
    report("estimate, lost", median_ns(lambda: summarize(lost, Weights.uniform(n)), n))

    for name, threshold in (("always", 1.0), ("never", 0.0)):
        pf = ParticleFilter(
            drive, FreeSensor(), num_particles=n, resample_when=EffectiveSizeBelow(threshold), rng=0
        )

        def step(pf: ParticleFilter = pf) -> None:
            pf.initialize(poses)
            pf.step(ODOMETRY, log_likelihood)

        start = median_ns(lambda pf=pf: pf.initialize(poses), n)
        report(f"whole step, {name} resampling", median_ns(step, n) - start)
    report("NumPy whole step", median_ns(lambda: numpy_step(poses, log_likelihood, rng), n))
    measure_sensor(n, report)


def measure_sensor(n: int, report: Callable[[str, float], None]) -> None:
    """Measure an update with ten references whose matches are given, 100 with each."""
    rng = np.random.default_rng(1)
    references = rng.uniform([-3, -3, -np.pi], [3, 3, np.pi], (REFERENCES, 3))
    pairs, _ = CorrespondenceSimulator(mismatch=0.8).pairs(REFERENCES, 100, rng=0)
    matches = [ReferenceMatch(index, pair) for index, pair in enumerate(pairs)]
    table = LikelihoodTable.default(bins=192)
    sensor = ReferenceImageModel(ReferenceMap.of_poses(references), table, max_range=8.0)
    for where, spread in (("", 0.3), (" 0.1 m", 0.1)):
        poses = rng.normal([0.2, 0.1, 1.0], [spread, spread, 0.1], (n, 3))
        pf = ParticleFilter(DifferentialDrive(), sensor, num_particles=n, rng=0)
        likelihood = median_ns(lambda poses=poses: sensor.log_likelihood(poses, matches), n)
        report(f"likelihood, 10 references, a reference{where}", likelihood / REFERENCES)

        def update(pf: ParticleFilter = pf, poses: np.ndarray = poses) -> None:
            pf.initialize(poses)
            pf.update(matches)

        start = median_ns(lambda pf=pf, poses=poses: pf.initialize(poses), n)
        whole = median_ns(update, n) - start
        report(f"update, 10 references, a reference{where}", whole / REFERENCES)
        report(f"update, 10 references{where} [ms]", 1e-6 * whole * n)
    tracemalloc.start()
    pf.initialize(poses)
    tracemalloc.reset_peak()
    pf.step(ODOMETRY, matches)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    report("memory at most [bytes]", peak / n)


if __name__ == "__main__":
    main()
