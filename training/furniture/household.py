"""Plants, textiles, toys, and what lies about a home."""

from __future__ import annotations

import numpy as np

from training.furniture.solids import (
    Model,
    Piece,
    box,
    cylinder,
    ellipsoid,
    join,
    lathe,
    legs,
    move,
    slab,
    tube,
    turn,
)

Rng = np.random.Generator


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


MAKERS = (
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
)
