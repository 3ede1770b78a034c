"""Things as perception has them, and as they are told once operators had their say."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from irsd.core.types import InstanceState, InstanceUpdate
from irsd.graph.edits import Beneath, naming, place_of, renumbered, same_thing, shaped, standing, things_of
from irsd.graph.model import Edit, InstanceArrays, InstanceNode, Place

TAUGHT_SCORE = 1.0


class Things:
    """Owner of the states beneath and of the nodes told. ``take`` what perception says, then ``settle`` what follows from it."""

    def __init__(
        self, make_node: Callable[[InstanceState], InstanceNode], room_of: Callable[[InstanceNode], str | None]
    ) -> None:
        """make_node: the node of a state, by perception alone. room_of: the room a node belongs to now."""
        self._make, self._room_of = make_node, room_of
        self._states: dict[int, InstanceState] = {}
        self._edits: tuple[Edit, ...] = ()
        self._edited: frozenset[int] = frozenset()
        self._lost: dict[str, tuple[Place, bool]] = {}
        self._last: dict[int, Place] = {}
        self._hidden: set[int] = set()
        self._names: dict[str, Edit] = {}
        self._told: dict[int, InstanceState] = {}
        self._dirty: set[int] = set()
        self._before: dict[str, InstanceNode | None] = {}
        self._beneath: dict[str, Beneath | None] = {}
        self.nodes: dict[str, InstanceNode] = {}
        self.arrays: dict[str, InstanceArrays] = {}
        self.by_room: dict[str | None, dict[str, None]] = {}

    def restore(
        self,
        nodes: Sequence[InstanceNode],
        arrays: Mapping[str, InstanceArrays],
        edits: Sequence[Edit],
        beneath: Mapping[str, Beneath],
    ) -> None:
        """Go on from what was stored: nodes and arrays as told, and what lay beneath those that were edited."""
        self.nodes, self.arrays = {node.id: node for node in nodes}, dict(arrays)
        for node in nodes:
            self.by_room.setdefault(node.room, {})[node.id] = None
        self._set(edits)
        whole = {n.id: (n, arrays[n.id]) for n in nodes if n.id in arrays and int(n.id[1:]) not in self._edited}
        self._states = {int(i[1:]): state_of(*pair) for i, pair in {**whole, **beneath}.items()}
        self._hidden = {int(i[1:]) for i in beneath}
        self._told = shaped(self._edits, {i: self._states[i] for i in sorted(self._edited) if i in self._states})
        self._find_lost()

    # ------------------------------------------------------------------------------------------------ taking in
    def take(self, update: InstanceUpdate) -> list[str]:
        """What perception changed; returns what merged, in words."""
        for number in (*update.ended, *(absorbed for _, absorbed in update.merged)):
            state = self._states.pop(number, None)
            if state is not None:
                self._dirty.add(number)
                if number in self._edited:
                    node = self._make(state)
                    self._last[number] = place_of(node, node.label)
        for state in update.changed:
            if len(state.points_map):
                self._states[state.id] = state
                self._dirty.add(state.id)
        return [f"I{absorbed} merged into I{kept}" for kept, absorbed in update.merged]

    def follow(self, edits: Sequence[Edit]) -> None:
        """The journal as it is now."""
        before = self._edited
        self._set(edits)
        self._dirty |= before | self._edited

    def move(self, rooms: Iterable[str]) -> None:
        """These rooms have ended: what was in them is elsewhere now."""
        for room in rooms:
            for node_id in list(self.by_room.get(room, ())):
                node = self.nodes[node_id]
                self._put(replace(node, room=self._room_of(node)))

    def settle(self) -> list[Edit]:
        """Brings the nodes up to date; returns the edits whose thing was found again under a new id, as they are now."""
        found = self._reattach()
        dirty, self._dirty = self._dirty, set()
        if not dirty:
            return found
        for number in sorted(dirty - self._edited):
            self._tell(number, self._states.get(number))
            self._note_beneath(number, None)
        if dirty & self._edited or self._told.keys() - self._edited:
            members = {i: self._states[i] for i in sorted(self._edited) if i in self._states}
            shapes, before, self._told = shaped(self._edits, members), self._told, {}
            for number in sorted(before.keys() | shapes.keys() | (dirty & self._edited)):
                state = shapes.get(number)
                mine = number in self._edited or state is not None
                if mine and (state is None or state is not before.get(number) or number in dirty):
                    self._tell(number, state)
                if state is not None:
                    self._told[number] = state
            for number in sorted(dirty & self._edited):
                self._note_beneath(number, self._states.get(number))
        self._find_lost()
        return found

    # ------------------------------------------------------------------------------------------------ answers
    def take_changes(self) -> dict[str, InstanceNode | None]:
        """The nodes as they were before, of all that may have changed since the last call; None: there was none."""
        out, self._before = self._before, {}
        return out

    def state(self, node_id: str) -> InstanceState | None:
        """What is told of a thing, as a state; None for an unknown one."""
        node = self.nodes.get(node_id)
        return None if node is None or node_id not in self.arrays else state_of(node, self.arrays[node_id])

    def states(self) -> list[InstanceState]:
        """What perception knows, by number."""
        return [self._states[i] for i in sorted(self._states)]

    def label_beneath(self, node_id: str) -> str:
        """What perception calls a thing."""
        state = self._states.get(int(node_id[1:]))
        return self._make(state).label if state is not None else self.nodes[node_id].label

    def beneath(self) -> dict[str, Beneath | None]:
        """What perception says of all things that are told otherwise."""
        found = {f"I{i}": self._states[i] for i in sorted(self._edited) if i in self._states}
        return {i: (self._make(s), InstanceArrays(s.points_map, s.embedding)) for i, s in found.items()}

    def take_beneath(self) -> dict[str, Beneath | None]:
        """What changed beneath since the last call; see ``edits.Record``."""
        out, self._beneath = self._beneath, {}
        return out

    # ------------------------------------------------------------------------------------------------ helpers
    def _set(self, edits: Sequence[Edit]) -> None:
        self._edits = tuple(edits)
        self._names = {i: edit for i, edit in naming(edits).items() if i[:1] == "I"}
        ids = {i for e in standing(edits) for i in things_of(e) if e.kind in ("merge", "split", "delete")}
        self._edited = frozenset(int(i[1:]) for i in ids | self._names.keys())

    def _tell(self, number: int, state: InstanceState | None) -> None:
        node_id = f"I{number}"
        if state is None:
            gone = self.nodes.pop(node_id, None)
            self.arrays.pop(node_id, None)
            if gone is not None:
                self.by_room[gone.room].pop(node_id, None)
                self._before.setdefault(node_id, gone)
            return
        node = self._make(state)
        named = self._names.get(node_id)
        if named is not None:
            others = tuple(pair for pair in node.labels if pair[0] != named.name)
            labels = ((named.name, TAUGHT_SCORE), *others)[: max(len(node.labels), 2)]
            node = replace(node, label=named.name, labels=labels)
        self.arrays[node_id] = InstanceArrays(state.points_map, state.embedding)
        self._put(node)

    def _put(self, node: InstanceNode) -> None:
        before = self.nodes.get(node.id)
        if before is not None and before.room != node.room:
            self.by_room[before.room].pop(node.id, None)
        self.by_room.setdefault(node.room, {})[node.id] = None
        self._before.setdefault(node.id, before)
        self.nodes[node.id] = node

    def _note_beneath(self, number: int, state: InstanceState | None) -> None:
        node_id = f"I{number}"
        if state is not None:
            self._beneath[node_id] = (self._make(state), InstanceArrays(state.points_map, state.embedding))
            self._hidden.add(number)
        elif number in self._hidden:
            self._beneath[node_id] = None
            self._hidden.discard(number)

    def _find_lost(self) -> None:
        """Which things of edits are not there now, and where they stood."""
        made = {e.others[0] for e in standing(self._edits) if e.kind == "split" and e.others}
        lost: dict[str, tuple[Place, bool]] = {}
        for edit in standing(self._edits):
            if edit.kind in ("teach", "rename") and self._names.get(edit.target) is not edit:
                continue
            for node_id, place in zip(things_of(edit), edit.places, strict=False):
                number = int(node_id[1:])
                if number in self._states or number in self._told or node_id in made:
                    self._last.pop(number, None)
                else:
                    lost[node_id] = (self._last.get(number, place), edit.kind == "delete")
        self._lost = lost

    def _reattach(self) -> list[Edit]:
        """Edits whose thing has ended, when a new thing stands in its place: the best fitting one that no edit speaks of."""
        fresh = [self._make(self._states[i]) for i in sorted(self._dirty - self._edited) if i in self._states]
        moved: dict[str, str] = {}
        for old, (place, deleted) in self._lost.items() if fresh else ():
            fits = [
                (same_thing(place, node, node.label), -int(node.id[1:]), node.id)
                for node in fresh
                # What was deleted is not there; something else may well be.
                if node.id not in moved.values() and (not deleted or node.label == place.label)
            ]
            best = max(fits, default=(0.0, 0, ""))
            if best[0] > 0:
                moved[old] = best[2]
        if not moved:
            return []
        edits, changed = [], []
        for edit in self._edits:
            now = edit
            for old, new in moved.items():
                now = renumbered(now, old, new) if old in things_of(now) else now
            edits.append(now)
            changed += [now] if now is not edit else []
        self.follow(edits)
        return changed


def state_of(node: InstanceNode, arrays: InstanceArrays) -> InstanceState:
    """A stored thing as fusion takes it up again."""
    return InstanceState(
        id=int(node.id[1:]),
        points_map=arrays.points_map,
        embedding=arrays.embedding,
        labels=node.labels,
        room=int(node.room[1:]) if node.room else 0,
        observations=node.observations,
        existence=node.existence,
        first_seen_ns=node.first_seen_ns,
        last_seen_ns=node.last_seen_ns,
        state=node.state,
        score_kind=node.score_kind,
    )
