"""Kitchen, bathroom and laundry machines, screens, office and laboratory equipment."""

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
    legs,
    move,
    slab,
    tube,
    turn,
)
from training.furniture.storage import cabinet_body

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


# ------------------------------------------------------------------------------------------------------ electronics
def television(rng: Rng) -> Model:
    wide = rng.uniform(0.6, 1.6)
    high, thick = wide * rng.uniform(0.55, 0.62), rng.uniform(0.025, 0.09)
    panel = [
        Piece(box(-thick / 2, thick / 2, -wide / 2, wide / 2, 0.0, high), "plastic_dark"),
        Piece(box(thick / 2, thick / 2 + 0.003, -wide / 2 + 0.015, wide / 2 - 0.015, 0.02, high - 0.015), "screen"),
    ]
    if rng.random() < 0.5:
        return Model(
            "television",
            tuple(Piece(move(p.triangles, 0.06), p.material) for p in panel),
            "wall",
            rng.uniform(0.7, 1.4),
        )
    foot = (
        join(slab(0.2, wide * 0.35, 0, 0.015), box(-0.02, 0.02, -0.05, 0.05, 0, 0.08))
        if rng.random() < 0.5
        else join(*(slab(0.22, 0.03, 0, 0.07, y=s * wide * 0.38) for s in (-1, 1)))
    )
    return Model(
        "television",
        (*(Piece(move(p.triangles, 0, 0, 0.06), p.material) for p in panel), Piece(foot, "plastic_dark")),
        "top",
        0.5,
    )


def old_television(rng: Rng) -> Model:
    wide = rng.uniform(0.4, 0.75)
    return Model(
        "television",
        (
            Piece(box(-0.2, 0.2, -wide / 2, wide / 2, 0, wide * 0.82), "plastic_dark"),
            Piece(box(0.2, 0.205, -wide * 0.42, wide * 0.42, 0.08, wide * 0.76), "screen"),
        ),
        "top",
        0.5,
    )


def monitor(rng: Rng) -> Model:
    wide = rng.uniform(0.38, 0.72)
    high = wide * rng.uniform(0.52, 0.7)
    lift = rng.uniform(0.06, 0.16)
    return Model(
        "monitor",
        (
            Piece(
                join(
                    slab(0.18, 0.22, 0, 0.015),
                    box(-0.03, 0, -0.03, 0.03, 0.015, lift + high / 2),
                    box(0, 0.03, -wide / 2, wide / 2, lift, lift + high),
                ),
                "plastic_dark",
            ),
            Piece(box(0.03, 0.033, -wide / 2 + 0.01, wide / 2 - 0.01, lift + 0.015, lift + high - 0.01), "screen"),
        ),
        "top",
        0.74,
    )


def laptop(rng: Rng) -> Model:
    wide = rng.uniform(0.3, 0.39)
    lid = move(
        turn(box(-0.005, 0.005, -wide / 2, wide / 2, 0, wide * 0.66), -rng.uniform(0.1, 0.5), "y"),
        -wide * 0.33,
        0,
        0.015,
    )
    return Model(
        "laptop",
        (Piece(slab(wide * 0.68, wide, 0, 0.018), rng.choice(["metal", "plastic_dark"])), Piece(lid, "screen")),
        "top",
        0.74,
    )


def keyboard(rng: Rng) -> Model:
    return Model(
        "keyboard",
        (
            Piece(
                slab(rng.uniform(0.12, 0.18), rng.uniform(0.36, 0.46), 0, 0.025),
                rng.choice(["plastic", "plastic_dark"]),
            ),
        ),
        "top",
        0.74,
    )


def tablet(rng: Rng) -> Model:
    return Model(
        "tablet", (Piece(slab(rng.uniform(0.12, 0.2), rng.uniform(0.17, 0.28), 0, 0.009), "screen"),), "top", 0.7
    )


def mobile_phone(rng: Rng) -> Model:
    return Model("mobile phone", (Piece(slab(0.075, 0.15, 0, 0.009), "screen"),), "top", 0.7)


def remote_control(rng: Rng) -> Model:
    return Model("remote control", (Piece(slab(0.05, rng.uniform(0.15, 0.22), 0, 0.02), "plastic_dark"),), "top", 0.5)


