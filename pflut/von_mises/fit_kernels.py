"""Kernels that fit a mixture to a grid by expectation maximization.

A grid holds a density at the centres of its cells, divided by its sum. So does a component here:
one sharper than a cell is divided by its sum over the cells, not by its integral, and its moments
are those of the cells. At a block of cells, see `point_kernels`, it is evaluated as if blurred; and
it is evaluated on the tiles where it is not negligible only.

Columns of a component: weight, then of a mode mean heading_l, mean heading_r, k1, k2, coupling; of
a band mean rotation, mean heading_l, their concentrations, and nothing. The last column is its
kind.
"""

from __future__ import annotations

import numpy as np

from pflut._jit import inline, jit
from pflut.von_mises.point_kernels import BLOCK, LEVELS, TILES

WEIGHT, MEAN_1, MEAN_2, K_1, K_2, COUPLING, KIND = range(7)
COLUMNS = 7
MODE, BAND = 0.0, 1.0
MOMENTS = 11
NODES = 10
"""Of half the integral of a normaliser; its error is then below that of I0."""
MAX_RUNS = 1 + 2 * TILES

SMALLEST_DEVIATION = 0.22
"""Of a component, in cells: its neighbours have e^-10 of its probability, and tell no more."""
SHARP = 0.7
"""Deviation of a heading given the other, in cells, below which a sum is no integral."""
LARGEST_CORRELATION = 0.9998
NEGLIGIBLE = 14.0
"""Nats below its maximum at which a mode has ended."""
NEARBY = 0.25
"""Radians within which what is missing makes one new mode."""
POLISHES = 4
"""So many times so many steps at most, once nothing is added any more."""
BAND_SHARE, BAND_LENGTH = 0.3, 0.8
"""A band is tried if three diagonals hold so much, at headings whose mean vector is no longer."""
TWO_PI = 2.0 * np.pi

_F0, _F1, _F2, _F3, _F4, _F5 = (
    np.float32(c)
    for c in np.polynomial.Chebyshev.interpolate(lambda t: 2.0**t, 5, domain=[-0.5, 0.5])
    .convert(kind=np.polynomial.Polynomial)
    .coef
)
_LOG2E, _HALF = np.float32(np.log2(np.e)), np.float32(0.5)
_LOWEST = np.float32(-40.0)
_ONE, _TWO, _ZERO = np.float32(1.0), np.float32(2.0), np.float32(0.0)
_BIAS, _SHIFT = np.int32(127), np.int32(23)
_PER_OCTAVE = np.float32(np.log(2.0) / 2**23)
_ONE_BITS = np.int32(127 << 23)


@inline
def _exp(x):  # type: ignore[no-untyped-def]
    """Exponential of a float32 below 80, to 4e-6; at least e^-40. A loop over it is vectorised."""
    z = max(x, _LOWEST) * _LOG2E
    whole = np.floor(z + _HALF)
    f = z - whole
    p = _F5 * f + _F4
    p = p * f + _F3
    p = p * f + _F2
    p = p * f + _F1
    p = p * f + _F0
    return p * np.int32((np.int32(whole) + _BIAS) << _SHIFT).view(np.float32)


@inline
def _rough_log(x):  # type: ignore[no-untyped-def]
    """Logarithm of a positive float32, to 0.06: the exponent's bits, and those behind them."""
    return np.float32(np.float32(x).view(np.int32) - _ONE_BITS) * _PER_OCTAVE


@inline
def _i0e(x):  # type: ignore[no-untyped-def]
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
        total += np.exp(gain) * _i0e(inner)
        sine, cosine = sine * cos_step + cosine * sin_step, cosine * cos_step - sine * sin_step
    return np.log(TWO_PI * 2.0 * half / NODES * total)


@jit
def _side(level, cell):  # type: ignore[no-untyped-def]
    """Give the side of the points of a size, radians."""
    return cell * BLOCK if level == 0 else cell


@jit
def _blur(level, cell):  # type: ignore[no-untyped-def]
    """Give the variance of the centres of a point's cells along an axis."""
    return cell * cell * (BLOCK * BLOCK - 1.0) / 12.0 if level == 0 else 0.0


