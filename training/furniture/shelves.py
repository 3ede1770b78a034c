"""Shelves, racks, and what things are kept or carried in."""

from __future__ import annotations

import itertools

import numpy as np

from training.furniture.cabinets import cabinet_body
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


def books(rng: Rng, x: float, y0: float, y1: float, z: float, room: float) -> list[Piece]:
    """Things on a shelf board: mostly books."""
    pieces, y = [], y0
    while y < y1 - 0.05:
        wide, tall, deep = rng.uniform(0.015, 0.07), rng.uniform(0.5, 0.92) * room, rng.uniform(0.12, 0.22)
        if rng.random() < 0.12:
            y += rng.uniform(0.05, 0.3)
            continue
        pieces.append(Piece(box(x, x + deep, y, min(y + wide, y1), z, z + tall), "book"))
        y += wide
    return pieces


def bookshelf(rng: Rng) -> Model:
    deep, wide, height = rng.uniform(0.22, 0.42), rng.uniform(0.5, 2.2), rng.uniform(0.9, 2.3)
    count = max(3, round(height / rng.uniform(0.3, 0.42)))
    levels = np.linspace(0.06, height, count)
    frame = [slab(deep, wide, z - 0.02, z) for z in levels]
    frame += [
        box(-deep / 2, deep / 2, y - 0.012, y + 0.012, 0, height)
        for y in np.linspace(-wide / 2, wide / 2, max(2, round(wide / 0.8) + 1))
    ]
    if rng.random() < 0.7:
        frame.append(box(-deep / 2, -deep / 2 + 0.01, -wide / 2, wide / 2, 0, height))
    pieces = [Piece(join(*frame), rng.choice(["wood", "wood", "metal"]))]
    for z, above in itertools.pairwise(levels):
        if rng.random() < 0.8:
            pieces += books(rng, -deep / 2 + 0.02, -wide / 2 + 0.03, wide / 2 - 0.03, z, above - z - 0.03)
    return Model("bookshelf", tuple(pieces))


def rack(rng: Rng) -> Model:
    """Open shelving of posts and boards, with boxes."""
    deep, wide, height = rng.uniform(0.3, 0.8), rng.uniform(0.8, 2.4), rng.uniform(1.4, 2.4)
    levels = np.linspace(0.12, height - 0.05, rng.integers(3, 6))
    pieces = [
        Piece(
            join(legs(deep, wide, height, 0.045), *(slab(deep, wide, z - 0.03, z) for z in levels)),
            rng.choice(["metal", "metal", "wood"]),
        )
    ]
    for z in levels[:-1]:
        y = -wide / 2 + 0.1
        while y < wide / 2 - 0.3:
            w, h = rng.uniform(0.15, 0.45), rng.uniform(0.1, (levels[1] - levels[0]) * 0.8)
            if rng.random() < 0.6:
                pieces.append(
                    Piece(box(-deep * 0.4, deep * 0.4, y, y + w, z, z + h), rng.choice(["cardboard", "plastic"]))
                )
            y += w + rng.uniform(0.02, 0.2)
    return Model("storage rack", tuple(pieces))


def wall_shelf(rng: Rng) -> Model:
    wide, deep = rng.uniform(0.4, 1.5), rng.uniform(0.14, 0.3)
    pieces = [Piece(slab(deep, wide, 0, rng.uniform(0.02, 0.08)), rng.choice(["wood", "glass", "painted"]))]
    if rng.random() < 0.3:
        pieces.append(Piece(slab(deep, wide, 0.3, 0.33), "wood"))
    return Model("shelf", tuple(pieces), "wall", rng.uniform(0.9, 1.8))


def shoe_rack(rng: Rng) -> Model:
    wide, deep, height = rng.uniform(0.5, 1.0), rng.uniform(0.24, 0.36), rng.uniform(0.4, 1.2)
    levels = np.linspace(0.08, height, max(2, round(height / 0.22)))
    pieces = [
        Piece(
            join(legs(deep, wide, height, 0.03), *(slab(deep, wide, z - 0.02, z) for z in levels)),
            rng.choice(["wood", "metal"]),
        )
    ]
    for z in levels[:-1]:
        for y in np.arange(-wide / 2 + 0.1, wide / 2 - 0.05, 0.12):
            if rng.random() < 0.7:
                pieces.append(
                    Piece(
                        ellipsoid(0.26, 0.09, rng.uniform(0.07, 0.12), y=float(y), z=float(z) + 0.05, power=3),
                        "leather",
                    )
                )
    return Model("shoe rack", tuple(pieces))


