"""Lights, what hangs on walls, plants, textiles and small things."""

from __future__ import annotations

import numpy as np

from training.furniture.solids import (
    Model,
    Piece,
    box,
    cylinder,
    ellipsoid,
    grid,
    join,
    lathe,
    legs,
    move,
    slab,
    tube,
    turn,
)

Rng = np.random.Generator


def _shade(rng: Rng, z: float, size: float) -> Piece:
    kind = rng.random()
    if kind < 0.6:
        return Piece(lathe(((size, z), (size * rng.uniform(0.5, 1.0), z + size * rng.uniform(0.8, 1.5)))), "lampshade")
    return Piece(ellipsoid(size * 2, size * 2, size * 2, z=z + size), "lampshade")


def floor_lamp(rng: Rng) -> Model:
    h = rng.uniform(1.25, 1.75)
    pieces = [
        Piece(join(cylinder(rng.uniform(0.12, 0.18), 0, 0.03), cylinder(0.015, 0.03, h)), rng.choice(["metal", "wood"]))
    ]
    shade = _shade(rng, h - 0.1, rng.uniform(0.12, 0.24))
    if rng.random() < 0.2:  # an arc
        reach = rng.uniform(0.5, 1.1)
        pieces = [
            Piece(
                join(
                    cylinder(0.16, 0, 0.05),
                    tube(((0, 0, 0), (0.05, 0, h * 0.7), (reach * 0.5, 0, h + 0.15), (reach, 0, h)), 0.015),
                ),
                "metal",
            )
        ]
        shade = Piece(move(shade.triangles, reach), shade.material)
    return Model("floor lamp", (*pieces, shade))


def table_lamp(rng: Rng) -> Model:
    h = rng.uniform(0.22, 0.5)
    base = (
        lathe(
            ((0.0, 0.0), (rng.uniform(0.05, 0.1), 0.0), (rng.uniform(0.02, 0.1), h * 0.4), (0.015, h * 0.8), (0.015, h))
        )
        if rng.random() < 0.6
        else join(cylinder(0.08, 0, 0.02), tube(((0, 0, 0), (-0.08, 0, h * 0.7), (0.1, 0, h)), 0.01))
    )
    return Model(
        "table lamp",
        (Piece(base, rng.choice(["ceramic", "metal", "wood"])), _shade(rng, h * 0.85, rng.uniform(0.07, 0.17))),
        "top",
        0.6,
    )


def pendant_lamp(rng: Rng) -> Model:
    drop, size = rng.uniform(0.4, 1.1), rng.uniform(0.1, 0.28)
    shade = _shade(rng, 0, size)
    return Model(
        "pendant lamp",
        (
            Piece(cylinder(0.006, -drop, 0), "plastic_dark"),
            Piece(move(shade.triangles, 0, 0, -drop - size), shade.material),
        ),
        "ceiling",
    )


def chandelier(rng: Rng) -> Model:
    drop, r, arms = rng.uniform(0.35, 0.8), rng.uniform(0.22, 0.5), int(rng.integers(3, 10))
    z = -drop
    pieces = [Piece(join(cylinder(0.012, z, 0), cylinder(0.06, -0.03, 0), ellipsoid(0.12, 0.12, 0.2, z=z)), "metal")]
    for k in range(arms):
        a = 2 * np.pi * k / arms
        arm = tube(((0.03, 0, z), (r * 0.5, 0, z - rng.uniform(0.02, 0.12)), (r, 0, z + 0.02)), 0.01)
        up = rng.random() < 0.6
        bulb = lathe(((0.03, 0.0), (0.055, 0.12)) if up else ((0.06, -0.12), (0.03, 0.0)), sides=8, x=r)
        pieces += [Piece(turn(arm, a), "metal"), Piece(turn(move(bulb, 0, 0, z + 0.03), a), "lampshade")]
    if rng.random() < 0.4:
        pieces.append(
            Piece(
                join(*(turn(ellipsoid(0.03, 0.03, 0.1, x=r * 0.7, z=z - 0.08), k) for k in np.linspace(0, 6.28, 12))),
                "glass",
            )
        )
    return Model("chandelier", tuple(pieces), "ceiling")