def telephone(rng: Rng) -> Model:
    return Model(
        "telephone",
        (
            Piece(
                join(slab(0.2, 0.18, 0, 0.06), ellipsoid(0.05, 0.2, 0.05, x=-0.05, z=0.08)),
                rng.choice(["plastic", "plastic_dark"]),
            ),
        ),
        "top",
        0.74,
    )


def computer(rng: Rng) -> Model:
    return Model(
        "computer",
        (
            Piece(
                slab(rng.uniform(0.38, 0.5), rng.uniform(0.17, 0.22), 0, rng.uniform(0.36, 0.48)),
                rng.choice(["plastic_dark", "metal"]),
            ),
        ),
    )


def server_rack(rng: Rng) -> Model:
    wide = rng.choice([0.6, 0.8])
    units = [
        box(0.4, 0.42, -wide * 0.4, wide * 0.4, z, z + 0.04) for z in np.arange(0.2, 1.8, 0.09) if rng.random() < 0.7
    ]
    return Model(
        "server rack",
        (
            Piece(slab(rng.uniform(0.8, 1.05), wide, 0, rng.uniform(1.4, 2.1)), "plastic_dark"),
            Piece(join(*units), "metal"),
        ),
    )


def printer(rng: Rng) -> Model:
    wide, high = rng.uniform(0.36, 0.5), rng.uniform(0.16, 0.36)
    return Model(
        "printer",
        (
            Piece(
                join(slab(0.38, wide, 0, high), box(0.15, 0.3, -wide * 0.35, wide * 0.35, 0.06, 0.08)),
                rng.choice(["plastic", "plastic_dark"]),
            ),
        ),
        "top",
        0.74,
    )


def copier(rng: Rng) -> Model:
    wide, high = rng.uniform(0.55, 0.7), rng.uniform(0.7, 0.9)
    return Model(
        "copier",
        (
            Piece(slab(0.62, wide, 0, high), "plastic"),
            Piece(
                join(slab(0.55, wide, high + 0.08, high + 0.25), slab(0.2, wide, high, high + 0.1, x=-0.2)),
                "plastic_dark",
            ),
        ),
    )


def projector(rng: Rng) -> Model:
    if rng.random() < 0.6:
        return Model(
            "projector", (Piece(join(cylinder(0.02, -0.3, 0), slab(0.28, 0.34, -0.42, -0.3)), "plastic"),), "ceiling"
        )
    return Model("projector", (Piece(slab(0.25, 0.32, 0, 0.11), "plastic"),), "top", 0.74)


def projection_screen(rng: Rng) -> Model:
    wide = rng.uniform(1.6, 2.6)
    return Model(
        "projection screen",
        (
            Piece(slab(0.01, wide, 0, wide * 0.6, x=0.05), "enamel"),
            Piece(slab(0.08, wide + 0.1, wide * 0.6, wide * 0.6 + 0.08, x=0.05), "metal"),
        ),
        "wall",
        rng.uniform(0.8, 1.1),
    )


def speaker(rng: Rng) -> Model:
    if rng.random() < 0.5:
        return Model(
            "speaker",
            (
                Piece(
                    slab(rng.uniform(0.2, 0.32), rng.uniform(0.15, 0.28), 0, rng.uniform(0.7, 1.2)),
                    rng.choice(["wood", "plastic_dark"]),
                ),
            ),
        )
    return Model(
        "speaker", (Piece(slab(0.2, rng.uniform(0.12, 0.24), 0, rng.uniform(0.18, 0.4)), "plastic_dark"),), "top", 0.6
    )


def game_console(rng: Rng) -> Model:
    return Model("game console", (Piece(slab(0.22, 0.3, 0, 0.06), "plastic_dark"),), "top", 0.4)


def router(rng: Rng) -> Model:
    return Model(
        "wifi router",
        (
            Piece(
                join(
                    slab(0.14, 0.22, 0, 0.04),
                    cylinder(0.006, 0.03, 0.18, x=-0.06, y=0.08),
                    cylinder(0.006, 0.03, 0.18, x=-0.06, y=-0.08),
                ),
                "plastic_dark",
            ),
        ),
        "top",
        0.8,
    )


