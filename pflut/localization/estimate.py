"""From particles to one pose: the mean of the heaviest cluster, its covariance, a confidence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut._cells import COORDINATE_MASK, EMPTY, cell_key, empty_table, find_cell, heading_cell
from pflut._jit import jit
from pflut.geometry import TWO_PI, FloatArray, as_poses, wrap_to_pi
from pflut.localization.resampling import systematic_indices, take
from pflut.localization.weights import Weights

METHODS = ("cluster", "mean")

# "here" for the confidence: near enough to call the robot localized
CONFIDENCE_RADIUS = 0.5
CONFIDENCE_ANGLE = np.deg2rad(10.0)

# the coarse histogram
CELL_SIZE = 0.5
CELLS_OF_HEADING = 18
# so many draws from the particles suffice to find where most of them are
NUM_DRAWS = 2048

# the mean's window, at least; and how often it may move
WINDOW_RADIUS = 1.0
WINDOW_ANGLE = np.deg2rad(30.0)
MAX_PASSES = 12
# what holds less of the weight is no cluster but a chance neighbourhood of a lost robot
SMALLEST_CLUSTER = 0.05


@dataclass(frozen=True, eq=False)
class Estimate:
    """What the filter believes after an update.

    Parameters
    ----------
    pose : ndarray of shape (3,)
        ``[x, y, heading]``, metres and radians, heading in (-pi, pi].
    covariance : ndarray of shape (3, 3)
        Of the particles in the cluster around ``pose``; of all particles for the method "mean",
        and for a robot that is lost: where the cluster holds less than 5 % of the weight.
        Differences of headings are wrapped.
    confidence : float
        In [0, 1]: what the particles give for the probability that the pose is within 0.5 m and
        10 degrees, their share of the weight there. Of a filter's update the smaller one of that
        and of what Bayes' rule makes of the image, before any flattening: when the image speaks
        for another place, it falls at once.
    cluster_weight : float
        Share of the weight that the pose is the mean of, in (0, 1].
    effective_sample_size : float
        Of the weights before resampling, in [1, num_particles].
    num_particles : int
        How many particles there were.
    log_mean_likelihood : float or None
        Log of the observation's mean likelihood over the weighted particles, not normalised: it
        falls when the observation fits none of them. None without an observation that counted.
    likelihood_exponent : float
        In (0, 1]: the power that the likelihood was flattened with to keep enough effective
        particles, see `ParticleFilter`.
    proposed_share : float
        In [0, 1]: share of the weight that the poses of `Recovery` have, by Bayes' rule, before
        any flattening. Near one where the robot was carried away, or found at last.
    resampled : bool
        Whether the particles were resampled after this estimate.
    degenerate : bool
        Whether the observation was ignored, because its likelihoods were NaN or +inf, or zero
        for every particle.
    degenerate_updates : int
        How many observations were ignored since the initialisation.
    stamp : float or None
        Seconds: when the robot was at the pose.
    delay : float
        Seconds that the observation is older than the pose.
    dropped : bool
        Whether the observation came too late for the filter's history and was not used.
    dropped_updates : int
        How many were since the initialisation.
    """

    pose: FloatArray
    covariance: FloatArray
    confidence: float
    cluster_weight: float
    effective_sample_size: float
    num_particles: int
    log_mean_likelihood: float | None = None
    likelihood_exponent: float = 1.0
    proposed_share: float = 0.0
    resampled: bool = False
    degenerate: bool = False
    degenerate_updates: int = 0
    stamp: float | None = None
    delay: float = 0.0
    dropped: bool = False
    dropped_updates: int = 0

    @property
    def position_std(self) -> float:
        """Metres: square root of the variances of x and y added."""
        return float(np.sqrt(self.covariance[0, 0] + self.covariance[1, 1]))

    @property
    def heading_std(self) -> float:
        """Radians: standard deviation of the heading."""
        return float(np.sqrt(self.covariance[2, 2]))


@jit
def _moments(
    poses: FloatArray,
    weights: FloatArray,
    center: FloatArray,
    radius: float,
    angle: float,
    out: FloatArray,
) -> None:
    """Sum w e e^T over the poses in a window, e = [1, x, y, heading] from its center: O(N).

    ``out`` (4, 4): so its first row holds the weight and the first moments.
    """
    center_x, center_y, center_h = center[0], center[1], center[2]
    radius2 = radius * radius
    w0, wx, wy, wh = 0.0, 0.0, 0.0, 0.0
    wxx, wxy, wxh, wyy, wyh, whh = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(poses.shape[0]):
        x = poses[i, 0] - center_x
        y = poses[i, 1] - center_y
        h = poses[i, 2] - center_h
        h -= TWO_PI * np.rint(h * (1.0 / TWO_PI))
        inside = (x * x + y * y <= radius2) & (abs(h) <= angle)
        w = weights[i] if inside else 0.0
        w0 += w
        wx += w * x
        wy += w * y
        wh += w * h
        wxx += w * x * x
        wxy += w * x * y
        wxh += w * x * h
        wyy += w * y * y
        wyh += w * y * h
        whh += w * h * h
    out[0, 0], out[0, 1], out[0, 2], out[0, 3] = w0, wx, wy, wh
    out[1, 0], out[1, 1], out[1, 2], out[1, 3] = wx, wxx, wxy, wxh
    out[2, 0], out[2, 1], out[2, 2], out[2, 3] = wy, wxy, wyy, wyh
    out[3, 0], out[3, 1], out[3, 2], out[3, 3] = wh, wxh, wyh, whh


@jit
def _mass(
    poses: FloatArray, weights: FloatArray, center: FloatArray, radius: float, angle: float
) -> float:
    """Sum the weights of the poses in a window: O(N)."""
    center_x, center_y, center_h = center[0], center[1], center[2]
    radius2 = radius * radius
    mass = 0.0
    for i in range(poses.shape[0]):
        x = poses[i, 0] - center_x
        y = poses[i, 1] - center_y
        h = poses[i, 2] - center_h
        h -= TWO_PI * np.rint(h * (1.0 / TWO_PI))
        inside = (x * x + y * y <= radius2) & (abs(h) <= angle)
        mass += weights[i] if inside else 0.0
    return mass


@jit
def _mean(poses: FloatArray, weights: FloatArray, out: FloatArray) -> None:
    """Write the weighted mean of all, the heading's by its sine and cosine: O(N)."""
    x, y, sin, cos = 0.0, 0.0, 0.0, 0.0
    for i in range(poses.shape[0]):
        w = weights[i]
        x += w * poses[i, 0]
        y += w * poses[i, 1]
        sin += w * np.sin(poses[i, 2])
        cos += w * np.cos(poses[i, 2])
    out[0], out[1], out[2] = x, y, np.arctan2(sin, cos)