def ceiling_lamp(rng: Rng) -> Model:
    if rng.random() < 0.5:
        r = rng.uniform(0.12, 0.3)
        return Model(
            "ceiling lamp", (Piece(lathe(((0, -0.11), (r * 0.8, -0.09), (r, -0.02), (r, 0))), "lampshade"),), "ceiling"
        )
    return Model(
        "ceiling lamp", (Piece(slab(rng.uniform(0.12, 0.6), rng.uniform(0.6, 1.5), -0.09, 0), "lampshade"),), "ceiling"
    )


def wall_lamp(rng: Rng) -> Model:
    s = rng.uniform(0.04, 0.1)
    shade = _shade(rng, 0, s)
    return Model(
        "wall lamp",
        (
            Piece(join(slab(0.02, 0.09, -0.06, 0.06, x=0.01), tube(((0.0, 0, 0), (s + 0.03, 0, 0.0)), 0.01)), "metal"),
            Piece(move(shade.triangles, s + 0.03), shade.material),
        ),
        "wall",
        rng.uniform(1.4, 2.0),
    )


def candle(rng: Rng) -> Model:
    return Model(
        "candle", (Piece(cylinder(rng.uniform(0.015, 0.05), 0, rng.uniform(0.06, 0.25)), "sheet"),), "top", 0.7
    )


# ------------------------------------------------------------------------------------------------------ on walls
def picture(rng: Rng) -> Model:
    wide, high = rng.uniform(0.3, 1.3), rng.uniform(0.3, 1.0)
    rim, thick = rng.uniform(0.0, 0.06), rng.uniform(0.015, 0.05)
    pieces = [Piece(box(0.005, thick, -wide / 2 + rim, wide / 2 - rim, rim, high - rim), "artwork")]
    if rim > 0.01:
        bars = [box(0, thick + 0.01, -wide / 2, wide / 2, a, a + rim) for a in (0, high - rim)] + [
            box(0, thick + 0.01, a, a + rim, 0, high) for a in (-wide / 2, wide / 2 - rim)
        ]
        pieces.append(Piece(join(*bars), rng.choice(["wood", "metal", "plastic_dark"])))
    return Model("picture", tuple(pieces), "wall", rng.uniform(1.0, 1.6))


def photo_frame(rng: Rng) -> Model:
    wide, high = rng.uniform(0.1, 0.28), rng.uniform(0.12, 0.3)
    panel = turn(slab(0.015, wide, 0, high), -rng.uniform(0.1, 0.35), "y")
    foot = tube(((-0.01, 0, high * 0.6), (-0.09, 0, 0.0)), 0.008)
    return Model(
        "photo frame",
        (
            Piece(join(panel, foot), rng.choice(["wood", "metal"])),
            Piece(move(turn(slab(0.004, wide * 0.8, 0.02, high - 0.02), -0.2, "y"), 0.012), "artwork"),
        ),
        "top",
        0.7,
    )


def mirror(rng: Rng) -> Model:
    wide, high = rng.uniform(0.35, 1.0), rng.uniform(0.5, 1.7)
    if rng.random() < 0.2:
        return Model("mirror", (Piece(turn(slab(0.03, wide, 0, 1.7), -0.1, "y"), "mirror"),))
    return Model("mirror", (Piece(slab(0.02, wide, 0, high, x=0.01), "mirror"),), "wall", rng.uniform(0.6, 1.2))


def wall_clock(rng: Rng) -> Model:
    r = rng.uniform(0.1, 0.22)
    disc = turn(cylinder(r, 0, 0.04), np.pi / 2, "y")
    return Model(
        "clock",
        (Piece(move(disc, 0, 0, r), rng.choice(["enamel", "wood", "plastic_dark"])),),
        "wall",
        rng.uniform(1.5, 2.0),
    )


