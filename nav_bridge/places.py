"""In what kind of room a thing stands: from its room's own labels, and softly from what stands round it.

A person means by "the kitchen" the part of a flat where the kitchen's things are, whether or not a wall tells it from the dining
room; and names a room to tell it from others: a room of unknown kind is rarely one more of a kind that is there already.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.graph.model import RoomNode
from irsd.perception.encoder import LabelEncoder
from nav_bridge.approach import in_polygon
from nav_bridge.index import Index
from nav_bridge.relations import plan_gap
from nav_bridge.words import fold

# What hangs or stands about anywhere tells nothing of the room it is in.
_ANYWHERE = frozenset({"decoration", "light"})
# Things that belong in one kind of room: elsewhere they are not looked for.
BOUND = frozenset(
    {
        "bed", "nightstand", "wardrobe", "toilet", "urinal", "bathtub", "shower", "bathroom sink", "stove", "cooktop", "oven",
        "range hood", "refrigerator", "freezer", "dishwasher", "kitchen sink", "kitchen cabinet", "kitchen counter",
        "washing machine", "tumble dryer", "dining table", "fume hood",
    }
)  # fmt: skip
_AIRY = frozenset({"balcony", "terrace", "garden"})  # rooms with windows all round, where they are rooms at all
_GLAZED = 4.0  # how much more likely they are where all of the outline is glass
_TAKEN = 0.5  # how much less likely a kind is that another room is known to be of
_BEST, _SURE = (
    0.6,
    0.9,
)  # grade of the likeliest kind of a room where that is not sure, and of the kind a room is known to be
_TELLING = 0.6  # share of its label from which a room is known to be of that kind
_BY_THINGS = 0.7  # what the things round it are worth against the room's label
_ELSEWHERE = 0.5  # the same where a thing asked for stands in a room that is known to be of that kind
_FEW = 0.15  # votes below this tell nothing
UNTOLD = "room"
_PASSAGE = "corridor"  # known by its shape: long, narrow, with many doors
_DOORS_OF_PASSAGE = 3
_MOST_NAMES = 256  # of rooms whose grades are kept for a graph
_BEYOND_M = 0.7  # so far from a door one is in the room behind it


@dataclass(frozen=True, slots=True)
class _Room:
    """What was found out about one room. things: the rows it was made from; votes: float64 [n, K] of what is round each of them."""

    things: tuple[object, ...]
    votes: NDArray[np.float64]
    glazed: float


def _passages(index: Index) -> NDArray[np.float64]:
    """[R] 0..1: how far rooms are corridors by their shape: some three times as long as wide, with doors to several rooms."""
    doors = Counter(name for door in index.graph.doors for name in set(door.rooms))
    out = np.zeros(len(index.graph.rooms))
    for k, room in enumerate(index.graph.rooms):
        if doors[room.id] >= _DOORS_OF_PASSAGE and len(room.polygon_xy) >= 3:
            (_, (a, b), _) = cv2.minAreaRect(np.asarray(room.polygon_xy, np.float32))
            out[k] = np.clip(max(a, b) / max(min(a, b), 1e-3) - 2.5, 0.0, 1.0)
    return out


class Places:
    """Grades rooms and places by kind. Caches per room what its things say; one owner, one thread."""

    def __init__(self, encoder: LabelEncoder, neighbourhood_m: float) -> None:
        self.names = encoder.aliases
        self._encoder = encoder
        self._reach_m = neighbourhood_m
        self._kinds_of: dict[str, tuple[str, ...]] = {}
        self._weights: dict[str, NDArray[np.float64]] = {}
        self._rooms: dict[str, _Room] = {}
        self._graded_of: Index | None = None  # the graph of which the next two are
        self._graded: dict[str, NDArray[np.float64]] = {}
        self._passages = np.zeros(0)
        self._columns = {kind: k for k, kind in enumerate(self.names.rooms)}
        self._typical: dict[str, set[str]] = {}
        for kind in self.names.rooms:
            about = self.names.find_room_kind(kind)
            for thing in about.objects if about else ():
                self._typical.setdefault(self.names.canonical(thing), set()).add(kind)

    # -------------------------------------------------------------------------------------------------- whole rooms
    def grade(self, wanted: str, room: RoomNode, shares: Mapping[str, float] | None = None) -> float:
        """0..1: is a room of the kind asked for. shares: how likely each kind is, where more is known than the room's labels."""
        if fold(wanted) == fold(room.id):
            return 1.0
        kind, label = self.names.canonical_room(wanted), self.names.canonical_room(room.label)
        likely = shares if shares is not None else self._shares(room)
        best = max(likely.values(), default=0.0)
        leads = best == 0 or likely.get(label, 0.0) >= best
        if kind == label and leads:
            return 1.0 if fold(wanted) == fold(room.label) else _SURE
        if best > 0 and kind in likely:
            return _BEST * max(0.0, (likely[kind] / best - 0.5) / 0.5)
        if not self.names.known_room(wanted) and room.label != UNTOLD:
            va, vb = self._encoder.encode_rooms([wanted, room.label])
            cosine = float(va @ vb)
            return cosine if cosine >= 0.75 else 0.0
        return 0.0

    def _shares(self, room: RoomNode) -> dict[str, float]:
        out: dict[str, float] = {}
        for name, share in room.labels:
            kind = self.names.canonical_room(name)
            out[kind] = max(out.get(kind, 0.0), share)
        return out

    def grades(self, wanted: str, index: Index) -> NDArray[np.float64]:
        """[R] ``grade`` of every room of a graph, each seen among the others, by its windows and its shape."""
        if self._graded_of is not index:
            self._graded_of, self._graded, self._passages = index, {}, _passages(index)
        found = self._graded.get(wanted)
        if found is None:
            if len(self._graded) >= _MOST_NAMES:  # names come from outside: they must not fill the memory
                self._graded.clear()
            found = self._graded[wanted] = self._grades(wanted, index)
        return found

    def _grades(self, wanted: str, index: Index) -> NDArray[np.float64]:
        shares = [self._shares(room) for room in index.graph.rooms]
        surest: dict[str, float] = {}
        for of_room in shares:
            for kind, share in of_room.items():
                surest[kind] = max(surest.get(kind, 0.0), share)
        out = np.zeros(len(shares))
        for k, room in enumerate(index.graph.rooms):
            likely = shares[k]
            passage = float(self._passages[k])
            if passage > 0.0:  # what stands in a corridor says little: plants, pictures
                rest = {kind: share * (1.0 - passage) for kind, share in likely.items()}
                likely = {**rest, _PASSAGE: max(passage, rest.get(_PASSAGE, 0.0))}
            elif likely.get(self.names.canonical_room(room.label), 0.0) < _TELLING and likely:
                glazed = self._room(room, index).glazed
                likely = {
                    kind: share
                    * (1.0 - _TAKEN * (surest[kind] if surest[kind] > share else 0.0))
                    * (1.0 + _GLAZED * glazed * (kind in _AIRY))
                    for kind, share in likely.items()
                }
            out[k] = self.grade(wanted, room, likely)
        return out

    # ------------------------------------------------------------------------------------------------ parts of rooms
    def kinds_of(self, label: str) -> tuple[str, ...]:
        """Kinds of rooms a thing is typical of, in the table's order; empty when it is typical of none."""
        found = self._kinds_of.get(label)
        if found is None:
            family = (self.names.canonical(label), *self.names.ancestors(label))
            kinds = set().union(*(self._typical.get(name, set()) for name in family))
            found = self._kinds_of[label] = tuple(kind for kind in self.names.rooms if kind in kinds)
        return found

    def belongs(self, label: str, wanted: str) -> bool | None:
        """Whether a thing belongs in a kind of room: True typical of it, False bound to another kind, None it may be anywhere."""
        if self.names.canonical_room(wanted) in self.kinds_of(label):
            return True
        return False if self.names.canonical(label) in BOUND else None

    def _room(self, room: RoomNode, index: Index) -> _Room:
        """What the things of a room say; found out again only when they have changed."""
        rows = index.members[room.id]
        nodes = index.graph.instances
        things = (room.polygon_xy, *(nodes[k] for k in rows))
        known = self._rooms.get(room.id)
        if known is None or known.things != things:
            labels = [nodes[k].label for k in rows]
            known = _Room(things, self._votes(labels, rows, index), self._glazed(labels, rows, index, room))
            if room.id not in self._rooms and len(self._rooms) > 2 * len(index.graph.rooms) + 64:
                self._rooms.clear()  # most are rooms of maps long gone
            self._rooms[room.id] = known
        return known

    def _votes(self, labels: list[str], rows: NDArray[np.intp], index: Index) -> NDArray[np.float64]:
        """float64 [n, K]: for each thing of a room, how much the things round it speak for each kind.

        A thing that is typical of several kinds shares its vote among them; of itself a thing speaks only if it is bound.
        """
        n = len(rows)
        weight = np.array([self._weight(label) for label in labels]).reshape(n, len(self._columns))
        speaks = np.flatnonzero(weight.any(1))
        if not len(speaks):
            return np.zeros_like(weight)
        own = index.boxes.take(rows)
        i, j = (side.ravel() for side in np.meshgrid(np.arange(n), speaks, indexing="ij"))
        near = np.exp(-plan_gap(own.take(i), own.take(j)) / self._reach_m).reshape(n, len(speaks))
        near[near < np.exp(-4.0)] = 0.0
        bound = np.array([self.names.canonical(labels[k]) in BOUND for k in speaks])
        near[speaks, np.arange(len(speaks))] = bound
        return np.asarray(near @ weight[speaks])

    def _weight(self, label: str) -> NDArray[np.float64]:
        """[K] how a thing of this label shares its vote."""
        found = self._weights.get(label)
        if found is None:
            found = self._weights[label] = np.zeros(len(self._columns))
            kinds = () if _ANYWHERE & set(self.names.ancestors(label)) else self.kinds_of(label)
            for kind in kinds:
                found[self._columns[kind]] = 1.0 / len(kinds)
        return found

    def _glazed(self, labels: list[str], rows: NDArray[np.intp], index: Index, room: RoomNode) -> float:
        """0..1: share of a room's outline that windows take."""
        outline = np.asarray(room.polygon_xy, np.float64).reshape(-1, 2)
        around = float(np.hypot(*(np.roll(outline, -1, 0) - outline).T).sum())
        panes = [row for row, label in zip(rows, labels, strict=True) if self.names.is_a(label, "window")]
        width = float(index.boxes.size_m[panes, :2].max(1).sum()) if panes else 0.0
        return min(1.0, width / around) if around > 0 else 0.0

    def inside(self, wanted: str, rows: NDArray[np.intp], index: Index) -> NDArray[np.float64]:
        """[n] 0..1: how far the things of these rows stand in a room, or a part of one, of the kind asked for."""
        by_room = np.append(self.grades(wanted, index), 0.0)[index.room[rows]]
        column = self._columns.get(self.names.canonical_room(wanted))
        by_things = np.zeros(len(rows))
        for at in np.unique(index.room[rows]) if column is not None else ():
            if at < 0:
                continue
            room = index.graph.rooms[at]
            here = np.flatnonzero(index.room[rows] == at)
            votes = self._room(room, index).votes[np.searchsorted(index.members[room.id], rows[here])]
            # A vote that is spread over many kinds (plants, pictures) says nothing; half of it for one kind says enough.
            total = votes.sum(1)
            share = votes[:, column] / np.maximum(total, _FEW)
            by_things[here] = np.where(votes.max(1, initial=0.0) >= _FEW, np.minimum(1.0, 2.0 * share), 0.0)
        if by_room.max(initial=0.0) >= _SURE:
            by_things = by_things * np.where(by_room >= _SURE, 1.0, _ELSEWHERE)
        soft = 1.0 - (1.0 - 0.95 * by_room) * (1.0 - _BY_THINGS * by_things)
        named = next((k for k, room in enumerate(index.graph.rooms) if fold(room.id) == fold(wanted)), None)
        return soft if named is None else (index.room[rows] == named).astype(np.float64)

    def follow(self, index: Index) -> None:
        """Finds out about the rooms that have changed, before a goal has to wait for it."""
        for room in index.graph.rooms:
            self._room(room, index)

    def leads_out(self, rows: NDArray[np.intp], index: Index) -> NDArray[np.bool_]:
        """[n] whether a thing (a door) has a room on one side only, as a front door has."""
        boxes = index.boxes.take(rows)
        across = boxes.yaw_rad + np.where(boxes.size_m[:, 0] < boxes.size_m[:, 1], 0.0, np.pi / 2)
        step = np.stack([np.cos(across), np.sin(across)], 1) * _BEYOND_M
        sides = [
            np.any(
                [
                    in_polygon(boxes.center_m[:, :2] + way, room.polygon_xy)
                    for room in index.graph.rooms
                    if len(room.polygon_xy) >= 3
                ]
                or [np.zeros(len(rows), bool)],
                0,
            )
            for way in (step, -step)
        ]
        return np.asarray(sides[0] ^ sides[1])
