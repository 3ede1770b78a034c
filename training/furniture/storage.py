"""Tables, and things that hold things."""

from __future__ import annotations

import itertools

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
    move,
    slab,
    tube,
    turn,
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


def books(rng: Rng, x: float, y0: float, y1: float, z: float, room: float) -> list[Piece]:
    """Things on a shelf board: mostly books."""
    pieces, y = [], y0
    while y < y1 - 0.05:
        wide, tall, deep = rng.uniform(0.015, 0.07), rng.uniform(0.5, 0.92) * room, rng.uniform(0.12, 0.22)
        if rng.random() < 0.12:
            y += rng.uniform(0.05, 0.3)
            continue
        pieces.append(Piece(box(x, x + deep, y, min(y + wide, y1), z, z + tall), "book"))
        y += wide
    return pieces


def bookshelf(rng: Rng) -> Model:
    deep, wide, height = rng.uniform(0.22, 0.42), rng.uniform(0.5, 2.2), rng.uniform(0.9, 2.3)
    count = max(3, round(height / rng.uniform(0.3, 0.42)))
    levels = np.linspace(0.06, height, count)
    frame = [slab(deep, wide, z - 0.02, z) for z in levels]
    frame += [
        box(-deep / 2, deep / 2, y - 0.012, y + 0.012, 0, height)
        for y in np.linspace(-wide / 2, wide / 2, max(2, round(wide / 0.8) + 1))
    ]
    if rng.random() < 0.7:
        frame.append(box(-deep / 2, -deep / 2 + 0.01, -wide / 2, wide / 2, 0, height))
    pieces = [Piece(join(*frame), rng.choice(["wood", "wood", "metal"]))]
    for z, above in itertools.pairwise(levels):
        if rng.random() < 0.8:
            pieces += books(rng, -deep / 2 + 0.02, -wide / 2 + 0.03, wide / 2 - 0.03, z, above - z - 0.03)
    return Model("bookshelf", tuple(pieces))


def rack(rng: Rng) -> Model:
    """Open shelving of posts and boards, with boxes."""
    deep, wide, height = rng.uniform(0.3, 0.8), rng.uniform(0.8, 2.4), rng.uniform(1.4, 2.4)
    levels = np.linspace(0.12, height - 0.05, rng.integers(3, 6))
    pieces = [
        Piece(
            join(legs(deep, wide, height, 0.045), *(slab(deep, wide, z - 0.03, z) for z in levels)),
            rng.choice(["metal", "metal", "wood"]),
        )
    ]
    for z in levels[:-1]:
        y = -wide / 2 + 0.1
        while y < wide / 2 - 0.3:
            w, h = rng.uniform(0.15, 0.45), rng.uniform(0.1, (levels[1] - levels[0]) * 0.8)
            if rng.random() < 0.6:
                pieces.append(
                    Piece(box(-deep * 0.4, deep * 0.4, y, y + w, z, z + h), rng.choice(["cardboard", "plastic"]))
                )
            y += w + rng.uniform(0.02, 0.2)
    return Model("storage rack", tuple(pieces))


def wall_shelf(rng: Rng) -> Model:
    wide, deep = rng.uniform(0.4, 1.5), rng.uniform(0.14, 0.3)
    pieces = [Piece(slab(deep, wide, 0, rng.uniform(0.02, 0.08)), rng.choice(["wood", "glass", "painted"]))]
    if rng.random() < 0.3:
        pieces.append(Piece(slab(deep, wide, 0.3, 0.33), "wood"))
    return Model("shelf", tuple(pieces), "wall", rng.uniform(0.9, 1.8))


def shoe_rack(rng: Rng) -> Model:
    wide, deep, height = rng.uniform(0.5, 1.0), rng.uniform(0.24, 0.36), rng.uniform(0.4, 1.2)
    levels = np.linspace(0.08, height, max(2, round(height / 0.22)))
    pieces = [
        Piece(
            join(legs(deep, wide, height, 0.03), *(slab(deep, wide, z - 0.02, z) for z in levels)),
            rng.choice(["wood", "metal"]),
        )
    ]
    for z in levels[:-1]:
        for y in np.arange(-wide / 2 + 0.1, wide / 2 - 0.05, 0.12):
            if rng.random() < 0.7:
                pieces.append(
                    Piece(
                        ellipsoid(0.26, 0.09, rng.uniform(0.07, 0.12), y=float(y), z=float(z) + 0.05, power=3),
                        "leather",
                    )
                )
    return Model("shoe rack", tuple(pieces))


