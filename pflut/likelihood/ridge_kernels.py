"""Kernels of the grid: a correspondence adds its ridge, and touches no other cell.

In each row of the grid (a heading of the view that is nearer to the landmark) the curve
sin v = -r sin u crosses once, or twice where |r| is near 1. The cells around the crossing get one
of few profiles, made beforehand (`ridges`): by how fast the residual grows from cell to cell,
where within its cell the curve crosses, and how probable the landmark is there. A row costs one
addition of eight numbers, or a few.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pflut._jit import jit
from pflut._lanes import LANES, add_lanes, add_transposed
from pflut._trig import fast_arctan2
from pflut.geometry import TWO_PI

SUBCELLS = 8
"""Places within a cell where a curve may cross; the kernel takes them from an integer's bits."""
WIDTH = 5 * LANES
"""Cells of a profile: the block of eight around the crossing, and two on either side."""
MIDDLE = 2 * LANES
"""Where the middle block begins; its fourth cell holds the crossing."""
LEFT = MIDDLE + LANES
"""Columns before the grid's first one, into which profiles run; folded back at the end."""
PAD = 2 * LEFT
"""Columns that a plane has beyond the grid's."""
LEVEL_STEPS = 512
"""Steps of the parallax from LEVEL_FROM to pi, in which a landmark's level is looked up."""
LEVEL_FROM = -0.3125
GROWTH_OCTAVES = 5
"""Classes of the residual's growth from 2 ** -GROWTH_OCTAVES to 1 radian a radian: four an octave,
taken from the bits of a float32."""
GROWTH_BITS = 21
LEAST_GROWTH = (127 - GROWTH_OCTAVES) << (23 - GROWTH_BITS)
NUM_GROWTHS = 4 * GROWTH_OCTAVES + 1
FLAT = 0.2
"""Growth of the residual for a unit of its second derivative, where the curve is flat: over the
width of a ridge."""
MERGED = 1.35
"""Radians from the baseline beyond which the two branches share a ridge."""
HALF_PI = 0.5 * np.pi
BAND = 32
"""Rows that stay in the first-level cache while a chunk of correspondences is added."""
CHUNK = 32
"""Correspondences whose crossings are kept at a time."""


class RidgeArrays(NamedTuple):
    """What grids of so many bins B are made of, for the kernels.

    Parameters
    ----------
    sines, cosines : ndarray of shape (B,), float32
        Of the cells' headings.
    levels : ndarray of shape (shapes, LEVEL_STEPS + 1), int16
        How probable a landmark is at a parallax, in steps, at even odds.
    highest : ndarray of shape (shapes,), int64
        Of the levels.
    reach : ndarray of shape (shapes,)
        By how much lines of sight may diverge, radians.
    bases : ndarray of shape (shapes,), int32
        First profile of each kind of elevation.
    near_by : float32
        Growth of the residual below which a profile is wider than its middle block.
    size : int
        Numbers from one level's profiles to the next's.
    profiles : ndarray of float32
        Log-likelihood ratios: (levels, kinds, growths, SUBCELLS, WIDTH) in a row.
    """

    sines: NDArray[np.float32]
    cosines: NDArray[np.float32]
    levels: NDArray[np.int16]
    highest: NDArray[np.int64]
    reach: NDArray[np.float64]
    bases: NDArray[np.int32]
    near_by: np.float32
    size: int
    profiles: NDArray[np.float32]


class Candidates(NamedTuple):
    """The highest local maxima of the grids of many pairs.

    Parameters
    ----------
    poses : ndarray of shape (m, 2)
        Headings, radians.
    values : ndarray of shape (m,)
        Of the grid, but for a constant of the pair.
    owners : ndarray of shape (m,), int64
        The pairs, ascending; each has one at least.
    evidence : ndarray of shape (pairs,)
        Log of the mean of each grid's exponentials, but for the same constant.
    """

    poses: NDArray[np.float64]
    values: NDArray[np.float64]
    owners: NDArray[np.int64]
    evidence: NDArray[np.float64]


class Scratch(NamedTuple):
    """Memory that the kernels work in.

    Parameters
    ----------
    planes : ndarray of shape (2, B (B + PAD)), float32
    line : ndarray of shape (8,), float32
    parts : ndarray of shape (4, CHUNK), int64
    growths : ndarray of shape (CHUNK, B), float32
    bits : ndarray of shape (CHUNK, B), int32
        The memory of ``growths``.
    integers : ndarray of shape (3, CHUNK, B), int32
    """

    planes: NDArray[np.float32]
    line: NDArray[np.float32]
    parts: NDArray[np.int64]
    growths: NDArray[np.float32]
    bits: NDArray[np.int32]
    integers: NDArray[np.int32]