def curtain(rng: Rng) -> Model:
    wide, high = rng.uniform(0.8, 3.0), rng.uniform(1.3, 2.6)
    parts = (
        [(-wide / 2, wide / 2)]
        if rng.random() < 0.4
        else [
            (-wide / 2, -wide / 2 + wide * rng.uniform(0.2, 0.45)),
            (wide / 2 - wide * rng.uniform(0.2, 0.45), wide / 2),
        ]
    )
    sheets = []
    for a, b in parts:
        y = np.linspace(a, b, max(12, int((b - a) * 26)))
        x = 0.06 + rng.uniform(0.02, 0.05) * np.sin(y * rng.uniform(25, 45) + rng.uniform(0, 6))
        z = np.array([0.0, high * 0.5, high])
        sheets.append(
            grid(
                np.stack(
                    [
                        np.broadcast_to(x, (3, len(y))),
                        np.broadcast_to(y, (3, len(y))),
                        np.broadcast_to(z[:, None], (3, len(y))),
                    ],
                    -1,
                )
            )
        )
    rod = tube(((0.06, -wide / 2 - 0.1, high), (0.06, wide / 2 + 0.1, high)), 0.014)
    return Model(
        "curtain",
        (Piece(join(*sheets), "fabric"), Piece(rod, "metal")),
        "wall",
        max(0.02, rng.uniform(2.3, 2.65) - high),
    )


def blind(rng: Rng) -> Model:
    wide, high = rng.uniform(0.6, 1.8), rng.uniform(0.8, 1.6)
    return Model(
        "blind",
        (
            Piece(
                join(
                    *(
                        move(turn(slab(0.03, wide, -0.001, 0.001), 0.5, "y"), 0.04, 0, z)
                        for z in np.arange(0, high, 0.04)
                    )
                ),
                rng.choice(["enamel", "wood"]),
            ),
        ),
        "wall",
        rng.uniform(0.8, 1.0),
    )


def wall_hooks(rng: Rng) -> Model:
    wide = rng.uniform(0.4, 1.0)
    pegs = [tube(((0, y, 0), (0.06, y, 0), (0.08, y, 0.03)), 0.008) for y in np.linspace(-wide * 0.4, wide * 0.4, 5)]
    pieces = [Piece(join(slab(0.02, wide, -0.04, 0.04, x=0.01), *pegs), "wood")]
    for y in np.linspace(-wide * 0.4, wide * 0.4, 5):
        if rng.random() < 0.5:
            pieces.append(
                Piece(ellipsoid(0.14, 0.3, rng.uniform(0.6, 0.95), x=0.1, y=float(y), z=-0.45, power=3), "fabric")
            )
    return Model("coat hooks", tuple(pieces), "wall", rng.uniform(1.5, 1.8))


def kitchen_utensils(rng: Rng) -> Model:
    wide = rng.uniform(0.3, 0.7)
    found = [tube(((0.03, -wide / 2, 0.3), (0.03, wide / 2, 0.3)), 0.008)]
    for y in np.linspace(-wide / 2 + 0.04, wide / 2 - 0.04, rng.integers(3, 7)):
        found += [
            slab(0.008, 0.02, 0.08, 0.29, x=0.04, y=float(y)),
            ellipsoid(0.02, rng.uniform(0.05, 0.09), 0.1, x=0.04, y=float(y), z=0.05),
        ]
    if rng.random() < 0.3:
        pot = cylinder(0.055, 0, 0.14)
        sticks = [
            tube(((0, 0, 0.1), (rng.uniform(-0.06, 0.06), rng.uniform(-0.06, 0.06), 0.32)), 0.008) for _ in range(5)
        ]
        return Model("kitchen utensils", (Piece(join(pot, *sticks), rng.choice(["metal", "wood"])),), "top", 0.9)
    return Model("kitchen utensils", (Piece(join(*found), "metal"),), "wall", rng.uniform(1.1, 1.5))


def sign(rng: Rng) -> Model:
    return Model(
        "sign",
        (Piece(slab(0.01, rng.uniform(0.15, 0.5), 0, rng.uniform(0.12, 0.4), x=0.01), "artwork"),),
        "wall",
        rng.uniform(1.4, 2.1),
    )


