"""Kitchen and laundry machines."""

from __future__ import annotations

import numpy as np

from training.furniture.solids import (
    Model,
    Piece,
    box,
    cylinder,
    ellipsoid,
    faces,
    join,
    lathe,
    slab,
    tube,
    turn,
)

Rng = np.random.Generator


def _bar(x: float, y: float, z0: float, z1: float) -> Piece:
    return Piece(box(x, x + 0.035, y - 0.012, y + 0.012, z0, z1), "metal")


def refrigerator(rng: Rng) -> Model:
    deep, wide, high = rng.uniform(0.58, 0.85), rng.uniform(0.54, 1.05), rng.uniform(1.4, 2.0)
    x, look = deep / 2, rng.choice(["enamel", "metal"])
    pieces = [Piece(slab(deep, wide, 0.03, high), look)]
    if wide > 0.8:
        pieces += [
            Piece(
                join(
                    box(x, x + 0.03, -wide / 2 + 0.01, -0.005, 0.06, high),
                    box(x, x + 0.03, 0.005, wide / 2 - 0.01, 0.06, high),
                ),
                look,
            ),
            _bar(x + 0.03, -0.05, 0.6, 1.3),
            _bar(x + 0.03, 0.05, 0.6, 1.3),
        ]
    else:
        cut = high * rng.choice([0.35, 0.6, 0.75])
        pieces += [
            Piece(
                join(
                    box(x, x + 0.03, -wide / 2, wide / 2, 0.06, cut - 0.005),
                    box(x, x + 0.03, -wide / 2, wide / 2, cut + 0.005, high),
                ),
                look,
            ),
            _bar(x + 0.03, -wide / 2 + 0.06, cut - 0.35, cut - 0.05),
            _bar(x + 0.03, -wide / 2 + 0.06, cut + 0.05, cut + 0.3),
        ]
    return Model("refrigerator", tuple(pieces))


def chest_freezer(rng: Rng) -> Model:
    wide = rng.uniform(0.7, 1.5)
    return Model(
        "chest freezer", (Piece(join(slab(0.62, wide, 0, 0.8), slab(0.66, wide + 0.02, 0.8, 0.87)), "enamel"),)
    )


