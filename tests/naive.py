"""Readable twins of every kernel: what it must compute, in loops and plain formulas.

One part a part of the library: the vision kernels, the simulator, the paper's table, the residual
table, the M-estimator, the sensor model, the simulated home, the homes of landmarks, the particle
filter, mixtures of von Mises distributions. Nothing here is fast, and nothing is taken from pflut
but the names of a surface's columns and the edges of the residual table's cells.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from itertools import combinations
from statistics import NormalDist

import numpy as np

from pflut.likelihood import axes
from pflut.simulation import raster

# --- vision ---------------------------------------------------------------------------------------


def descriptor_distance(a: np.ndarray, b: np.ndarray) -> float:
    """Hamming distance of bytes, else the Euclidean distance."""
    if a.dtype == np.uint8:
        return float(sum(bin(int(x) ^ int(y)).count("1") for x, y in zip(a, b, strict=True)))
    return math.dist(a.astype(float), b.astype(float))


def ratio_matches(
    reference: np.ndarray, query: np.ndarray, ratio: float, mutual: bool
) -> dict[int, tuple[int, float]]:
    """Query index -> (reference index, score): Lowe's ratio test, best taker keeps."""
    if len(reference) < 2:
        return {}
    table = np.array([[descriptor_distance(r, q) for r in reference] for q in query])
    matches: dict[int, tuple[int, float]] = {}
    takers: dict[int, tuple[int, float]] = {}
    for j in range(len(query)):
        first, second = np.argsort(table[j], kind="stable")[:2]
        score = 1.0 if table[j, second] == 0.0 else table[j, first] / table[j, second]
        if score >= ratio or (mutual and np.argmin(table[:, first]) != j):
            continue
        if int(first) not in takers or score < takers[int(first)][1]:
            takers[int(first)] = (j, float(score))
    for i, (j, score) in takers.items():
        matches[j] = (i, score)
    return matches


def distinct(
    descriptors: np.ndarray, pixels: np.ndarray, response: np.ndarray, limit: float
) -> list[bool]:
    """Both of a resembling pair go; of two at one place (3 pixels) only the weaker."""
    n = len(descriptors)
    keep = [True] * n
    for i in range(n):
        for j in range(i + 1, n):
            if descriptor_distance(descriptors[i], descriptors[j]) >= limit:
                continue
            if math.dist(pixels[i], pixels[j]) < 3.0:
                keep[i if response[i] < response[j] else j] = False
            else:
                keep[i] = keep[j] = False
    return keep


def unified_projection(
    vector: tuple[float, float, float], xi: float, k: tuple[float, ...]
) -> tuple[float, float]:
    """The unified model after Mei: sphere, shifted center, Brown's distortion (k1 k2 p1 p2)."""
    x, y, z = (component / math.hypot(*vector) for component in vector)
    x, y = x / (z + xi), y / (z + xi)
    k1, k2, p1, p2 = k
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2 * r2
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )


def ocam_ray(
    u: float,
    v: float,
    center: tuple[float, float],
    polynomial: tuple[float, ...],
    affine: tuple[float, float, float],
) -> tuple[float, float, float]:
    """OCamCalib's cam2world: (row, column, polynomial of the radius), not normalized."""
    c, d, e = affine
    # [row', column'] = [[c, d], [e, 1]] [row, column] + center
    matrix = np.array([[c, d], [e, 1.0]])
    row, column = np.linalg.solve(matrix, [v - center[1], u - center[0]])
    rho = math.hypot(row, column)
    return row, column, sum(a * rho**i for i, a in enumerate(polynomial))


# --- the simulator of correspondences -------------------------------------------------------------


class SplitMix:
    """Sebastiano Vigna's splitmix64 with Python's own integers."""

    def __init__(self, state):
        self.state = int(state)

    def uniform(self):
        mask = 2**64 - 1
        self.state = (self.state + 0x9E3779B97F4A7C15) & mask
        z = self.state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
        return ((z ^ (z >> 31)) >> 11) / 2**53

    def two_normals(self):
        while True:
            a, b = 2 * self.uniform() - 1, 2 * self.uniform() - 1
            s = a * a + b * b
            if 0 < s < 1:
                return a * math.sqrt(-2 * math.log(s) / s), b * math.sqrt(-2 * math.log(s) / s)

    def ball_point(self, radius):
        while True:
            point = np.array([2 * self.uniform() - 1 for _ in range(3)])
            if point @ point <= 1:
                return radius * point

    def cube_point(self, radius):
        """A point of the ball, or None: one try of ball_point."""
        point = np.array([2 * self.uniform() - 1 for _ in range(3)])
        return radius * point if point @ point <= 1 else None

    def room(self):
        """Two opposite corners: 1.2 to 3 away in x and in y, 0.4 to 1.2 in z."""
        lower, upper = np.empty(3), np.empty(3)
        for axis, (nearest, farthest) in enumerate([(1.2, 3.0), (1.2, 3.0), (0.4, 1.2)]):
            lower[axis] = -(nearest + (farthest - nearest) * self.uniform())
            upper[axis] = nearest + (farthest - nearest) * self.uniform()
        return lower, upper

    def room_position(self, lower, upper):
        """Anywhere on the plane, 0.2 from the walls."""
        x, y = (
            low + 0.2 + (high - low - 0.4) * self.uniform()
            for low, high in zip(lower[:2], upper[:2], strict=True)
        )
        return np.array([x, y, 0.0])

    def room_point(self, lower, upper):
        """A pair of opposite faces by its area, then a place on it, then which of the two."""
        size = upper - lower
        areas = [size[1] * size[2], size[0] * size[2], size[0] * size[1]]
        at, first, second = sum(areas) * self.uniform(), self.uniform(), 2 * self.uniform()
        across = 0 if at < areas[0] else 1 if at < areas[0] + areas[1] else 2
        along = [first, second % 1.0]
        along.insert(across, math.floor(second))
        return lower + size * along


def rotation(axis, angle):
    """Rotation matrix about a coordinate axis."""
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = math.cos(angle)
    matrix[j, i], matrix[i, j] = math.sin(angle), -math.sin(angle)
    return matrix


def noisy_bearing(vector, across, upward):
    """Azimuth and slope of a vector's direction, moved in the sphere's tangent plane."""
    x, y, z = np.asarray(vector) / np.linalg.norm(vector)
    planar = math.hypot(x, y)
    east = np.array([-y, x, 0.0]) / planar
    zenith = np.array([-z * x, -z * y, planar**2]) / planar
    x, y, z = np.array([x, y, z]) + across * east + upward * zenith
    return math.atan2(y, x), z / math.hypot(x, y)


def noisy_image_point(vector, across, upward):
    """Azimuth and slope of a vector's image at unit focal length, moved in the image plane."""
    image = np.array([1.0, vector[1] / vector[0] + across, vector[2] / vector[0] + upward])
    return math.atan2(image[1], image[0]), image[2] / math.hypot(image[0], image[1])


