"""How well two things stand to each other as a relation says: scores 0..1 from upright boxes. Pure functions.

A box is ``Box``: centre, size and yaw of an upright (z up) box in the map frame, metres. Scores fall smoothly, so that of several
candidates the one that fits best wins by comparison and not by a sharp limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.graph.model import InstanceNode, RoomNode


@dataclass(frozen=True, slots=True)
class Box:
    """center (x, y, z), size (along its own x, y, z), yaw_rad about z."""

    center_m: tuple[float, float, float]
    size_m: tuple[float, float, float]
    yaw_rad: float = 0.0

    @property
    def bottom_m(self) -> float:
        return self.center_m[2] - self.size_m[2] / 2

    @property
    def top_m(self) -> float:
        return self.center_m[2] + self.size_m[2] / 2


def box_of(node: InstanceNode) -> Box:
    """The box of an instance: its upright oriented box."""
    return Box(node.obb_center_m, node.obb_size_m, node.obb_yaw_rad)


def room_box(room: RoomNode) -> Box:
    """The box of a room: its AABB from floor to ceiling."""
    x0, y0, x1, y1 = room.aabb_xy
    ceiling = room.ceiling_z_m if room.ceiling_z_m is not None else room.floor_z_m + 2.5
    height = ceiling - room.floor_z_m
    return Box(((x0 + x1) / 2, (y0 + y1) / 2, room.floor_z_m + height / 2), (x1 - x0, y1 - y0, height))


def _to_local(box: Box, xy: NDArray[np.float64]) -> NDArray[np.float64]:
    c, s = np.cos(box.yaw_rad), np.sin(box.yaw_rad)
    return np.asarray((xy - np.array(box.center_m[:2])) @ np.array([[c, -s], [s, c]]))


def _samples(box: Box, per_side: int = 9) -> NDArray[np.float64]:
    """[per_side^2, 2] plan points on a lattice over the box."""
    steps = np.linspace(-0.5, 0.5, per_side)
    x, y = np.meshgrid(steps * box.size_m[0], steps * box.size_m[1])
    c, s = np.cos(box.yaw_rad), np.sin(box.yaw_rad)
    local = np.stack([x.ravel(), y.ravel()], 1)
    return np.asarray(local @ np.array([[c, s], [-s, c]]) + np.array(box.center_m[:2]))


def _distance_to(box: Box, xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """[N] plan distance of points [N, 2] to a box, 0 inside."""
    out = np.abs(_to_local(box, xy)) - np.array(box.size_m[:2]) / 2
    return np.asarray(np.hypot(*np.clip(out, 0.0, None).T))


def plan_gap(a: Box, b: Box) -> float:
    """Plan distance between two boxes, 0 when they overlap; exact to the lattice (an eighth of a side)."""
    return float(min(_distance_to(b, _samples(a)).min(), _distance_to(a, _samples(b)).min()))


def plan_overlap(a: Box, b: Box) -> float:
    """Share of a's footprint that lies over b's, 0..1 (b widened by 5 cm for measuring errors)."""
    return float((_distance_to(b, _samples(a)) <= 0.05).mean())


def _fall(value: float, good: float, none: float) -> float:
    """1 up to good, 0 from none on, straight between."""
    return float(np.clip((none - value) / (none - good), 0.0, 1.0))


def near(a: Box, b: Box, good_m: float = 0.4, none_m: float = 2.5) -> float:
    """Side by side in plan; what is on or hangs far above the other is less so."""
    apart = max(a.bottom_m - b.top_m, b.bottom_m - a.top_m, 0.0)
    return _fall(plan_gap(a, b), good_m, none_m) * _fall(apart, 1.0, 3.0)


def on(a: Box, b: Box) -> float:
    """a rests on or in b: over its footprint, its bottom between b's bottom and a little above b's top."""
    over = plan_overlap(a, b)
    height = min(_fall(a.bottom_m - b.top_m, 0.12, 0.35), _fall(b.bottom_m - a.bottom_m, 0.05, 0.25))
    bigger = a.size_m[0] * a.size_m[1] > 2.5 * b.size_m[0] * b.size_m[1]
    return 0.0 if bigger else _fall(1.0 - over, 0.4, 0.95) * height


def above(a: Box, b: Box) -> float:
    """a hangs over b: its bottom not below b's top (less an overlap), close in plan."""
    lower = max(b.top_m - a.bottom_m, 0.0) / max(min(a.size_m[2], b.size_m[2]), 0.05)
    return _fall(plan_gap(a, b), 0.15, 1.2) * _fall(lower, 0.35, 0.8)


def under(a: Box, b: Box) -> float:
    """a lies below b: b hangs over it, or b (a table) spans it."""
    return max(above(b, a), plan_overlap(a, b) * float(a.top_m <= b.top_m))


def in_front(a: Box, b: Box) -> float:
    """a stands where one looks at b from: some metres off at most, not on it. Which side is b's front is not known."""
    # What stands on the floor inside the other's box (a table in the bend of a corner sofa) is before it, not on it.
    rests = max(on(a, b), on(b, a)) if abs(a.bottom_m - b.bottom_m) > 0.1 else 0.0
    return _fall(plan_gap(a, b), 2.5, 5.0) * (1.0 - rests)


def between(a: Box, b: Box, c: Box) -> float:
    """a lies between b and c in plan."""
    p, q, r = (np.array(box.center_m[:2]) for box in (a, b, c))
    span = r - q
    length = float(np.hypot(*span))
    if length < 1e-6:
        return 0.0
    along = float((p - q) @ span) / length**2
    across = abs(float(span[0] * (p - q)[1] - span[1] * (p - q)[0])) / length
    half = max(a.size_m[0], a.size_m[1]) / 2
    return _fall(max(-along, along - 1.0, 0.0), 0.0, 0.3) * _fall(max(across - half, 0.0) / max(length, 1.0), 0.15, 0.6)


def on_floor(a: Box, floor_z_m: float) -> float:
    return _fall(a.bottom_m - floor_z_m, 0.15, 0.5)


def on_wall(a: Box, floor_z_m: float) -> float:
    """Off the floor, or flat and upright."""
    flat = min(a.size_m[:2]) < 0.35
    return max(1.0 - on_floor(a, floor_z_m), 0.6 if flat and a.size_m[2] > 0.3 else 0.0)


def on_ceiling(a: Box, ceiling_z_m: float) -> float:
    return _fall(ceiling_z_m - a.top_m, 0.4, 1.2)


def in_corner(a: Box, outline_xy: Sequence[tuple[float, float]]) -> float:
    """a's box comes near a corner of the room's outline that turns inwards (60..120 degrees)."""
    corners = np.asarray(outline_xy, np.float64)
    if len(corners) < 3:
        return 0.0
    before, after = np.roll(corners, 1, 0) - corners, np.roll(corners, -1, 0) - corners
    lengths = np.hypot(*before.T) * np.hypot(*after.T)
    cosine = (before * after).sum(1) / np.maximum(lengths, 1e-9)
    convex = after[:, 0] * before[:, 1] - after[:, 1] * before[:, 0] > 0  # the outline runs counter-clockwise
    real = corners[convex & (np.abs(cosine) < 0.5)]
    return _fall(float(_distance_to(a, real).min()), 0.5, 2.0) if len(real) else 0.0


def in_middle(a: Box, room: Box) -> float:
    off = np.abs(_to_local(room, np.array([a.center_m[:2]]))[0]) / np.maximum(np.array(room.size_m[:2]) / 2, 1e-6)
    return _fall(float(off.max()), 0.35, 0.85)
