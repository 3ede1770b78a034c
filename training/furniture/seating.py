"""Chairs, sofas, stools and benches."""

from __future__ import annotations

import numpy as np

from training.furniture.solids import (
    Model,
    Piece,
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


def back(rng: Rng, width: float, z0: float, z1: float, x: float, lean: float, frame: str, soft: str) -> list[Piece]:
    """A chair's back: panel, slats, bars or cushion, leaning by ``lean`` metres at its top."""
    kind = rng.integers(4)
    thick = rng.uniform(0.02, 0.04)
    height = z1 - z0
    angle = -np.arctan2(lean, height)

    def placed(solid):
        return move(turn(solid, angle, "y"), x, 0, z0)

    posts = [placed(box(-thick, 0, s * width / 2 - 0.018, s * width / 2 + 0.018, 0, height)) for s in (-1, 1)]
    if kind == 0:
        return [Piece(placed(box(-thick, 0, -width / 2, width / 2, rng.uniform(0, 0.4) * height, height)), frame)]
    if kind == 1:
        bars = [
            placed(box(-thick, 0, -width / 2, width / 2, z, z + 0.06))
            for z in np.linspace(0.2, height - 0.06, rng.integers(2, 5))
        ]
        return [Piece(join(*posts, *bars), frame)]
    if kind == 2:
        at = np.linspace(-width / 2 + 0.04, width / 2 - 0.04, rng.integers(3, 8))
        bars = [placed(box(-thick, 0, y - 0.012, y + 0.012, 0.02, height - 0.05)) for y in at]
        return [Piece(join(*posts, *bars, placed(box(-thick, 0, -width / 2, width / 2, height - 0.07, height))), frame)]
    return [Piece(placed(ellipsoid(0.07, width, height * 0.9, z=height * 0.52, power=6)), soft)]


def chair(rng: Rng) -> Model:
    seat_z, deep, wide = rng.uniform(0.42, 0.48), rng.uniform(0.38, 0.5), rng.uniform(0.38, 0.52)
    frame, soft = rng.choice(["wood", "wood", "metal", "plastic"]), rng.choice(["fabric", "leather", "wood", "plastic"])
    if rng.random() < 0.15:  # cantilever
        under = [
            tube(
                ((deep / 2, s * wide / 2, seat_z), (deep / 2, s * wide / 2, 0.02), (-deep / 2, s * wide / 2, 0.02)),
                0.013,
            )
            for s in (-1, 1)
        ]
        base = join(*under)
    elif rng.random() < 0.15:
        base = join(cylinder(0.22, 0, 0.03), cylinder(0.025, 0.03, seat_z))
    else:
        base = legs(
            deep,
            wide,
            seat_z - 0.02,
            rng.uniform(0.025, 0.045),
            taper=rng.uniform(0.6, 1.0),
            splay=rng.choice([0, 0.03, 0.06]),
            round_=bool(rng.integers(2)),
        )
    if rng.random() < 0.3:
        seat = ellipsoid(deep, wide, 0.09, z=seat_z, power=7)
    else:
        seat = slab(deep, wide, seat_z - 0.03, seat_z + rng.uniform(0.0, 0.03))
    top = rng.uniform(0.76, 1.05)
    pieces = [
        Piece(base, frame),
        Piece(seat, soft),
        *back(rng, wide * rng.uniform(0.85, 1), seat_z, top, -deep / 2 + 0.03, rng.uniform(0.02, 0.14), frame, soft),
    ]
    if rng.random() < 0.2:
        pieces.append(Piece(armrests(deep, wide, seat_z, rng.uniform(0.18, 0.24)), frame))
    return Model("chair", tuple(pieces))


def armrests(deep: float, wide: float, seat_z: float, height: float):
    """Two bars with posts."""
    found = []
    for s in (-1, 1):
        y = s * wide / 2
        found += [
            box(-deep / 2, deep / 2 - 0.05, y - 0.025, y + 0.025, seat_z + height - 0.025, seat_z + height),
            box(deep / 2 - 0.09, deep / 2 - 0.05, y - 0.015, y + 0.015, seat_z, seat_z + height),
        ]
    return join(*found)


def office_chair(rng: Rng) -> Model:
    seat_z, wide = rng.uniform(0.43, 0.52), rng.uniform(0.45, 0.54)
    soft = rng.choice(["fabric", "leather", "mesh"])
    feet = [turn(box(0, 0.3, -0.02, 0.02, 0.04, 0.08), k * 2 * np.pi / 5) for k in range(5)]
    wheels = [
        move(ellipsoid(0.05, 0.05, 0.05, z=0.025), 0.29 * np.cos(k * 2 * np.pi / 5), 0.29 * np.sin(k * 2 * np.pi / 5))
        for k in range(5)
    ]
    top = rng.uniform(0.85, 1.25)
    pieces = [
        Piece(join(*feet, *wheels, cylinder(0.03, 0.06, seat_z)), "plastic_dark"),
        Piece(ellipsoid(0.5, wide, 0.11, z=seat_z, power=7), soft),
        Piece(
            move(
                turn(ellipsoid(0.08, wide * 0.95, top - seat_z - 0.08, power=6), -0.12, "y"),
                -0.24,
                0,
                (top + seat_z) / 2 + 0.05,
            ),
            soft,
        ),
    ]
    if rng.random() < 0.7:
        pieces.append(Piece(armrests(0.4, wide + 0.05, seat_z, 0.2), "plastic_dark"))
    return Model("office chair", tuple(pieces))


def armchair(rng: Rng) -> Model:
    return sofa_like(rng, "armchair", rng.uniform(0.7, 1.0), 1)


def sofa(rng: Rng) -> Model:
    if rng.random() < 0.25:
        return corner_sofa(rng)
    seats = int(rng.integers(2, 5))
    return sofa_like(rng, "sofa", seats * rng.uniform(0.6, 0.75) + rng.uniform(0.2, 0.45), seats)


def sofa_like(rng: Rng, name: str, width: float, seats: int) -> Model:
    deep, seat_z, top = rng.uniform(0.75, 1.0), rng.uniform(0.36, 0.48), rng.uniform(0.68, 0.98)
    soft, arm = rng.choice(["fabric", "fabric", "leather"]), rng.uniform(0.08, 0.24)
    arm_top, foot, thick = rng.uniform(0.48, 0.7), rng.uniform(0.0, 0.16), rng.uniform(0.14, 0.26)
    half = width / 2
    pieces = [
        Piece(box(-deep / 2, deep / 2, -half, half, foot, seat_z - 0.12), soft),
        Piece(box(-deep / 2, -deep / 2 + thick * 0.7, -half + arm, half - arm, seat_z - 0.15, top - 0.04), soft),
    ]
    for s in (-1, 1):
        y = s * (half - arm / 2)
        if rng.random() < 0.3:
            pieces.append(
                Piece(
                    join(
                        slab(deep, arm, foot, arm_top - arm / 2, y=y),
                        turn(cylinder(arm / 2, -deep / 2, deep / 2), np.pi / 2, "y")
                        + np.array([0, y, arm_top - arm / 2], np.float32),
                    ),
                    soft,
                )
            )
        else:
            pieces.append(Piece(slab(deep, arm, foot, arm_top, y=y), soft))
    inner = (width - 2 * arm) / seats
    for k in range(seats):
        y = -half + arm + inner * (k + 0.5)
        pieces.append(Piece(ellipsoid(deep - thick, inner, 0.2, x=thick / 2, y=y, z=seat_z - 0.06, power=8), soft))
        pieces.append(
            Piece(
                move(
                    turn(ellipsoid(thick, inner, top - seat_z + 0.06, power=7), -0.15, "y"),
                    -deep / 2 + thick,
                    y,
                    (top + seat_z) / 2,
                ),
                soft,
            )
        )
    if foot > 0.05:
        pieces.append(Piece(legs(deep, width, foot, 0.05), "wood"))
    if rng.random() < 0.4:
        for _ in range(rng.integers(1, 4)):
            pieces.append(
                Piece(
                    move(
                        turn(ellipsoid(0.14, 0.42, 0.42, power=4), -0.3, "y"),
                        -deep / 2 + thick + 0.15,
                        rng.uniform(-half + arm + 0.2, max(half - arm - 0.2, -half + arm + 0.21)),
                        seat_z + 0.2,
                    ),
                    "fabric",
                )
            )
    return Model(name, tuple(pieces))


def corner_sofa(rng: Rng) -> Model:
    main = sofa_like(rng, "sofa", rng.uniform(2.0, 2.8), 3)
    width = float(np.ptp(main.triangles()[..., 1]))
    wing_long, wing = rng.uniform(1.4, 2.3), rng.uniform(0.75, 0.95)
    side = float(rng.choice([-1, 1]))
    soft = main.pieces[0].material
    low = main.triangles().reshape(-1, 3).min(0)
    x0, y = float(low[0]), side * (width / 2 - wing / 2)
    extra = [
        Piece(box(x0, x0 + wing_long, y - wing / 2, y + wing / 2, 0.06, 0.32), soft),
        Piece(ellipsoid(wing_long - 0.2, wing, 0.2, x=x0 + wing_long / 2 + 0.1, y=y, z=0.36, power=8), soft),
    ]
    if rng.random() < 0.6:
        extra.append(
            Piece(
                box(x0, x0 + wing_long, y + side * (wing / 2 - 0.16), y + side * wing / 2, 0.06, 0.75)
                if side > 0
                else box(x0, x0 + wing_long, y - wing / 2, y - wing / 2 + 0.16, 0.06, 0.75),
                soft,
            )
        )
    return Model("sofa", main.pieces + tuple(extra))


def stool(rng: Rng) -> Model:
    height, radius = rng.uniform(0.4, 0.55), rng.uniform(0.14, 0.2)
    return _stool("stool", rng, height, radius)


def bar_stool(rng: Rng) -> Model:
    return _stool("bar stool", rng, rng.uniform(0.62, 0.82), rng.uniform(0.15, 0.2))


def _stool(name: str, rng: Rng, height: float, radius: float) -> Model:
    if rng.random() < 0.4:
        base = join(cylinder(0.2, 0, 0.02), cylinder(0.025, 0.02, height))
    else:
        base = legs(radius * 1.8, radius * 1.8, height, 0.03, splay=rng.uniform(0, 0.07), round_=True)
    seat = (
        cylinder(radius, height - 0.02, height + rng.uniform(0.02, 0.07))
        if rng.random() < 0.7
        else slab(radius * 2, radius * 2, height - 0.02, height + 0.03)
    )
    pieces = [Piece(base, rng.choice(["metal", "wood"])), Piece(seat, rng.choice(["wood", "leather", "plastic"]))]
    if name == "bar stool" and rng.random() < 0.5:
        pieces += back(rng, radius * 1.9, height, height + rng.uniform(0.2, 0.4), -radius, 0.03, "metal", "leather")
    return Model(name, tuple(pieces))


def bench(rng: Rng) -> Model:
    wide, deep, height = rng.uniform(0.9, 1.8), rng.uniform(0.28, 0.45), rng.uniform(0.4, 0.48)
    pieces = [
        Piece(slab(deep, wide, height - 0.05, height), "wood"),
        Piece(legs(deep, wide, height - 0.05, 0.06), rng.choice(["wood", "metal"])),
    ]
    if rng.random() < 0.5:
        pieces += back(rng, wide, height, height + rng.uniform(0.3, 0.45), -deep / 2, 0.08, "wood", "wood")
    return Model("bench", tuple(pieces))


def ottoman(rng: Rng) -> Model:
    if rng.random() < 0.5:
        return Model("ottoman", (Piece(cylinder(rng.uniform(0.22, 0.4), 0.02, rng.uniform(0.34, 0.46)), "fabric"),))
    return Model(
        "ottoman",
        (
            Piece(
                ellipsoid(rng.uniform(0.4, 0.8), rng.uniform(0.4, 0.9), 0.4, z=0.22, power=8),
                rng.choice(["fabric", "leather"]),
            ),
        ),
    )


MAKERS = (
    (chair, 4),
    (office_chair, 2),
    (armchair, 2),
    (sofa, 3),
    (stool, 1),
    (bar_stool, 1),
    (bench, 1),
    (ottoman, 1),
)