def seen_by(vector, field):
    """Whether a vector of the camera's frame lies inside a field of view (across, upward)."""
    x, y, z = vector
    half_width, half_height = (math.tan(angle / 2) for angle in field)
    return x > 0 and abs(y / x) <= half_width and abs(z / x) <= half_height


def simulate(
    state,
    pairs,
    n,
    *,
    mismatch,
    noise,
    max_tilt,
    radius,
    scene="ball",
    field_of_view=None,
    max_turn=0.0,
):
    """Headings (pairs, 2) and bearings (pairs, n, 4), by 3-D vectors and rotation matrices."""
    random = SplitMix(state)
    headings, bearings = np.empty((pairs, 2)), np.empty((pairs, n, 4))

    def pose():
        corners = random.room() if scene == "box" else None
        if corners is None:
            angles = [2 * math.pi * random.uniform() for _ in range(2)]
            left, right = (np.array([math.cos(a), math.sin(a), 0.0]) for a in angles)
        else:
            left, right = (random.room_position(*corners) for _ in range(2))
        yaw_l = 2 * math.pi * random.uniform()
        turn = random.uniform()
        yaw_r = yaw_l + max_turn * (2 * turn - 1) if field_of_view else 2 * math.pi * turn
        roll, pitch = (max_tilt * (2 * random.uniform() - 1) for _ in range(2))
        x, y, _ = right - left
        truth = [math.atan2(y, x) - yaw_l, math.atan2(-y, -x) - yaw_r]
        camera_l = rotation("z", yaw_l)
        camera_r = rotation("z", yaw_r) @ (rotation("y", pitch) @ rotation("x", roll)).T
        return corners, (left, camera_l), (right, camera_r), truth

    def vector(landmark, camera):
        position, world_camera = camera
        return world_camera.T @ (landmark - position)

    def draw(corners, cameras):
        if field_of_view is None:
            return random.room_point(*corners) if corners else random.ball_point(radius)
        for _ in range(2000):
            point = random.room_point(*corners) if corners else random.cube_point(radius)
            if point is not None and all(seen_by(vector(point, c), field_of_view) for c in cameras):
                return point
        return None

    def see(landmark, camera):
        across, upward = (noise * normal for normal in random.two_normals())
        project = noisy_image_point if field_of_view else noisy_bearing
        return project(vector(landmark, camera), across, upward)

    def pair():
        corners, left, right, truth = pose()
        out = np.empty((n, 4))
        for i in range(n):
            landmark = draw(corners, (left, right))
            if landmark is None:
                return None
            out[i, :2] = see(landmark, left)
            if i < round(mismatch * n):
                landmark = draw(corners, (left, right))
                if landmark is None:
                    return None
            out[i, 2:] = see(landmark, right)
        return truth, out

    for p in range(pairs):
        drawn = pair()
        while drawn is None:
            drawn = pair()
        headings[p], bearings[p] = drawn
    return headings % (2 * np.pi), bearings


# --- the paper's table: Algorithms 1 and 2 --------------------------------------------------------


def cell(angle, bins):
    return min(math.floor(angle % (2 * math.pi) / (2 * math.pi) * bins), bins - 1)


def ratio_cell(slope_l, slope_r, ratio_bins):
    """Cell of r and whether the views are exchanged, equations 2 and 10."""
    exchanged = abs(slope_r) > abs(slope_l)
    near, far = (slope_r, slope_l) if exchanged else (slope_l, slope_r)
    r = far / near if near else 0.0
    return min(math.floor((r + 1) / 2 * ratio_bins), ratio_bins - 1), exchanged


def count(headings, bearings, weights, ratio_bins, bins):
    """Algorithm 2, second loop."""
    histogram = np.zeros((ratio_bins, bins, bins))
    for (theta, phi), pair, weight in zip(headings, bearings, weights, strict=True):
        for azimuth_l, slope_l, azimuth_r, slope_r in pair:
            k, exchanged = ratio_cell(slope_l, slope_r, ratio_bins)
            u = (cell(theta, bins) - cell(azimuth_l, bins)) % bins
            v = (cell(phi, bins) - cell(azimuth_r, bins)) % bins
            histogram[(k, v, u) if exchanged else (k, u, v)] += weight
    return histogram


def grid(table, correspondences):
    """Algorithm 1: for every correspondence and every pose, one look-up."""
    ratio_bins, bins, _ = table.shape
    total = np.zeros((bins, bins))
    c = correspondences
    for k in range(len(c)):
        slopes = math.tan(c.elevation_l[k]), math.tan(c.elevation_r[k])
        r, exchanged = ratio_cell(*slopes, ratio_bins)
        left, right = cell(c.azimuth_l[k], bins), cell(c.azimuth_r[k], bins)
        for i in range(bins):
            for j in range(bins):
                u, v = (i - left) % bins, (j - right) % bins
                total[i, j] += table[r, v, u] if exchanged else table[r, u, v]
    return total


def log_ratio(histogram, uniform):
    """Log of p(u, v | r) over the uniform density, mirror images counted alike; no blur."""
    ratio_bins, bins, _ = histogram.shape
    out = np.zeros(histogram.shape)
    for r in range(ratio_bins):
        total = histogram[r].sum()
        for u in range(bins):
            for v in range(bins):
                both = histogram[r, u, v] + histogram[r, -u % bins, -v % bins]
                share = both / (2 * total) * bins**2 if total else 1.0
                out[r, u, v] = math.log((1 - uniform) * share + uniform)
    return out


# --- the residual table ---------------------------------------------------------------------------


def angles_of(correspondences):
    """Bearings as rows: azimuth and elevation of L, then of R."""
    c = correspondences
    return np.stack([c.azimuth_l, c.elevation_l, c.azimuth_r, c.elevation_r], axis=1)


def constraint(bearing, theta, phi):
    """The planar epipolar constraint at poses (arrays); bearing: azimuth and elevation of L, R."""
    azimuth_l, elevation_l, azimuth_r, elevation_r = bearing
    left = np.sin(elevation_r) * np.cos(elevation_l) * np.sin(theta - azimuth_l)
    return left + np.sin(elevation_l) * np.cos(elevation_r) * np.sin(phi - azimuth_r)


def gradient_length(bearing, theta, phi, step=1e-5):
    """Change of the constraint as the two points move by an arc of the sphere, any way."""
    squares = 0.0
    for i in range(4):
        # an azimuth moves the point by cos(elevation) of its own change
        arc = step / np.cos(bearing[i + 1]) if i % 2 == 0 else step
        there, back = np.array(bearing, float), np.array(bearing, float)
        there[i] += arc
        back[i] -= arc
        change = constraint(there, theta, phi) - constraint(back, theta, phi)
        squares = squares + (change / (2 * step)) ** 2
    return np.sqrt(squares)


