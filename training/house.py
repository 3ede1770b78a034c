"""Empty buildings without end: rooms split off a rectangle, walls with doors and windows of many kinds, ceilings with beams.

Every triangle knows what it is part of (``Structure``). What a door, a window or a wall is follows the scenes that people mark by hand: frames,
leaves, handles and glass of a doorway are door; panes, frames and sills are window; lintels, pillars, skirting boards and free-standing
partitions and beams are wall; coves are ceiling; carpets are floor.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from irsd.core.types import Structure
from training.furniture.solids import Triangles, box, turn

Rect = tuple[float, float, float, float]  # x0, y0, x1, y1
Rng = np.random.Generator


@dataclass(frozen=True, slots=True)
class Room:
    """Inner rectangle and ceiling height."""

    rect: Rect
    height_m: float


@dataclass(frozen=True, slots=True)
class Opening:
    """A window or doorway seen from above (for curtains, and to keep furniture off doors): its middle, half width, along x or y, kind."""

    x_m: float
    y_m: float
    half_m: float
    along_x: bool
    kind: str  # door | window


@dataclass
class Shell:
    """Triangles [T, 3, 3] with the structure [T] of each, rooms and openings."""

    rooms: list[Room] = field(default_factory=list)
    openings: list[Opening] = field(default_factory=list)
    solids: list[Triangles] = field(default_factory=list)
    classes: list[NDArray[np.uint8]] = field(default_factory=list)

    def add(self, solid: Triangles, kind: Structure) -> None:
        """One more solid of a class."""
        self.solids.append(solid)
        self.classes.append(np.full(len(solid), kind, np.uint8))


@dataclass(frozen=True, slots=True)
class _Wall:
    """A wall in its own frame: u along it from 0, v across from 0 to thick, and how that frame lies in the building."""

    x_m: float
    y_m: float
    along_x: bool
    length_m: float
    thick_m: float
    height_m: float
    outer: int  # which face is outside: -1 the one at v = 0, +1 the other, 0 neither
    joints: tuple[float, ...]  # u at which other walls meet it

    def place(self, solid: Triangles) -> Triangles:
        """Own frame to the building's."""
        out = solid if self.along_x else solid[..., [1, 0, 2]]
        return np.asarray(out + np.float32([self.x_m, self.y_m, 0]), np.float32)


def make_shell(rng: Rng) -> Shell:
    """A building of one to five rooms."""
    shell = Shell()
    wide, deep = float(rng.uniform(3.0, 13.0)), float(rng.uniform(3.0, 9.0))
    height = float(rng.uniform(2.3, 3.1) if rng.random() < 0.85 else rng.uniform(3.1, 5.0))
    outer, inner = float(rng.uniform(0.1, 0.35)), float(rng.uniform(0.06, 0.22))
    cuts: list[tuple[bool, float, float, float]] = []
    rects = _split(rng, (0.0, 0.0, wide, deep), inner, cuts)
    for rect in rects:
        lower = height - (float(rng.uniform(0.1, 0.6)) if rng.random() < 0.2 and height > 2.5 else 0.0)
        shell.rooms.append(Room(rect, lower))
    style = _Style(rng)
    for along_x, at, low, high in cuts:
        crossing = [
            c[1] + inner / 2 - low
            for c in cuts
            if c[0] != along_x and low < c[1] < high and c[2] - 0.2 <= at <= c[3] + 0.2
        ]
        x, y = (low, at) if along_x else (at, low)
        _raise(shell, _Wall(x, y, along_x, high - low, inner, height, 0, tuple(crossing)), style, rng)
    for along_x, at, outside in ((True, -outer, -1), (True, deep, 1), (False, -outer, -1), (False, wide, 1)):
        length = (wide if along_x else deep) + 2 * outer
        meets = tuple(c[1] + inner / 2 + outer for c in cuts if c[0] != along_x)
        x, y = (-outer, at) if along_x else (at, -outer)
        _raise(shell, _Wall(x, y, along_x, length, outer, height, outside, meets), style, rng)
    _levels(shell, rng, (-outer, -outer, wide + outer, deep + outer), height)
    return shell


