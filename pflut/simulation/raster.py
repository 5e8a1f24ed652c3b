"""The kernels that draw a scene of upright surfaces into a panorama.

Everything in a home is upright or level, so a panorama's column sees the world in one vertical
half-plane: a wall, the side of a box or of a cylinder is hit at one planar distance, whatever
the row; a table top or a rug covers an interval of planar distances at one height. Both cover
an interval of rows, and a depth buffer of a single column decides what is seen.

A scene's surfaces are rows of a float64 array ``(n, COLUMNS)``; the names below are its columns.

Kinds: ``QUAD`` is an upright rectangle from (X, Y) along (UX, UY) for LENGTH, from height Z up to
Z + SIZE; its front lies to the right of (UX, UY), so that textures read from left to right.
``RECTANGLE`` is level at height Z, from the corner (X, Y) along (UX, UY) for LENGTH and to its
left for SIZE; FACING is +1 (seen from above) or -1. ``CYLINDER`` stands at (X, Y) with radius
LENGTH, from Z to Z + SIZE. ``DISC`` is level with radius LENGTH. ``SPHERE`` is an ellipsoid of
revolution with the horizontal radius LENGTH, the vertical one SIZE and its centre at height Z.
"""

from __future__ import annotations

import numpy as np

from pflut._jit import jit

QUAD, RECTANGLE, CYLINDER, DISC, SPHERE = 0, 1, 2, 3, 4

KIND, X, Y, UX, UY, LENGTH, SIZE, Z, FACING = 0, 1, 2, 3, 4, 5, 6, 7, 8
TEXTURE, SCALE_U, SCALE_V, OFFSET_U, OFFSET_V = 9, 10, 11, 12, 13  # repeats a metre, repeats
CUTOUT = 14  # 1: texels with alpha below one half are holes
LIGHT, LIGHT_U, LIGHT_V = 15, 16, 17  # first texel and grid size of its light map
COLUMNS = 18

EPSILON = 1e-9
NEAREST = 1e-3  # metres: what lies closer to the lens is not drawn


@jit
def surface_spans(surfaces, camera, spans):  # type: ignore[no-untyped-def]
    """Find from where to where each surface is seen, and how close it comes.

    Parameters
    ----------
    surfaces : ndarray of shape (n, COLUMNS)
    camera : ndarray of shape (3,)
        x, y and height of the lens in metres.
    spans : ndarray of shape (n, 3)
        Out: the first azimuth in radians, the width counter-clockwise in radians (negative:
        turned away, never seen), and the smallest planar distance in metres.
    """
    two_pi = 2.0 * np.pi
    for i in range(surfaces.shape[0]):
        s = surfaces[i]
        px, py = s[X] - camera[0], s[Y] - camera[1]
        kind = s[KIND]
        spans[i, 0] = 0.0
        spans[i, 1] = two_pi
        spans[i, 2] = 0.0
        if kind == QUAD:
            side = s[UX] * -py - s[UY] * -px
            if s[FACING] > 0.0 and side >= -EPSILON:
                spans[i, 1] = -1.0
                continue
            along = min(max(-(px * s[UX] + py * s[UY]), 0.0), s[LENGTH])
            spans[i, 2] = np.hypot(px + along * s[UX], py + along * s[UY])
            first = np.arctan2(py, px)
            last = np.arctan2(py + s[LENGTH] * s[UY], px + s[LENGTH] * s[UX])
            width = (first - last) % two_pi  # seen from the front, u runs clockwise
            if width > np.pi:  # the back of a surface with two sides
                first, last = last, first
                width = two_pi - width
            spans[i, 0], spans[i, 1] = last, width
        elif kind == RECTANGLE:
            if (camera[2] - s[Z]) * s[FACING] <= EPSILON:
                spans[i, 1] = -1.0
                continue
            u = -(px * s[UX] + py * s[UY])
            v = -(py * s[UX] - px * s[UY])
            du = max(max(-u, u - s[LENGTH]), 0.0)
            dv = max(max(-v, v - s[SIZE]), 0.0)
            spans[i, 2] = np.hypot(du, dv)
            if spans[i, 2] > 0.0:
                centre = np.arctan2(
                    py + 0.5 * (s[LENGTH] * s[UY] + s[SIZE] * s[UX]),
                    px + 0.5 * (s[LENGTH] * s[UX] - s[SIZE] * s[UY]),
                )
                low, high = 0.0, 0.0
                for corner in range(4):
                    a = s[LENGTH] if corner % 2 else 0.0
                    b = s[SIZE] if corner // 2 else 0.0
                    angle = np.arctan2(py + a * s[UY] + b * s[UX], px + a * s[UX] - b * s[UY])
                    offset = (angle - centre + np.pi) % two_pi - np.pi
                    low, high = min(low, offset), max(high, offset)
                spans[i, 0], spans[i, 1] = centre + low, high - low
        else:
            if kind == DISC and (camera[2] - s[Z]) * s[FACING] <= EPSILON:
                spans[i, 1] = -1.0
                continue
            distance = np.hypot(px, py)
            if distance > s[LENGTH]:
                half = np.arcsin(s[LENGTH] / distance)
                spans[i, 0], spans[i, 1] = np.arctan2(py, px) - half, 2.0 * half
                spans[i, 2] = distance - s[LENGTH]
            elif kind != DISC:  # the lens is inside it
                spans[i, 1] = -1.0