def residuals(bearing, theta, phi):
    """Distance of a correspondence to the constraint at poses, radians."""
    return constraint(bearing, theta, phi) / gradient_length(bearing, theta, phi)


def residual_slopes(bearing, theta, phi, step=1e-5):
    """Change of the constraint with either heading, in units of the residual."""
    length = gradient_length(bearing, theta, phi)
    by_theta = constraint(bearing, theta + step, phi) - constraint(bearing, theta - step, phi)
    by_phi = constraint(bearing, theta, phi + step) - constraint(bearing, theta, phi - step)
    return by_theta / (2 * step) / length, by_phi / (2 * step) / length


def parallax(bearing, theta, phi):
    """The third angle of the triangle seen from above; NaN for different sides of the base line."""
    u, v = wrap(theta - bearing[0]), wrap(phi - bearing[2])
    return np.where(u * v > 0, np.nan, np.pi - np.abs(u) - np.abs(v))


def looked_up(bearing, theta, phi):
    """The parallax as it is looked up: at the middle of a step of sin(gamma / 2)."""
    step = 2 / axes.PARALLAX_STEPS
    sine = np.sin(parallax(bearing, theta, phi) / 2)
    return 2 * np.arcsin(np.minimum((np.floor((sine + 1) / step) + 0.5) * step - 1, 1))


def parallax_cells(bearing, theta, phi):
    """Cell of the parallax; the first one if the lines of sight diverge or pass on both sides."""
    gamma = looked_up(bearing, theta, phi)
    return sum((gamma >= edge).astype(int) for edge in axes.parallax_edges()[:-1])


def densities(bearing, theta, phi, density):
    """Density ratio of a landmark there, (*poses, C): linear between the middles of the cells."""
    gamma = looked_up(bearing, theta, phi)
    edges = axes.parallax_edges()
    middles = (edges[1:] + edges[:-1]) / 2
    row = density[:, shape(bearing)]
    apart = ~(gamma >= edges[0])
    between = [np.interp(gamma, middles, row[1:, c]) for c in range(row.shape[1])]
    return np.stack([np.where(apart, row[0, c], b) for c, b in enumerate(between)], axis=-1)


def shape(bearing):
    """Cell of the ratio of the slopes and of the larger elevation."""
    low, high = sorted((abs(bearing[1]), abs(bearing[3])))
    r = math.tan(low) / math.tan(high) if high else 0.0
    r = -r if bearing[1] * bearing[3] < 0 else r
    ratio = sum(r >= edge for edge in axes.RATIO_EDGES[1:-1])
    elevation = sum(high >= edge for edge in axes.elevation_edges()[1:-1])
    return ratio * axes.ELEVATION_CELLS + elevation


def agreement(residual, row):
    """Look a profile up: linear between its nodes along the root of the residual."""
    nodes = axes.residual_nodes()
    return np.interp(np.sqrt(np.abs(residual)), np.sqrt(nodes), row, right=0.0)


def ratios(bearing, theta, phi, density, profile, least=0.0):
    """Density ratio of a true match to a mismatch at poses, (*poses, C); 0 far from the curve."""
    row = profile[shape(bearing) % axes.ELEVATION_CELLS]
    height = np.asarray(agreement(residuals(bearing, theta, phi), row))
    height = np.where(height > least, height, 0.0)
    return densities(bearing, theta, phi, density) * height[..., None]


def mean_parallax(bearings, theta, phi, band):
    """Average sin(gamma / 2) of what agrees with a pose and does not diverge."""
    halves = []
    for bearing in bearings:
        if abs(residuals(bearing, theta, phi)) < band and parallax_cells(bearing, theta, phi) > 0:
            sine = np.sin(parallax(bearing, theta, phi) / 2)
            step = 2 / axes.PARALLAX_STEPS
            halves.append(np.floor((sine + 1) / step) * step - 1)
    return np.mean(halves) if halves else 0.0


def count_residuals(bearings, theta, phi, band):
    """Counts of one pair at one pose: (parallax, shape) within the band, (elevation, residual)."""
    shapes = (len(axes.RATIO_EDGES) - 1) * axes.ELEVATION_CELLS
    inside = np.zeros((axes.PARALLAX_CELLS, shapes))
    profile = np.zeros((axes.ELEVATION_CELLS, axes.RESIDUAL_CELLS + 1))
    for bearing in bearings:
        residual = abs(residuals(bearing, theta, phi))
        if residual < band:
            inside[parallax_cells(bearing, theta, phi), shape(bearing)] += 1
        k = sum(residual >= edge for edge in axes.residual_nodes()[1:])
        profile[shape(bearing) % axes.ELEVATION_CELLS, k] += 1
    return inside, profile


def log_likelihood(bearings, odds, theta, phi, density, profile):
    """Log-likelihood ratio of one pose, the mean over the depth classes; and their shares."""
    classes = np.zeros(density.shape[2])
    for bearing, one in zip(bearings, odds, strict=True):
        ratio = ratios(bearing, theta, phi, density, profile)
        classes += np.log((1 + one * ratio) / (1 + one))
    total = np.logaddexp.reduce(classes)
    return total - np.log(len(classes)), np.exp(classes - total)


def climb(bearings, odds, theta, phi, density, profile, least, longest=0.1):
    """One step of expectation maximization: the pose after it, and the information before.

    Of correspondences whose odds times profile are above ``least``.
    """
    _, shares = log_likelihood(bearings, odds, theta, phi, density, profile)
    matrix, vector = np.zeros((2, 2)), np.zeros(2)
    squares = total = 0.0
    for bearing, one in zip(bearings, odds, strict=True):
        ratio = one * ratios(bearing, theta, phi, density, profile, least / one)
        # the probability that it is a true match, over the classes
        weight = shares @ (ratio / (1 + ratio))
        residual = residuals(bearing, theta, phi)
        slopes = np.array(residual_slopes(bearing, theta, phi))
        matrix += weight * np.outer(slopes, slopes)
        vector += weight * slopes * residual
        squares += weight * residual**2
        total += weight
    step = np.linalg.solve(matrix + (1e-6 * np.trace(matrix) + 1e-9) * np.eye(2), vector)
    length = np.linalg.norm(step)
    if length > longest:
        step *= longest / length
    information = [matrix[0, 0], matrix[0, 1], matrix[1, 1], squares, total]
    return np.array([theta, phi]) - step, information