def _split(rng: Rng, rect: Rect, thick: float, cuts: list[tuple[bool, float, float, float]]) -> list[Rect]:
    """Rooms of a rectangle; writes cuts: (along x, lower edge, from, to) of the walls between."""
    x0, y0, x1, y1 = rect
    wide, deep = x1 - x0, y1 - y0
    if max(wide, deep) < 4.8 or (wide * deep < 28 and rng.random() < 0.6) or (wide * deep < 60 and rng.random() < 0.2):
        return [rect]
    at = float(rng.uniform(0.35, 0.65) if rng.random() < 0.7 else rng.choice([0.25, 0.75])) * max(wide, deep)
    at = min(max(at, 1.5), max(wide, deep) - 1.5)
    if wide > deep:
        cuts.append((False, x0 + at, y0, y1))
        return _split(rng, (x0, y0, x0 + at, y1), thick, cuts) + _split(rng, (x0 + at + thick, y0, x1, y1), thick, cuts)
    cuts.append((True, y0 + at, x0, x1))
    return _split(rng, (x0, y0, x1, y0 + at), thick, cuts) + _split(rng, (x0, y0 + at + thick, x1, y1), thick, cuts)


class _Style:
    """What doors and windows of one building have in common."""

    def __init__(self, rng: Rng) -> None:
        self.door_top = float(rng.uniform(1.95, 2.15) if rng.random() < 0.75 else rng.uniform(2.15, 2.6))
        self.frame_m = float(rng.uniform(0.03, 0.11))
        self.proud_m = float(
            rng.choice([0.01, 0.015, 0.02, 0.03])
        )  # a flush door in a flush frame is a wall to any LiDAR
        self.sill_m = float(rng.choice([0.05, 0.4, 0.5, 0.8, 0.9, 1.0, 1.1]) * rng.uniform(0.9, 1.1))
        self.window_top = max(self.sill_m + 0.8, float(rng.uniform(1.9, 2.4)))
        self.skirting = float(rng.uniform(0.06, 0.15)) if rng.random() < 0.4 else 0.0
        self.ribbon = rng.random() < 0.25  # windows side by side along whole walls


def _raise(shell: Shell, wall: _Wall, style: _Style, rng: Rng) -> None:
    """A wall with its openings and what fills them."""
    gaps = _gaps(wall, style, rng)
    at = 0.0
    for start, end, z0, z1, kind in gaps:
        _solid(shell, wall, at, start, 0.0, wall.height_m, style, rng)
        if z1 < wall.height_m - 0.02:
            _solid(shell, wall, start, end, z1, wall.height_m, style, rng)
        if z0 > 0.02:
            _solid(shell, wall, start, end, 0.0, z0, style, rng)
        middle, half = (start + end) / 2, (end - start) / 2
        x, y = (
            (wall.x_m + middle, wall.y_m + wall.thick_m / 2)
            if wall.along_x
            else (wall.x_m + wall.thick_m / 2, wall.y_m + middle)
        )
        if kind == "window":
            _window(shell, wall, (start, end, z0, z1), rng)
            shell.openings.append(Opening(x, y, half, wall.along_x, "window"))
        else:
            if kind != "open":
                _door(shell, wall, (start, end, z0, z1), kind, style, rng)
            shell.openings.append(Opening(x, y, half, wall.along_x, "door"))
        at = end
    _solid(shell, wall, at, wall.length_m, 0.0, wall.height_m, style, rng)


def _solid(shell: Shell, wall: _Wall, u0: float, u1: float, z0: float, z1: float, style: _Style, rng: Rng) -> None:
    if u1 - u0 < 0.005:
        return
    shell.add(wall.place(box(u0, u1, 0, wall.thick_m, z0, z1)), Structure.WALL)
    if z0 == 0 and style.skirting and z1 > style.skirting:
        shell.add(wall.place(box(u0, u1, -0.015, wall.thick_m + 0.015, 0, style.skirting)), Structure.WALL)