def security_camera(rng: Rng) -> Model:
    if rng.random() < 0.5:
        return Model(
            "security camera",
            (Piece(join(cylinder(0.06, -0.05, 0), ellipsoid(0.1, 0.1, 0.1, z=-0.06)), "plastic"),),
            "ceiling",
        )
    return Model(
        "security camera",
        (
            Piece(
                join(tube(((0, 0, 0), (0.06, 0, 0.02)), 0.012), move(slab(0.16, 0.07, 0, 0.07), 0.12, 0, 0)), "plastic"
            ),
        ),
        "wall",
        rng.uniform(1.8, 2.4),
    )


# ------------------------------------------------------------------------------------------------------ bathroom
def toilet(rng: Rng) -> Model:
    bowl_z = rng.uniform(0.38, 0.45)
    bowl = join(
        lathe(((0.0, 0.0), (0.13, 0.0), (0.12, 0.15), (0.19, bowl_z - 0.05), (0.19, bowl_z), (0.0, bowl_z)))
        * np.array([1.25, 0.98, 1], np.float32),
        ellipsoid(0.46, 0.38, 0.05, z=bowl_z + 0.02, power=3),
    )
    pieces = [Piece(bowl, "ceramic")]
    if rng.random() < 0.75:
        pieces.append(Piece(box(-0.38, -0.2, -0.2, 0.2, bowl_z - 0.05, rng.uniform(0.7, 0.9)), "ceramic"))
    return Model("toilet", tuple(pieces))


def urinal(rng: Rng) -> Model:
    return Model(
        "urinal",
        (Piece(ellipsoid(0.34, 0.36, rng.uniform(0.55, 0.8), x=0.15, z=0.3, power=4), "ceramic"),),
        "wall",
        0.45,
    )


def bidet(rng: Rng) -> Model:
    return Model(
        "bidet",
        (
            Piece(
                lathe(
                    (
                        (0.0, 0.0),
                        (0.13, 0.0),
                        (0.13, 0.15),
                        (0.19, 0.36),
                        (0.19, 0.4),
                        (0.14, 0.38),
                        (0.1, 0.25),
                        (0, 0.24),
                    )
                )
                * np.array([1.4, 0.95, 1], np.float32),
                "ceramic",
            ),
            Piece(tube(((-0.18, 0, 0.38), (-0.18, 0, 0.5), (-0.08, 0, 0.5)), 0.014), "metal"),
        ),
    )


def _tap(x: float, z: float) -> Piece:
    return Piece(tube(((x, 0, z), (x, 0, z + 0.16), (x + 0.11, 0, z + 0.16), (x + 0.12, 0, z + 0.12)), 0.013), "metal")


def washbasin(rng: Rng) -> Model:
    wide, top = rng.uniform(0.45, 0.75), rng.uniform(0.78, 0.88)
    bowl = lathe(
        ((0.0, -0.16), (0.1, -0.16), (0.24, 0.0), (0.26, 0.0), (0.25, -0.02), (0.09, -0.19), (0, -0.19))
    ) * np.array([0.85, wide / 0.52, 1], np.float32)
    kind = rng.random()
    if kind < 0.35:
        return Model(
            "washbasin",
            (
                Piece(join(move(bowl, 0.25, 0, top), cylinder(0.09, 0, top - 0.16, x=0.15, top=0.11)), "ceramic"),
                _tap(0.04, top),
            ),
        )
    if kind < 0.75:
        pieces = cabinet_body(rng, 0.44, max(wide, 0.55), rng.choice([0.0, 0.3]), top - 0.05, doors=2)
        return Model(
            "washbasin",
            (
                *pieces,
                Piece(
                    join(slab(0.48, max(wide, 0.55) + 0.02, top - 0.05, top), move(bowl, 0, 0, top + 0.05)), "ceramic"
                ),
                _tap(-0.18, top),
            ),
        )
    return Model(
        "washbasin",
        (Piece(join(move(slab(0.44, wide, -0.16, 0), 0.22, 0, top)), "ceramic"), _tap(0.04, top)),
        "wall",
        0.0,
    )


def kitchen_sink(rng: Rng) -> Model:
    wide = rng.uniform(0.5, 1.1)
    rim = [box(s * 0.2 - 0.03, s * 0.2 + 0.03, -wide / 2, wide / 2, 0, 0.012) for s in (-1, 1)] + [
        box(-0.23, 0.23, s * wide / 2 - 0.03, s * wide / 2 + 0.03, 0, 0.012) for s in (-1, 1)
    ]
    return Model(
        "sink", (Piece(join(*rim, slab(0.36, wide - 0.1, -0.16, -0.15)), "metal"), _tap(-0.2, 0.0)), "top", 0.9
    )


