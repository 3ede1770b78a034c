"""The shell of rendered rooms: walls, floors, doors, windows, beams and partitions."""

from __future__ import annotations

import numpy as np

from training.furniture.solids import box
from training.render_models import Surface, surface
from training.render_yard import CEILING, DOOR, FLOOR, WALL, WINDOW, Yard

Rng = np.random.Generator


def floor_look(yard: Yard) -> Surface:
    return surface(
        str(yard.rng.choice(["wood", "wood", "stone", "carpet", "enamel", "any", "cardboard"])), yard.bank, yard.rng
    )


def wall_look(yard: Yard) -> Surface:
    return surface(
        str(yard.rng.choice(["enamel", "enamel", "enamel", "ceramic", "sheet", "any", "stone", "wood"])),
        yard.bank,
        yard.rng,
    )


def _panel(rng: Rng, start: float, end: float, height: float, gaps) -> list[tuple[float, float, float, float]]:
    """Rectangles (a, b, z0, z1) of a wall with gaps (a, b, z0, z1)."""
    out, at = [], start
    for a, b, z0, z1 in sorted(gaps):
        out.append((at, a, 0.0, height))
        out += [(a, b, 0.0, z0)] if z0 > 0.01 else []
        out += [(a, b, z1, height)] if z1 < height - 0.01 else []
        at = b
    return [*out, (at, end, 0.0, height)]


def _side(room, side: int, a: float, b: float, z0: float, z1: float, back: float, front: float):
    """A box on a wall: along it from a to b, from ``back`` behind its face (negative) to ``front`` before it."""
    x0, y0, x1, y1 = room
    if side == 0:
        return box(x0 + back, x0 + front, a, b, z0, z1)
    if side == 1:
        return box(x1 - front, x1 - back, a, b, z0, z1)
    if side == 2:
        return box(a, b, y0 + back, y0 + front, z0, z1)
    return box(a, b, y1 - front, y1 - back, z0, z1)


def shell(yard: Yard, room, floor: Surface, wall: Surface, ceiling: Surface, gap, k: int, taken) -> None:
    rng, high = yard.rng, yard.height_m
    x0, y0, x1, y1 = room
    yard.shell(box(x0 - 0.3, x1 + 0.3, y0 - 0.3, y1 + 0.3, -0.1, 0.0), FLOOR, floor, rng.uniform(0.5, 2.0))
    yard.shell(box(x0 - 0.3, x1 + 0.3, y0 - 0.3, y1 + 0.3, high, high + 0.1), CEILING, ceiling, rng.uniform(0.5, 2.0))
    frame, leaf = (
        surface(str(rng.choice(["wood", "enamel", "plastic_dark"])), yard.bank, rng),
        surface("wood", yard.bank, rng),
    )
    pane = surface(str(rng.choice(["glass", "lampshade", "artwork"])), yard.bank, rng)
    pane = Surface(pane.texture, pane.colour, pane.gloss, float(rng.uniform(0.2, 0.9)))
    here: list[tuple[int, float, float]] = []
    repeat = rng.uniform(0.4, 2.0)
    skirting = rng.random() < 0.4
    for side in range(4):
        low, end = (y0, y1) if side < 2 else (x0, x1)
        gaps = []
        if gap is not None and ((k == 0 and side == 1) or (k == 1 and side == 0)):
            gaps.append((gap[0], gap[1], 0.0, min(gap[2], high)))
            here.append((side, gap[0] - 0.3, gap[1] + 0.3))
        elif end - low > 1.8 and rng.random() < 0.75:
            kind = rng.choice(["door", "window", "window", "wide"])
            size = {"door": 0.9, "window": rng.uniform(0.6, 1.8), "wide": min(end - low - 0.6, rng.uniform(2, 6))}[
                str(kind)
            ]
            a = rng.uniform(low + 0.2, max(end - 0.2 - size, low + 0.25))
            z0, z1 = (
                (0.0, min(2.05, high))
                if kind == "door"
                else (rng.choice([0.3, 0.8, 0.9, 1.1]), rng.uniform(1.9, high - 0.1))
            )
            gaps.append((a, min(a + size, end - 0.1), z0, z1))
            here.append((side, a - 0.1, a + size + 0.1))
        for a, b, z0, z1 in _panel(rng, low - 0.1, end + 0.1, high, gaps):
            yard.shell(_side(room, side, a, b, z0, z1, -0.1, 0.0), WALL, wall, repeat)
            if skirting and z0 == 0:
                yard.shell(_side(room, side, a, b, 0, 0.09, 0.0, 0.015), WALL, frame)
        for a, b, z0, z1 in gaps:
            _opening(
                yard,
                room,
                side,
                (a, b, z0, z1),
                gap is not None and side < 2 and gaps[0][0] == gap[0],
                frame,
                leaf,
                pane,
            )
    taken.append(here)