def switch(rng: Rng) -> Model:
    return Model(
        "light switch", (Piece(slab(0.012, 0.085, 0, 0.085, x=0.006), "enamel"),), "wall", rng.choice([0.25, 1.05])
    )


def fireplace(rng: Rng) -> Model:
    wide, high = rng.uniform(1.0, 1.6), rng.uniform(0.95, 1.25)
    return Model(
        "fireplace",
        (
            Piece(
                join(
                    *(box(-0.2, 0.2, s * wide / 2 - 0.16, s * wide / 2 + 0.16, 0, high) for s in (-1, 1)),
                    box(-0.2, 0.2, -wide / 2, wide / 2, high * 0.72, high),
                    box(-0.25, 0.28, -wide / 2 - 0.22, wide / 2 + 0.22, high, high + 0.07),
                ),
                "stone",
            ),
            Piece(box(-0.2, -0.18, -wide / 2, wide / 2, 0, high), "plastic_dark"),
        ),
    )


# ------------------------------------------------------------------------------------------------------ plants, textiles, toys
def plant(rng: Rng) -> Model:
    big = rng.random() < 0.6
    pot_r, pot_h = (
        (rng.uniform(0.12, 0.22), rng.uniform(0.2, 0.42)) if big else (rng.uniform(0.05, 0.1), rng.uniform(0.08, 0.15))
    )
    high = rng.uniform(0.7, 1.9) if big else rng.uniform(0.2, 0.5)
    pieces = [Piece(cylinder(pot_r * 0.75, 0, pot_h, top=pot_r), rng.choice(["ceramic", "terracotta", "plastic"]))]
    leaves = []
    for _ in range(int(rng.integers(12, 40))):
        a, tilt, long = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 1.3), rng.uniform(0.25, 0.6) * (high - pot_h)
        z = rng.uniform(pot_h, pot_h + (high - pot_h) * 0.7)
        leaf = turn(ellipsoid(long * rng.uniform(0.15, 0.4), 0.012, long, z=long / 2), tilt, "y")
        leaves.append(move(turn(leaf, a), 0, 0, z))
    pieces += [Piece(join(*leaves), "leaf"), Piece(cylinder(0.012 if not big else 0.025, pot_h, high * 0.8), "wood")]
    return Model("plant", tuple(pieces), "floor" if big else "top", 0.0 if big else 0.7)


def vase(rng: Rng) -> Model:
    h, r = rng.uniform(0.12, 0.45), rng.uniform(0.04, 0.12)
    body = lathe(
        (
            (0, 0),
            (r * rng.uniform(0.5, 0.9), 0),
            (r, h * rng.uniform(0.3, 0.6)),
            (r * rng.uniform(0.3, 0.7), h * 0.85),
            (r * rng.uniform(0.4, 0.9), h),
        )
    )
    pieces = [Piece(body, rng.choice(["ceramic", "glass"]))]
    if rng.random() < 0.4:
        stalks = [
            tube(
                ((0, 0, h * 0.7), (rng.uniform(-0.12, 0.12), rng.uniform(-0.12, 0.12), h + rng.uniform(0.1, 0.3))),
                0.004,
            )
            for _ in range(6)
        ]
        pieces += [
            Piece(join(*stalks), "leaf"),
            Piece(
                join(
                    *(
                        ellipsoid(
                            0.05, 0.05, 0.04, x=float(s[-1, 0, 0]), y=float(s[-1, 0, 1]), z=float(s[..., 2].max())
                        )
                        for s in stalks
                    )
                ),
                "flower",
            ),
        ]
    return Model("vase", tuple(pieces), "top", 0.7)


def cushion(rng: Rng) -> Model:
    a = rng.uniform(0.35, 0.55)
    return Model(
        "cushion", (Piece(turn(ellipsoid(a, a, 0.14, z=0.07, power=4), rng.uniform(0, 3)), "fabric"),), "top", 0.45
    )


