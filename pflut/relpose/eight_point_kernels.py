"""Kernels of the general RANSAC: the 8-point solver, scoring, refinement of all five angles.

A pose (12,) is the rotation by rows and the unit translation of x_r = R x_l + t. Rays (6, n) are
the unit vectors of both views, filled up with zeros to a multiple of `BLOCK`. The residual is the
first-order distance to the epipolar constraint in radians on the sphere (Sampson's), as that of the
plane; with w = R x_l, its gradient has the squared length 2 - (t w)^2 - (t x_r)^2 - 2 value^2.
"""

from __future__ import annotations

import numpy as np

from pflut._jit import jit
from pflut._random import uniform
from pflut._robust import CHEIRALITY_SLACK, TUKEY, iterations_needed, robust_weight, seed_of

SAMPLE_SIZE = 8
BLOCK = 8
"""Correspondences scored at a time."""
MIN_PIVOT = 1e-9
LOCAL_STEPS = 6
LONGEST_STEP = 0.2
SWEEPS = 6


@jit
def null_vector(matrix, order, vector):  # type: ignore[no-untyped-def]
    """Solve eight homogeneous equations in nine unknowns; False if they are not independent.

    Gaussian elimination with complete pivoting. ``matrix`` (8, 9) is destroyed, ``order`` (9,)
    int64 is scratch, ``vector`` (9,) out.
    """
    for j in range(9):
        order[j] = j
    for k in range(8):
        pivot, row, column = 0.0, k, k
        for i in range(k, 8):
            for j in range(k, 9):
                if abs(matrix[i, order[j]]) > pivot:
                    pivot, row, column = abs(matrix[i, order[j]]), i, j
        if pivot < MIN_PIVOT:
            return False
        order[k], order[column] = order[column], order[k]
        for j in range(9):
            matrix[k, j], matrix[row, j] = matrix[row, j], matrix[k, j]
        for i in range(k + 1, 8):
            factor = matrix[i, order[k]] / matrix[k, order[k]]
            for j in range(k + 1, 9):
                matrix[i, order[j]] -= factor * matrix[k, order[j]]
    vector[order[8]] = 1.0
    for k in range(7, -1, -1):
        total = 0.0
        for j in range(k + 1, 9):
            total += matrix[k, order[j]] * vector[order[j]]
        vector[order[k]] = -total / matrix[k, order[k]]
    return True


@jit
def _diagonalise(matrix, vectors):  # type: ignore[no-untyped-def]
    """Turn a symmetric 3 x 3 matrix into a diagonal one by Jacobi's rotations.

    ``matrix`` in and out; ``vectors`` (3, 3) out, its columns the eigenvectors.
    """
    for i in range(3):
        for j in range(3):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(SWEEPS):
        for p in range(2):
            for q in range(p + 1, 3):
                if matrix[p, q] == 0.0:
                    continue
                tau = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
                tangent = np.copysign(1.0, tau) / (abs(tau) + np.sqrt(1.0 + tau * tau))
                cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
                sine = tangent * cosine
                for k in range(3):
                    a, b = matrix[k, p], matrix[k, q]
                    matrix[k, p], matrix[k, q] = cosine * a - sine * b, sine * a + cosine * b
                for k in range(3):
                    a, b = matrix[p, k], matrix[q, k]
                    matrix[p, k], matrix[q, k] = cosine * a - sine * b, sine * a + cosine * b
                    a, b = vectors[k, p], vectors[k, q]
                    vectors[k, p], vectors[k, q] = cosine * a - sine * b, sine * a + cosine * b