@jit
def _planar_interval(s, px, py, ca, sa):  # type: ignore[no-untyped-def]
    """Intersect a column's ray with a surface's plan: the two planar distances, far < near if none.

    ``px, py`` is the surface's origin seen from the lens, ``ca, sa`` the ray's direction.
    A quad has one distance only, given twice.
    """
    kind = s[KIND]
    if kind == QUAD:
        across = ca * s[UY] - sa * s[UX]
        if abs(across) < EPSILON:
            return 1.0, 0.0
        along = (px * sa - py * ca) / across
        if along < -EPSILON or along > s[LENGTH] + EPSILON:
            return 1.0, 0.0
        distance = (px * s[UY] - py * s[UX]) / across
        return distance, distance
    if kind == RECTANGLE:
        near, far = 0.0, 1e30
        for axis in range(2):
            if axis == 0:
                start, step, size = -(px * s[UX] + py * s[UY]), ca * s[UX] + sa * s[UY], s[LENGTH]
            else:
                start, step, size = px * s[UY] - py * s[UX], sa * s[UX] - ca * s[UY], s[SIZE]
            if abs(step) < EPSILON:
                if start < 0.0 or start > size:
                    return 1.0, 0.0
            else:
                a, b = -start / step, (size - start) / step
                near, far = max(near, min(a, b)), min(far, max(a, b))
        return near, far
    middle = px * ca + py * sa
    inside = s[LENGTH] * s[LENGTH] - (px * px + py * py - middle * middle)
    if inside <= 0.0:
        return 1.0, 0.0
    half = np.sqrt(inside)
    return middle - half, middle + half


@jit
def _texture_position(s, px, py, dx, dy, z):  # type: ignore[no-untyped-def]
    """Give a surface point's own coordinates (u, v) in metres.

    ``dx, dy`` is the point seen from the lens, ``px, py`` the surface's origin, ``z`` its height.
    Upright surfaces count v from the top down, as a picture's rows do.
    """
    kind = s[KIND]
    x, y = dx - px, dy - py
    if kind == QUAD:
        return x * s[UX] + y * s[UY], s[Z] + s[SIZE] - z
    if kind == RECTANGLE:
        return x * s[UX] + y * s[UY], y * s[UX] - x * s[UY]
    if kind == DISC:
        return x * s[UX] + y * s[UY] + s[LENGTH], y * s[UX] - x * s[UY] + s[LENGTH]
    angle = np.arctan2(y * s[UX] - x * s[UY], x * s[UX] + y * s[UY]) + np.pi
    if kind == CYLINDER:
        return angle * s[LENGTH], s[Z] + s[SIZE] - z
    rise = min(max((z - s[Z]) / s[SIZE], -1.0), 1.0)
    return angle * s[LENGTH], np.arccos(rise) * s[SIZE]