def _gaps(wall: _Wall, style: _Style, rng: Rng) -> list[tuple[float, float, float, float, str]]:
    """(start, end, z0, z1, kind) along a wall, in order, none overlapping."""
    wanted: list[tuple[float, float, float, str]] = []
    top = min(style.door_top, wall.height_m - 0.05)
    if wall.outer == 0:
        draw = rng.random()
        if draw < 0.7:
            kind = str(rng.choice(["closed", "ajar", "open leaf", "frame", "double"], p=[0.35, 0.12, 0.28, 0.15, 0.1]))
            width = float(rng.uniform(1.3, 1.8) if kind == "double" else rng.uniform(0.7, 1.1))
            wanted.append((width, 0.0, top, kind))
        elif draw < 0.85:
            full = rng.random() < 0.4
            high = wall.height_m - 0.1 if rng.random() < 0.3 else top
            wanted.append(
                (
                    float(rng.uniform(1.5, 3.4)),
                    0.0,
                    wall.height_m if full and rng.random() < 0.5 else high,
                    str(rng.choice(["sliding", "folding"])),
                )
            )
        else:
            wanted.append((float(rng.uniform(0.8, 3.0)), 0.0, wall.height_m if rng.random() < 0.4 else top, "open"))
        if rng.random() < 0.3 and wall.length_m > 4:
            wanted.append((float(rng.uniform(0.7, 1.0)), 0.0, top, str(rng.choice(["closed", "open leaf"]))))
        if rng.random() < 0.12:
            wanted.append(
                (float(rng.uniform(0.8, 2.0)), style.sill_m, min(style.window_top, wall.height_m - 0.1), "window")
            )
    else:
        if rng.random() < 0.35:
            wanted.append((float(rng.uniform(0.8, 1.8)), 0.0, top, "closed"))
        window_top = min(style.window_top, wall.height_m - 0.08)
        if window_top > style.sill_m + 0.4:
            if style.ribbon and rng.random() < 0.7:
                width = float(rng.uniform(0.9, 2.4))
                wanted += [(width, style.sill_m, window_top, "window")] * 6
            else:
                wanted += [
                    (float(rng.uniform(0.5, 2.6)), style.sill_m, window_top, "window")
                    for _ in range(int(rng.integers(0, 4)))
                ]
    return _spread(wall, wanted, style.ribbon and wall.outer != 0, rng)


def _spread(
    wall: _Wall, wanted: list[tuple[float, float, float, str]], tight: bool, rng: Rng
) -> list[tuple[float, float, float, float, str]]:
    """Places for the openings that keep off corners, other walls and each other (tight: side by side)."""
    taken: list[tuple[float, float]] = [(u - 0.18, u + 0.18) for u in wall.joints]
    edge = wall.thick_m + 0.12 if wall.outer else 0.12
    apart = 0.0 if tight else 0.12
    found = []
    for width, z0, z1, kind in wanted:
        for attempt in range(12):
            if edge + width > wall.length_m - edge:
                break
            start = float(rng.uniform(edge, wall.length_m - edge - width))
            if tight and found and attempt < 6:
                start = found[-1][1] + 0.001
            end = start + width
            if end < wall.length_m - edge and all(end + apart <= a or start - apart >= b for a, b in taken):
                taken.append((start, end))
                found.append((start, end, z0, z1, kind))
                break
    return sorted(found)


