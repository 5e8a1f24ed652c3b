"""Kernels of the maximization: each component from its share of the points."""

from __future__ import annotations

import numpy as np

from pflut._jit import inline, jit
from pflut.von_mises._components import (
    COLUMNS,
    COUPLING,
    K_1,
    K_2,
    KIND,
    LARGEST_CORRELATION,
    MEAN_1,
    MEAN_2,
    MODE,
    WEIGHT,
    concentration,
    is_sharp,
    is_short,
    set_covariance,
    sharpen,
    sum_over_cells,
    sum_over_diagonals,
)
from pflut.von_mises.point_kernels import BLOCK_VARIANCE, CHUNK

MOMENTS = 11
SMALLEST_DEVIATION = 0.22
"""Of a component, in cells: its neighbours have e^-10 of its probability, and tell no more."""
LEAST_UNIFORM = 1e-9
RELAXATION = 1.5
"""Steps are so many times as long as those of expectation maximization."""
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


@inline
def _mode_moments(points, factors, first, last, component, density, at, out):  # type: ignore[no-untyped-def]
    """Sum a mode's moments about its mean over points, weighted with its share of them."""
    sin_1, cos_1 = np.float32(np.sin(component[MEAN_1])), np.float32(np.cos(component[MEAN_1]))
    sin_2, cos_2 = np.float32(np.sin(component[MEAN_2])), np.float32(np.cos(component[MEAN_2]))
    mass, m1, m2, u1, u2 = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    s11, s22, s12, t1, t2, quartic = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    shift = at - first
    for n in range(first, last):
        s1 = points[0, n] * cos_1 - points[1, n] * sin_1
        c1 = points[1, n] * cos_1 + points[0, n] * sin_1
        s2 = points[2, n] * cos_2 - points[3, n] * sin_2
        c2 = points[3, n] * cos_2 + points[2, n] * sin_2
        share = factors[n] * density[n + shift]
        mass += share
        m1 += share * s1
        m2 += share * s2
        u1 += share * (_ONE - c1)
        u2 += share * (_ONE - c2)
        s11 += share * s1 * s1
        s22 += share * s2 * s2
        both = share * s1 * s2
        s12 += both
        t1 += both * c1
        t2 += both * c2
        quartic += both * s1 * s2
    out[0] += mass
    out[1] += m1
    out[2] += m2
    out[3] += u1
    out[4] += u2
    out[5] += s11
    out[6] += s22
    out[7] += s12
    out[8] += t1
    out[9] += t2
    out[10] += quartic
    return mass


@inline
def _band_moments(points, factors, first, last, component, density, at, out):  # type: ignore[no-untyped-def]
    """Sum a band's sines and cosines about its means over points."""
    sin_1, cos_1 = np.float32(np.sin(component[MEAN_1])), np.float32(np.cos(component[MEAN_1]))
    sin_2, cos_2 = np.float32(np.sin(component[MEAN_2])), np.float32(np.cos(component[MEAN_2]))
    mass, m1, m2, u1, u2 = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    shift = at - first
    for n in range(first, last):
        sin_psi = points[1, n] * points[2, n] - points[0, n] * points[3, n]
        cos_psi = -points[1, n] * points[3, n] - points[0, n] * points[2, n]
        share = factors[n] * density[n + shift]
        mass += share
        m1 += share * (sin_psi * cos_1 - cos_psi * sin_1)
        m2 += share * (points[0, n] * cos_2 - points[1, n] * sin_2)
        u1 += share * (_ONE - cos_psi * cos_1 - sin_psi * sin_1)
        u2 += share * (_ONE - points[1, n] * cos_2 - points[0, n] * sin_2)
    out[0] += mass
    out[1] += m1
    out[2] += m2
    out[3] += u1
    out[4] += u2
    return mass


@jit
def least_variance(blur, cell):  # type: ignore[no-untyped-def]
    """Give the least variance of a component whose points have a mean blur."""
    return max((SMALLEST_DEVIATION * cell) ** 2, 3.0 * blur)


