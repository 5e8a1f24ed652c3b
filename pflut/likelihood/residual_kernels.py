"""Kernels of the residual table: coordinates of a correspondence at a pose, counting, scoring."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pflut._jit import jit
from pflut._random import uniform
from pflut._trig import fast_sincos
from pflut.geometry import TWO_PI
from pflut.likelihood.axes import (
    ELEVATION_CELLS,
    NEGATIVE_CELLS,
    PARALLAX_CELLS,
    PARALLAX_STEPS,
    RATIO_CELLS,
    RESIDUAL_CELLS,
    RESIDUAL_MAX,
)

HALF_STEPS = 0.5 * PARALLAX_STEPS
LARGE = 1e100
"""A product beyond is kept as its logarithm."""
NOTHING = 1e-5
"""Factors of odds and residual below matter to no landmark."""
LONGEST_STEP = 0.1
"""Radians; a longer step leaves the basin."""


class PairArrays(NamedTuple):
    """The correspondences of many pairs, one pair after the other, for the kernels.

    Parameters
    ----------
    columns : ndarray of shape (8, n)
        Sines and cosines of azimuth_l, elevation_l, azimuth_r, elevation_r.
    shapes : ndarray of shape (n,), int64
        Cells of ratio and elevation.
    odds : ndarray of shape (n,)
        True match to mismatch.
    first : ndarray of shape (pairs + 1,), int64
        Pair k has the columns ``first[k]`` to ``first[k + 1]``.
    """

    columns: NDArray[np.float64]
    shapes: NDArray[np.int64]
    odds: NDArray[np.float64]
    first: NDArray[np.int64]


class TableArrays(NamedTuple):
    """A table, for the kernels.

    Parameters
    ----------
    positions : ndarray
        Of `axes.parallax_positions`.
    density : ndarray of shape (PARALLAX_CELLS, SHAPE_CELLS, C), float32
    profile : ndarray of shape (ELEVATION_CELLS, RESIDUAL_CELLS + 1), float32
    """

    positions: NDArray[np.float64]
    density: NDArray[np.float32]
    profile: NDArray[np.float32]


@jit
def shape_cell(slope_l, slope_r):  # type: ignore[no-untyped-def]
    """Give the cell of (ratio, elevation): RATIO_CELLS x ELEVATION_CELLS of them, row by row.

    Slopes are tangents of elevations. Nothing depends on which view is L, nor on what is up.
    """
    far, near = abs(slope_l), abs(slope_r)
    if near < far:
        far, near = near, far
    r = far / near if near > 0.0 else 0.0
    if slope_l * slope_r >= 0.0:
        even = RATIO_CELLS - NEGATIVE_CELLS
        ratio = NEGATIVE_CELLS + min(int(r * even), even - 1)
    elif r > 0.3:
        ratio = 0
    elif r > 0.1:
        ratio = 1
    elif r > 0.03:
        ratio = 2
    else:
        ratio = 3
    share = np.sqrt(np.arctan(near) * (2.0 / np.pi))
    return ratio * ELEVATION_CELLS + min(int(share * ELEVATION_CELLS), ELEVATION_CELLS - 1)


@jit
def coordinates(bearing, sin_theta, cos_theta, sin_phi, cos_phi, slopes):  # type: ignore[no-untyped-def]
    """Give the residual in radians and the parallax's step of a correspondence at a pose.

    ``bearing`` (8,) sines and cosines: of azimuth_l, elevation_l, azimuth_r, elevation_r.
    ``slopes`` (2,) out: the residual's derivatives by theta and phi. The step is -1 where the
    lines of sight lie on different sides of the baseline.
    """
    sin_u = sin_theta * bearing[1] - cos_theta * bearing[0]
    cos_u = cos_theta * bearing[1] + sin_theta * bearing[0]
    sin_v = sin_phi * bearing[5] - cos_phi * bearing[4]
    cos_v = cos_phi * bearing[5] + sin_phi * bearing[4]
    sin_l, cos_l, sin_r, cos_r = bearing[2], bearing[3], bearing[6], bearing[7]
    p, q = sin_r * cos_l, sin_l * cos_r
    # the gradient by the four measured angles, arcs of the sphere all of them
    across_l = sin_r * cos_u
    upward_l = cos_l * cos_r * sin_v - sin_r * sin_l * sin_u
    across_r = sin_l * cos_v
    upward_r = cos_r * cos_l * sin_u - sin_l * sin_r * sin_v
    square = across_l**2 + upward_l**2 + across_r**2 + upward_r**2
    norm = 1.0 / np.sqrt(square + 1e-24)
    slopes[0] = p * cos_u * norm
    slopes[1] = q * cos_v * norm
    residual = (p * sin_u + q * sin_v) * norm
    # L sees the landmark at -u from the baseline, R at v: on one side of it if the signs of their
    # sines agree, and then gamma = pi - |u - v|
    if sin_u * sin_v > 0.0:
        return residual, -1
    apex = sin_u * cos_v - cos_u * sin_v
    cosine = cos_u * cos_v + sin_u * sin_v
    half = np.sqrt(max(0.5 + 0.5 * cosine, 0.0))
    if (sin_u - sin_v) * apex < 0.0:
        half = -half
    return residual, int((half + 1.0) * HALF_STEPS)


@jit
def _agreement(residual, row):  # type: ignore[no-untyped-def]
    """Look a residual up in the profile of an elevation, ``row`` (residual nodes,)."""
    share = np.sqrt(abs(residual) * (1.0 / RESIDUAL_MAX)) * RESIDUAL_CELLS
    k = int(share)
    if k >= RESIDUAL_CELLS:
        return 0.0
    return row[k] + (share - k) * (row[k + 1] - row[k])


@jit
def describe(slopes, out):  # type: ignore[no-untyped-def]
    """Turn ``slopes`` (n, 4) [azimuth_l, slope_l, azimuth_r, slope_r] into ``out`` (n, 8).

    Sines and cosines of azimuth_l, elevation_l, azimuth_r, elevation_r.
    """
    for i in range(slopes.shape[0]):
        for view in range(2):
            azimuth, slope = slopes[i, 2 * view], slopes[i, 2 * view + 1]
            cosine = 1.0 / np.sqrt(1.0 + slope * slope)
            out[i, 4 * view] = np.sin(azimuth)
            out[i, 4 * view + 1] = np.cos(azimuth)
            out[i, 4 * view + 2] = slope * cosine
            out[i, 4 * view + 3] = cosine


@jit
def mean_parallax(bearings, theta, phi, lookup, band):  # type: ignore[no-untyped-def]
    """Average sin(gamma / 2) of the correspondences that agree with a pose; 0 if none does.

    ``bearings`` (n, 8), ``band`` the largest residual that agrees, radians.
    """
    sin_theta, cos_theta = np.sin(theta), np.cos(theta)
    sin_phi, cos_phi = np.sin(phi), np.cos(phi)
    slopes = np.empty(2)
    total = 0.0
    agreeing = 0
    for i in range(bearings.shape[0]):
        residual, step = coordinates(bearings[i], sin_theta, cos_theta, sin_phi, cos_phi, slopes)
        if abs(residual) < band and step >= 0 and lookup[step] > 0:
            total += step / HALF_STEPS - 1.0
            agreeing += 1
    return total / agreeing if agreeing > 0 else 0.0


@jit
def count_true(slopes, headings, weights, lookup, band, edges, bearings, inside, profile, seen):  # type: ignore[no-untyped-def]
    """Count correspondences at the true poses of their pairs.

    ``slopes`` (p, n, 4), ``headings`` (p, 2), ``weights`` (p,) of each pair's samples, ``lookup``
    of `axes.parallax_lookup`, ``band`` radians, ``edges`` (C - 1,) between the depth classes'
    mean parallaxes, ``bearings`` (n, 8) scratch. Out: ``inside`` (C, parallax, shape) the
    samples with a residual below the band; ``profile`` (elevation, residual) and ``seen`` (C,)
    all samples.
    """
    ignored = np.empty(2)
    for p in range(slopes.shape[0]):
        describe(slopes[p], bearings)
        theta, phi, weight = headings[p, 0], headings[p, 1], weights[p]
        depth = 0
        if edges.size > 0:
            mean = mean_parallax(bearings, theta, phi, lookup, band)
            for k in range(edges.size):
                depth += mean > edges[k]
        sin_theta, cos_theta = np.sin(theta), np.cos(theta)
        sin_phi, cos_phi = np.sin(phi), np.cos(phi)
        for i in range(slopes.shape[1]):
            residual, step = coordinates(
                bearings[i], sin_theta, cos_theta, sin_phi, cos_phi, ignored
            )
            residual = abs(residual)
            shape = shape_cell(slopes[p, i, 1], slopes[p, i, 3])
            cell = lookup[step] if step >= 0 else 0
            if residual < band:
                inside[depth, cell, shape] += weight
            share = np.sqrt(residual * (1.0 / RESIDUAL_MAX))
            k = min(int(share * RESIDUAL_CELLS), RESIDUAL_CELLS)
            profile[shape % ELEVATION_CELLS, k] += weight
            seen[depth] += weight


@jit
def count_chance(slopes, state, draws, lookup, band, bearings, inside, profile):  # type: ignore[no-untyped-def]
    """Count mismatches at random poses.

    As `count_true`; each of the correspondences ``slopes`` (n, 4) is met at ``draws`` poses, drawn
    uniform with the counter ``state`` (1,). Out: ``inside`` (parallax, shape), ``profile``
    (elevation, residual).
    """
    ignored = np.empty(2)
    describe(slopes, bearings)
    for i in range(slopes.shape[0]):
        shape = shape_cell(slopes[i, 1], slopes[i, 3])
        for _ in range(draws):
            theta, phi = TWO_PI * uniform(state), TWO_PI * uniform(state)
            residual, step = coordinates(
                bearings[i], np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi), ignored
            )
            residual = abs(residual)
            cell = lookup[step] if step >= 0 else 0
            if residual < band:
                inside[cell, shape] += 1
            share = np.sqrt(residual * (1.0 / RESIDUAL_MAX))
            k = min(int(share * RESIDUAL_CELLS), RESIDUAL_CELLS)
            profile[shape % ELEVATION_CELLS, k] += 1


@jit
def _sines_cosines(angles, sines, cosines):  # type: ignore[no-untyped-def]
    """Compute sines and cosines of angles (n,); the loop is vectorised."""
    for i in range(angles.size):
        sines[i], cosines[i] = fast_sincos(angles[i])


@jit
def sines_cosines(azimuth_l, elevation_l, azimuth_r, elevation_r, out):  # type: ignore[no-untyped-def]
    """Write sines and cosines of each of four arrays (n,) of radians in turn: ``out`` (8, n)."""
    _sines_cosines(azimuth_l, out[0], out[1])
    _sines_cosines(elevation_l, out[2], out[3])
    _sines_cosines(azimuth_r, out[4], out[5])
    _sines_cosines(elevation_r, out[6], out[7])


@jit
def shape_cells(columns, out):  # type: ignore[no-untyped-def]
    """Give the cells of (ratio, elevation) of correspondences ``columns`` (8, n): ``out`` (n,)."""
    for i in range(out.size):
        cos_l, cos_r = max(columns[3, i], 1e-9), max(columns[7, i], 1e-9)
        out[i] = shape_cell(columns[2, i] / cos_l, columns[6, i] / cos_r)


@jit
def _meet(  # type: ignore[no-untyped-def]
    sin_al,
    cos_al,
    sin_el,
    cos_el,
    sin_ar,
    cos_ar,
    sin_er,
    cos_er,
    theta,
    phi,
    residuals,
    halves,
    by_theta,
    by_phi,
):
    """Compute `coordinates` of all correspondences of a pair; the loop is vectorised.

    Out, (n,): ``residuals``, their derivatives, and ``halves`` sin(gamma / 2), -2 where the lines
    of sight lie on different sides of the baseline.
    """
    sin_theta, cos_theta, sin_phi, cos_phi = np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi)
    for i in range(sin_al.size):
        sin_u = sin_theta * cos_al[i] - cos_theta * sin_al[i]
        cos_u = cos_theta * cos_al[i] + sin_theta * sin_al[i]
        sin_v = sin_phi * cos_ar[i] - cos_phi * sin_ar[i]
        cos_v = cos_phi * cos_ar[i] + sin_phi * sin_ar[i]
        p, q = sin_er[i] * cos_el[i], sin_el[i] * cos_er[i]
        both, height = cos_el[i] * cos_er[i], sin_el[i] * sin_er[i]
        across_l = sin_er[i] * cos_u
        upward_l = both * sin_v - height * sin_u
        across_r = sin_el[i] * cos_v
        upward_r = both * sin_u - height * sin_v
        square = across_l**2 + upward_l**2 + across_r**2 + upward_r**2
        norm = 1.0 / np.sqrt(square + 1e-24)
        residuals[i] = (p * sin_u + q * sin_v) * norm
        by_theta[i] = p * cos_u * norm
        by_phi[i] = q * cos_v * norm
        half = np.sqrt(max(0.5 + 0.5 * (cos_u * cos_v + sin_u * sin_v), 0.0))
        apex = sin_u * cos_v - cos_u * sin_v
        half = -half if (sin_u - sin_v) * apex < 0.0 else half
        halves[i] = -2.0 if sin_u * sin_v > 0.0 else half


@jit
def _weigh(pairs, low, high, headings, table, numbers, members, ratios, scores):  # type: ignore[no-untyped-def]
    """Score one pose of one pair: the log-likelihood ratio in each depth class, ``scores`` (C,).

    The pair has the columns ``low`` to ``high``. Out: ``numbers`` (4, n) of `_meet`; of the
    correspondences that matter, whose number is returned, ``members`` (n,) which they are and
    ``ratios`` (n, C) of true match to mismatch. O(n C).
    """
    n = high - low
    columns, density = pairs.columns, table.density
    _meet(
        columns[0, low:high],
        columns[1, low:high],
        columns[2, low:high],
        columns[3, low:high],
        columns[4, low:high],
        columns[5, low:high],
        columns[6, low:high],
        columns[7, low:high],
        headings[0],
        headings[1],
        numbers[0, :n],
        numbers[1, :n],
        numbers[2, :n],
        numbers[3, :n],
    )
    known = 0
    for i in range(n):
        residual = numbers[0, i]
        if abs(residual) >= RESIDUAL_MAX:
            continue
        shape = pairs.shapes[low + i]
        row = table.profile[shape % ELEVATION_CELLS]
        factor = pairs.odds[low + i] * _agreement(residual, row)
        if factor <= NOTHING:
            continue
        half = numbers[1, i]
        position = table.positions[int((half + 1.0) * HALF_STEPS)] if half >= -1.0 else 0.0
        cell = int(position)
        share = position - cell
        here, there = density[cell, shape], density[min(cell + 1, PARALLAX_CELLS - 1), shape]
        for c in range(scores.size):
            ratios[known, c] = factor * (here[c] + share * (there[c] - here[c]))
        members[known] = i
        known += 1
    for c in range(scores.size):
        scores[c] = 0.0
        product = 1.0
        for k in range(known):
            product *= 1.0 + ratios[k, c]
            if product > LARGE:
                scores[c] += np.log(product)
                product = 1.0
        scores[c] += np.log(product)
    return known


@jit
def _mean(scores):  # type: ignore[no-untyped-def]
    """Give the log of the mean of exp(scores), and turn them into their shares."""
    largest = scores.max()
    total = 0.0
    for c in range(scores.size):
        scores[c] = np.exp(scores[c] - largest)
        total += scores[c]
    for c in range(scores.size):
        scores[c] /= total
    return largest + np.log(total / scores.size)


@jit
def _longest(first):  # type: ignore[no-untyped-def]
    """Give the largest number of correspondences of a pair."""
    most = 0
    for k in range(first.size - 1):
        most = max(most, first[k + 1] - first[k])
    return most


@jit
def score(pairs, poses, owners, table, out):  # type: ignore[no-untyped-def]
    """Compute the log-likelihood ratio of pairs at poses: no grid, all depth classes.

    ``pairs`` `PairArrays`; ``poses`` (m, 2) headings, ``owners`` (m,) the pairs that they belong
    to; ``table`` `TableArrays`. ``out`` (m,): log of the mean over the depth classes of the product
    over the correspondences of (1 + odds density profile), the density between the parallax's
    cells by interpolation. O(m n C).
    """
    first = pairs.first
    most = _longest(first)
    numbers, members = np.empty((4, most)), np.empty(most, np.int64)
    scores = np.empty(table.density.shape[2])
    ratios = np.empty((most, scores.size))
    for m in range(poses.shape[0]):
        low, high = first[owners[m]], first[owners[m] + 1]
        _weigh(pairs, low, high, poses[m], table, numbers, members, ratios, scores)
        out[m] = _mean(scores)


@jit
def maximize(pairs, poses, owners, steps, table, out, information):  # type: ignore[no-untyped-def]
    """Climb to the maximum of the likelihood near poses, by expectation maximization.

    As `score`, which is what it climbs. Each step weighs every correspondence with the probability
    that it is a true match (all the table knows of it, in the depth classes as probable as the
    pose's other correspondences make them), and solves the weighted least squares of the residuals.

    ``poses`` (m, 2) in and out, at most ``steps`` steps each. Out: ``out`` (m,) the log-likelihood
    ratio before the last step; ``information`` (m, 5): the entries (0, 0), (0, 1), (1, 1) of
    J^T W J, the weighted sum of squared residuals and the sum of the weights.
    """
    first = pairs.first
    most = _longest(first)
    numbers, members = np.empty((4, most)), np.empty(most, np.int64)
    scores = np.empty(table.density.shape[2])
    ratios = np.empty((most, scores.size))
    for m in range(poses.shape[0]):
        low, high = first[owners[m]], first[owners[m] + 1]
        for _ in range(steps):
            known = _weigh(pairs, low, high, poses[m], table, numbers, members, ratios, scores)
            out[m] = _mean(scores)
            a = b = c = g = h = squares = total = 0.0
            for k in range(known):
                i = members[k]
                weight = 0.0
                for d in range(scores.size):
                    weight += scores[d] * ratios[k, d] / (1.0 + ratios[k, d])
                residual, by_theta, by_phi = numbers[0, i], numbers[2, i], numbers[3, i]
                a += weight * by_theta * by_theta
                b += weight * by_theta * by_phi
                c += weight * by_phi * by_phi
                g += weight * by_theta * residual
                h += weight * by_phi * residual
                squares += weight * residual * residual
                total += weight
            information[m, 0], information[m, 1], information[m, 2] = a, b, c
            information[m, 3], information[m, 4] = squares, total
            # a little damping: a turn on the spot leaves one direction free
            damping = 1e-6 * (a + c) + 1e-9
            determinant = (a + damping) * (c + damping) - b * b
            step_l = ((c + damping) * g - b * h) / determinant
            step_r = ((a + damping) * h - b * g) / determinant
            length = np.sqrt(step_l * step_l + step_r * step_r)
            if length > LONGEST_STEP:
                step_l *= LONGEST_STEP / length
                step_r *= LONGEST_STEP / length
            poses[m, 0] -= step_l
            poses[m, 1] -= step_r
            if length < 1e-6:
                break
