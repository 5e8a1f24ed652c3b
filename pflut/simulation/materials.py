"""What floors, walls and furniture are made of, painted procedurally.

Every function takes a Generator and returns a uint8 RGB picture with sides of powers of two that
repeats without a seam. How many metres it covers is the caller's business.
"""

from __future__ import annotations

import colorsys
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from pflut.simulation.textures import Image, noise, to_image

Color = tuple[float, float, float]


def hue(h: float, saturation: float, value: float) -> Color:
    """Give red, green, blue of a hue in turns."""
    return colorsys.hsv_to_rgb(h % 1.0, saturation, value)


def vary(rng: np.random.Generator, color: Color, spread: float = 0.03) -> Color:
    """Shift a color a little: its brightness more than its hue."""
    factor = 1.0 + rng.normal(0.0, 2.0 * spread)
    r, g, b = np.clip(factor * np.asarray(color) + rng.normal(0.0, 0.3 * spread, 3), 0.02, 0.98)
    return float(r), float(g), float(b)


def _filled(size: tuple[int, int], color: Color) -> NDArray[np.float32]:
    """Give a picture of one color, of (height, width)."""
    return np.ones((*size, 3), dtype=np.float32) * np.asarray(color, dtype=np.float32)


def plaster(rng: np.random.Generator, color: Color) -> Image:
    """Painted plaster: the roller's grain, faint clouds and a few scratches; 2 m a side."""
    size = 512
    image = _filled((size, size), color)
    image += 0.010 * noise(rng, size, size, (4, 4), 3)[..., None]
    image += 0.007 * noise(rng, size, size, (128, 128), 2)[..., None]
    return to_image(image)


