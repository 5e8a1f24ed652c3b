"""Kernels of the planar RANSAC: minimal solvers, scoring, local optimisation, the loop."""

from __future__ import annotations

import numpy as np

from pflut._jit import jit
from pflut._random import uniform
from pflut._robust import CHEIRALITY_SLACK, TUKEY, iterations_needed, robust_weight, seed_of

SIN_L, COS_L, SIN_R, COS_R, SCALE_L, SCALE_R, GRADIENT, GRADIENT_L, GRADIENT_R = range(9)
NUM_ROWS = 9
"""Quantities of a correspondence that do not change with the pose, one row each."""
BLOCK = 8
"""Correspondences scored at a time; the rows are filled up to a multiple of it."""
MIN_DETERMINANT = 1e-12
LOCAL_STEPS = 6


@jit
def prepare(columns, state, rows, pool, gated):  # type: ignore[no-untyped-def]
    """Fill the rows of a pair, and the pool that samples are drawn from, shuffled.

    A correspondence whose bearings lie on different sides of the horizon has no pose with both
    depths positive, so that with ``gated`` no sample holds it.

    ``columns`` (8, n): sines and cosines of azimuth_l, elevation_l, azimuth_r, elevation_r;
    ``rows`` (NUM_ROWS, n up to a multiple of BLOCK) out, zero behind n; ``pool`` (n,) out. Returns
    the size of the pool.
    """
    n = columns.shape[1]
    size = 0
    rows[:, n:] = 0.0
    for i in range(n):
        sin_l, cos_l = columns[2, i], columns[3, i]
        sin_r, cos_r = columns[6, i], columns[7, i]
        rows[SIN_L, i], rows[COS_L, i] = columns[0, i], columns[1, i]
        rows[SIN_R, i], rows[COS_R, i] = columns[4, i], columns[5, i]
        rows[SCALE_L, i] = sin_r * cos_l
        rows[SCALE_R, i] = sin_l * cos_r
        # the squared gradient is a quadratic form of sin u and sin v
        both = (cos_l * cos_r) ** 2 + (sin_l * sin_r) ** 2
        rows[GRADIENT, i] = sin_l * sin_l + sin_r * sin_r
        rows[GRADIENT_L, i] = both - sin_r * sin_r
        rows[GRADIENT_R, i] = both - sin_l * sin_l
        if sin_l * sin_r > 0.0 or not gated:
            pool[size] = i
            size += 1
    for i in range(size - 1, 0, -1):
        j = int(uniform(state) * (i + 1))
        pool[i], pool[j] = pool[j], pool[i]
    return size


@jit
def model_cost(rows, model, threshold, truncated, limit):  # type: ignore[no-untyped-def]
    """Sum up what the correspondences cost, each 1 at most; stop at ``limit``.

    ``model`` (4,): sin theta, cos theta, sin phi, cos phi. The residual is the first-order
    distance to the planar epipolar constraint in radians on the sphere (Sampson's). Its square over
    that of the threshold is the cost if ``truncated`` (MSAC), else 0; 1 beyond the threshold or
    behind a view.
    """
    sin_theta, cos_theta, sin_phi, cos_phi = model[0], model[1], model[2], model[3]
    square = threshold * threshold
    total = 0.0
    for start in range(0, rows.shape[1], BLOCK):
        part = 0.0
        for i in range(start, start + BLOCK):
            sin_u = sin_theta * rows[COS_L, i] - cos_theta * rows[SIN_L, i]
            cos_u = cos_theta * rows[COS_L, i] + sin_theta * rows[SIN_L, i]
            sin_v = sin_phi * rows[COS_R, i] - cos_phi * rows[SIN_R, i]
            cos_v = cos_phi * rows[COS_R, i] + sin_phi * rows[SIN_R, i]
            left, right = rows[SCALE_L, i] * sin_u, rows[SCALE_R, i] * sin_v
            gradient = rows[GRADIENT, i] - 4.0 * left * right
            gradient += rows[GRADIENT_L, i] * sin_u * sin_u + rows[GRADIENT_R, i] * sin_v * sin_v
            cost = min((left + right) ** 2 / (square * max(gradient, 1e-24)), 1.0)
            apex = sin_u * cos_v - cos_u * sin_v
            behind = max(-sin_u * apex, sin_v * apex)
            cost = 1.0 if behind > CHEIRALITY_SLACK else cost
            part += cost if truncated else np.floor(cost)
        total += part
        if total >= limit:
            break
    return total


