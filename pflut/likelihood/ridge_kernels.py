"""Kernels of the grid: a correspondence adds its ridge, and touches no other cell.

In each row of the grid (a heading of the view that is nearer to the landmark) the curve
sin v = -r sin u crosses once, or twice where |r| is near 1. The cells around the crossing get one
of few profiles, made beforehand (`ridges`): by how fast the residual grows from cell to cell,
where within its cell the curve crosses, and how probable the landmark is there. A row costs one
addition of sixteen numbers of 16 bits, or three.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pflut._jit import inline, jit
from pflut._lanes import HALF, LANES, add_lanes, add_scaled, add_shares, add_transposed
from pflut._trig import fast_arctan2
from pflut.geometry import TWO_PI

SUBCELL_BITS = 3
SUBCELLS = 1 << SUBCELL_BITS
"""Places within a cell where a curve may cross; the kernel takes them from an integer's bits."""
MIDDLE = 7
"""The lane of a profile's middle block in which the curve crosses."""
BLOCKS = 3
"""Blocks of a profile: the middle one, the one before and the one after it."""
LEFT = 2 * LANES
"""Columns before the grid's first one, into which profiles run; folded back at the end."""
PAD = 2 * LEFT
"""Columns that a plane has beyond the grid's."""
NATS = 1.0 / 128.0
"""What a unit of a profile, and of a plane, is worth."""
FULL = 65535
"""The largest number in a plane."""
LEVEL_MIN, LEVEL_STEP, NUM_LEVELS = -3.0, 0.25, 64
"""Levels of log(odds times density times the profile's height); what is higher has the last one."""
MOST_SHIFT = 100
"""Levels by which odds count at most, of 16 nats on either side."""
LEVEL_STEPS = 288
"""Steps of the parallax from LEVEL_FROM to pi, in which a landmark's level is looked up; the first
one is for none."""
LEVEL_FROM = -0.75
GROWTH_OCTAVES = 5
"""Classes of the residual's growth from 2 ** -GROWTH_OCTAVES to 1 radian a radian: four an octave,
taken from the bits of a float32."""
GROWTH_BITS = 21
LEAST_GROWTH = (127 - GROWTH_OCTAVES) << (23 - GROWTH_BITS)
NUM_GROWTHS = 4 * GROWTH_OCTAVES + 1
NUM_SLOPES = 3
GENTLE, STEEP = 0.4, 0.75
"""Slopes of the curve, columns a row, that part the classes."""
MERGED = 4.0
"""The two branches share a ridge where the residual between them is less than its noise, unless
its amplitude is not so many times the noise: then it is as good as flat."""
STEP_BITS, COLUMN_BITS = 9, 11
"""Of the numbers of an address: the profile, the column, whether v is positive, the step."""
HALF_PI = 0.5 * np.pi


class RidgeArrays(NamedTuple):
    """What grids of so many bins B are made of, for the kernels.

    Parameters
    ----------
    turns : ndarray of shape (2, B), float32
        Sines and cosines of the cells' headings.
    levels : ndarray of shape (shapes, LEVEL_STEPS + 1), int8
        How probable a landmark is at a parallax, in steps, at even odds.
    highest : ndarray of shape (shapes,), int64
        Of the levels.
    bases : ndarray of shape (shapes,), int32
        First profile of each kind of elevation.
    wide : int
        Profiles of a kind that are wider than their middle block: the first ones.
    near, far : int
        Steps of the parallax up to which the middle block, and the others, reach to where the
        lines of sight diverge.
    noise, extent : float32
        Residuals at half a profile's height, and where it ends, radians.
    shares : ndarray of uint16
        Of each cell, how much lies where the lines of sight do not diverge: (whether v is
        positive, steps, BLOCKS, LANES) in a row.
    peaks : ndarray of shape (NUM_LEVELS,), int64
        The most that a level's profiles add to a cell.
    size : int
        Numbers from one level's blocks to the next's.
    profiles : ndarray of uint16
        Log-likelihood ratios in units of NATS: (BLOCKS, NUM_LEVELS, kinds, growths, slopes,
        SUBCELLS, LANES) in a row.
    """

    turns: NDArray[np.float32]
    levels: NDArray[np.int8]
    highest: NDArray[np.int64]
    bases: NDArray[np.int32]
    wide: int
    near: int
    far: int
    noise: np.float32
    extent: np.float32
    shares: NDArray[np.uint16]
    peaks: NDArray[np.int64]
    size: int
    profiles: NDArray[np.uint16]


