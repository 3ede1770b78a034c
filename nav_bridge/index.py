"""The things of a graph as arrays, so that a goal is judged against thousands of them at once.

A graph is followed from revision to revision: only things that a delta replaced are read again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.graph.model import GraphSnapshot, InstanceNode, RoomNode
from nav_bridge.relations import Boxes

_MAX_NAMES = 16384  # labels come from outside: beyond this many the table of names is made anew


@dataclass(frozen=True, slots=True)
class Index:
    """The things of one graph; row k is graph.instances[k].

    boxes: their upright boxes. exists: float64 [N], 0 for what is gone. chances: bool [N], scores of labels are chances and no votes.
    observations, points: int64 [N]. volume_m3: float64 [N]. room: intp [N], row of the thing's room in graph.rooms, -1 for none.
    names: every label that occurs (and some that did); begin: intp [N + 1]: the labels of row k are name[begin[k] : begin[k + 1]]
    (intp, into names), best first, with their share of what was said, share (float64, sums to 1 per thing). members: rows of the
    things that exist, per room id.
    """

    graph: GraphSnapshot
    rows: Mapping[str, int]
    rooms: Mapping[str, int]
    boxes: Boxes
    exists: NDArray[np.float64]
    chances: NDArray[np.bool_]
    observations: NDArray[np.int64]
    points: NDArray[np.int64]
    volume_m3: NDArray[np.float64]
    room: NDArray[np.intp]
    names: Mapping[str, int]
    begin: NDArray[np.intp]
    name: NDArray[np.intp]
    share: NDArray[np.float64]
    members: Mapping[str, NDArray[np.intp]]

    def __len__(self) -> int:
        return len(self.exists)

    @property
    def first_name(self) -> NDArray[np.intp]:
        """[N] the usual label of each thing."""
        return np.asarray(self.name[self.begin[:-1]])

    def room_of(self, row: int) -> RoomNode | None:
        return self.graph.rooms[self.room[row]] if self.room[row] >= 0 else None

    def per_thing(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """[N] sum over a thing's labels of values [labels of all things]."""
        return np.asarray(np.add.reduceat(values, self.begin[:-1])) if len(self) else np.zeros(0)


def index_of(graph: GraphSnapshot, last: Index | None = None) -> Index:
    """The index of a graph. last: of an earlier revision, from which everything is taken that did not change."""
    if last is not None and (last.graph is graph or len(last.names) > _MAX_NAMES):
        if last.graph is graph:
            return last
        last = None
    nodes = graph.instances
    source = np.full(len(nodes), -1, np.intp)
    if last is not None:
        known, old = last.rows, last.graph.instances
        for row, node in enumerate(nodes):
            at = known.get(node.id, -1)
            if at >= 0 and old[at] is node:
                source[row] = at
    fresh = np.flatnonzero(source < 0)
    names: dict[str, int] = dict(last.names) if last is not None else {}
    columns, labels = _read([nodes[k] for k in fresh], names)
    if last is not None:
        columns, labels = _merged(last, source, columns, labels)
    begin = np.zeros(len(nodes) + 1, np.intp)
    np.cumsum([len(name) for name, _ in labels], out=begin[1:]) if nodes else None
    rooms = {room.id: row for row, room in enumerate(graph.rooms)}
    room = np.array([rooms.get(node.room or "", -1) for node in nodes], np.intp)
    exists = columns[:, 7]
    return Index(
        graph=graph,
        rows={node.id: row for row, node in enumerate(nodes)},
        rooms=rooms,
        boxes=Boxes(columns[:, 0:3], columns[:, 3:6], columns[:, 6]),
        exists=exists,
        chances=columns[:, 11] > 0,
        observations=columns[:, 8].astype(np.int64),
        points=columns[:, 9].astype(np.int64),
        volume_m3=columns[:, 10],
        room=room,
        names=names,
        begin=begin,
        name=np.concatenate([name for name, _ in labels]) if labels else np.zeros(0, np.intp),
        share=np.concatenate([share for _, share in labels]) if labels else np.zeros(0),
        members=_members(graph, room, exists),
    )


Labels = list[tuple[NDArray[np.intp], NDArray[np.float64]]]
_COLUMNS = 12


def _read(nodes: list[InstanceNode], names: dict[str, int]) -> tuple[NDArray[np.float64], Labels]:
    """(what is a number of each thing, its labels); new labels are added to names."""
    columns = np.empty((len(nodes), _COLUMNS))
    labels: Labels = []
    for row, node in enumerate(nodes):
        exists = 0.0 if node.state == "gone" else node.existence
        columns[row] = (
            *node.obb_center_m, *node.obb_size_m, node.obb_yaw_rad, exists,
            node.observations, node.point_count, node.volume_m3, node.score_kind == "chances",
        )  # fmt: skip
        said = [(name, score) for name, score in node.labels if score > 0] or [(node.label, 1.0)]
        total = sum(score for _, score in said)
        numbers = np.array([names.setdefault(name, len(names)) for name, _ in said], np.intp)
        labels.append((numbers, np.array([score / total for _, score in said])))
    return columns, labels


def _merged(
    last: Index, source: NDArray[np.intp], columns: NDArray[np.float64], labels: Labels
) -> tuple[NDArray[np.float64], Labels]:
    """Columns and labels of all things: those with a source >= 0 from the last index, the others as read."""
    old = np.c_[
        last.boxes.center_m, last.boxes.size_m, last.boxes.yaw_rad,
        last.exists, last.observations, last.points, last.volume_m3, last.chances,
    ]  # fmt: skip
    out = np.empty((len(source), _COLUMNS))
    kept = source >= 0
    out[kept], out[~kept] = old[source[kept]], columns
    fresh = iter(labels)
    begin, name, share = last.begin.tolist(), last.name, last.share
    every = [
        (name[begin[k] : begin[k + 1]], share[begin[k] : begin[k + 1]]) if k >= 0 else next(fresh)
        for k in source.tolist()
    ]
    return out, every


def _members(
    graph: GraphSnapshot, room: NDArray[np.intp], exists: NDArray[np.float64]
) -> Mapping[str, NDArray[np.intp]]:
    order = np.argsort(room, kind="stable")
    order = order[(room[order] >= 0) & (exists[order] > 0)]
    ends = np.searchsorted(room[order], np.arange(len(graph.rooms) + 1))
    return {r.id: order[ends[k] : ends[k + 1]] for k, r in enumerate(graph.rooms)}
