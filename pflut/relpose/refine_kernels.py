"""Kernels of the M-estimator: the planar epipolar residual, reweighted least squares."""

from __future__ import annotations

import numpy as np

from pflut._jit import jit
from pflut._robust import CHEIRALITY_SLACK, TUKEY, robust_weight


@jit
def _residual(bearing, sin_theta, cos_theta, sin_phi, cos_phi, out):  # type: ignore[no-untyped-def]
    """Give the normalised residual of one correspondence, its Jacobian, and the depths' sign.

    ``bearing`` (8,) sines and cosines: sin/cos azimuth_l, sin/cos elevation_l, then of R.
    ``out`` (3,): the first-order distance to the constraint in radians on the sphere (Sampson's),
    and its derivatives by theta and phi. Returns whether both depths are positive.
    """
    sin_u = sin_theta * bearing[1] - cos_theta * bearing[0]
    cos_u = cos_theta * bearing[1] + sin_theta * bearing[0]
    sin_v = sin_phi * bearing[5] - cos_phi * bearing[4]
    cos_v = cos_phi * bearing[5] + sin_phi * bearing[4]
    sin_l, cos_l, sin_r, cos_r = bearing[2], bearing[3], bearing[6], bearing[7]
    value = sin_r * cos_l * sin_u + sin_l * cos_r * sin_v
    # the gradient by the four measured angles, arcs of the sphere all of them
    across_l = sin_r * cos_u
    upward_l = cos_l * cos_r * sin_v - sin_r * sin_l * sin_u
    across_r = sin_l * cos_v
    upward_r = cos_r * cos_l * sin_u - sin_l * sin_r * sin_v
    norm = np.sqrt(across_l**2 + upward_l**2 + across_r**2 + upward_r**2) + 1e-12
    out[0] = value / norm
    out[1] = sin_r * cos_l * cos_u / norm
    out[2] = sin_l * cos_r * cos_v / norm
    # The triangle L-R-landmark: u and -v have the same sign and |u| + |v| <= pi, that is
    # sin u sin(u - v) > 0 and sin v sin(u - v) < 0.
    apex = sin_u * cos_v - cos_u * sin_v
    return sin_u * apex >= -CHEIRALITY_SLACK and sin_v * apex <= CHEIRALITY_SLACK


@jit
def _refine(  # type: ignore[no-untyped-def]
    sin_al,
    cos_al,
    sin_el,
    cos_el,
    sin_ar,
    cos_ar,
    sin_er,
    cos_er,
    loss,
    knee,
    scales,
    steps_per_scale,
    headings,
    information,
):
    """Polish the two headings, as `refine`; the loop over the correspondences is vectorised."""
    inliers = 0.0
    for scale in scales:
        for _ in range(steps_per_scale):
            a = b = c = g = h = squares = inliers = 0.0
            theta, phi = headings[0], headings[1]
            sin_theta, cos_theta = np.sin(theta), np.cos(theta)
            sin_phi, cos_phi = np.sin(phi), np.cos(phi)
            for i in range(sin_al.size):
                # as `_residual`, without a branch
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
                residual = (p * sin_u + q * sin_v) * norm
                by_theta, by_phi = p * cos_u * norm, q * cos_v * norm
                apex = sin_u * cos_v - cos_u * sin_v
                counts = (sin_u * apex >= -CHEIRALITY_SLACK) & (sin_v * apex <= CHEIRALITY_SLACK)
                counts &= residual * residual < scale * scale
                weight = robust_weight(residual, loss, knee, scale) if counts else 0.0
                inliers += 1.0 if counts else 0.0
                a += weight * by_theta * by_theta
                b += weight * by_theta * by_phi
                c += weight * by_phi * by_phi
                g += weight * by_theta * residual
                h += weight * by_phi * residual
                squares += weight * residual * residual
            information[0], information[1], information[2], information[3] = a, b, c, squares
            # a little damping: a turn on the spot leaves one direction free
            damping = 1e-6 * (a + c) + 1e-12
            determinant = (a + damping) * (c + damping) - b * b
            if inliers == 0.0 or determinant <= 0.0:
                return int(inliers)
            step_l = ((c + damping) * g - b * h) / determinant
            step_r = ((a + damping) * h - b * g) / determinant
            # a step longer than the basin is no step
            length = np.sqrt(step_l * step_l + step_r * step_r)
            if length > 0.1:
                step_l *= 0.1 / length
                step_r *= 0.1 / length
            headings[0] = theta - step_l
            headings[1] = phi - step_r
            if length < 1e-7:
                break
    return int(inliers)


