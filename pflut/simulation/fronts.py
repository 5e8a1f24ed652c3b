"""Fronts of furniture and machines, and other things with a face of their own.

Every function takes a Generator and returns one whole picture (uint8 RGB, or RGBA with holes)
with sides of powers of two, stretched over the object it belongs to.
"""

from __future__ import annotations

import cv2
import numpy as np

from pflut.simulation.materials import hue, wood
from pflut.simulation.prints import any_hue, word
from pflut.simulation.textures import Image, noise, to_image


def door(rng: np.random.Generator) -> Image:
    """Paint a door leaf with panels and a handle."""
    tone = hue(0.09, float(rng.uniform(0.02, 0.5)), float(rng.uniform(0.5, 0.92)))
    image = cv2.resize(wood(rng, tone), (256, 512))
    for top, bottom in ((40, 200), (240, 470)):
        for left, right in ((36, 116), (140, 220)):
            cv2.rectangle(image, (left, top), (right, bottom), tuple(int(200 * c) for c in tone), 5)
            cv2.line(
                image, (left, bottom + 3), (right, bottom + 3), tuple(int(250 * c) for c in tone), 3
            )
    cv2.rectangle(image, (14, 236), (26, 290), (150, 150, 150), -1)
    cv2.line(image, (18, 256), (50, 256), (110, 110, 110), 6, cv2.LINE_AA)
    return np.asarray(image)


def cupboard(
    rng: np.random.Generator, color: tuple[float, float, float], *, drawers: int = 0
) -> Image:
    """Paint a cupboard's front: one door with a handle, or drawers."""
    image = to_image(
        np.ones((256, 256, 3)) * np.asarray(color)
        + 0.01 * noise(rng, 256, 256, (64, 64), 2)[..., None]
    )
    dark = tuple(int(150 * c) for c in color)
    metal = (90, 90, 95)
    parts = max(drawers, 1)
    for part in range(parts):
        top, bottom = 256 * part // parts, 256 * (part + 1) // parts - 1
        cv2.rectangle(image, (2, top + 2), (253, bottom), dark, 4)
        cv2.rectangle(
            image, (20, top + 16), (235, bottom - 16), tuple(int(205 * c) for c in color), 3
        )
        if drawers:
            y = (top + bottom) // 2
            cv2.line(image, (100, y), (156, y), metal, 7, cv2.LINE_AA)
        else:
            cv2.line(image, (216, 60), (216, 120), metal, 7, cv2.LINE_AA)
    return image


def oven(rng: np.random.Generator) -> Image:
    """Paint an oven's front with knobs and a window."""
    image = to_image(0.72 + 0.02 * noise(rng, 256, 256, (128, 4), 2)[..., None] * np.ones(3))
    for x in range(40, 240, 44):
        cv2.circle(image, (x, 30), 14, (40, 40, 44), -1, cv2.LINE_AA)
        cv2.line(image, (x, 30), (x + 8, 20), (220, 220, 220), 3, cv2.LINE_AA)
    cv2.rectangle(image, (24, 84), (232, 232), (24, 24, 28), -1)
    for y in (120, 160, 200):
        cv2.line(image, (34, y), (222, y), (70, 66, 60), 2)
    cv2.line(image, (30, 68), (226, 68), (70, 70, 74), 7, cv2.LINE_AA)
    return image


