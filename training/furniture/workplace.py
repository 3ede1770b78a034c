"""What offices, laboratories and clinics have."""

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


MAKERS = (
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
)