@jit
def least_variance(blur, cell):  # type: ignore[no-untyped-def]
    """Give the least variance of a component whose points have a mean blur."""
    return max((SMALLEST_DEVIATION * cell) ** 2, 3.0 * blur)


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
    """Sum a sharp mode over the cells around it.

    ``sums`` (6,) receives the log of the sum times a cell's area, for a maximum of one; then the
    moments about the mean, over the sum: of d1, d2, d1^2, d2^2 and d1 d2.
    """
    # rows along the heading that is less sharp, given the other
    swapped = component[K_1] > component[K_2]
    k1, k2, mean_1, mean_2 = component[K_1], component[K_2], component[MEAN_1], component[MEAN_2]
    if swapped:
        k1, k2, mean_1, mean_2 = k2, k1, mean_2, mean_1
    c = component[COUPLING]
    reach = half_width(k1, k2, c, 9.0) / cell
    center = mean_1 / cell - 0.5
    total, m1, m2, s11, s22, s12 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(int(np.ceil(center - reach)), int(np.floor(center + reach)) + 1):
        d1 = (i - center) * cell
        sine = c * np.sin(d1)
        row = -k1 * (1.0 - np.cos(d1))
        steepness = np.sqrt(k2 * k2 + sine * sine)
        middle = (mean_2 + np.arctan2(sine, k2)) / cell - 0.5
        width = 4.2 / (np.sqrt(steepness) * cell) + 0.5
        for j in range(int(np.ceil(middle - width)), int(np.floor(middle + width)) + 1):
            d2 = (j + 0.5) * cell - mean_2
            value = np.exp(row - k2 * (1.0 - np.cos(d2)) + sine * np.sin(d2))
            total += value
            m1 += value * d1
            m2 += value * d2
            s11 += value * d1 * d1
            s22 += value * d2 * d2
            s12 += value * d1 * d2
    total = max(total, 1e-30)
    sums[0] = np.log(total * cell * cell)
    sums[1], sums[2] = m1 / total, m2 / total
    sums[3], sums[4], sums[5] = s11 / total, s22 / total, s12 / total
    if swapped:
        sums[1], sums[2], sums[3], sums[4] = sums[2], sums[1], sums[4], sums[3]


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
def _tiles(mean, half):  # type: ignore[no-untyped-def]
    """Give the first of the tiles along one angle that a range covers, and how many they are."""
    width = TWO_PI / TILES
    first = int(np.floor((mean - half) / width))
    count = int(np.floor((mean + half) / width)) - first + 1
    if count >= TILES:
        return 0, TILES
    return first % TILES, count


@jit
def _find_runs(component, cell, start, runs):  # type: ignore[no-untyped-def]
    """List where a component's points lie, [first, last, size] a row; return how many rows."""
    x, rows, y, columns = 0, TILES, 0, TILES
    if component[KIND] == MODE:
        k1, k2, c = component[K_1], component[K_2], component[COUPLING]
        # half a block; and where blocks do not fill tiles evenly, a whole one more
        margin = (0.5 * BLOCK + 0.5) * cell
        if round(TWO_PI / cell) % (TILES * BLOCK) != 0:
            margin += BLOCK * cell
        x, rows = _tiles(component[MEAN_1], half_width(k1, k2, c, NEGLIGIBLE) + margin)
        y, columns = _tiles(component[MEAN_2], half_width(k2, k1, c, NEGLIGIBLE) + margin)
    base, n = TILES * TILES, 0
    # blocks are few, and what is sharp does not lie on them
    if not (is_sharp(component, cell) and is_short(component, cell)):
        n = _add_run(start[0], start[base], 0, runs, 0)
    if rows == TILES and columns == TILES:
        return _add_run(start[base], start[2 * base], 1, runs, n)
    for a in range(x, x + rows):
        row = base + a % TILES * TILES
        end = min(y + columns, TILES)
        n = _add_run(start[row + y], start[row + end], 1, runs, n)
        if y + columns > TILES:
            n = _add_run(start[row], start[row + y + columns - TILES], 1, runs, n)
    return n