@jit
def _vote(
    poses: FloatArray,
    cell: float,
    cells_of_heading: int,
    keys: NDArray[np.int64],
    votes: NDArray[np.int32],
    out: FloatArray,
) -> None:
    """Write the center of the cell with most votes, its neighbours' counting less: O(N).

    ``keys`` is an empty hash table for as many cells as poses, ``votes`` (zeros) belongs to it.
    """
    left, bottom = poses[0, 0], poses[0, 1]
    for i in range(poses.shape[0]):
        left = min(left, poses[i, 0])
        bottom = min(bottom, poses[i, 1])
    for i in range(poses.shape[0]):
        # +1: the neighbours of the first cells have coordinates that are not negative, too
        x = (int((poses[i, 0] - left) / cell) + 1) & COORDINATE_MASK
        y = (int((poses[i, 1] - bottom) / cell) + 1) & COORDINATE_MASK
        h = heading_cell(poses[i, 2], cells_of_heading)
        place = find_cell(x, y, h, keys)
        keys[place] = cell_key(x, y, h)
        votes[place] += 1
    best = -1
    for place in range(keys.shape[0]):
        if keys[place] == EMPTY:
            continue
        x, y, h = keys[place] >> 34, (keys[place] >> 8) & COORDINATE_MASK, keys[place] & 0xFF
        score = 0
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                for dh in range(-1, 2):
                    neighbor = (h + dh + cells_of_heading) % cells_of_heading
                    found = find_cell(x + dx, y + dy, neighbor, keys)
                    score += votes[found] << (3 - abs(dx) - abs(dy) - abs(dh))
        if score > best:
            best = score
            out[0] = left + (x - 0.5) * cell
            out[1] = bottom + (y - 0.5) * cell
            out[2] = (h + 0.5) * TWO_PI / cells_of_heading


