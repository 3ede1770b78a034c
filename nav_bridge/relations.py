"""How well things stand to each other as a relation says: scores 0..1 from upright boxes, many pairs at once. Pure functions.

``a`` and ``b`` are ``Boxes`` of the same length (or of length 1, which stands for all): pair k is a[k], b[k]. Scores fall smoothly, so
that of several candidates the one that fits best wins by comparison and not by a sharp limit. Map frame, metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.graph.model import InstanceNode, RoomNode

Floats = NDArray[np.float64]
_LATTICE = 9  # places per side at which a footprint is probed


@dataclass(frozen=True, slots=True)
class Boxes:
    """Upright (z up) boxes. center_m, size_m: float64 [n, 3], size along the box's own axes; yaw_rad: float64 [n] about z."""

    center_m: Floats
    size_m: Floats
    yaw_rad: Floats

    def __len__(self) -> int:
        return len(self.yaw_rad)

    def take(self, rows: NDArray[np.intp] | Sequence[int]) -> Boxes:
        """The boxes of these rows, in this order."""
        return Boxes(self.center_m[rows], self.size_m[rows], self.yaw_rad[rows])

    @property
    def bottom_m(self) -> Floats:
        return np.asarray(self.center_m[:, 2] - self.size_m[:, 2] / 2)

    @property
    def top_m(self) -> Floats:
        return np.asarray(self.center_m[:, 2] + self.size_m[:, 2] / 2)

    @property
    def radius_m(self) -> Floats:
        """[n] of the circle round the centre that holds the footprint."""
        return np.asarray(np.hypot(self.size_m[:, 0], self.size_m[:, 1]) / 2)


def boxes(rows: Sequence[tuple[Sequence[float], Sequence[float], float]]) -> Boxes:
    """Boxes from (centre, size, yaw) each."""
    centers = np.array([row[0] for row in rows], np.float64).reshape(-1, 3)
    sizes = np.array([row[1] for row in rows], np.float64).reshape(-1, 3)
    return Boxes(centers, sizes, np.array([row[2] for row in rows], np.float64))


def boxes_of(nodes: Sequence[InstanceNode]) -> Boxes:
    """The upright oriented boxes of instances."""
    return boxes([(node.obb_center_m, node.obb_size_m, node.obb_yaw_rad) for node in nodes])


def room_boxes(rooms: Sequence[RoomNode]) -> Boxes:
    """The boxes of rooms: their AABB from floor to ceiling."""
    rows = []
    for room in rooms:
        x0, y0, x1, y1 = room.aabb_xy
        height = (room.ceiling_z_m if room.ceiling_z_m is not None else room.floor_z_m + 2.5) - room.floor_z_m
        middle = ((x0 + x1) / 2, (y0 + y1) / 2, room.floor_z_m + height / 2)
        rows.append((middle, (x1 - x0, y1 - y0, height), 0.0))
    return boxes(rows)


Plan = tuple[Floats, Floats]  # x and y, each [k, n]: k places for each of n boxes
_CORNERS = (np.array([[1.0], [1.0], [-1.0], [-1.0]]), np.array([[1.0], [-1.0], [-1.0], [1.0]]))
_GRID = tuple(side.reshape(-1, 1) for side in np.meshgrid(*[np.linspace(-1.0, 1.0, _LATTICE)] * 2))


def _to_local(b: Boxes, places: Plan) -> Plan:
    """Places in each box's own frame."""
    c, s = np.cos(b.yaw_rad), np.sin(b.yaw_rad)
    x, y = places[0] - b.center_m[:, 0], places[1] - b.center_m[:, 1]
    return c * x + s * y, c * y - s * x


def _places(a: Boxes, local: tuple[Floats, ...]) -> Plan:
    """Places in the map, of such that are given in halves of each box's sides, [k, 1]."""
    c, s = np.cos(a.yaw_rad), np.sin(a.yaw_rad)
    x, y = local[0] * a.size_m[:, 0] / 2, local[1] * a.size_m[:, 1] / 2
    return c * x - s * y + a.center_m[:, 0], s * x + c * y + a.center_m[:, 1]


def _out(b: Boxes, local: Plan) -> Floats:
    """[k, n] plan distance of places in a box's own frame to the box, 0 inside."""
    x, y = (np.maximum(np.abs(side) - b.size_m[:, k] / 2, 0.0) for k, side in enumerate(local))
    return np.asarray(np.hypot(x, y))


