"""The kernels of simulated correspondences: random numbers, scenes, cameras and their noise.

The random numbers are a stream of one 64-bit counter. What is drawn for a pair, in this order:
the room (box only), where L and R stand, how they are turned, how R is tilted; then for every
correspondence the landmark of L, the noise of L, the landmark of R (mismatches only) and its noise.

A camera is a tuple: its position x, y and the cosines and sines of its heading, roll and pitch.
A room is a tuple: where its walls stand in x and in y, and the heights of its floor and ceiling.
"""

from __future__ import annotations

import numpy as np

from pflut._jit import jit
from pflut._random import uniform
from pflut._trig import fast_arctan2
from pflut.geometry import TWO_PI

# a room's distances from the origin, and what a camera keeps from its walls, in the unit circle's
# radii
NEAREST_WALL, FARTHEST_WALL = 1.2, 3.0
NEAREST_LEVEL, FARTHEST_LEVEL = 0.4, 1.2
CLEARANCE = 0.2

# two limited fields of view share a landmark within so many tries, or the pair is drawn anew; a
# sample gives up after so many pairs one after the other
LANDMARKS_TRIED = 2000
PAIRS_TRIED = 1000


@jit
def _between(state, low, high):  # type: ignore[no-untyped-def]
    """Draw from [low, high)."""
    return low + (high - low) * uniform(state)


@jit
def _two_normals(state):  # type: ignore[no-untyped-def]
    """Draw two independent standard normals (Marsaglia's polar method)."""
    while True:
        a = 2.0 * uniform(state) - 1.0
        b = 2.0 * uniform(state) - 1.0
        s = a * a + b * b
        if 0.0 < s < 1.0:
            scale = np.sqrt(-2.0 * np.log(s) / s)
            return scale * a, scale * b


@jit
def _ball_point(state, radius):  # type: ignore[no-untyped-def]
    """Draw a point uniform in a ball by rejection from the cube."""
    while True:
        x = 2.0 * uniform(state) - 1.0
        y = 2.0 * uniform(state) - 1.0
        z = 2.0 * uniform(state) - 1.0
        if x * x + y * y + z * z <= 1.0:
            return radius * x, radius * y, radius * z


@jit
def _box_point(state, room):  # type: ignore[no-untyped-def]
    """Draw a point uniform on the walls, the floor and the ceiling of a room."""
    west, east, south, north, floor, ceiling = room
    width, depth, height = east - west, north - south, ceiling - floor
    side, front, level = depth * height, width * height, width * depth
    at = (side + front + level) * uniform(state)
    a = uniform(state)
    b = 2.0 * uniform(state)
    # selections instead of branches: which of the six it is cannot be predicted
    opposite = 1.0 if b >= 1.0 else 0.0
    b -= opposite
    on_side, on_level = at < side, at >= side + front
    along_x = opposite if on_side else a
    along_y = b if on_level else opposite
    along_y = a if on_side else along_y
    along_z = opposite if on_level else b
    return west + width * along_x, south + depth * along_y, floor + height * along_z


@jit
def _landmark(state, box, radius, room):  # type: ignore[no-untyped-def]
    """Draw a landmark of the scene."""
    if box:
        return _box_point(state, room)
    return _ball_point(state, radius)


@jit
def _scene(state, box):  # type: ignore[no-untyped-def]
    """Draw a room, and the two positions; the ball has no room, and its cameras a circle."""
    if box:
        west = -_between(state, NEAREST_WALL, FARTHEST_WALL)
        east = _between(state, NEAREST_WALL, FARTHEST_WALL)
        south = -_between(state, NEAREST_WALL, FARTHEST_WALL)
        north = _between(state, NEAREST_WALL, FARTHEST_WALL)
        floor = -_between(state, NEAREST_LEVEL, FARTHEST_LEVEL)
        ceiling = _between(state, NEAREST_LEVEL, FARTHEST_LEVEL)
        x_l = _between(state, west + CLEARANCE, east - CLEARANCE)
        y_l = _between(state, south + CLEARANCE, north - CLEARANCE)
        x_r = _between(state, west + CLEARANCE, east - CLEARANCE)
        y_r = _between(state, south + CLEARANCE, north - CLEARANCE)
        return (west, east, south, north, floor, ceiling), x_l, y_l, x_r, y_r
    angle_l = TWO_PI * uniform(state)
    angle_r = TWO_PI * uniform(state)
    room = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return room, np.cos(angle_l), np.sin(angle_l), np.cos(angle_r), np.sin(angle_r)


