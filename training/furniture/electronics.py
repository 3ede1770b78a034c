"""Screens, computers, and what stands beside them."""

from __future__ import annotations

import numpy as np

from training.furniture.solids import (
    Model,
    Piece,
    box,
    cylinder,
    ellipsoid,
    join,
    move,
    slab,
    tube,
    turn,
)

Rng = np.random.Generator


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


MAKERS = (
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
)
