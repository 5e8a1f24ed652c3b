"""Readable twins of the filter's kernels: what they must compute, in plain Python."""

from __future__ import annotations

from collections import Counter

import numpy as np


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
