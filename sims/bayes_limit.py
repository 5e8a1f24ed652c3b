"""The limit: how many relative poses of the paper's simulator could be found at all.

    python sims/bayes_limit.py [--quick] [--pairs N] [--threads N] [--output DIR]

The Bayes-optimal estimator knows the simulator: the ball and its density of landmarks, the noise,
the share of mismatches, and how both cameras may stand. It gives the pose with the largest
posterior mass within 0.1 rad, which nothing can be right about more often. Beside it, on the same
pairs, stands the default table.

With the *hint*: mismatches show landmarks of the same ball, and so tell where its centre is, as
any true match does. That is the scene's, not the pose's, and no table uses it; so the limit is also
given with mismatches whose azimuths are uniform.

Where the cameras stand is one hidden number of a pair: the angle between them on the circle, over
which the likelihood is averaged. A true match's landmark is where its lines of sight meet; the
noise along them is averaged over, too. All else is Laplace's approximation. Whether it is good is
seen in the table: the posterior mass that the estimator promises should be its success.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from tqdm import tqdm

from pflut import Correspondences, CorrespondenceSimulator, LikelihoodTable
from pflut._files import write_csv
from pflut._jit import jit
from pflut._robust import TUKEY
from pflut.geometry import TWO_PI, wrap_to_pi
from pflut.likelihood.table import bearing_columns
from pflut.plot import save_figure
from pflut.plot.style import CYCLE, new_figure, tidy
from pflut.relpose.refine_kernels import refine_many
from pflut.relpose.search import CUTOFFS, STEPS_PER_CUTOFF, estimate_relative_poses
from pflut.statistics import success_rate

SUCCESS = 0.1
SEED = 1
CELLS = ((25, 0.8), (25, 0.85), (25, 0.9), (100, 0.85), (100, 0.9), (100, 0.93), (100, 0.95))
NOISE = 0.01
RADIUS = 2.0
VOLUME = 4.0 / 3.0 * np.pi * RADIUS**3
ANGLES = 40
"""Angles between the cameras, over which is averaged."""
NODES = 5
"""Parallaxes by which a true match may really be seen."""
FAR = 6.0
"""Standard deviations beyond which a residual is no true match's."""
LEAST = 1e-3
"""Radians: no angle of a triangle is smaller."""
SAFE = 16
"""So many correspondences can be multiplied before the logarithm is taken."""
MARGIN = 7.0
"""Nats below the maximum at which the posterior is not looked at any more."""
ALIKE = 0.01
"""Radians within which candidates are the same."""
GRID = 1536
"""Cells an axis in which the mass is integrated."""
AROUND = 8
"""Cells on either side of a candidate to begin with."""
NAMES = ("with the hint", "without", "default table")


@jit
def _chances(ahead_l, across_l, ahead_r, across_r, halves, asides, out):  # type: ignore[no-untyped-def]
    """Compute the density of two bearings as a mismatch for each angle of the cameras, ``out``.

    The ball's centre is half a baseline along, and aside. The loop is vectorised.
    """
    power = RADIUS * RADIUS - 1.0
    for d in range(halves.size):
        towards = ahead_l * halves[d] + across_l * asides[d]
        reach_l = towards + np.sqrt(towards * towards + power)
        towards = ahead_r * halves[d] + across_r * asides[d]
        reach_r = towards + np.sqrt(towards * towards + power)
        both = reach_l * reach_r
        out[d] = both * both * both * (1.0 / (9.0 * VOLUME * VOLUME))


