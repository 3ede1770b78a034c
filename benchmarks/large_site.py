"""A large made-up site as graph, map and surfaces: blocks of rooms along corridors, things along the walls and above them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.graph.model import BuildingNode, DoorEdge, GraphSnapshot, InstanceNode, RoomNode
from irsd.perception.aliases import AliasTable

ROOM_X_M, ROOM_Y_M, CORRIDOR_M, CELL_M = 5.0, 4.0, 2.0, 0.05
_SIDE = 20  # rooms in a block
_BLOTCH = 0.08  # share of what is said of a thing that is wrong


@dataclass(frozen=True, slots=True)
class Site:
    graph: GraphSnapshot
    frame: GridFrame
    cells: NDArray[np.int8]

    def points_of(self, name: str) -> NDArray[np.float32]:
        """Surface points [N, 3] of a thing: its box, 5 cm apart."""
        node = self.graph.instances[int(name[1:]) - 1]
        low, high = np.array(node.aabb_min_m), np.array(node.aabb_max_m)
        axes = [np.linspace(a, b, max(2, round((b - a) / 0.05) + 1)) for a, b in zip(low, high, strict=True)]
        grid = np.stack([m.ravel() for m in np.meshgrid(*axes)], 1)
        outer = ((grid == low) | (grid == high)).any(1)
        return grid[outer].astype(np.float32)


def make_site(rooms: int, things: int, seed: int) -> Site:
    """The same numbers give the same site."""
    rng = np.random.default_rng(seed)
    names = AliasTable.load()
    rows = -(-rooms // _SIDE)
    frame = GridFrame(
        (-3.0, -1.0),
        CELL_M,
        round((rows * (ROOM_Y_M + CORRIDOR_M) + 2.0) / CELL_M),
        round((_SIDE * ROOM_X_M + 4.0) / CELL_M),
    )
    cells = np.full((frame.height, frame.width), -1, np.int8)

    def paint(x0: float, y0: float, x1: float, y1: float, value: int) -> None:
        c0, r0 = round((x0 - frame.origin_xy_m[0]) / CELL_M), round((y0 - frame.origin_xy_m[1]) / CELL_M)
        c1, r1 = round((x1 - frame.origin_xy_m[0]) / CELL_M), round((y1 - frame.origin_xy_m[1]) / CELL_M)
        cells[r0:r1, c0:c1] = value

    paint(-2.0, 0.0, 0.0, rows * (ROOM_Y_M + CORRIDOR_M), 0)
    nodes: list[InstanceNode] = []
    room_nodes, doors = [], []
    kinds = [kind for kind in names.rooms if kind not in ("corridor", "staircase", "elevator", "garden", "terrace")]
    for number in range(rooms):
        row, column = divmod(number, _SIDE)
        x0, y0 = column * ROOM_X_M, row * (ROOM_Y_M + CORRIDOR_M)
        inner = (x0 + 0.1, y0 + 0.1, x0 + ROOM_X_M - 0.1, y0 + ROOM_Y_M - 0.1)
        paint(x0, y0, x0 + ROOM_X_M, y0 + ROOM_Y_M, 100)
        paint(*inner, 0)
        door_x = x0 + ROOM_X_M / 2
        paint(door_x - 0.5, y0 + ROOM_Y_M - 0.1, door_x + 0.5, y0 + ROOM_Y_M, 0)
        paint(x0 if column else -0.1, y0 + ROOM_Y_M, x0 + ROOM_X_M, y0 + ROOM_Y_M + CORRIDOR_M - 0.1, 0)
        kind, share = str(rng.choice(kinds)), things // rooms + (number < things % rooms)
        first = len(nodes)
        for thing in range(share):
            nodes.append(_thing(len(nodes) + 1, f"R{number + 1}", kind, inner, thing, rng, names))
            low, high = nodes[-1].aabb_min_m, nodes[-1].aabb_max_m
            if low[2] < 0.5:
                paint(low[0], low[1], high[0], high[1], 100)
        told = bool(rng.random() < 0.7)
        room_nodes.append(_room(number, kind, told, inner, [n.id for n in nodes[first:]]))
        if number:
            doors.append(DoorEdge(f"D{number}", (f"R{number}", f"R{number + 1}"), (door_x, y0 + ROOM_Y_M), 1.0))
    building = BuildingNode("B0", "site", tuple(r.id for r in room_nodes))
    graph = GraphSnapshot(1, 1, "site", "map", building, tuple(room_nodes), tuple(doors), tuple(nodes))
    return Site(graph, frame, cells)


def _room(number: int, kind: str, told: bool, rect: tuple[float, float, float, float], inside: list[str]) -> RoomNode:
    x0, y0, x1, y1 = rect
    corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
    labels = ((kind, 0.8 if told else 0.4), ("office", 0.1), ("hall", 0.05))
    area = (x1 - x0) * (y1 - y0)
    return RoomNode(
        f"R{number + 1}", kind if told else "room", labels, corners, rect, area, 0.0, 2.7, tuple(inside), ()
    )


def _thing(
    number: int,
    room: str,
    kind: str,
    rect: tuple[float, float, float, float],
    place: int,
    rng: np.random.Generator,
    names: AliasTable,
) -> InstanceNode:
    """place: 0..11 stand on the floor along the two side walls, the others on top of them or above."""
    x0, y0, x1, _ = rect
    about = names.find_room_kind(kind)
    typical = about.objects if about is not None and about.objects and rng.random() < 0.5 else names.things
    label = names.canonical(str(rng.choice(typical)))
    side, along = divmod(place % 12, 6)
    size = np.array([0.5, 0.5, 0.7]) if place < 12 else np.array([0.15, 0.15, 0.2])
    centre = np.array([x0 + 0.27 if side == 0 else x1 - 0.27, y0 + 0.4 + along * 0.55, 0.35])
    if place >= 12:
        centre += [rng.uniform(-0.15, 0.15), rng.uniform(-0.15, 0.15), 0.46 + 0.3 * (place // 12 - 1)]
    slips = [str(s) for s in rng.choice(names.things, 5)]
    labels = ((label, 0.8), *((slip, _BLOTCH / 5) for slip in slips))
    low, high = centre - size / 2, centre + size / 2
    c, s = tuple(map(float, centre)), tuple(map(float, size))
    return InstanceNode(
        id=f"I{number}", label=label, labels=labels, room=room, centroid_m=c, aabb_min_m=tuple(map(float, low)),
        aabb_max_m=tuple(map(float, high)), obb_center_m=c, obb_size_m=s, obb_yaw_rad=0.0, volume_m3=float(np.prod(size)),
        point_count=200, observations=int(rng.integers(5, 80)), existence=0.95, state="present", first_seen_ns=0, last_seen_ns=1,
    )  # type: ignore[arg-type]  # fmt: skip


def sentences(site: Site, count: int, seed: int) -> list[str]:
    """Goals of all kinds about a site: names, rooms, relations, choices, purposes, other languages, and what is not there."""
    rng = np.random.default_rng(seed)
    nodes, rooms = site.graph.instances, {room.id: room for room in site.graph.rooms}
    fixed = (
        "where can I cook",
        "something to sit on",
        "the elephant",
        "der Kühlschrank",
        "寝室のテレビ",
        "шкаф в спальне",
        "the blue whale",
    )
    out: list[str] = []
    while len(out) < count:
        node, other = nodes[int(rng.integers(len(nodes)))], nodes[int(rng.integers(len(nodes)))]
        room = rooms[str(node.room)]
        near = next((n for n in nodes if n.room == node.room and n.id != node.id), other)
        kind = room.labels[0][0]
        templates = (
            f"{node.label} in {room.id}", f"{node.label} in the {kind}", f"nearest {node.label}", f"{node.label}",
            f"{node.label} next to the {near.label} in the {kind}", f"{node.label} on the {near.label}", f"any {node.label}",
            f"second {node.label} left of the {near.label}", f"the {node.label} between the {near.label} and the {other.label}",
            f"{node.label} in the corner of the {kind}", f"{node.label} closest to the {other.label}", f"{node.id}",
            f"small red {node.label} not in the {kind}", f"go to the {kind}", fixed[len(out) % len(fixed)],
        )  # fmt: skip
        out.append(templates[len(out) % len(templates)])
    return out
