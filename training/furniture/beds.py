"""Beds, and seats for the ill, the small and the garden."""

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