@jit
def _landmarks(bearing, u, v, noise, shifts, weights, points):  # type: ignore[no-untyped-def]
    """Find where a true match's landmark may be; its number of places is returned.

    ``bearing`` (4,) sine and cosine of both elevations; ``u``, ``v`` (2,) sine and cosine of the
    headings less the azimuths. The baseline lies along x, L at 0 and R at 1. ``points`` (K, 4) out:
    x, y, z, and what the density of landmarks there, over volume, is multiplied with.
    """
    sin_l, cos_l, sin_r, cos_r = bearing
    sin_u, cos_u = u
    sin_v, cos_v = v
    square = (sin_r * cos_u) ** 2 + (cos_l * cos_r * sin_v - sin_r * sin_l * sin_u) ** 2
    square += (sin_l * cos_v) ** 2 + (cos_r * cos_l * sin_u - sin_l * sin_r * sin_v) ** 2
    residual = (sin_r * cos_l * sin_u + sin_l * cos_r * sin_v) / np.sqrt(square + 1e-18)
    if abs(residual) > FAR * noise:
        return 0
    height = np.exp(-0.5 * (residual / noise) ** 2) / (noise * np.sqrt(TWO_PI))
    a, b = np.arctan2(-sin_u, cos_u), np.arctan2(sin_v, cos_v)
    side = 1.0 if a + b > 0.0 else -1.0
    a, b = side * a, side * b
    spread_l, spread_r = noise / cos_l, noise / cos_r
    if a < -3.0 * spread_l or b < -3.0 * spread_r:
        return 0
    spread = np.sqrt(spread_l * spread_l + spread_r * spread_r)
    share = (spread_l / spread) ** 2
    known = 0
    for k in range(shifts.size):
        change = spread * shifts[k]
        at_l = max(a - share * change, LEAST)
        at_r = max(b - (1.0 - share) * change, LEAST)
        parallax = np.pi - at_l - at_r
        if parallax < LEAST:
            continue
        d_l, d_r = np.sin(at_r) / np.sin(parallax), np.sin(at_l) / np.sin(parallax)
        x, y = d_l * np.cos(at_l), side * d_l * np.sin(at_l)
        # the elevations' two heights, weighted by how well each is known
        w_l, w_r = (cos_l * cos_l / d_l) ** 2, (cos_r * cos_r / d_r) ** 2
        z = (w_l * d_l * sin_l / cos_l + w_r * d_r * sin_r / cos_r) / (w_l + w_r)
        rho_l, rho_r = np.sqrt(d_l * d_l + z * z), np.sqrt(d_r * d_r + z * z)
        cosine = (x * (x - 1.0) + y * y + z * z) / (rho_l * rho_r)
        sine = np.sqrt(max(1.0 - cosine * cosine, 1e-8))
        area = sine / (rho_l * rho_r) * np.sqrt(1.0 / rho_l**2 + 1.0 / rho_r**2)
        points[known, 0], points[known, 1], points[known, 2] = x, y, z
        points[known, 3] = weights[k] * height / area
        known += 1
    return known


@jit
def _log_mean(logs, factors, shares):  # type: ignore[no-untyped-def]
    """Give the log of the mean of exp(logs) times factors, weighted with shares."""
    largest = -np.inf
    for d in range(logs.size):
        logs[d] += np.log(factors[d] * shares[d])
        largest = max(largest, logs[d])
    total = 0.0
    for d in range(logs.size):
        total += np.exp(logs[d] - largest)
    return largest + np.log(total)


@jit
def log_likelihoods(  # type: ignore[no-untyped-def]
    columns, poses, hint, mismatch, noise, angles, shares, shifts, weights, plain, out
):
    """Compute the exact log-likelihood of a pair at poses, but for a constant: ``out`` (m,).

    ``columns`` (8, n) sines and cosines of azimuth_l, elevation_l, azimuth_r, elevation_r;
    ``poses`` (m, 2); ``hint`` whether mismatches show the same ball; ``angles`` (D,) between the
    cameras and ``shares`` (D,) that they have; ``shifts``, ``weights`` (K,) of standard normal
    noise; ``plain`` (n,) density of each correspondence as a mismatch of uniform azimuths.
    O(m n D).
    """
    n, num_angles = columns.shape[1], angles.size
    halves, asides = np.sin(0.5 * angles), np.cos(0.5 * angles)
    factors, logs = np.empty(num_angles), np.empty(num_angles)
    true, chances = np.empty(num_angles), np.empty(num_angles)
    points = np.empty((shifts.size, 4))
    for m in range(poses.shape[0]):
        sin_theta, cos_theta = np.sin(poses[m, 0]), np.cos(poses[m, 0])
        sin_phi, cos_phi = np.sin(poses[m, 1]), np.cos(poses[m, 1])
        factors[:] = 1.0
        logs[:] = 0.0
        for i in range(n):
            bearing = columns[2, i], columns[3, i], columns[6, i], columns[7, i]
            sin_u = sin_theta * columns[1, i] - cos_theta * columns[0, i]
            cos_u = cos_theta * columns[1, i] + sin_theta * columns[0, i]
            sin_v = sin_phi * columns[5, i] - cos_phi * columns[4, i]
            cos_v = cos_phi * columns[5, i] + sin_phi * columns[4, i]
            known = _landmarks(
                bearing, (sin_u, cos_u), (sin_v, cos_v), noise, shifts, weights, points
            )
            if known > 0:
                scale = (1.0 - mismatch) / VOLUME / plain[i]
                for d in range(num_angles):
                    # the ball's centre is half a baseline along, and aside
                    baseline = 2.0 * halves[d]
                    true[d] = 0.0
                    for k in range(known):
                        x = points[k, 0] * baseline - halves[d]
                        y = points[k, 1] * baseline - asides[d]
                        z = points[k, 2] * baseline
                        if x * x + y * y + z * z <= RADIUS * RADIUS:
                            true[d] += points[k, 3]
                    true[d] *= scale * baseline**3
            if hint:
                share = mismatch / plain[i]
                cos_l, cos_r = bearing[1], bearing[3]
                _chances(
                    cos_l * cos_u,
                    -cos_l * sin_u,
                    cos_r * cos_v,
                    cos_r * sin_v,
                    halves,
                    asides,
                    chances,
                )
                if known == 0:
                    for d in range(num_angles):
                        factors[d] *= share * chances[d]
                else:
                    for d in range(num_angles):
                        factors[d] *= share * chances[d] + true[d]
            elif known > 0:
                # a mismatch's factor is the same at every pose
                for d in range(num_angles):
                    factors[d] *= 1.0 + true[d] / mismatch
            if i % SAFE == 0:
                for d in range(num_angles):
                    logs[d] += np.log(factors[d])
                    factors[d] = 1.0
        out[m] = _log_mean(logs, factors, shares)