@jit
def update_mode(moments, blur, least, component):  # type: ignore[no-untyped-def]
    """Set a mode from its moments: score matching, which is linear and needs no normaliser.

    With t the statistics (cos d1, cos d2, sin d1 sin d2), the parameters solve
    E[grad t . grad t'] x = -E[Laplacian of t]. K. V. Mardia, J. T. Kent, A. K. Laha, "Score
    matching estimators for directional distributions", arXiv:1604.08470, 2016. For small deviations
    it is the inverse of the covariance.
    """
    mass = moments[0]
    component[WEIGHT] = mass
    if mass < 1e-9:
        return
    m1, m2 = moments[1] / mass, moments[2] / mass
    u1, u2 = moments[3] / mass, moments[4] / mass
    component[MEAN_1] += np.arctan2(m1, 1.0 - u1)
    component[MEAN_2] += np.arctan2(m2, 1.0 - u2)
    # about the new mean, to second order
    s11, s22 = moments[5] / mass - m1 * m1, moments[6] / mass - m2 * m2
    s12 = moments[7] / mass - m1 * m2
    t1, t2 = moments[8] / mass - m1 * m2, moments[9] / mass - m1 * m2
    c1 = 1.0 - u1 + 0.5 * m1 * m1
    c2 = 1.0 - u2 + 0.5 * m2 * m2
    sharp = np.empty(3)
    sharpen(s11, s22, s12, blur, least, sharp)
    quartic = moments[10] / mass
    both = sharp[0] + sharp[1] - 2.0 * min(quartic, sharp[0] * sharp[1] * 3.0)
    t1 += sharp[2] - s12
    t2 += sharp[2] - s12
    s11, s22, s12 = sharp[0], sharp[1], sharp[2]
    rest = both - t1 * t1 / s11 - t2 * t2 / s22
    coupling = 0.0
    if rest > 1e-12:
        coupling = (2.0 * s12 + t1 * c1 / s11 + t2 * c2 / s22) / rest
    k1 = max((c1 + coupling * t1) / s11, 0.0)
    k2 = max((c2 + coupling * t2) / s22, 0.0)
    limit = LARGEST_CORRELATION * np.sqrt(k1 * k2)
    component[K_1], component[K_2] = k1, k2
    component[COUPLING] = min(max(coupling, -limit), limit)


@jit
def update_sharp_mode(moments, cell, least, component):  # type: ignore[no-untyped-def]
    """Set a mode sharper than a cell: its moments over the cells approach those that are given."""
    mass = moments[0]
    component[WEIGHT] = mass
    if mass < 1e-9:
        return
    sums = np.empty(6)
    sum_over_cells(component, cell, sums)
    k1, k2, c = component[K_1], component[K_2], component[COUPLING]
    determinant = k1 * k2 - c * c
    m1, m2 = moments[1] / mass, moments[2] / mass
    s11 = k2 / determinant + moments[5] / mass - m1 * m1 - (sums[3] - sums[1] * sums[1])
    s22 = k1 / determinant + moments[6] / mass - m2 * m2 - (sums[4] - sums[2] * sums[2])
    s12 = c / determinant + moments[7] / mass - m1 * m2 - (sums[5] - sums[1] * sums[2])
    sharp = np.empty(3)
    sharpen(s11, s22, s12, 0.0, least, sharp)
    component[MEAN_1] += m1 - sums[1]
    component[MEAN_2] += m2 - sums[2]
    set_covariance(sharp, component)


