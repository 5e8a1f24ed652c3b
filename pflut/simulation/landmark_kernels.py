"""The kernels of landmark views: what an image shows, and what a matcher makes of two images."""

from __future__ import annotations

import numpy as np

from pflut._jit import inline, jit
from pflut._random import uniform
from pflut.geometry import TWO_PI

CAMERA_HEIGHT = 1.2  # metres, as in the rendered home
LOWEST, HIGHEST = np.tan(np.radians(-40.0)), np.tan(np.radians(50.0))  # slopes of the image's edges
NEAREST, FARTHEST = 0.3, 6.0  # metres from the camera to a landmark
GRAZING = 0.17  # cosine of the angle of view, 80 degrees off the surface's normal
OWN_WALL = 0.01  # metres: a wall as near to a landmark is the one it is on
PERSON_RADIUS, PERSON_HEIGHT = 0.2, 1.75


@inline
def _blocked(x, y, dx, dy, distance, walls):  # type: ignore[no-untyped-def]
    """Say whether a wall crosses the way from (x, y) over (dx, dy)."""
    limit = 1.0 - OWN_WALL / distance
    for k in range(walls.shape[0]):
        ax, ay = walls[k, 0, 0] - x, walls[k, 0, 1] - y
        bx, by = walls[k, 1, 0] - x, walls[k, 1, 1] - y
        side_a, side_b = dx * ay - dy * ax, dx * by - dy * bx
        if side_a * side_b > 0.0 or side_a == side_b:
            continue
        # where along the way: the wall's point that lies on it
        part = side_a / (side_a - side_b)
        cx, cy = ax + part * (bx - ax), ay + part * (by - ay)
        along = (cx * dx + cy * dy) / (distance * distance)
        if 0.0 < along < limit:
            return True
    return False


@inline
def _hidden(x, y, dx, dy, distance, rise, people):  # type: ignore[no-untyped-def]
    """Say whether a person stands in the way."""
    for k in range(people.shape[0]):
        px, py = people[k, 0] - x, people[k, 1] - y
        along = (px * dx + py * dy) / distance
        if not 0.0 < along < distance or abs(dx * py - dy * px) >= PERSON_RADIUS * distance:
            continue
        if CAMERA_HEIGHT + rise * along / distance < PERSON_HEIGHT:
            return True
    return False


@jit
def see(  # type: ignore[no-untyped-def]
    pose, points, facing, walls, people, detected, noise, state, seen, azimuth, elevation, view, log
):
    """Find the landmarks that an image shows, and where.

    Parameters
    ----------
    pose : ndarray of shape (3,)
    points : ndarray of shape (n, 3)
    facing : ndarray of shape (n,)
    walls : ndarray of shape (s, 2, 2)
    people : ndarray of shape (k, 3)
    detected : float
        Share of the visible landmarks that become features.
    noise : float
        Radians, isotropic on the sphere.
    state : ndarray of shape (1,) uint64
        In and out. Draws one number for each visible landmark and two more for a detected one.
    seen : ndarray of shape (n,) bool
        Out: what the image shows. What follows is set there only.
    azimuth, elevation : ndarray of shape (n,)
        Out: bearings in the robot's frame; azimuths not wrapped.
    view : ndarray of shape (n,)
        Out: from which side the surface is seen, radians off its normal.
    log : ndarray of shape (n,)
        Out: logarithm of the distance.
    """
    x, y, heading = pose[0], pose[1], pose[2]
    for i in range(points.shape[0]):
        seen[i] = False
        dx, dy, rise = points[i, 0] - x, points[i, 1] - y, points[i, 2] - CAMERA_HEIGHT
        distance = np.sqrt(dx * dx + dy * dy)
        if distance < NEAREST or distance > FARTHEST:
            continue
        if rise < LOWEST * distance or rise > HIGHEST * distance:
            continue
        nx, ny = np.cos(facing[i]), np.sin(facing[i])
        toward, aside = -(nx * dx + ny * dy), ny * dx - nx * dy
        if toward < GRAZING * distance:
            continue
        if _blocked(x, y, dx, dy, distance, walls):
            continue
        if _hidden(x, y, dx, dy, distance, rise, people):
            continue
        if uniform(state) >= detected:
            continue
        seen[i] = True
        size = noise * np.sqrt(-2.0 * np.log(1.0 - uniform(state)))
        turn = TWO_PI * uniform(state)
        left, up = size * np.cos(turn), size * np.sin(turn)
        # the unit vector, moved along the sphere's two tangents
        length = np.sqrt(distance * distance + rise * rise)
        cos, sin = distance / length, rise / length
        ahead, high = cos - up * sin, sin + up * cos
        azimuth[i] = np.arctan2(dy, dx) - heading + np.arctan2(left, ahead)
        elevation[i] = np.arctan2(high, np.sqrt(ahead * ahead + left * left))
        view[i] = np.arctan2(aside, toward)
        log[i] = np.log(length)