def sculpture(rng: Rng) -> Model:
    h = rng.uniform(0.15, 1.2)
    blobs = [
        ellipsoid(h * rng.uniform(0.15, 0.4), h * rng.uniform(0.15, 0.4), h * 0.4, x=rng.uniform(-0.05, 0.05), z=h * z)
        for z in (0.25, 0.5, 0.75)
    ]
    return Model(
        "sculpture",
        (Piece(join(slab(h * 0.3, h * 0.3, 0, h * 0.1), *blobs), rng.choice(["stone", "metal", "wood"])),),
        "top" if h < 0.5 else "floor",
        0.7 if h < 0.5 else 0.0,
    )


def aquarium(rng: Rng) -> Model:
    wide, deep, high = rng.uniform(0.5, 1.4), rng.uniform(0.28, 0.5), rng.uniform(0.35, 0.6)
    return Model(
        "aquarium",
        (Piece(slab(deep, wide, 0, high), "glass"), Piece(slab(deep, wide, high, high + 0.05), "plastic_dark")),
        "top",
        0.7,
    )


def teddy(rng: Rng) -> Model:
    s = rng.uniform(0.2, 0.6)
    blobs = (
        [ellipsoid(s * 0.5, s * 0.55, s * 0.6, z=s * 0.3), ellipsoid(s * 0.4, s * 0.45, s * 0.4, z=s * 0.75)]
        + [ellipsoid(s * 0.5, s * 0.2, s * 0.2, x=s * 0.3, y=y * s * 0.25, z=s * 0.12) for y in (-1, 1)]
        + [ellipsoid(s * 0.2, s * 0.2, s * 0.35, y=y * s * 0.35, z=s * 0.4) for y in (-1, 1)]
    )
    return Model("teddy bear", (Piece(join(*blobs), "fabric"),), "top", 0.45)


def toy(rng: Rng) -> Model:
    return Model(
        "toy",
        (
            Piece(
                join(
                    slab(0.22, 0.12, 0.03, 0.1),
                    slab(0.1, 0.11, 0.1, 0.16),
                    *(ellipsoid(0.06, 0.03, 0.06, x=x, y=y, z=0.03) for x in (-0.07, 0.07) for y in (-0.06, 0.06)),
                ),
                "plastic",
            ),
        ),
    )


def piano(rng: Rng) -> Model:
    wide, high = rng.uniform(1.4, 1.55), rng.uniform(1.0, 1.3)
    return Model(
        "piano",
        (
            Piece(
                join(
                    box(-0.3, 0.05, -wide / 2, wide / 2, 0, high),
                    box(0.05, 0.35, -wide / 2, wide / 2, 0.6, 0.74),
                    *(box(0.25, 0.33, s * wide * 0.45 - 0.04, s * wide * 0.45 + 0.04, 0, 0.6) for s in (-1, 1)),
                ),
                rng.choice(["wood", "plastic_dark"]),
            ),
        ),
    )


def guitar(rng: Rng) -> Model:
    body = join(
        ellipsoid(0.1, 0.38, 0.45, z=0.24, power=2.5), ellipsoid(0.1, 0.28, 0.3, z=0.48), slab(0.03, 0.05, 0.55, 1.0)
    )
    return Model("guitar", (Piece(turn(body, -0.2, "y"), "wood"),))


def person(rng: Rng) -> Model:
    h = rng.uniform(1.5, 1.9)
    legs_ = [cylinder(0.08, 0, h * 0.48, y=y) for y in (-0.1, 0.1)]
    arms = [
        tube(
            (
                (0, s * 0.2, h * 0.8),
                (rng.uniform(-0.1, 0.3), s * 0.27, h * 0.6),
                (rng.uniform(0, 0.4), s * 0.25, h * 0.5),
            ),
            0.045,
        )
        for s in (-1, 1)
    ]
    return Model(
        "person",
        (
            Piece(join(*legs_), "fabric"),
            Piece(join(ellipsoid(0.24, 0.42, h * 0.36, z=h * 0.66, power=3), *arms), "fabric"),
            Piece(ellipsoid(0.2, 0.17, 0.24, z=h - 0.12), "skin"),
        ),
    )