def fridge(rng: np.random.Generator) -> Image:
    """Paint a fridge's front with magnets and notes."""
    image = to_image(0.86 + 0.01 * noise(rng, 512, 256, (64, 64), 2)[..., None] * np.ones(3))
    cv2.line(image, (0, 180), (256, 180), (120, 120, 124), 4)
    cv2.line(image, (232, 100), (232, 165), (110, 110, 114), 9)
    cv2.line(image, (232, 200), (232, 290), (110, 110, 114), 9)
    for _ in range(9):
        x, y = int(rng.integers(15, 180)), int(rng.integers(20, 380))
        size = rng.integers(12, 46, 2)
        cv2.rectangle(
            image, (x, y), (x + int(size[0]), y + int(size[1])), any_hue(rng, (0.5, 1.0)), -1
        )
        cv2.circle(image, (x + int(size[0]) // 2, y), 5, any_hue(rng), -1, cv2.LINE_AA)
    return image


def washer(rng: np.random.Generator) -> Image:
    """Paint a washing machine's front."""
    image = to_image(0.88 + 0.01 * noise(rng, 256, 256, (64, 64), 2)[..., None] * np.ones(3))
    cv2.rectangle(image, (10, 10), (110, 44), (190, 190, 196), -1)
    cv2.circle(image, (200, 28), 15, (110, 110, 116), -1, cv2.LINE_AA)
    cv2.circle(image, (128, 150), 78, (150, 150, 156), 12, cv2.LINE_AA)
    cv2.circle(image, (128, 150), 64, (50, 56, 66), -1, cv2.LINE_AA)
    cv2.circle(image, (112, 168), 30, any_hue(rng, (0.3, 0.6)), -1, cv2.LINE_AA)
    return image


def screen(rng: np.random.Generator) -> Image:
    """Paint a dark television with a faint reflection."""
    image = np.full((256, 512, 3), 18, dtype=np.uint8)
    glare = np.array([[120, 30], [230, 30], [130, 220], [20, 220]], dtype=np.int32)
    cv2.fillPoly(image, [glare], (34, 36, 40), cv2.LINE_AA)
    cv2.rectangle(image, (0, 0), (511, 255), (8, 8, 9), 14)
    cv2.circle(image, (490, 246), 3, (200, 30, 30), -1)
    sheen = 0.01 * np.abs(noise(rng, 256, 512, (8, 8), 3))[..., None]
    return to_image(image / 255.0 + sheen)


def radiator(rng: np.random.Generator) -> Image:
    """Paint a radiator's ribs."""
    x = np.linspace(0.0, 1.0, 256, endpoint=False)
    ribs = 0.80 + 0.13 * np.cos(2.0 * np.pi * 12.0 * x)
    image = np.ones((128, 256, 1)) * ribs[None, :, None] * np.array([1.0, 0.99, 0.96])
    image[:8] *= 0.9
    image[-8:] *= 0.7
    return to_image(image + 0.01 * noise(rng, 128, 256, (32, 32), 2)[..., None])


def clock(rng: np.random.Generator) -> Image:
    """Paint a wall clock with its corners cut out."""
    image = np.zeros((256, 256, 4), dtype=np.uint8)
    cv2.circle(image, (128, 128), 126, (*any_hue(rng, (0.1, 0.5)), 255), -1, cv2.LINE_AA)
    cv2.circle(image, (128, 128), 108, (240, 238, 228, 255), -1, cv2.LINE_AA)
    for hour in range(12):
        angle = 2.0 * np.pi * hour / 12.0
        x, y = 128 + 88 * np.sin(angle), 128 - 88 * np.cos(angle)
        label = str(hour or 12)
        cv2.putText(
            image,
            label,
            (int(x) - 12, int(y) + 10),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.8,
            (20, 20, 20, 255),
            3,
            cv2.LINE_AA,
        )
    for length, turn, thick in ((52, rng.random(), 8), (80, rng.random(), 5)):
        end = (
            int(128 + length * np.sin(2 * np.pi * turn)),
            int(128 - length * np.cos(2 * np.pi * turn)),
        )
        cv2.line(image, (128, 128), end, (15, 15, 20, 255), thick, cv2.LINE_AA)
    return image


def package(rng: np.random.Generator) -> Image:
    """Paint a box of cereal or a parcel with a label."""
    image = np.full((256, 128, 3), any_hue(rng, (0.4, 0.95)), dtype=np.uint8)
    cv2.rectangle(image, (10, 20), (118, 90), any_hue(rng), -1)
    cv2.putText(
        image,
        word(rng, 2),
        (14, 66),
        cv2.FONT_HERSHEY_DUPLEX,
        0.95,
        (250, 250, 240),
        2,
        cv2.LINE_AA,
    )
    cv2.circle(image, (64, 160), int(rng.integers(22, 44)), any_hue(rng), -1, cv2.LINE_AA)
    for y in range(216, 250, 9):
        cv2.line(image, (12, y), (int(rng.integers(50, 116)), y), (40, 40, 40), 2)
    return image


def foliage(rng: np.random.Generator) -> Image:
    """Leaves with holes between them, to be wrapped around a ball."""
    image = np.zeros((256, 512, 4), dtype=np.uint8)
    tone = float(rng.uniform(0.22, 0.38))
    for _ in range(330):
        color = hue(tone + float(rng.normal(0.0, 0.02)), 0.55, float(rng.uniform(0.12, 0.55)))
        center = (int(rng.integers(0, 512)), int(rng.integers(0, 256)))
        axes = (int(rng.integers(10, 26)), int(rng.integers(4, 9)))
        ink = (*(int(255 * c) for c in color), 255)
        cv2.ellipse(image, center, axes, int(rng.integers(0, 180)), 0, 360, ink, -1)
    return image