@jit
def _sample(texels, start, log_w, log_h, u, v, rgb):  # type: ignore[no-untyped-def]
    """Sample one level of a texture bilinearly; it repeats. Squares: texels hold square roots."""
    w, h = 1 << log_w, 1 << log_h
    x = u * w - 0.5
    y = v * h - 0.5
    x0, y0 = int(np.floor(x)), int(np.floor(y))
    fx, fy = x - x0, y - y0
    left, right = x0 & (w - 1), (x0 + 1) & (w - 1)
    top, bottom = start + ((y0 & (h - 1)) << log_w), start + (((y0 + 1) & (h - 1)) << log_w)
    a, b = (1.0 - fx) * (1.0 - fy), fx * (1.0 - fy)
    c, d = (1.0 - fx) * fy, fx * fy
    for channel in range(3):
        value = (
            a * texels[top + left, channel]
            + b * texels[top + right, channel]
            + c * texels[bottom + left, channel]
            + d * texels[bottom + right, channel]
        ) * (1.0 / 255.0)
        rgb[channel] = value * value


@jit
def _light(lights, s, u, v, rgb):  # type: ignore[no-untyped-def]
    """Interpolate a surface's light map at its point (u, v); clamped at the borders."""
    nu, nv = int(s[LIGHT_U]), int(s[LIGHT_V])
    kind = s[KIND]
    u_size, v_size = s[LENGTH], s[SIZE]
    if kind in (CYLINDER, SPHERE):
        u_size = 2.0 * np.pi * s[LENGTH]
        if kind == SPHERE:
            v_size = np.pi * s[SIZE]
    elif kind == DISC:
        u_size = v_size = 2.0 * s[LENGTH]
    x = min(max(u / u_size, 0.0), 1.0) * (nu - 1)
    y = min(max(v / v_size, 0.0), 1.0) * (nv - 1)
    x0, y0 = min(int(x), max(nu - 2, 0)), min(int(y), max(nv - 2, 0))
    fx, fy = x - x0, y - y0
    first = int(s[LIGHT]) + y0 * nu + x0
    right = 1 if nu > 1 else 0
    below = nu if nv > 1 else 0
    for channel in range(3):
        rgb[channel] = (1.0 - fy) * (
            (1.0 - fx) * lights[first, channel] + fx * lights[first + right, channel]
        ) + fy * (
            (1.0 - fx) * lights[first + below, channel]
            + fx * lights[first + below + right, channel]
        )


@jit
def _rows_of(s, near, far, height, top, step, rows):  # type: ignore[no-untyped-def]
    """Give the first and the last sampled row that a surface may cover in a column."""
    kind = s[KIND]
    if kind in (QUAD, CYLINDER):
        low, high = (s[Z] - height) / near, (s[Z] + s[SIZE] - height) / near
    elif kind == SPHERE:
        low, high = s[Z] - s[SIZE] - height, s[Z] + s[SIZE] - height
        low /= near if low < 0.0 else far
        high /= near if high > 0.0 else far
    else:
        low, high = (s[Z] - height) / near, (s[Z] - height) / far
        if low > high:
            low, high = high, low
    first = max(int(np.ceil((top - np.arctan(high)) / step)), 0)
    last = min(int(np.floor((top - np.arctan(low)) / step)), rows - 1)
    return first, last


@jit
def _sphere_distance(s, near, far, height, tangent):  # type: ignore[no-untyped-def]
    """Intersect a ray with an ellipsoid's slice, an ellipse between ``near`` and ``far``."""
    squash = (s[LENGTH] / s[SIZE]) ** 2
    middle, half = 0.5 * (near + far), 0.5 * (far - near)
    rise = height - s[Z]
    a = 1.0 + squash * tangent * tangent
    b = squash * rise * tangent - middle
    c = middle * middle + squash * rise * rise - half * half
    if b * b < a * c:
        return 1e30
    distance = (-b - np.sqrt(b * b - a * c)) / a
    return distance if distance > NEAREST else 1e30