@jit
def update_band(moments, blur, cell, least, component):  # type: ignore[no-untyped-def]
    """Set a band from its moments."""
    mass = moments[0]
    component[WEIGHT] = mass
    if mass < 1e-9:
        return
    m1, m2 = moments[1] / mass, moments[2] / mass
    u1, u2 = moments[3] / mass, moments[4] / mass
    spread_2 = 1.0 - np.sqrt((1.0 - u2) ** 2 + m2 * m2)
    component[MEAN_2] += np.arctan2(m2, 1.0 - u2)
    # along itself a band is no sharper than a cell, where a sum over cells is no integral
    component[K_2] = concentration(max(spread_2, 1e-3, 0.25 * cell * cell))
    if is_sharp(component, cell):
        sums = np.empty(3)
        sum_over_diagonals(component, cell, sums)
        seen = 2.0 * u1 - m1 * m1 - blur
        variance = 1.0 / component[K_1] + seen - (sums[2] - sums[1] * sums[1])
        component[MEAN_1] += m1 - sums[1]
        component[K_1] = 1.0 / max(variance, least)
    else:
        spread_1 = 1.0 - np.sqrt((1.0 - u1) ** 2 + m1 * m1)
        component[MEAN_1] += np.arctan2(m1, 1.0 - u1)
        component[K_1] = concentration(max(spread_1 - 0.5 * blur, 0.5 * least))


@jit
def _go_on(before, component):  # type: ignore[no-untyped-def]
    """Move a component further the way it was moved: steps of expectation maximization are short.

    R. Salakhutdinov, S. Roweis, "Adaptive overrelaxed bound optimization methods", ICML 2003.
    """
    more = RELAXATION - 1.0
    weight, k1, k2 = component[WEIGHT], component[K_1], component[K_2]
    component[WEIGHT] = weight * (weight / max(before[WEIGHT], 1e-12)) ** more
    component[MEAN_1] += more * (component[MEAN_1] - before[MEAN_1])
    component[MEAN_2] += more * (component[MEAN_2] - before[MEAN_2])
    if component[KIND] == MODE and k1 * k2 > 0.0 and before[K_1] * before[K_2] > 0.0:
        r = component[COUPLING] / np.sqrt(k1 * k2)
        r += more * (r - before[COUPLING] / np.sqrt(before[K_1] * before[K_2]))
        k1 *= (k1 / before[K_1]) ** more
        k2 *= (k2 / before[K_2]) ** more
        component[K_1], component[K_2] = k1, k2
        r = min(max(r, -LARGEST_CORRELATION), LARGEST_CORRELATION)
        component[COUPLING] = r * np.sqrt(k1 * k2)


@jit
def maximize(points, blocks, cell, components, first, runs, num_runs, scratch, total):  # type: ignore[no-untyped-def]
    """Set the components from a first one on from their shares; return what is left to no one.

    Arrays are as `expectation_kernels.expect` left them; ``total`` is spoiled.
    """
    for n in range(total.shape[0]):
        total[n] = points[4, n] / total[n]
    moments = np.empty(MOMENTS)
    before = np.empty(COLUMNS)
    rest = 1.0
    for k in range(first, components.shape[0]):
        moments[:] = 0.0
        component = components[k]
        blur = 0.0
        at = np.uint64(0)
        for r in range(num_runs[k]):
            start, end = runs[k, r, 0], runs[k, r, 1]
            if component[KIND] == MODE:
                mass = _mode_moments(points, total, start, end, component, scratch[k], at, moments)
            else:
                mass = _band_moments(points, total, start, end, component, scratch[k], at, moments)
            if start < blocks * CHUNK:
                blur += mass * BLOCK_VARIANCE * cell * cell
            at += end - start
        blur /= max(moments[0], 1e-12)
        least = least_variance(blur, cell)
        before[:] = component
        if component[KIND] == MODE:
            if is_sharp(component, cell) and is_short(component, cell):
                update_sharp_mode(moments, cell, least, component)
            else:
                update_mode(moments, blur, least, component)
        else:
            update_band(moments, 2.0 * blur, cell, least, component)
        if component[WEIGHT] > 1e-9:
            _go_on(before, component)
        rest -= component[WEIGHT]
    if first == 0 and rest < LEAST_UNIFORM:
        for k in range(components.shape[0]):
            components[k, WEIGHT] *= (1.0 - LEAST_UNIFORM) / (1.0 - rest)
        rest = LEAST_UNIFORM
    return rest