def coat_rack(rng: Rng) -> Model:
    height = rng.uniform(1.6, 1.95)
    hooks = [
        turn(tube(((0, 0, height - 0.15), (0.12, 0, height - 0.05), (0.16, 0, height)), 0.012), k * np.pi / 3)
        for k in range(6)
    ]
    pieces = [
        Piece(
            join(cylinder(rng.uniform(0.16, 0.25), 0, 0.03), cylinder(0.022, 0.03, height), *hooks),
            rng.choice(["wood", "metal"]),
        )
    ]
    if rng.random() < 0.6:
        pieces.append(Piece(ellipsoid(0.3, 0.45, rng.uniform(0.7, 1.0), x=0.1, z=height - 0.55, power=3), "fabric"))
    return Model("coat rack", tuple(pieces))


def trolley(rng: Rng) -> Model:
    deep, wide, height = rng.uniform(0.4, 0.6), rng.uniform(0.5, 0.95), rng.uniform(0.75, 1.05)
    shelves = [slab(deep, wide, z, z + 0.03) for z in np.linspace(0.15, height - 0.05, rng.integers(2, 4))]
    bar = tube(((-deep / 2, -wide / 2, height + 0.05), (deep / 2, -wide / 2, height + 0.05)), 0.015)
    pieces = [Piece(join(legs(deep, wide, height, 0.03), *shelves, bar), rng.choice(["metal", "plastic"]))]
    for _ in range(rng.integers(0, 4)):
        pieces.append(
            Piece(
                move(
                    slab(0.2, 0.2, 0, rng.uniform(0.08, 0.2)),
                    rng.uniform(-0.1, 0.1),
                    rng.uniform(-wide / 3, wide / 3),
                    height - 0.02,
                ),
                "plastic",
            )
        )
    return Model("trolley", tuple(pieces))


def hand_truck(rng: Rng) -> Model:
    wide, long = rng.uniform(0.5, 0.7), rng.uniform(0.8, 1.2)
    return Model(
        "platform cart",
        (
            Piece(slab(long, wide, 0.14, 0.2), rng.choice(["wood", "metal"])),
            Piece(
                tube(
                    (
                        (-long / 2, -wide / 2, 0.2),
                        (-long / 2, -wide / 2, 0.95),
                        (-long / 2, wide / 2, 0.95),
                        (-long / 2, wide / 2, 0.2),
                    ),
                    0.018,
                ),
                "metal",
            ),
            Piece(
                join(
                    *(
                        move(ellipsoid(0.13, 0.05, 0.13), sx * long * 0.4, sy * wide * 0.4, 0.065)
                        for sx in (-1, 1)
                        for sy in (-1, 1)
                    )
                ),
                "plastic_dark",
            ),
        ),
    )


def crate(rng: Rng) -> Model:
    dx, dy, dz = rng.uniform(0.25, 0.7), rng.uniform(0.25, 0.7), rng.uniform(0.18, 0.6)
    return Model("box", (Piece(slab(dx, dy, 0, dz), rng.choice(["cardboard", "cardboard", "plastic", "wood"])),))


def open_box(rng: Rng) -> Model:
    dx, dy, dz = rng.uniform(0.3, 0.6), rng.uniform(0.3, 0.6), rng.uniform(0.15, 0.4)
    sides = [box(s * dx / 2 - 0.01, s * dx / 2 + 0.01, -dy / 2, dy / 2, 0, dz) for s in (-1, 1)] + [
        box(-dx / 2, dx / 2, s * dy / 2 - 0.01, s * dy / 2 + 0.01, 0, dz) for s in (-1, 1)
    ]
    return Model("box", (Piece(join(slab(dx, dy, 0, 0.02), *sides), rng.choice(["cardboard", "plastic"])),))


def basket(rng: Rng) -> Model:
    r, h = rng.uniform(0.15, 0.28), rng.uniform(0.25, 0.6)
    return Model("basket", (Piece(cylinder(r * 0.85, 0, h, top=r), rng.choice(["wicker", "plastic", "fabric"])),))