@inline
def _best_alike(j, copies, seen, view_l, log_l, view_r, log_r, turn, scale):  # type: ignore[no-untyped-def]
    """Find what in a reference looks most like a landmark of the image, itself or a copy.

    Returns its number, -1 for none, and by how much it looks more alike than the runner-up.
    """
    best, first, second = -1, 0.0, 0.0
    k = j
    while True:
        if seen[k]:
            unlike = abs(view_l[k] - view_r[j]) / turn + abs(log_l[k] - log_r[j]) / scale
            alike = np.exp(-unlike)
            if alike > first:
                best, first, second = k, alike, first
            elif alike > second:
                second = alike
        k = copies[k]
        if k == j:
            return best, first - second


@jit
def match(  # type: ignore[no-untyped-def]
    seen_l,
    view_l,
    log_l,
    shown,
    view_r,
    log_r,
    copies,
    gain,
    turn,
    scale,
    wrong,
    state,
    counts,
    pairs,
):
    """Match an image with references.

    Parameters
    ----------
    seen_l, view_l, log_l : ndarray of shape (m, n)
        Of the references, as of ``see``.
    shown : ndarray of shape (k,) int
        The landmarks that the image shows.
    view_r, log_r : ndarray of shape (n,)
        Of the image.
    copies : ndarray of shape (n,) int
        Ring of the landmarks that look alike.
    gain : float
        Probability to match what looks exactly as in the other image, and unlike anything else.
    turn, scale : float
        Radians of view and logarithm of distance that divide this by e.
    wrong : ndarray of shape (m,) int
        So many mismatches besides, of any feature with any other.
    state : ndarray of shape (1,) uint64
        In and out. Draws one number for each of ``shown`` in each reference that shows the same or
        a copy, then two or more for each of ``wrong``.
    counts : ndarray of shape (m,) int
        Out: matches of each reference.
    pairs : ndarray of shape (at least m k + sum of wrong, 2) int
        Out: landmark in the reference and in the image, one reference after the other.
    """
    total = 0
    for r in range(seen_l.shape[0]):
        start = total
        features = 0
        for i in range(seen_l.shape[1]):
            features += seen_l[r, i]
        for j in shown:
            best, margin = _best_alike(
                j, copies, seen_l[r], view_l[r], log_l[r], view_r, log_r, turn, scale
            )
            if best >= 0 and uniform(state) < gain * margin:
                pairs[total, 0], pairs[total, 1] = best, j
                total += 1
        if features > 1 and shown.size > 0:
            for _ in range(wrong[r]):
                j = shown[int(uniform(state) * shown.size)]
                while True:
                    i = int(uniform(state) * seen_l.shape[1])
                    if seen_l[r, i] and i != j:
                        break
                pairs[total, 0], pairs[total, 1] = i, j
                total += 1
        counts[r] = total - start


@jit
def expect(seen_l, view_l, log_l, shown, view_r, log_r, copies, turn, scale, near, out):  # type: ignore[no-untyped-def]
    """Add up the matches that ``match`` finds on the average with a gain of 1.

    Parameters
    ----------
    seen_l, view_l, log_l, shown, view_r, log_r, copies, turn, scale
        As of ``match``.
    near : ndarray of shape (m,) bool
        The references that count.
    out : ndarray of shape (2,)
        In and out: matches of landmarks with themselves, and with their copies.
    """
    for r in range(seen_l.shape[0]):
        if not near[r]:
            continue
        for j in shown:
            best, margin = _best_alike(
                j, copies, seen_l[r], view_l[r], log_l[r], view_r, log_r, turn, scale
            )
            if best == j:
                out[0] += margin
            elif best >= 0:
                out[1] += margin