def _apart(b: Boxes, local: Plan) -> NDArray[np.bool_]:
    """[n] whether an axis of a box tells it from another, whose corners are given in its frame."""
    halves = b.size_m[:, 0] / 2, b.size_m[:, 1] / 2
    x, y = ((side.min(0) > half) | (side.max(0) < -half) for side, half in zip(local, halves, strict=True))
    return np.asarray(x | y)


def plan_gap(a: Boxes, b: Boxes) -> Floats:
    """[n] plan distance between two boxes, 0 when they overlap. Exact: the nearest place of two apart is a corner of one."""
    a_in_b, b_in_a = _to_local(b, _places(a, _CORNERS)), _to_local(a, _places(b, _CORNERS))
    away = np.minimum(_out(b, a_in_b).min(0), _out(a, b_in_a).min(0))
    return np.asarray(np.where(_apart(b, a_in_b) | _apart(a, b_in_a), away, 0.0))


def plan_overlap(a: Boxes, b: Boxes) -> Floats:
    """[n] share of a's footprint that lies over b's, 0..1 (b widened by 5 cm for measuring errors)."""
    return np.asarray((_out(b, _to_local(b, _places(a, _GRID))) <= 0.05).mean(0))


def _fall(value: Floats, good: float, none: float) -> Floats:
    """1 up to good, 0 from none on, straight between."""
    return np.asarray(np.clip((none - value) / (none - good), 0.0, 1.0))


def near(a: Boxes, b: Boxes, good_m: float = 0.4, none_m: float = 2.5) -> Floats:
    """Side by side in plan; what is on or hangs far above the other is less so."""
    apart = np.maximum(np.maximum(a.bottom_m - b.top_m, b.bottom_m - a.top_m), 0.0)
    return _fall(plan_gap(a, b), good_m, none_m) * _fall(apart, 1.0, 3.0)


def on(a: Boxes, b: Boxes) -> Floats:
    """a rests on or in b: over its footprint, its bottom between b's bottom and a little above b's top.

    Of furniture often only the front is seen: what stands as high as its top, not far behind, is most likely on it as well.
    """
    height = np.minimum(_fall(a.bottom_m - b.top_m, 0.12, 0.35), _fall(b.bottom_m - a.bottom_m, 0.05, 0.25))
    bigger = a.size_m[:, 0] * a.size_m[:, 1] > 2.5 * b.size_m[:, 0] * b.size_m[:, 1]
    level = _fall(np.abs(a.bottom_m - b.top_m), 0.08, 0.2)
    over = np.maximum(
        _fall(1.0 - plan_overlap(a, b), 0.4, 0.95) * height, 0.75 * level * _fall(plan_gap(a, b), 0.1, 0.6)
    )
    return np.where(bigger, 0.0, over)


def above(a: Boxes, b: Boxes) -> Floats:
    """a hangs over b: its bottom not below b's top (less an overlap), close in plan."""
    lower = np.maximum(b.top_m - a.bottom_m, 0.0) / np.maximum(np.minimum(a.size_m[:, 2], b.size_m[:, 2]), 0.05)
    return _fall(plan_gap(a, b), 0.15, 1.2) * _fall(lower, 0.35, 0.8)


def under(a: Boxes, b: Boxes) -> Floats:
    """a lies below b: b hangs over it, or b (a table) spans it."""
    return np.maximum(above(b, a), plan_overlap(a, b) * (a.top_m <= b.top_m))


def in_front(a: Boxes, b: Boxes) -> Floats:
    """a stands where one looks at b from: some metres off at most, not on it. Which side is b's front is not known."""
    # What stands on the floor inside the other's box (a table in the bend of a corner sofa) is before it, not on it.
    rests = np.where(np.abs(a.bottom_m - b.bottom_m) > 0.1, np.maximum(on(a, b), on(b, a)), 0.0)
    return _fall(plan_gap(a, b), 2.5, 5.0) * (1.0 - rests)