def coat_rack(rng: Rng) -> Model:
    height = rng.uniform(1.6, 1.95)
    hooks = [
        turn(tube(((0, 0, height - 0.15), (0.12, 0, height - 0.05), (0.16, 0, height)), 0.012), k * np.pi / 3)
        for k in range(6)
    ]
    pieces = [
        Piece(
            join(cylinder(rng.uniform(0.16, 0.25), 0, 0.03), cylinder(0.022, 0.03, height), *hooks),
            rng.choice(["wood", "metal"]),
        )
    ]
    if rng.random() < 0.6:
        pieces.append(Piece(ellipsoid(0.3, 0.45, rng.uniform(0.7, 1.0), x=0.1, z=height - 0.55, power=3), "fabric"))
    return Model("coat rack", tuple(pieces))


def trolley(rng: Rng) -> Model:
    deep, wide, height = rng.uniform(0.4, 0.6), rng.uniform(0.5, 0.95), rng.uniform(0.75, 1.05)
    shelves = [slab(deep, wide, z, z + 0.03) for z in np.linspace(0.15, height - 0.05, rng.integers(2, 4))]
    bar = tube(((-deep / 2, -wide / 2, height + 0.05), (deep / 2, -wide / 2, height + 0.05)), 0.015)
    pieces = [Piece(join(legs(deep, wide, height, 0.03), *shelves, bar), rng.choice(["metal", "plastic"]))]
    for _ in range(rng.integers(0, 4)):
        pieces.append(
            Piece(
                move(
                    slab(0.2, 0.2, 0, rng.uniform(0.08, 0.2)),
                    rng.uniform(-0.1, 0.1),
                    rng.uniform(-wide / 3, wide / 3),
                    height - 0.02,
                ),
                "plastic",
            )
        )
    return Model("trolley", tuple(pieces))


def hand_truck(rng: Rng) -> Model:
    wide, long = rng.uniform(0.5, 0.7), rng.uniform(0.8, 1.2)
    return Model(
        "platform cart",
        (
            Piece(slab(long, wide, 0.14, 0.2), rng.choice(["wood", "metal"])),
            Piece(
                tube(
                    (
                        (-long / 2, -wide / 2, 0.2),
                        (-long / 2, -wide / 2, 0.95),
                        (-long / 2, wide / 2, 0.95),
                        (-long / 2, wide / 2, 0.2),
                    ),
                    0.018,
                ),
                "metal",
            ),
            Piece(
                join(
                    *(
                        move(ellipsoid(0.13, 0.05, 0.13), sx * long * 0.4, sy * wide * 0.4, 0.065)
                        for sx in (-1, 1)
                        for sy in (-1, 1)
                    )
                ),
                "plastic_dark",
            ),
        ),
    )


def crate(rng: Rng) -> Model:
    dx, dy, dz = rng.uniform(0.25, 0.7), rng.uniform(0.25, 0.7), rng.uniform(0.18, 0.6)
    return Model("box", (Piece(slab(dx, dy, 0, dz), rng.choice(["cardboard", "cardboard", "plastic", "wood"])),))


def open_box(rng: Rng) -> Model:
    dx, dy, dz = rng.uniform(0.3, 0.6), rng.uniform(0.3, 0.6), rng.uniform(0.15, 0.4)
    sides = [box(s * dx / 2 - 0.01, s * dx / 2 + 0.01, -dy / 2, dy / 2, 0, dz) for s in (-1, 1)] + [
        box(-dx / 2, dx / 2, s * dy / 2 - 0.01, s * dy / 2 + 0.01, 0, dz) for s in (-1, 1)
    ]
    return Model("box", (Piece(join(slab(dx, dy, 0, 0.02), *sides), rng.choice(["cardboard", "plastic"])),))


def basket(rng: Rng) -> Model:
    r, h = rng.uniform(0.15, 0.28), rng.uniform(0.25, 0.6)
    return Model("basket", (Piece(cylinder(r * 0.85, 0, h, top=r), rng.choice(["wicker", "plastic", "fabric"])),))


