"""What stands in which kind of room, and finding places for it: no overlaps, doors kept clear, every corner reachable."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from irsd.sim import furniture as f
from irsd.sim.parts import Group, Item, box

Rect = tuple[float, float, float, float]  # x0, y0, x1, y1

_WALL_GAP_M = 0.02
_ITEM_GAP_M = 0.06
_ROBOT_REACH_M = 0.31  # from a robot's middle to anything: its radius and a margin for steering
_TALL_M = 1.2  # things that begin above this are above the robot
_CELL_M = 0.1


@dataclass(frozen=True, slots=True)
class Solid:
    """A space that is taken: plan rectangle and height span, metres, building frame."""

    rect: Rect
    z0: float
    z1: float


@dataclass(frozen=True, slots=True)
class Placement:
    """A group at its place: its origin and the direction that its front faces, building frame."""

    group: Group
    x_m: float
    y_m: float
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class RoomSpace:
    """An empty room: inner rectangle, floor kept free before doors, wall spans taken (windows), a point inside each door."""

    rect: Rect
    keep_free: tuple[Rect, ...]
    wall_taken: tuple[Solid, ...]
    door_points: tuple[tuple[float, float], ...]


# --------------------------------------------------------------------------------------- what stands where
def programme(kind: str, rng: np.random.Generator) -> tuple[Group, ...]:
    """The furniture of a room of this kind, most important first. Raises KeyError for an unknown kind."""
    makers = {
        "laboratory": _laboratory,
        "office": _office,
        "kitchen": _kitchen,
        "bedroom": _bedroom,
        "lounge": _lounge,
        "bathroom": _bathroom,
        "meeting room": _meeting_room,
        "dining room": _dining_room,
        "corridor": _corridor,
    }
    return makers[kind](rng)


def _tv_group(rng: np.random.Generator) -> Group:
    """A TV at the front edge of its stand, so that a robot before the stand is near the screen."""
    dy = float(rng.uniform(1.0, 1.2))
    stand = f.tv_stand(rng, dy + 0.2)
    return Group((stand, f.television(rng, dy).at(0.06, 0, 0.5)), "wall", 0.9, required=True)


def _desk_group(rng: np.random.Generator, required: bool) -> Group:
    desk = f.table(rng, 0.7, float(rng.uniform(1.3, 1.6)), label="desk")
    items = (
        desk,
        f.monitor(rng).at(-0.2, float(rng.uniform(-0.2, 0.2)), 0.74),
        f.keyboard(rng).at(0.12, 0, 0.74),
        f.office_chair(rng).at(0.72, float(rng.uniform(-0.1, 0.1)), 0, np.pi + float(rng.uniform(-0.2, 0.2))),
    )
    return Group(items, "wall", 0.3, required)


def _bench_group(rng: np.random.Generator, on_top: tuple[Item, ...]) -> Group:
    dy = float(rng.uniform(1.5, 1.9))
    stool = f.stool(rng).at(0.62, float(rng.uniform(-0.3, 0.3)))
    return Group((f.lab_bench(rng, 0.7, dy), *on_top, stool), "wall", 0.3)


def _table_group(rng: np.random.Generator, dx: float, dy: float, per_side: int) -> Group:
    """A table with chairs on its two long sides, in the middle of the room."""
    items = [f.table(rng, dx, dy)]
    for side in (-1, 1):
        for y in (np.arange(per_side) - (per_side - 1) / 2) * dy / per_side:
            yaw = (np.pi if side > 0 else 0.0) + float(rng.uniform(-0.12, 0.12))
            items.append(f.chair(rng).at(side * (dx / 2 + 0.2), float(y), 0, yaw))
    return Group(tuple(items), "middle", 0.0)


def _on_wall(item: Item, z_m: float) -> Group:
    return Group((item.at(0, 0, z_m),), "wall")


def _picture(rng: np.random.Generator) -> Group:
    colours = (f.pick(rng, f.WOODS), f.pick(rng, f.FABRICS))
    size = float(rng.uniform(0.5, 0.8))
    return _on_wall(f.flat_on_wall("picture", ("painting", "framed picture"), size, 0.75 * size, colours), 1.35)


def _whiteboard() -> Group:
    return _on_wall(f.flat_on_wall("whiteboard", ("white board", "marker board"), 1.6, 1.0, (f.STEEL, f.WHITE)), 0.95)


def _single(item: Item, clear_m: float = 0.0) -> Group:
    return Group((item,), "wall", clear_m)


def _laboratory(rng: np.random.Generator) -> tuple[Group, ...]:
    microscopes = (f.microscope(rng).at(0, -0.35, 0.9), f.monitor(rng).at(-0.15, 0.35, 0.9))
    return (
        _tv_group(rng),
        Group((f.fume_hood(rng),), "wall", 0.7, required=True),
        _bench_group(rng, microscopes),
        _bench_group(rng, (f.microscope(rng).at(0, 0.2, 0.9),)),
        _single(f.shelf(rng, 1.0, label="shelf"), 0.5),
        _single(f.gas_cylinder(rng)),
        _whiteboard(),
        _single(f.trash_can(rng)),
    )


def _office(rng: np.random.Generator) -> tuple[Group, ...]:
    return (
        _desk_group(rng, required=True),
        _desk_group(rng, required=False),
        _single(f.shelf(rng, float(rng.uniform(0.8, 1.2))), 0.5),
        _single(f.printer(rng), 0.5),
        _single(f.plant(rng)),
        _picture(rng),
        _single(f.trash_can(rng)),
    )


def _kitchen(rng: np.random.Generator) -> tuple[Group, ...]:
    row = (
        f.stove(rng).at(0, -1.1),
        f.counter(rng, 0.8).at(0, -0.39),
        f.microwave(rng).at(-0.08, -0.39, 0.91),
        f.kitchen_sink(rng).at(0, 0.41),
        f.counter(rng, 0.5).at(0, 1.07),
        f.coffee_machine(rng).at(-0.06, 1.07, 0.91),
    )
    return (
        Group(row, "wall", 0.6, required=True),
        Group((f.fridge(rng),), "wall", 0.6, required=True),
        _table_group(rng, 0.75, 0.9, 1),
        _single(f.trash_can(rng)),
        _picture(rng),
    )


def _bedroom(rng: np.random.Generator) -> tuple[Group, ...]:
    bed = f.bed(rng)
    half = -bed.parts[0].lo[1]
    items = (bed, f.nightstand(rng).at(-0.83, half + 0.25), f.nightstand(rng).at(-0.83, -half - 0.25))
    return (
        Group(items, "wall", 0.4, required=True),
        _single(f.wardrobe(rng), 0.5),
        _single(f.floor_lamp(rng)),
        _picture(rng),
        _single(f.plant(rng)),
    )


def _lounge(rng: np.random.Generator) -> tuple[Group, ...]:
    low = f.table(rng, 0.5, 0.9, 0.42, "coffee table").at(1.25, 0)
    rug = Item("carpet", ("rug",), (box(0.6, 2.0, -0.8, 0.8, 0.0, 0.012, f.pick(rng, f.FABRICS)),))
    return (
        Group((f.sofa(rng), low, rug), "wall", 0.0, required=True),
        _tv_group(rng),
        _single(f.shelf(rng), 0.5),
        _single(f.floor_lamp(rng)),
        _single(f.plant(rng)),
        _picture(rng),
    )


def _bathroom(rng: np.random.Generator) -> tuple[Group, ...]:
    mirror = f.flat_on_wall("mirror", ("wall mirror",), 0.5, 0.7, (f.STEEL, (188, 200, 206))).at(-0.22, 0, 1.15)
    return (
        Group((f.bathtub(rng),), "wall", 0.4, required=True),
        Group((f.toilet(rng),), "wall", 0.5, required=True),
        Group((f.washbasin(rng), mirror), "wall", 0.5, required=True),
        _single(f.trash_can(rng)),
    )


def _meeting_room(rng: np.random.Generator) -> tuple[Group, ...]:
    return (
        _table_group(rng, 1.0, 1.9, 3),
        _whiteboard(),
        _single(f.plant(rng)),
        _single(f.trash_can(rng)),
        _picture(rng),
    )


def _dining_room(rng: np.random.Generator) -> tuple[Group, ...]:
    return (
        _table_group(rng, 0.9, 1.6, 2),
        _single(f.counter(rng, 1.2), 0.4),
        _single(f.plant(rng)),
        _single(f.floor_lamp(rng)),
        _picture(rng),
    )


def _corridor(rng: np.random.Generator) -> tuple[Group, ...]:
    return (_single(f.plant(rng)), _single(f.cardboard_box(rng)), _picture(rng), _picture(rng))


# --------------------------------------------------------------------------------------- placing
def furnish(space: RoomSpace, groups: tuple[Group, ...], rng: np.random.Generator) -> tuple[Placement, ...] | None:
    """Places for as many groups as fit, in order; None when a required one does not fit."""
    solids = list(space.wall_taken)
    clear = list(space.keep_free)
    reach = list(space.door_points)
    placed: list[Placement] = []
    for group in groups:
        found = _find_place(space, group, solids, clear, reach, rng)
        if found is None:
            if group.required:
                return None
            continue
        placement, solid, front, point = found
        placed.append(placement)
        solids.append(solid)
        if front is not None and point is not None:
            clear.append(front)
            reach.append(point)
    return tuple(placed)


_Found = tuple[Placement, Solid, Rect | None, tuple[float, float] | None]


def _find_place(
    space: RoomSpace,
    group: Group,
    solids: list[Solid],
    clear: list[Rect],
    reach: list[tuple[float, float]],
    rng: np.random.Generator,
) -> _Found | None:
    """The first candidate that overlaps nothing and leaves every door and every front reachable."""
    lo, hi = group.extent()
    for x, y, yaw in _candidates(space.rect, group, lo, hi, rng):
        solid = Solid(_turned((lo[0], lo[1], hi[0], hi[1]), x, y, yaw), float(lo[2]), float(hi[2]))
        front, point = None, None
        if group.front_clear_m > 0:
            front = _turned((hi[0], lo[1], hi[0] + group.front_clear_m, hi[1]), x, y, yaw)
            ahead = hi[0] + _ROBOT_REACH_M + 0.06
            centre = (lo[1] + hi[1]) / 2
            edge = _turned((ahead, centre, ahead, centre), x, y, yaw)
            point = (edge[0], edge[1])
            if not _within(front, space.rect) or any(_overlap(front, s.rect) for s in solids if s.z0 < _TALL_M):
                continue
        if not _fits(solid, space.rect, solids, clear):
            continue
        low = [s.rect for s in (*solids, solid) if s.z0 < _TALL_M and s.z1 > 0.05]
        points = [*reach, point] if point is not None else reach
        if solid.z0 < _TALL_M and not _all_reachable(space.rect, low, points):
            continue
        return Placement(group, x, y, yaw), solid, front, point
    return None


def _candidates(
    rect: Rect, group: Group, lo: NDArray[np.float64], hi: NDArray[np.float64], rng: np.random.Generator
) -> list[tuple[float, float, float]]:
    """Origins and headings (x, y, yaw) to try, in order of preference: corners before wall middles, or middle of the room."""
    x0, y0, x1, y1 = rect
    found: list[tuple[float, tuple[float, float, float]]] = []
    if group.place == "middle":
        for yaw in (0.0, np.pi / 2):
            for dx in np.arange(-1.5, 1.51, 0.15):
                for dy in np.arange(-1.5, 1.51, 0.15):
                    cost = float(np.hypot(dx, dy) + rng.uniform(0, 0.3))
                    found.append((cost, ((x0 + x1) / 2 + float(dx), (y0 + y1) / 2 + float(dy), yaw)))
        return [pose for _, pose in sorted(found)]
    half, back, middle = (hi[1] - lo[1]) / 2, _WALL_GAP_M - lo[0], (lo[1] + hi[1]) / 2
    for quarter in range(4):
        yaw = quarter * np.pi / 2
        c, s = round(np.cos(yaw)), round(np.sin(yaw))
        along0, along1 = (y0, y1) if s == 0 else (x0, x1)
        bias = float(rng.uniform(0, 1.0))
        for t in np.arange(along0 + half + _WALL_GAP_M, along1 - half - _WALL_GAP_M + 1e-9, 0.08):
            wall_x = (x0 if c > 0 else x1) if s == 0 else float(t)
            wall_y = (y0 if s > 0 else y1) if c == 0 else float(t)
            x = wall_x + c * back + s * middle
            y = wall_y + s * back - c * middle
            corner = min(t - along0, along1 - t) - half
            found.append((bias + float(corner + rng.uniform(0, 0.8)), (float(x), float(y), yaw)))
    return [pose for _, pose in sorted(found)]


def _turned(rect: Rect, x: float, y: float, yaw: float) -> Rect:
    """A rectangle of the group's frame in the building's frame (yaw is a multiple of a quarter turn)."""
    c, s = round(np.cos(yaw)), round(np.sin(yaw))
    xs = (x + c * rect[0] - s * rect[1], x + c * rect[2] - s * rect[3])
    ys = (y + s * rect[0] + c * rect[1], y + s * rect[2] + c * rect[3])
    return (float(min(xs)), float(min(ys)), float(max(xs)), float(max(ys)))


def _overlap(a: Rect, b: Rect, gap_m: float = 0.0) -> bool:
    return a[0] < b[2] + gap_m and b[0] < a[2] + gap_m and a[1] < b[3] + gap_m and b[1] < a[3] + gap_m


def _within(inner: Rect, outer: Rect) -> bool:
    return inner[0] >= outer[0] and inner[1] >= outer[1] and inner[2] <= outer[2] and inner[3] <= outer[3]


def _fits(solid: Solid, rect: Rect, solids: list[Solid], clear: list[Rect]) -> bool:
    """Inside the room, off every other solid at its height, and, when it stands on the floor, off every kept-free floor."""
    if not _within(solid.rect, rect):
        return False
    if any(_overlap(solid.rect, s.rect, _ITEM_GAP_M) and solid.z0 < s.z1 and s.z0 < solid.z1 for s in solids):
        return False
    return solid.z0 >= _TALL_M or not any(_overlap(solid.rect, c) for c in clear)


def _all_reachable(rect: Rect, taken: list[Rect], points: list[tuple[float, float]]) -> bool:
    """Can a robot stand at every point and drive between them, and is hardly any open floor cut off?"""
    x0, y0, x1, y1 = rect
    xs, ys = np.arange(x0 + _CELL_M / 2, x1, _CELL_M), np.arange(y0 + _CELL_M / 2, y1, _CELL_M)
    gx, gy = np.meshgrid(xs, ys)
    distance = np.minimum.reduce([gx - x0, x1 - gx, gy - y0, y1 - gy])
    for a in taken:
        dx = np.maximum(np.maximum(a[0] - gx, gx - a[2]), 0)
        dy = np.maximum(np.maximum(a[1] - gy, gy - a[3]), 0)
        distance = np.minimum(distance, np.hypot(dx, dy))
    labels, _ = ndimage.label(distance >= _ROBOT_REACH_M, np.ones((3, 3)))
    cells = [(int((y - y0) / _CELL_M), int((x - x0) / _CELL_M)) for x, y in points]
    if not all(0 <= r < len(ys) and 0 <= c < len(xs) for r, c in cells):
        return False
    values = {int(labels[r, c]) for r, c in cells}
    if len(values) != 1 or 0 in values:
        return False
    return bool((labels == values.pop()).sum() >= 0.85 * (labels > 0).sum())