@jit
def _pair(state, box, alike, max_turn, max_tilt):  # type: ignore[no-untyped-def]
    """Draw a room and two cameras, of any headings or looking alike; with the true headings."""
    room, x_l, y_l, x_r, y_r = _scene(state, box)
    yaw_l = TWO_PI * uniform(state)
    turn = uniform(state)
    yaw_r = yaw_l + max_turn * (2.0 * turn - 1.0) if alike else TWO_PI * turn
    roll = max_tilt * (2.0 * uniform(state) - 1.0)
    pitch = max_tilt * (2.0 * uniform(state) - 1.0)
    camera_l = (x_l, y_l, np.cos(yaw_l), np.sin(yaw_l))
    camera_r = (
        x_r,
        y_r,
        np.cos(yaw_r),
        np.sin(yaw_r),
        np.cos(roll),
        np.sin(roll),
        np.cos(pitch),
        np.sin(pitch),
    )
    direction = np.arctan2(y_r - y_l, x_r - x_l)
    theta = (direction - yaw_l) % TWO_PI
    phi = (direction + np.pi - yaw_r) % TWO_PI
    return room, camera_l, camera_r, theta, phi


@jit
def _noisy_bearing(state, x, y, z, noise, cos_roll, sin_roll, cos_pitch, sin_pitch):  # type: ignore[no-untyped-def]
    """Project a point given in the camera's frame: tilt, noise, then azimuth and slope."""
    y, z = cos_roll * y - sin_roll * z, sin_roll * y + cos_roll * z
    x, z = cos_pitch * x + sin_pitch * z, cos_pitch * z - sin_pitch * x
    planar = np.sqrt(x * x + y * y)
    # The noise lies in the sphere's tangent plane: across, and towards the zenith. Everything is
    # scaled by the landmark's distance, which cancels in both angles.
    across, upward = _two_normals(state)
    across *= noise * np.sqrt(planar * planar + z * z)
    radial = planar - noise * upward * z
    height = z + noise * upward * planar
    azimuth = fast_arctan2(y * radial + x * across, x * radial - y * across)
    return azimuth, height / np.sqrt(radial * radial + across * across)


@jit
def _noisy_image_point(state, left, up, noise):  # type: ignore[no-untyped-def]
    """Move a point of the image plane at unit focal length by noise: azimuth and slope."""
    across, upward = _two_normals(state)
    left += noise * across
    up += noise * upward
    return fast_arctan2(left, 1.0), up / np.sqrt(1.0 + left * left)


@jit
def _candidate(state, box, radius, room):  # type: ignore[no-untyped-def]
    """Draw a point that is a landmark of the scene unless it is said not to be one."""
    if box:
        x, y, z = _box_point(state, room)
        return True, x, y, z
    x = 2.0 * uniform(state) - 1.0
    y = 2.0 * uniform(state) - 1.0
    z = 2.0 * uniform(state) - 1.0
    return x * x + y * y + z * z <= 1.0, radius * x, radius * y, radius * z


@jit
def _shared_landmark(state, box, radius, room, camera_l, camera_r, half_width, half_height):  # type: ignore[no-untyped-def]
    """Draw a landmark that both see: whether there was one, and left and up in both images."""
    x_l, y_l, cos_l, sin_l = camera_l
    x_r, y_r, cos_r, sin_r, cos_roll, sin_roll, cos_pitch, sin_pitch = camera_r
    for _ in range(LANDMARKS_TRIED):
        seen, x, y, z = _candidate(state, box, radius, room)
        dx, dy = x - x_l, y - y_l
        ahead_l, left_l = cos_l * dx + sin_l * dy, cos_l * dy - sin_l * dx
        dx, dy = x - x_r, y - y_r
        ahead_r, left_r = cos_r * dx + sin_r * dy, cos_r * dy - sin_r * dx
        left_r, up_r = cos_roll * left_r - sin_roll * z, sin_roll * left_r + cos_roll * z
        ahead_r, up_r = (
            cos_pitch * ahead_r + sin_pitch * up_r,
            cos_pitch * up_r - sin_pitch * ahead_r,
        )
        # one branch that is rarely taken costs less than six that nobody can predict
        seen &= (ahead_l > 0.0) & (ahead_r > 0.0)
        seen &= (abs(left_l) <= half_width * ahead_l) & (abs(z) <= half_height * ahead_l)
        seen &= (abs(left_r) <= half_width * ahead_r) & (abs(up_r) <= half_height * ahead_r)
        if seen:
            return True, left_l / ahead_l, z / ahead_l, left_r / ahead_r, up_r / ahead_r
    return False, 0.0, 0.0, 0.0, 0.0


