"""One component of a mixture on a grid, for kernels: its normaliser, and how sharp it is.

A grid holds a density at the centres of its cells, divided by its sum. So does a component here:
one sharper than a cell is divided by its sum over the cells, not by its integral, and its moments
are those of the cells.

Columns of a component: weight, then of a mode mean heading_l, mean heading_r, k1, k2, coupling; of
a band mean rotation, mean heading_l, their concentrations, and nothing. The last column is its
kind.

Whoever edits this file deletes Numba's cache: it does not notice that kernels of other files call
these (``find pflut -name "*.nb[ci]" -delete``).
"""

from __future__ import annotations

import numpy as np

from pflut._jit import inline, jit

WEIGHT, MEAN_1, MEAN_2, K_1, K_2, COUPLING, KIND = range(7)
COLUMNS = 7
MODE, BAND = 0.0, 1.0
NODES = 10
"""Of half the integral of a normaliser; its error is then below that of I0."""
SHARP = 0.7
"""Deviation of a heading given the other, in cells, below which a sum is no integral."""
LARGEST_CORRELATION = 0.9998
MOST_DAMPED = 0.45
"""Variance along a wave, in squared wavelengths, at which a sum over cells misses it by 3e-4."""
TWO_PI = 2.0 * np.pi


@inline
def i0e(x):  # type: ignore[no-untyped-def]
    """I0(x) exp(-x), to 2e-7: Abramowitz and Stegun 9.8.1 and 9.8.2."""
    if x < 3.75:
        t = (x / 3.75) ** 2
        p = 0.0360768 + t * 0.0045813
        p = 0.2659732 + t * p
        p = 1.2067492 + t * p
        p = 3.0899424 + t * p
        p = 3.5156229 + t * p
        return (1.0 + t * p) * np.exp(-x)
    t = 3.75 / x
    p = -0.01647633 + t * 0.00392377
    p = 0.02635537 + t * p
    p = -0.02057706 + t * p
    p = 0.00916281 + t * p
    p = -0.00157565 + t * p
    p = 0.00225319 + t * p
    p = 0.01328592 + t * p
    return (0.39894228 + t * p) / np.sqrt(x)


@jit
def half_width(k1, k2, coupling, nats):  # type: ignore[no-untyped-def]
    """Give the angle d1 beyond which a mode is so many nats below its maximum, whatever d2.

    With v = 1 - cos d1 and r^2 = c^2 / (k1 k2) its log-density is there at most
    -k1 v (1 - r^2 + r^2 v / 2) below.
    """
    if k1 < 1e-9:
        return np.pi
    squared = min(coupling * coupling / (k1 * max(k2, 1e-9)), 1.0)
    share = nats / k1
    rest = 1.0 - squared
    v = 2.0 * share / (rest + np.sqrt(rest * rest + 2.0 * squared * share))
    return np.arccos(1.0 - v) if v < 2.0 else np.pi


@jit
def log_normalizer(k1, k2, coupling):  # type: ignore[no-untyped-def]
    """Log of a sine model's normaliser less its log-density's maximum, as `sine.log_normalizer`.

    Of small deviations it is the normal distribution's, with the mean of the fourth-order terms.
    """
    determinant = k1 * k2 - coupling * coupling
    if determinant > 0.0:
        s11, s22, s12 = k2 / determinant, k1 / determinant, coupling / determinant
        fourth = 0.125 * (k1 * s11 * s11 + k2 * s22 * s22) - 0.5 * coupling * s12 * (s11 + s22)
        if abs(fourth) < 0.02 and s11 < 0.1 and s22 < 0.1:
            return np.log(TWO_PI) - 0.5 * np.log(determinant) + fourth
    half = half_width(k2, k1, coupling, 25.0)
    # nodes at odd multiples of half a step, by turning half their angle on
    turn = 0.5 * half / NODES
    sine, cosine = np.sin(0.5 * turn), np.cos(0.5 * turn)
    sin_step, cos_step = np.sin(turn), np.cos(turn)
    total = 0.0
    for _ in range(NODES):
        across = coupling * 2.0 * sine * cosine
        across *= across
        inner = np.sqrt(k1 * k1 + across)
        gain = across / max(inner + k1, 1e-300) - 2.0 * k2 * sine * sine
        total += np.exp(gain) * i0e(inner)
        sine, cosine = sine * cos_step + cosine * sin_step, cosine * cos_step - sine * sin_step
    return np.log(TWO_PI * 2.0 * half / NODES * total)


@jit
def is_sharp(component, cell):  # type: ignore[no-untyped-def]
    """Say whether the sum of a component over the cells is not its integral."""
    steepest = component[K_1]
    if component[KIND] == MODE:
        steepest = max(steepest, component[K_2])
    return steepest * (SHARP * cell) ** 2 > 1.0


@jit
def is_short(component, cell):  # type: ignore[no-untyped-def]
    """Say whether a mode is no longer than three cells, so that it is normal."""
    k1, k2 = component[K_1], component[K_2]
    return component[KIND] == MODE and k1 + k2 < (3.0 * cell) ** 2 * (
        k1 * k2 - component[COUPLING] ** 2
    )


