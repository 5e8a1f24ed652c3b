"""Furniture made of boxes, cylinders and balls.

Every piece stands in its own frame: x from 0 to its width along the wall, y from 0 at its back to
its depth, z up from the floor. Pieces are drawn by functions ``(kit) -> None``; ``PIECES`` says
how much room each takes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pflut.simulation.scene import Material, SceneBuilder
from pflut.simulation.stock import Stock


@dataclass(frozen=True)
class Kit:
    """What a piece of furniture is made with.

    Parameters
    ----------
    b : SceneBuilder
        Its frame is the piece's.
    stock : Stock
    rng : Generator
        For what stays as it is.
    small : callable
        Gives a new Generator for each group of small objects that somebody may have moved
        between two drives.
    """

    b: SceneBuilder
    stock: Stock
    rng: np.random.Generator
    small: Callable[[], np.random.Generator]

    def pick(
        self, choices: tuple[Material, ...], rng: np.random.Generator | None = None
    ) -> Material:
        """Take one of several materials."""
        return choices[int((rng or self.rng).integers(len(choices)))]


@dataclass(frozen=True)
class Piece:
    """A piece of furniture: its size in metres and how to draw it."""

    width: float
    depth: float
    height: float
    draw: Callable[[Kit], None]


def legs(kit: Kit, width: float, depth: float, height: float, material: Material) -> None:
    """Draw four legs of 5 cm."""
    for x in (0.0, width - 0.05):
        for y in (0.0, depth - 0.05):
            kit.b.box((x, x + 0.05), (y, y + 0.05), (0.0, height), material)


def clutter(kit: Kit, width: float, depth: float, z: float, count: int) -> None:
    """Put small objects on a board: stacks of books, mugs, bottles, boxes, plants, pictures."""
    b, stock = kit.b, kit.stock
    slot = width / count
    for k in range(count):
        rng = kit.small()
        kind = int(rng.integers(7))
        x = slot * (k + 0.5) + float(rng.uniform(-0.25, 0.25)) * slot
        y = depth * float(rng.uniform(0.35, 0.65))
        turn = float(rng.uniform(-0.6, 0.6))
        with b.placed(x, y, turn):
            if kind == 0:
                top = z
                for _ in range(int(rng.integers(2, 5))):
                    thick, w, d = rng.uniform([0.015, 0.16, 0.11], [0.045, 0.24, 0.17])
                    cover = kit.pick(stock.colors, rng)
                    b.box((-w / 2, w / 2), (-d / 2, d / 2), (top, top + thick), cover)
                    top += thick
            elif kind == 1:
                b.cylinder(
                    (0.0, 0.0), 0.042, (z, z + 0.1), kit.pick((*stock.colors, stock.ceramic), rng)
                )
            elif kind == 2:
                tall = float(rng.uniform(0.2, 0.3))
                color = kit.pick(stock.colors, rng)
                b.cylinder((0.0, 0.0), 0.038, (z, z + 0.65 * tall), color)
                b.cylinder((0.0, 0.0), 0.014, (z + 0.65 * tall, z + tall), color)
            elif kind == 3:
                wrap = kit.pick(stock.packages, rng)
                tall = float(rng.uniform(0.16, 0.3))
                b.box((-0.07, 0.07), (-0.03, 0.03), (z, z + tall), wrap)
            elif kind == 4:
                b.cylinder((0.0, 0.0), 0.07, (z, z + 0.12), kit.pick(stock.colors, rng))
                b.sphere((0.0, 0.0, z + 0.22), 0.14, kit.pick(stock.foliage, rng))
            elif kind == 5:
                image = kit.pick(stock.pictures, rng)
                w = float(rng.uniform(0.06, 0.1))
                b.box((-w, w), (-0.01, 0.01), (z, z + 2.6 * w), stock.white, front=image)
            else:
                b.cylinder(
                    (0.0, 0.0), 0.12, (z, z + 0.07), kit.pick((stock.ceramic, *stock.colors), rng)
                )


def sofa(kit: Kit) -> None:
    """Draw a sofa with two or three cushions."""
    b, cloth = kit.b, kit.pick(kit.stock.fabrics)
    b.box((0.0, 2.0), (0.0, 0.9), (0.0, 0.42), cloth)
    b.box((0.0, 2.0), (0.0, 0.24), (0.42, 0.86), cloth)
    for x in (0.0, 1.82):
        b.box((x, x + 0.18), (0.24, 0.9), (0.42, 0.62), cloth)
    for k in range(int(kit.rng.integers(2, 4))):
        rng = kit.small()
        with b.placed(
            0.4 + 0.55 * k + float(rng.uniform(-0.1, 0.1)), 0.33, float(rng.uniform(-0.3, 0.3))
        ):
            cover = kit.pick(kit.stock.fabrics, rng)
            b.box((-0.2, 0.2), (-0.07, 0.07), (0.42, 0.80), cover)


def armchair(kit: Kit) -> None:
    """Draw an armchair."""
    b, cloth = kit.b, kit.pick(kit.stock.fabrics)
    b.box((0.0, 0.85), (0.0, 0.85), (0.08, 0.42), cloth)
    b.box((0.0, 0.85), (0.0, 0.2), (0.42, 0.92), cloth)
    for x in (0.0, 0.69):
        b.box((x, x + 0.16), (0.2, 0.85), (0.42, 0.6), cloth)


def coffee_table(kit: Kit) -> None:
    """Draw a low table with things on it."""
    wood = kit.pick(kit.stock.woods)
    legs(kit, 1.1, 0.6, 0.38, wood)
    kit.b.box((0.0, 1.1), (0.0, 0.6), (0.38, 0.42), wood)
    clutter(kit, 1.1, 0.6, 0.42, 3)


def television(kit: Kit) -> None:
    """Draw a television on a low board."""
    b, wood = kit.b, kit.pick(kit.stock.woods)
    b.box((0.0, 1.6), (0.0, 0.4), (0.0, 0.45), wood)
    b.box((0.5, 1.1), (0.12, 0.3), (0.45, 0.48), kit.stock.black)
    b.box((0.2, 1.4), (0.18, 0.23), (0.50, 1.16), kit.stock.black, front=kit.stock.screen)
    with b.placed(1.4, 0.05):
        clutter(kit, 0.2, 0.3, 0.45, 1)


def bookcase(kit: Kit) -> None:
    """Draw a bookcase with books on most shelves and things on the others."""
    b, wood = kit.b, kit.pick(kit.stock.woods)
    b.box((0.0, 0.9), (0.0, 0.02), (0.0, 1.96), wood)
    for x in (0.0, 0.88):
        b.box((x, x + 0.02), (0.02, 0.3), (0.0, 1.96), wood)
    for k in range(6):
        z = 0.04 + 0.38 * k
        b.box((0.02, 0.88), (0.02, 0.3), (z, z + 0.02), wood)
        if k == 5:
            break
        if kit.rng.random() < 0.8:
            row = kit.pick(kit.stock.books)
            b.box(
                (0.03, 0.87), (0.05, 0.24), (z + 0.02, z + 0.02 + 0.27), kit.stock.white, front=row
            )
        else:
            with b.placed(0.05, 0.05):
                clutter(kit, 0.8, 0.22, z + 0.02, 3)


def table(kit: Kit) -> None:
    """Draw a dining table."""
    wood = kit.pick(kit.stock.woods)
    legs(kit, 1.5, 0.85, 0.71, wood)
    kit.b.box((0.0, 1.5), (0.0, 0.85), (0.71, 0.75), wood)
    clutter(kit, 1.5, 0.85, 0.75, 5)


def chair(kit: Kit) -> None:
    """Draw a chair; its back is at y = 0. All chairs of a home are of one kind."""
    b, wood, seat = kit.b, kit.stock.woods[0], kit.stock.fabrics[0]
    legs(kit, 0.42, 0.42, 0.43, wood)
    b.box((0.0, 0.42), (0.0, 0.42), (0.43, 0.48), seat)
    for x in (0.0, 0.38):
        b.box((x, x + 0.04), (0.0, 0.04), (0.48, 0.95), wood)
    for z in (0.6, 0.72, 0.84):
        b.box((0.04, 0.38), (0.01, 0.03), (z, z + 0.08), wood)


def bed(kit: Kit) -> None:
    """Draw a double bed with its head at the wall."""
    b, wood = kit.b, kit.pick(kit.stock.woods)
    sheet, cover = kit.pick(kit.stock.bedding), kit.pick(kit.stock.bedding, kit.small())
    made = float(kit.small().uniform(0.6, 1.3))  # how far the cover is pulled up
    b.box((0.0, 1.6), (0.0, 0.06), (0.0, 1.0), wood)
    b.box((0.0, 1.6), (0.06, 2.05), (0.0, 0.3), wood)
    b.box((0.03, 1.57), (0.08, 2.0), (0.3, 0.5), sheet)
    b.box((0.0, 1.6), (made, 2.03), (0.32, 0.54), cover)
    for x in (0.15, 0.85):
        rng = kit.small()
        with b.placed(x + 0.3, 0.33, float(rng.uniform(-0.15, 0.15))):
            b.box((-0.3, 0.3), (-0.18, 0.18), (0.5, 0.64), kit.stock.bedding[0])


def night_table(kit: Kit) -> None:
    """Draw a night table with a lamp."""
    b = kit.b
    b.box((0.0, 0.45), (0.0, 0.4), (0.0, 0.5), kit.pick(kit.stock.woods), front=kit.stock.drawers)
    table_lamp(kit, 0.22, 0.2, 0.5)


def table_lamp(kit: Kit, x: float, y: float, z: float) -> None:
    """Draw a small lamp with a shade that shines."""
    b = kit.b
    glow = b.lamp(x, y, z + 0.32, 0.35)
    b.cylinder((x, y), 0.06, (z, z + 0.02), kit.stock.metal)
    b.cylinder((x, y), 0.014, (z + 0.02, z + 0.22), kit.stock.metal, solid=False)
    shade = Material(kit.stock.shade.texture, 0.3, 0.3, glow=glow)
    b.cylinder((x, y), 0.11, (z + 0.22, z + 0.40), shade, solid=False)


def floor_lamp(kit: Kit) -> None:
    """Draw a lamp on a tall stand."""
    b = kit.b
    glow = b.lamp(0.2, 0.2, 1.62, 0.8)
    b.cylinder((0.2, 0.2), 0.14, (0.0, 0.03), kit.stock.black)
    b.cylinder((0.2, 0.2), 0.015, (0.03, 1.45), kit.stock.metal, solid=False)
    shade = Material(kit.stock.shade.texture, 0.3, 0.3, glow=glow)
    b.cylinder((0.2, 0.2), 0.18, (1.45, 1.76), shade, solid=False)


def wardrobe(kit: Kit) -> None:
    """Draw a wardrobe of three doors."""
    b, wood = kit.b, kit.pick(kit.stock.woods)
    for k in range(3):
        x = 0.5 * k
        b.box((x, x + 0.5), (0.0, 0.6), (0.0, 2.15), wood, front=kit.stock.wardrobe)
    for k in range(2):
        rng = kit.small()
        x = 0.15 + 0.7 * k + float(rng.uniform(0.0, 0.2))
        b.box(
            (x, x + 0.42),
            (0.08, 0.45),
            (2.15, 2.15 + float(rng.uniform(0.15, 0.3))),
            kit.stock.cardboard,
        )


def dresser(kit: Kit) -> None:
    """Draw a chest of drawers with things on it."""
    b, wood = kit.b, kit.pick(kit.stock.woods)
    for k in range(2):
        b.box((0.55 * k, 0.55 * k + 0.55), (0.0, 0.45), (0.0, 0.85), wood, front=kit.stock.drawers)
    clutter(kit, 1.1, 0.45, 0.85, 4)


def desk(kit: Kit) -> None:
    """Draw a desk with a monitor, a lamp and things."""
    b, wood = kit.b, kit.pick(kit.stock.woods)
    b.box((0.0, 0.04), (0.0, 0.65), (0.0, 0.71), wood)
    b.box((0.9, 1.3), (0.0, 0.62), (0.0, 0.71), wood, front=kit.stock.drawers)
    b.box((0.0, 1.3), (0.0, 0.65), (0.71, 0.75), wood)
    b.cylinder((0.55, 0.2), 0.1, (0.75, 0.77), kit.stock.black)
    b.box((0.53, 0.57), (0.16, 0.2), (0.77, 0.95), kit.stock.black)
    b.box((0.28, 0.82), (0.2, 0.23), (0.88, 1.22), kit.stock.black, front=kit.stock.screen)
    b.box((0.35, 0.75), (0.38, 0.5), (0.75, 0.77), kit.stock.black)
    table_lamp(kit, 1.15, 0.2, 0.75)
    with b.placed(0.85, 0.3):
        clutter(kit, 0.4, 0.3, 0.75, 2)


def kitchen_unit(kit: Kit) -> None:
    """Draw a base unit with worktop, and a wall unit above."""
    b, stock = kit.b, kit.stock
    kind = int(kit.rng.integers(5))
    front = stock.drawers if kind == 0 else stock.oven if kind == 1 else stock.front
    b.box((0.0, 0.6), (0.0, 0.56), (0.0, 0.1), stock.black)
    b.box((0.0, 0.6), (0.0, 0.58), (0.1, 0.86), stock.white, front=front)
    b.box((0.0, 0.6), (0.0, 0.61), (0.86, 0.9), stock.worktop)
    b.box((0.0, 0.6), (0.0, 0.34), (1.45, 2.15), stock.white, front=stock.front)
    if kind == 1:
        for x in (0.16, 0.44):
            for y in (0.17, 0.43):
                b.cylinder((x, y), 0.08, (0.9, 0.905), stock.black, solid=False)
        b.cylinder((0.44, 0.17), 0.09, (0.905, 1.02), stock.metal)
    elif kind == 2:
        b.box((0.06, 0.54), (0.1, 0.5), (0.9, 0.903), stock.metal, solid=False)
        b.cylinder((0.3, 0.08), 0.015, (0.9, 1.15), stock.metal, solid=False)
        b.box((0.28, 0.32), (0.08, 0.26), (1.13, 1.16), stock.metal)
    else:
        with b.placed(0.0, 0.05):
            clutter(kit, 0.6, 0.4, 0.9, 2)


def tall_fridge(kit: Kit) -> None:
    """Draw a fridge."""
    kit.b.box((0.0, 0.6), (0.0, 0.64), (0.0, 1.85), kit.stock.white, front=kit.stock.fridge)
    kit.b.box((0.1, 0.5), (0.1, 0.5), (1.85, 2.05), kit.stock.cardboard)


def bathtub(kit: Kit) -> None:
    """Draw a bath, full of water."""
    b, stock = kit.b, kit.stock
    b.box((0.0, 1.7), (0.0, 0.75), (0.0, 0.56), stock.ceramic, front=stock.walls["bathroom"])
    b.rectangle((0.1, 0.1), (1.5, 0.55), 0.563, stock.glass)
    b.cylinder((0.15, 0.4), 0.02, (0.56, 0.78), stock.metal)


def toilet(kit: Kit) -> None:
    """Draw a toilet."""
    b, white = kit.b, kit.stock.ceramic
    b.box((0.02, 0.38), (0.0, 0.18), (0.0, 0.8), white)
    b.cylinder((0.2, 0.42), 0.19, (0.0, 0.42), white)
    b.cylinder((0.2, 0.42), 0.2, (0.42, 0.45), kit.stock.white)


def washbasin(kit: Kit) -> None:
    """Draw a washbasin on a cupboard, with a mirror above."""
    b, stock = kit.b, kit.stock
    b.box((0.05, 0.65), (0.0, 0.42), (0.0, 0.74), stock.white, front=stock.front)
    b.box((0.0, 0.7), (0.0, 0.47), (0.74, 0.86), stock.ceramic)
    b.cylinder((0.35, 0.1), 0.015, (0.86, 1.0), stock.metal)
    b.box((0.05, 0.65), (0.0, 0.02), (1.1, 1.85), stock.metal, front=stock.glass)
    with b.placed(0.45, 0.02):
        clutter(kit, 0.25, 0.2, 0.86, 1)


def washing_machine(kit: Kit) -> None:
    """Draw a washing machine with a basket on top."""
    kit.b.box((0.0, 0.6), (0.0, 0.58), (0.0, 0.86), kit.stock.white, front=kit.stock.washer)
    clutter(kit, 0.6, 0.5, 0.86, 2)


def plant(kit: Kit) -> None:
    """Draw a tall plant in a pot."""
    b = kit.b
    b.cylinder((0.25, 0.25), 0.17, (0.0, 0.34), kit.pick(kit.stock.colors), top=kit.stock.woods[2])
    b.cylinder((0.25, 0.25), 0.025, (0.34, 0.8), kit.stock.woods[2], solid=False)
    leaves = kit.pick(kit.stock.foliage)
    for _ in range(4):
        x, y, z = kit.rng.uniform([0.1, 0.1, 0.7], [0.4, 0.4, 1.35])
        b.sphere(
            (float(x), float(y), float(z)), float(kit.rng.uniform(0.18, 0.28)), leaves, solid=False
        )
    b.solid((0.1, 0.4), (0.1, 0.4), (0.8, 1.3))


def parcels(kit: Kit) -> None:
    """Draw a few boxes on the floor, left where there was room."""
    rng = kit.small()
    top = 0.0
    for _ in range(int(rng.integers(1, 4))):
        w, d, h = (float(v) for v in rng.uniform([0.28, 0.24, 0.16], [0.48, 0.42, 0.34]))
        label = kit.pick(kit.stock.packages, rng)
        x, y = 0.5 * (0.5 - w), 0.5 * (0.45 - d)
        kit.b.box((x, x + w), (y, y + d), (top, top + h), kit.stock.cardboard, front=label)
        top += h


PIECES = {
    "sofa": Piece(2.0, 0.9, 0.86, sofa),
    "armchair": Piece(0.85, 0.85, 0.92, armchair),
    "coffee table": Piece(1.1, 0.6, 0.6, coffee_table),
    "television": Piece(1.6, 0.4, 1.16, television),
    "bookcase": Piece(0.9, 0.3, 2.0, bookcase),
    "table": Piece(1.5, 0.85, 0.8, table),
    "chair": Piece(0.42, 0.42, 0.95, chair),
    "bed": Piece(1.6, 2.05, 1.0, bed),
    "night table": Piece(0.45, 0.4, 0.9, night_table),
    "floor lamp": Piece(0.4, 0.4, 1.8, floor_lamp),
    "wardrobe": Piece(1.5, 0.6, 2.5, wardrobe),
    "dresser": Piece(1.1, 0.45, 1.2, dresser),
    "desk": Piece(1.3, 0.65, 1.3, desk),
    "kitchen unit": Piece(0.6, 0.61, 2.2, kitchen_unit),
    "fridge": Piece(0.6, 0.64, 2.1, tall_fridge),
    "bathtub": Piece(1.7, 0.75, 0.8, bathtub),
    "toilet": Piece(0.4, 0.62, 0.8, toilet),
    "washbasin": Piece(0.7, 0.47, 1.9, washbasin),
    "washing machine": Piece(0.6, 0.58, 0.9, washing_machine),
    "plant": Piece(0.5, 0.5, 1.6, plant),
    "parcels": Piece(0.5, 0.45, 0.9, parcels),
}