def make_scratch(bins: int) -> Scratch:
    """Allocate the kernels' memory for grids of so many bins."""
    growths = np.empty((CHUNK, bins), np.float32)
    return Scratch(
        planes=np.empty((2, bins * (bins + PAD)), np.float32),
        line=np.empty(8, np.float32),
        parts=np.empty((4, CHUNK), np.int64),
        growths=growths,
        bits=growths.view(np.int32),
        integers=np.empty((3, CHUNK, bins), np.int32),
    )


@jit
def _crossings(line, sines, cosines, growths, places, steps):  # type: ignore[no-untyped-def]
    """Find where a curve's acute branch crosses the rows, and what decides on the profile.

    ``line`` (8,) float32: azimuths of the near view (of its row 0) and of the far view in cells;
    sine and cosine of the near one; the factors of sin u and sin v in the constraint; the
    gradient's coefficient; cells a turn. ``sines``, ``cosines`` (B,) float32 of the rows'
    headings. Out, (B,): ``growths`` float32 of the residual along the row, radians a radian; int32
    ``places`` of the crossing in 1 / SUBCELLS of a cell, ``steps`` of the parallax. The loop is
    vectorised.
    """
    near, far, sine, cosine = line[0], line[1], line[2], line[3]
    p, q, c, turn = line[4], line[5], line[6], line[7]
    one, half, zero, pi = np.float32(1.0), np.float32(0.5), np.float32(0.0), np.float32(np.pi)
    cells = turn * np.float32(1.0 / TWO_PI)
    r = p / q
    constant = p * p + q * q + np.float32(1e-20)
    scale = np.float32(LEVEL_STEPS / (np.pi - LEVEL_FROM))
    for i in range(sines.size):
        sin_u = sines[i] * cosine - cosines[i] * sine
        sin_v = -r * sin_u
        x = min(abs(sin_v), one)
        cos_v = np.sqrt(one - x * x)
        # arcsine: Abramowitz and Stegun, 4.4.46
        a = np.float32(-0.0012624911) * x + np.float32(0.0066700901)
        a = a * x + np.float32(-0.0170881256)
        a = a * x + np.float32(0.0308918810)
        a = a * x + np.float32(-0.0501743046)
        a = a * x + np.float32(0.0889789874)
        a = a * x + np.float32(-0.2145988016)
        a = a * x + np.float32(1.5707963050)
        angle = np.float32(HALF_PI) - np.sqrt(one - x) * a
        v = angle if sin_v > zero else -angle
        norm = one / np.sqrt(constant + sin_u * sin_u * c)
        growth = abs(q) * cos_v * norm
        bend = abs(q) * x * norm
        growth = max(growth, half * growth + np.float32(FLAT) * bend)
        row = np.float32(i) - near
        away = abs(row - turn * np.floor(row / turn + half))
        gamma = pi - angle - away / cells
        step = min(max((gamma - np.float32(LEVEL_FROM)) * scale, zero), np.float32(LEVEL_STEPS))
        place = v * cells + far
        place = place - turn * np.floor(place / turn)
        growths[i] = min(max(growth, np.float32(0.5**GROWTH_OCTAVES)), one)
        places[i] = np.int32(place * np.float32(SUBCELLS))
        steps[i] = np.int32(step)


@jit
def _obtuse(line, first, places, steps, other_places, other_steps):  # type: ignore[no-untyped-def]
    """Find where the obtuse branch crosses the rows from ``first`` on; the loop is vectorised.

    It mirrors the acute one, whose ``places`` and ``steps`` (n,) are given: their azimuths sum up
    to half a turn. Out: ``other_places`` and ``other_steps`` (n,).
    """
    near, far, turn = line[0], line[1], line[7]
    half, zero = np.float32(0.5), np.float32(0.0)
    cells = turn * np.float32(1.0 / TWO_PI)
    scale = np.float32(LEVEL_STEPS / (np.pi - LEVEL_FROM))
    # one step less: each was rounded down
    whole = np.float32(np.pi - 2.0 * LEVEL_FROM) * scale - np.float32(1.0)
    around = np.int32(turn) * np.int32(SUBCELLS)
    mirror = np.int32((far * np.float32(2.0) + turn * np.float32(2.5)) * np.float32(SUBCELLS))
    for i in range(places.size):
        row = np.float32(first + i) - near
        away = abs(row - turn * np.floor(row / turn + half))
        step = whole - np.float32(2.0) * away / cells * scale - np.float32(steps[i])
        place = mirror - places[i]
        place -= around if place >= around else np.int32(0)
        place -= around if place >= around else np.int32(0)
        place -= around if place >= around else np.int32(0)
        other_places[i] = min(max(place, np.int32(0)), around - np.int32(1))
        other_steps[i] = np.int32(min(max(step, zero), np.float32(LEVEL_STEPS)))


