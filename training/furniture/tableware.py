"""Small things of kitchens and tables, and carpets."""

from __future__ import annotations

import numpy as np

from training.furniture.solids import (
    Model,
    Piece,
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


def cup(rng: Rng) -> Model:
    r, h = rng.uniform(0.03, 0.05), rng.uniform(0.06, 0.12)
    return Model(
        "cup",
        (
            Piece(
                join(
                    lathe(((0, 0), (r * 0.8, 0), (r, h), (r * 0.9, h), (r * 0.7, 0.01), (0, 0.01))),
                    tube(
                        ((r, 0, h * 0.8), (r + 0.03, 0, h * 0.7), (r + 0.03, 0, h * 0.35), (r * 0.9, 0, h * 0.2)), 0.006
                    ),
                ),
                "ceramic",
            ),
        ),
        "top",
        0.75,
    )


def bowl(rng: Rng) -> Model:
    r = rng.uniform(0.06, 0.18)
    pieces = [
        Piece(
            lathe(((0, 0), (r * 0.4, 0), (r, r * 0.6), (r * 0.95, r * 0.6), (r * 0.35, 0.015), (0, 0.015))),
            rng.choice(["ceramic", "wood", "glass", "metal"]),
        )
    ]
    if rng.random() < 0.4:
        pieces.append(
            Piece(
                join(
                    *(
                        ellipsoid(
                            0.08, 0.08, 0.08, x=rng.uniform(-0.5, 0.5) * r, y=rng.uniform(-0.5, 0.5) * r, z=r * 0.5
                        )
                        for _ in range(5)
                    )
                ),
                "fruit",
            )
        )
    return Model("bowl", tuple(pieces), "top", 0.75)


def plate(rng: Rng) -> Model:
    r = rng.uniform(0.08, 0.16)
    return Model(
        "plate",
        (Piece(lathe(((0, 0), (r * 0.6, 0), (r, 0.02), (r * 0.6, 0.006), (0, 0.006))), "ceramic"),),
        "top",
        0.75,
    )


def tableware(rng: Rng) -> Model:
    found = []
    for _ in range(rng.integers(2, 6)):
        maker = [cup, bowl, plate][rng.integers(3)]
        found.append(move(maker(rng).triangles(), rng.uniform(-0.12, 0.12), rng.uniform(-0.18, 0.18), 0))
    if rng.random() < 0.5:
        found.append(
            join(
                lathe(((0, 0), (0.06, 0.0), (0.09, 0.08), (0.05, 0.15), (0, 0.16))),
                tube(((0.07, 0, 0.06), (0.14, 0, 0.13)), 0.012),
            )
        )
    return Model("tableware", (Piece(join(*found), "ceramic"),), "top", 0.75)


def pot(rng: Rng) -> Model:
    r, h = rng.uniform(0.08, 0.16), rng.uniform(0.05, 0.2)
    handles = (
        tube(((r, 0, h * 0.8), (r + 0.2, 0, h * 0.9)), 0.01)
        if h < 0.1
        else join(*(tube(((0, s * r, h * 0.8), (0.0, s * (r + 0.05), h * 0.8)), 0.01) for s in (-1, 1)))
    )
    return Model("cooking pot", (Piece(join(cylinder(r, 0, h), handles), "metal"),), "top", 0.9)


def bottle(rng: Rng) -> Model:
    r, h = rng.uniform(0.03, 0.05), rng.uniform(0.18, 0.34)
    return Model(
        "bottle",
        (
            Piece(
                lathe(((0, 0), (r, 0), (r, h * 0.62), (r * 0.35, h * 0.8), (r * 0.35, h), (0, h))),
                rng.choice(["glass", "plastic", "glass_dark"]),
            ),
        ),
        "top",
        0.75,
    )


def wine_glass(rng: Rng) -> Model:
    return Model(
        "glass",
        (Piece(lathe(((0, 0), (0.035, 0), (0.005, 0.01), (0.005, 0.09), (0.04, 0.12), (0.035, 0.2))), "glass"),),
        "top",
        0.75,
    )


def jars(rng: Rng) -> Model:
    count, h, r = int(rng.integers(3, 8)), rng.uniform(0.06, 0.16), rng.uniform(0.02, 0.045)
    body = join(
        *(
            join(cylinder(r, 0, h * 0.85, y=k * r * 2.2), cylinder(r * 0.8, h * 0.85, h, y=k * r * 2.2))
            for k in range(count)
        )
    )
    return Model(
        "seasoning jars",
        (Piece(move(body, 0, -count * r * 1.1, 0), rng.choice(["glass", "ceramic", "metal"])),),
        "top",
        0.95,
    )


def knife_block(rng: Rng) -> Model:
    return Model(
        "knife block",
        (
            Piece(turn(slab(0.12, 0.1, 0, 0.22), 0.25, "y"), "wood"),
            Piece(
                join(*(turn(slab(0.02, 0.02, 0.22, 0.33, y=y), 0.25, "y") for y in (-0.03, 0, 0.03))), "plastic_dark"
            ),
        ),
        "top",
        0.9,
    )


def tray(rng: Rng) -> Model:
    return Model(
        "tray",
        (
            Piece(
                slab(rng.uniform(0.25, 0.4), rng.uniform(0.35, 0.55), 0, 0.025),
                rng.choice(["wood", "metal", "plastic"]),
            ),
        ),
        "top",
        0.75,
    )


def soap_dispenser(rng: Rng) -> Model:
    return Model(
        "soap dispenser",
        (Piece(join(cylinder(0.035, 0, 0.13), tube(((0, 0, 0.13), (0, 0, 0.18), (0.05, 0, 0.18)), 0.006)), "plastic"),),
        "top",
        0.85,
    )


def tissue_box(rng: Rng) -> Model:
    return Model("tissue box", (Piece(slab(0.12, 0.23, 0, 0.1), "cardboard"),), "top", 0.7)


def alarm_clock(rng: Rng) -> Model:
    return Model("clock", (Piece(slab(0.06, rng.uniform(0.08, 0.18), 0, 0.09), "plastic_dark"),), "top", 0.55)


def pen_holder(rng: Rng) -> Model:
    return Model(
        "pen holder",
        (
            Piece(
                join(
                    cylinder(0.04, 0, 0.1),
                    *(
                        tube(((0, 0, 0.05), (rng.uniform(-0.04, 0.04), rng.uniform(-0.04, 0.04), 0.18)), 0.004)
                        for _ in range(4)
                    ),
                ),
                "plastic_dark",
            ),
        ),
        "top",
        0.74,
    )


def carpet(rng: Rng) -> Model:
    if rng.random() < 0.3:
        return Model("carpet", (Piece(cylinder(rng.uniform(0.5, 1.2), 0, 0.015), "carpet"),))
    return Model("carpet", (Piece(slab(rng.uniform(0.6, 2.2), rng.uniform(1.0, 3.2), 0, 0.015), "carpet"),))


MAKERS = (
    (cup, 1),
    (bowl, 1),
    (plate, 0.7),
    (tableware, 1),
    (pot, 1),
    (bottle, 1),
    (wine_glass, 0.7),
    (jars, 1),
    (knife_block, 0.5),
    (tray, 0.7),
    (soap_dispenser, 0.7),
    (tissue_box, 0.7),
    (alarm_clock, 0.7),
    (pen_holder, 0.7),
    (carpet, 1),
)