def bathtub(rng: Rng) -> Model:
    wide, long, high = rng.uniform(0.68, 0.85), rng.uniform(1.5, 1.8), rng.uniform(0.5, 0.62)
    if rng.random() < 0.3:
        shell = lathe(((0.0, 0.03), (0.24, 0.03), (0.36, high), (0.34, high), (0.22, 0.15), (0.0, 0.12))) * np.array(
            [1, long / 0.72, 1], np.float32
        )
        return Model("bathtub", (Piece(shell, "ceramic"),))
    w, half = wide / 2, long / 2
    walls = [
        box(-w, w, -half, half, 0, 0.14),
        box(-w, -w + 0.07, -half, half, 0.14, high),
        box(w - 0.07, w, -half, half, 0.14, high),
        box(-w, w, -half, -half + 0.1, 0.14, high),
        box(-w, w, half - 0.1, half, 0.14, high),
    ]
    return Model(
        "bathtub",
        (
            Piece(join(*walls), "ceramic"),
            Piece(
                tube(((0, -half + 0.05, high), (0, -half + 0.05, high + 0.15), (0, -half + 0.18, high + 0.15)), 0.015),
                "metal",
            ),
        ),
    )


def shower(rng: Rng) -> Model:
    a, high = rng.uniform(0.8, 1.1), rng.uniform(1.85, 2.1)
    frame = [cylinder(0.015, 0, high, x=sx * a / 2, y=sy * a / 2) for sx in (-1, 1) for sy in (-1, 1)]
    glass = [
        box(a / 2 - 0.005, a / 2 + 0.005, -a / 2, a / 2, 0.12, high),
        box(-a / 2, a / 2, a / 2 - 0.005, a / 2 + 0.005, 0.12, high),
    ]
    return Model(
        "shower",
        (
            Piece(slab(a, a, 0, 0.1), "ceramic"),
            Piece(join(*glass), "glass"),
            Piece(
                join(*frame, tube(((-a / 2 + 0.05, 0, 0.9), (-a / 2 + 0.05, 0, 2.0), (-a / 2 + 0.3, 0, 2.0)), 0.012)),
                "metal",
            ),
        ),
    )


def towel_rack(rng: Rng) -> Model:
    wide = rng.uniform(0.4, 0.65)
    pieces = [Piece(tube(((0.08, -wide / 2, 0.6), (0.08, wide / 2, 0.6)), 0.01), "metal")]
    pieces.append(Piece(slab(0.03, wide * rng.uniform(0.5, 0.9), 0.05, 0.61, x=0.08), "fabric"))
    return Model("towel", tuple(pieces), "wall", rng.uniform(0.6, 1.0))


def toilet_paper(rng: Rng) -> Model:
    return Model(
        "toilet paper holder",
        (Piece(turn(cylinder(0.055, -0.05, 0.05), np.pi / 2, "x") + np.array([0.07, 0, 0], np.float32), "sheet"),),
        "wall",
        rng.uniform(0.6, 0.8),
    )


# ------------------------------------------------------------------------------------------------------ office and laboratory
def whiteboard(rng: Rng) -> Model:
    wide, high = rng.uniform(0.9, 2.4), rng.uniform(0.8, 1.25)
    panel = Piece(slab(0.02, wide, 0, high, x=0.03), "enamel")
    tray = Piece(box(0.03, 0.1, -wide / 2, wide / 2, -0.02, 0), "metal")
    if rng.random() < 0.75:
        return Model("whiteboard", (panel, tray), "wall", rng.uniform(0.8, 1.1))
    stand = join(
        *(slab(0.5, 0.04, 0.05, 0.08, y=s * wide * 0.45) for s in (-1, 1)),
        *(slab(0.04, 0.04, 0.05, 0.9 + high, y=s * wide / 2) for s in (-1, 1)),
    )
    return Model("whiteboard", (Piece(move(panel.triangles, 0, 0, 0.9), "enamel"), Piece(stand, "metal")))


