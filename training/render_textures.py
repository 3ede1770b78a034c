"""Textures for rendered rooms: a bank of squares with natural statistics, made from noise, and what the catalogues' models bring.

A texture is uint8 [SIDE, SIDE, 3]. Greys around 128 are multiplied by a material's colour; coloured ones stand for themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

SIDE = 128
LEVELS = 6
Texture = NDArray[np.uint8]
Rng = np.random.Generator


def noise(rng: Rng, power: float = 1.0, stretch: float = 1.0) -> NDArray[np.float32]:
    """Noise [SIDE, SIDE] whose amplitude falls off with frequency to ``power``, mean 0, deviation 1, repeating at its edges."""
    fy = np.fft.fftfreq(SIDE)[:, None] * stretch
    fx = np.fft.rfftfreq(SIDE)[None] / stretch
    fall = (fx**2 + fy**2 + (0.5 / SIDE) ** 2) ** (-power / 2)
    wave = fall * np.exp(2j * np.pi * rng.random(fall.shape))
    wave[0, 0] = 0
    field = np.fft.irfft2(wave, (SIDE, SIDE))
    return np.asarray(field / field.std(), np.float32)


def grey(field: NDArray[np.floating], contrast: float) -> Texture:
    """A field of mean 0 as a grey texture around 128."""
    return np.repeat(np.clip(128 * (1 + contrast * field), 0, 255).astype(np.uint8)[..., None], 3, 2)


def plain(rng: Rng) -> Texture:
    return grey(noise(rng, rng.uniform(0.3, 1.6)), rng.uniform(0.0, 0.06))


def speckle(rng: Rng) -> Texture:
    field = noise(rng, rng.uniform(0.0, 0.8))
    return grey(np.sign(field) * np.abs(field) ** 2, rng.uniform(0.03, 0.15))


def wood(rng: Rng) -> Texture:
    rings = np.sin(noise(rng, 1.6, rng.uniform(4, 8)) * rng.uniform(1, 5)) * 0.6 + noise(rng, 0.8, 6) * 0.4
    field = rings
    if rng.random() < 0.4:  # boards
        boards = int(rng.integers(2, 9))
        row = np.arange(SIDE) * boards // SIDE
        field = field + rng.normal(0, 0.8, boards)[row][:, None]
        field[np.diff(row, prepend=-1) > 0] -= rng.uniform(1, 4)
    return grey(field, rng.uniform(0.03, 0.16))


def marble(rng: Rng) -> Texture:
    return grey(-np.abs(noise(rng, 1.5)) * 1.2 + 0.8, rng.uniform(0.05, 0.25))


def weave(rng: Rng) -> Texture:
    y, x = np.mgrid[:SIDE, :SIDE] * (2 * np.pi / SIDE)
    k = int(rng.integers(8, 30))
    return grey(np.sin(k * x) * np.sin(k * y) + noise(rng, 0.7) * 0.5, rng.uniform(0.03, 0.15))


def stripes(rng: Rng) -> Texture:
    count = int(rng.integers(1, 8))
    along = (np.arange(SIDE) * count * 2 // SIDE) % 2
    colours = rng.uniform(30, 250, (2, 3))
    out = np.broadcast_to(colours[along][:, None], (SIDE, SIDE, 3)) + noise(rng)[..., None] * 5
    return np.clip(out if rng.random() < 0.5 else out.swapaxes(0, 1), 0, 255).astype(np.uint8)


def tiles(rng: Rng) -> Texture:
    nx, ny = int(rng.integers(1, 5)), int(rng.integers(1, 9))
    y, x = np.mgrid[:SIDE, :SIDE]
    row = y * ny // SIDE
    shifted = x + (row % 2) * (SIDE // nx // 2 if rng.random() < 0.5 else 0)
    cell = (shifted * nx // SIDE) % nx
    shade = rng.normal(0, 1, (ny, nx))[row, cell] * rng.uniform(0, 1.5)
    edge = np.minimum(y * ny % SIDE, shifted * nx % SIDE) < rng.uniform(2, 8)
    return grey(np.where(edge, rng.choice([-4, 3]), shade + noise(rng) * 0.5), rng.uniform(0.03, 0.12))


def checks(rng: Rng) -> Texture:
    k = int(rng.integers(1, 5)) * 2
    y, x = np.mgrid[:SIDE, :SIDE] * k // SIDE
    colours = rng.uniform(20, 250, (2, 3))
    return np.clip(colours[(x + y) % 2] + noise(rng)[..., None] * 5, 0, 255).astype(np.uint8)


def photograph(rng: Rng) -> Texture:
    """Colours with the statistics of a photograph: correlated 1/f channels, and shapes before them."""
    shared = noise(rng, rng.uniform(1.0, 1.6))
    out = np.stack([shared * 0.8 + noise(rng, 1.3) * 0.5 for _ in range(3)], -1) * rng.uniform(25, 60)
    out = np.clip(out + rng.uniform(60, 190, 3), 0, 255)
    for _ in range(int(rng.integers(0, 12))):
        colour = rng.uniform(0, 255, 3).tolist()
        centre, size = rng.integers(0, SIDE, 2).tolist(), rng.integers(4, 50, 2).tolist()
        layer = cv2.ellipse(
            np.ascontiguousarray(out),
            centre,
            size,
            float(rng.uniform(0, 180)),
            0,
            float(rng.choice([360, 180])),
            colour,
            -1,
        )
        out = layer if rng.random() < 0.8 else 0.5 * (layer + out)
    return cv2.GaussianBlur(out, (0, 0), rng.uniform(0.4, 1.5)).clip(0, 255).astype(np.uint8)


def drawing(rng: Rng) -> Texture:
    """Shapes and lines on paper, or on a carpet: flat colours."""
    out = np.full((SIDE, SIDE, 3), rng.uniform(0, 255, 3))
    palette = rng.uniform(0, 255, (4, 3))
    for _ in range(int(rng.integers(2, 14))):
        a, b = rng.integers(0, SIDE, 2).tolist(), rng.integers(0, SIDE, 2).tolist()
        colour = palette[rng.integers(4)].tolist()
        if rng.random() < 0.5:
            out = cv2.rectangle(np.ascontiguousarray(out), a, b, colour, -1 if rng.random() < 0.6 else 4)
        else:
            out = cv2.line(np.ascontiguousarray(out), a, b, colour, int(rng.integers(1, 8)))
    if rng.random() < 0.5:  # a carpet's or a frame's symmetry
        half = out[: SIDE // 2, : SIDE // 2]
        half = np.concatenate([half, half[::-1]])
        out = np.concatenate([half, half[:, ::-1]], 1)
        for k in range(int(rng.integers(0, 3))):
            at = 3 + 7 * k
            out = cv2.rectangle(np.ascontiguousarray(out), (at, at), (SIDE - at, SIDE - at), palette[k].tolist(), 4)
    return (out + noise(rng)[..., None] * 4).clip(0, 255).astype(np.uint8)


def spines(rng: Rng) -> Texture:
    out, x = np.zeros((SIDE, SIDE, 3)), 0
    while x < SIDE:
        w = int(rng.integers(6, 20))
        out[:, x : x + w] = rng.uniform(10, 240, 3)
        out[rng.integers(0, 60) : rng.integers(60, 128), x + 1 : x + w - 1] *= rng.uniform(0.8, 1.2)
        x += w
    return out.clip(0, 255).astype(np.uint8)


KINDS = {
    "plain": (plain, 10),
    "speckle": (speckle, 10),
    "wood": (wood, 24),
    "marble": (marble, 10),
    "weave": (weave, 12),
    "stripes": (stripes, 8),
    "tiles": (tiles, 14),
    "checks": (checks, 5),
    "photograph": (photograph, 40),
    "drawing": (drawing, 24),
    "spines": (spines, 6),
}


@dataclass(frozen=True, slots=True)
class Bank:
    """levels: the textures uint8 [K, SIDE >> l, SIDE >> l, 3] at halved sides; of_kind: their numbers by kind."""

    levels: tuple[NDArray[np.uint8], ...]
    of_kind: dict[str, tuple[int, ...]]


def bank(rng: Rng, more: list[Texture]) -> Bank:
    """The textures of all kinds; ``more`` come after them, as kind ``model``."""
    made: list[Texture] = []
    of_kind: dict[str, tuple[int, ...]] = {}
    for kind, (maker, count) in KINDS.items():
        of_kind[kind] = tuple(range(len(made), len(made) + count))
        made += [maker(rng) for _ in range(count)]
    of_kind["model"] = tuple(range(len(made), len(made) + len(more)))
    levels = [np.stack(made + more)]
    for _ in range(LEVELS - 1):
        last = levels[-1].astype(np.uint16)
        levels.append(
            ((last[:, ::2, ::2] + last[:, 1::2, ::2] + last[:, ::2, 1::2] + last[:, 1::2, 1::2]) // 4).astype(np.uint8)
        )
    return Bank(tuple(levels), of_kind)
