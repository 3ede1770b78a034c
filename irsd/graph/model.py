"""The scene graph's vocabulary: nodes, snapshot and delta as frozen values with readable ids (``B0``, ``R3``, ``I7``, ``D2``).

Topology (which room, which neighbours) is held in ids; the heavy arrays of an instance (points, embedding) travel apart
as ``InstanceArrays``. Everything here is data: no zenoh, no disk, no networkx.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SCHEMA_VERSION = 1


@dataclass(frozen=True, slots=True)
class BuildingNode:
    """The root. rooms: ids of all rooms. floors_z_m: height of every floor, by its index."""

    id: str
    name: str
    rooms: tuple[str, ...]
    floors_z_m: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class RoomNode:
    """A room. polygon_xy: (x, y) metres in the map frame, counter-clockwise, not closed. labels: (type, score) best first.

    label is the best type, or "room" where the evidence does not say. doors: ids of DoorEdge. floor: index into the building's.
    """

    id: str
    label: str
    labels: tuple[tuple[str, float], ...]
    polygon_xy: tuple[tuple[float, float], ...]
    aabb_xy: tuple[float, float, float, float]
    area_m2: float
    floor_z_m: float
    ceiling_z_m: float | None
    instances: tuple[str, ...]
    doors: tuple[str, ...]
    floor: int = 0


@dataclass(frozen=True, slots=True)
class DoorEdge:
    """A way between two rooms. traversed: the robot went through, it was not just seen."""

    id: str
    rooms: tuple[str, str]
    position_xy: tuple[float, float]
    width_m: float
    traversed: bool = False


@dataclass(frozen=True, slots=True)
class InstanceNode:
    """A thing. labels: (name, score) best first. obb: upright box (centre [3], size [3], yaw_rad). state: present | moved | gone.

    score_kind: what the scores are: votes (shares of what a detector said) | chances (of irsd's own eyes, softmax over all names).
    """

    id: str
    label: str
    labels: tuple[tuple[str, float], ...]
    room: str | None
    centroid_m: tuple[float, float, float]
    aabb_min_m: tuple[float, float, float]
    aabb_max_m: tuple[float, float, float]
    obb_center_m: tuple[float, float, float]
    obb_size_m: tuple[float, float, float]
    obb_yaw_rad: float
    volume_m3: float
    point_count: int
    observations: int
    existence: float
    state: str
    first_seen_ns: int
    last_seen_ns: int
    score_kind: str = "votes"


@dataclass(frozen=True, slots=True)
class Place:
    """Where a node was: corners of its box, its outline in plan (rooms only), and what perception called it. Map frame."""

    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]
    label: str
    polygon_xy: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Edit:
    """One line of the journal. number: counts from 1, never used twice.

    others: of a merge, the things that become part of the target; of a split, the id of the part beyond the plane.
    plane: (nx, ny, nz, d) of a split: points with n . p >= d (map frame, metres) are the new part.
    places: where the target, and then the others of a merge, stood. stamp_ns: sensor time. undone: it counts no more.
    """

    number: int
    kind: str
    target: str
    name: str
    others: tuple[str, ...]
    plane: tuple[float, float, float, float] | None
    places: tuple[Place, ...]
    stamp_ns: int
    undone: bool = False


@dataclass(frozen=True, slots=True)
class GraphSnapshot:
    """The whole graph at one revision. Nodes are sorted by the number in their id."""

    seq: int
    stamp_ns: int
    map_id: str
    frame: str
    building: BuildingNode
    rooms: tuple[RoomNode, ...]
    doors: tuple[DoorEdge, ...]
    instances: tuple[InstanceNode, ...]


@dataclass(frozen=True, slots=True)
class GraphDelta:
    """From revision seq - 1 to seq: nodes to insert or replace, ids to remove, and what became of rooms in words."""

    seq: int
    stamp_ns: int
    map_id: str
    frame: str
    rooms: tuple[RoomNode, ...]
    doors: tuple[DoorEdge, ...]
    instances: tuple[InstanceNode, ...]
    removed: tuple[str, ...]
    lineage: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class InstanceArrays:
    """The heavy side of an instance: points_map float32 [N, 3], embedding float32 [D] or None."""

    points_map: NDArray[np.float32]
    embedding: NDArray[np.float32] | None


def building_of(node_id: str, name: str, rooms: tuple[RoomNode, ...]) -> BuildingNode:
    """The root over these rooms: a floor is as high as the lowest floor of its rooms; one without rooms lies at 0."""
    heights: dict[int, float] = {}
    for room in rooms:
        heights[room.floor] = min(room.floor_z_m, heights.get(room.floor, room.floor_z_m))
    floors = tuple(heights.get(k, 0.0) for k in range(max(heights, default=-1) + 1))
    return BuildingNode(node_id, name, tuple(room.id for room in rooms), floors)