@jit
def _add_run(first, last, level, runs, n):  # type: ignore[no-untyped-def]
    """Append a run unless it is empty; return the number of runs."""
    if last > first:
        runs[n, 0], runs[n, 1], runs[n, 2] = first, last, level
        n += 1
    return n


@inline
def _mode_run(points, first, last, s, out, total):  # type: ignore[no-untyped-def]
    """Write a mode's density at points, and add it to the mixture's."""
    sin_1, cos_1, sin_2, cos_2, k_1, k_2, coupling, scale = s
    for n in range(first, last):
        s1 = points[0, n] * cos_1 - points[1, n] * sin_1
        c1 = points[1, n] * cos_1 + points[0, n] * sin_1
        s2 = points[2, n] * cos_2 - points[3, n] * sin_2
        c2 = points[3, n] * cos_2 + points[2, n] * sin_2
        value = _exp(k_1 * (c1 - _ONE) + k_2 * (c2 - _ONE) + coupling * s1 * s2 + scale)
        out[n] = value
    # a loop that writes two arrays is not vectorised: too many of them might overlap
    for n in range(first, last):
        total[n] += out[n]


@inline
def _band_run(points, first, last, s, out, total):  # type: ignore[no-untyped-def]
    """As `_mode_run`, of a band."""
    sin_1, cos_1, sin_2, cos_2, across, along, scale = s
    for n in range(first, last):
        # psi = heading_l - heading_r + pi: its sine and cosine are those of the difference, negated
        sin_psi = points[1, n] * points[2, n] - points[0, n] * points[3, n]
        cos_psi = -points[1, n] * points[3, n] - points[0, n] * points[2, n]
        c1 = cos_psi * cos_1 + sin_psi * sin_1
        c2 = points[1, n] * cos_2 + points[0, n] * sin_2
        value = _exp(across * (c1 - _ONE) + along * (c2 - _ONE) + scale)
        out[n] = value
    # a loop that writes two arrays is not vectorised: too many of them might overlap
    for n in range(first, last):
        total[n] += out[n]


@jit
def _evaluate(points, runs, count, cell, component, out, total):  # type: ignore[no-untyped-def]
    """Write a component's weighted density at its points, and add it to the mixture's."""
    k1, k2, c = component[K_1], component[K_2], component[COUPLING]
    peak = np.log(max(component[WEIGHT], 1e-30))
    sums = np.empty(6)
    if component[KIND] == MODE:
        if is_sharp(component, cell):
            sum_over_cells(component, cell, sums)
            peak -= sums[0]
        else:
            peak -= log_normalizer(k1, k2, c)
    else:
        peak -= np.log(TWO_PI * _i0e(k2))
        if is_sharp(component, cell):
            sum_over_diagonals(component, cell, sums)
            peak -= sums[0]
        else:
            peak -= np.log(TWO_PI * _i0e(k1))
    sin_1, cos_1 = np.float32(np.sin(component[MEAN_1])), np.float32(np.cos(component[MEAN_1]))
    sin_2, cos_2 = np.float32(np.sin(component[MEAN_2])), np.float32(np.cos(component[MEAN_2]))
    for r in range(count):
        # tails of what is narrower than a block do not reach into it
        blur = _blur(runs[r, 2], cell) if max(k1, k2) * (2.0 * cell) ** 2 < 1.0 else 0.0
        if component[KIND] == MODE:
            # the inverse of (inverse of the precision + blur)
            determinant = k1 * k2 - c * c
            wider = 1.0 + blur * (k1 + k2) + blur * blur * determinant
            blurred = (
                sin_1,
                cos_1,
                sin_2,
                cos_2,
                np.float32((k1 + blur * determinant) / wider),
                np.float32((k2 + blur * determinant) / wider),
                np.float32(c / wider),
                np.float32(peak - 0.5 * np.log(wider)),
            )
            _mode_run(points, runs[r, 0], runs[r, 1], blurred, out, total)
        else:
            wider = 1.0 + 2.0 * blur * k1
            band = (
                sin_1,
                cos_1,
                sin_2,
                cos_2,
                np.float32(k1 / wider),
                np.float32(k2),
                np.float32(peak - 0.5 * np.log(wider)),
            )
            _band_run(points, runs[r, 0], runs[r, 1], band, out, total)


