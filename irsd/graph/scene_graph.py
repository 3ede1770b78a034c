"""The live graph: topology in networkx (building -> rooms -> instances, doors between rooms), attributes as frozen nodes.

One writer applies deltas; readers get immutable snapshots by reference.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterable
from typing import Any, TypeVar

import networkx

from irsd.graph.model import BuildingNode, DoorEdge, GraphDelta, GraphSnapshot, InstanceNode, RoomNode, building_of

BUILDING_ID = "B0"
NodeT = TypeVar("NodeT", bound=RoomNode | DoorEdge | InstanceNode)
Node = BuildingNode | RoomNode | DoorEdge | InstanceNode


class SceneGraph:
    """Nodes by id. ``find_`` gives None, ``get_`` raises KeyError, ``has_`` is a bool; queries never change anything."""

    def __init__(self, map_id: str, frame: str = "map", building_name: str = "building") -> None:
        building = BuildingNode(BUILDING_ID, building_name, ())
        self._graph = networkx.MultiGraph()
        self._ends: dict[str, tuple[str, str]] = {}
        self._graph.add_node(BUILDING_ID, data=building)
        self._snapshot = GraphSnapshot(0, 0, map_id, frame, building, (), (), ())

    @classmethod
    def from_snapshot(cls, snapshot: GraphSnapshot) -> SceneGraph:
        """The graph as it was, to go on from there."""
        graph = cls(snapshot.map_id, snapshot.frame, snapshot.building.name)
        graph._insert(snapshot.rooms, snapshot.doors, snapshot.instances)
        graph._graph.nodes[BUILDING_ID]["data"] = snapshot.building
        graph._snapshot = snapshot
        return graph

    def apply(self, delta: GraphDelta) -> GraphSnapshot:
        """The graph after one step. ValueError when the delta is of another map or does not follow on the last one."""
        now = self._snapshot
        if (delta.map_id, delta.frame) != (now.map_id, now.frame):
            raise ValueError(
                f"delta is of map {delta.map_id} in {delta.frame}, this graph of {now.map_id} in {now.frame}"
            )
        if delta.seq != now.seq + 1:
            raise ValueError(f"delta {delta.seq} does not follow revision {now.seq}")
        for node_id in delta.removed:
            if node_id[:1] == "D":
                self._remove_door(node_id)
            elif node_id in self._graph:
                self._graph.remove_node(node_id)
        self._insert(delta.rooms, delta.doors, delta.instances)
        rooms = _merged(now.rooms, delta.rooms, delta.removed)
        building = building_of(BUILDING_ID, now.building.name, rooms)
        self._graph.nodes[BUILDING_ID]["data"] = building
        self._snapshot = GraphSnapshot(
            seq=delta.seq,
            stamp_ns=delta.stamp_ns,
            map_id=now.map_id,
            frame=now.frame,
            building=building,
            rooms=rooms,
            doors=_merged(now.doors, delta.doors, delta.removed),
            instances=_merged(now.instances, delta.instances, delta.removed),
        )
        return self._snapshot

    def _insert(self, rooms: Iterable[RoomNode], doors: Iterable[DoorEdge], instances: Iterable[InstanceNode]) -> None:
        for room in rooms:
            self._graph.add_node(room.id, data=room)
            self._graph.add_edge(BUILDING_ID, room.id, key="holds")
        for door in doors:
            self._remove_door(door.id)
            if all(room in self._graph for room in door.rooms):
                self._graph.add_edge(*door.rooms, key=door.id, data=door)
                self._ends[door.id] = door.rooms
        for instance in instances:
            known = self._graph.nodes.get(instance.id)
            if known is not None and known["data"].room != instance.room:
                self._graph.remove_node(instance.id)
            self._graph.add_node(instance.id, data=instance)
            if instance.room is not None and instance.room in self._graph:
                self._graph.add_edge(instance.room, instance.id, key="holds")

    def _remove_door(self, door_id: str) -> None:
        ends = self._ends.pop(door_id, None)
        if ends is not None and self._graph.has_edge(*ends, key=door_id):
            self._graph.remove_edge(*ends, key=door_id)

    # ------------------------------------------------------------------------------------------------ queries
    def snapshot(self) -> GraphSnapshot:
        """The whole graph at its last revision."""
        return self._snapshot

    def has_node(self, node_id: str) -> bool:
        """Whether a building, room, instance or door has this id."""
        return self.find_node(node_id) is not None

    def find_node(self, node_id: str) -> Node | None:
        """The node or door with this id, None if there is none."""
        if node_id[:1] == "D":
            return next((door for door in self._snapshot.doors if door.id == node_id), None)
        attributes: dict[str, Any] | None = self._graph.nodes.get(node_id)
        return None if attributes is None else attributes["data"]

    def get_node(self, node_id: str) -> Node:
        """The node or door with this id. Raises KeyError."""
        node = self.find_node(node_id)
        if node is None:
            raise KeyError(node_id)
        return node

    def get_instances(self, room_id: str) -> tuple[InstanceNode, ...]:
        """What is in a room, by number. Raises KeyError for an unknown room."""
        self.get_node(room_id)
        inside = [n for n in self._graph.neighbors(room_id) if n[:1] == "I"]
        return tuple(self._graph.nodes[n]["data"] for n in sorted(inside, key=number_of))

    def get_neighbours(self, room_id: str) -> tuple[str, ...]:
        """Rooms that a door leads to, by number. Raises KeyError for an unknown room."""
        self.get_node(room_id)
        return tuple(sorted((n for n in self._graph.neighbors(room_id) if n[:1] == "R"), key=number_of))

    def find_way(self, from_room: str, to_room: str) -> tuple[str, ...] | None:
        """Rooms on a way with the fewest doors, both ends included; None when there is none."""
        rooms = self._graph.subgraph(n for n in self._graph if n[:1] == "R")
        try:
            return tuple(networkx.shortest_path(rooms, from_room, to_room))
        except (networkx.NetworkXNoPath, networkx.NodeNotFound):
            return None


def number_of(node_id: str) -> int:
    """7 for ``I7``."""
    return int(node_id[1:])


def _merged(old: tuple[NodeT, ...], new: tuple[NodeT, ...], removed: tuple[str, ...]) -> tuple[NodeT, ...]:
    """Old nodes with new ones in their places and removed ones left out, by number."""
    if not new and not removed:
        return old
    # By bisection, one by one: a step changes few of many. Costs one copy of the row of nodes.
    nodes = list(old)
    for node_id in set(removed) - {node.id for node in new}:
        at = _place(nodes, number_of(node_id))
        if at < len(nodes) and nodes[at].id == node_id:
            del nodes[at]
    for node in new:
        at = _place(nodes, number_of(node.id))
        if at < len(nodes) and nodes[at].id == node.id:
            nodes[at] = node
        else:
            nodes.insert(at, node)
    return tuple(nodes)


def _place(nodes: list[NodeT], number: int) -> int:
    """Where the node with this number stands, or would stand."""
    return bisect.bisect_left(nodes, number, key=lambda node: number_of(node.id))
