"""Lights, and what hangs on walls."""

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
)