def ridges(bearings, odds, density, profile, bins, samples):
    """Grid of log-likelihood ratios: the mean ratio over each cell, of samples x samples places."""
    steps = (np.arange(bins * samples) + 0.5) * (2 * np.pi / (bins * samples))
    theta, phi = np.meshgrid(steps, steps, indexing="ij")
    mean_density = density.mean(axis=2, keepdims=True)
    total = np.zeros((bins, bins))
    for bearing, one in zip(bearings, odds, strict=True):
        ratio = ratios(bearing, theta, phi, mean_density, profile)
        mean = ratio.reshape(bins, samples, bins, samples).mean(axis=(1, 3))
        total += np.log((1 + one * mean) / (1 + one))
    return total


def local_maxima(grid, margin, most):
    """[row, column, value] of cells higher than their eight neighbours, by a parabola each way."""
    bins = len(grid)
    found = []
    for i in range(bins):
        for j in range(bins):
            value = grid[i, j]
            around = [
                grid[(i + di) % bins, (j + dj) % bins]
                for di in (-1, 0, 1)
                for dj in (-1, 0, 1)
                if di or dj
            ]
            if value < grid.max() - margin or max(around) >= value:
                continue
            place = []
            for before, after in (
                (grid[i - 1, j], grid[(i + 1) % bins, j]),
                (grid[i, j - 1], grid[i, (j + 1) % bins]),
            ):
                # a x^2 + b x + value through (-1, before) and (1, after)
                a, b = (before + after) / 2 - value, (after - before) / 2
                place.append(-b / (2 * a))
            found.append([i + place[0], j + place[1], value])
    return sorted(found, key=lambda row: -row[2])[:most]


# --- the planar epipolar residual and the M-estimator --------------------------------------------


def epipolar_value(bearing, theta, phi):
    """The planar epipolar constraint; bearing: azimuth and elevation of L, then of R."""
    azimuth_l, elevation_l, azimuth_r, elevation_r = bearing
    left = math.sin(elevation_r) * math.cos(elevation_l) * math.sin(theta - azimuth_l)
    return left + math.sin(elevation_l) * math.cos(elevation_r) * math.sin(phi - azimuth_r)


def epipolar_residual(bearing, theta, phi):
    """Value over the length of its gradient on the two spheres, by finite differences."""
    step = 1e-6
    gradient = []
    for i in range(4):
        # an azimuth moves the point by cos(elevation) of its own change
        arc = step / math.cos(bearing[i + 1]) if i % 2 == 0 else step
        moved = [np.array(bearing, float), np.array(bearing, float)]
        moved[0][i] += arc
        moved[1][i] -= arc
        gradient.append(
            (epipolar_value(moved[0], theta, phi) - epipolar_value(moved[1], theta, phi))
            / (2 * step)
        )
    return epipolar_value(bearing, theta, phi) / np.linalg.norm(gradient), np.linalg.norm(gradient)


def planar_depths(bearing, theta, phi):
    """Planar distances of the landmark from L and R, the baseline being one: a linear system."""
    azimuth_l, _, azimuth_r, _ = bearing
    # in a frame with L in the origin and R at (1, 0): directions from L and from R
    left, right = azimuth_l - theta, azimuth_r - phi + math.pi
    rays = [[math.cos(left), -math.cos(right)], [math.sin(left), -math.sin(right)]]
    return np.linalg.solve(rays, [1.0, 0.0])


def biweight_cost(bearings, theta, phi, cutoff):
    """Sum of Tukey's rho over the correspondences, those behind a view at the full penalty."""
    cost = 0.0
    for bearing in bearings:
        ratio = epipolar_residual(bearing, theta, phi)[0] / cutoff
        in_front = (planar_depths(bearing, theta, phi) > 0).all()
        cost += 1 - (1 - ratio**2) ** 3 if in_front and abs(ratio) < 1 else 1.0
    return cost


def count_inliers(bearings, theta, phi, cutoff):
    """Correspondences with a small residual and positive depths."""
    return sum(
        abs(epipolar_residual(b, theta, phi)[0]) < cutoff
        and bool((planar_depths(b, theta, phi) > 0).all())
        for b in bearings
    )


def in_front(bearing, theta, phi, slack=1e-3):
    """Whether both depths are positive, with the benefit of the doubt near the base line."""
    u, v = theta - bearing[0], phi - bearing[2]
    apex = math.sin(u - v)
    if apex == 0:
        return True
    return bool((planar_depths(bearing, theta, phi) * apex**2 >= -slack).all())


def robust_weight(residual, loss, knee, cutoff):
    """rho'(e) / e of the loss, zero beyond the cut-off."""
    if abs(residual) >= cutoff:
        return 0.0
    if loss == "tukey":
        return (1 - (residual / cutoff) ** 2) ** 2
    if loss == "huber":
        return 1.0 if abs(residual) <= knee else knee / abs(residual)
    return 1 / (1 + (residual / knee) ** 2)


def polish(bearings, theta, phi, cutoffs, steps, loss="tukey", knee=0.0):
    """Reweighted least squares with a loss: the pose after so many steps a cut-off."""
    pose = np.array([theta, phi], float)
    for cutoff in cutoffs:
        for _ in range(steps):
            matrix, vector = np.zeros((2, 2)), np.zeros(2)
            for bearing in bearings:
                residual = residuals(bearing, *pose)
                if abs(residual) < cutoff and in_front(bearing, *pose):
                    slopes = np.array(residual_slopes(bearing, *pose))
                    weight = robust_weight(residual, loss, knee, cutoff)
                    matrix += weight * np.outer(slopes, slopes)
                    vector += weight * slopes * residual
            if not matrix.any():
                return pose
            matrix += (1e-6 * np.trace(matrix) + 1e-12) * np.eye(2)
            step = np.linalg.solve(matrix, vector)
            pose -= step * min(1.0, 0.1 / np.linalg.norm(step))
    return pose


def log_false_alarms(inliers, total, share, cutoff, degrees):
    """Log of the number of poses with as many inliers by coincidence: the binomial tail, summed."""
    share = min(max(share, 1 / (16 * max(total, 1))), 1 - 1e-9)
    tail = math.fsum(
        math.comb(total, k) * share**k * (1 - share) ** (total - k)
        for k in range(inliers, total + 1)
    )
    return degrees * math.log(math.pi / cutoff) + math.log(tail)


def judge(bearings, theta, phi, cutoff, shifts):
    """Inliers, and the log of false alarms by mismatches made of the bearings themselves."""
    n = len(bearings)

    def agreeing(rows):
        return sum(
            abs(residuals(row, theta, phi)) < cutoff and in_front(row, theta, phi) for row in rows
        )

    inliers = agreeing(bearings)
    shifts = min(shifts, n - 1)
    if shifts < 1:
        return inliers, 0.0
    by_chance = 0
    for shift in range(1, shifts + 1):
        rows = [[*bearings[i][:2], *bearings[(i + shift) % n][2:]] for i in range(n)]
        by_chance += agreeing(rows)
    return inliers, log_false_alarms(inliers, n, by_chance / (n * shifts), cutoff, 2)