def ladder(rng: Rng) -> Model:
    h = rng.uniform(0.6, 2.0)
    rungs = [box(-0.02, 0.06, -0.2, 0.2, z, z + 0.03) for z in np.arange(0.22, h, 0.25)]
    a = join(*(box(0, 0.04, s * 0.22 - 0.015, s * 0.22 + 0.015, 0, h) for s in (-1, 1)), *rungs)
    b = join(*(box(0, 0.03, s * 0.22 - 0.015, s * 0.22 + 0.015, 0, h) for s in (-1, 1)))
    spread = rng.uniform(0.15, 0.3)
    return Model(
        "ladder",
        (
            Piece(
                join(
                    move(turn(a, -spread, "y"), h * np.sin(spread), 0, 0),
                    move(turn(b, spread, "y"), -h * np.sin(spread), 0, 0),
                ),
                "metal",
            ),
        ),
    )


def clothes_rack(rng: Rng) -> Model:
    wide, h = rng.uniform(0.8, 1.5), rng.uniform(0.9, 1.7)
    if h < 1.15:
        bars = [tube(((x, -wide / 2, h), (x, wide / 2, h)), 0.006) for x in np.linspace(-0.28, 0.28, 8)]
        return Model(
            "drying rack",
            (
                Piece(join(legs(0.55, wide, h, 0.02, round_=True), *bars), "metal"),
                Piece(slab(0.02, wide * 0.4, h - 0.6, h), "fabric"),
            ),
        )
    clothes = [
        Piece(ellipsoid(0.45, 0.08, 0.9, y=float(y), z=h - 0.5, power=3), "fabric")
        for y in np.arange(-wide * 0.4, wide * 0.4, 0.12)
        if rng.random() < 0.7
    ]
    return Model(
        "clothes rack",
        (
            Piece(
                join(
                    *(slab(0.45, 0.04, 0.0, 0.05, y=s * wide / 2) for s in (-1, 1)),
                    *(cylinder(0.015, 0, h, y=s * wide / 2) for s in (-1, 1)),
                    tube(((0, -wide / 2, h), (0, wide / 2, h)), 0.014),
                ),
                "metal",
            ),
            *clothes,
        ),
    )


def ironing_board(rng: Rng) -> Model:
    h = rng.uniform(0.8, 0.95)
    return Model(
        "ironing board",
        (
            Piece(ellipsoid(0.35, 1.25, 0.04, z=h, power=3), "fabric"),
            Piece(join(tube(((0, -0.4, 0), (0, 0.3, h)), 0.015), tube(((0, 0.4, 0), (0, -0.3, h)), 0.015)), "metal"),
        ),
    )


def broom(rng: Rng) -> Model:
    return Model(
        "broom",
        (Piece(tube(((0, 0, 0.1), (-0.2, 0, 1.35)), 0.012), "wood"), Piece(slab(0.07, 0.3, 0, 0.14), "plastic")),
    )


def bucket(rng: Rng) -> Model:
    return Model("bucket", (Piece(cylinder(0.11, 0, 0.3, top=0.15), "plastic"),))


def backpack(rng: Rng) -> Model:
    h = rng.uniform(0.38, 0.55)
    return Model("bag", (Piece(ellipsoid(0.22, h * 0.7, h, z=h / 2, power=4), rng.choice(["fabric", "leather"])),))


def shoes(rng: Rng) -> Model:
    return Model(
        "shoes",
        (
            Piece(
                join(
                    *(
                        join(
                            ellipsoid(0.28, 0.1, 0.08, y=y, z=0.04, power=4),
                            ellipsoid(0.1, 0.09, 0.14, x=-0.08, y=y, z=0.08),
                        )
                        for y in (-0.07, 0.07)
                    )
                ),
                "leather",
            ),
        ),
    )