@jit
def simulate_panoramas(state, box, mismatch, noise, max_tilt, radius, headings, bearings):  # type: ignore[no-untyped-def]
    """Fill headings (pairs, 2) and bearings (pairs, n, 4: azimuth and slope of L, then of R)."""
    pairs, n, _ = bearings.shape
    num_mismatches = int(np.round(mismatch * n))
    for p in range(pairs):
        room, camera_l, camera_r, headings[p, 0], headings[p, 1] = _pair(
            state, box, False, 0.0, max_tilt
        )
        x_l, y_l, cos_l, sin_l = camera_l
        x_r, y_r, cos_r, sin_r, cos_roll, sin_roll, cos_pitch, sin_pitch = camera_r
        for i in range(n):
            x, y, z = _landmark(state, box, radius, room)
            dx, dy = x - x_l, y - y_l
            bearings[p, i, 0], bearings[p, i, 1] = _noisy_bearing(
                state,
                cos_l * dx + sin_l * dy,
                cos_l * dy - sin_l * dx,
                z,
                noise,
                1.0,
                0.0,
                1.0,
                0.0,
            )
            if i < num_mismatches:
                x, y, z = _landmark(state, box, radius, room)
            dx, dy = x - x_r, y - y_r
            bearings[p, i, 2], bearings[p, i, 3] = _noisy_bearing(
                state,
                cos_r * dx + sin_r * dy,
                cos_r * dy - sin_r * dx,
                z,
                noise,
                cos_roll,
                sin_roll,
                cos_pitch,
                sin_pitch,
            )


@jit
def _fill_images(  # type: ignore[no-untyped-def]
    state,
    box,
    num_mismatches,
    noise,
    radius,
    room,
    camera_l,
    camera_r,
    half_width,
    half_height,
    bearings,
):
    """Fill one pair's bearings (n, 4); and tell whether the two views share enough for it."""
    for i in range(len(bearings)):
        found, left_l, up_l, left_r, up_r = _shared_landmark(
            state, box, radius, room, camera_l, camera_r, half_width, half_height
        )
        if not found:
            return False
        bearings[i, 0], bearings[i, 1] = _noisy_image_point(state, left_l, up_l, noise)
        if i < num_mismatches:
            found, _, _, left_r, up_r = _shared_landmark(
                state, box, radius, room, camera_l, camera_r, half_width, half_height
            )
            if not found:
                return False
        bearings[i, 2], bearings[i, 3] = _noisy_image_point(state, left_r, up_r, noise)
    return True


@jit
def simulate_images(  # type: ignore[no-untyped-def]
    state,
    box,
    mismatch,
    noise,
    max_tilt,
    radius,
    half_width,
    half_height,
    max_turn,
    headings,
    bearings,
):
    """Fill the same for perspective images that look alike; and tell whether it could be done.

    The images reach half_width and half_height from their centre at unit focal length.
    """
    pairs, n, _ = bearings.shape
    num_mismatches = int(np.round(mismatch * n))
    for p in range(pairs):
        filled = False
        tries = 0
        while not filled:
            if tries == PAIRS_TRIED:
                return False
            tries += 1
            room, camera_l, camera_r, headings[p, 0], headings[p, 1] = _pair(
                state, box, True, max_turn, max_tilt
            )
            filled = _fill_images(
                state,
                box,
                num_mismatches,
                noise,
                radius,
                room,
                camera_l,
                camera_r,
                half_width,
                half_height,
                bearings[p],
            )
    return True