@jit
def _addresses(base, bits, places, starts):  # type: ignore[no-untyped-def]
    """Find where profiles begin; the loop is vectorised.

    ``base`` the first profile of the correspondence's elevation, ``bits`` (n,) the growths' floats
    as int32, ``places`` (n,). ``starts`` (n,) int32: the middle block of the lowest level.
    """
    for i in range(places.size):
        growth = (bits[i] >> np.int32(GROWTH_BITS)) - np.int32(LEAST_GROWTH)
        profile = base + growth * np.int32(SUBCELLS) + (places[i] & np.int32(SUBCELLS - 1))
        starts[i] = profile * np.int32(WIDTH) + np.int32(MIDDLE)


@jit
def _stamp(growths, starts, places, steps, first, last, levels, shift, ridges, plane, stride):  # type: ignore[no-untyped-def]
    """Add a profile to each of the rows from ``first`` to ``last`` of a plane.

    ``growths``, ``places`` and ``steps`` of `_crossings`, ``starts`` of `_addresses`, (B,);
    ``levels`` (LEVEL_STEPS + 1,) int16 of the landmark's probability, to which the correspondence
    adds ``shift``, negative for none; ``ridges`` `RidgeArrays`; ``plane`` (B * stride,).
    """
    near_by, size, profiles = ridges.near_by, ridges.size, ridges.profiles
    target = first * stride + LEFT - 3
    for i in range(first, last):
        level = np.int64(levels[np.uintp(steps[np.uintp(i)])]) + shift
        if level >= 0:
            start = np.int64(starts[np.uintp(i)]) + level * size
            at = target + (np.int64(places[np.uintp(i)]) >> 3)
            add_lanes(plane, at, profiles, start)
            growth = growths[np.uintp(i)]
            if growth < near_by:
                add_lanes(plane, at - LANES, profiles, start - LANES)
                add_lanes(plane, at + LANES, profiles, start + LANES)
                if growth < np.float32(3.0 / 11.0) * near_by:
                    add_lanes(plane, at - 2 * LANES, profiles, start - 2 * LANES)
                    add_lanes(plane, at + 2 * LANES, profiles, start + 2 * LANES)
        target += stride


@jit
def _fold(plane, bins, stride):  # type: ignore[no-untyped-def]
    """Add the columns beyond both ends of each row where they belong on the circle."""
    for row in range(bins):
        first = row * stride + LEFT
        if bins >= LEFT:
            for j in range(0, LEFT, LANES):
                add_lanes(plane, first + bins - LEFT + j, plane, first - LEFT + j)
                add_lanes(plane, first + j, plane, first + bins + j)
        else:
            for j in range(LEFT):
                plane[first + (-1 - j) % bins] += plane[first - 1 - j]
                plane[first + j % bins] += plane[first + bins + j]


@jit
def _join(own, other, bins, stride, out):  # type: ignore[no-untyped-def]
    """Add two folded planes to ``out`` (B * B,): one as it is, the other one transposed."""
    whole = bins - bins % LANES
    for i in range(bins):
        for j in range(0, whole, LANES):
            add_lanes(out, i * bins + j, own, i * stride + LEFT + j)
        for j in range(whole, bins):
            out[i * bins + j] += own[i * stride + LEFT + j]
    for i in range(0, whole, LANES):
        for j in range(0, whole, LANES):
            add_transposed(out, j * bins + i, bins, other, i * stride + LEFT + j, stride)
    for j in range(bins):
        for i in range(whole if j < whole else 0, bins):
            out[j * bins + i] += other[i * stride + LEFT + j]