def _opening(yard: Yard, room, side: int, at, through: bool, frame: Surface, leaf: Surface, pane: Surface) -> None:
    """A frame, and what fills it: nothing, a door's leaf, panes with bars."""
    rng, (a, b, z0, z1) = yard.rng, at
    part = DOOR if z0 < 0.01 else WINDOW
    rim = rng.uniform(0.03, 0.1)
    for p, q, r, s in ((a - rim, a, z0, z1), (b, b + rim, z0, z1), (a - rim, b + rim, z1, z1 + rim)):
        yard.shell(_side(room, side, p, q, r, s, -0.12, 0.02), part, frame)
    if through:
        return
    if part == DOOR and rng.random() < 0.7:
        yard.shell(_side(room, side, a, b, z0, z1, -0.08, -0.04), DOOR, leaf, 0.8)
        for p, q in ((0.15, 0.45), (0.55, 0.95)):
            if rng.random() < 0.5:
                inner = _side(
                    room, side, a + 0.12, b - 0.12, z0 + (z1 - z0) * p, z0 + (z1 - z0) * (q - 0.03), -0.04, -0.03
                )
                yard.shell(inner, DOOR, leaf, 0.5)
        return
    yard.shell(_side(room, side, a, b, z0, z1, -0.08, -0.06), part, pane, 2.0, flat=True)
    across, up = int(rng.integers(0, max(2, round((b - a) / 0.4)))), int(rng.integers(0, 4))
    bar = rng.uniform(0.015, 0.05)
    for p in np.linspace(a, b, across + 2)[1:-1]:
        yard.shell(_side(room, side, p - bar, p + bar, z0, z1, -0.06, -0.01), part, frame)
    for r in np.linspace(z0, z1, up + 2)[1:-1]:
        yard.shell(_side(room, side, a, b, r - bar, r + bar, -0.06, -0.01), part, frame)
    if part == WINDOW and rng.random() < 0.5:
        yard.shell(_side(room, side, a - 0.05, b + 0.05, z0 - 0.04, z0, -0.1, rng.uniform(0.05, 0.2)), WINDOW, frame)


def beams(yard: Yard, rooms) -> None:
    """Beams, columns and partitions with panes: structure that stands in the room."""
    rng, high = yard.rng, yard.height_m
    x0, y0, x1, y1 = rooms[0]
    look = surface(str(rng.choice(["wood", "enamel", "stone", "plastic_dark"])), yard.bank, rng)
    if rng.random() < 0.2:
        deep = rng.uniform(0.1, 0.3)
        for x in np.arange(x0 + rng.uniform(0.3, 1), x1, rng.uniform(0.8, 2)):
            yard.shell(box(x, x + deep, y0, y1, high - deep, high), WALL, look)  # as in `house`
    if rng.random() < 0.2:
        x, y, w = rng.uniform(x0 + 0.5, x1 - 0.5), rng.uniform(y0 + 0.5, y1 - 0.5), rng.uniform(0.2, 0.4)
        yard.shell(box(x, x + w, y, y + w, 0, high), WALL, look)
        yard.boxes.append((np.array([x, y, 0]), np.array([x + w, y + w, high])))
    if rng.random() < 0.25 and x1 - x0 > 4:  # a partition across a part of the room
        x, end, top = (
            rng.uniform(x0 + 1.5, x1 - 1.5),
            y0 + rng.uniform(0.8, (y1 - y0) * 0.6),
            rng.choice([1.4, 2.1, high]),
        )
        bar, pane = rng.uniform(0.02, 0.05), surface(str(rng.choice(["glass", "enamel", "wood"])), yard.bank, rng)
        for y in np.linspace(y0, end, int(rng.integers(2, 6))):
            yard.shell(box(x - bar, x + bar, y - bar, y + bar, 0, top), WALL, look)
        for z in np.linspace(bar, top - bar, int(rng.integers(2, 6))):
            yard.shell(box(x - bar, x + bar, y0, end, z - bar, z + bar), WALL, look)
        if rng.random() < 0.7:
            yard.shell(box(x - 0.01, x + 0.01, y0, end, 0, top), WALL, pane)
        yard.boxes.append((np.array([x - bar, y0, 0]), np.array([x + bar, end, top])))