@jit
def refine(columns, loss, knee, scales, steps_per_scale, headings, information):  # type: ignore[no-untyped-def]
    """Polish the two headings by iteratively reweighted least squares.

    Minimises the sum of a robust loss of the residuals with positive depths, residuals beyond a
    cut-off left out, the cut-off going down through ``scales`` (radians), by Gauss-Newton steps.

    ``columns`` (8, n) sines and cosines of azimuth_l, elevation_l, azimuth_r, elevation_r;
    ``loss``, ``knee`` see `robust_weight`; ``headings`` (2,) in and out; ``information`` (4,) out:
    the entries (0, 0), (0, 1), (1, 1) of J^T W J, and the weighted sum of squared residuals.
    Returns the number of inliers (residual below the last cut-off with positive depths).
    """
    return _refine(
        columns[0],
        columns[1],
        columns[2],
        columns[3],
        columns[4],
        columns[5],
        columns[6],
        columns[7],
        loss,
        knee,
        scales,
        steps_per_scale,
        headings,
        information,
    )


@jit
def refine_many(  # type: ignore[no-untyped-def]
    columns, first, loss, knee, scales, steps_per_scale, poses, owners, information, inliers
):
    """Polish many poses of many pairs, as `refine`.

    Pair k has the columns ``first[k]`` to ``first[k + 1]`` of ``columns`` (8, n); ``poses`` (m, 2)
    in and out, ``owners`` (m,) the pairs; ``information`` (m, 4) and ``inliers`` (m,) out.
    """
    for m in range(poses.shape[0]):
        low, high = first[owners[m]], first[owners[m] + 1]
        inliers[m] = _refine(
            columns[0, low:high],
            columns[1, low:high],
            columns[2, low:high],
            columns[3, low:high],
            columns[4, low:high],
            columns[5, low:high],
            columns[6, low:high],
            columns[7, low:high],
            loss,
            knee,
            scales,
            steps_per_scale,
            poses[m],
            information[m],
        )


@jit
def _solve(matrix, vector, out):  # type: ignore[no-untyped-def]
    """Solve a symmetric positive definite 3 x 3 system by its adjugate (Cramer's rule)."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1], matrix[1, 2], matrix[2, 2]
    first, second, third = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * first + b * second + c * third
    out[0] = (first * vector[0] + second * vector[1] + third * vector[2]) / determinant
    out[1] = second * vector[0] + (a * f - c * c) * vector[1] + (b * c - a * e) * vector[2]
    out[1] /= determinant
    out[2] = third * vector[0] + (b * c - a * e) * vector[1] + (a * d - b * b) * vector[2]
    out[2] /= determinant


@jit
def refine_pose(bearings, owners, references, scales, steps_per_scale, pose, information):  # type: ignore[no-untyped-def]
    """Polish a pose with the correspondences of several references at once.

    As `refine`, over [x, y, heading]: the headings of every reference follow from the pose.

    ``bearings`` (n, 8), ``owners`` (n,) the rows of ``references`` (m, 3) that they belong to,
    ``pose`` (3,) in and out, ``information`` (3, 3) out: J^T W J of the last step. Returns the
    number of inliers.
    """
    row = np.empty(3)
    slope = np.empty(3)
    step = np.empty(3)
    gradient = np.empty(3)
    inliers = 0
    for scale in scales:
        for _ in range(steps_per_scale):
            information[:] = 0.0
            gradient[:] = 0.0
            inliers = 0
            for i in range(bearings.shape[0]):
                reference = references[owners[i]]
                dx = pose[0] - reference[0]
                dy = pose[1] - reference[1]
                # nearer than 2 cm the direction turns faster than any step can follow
                square = max(dx * dx + dy * dy, 4e-4)
                direction = np.arctan2(dy, dx)
                theta = direction - reference[2]
                phi = direction + np.pi - pose[2]
                in_front = _residual(
                    bearings[i], np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi), row
                )
                ratio = row[0] / scale
                if not in_front or ratio * ratio >= 1.0:
                    continue
                inliers += 1
                weight = robust_weight(row[0], TUKEY, 0.0, scale)
                turn = row[1] + row[2]
                slope[0] = -turn * dy / square
                slope[1] = turn * dx / square
                slope[2] = -row[2]
                for j in range(3):
                    gradient[j] += weight * slope[j] * row[0]
                    for k in range(3):
                        information[j, k] += weight * slope[j] * slope[k]
            if inliers < 3:
                return inliers
            damped = information.copy()
            for j in range(3):
                damped[j, j] += 1e-4 * information[j, j] + 1e-9
            _solve(damped, gradient, step)
            length = np.sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2])
            step *= min(1.0, 0.2 / max(length, 1e-12))
            pose -= step
            if length < 1e-7:
                break
    return inliers
