"""Furnished rooms without end for the renderer: one or two rooms, doors, windows, partitions, furniture, things on it and on walls.

Frame: z up from the floor, metres. Number 0 is structure; things count from 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from training.furniture import collection, groups
from training.furniture.solids import box
from training.render_models import Body, Drawn, Surface, fitted, of_drawn, of_model, projected, surface
from training.render_textures import Bank

Rng = np.random.Generator
NONE, WALL, FLOOR, CEILING, DOOR, WINDOW, CARPET = range(7)
_SUPPORTS = 0.35  # things lower than this carry nothing
_CHAIRS = ("chair", "stool", "office chair", "bar stool")
_TABLES = ("dining table", "desk", "coffee table", "workbench", "side table", "reception desk", "console table")


@dataclass(frozen=True, slots=True)
class Scene:
    """triangles [T, 3, 3]; uv [T, 3, 2]; surface [T] into surfaces; thing [T], 0 structure; part [T], which structure (WALL ..), 0 for
    things; names of things 1..; rooms: rectangles (x0, y0, x1, y1); blocked: rectangles in plan that things stand on."""

    triangles: NDArray[np.float32]
    uv: NDArray[np.float32]
    surface: NDArray[np.int32]
    surfaces: tuple[Surface, ...]
    thing: NDArray[np.int32]
    part: NDArray[np.uint8]
    names: tuple[str, ...]
    rooms: tuple[tuple[float, float, float, float], ...]
    height_m: float
    blocked: NDArray[np.float64]


@dataclass(slots=True)
class _Yard:
    """What has been placed so far."""

    bank: Bank
    models: list[Drawn]
    rng: Rng
    height_m: float
    triangles: list = field(default_factory=list)
    uv: list = field(default_factory=list)
    surface: list = field(default_factory=list)
    surfaces: list = field(default_factory=list)
    thing: list = field(default_factory=list)
    part: list = field(default_factory=list)
    names: list = field(default_factory=list)
    boxes: list = field(default_factory=list)  # (low [3], high [3]) of things
    carriers: list = field(default_factory=list)  # triangles that face up, of things that can carry others

    def shell(self, solid, part: int, look: Surface, repeat_m: float = 1.0, flat: bool = False) -> None:
        uv = fitted(solid) if flat else projected(solid, repeat_m)
        self._add(solid, uv, np.zeros(len(solid), np.int32), (look,), 0, part)

    def stand(self, body: Body, x: float, y: float, z: float, yaw: float, *, overlap: bool = False) -> bool:
        """The body at a place, unless it would stand in another thing."""
        c, s = np.cos(yaw), np.sin(yaw)
        solid = body.triangles @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]], np.float32).T + np.array(
            [x, y, z], np.float32
        )
        low, high = solid.reshape(-1, 3).min(0), solid.reshape(-1, 3).max(0)
        if not overlap and not self.free(low, high):
            return False
        self.names.append(body.name)
        self._add(solid, body.uv, body.surface, body.surfaces, len(self.names), NONE)
        self.boxes.append((low, high))
        normal = np.cross(solid[:, 1] - solid[:, 0], solid[:, 2] - solid[:, 0])
        level = np.abs(normal[:, 2]) > 0.98 * np.linalg.norm(normal, axis=1) + 1e-9
        if high[2] > _SUPPORTS and level.any() and z < 1.5:
            flat = solid[level]
            if len(flat) < 4000:
                self.carriers.append((len(self.names), flat, high))
        for model, ahead, aside, up, turned in groups.upon(self.rng, body.name, body.triangles) if z == 0 else ():
            at = (x + c * ahead - s * aside, y + s * ahead + c * aside, up + 0.003)
            self.stand(of_model(model, self.bank, self.rng), *at, yaw + turned)
        return True

    def free(self, low, high, gap: float = 0.02) -> bool:
        return not any((low < theirs[1] - gap).all() and (high > theirs[0] + gap).all() for theirs in self.boxes)

    def _add(self, solid, uv, number, looks, thing: int, part: int) -> None:
        self.triangles.append(solid)
        self.uv.append(uv)
        self.surface.append(number + len(self.surfaces))
        self.surfaces += looks
        self.thing.append(np.full(len(solid), thing, np.int32))
        self.part.append(np.full(len(solid), part, np.uint8))


def make_scene(bank: Bank, models: list[Drawn], rng: Rng) -> Scene:
    """A new place, furnished."""
    yard = _Yard(bank, models, rng, float(rng.uniform(2.35, 3.3)))
    wide, deep = rng.uniform(2.8, 8.0), rng.uniform(2.8, 7.0)
    rooms = [(0.0, 0.0, float(wide), float(deep))]
    gap = None
    if rng.random() < 0.6:  # another room behind the wall at x = wide
        start = rng.uniform(-1.0, 0.5)
        rooms.append(
            (
                float(wide + 0.12),
                float(start),
                float(wide + 0.12 + rng.uniform(2.5, 5)),
                float(deep + rng.uniform(-0.5, 1.5)),
            )
        )
        open_ = min(rng.choice([0.9, 0.9, 1.5, 3.0]), deep - 1.4)
        middle = rng.uniform(0.6 + open_ / 2, deep - 0.6 - open_ / 2)
        gap = (middle - open_ / 2, middle + open_ / 2, rng.choice([2.05, yard.height_m]))
    floor = _floor(yard)
    wall = _wall(yard)
    ceiling = surface("wood" if rng.random() < 0.2 else "enamel", bank, rng)
    taken: list[list[tuple[int, float, float]]] = []
    for k, room in enumerate(rooms):
        if k and rng.random() < 0.5:
            floor, wall = _floor(yard), _wall(yard)
        _shell(yard, room, floor, wall, ceiling, gap, k, taken)
    _beams(yard, rooms)
    for k, room in enumerate(rooms):
        _furnish(yard, room, taken[k], gap, k)
    return Scene(
        np.concatenate(yard.triangles).astype(np.float32),
        np.concatenate(yard.uv).astype(np.float32),
        np.concatenate(yard.surface).astype(np.int32),
        tuple(yard.surfaces),
        np.concatenate(yard.thing),
        np.concatenate(yard.part),
        tuple(yard.names),
        tuple(rooms),
        yard.height_m,
        np.array([[*low[:2], *high[:2]] for low, high in yard.boxes if low[2] < 1.1 and high[2] > 0.05]).reshape(-1, 4),
    )


# ------------------------------------------------------------------------------------------------ the shell
def _floor(yard: _Yard) -> Surface:
    return surface(
        str(yard.rng.choice(["wood", "wood", "stone", "carpet", "enamel", "any", "cardboard"])), yard.bank, yard.rng
    )


def _wall(yard: _Yard) -> Surface:
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


def _shell(yard: _Yard, room, floor: Surface, wall: Surface, ceiling: Surface, gap, k: int, taken) -> None:
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


def _opening(yard: _Yard, room, side: int, at, through: bool, frame: Surface, leaf: Surface, pane: Surface) -> None:
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


def _beams(yard: _Yard, rooms) -> None:
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


# ------------------------------------------------------------------------------------------------ furniture
def draw(yard: _Yard, mount: str | None = None) -> Body:
    """A new thing, of such a mount if that is given."""
    rng = yard.rng
    for _ in range(60):
        if yard.models and rng.random() < 0.35:
            drawn = yard.models[int(rng.integers(len(yard.models)))]
            if mount is None or drawn.mount == mount:
                return of_drawn(drawn, yard.bank, rng)
        else:
            model = collection.draw(rng)
            if mount is None or model.mount == mount:
                body = of_model(model, yard.bank, rng)
                stretch = rng.uniform(0.92, 1.08, 3).astype(np.float32)
                return Body(
                    body.name, body.mount, body.bottom_m, body.triangles * stretch, body.uv, body.surface, body.surfaces
                )
    return draw(yard)


def _furnish(yard: _Yard, room, taken, gap, k: int) -> None:
    rng = yard.rng
    x0, y0, x1, y1 = room
    area = (x1 - x0) * (y1 - y0)
    if gap is not None:  # the way through stays open
        x = x1 if k == 0 else x0
        yard.boxes.append((np.array([x - 0.9, gap[0], 0.0]), np.array([x + 0.9, gap[1], 2.0])))
    for _ in range(int(rng.integers(0, 3))):
        if rng.random() < 0.6:
            _carpet(yard, room)
    for _ in range(int(rng.integers(1, 3))):
        if rng.random() < 0.6:
            _table_with_chairs(yard, room)
    for _ in range(round(area * rng.uniform(0.2, 0.7))):
        body = draw(yard, "floor")
        if rng.random() < 0.75:
            _to_wall(yard, body, room, taken, 0.0)
        else:
            _to_middle(yard, body, room)
    for _ in range(int(rng.integers(1, 9))):
        body = draw(yard, "wall")
        _to_wall(
            yard,
            body,
            room,
            taken if body.name not in ("curtain", "blind") else [],
            body.bottom_m * rng.uniform(0.85, 1.1),
        )
    for _ in range(int(rng.integers(0, 4))):
        body = draw(yard, "ceiling")
        drop = yard.height_m - max(0.0, float(body.triangles[..., 2].max()))
        yard.stand(body, rng.uniform(x0 + 0.5, x1 - 0.5), rng.uniform(y0 + 0.5, y1 - 0.5), drop, rng.uniform(0, 6.28))
    for _ in range(int(rng.integers(2, 18))):
        _on_top(yard)
    if rng.random() < 0.3:
        for _ in range(int(rng.integers(1, 4))):  # small things left on the floor
            body = draw(yard, "top")
            _to_middle(yard, body, room)


def _carpet(yard: _Yard, room) -> None:
    rng, (x0, y0, x1, y1) = yard.rng, room
    w, d = rng.uniform(0.6, 3), rng.uniform(0.6, 2.5)
    x, y = rng.uniform(x0, max(x1 - w, x0 + 0.1)), rng.uniform(y0, max(y1 - d, y0 + 0.1))
    solid = box(x, min(x + w, x1), y, min(y + d, y1), 0.0, rng.uniform(0.004, 0.02))
    look = surface("carpet", yard.bank, rng)
    uv = fitted(solid[..., [2, 0, 1]])
    yard._add(solid, uv, np.zeros(len(solid), np.int32), (look,), 0, CARPET)


def _to_wall(yard: _Yard, body: Body, room, taken, z: float) -> bool:
    rng = yard.rng
    x0, y0, x1, y1 = room
    low, high = body.triangles.reshape(-1, 3).min(0), body.triangles.reshape(-1, 3).max(0)
    for _ in range(12):
        side = int(rng.integers(4))
        start, end = (y0, y1) if side < 2 else (x0, x1)
        half = (high[1] - low[1]) / 2
        if end - start < 2 * half + 0.05:
            continue
        at = rng.uniform(start + half, end - half)
        if any(s == side and at + half > a and at - half < b for s, a, b in taken):
            continue
        gap = -float(low[0]) + rng.choice([0.005, 0.02, 0.06])
        yaw = (0.0, np.pi, np.pi / 2, -np.pi / 2)[side]
        x, y = ((x0 + gap, at), (x1 - gap, at), (at, y0 + gap), (at, y1 - gap))[side]
        if yard.stand(body, x, y, z, yaw + (rng.normal(0, 0.03) if z == 0 and rng.random() < 0.3 else 0.0)):
            return True
    return False


def _to_middle(yard: _Yard, body: Body, room, z: float = 0.0) -> bool:
    rng, (x0, y0, x1, y1) = yard.rng, room
    reach = float(np.abs(body.triangles[..., :2]).max()) + 0.05
    if min(x1 - x0, y1 - y0) < 2 * reach:
        return False
    return any(
        yard.stand(
            body, rng.uniform(x0 + reach, x1 - reach), rng.uniform(y0 + reach, y1 - reach), z, rng.uniform(0, 6.28)
        )
        for _ in range(6)
    )


def _of_name(yard: _Yard, names: tuple[str, ...]) -> Body:
    for _ in range(3000):
        model = collection.draw(yard.rng)
        if model.name in names:
            return of_model(model, yard.bank, yard.rng)
    raise ValueError(f"no maker gives any of {names}")


def _table_with_chairs(yard: _Yard, room) -> None:
    """A table in the room or at a wall, chairs of one kind around it."""
    rng, (x0, y0, x1, y1) = yard.rng, room
    table, chair = _of_name(yard, _TABLES[: int(rng.integers(1, len(_TABLES) + 1))]), _of_name(yard, _CHAIRS)
    low, high = table.triangles.reshape(-1, 3).min(0), table.triangles.reshape(-1, 3).max(0)
    reach = float(np.abs(table.triangles[..., :2]).max()) + 0.6
    if min(x1 - x0, y1 - y0) < 2 * reach:
        return
    x, y = rng.uniform(x0 + reach, x1 - reach), rng.uniform(y0 + reach, y1 - reach)
    yaw = rng.choice([0, np.pi / 2]) + rng.normal(0, 0.05)
    if not yard.stand(table, x, y, 0.0, yaw):
        return
    for side in (-1, 1):
        count = int(rng.integers(0, max(2, round((high[1] - low[1]) / 0.7) + 1)))
        for k in range(count):
            out = side * (high[0] + rng.uniform(-0.1, 0.35))
            along = (k + 0.5) / count * (high[1] - low[1]) + low[1]
            cx, cy = x + out * np.cos(yaw) - along * np.sin(yaw), y + out * np.sin(yaw) + along * np.cos(yaw)
            turned = yaw + (np.pi if side > 0 else 0.0) + rng.normal(0, 0.15)
            yard.stand(chair, cx, cy, 0.0, turned, overlap=True)


def _on_top(yard: _Yard) -> None:
    """A small thing on any level surface that has room for it."""
    if not yard.carriers:
        return
    rng = yard.rng
    carrier, flat, _ = yard.carriers[int(rng.integers(len(yard.carriers)))]
    body = draw(yard, "top")
    size = np.ptp(body.triangles.reshape(-1, 3), axis=0)
    if size.max() > 1.2 or carrier > len(yard.names):
        return
    area = np.abs(np.cross(flat[:, 1, :2] - flat[:, 0, :2], flat[:, 2, :2] - flat[:, 0, :2])) / 2
    if area.sum() < 1e-3:
        return
    for _ in range(4):
        k = int(rng.choice(len(flat), p=area / area.sum()))
        a, b = np.sort(rng.random(2))
        x, y, z = flat[k, 0] * a + flat[k, 1] * (b - a) + flat[k, 2] * (1 - b)
        if not 0.15 < z < 1.9:
            continue
        low = np.array([x - size[0] * 0.4, y - size[1] * 0.4, z + 0.004])
        high = np.array([x + size[0] * 0.4, y + size[1] * 0.4, z + size[2]])
        above = flat[:, :, 2].min(1)
        blocked = (
            (above > z + 0.01)
            & (above < z + size[2])
            & (flat[..., :2].min(1) < high[:2]).all(1)
            & (flat[..., :2].max(1) > low[:2]).all(1)
        )
        others = [b for n, b in enumerate(yard.boxes) if n < len(yard.boxes) and not _is(yard, n, carrier)]
        clear = not any((low < q - 0.01).all() and (high > p + 0.01).all() for p, q in others)
        if not blocked.any() and clear:
            yard.stand(body, float(x), float(y), float(z) + 0.002, rng.uniform(0, 6.28), overlap=True)
            return


def _is(yard: _Yard, n: int, carrier: int) -> bool:
    """Whether the n-th box is the carrier's own."""
    _, high = yard.boxes[n]
    flat = next(c for c in yard.carriers if c[0] == carrier)
    return bool(np.allclose(high, flat[2]))