def notice_board(rng: Rng) -> Model:
    wide, high = rng.uniform(0.6, 1.5), rng.uniform(0.5, 1.0)
    sheets = [
        slab(0.003, 0.2, z, z + 0.28, x=0.04, y=y)
        for y in np.arange(-wide / 2 + 0.15, wide / 2 - 0.1, 0.25)
        for z in (0.05, high - 0.35)
        if rng.random() < 0.7
    ]
    return Model(
        "notice board",
        (Piece(slab(0.025, wide, 0, high, x=0.02), "cork"), *([Piece(join(*sheets), "sheet")] if sheets else [])),
        "wall",
        rng.uniform(1.0, 1.3),
    )


def microscope(rng: Rng) -> Model:
    s = rng.uniform(0.85, 1.2)
    body = join(
        slab(0.26, 0.2, 0, 0.05),
        box(-0.12, -0.05, -0.05, 0.05, 0.05, 0.34),
        box(-0.12, 0.1, -0.045, 0.045, 0.3, 0.38),
        cylinder(0.03, 0.2, 0.3, x=0.06),
        slab(0.16, 0.16, 0.13, 0.15),
        turn(cylinder(0.02, 0, 0.15), -0.6, "y") + np.array([-0.05, 0, 0.37], np.float32),
    )
    return Model(
        "microscope",
        (Piece((body * np.float32(s)).astype(np.float32), rng.choice(["enamel", "plastic_dark"])),),
        "top",
        0.9,
    )


def centrifuge(rng: Rng) -> Model:
    a = rng.uniform(0.3, 0.6)
    return Model(
        "centrifuge",
        (Piece(join(slab(a, a * 1.1, 0, a * 0.6), cylinder(a * 0.42, a * 0.6, a * 0.68)), "enamel"),),
        "top",
        0.9,
    )


def fume_hood(rng: Rng) -> Model:
    wide, high = rng.uniform(1.0, 1.9), rng.uniform(2.1, 2.5)
    w = wide / 2
    return Model(
        "fume hood",
        (
            Piece(
                join(
                    slab(0.8, wide, 0, 0.88),
                    box(-0.4, -0.34, -w, w, 0.88, high),
                    box(-0.34, 0.36, -w, -w + 0.07, 0.88, 1.7),
                    box(-0.34, 0.36, w - 0.07, w, 0.88, 1.7),
                    box(-0.34, 0.38, -w, w, 1.7, high),
                ),
                rng.choice(["enamel", "metal"]),
            ),
            Piece(box(0.34, 0.36, -w + 0.07, w - 0.07, rng.uniform(1.0, 1.4), 1.7), "glass"),
        ),
    )


def gas_cylinder(rng: Rng) -> Model:
    r, h = rng.uniform(0.09, 0.14), rng.uniform(0.6, 1.45)
    return Model(
        "gas cylinder",
        (
            Piece(
                lathe(((0, 0), (r, 0), (r, h - 0.12), (r * 0.4, h), (0.03, h + 0.02), (0.03, h + 0.12), (0, h + 0.12))),
                "metal_paint",
            ),
        ),
    )


def fire_extinguisher(rng: Rng) -> Model:
    r, h = rng.uniform(0.06, 0.09), rng.uniform(0.38, 0.55)
    body = join(
        lathe(((0, 0), (r, 0), (r, h - 0.1), (r * 0.4, h), (0, h))),
        slab(0.12, 0.03, h, h + 0.05),
        tube(((0.03, 0, h), (r + 0.04, 0, h - 0.1), (r + 0.03, 0, h * 0.4)), 0.01),
    )
    if rng.random() < 0.6:
        return Model("fire extinguisher", (Piece(move(body, 0.1), "red"),), "wall", rng.uniform(0.4, 0.9))
    return Model("fire extinguisher", (Piece(body, "red"),))


def first_aid_box(rng: Rng) -> Model:
    return Model(
        "first aid kit",
        (Piece(slab(0.14, rng.uniform(0.28, 0.4), 0, rng.uniform(0.25, 0.4), x=0.07), rng.choice(["enamel", "red"])),),
        "wall",
        rng.uniform(1.2, 1.6),
    )


def iv_stand(rng: Rng) -> Model:
    h = rng.uniform(1.6, 2.0)
    feet = [turn(box(0, 0.28, -0.015, 0.015, 0.03, 0.06), k * 2 * np.pi / 5) for k in range(5)]
    return Model(
        "IV stand",
        (
            Piece(join(*feet, cylinder(0.012, 0.05, h), tube(((0, -0.12, h), (0, 0.12, h)), 0.008)), "metal"),
            Piece(ellipsoid(0.03, 0.12, 0.22, y=0.1, z=h - 0.15, power=4), "plastic"),
        ),
    )