class Candidates(NamedTuple):
    """The highest local maxima of the grids of many pairs.

    Parameters
    ----------
    poses : ndarray of shape (m, 2)
        Headings, radians.
    values : ndarray of shape (m,)
        Of the grid.
    owners : ndarray of shape (m,), int64
        The pairs, ascending; each has one at least.
    evidence : ndarray of shape (pairs,)
        Log of the mean of each grid's exponentials.
    """

    poses: NDArray[np.float64]
    values: NDArray[np.float64]
    owners: NDArray[np.int64]
    evidence: NDArray[np.float64]


@jit
def _line(columns, i, bins, line):  # type: ignore[no-untyped-def]
    """Describe a correspondence's curve, sin v = -r sin u.

    Gives the nearer view, 0 for L and 1 for R, and the ratio r. Where both points lie on the
    horizon r is NaN. ``columns`` (8, n) sines and cosines. Out, ``line`` (8,) float32: azimuths of
    the near view and of the far view, in rows and columns of the grid; sine and cosine of the
    near one; the factors of sin u and sin v in the constraint; the gradient's coefficient; cells
    a turn.
    """
    sin_l, cos_l, sin_r, cos_r = columns[2, i], columns[3, i], columns[6, i], columns[7, i]
    p, q = sin_r * cos_l, sin_l * cos_r
    view = 0
    if abs(p) > abs(q):
        p, q = q, p
        view = 1
    # what a float32 cannot hold is on the horizon
    r = p / q if abs(q) > 1e-30 else np.nan
    cells = bins / TWO_PI
    sine, cosine = columns[4 * view, i], columns[4 * view + 1, i]
    near = fast_arctan2(sine, cosine)
    far = fast_arctan2(columns[4 - 4 * view, i], columns[5 - 4 * view, i])
    both, height = cos_l * cos_r, sin_l * sin_r
    # headings are those of the cells' centres, places are rounded to the nearest
    line[0] = near * cells - 0.5
    line[1] = far * cells - 0.5 + 0.5 / SUBCELLS
    line[2], line[3], line[4], line[5] = sine, cosine, p, q
    line[6] = (both * r + height) ** 2 + (both + height * r) ** 2 - 2.0 * p * p
    line[7] = bins
    return view, r


@jit
def _crossings(line, first, last, turns, noise, crossings):  # type: ignore[no-untyped-def]
    """Find where the acute branch crosses the rows from ``first`` to ``last``; vectorised.

    Where the residual between this branch and the obtuse one is less than ``noise``, one ridge
    serves both, in their middle: v is a quarter of a turn. ``line`` of `_line`, ``turns`` of
    `RidgeArrays`. Out, ``crossings`` (4, rows) float32: growth of the residual along the row,
    radians a radian; column, counted from the far view's azimuth; parallax in a row that looks
    along the near view's azimuth, radians; class of the curve's slope.
    """
    sine, cosine, p, q, c, turn = line[2], line[3], line[4], line[5], line[6], line[7]
    one, half, zero, pi = np.float32(1.0), np.float32(0.5), np.float32(0.0), np.float32(np.pi)
    cells = turn * np.float32(1.0 / TWO_PI)
    r, height = p / q, abs(q)
    constant = p * p + q * q + np.float32(1e-20)
    sines, cosines = turns[0], turns[1]
    for row in range(first, last):
        i = np.uintp(row)
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
        amplitude = height / np.sqrt(constant + sin_u * sin_u * c)
        between = amplitude * (one - x)
        merged = between < noise and amplitude > np.float32(MERGED) * noise
        # the cosine is a parabola there
        beside = noise * np.sqrt(half * amplitude / (between + noise))
        growth, angle = (beside, np.float32(HALF_PI)) if merged else (cos_v * amplitude, angle)
        crossings[0, i] = min(max(growth, np.float32(0.5**GROWTH_OCTAVES)), one)
        crossings[1, i] = (angle if sin_v > zero else -angle) * cells
        crossings[2, i] = pi - angle
        slope = abs(r * (cosines[i] * cosine + sines[i] * sine))
        steep = np.float32(slope > np.float32(STEEP) * cos_v)
        crossings[3, i] = steep + np.float32(slope > np.float32(GENTLE) * cos_v)