@jit
def _expect(points, start, cell, components, count, uniform, run_rows, num_runs, scratch, total):  # type: ignore[no-untyped-def]
    """Evaluate all components, and their sum."""
    size = total.shape[0]
    base = np.float32(uniform / (TWO_PI * TWO_PI))
    for n in range(size):
        total[n] = base
    for k in range(count):
        num_runs[k] = _find_runs(components[k], cell, start, run_rows[k])
        _evaluate(points, run_rows[k], num_runs[k], cell, components[k], scratch[k], total)


@jit
def _cross_entropy(points, total):  # type: ignore[no-untyped-def]
    """Mean of minus the log of the density over the grid's probability."""
    value = 0.0
    for n in range(total.shape[0]):
        value -= np.float64(points[4, n]) * np.log(np.float64(total[n]))
    return value


@inline
def _mode_moments(points, factors, first, last, component, density, out):  # type: ignore[no-untyped-def]
    """Sum a mode's moments about its mean over points, weighted with its share of them."""
    sin_1, cos_1 = np.float32(np.sin(component[MEAN_1])), np.float32(np.cos(component[MEAN_1]))
    sin_2, cos_2 = np.float32(np.sin(component[MEAN_2])), np.float32(np.cos(component[MEAN_2]))
    mass, m1, m2, u1, u2 = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    s11, s22, s12, t1, t2, quartic = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    for n in range(first, last):
        s1 = points[0, n] * cos_1 - points[1, n] * sin_1
        c1 = points[1, n] * cos_1 + points[0, n] * sin_1
        s2 = points[2, n] * cos_2 - points[3, n] * sin_2
        c2 = points[3, n] * cos_2 + points[2, n] * sin_2
        share = factors[n] * density[n]
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
def _band_moments(points, factors, first, last, component, density, out):  # type: ignore[no-untyped-def]
    """Sum a band's sines and cosines about its means over points."""
    sin_1, cos_1 = np.float32(np.sin(component[MEAN_1])), np.float32(np.cos(component[MEAN_1]))
    sin_2, cos_2 = np.float32(np.sin(component[MEAN_2])), np.float32(np.cos(component[MEAN_2]))
    mass, m1, m2, u1, u2 = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    for n in range(first, last):
        sin_psi = points[1, n] * points[2, n] - points[0, n] * points[3, n]
        cos_psi = -points[1, n] * points[3, n] - points[0, n] * points[2, n]
        share = factors[n] * density[n]
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
def set_covariance(covariance, component):  # type: ignore[no-untyped-def]
    """Set a mode's concentrations and coupling by a small covariance [s11, s22, s12]."""
    s11, s22, s12 = covariance[0], covariance[1], covariance[2]
    determinant = s11 * s22 - s12 * s12
    component[K_1], component[K_2] = s22 / determinant, s11 / determinant
    limit = LARGEST_CORRELATION * np.sqrt(component[K_1] * component[K_2])
    component[COUPLING] = min(max(s12 / determinant, -limit), limit)


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
    component[K_2] = concentration(max(spread_2, 1e-3))
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
def find_band(prob, diagonals, component):  # type: ignore[no-untyped-def]
    """Make a band of the rotation that holds most; return whether it holds much, at many headings.

    ``diagonals`` (B,): the probability of each (i - j) % B.
    """
    bins = prob.shape[0]
    cell = TWO_PI / bins
    most, peak = 0.0, 0
    for k in range(bins):
        near = diagonals[k - 1] + diagonals[k] + diagonals[(k + 1) % bins]
        if near > most:
            most, peak = near, k
    if most < BAND_SHARE:
        return False
    mass, m1, s11, sine, cosine = 0.0, 0.0, 0.0, 0.0, 0.0
    for offset in range(-3, 4):
        for i in range(bins):
            value = prob[i, (i - peak - offset) % bins]
            mass += value
            m1 += value * offset
            s11 += value * offset * offset
            sine += value * np.sin((i + 0.5) * cell)
            cosine += value * np.cos((i + 0.5) * cell)
    length = np.sqrt(sine * sine + cosine * cosine) / mass
    if length > BAND_LENGTH:
        return False
    m1 /= mass
    component[KIND] = BAND
    component[WEIGHT] = 0.5 * mass
    component[MEAN_1] = np.pi + (peak + m1) * cell
    component[MEAN_2] = np.arctan2(sine, cosine)
    component[K_1] = 1.0 / (max(s11 / mass - m1 * m1, 0.25) * cell * cell)
    component[K_2] = concentration(1.0 - length)
    component[COUPLING] = 0.0
    return True