def between(a: Boxes, b: Boxes, c: Boxes) -> Floats:
    """a lies between b and c in plan."""
    p, q, r = (box.center_m[:, :2] for box in (a, b, c))
    span = r - q
    length = np.hypot(span[:, 0], span[:, 1])
    safe = np.maximum(length, 1e-6)
    along = ((p - q) * span).sum(1) / safe**2
    across = np.abs(span[:, 0] * (p - q)[:, 1] - span[:, 1] * (p - q)[:, 0]) / safe
    half = np.maximum(a.size_m[:, 0], a.size_m[:, 1]) / 2
    inside = _fall(np.maximum(np.maximum(-along, along - 1.0), 0.0), 0.0, 0.3)
    return np.where(
        length < 1e-6, 0.0, inside * _fall(np.maximum(across - half, 0.0) / np.maximum(length, 1.0), 0.15, 0.6)
    )


def beside(a: Boxes, b: Boxes, eye_xy: Floats, side: str) -> Floats:
    """a stands left, right or behind (side) of b as one at eye_xy [n, 2] or [1, 2] sees it, at most some metres off.

    Left is where b's left edge is in sight: across the line from the eye to b's middle, by more than along it.
    """
    line = b.center_m[:, :2] - eye_xy
    line = line / np.maximum(np.hypot(line[:, 0], line[:, 1]), 1e-6)[:, None]
    off = a.center_m[:, :2] - b.center_m[:, :2]
    leftward = line[:, 0] * off[:, 1] - line[:, 1] * off[:, 0]
    onward = (line * off).sum(1)
    wanted, other = {"left": (leftward, onward), "right": (-leftward, onward), "behind": (onward, leftward)}[side]
    off_axis = np.degrees(np.arctan2(np.abs(other), np.maximum(wanted, 1e-9)))
    return _fall(plan_gap(a, b), 0.8, 4.0) * _fall(np.where(wanted > 0, off_axis, 180.0), 45.0, 80.0)


def bearing(a: Boxes, eye_xy: Floats, look_xy: Floats) -> Floats:
    """[n] how far left (+, rad) of the line of sight from eye_xy [2] to look_xy [2] a thing is seen."""
    off, line = a.center_m[:, :2] - eye_xy, look_xy - eye_xy
    turn = np.arctan2(off[:, 1], off[:, 0]) - np.arctan2(line[1], line[0])
    return np.asarray((turn + np.pi) % (2 * np.pi) - np.pi)


def on_floor(a: Boxes, floor_z_m: Floats | float) -> Floats:
    return _fall(a.bottom_m - floor_z_m, 0.15, 0.5)


def on_wall(a: Boxes, floor_z_m: Floats | float) -> Floats:
    """Off the floor, or flat and upright."""
    flat = (a.size_m[:, :2].min(1) < 0.35) & (a.size_m[:, 2] > 0.3)
    return np.maximum(1.0 - on_floor(a, floor_z_m), np.where(flat, 0.6, 0.0))


def on_ceiling(a: Boxes, ceiling_z_m: Floats | float) -> Floats:
    return _fall(ceiling_z_m - a.top_m, 0.4, 1.2)


def in_corner(a: Boxes, outline_xy: Sequence[tuple[float, float]]) -> Floats:
    """a's box comes near a corner of the room's outline that turns inwards (60..120 degrees)."""
    corners = np.asarray(outline_xy, np.float64)
    if len(corners) < 3:
        return np.zeros(len(a))
    before, after = np.roll(corners, 1, 0) - corners, np.roll(corners, -1, 0) - corners
    lengths = np.hypot(*before.T) * np.hypot(*after.T)
    cosine = (before * after).sum(1) / np.maximum(lengths, 1e-9)
    convex = after[:, 0] * before[:, 1] - after[:, 1] * before[:, 0] > 0  # the outline runs counter-clockwise
    real = corners[convex & (np.abs(cosine) < 0.5)]
    if not len(real):
        return np.zeros(len(a))
    return _fall(_out(a, _to_local(a, (real[:, :1], real[:, 1:]))).min(0), 0.5, 2.0)


def in_middle(a: Boxes, room: Boxes) -> Floats:
    """room: the box of the room, or one per thing."""
    x, y = _to_local(room, (a.center_m[None, :, 0], a.center_m[None, :, 1]))
    off = [np.abs(side[0]) / np.maximum(room.size_m[:, k] / 2, 1e-6) for k, side in enumerate((x, y))]
    return _fall(np.maximum(*off), 0.35, 0.85)