# --- the sensor model ----------------------------------------------------------------------------


def link(log_grid, temperature, linked):
    """What a particle is worth at each relative pose, and at each rotation alone."""
    bins = len(log_grid)
    table, turns = np.empty((bins, bins)), np.empty(bins)
    for i in range(bins):
        for j in range(bins):
            there = math.log(linked) + temperature * log_grid[i, j]
            table[i, j] = np.logaddexp(math.log(1 - linked), there)
    for k in range(bins):
        turns[k] = np.logaddexp.reduce([table[(j + k) % bins, j] for j in range(bins)])
    return table, turns - math.log(bins)


def bilinear(table, x, y):
    """Interpolate a periodic table at fractional cell numbers."""
    rows, columns = table.shape
    i, j = math.floor(x), math.floor(y)
    total = 0.0
    for a, share_a in ((i, 1 - (x - i)), (i + 1, x - i)):
        for b, share_b in ((j, 1 - (y - j)), (j + 1, y - j)):
            total += share_a * share_b * table[a % rows, b % columns]
    return total


def reference_log_likelihood(pose, reference, table, turns, near, ramp, reach):
    """One reference's part of the log-likelihood of one particle."""
    bins = len(table)
    dx, dy = pose[0] - reference[0], pose[1] - reference[1]
    distance = math.hypot(dx, dy)
    if distance >= reach:
        return 0.0
    theta = math.atan2(dy, dx) - reference[2]
    phi = math.atan2(-dy, -dx) - pose[2]
    # the rotation alone decides where the particle stands on the reference
    psi = pose[2] - reference[2]
    value = bilinear(table, theta * bins / (2 * math.pi) - 0.5, phi * bins / (2 * math.pi) - 0.5)
    turned = bilinear(turns[:, None], (psi - math.pi) * bins / (2 * math.pi), 0.0)
    if distance < near:
        t = distance / near
        value = turned + (3 * t**2 - 2 * t**3) * (value - turned)
    return value * min(1.0, (reach - distance) / (reach - ramp))


# --- relative poses as a sensor -------------------------------------------------------------------


def normal_density(values, covariance):
    """The density of a normal distribution around zero."""
    values, covariance = np.atleast_1d(values), np.atleast_2d(covariance)
    squared = values @ np.linalg.inv(covariance) @ values
    return math.exp(-0.5 * squared) / math.sqrt(np.linalg.det(2 * math.pi * covariance))


def angle_between(a, b):
    """a - b by way of the unit circle."""
    return math.atan2(math.sin(a - b), math.cos(a - b))


def relative_pose_log_likelihood(pose, fixes, linked, near, reach):
    """Sum over (reference, headings, covariance): a normal peak on a floor, in ratio to uniform."""
    total = 0.0
    for reference, headings, c in fixes:
        dx, dy = pose[0] - reference[0], pose[1] - reference[1]
        distance = math.hypot(dx, dy)
        if distance >= reach:
            continue
        theta = angle_between(headings[0], math.atan2(dy, dx) - reference[2])
        phi = angle_between(headings[1], math.atan2(-dy, -dx) - pose[2])
        both = (2 * math.pi) ** 2 * normal_density([theta, phi], c)
        rotation = (
            2 * math.pi * normal_density(angle_between(theta, phi), c[0][0] - 2 * c[0][1] + c[1][1])
        )
        share = min(distance / near, 1.0) if near > 0 else 1.0
        share = 3 * share**2 - 2 * share**3
        value = share * math.log(1 - linked + linked * both)
        value += (1 - share) * math.log(1 - linked + linked * rotation)
        total += value * min(4 * (reach - distance) / reach, 1.0)
    return total


# --- the simulated home ---------------------------------------------------------------------------


def first_surface(
    surfaces: np.ndarray, lens: np.ndarray, direction: np.ndarray
) -> tuple[int, float]:
    """Cast one ray in three dimensions; give the surface it meets first and how far along it."""
    best, nearest = -1, np.inf
    for number, row in enumerate(surfaces):
        for t in _meetings(row, lens, direction):
            if 1e-3 < t < nearest:
                best, nearest = number, t
    return best, nearest


def _meetings(row: np.ndarray, lens: np.ndarray, direction: np.ndarray) -> list[float]:
    """Give where a ray meets the seen side of a surface."""
    kind = row[raster.KIND]
    origin = np.array([row[raster.X], row[raster.Y], row[raster.Z]])
    along = np.array([row[raster.UX], row[raster.UY], 0.0])
    left = np.array([-row[raster.UY], row[raster.UX], 0.0])
    up = np.array([0.0, 0.0, 1.0])
    length, size, facing = row[raster.LENGTH], row[raster.SIZE], row[raster.FACING]
    if kind in (raster.QUAD, raster.RECTANGLE, raster.DISC):
        normal = -left if kind == raster.QUAD else up * facing
        if direction @ normal >= 0.0 and not (kind == raster.QUAD and facing == 0.0):
            return []
        if abs(direction @ normal) < 1e-12:
            return []
        t = ((origin - lens) @ normal) / (direction @ normal)
        local = lens + t * direction - origin
        if kind == raster.DISC:
            return [t] if np.hypot(local @ along, local @ left) <= length else []
        across = local @ (up if kind == raster.QUAD else left)
        inside = 0.0 <= local @ along <= length and 0.0 <= across <= size
        return [t] if inside else []
    flat = np.array([1.0, 1.0, 0.0 if kind == raster.CYLINDER else length / size])
    d, p = direction * flat, (lens - origin) * flat
    a, b, c = d @ d, p @ d, p @ p - length**2
    if b * b < a * c or c < 0.0:
        return []
    t = (-b - np.sqrt(b * b - a * c)) / a
    if kind == raster.CYLINDER and not 0.0 <= (lens + t * direction - origin)[2] <= size:
        return []
    return [t]


def cheapest_way(cost: np.ndarray, goal: tuple[int, int]) -> np.ndarray:
    """Dijkstra's algorithm on a grid with eight neighbors."""
    total = np.full(cost.shape, np.inf)
    total[goal] = 0.0
    queue = [(0.0, goal)]
    while queue:
        so_far, (y, x) = heapq.heappop(queue)
        if so_far > total[y, x]:
            continue
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                v, u = y + dy, x + dx
                if (dy or dx) and 0 <= v < cost.shape[0] and 0 <= u < cost.shape[1]:
                    way = so_far + 0.5 * np.hypot(dy, dx) * (cost[y, x] + cost[v, u])
                    if way < total[v, u]:
                        total[v, u] = way
                        heapq.heappush(queue, (way, (v, u)))
    return total