def patient_monitor(rng: Rng) -> Model:
    return Model(
        "patient monitor",
        (
            Piece(
                join(
                    *(turn(box(0, 0.28, -0.015, 0.015, 0.03, 0.06), k * 2 * np.pi / 5) for k in range(5)),
                    cylinder(0.02, 0.05, 1.1),
                    slab(0.3, 0.35, 0.75, 0.8),
                ),
                "metal",
            ),
            Piece(slab(0.14, 0.34, 1.1, 1.38), "screen"),
        ),
    )


def surgical_lamp(rng: Rng) -> Model:
    return Model(
        "surgical lamp",
        (
            Piece(
                join(
                    cylinder(0.04, -0.5, 0),
                    tube(((0, 0, -0.45), (0.6, 0, -0.5), (0.7, 0, -0.9)), 0.025),
                    lathe(((0, -0.82), (0.3, -0.9), (0.3, -1.0), (0, -0.98)), x=0.7),
                ),
                "enamel",
            ),
        ),
        "ceiling",
    )


def privacy_screen(rng: Rng) -> Model:
    panels = [
        move(turn(slab(0.02, 0.6, 0.15, 1.75), a), 0, y, 0) for a, y in ((0.35, -0.58), (-0.35, 0.0), (0.35, 0.58))
    ]
    return Model("folding screen", (Piece(join(*panels), rng.choice(["fabric", "wood"])),))


def treadmill(rng: Rng) -> Model:
    return Model(
        "treadmill",
        (
            Piece(slab(rng.uniform(1.4, 1.8), rng.uniform(0.6, 0.8), 0.05, 0.2), "plastic_dark"),
            Piece(
                join(
                    *(tube(((0.6, s * 0.32, 0.2), (0.75, s * 0.32, 1.2), (0.4, s * 0.32, 1.0)), 0.03) for s in (-1, 1)),
                    slab(0.1, 0.65, 1.15, 1.4, x=0.75),
                ),
                "metal",
            ),
        ),
    )


def exercise_bike(rng: Rng) -> Model:
    return Model(
        "exercise bike",
        (
            Piece(
                join(
                    tube(((-0.4, -0.25, 0.03), (-0.4, 0.25, 0.03)), 0.03),
                    tube(((0.45, -0.25, 0.03), (0.45, 0.25, 0.03)), 0.03),
                    tube(((-0.4, 0, 0.05), (-0.25, 0, 0.85)), 0.03),
                    tube(((0.45, 0, 0.05), (0.3, 0, 1.15), (0.2, 0, 1.2)), 0.03),
                    tube(((-0.3, 0, 0.4), (0.4, 0, 0.4)), 0.04),
                ),
                "metal",
            ),
            Piece(
                join(
                    turn(cylinder(0.24, -0.04, 0.04), np.pi / 2, "x") + np.array([0.3, 0, 0.32], np.float32),
                    ellipsoid(0.28, 0.2, 0.09, x=-0.25, z=0.9),
                ),
                "plastic_dark",
            ),
        ),
    )


def weight_bench(rng: Rng) -> Model:
    long = rng.uniform(1.0, 1.4)
    pieces = [
        Piece(
            join(
                slab(long * 0.6, 0.28, 0.4, 0.48, x=0.1),
                move(turn(slab(0.6, 0.28, -0.04, 0.04), rng.uniform(0, 0.9), "y"), -long / 2 + 0.15, 0, 0.55),
            ),
            "leather",
        ),
        Piece(
            join(
                legs(long, rng.uniform(0.4, 1.0), 0.42, 0.06),
                *(cylinder(0.025, 0, rng.uniform(0.85, 1.2), x=-long * 0.4, y=s * 0.45) for s in (-1, 1)),
            ),
            "metal",
        ),
    ]
    if rng.random() < 0.6:
        pieces.append(
            Piece(
                join(
                    tube(((-long * 0.4, -0.8, 0.95), (-long * 0.4, 0.8, 0.95)), 0.014),
                    *(
                        turn(cylinder(0.19, -0.03, 0.03), np.pi / 2, "x")
                        + np.array([-long * 0.4, s * 0.65, 0.95], np.float32)
                        for s in (-1, 1)
                    ),
                ),
                "plastic_dark",
            )
        )
    return Model("weight bench", tuple(pieces))