# ------------------------------------------------------------------------------------------------------ kitchen and table things
def cup(rng: Rng) -> Model:
    r, h = rng.uniform(0.03, 0.05), rng.uniform(0.06, 0.12)
    return Model(
        "cup",
        (
            Piece(
                join(
                    lathe(((0, 0), (r * 0.8, 0), (r, h), (r * 0.9, h), (r * 0.7, 0.01), (0, 0.01))),
                    tube(
                        ((r, 0, h * 0.8), (r + 0.03, 0, h * 0.7), (r + 0.03, 0, h * 0.35), (r * 0.9, 0, h * 0.2)), 0.006
                    ),
                ),
                "ceramic",
            ),
        ),
        "top",
        0.75,
    )


def bowl(rng: Rng) -> Model:
    r = rng.uniform(0.06, 0.18)
    pieces = [
        Piece(
            lathe(((0, 0), (r * 0.4, 0), (r, r * 0.6), (r * 0.95, r * 0.6), (r * 0.35, 0.015), (0, 0.015))),
            rng.choice(["ceramic", "wood", "glass", "metal"]),
        )
    ]
    if rng.random() < 0.4:
        pieces.append(
            Piece(
                join(
                    *(
                        ellipsoid(
                            0.08, 0.08, 0.08, x=rng.uniform(-0.5, 0.5) * r, y=rng.uniform(-0.5, 0.5) * r, z=r * 0.5
                        )
                        for _ in range(5)
                    )
                ),
                "fruit",
            )
        )
    return Model("bowl", tuple(pieces), "top", 0.75)


def plate(rng: Rng) -> Model:
    r = rng.uniform(0.08, 0.16)
    return Model(
        "plate",
        (Piece(lathe(((0, 0), (r * 0.6, 0), (r, 0.02), (r * 0.6, 0.006), (0, 0.006))), "ceramic"),),
        "top",
        0.75,
    )


def tableware(rng: Rng) -> Model:
    found = []
    for _ in range(rng.integers(2, 6)):
        maker = [cup, bowl, plate][rng.integers(3)]
        found.append(move(maker(rng).triangles(), rng.uniform(-0.12, 0.12), rng.uniform(-0.18, 0.18), 0))
    if rng.random() < 0.5:
        found.append(
            join(
                lathe(((0, 0), (0.06, 0.0), (0.09, 0.08), (0.05, 0.15), (0, 0.16))),
                tube(((0.07, 0, 0.06), (0.14, 0, 0.13)), 0.012),
            )
        )
    return Model("tableware", (Piece(join(*found), "ceramic"),), "top", 0.75)


def pot(rng: Rng) -> Model:
    r, h = rng.uniform(0.08, 0.16), rng.uniform(0.05, 0.2)
    handles = (
        tube(((r, 0, h * 0.8), (r + 0.2, 0, h * 0.9)), 0.01)
        if h < 0.1
        else join(*(tube(((0, s * r, h * 0.8), (0.0, s * (r + 0.05), h * 0.8)), 0.01) for s in (-1, 1)))
    )
    return Model("cooking pot", (Piece(join(cylinder(r, 0, h), handles), "metal"),), "top", 0.9)


def bottle(rng: Rng) -> Model:
    r, h = rng.uniform(0.03, 0.05), rng.uniform(0.18, 0.34)
    return Model(
        "bottle",
        (
            Piece(
                lathe(((0, 0), (r, 0), (r, h * 0.62), (r * 0.35, h * 0.8), (r * 0.35, h), (0, h))),
                rng.choice(["glass", "plastic", "glass_dark"]),
            ),
        ),
        "top",
        0.75,
    )


def wine_glass(rng: Rng) -> Model:
    return Model(
        "glass",
        (Piece(lathe(((0, 0), (0.035, 0), (0.005, 0.01), (0.005, 0.09), (0.04, 0.12), (0.035, 0.2))), "glass"),),
        "top",
        0.75,
    )


def jars(rng: Rng) -> Model:
    count, h, r = int(rng.integers(3, 8)), rng.uniform(0.06, 0.16), rng.uniform(0.02, 0.045)
    body = join(
        *(
            join(cylinder(r, 0, h * 0.85, y=k * r * 2.2), cylinder(r * 0.8, h * 0.85, h, y=k * r * 2.2))
            for k in range(count)
        )
    )
    return Model(
        "seasoning jars",
        (Piece(move(body, 0, -count * r * 1.1, 0), rng.choice(["glass", "ceramic", "metal"])),),
        "top",
        0.95,
    )