def _window(shell: Shell, wall: _Wall, gap: tuple[float, float, float, float], rng: Rng) -> None:
    """Pane, frame, bars and sill; the pane lies deep in the wall or near its inner face."""
    u0, u1, z0, z1 = gap
    t = wall.thick_m
    thick = float(rng.uniform(0.02, 0.07))
    deep = float(rng.uniform(0.0, max(t - thick, 0.0)) if rng.random() < 0.8 else t - thick / 2)
    v0 = deep if wall.outer >= 0 else t - deep - thick
    bar = float(rng.uniform(0.03, 0.09))

    def add(a: float, b: float, low: float, high: float, inset: float = 0.0) -> None:
        shell.add(wall.place(box(a, b, v0 + inset, v0 + thick - inset, low, high)), Structure.WINDOW)

    add(u0, u0 + bar, z0, z1)
    add(u1 - bar, u1, z0, z1)
    add(u0, u1, z0, z0 + bar)
    add(u0, u1, z1 - bar, z1)
    for k in range(1, int(rng.integers(1, 5))):
        middle = u0 + (u1 - u0) * k / 4 if rng.random() < 0.5 else (u0 + u1) / 2
        add(middle - bar / 2, middle + bar / 2, z0, z1)
    if rng.random() < 0.2:
        add(u0, u1, (z0 + z1) / 2 - bar / 2, (z0 + z1) / 2 + bar / 2)
    if rng.random() < 0.88:  # else the light goes through and nothing comes back
        add(u0, u1, z0, z1, thick * 0.35)
    if rng.random() < 0.4 and z0 > 0.3:
        out = float(rng.uniform(0.02, 0.15))
        a, b = (-out, deep) if wall.outer >= 0 else (t - deep, t + out)
        shell.add(wall.place(box(u0 - 0.04, u1 + 0.04, a, b, z0 - 0.03, z0)), Structure.WINDOW)


def _door(
    shell: Shell, wall: _Wall, gap: tuple[float, float, float, float], kind: str, style: _Style, rng: Rng
) -> None:
    """Frame, leaves and handles of a doorway."""
    u0, u1, _, top = gap
    t, frame, proud = wall.thick_m, style.frame_m, style.proud_m

    def add(solid: Triangles) -> None:
        shell.add(wall.place(solid), Structure.DOOR)

    if kind in ("sliding", "folding"):
        _panels(add, wall, gap, kind, rng)
        return
    add(box(u0 - frame * 0.5, u0 + frame * 0.5, -proud, t + proud, 0, top))
    add(box(u1 - frame * 0.5, u1 + frame * 0.5, -proud, t + proud, 0, top))
    add(box(u0, u1, -proud, t + proud, top - frame * 0.5, top + frame * 0.5))
    if kind == "frame":
        return
    thick = float(rng.uniform(0.03, 0.05))
    deep = float(rng.uniform(0.0, max(t - thick, 0.001)))
    v = float(rng.choice([0.0, t - thick, deep, deep, deep]))
    double = kind == "double" or u1 - u0 > 1.25
    spans = [(u0, (u0 + u1) / 2, 1), ((u0 + u1) / 2, u1, -1)] if double else [(u0, u1, int(rng.choice([-1, 1])))]
    for a, b, side in spans:
        leaf = _leaf(b - a - 0.012, top - 0.02, thick, rng)  # hinge at u = 0, from there along +u
        opened = kind in ("ajar", "open leaf") or (kind == "double" and rng.random() < 0.4)
        angle = 0.0
        if opened:
            angle = float(
                np.deg2rad(rng.uniform(8, 40) if kind == "ajar" else rng.uniform(60, 165)) * rng.choice([-1, 1])
            )
        leaf = turn(leaf, angle)
        if side < 0:
            leaf = leaf * np.float32([-1, 1, 1])
        hinge = a + 0.006 if side > 0 else b - 0.006
        add(leaf + np.float32([hinge, t if angle > 0 else 0.0 if angle < 0 else v, 0.01]))


def _leaf(width: float, high: float, thick: float, rng: Rng) -> Triangles:
    """A door's leaf from u = 0 to width, v = 0 to thick, with handles, perhaps with panels."""
    parts = [box(0, width, 0, thick, 0, high)]
    if rng.random() < 0.4:
        out = float(rng.uniform(0.005, 0.015))
        parts += [
            box(width * 0.15, width * 0.85, -out, thick + out, high * a, high * b)
            for a, b in ((0.08, 0.45), (0.55, 0.92))
        ]
    reach, z = float(rng.uniform(0.04, 0.08)), float(rng.uniform(0.9, 1.1))
    long = float(rng.choice([0.03, 0.12]))
    parts.append(
        box(
            width - 0.07 - long,
            width - 0.05,
            -reach,
            thick + reach,
            z,
            z + float(rng.choice([0.025, 0.4], p=[0.85, 0.15])),
        )
    )
    return np.concatenate(parts)


