"""From rooms and instances to nodes, and from nodes to deltas: only what changed, ids that stay."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TypeVar

import numpy as np

from irsd.core.errors import EditError
from irsd.core.settings import setting
from irsd.core.types import InstanceState, InstanceUpdate, Prototype, RoomFootprint, Rooms
from irsd.graph.book import EditBook
from irsd.graph.codec import as_published
from irsd.graph.doors import DoorRegister
from irsd.graph.edits import (
    Beneath,
    Record,
    Request,
    checked,
    in_words,
    naming,
    place_of,
    prototype_of,
    renumbered,
    same_room,
    splitting_plane,
)
from irsd.graph.footprints import bare_room, footprint_of, room_over, same_footprint
from irsd.graph.model import DoorEdge, Edit, GraphDelta, GraphSnapshot, InstanceArrays, InstanceNode, RoomNode
from irsd.graph.room_types import UNKNOWN, Evidence, RoomTyper, RoomTypeSettings
from irsd.graph.shapes import box_of
from irsd.graph.things import TAUGHT_SCORE, Things
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
    """Holds the nodes as last told, the arrays of the instances and the journal of edits; the single writer of revision numbers.

    A step costs what changed in it, not what the map holds.
    """

    def __init__(self, settings: GraphSettings, label_encoder: LabelEncoder, frame: str, map_id: str) -> None:
        self.settings = settings
        self.frame, self.map_id = frame, map_id
        self.seq = 0
        self._aliases = label_encoder.aliases
        self._typer = RoomTyper(settings.room_types, label_encoder)
        self._doors = DoorRegister(settings.door_match_m)
        self._book = EditBook()
        self._names: dict[str, Edit] = {}
        self._things = Things(self._instance_node, lambda node: self._room_at(node.centroid_m))
        self._footprints: dict[str, RoomFootprint] = {}
        self._placing: Rooms | None = None
        self._room_nodes: dict[str, RoomNode] = {}
        self._kinds: dict[str, str] = {}  # of rooms, by what stands in them
        self._door_nodes: dict[str, DoorEdge] = {}

    def restore(
        self,
        snapshot: GraphSnapshot,
        arrays: Mapping[str, InstanceArrays],
        edits: Sequence[Edit] = (),
        taught: Mapping[int, Prototype] = MappingProxyType({}),
        beneath: Mapping[str, Beneath] = MappingProxyType({}),
    ) -> None:
        """Go on from a stored map: same ids, next revision. ValueError when it is of another map or frame."""
        if (snapshot.map_id, snapshot.frame) != (self.map_id, self.frame):
            raise ValueError(f"stored map is {snapshot.map_id} in {snapshot.frame}, not {self.map_id} in {self.frame}")
        self.seq = snapshot.seq
        self._book.restore(edits, taught)
        self._names = _rooms_named(self._book.edits)
        self._room_nodes = {room.id: room for room in snapshot.rooms}
        self._kinds = {room.id: room.label for room in snapshot.rooms if room.id not in self._names}
        self._footprints = {room.id: footprint_of(room) for room in snapshot.rooms}
        self._door_nodes = {door.id: door for door in snapshot.doors}
        self._doors.restore(snapshot.doors)
        self._things.restore(snapshot.instances, arrays, self._book.edits, beneath)

    def learn(self, taught: Mapping[int, Prototype]) -> None:
        """What was taught on earlier maps, for a map that begins."""
        self._book.restore(self._book.edits, taught)

    def build(self, rooms: Rooms | None, update: InstanceUpdate | None, stamp_ns: int) -> GraphDelta | None:
        """The next step of the graph, None when nothing changed. rooms, update: None = as before."""
        touched, doors_before = set[str](), self._door_nodes
        lineage = list(rooms.lineage) if rooms is not None else []
        if rooms is not None and rooms is not self._placing:
            touched = self._follow_rooms(rooms)
        if update is not None:
            lineage += self._things.take(update)
        return self._told(touched, doors_before, lineage, stamp_ns, force=False)

    def edit(self, request: Request, stamp_ns: int, new_number: Callable[[], int]) -> tuple[Edit, GraphDelta]:
        """One edit, and the step of the graph that holds its effect. new_number: a number for a thing that nothing else will get.

        EditError when it can't be done.
        """
        request = checked(request)
        edit, example = self._made(request, stamp_ns, new_number)
        self._book.add(edit, example)
        return edit, self._edited(in_words(edit), edit, stamp_ns)

    def undo(self, stamp_ns: int) -> tuple[Edit, GraphDelta]:
        """Takes the last edit back that stands. EditError when there is none."""
        edit = replace(self._book.last_standing(), undone=True)
        self._book.put([edit])
        return edit, self._edited(f"undone: {in_words(edit)}", edit, stamp_ns)

    @property
    def edits(self) -> tuple[Edit, ...]:
        """The journal, undone edits included."""
        return self._book.edits

    def prototypes(self) -> tuple[Prototype, ...]:
        """What was taught and is not forgotten."""
        return self._book.prototypes()

    def take_record(self, next_ids: Mapping[str, int]) -> Record:
        """What the last steps leave on disk beside their deltas."""
        edits, learnt = self._book.take_changes()
        return Record(edits, learnt, self._things.take_beneath(), dict(next_ids))

    def whole_record(self, next_ids: Mapping[str, int]) -> Record:
        """What all steps so far have left on disk beside their deltas."""
        return Record(self._book.edits, self._book.taught, self._things.beneath(), dict(next_ids))

    def states_beneath(self) -> list[InstanceState]:
        """What perception knows of the things, edits apart."""
        return self._things.states()

    def arrays(self, node_id: str) -> InstanceArrays:
        """Points and embedding of an instance (``I7``). Raises KeyError for an unknown one."""
        return self._things.arrays[node_id]

    def find_arrays(self, node_id: str) -> InstanceArrays | None:
        """Points and embedding of an instance, None for an unknown one."""
        return self._things.arrays.get(node_id)

    def all_arrays(self) -> Mapping[str, InstanceArrays]:
        """Points and embeddings of all instances by id: a copy that later steps don't change. Costs a look at each."""
        return dict(self._things.arrays)

    # ------------------------------------------------------------------------------------------------ a step
    def _told(
        self,
        touched: set[str],
        doors_before: Mapping[str, DoorEdge],
        lineage: Sequence[str],
        stamp_ns: int,
        *,
        force: bool,
    ) -> GraphDelta | None:
        """The delta over all that was touched. touched: rooms that may have changed."""
        found_again = self._things.settle()
        self._book.put(found_again)
        before, now = self._things.take_changes(), self._things.nodes
        for node_id, node in before.items():
            touched |= {n.room for n in (node, now.get(node_id)) if n is not None and n.room is not None}
        rooms_before = {room: self._room_nodes[room] for room in touched if room in self._room_nodes}
        doors = self._doors_of(touched)
        for room in sorted(touched):
            if room in self._footprints:
                self._room_nodes[room] = self._room_node(room, doors[room])
            else:
                self._room_nodes.pop(room, None)
                self._kinds.pop(room, None)
        changed_rooms = _changed(rooms_before, {r: self._room_nodes[r] for r in touched if r in self._room_nodes})
        changed_doors = _changed(doors_before, self._door_nodes) if doors_before is not self._door_nodes else ()
        changed_instances = _changed(before, {i: now[i] for i in before if i in now})
        removed = (
            *_by_number(rooms_before.keys() - self._room_nodes.keys()),
            *(
                _by_number(doors_before.keys() - self._door_nodes.keys())
                if doors_before is not self._door_nodes
                else ()
            ),
            *_by_number(i for i, node in before.items() if node is not None and i not in now),
        )
        if not (changed_rooms or changed_doors or changed_instances or removed or force):
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
            lineage=(*lineage, *(f"found again: {in_words(edit)}" for edit in found_again)),
        )

    # ------------------------------------------------------------------------------------------------ edits
    def _made(self, request: Request, stamp_ns: int, new_number: Callable[[], int]) -> tuple[Edit, Prototype | None]:
        """The edit that a request comes to in the graph of now, and the example that a teach shows."""
        nodes = [self._node(node_id) for node_id in (request.target, *request.others) if node_id]
        others, plane, example = request.others, None, None
        if request.kind == "forget" and request.target and request.target not in naming(self.edits):
            raise EditError(f"{request.target} has no taught name")
        taught = {p.name for p in self.prototypes()} | {e.name for e in naming(self.edits).values()}
        if request.kind == "forget" and not request.target and request.name not in taught:
            raise EditError(f"nothing is taught as {request.name!r}")
        if request.kind in ("split", "teach") and request.target[:1] == "I":
            state = self._things.state(request.target)
            if state is None:
                raise EditError(f"{request.target} has no points")
            if request.kind == "split":
                plane = splitting_plane(state.points_map)
                others = (f"I{new_number()}",)
            else:
                room = self._footprints.get(f"R{state.room}")
                floor = float(state.points_map[:, 2].min()) if room is None else room.floor_z_m
                example = prototype_of(request.name, state, floor)
        places = tuple(place_of(n, self._label_beneath(n)) for n in nodes)
        number = self._book.next_number
        edit = Edit(number, request.kind, request.target, request.name, others, plane, places, stamp_ns)
        return as_published(edit), example

    def _edited(self, line: str, edit: Edit, stamp_ns: int) -> GraphDelta:
        self._things.follow(self._book.edits)
        self._names = _rooms_named(self._book.edits)
        touched = {i for i in (edit.target,) if i in self._footprints}
        if edit.kind == "forget" and not edit.target:
            touched = set(self._footprints)
        delta = self._told(touched, self._door_nodes, (line,), stamp_ns, force=True)
        assert delta is not None
        return delta

    def _node(self, node_id: str) -> RoomNode | InstanceNode:
        node = self._room_nodes.get(node_id) if node_id[:1] == "R" else self._things.nodes.get(node_id)
        if node is None:
            raise EditError(f"there is no {node_id}: irsctl tree lists what there is")
        return node

    def _label_beneath(self, node: RoomNode | InstanceNode) -> str:
        return self._kinds.get(node.id, UNKNOWN) if isinstance(node, RoomNode) else self._things.label_beneath(node.id)

    # ------------------------------------------------------------------------------------------------ instances
    def _instance_node(self, state: InstanceState) -> InstanceNode:
        box = box_of(state.points_map)
        labels = self._labels(state.labels)
        room: str | None = f"R{state.room}"
        if room not in self._footprints:  # none, or a room that ended since the state was made
            room = self._room_at(box.centroid_m)
        node = InstanceNode(
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
            score_kind=state.score_kind,
        )
        return as_published(node)

    def _labels(self, labels: Iterable[tuple[str, float]]) -> tuple[tuple[str, float], ...]:
        """Canonical names, synonyms summed, best first; ties keep their order."""
        scores: dict[str, float] = {}
        for name, score in labels:
            canonical = self._aliases.canonical(name) or "thing"
            scores[canonical] = scores.get(canonical, 0.0) + float(score)
        ranked = sorted(scores.items(), key=lambda item: -item[1])[: self.settings.labels_per_instance]
        return tuple(ranked) or (("thing", 0.0),)

    def _room_at(self, point_m: tuple[float, float, float]) -> str | None:
        """The room at a place of the plan, or the nearest within ``room_reach_m``: what hangs on a wall is in that room."""
        if self._placing is None:  # a stored map of which nothing was seen yet
            return room_over(self._footprints, point_m)
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
    def _follow_rooms(self, rooms: Rooms) -> set[str]:
        """Takes new rooms over; returns those that changed, began or ended."""
        before, doors_before = self._footprints, self._door_nodes
        self._placing = rooms
        self._footprints = {f"R{i}": f for i, f in zip(rooms.ids, rooms.footprints, strict=True)}
        touched = before.keys() ^ self._footprints.keys()
        touched |= {
            r for r in before.keys() & self._footprints.keys() if not same_footprint(before[r], self._footprints[r])
        }
        self._door_nodes = {door.id: as_published(door) for door in self._doors.match(rooms.openings)}
        for door in doors_before.keys() | self._door_nodes.keys():
            if doors_before.get(door) != self._door_nodes.get(door):
                touched |= {r for d in (doors_before, self._door_nodes) if door in d for r in d[door].rooms}
        self._things.move(before.keys() - self._footprints.keys())
        touched |= self._reattach_rooms()
        return touched

    def _reattach_rooms(self) -> set[str]:
        """Names of rooms that have ended go to the unnamed room that lies where they lay; returns these rooms."""
        out: set[str] = set()
        for node_id, edit in list(self._names.items()):
            if node_id in self._footprints or not edit.places:
                continue
            last = self._room_nodes.get(node_id)
            place = edit.places[0] if last is None else place_of(last, edit.places[0].label)
            fits = [
                (same_room(place, bare_room(room, self._footprints[room])), -int(room[1:]), room)
                for room in self._footprints
                if room not in self._names
            ]
            best = max(fits, default=(0.0, 0, ""))
            if best[0] > 0:
                self._book.put([renumbered(e, node_id, best[2]) for e in self.edits if e.target == node_id])
                self._names = _rooms_named(self._book.edits)
                self._things.follow(self._book.edits)
                out.add(best[2])
        return out

    def _doors_of(self, rooms: set[str]) -> dict[str, list[str]]:
        """Doors of some rooms, by number."""
        doors: dict[str, list[str]] = {room: [] for room in rooms}
        for door_id in _by_number(self._door_nodes) if rooms else ():
            for room in self._door_nodes[door_id].rooms:
                if room in doors:
                    doors[room].append(door_id)
        return doors

    def _room_node(self, room: str, doors: Sequence[str]) -> RoomNode:
        inside = [self._things.nodes[i] for i in _by_number(self._things.by_room.get(room, ()))]
        things = [Evidence(node.labels, node.volume_m3 * node.existence) for node in inside]
        kind = self._typer.type_of(things, self._kinds.get(room, UNKNOWN))
        self._kinds[room] = kind.label
        named = self._names.get(room)
        label, labels = kind.label, kind.labels
        if named is not None:
            label, labels = named.name, ((named.name, TAUGHT_SCORE), *(p for p in labels if p[0] != named.name))
        node = replace(bare_room(room, self._footprints[room]), label=label, labels=labels)
        return as_published(replace(node, instances=tuple(n.id for n in inside), doors=tuple(doors)))


def _rooms_named(edits: Sequence[Edit]) -> dict[str, Edit]:
    return {node_id: edit for node_id, edit in naming(edits).items() if node_id[:1] == "R"}


def _by_number(ids: Iterable[str]) -> list[str]:
    return sorted(ids, key=lambda node_id: int(node_id[1:]))


def _changed(old: Mapping[str, NodeT | None], new: Mapping[str, NodeT]) -> tuple[NodeT, ...]:
    """Nodes that are new or differ, by number."""
    return tuple(new[i] for i in _by_number(new) if old.get(i) != new[i])