def knife_block(rng: Rng) -> Model:
    return Model(
        "knife block",
        (
            Piece(turn(slab(0.12, 0.1, 0, 0.22), 0.25, "y"), "wood"),
            Piece(
                join(*(turn(slab(0.02, 0.02, 0.22, 0.33, y=y), 0.25, "y") for y in (-0.03, 0, 0.03))), "plastic_dark"
            ),
        ),
        "top",
        0.9,
    )


def tray(rng: Rng) -> Model:
    return Model(
        "tray",
        (
            Piece(
                slab(rng.uniform(0.25, 0.4), rng.uniform(0.35, 0.55), 0, 0.025),
                rng.choice(["wood", "metal", "plastic"]),
            ),
        ),
        "top",
        0.75,
    )


def soap_dispenser(rng: Rng) -> Model:
    return Model(
        "soap dispenser",
        (Piece(join(cylinder(0.035, 0, 0.13), tube(((0, 0, 0.13), (0, 0, 0.18), (0.05, 0, 0.18)), 0.006)), "plastic"),),
        "top",
        0.85,
    )


def tissue_box(rng: Rng) -> Model:
    return Model("tissue box", (Piece(slab(0.12, 0.23, 0, 0.1), "cardboard"),), "top", 0.7)


def alarm_clock(rng: Rng) -> Model:
    return Model("clock", (Piece(slab(0.06, rng.uniform(0.08, 0.18), 0, 0.09), "plastic_dark"),), "top", 0.55)


def pen_holder(rng: Rng) -> Model:
    return Model(
        "pen holder",
        (
            Piece(
                join(
                    cylinder(0.04, 0, 0.1),
                    *(
                        tube(((0, 0, 0.05), (rng.uniform(-0.04, 0.04), rng.uniform(-0.04, 0.04), 0.18)), 0.004)
                        for _ in range(4)
                    ),
                ),
                "plastic_dark",
            ),
        ),
        "top",
        0.74,
    )


def carpet(rng: Rng) -> Model:
    if rng.random() < 0.3:
        return Model("carpet", (Piece(cylinder(rng.uniform(0.5, 1.2), 0, 0.015), "carpet"),))
    return Model("carpet", (Piece(slab(rng.uniform(0.6, 2.2), rng.uniform(1.0, 3.2), 0, 0.015), "carpet"),))


MAKERS = (
    (floor_lamp, 2),
    (table_lamp, 2),
    (pendant_lamp, 2),
    (chandelier, 2),
    (ceiling_lamp, 1.5),
    (wall_lamp, 2),
    (candle, 0.7),
    (picture, 4),
    (photo_frame, 3),
    (mirror, 2),
    (wall_clock, 1),
    (curtain, 3),
    (blind, 1),
    (wall_hooks, 1),
    (kitchen_utensils, 1),
    (sign, 1),
    (switch, 0.7),
    (fireplace, 0.7),
    (plant, 3),
    (vase, 2),
    (cushion, 1),
    (sculpture, 1),
    (aquarium, 0.7),
    (teddy, 0.7),
    (toy, 0.7),
    (piano, 0.7),
    (guitar, 0.7),
    (person, 1),
    (ladder, 0.7),
    (clothes_rack, 0.7),
    (ironing_board, 0.7),
    (broom, 0.5),
    (bucket, 0.7),
    (backpack, 0.7),
    (shoes, 0.7),
    (cup, 1),
    (bowl, 1),
    (plate, 0.7),
    (tableware, 1),
    (pot, 1),
    (bottle, 1),
    (wine_glass, 0.7),
    (jars, 1),
    (knife_block, 0.5),
    (tray, 0.7),
    (soap_dispenser, 0.7),
    (tissue_box, 0.7),
    (alarm_clock, 0.7),
    (pen_holder, 0.7),
    (carpet, 1),
)