def enters_box(box: np.ndarray, start: np.ndarray, direction: np.ndarray) -> float:
    """Give where a ray enters a turned box, by sampling its six planes; infinite if it does not."""
    x, y, cos, sin, half_x, half_y, low, high = box
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    p, d = turn @ (start - [x, y, 0.0]), turn @ direction
    lower, upper = np.array([-half_x, -half_y, low]), np.array([half_x, half_y, high])
    if ((p > lower) & (p < upper)).all():
        return np.inf
    best = np.inf
    for axis in range(3):
        for plane in (lower[axis], upper[axis]):
            if abs(d[axis]) > 1e-12:
                t = (plane - p[axis]) / d[axis]
                at = p + t * d
                others = [k for k in range(3) if k != axis]
                inside = all(lower[k] <= at[k] <= upper[k] for k in others)
                if t > 0.0 and inside:
                    best = min(best, t)
    return best


# --- the homes of landmarks -----------------------------------------------------------------------


def crosses(start, end, wall) -> bool:
    """Whether a wall meets the way between two points, 1 cm before its end at the latest."""
    way, along = np.subtract(end, start), np.subtract(wall[1], wall[0])
    matrix = np.column_stack([way, -along])
    if abs(np.linalg.det(matrix)) < 1e-12:
        return False
    on_way, on_wall = np.linalg.solve(matrix, np.subtract(wall[0], start))
    return bool(0 < on_way < 1 - 0.01 / np.hypot(*way) and 0 <= on_wall <= 1)


def landmark_image(pose, points, facing, walls, people, detected, noise, random) -> dict:
    """Landmark -> (azimuth, elevation, view, log distance): what a camera 1.2 m high sees."""
    shown = {}
    for i, (x, y, z) in enumerate(points):
        offset = np.array([x - pose[0], y - pose[1], z - 1.2])
        flat = np.hypot(offset[0], offset[1])
        slope = math.degrees(math.atan2(offset[2], flat))
        if not 0.3 <= flat <= 6.0 or not -40 <= slope <= 50:
            continue
        back = math.atan2(-offset[1], -offset[0])  # from the landmark to the camera
        view = math.remainder(back - facing[i], 2 * math.pi)
        if math.cos(view) < 0.17:
            continue
        if any(crosses(pose[:2], (x, y), wall) for wall in walls):
            continue
        ahead = offset[:2] / flat
        hidden = False
        for person in people:
            along = float(ahead @ (person[:2] - pose[:2]))
            beside = math.dist(person[:2], pose[:2] + along * ahead)
            height = 1.2 + offset[2] * along / flat
            hidden |= 0 < along < flat and beside < 0.2 and height < 1.75
        if hidden or random.uniform() >= detected:
            continue
        size = noise * math.sqrt(-2 * math.log(1 - random.uniform()))
        turn = 2 * math.pi * random.uniform()
        ray = offset / np.linalg.norm(offset)
        left = np.array([-ahead[1], ahead[0], 0.0])
        ray = ray + size * (math.cos(turn) * left + math.sin(turn) * np.cross(ray, left))
        azimuth = math.atan2(ray[1], ray[0]) - pose[2]
        elevation = math.atan2(ray[2], math.hypot(ray[0], ray[1]))
        shown[i] = (azimuth, elevation, view, math.log(np.linalg.norm(offset)))
    return shown


def most_alike(j, image, reference, looks, turn, scale) -> tuple[int, float]:
    """The landmark of a reference that looks most like j, and its lead on the second."""
    alike = {}
    for k in reference:
        if looks[k] == looks[j]:
            change = abs(reference[k][2] - image[j][2]) / turn
            alike[k] = math.exp(-change - abs(reference[k][3] - image[j][3]) / scale)
    if not alike:
        return -1, 0.0
    first, *others = sorted(alike, key=alike.__getitem__, reverse=True)
    return first, alike[first] - (alike[others[0]] if others else 0.0)


def match_landmarks(
    references, image, looks, gain, turn, scale, wrong, random
) -> list[list[tuple[int, int]]]:
    """For each reference its pairs (landmark there, landmark in the image)."""
    found = []
    for reference, mismatches in zip(references, wrong, strict=True):
        pairs = []
        for j in image:
            k, lead = most_alike(j, image, reference, looks, turn, scale)
            if k >= 0 and random.uniform() < gain * lead:
                pairs.append((k, j))
        for _ in range(mismatches):
            j = list(image)[int(random.uniform() * len(image))]
            k = j
            while k == j or k not in reference:
                k = int(random.uniform() * len(looks))
            pairs.append((k, j))
        found.append(pairs)
    return found


# --- the particle filter --------------------------------------------------------------------------


def wrap(angle):
    return np.pi - (np.pi - angle) % (2 * np.pi)


def move(poses, normals, motion, stds):
    """normals (4, N): direction, along, lateral, heading."""
    direction, translation, rotation = motion
    out = []
    for i, (x, y, heading) in enumerate(poses):
        d, a, s, h = normals[:, i] * stds
        towards = heading + direction + d
        along, lateral = translation + a, s
        x += along * np.cos(towards) - lateral * np.sin(towards)
        y += along * np.sin(towards) + lateral * np.cos(towards)
        out.append([x, y, wrap(heading + d + rotation + h)])
    return np.array(out)


def point_indices(weights, points):
    """The particle under each point of [0, 1), laid side by side with their shares as widths."""
    edges = np.cumsum(weights) / np.sum(weights)
    return np.array([int(np.argmax(edges > point)) for point in points])


def systematic(weights, n, uniform):
    return point_indices(weights, (np.arange(n) + uniform) / n)


def stratified(weights, n, uniforms):
    return point_indices(weights, (np.arange(n) + uniforms) / n)


def multinomial(weights, n, spacings):
    sums = np.cumsum(spacings)
    return point_indices(weights, sums[:n] / sums[n])


def residual(weights, n, draw):
    """draw(weights, n) -> indices: how the rest is drawn."""
    expected = n * np.asarray(weights) / np.sum(weights)
    counts = np.floor(expected + 1e-9).astype(int)
    rest = n - counts.sum()
    if rest:
        for j in draw(np.maximum(expected - counts, 0), rest):
            counts[j] += 1
    return np.repeat(np.arange(len(counts)), counts)


def ssp(weights, n, uniforms):
    """Rests rounded two at a time: a game that is fair for both."""
    expected = n * np.asarray(weights) / np.sum(weights)
    counts = np.floor(expected + 1e-9).astype(int)
    rests = np.maximum(expected - counts, 0)
    players = [j for j in range(len(rests)) if rests[j] > 0]
    for k, j in enumerate(players[1:]):
        i = players[k]  # who is open
        both = rests[i] + rests[j]
        if both < 1:
            winner, loser = (i, j) if uniforms[j] * both < rests[i] else (j, i)
            rests[winner], rests[loser] = both, 0
            players[k + 1] = winner
        else:
            winner, loser = (i, j) if uniforms[j] * (2 - both) < 1 - rests[j] else (j, i)
            counts[winner] += 1
            rests[winner], rests[loser] = 0, both - 1
            players[k + 1] = loser
    counts += np.round(rests).astype(int)
    return np.repeat(np.arange(len(counts)), counts)


