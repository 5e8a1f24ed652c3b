"""Readable twins of the vision kernels and formulas: loops, no tricks."""

from __future__ import annotations

import math

import numpy as np


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