@jit
def _maximize(points, cell, components, count, run_rows, num_runs, scratch, total):  # type: ignore[no-untyped-def]
    """Set all components from their shares of the points; return the uniform weight."""
    for n in range(total.shape[0]):
        total[n] = points[4, n] / total[n]
    moments = np.empty(MOMENTS)
    rest = 1.0
    for k in range(count):
        moments[:] = 0.0
        component = components[k]
        blur = 0.0
        for r in range(num_runs[k]):
            first, last, level = run_rows[k, r, 0], run_rows[k, r, 1], run_rows[k, r, 2]
            if component[KIND] == MODE:
                mass = _mode_moments(points, total, first, last, component, scratch[k], moments)
            else:
                mass = _band_moments(points, total, first, last, component, scratch[k], moments)
            blur += mass * _blur(level, cell)
        blur /= max(moments[0], 1e-12)
        least = least_variance(blur, cell)
        if component[KIND] == MODE:
            if is_sharp(component, cell) and is_short(component, cell):
                update_sharp_mode(moments, cell, least, component)
            else:
                update_mode(moments, blur, least, component)
        else:
            update_band(moments, 2.0 * blur, cell, least, component)
        rest -= component[WEIGHT]
    return max(rest, 1e-9)


@jit
def _find_missing(points, start, cell, total, gains, best):  # type: ignore[no-untyped-def]
    """Sum, over each tile, the nats that the mixture lacks; and find its worst point."""
    gains[:] = _ZERO
    best[:] = -1
    for level in range(LEVELS):
        area = np.float32(_side(level, cell) ** 2)
        for tile in range(TILES * TILES):
            segment = level * TILES * TILES + tile
            worst, place, sum_ = _ZERO, -1, _ZERO
            for n in range(start[segment], start[segment + 1]):
                ratio = points[4, n] / (total[n] * area)
                if ratio > _ONE:
                    gain = points[4, n] * _rough_log(ratio)
                    sum_ += gain
                    if gain > worst:
                        worst, place = gain, n
            if sum_ > _ZERO:
                if best[tile] < 0 or worst > gains[TILES * TILES + tile]:
                    best[tile] = place
                    gains[TILES * TILES + tile] = worst
                gains[tile] += sum_


@jit
def _seed(points, start, cell, total, center, tile, component):  # type: ignore[no-untyped-def]
    """Make a mode of what the mixture lacks around a point; return its weight."""
    sin_1, cos_1 = points[0, center], points[1, center]
    sin_2, cos_2 = points[2, center], points[3, center]
    nearest = np.float32(np.cos(NEARBY))
    x, y = tile // TILES, tile % TILES
    mass, m1, m2, s11, s22, s12, blur = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for level in range(LEVELS):
        area = np.float32(_side(level, cell) ** 2)
        for a in range(x + TILES - 1, x + TILES + 2):
            for b in range(y + TILES - 1, y + TILES + 2):
                segment = (level * TILES + a % TILES) * TILES + b % TILES
                for n in range(start[segment], start[segment + 1]):
                    excess = points[4, n] - total[n] * area
                    if excess <= 0.0:
                        continue
                    c1 = points[1, n] * cos_1 + points[0, n] * sin_1
                    c2 = points[3, n] * cos_2 + points[2, n] * sin_2
                    if c1 < nearest or c2 < nearest:
                        continue
                    s1 = points[0, n] * cos_1 - points[1, n] * sin_1
                    s2 = points[2, n] * cos_2 - points[3, n] * sin_2
                    mass += excess
                    m1 += excess * s1
                    m2 += excess * s2
                    s11 += excess * s1 * s1
                    s22 += excess * s2 * s2
                    s12 += excess * s1 * s2
                    blur += excess * _blur(level, cell)
    if mass < 1e-7:
        return 0.0
    m1, m2 = m1 / mass, m2 / mass
    sharp = np.empty(3)
    s11, s22, s12 = s11 / mass - m1 * m1, s22 / mass - m2 * m2, s12 / mass - m1 * m2
    sharpen(s11, s22, s12, 0.0, max((0.4 * cell) ** 2, 3.0 * blur / mass), sharp)
    component[WEIGHT] = mass
    component[MEAN_1] = np.arctan2(sin_1, cos_1) + m1
    component[MEAN_2] = np.arctan2(sin_2, cos_2) + m2
    set_covariance(sharp, component)
    component[KIND] = MODE
    return mass


