"""Cabinets and what has doors or drawers."""

from __future__ import annotations

import numpy as np

from training.furniture.solids import (
    Model,
    Piece,
    box,
    ellipsoid,
    join,
    legs,
    slab,
    tube,
)

Rng = np.random.Generator


def _handles(rng: Rng, x: float, spots: list[tuple[float, float]]) -> Piece:
    if rng.random() < 0.5:
        return Piece(join(*(box(x, x + 0.025, y - 0.06, y + 0.06, z - 0.01, z + 0.01) for y, z in spots)), "metal")
    return Piece(join(*(ellipsoid(0.04, 0.03, 0.03, x=x + 0.015, y=y, z=z) for y, z in spots)), "metal")


def cabinet_body(
    rng: Rng, deep: float, wide: float, z0: float, z1: float, *, doors: int = 0, drawers: int = 0
) -> list[Piece]:
    """A closed body with fronts that stand out a little and handles."""
    wood = rng.choice(["wood", "wood", "plastic", "painted"])
    pieces = [Piece(slab(deep, wide, z0, z1), wood)]
    fronts, spots, x = [], [], deep / 2
    for k in range(doors):
        y0, y1 = -wide / 2 + k * wide / doors + 0.008, -wide / 2 + (k + 1) * wide / doors - 0.008
        fronts.append(box(x, x + 0.018, y0, y1, z0 + 0.03, z1 - 0.01))
        spots.append((y1 - 0.05 if k % 2 == 0 else y0 + 0.05, (z0 + z1) / 2 + rng.uniform(-0.1, 0.1)))
    for k in range(drawers):
        a, b = z0 + 0.03 + k * (z1 - z0 - 0.04) / drawers, z0 + 0.02 + (k + 1) * (z1 - z0 - 0.04) / drawers
        fronts.append(box(x, x + 0.018, -wide / 2 + 0.01, wide / 2 - 0.01, a, b))
        spots.append((0.0, (a + b) / 2))
    if fronts:
        pieces += [Piece(join(*fronts), wood), _handles(rng, x + 0.018, spots)]
    return pieces


def wardrobe(rng: Rng) -> Model:
    wide = rng.uniform(0.8, 2.6)
    return Model(
        "wardrobe",
        tuple(
            cabinet_body(
                rng,
                rng.uniform(0.5, 0.68),
                wide,
                rng.uniform(0, 0.1),
                rng.uniform(1.8, 2.4),
                doors=max(2, round(wide / 0.5)),
            )
        ),
    )


def cabinet(rng: Rng) -> Model:
    wide = rng.uniform(0.5, 1.6)
    return Model(
        "cabinet",
        tuple(
            cabinet_body(
                rng,
                rng.uniform(0.32, 0.55),
                wide,
                rng.uniform(0, 0.15),
                rng.uniform(0.7, 1.5),
                doors=max(1, round(wide / 0.45)),
                drawers=0,
            )
        ),
    )


def sideboard(rng: Rng) -> Model:
    wide = rng.uniform(1.2, 2.2)
    return Model(
        "sideboard",
        tuple(
            cabinet_body(
                rng,
                rng.uniform(0.38, 0.5),
                wide,
                rng.uniform(0.03, 0.2),
                rng.uniform(0.65, 0.95),
                doors=max(2, round(wide / 0.5)),
            )
        ),
    )


def kitchen_cabinet(rng: Rng) -> Model:
    """A run of base cabinets with worktop, straight, L or U, with or without sink, upper cabinets and splash."""
    deep, height = rng.uniform(0.55, 0.66), rng.uniform(0.84, 0.94)
    wide = rng.uniform(0.6, 3.6)
    body = cabinet_body(rng, deep, wide, 0.0, height - 0.04, doors=max(1, round(wide / 0.5)))
    top = [slab(deep + 0.03, wide, height - 0.04, height)]
    if rng.random() < 0.45 and wide > 1.4:
        arm = rng.uniform(0.8, 2.4)
        for side in [-1, 1] if rng.random() < 0.3 else [float(rng.choice([-1, 1]))]:
            y = side * (wide / 2 - deep / 2)
            body.append(
                Piece(box(deep / 2, deep / 2 + arm, y - deep / 2, y + deep / 2, 0, height - 0.04), body[0].material)
            )
            top.append(box(deep / 2, deep / 2 + arm, y - deep / 2, y + deep / 2, height - 0.04, height))
    pieces = [*body, Piece(join(*top), rng.choice(["stone", "wood", "plastic"]))]
    if rng.random() < 0.5:
        y = rng.uniform(-wide / 3, wide / 3)
        pieces.append(
            Piece(
                join(
                    tube(
                        (
                            (-0.2, y, height),
                            (-0.2, y, height + 0.25),
                            (-0.05, y, height + 0.25),
                            (-0.03, y, height + 0.18),
                        ),
                        0.015,
                    ),
                    slab(0.4, 0.5, height, height + 0.008, y=y),
                ),
                "metal",
            )
        )
    if rng.random() < 0.25:
        z0 = rng.uniform(1.35, 1.5)
        pieces.append(
            Piece(
                box(-deep / 2, -deep / 2 + 0.35, -wide / 2, wide / 2, z0, z0 + rng.uniform(0.5, 0.9)), body[0].material
            )
        )
    return Model("kitchen cabinet", tuple(pieces))