@inline
def _address(place, gamma, least, outward, turn, profile, up):  # type: ignore[no-untyped-def]
    """Pack what is added to a row: see `_addresses`.

    ``place`` the column, not yet on the circle; ``gamma`` the parallax there, from LEVEL_FROM on,
    no ridge where it is less than ``least``; ``outward`` its change a SUBCELL.
    """
    scale, highest = np.float32(LEVEL_STEPS / (np.pi - LEVEL_FROM)), np.float32(LEVEL_STEPS)
    around = np.floor(place * (np.float32(1.0) / turn))
    cell = np.int32((place - turn * around) * np.float32(SUBCELLS))
    part = cell & np.int32(SUBCELLS - 1)
    step = (gamma + outward * np.float32(part)) * scale
    step = np.float32(0.0) if gamma < least else step
    return (
        ((profile + part) << np.int32(STEP_BITS + 1 + COLUMN_BITS))
        + ((cell >> np.int32(SUBCELL_BITS)) << np.int32(STEP_BITS + 1))
        + (up << np.int32(STEP_BITS))
        + np.int32(min(max(step, np.float32(0.0)), highest))
    )


@jit
def _addresses(line, first, last, half, side, base, extent, crossings, bits, addresses):  # type: ignore[no-untyped-def]
    """Find which profiles are added to the rows, and where; vectorised.

    Of the acute branch with ``side`` 1; with -1 of the obtuse one, of which columns and parallaxes
    are those of the acute one, taken from half a turn; with 0 of points on different sides of the
    horizon, which have no parallax. ``crossings`` of `_crossings` and ``bits``, the same memory as
    int32; ``base`` the first profile of the kind of elevation, ``extent`` of `RidgeArrays`. Out,
    ``addresses`` (2 half,) int32: number of the profile, column, whether v is positive, and step
    of the parallax in the middle lane's cell, for the rows from ``first`` to ``last`` and for
    those ``half`` rows on, where the curve is mirrored.
    """
    near, turn = line[0], line[7]
    zero, pi = np.float32(0.0), np.float32(np.pi)
    turns = np.float32(1.0) / turn
    obtuse, large = side < zero, np.float32(99.0)
    sign = np.float32(-1.0) if obtuse else np.float32(1.0)
    middle = line[1] + np.float32(0.5) * turn if obtuse else line[1]
    start = (pi if obtuse else zero if side > zero else large) - np.float32(LEVEL_FROM)
    part = np.float32(TWO_PI) * turns / np.float32(SUBCELLS)
    quarter = np.float32(0.2499) * turn
    for i in range(first, last):
        away = np.float32(i) - near
        away = abs(away * turns - np.floor(away * turns + np.float32(0.5))) * np.float32(TWO_PI)
        column = crossings[1, i]
        up = np.int32(column > zero)
        outward = part if column > zero else -part
        growth = (bits[0, i] >> np.int32(GROWTH_BITS)) - np.int32(LEAST_GROWTH)
        profile = growth * np.int32(NUM_SLOPES) + np.int32(crossings[3, i])
        profile = base + profile * np.int32(SUBCELLS)
        parallax = start + sign * crossings[2, i]
        # no ridge where it ends before it comes to where the lines of sight meet
        least = -extent / crossings[0, i] - np.float32(LEVEL_FROM)
        least = large if obtuse and abs(column) > quarter else least
        # the twin first: of an odd number of rows there are no twins, and their place is free
        addresses[np.uintp(half + i)] = _address(
            middle - sign * column,
            parallax + away - pi,
            least,
            -outward,
            turn,
            profile,
            np.int32(1) - up,
        )
        addresses[np.uintp(i)] = _address(
            middle + sign * column, parallax - away, least, outward, turn, profile, up
        )