@jit
def _cross(a, b, out):  # type: ignore[no-untyped-def]
    """Write the cross product."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@jit
def _normalise(vector):  # type: ignore[no-untyped-def]
    """Scale a vector to length one; False if it has none."""
    length = np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    if length < MIN_PIVOT:
        return False
    for k in range(3):
        vector[k] /= length
    return True


@jit
def decompose(essential, poses):  # type: ignore[no-untyped-def]
    """Give the four poses of the essential matrix nearest to a matrix; False if it has none.

    R = U W V' or U W' V', and t is the last column of U or its opposite (R. Hartley, A. Zisserman,
    "Multiple view geometry", 2nd ed., result 9.19).

    ``essential`` (3, 3) as in x_r' E x_l = 0; ``poses`` (4, 12) out.
    """
    square, v = np.zeros((3, 3)), np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                square[i, j] += essential[k, i] * essential[k, j]
    _diagonalise(square, v)
    last = 0
    for k in range(1, 3):
        last = k if square[k, k] < square[last, last] else last
    first, second = (last + 1) % 3, (last + 2) % 3
    if square[first, first] < square[second, second]:
        first, second = second, first
    u1, u2, u3, v3 = np.zeros(3), np.zeros(3), np.empty(3), np.empty(3)
    for i in range(3):
        for k in range(3):
            u1[i] += essential[i, k] * v[k, first]
            u2[i] += essential[i, k] * v[k, second]
    if not _normalise(u1):
        return False
    inner = u1[0] * u2[0] + u1[1] * u2[1] + u1[2] * u2[2]
    for i in range(3):
        u2[i] -= inner * u1[i]
    if not _normalise(u2):
        return False
    _cross(u1, u2, u3)
    _cross(v[:, first], v[:, second], v3)
    for m in range(4):
        turn = 1.0 if m < 2 else -1.0
        for i in range(3):
            for j in range(3):
                turned = u2[i] * v[j, first] - u1[i] * v[j, second]
                poses[m, 3 * i + j] = turn * turned + u3[i] * v3[j]
            poses[m, 9 + i] = u3[i] if m % 2 == 0 else -u3[i]
    return True


@jit
def pose_cost(rays, pose, threshold, truncated, limit):  # type: ignore[no-untyped-def]
    """Sum up what the correspondences cost, each 1 at most; stop at ``limit``.

    As `ransac_kernels.model_cost`, for a pose of all five angles.
    """
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = pose[:9]
    t0, t1, t2 = pose[9:]
    square = threshold * threshold
    total = 0.0
    for start in range(0, rays.shape[1], BLOCK):
        part = 0.0
        for i in range(start, start + BLOCK):
            x, y, z = rays[0, i], rays[1, i], rays[2, i]
            p, q, s = rays[3, i], rays[4, i], rays[5, i]
            w0, w1, w2 = (
                r0 * x + r1 * y + r2 * z,
                r3 * x + r4 * y + r5 * z,
                r6 * x + r7 * y + r8 * z,
            )
            value = p * (t1 * w2 - t2 * w1) + q * (t2 * w0 - t0 * w2) + s * (t0 * w1 - t1 * w0)
            along_l = t0 * w0 + t1 * w1 + t2 * w2
            along_r = t0 * p + t1 * q + t2 * s
            gradient = 2.0 - along_l * along_l - along_r * along_r - 2.0 * value * value
            cost = min(value * value / (square * max(gradient, 1e-24)), 1.0)
            apex = w0 * p + w1 * q + w2 * s
            behind = max(along_l - apex * along_r, apex * along_l - along_r)
            cost = 1.0 if behind > CHEIRALITY_SLACK else cost
            part += cost if truncated else np.floor(cost)
        total += part
        if total >= limit:
            break
    return total


@jit
def solve(rays, samples, scratch, pose):  # type: ignore[no-untyped-def]
    """Solve for the pose of eight correspondences with most of them before both views.

    ``samples`` (8,) columns of ``rays``; ``scratch``: arrays (8, 9), (9,) int64, (9,), (4, 12) and
    (6, 8); ``pose`` (12,) out. Returns whether there is one.
    """
    matrix, order, vector, poses, chosen = scratch
    for k in range(SAMPLE_SIZE):
        for i in range(3):
            chosen[i, k], chosen[3 + i, k] = rays[i, samples[k]], rays[3 + i, samples[k]]
            for j in range(3):
                matrix[k, 3 * i + j] = rays[3 + i, samples[k]] * rays[j, samples[k]]
    if not null_vector(matrix, order, vector):
        return False
    if not decompose(vector.reshape(3, 3), poses):
        return False
    best = SAMPLE_SIZE + 1.0
    for m in range(4):
        # with an endless threshold only what lies behind a view costs anything
        behind = pose_cost(chosen, poses[m], 1e9, False, best)
        if behind < best:
            best = behind
            pose[:] = poses[m]
    return True


@jit
def _step(pose, basis, step):  # type: ignore[no-untyped-def]
    """Turn the rotation by a rotation vector, and move the translation along its tangents."""
    angle = np.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
    turn = np.sin(angle) / angle if angle > 1e-12 else 1.0
    bend = (1.0 - np.cos(angle)) / (angle * angle) if angle > 1e-6 else 0.5
    first, second = np.empty(3), np.empty(3)
    for j in range(3):
        _cross(step, pose[j:9:3], first)
        _cross(step, first, second)
        for i in range(3):
            pose[3 * i + j] += turn * first[i] + bend * second[i]
    for i in range(3):
        pose[9 + i] += step[3] * basis[0, i] + step[4] * basis[1, i]
    _normalise(pose[9:])


@jit
def _tangents(direction, basis):  # type: ignore[no-untyped-def]
    """Write two unit vectors across a direction."""
    axis = np.zeros(3)
    axis[np.argmin(np.abs(direction))] = 1.0
    _cross(direction, axis, basis[0])
    _normalise(basis[0])
    _cross(direction, basis[0], basis[1])


@jit
def _solve_damped(matrix, vector, out):  # type: ignore[no-untyped-def]
    """Solve a symmetric 5 x 5 system with a little damping, by Cholesky's factors."""
    lower = np.zeros((5, 5))
    trace = 0.0
    for i in range(5):
        trace += matrix[i, i]
    for i in range(5):
        for j in range(i + 1):
            total = matrix[i, j] + (1e-6 * trace + 1e-12 if i == j else 0.0)
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            lower[i, j] = np.sqrt(max(total, 1e-18)) if i == j else total / lower[j, j]
    for i in range(5):
        out[i] = vector[i]
        for k in range(i):
            out[i] -= lower[i, k] * out[k]
        out[i] /= lower[i, i]
    for i in range(4, -1, -1):
        for k in range(i + 1, 5):
            out[i] -= lower[k, i] * out[k]
        out[i] /= lower[i, i]


