"""Fitness equipment, balls and bicycles."""

from __future__ import annotations

import numpy as np

from training.furniture.solids import (
    Model,
    Piece,
    cylinder,
    ellipsoid,
    join,
    lathe,
    legs,
    move,
    slab,
    tube,
    turn,
)

Rng = np.random.Generator


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
