"""Furnished rooms without end for the renderer: one or two rooms, doors, windows, partitions, furniture, things on it and on walls.

Frame: z up from the floor, metres. Number 0 is structure; things count from 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from training.furniture import collection
from training.furniture.solids import box
from training.render_models import Body, Drawn, Surface, fitted, of_drawn, of_model, surface
from training.render_shell import beams, floor_look, shell, wall_look
from training.render_textures import Bank
from training.render_yard import CARPET, Yard

Rng = np.random.Generator
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


def make_scene(bank: Bank, models: list[Drawn], rng: Rng) -> Scene:
    """A new place, furnished."""
    yard = Yard(bank, models, rng, float(rng.uniform(2.35, 3.3)))
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
    floor = floor_look(yard)
    wall = wall_look(yard)
    ceiling = surface("wood" if rng.random() < 0.2 else "enamel", bank, rng)
    taken: list[list[tuple[int, float, float]]] = []
    for k, room in enumerate(rooms):
        if k and rng.random() < 0.5:
            floor, wall = floor_look(yard), wall_look(yard)
        shell(yard, room, floor, wall, ceiling, gap, k, taken)
    beams(yard, rooms)
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


# ------------------------------------------------------------------------------------------------ furniture
def draw(yard: Yard, mount: str | None = None) -> Body:
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


def _furnish(yard: Yard, room, taken, gap, k: int) -> None:
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


def _carpet(yard: Yard, room) -> None:
    rng, (x0, y0, x1, y1) = yard.rng, room
    w, d = rng.uniform(0.6, 3), rng.uniform(0.6, 2.5)
    x, y = rng.uniform(x0, max(x1 - w, x0 + 0.1)), rng.uniform(y0, max(y1 - d, y0 + 0.1))
    solid = box(x, min(x + w, x1), y, min(y + d, y1), 0.0, rng.uniform(0.004, 0.02))
    look = surface("carpet", yard.bank, rng)
    uv = fitted(solid[..., [2, 0, 1]])
    yard.add(solid, uv, np.zeros(len(solid), np.int32), (look,), 0, CARPET)


def _to_wall(yard: Yard, body: Body, room, taken, z: float) -> bool:
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


def _to_middle(yard: Yard, body: Body, room, z: float = 0.0) -> bool:
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


def _of_name(yard: Yard, names: tuple[str, ...]) -> Body:
    for _ in range(3000):
        model = collection.draw(yard.rng)
        if model.name in names:
            return of_model(model, yard.bank, yard.rng)
    raise ValueError(f"no maker gives any of {names}")


def _table_with_chairs(yard: Yard, room) -> None:
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


def _on_top(yard: Yard) -> None:
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


def _is(yard: Yard, n: int, carrier: int) -> bool:
    """Whether the n-th box is the carrier's own."""
    _, high = yard.boxes[n]
    flat = next(c for c in yard.carriers if c[0] == carrier)
    return bool(np.allclose(high, flat[2]))