@jit
def _add_modes(points, start, cell, total, components, count, room, worth, gains, best):  # type: ignore[no-untyped-def]
    """Add modes where most is missing; return their number and their weight."""
    _find_missing(points, start, cell, total, gains, best)
    fresh, taken = 0, 0.0
    tiles = TILES * TILES
    while fresh < room:
        tile = int(np.argmax(gains[:tiles]))
        gain = gains[tile]
        if gain <= worth:
            break
        # the neighbours share what is missing here
        x, y = tile // TILES, tile % TILES
        for a in range(x + TILES - 1, x + TILES + 2):
            for b in range(y + TILES - 1, y + TILES + 2):
                gains[a % TILES * TILES + b % TILES] = _ZERO
        mass = _seed(points, start, cell, total, best[tile], tile, components[count + fresh])
        if mass > 0.0:
            taken += mass
            fresh += 1
    return fresh, taken


@jit
def fit(  # type: ignore[no-untyped-def]
    information, cell, points, start, run_rows, num_runs, scratch, total, components, count, options
):
    """Add modes where most is missing until the divergence is small, or too little is gained.

    ``components`` (limit, COLUMNS): ``count`` of them are given. ``options`` (5,): the divergence
    that is small, the least gain of a component, modes added at once at least, steps after each
    addition, what a tile must lack to be worth a mode. Returns how many components there are in
    the end, the uniform weight and the divergence.
    """
    target, least_gain, added, steps, worth = options
    base = information - 2.0 * np.log(cell)
    limit = components.shape[0]
    uniform = 1.0
    for k in range(count):
        uniform -= components[k, WEIGHT]
    gains = np.empty(2 * TILES * TILES, dtype=np.float32)
    best = np.empty(TILES * TILES, dtype=np.int64)
    _expect(points, start, cell, components, count, uniform, run_rows, num_runs, scratch, total)
    divergence = base + _cross_entropy(points, total)
    disappointed = False
    while divergence > target and count < limit:
        room = min(max(int(added), count), limit - count)
        fresh, taken = _add_modes(
            points, start, cell, total, components, count, room, worth, gains, best
        )
        if fresh == 0:
            break
        # what is missing in one place is too much elsewhere
        keep = 1.0 / (1.0 + taken)
        count += fresh
        for k in range(count):
            components[k, WEIGHT] *= keep
        uniform *= keep
        _expect(points, start, cell, components, count, uniform, run_rows, num_runs, scratch, total)
        for _ in range(int(steps)):
            uniform = _maximize(points, cell, components, count, run_rows, num_runs, scratch, total)
            _expect(
                points, start, cell, components, count, uniform, run_rows, num_runs, scratch, total
            )
        before = divergence
        divergence = base + _cross_entropy(points, total)
        # modes that are nearly one need a second round to part
        little = before - divergence < least_gain * fresh
        if little and disappointed:
            break
        disappointed = little
    # nothing more may be added: improve what there is
    for _ in range(POLISHES):
        if divergence <= target:
            break
        for _ in range(POLISHES):
            uniform = _maximize(points, cell, components, count, run_rows, num_runs, scratch, total)
            _expect(
                points, start, cell, components, count, uniform, run_rows, num_runs, scratch, total
            )
        before = divergence
        divergence = base + _cross_entropy(points, total)
        if before - divergence < 0.05 * divergence:
            break
    return count, uniform, divergence
