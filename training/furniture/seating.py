"""Things to sit and lie on."""

from __future__ import annotations

import numpy as np

from training.furniture.solids import (
    Model,
    Piece,
    box,
    cylinder,
    ellipsoid,
    extrude,
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


def bed(rng: Rng) -> Model:
    wide, deep, top = (
        rng.choice([0.9, 1.2, 1.4, 1.6, 1.8, 2.0]) + rng.uniform(0, 0.12),
        rng.uniform(1.95, 2.2),
        rng.uniform(0.38, 0.65),
    )
    frame, head = rng.choice(["wood", "fabric", "metal"]), rng.uniform(0.7, 1.35)
    half, low = wide / 2, rng.uniform(0.04, 0.25)
    x0, x1 = -deep / 2, deep / 2
    pieces = [
        Piece(box(x0, x1, -half, half, low, top - 0.2), frame),
        Piece(box(x0 - 0.07, x0, -half - rng.uniform(0, 0.1), half + rng.uniform(0, 0.1), 0, head), frame),
        Piece(ellipsoid(deep - 0.04, wide - 0.04, 0.28, z=top - 0.12, power=10), "sheet"),
        Piece(
            ellipsoid(deep * rng.uniform(0.55, 0.8), wide + 0.04, 0.24, x=deep * 0.14, z=top - 0.06, power=9), "fabric"
        ),
        Piece(legs(deep, wide, max(low, 0.05), 0.07), frame),
    ]
    if rng.random() < 0.3:
        pieces.append(Piece(box(x1, x1 + 0.05, -half, half, 0, rng.uniform(0.4, 0.8)), frame))
    for k in range(1 if wide < 1.3 else 2):
        y = 0.0 if wide < 1.3 else (k - 0.5) * wide * 0.48
        pieces.append(Piece(ellipsoid(0.42, 0.62, 0.16, x=x0 + 0.28, y=y, z=top + 0.06, power=4), "sheet"))
    return Model("bed", tuple(pieces))


def bunk_bed(rng: Rng) -> Model:
    wide, deep, height = rng.uniform(0.85, 1.1), 2.0, rng.uniform(1.5, 1.8)
    posts = legs(deep, wide, height, 0.08)
    decks = [slab(deep, wide, z, z + 0.12) for z in (0.3, height - 0.45)]
    rails = [
        box(-deep / 2, deep / 2, s * wide / 2 - 0.015, s * wide / 2 + 0.015, height - 0.15, height - 0.05)
        for s in (-1, 1)
    ]
    mattress = [ellipsoid(deep - 0.06, wide - 0.08, 0.16, z=z + 0.19, power=9) for z in (0.3, height - 0.45)]
    ladder = tube(((deep / 2, 0.2, 0), (deep / 2, 0.2, height)), 0.02)
    return Model(
        "bunk bed",
        (Piece(join(posts, *decks, *rails, ladder), rng.choice(["wood", "metal"])), Piece(join(*mattress), "sheet")),
    )


def crib(rng: Rng) -> Model:
    wide, deep, top = rng.uniform(0.6, 0.75), rng.uniform(1.15, 1.4), rng.uniform(0.8, 1.0)
    bars = []
    for s in (-1, 1):
        bars += [
            box(x - 0.01, x + 0.01, s * wide / 2 - 0.01, s * wide / 2 + 0.01, 0.25, top)
            for x in np.linspace(-deep / 2, deep / 2, 14)
        ]
        bars.append(box(-deep / 2, deep / 2, s * wide / 2 - 0.02, s * wide / 2 + 0.02, top - 0.03, top))
        bars.append(box(s * deep / 2 - 0.015, s * deep / 2 + 0.015, -wide / 2, wide / 2, 0.25, top))
    return Model(
        "crib",
        (
            Piece(join(*bars, legs(deep, wide, top, 0.05)), "wood"),
            Piece(ellipsoid(deep, wide, 0.14, z=0.35, power=9), "sheet"),
        ),
    )


def hospital_bed(rng: Rng) -> Model:
    wide, deep, top = rng.uniform(0.85, 1.0), rng.uniform(2.0, 2.2), rng.uniform(0.5, 0.75)
    rails = [box(-0.5, 0.3, s * wide / 2 - 0.02, s * wide / 2 + 0.02, top + 0.05, top + 0.35) for s in (-1, 1)]
    ends = [
        box(s * deep / 2 - 0.03, s * deep / 2 + 0.03, -wide / 2, wide / 2, top - 0.1, top + rng.uniform(0.3, 0.5))
        for s in (-1, 1)
    ]
    under = join(
        slab(deep * 0.7, wide * 0.6, 0.18, 0.35),
        legs(deep * 0.8, wide * 0.9, 0.2, 0.08),
        slab(deep, wide, top - 0.14, top - 0.08),
        cylinder(0.06, 0.3, top - 0.1),
    )
    head = move(
        turn(ellipsoid(0.8, wide - 0.1, 0.14, power=9), -rng.uniform(0.05, 0.6), "y"), -deep / 2 + 0.42, 0, top + 0.12
    )
    return Model(
        "hospital bed",
        (
            Piece(join(*rails, *ends), "plastic"),
            Piece(under, "metal"),
            Piece(join(ellipsoid(deep * 0.62, wide - 0.1, 0.14, x=deep * 0.17, z=top, power=9), head), "sheet"),
        ),
    )


def wheelchair(rng: Rng) -> Model:
    wide = rng.uniform(0.5, 0.65)
    big = [
        turn(cylinder(0.3, -0.015, 0.015), np.pi / 2, "x") + np.array([-0.05, s * wide / 2, 0.3], np.float32)
        for s in (-1, 1)
    ]
    small = [
        turn(cylinder(0.08, -0.015, 0.015), np.pi / 2, "x") + np.array([0.38, s * wide * 0.4, 0.08], np.float32)
        for s in (-1, 1)
    ]
    frame = [
        tube(
            (
                (-0.3, s * wide * 0.42, 0.95),
                (-0.22, s * wide * 0.42, 0.5),
                (0.3, s * wide * 0.42, 0.5),
                (0.45, s * wide * 0.3, 0.12),
            ),
            0.015,
        )
        for s in (-1, 1)
    ]
    return Model(
        "wheelchair",
        (
            Piece(join(*big, *small), "plastic_dark"),
            Piece(join(*frame), "metal"),
            Piece(
                join(slab(0.42, wide * 0.8, 0.48, 0.53), move(slab(0.04, wide * 0.8, 0.0, 0.45), -0.24, 0, 0.5)),
                "fabric",
            ),
        ),
    )


def deck_chair(rng: Rng) -> Model:
    wide, long = rng.uniform(0.55, 0.75), rng.uniform(1.4, 1.95)
    rest = move(turn(slab(0.7, wide, -0.03, 0.03), rng.uniform(0.4, 1.0), "y"), -long / 2 + 0.25, 0, 0.5)
    return Model(
        "lounge chair",
        (
            Piece(slab(long * 0.65, wide, 0.3, 0.36, x=long * 0.17), "fabric"),
            Piece(rest, "fabric"),
            Piece(legs(long, wide, 0.3, 0.05), rng.choice(["wood", "metal"])),
        ),
    )


def high_chair(rng: Rng) -> Model:
    seat = rng.uniform(0.5, 0.62)
    return Model(
        "high chair",
        (
            Piece(legs(0.45, 0.45, seat, 0.035, splay=0.07, round_=True), rng.choice(["wood", "metal", "plastic"])),
            Piece(
                join(
                    slab(0.32, 0.34, seat, seat + 0.04),
                    slab(0.04, 0.34, seat, seat + 0.45, x=-0.16),
                    slab(0.28, 0.44, seat + 0.2, seat + 0.23, x=0.2),
                ),
                "plastic",
            ),
        ),
    )


def mattress(rng: Rng) -> Model:
    return Model(
        "mattress",
        (Piece(ellipsoid(2.0, rng.choice([0.9, 1.4, 1.6]), rng.uniform(0.12, 0.28), z=0.1, power=10), "sheet"),),
    )


def stretcher(rng: Rng) -> Model:
    top = rng.uniform(0.65, 0.9)
    return Model(
        "stretcher",
        (
            Piece(join(legs(1.6, 0.55, top, 0.04), slab(1.9, 0.58, top - 0.04, top)), "metal"),
            Piece(ellipsoid(1.9, 0.55, 0.1, z=top + 0.05, power=9), "leather"),
        ),
    )


def beanbag(rng: Rng) -> Model:
    size = rng.uniform(0.7, 1.0)
    return Model(
        "bean bag",
        (
            Piece(
                join(
                    ellipsoid(size, size, 0.5, z=0.24, power=2.6),
                    ellipsoid(size * 0.6, size * 0.8, 0.5, x=-size * 0.2, z=0.5),
                ),
                "fabric",
            ),
        ),
    )


def extruded_seat(rng: Rng) -> Model:
    """A modern stool of one bent sheet."""
    w = rng.uniform(0.3, 0.5)
    return Model(
        "stool",
        (
            Piece(
                extrude(((-w / 2, -0.15), (w / 2, -0.15), (w / 2, 0.15), (-w / 2, 0.15)), 0, rng.uniform(0.4, 0.5)),
                "wood",
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
    (bed, 3),
    (bunk_bed, 1),
    (crib, 1),
    (hospital_bed, 1),
    (wheelchair, 1),
    (deck_chair, 1),
    (high_chair, 1),
    (mattress, 1),
    (stretcher, 1),
    (beanbag, 1),
    (extruded_seat, 0.3),
)