@jit
def refine(rays, n, loss, knee, cutoffs, steps, pose, information, slopes):  # type: ignore[no-untyped-def]
    """Polish all five angles by iteratively reweighted least squares.

    As `refine_kernels.refine`: a robust loss of the residuals with positive depths, by Gauss-Newton
    steps over a rotation vector and the translation's two tangents; without any, the pose stays.

    ``pose`` (12,) in and out; ``information`` (5, 5) out: J' W J; ``slopes`` (2, 5) out: those of
    the headings. Returns the number of inliers within the last cut-off, and the weighted sum of
    their squared residuals.
    """
    basis, gradient, step, row = np.empty((2, 3)), np.empty(5), np.empty(5), np.empty(5)
    w, x, normal = np.empty(3), np.empty(3), np.empty(3)
    inliers, squares = 0, 0.0
    for cutoff in cutoffs:
        for _ in range(max(steps, 1)):
            information[:] = 0.0
            gradient[:] = 0.0
            inliers, squares = 0, 0.0
            translation = pose[9:]
            _tangents(translation, basis)
            for i in range(n):
                for k in range(3):
                    x[k] = rays[3 + k, i]
                    w[k] = pose[3 * k] * rays[0, i] + pose[3 * k + 1] * rays[1, i]
                    w[k] += pose[3 * k + 2] * rays[2, i]
                _cross(w, x, normal)
                value, along_l, along_r, apex = 0.0, 0.0, 0.0, 0.0
                for k in range(3):
                    value += translation[k] * normal[k]
                    along_l += translation[k] * w[k]
                    along_r += translation[k] * x[k]
                    apex += w[k] * x[k]
                behind = max(along_l - apex * along_r, apex * along_l - along_r)
                square = 2.0 - along_l * along_l - along_r * along_r - 2.0 * value * value
                square = max(square, 1e-24)
                if behind > CHEIRALITY_SLACK or value * value >= cutoff * cutoff * square:
                    continue
                norm = 1.0 / np.sqrt(square)
                weight = robust_weight(value * norm, loss, knee, cutoff)
                for k in range(3):
                    row[k] = norm * (x[k] * along_l - translation[k] * apex)
                for k in range(2):
                    row[3 + k] = norm * (
                        basis[k, 0] * normal[0] + basis[k, 1] * normal[1] + basis[k, 2] * normal[2]
                    )
                inliers += 1
                squares += weight * (value * norm) ** 2
                for k in range(5):
                    gradient[k] -= weight * row[k] * value * norm
                    for j in range(5):
                        information[k, j] += weight * row[k] * row[j]
            if steps == 0:
                break
            _solve_damped(information, gradient, step)
            length = np.sqrt(np.sum(step * step))
            if length > LONGEST_STEP:
                step *= LONGEST_STEP / length
            _step(pose, basis, step)
            if length < 1e-7:
                break
    _write_slopes(pose, basis, slopes)
    return inliers, squares