@jit
def _in_front(rows, samples, model):  # type: ignore[no-untyped-def]
    """Tell whether all samples lie before both views; turn the model around if all lie behind."""
    positive = 0
    for i in samples:
        sin_u = model[0] * rows[COS_L, i] - model[1] * rows[SIN_L, i]
        cos_u = model[1] * rows[COS_L, i] + model[0] * rows[SIN_L, i]
        sin_v = model[2] * rows[COS_R, i] - model[3] * rows[SIN_R, i]
        cos_v = model[3] * rows[COS_R, i] + model[2] * rows[SIN_R, i]
        # both bearings on one side of the horizon: the depths have the same sign
        positive += sin_u * (sin_u * cos_v - cos_u * sin_v) > 0.0
    if positive == 0:
        for k in range(4):
            model[k] = -model[k]
    return positive == 0 or positive == samples.shape[0]


@jit
def _normalise(first, second, model, half):  # type: ignore[no-untyped-def]
    """Write a sine and a cosine, scaled to the unit circle; False if there is no direction."""
    norm = np.sqrt(first * first + second * second)
    if norm < MIN_DETERMINANT:
        return False
    model[half], model[half + 1] = first / norm, second / norm
    return True


@jit
def solve(rows, samples, models):  # type: ignore[no-untyped-def]
    """Solve for the poses of two or three correspondences; return how many.

    The constraint is linear in (sin theta, cos theta, sin phi, cos phi). Three rows have one null
    vector, and its halves are scaled to unit length; two have a plane of them, in which two lines
    have halves of equal length. The sign follows from the depths.

    ``samples`` (2,) or (3,) columns of ``rows``; ``models`` (2, 4) out.
    """
    i, j = samples[0], samples[1]
    a0, a1 = rows[SCALE_L, i] * rows[COS_L, i], -rows[SCALE_L, i] * rows[SIN_L, i]
    a2, a3 = rows[SCALE_R, i] * rows[COS_R, i], -rows[SCALE_R, i] * rows[SIN_R, i]
    b0, b1 = rows[SCALE_L, j] * rows[COS_L, j], -rows[SCALE_L, j] * rows[SIN_L, j]
    b2, b3 = rows[SCALE_R, j] * rows[COS_R, j], -rows[SCALE_R, j] * rows[SIN_R, j]
    m01, m02, m03 = a0 * b1 - a1 * b0, a0 * b2 - a2 * b0, a0 * b3 - a3 * b0
    m12, m13, m23 = a1 * b2 - a2 * b1, a1 * b3 - a3 * b1, a2 * b3 - a3 * b2
    found = 0
    if samples.shape[0] == 3:
        k = samples[2]
        c0, c1 = rows[SCALE_L, k] * rows[COS_L, k], -rows[SCALE_L, k] * rows[SIN_L, k]
        c2, c3 = rows[SCALE_R, k] * rows[COS_R, k], -rows[SCALE_R, k] * rows[SIN_R, k]
        sin_l, cos_l = c1 * m23 - c2 * m13 + c3 * m12, -c0 * m23 + c2 * m03 - c3 * m02
        sin_r, cos_r = c0 * m13 - c1 * m03 + c3 * m01, -c0 * m12 + c1 * m02 - c2 * m01
        proper = _normalise(sin_l, cos_l, models[0], 0) and _normalise(sin_r, cos_r, models[0], 2)
        return int(proper and _in_front(rows, samples, models[0]))
    # the half with the smaller determinant is the unknown, the other follows by Cramer's rule
    swap = abs(m01) > abs(m23)
    if swap:
        m02, m03, m12, m13, m23 = -m02, -m12, -m03, -m13, m01
    if abs(m23) < MIN_DETERMINANT:
        return 0
    half = 2 if swap else 0
    # a s^2 + 2 b s c + d c^2 = 0 says that both halves have the same length
    a = m03 * m03 + m02 * m02 - m23 * m23
    b = m03 * m13 + m02 * m12
    d = m13 * m13 + m12 * m12 - m23 * m23
    discriminant = b * b - a * d
    if discriminant < 0.0:
        return 0
    if max(abs(a), abs(b), abs(d)) < MIN_DETERMINANT * m23 * m23:
        # of one place seen twice any direction will do
        a, b, d, discriminant = 1.0, 0.0, 0.0, 0.0
    q = -b - np.copysign(np.sqrt(discriminant), b)
    for root in range(2):
        sine, cosine = (q, a) if root == 0 else (d, q)
        model = models[found]
        if not _normalise(sine, cosine, model, half):
            continue
        sine, cosine = model[half], model[half + 1]
        other = (-(m03 * sine + m13 * cosine) / m23, (m02 * sine + m12 * cosine) / m23)
        if _normalise(other[0], other[1], model, 2 - half) and _in_front(rows, samples, model):
            found += 1
    return found