def kitchen_island(rng: Rng) -> Model:
    deep, wide, height = rng.uniform(0.7, 1.2), rng.uniform(1.2, 2.4), rng.uniform(0.86, 1.0)
    return Model(
        "kitchen island",
        (
            *cabinet_body(rng, deep * 0.8, wide * 0.9, 0, height - 0.05, doors=3),
            Piece(slab(deep, wide, height - 0.05, height), rng.choice(["stone", "wood"])),
        ),
    )


def wall_cabinet(rng: Rng) -> Model:
    wide = rng.uniform(0.4, 2.4)
    return Model(
        "wall cabinet",
        tuple(
            cabinet_body(rng, rng.uniform(0.15, 0.4), wide, 0, rng.uniform(0.4, 0.9), doors=max(1, round(wide / 0.45)))
        ),
        "wall",
        rng.uniform(1.3, 1.6),
    )


def nightstand(rng: Rng) -> Model:
    height = rng.uniform(0.4, 0.7)
    pieces = cabinet_body(
        rng,
        rng.uniform(0.32, 0.5),
        rng.uniform(0.38, 0.62),
        rng.choice([0.0, 0.1, 0.2]),
        height,
        drawers=int(rng.integers(1, 4)),
    )
    return Model("nightstand", (*pieces, Piece(legs(0.36, 0.4, 0.2, 0.04), "wood")))


def chest_of_drawers(rng: Rng) -> Model:
    return Model(
        "chest of drawers",
        tuple(
            cabinet_body(
                rng,
                rng.uniform(0.38, 0.55),
                rng.uniform(0.6, 1.4),
                0.04,
                rng.uniform(0.7, 1.3),
                drawers=int(rng.integers(3, 7)),
            )
        ),
    )


def filing_cabinet(rng: Rng) -> Model:
    drawers = int(rng.integers(2, 5))
    return Model(
        "filing cabinet",
        tuple(
            Piece(p.triangles, "metal")
            for p in cabinet_body(
                rng, rng.uniform(0.5, 0.65), rng.uniform(0.4, 0.48), 0, drawers * 0.33 + 0.05, drawers=drawers
            )
        ),
    )


def locker(rng: Rng) -> Model:
    wide = rng.uniform(0.3, 1.5)
    return Model(
        "locker",
        tuple(
            Piece(p.triangles, "metal")
            for p in cabinet_body(
                rng,
                rng.uniform(0.4, 0.52),
                wide,
                rng.uniform(0, 0.12),
                rng.uniform(1.6, 2.0),
                doors=max(1, round(wide / 0.32)),
            )
        ),
    )


def tv_stand(rng: Rng) -> Model:
    deep, wide, height = rng.uniform(0.35, 0.62), rng.uniform(1.0, 2.9), rng.uniform(0.32, 0.62)
    if rng.random() < 0.5:
        return Model(
            "TV stand",
            tuple(cabinet_body(rng, deep, wide, rng.uniform(0.02, 0.15), height, doors=max(2, round(wide / 0.5)))),
        )
    boards = [slab(deep, wide, z, z + 0.03) for z in (0.05, height / 2, height - 0.03)]
    walls = [
        box(-deep / 2, deep / 2, y - 0.015, y + 0.015, 0, height)
        for y in np.linspace(-wide / 2 + 0.015, wide / 2 - 0.015, rng.integers(2, 5))
    ]
    return Model("TV stand", (Piece(join(*boards, *walls), "wood"),))


MAKERS = (
    (wardrobe, 2),
    (cabinet, 2),
    (sideboard, 1),
    (kitchen_cabinet, 3),
    (kitchen_island, 0.7),
    (wall_cabinet, 1),
    (nightstand, 2),
    (chest_of_drawers, 1),
    (filing_cabinet, 1),
    (locker, 1),
    (tv_stand, 2),
)