@jit
def _write_slopes(pose, basis, slopes):  # type: ignore[no-untyped-def]
    """Write the headings' derivatives (2, 5) by what `refine` moves."""
    turned, center, arm = np.empty((5, 3)), np.empty(3), np.empty(3)
    axis = np.zeros(3)
    for k in range(5):
        if k < 3:
            axis[:] = 0.0
            axis[k] = 1.0
            _cross(axis, pose[9:], arm)
        else:
            for i in range(3):
                arm[i] = -basis[k - 3, i]
        for j in range(3):
            turned[k, j] = pose[j] * arm[0] + pose[3 + j] * arm[1] + pose[6 + j] * arm[2]
    for j in range(3):
        center[j] = -(pose[j] * pose[9] + pose[3 + j] * pose[10] + pose[6 + j] * pose[11])
    length_l = max(center[0] ** 2 + center[1] ** 2, 1e-6)
    length_r = max(pose[9] ** 2 + pose[10] ** 2, 1e-6)
    for k in range(5):
        slopes[0, k] = (center[0] * turned[k, 1] - center[1] * turned[k, 0]) / length_l
        slopes[1, k] = 0.0
        if k >= 3:
            across = pose[9] * basis[k - 3, 1] - pose[10] * basis[k - 3, 0]
            slopes[1, k] = across / length_r


@jit
def _write_headings(pose, headings):  # type: ignore[no-untyped-def]
    """Write the directions on the plane from L to R in L's frame, and from R to L in R's."""
    x = -(pose[0] * pose[9] + pose[3] * pose[10] + pose[6] * pose[11])
    y = -(pose[1] * pose[9] + pose[4] * pose[10] + pose[7] * pose[11])
    headings[0] = np.arctan2(y, x)
    headings[1] = np.arctan2(pose[10], pose[9])


@jit
def search(rays, n, state, options, pool, scratch, pose):  # type: ignore[no-untyped-def]
    """Find the cheapest pose: samples of eight, their poses, each new best one refined.

    ``rays`` (6, n up to a multiple of BLOCK); ``options`` as `ransac_kernels.search` takes them;
    ``pool`` (n,) int64 scratch; ``pose`` (12,) out. Returns the iterations taken, negative or zero
    if no pose costs less than having none. O(iterations n).
    """
    threshold, max_iterations, truncated, optimise, confidence, _ = options
    if n < SAMPLE_SIZE:
        return 0
    for i in range(n):
        pool[i] = i
    minimal, local, information = np.empty(12), np.empty(12), np.empty((5, 5))
    slopes, cutoffs = np.empty((2, 5)), np.full(1, threshold)
    cheapest = cheapest_minimal = float(n)
    stop = float(max_iterations)
    iteration = 0
    while iteration < stop:
        for k in range(SAMPLE_SIZE):
            j = k + int(uniform(state) * (n - k))
            pool[k], pool[j] = pool[j], pool[k]
        iteration += 1
        if not solve(rays, pool[:SAMPLE_SIZE], scratch, minimal):
            continue
        cost = pose_cost(rays, minimal, threshold, truncated, cheapest_minimal)
        if cost >= cheapest_minimal:
            continue
        cheapest_minimal = cost
        if cost < cheapest:
            cheapest = cost
            pose[:] = minimal
        if optimise:
            local[:] = minimal
            refine(rays, n, TUKEY, 0.0, cutoffs, LOCAL_STEPS, local, information, slopes)
            cost = pose_cost(rays, local, threshold, truncated, cheapest)
            if cost < cheapest:
                cheapest = cost
                pose[:] = local
        if confidence > 0.0:
            inliers = n - pose_cost(rays, pose, threshold, False, np.inf)
            stop = min(stop, iterations_needed(inliers, n, SAMPLE_SIZE, confidence))
    return iteration if cheapest < n else -iteration


