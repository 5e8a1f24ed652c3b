"""Pictures: on walls, on spines of books, of faces, and the view outside.

Every function takes a Generator and returns one whole picture (uint8 RGB, or RGBA with holes)
with sides of powers of two, stretched over the object it belongs to.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pflut.simulation.materials import hue
from pflut.simulation.textures import Image, noise, to_image

SYLLABLES = (
    *("an", "be", "co", "du", "el", "fi", "go", "ha", "in", "jo"),
    *("ka", "lu", "mi", "no", "or", "pa", "qui", "re", "so", "ta"),
)


def word(rng: np.random.Generator, syllables: int) -> str:
    """Make up a word."""
    return "".join(SYLLABLES[int(i)] for i in rng.integers(len(SYLLABLES), size=syllables)).title()


def any_hue(rng: np.random.Generator, value: tuple[float, float] = (0.2, 0.95)) -> tuple[int, ...]:
    """Draw a color as 0..255 integers."""
    color = hue(float(rng.random()), float(rng.uniform(0.1, 0.8)), float(rng.uniform(*value)))
    return tuple(int(255 * c) for c in color)


def _framed(rng: np.random.Generator, image: Image) -> Image:
    """Paint a frame and perhaps a mat around a picture."""
    height, width = image.shape[:2]
    result = image.copy()
    if rng.random() < 0.6:
        mat = int(rng.integers(16, 34))
        inner = cv2.resize(image, (width - 2 * mat, height - 2 * mat), interpolation=cv2.INTER_AREA)
        result[:] = (238, 236, 228)
        result[mat : height - mat, mat : width - mat] = inner
    frame = [(35, 30, 28), (120, 85, 50), (215, 210, 200), (165, 140, 80)][int(rng.integers(4))]
    width_px = int(rng.integers(7, 13))
    cv2.rectangle(result, (0, 0), (width - 1, height - 1), frame, 2 * width_px)
    cv2.rectangle(result, (0, 0), (width - 1, height - 1), tuple(c // 2 for c in frame), 4)
    return result


def abstract(rng: np.random.Generator) -> Image:
    """Paint a framed abstract painting of shapes and strokes."""
    image = np.full((256, 256, 3), any_hue(rng, (0.6, 0.95)), dtype=np.uint8)
    for _ in range(int(rng.integers(10, 26))):
        kind = int(rng.integers(4))
        center = rng.integers(0, 256, 2)
        size = rng.integers(10, 70, 2)
        color = any_hue(rng)
        x, y = int(center[0]), int(center[1])
        if kind == 0:
            corner = (x + int(size[0]), y + int(size[1]))
            cv2.rectangle(image, (x, y), corner, color, int(rng.choice([-1, 4])))
        elif kind == 1:
            cv2.circle(
                image, (x, y), int(size[0]) // 2, color, int(rng.choice([-1, 5])), cv2.LINE_AA
            )
        elif kind == 2:
            points = center + rng.integers(-60, 60, (3, 2))
            cv2.fillPoly(image, [points.astype(np.int32)], color, cv2.LINE_AA)
        else:
            end = center + rng.integers(-150, 150, 2)
            cv2.line(
                image,
                (x, y),
                (int(end[0]), int(end[1])),
                color,
                int(rng.integers(2, 9)),
                cv2.LINE_AA,
            )
    return _framed(rng, image)


def landscape(rng: np.random.Generator) -> Image:
    """Paint a framed landscape: sky, ridges, a sun, trees, water."""
    size = 256
    rows = np.linspace(0.0, 1.0, size)[:, None, None]
    sky = np.asarray(hue(float(rng.choice([0.08, 0.55, 0.6, 0.95])), 0.4, 0.85))
    image = sky * (1.0 - 0.3 * rows) + 0.08 * noise(rng, size, size, (4, 2), 4)[..., None]
    image = np.ascontiguousarray(image, dtype=np.float32)
    sun = (int(rng.integers(30, 226)), int(rng.integers(30, 100)))
    cv2.circle(image, sun, int(rng.integers(10, 24)), (1.0, 0.9, 0.6), -1, cv2.LINE_AA)
    ground = float(rng.choice([0.3, 0.1, 0.6]))
    y_grid = np.arange(size)[:, None]
    for ridge in range(4):
        profile = 95 + 38 * ridge + (26 - 4 * ridge) * noise(rng, 8, size, (1, 4), 5)[0]
        color = np.asarray(hue(ground + 0.03 * ridge, 0.3 + 0.1 * ridge, 0.7 - 0.12 * ridge))
        mask = y_grid > profile[None]
        relief = 0.04 * noise(rng, size, size, (16, 16), 3)[..., None]
        image = np.where(mask[..., None], color + relief, image).astype(np.float32)
    for _ in range(int(rng.integers(3, 14))):
        x, y = int(rng.integers(0, size)), int(rng.integers(170, 250))
        tall = int(rng.integers(14, 44))
        cv2.line(image, (x, y), (x, y - tall), (0.2, 0.13, 0.08), 2)
        green = hue(0.28, 0.6, float(rng.uniform(0.2, 0.5)))
        cv2.ellipse(image, (x, y - tall), (tall // 3, tall // 2), 0, 0, 360, green, -1, cv2.LINE_AA)
    return _framed(rng, to_image(image))


def portrait(rng: np.random.Generator) -> Image:
    """Paint a framed drawing of a face."""
    image = np.full((256, 256, 3), any_hue(rng, (0.3, 0.7)), dtype=np.uint8)
    image = cv2.add(
        image, to_image(0.05 + 0.04 * noise(rng, 256, 256, (4, 4), 4)[..., None] * np.ones(3))
    )
    skin = tuple(int(c) for c in np.array([225, 180, 145]) * rng.uniform(0.5, 1.05))
    hair, coat = any_hue(rng, (0.1, 0.5)), any_hue(rng, (0.2, 0.8))
    cv2.ellipse(image, (128, 262), (100, 80), 0, 0, 360, coat, -1, cv2.LINE_AA)
    cv2.ellipse(image, (128, 112), (62, 78), 0, 0, 360, hair, -1, cv2.LINE_AA)
    cv2.ellipse(image, (128, 125), (48, 62), 0, 0, 360, skin, -1, cv2.LINE_AA)
    for x in (108, 148):
        cv2.circle(image, (x, 115), 7, (245, 245, 245), -1, cv2.LINE_AA)
        cv2.circle(image, (x + int(rng.integers(-2, 3)), 115), 4, (30, 30, 40), -1, cv2.LINE_AA)
        cv2.line(image, (x - 9, 101), (x + 9, 99), hair, 4, cv2.LINE_AA)
    cv2.line(image, (128, 118), (122, 142), tuple(c // 2 for c in skin), 3, cv2.LINE_AA)
    cv2.ellipse(
        image, (128, 160), (18, int(rng.integers(3, 10))), 0, 0, 180, (150, 50, 50), 3, cv2.LINE_AA
    )
    return _framed(rng, image)


def face(rng: np.random.Generator) -> Image:
    """Paint a head all around, to be wrapped around a ball: the face is in the middle."""
    skin = tuple(int(c) for c in np.array([225, 180, 145]) * rng.uniform(0.5, 1.05))
    image = np.full((256, 512, 3), skin, dtype=np.uint8)
    hair = any_hue(rng, (0.1, 0.45))
    cv2.rectangle(image, (0, 0), (511, 70), hair, -1)
    for x0, x1 in ((0, 150), (362, 511)):
        cv2.rectangle(image, (x0, 0), (x1, 175), hair, -1)
    for x in (226, 286):
        cv2.circle(image, (x, 112), 11, (245, 245, 245), -1, cv2.LINE_AA)
        cv2.circle(image, (x, 112), 6, (30, 30, 40), -1, cv2.LINE_AA)
        cv2.line(image, (x - 16, 92), (x + 16, 92), hair, 6, cv2.LINE_AA)
    cv2.line(image, (256, 112), (250, 146), tuple(c // 2 for c in skin), 5, cv2.LINE_AA)
    cv2.ellipse(image, (256, 172), (24, 7), 0, 0, 180, (150, 50, 50), 5, cv2.LINE_AA)
    return image


def poster(rng: np.random.Generator) -> Image:
    """Paint a poster with a title, a shape and lines of text."""
    image = np.full((512, 256, 3), any_hue(rng), dtype=np.uint8)
    ink = (245, 240, 225) if image.mean() < 140 else (25, 25, 30)
    cv2.circle(image, (128, 220), int(rng.integers(60, 105)), any_hue(rng), -1, cv2.LINE_AA)
    points = np.array([128, 220]) + rng.integers(-90, 90, (5, 2))
    cv2.polylines(image, [points.astype(np.int32)], True, ink, 5, cv2.LINE_AA)
    font = cv2.FONT_HERSHEY_DUPLEX
    cv2.putText(image, word(rng, 2).upper(), (14, 66), font, 1.7, ink, 4, cv2.LINE_AA)
    for row in range(int(rng.integers(3, 6))):
        line = f"{word(rng, 2)} {word(rng, 3)}"
        cv2.putText(image, line, (18, 370 + 30 * row), font, 0.75, ink, 2, cv2.LINE_AA)
    return image


def print_of(rng: np.random.Generator) -> Image:
    """Draw some picture for a wall."""
    return [abstract, landscape, portrait, abstract][int(rng.integers(4))](rng)


def books(rng: np.random.Generator) -> Image:
    """Paint a shelf's row of book spines, seen from the front; the whole board."""
    height, width = 128, 512
    image = np.full((height, width, 3), 28, dtype=np.uint8)
    x = 2
    while x < width - 12:
        thick = int(rng.integers(9, 30))
        if rng.random() < 0.12:  # a gap
            x += int(rng.integers(10, 40))
            continue
        top = int(rng.integers(4, 46))
        color = any_hue(rng)
        right = min(x + thick, width - 2)
        cv2.rectangle(image, (x, top), (right, height), color, -1)
        ink = (240, 235, 215) if sum(color) < 330 else (30, 25, 25)
        for _ in range(int(rng.integers(1, 4))):
            y = int(rng.integers(top + 4, height - 8))
            cv2.line(image, (x + 2, y), (right - 2, y), ink, int(rng.integers(1, 4)))
        if thick > 14 and rng.random() < 0.7:
            label = np.zeros((thick, height - top - 16), dtype=np.uint8)
            cv2.putText(
                label,
                word(rng, 3),
                (2, thick - 5),
                cv2.FONT_HERSHEY_SIMPLEX,
                0.42,
                255,
                1,
                cv2.LINE_AA,
            )
            mask = np.rot90(label)[:, : right - x]
            region = image[top + 8 : top + 8 + mask.shape[0], x : x + mask.shape[1]]
            region[mask > 90] = ink
        cv2.line(image, (right, top), (right, height), tuple(c // 3 for c in color), 1)
        x = right + 1
    return image


def view_outside(rng: np.random.Generator) -> Image:
    """Paint a street seen from a window: sky, houses with their windows, trees."""
    height, width = 512, 1024
    rows = np.linspace(0.0, 1.0, height)[:, None, None]
    image = np.array([0.60, 0.76, 0.95]) * (1.0 - rows) + np.array([0.93, 0.94, 0.95]) * rows
    clouds = np.clip(noise(rng, height, width, (4, 4), 5) - 0.4, 0.0, 1.0)
    street = np.ascontiguousarray(image + 0.2 * clouds[..., None], dtype=np.float32)
    x = 0
    while x < width:
        wide = int(rng.integers(90, 200))
        _house(rng, street, x, min(x + wide, width), int(rng.integers(130, 300)))
        x += wide
    for _ in range(16):
        center = (int(rng.integers(0, width)), int(rng.integers(380, 470)))
        green = hue(0.28, 0.5, float(rng.uniform(0.25, 0.5)))
        cv2.line(street, center, (center[0], height), (0.25, 0.18, 0.12), 5)
        for _ in range(14):
            leaf = (center[0] + int(rng.normal(0, 18)), center[1] + int(rng.normal(-20, 22)))
            shade = tuple(float(c * rng.uniform(0.7, 1.2)) for c in green)
            cv2.circle(street, leaf, int(rng.integers(7, 18)), shade, -1, cv2.LINE_AA)
    return to_image(street)


def _house(
    rng: np.random.Generator, image: NDArray[np.float32], left: int, right: int, roof: int
) -> None:
    """Paint a house front with rows of windows."""
    bottom = image.shape[0]
    wall = hue(
        float(rng.uniform(0.02, 0.13)), float(rng.uniform(0.1, 0.5)), float(rng.uniform(0.45, 0.85))
    )
    cv2.rectangle(image, (left, roof), (right, bottom), wall, -1)
    cv2.rectangle(image, (left, roof - 8), (right, roof), tuple(0.5 * c for c in wall), -1)
    step_x, step_y = int(rng.integers(30, 46)), int(rng.integers(44, 60))
    for y in range(roof + 14, bottom - 30, step_y):
        for x in range(left + 9, right - 20, step_x):
            glass = hue(0.58, 0.3, float(rng.uniform(0.15, 0.5)))
            cv2.rectangle(image, (x - 2, y - 2), (x + 20, y + 30), (0.92, 0.92, 0.9), -1)
            cv2.rectangle(image, (x, y), (x + 18, y + 28), glass, -1)
            cv2.line(image, (x + 9, y), (x + 9, y + 28), (0.92, 0.92, 0.9), 2)