@jit
def improve(rows, n, cutoff, headings):  # type: ignore[no-untyped-def]
    """Move the two headings to a minimum of Tukey's biweight of the residuals in front.

    The M-estimator of `refine_kernels.refine` on the rows that scoring uses: a few steps with one
    cut-off. ``headings`` (2,) in and out.
    """
    for _ in range(LOCAL_STEPS):
        a = b = c = g = h = 0.0
        sin_theta, cos_theta = np.sin(headings[0]), np.cos(headings[0])
        sin_phi, cos_phi = np.sin(headings[1]), np.cos(headings[1])
        for i in range(n):
            sin_u = sin_theta * rows[COS_L, i] - cos_theta * rows[SIN_L, i]
            cos_u = cos_theta * rows[COS_L, i] + sin_theta * rows[SIN_L, i]
            sin_v = sin_phi * rows[COS_R, i] - cos_phi * rows[SIN_R, i]
            cos_v = cos_phi * rows[COS_R, i] + sin_phi * rows[SIN_R, i]
            left, right = rows[SCALE_L, i] * sin_u, rows[SCALE_R, i] * sin_v
            gradient = rows[GRADIENT, i] - 4.0 * left * right
            gradient += rows[GRADIENT_L, i] * sin_u * sin_u + rows[GRADIENT_R, i] * sin_v * sin_v
            gradient = max(gradient, 1e-24)
            value = left + right
            apex = sin_u * cos_v - cos_u * sin_v
            behind = max(-sin_u * apex, sin_v * apex) > CHEIRALITY_SLACK
            if behind or value * value >= cutoff * cutoff * gradient:
                continue
            weight = robust_weight(value / np.sqrt(gradient), TUKEY, 0.0, cutoff) / gradient
            slope_l, slope_r = rows[SCALE_L, i] * cos_u, rows[SCALE_R, i] * cos_v
            a += weight * slope_l * slope_l
            b += weight * slope_l * slope_r
            c += weight * slope_r * slope_r
            g += weight * slope_l * value
            h += weight * slope_r * value
        # a little damping: a turn on the spot leaves one direction free
        damping = 1e-6 * (a + c) + 1e-12
        determinant = (a + damping) * (c + damping) - b * b
        if determinant <= 0.0:
            break
        step_l = ((c + damping) * g - b * h) / determinant
        step_r = ((a + damping) * h - b * g) / determinant
        # a step longer than the basin is no step
        length = np.sqrt(step_l * step_l + step_r * step_r)
        if length > 0.1:
            step_l *= 0.1 / length
            step_r *= 0.1 / length
        headings[0] -= step_l
        headings[1] -= step_r
        if length < 1e-7:
            break