@jit
def _stamp(addresses, first, last, shape, shift, ridges, plane, stride):  # type: ignore[no-untyped-def]
    """Add a profile to each of the rows from ``first`` to ``last`` of a plane (B * stride,).

    ``addresses`` of `_addresses`; ``shift`` the levels by which the odds of the correspondence
    change those of its ``shape``: where the sum is negative there is nothing to add.
    """
    profiles, levels, shares = ridges.profiles, ridges.levels, ridges.shares
    size, next_block = ridges.size, ridges.size * NUM_LEVELS
    wide, near, far = ridges.bases[shape] + ridges.wide, ridges.near, ridges.far
    target = first * stride + LEFT - MIDDLE
    for i in range(first, last):
        address = np.int64(addresses[np.uintp(i)])
        step = address & ((1 << STEP_BITS) - 1)
        level = min(np.int64(levels[shape, np.uintp(step)]) + shift, NUM_LEVELS - 1)
        if level >= 0:
            profile = address >> (STEP_BITS + 1 + COLUMN_BITS)
            start = profile * LANES + level * size
            at = target + ((address >> (STEP_BITS + 1)) & ((1 << COLUMN_BITS) - 1))
            share = int(address & ((2 << STEP_BITS) - 1)) * (BLOCKS * LANES)
            if step < near:
                add_shares(plane, at, profiles, start, shares, share)
            else:
                add_lanes(plane, at, profiles, start)
            if profile < wide:
                before, after = start + next_block, start + 2 * next_block
                if step < far:
                    add_shares(plane, at - LANES, profiles, before, shares, share + LANES)
                    add_shares(plane, at + LANES, profiles, after, shares, share + 2 * LANES)
                else:
                    add_lanes(plane, at - LANES, profiles, before)
                    add_lanes(plane, at + LANES, profiles, after)
        target += stride