@jit
def _line(bearing, bins, line):  # type: ignore[no-untyped-def]
    """Describe a correspondence's curve for `_crossings`.

    Gives the nearer view, 0 for L and 1 for R, the ratio r, and the nearer view's azimuth.
    ``bearing`` (8,) sines and cosines. Where both points lie on the horizon r is NaN.
    """
    sin_l, cos_l, sin_r, cos_r = bearing[2], bearing[3], bearing[6], bearing[7]
    p, q = sin_r * cos_l, sin_l * cos_r
    view = 0
    if abs(p) > abs(q):
        p, q = q, p
        view = 1
    # what a float32 cannot hold is on the horizon
    r = p / q if abs(q) > 1e-30 else np.nan
    cells = bins / TWO_PI
    sine, cosine = bearing[4 * view], bearing[4 * view + 1]
    near = fast_arctan2(sine, cosine)
    far = fast_arctan2(bearing[4 - 4 * view], bearing[5 - 4 * view])
    both, height = cos_l * cos_r, sin_l * sin_r
    # headings are those of the cells' centres, places are rounded to the nearest
    line[0] = near * cells - 0.5
    line[1] = far * cells - 0.5 + 0.5 / SUBCELLS
    line[2], line[3], line[4], line[5] = sine, cosine, p, q
    line[6] = (both * r + height) ** 2 + (both + height * r) ** 2 - 2.0 * p * p
    line[7] = bins
    return view, r, near


@jit
def ridge_grid(bearings, shapes, shifts, constant, ridges, scratch, out):  # type: ignore[no-untyped-def]
    """Compute the log-likelihood ratio of one pair over the grid of poses: O(n B).

    ``bearings`` (n, 8) sines and cosines of azimuth_l, elevation_l, azimuth_r, elevation_r,
    ``shapes`` (n,) of `shape_cells`, ``shifts`` (n,) of the levels by each correspondence's odds;
    ``constant`` float32 is added to every cell; ``ridges`` `RidgeArrays`, ``scratch`` `Scratch`.
    ``out`` (B * B,) float32.
    """
    bins = ridges.sines.size
    stride = bins + PAD
    cells = bins / TWO_PI
    planes, line, growths, bits = scratch.planes, scratch.line, scratch.growths, scratch.bits
    starts, places, steps = scratch.integers[0], scratch.integers[1], scratch.integers[2]
    parts = scratch.parts
    owners, views, firsts, lasts = parts[0], parts[1], parts[2], parts[3]
    planes[:] = 0.0
    out[:] = constant
    n = bearings.shape[0]
    i = 0
    while i < n:
        # the crossings of a chunk of correspondences: an acute branch, and parts of an obtuse one
        chunk = acute = 0
        while i < n and chunk + 3 <= CHUNK:
            shape = shapes[i]
            view, r, near = _line(bearings[i], bins, line)
            may_be = ridges.highest[shape] + shifts[i] >= 0
            if may_be and r == r:
                owners[chunk], views[chunk], firsts[chunk], lasts[chunk] = i, view, 0, bins
                acute = chunk
                _crossings(
                    line,
                    ridges.sines,
                    ridges.cosines,
                    growths[chunk],
                    places[chunk],
                    steps[chunk],
                )
                _addresses(ridges.bases[shape], bits[chunk], places[chunk], starts[chunk])
                chunk += 1
            if may_be and r > 0.0:
                # its lines of sight diverge by at least (1 - r) |u|
                limit = min(ridges.reach[shape] / max(1.0 - r, 1e-9), MERGED)
                low = int(np.ceil((near - limit) * cells - 0.5))
                high = int(np.floor((near + limit) * cells - 0.5)) + 1
                for turn in range(-bins, bins + 1, bins):
                    first, last = max(low + turn, 0), min(high + turn, bins)
                    if first < last:
                        owners[chunk], views[chunk] = i, view
                        firsts[chunk], lasts[chunk] = first, last
                        _obtuse(
                            line,
                            first,
                            places[acute, first:last],
                            steps[acute, first:last],
                            places[chunk, first:last],
                            steps[chunk, first:last],
                        )
                        growths[chunk, first:last] = growths[acute, first:last]
                        _addresses(
                            ridges.bases[shape],
                            bits[acute, first:last],
                            places[chunk, first:last],
                            starts[chunk, first:last],
                        )
                        chunk += 1
            i += 1
        for view in range(2):
            for row in range(0, bins, BAND):
                end = min(row + BAND, bins)
                for k in range(chunk):
                    if views[k] == view and firsts[k] < end and lasts[k] > row:
                        _stamp(
                            growths[k],
                            starts[k],
                            places[k],
                            steps[k],
                            max(row, firsts[k]),
                            min(end, lasts[k]),
                            ridges.levels[shapes[owners[k]]],
                            shifts[owners[k]],
                            ridges,
                            planes[view],
                            stride,
                        )
    _fold(planes[0], bins, stride)
    _fold(planes[1], bins, stride)
    _join(planes[0], planes[1], bins, stride, out)