def plain_density(elevations: np.ndarray) -> np.ndarray:
    """Give the density of bearings on the sphere, all azimuths alike, at elevations."""
    axis = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181)
    azimuths = np.linspace(0.0, TWO_PI, 400, endpoint=False)
    towards = np.cos(axis)[:, None] * np.cos(azimuths)
    reach = towards + np.sqrt(towards**2 + RADIUS**2 - 1.0)
    return np.interp(elevations, axis, (reach**3 / (3.0 * VOLUME)).mean(axis=1))


class Limit:
    """The Bayes-optimal estimator of the paper's simulator."""

    def __init__(self, mismatch: float) -> None:
        self.mismatch = mismatch
        self.table = LikelihoodTable.default()
        # closer to each other where the cameras are, and where the headings vary most
        root = (np.arange(ANGLES // 2) + 0.5) / (ANGLES // 2)
        self.angles = np.append(np.pi * root**2, TWO_PI - np.pi * root**2)
        self.shares = np.append(root, root) / (2.0 * root.sum())
        self.shifts, weights = np.polynomial.hermite_e.hermegauss(NODES)
        self.weights = weights / weights.sum()

    def evaluate(self, bearings: np.ndarray, poses: np.ndarray, hint: bool) -> np.ndarray:
        """Give the log-likelihoods (m,) of bearings (n, 4), with the hint or without."""
        columns = bearing_columns(Correspondences(*bearings.T))
        plain = plain_density(bearings[:, 1]) * plain_density(bearings[:, 3])
        out = np.empty(len(poses))
        numbers = (self.mismatch, NOISE, self.angles, self.shares, self.shifts, self.weights)
        log_likelihoods(columns, np.ascontiguousarray(poses), hint, *numbers, plain, out)
        return out

    def estimates(self, bearings: np.ndarray) -> list[tuple[np.ndarray, float]]:
        """Give the optimal poses and the masses around them: with the hint, and without."""
        candidates = self.candidates(bearings)
        return [self.estimate(bearings, candidates, hint) for hint in (True, False)]

    def candidates(self, bearings: np.ndarray) -> np.ndarray:
        """Give the local maxima of the table's grids, polished and not."""
        columns, n = bearing_columns(Correspondences(*bearings.T)), len(bearings)
        odds, first = np.full(n, self.table.prior_odds), np.array([0, n])
        shapes = self.table.shapes(columns)
        found = []
        for bins, margin in ((128, 1e9), (256, 25.0)):
            poses, _, owners, _ = self.table.ridges(bins).candidates(
                columns, shapes, odds, first, margin=margin, most=512
            )
            polished = poses.copy()
            cutoffs = NOISE * np.array(CUTOFFS)
            scratch = np.empty((len(poses), 4)), np.empty(len(poses), np.int64)
            refine_many(
                columns, first, TUKEY, 0.0, cutoffs, STEPS_PER_CUTOFF, polished, owners, *scratch
            )
            found += [poses, polished]
        poses = np.concatenate(found)
        # many of them are the same by now
        return poses[np.unique(np.floor(poses / ALIKE).astype(int), axis=0, return_index=True)[1]]

    def seeds(self, bearings: np.ndarray, candidates: np.ndarray, hint: bool) -> np.ndarray:
        """Give the cells around the candidates that may hold a part of the mass, as a mask."""
        steps = 0.02 * np.array([-1.0, 0.0, 1.0])
        offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        values = self.evaluate(bearings, (candidates[:, None] + offsets).reshape(-1, 2), hint)
        values = values.reshape(len(candidates), -1).max(axis=1)
        middle = np.floor(candidates[values > values.max() - MARGIN] / TWO_PI * GRID)
        marked = np.zeros((GRID, GRID), bool)
        marked[tuple(middle.astype(np.int64).T % GRID)] = True
        return grown(marked, AROUND)

    def estimate(
        self, bearings: np.ndarray, candidates: np.ndarray, hint: bool
    ) -> tuple[np.ndarray, float]:
        """Give the optimal pose (2,), and the posterior mass around it.

        The mass is integrated over a grid: around the candidates, and on from there as far as it
        reaches, which is a long way along the band of a turn on the spot.
        """
        values = np.full((GRID, GRID), -np.inf)
        wanted = self.seeds(bearings, candidates, hint)
        while wanted.any():
            poses = (np.argwhere(wanted) + 0.5) * (TWO_PI / GRID)
            values[wanted] = self.evaluate(bearings, poses, hint)
            wanted = grown(values > values.max() - MARGIN, 2) & np.isneginf(values)
        mass = np.exp(values - values.max())
        total = mass.sum()
        reach = int(SUCCESS / TWO_PI * GRID)
        low = np.arange(GRID)
        for axis in range(2):
            padding = [(0, 0), (0, 0)]
            padding[axis] = (reach + 1, reach)
            sums = np.cumsum(np.pad(mass, padding, mode="wrap"), axis=axis)
            mass = np.take(sums, low + 2 * reach + 1, axis) - np.take(sums, low, axis)
        best = np.array(np.unravel_index(int(mass.argmax()), mass.shape))
        return (best + 0.5) * (TWO_PI / GRID), float(mass.max() / total)


def grown(marked: np.ndarray, cells: int) -> np.ndarray:
    """Mark all that is within so many cells of what is marked; the grid is a torus."""
    for axis in range(2):
        wide = marked.copy()
        for shift in range(1, cells + 1):
            wide |= np.roll(marked, shift, axis) | np.roll(marked, -shift, axis)
        marked = wide
    return marked


def main() -> None:
    """Run all cells."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="30 pairs a cell")
    parser.add_argument("--pairs", type=int, default=400, help="pairs a cell")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--output", type=Path, default=Path("results/bayes_limit"))
    arguments = parser.parse_args()
    pairs = 30 if arguments.quick else arguments.pairs
    arguments.output.mkdir(parents=True, exist_ok=True)
    rows = []
    total = pairs * len(CELLS)
    with (
        tqdm(total=total, unit="pair", disable=None) as bar,
        ThreadPoolExecutor(arguments.threads) as pool,
    ):
        for count, share in CELLS:
            headings, bearings = CorrespondenceSimulator(mismatch=share, noise=NOISE).sample(
                pairs, count, rng=SEED
            )
            limit = Limit(round(share * count) / count)
            given = [Correspondences(*pair.T) for pair in bearings]
            by_table = estimate_relative_poses(given, limit.table)
            poses = np.empty((pairs, len(NAMES), 2))
            poses[:, 2] = [[pose.heading_l, pose.heading_r] for pose in by_table]
            promised = np.full((pairs, len(NAMES)), np.nan)
            for k, estimates in enumerate(pool.map(limit.estimates, bearings)):
                for column, (pose, mass) in enumerate(estimates):
                    poses[k, column], promised[k, column] = pose, mass
                bar.update()
            found = np.abs(wrap_to_pi(poses - headings[:, None])).max(axis=2) < SUCCESS
            for name, successes, masses in zip(NAMES, found.T, promised.T, strict=True):
                rate = success_rate(successes)
                row = (name, count, share, pairs, rate.rate, rate.low, rate.high, masses.mean())
                rows.append(row)
    print(f"{pairs} pairs a cell, seed {SEED}; success: both headings within {SUCCESS} rad")
    print(f"{'estimator':16}{'n':>4}{'mismatch':>10}{'success':>9}{'95 % interval':>16}", end="")
    print(f"{'promised':>10}")
    for name, count, share, _, rate, low, high, mass in rows:
        interval = f"{low:.3f} to {high:.3f}"
        shown = "" if np.isnan(mass) else f"{mass:.3f}"
        print(f"{name:16}{count:4}{share:10.2f}{rate:9.3f}{interval:>16}{shown:>10}")
    columns = (
        "estimator",
        "correspondences",
        "mismatch",
        "pairs",
        "success",
        "low",
        "high",
        "mass",
    )
    write_csv(arguments.output / "limit.csv", columns, rows)
    figure = new_figure(8.0, 4.0)
    axes = figure.subplots(1, 2, sharey=True)
    for panel, count in zip(axes, (25, 100), strict=True):
        for color, name in zip(CYCLE, NAMES, strict=False):
            some = np.array([row[2:7] for row in rows if row[:2] == (name, count)])
            share, _, rate, low, high = some.T
            label = name if name == NAMES[2] else f"limit, {name}"
            panel.errorbar(
                100 * share, rate, (rate - low, high - rate), fmt=".-", color=color, label=label
            )
        panel.set(xlabel="mismatches [%]", title=f"{count} correspondences", ylim=(0.0, 1.02))
        tidy(panel)
    axes[0].set_ylabel("success")
    axes[0].legend(frameon=False)
    save_figure(figure, arguments.output / "limit.png")
    print(f"written: {arguments.output}")


if __name__ == "__main__":
    main()