@jit
def _is_hole(s, px, py, dx, dy, z, texels, levels):  # type: ignore[no-untyped-def]
    """Say whether a surface's texture is transparent at a point."""
    u, v = _texture_position(s, px, py, dx, dy, z)
    start, log_w, log_h = levels[int(s[TEXTURE]), 0]
    x = int(np.floor((u * s[SCALE_U] + s[OFFSET_U]) * (1 << log_w))) & ((1 << log_w) - 1)
    y = int(np.floor((v * s[SCALE_V] + s[OFFSET_V]) * (1 << log_h))) & ((1 << log_h) - 1)
    return texels[start + (y << log_w) + x, 3] < 128


@jit
def _scan_column(  # type: ignore[no-untyped-def]
    surfaces, spans, order, closed, texels, levels,
    camera, azimuth, top, step, tangents, distance, seen,
):  # fmt: skip
    """Find what a column of samples sees: the planar distance and the surface of each row."""
    rows = tangents.size
    height = camera[2]
    ca, sa = np.cos(azimuth), np.sin(azimuth)
    two_pi = 2.0 * np.pi
    distance[:] = 1e30
    seen[:] = -1
    wall = 1e30
    for k in range(order.size):
        i = order[k]
        if spans[i, 2] > wall:
            break
        offset = azimuth - spans[i, 0] + EPSILON  # the slack closes seams between neighbors
        offset -= two_pi * np.floor(offset / two_pi)
        if offset > spans[i, 1] + 2.0 * EPSILON:
            continue
        s = surfaces[i]
        px, py = s[X] - camera[0], s[Y] - camera[1]
        near, far = _planar_interval(s, px, py, ca, sa)
        if far < near or far < NEAREST:
            continue
        near = max(near, NEAREST)
        kind, solid = s[KIND], s[CUTOUT] == 0.0
        first, last = _rows_of(s, near, far, height, top, step, rows)
        if kind == QUAD and solid and s[Z] <= closed[0] and s[Z] + s[SIZE] >= closed[1]:
            wall = min(wall, near)
        for row in range(first, last + 1):
            if kind in (QUAD, CYLINDER):
                d = near
            elif kind == SPHERE:
                d = _sphere_distance(s, near, far, height, tangents[row])
            else:
                d = (s[Z] - height) / tangents[row]
            if d >= distance[row]:
                continue
            if not solid and _is_hole(
                s, px, py, d * ca, d * sa, height + d * tangents[row], texels, levels
            ):
                continue
            distance[row] = d
            seen[row] = i


@jit
def _shade(  # type: ignore[no-untyped-def]
    s, glow, texels, levels, lights, camera, ca, sa, tangent, d, pixel, rgb, other, light
):  # fmt: skip
    """Give the light that comes from a surface at a planar distance: texture times light.

    ``pixel`` is a pixel's angle in radians; the texture's level of detail is the one whose
    texels are as large as a pixel's footprint, between the longer and the shorter side of it.
    """
    px, py = s[X] - camera[0], s[Y] - camera[1]
    u, v = _texture_position(s, px, py, d * ca, d * sa, camera[2] + d * tangent)
    _light(lights, s, u, v, light)
    secant = np.sqrt(1.0 + tangent * tangent)
    kind = s[KIND]
    if kind == QUAD:
        slope = max(abs(ca * s[UY] - sa * s[UX]), 0.05)
        footprint_u, footprint_v = pixel * d / slope, pixel * d * secant * secant
    elif kind in (RECTANGLE, DISC):
        slope = max(abs(tangent) / secant, 0.05)
        footprint_u, footprint_v = pixel * d, pixel * d * secant / slope
    else:
        footprint_u, footprint_v = pixel * d, pixel * d * secant
    texture = int(s[TEXTURE])
    texels_u = footprint_u * s[SCALE_U] * (1 << levels[texture, 0, 1])
    texels_v = footprint_v * s[SCALE_V] * (1 << levels[texture, 0, 2])
    level = 0.5 * np.log2(max(abs(texels_u * texels_v), 1e-6))
    level = min(max(level, 0.0), levels.shape[1] - 1.001)
    base = int(level)
    blend = level - base
    u = u * s[SCALE_U] + s[OFFSET_U]
    v = v * s[SCALE_V] + s[OFFSET_V]
    start, log_w, log_h = levels[texture, base]
    _sample(texels, start, log_w, log_h, u, v, rgb)
    if blend > 0.0:
        start, log_w, log_h = levels[texture, base + 1]
        _sample(texels, start, log_w, log_h, u, v, other)
        for channel in range(3):
            rgb[channel] += blend * (other[channel] - rgb[channel])
    for channel in range(3):
        rgb[channel] *= light[channel] + glow


