"""Machines of the rest of a house: air, water, dust."""

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
    move,
    slab,
    tube,
    turn,
)

Rng = np.random.Generator


def air_conditioner(rng: Rng) -> Model:
    wide, high, deep = rng.uniform(0.7, 1.1), rng.uniform(0.25, 0.5), rng.uniform(0.18, 0.26)
    return Model(
        "air conditioner",
        (
            Piece(move(turn(ellipsoid(high, wide, deep, power=7), np.pi / 2, "y"), deep / 2, 0, high / 2), "enamel"),
            Piece(box(deep - 0.03, deep + 0.01, -wide * 0.45, wide * 0.45, 0.02, 0.07), "plastic_dark"),
        ),
        "wall",
        rng.uniform(1.9, 2.3),
        ("wall",),
    )


def standing_air_conditioner(rng: Rng) -> Model:
    wide, deep, high = rng.uniform(0.38, 0.6), rng.uniform(0.28, 0.42), rng.uniform(1.6, 2.05)
    body = slab(deep, wide, 0, high) if rng.random() < 0.7 else cylinder(wide / 2, 0, high)
    return Model(
        "air conditioner",
        (
            Piece(body, "enamel"),
            Piece(box(deep / 2, deep / 2 + 0.015, -wide * 0.4, wide * 0.4, high * 0.65, high * 0.92), "plastic_dark"),
        ),
        "floor",
        0.0,
        ("standing",),
    )


def water_heater(rng: Rng) -> Model:
    high, r = rng.uniform(0.6, 1.1), rng.uniform(0.18, 0.26)
    return Model(
        "water heater",
        (Piece(cylinder(r, 0, high, x=r), "enamel"), Piece(tube(((r, 0.08, -0.3), (r, 0.08, 0.0)), 0.012), "metal")),
        "wall",
        rng.uniform(1.1, 1.5),
    )


def radiator(rng: Rng) -> Model:
    wide, high = rng.uniform(0.4, 1.8), rng.uniform(0.4, 0.9)
    fins = [
        box(0.02, 0.02 + rng.uniform(0.07, 0.13), y, y + 0.045, 0, high) for y in np.arange(-wide / 2, wide / 2, 0.07)
    ]
    return Model(
        "radiator",
        (Piece(join(*fins) if rng.random() < 0.6 else slab(0.1, wide, 0, high, x=0.07), "enamel"),),
        "wall",
        rng.uniform(0.08, 0.18),
    )


def standing_fan(rng: Rng) -> Model:
    high = rng.uniform(0.9, 1.3)
    head = turn(lathe(((0.0, -0.06), (0.2, -0.05), (0.22, 0.0), (0.2, 0.05), (0.0, 0.06))), np.pi / 2, "y") + np.array(
        [0.1, 0, high], np.float32
    )
    return Model(
        "fan",
        (
            Piece(
                join(cylinder(0.2, 0, 0.04), cylinder(0.018, 0.04, high), head),
                rng.choice(["plastic", "plastic_dark", "metal"]),
            ),
        ),
    )


def ceiling_fan(rng: Rng) -> Model:
    r, drop = rng.uniform(0.45, 0.7), rng.uniform(0.25, 0.5)
    blades = [turn(box(0.1, r, -0.07, 0.07, -drop, -drop + 0.02), k * 2 * np.pi / 5) for k in range(5)]
    return Model(
        "ceiling fan",
        (
            Piece(
                join(cylinder(0.02, -drop, 0), cylinder(0.1, -drop - 0.06, -drop + 0.08), *blades),
                rng.choice(["wood", "enamel"]),
            ),
        ),
        "ceiling",
    )


def vacuum_cleaner(rng: Rng) -> Model:
    if rng.random() < 0.4:
        return Model("robot vacuum", (Piece(cylinder(0.17, 0, 0.09), "plastic_dark"),))
    return Model(
        "vacuum cleaner",
        (
            Piece(ellipsoid(0.45, 0.28, 0.26, z=0.14, power=3), "plastic"),
            Piece(
                tube(((0.2, 0, 0.2), (0.5, 0.1, 0.5), (0.7, 0.1, 0.9), (1.0, 0.1, 0.03), (1.05, 0.1, 0.02)), 0.02),
                "plastic_dark",
            ),
        ),
    )


def water_dispenser(rng: Rng) -> Model:
    return Model(
        "water cooler",
        (
            Piece(slab(0.32, 0.32, 0, rng.uniform(0.85, 1.05)), "enamel"),
            Piece(lathe(((0.0, 1.0), (0.06, 1.0), (0.135, 1.1), (0.135, 1.35), (0.0, 1.38))), "glass"),
        ),
    )


def vending_machine(rng: Rng) -> Model:
    wide = rng.uniform(0.75, 1.2)
    return Model(
        "vending machine",
        (
            Piece(slab(rng.uniform(0.7, 0.9), wide, 0, rng.uniform(1.75, 2.0)), rng.choice(["metal", "plastic"])),
            Piece(box(0.4, 0.43, -wide * 0.45, wide * 0.2, 0.5, 1.7), "glass_dark"),
        ),
    )


def sewing_machine(rng: Rng) -> Model:
    return Model(
        "sewing machine",
        (
            Piece(
                join(
                    slab(0.18, 0.42, 0, 0.06),
                    box(-0.06, 0.06, 0.1, 0.2, 0.06, 0.28),
                    box(-0.06, 0.06, -0.18, 0.2, 0.2, 0.3),
                ),
                "enamel",
            ),
        ),
        "top",
        0.75,
    )


MAKERS = (
    (air_conditioner, 1.5),
    (standing_air_conditioner, 1),
    (water_heater, 1),
    (radiator, 1.5),
    (standing_fan, 1),
    (ceiling_fan, 1),
    (vacuum_cleaner, 1),
    (water_dispenser, 1),
    (vending_machine, 0.7),
    (sewing_machine, 0.5),
)
