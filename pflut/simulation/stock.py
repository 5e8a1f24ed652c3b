"""The materials that one home is furnished with, some of them several times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pflut.simulation import fronts, materials, prints
from pflut.simulation.materials import hue, vary
from pflut.simulation.scene import SKY_GLOW, Material, SceneBuilder
from pflut.simulation.textures import plain


@dataclass(frozen=True)
class Stock:
    """What there is to furnish a home with; tuples are choices."""

    white: Material
    black: Material
    metal: Material
    ceramic: Material
    glass: Material
    cardboard: Material
    shade: Material
    woods: tuple[Material, ...]
    fabrics: tuple[Material, ...]
    bedding: tuple[Material, ...]
    colors: tuple[Material, ...]
    foliage: tuple[Material, ...]
    pictures: tuple[Material, ...]
    posters: tuple[Material, ...]
    books: tuple[Material, ...]
    packages: tuple[Material, ...]
    rugs: tuple[Material, ...]
    curtains: tuple[Material, ...]
    views: tuple[Material, ...]
    faces: tuple[Material, ...]
    sky: Material
    clock: Material
    screen: Material
    radiator: Material
    door: Material
    front: Material
    drawers: Material
    wardrobe: Material
    worktop: Material
    oven: Material
    fridge: Material
    washer: Material
    floors: dict[str, Material]
    walls: dict[str, Material]
    accents: dict[str, Material]


WALL_TONES = ((0.86, 0.83, 0.76), (0.80, 0.83, 0.80), (0.84, 0.79, 0.75), (0.78, 0.81, 0.86))
WOOD_TONES = ((0.72, 0.55, 0.36), (0.50, 0.33, 0.20), (0.36, 0.24, 0.16), (0.82, 0.72, 0.56))
KINDS = ("living", "kitchen", "bedroom", "study", "bathroom")


def make_stock(b: SceneBuilder, rng: np.random.Generator) -> Stock:
    """Paint everything that a home needs.

    Parameters
    ----------
    b : SceneBuilder
        Receives the pictures.
    rng : Generator

    Returns
    -------
    Stock
    """
    kitchen = vary(
        rng, [(0.88, 0.87, 0.82), (0.45, 0.55, 0.50), (0.62, 0.30, 0.26)][rng.integers(3)]
    )
    wardrobe = vary(rng, [(0.85, 0.82, 0.76), (0.55, 0.40, 0.28)][rng.integers(2)])
    sofas = [
        hue(float(h), float(rng.uniform(0.15, 0.5)), float(rng.uniform(0.3, 0.75)))
        for h in rng.random(4)
    ]
    beds = [
        hue(float(h), float(rng.uniform(0.05, 0.4)), float(rng.uniform(0.7, 0.95)))
        for h in rng.random(3)
    ]

    def many(paint, count: int, width: float = 0.0, height: float | None = None, **options: bool):  # type: ignore[no-untyped-def]
        return tuple(b.material(paint(rng), width, height, **options) for _ in range(count))

    return Stock(
        white=b.material(plain(rng, (0.9, 0.89, 0.87), grain=0.004), 0.5),
        black=b.material(plain(rng, (0.09, 0.09, 0.10)), 0.5),
        metal=b.material(plain(rng, (0.58, 0.58, 0.60), grain=0.03), 0.3),
        ceramic=b.material(plain(rng, (0.93, 0.93, 0.94), grain=0.004), 0.5),
        glass=b.material(plain(rng, (0.55, 0.63, 0.66), grain=0.03), 0.6),
        cardboard=b.material(plain(rng, (0.62, 0.48, 0.33), grain=0.03), 0.4),
        shade=b.material(plain(rng, (0.95, 0.88, 0.74), grain=0.02), 0.3),
        woods=tuple(b.material(materials.wood(rng, vary(rng, tone)), 1.0) for tone in WOOD_TONES),
        fabrics=tuple(b.material(materials.fabric(rng, color), 0.6) for color in sofas),
        bedding=tuple(b.material(materials.fabric(rng, color), 0.8) for color in beds),
        colors=tuple(
            b.material(
                plain(
                    rng, hue(k / 7.0, float(rng.uniform(0.4, 0.8)), float(rng.uniform(0.3, 0.8)))
                ),
                0.2,
            )
            for k in range(7)
        ),
        foliage=many(fronts.foliage, 2, cutout=True),
        pictures=many(prints.print_of, 13),
        posters=many(prints.poster, 3),
        books=many(prints.books, 6),
        packages=many(fronts.package, 6),
        rugs=many(materials.rug, 3),
        curtains=tuple(
            b.material(
                materials.curtain(
                    rng, hue(float(rng.random()), float(rng.uniform(0.05, 0.45)), 0.75)
                )
            )
            for _ in range(3)
        ),
        views=tuple(b.material(prints.view_outside(rng), glow=SKY_GLOW) for _ in range(2)),
        sky=b.material(plain(rng, (0.60, 0.76, 0.95)), 8.0, glow=SKY_GLOW),
        faces=many(prints.face, 3),
        clock=b.material(fronts.clock(rng), cutout=True),
        screen=b.material(fronts.screen(rng)),
        radiator=b.material(fronts.radiator(rng)),
        door=b.material(fronts.door(rng)),
        front=b.material(fronts.cupboard(rng, kitchen)),
        drawers=b.material(fronts.cupboard(rng, kitchen, drawers=3)),
        wardrobe=b.material(fronts.cupboard(rng, wardrobe)),
        worktop=b.material(plain(rng, (0.32, 0.31, 0.30), 128, grain=0.06), 0.6),
        oven=b.material(fronts.oven(rng)),
        fridge=b.material(fronts.fridge(rng)),
        washer=b.material(fronts.washer(rng)),
        floors=_floors(b, rng),
        walls={
            kind: b.material(
                materials.plaster(rng, vary(rng, WALL_TONES[int(rng.integers(4))], 0.01)), 2.0
            )
            if kind != "bathroom"
            else b.material(materials.tiles(rng, (0.88, 0.90, 0.91), ornament=0.06), 1.6)
            for kind in KINDS
        },
        accents=_accents(b, rng),
    )


def _floors(b: SceneBuilder, rng: np.random.Generator) -> dict[str, Material]:
    """Choose each kind of room's floor; two rooms of a kind share theirs."""
    boards = b.material(
        materials.planks(rng, vary(rng, WOOD_TONES[int(rng.integers(2))], 0.04)), 2.0
    )
    blocks = b.material(
        materials.parquet(rng, vary(rng, WOOD_TONES[int(rng.integers(2))], 0.04)), 1.2
    )
    pile = b.material(materials.carpet(rng, hue(float(rng.random()), 0.2, 0.55)), 1.0)
    squares = b.material(
        materials.checker(rng, (0.84, 0.82, 0.78), hue(float(rng.random()), 0.2, 0.35)), 1.6
    )
    tiled = b.material(materials.tiles(rng, vary(rng, (0.66, 0.66, 0.64)), count=4), 1.2)
    return {
        "living": [boards, blocks][int(rng.integers(2))],
        "kitchen": [squares, tiled][int(rng.integers(2))],
        "bedroom": [boards, pile][int(rng.integers(2))],
        "study": [boards, pile, blocks][int(rng.integers(3))],
        "bathroom": [squares, tiled][int(rng.integers(2))],
    }


def _accents(b: SceneBuilder, rng: np.random.Generator) -> dict[str, Material]:
    """Choose the covering of one wall of each kind of room: bricks, wallpaper, tiles."""
    bricks = b.material(materials.brick(rng, vary(rng, (0.58, 0.36, 0.28), 0.05)), 1.6)
    papers = [
        b.material(
            materials.wallpaper(rng, hue(float(rng.random()), float(rng.uniform(0.08, 0.3)), 0.8)),
            1.0,
        )
        for _ in range(3)
    ]
    tiled = b.material(materials.tiles(rng, (0.90, 0.89, 0.85), ornament=0.12), 1.6)
    return {
        "living": [bricks, papers[0]][int(rng.integers(2))],
        "kitchen": tiled,
        "bedroom": papers[1],
        "study": [papers[2], bricks][int(rng.integers(2))],
        "bathroom": tiled,
    }