def dumbbell(rng: Rng) -> Model:
    long, r = rng.choice([0.25, 0.35, 1.3]) * rng.uniform(0.9, 1.15), rng.uniform(0.06, 0.2)
    discs = [
        turn(cylinder(r, -0.05, 0.05), np.pi / 2, "x") + np.array([0, s * long * 0.38, r], np.float32) for s in (-1, 1)
    ]
    return Model("dumbbell", (Piece(join(tube(((0, -long / 2, r), (0, long / 2, r)), 0.014), *discs), "plastic_dark"),))


def exercise_ball(rng: Rng) -> Model:
    d = rng.uniform(0.5, 0.78)
    return Model("exercise ball", (Piece(ellipsoid(d, d, d, z=d / 2), "plastic"),))


def small_ball(rng: Rng) -> Model:
    d = rng.uniform(0.1, 0.26)
    return Model("ball", (Piece(ellipsoid(d, d, d, z=d / 2), rng.choice(["plastic", "leather"])),))


def bicycle(rng: Rng) -> Model:
    wheels = [
        turn(lathe(((0.31, -0.02), (0.34, 0.0), (0.31, 0.02), (0.31, -0.02))), np.pi / 2, "x")
        + np.array([x, 0, 0.34], np.float32)
        for x in (-0.52, 0.52)
    ]
    frame = join(
        tube(((-0.52, 0, 0.34), (-0.05, 0, 0.3), (0.4, 0, 0.78)), 0.02),
        tube(((-0.05, 0, 0.3), (-0.18, 0, 0.85)), 0.02),
        tube(((-0.15, 0, 0.72), (0.38, 0, 0.75)), 0.02),
        tube(((0.52, 0, 0.34), (0.36, 0, 0.95)), 0.02),
        tube(((0.36, -0.28, 1.0), (0.36, 0.28, 1.0)), 0.014),
    )
    return Model(
        "bicycle",
        (
            Piece(join(*wheels), "plastic_dark"),
            Piece(frame, "metal_paint"),
            Piece(ellipsoid(0.26, 0.14, 0.07, x=-0.18, z=0.9), "leather"),
        ),
    )


def yoga_mat(rng: Rng) -> Model:
    if rng.random() < 0.5:
        return Model("yoga mat", (Piece(slab(0.61, 1.75, 0, 0.012), "plastic"),))
    return Model(
        "yoga mat",
        (Piece(turn(cylinder(0.06, -0.3, 0.3), np.pi / 2, "x") + np.array([0, 0, 0.06], np.float32), "plastic"),),
    )


def punching_bag(rng: Rng) -> Model:
    return Model(
        "punching bag", (Piece(join(cylinder(0.17, -1.9, -0.7), cylinder(0.01, -0.7, 0)), "leather"),), "ceiling"
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
    (television, 3),
    (old_television, 0.5),
    (monitor, 2),
    (laptop, 1.5),
    (keyboard, 1),
    (tablet, 1),
    (mobile_phone, 0.7),
    (remote_control, 0.7),
    (telephone, 0.7),
    (computer, 1),
    (server_rack, 0.7),
    (printer, 1),
    (copier, 0.7),
    (projector, 1),
    (projection_screen, 0.7),
    (speaker, 1),
    (game_console, 0.5),
    (router, 0.7),
    (security_camera, 1),
    (toilet, 2),
    (urinal, 0.7),
    (bidet, 0.7),
    (washbasin, 2),
    (kitchen_sink, 1),
    (bathtub, 1.5),
    (shower, 1),
    (towel_rack, 1),
    (toilet_paper, 0.7),
    (whiteboard, 1.5),
    (notice_board, 1),
    (microscope, 1.5),
    (centrifuge, 1),
    (fume_hood, 1.5),
    (gas_cylinder, 1.5),
    (fire_extinguisher, 1),
    (first_aid_box, 0.7),
    (iv_stand, 0.7),
    (patient_monitor, 0.5),
    (surgical_lamp, 0.5),
    (privacy_screen, 0.7),
    (treadmill, 0.7),
    (exercise_bike, 0.7),
    (weight_bench, 1),
    (dumbbell, 1),
    (exercise_ball, 1),
    (small_ball, 0.7),
    (bicycle, 0.7),
    (yoga_mat, 0.7),
    (punching_bag, 0.5),
)
