"""Tables, desks and benches."""

from __future__ import annotations

import numpy as np

from training.furniture.solids import (
    Model,
    Piece,
    Triangles,
    box,
    cylinder,
    ellipsoid,
    join,
    legs,
    slab,
)

Rng = np.random.Generator


def top_of(rng: Rng, dx: float, dy: float, z: float, thick: float) -> Triangles:
    """A table top: rectangle, round or rounded."""
    kind = rng.random()
    if kind < 0.7:
        return slab(dx, dy, z - thick, z)
    if kind < 0.85:
        return cylinder(min(dx, dy) / 2, z - thick, z)
    return ellipsoid(dx, dy, thick, z=z - thick / 2, power=5)


def under(rng: Rng, dx: float, dy: float, height: float) -> Triangles:
    """What carries a table."""
    kind = rng.random()
    if kind < 0.6:
        return legs(
            dx * 0.95,
            dy * 0.95,
            height,
            rng.uniform(0.035, 0.09),
            taper=rng.uniform(0.6, 1),
            splay=rng.choice([0, 0, 0.05]),
            round_=bool(rng.integers(2)),
        )
    if kind < 0.75:
        return join(cylinder(min(dx, dy) * 0.3, 0, 0.03), cylinder(0.045, 0.03, height))
    if kind < 0.9:
        return join(*(slab(dx * 0.8, 0.05, 0, height, y=s * dy * 0.4) for s in (-1, 1)))
    frames = [
        join(slab(0.05, 0.05, 0, height, y=s * dy * 0.4), slab(dx * 0.8, 0.06, 0, 0.04, y=s * dy * 0.4))
        for s in (-1, 1)
    ]
    return join(*frames)


def plain_table(name: str, rng: Rng, dx: tuple[float, float], dy: tuple[float, float], z: tuple[float, float]) -> Model:
    """A table with its size drawn from ranges."""
    wide, long, height, thick = rng.uniform(*dx), rng.uniform(*dy), rng.uniform(*z), rng.uniform(0.015, 0.06)
    pieces = [
        Piece(top_of(rng, wide, long, height, thick), rng.choice(["wood", "wood", "glass", "stone", "plastic"])),
        Piece(under(rng, wide, long, height - thick), rng.choice(["wood", "metal"])),
    ]
    if rng.random() < 0.2:
        pieces.append(Piece(slab(wide * 0.85, long * 0.85, height * 0.3, height * 0.3 + 0.02), "wood"))
    return Model(name, tuple(pieces))


def dining_table(rng: Rng) -> Model:
    return plain_table("dining table", rng, (0.65, 1.1), (0.9, 2.2), (0.7, 0.8))


def coffee_table(rng: Rng) -> Model:
    if rng.random() < 0.25:
        height = rng.uniform(0.28, 0.45)
        return Model("coffee table", (Piece(slab(rng.uniform(0.5, 0.8), rng.uniform(0.8, 1.4), 0, height), "wood"),))
    return plain_table("coffee table", rng, (0.45, 0.9), (0.7, 1.5), (0.28, 0.5))


def side_table(rng: Rng) -> Model:
    return plain_table("side table", rng, (0.3, 0.6), (0.3, 0.62), (0.4, 0.65))


def console_table(rng: Rng) -> Model:
    return plain_table("console table", rng, (0.25, 0.42), (0.8, 1.5), (0.7, 0.9))


def desk(rng: Rng) -> Model:
    deep, wide, height = rng.uniform(0.5, 0.85), rng.uniform(1.0, 1.9), rng.uniform(0.7, 0.78)
    wood = rng.choice(["wood", "plastic"])
    pieces = [Piece(slab(deep, wide, height - 0.03, height), wood)]
    kind, half = rng.random(), wide / 2
    if kind < 0.45:
        pieces.append(Piece(legs(deep, wide, height - 0.03, 0.05), rng.choice(["metal", "wood"])))
    else:
        pieces.append(
            Piece(
                join(*(box(-deep / 2, deep / 2, s * half - 0.02, s * half + 0.02, 0, height - 0.03) for s in (-1, 1))),
                wood,
            )
        )
    for s in (-1, 1):
        if rng.random() < 0.5:
            pieces.append(
                Piece(slab(deep * 0.9, 0.38, rng.choice([0.05, 0.4]), height - 0.03, y=s * (half - 0.22)), wood)
            )
    if rng.random() < 0.5:
        pieces.append(Piece(box(-deep / 2, -deep / 2 + 0.02, -half, half, 0.3, height), wood))
    if rng.random() < 0.15:
        pieces.append(Piece(box(-deep / 2, -deep / 2 + 0.28, -half, half, height + 0.3, height + 0.6), wood))
    return Model("desk", tuple(pieces))


def workbench(rng: Rng) -> Model:
    deep, wide, height = rng.uniform(0.6, 0.9), rng.uniform(1.2, 2.4), rng.uniform(0.85, 0.95)
    return Model(
        "workbench",
        (
            Piece(slab(deep, wide, height - 0.06, height), rng.choice(["wood", "plastic", "stone"])),
            Piece(
                join(
                    legs(deep, wide, height - 0.06, 0.08),
                    slab(deep * 0.9, wide * 0.9, 0.15, 0.2),
                    slab(deep * 0.9, wide * rng.uniform(0.2, 0.95), 0.2, height - 0.1),
                ),
                rng.choice(["metal", "wood", "plastic"]),
            ),
        ),
    )


def pool_table(rng: Rng) -> Model:
    wide, long = rng.uniform(1.2, 1.5), rng.uniform(2.1, 2.8)
    rim = join(
        *(box(-wide / 2, wide / 2, s * long / 2 - 0.07, s * long / 2 + 0.07, 0.65, 0.85) for s in (-1, 1)),
        *(box(s * wide / 2 - 0.07, s * wide / 2 + 0.07, -long / 2, long / 2, 0.65, 0.85) for s in (-1, 1)),
    )
    return Model(
        "pool table",
        (Piece(join(rim, legs(wide, long, 0.7, 0.16)), "wood"), Piece(slab(wide, long, 0.75, 0.8), "fabric")),
    )


def reception_desk(rng: Rng) -> Model:
    wide, height = rng.uniform(1.6, 3.5), rng.uniform(1.0, 1.2)
    return Model(
        "reception desk",
        (
            Piece(
                join(
                    box(0.3, 0.36, -wide / 2, wide / 2, 0, height),
                    box(0.1, 0.42, -wide / 2, wide / 2, height, height + 0.04),
                    box(-0.45, 0.3, -wide / 2, wide / 2, 0.72, 0.76),
                    *(box(-0.45, 0.3, s * wide / 2 - 0.03, s * wide / 2 + 0.03, 0, height) for s in (-1, 1)),
                ),
                rng.choice(["wood", "stone", "plastic"]),
            ),
        ),
    )


MAKERS = (
    (dining_table, 3),
    (coffee_table, 2),
    (side_table, 2),
    (console_table, 1),
    (desk, 3),
    (workbench, 2),
    (pool_table, 0.5),
    (reception_desk, 0.7),
)