def trash_can(rng: Rng) -> Model:
    h, r = rng.uniform(0.25, 0.75), rng.uniform(0.1, 0.22)
    body = slab(r * 1.6, r * 2, 0, h) if rng.random() < 0.3 else cylinder(r * rng.uniform(0.75, 1.0), 0, h, top=r)
    pieces = [Piece(body, rng.choice(["plastic", "metal", "plastic_dark"]))]
    if rng.random() < 0.4:
        pieces.append(Piece(ellipsoid(2 * r, 2 * r, 0.12, z=h), "plastic_dark"))
    return Model("trash can", tuple(pieces))


def suitcase(rng: Rng) -> Model:
    h = rng.uniform(0.5, 0.78)
    return Model(
        "suitcase",
        (
            Piece(ellipsoid(0.26, h * 0.68, h, z=h / 2 + 0.04, power=7), rng.choice(["plastic", "fabric"])),
            Piece(
                tube(((-0.08, -0.1, h), (-0.08, -0.1, h + 0.3), (-0.08, 0.1, h + 0.3), (-0.08, 0.1, h)), 0.01), "metal"
            ),
        ),
    )


def safe(rng: Rng) -> Model:
    a = rng.uniform(0.35, 0.7)
    return Model(
        "safe",
        (
            Piece(slab(a, a, 0, a * rng.uniform(0.9, 1.6)), "metal"),
            Piece(
                cylinder(0.04, 0, 0.04) @ np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0]], np.float32)
                + np.array([a / 2, 0, a / 2], np.float32),
                "metal",
            ),
        ),
    )


def pallet(rng: Rng) -> Model:
    boards = [slab(0.1, 0.8, 0.12, 0.144, x=x) for x in np.linspace(-0.55, 0.55, 8)]
    skids = [slab(1.2, 0.1, 0, 0.12, y=y) for y in (-0.35, 0, 0.35)]
    pieces = [Piece(join(*boards, *skids), "wood")]
    if rng.random() < 0.5:
        pieces.append(Piece(slab(1.1, 0.75, 0.144, rng.uniform(0.4, 1.3)), "cardboard"))
    return Model("pallet", tuple(pieces))


def barrel(rng: Rng) -> Model:
    h, r = rng.uniform(0.55, 0.95), rng.uniform(0.2, 0.32)
    return Model(
        "barrel",
        (
            Piece(
                join(cylinder(r, 0, h / 2, top=r * 1.08), cylinder(r * 1.08, h / 2, h, top=r)),
                rng.choice(["metal", "plastic", "wood"]),
            ),
        ),
    )


def vanity(rng: Rng) -> Model:
    wide, height = rng.uniform(0.8, 1.3), rng.uniform(0.7, 0.8)
    pieces = cabinet_body(rng, 0.42, wide, 0.45, height, drawers=1)
    return Model(
        "dressing table",
        (
            *pieces,
            Piece(legs(0.42, wide, 0.45, 0.05), "wood"),
            Piece(box(-0.2, -0.18, -0.35, 0.35, height, height + rng.uniform(0.5, 0.8)), "mirror"),
        ),
    )


def book_pile(rng: Rng) -> Model:
    pieces, z = [], 0.0
    for _ in range(rng.integers(1, 7)):
        t = rng.uniform(0.012, 0.05)
        pieces.append(
            Piece(
                move(turn(slab(rng.uniform(0.14, 0.22), rng.uniform(0.2, 0.3), 0, t), rng.uniform(-0.4, 0.4)), 0, 0, z),
                "book",
            )
        )
        z += t
    return Model("book", tuple(pieces), "top")


MAKERS = (
    (dining_table, 3),
    (coffee_table, 2),
    (side_table, 2),
    (console_table, 1),
    (desk, 3),
    (workbench, 2),
    (pool_table, 0.5),
    (reception_desk, 0.7),
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
    (bookshelf, 2),
    (rack, 1),
    (wall_shelf, 2),
    (shoe_rack, 1),
    (coat_rack, 1),
    (trolley, 1),
    (hand_truck, 0.5),
    (crate, 1),
    (open_box, 0.5),
    (basket, 1),
    (trash_can, 2),
    (suitcase, 1),
    (safe, 0.5),
    (pallet, 0.5),
    (barrel, 0.5),
    (vanity, 0.7),
    (book_pile, 1),
)