@jit
def sum_over_cells(component, cell, sums):  # type: ignore[no-untyped-def]
    """Sum a sharp mode over the cells, as if normal: Poisson's summation formula.

    A sum over a lattice is the integral times the sum, over the waves that the lattice cannot tell
    from a constant, of their means under the density; of a normal one those are
    e^(-2 pi^2 w' S w) cos(2 pi w' m), with the wave's number w, the covariance S and the mean m in
    cells. Its derivatives by the mean give the moments.

    ``sums`` (6,) receives the log of the sum times a cell's area, for a maximum of one; then the
    moments about the mean, over the sum: of d1, d2, d1^2, d2^2 and d1 d2.
    """
    k1, k2, c = component[K_1], component[K_2], component[COUPLING]
    determinant = k1 * k2 - c * c
    s11, s22, s12 = k2 / determinant, k1 / determinant, c / determinant
    area = cell * cell
    x, y = component[MEAN_1] / cell - 0.5, component[MEAN_2] / cell - 0.5
    total, g1, g2, h11, h22, h12 = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    # all waves, and of two opposite ones the first, that are damped by less
    damping = MOST_DAMPED * area
    rest = 1.0 / k1
    for u in range(int(np.sqrt(damping * k1)) + 1):
        middle, width = -u * s12 / s22, np.sqrt(max(damping - u * u * rest, 0.0) / s22)
        first = int(np.ceil(middle - width))
        if u == 0:
            first = 1
        for v in range(first, int(np.floor(middle + width)) + 1):
            damped = u * u * s11 + v * v * s22 + 2.0 * u * v * s12
            phase = TWO_PI * (u * x + v * y)
            height = 2.0 * np.exp(-0.5 * TWO_PI * TWO_PI / area * damped)
            sine, cosine = height * np.sin(phase), height * np.cos(phase)
            total += cosine
            g1 -= u * sine
            g2 -= v * sine
            h11 -= u * u * cosine
            h22 -= v * v * cosine
            h12 -= u * v * cosine
    total = max(total, 1e-6)
    scale = TWO_PI / (cell * total)
    g1, g2 = scale * g1, scale * g2
    scale *= TWO_PI / cell
    h11, h22, h12 = scale * h11, scale * h22, scale * h12
    sums[0] = log_normalizer(k1, k2, c) + np.log(total)
    sums[1], sums[2] = s11 * g1 + s12 * g2, s12 * g1 + s22 * g2
    sums[3] = s11 + s11 * s11 * h11 + s12 * s12 * h22 + 2.0 * s11 * s12 * h12
    sums[4] = s22 + s12 * s12 * h11 + s22 * s22 * h22 + 2.0 * s12 * s22 * h12
    sums[5] = s12 + s11 * s12 * h11 + s12 * s22 * h22 + (s11 * s22 + s12 * s12) * h12


@jit
def sum_over_diagonals(component, cell, sums):  # type: ignore[no-untyped-def]
    """Sum a sharp band over the rotations of the cells, as if normal.

    ``sums`` (3,) receives the log of the sum times a cell, for a maximum of one; then the moments
    of psi about the mean.
    """
    k1 = component[K_1]
    # rotations are whole cells, plus half a turn
    center = (component[MEAN_1] - np.pi) / cell
    width = 4.5 / (np.sqrt(k1) * cell) + 0.5
    total, first, second = 0.0, 0.0, 0.0
    for i in range(int(np.ceil(center - width)), int(np.floor(center + width)) + 1):
        d = (i - center) * cell
        value = np.exp(-0.5 * k1 * d * d)
        total += value
        first += value * d
        second += value * d * d
    total = max(total, 1e-30)
    sums[0] = np.log(total * cell)
    sums[1], sums[2] = first / total, second / total


@jit
def sharpen(s11, s22, s12, blur, least, out):  # type: ignore[no-untyped-def]
    """Take a blur off a covariance; no direction's variance becomes less than a least one."""
    mean, half = 0.5 * (s11 + s22), 0.5 * (s11 - s22)
    reach = np.sqrt(half * half + s12 * s12)
    large = max(mean + reach - blur, least)
    small = max(mean - reach - blur, least)
    if reach <= 1e-12 * mean:
        out[0], out[1], out[2] = large, large, 0.0
        return
    # the eigenvectors stay, the eigenvalues are new
    center, radius = 0.5 * (large + small), 0.5 * (large - small)
    out[0] = center + radius * half / reach
    out[1] = center - radius * half / reach
    out[2] = radius * s12 / reach


@jit
def set_covariance(covariance, component):  # type: ignore[no-untyped-def]
    """Set a mode's concentrations and coupling by a small covariance [s11, s22, s12]."""
    s11, s22, s12 = covariance[0], covariance[1], covariance[2]
    determinant = s11 * s22 - s12 * s12
    component[K_1], component[K_2] = s22 / determinant, s11 / determinant
    limit = LARGEST_CORRELATION * np.sqrt(component[K_1] * component[K_2])
    component[COUPLING] = min(max(s12 / determinant, -limit), limit)


@jit
def concentration(spread):  # type: ignore[no-untyped-def]
    """Concentration of a von Mises distribution whose mean cosine is one minus a spread.

    Within 4 %: D. J. Best, N. I. Fisher, Communications in Statistics B 10 (1981) 493.
    """
    length = 1.0 - spread
    if length <= 0.0:
        return 0.0
    if length < 0.53:
        return length * (2.0 + length**2 + 5.0 / 6.0 * length**4)
    if length < 0.85:
        return -0.4 + 1.39 * length + 0.43 / spread
    return 1.0 / (length * spread * (2.0 + spread))