def trash_can(rng: Rng) -> Model:
    h, r = rng.uniform(0.25, 0.75), rng.uniform(0.1, 0.22)
    body = slab(r * 1.6, r * 2, 0, h) if rng.random() < 0.3 else cylinder(r * rng.uniform(0.75, 1.0), 0, h, top=r)
    pieces = [Piece(body, rng.choice(["plastic", "metal", "plastic_dark"]))]
    if rng.random() < 0.4:
        pieces.append(Piece(ellipsoid(2 * r, 2 * r, 0.12, z=h), "plastic_dark"))
    return Model("trash can", tuple(pieces))


def suitcase(rng: Rng) -> Model:
    h = rng.uniform(0.5, 0.78)
    return Model(
        "suitcase",
        (
            Piece(ellipsoid(0.26, h * 0.68, h, z=h / 2 + 0.04, power=7), rng.choice(["plastic", "fabric"])),
            Piece(
                tube(((-0.08, -0.1, h), (-0.08, -0.1, h + 0.3), (-0.08, 0.1, h + 0.3), (-0.08, 0.1, h)), 0.01), "metal"
            ),
        ),
    )


def safe(rng: Rng) -> Model:
    a = rng.uniform(0.35, 0.7)
    return Model(
        "safe",
        (
            Piece(slab(a, a, 0, a * rng.uniform(0.9, 1.6)), "metal"),
            Piece(
                cylinder(0.04, 0, 0.04) @ np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0]], np.float32)
                + np.array([a / 2, 0, a / 2], np.float32),
                "metal",
            ),
        ),
    )


def pallet(rng: Rng) -> Model:
    boards = [slab(0.1, 0.8, 0.12, 0.144, x=x) for x in np.linspace(-0.55, 0.55, 8)]
    skids = [slab(1.2, 0.1, 0, 0.12, y=y) for y in (-0.35, 0, 0.35)]
    pieces = [Piece(join(*boards, *skids), "wood")]
    if rng.random() < 0.5:
        pieces.append(Piece(slab(1.1, 0.75, 0.144, rng.uniform(0.4, 1.3)), "cardboard"))
    return Model("pallet", tuple(pieces))


def barrel(rng: Rng) -> Model:
    h, r = rng.uniform(0.55, 0.95), rng.uniform(0.2, 0.32)
    return Model(
        "barrel",
        (
            Piece(
                join(cylinder(r, 0, h / 2, top=r * 1.08), cylinder(r * 1.08, h / 2, h, top=r)),
                rng.choice(["metal", "plastic", "wood"]),
            ),
        ),
    )


def vanity(rng: Rng) -> Model:
    wide, height = rng.uniform(0.8, 1.3), rng.uniform(0.7, 0.8)
    pieces = cabinet_body(rng, 0.42, wide, 0.45, height, drawers=1)
    return Model(
        "dressing table",
        (
            *pieces,
            Piece(legs(0.42, wide, 0.45, 0.05), "wood"),
            Piece(box(-0.2, -0.18, -0.35, 0.35, height, height + rng.uniform(0.5, 0.8)), "mirror"),
        ),
    )


def book_pile(rng: Rng) -> Model:
    pieces, z = [], 0.0
    for _ in range(rng.integers(1, 7)):
        t = rng.uniform(0.012, 0.05)
        pieces.append(
            Piece(
                move(turn(slab(rng.uniform(0.14, 0.22), rng.uniform(0.2, 0.3), 0, t), rng.uniform(-0.4, 0.4)), 0, 0, z),
                "book",
            )
        )
        z += t
    return Model("book", tuple(pieces), "top")


MAKERS = (
    (bookshelf, 2),
    (rack, 1),
    (wall_shelf, 2),
    (shoe_rack, 1),
    (coat_rack, 1),
    (trolley, 1),
    (hand_truck, 0.5),
    (crate, 1),
    (open_box, 0.5),
    (basket, 1),
    (trash_can, 2),
    (suitcase, 1),
    (safe, 0.5),
    (pallet, 0.5),
    (barrel, 0.5),
    (vanity, 0.7),
    (book_pile, 1),
)