def _panels(add, wall: _Wall, gap: tuple[float, float, float, float], kind: str, rng: Rng) -> None:  # type: ignore[no-untyped-def]
    """Wide glass doors that slide along or fold to a side, partly open."""
    u0, u1, _, top = gap
    count = int(rng.integers(2, 5))
    width = (u1 - u0) / count
    thick = float(rng.uniform(0.03, 0.05))
    v = float(rng.choice([-0.02, wall.thick_m / 2 - thick / 2, wall.thick_m - thick + 0.02]))
    for k in range(count):
        if rng.random() < 0.3:
            continue
        bar = float(rng.uniform(0.04, 0.1))
        a = u0 + k * width
        pane = [box(0, width, thick * 0.3, thick * 0.7, 0.03, top - 0.03)]
        pane += [
            box(0, bar, 0, thick, 0.02, top),
            box(width - bar, width, 0, thick, 0.02, top),
            box(0, width, 0, thick, 0.02, bar),
            box(0, width, 0, thick, top - bar, top),
        ]
        if rng.random() < 0.3:
            pane += [box(0, width, 0, thick, z - 0.02, z + 0.02) for z in np.arange(0.4, top - 0.2, 0.4)]
        solid = np.concatenate(pane)
        if kind == "folding":
            solid = turn(solid, float(rng.uniform(0, 1.4)) * (1 if k % 2 else -1))
        add(solid + np.float32([a, v, 0]))


def _levels(shell: Shell, rng: Rng, rect: Rect, height: float) -> None:
    """Floor, ceilings, beams, coves, pillars and partitions."""
    x0, y0, x1, y1 = rect
    shell.add(box(x0, x1, y0, y1, -0.1, 0.0), Structure.FLOOR)
    shell.add(box(x0, x1, y0, y1, height, height + 0.1), Structure.CEILING)
    for room in shell.rooms:
        a, b, c, d = room.rect
        wide, deep = c - a, d - b
        if room.height_m < height - 0.01:
            shell.add(box(a, c, b, d, room.height_m, height), Structure.CEILING)
        if rng.random() < 0.15:  # beams
            drop, thick = float(rng.uniform(0.1, 0.4)), float(rng.uniform(0.1, 0.3))
            for u in np.arange(0.8, wide - 0.5, float(rng.uniform(1.0, 2.5))):
                shell.add(box(a + u, a + u + thick, b, d, room.height_m - drop, room.height_m), Structure.WALL)
        if rng.random() < 0.2:  # a cove around
            size, drop = float(rng.uniform(0.05, 0.5)), float(rng.uniform(0.05, 0.3))
            for s in ((a, c, b, b + size), (a, c, d - size, d), (a, a + size, b, d), (c - size, c, b, d)):
                shell.add(box(*s, room.height_m - drop, room.height_m), Structure.CEILING)
        if rng.random() < 0.15:  # a pillar, mostly at a wall
            size = float(rng.uniform(0.2, 0.6))
            x = float(rng.choice([a, c - size, rng.uniform(a, max(c - size, a + 0.01))]))
            y = float(rng.uniform(b, max(d - size, b + 0.01)))
            shell.add(box(x, x + size, y, y + size * float(rng.uniform(0.5, 1.2)), 0, room.height_m), Structure.WALL)
        if rng.random() < 0.12 and min(wide, deep) > 3:  # a partition that ends below the ceiling
            thick, top = float(rng.uniform(0.08, 0.15)), float(rng.uniform(0.9, 2.0))
            start, end = sorted(rng.uniform(0, wide, 2).tolist())
            y = float(rng.uniform(b + 1.2, d - 1.2))
            if end - start > 1.2:
                shell.add(box(a + start, a + end, y, y + thick, 0, top), Structure.WALL)
        if rng.random() < 0.35:  # a carpet
            w, h = float(rng.uniform(0.8, min(3.5, wide * 0.8))), float(rng.uniform(0.8, min(3.5, deep * 0.8)))
            x, y = float(rng.uniform(a, c - w)), float(rng.uniform(b, d - h))
            shell.add(box(x, x + w, y, y + h, 0, float(rng.uniform(0.003, 0.015))), Structure.FLOOR)