@inline
def _add_ridge(  # type: ignore[no-untyped-def]
    line, r, shape, shift, ridges, rows, halves, crossings, bits, addresses, plane, stride
):
    """Add a correspondence's ridge to the plane of its near view.

    ``line`` and ``r`` of `_line`, ``shift`` of the levels, ``rows`` of `_intervals` and ``halves``
    the same of half a turn; ``crossings`` with its ``bits`` and ``addresses`` are memory to work
    in.
    """
    bins = ridges.turns.shape[1]
    half, base, extent = addresses.size // 2, ridges.bases[shape], ridges.extent
    noise = ridges.noise if r >= 0.0 else np.float32(0.0)
    side = np.float32(1.0) if r >= 0.0 else np.float32(0.0)
    for part in range(2):
        start, end = halves[part, 0], halves[part, 1]
        _crossings(line, start, end, ridges.turns, noise, crossings)
        _addresses(line, start, end, half, side, base, extent, crossings, bits, addresses)
    for part in range(2):
        _stamp(addresses, rows[part, 0], rows[part, 1], shape, shift, ridges, plane, stride)
    if not r >= 0.0:
        return
    # the obtuse branch: its lines of sight diverge by (1 - r) |u| at least, but its ridge is wide
    p, q, c = line[4], line[5], max(line[6], np.float32(0.0))
    least = abs(q) * np.sqrt(max(1.0 - r * r, 0.0) / (p * p + q * q + c))
    limit = min(extent / max((1.0 - r) * least, 1e-9), HALF_PI) * bins / TWO_PI
    low, high = int(np.ceil(line[0] - limit)), int(np.floor(line[0] + limit)) + 1
    if low >= high:
        return
    for piece in range(low // half, (high - 1) // half + 1):
        # rows that are in the same half of the grid, or in the grid
        row = piece * half % bins
        first, last = max(low - piece * half, 0), min(high - piece * half, half)
        meets = False
        for part in range(2):
            meets |= max(row + first, rows[part, 0]) < min(row + last, rows[part, 1])
        if not meets:
            continue
        start = first - first % LANES
        end = min(last + LANES - 1 - (last - 1) % LANES, half)
        _addresses(line, start, end, half, -side, base, extent, crossings, bits, addresses)
        for part in range(2):
            top, bottom = max(row + first, rows[part, 0]), min(row + last, rows[part, 1])
            _stamp(addresses, top, bottom, shape, shift, ridges, plane, stride)


@jit
def _intervals(first, count, bins, rows):  # type: ignore[no-untyped-def]
    """Write as intervals the ``count`` rows from ``first`` on, around the circle: ``rows`` (2, 2).

    What is beyond the grid's last row is the second one, from its first row on. Where less than two
    registers' rows are left out, all are in.
    """
    if count > bins - 2 * HALF:
        first, count = 0, bins
    rows[0, 0], rows[0, 1] = first, min(first + count, bins)
    rows[1, 0], rows[1, 1] = 0, max(first + count - bins, 0)


@jit
def _fold(plane, rows, bins, stride):  # type: ignore[no-untyped-def]
    """Add the columns beyond both ends of the rows where they belong on the circle."""
    for part in range(2):
        for row in range(rows[part, 0], rows[part, 1]):
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
def _join(plane, rows, columns, bins, stride, transposed, out):  # type: ignore[no-untyped-def]
    """Add a folded plane to ``out`` (B * B,), in nats, as it is or transposed.

    Of its ``rows`` and ``columns``, and of what lies beside them in a register.
    """
    whole, unit = bins - bins % HALF, np.float32(NATS)
    for part in range(4):
        top, bottom = rows[part // 2, 0], rows[part // 2, 1]
        left, right = columns[part % 2, 0], columns[part % 2, 1]
        if top >= bottom or left >= right:
            continue
        left -= left % HALF
        edge = min(right + -right % HALF, whole)
        if transposed:
            top -= top % HALF
            bottom = min(bottom + -bottom % HALF, bins)
            for j in range(left, edge, HALF):
                for i in range(top, min(bottom, whole), HALF):
                    add_transposed(
                        out, j * bins + i, bins, plane, i * stride + LEFT + j, stride, unit
                    )
            for j in range(left, right):
                for i in range(max(top, whole) if j < whole else top, bottom):
                    out[j * bins + i] += unit * np.float32(plane[i * stride + LEFT + j])
        else:
            for i in range(top, bottom):
                row, first = i * bins, i * stride + LEFT
                for j in range(left, edge, HALF):
                    add_scaled(out, row + j, plane, first + j, unit)
                for j in range(max(left, whole), right):
                    out[row + j] += unit * np.float32(plane[first + j])


@jit
def ridge_grid(columns, shapes, odds, first, last, ridges, window, out):  # type: ignore[no-untyped-def]
    """Compute the log-likelihood ratio of one pair over the grid of poses: O(n B).

    ``columns`` (8, n) sines and cosines of azimuth_l, elevation_l, azimuth_r, elevation_r,
    ``shapes`` (n,) of `shape_cells`, ``odds`` (n,) of being a true match, of which those from
    ``first`` to ``last`` are the pair's; ``ridges`` `RidgeArrays`; ``window`` (2, 2) the first
    cell and the number of cells of either heading that are asked for. ``out`` (B * B,) float32, in
    which outside the window there may be anything.
    """
    n, bins = last - first, ridges.turns.shape[1]
    lines, ratios = np.empty((n, 8), np.float32), np.empty(n)
    views, shifts = np.empty(n, np.int64), np.empty(n, np.int64)
    constant = rest = 0.0
    shift = np.int64(0)
    for i in range(n):
        views[i], ratios[i] = _line(columns, first + i, bins, lines[i])
        one = odds[first + i]
        if i == 0 or one != odds[first + i - 1]:
            rest = np.log1p(one)
            levels = min(max(np.log(one) / LEVEL_STEP, -MOST_SHIFT), MOST_SHIFT)
            shift = np.int64(np.rint(levels))
        constant -= rest
        highest = ridges.highest[shapes[first + i]]
        shifts[i] = shift
        if highest + shift < 0 or ratios[i] != ratios[i]:
            views[i] = -1
    # half a turn farther on a curve is mirrored
    half = bins // 2 if bins % 2 == 0 else bins
    stride = bins + PAD
    crossings, addresses = np.empty((4, half), np.float32), np.empty(2 * half, np.int32)
    bits = crossings.view(np.int32)
    plane = np.empty(bins * stride, np.uint16)
    windows, halves = np.empty((2, 2, 2), np.int64), np.empty((2, 2), np.int64)
    for view in range(2):
        _intervals(window[view, 0], window[view, 1], bins, windows[view])
    for part in range(2):
        out[windows[0, part, 0] * bins : windows[0, part, 1] * bins] = constant
    for view in range(2):
        load = 0
        rows, others = windows[view], windows[1 - view]
        _intervals(window[view, 0] % half, min(window[view, 1], half), half, halves)
        for i in range(n):
            if views[i] != view:
                continue
            shape = shapes[first + i]
            # both branches may come into the same cell, and in small grids a profile more than once
            level = min(ridges.highest[shape] + shifts[i], NUM_LEVELS - 1)
            peak = 2 * ridges.peaks[level] * (1 + (BLOCKS * LANES - 1) // bins)
            if load + peak > FULL:
                _fold(plane, rows, bins, stride)
                _join(plane, rows, others, bins, stride, view == 1, out)
                load = 0
            if load == 0:
                for part in range(2):
                    plane[rows[part, 0] * stride : rows[part, 1] * stride] = 0
            load += peak
            _add_ridge(
                lines[i],
                ratios[i],
                shape,
                shifts[i],
                ridges,
                rows,
                halves,
                crossings,
                bits,
                addresses,
                plane,
                stride,
            )
        if load > 0:
            _fold(plane, rows, bins, stride)
            _join(plane, rows, others, bins, stride, view == 1, out)


@inline
def _largest(bits, first, last, floats):  # type: ignore[no-untyped-def]
    """Give the largest of the floats whose bits those of an int32 array are; vectorised.

    Integers order positive floats as these do, and negative ones once all but the sign is turned.
    ``floats`` (1,) float32 is memory to work in.
    """
    largest = np.int32(-(2**31))
    for i in range(first, last):
        one = bits[np.uintp(i)]
        largest = max(largest, one ^ ((one >> np.int32(31)) & np.int32(0x7FFFFFFF)))
    floats.view(np.int32)[0] = largest ^ ((largest >> np.int32(31)) & np.int32(0x7FFFFFFF))
    return floats[0]


@jit
def _maxima(grid, bins, margin, found):  # type: ignore[no-untyped-def]
    """Find the highest local maxima of a periodic grid (B * B,); give their number.

    Those within ``margin`` of the highest one, at most as many as ``found`` (k, 3) has rows:
    [row, column, value], the highest first; places are between the cells' centres, by a parabola
    along each axis.
    """
    most = found.shape[0]
    rows, bits, floats = np.empty(bins, np.float32), grid.view(np.int32), np.empty(1, np.float32)
    for i in range(bins):
        rows[i] = _largest(bits, i * bins, (i + 1) * bins, floats)
    least = rows.max() - margin
    count = 0
    for i in range(bins):
        if rows[i] < least:
            continue
        here, above, below = i * bins, (i - 1) % bins * bins, (i + 1) % bins * bins
        for j in range(bins):
            value = grid[np.uintp(here + j)]
            if value < least:
                continue
            left, right = (j - 1) % bins, (j + 1) % bins
            north, south = grid[above + j], grid[below + j]
            west, east = grid[here + left], grid[here + right]
            # of cells that are equal, the last one is the maximum
            before = max(grid[above + left], north, grid[above + right], west)
            after = max(grid[below + left], south, grid[below + right], east)
            if value <= after or value < before:
                continue
            k = min(count, most - 1)
            while k > 0 and found[k - 1, 2] < value:
                for part in range(3):
                    found[k, part] = found[k - 1, part]
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
    largest = _largest(grid.view(np.int32), 0, grid.size, np.empty(1, np.float32))
    total = np.float32(0.0)
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
def ridge_candidates(columns, shapes, odds, first, margin, ridges, found, out):  # type: ignore[no-untyped-def]
    """Find candidate poses of many pairs: the highest local maxima of their grids.

    As `ridge_grid` for pair k of the columns ``first[k]`` to ``first[k + 1]``, and `_maxima` with
    ``found`` (K, 3) as scratch. ``out`` `Candidates`, of which the first ones are filled: as many
    as is returned. A pair has at least one.
    """
    poses, values, owners, evidence = out.poses, out.values, out.owners, out.evidence
    bins = ridges.turns.shape[1]
    cell = TWO_PI / bins
    grid = np.empty(bins * bins, np.float32)
    whole = np.array([[0, bins], [0, bins]])
    total = 0
    for k in range(first.size - 1):
        ridge_grid(columns, shapes, odds, first[k], first[k + 1], ridges, whole, grid)
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
