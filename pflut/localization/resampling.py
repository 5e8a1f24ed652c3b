"""Resampling: which particles live on, drawn in proportion to their weights.

Every scheme is a function ``(weights, n, rng) -> indices``: the weights need not be normalised,
the indices are sorted int32, a particle of zero weight is never chosen, and the expected number
of copies of particle j is ``n * weights[j] / weights.sum()``. The schemes differ in the variance
of that number; the names and definitions are those of Douc, Cappe, Moulines, "Comparison of
resampling schemes for particle filtering" (2005).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut._jit import jit
from pflut.geometry import FloatArray

IndexArray = NDArray[np.int32]
Resampler = Callable[[ArrayLike, int, "np.random.Generator | int | None"], IndexArray]

# an expected count this close below a whole number is that number: its sum was rounded
_WHOLE = 1e-9


@jit
def _comb_indices(
    weights: FloatArray, last: int, total: float, uniforms: FloatArray, out: IndexArray
) -> None:
    """Choose with one point in each n-th of the total weight: O(N + n), no branch to mispredict.

    Point i lies at (i + uniform) / n; ``uniforms`` holds n numbers, or a single one for all.
    Particle j is written where its copies would start. One without copies is overwritten there
    by the next; a running maximum then fills the places between. ``last`` is the last particle
    with weight, which so also gets what rounding left over. ``out`` has n + 1 places: the last
    takes those that start behind the end.
    """
    n = out.shape[0] - 1
    step = 1 if uniforms.shape[0] > 1 else 0
    out[:] = 0
    cumulative = 0.0
    for j in range(last + 1):
        scaled = cumulative / total * n
        start = n
        if scaled < n:
            start = int(scaled)
            start += uniforms[start * step] < scaled - start
        out[start] = j
        cumulative += weights[j]
    for i in range(1, n):
        out[i] = max(out[i], out[i - 1])


@jit
def _merge_indices(
    weights: FloatArray, last: int, total: float, spacings: FloatArray, out: IndexArray
) -> None:
    """Choose with sorted uniform points given by n + 1 exponential spacings: O(N + n)."""
    span = 0.0
    for i in range(spacings.shape[0]):
        span += spacings[i]
    j = 0
    cumulative = weights[0]
    point = 0.0
    for i in range(out.shape[0]):
        point += spacings[i]
        position = point / span * total
        while position >= cumulative and j < last:
            j += 1
            cumulative += weights[j]
        out[i] = j


@jit
def _split_counts(
    weights: FloatArray, total: float, n: int, counts: IndexArray, residuals: FloatArray
) -> int:
    """Split the expected counts into whole copies and the rest; give the sum of the whole ones."""
    whole = 0
    for j in range(weights.shape[0]):
        expected = weights[j] / total * n
        counts[j] = int(expected + _WHOLE)
        residuals[j] = max(expected - counts[j], 0.0)
        whole += counts[j]
    return whole


@jit
def _round_rests(
    residuals: FloatArray, missing: int, uniforms: FloatArray, counts: IndexArray
) -> None:
    """Round the rests up or down, two at a time, until each has a whole copy or none: O(N).

    One particle is open. With the next one it plays for both rests: less than a copy goes to one of
    them, more than one gives a copy to one and leaves the other what is left over.
    """
    current, rest, given = -1, 0.0, 0
    for j in range(residuals.shape[0]):
        if residuals[j] == 0.0:
            continue
        if current < 0:
            current, rest = j, residuals[j]
            continue
        total = rest + residuals[j]
        if total < 1.0:
            if uniforms[j] * total >= rest:
                current = j
            rest = total
        else:
            first = uniforms[j] * (2.0 - total) < 1.0 - residuals[j]
            counts[current if first else j] += 1
            given += 1
            if first:
                current = j
            rest = total - 1.0
    # the last rest is a whole copy or nothing, but for rounding
    if given < missing:
        counts[current] += missing - given


@jit
def _expand_counts(counts: IndexArray, out: IndexArray) -> None:
    """Write each index as often as it counts."""
    i = 0
    for j in range(counts.shape[0]):
        for _ in range(counts[j]):
            out[i] = j
            i += 1


@jit
def _take_rows(poses: FloatArray, indices: IndexArray, out: FloatArray) -> None:
    """Copy the chosen poses."""
    for i in range(indices.shape[0]):
        j = indices[i]
        out[i, 0] = poses[j, 0]
        out[i, 1] = poses[j, 1]
        out[i, 2] = poses[j, 2]


def _check(weights: ArrayLike, n: int) -> tuple[FloatArray, int, float]:
    """Check weights; give them as float64, the last one with weight, and their sum."""
    w = np.ascontiguousarray(weights, dtype=np.float64)
    if w.ndim != 1 or w.size == 0:
        raise ValueError(f"weights: expected shape (N,) with N >= 1, got {w.shape}")
    if n < 0:
        raise ValueError(f"n: expected a number >= 0, got {n}")
    low, high = w.min(), w.max()
    if not (low >= 0.0 and high < np.inf):  # so written, NaN is refused as well
        row = int(np.flatnonzero(~((w >= 0.0) & (w < np.inf)))[0])
        raise ValueError(f"weights: value {row} is {w[row]}, expected finite and >= 0")
    if high == 0.0:
        raise ValueError("weights: all are zero, expected at least one above")
    if not 1e-200 < high < 1e200:  # sums and quotients would overflow
        w = w / high
    last = w.size - 1
    while w[last] == 0.0:
        last -= 1
    return w, last, float(w.sum())


def _whole_copies(weights: ArrayLike, n: int) -> tuple[IndexArray, FloatArray, int]:
    """Give the whole copies that are expected, the rests, and how many copies are missing."""
    w, _, total = _check(weights, n)
    counts, residuals = np.empty(w.size, dtype=np.int32), np.empty(w.size)
    return counts, residuals, n - _split_counts(w, total, n, counts, residuals)


def _expanded(counts: IndexArray, n: int) -> IndexArray:
    """Give each index as often as it counts, n in all."""
    out = np.empty(n, dtype=np.int32)
    _expand_counts(counts, out)
    return out


def systematic_indices(weights: ArrayLike, n: int, uniform: float) -> IndexArray:
    """Resample with a comb of n equal teeth, its random number in [0, 1) given.

    See `systematic`, which draws that number.
    """
    w, last, total = _check(weights, n)
    out = np.empty(n + 1, dtype=np.int32)
    _comb_indices(w, last, total, np.array([uniform]), out)
    return out[:n]


def systematic(
    weights: ArrayLike, n: int, rng: np.random.Generator | int | None = None
) -> IndexArray:
    """Resample with a comb of n equal teeth, placed by a single random number.

    The copies of a particle differ from their expectation by less than one. The cheapest, and
    the default.

    Parameters
    ----------
    weights : array_like of shape (N,)
        Finite, >= 0, not all zero; not necessarily normalised.
    n : int
        How many to draw.
    rng : numpy.random.Generator or int, optional

    Returns
    -------
    ndarray of shape (n,), int32
        Sorted indices into ``weights``.

    Raises
    ------
    ValueError
        If the weights are not as said above.
    """
    return systematic_indices(weights, n, np.random.default_rng(rng).random())


def stratified(
    weights: ArrayLike, n: int, rng: np.random.Generator | int | None = None
) -> IndexArray:
    """Resample with one point, placed at random, in each n-th of the total weight.

    Parameters
    ----------
    weights : array_like of shape (N,)
        Finite, >= 0, not all zero; not necessarily normalised.
    n : int
        How many to draw.
    rng : numpy.random.Generator or int, optional

    Returns
    -------
    ndarray of shape (n,), int32
        Sorted indices into ``weights``.

    Raises
    ------
    ValueError
        If the weights are not as said above.
    """
    w, last, total = _check(weights, n)
    uniforms = np.random.default_rng(rng).random(n)
    out = np.empty(n + 1, dtype=np.int32)
    _comb_indices(w, last, total, uniforms, out)
    return out[:n]


def multinomial(
    weights: ArrayLike, n: int, rng: np.random.Generator | int | None = None
) -> IndexArray:
    """Resample with n independent draws: the textbook's scheme, with the largest variance.

    The uniform points are drawn already sorted (normalised sums of exponential variates), so
    that one pass suffices.

    Parameters
    ----------
    weights : array_like of shape (N,)
        Finite, >= 0, not all zero; not necessarily normalised.
    n : int
        How many to draw.
    rng : numpy.random.Generator or int, optional

    Returns
    -------
    ndarray of shape (n,), int32
        Sorted indices into ``weights``.

    Raises
    ------
    ValueError
        If the weights are not as said above.
    """
    w, last, total = _check(weights, n)
    spacings = np.random.default_rng(rng).standard_exponential(n + 1)
    out = np.empty(n, dtype=np.int32)
    _merge_indices(w, last, total, spacings, out)
    return out


def residual(
    weights: ArrayLike, n: int, rng: np.random.Generator | int | None = None
) -> IndexArray:
    """Resample with the whole part of each expected count, and draw the rest independently.

    Parameters
    ----------
    weights : array_like of shape (N,)
        Finite, >= 0, not all zero; not necessarily normalised.
    n : int
        How many to draw.
    rng : numpy.random.Generator or int, optional

    Returns
    -------
    ndarray of shape (n,), int32
        Sorted indices into ``weights``.

    Raises
    ------
    ValueError
        If the weights are not as said above.

    References
    ----------
    Liu, Chen, "Sequential Monte Carlo methods for dynamic systems" (1998).
    """
    counts, residuals, missing = _whole_copies(weights, n)
    if missing > 0:
        drawn = np.bincount(multinomial(residuals, missing, rng), minlength=counts.size)
        counts += drawn.astype(np.int32)
    return _expanded(counts, n)


def ssp(weights: ArrayLike, n: int, rng: np.random.Generator | int | None = None) -> IndexArray:
    """Resample with each expected number of copies rounded up or down, negatively associated.

    The Srinivasan sampling process: what one particle gets, others do not. As with "systematic" the
    copies differ from their expectation by less than one; but convergence is proven, for any order
    of the particles.

    Parameters
    ----------
    weights : array_like of shape (N,)
        Finite, >= 0, not all zero; not necessarily normalised.
    n : int
        How many to draw.
    rng : numpy.random.Generator or int, optional

    Returns
    -------
    ndarray of shape (n,), int32
        Sorted indices into ``weights``.

    Raises
    ------
    ValueError
        If the weights are not as said above.

    References
    ----------
    Gerber, Chopin, Whiteley, "Negative association, ordering and convergence of resampling
    methods", Annals of Statistics 47(4), 2019.
    """
    counts, residuals, missing = _whole_copies(weights, n)
    _round_rests(residuals, missing, np.random.default_rng(rng).random(counts.size), counts)
    return _expanded(counts, n)


def take(poses: FloatArray, indices: IndexArray) -> FloatArray:
    """Copy the chosen poses: ``poses[indices]``, several times faster.

    Parameters
    ----------
    poses : ndarray of shape (N, 3)
        float64, contiguous.
    indices : ndarray of shape (n,), int32
        Each in [0, N): a resampler's answer. Not checked.

    Returns
    -------
    ndarray of shape (n, 3)
    """
    out = np.empty((indices.shape[0], 3))
    _take_rows(poses, indices, out)
    return out


RESAMPLERS: dict[str, Resampler] = {
    "systematic": systematic,
    "stratified": stratified,
    "multinomial": multinomial,
    "residual": residual,
    "ssp": ssp,
}


def _checking(resample: Resampler) -> Resampler:
    """Check what a function of somebody else's answers: kernels trust it."""

    def checked(
        weights: ArrayLike, n: int, rng: np.random.Generator | int | None = None
    ) -> IndexArray:
        # what somebody else's function writes into is its own
        indices = np.array(resample(np.array(weights), n, rng))
        if indices.shape != (n,) or indices.dtype.kind not in "iu":
            raise ValueError(
                f"resampling: expected {n} whole numbers, got {indices.dtype} of {indices.shape}"
            )
        if n and not 0 <= indices.min() <= indices.max() < np.size(weights):
            raise ValueError(
                f"resampling: expected indices 0 to {np.size(weights) - 1}, got "
                f"{indices.min()} to {indices.max()}"
            )
        return indices.astype(np.int32)

    return checked


def get_resampler(scheme: str | Resampler) -> Resampler:
    """Give a resampler by its name; what a function answers is checked at every call.

    Parameters
    ----------
    scheme : str or callable
        A key of ``RESAMPLERS``, or a function ``(weights, n, rng) -> sorted int32 indices``.

    Returns
    -------
    callable

    Raises
    ------
    ValueError
        If no scheme has that name.
    """
    if not isinstance(scheme, str):
        return scheme if scheme in RESAMPLERS.values() else _checking(scheme)
    if scheme not in RESAMPLERS:
        raise ValueError(f"resampling: expected one of {sorted(RESAMPLERS)}, got {scheme!r}")
    return RESAMPLERS[scheme]
