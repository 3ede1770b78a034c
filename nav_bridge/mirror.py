"""The scene graph as irsd publishes it, followed here: deltas first, then the snapshot, then every delta after it.

A gap in the revisions, or another map, means: take the snapshot again.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import replace
from typing import TypeVar

from irsd.core.errors import IrsdError
from irsd.core.runtime import Cell, Counters, Ring, Stopper, Worker, monotonic_ns
from irsd.graph.codec import delta_from_json, snapshot_from_json
from irsd.graph.model import DoorEdge, GraphDelta, GraphSnapshot, InstanceNode, RoomNode
from irsd.io.keys import RobotKeys
from irsd.io.session import Sample, Session

_log = logging.getLogger(__name__)

_RETRY_S = 1.0  # pause between questions for a snapshot that nobody answers
_BACKLOG = 512

N = TypeVar("N", RoomNode, DoorEdge, InstanceNode)


def apply_delta(graph: GraphSnapshot, delta: GraphDelta) -> GraphSnapshot:
    """The graph one revision on. Nodes stay sorted by the number in their id; the building lists all rooms."""
    gone = frozenset(delta.removed)
    rooms = _merged(graph.rooms, delta.rooms, gone)
    return replace(
        graph,
        seq=delta.seq,
        stamp_ns=delta.stamp_ns,
        frame=delta.frame,
        building=replace(graph.building, rooms=tuple(room.id for room in rooms)),
        rooms=rooms,
        doors=_merged(graph.doors, delta.doors, gone),
        instances=_merged(graph.instances, delta.instances, gone),
    )


def _merged(old: Iterable[N], new: Iterable[N], gone: frozenset[str]) -> tuple[N, ...]:
    nodes = {node.id: node for node in old if node.id not in gone}
    nodes.update({node.id: node for node in new})
    return tuple(sorted(nodes.values(), key=lambda node: int(node.id[1:])))


class GraphMirror:
    """Keeps a copy of irsd's graph up to date on its own thread. ``graph`` may be read from any thread."""

    def __init__(self, session: Session, keys: RobotKeys, timeout_s: float) -> None:
        self._session = session
        self._keys = keys
        self._timeout_s = timeout_s
        self._graph: Cell[GraphSnapshot | None] = Cell(None)
        self._synced_ns: Cell[int] = Cell(0)
        self._counters = Counters()
        self._stopper = Stopper()
        self._deltas: Ring[Sample] = Ring(_BACKLOG)
        # Before the first snapshot is asked for: what happens meanwhile must not be missed.
        self._hellos: Ring[Sample] = Ring(8)
        self._alive = session.watch_alive(keys.alive, self._hellos)
        self._subscription = session.subscribe_history(keys.delta, self._deltas)
        self._worker = Worker("graph-mirror", self._run).start()

    @property
    def graph(self) -> GraphSnapshot | None:
        """The latest graph, None while irsd has not answered yet."""
        return self._graph.get()

    @property
    def synced_ns(self) -> int:
        """When irsd was last asked for its whole graph, and answered; 0 before."""
        return self._synced_ns.get()

    @property
    def alive(self) -> bool:
        return self._worker.alive

    def counters(self) -> dict[str, int]:
        """deltas applied, resyncs, bad_documents."""
        return dict(self._counters.snapshot())

    def close(self) -> None:
        self._stopper.request("closed")
        self._worker.join(self._timeout_s + 2.0)
        self._subscription.close()
        self._alive.close()

    def _run(self) -> None:
        dropped = 0
        while not self._stopper.requested:
            if self._graph.get() is None and not self._resync():
                self._stopper.wait(_RETRY_S)
                continue
            sample = self._deltas.get(timeout_s=0.2)
            # irsd (again): it may hold another map, of which no delta tells as long as it stands still.
            started = any(not hello.deleted for hello in self._hellos.drain())
            if started or self._deltas.dropped != dropped:
                dropped = self._deltas.dropped
                self._resync()
            if sample is not None:
                self._take(sample)

    def _take(self, sample: Sample) -> None:
        graph = self._graph.get()
        try:
            delta = delta_from_json(sample.payload)
        except IrsdError as error:
            self._counters.add("bad_documents")
            _log.warning("a graph delta was dropped: %s", error)
            return
        if graph is not None and delta.map_id == graph.map_id:
            if delta.seq <= graph.seq:
                return
            if delta.seq == graph.seq + 1:
                self._graph.set(apply_delta(graph, delta))
                self._counters.add("deltas")
                return
        self._resync()

    def _resync(self) -> bool:
        """Takes the snapshot; False when irsd does not answer with one."""
        self._counters.add("resyncs")
        asked_ns = monotonic_ns()
        for reply in self._session.get(self._keys.snapshot, timeout_s=self._timeout_s):
            if not reply.ok:
                continue
            try:
                self._graph.set(snapshot_from_json(reply.payload))
                self._synced_ns.set(asked_ns)
                return True
            except IrsdError as error:
                self._counters.add("bad_documents")
                _log.warning("the graph's snapshot was dropped: %s", error)
        return False
