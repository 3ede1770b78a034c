"""Bathroom and kitchen sanitary ware."""

from __future__ import annotations

import numpy as np

from training.furniture.cabinets import cabinet_body
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


MAKERS = (
    (toilet, 2),
    (urinal, 0.7),
    (bidet, 0.7),
    (washbasin, 2),
    (kitchen_sink, 1),
    (bathtub, 1.5),
    (shower, 1),
    (towel_rack, 1),
    (toilet_paper, 0.7),
)