@jit
def agreeing_by_chance(rays, n, pose, threshold, shifts, shifted):  # type: ignore[no-untyped-def]
    """Count certain mismatches that agree with a pose: each ray of L with the next ones of R.

    ``shifted`` as ``rays``, scratch. See `judge_kernels.judge`.
    """
    agreeing = 0
    shifted[:] = 0.0
    shifted[:3] = rays[:3]
    for shift in range(1, shifts + 1):
        for i in range(n):
            shifted[3:, i] = rays[3:, (i + shift) % n]
        agreeing += n - int(pose_cost(shifted, pose, threshold, False, np.inf))
    return agreeing


@jit
def estimate_many(  # type: ignore[no-untyped-def]
    columns, first, seed, options, polish, shifts, headings, found
):
    """Estimate the poses of many pairs: `search`, then `refine`; each with its own random numbers.

    Pair k has the columns ``first[k]`` to ``first[k + 1]`` of ``columns`` (8, n): sines and cosines
    of azimuth_l, elevation_l, azimuth_r, elevation_r. ``seed`` (1,) uint64; ``polish``: the loss,
    its knee, the cut-offs and the steps with each. Out: ``headings`` (pairs, 2); ``found``: numbers
    of iterations (see `search`), of inliers and of certain mismatches that agree, all (pairs,)
    int64, sums of squares (pairs,), information (pairs, 5, 5) and slopes (pairs, 2, 5).
    """
    loss, knee, cutoffs, steps = polish
    iterations, inliers, agreeing, squares, information, slopes = found
    pose = np.empty(12)
    state = seed.copy()
    matrix, order, vector = np.empty((8, 9)), np.empty(9, np.int64), np.empty(9)
    scratch = (matrix, order, vector, np.empty((4, 12)), np.empty((6, SAMPLE_SIZE)))
    for k in range(headings.shape[0]):
        pair = columns[:, first[k] : first[k + 1]]
        n = pair.shape[1]
        rays = np.zeros((6, (n + BLOCK - 1) // BLOCK * BLOCK))
        for i in range(n):
            for view in range(2):
                sin_az, cos_az = pair[4 * view, i], pair[4 * view + 1, i]
                sin_el, cos_el = pair[4 * view + 2, i], pair[4 * view + 3, i]
                rays[3 * view, i] = cos_el * cos_az
                rays[3 * view + 1, i] = cos_el * sin_az
                rays[3 * view + 2, i] = sin_el
        state[0] = seed_of(pair, seed[0])
        iterations[k] = search(rays, n, state, options, np.empty(n, np.int64), scratch, pose)
        inliers[k] = agreeing[k] = 0
        squares[k] = 0.0
        information[k] = slopes[k] = 0.0
        headings[k] = 0.0
        if iterations[k] > 0:
            inliers[k], squares[k] = refine(
                rays, n, loss, knee, cutoffs, steps, pose, information[k], slopes[k]
            )
            _write_headings(pose, headings[k])
            shifted = np.empty_like(rays)
            agreeing[k] = agreeing_by_chance(
                rays, n, pose, cutoffs[-1], min(shifts, n - 1), shifted
            )