@jit
def _settle(poses: FloatArray, center: FloatArray, window: FloatArray) -> None:
    """Shift a window to the mean of what it holds, let it grow to its spread, until it rests.

    ``center`` (3,) and ``window`` (2,), its radius and angle, are changed.
    """
    sums, weights = np.empty((4, 4)), np.full(poses.shape[0], 1.0 / poses.shape[0])
    for _ in range(MAX_PASSES):
        _moments(poses, weights, center, window[0], window[1], sums)
        share = sums[0, 0]
        if share <= 0.0:
            break
        farthest = 0.0
        for k in range(3):
            farthest = max(farthest, abs(sums[0, k + 1] / share))
            center[k] += sums[0, k + 1] / share
        rests = farthest < 1e-3
        if share >= SMALLEST_CLUSTER:
            x, y, h = sums[0, 1] / share, sums[0, 2] / share, sums[0, 3] / share
            variance = max(sums[1, 1] / share - x * x, sums[2, 2] / share - y * y)
            radius = 3.0 * np.sqrt(max(variance, 0.0))
            angle = min(3.0 * np.sqrt(max(sums[3, 3] / share - h * h, 0.0)), np.pi)
            rests = rests and radius <= 1.05 * window[0] and angle <= 1.05 * window[1]
            window[0], window[1] = max(window[0], radius), max(window[1], angle)
        if rests:
            break


def _fullest_cell(poses: FloatArray) -> FloatArray:
    """Find the center of the fullest cell of a coarse histogram over (x, y, heading)."""
    keys = empty_table(len(poses))
    votes = np.zeros(keys.shape, dtype=np.int32)
    center = np.empty(3)
    _vote(poses, CELL_SIZE, CELLS_OF_HEADING, keys, votes, center)
    return center


def _window(
    poses: FloatArray, weights: FloatArray, center: FloatArray, radius: float, angle: float
) -> tuple[float, FloatArray, FloatArray]:
    """Give the share of the weight in a window, the mean pose there and the covariance."""
    sums = np.empty((4, 4))
    _moments(poses, weights, center, radius, angle, sums)
    share = float(sums[0, 0])
    if share <= 0.0:
        return 0.0, center, np.zeros((3, 3))
    shift = sums[0, 1:] / share
    covariance = sums[1:, 1:] / share - shift[:, None] * shift
    if covariance.diagonal().min() < 0.0:  # rounding, where all particles are one
        np.fill_diagonal(covariance, np.maximum(covariance.diagonal(), 0.0))
    return share, center + shift, covariance


class Cluster(NamedTuple):
    """Particles that stand together.

    Parameters
    ----------
    share : float
        Of the weight.
    pose : ndarray of shape (3,)
        Their mean; the heading is not wrapped.
    covariance : ndarray of shape (3, 3)
    radius, angle : float
        Metres and radians around the pose that they lie within.
    """

    share: float
    pose: FloatArray
    covariance: FloatArray
    radius: float
    angle: float