@jit
def _maxima(grid, bins, margin, found):  # type: ignore[no-untyped-def]
    """Find the highest local maxima of a periodic grid (B * B,); give their number.

    Those within ``margin`` of the highest one, at most as many as ``found`` (k, 3) has rows:
    [row, column, value], the highest first; places are between the cells' centres, by a parabola
    along each axis.
    """
    most = found.shape[0]
    least = grid.max() - margin
    count = 0
    for i in range(bins):
        here = i * bins
        above, below = (i - 1) % bins * bins, (i + 1) % bins * bins
        j = -1
        while j + 1 < bins:
            j += 1
            if j % LANES == 0 and j + LANES <= bins:
                # eight cells at once, of which mostly none is high enough
                high = grid[np.uintp(here + j)]
                for k in range(1, LANES):
                    high = max(high, grid[np.uintp(here + j + k)])
                if high < least:
                    j += LANES - 1
                    continue
            value = grid[np.uintp(here + j)]
            if value < least:
                continue
            left, right = (j - 1) % bins, (j + 1) % bins
            north, south = grid[above + j], grid[below + j]
            west, east = grid[here + left], grid[here + right]
            # of cells that are equal, the last one is the maximum
            if not (value > south and value > east and value >= north and value >= west):
                continue
            if value < grid[above + left] or value < grid[above + right]:
                continue
            if value <= grid[below + left] or value <= grid[below + right]:
                continue
            k = min(count, most - 1)
            while k > 0 and found[k - 1, 2] < value:
                found[k] = found[k - 1]
                k -= 1
            along = 2.0 * value - west - east
            across = 2.0 * value - north - south
            found[k, 0] = i + (0.5 * (south - north) / across if across > 0.0 else 0.0)
            found[k, 1] = j + (0.5 * (east - west) / along if along > 0.0 else 0.0)
            found[k, 2] = value
            count = min(count + 1, most)
            if count == most:
                least = max(least, found[most - 1, 2])
    return count


@jit
def _log_mean_exp(grid):  # type: ignore[no-untyped-def]
    """Give the log of the mean of exp(grid), to some thousandths; the loop is vectorised.

    exp(x) is (1 + x / 4096) ** 4096.
    """
    largest = grid.max()
    total = 0.0
    for i in range(grid.size):
        x = max(grid[i] - largest, np.float32(-40.0)) * np.float32(1.0 / 4096.0) + np.float32(1.0)
        x = x * x
        x = x * x
        x = x * x
        x = x * x
        x = x * x
        x = x * x
        x = x * x
        x = x * x
        x = x * x
        x = x * x
        x = x * x
        x = x * x
        total += x
    return largest + np.log(total / grid.size)


@jit
def ridge_candidates(bearings, shapes, shifts, first, margin, ridges, scratch, found, out):  # type: ignore[no-untyped-def]
    """Find candidate poses of many pairs: the highest local maxima of their grids.

    As `ridge_grid` for pair k of the rows ``first[k]`` to ``first[k + 1]``, and `_maxima` with
    ``found`` (K, 3) as scratch. ``out`` `Candidates`, of which the first ones are filled: as many
    as is returned. A pair has at least one.
    """
    poses, values, owners, evidence = out.poses, out.values, out.owners, out.evidence
    bins = ridges.sines.size
    cell = TWO_PI / bins
    grid = np.empty(bins * bins, np.float32)
    total = 0
    for k in range(first.size - 1):
        low, high = first[k], first[k + 1]
        ridge_grid(
            bearings[low:high],
            shapes[low:high],
            shifts[low:high],
            np.float32(0.0),
            ridges,
            scratch,
            grid,
        )
        evidence[k] = _log_mean_exp(grid)
        count = _maxima(grid, bins, margin, found)
        if count == 0:
            # a plateau has no maximum
            best = grid.argmax()
            found[0, 0], found[0, 1], found[0, 2] = best // bins, best % bins, grid[best]
            count = 1
        for c in range(count):
            poses[total, 0] = (found[c, 0] + 0.5) * cell
            poses[total, 1] = (found[c, 1] + 0.5) * cell
            values[total] = found[c, 2]
            owners[total] = k
            total += 1
    return total