def normalize(log_weights):
    """Weights, log-weights, ESS, log of the sum."""
    weights = np.exp(log_weights - np.max(log_weights))
    total = weights.sum()
    weights = weights / total
    with np.errstate(divide="ignore"):
        logs = np.log(weights)
    return weights, logs, 1 / (weights**2).sum(), np.log(total) + np.max(log_weights)


def moments(poses, weights, center, radius, angle):
    sums = np.zeros((4, 4))
    for (x, y, h), w in zip(poses, weights, strict=True):
        d = np.array([x - center[0], y - center[1], wrap(h - center[2])])
        if np.hypot(d[0], d[1]) <= radius and abs(d[2]) <= angle:
            sums += w * np.outer([1.0, *d], [1.0, *d])
    return sums


def heaviest_cell(poses, cell, cells_of_heading):
    """The occupied cell with most votes, a neighbour's halved a step: its center and votes."""
    left, bottom = poses[:, 0].min(), poses[:, 1].min()
    votes = Counter()
    for x, y, h in poses:
        turn = (h / (2 * np.pi)) % 1.0
        votes[int((x - left) // cell), int((y - bottom) // cell), int(turn * cells_of_heading)] += 1

    def score(key):
        total = 0.0
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                for dh in (-1, 0, 1):
                    other = (key[0] + dx, key[1] + dy, (key[2] + dh) % cells_of_heading)
                    total += votes.get(other, 0) * 0.5 ** (abs(dx) + abs(dy) + abs(dh))
        return total

    best = max(votes, key=score)
    width = 2 * np.pi / cells_of_heading
    center = [left + (best[0] + 0.5) * cell, bottom + (best[1] + 0.5) * cell]
    return np.array([*center, (best[2] + 0.5) * width]), score(best)


# --- RANSAC ---------------------------------------------------------------------------------------


def constraint_row(bearing):
    """What (sin theta, cos theta, sin phi, cos phi) is multiplied with in the constraint."""
    azimuth_l, elevation_l, azimuth_r, elevation_r = bearing
    left = math.sin(elevation_r) * math.cos(elevation_l)
    right = math.sin(elevation_l) * math.cos(elevation_r)
    of_theta = [left * math.cos(azimuth_l), -left * math.sin(azimuth_l)]
    return np.array([*of_theta, right * math.cos(azimuth_r), -right * math.sin(azimuth_r)])


def minimal_poses(sample):
    """All (theta, phi) of two or three bearings with positive depths."""
    _, _, right = np.linalg.svd(np.array([constraint_row(bearing) for bearing in sample]))
    lines = [right[3]]
    if len(sample) == 2:
        # which mixtures of the two null vectors have halves of the same length?
        top, bottom = right[2:, :2], right[2:, 2:]
        form = top @ top.T - bottom @ bottom.T
        roots = np.roots([form[0, 0], 2 * form[0, 1], form[1, 1]])
        lines = [root.real * right[2] + right[3] for root in roots if root.imag == 0.0]
    poses = []
    for line in lines:
        for x in (line, -line):
            theta, phi = math.atan2(x[0], x[1]), math.atan2(x[2], x[3])
            if all((planar_depths(bearing, theta, phi) > 0).all() for bearing in sample):
                poses.append((theta, phi))
    return poses


def model_cost(bearings, theta, phi, threshold, truncated):
    """One for everything that does not agree; for what does a share of it, or nothing."""
    cost = 0.0
    for bearing in bearings:
        ratio = (epipolar_residual(bearing, theta, phi)[0] / threshold) ** 2
        agrees = ratio < 1 and (planar_depths(bearing, theta, phi) > 0).all()
        cost += (ratio if truncated else 0.0) if agrees else 1.0
    return cost


def cheapest_pose(bearings, threshold, truncated):
    """The pose of two bearings that costs least, of all pairs on one side of the horizon each."""
    usable = [bearing for bearing in bearings if bearing[1] * bearing[3] > 0]
    best, headings = float(len(bearings)), (0.0, 0.0)
    for sample in combinations(usable, 2):
        for theta, phi in minimal_poses(sample):
            cost = model_cost(bearings, theta, phi, threshold, truncated)
            if cost < best:
                best, headings = cost, (theta, phi)
    return best, headings


def iterations_needed(inliers, pool_size, sample_size, confidence):
    """The smallest number with 1 - (1 - share)^number >= confidence, not rounded."""
    share = math.comb(inliers, sample_size) / math.comb(pool_size, sample_size)
    return math.log(1 - confidence) / math.log(1 - share)


# --- five angles ----------------------------------------------------------------------------------


def unit(azimuth, elevation):
    """The ray of a bearing."""
    along = math.cos(elevation)
    return np.array([along * math.cos(azimuth), along * math.sin(azimuth), math.sin(elevation)])


def general_value(bearing, turn, shift):
    """x_r' [t]x R x_l of a bearing (azimuth and elevation in L, then in R)."""
    return float(unit(*bearing[2:]) @ np.cross(shift, turn @ unit(*bearing[:2])))


def general_residual(bearing, turn, shift, step=1e-5):
    """First-order distance to the epipolar constraint on the sphere, by differences."""
    squares = 0.0
    for k in range(4):
        # an arc along a parallel is shorter than its angle
        arc = step / (math.cos(bearing[k + 1]) if k % 2 == 0 else 1.0)
        ahead, behind = np.array(bearing, float), np.array(bearing, float)
        ahead[k] += arc
        behind[k] -= arc
        change = general_value(ahead, turn, shift) - general_value(behind, turn, shift)
        squares += (change / (2 * step)) ** 2
    return general_value(bearing, turn, shift) / math.sqrt(squares)


def general_depths(bearing, turn, shift):
    """Distances of the landmark from L and R along the rays: d_r x_r = d_l R x_l + t, nearly."""
    columns = np.stack([turn @ unit(*bearing[:2]), -unit(*bearing[2:])], axis=1)
    return np.linalg.lstsq(columns, -np.asarray(shift), rcond=None)[0]


def general_cost(bearings, turn, shift, threshold, truncated):
    """As `model_cost`, of a pose of all five angles."""
    cost = 0.0
    for bearing in bearings:
        ratio = (general_residual(bearing, turn, shift) / threshold) ** 2
        agrees = ratio < 1 and (general_depths(bearing, turn, shift) > 0).all()
        cost += (ratio if truncated else 0.0) if agrees else 1.0
    return cost


def eight_point(bearings):
    """The matrix of x_r' E x_l = 0 of eight bearings, and the nearest one that is essential."""
    rows = [np.outer(unit(*b[2:]), unit(*b[:2])).ravel() for b in bearings]
    matrix = np.linalg.svd(np.array(rows))[2][8].reshape(3, 3)
    u, _, vt = np.linalg.svd(matrix)
    return matrix, u @ np.diag([1.0, 1.0, 0.0]) @ vt


def kld_bound(occupied: int, error: float, quantile: float) -> float:
    """Fox 2003, equation (7)."""
    if occupied <= 1:
        return 0.0
    k = occupied - 1
    return k / (2 * error) * (1 - 2 / (9 * k) + (2 / (9 * k)) ** 0.5 * quantile) ** 3


def kld_sample_size(poses: np.ndarray, weights: np.ndarray, kld: object) -> int:
    """Go through a comb's draws in a scattered order, count cells in a set, stop when enough."""
    n, width = kld.max_particles, 2 * np.pi / kld.cell_angle
    draws = np.searchsorted(np.cumsum(weights) / weights.sum(), (np.arange(n) + 0.5) / n)
    quantile = NormalDist().inv_cdf(kld.probability)
    stride = int(0.6180339887498949 * n)
    while np.gcd(stride, n) != 1:
        stride += 1
    cells = set()
    for seen in range(n):
        if seen >= kld.min_particles and seen >= kld_bound(len(cells), kld.error, quantile):
            return seen
        x, y, heading = poses[draws[seen * stride % n]]
        turn = heading / (2 * np.pi) % 1.0
        cells.add((x // kld.cell_size, y // kld.cell_size, int(turn * round(width))))
    return n


def claim(poses, center, radius, angle, number, owners, left):
    """Number the particles in a window that nobody owns, and take their weight."""
    owners, left = owners.copy(), left.copy()
    for i, (x, y, heading) in enumerate(poses):
        turn = math.remainder(heading - center[2], 2 * math.pi)
        near = math.hypot(x - center[0], y - center[1]) <= radius and abs(turn) <= angle
        if owners[i] < 0 and near:
            owners[i], left[i] = number, 0.0
    return owners, left


def sine_normalizer(k1, k2, coupling, terms=400):
    """The series of Singh, Hnizdo and Demchuk 2002, equation (2.1); Bessel functions are SciPy's.

    Less the exponent of the maximum, k1 + k2.
    """
    from scipy.special import gammaln, ive

    total = 0.0
    for m in range(terms):
        log = gammaln(2 * m + 1) - 2 * gammaln(m + 1)
        log += m * math.log(coupling * coupling / (4 * k1 * k2))
        total += math.exp(log) * ive(m, k1) * ive(m, k2)
    return math.log(4 * math.pi**2 * total)


def sine_log_density(headings, mean, concentrations, coupling):
    """Of one pose under one mode; the normaliser is a sum over a fine grid."""
    k1, k2 = concentrations

    def exponent(d1, d2):
        across = np.sin(d1) * np.sin(d2)
        return k1 * (np.cos(d1) - 1) + k2 * (np.cos(d2) - 1) + coupling * across

    axis = np.arange(1000) * (2 * math.pi / 1000)
    area = (axis[1] - axis[0]) ** 2
    total = np.exp(exponent(axis[:, None], axis[None, :])).sum() * area
    return exponent(headings[0] - mean[0], headings[1] - mean[1]) - math.log(total)


def grid_points(log_prob, even, side):
    """The blocks of a grid that are nearly even, and the cells that are in none."""
    prob, bins = np.exp(log_prob), len(log_prob)
    blocks, cells = {}, {}
    for i in range(0, bins, side):
        for j in range(0, bins, side):
            block = prob[i : i + side, j : j + side]
            mass = block.sum()
            inner = (block * (np.log(block) - math.log(mass / side**2))).sum()
            if inner < even:
                blocks[i, j] = mass
            else:
                for a, b in np.ndindex(side, side):
                    cells[i + a, j + b] = block[a, b]
    return blocks, cells


def score_matching(points, weights, mean):
    """k1, k2 and coupling of a sine model: E[grad t . grad t'] x = -E[Laplacian of t]."""
    matrix, vector = np.zeros((3, 3)), np.zeros(3)
    for (x, y), weight in zip(points, weights / weights.sum(), strict=True):
        s1, c1 = math.sin(x - mean[0]), math.cos(x - mean[0])
        s2, c2 = math.sin(y - mean[1]), math.cos(y - mean[1])
        gradients = np.array([[-s1, 0.0], [0.0, -s2], [c1 * s2, s1 * c2]])
        matrix += weight * gradients @ gradients.T
        vector += weight * np.array([c1, c2, 2 * s1 * s2])
    return np.linalg.solve(matrix, vector)


def sharpened(covariance, blur, least):
    """A covariance without a blur, none of whose directions has less than a least variance."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors @ np.diag(np.maximum(values - blur, least)) @ vectors.T


def cell_sums(mean, concentrations, coupling, bins):
    """A mode's sum over all cells of a grid times their area, and its mean and second moments."""
    cell = 2 * math.pi / bins
    total, first, second = 0.0, np.zeros(2), np.zeros((2, 2))
    for i, j in np.ndindex(bins, bins):
        d = np.array([(i + 0.5) * cell - mean[0], (j + 0.5) * cell - mean[1]])
        d = (d + math.pi) % (2 * math.pi) - math.pi
        exponent = concentrations @ (np.cos(d) - 1) + coupling * math.sin(d[0]) * math.sin(d[1])
        value = math.exp(exponent)
        total += value
        first += value * d
        second += value * np.outer(d, d)
    return total * cell * cell, first / total, second / total


def mixture_divergence(log_prob, mixture):
    """Kullback-Leibler divergence of a grid, each component being divided by its own sum."""
    bins = len(log_prob)
    axis = (np.arange(bins) + 0.5) * (2 * math.pi / bins)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    psi = x - y + math.pi
    own = np.full((bins, bins), mixture.uniform_weight / bins**2)
    modes = (mixture.weights, mixture.means, mixture.concentrations, mixture.couplings)
    for weight, (m1, m2), (k1, k2), c in zip(*modes, strict=True):
        exponent = k1 * np.cos(x - m1) + k2 * np.cos(y - m2) + c * np.sin(x - m1) * np.sin(y - m2)
        share = np.exp(exponent - exponent.max())
        own += weight * share / share.sum()
    for k, weight in enumerate(mixture.rotation_weights):
        exponent = mixture.rotation_concentrations[k] * np.cos(psi - mixture.rotation_means[k])
        along = np.cos(x - mixture.rotation_headings[k])
        exponent += mixture.rotation_heading_concentrations[k] * along
        share = np.exp(exponent - exponent.max())
        own += weight * share / share.sum()
    return float((np.exp(log_prob) * (log_prob - np.log(own))).sum())
