"""A small made-up flat as graph, map and points, for the tests of nav_bridge. Everything is known exactly."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.graph.model import BuildingNode, DoorEdge, GraphSnapshot, InstanceNode, RoomNode

RESOLUTION_M = 0.05
# Two rooms of 5 x 6 m side by side, a wall 0.2 m thick at x = 5 with a door from y = 2.5 to 3.5.
FRAME = GridFrame((-0.5, -0.5), RESOLUTION_M, 140, 226)


def instance(
    number: int,
    label: str,
    room: str,
    low: Sequence[float],
    high: Sequence[float],
    labels: Sequence[tuple[str, float]] = (),
    observations: int = 40,
) -> InstanceNode:
    """A thing that fills the box from low to high (x, y, z)."""
    a, b = np.asarray(low, float), np.asarray(high, float)
    centre, size = (float(v) for v in (a + b) / 2), (float(v) for v in b - a)
    middle = tuple(centre)
    return InstanceNode(
        id=f"I{number}",
        label=label,
        labels=tuple(labels) or ((label, 0.9),),
        room=room,
        centroid_m=middle,  # type: ignore[arg-type]
        aabb_min_m=tuple(map(float, a)),  # type: ignore[arg-type]
        aabb_max_m=tuple(map(float, b)),  # type: ignore[arg-type]
        obb_center_m=middle,  # type: ignore[arg-type]
        obb_size_m=tuple(size),  # type: ignore[arg-type]
        obb_yaw_rad=0.0,
        volume_m3=float(np.prod(b - a)),
        point_count=len(surface(low, high)),
        observations=observations,
        existence=0.95,
        state="present",
        first_seen_ns=0,
        last_seen_ns=1,
    )


def surface(low: Sequence[float], high: Sequence[float]) -> NDArray[np.float32]:
    """Points [N, 3] on the sides and the top of a box, at most 5 cm apart."""
    a, b = np.asarray(low, float), np.asarray(high, float)
    axes = [np.linspace(p, q, max(2, math.ceil((q - p) / 0.05) + 1)) for p, q in zip(a, b, strict=True)]
    x, y, z = (m.ravel() for m in np.meshgrid(*axes))
    outer = (x == a[0]) | (x == b[0]) | (y == a[1]) | (y == b[1]) | (z == b[2])
    return np.stack([x, y, z], 1)[outer].astype(np.float32)


def room(number: int, label: str, x0: float, x1: float, instances: Sequence[str]) -> RoomNode:
    corners = ((x0, 0.0), (x1, 0.0), (x1, 6.0), (x0, 6.0))
    return RoomNode(
        f"R{number}",
        label,
        ((label, 0.8),),
        corners,
        (x0, 0.0, x1, 6.0),
        (x1 - x0) * 6.0,
        0.0,
        2.6,
        tuple(instances),
        ("D1",),
    )


THINGS = (
    # laboratory: x 0..4.9
    instance(1, "desk", "R1", (0.1, 4.5, 0.0), (1.6, 5.3, 0.75)),
    instance(2, "television", "R1", (4.8, 4.4, 1.0), (4.88, 5.6, 1.7), (("television", 0.7), ("tv", 0.2))),
    instance(3, "office chair", "R1", (0.6, 3.7, 0.0), (1.1, 4.2, 0.9), (("office chair", 0.6), ("blue chair", 0.2))),
    instance(4, "trash can", "R1", (0.1, 0.1, 0.0), (0.4, 0.4, 0.4)),
    instance(5, "monitor", "R1", (0.6, 4.9, 0.75), (1.1, 5.0, 1.1)),
    # kitchen: x 5.1..10
    instance(6, "refrigerator", "R2", (9.3, 0.2, 0.0), (9.9, 0.9, 1.9)),
    instance(7, "stove", "R2", (9.3, 2.0, 0.8), (9.9, 2.6, 0.95)),
    instance(8, "range hood", "R2", (9.4, 2.0, 1.6), (9.9, 2.6, 2.0)),
    instance(9, "dining table", "R2", (6.8, 4.0, 0.0), (8.2, 4.9, 0.75)),
    instance(10, "chair", "R2", (6.4, 4.2, 0.0), (6.75, 4.6, 0.9), (("chair", 0.7), ("red chair", 0.2))),
    instance(11, "chair", "R2", (8.25, 4.2, 0.0), (8.6, 4.6, 0.9)),
    instance(12, "television", "R2", (7.0, 5.85, 1.0), (8.0, 5.95, 1.6)),
    instance(13, "cup", "R2", (7.4, 4.4, 0.75), (7.5, 4.5, 0.85)),
    instance(14, "trash can", "R2", (5.2, 0.1, 0.0), (5.5, 0.4, 0.4)),
)
_BY_ROOM = {r: [t.id for t in THINGS if t.room == r] for r in ("R1", "R2")}
GRAPH = GraphSnapshot(
    seq=7,
    stamp_ns=1,
    map_id="flat",
    frame="map",
    building=BuildingNode("B0", "flat", ("R1", "R2")),
    rooms=(room(1, "laboratory", 0.0, 4.9, _BY_ROOM["R1"]), room(2, "kitchen", 5.1, 10.0, _BY_ROOM["R2"])),
    doors=(DoorEdge("D1", ("R1", "R2"), (5.0, 3.0), 1.0),),
    instances=THINGS,
)


def points_of(name: str) -> NDArray[np.float32]:
    """Surface points of a thing; none for an unknown one."""
    thing = next((t for t in THINGS if t.id == name), None)
    return np.zeros((0, 3), np.float32) if thing is None else surface(thing.aabb_min_m, thing.aabb_max_m)


def occupancy() -> NDArray[np.int8]:
    """Cells int8 [H, W]: walls and everything that stands lower than 1 m is occupied, outside is unknown."""
    cells = np.full((FRAME.height, FRAME.width), -1, np.int8)
    rows, cols = np.mgrid[: FRAME.height, : FRAME.width]
    x = FRAME.origin_xy_m[0] + (cols + 0.5) * RESOLUTION_M
    y = FRAME.origin_xy_m[1] + (rows + 0.5) * RESOLUTION_M
    inside = (x > 0) & (x < 10) & (y > 0) & (y < 6)
    rim = (x > -0.1) & (x < 10.1) & (y > -0.1) & (y < 6.1) & ~inside
    wall = inside & (np.abs(x - 5) < 0.1) & ~((y > 2.5) & (y < 3.5))
    cells[inside] = 0
    cells[rim | wall] = 100
    for thing in THINGS:
        if thing.aabb_min_m[2] < 0.9:
            low, high = thing.aabb_min_m, thing.aabb_max_m
            cells[(x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])] = 100
    return cells