@jit
def _draw(state, pool, iteration, samples):  # type: ignore[no-untyped-def]
    """Draw two or three different members of the shuffled pool.

    Pairs are those of neighbors in the pool's cycle, then of neighbors but one and so on, so that
    size (size - 1) / 2 iterations meet every pair once.
    """
    size = pool.shape[0]
    first = iteration % size
    samples[0] = pool[first]
    if samples.shape[0] == 2:
        samples[1] = pool[(first + 1 + iteration // size) % size]
        return
    second = int(uniform(state) * (size - 1))
    third = int(uniform(state) * (size - 2))
    # the numbers of those not taken yet
    second += second >= first
    low, high = min(first, second), max(first, second)
    third += third >= low
    third += third >= high
    samples[1], samples[2] = pool[second], pool[third]


@jit
def _write_model(headings, model):  # type: ignore[no-untyped-def]
    """Write the sines and cosines of the headings."""
    model[0], model[1] = np.sin(headings[0]), np.cos(headings[0])
    model[2], model[3] = np.sin(headings[1]), np.cos(headings[1])


@jit
def search(columns, state, options, work, headings):  # type: ignore[no-untyped-def]
    """Find the cheapest model of a pair: samples, their models, each new best one improved.

    ``columns`` (8, n) as `prepare` takes them; ``state`` (1,) uint64 of the random numbers, in and
    out; ``options``: the threshold of the residual in radians, the largest number of iterations,
    whether the costs are truncated squares, whether each new best model is moved to a minimum, the
    confidence to stop at (0: never), whether samples are ``gated``; ``work``: the rows and the pool
    of `prepare`, and the sample (2,) or (3,), whose size chooses the solver. ``headings`` (2,) out.

    Returns the iterations taken, negative or zero if no model costs less than having none; the
    headings are then zero. O(iterations n).
    """
    threshold, max_iterations, truncated, optimise, confidence, gated = options
    rows, pool, samples = work
    n = columns.shape[1]
    size = prepare(columns, state, rows, pool, gated)
    headings[:] = 0.0
    if size < samples.shape[0]:
        return 0
    pool = pool[:size]
    models, local, model = np.empty((2, 4)), np.empty(2), np.empty(4)
    cheapest = cheapest_minimal = float(n)
    stop = float(max_iterations)
    if samples.shape[0] == 2:
        stop = min(stop, 0.5 * size * (size - 1))
    iteration = 0
    while iteration < stop:
        _draw(state, pool, iteration, samples)
        iteration += 1
        for k in range(solve(rows, samples, models)):
            cost = model_cost(rows, models[k], threshold, truncated, cheapest_minimal)
            if cost >= cheapest_minimal:
                continue
            cheapest_minimal = cost
            local[0] = np.arctan2(models[k, 0], models[k, 1])
            local[1] = np.arctan2(models[k, 2], models[k, 3])
            if cost < cheapest:
                cheapest = cost
                headings[:] = local
            if optimise:
                improve(rows, n, threshold, local)
                _write_model(local, model)
                cost = model_cost(rows, model, threshold, truncated, cheapest)
                if cost < cheapest:
                    cheapest = cost
                    headings[:] = local
            if confidence > 0.0:
                _write_model(headings, model)
                inliers = min(n - model_cost(rows, model, threshold, False, np.inf), size)
                needed = iterations_needed(inliers, size, samples.shape[0], confidence)
                stop = min(stop, needed)
    return iteration if cheapest < n else -iteration


@jit
def search_many(columns, first, seed, sample_size, options, headings, iterations):  # type: ignore[no-untyped-def]
    """Find the cheapest models of many pairs, as `search`, each with random numbers of its own.

    Pair k has the columns ``first[k]`` to ``first[k + 1]`` of ``columns`` (8, n). ``seed`` (1,)
    uint64; ``sample_size`` 2 or 3; ``headings`` (pairs, 2) and ``iterations`` (pairs,) out.
    """
    samples, state = np.empty(sample_size, np.int64), seed.copy()
    for k in range(headings.shape[0]):
        n = first[k + 1] - first[k]
        # of its own size each, so that the loop over it is contiguous
        rows = np.empty((NUM_ROWS, (n + BLOCK - 1) // BLOCK * BLOCK))
        work = (rows, np.empty(n, np.int64), samples)
        pair = columns[:, first[k] : first[k + 1]]
        state[0] = seed_of(pair, seed[0])
        iterations[k] = search(pair, state, options, work, headings[k])
