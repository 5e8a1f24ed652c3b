"""Kernels that choose among poses, and judge them: what agrees, and would chance bring it."""

from __future__ import annotations

import math

import numpy as np

from pflut._jit import jit
from pflut._robust import CHEIRALITY_SLACK


@jit
def _count_inliers(  # type: ignore[no-untyped-def]
    sin_al, cos_al, sin_el, cos_el, sin_ar, cos_ar, sin_er, cos_er, cutoff, headings
):
    """Count the correspondences that agree with a pose; the loop is vectorised."""
    sin_theta, cos_theta = np.sin(headings[0]), np.cos(headings[0])
    sin_phi, cos_phi = np.sin(headings[1]), np.cos(headings[1])
    inliers = 0.0
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
        value = p * sin_u + q * sin_v
        apex = sin_u * cos_v - cos_u * sin_v
        counts = (sin_u * apex >= -CHEIRALITY_SLACK) & (sin_v * apex <= CHEIRALITY_SLACK)
        counts &= value * value < cutoff * cutoff * (square + 1e-24)
        inliers += 1.0 if counts else 0.0
    return int(inliers)


@jit
def log_false_alarms(inliers, total, share, cutoff, degrees):  # type: ignore[no-untyped-def]
    """Give the log of the number of poses expected to have as many inliers by coincidence.

    The a-contrario test (Moisan, Stival, "A probabilistic criterion to detect rigid point matches
    between two images and estimate the fundamental matrix", IJCV 57(3), 2004): the binomial tail
    of ``inliers`` out of ``total`` at the chance ``share`` that a mismatch agrees with a pose,
    times the number of poses that differ, one every ``2 cutoff`` radians along each heading.
    Below zero, coincidence would bring less than one such pose.
    """
    share = min(max(share, 1.0 / (16.0 * max(total, 1))), 1.0 - 1e-9)
    term = math.lgamma(total + 1.0) - math.lgamma(inliers + 1.0)
    term -= math.lgamma(total - inliers + 1.0)
    term += inliers * np.log(share) + (total - inliers) * np.log1p(-share)
    # the terms after the first one, relative to it
    ratio = 1.0
    tail = 1.0
    for k in range(inliers, total):
        ratio *= (total - k) / (k + 1.0) * share / (1.0 - share)
        tail += ratio
        if ratio < 1e-12 * tail and k > share * total:
            break
    return degrees * np.log(np.pi / cutoff) + term + np.log(tail)


@jit
def choose(values, owners, count, chosen):  # type: ignore[no-untyped-def]
    """Choose the ``count`` highest ``values`` (m,) of each owner, the highest first.

    ``owners`` (m,) ascending. ``chosen`` (m,) int64 out, of which the first ones are filled: as
    many as is returned.
    """
    total = begin = 0
    for m in range(values.size):
        if m == 0 or owners[m] != owners[m - 1]:
            begin = total
        k = total
        while k > begin and values[chosen[k - 1]] < values[m]:
            if k < begin + count:
                chosen[k] = chosen[k - 1]
            k -= 1
        if k < begin + count:
            chosen[k] = m
            total = min(total + 1, begin + count)
    return total


@jit
def judge(columns, first, poses, cutoff, shifts, inliers, alarms):  # type: ignore[no-untyped-def]
    """Count what agrees with the pose of each pair, and tell whether coincidence would bring it.

    What coincidence brings is measured at the pose with certain mismatches, made of the data's own
    bearings: each point of L with the points of R that belong to the next ``shifts``
    correspondences. Bearings that crowd in one direction agree with some poses far more often
    than others.

    Pair k has the columns ``first[k]`` to ``first[k + 1]`` of ``columns`` (8, n) and the headings
    ``poses[k]``. ``cutoff`` largest residual, radians. Out: ``inliers`` (p,) int64, ``alarms``
    (p,) of `log_false_alarms`. O(n shifts).
    """
    for k in range(poses.shape[0]):
        low, high = first[k], first[k + 1]
        n = high - low
        inliers[k] = 0
        alarms[k] = 0.0
        agreeing = 0
        shifted = min(shifts, n - 1)
        for shift in range(shifted + 1):
            # points of L from `start` on with points of R from `begin` on: two runs a shift
            for part in range(2):
                start = low if part == 0 else high - shift
                begin = low + shift if part == 0 else low
                size = n - shift if part == 0 else shift
                count = _count_inliers(
                    columns[0, start : start + size],
                    columns[1, start : start + size],
                    columns[2, start : start + size],
                    columns[3, start : start + size],
                    columns[4, begin : begin + size],
                    columns[5, begin : begin + size],
                    columns[6, begin : begin + size],
                    columns[7, begin : begin + size],
                    cutoff,
                    poses[k],
                )
                if shift == 0:
                    inliers[k] += count
                else:
                    agreeing += count
        if n > 1:
            alarms[k] = log_false_alarms(inliers[k], n, agreeing / (n * shifted), cutoff, 2)