def stove(rng: Rng) -> Model:
    """A free-standing cooker."""
    wide, high = rng.uniform(0.5, 0.95), rng.uniform(0.85, 0.93)
    rings = [
        lathe(
            ((0.06, high), (0.085, high), (0.085, high + 0.015), (0.06, high + 0.015)), x=sx * 0.14, y=sy * wide * 0.24
        )
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    knobs = [ellipsoid(0.04, 0.04, 0.04, x=0.31, y=y, z=high - 0.06) for y in np.linspace(-wide * 0.35, wide * 0.35, 5)]
    pieces = [
        Piece(slab(0.6, wide, 0, high), rng.choice(["enamel", "metal"])),
        Piece(join(*rings, *knobs, box(0.3, 0.315, -wide * 0.42, wide * 0.42, 0.2, 0.68)), "plastic_dark"),
        Piece(box(0.32, 0.35, -wide * 0.4, wide * 0.4, 0.7, 0.72), "metal"),
    ]
    if rng.random() < 0.3:
        pieces.append(Piece(box(-0.3, -0.26, -wide / 2, wide / 2, high, high + 0.15), "metal"))
    return Model("stove", tuple(pieces))


def cooktop(rng: Rng) -> Model:
    deep, wide = rng.uniform(0.42, 0.58), rng.uniform(0.5, 1.0)
    rings = [
        lathe(((0.05, 0.02), (0.09, 0.02), (0.09, rng.uniform(0.03, 0.07)), (0.05, 0.04)), x=sx * deep * 0.22, y=y)
        for sx in (-1, 1)
        for y in ([-wide * 0.26, wide * 0.26] if wide < 0.8 else [-wide * 0.32, 0, wide * 0.32])
    ]
    return Model(
        "cooktop",
        (Piece(slab(deep, wide, 0, 0.03), rng.choice(["glass_dark", "metal"])), Piece(join(*rings), "plastic_dark")),
        "top",
        0.9,
    )


def oven(rng: Rng) -> Model:
    wide, high = rng.uniform(0.5, 0.62), rng.uniform(0.4, 0.62)
    return Model(
        "oven",
        (
            Piece(slab(0.5, wide, 0, high), "metal"),
            Piece(box(0.25, 0.265, -wide * 0.45, wide * 0.45, 0.05, high * 0.75), "glass_dark"),
            Piece(box(0.265, 0.3, -wide * 0.4, wide * 0.4, high * 0.8, high * 0.83), "metal"),
        ),
        "top",
        rng.uniform(0.0, 1.2),
    )


def microwave(rng: Rng) -> Model:
    deep, wide, high = rng.uniform(0.3, 0.42), rng.uniform(0.42, 0.56), rng.uniform(0.25, 0.33)
    return Model(
        "microwave",
        (
            Piece(slab(deep, wide, 0, high), rng.choice(["enamel", "metal", "plastic_dark"])),
            Piece(box(deep / 2, deep / 2 + 0.012, -wide * 0.46, wide * 0.2, 0.03, high - 0.03), "glass_dark"),
        ),
        "top",
        0.9,
    )


def range_hood(rng: Rng) -> Model:
    wide, deep = rng.uniform(0.55, 1.3), rng.uniform(0.4, 0.6)
    low = rng.uniform(0.06, 0.25)
    if rng.random() < 0.6:
        low_rect = np.array(
            [[-deep / 2, -wide / 2], [deep / 2, -wide / 2], [deep / 2, wide / 2], [-deep / 2, wide / 2]]
        )
        high_rect = np.array(
            [[-deep / 2, -0.15], [-deep / 2 + 0.28, -0.15], [-deep / 2 + 0.28, 0.15], [-deep / 2, 0.15]]
        )

        vertices = np.vstack(
            [
                np.column_stack([low_rect, np.full(4, low)]),
                np.column_stack([high_rect, np.full(4, low + rng.uniform(0.15, 0.4))]),
            ]
        )
        cone = faces(vertices, [(k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)])
        body = join(
            slab(deep, wide, 0, low), cone, box(-deep / 2, -deep / 2 + 0.28, -0.15, 0.15, low, rng.uniform(0.7, 1.2))
        )
    else:
        body = join(
            slab(deep, wide, 0, low),
            slab(deep * 0.6, wide * rng.uniform(0.3, 0.6), low, rng.uniform(0.4, 0.9), x=-deep * 0.2),
        )
    return Model("range hood", (Piece(body, "metal"),), "wall", rng.uniform(1.4, 1.75))


def washing_machine(rng: Rng) -> Model:
    high = rng.uniform(0.82, 0.9)
    door = turn(lathe(((0.0, 0.0), (0.17, 0.0), (0.2, 0.03), (0.14, 0.05), (0, 0.02))), np.pi / 2, "y") + np.array(
        [0.3, 0, 0.45], np.float32
    )
    return Model(
        "washing machine",
        (
            Piece(slab(rng.uniform(0.5, 0.62), 0.6, 0, high), "enamel"),
            Piece(door, "glass_dark"),
            Piece(box(0.3, 0.32, -0.28, 0.28, high - 0.12, high - 0.02), "plastic_dark"),
        ),
    )


def dishwasher(rng: Rng) -> Model:
    return Model(
        "dishwasher",
        (
            Piece(slab(0.6, rng.uniform(0.45, 0.6), 0, rng.uniform(0.8, 0.87)), rng.choice(["enamel", "metal"])),
            Piece(box(0.3, 0.33, -0.2, 0.2, 0.72, 0.74), "metal"),
        ),
    )


def toaster(rng: Rng) -> Model:
    return Model(
        "toaster",
        (Piece(ellipsoid(0.17, 0.3, 0.2, z=0.1, power=6), rng.choice(["metal", "enamel", "plastic_dark"])),),
        "top",
        0.9,
    )


def kettle(rng: Rng) -> Model:
    return Model(
        "kettle",
        (
            Piece(
                join(
                    cylinder(0.085, 0, 0.2, top=0.065),
                    tube(((0.07, 0, 0.06), (0.13, 0, 0.1), (0.13, 0, 0.2), (0.05, 0, 0.22)), 0.012),
                ),
                rng.choice(["metal", "plastic", "glass"]),
            ),
        ),
        "top",
        0.9,
    )


def coffee_machine(rng: Rng) -> Model:
    high, wide = rng.uniform(0.28, 0.45), rng.uniform(0.18, 0.35)
    return Model(
        "coffee machine",
        (
            Piece(
                join(
                    slab(0.34, wide, 0, 0.05),
                    box(-0.17, -0.02, -wide / 2, wide / 2, 0.05, high),
                    box(-0.02, 0.15, -wide / 2, wide / 2, high * 0.7, high),
                ),
                rng.choice(["plastic_dark", "metal"]),
            ),
            Piece(cylinder(0.05, 0.05, 0.14, x=0.08), "glass"),
        ),
        "top",
        0.9,
    )


def blender(rng: Rng) -> Model:
    return Model(
        "blender",
        (
            Piece(cylinder(0.09, 0, 0.14, top=0.07), "plastic_dark"),
            Piece(cylinder(0.06, 0.14, 0.38, top=0.08), "glass"),
        ),
        "top",
        0.9,
    )


MAKERS = (
    (refrigerator, 3),
    (chest_freezer, 0.5),
    (stove, 2),
    (cooktop, 1.5),
    (oven, 1),
    (microwave, 2),
    (range_hood, 2),
    (washing_machine, 1.5),
    (dishwasher, 1),
    (toaster, 1),
    (kettle, 1),
    (coffee_machine, 1),
    (blender, 1),
)
