"""From rooms and instances to nodes, and from nodes to deltas: only what changed, ids that stay."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from irsd.core.settings import setting
from irsd.core.types import InstanceState, InstanceUpdate, RoomFootprint, Rooms
from irsd.graph.codec import as_published
from irsd.graph.doors import DoorRegister
from irsd.graph.model import DoorEdge, GraphDelta, GraphSnapshot, InstanceArrays, InstanceNode, RoomNode
from irsd.graph.room_types import UNKNOWN, Evidence, RoomTyper, RoomTypeSettings
from irsd.graph.shapes import box_of
from irsd.perception.encoder import LabelEncoder

NodeT = TypeVar("NodeT", RoomNode, DoorEdge, InstanceNode)


@dataclass(frozen=True, slots=True)
class GraphSettings:
    """How the scene graph is made of rooms and instances."""

    building: str = setting("building", "name of the building")
    labels_per_instance: int = setting(5, "names given with an instance, best first", lo=1, hi=50)
    room_reach_m: float = setting(
        0.4, "a thing between rooms (in a wall's thickness) belongs to the nearest room within this", lo=0.0, hi=5.0
    )
    door_match_m: float = setting(1.0, "a door seen again within this distance keeps its id", lo=0.0, hi=10.0)
    room_types: RoomTypeSettings = field(default_factory=RoomTypeSettings)


class GraphBuilder:
    """Holds the nodes as last told and the arrays of the instances; the single writer of revision numbers."""

    def __init__(self, settings: GraphSettings, label_encoder: LabelEncoder, frame: str, map_id: str) -> None:
        self.settings = settings
        self.frame, self.map_id = frame, map_id
        self.seq = 0
        self._aliases = label_encoder.aliases
        self._typer = RoomTyper(settings.room_types, label_encoder)
        self._doors = DoorRegister(settings.door_match_m)
        self._footprints: dict[str, RoomFootprint] = {}
        self._placing: Rooms | None = None
        self._room_nodes: dict[str, RoomNode] = {}
        self._door_nodes: dict[str, DoorEdge] = {}
        self._instance_nodes: dict[str, InstanceNode] = {}
        self._arrays: dict[str, InstanceArrays] = {}

    def restore(self, snapshot: GraphSnapshot, arrays: Mapping[str, InstanceArrays]) -> None:
        """Go on from a stored map: same ids, next revision. ValueError when it is of another map or frame."""
        if (snapshot.map_id, snapshot.frame) != (self.map_id, self.frame):
            raise ValueError(f"stored map is {snapshot.map_id} in {snapshot.frame}, not {self.map_id} in {self.frame}")
        self.seq = snapshot.seq
        self._room_nodes = {room.id: room for room in snapshot.rooms}
        self._footprints = {room.id: footprint_of(room) for room in snapshot.rooms}
        self._door_nodes = {door.id: door for door in snapshot.doors}
        self._doors.restore(snapshot.doors)
        self._instance_nodes = {instance.id: instance for instance in snapshot.instances}
        self._arrays = dict(arrays)

    def build(self, rooms: Rooms | None, update: InstanceUpdate | None, stamp_ns: int) -> GraphDelta | None:
        """The next step of the graph, None when nothing changed. rooms, update: None = as before."""
        before = (self._room_nodes, self._door_nodes, self._instance_nodes)
        instances, merges = dict(self._instance_nodes), []
        if rooms is not None:
            self._placing = rooms
            self._footprints = {f"R{i}": f for i, f in zip(rooms.ids, rooms.footprints, strict=True)}
            self._door_nodes = {door.id: as_published(door) for door in self._doors.match(rooms.openings)}
            instances = {i: self._still_placed(node) for i, node in instances.items()}
        if update is not None:
            merges = self._take(update, instances)
        self._instance_nodes = instances
        self._room_nodes = self._make_rooms()
        changed_rooms = _changed(before[0], self._room_nodes)
        changed_doors = _changed(before[1], self._door_nodes)
        changed_instances = _changed(before[2], self._instance_nodes)
        removed = (
            *_by_number(before[0].keys() - self._room_nodes.keys()),
            *_by_number(before[1].keys() - self._door_nodes.keys()),
            *_by_number(before[2].keys() - self._instance_nodes.keys()),
        )
        for node_id in removed:
            self._arrays.pop(node_id, None)
        lineage = (*(rooms.lineage if rooms is not None else ()), *merges)
        if not (changed_rooms or changed_doors or changed_instances or removed):
            return None
        self.seq += 1
        return GraphDelta(
            seq=self.seq,
            stamp_ns=stamp_ns,
            map_id=self.map_id,
            frame=self.frame,
            rooms=changed_rooms,
            doors=changed_doors,
            instances=changed_instances,
            removed=removed,
            lineage=lineage,
        )

    def arrays(self, node_id: str) -> InstanceArrays:
        """Points and embedding of an instance (``I7``). Raises KeyError for an unknown one."""
        return self._arrays[node_id]

    def all_arrays(self) -> Mapping[str, InstanceArrays]:
        """Points and embeddings of all instances by id: a copy that later steps don't change."""
        return dict(self._arrays)

    # ------------------------------------------------------------------------------------------------ instances
    def _take(self, update: InstanceUpdate, instances: dict[str, InstanceNode]) -> list[str]:
        """Put the update into the mapping; returns what merged, in words."""
        for number in (*update.ended, *(absorbed for _, absorbed in update.merged)):
            instances.pop(f"I{number}", None)
        for state in update.changed:
            if len(state.points_map):
                instances[f"I{state.id}"] = as_published(self._instance_node(state))
                self._arrays[f"I{state.id}"] = InstanceArrays(state.points_map, state.embedding)
        return [f"I{absorbed} merged into I{kept}" for kept, absorbed in update.merged]

    def _instance_node(self, state: InstanceState) -> InstanceNode:
        box = box_of(state.points_map)
        labels = self._labels(state.labels)
        room: str | None = f"R{state.room}"
        if room not in self._footprints:  # none, or a room that ended since the state was made
            room = self._room_at(box.centroid_m)
        return InstanceNode(
            id=f"I{state.id}",
            label=labels[0][0],
            labels=labels,
            room=room,
            centroid_m=box.centroid_m,
            aabb_min_m=box.aabb_min_m,
            aabb_max_m=box.aabb_max_m,
            obb_center_m=box.obb_center_m,
            obb_size_m=box.obb_size_m,
            obb_yaw_rad=box.obb_yaw_rad,
            volume_m3=box.volume_m3,
            point_count=len(state.points_map),
            observations=state.observations,
            existence=float(state.existence),
            state=state.state,
            first_seen_ns=state.first_seen_ns,
            last_seen_ns=state.last_seen_ns,
        )

    def _labels(self, labels: Iterable[tuple[str, float]]) -> tuple[tuple[str, float], ...]:
        """Canonical names, synonyms summed, best first; ties keep their order."""
        scores: dict[str, float] = {}
        for name, score in labels:
            canonical = self._aliases.canonical(name) or "thing"
            scores[canonical] = scores.get(canonical, 0.0) + float(score)
        ranked = sorted(scores.items(), key=lambda item: -item[1])[: self.settings.labels_per_instance]
        return tuple(ranked) or (("thing", 0.0),)

    def _still_placed(self, node: InstanceNode) -> InstanceNode:
        """The node with another room, if its room has ended."""
        if node.room is None or node.room in self._footprints:
            return node
        room = self._room_at(node.centroid_m)
        values = {name: getattr(node, name) for name in InstanceNode.__slots__}
        return InstanceNode(**{**values, "room": room})

    def _room_at(self, point_m: tuple[float, float, float]) -> str | None:
        """The room at a place of the plan, or the nearest within ``room_reach_m``: what hangs on a wall is in that room."""
        if self._placing is None:
            return None
        frame, labels = self._placing.frame, self._placing.labels
        reach = round(self.settings.room_reach_m / frame.resolution_m)
        row, col = frame.cells_of(np.array([point_m]))[0]
        low = np.maximum([row - reach, col - reach], 0)
        window = labels[low[0] : max(row + reach + 1, 0), low[1] : max(col + reach + 1, 0)]
        cells = np.argwhere(window)
        if not len(cells):
            return None
        nearest = cells[((cells + low - (row, col)) ** 2).sum(1).argmin()]
        room = f"R{int(window[nearest[0], nearest[1]])}"
        return room if room in self._footprints else None

    # ------------------------------------------------------------------------------------------------ rooms
    def _make_rooms(self) -> dict[str, RoomNode]:
        inside: dict[str, list[InstanceNode]] = {room: [] for room in self._footprints}
        for instance_id in _by_number(self._instance_nodes):
            node = self._instance_nodes[instance_id]
            if node.room in inside:
                inside[node.room].append(node)
        doors: dict[str, list[str]] = {room: [] for room in self._footprints}
        for door_id in _by_number(self._door_nodes):
            for room in self._door_nodes[door_id].rooms:
                doors.setdefault(room, []).append(door_id)
        return {room: self._room_node(room, inside[room], doors[room]) for room in _by_number(self._footprints)}

    def _room_node(self, room: str, inside: list[InstanceNode], doors: list[str]) -> RoomNode:
        last, place = self._room_nodes.get(room), self._footprints[room]
        things = [Evidence(node.labels, node.volume_m3 * node.existence) for node in inside]
        kind = self._typer.type_of(things, last.label if last else UNKNOWN)
        return as_published(
            RoomNode(
                id=room,
                label=kind.label,
                labels=kind.labels,
                polygon_xy=tuple((float(x), float(y)) for x, y in place.polygon_xy),
                aabb_xy=(
                    float(place.aabb_xy[0]),
                    float(place.aabb_xy[1]),
                    float(place.aabb_xy[2]),
                    float(place.aabb_xy[3]),
                ),
                area_m2=float(place.area_m2),
                floor_z_m=float(place.floor_z_m),
                ceiling_z_m=None if place.ceiling_z_m is None else float(place.ceiling_z_m),
                instances=tuple(node.id for node in inside),
                doors=tuple(doors),
                floor=place.floor,
            )
        )


def footprint_of(room: RoomNode) -> RoomFootprint:
    """A published room as the room stage takes it up again."""
    polygon = np.array(room.polygon_xy, np.float64).reshape(-1, 2)
    return RoomFootprint(polygon, room.aabb_xy, room.area_m2, room.floor_z_m, room.ceiling_z_m, room.floor)


def _by_number(ids: Iterable[str]) -> list[str]:
    return sorted(ids, key=lambda node_id: int(node_id[1:]))


def _changed(old: Mapping[str, NodeT], new: Mapping[str, NodeT]) -> tuple[NodeT, ...]:
    """Nodes that are new or differ, by number."""
    return tuple(new[i] for i in _by_number(new) if old.get(i) != new[i])