def wallpaper(rng: np.random.Generator, color: Color) -> Image:
    """Wallpaper with one printed motif that repeats; 1 m a side."""
    size = 256
    second = vary(rng, color, 0.07)
    image = _filled((size, size), color)
    style = int(rng.integers(3))
    if style == 0:  # stripes of several widths
        edges = np.sort(rng.integers(0, 64, 4))
        stripe = np.zeros(64, dtype=np.float32)
        stripe[edges[0] : edges[1]] = 1.0
        stripe[edges[2] : edges[3]] = 0.6
        mask = np.tile(stripe, size // 64)[None, :].repeat(size, axis=0)
    elif style == 1:  # an ornament in every cell, in staggered rows
        cell = np.zeros((128, 128), dtype=np.uint8)
        for _ in range(4):
            center = (int(rng.integers(40, 88)), int(rng.integers(30, 98)))
            axes = (int(rng.integers(6, 26)), int(rng.integers(4, 16)))
            angle = int(rng.integers(0, 180))
            cv2.ellipse(cell, center, axes, angle, 0, 360, 255, int(rng.choice([-1, 3])))
        cell = np.maximum(cell, cell[:, ::-1])
        pair = np.hstack([cell, np.roll(cell, 64, axis=0)])
        mask = np.tile(pair, (2, 1)).astype(np.float32) / 255.0
    else:  # leaves on stems
        cell = np.zeros((size, size), dtype=np.uint8)
        for x in range(32, size, 64):
            cv2.line(cell, (x, 0), (x, size), 160, 2)
            for y in range(0, size, 32):
                side = 1 if (y // 32) % 2 else -1
                cv2.ellipse(cell, (x + 12 * side, y), (14, 5), -35 * side, 0, 360, 255, -1)
        mask = cell.astype(np.float32) / 255.0
    image += mask[..., None] * (np.asarray(second) - np.asarray(color)).astype(np.float32)
    image += 0.005 * noise(rng, size, size, (64, 64), 2)[..., None]
    return to_image(image)


def brick(rng: np.random.Generator, color: Color) -> Image:
    """Paint a brick wall in running bond; 1.6 m a side."""
    size, rows, columns = 512, 20, 8
    image = _filled((size, size), (0.70, 0.67, 0.62))
    height, width = size / rows, size / columns
    for row in range(rows):
        for column in range(columns):
            tone = vary(rng, color, 0.045)
            x0 = (column + 0.5 * (row % 2)) * width
            y0, y1 = int(row * height + 2), int((row + 1) * height - 2)
            for shift in (0, -size):  # the last brick of a row continues on the left
                left, right = int(x0 + 2 + shift), int(x0 + width - 2 + shift)
                image[y0:y1, max(left, 0) : max(right, 0)] = tone
    image += 0.02 * noise(rng, size, size, (64, 64), 3)[..., None]
    return to_image(image)


def planks(rng: np.random.Generator, color: Color) -> Image:
    """Paint a wooden floor of boards with their own tones, grain and knots; 2 m a side."""
    size, boards = 512, 14
    image = np.zeros((size, size, 3), dtype=np.float32)
    grain = noise(rng, size, size, (64, 4), 3)
    edges = np.linspace(0, size, boards + 1).astype(int)
    for low, high in pairwise(edges):
        start = int(rng.integers(size))
        joints = np.sort(rng.choice(size, 3, replace=False))
        tones = [np.asarray(vary(rng, color, 0.02)) * rng.uniform(0.88, 1.1) for _ in joints]
        row = np.zeros((size, 3), dtype=np.float32)
        for joint, tone in zip(joints, tones, strict=True):
            row[joint:] = tone
        row[: joints[0]] = tones[-1]
        board = row[None] + 0.02 * np.roll(grain[low:high], start, axis=1)[..., None]
        board[:, joints] *= 0.55
        board[0] *= 0.55
        for _ in range(int(rng.integers(0, 3))):
            center = (int(rng.integers(20, size - 20)), int(rng.integers(5, high - low - 5)))
            dark = tuple(float(v) for v in 0.6 * np.asarray(color))
            cv2.ellipse(board, center, (6, 3), 0, 0, 360, dark, -1, cv2.LINE_AA)
        image[low:high] = board
    return to_image(image)


def parquet(rng: np.random.Generator, color: Color) -> Image:
    """Paint a basket-weave parquet of blocks with five slats each; 1.2 m a side."""
    size, block, slats = 512, 128, 5
    image = np.zeros((size, size, 3), dtype=np.float32)
    grain = noise(rng, size, size, (64, 8), 3)
    for row in range(size // block):
        for column in range(size // block):
            tile = np.zeros((block, block, 3), dtype=np.float32)
            edges = np.linspace(0, block, slats + 1).astype(int)
            for low, high in pairwise(edges):
                tile[low:high] = np.asarray(vary(rng, color, 0.02)) * rng.uniform(0.88, 1.08)
                tile[low] *= 0.6
            y, x = row * block, column * block
            tile += 0.02 * grain[y : y + block, x : x + block, None]
            tile[:, 0] *= 0.6
            if (row + column) % 2:
                tile = tile.transpose(1, 0, 2)
            image[y : y + block, x : x + block] = tile
    return to_image(image)


def wood(rng: np.random.Generator, color: Color) -> Image:
    """Furniture wood: grain along the width; 1 m a side."""
    size = 256
    rows = np.linspace(0.0, 1.0, size, endpoint=False)[:, None]
    warp = noise(rng, size, size, (2, 2), 2)
    rings = np.sin(2.0 * np.pi * (9.0 * rows) + 1.6 * warp)
    image = _filled((size, size), color)
    image *= (1.0 + 0.05 * rings)[..., None].astype(np.float32)
    image += 0.014 * noise(rng, size, size, (128, 4), 2)[..., None]
    return to_image(image)


def tiles(
    rng: np.random.Generator, color: Color, *, count: int = 8, ornament: float = 0.0
) -> Image:
    """Square tiles with joints; a share of them carries one ornament. ``count`` tiles a side."""
    size = 512
    side = size // count
    image = np.zeros((size, size, 3), dtype=np.float32)
    motif = np.zeros((side, side), dtype=np.uint8)
    middle = side // 2
    for _ in range(3):
        radius = int(rng.integers(side // 8, side // 3))
        cv2.circle(motif, (middle, middle), radius, 255, int(rng.choice([-1, 2])), cv2.LINE_AA)
    corner = int(rng.integers(side // 8, side // 3))
    cv2.circle(motif, (0, 0), corner, 255, -1, cv2.LINE_AA)
    motif = np.maximum.reduce([motif, motif[::-1], motif[:, ::-1], motif[::-1, ::-1]])
    ink = np.asarray(hue(float(rng.random()), 0.5, 0.45), dtype=np.float32)
    mask = (motif / 255.0)[..., None].astype(np.float32)
    for row in range(count):
        for column in range(count):
            tile = _filled((side, side), vary(rng, color, 0.008))
            if rng.random() < ornament:
                tile = tile * (1.0 - mask) + ink * mask
            tile[:2] = tile[:, :2] = 0.62 * np.asarray(color, dtype=np.float32)
            image[row * side : (row + 1) * side, column * side : (column + 1) * side] = tile
    image += 0.006 * noise(rng, size, size, (32, 32), 3)[..., None]
    return to_image(image)


def checker(rng: np.random.Generator, light: Color, dark: Color) -> Image:
    """Paint a chessboard of veined stone tiles; 1.6 m a side, 40 cm a tile."""
    size, count = 512, 4
    side = size // count
    cells = (np.arange(size) // side)[:, None] + (np.arange(size) // side)[None]
    image = np.where((cells % 2)[..., None] == 0, np.asarray(light), np.asarray(dark))
    veins = np.exp(-np.abs(noise(rng, size, size, (4, 4), 5)) * 6.0)
    image = image + 0.06 * veins[..., None] + 0.012 * noise(rng, size, size, (64, 64), 2)[..., None]
    joints = np.arange(0, size, side)
    image[joints] *= 0.7
    image[:, joints] *= 0.7
    return to_image(image)


def carpet(rng: np.random.Generator, color: Color) -> Image:
    """Fitted carpet: mottled pile; 1 m a side."""
    size = 256
    image = _filled((size, size), color)
    image += 0.018 * noise(rng, size, size, (64, 64), 2)[..., None]
    image += 0.015 * noise(rng, size, size, (8, 8), 2)[..., None]
    return to_image(image)


def fabric(rng: np.random.Generator, color: Color) -> Image:
    """Upholstery or bedding: plain weave, stripes, checks or dots; 0.6 m a side."""
    size = 256
    image = _filled((size, size), color)
    second = np.asarray(
        hue(float(rng.random()), float(rng.uniform(0.1, 0.6)), float(rng.uniform(0.3, 0.95)))
    )
    style = int(rng.integers(5))
    position = np.arange(size)
    if style == 1:
        mask = ((position // 16) % 3 == 0)[None, :] * np.ones((size, 1))
    elif style == 2:
        lines = (position // 16) % 4 == 0
        mask = 0.5 * lines[None, :] + 0.5 * lines[:, None]
    elif style == 3:
        dots = np.zeros((64, 64), dtype=np.uint8)
        cv2.circle(dots, (16, 16), 8, 255, -1, cv2.LINE_AA)
        cv2.circle(dots, (48, 48), 8, 255, -1, cv2.LINE_AA)
        mask = np.tile(dots, (4, 4)) / 255.0
    else:
        mask = np.zeros((size, size))
    image += (0.8 * mask[..., None] * (second - np.asarray(color))).astype(np.float32)
    image += 0.01 * noise(rng, size, size, (128, 128), 1)[..., None]
    image += 0.02 * noise(rng, size, size, (4, 4), 3)[..., None]
    return to_image(image)


def curtain(rng: np.random.Generator, color: Color) -> Image:
    """Paint a curtain's folds; the width is one repeat."""
    size = 256
    x = np.linspace(0.0, 1.0, size, endpoint=False)
    folds = np.zeros(size)
    for wave in range(3, 12):
        folds += rng.normal(0.0, 1.0) * np.sin(2.0 * np.pi * (wave * x + rng.random())) / wave**0.5
    image = _filled((size, size), color)
    image *= (1.0 + 0.10 * folds / folds.std())[None, :, None].astype(np.float32)
    image += 0.01 * noise(rng, size, size, (64, 64), 2)[..., None]
    return to_image(image)


def rug(rng: np.random.Generator) -> Image:
    """Paint a rug: borders, medallions and motifs, symmetric about both axes; the whole rug."""
    height, width = 256, 512
    start = float(rng.random())
    palette = [
        hue(start + float(rng.normal(0.0, 0.08)), float(rng.uniform(0.25, 0.65)), value)
        for value in (0.35, 0.5, 0.62, 0.75, 0.85)
    ]
    order = [palette[int(i)] for i in rng.permutation(len(palette))]
    quarter = np.zeros((height // 2, width // 2, 3), dtype=np.float32)
    quarter[:] = order[0]
    margin = 0
    for ring in range(4):
        cv2.rectangle(quarter, (margin, margin), (width, height), order[ring % 5], -1)
        if ring % 2:
            for k in range(margin + 6, width, 16):
                cv2.circle(quarter, (k, margin + 6), 4, order[(ring + 2) % 5], -1, cv2.LINE_AA)
                cv2.circle(quarter, (margin + 6, k), 4, order[(ring + 2) % 5], -1, cv2.LINE_AA)
        margin += int(rng.integers(8, 16))
    corner = (width // 2, height // 2)
    for radius in (90, 70, 48, 26):
        radius = int(radius * rng.uniform(0.8, 1.1))
        cv2.ellipse(
            quarter,
            corner,
            (2 * radius, radius),
            0,
            0,
            360,
            order[int(rng.integers(5))],
            -1,
            cv2.LINE_AA,
        )
    for _ in range(22):
        x, y = int(rng.integers(margin, width // 2)), int(rng.integers(margin, height // 2))
        size = int(rng.integers(3, 11))
        diamond = np.array([[x - size, y], [x, y - size], [x + size, y], [x, y + size]])
        cv2.fillPoly(quarter, [diamond.astype(np.int32)], order[int(rng.integers(5))], cv2.LINE_AA)
    half = np.concatenate([quarter, quarter[:, ::-1]], axis=1)
    image = np.concatenate([half, half[::-1]], axis=0)
    image += 0.015 * noise(rng, height, width, (64, 128), 2)[..., None]
    return to_image(image)