def heaviest_cluster(poses: FloatArray, weights: FloatArray) -> Cluster:
    """Shift a window from the heaviest cell to the mean of what it holds, until it rests.

    It is looked for among 2048 draws from the particles; what it holds is that of all.

    The window grows to three standard deviations of what it holds, so that a wide cluster is
    not cut; from one that stands apart it does not reach the others. It does not grow where it
    holds less than 5 % of the weight.

    Parameters
    ----------
    poses : ndarray of shape (N, 3)
        float64, contiguous, finite.
    weights : ndarray of shape (N,)
        >= 0, not all zero, their sum at most one.
    """
    # draws with a fixed tooth: the same particles give the same cluster, and however many they are
    # one pass chooses those that are looked at again and again
    drawn = take(poses, systematic_indices(weights, NUM_DRAWS, 0.5))
    center, window = _fullest_cell(drawn), np.array([WINDOW_RADIUS, WINDOW_ANGLE])
    _settle(drawn, center, window)
    radius, angle = window.tolist()
    share, mean, covariance = _window(poses, weights, center, radius, angle)
    return Cluster(share, mean, covariance, radius, angle)


def mass_near(poses: FloatArray, weights: FloatArray, pose: FloatArray) -> float:
    """Give the share of the weight within 0.5 m and 10 degrees of a pose: a confidence.

    Parameters
    ----------
    poses : ndarray of shape (N, 3)
        float64, contiguous, finite.
    weights : ndarray of shape (N,)
        Their sum is one.
    pose : ndarray of shape (3,)

    Returns
    -------
    float
        In [0, 1].
    """
    return min(float(_mass(poses, weights, pose, CONFIDENCE_RADIUS, CONFIDENCE_ANGLE)), 1.0)


def summarize(poses: FloatArray, weights: Weights, *, method: str = "cluster") -> Estimate:
    """Estimate the pose from particles whose weights are normalised already.

    Parameters
    ----------
    poses : ndarray of shape (N, 3)
        float64, contiguous, finite.
    weights : Weights
        N of them.
    method : {"cluster", "mean"}
        As in `estimate_from_particles`.

    Returns
    -------
    Estimate
    """
    if method == "cluster":
        share, pose, covariance, _, _ = heaviest_cluster(poses, weights.linear)
        if share < SMALLEST_CLUSTER:  # lost: it may be anywhere
            _, mean, covariance = _window(poses, weights.linear, pose, np.inf, np.inf)
            offset = mean - pose
            covariance = covariance + offset[:, None] * offset
    elif method == "mean":
        pose = np.empty(3)
        _mean(poses, weights.linear, pose)
        share, _, covariance = _window(poses, weights.linear, pose, np.inf, np.inf)
    else:
        raise ValueError(f"method: expected one of {METHODS}, got {method!r}")
    pose[2] = wrap_to_pi(pose[2])
    return Estimate(
        pose=pose,
        covariance=covariance,
        confidence=mass_near(poses, weights.linear, pose),
        cluster_weight=min(share, 1.0),
        effective_sample_size=weights.effective_sample_size,
        num_particles=len(weights),
    )


def estimate_from_particles(
    poses: ArrayLike, log_weights: ArrayLike | None = None, *, method: str = "cluster"
) -> Estimate:
    """Estimate the pose from weighted particles.

    Parameters
    ----------
    poses : array_like of shape (N, 3)
        ``[x, y, heading]``.
    log_weights : array_like of shape (N,), optional
        Not necessarily normalised; -inf rules a particle out. By default all weigh the same.
    method : {"cluster", "mean"}
        "cluster": the heaviest cell of a coarse histogram (0.5 m, 20 degrees, neighbours
        counting), then the mean of the particles in a window around it (1 m, 30 degrees, or
        three standard deviations where that is more), moved to that mean until it rests. With
        two hypotheses it gives one of them. "mean": over all particles, the heading's by its
        sine and cosine; with two hypotheses it lies between them.

    Returns
    -------
    Estimate

    Raises
    ------
    ValueError
        If shapes do not fit, a pose is not finite, a weight is NaN or +inf, or all are zero.
    """
    particles = as_poses(poses)
    weights = Weights.of_poses(len(particles), log_weights)
    return summarize(particles, weights, method=method)