@jit
def draw_columns(  # type: ignore[no-untyped-def]
    surfaces, spans, order, closed, texels, levels, lights, emission,
    camera, azimuths, elevations, supersampling, distance, seen, image,
):  # fmt: skip
    """Draw a panorama: a depth buffer per column of samples, then one shading a pixel.

    A pixel whose samples all see one surface is shaded once, in its middle; at edges each sample
    is shaded and the mean taken.

    Parameters
    ----------
    surfaces : ndarray of shape (n, COLUMNS)
    spans : ndarray of shape (n, 3)
        Of ``surface_spans``.
    order : ndarray of shape (k,) int64
        The surfaces to draw by increasing smallest distance.
    closed : ndarray of shape (2,)
        Heights of the floor and the ceiling: a solid quad over all of it hides what is behind.
    texels : ndarray of shape (t, 4) uint8
        Of all textures and levels: red, green, blue (square roots of reflectances) and alpha.
    levels : ndarray of shape (textures, levels, 3) int64
        First texel, log2 of width and log2 of height of each level; a repeated last level
        ends a short pyramid.
    lights : ndarray of shape (l, 3) float32
        Light maps of all surfaces.
    emission : ndarray of shape (n,)
        Light a surface sends out itself, on top of what it reflects.
    camera : ndarray of shape (3,)
        x, y and height of the lens in metres.
    azimuths : ndarray of shape (width * supersampling,)
        World azimuth of each column of samples in radians.
    elevations : ndarray of shape (height * supersampling,)
        Of each row of samples in radians, equally spaced, decreasing.
    supersampling : int
        Samples along each side of a pixel.
    distance, seen : ndarray of shape (supersampling, height * supersampling)
        Scratch, float64 and int64: the planar distance and the surface of each sample.
    image : ndarray of shape (height, width, 3) float32
        Out: the mean of the samples of each pixel (linear light).
    """
    height, width = image.shape[0], image.shape[1]
    n = supersampling
    top = elevations[0]
    step = (top - elevations[-1]) / (elevations.size - 1)
    pixel = step * n
    tangents = np.tan(elevations)
    middles = np.empty(height)
    for y in range(height):
        middles[y] = np.tan(0.5 * (elevations[y * n] + elevations[y * n + n - 1]))
    rgb = np.empty(3)
    other = np.empty(3)
    light = np.empty(3)
    for x in range(width):
        for k in range(n):
            _scan_column(
                surfaces, spans, order, closed, texels, levels, camera,
                azimuths[x * n + k], top, step, tangents, distance[k], seen[k],
            )  # fmt: skip
        azimuth = 0.5 * (azimuths[x * n] + azimuths[x * n + n - 1])
        ca, sa = np.cos(azimuth), np.sin(azimuth)
        for y in range(height):
            first = seen[0, y * n]
            alike = True
            mean = 0.0
            for k in range(n):
                for row in range(y * n, y * n + n):
                    alike = alike and seen[k, row] == first
                    mean += distance[k, row]
            image[y, x] = 0.0
            if alike:
                if first >= 0:
                    _shade(
                        surfaces[first], emission[first], texels, levels, lights, camera,
                        ca, sa, middles[y], mean / (n * n), pixel, rgb, other, light,
                    )  # fmt: skip
                    for channel in range(3):
                        image[y, x, channel] = rgb[channel]
                continue
            for k in range(n):
                ck, sk = np.cos(azimuths[x * n + k]), np.sin(azimuths[x * n + k])
                for row in range(y * n, y * n + n):
                    i = seen[k, row]
                    if i < 0:
                        continue
                    _shade(
                        surfaces[i], emission[i], texels, levels, lights, camera,
                        ck, sk, tangents[row], distance[k, row], pixel, rgb, other, light,
                    )  # fmt: skip
                    for channel in range(3):
                        image[y, x, channel] += rgb[channel] / (n * n)
