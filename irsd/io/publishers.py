"""The scene graph as zenoh resources: deltas with history, a last value per node, arrays and the map on request, status.

Deltas: subscribe first, then take ``graph/snapshot`` and drop deltas with seq <= its seq. Every node is a resource of its own,
put when it changes, deleted when it ends, and answered to late ``get``s, wildcards included. Points and embeddings are heavy:
they are answered only where the question ends in ``points`` or ``embedding``, not to a ``graph/**``.
"""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import TransportError
from irsd.core.grid import GridFrame
from irsd.core.runtime import Cell, Guarded
from irsd.graph.codec import array_to_bytes, delta_to_json, node_to_json, occupancy_to_png, snapshot_to_json
from irsd.graph.model import BuildingNode, GraphDelta, GraphSnapshot, InstanceArrays, InstanceNode, RoomNode
from irsd.io.keys import RobotKeys
from irsd.io.session import BINARY, PNG, Handle, Query, Session

Node = BuildingNode | RoomNode | InstanceNode
Grid = tuple[GridFrame, NDArray[np.int8]]

_DELTAS_KEPT = 1024


class GraphPublisher:
    """Tells the network of the graph. One thread calls ``publish``, one ``publish_status``; the session's pool answers.

    arrays(instance id), grid(): fetch from the pipeline in a way that is safe from any thread; may raise IrsdError.
    ``announce`` comes last, when everything that the alive token promises is answered.
    """

    def __init__(
        self,
        session: Session,
        keys: RobotKeys,
        snapshot: GraphSnapshot,
        arrays: Callable[[str], InstanceArrays | None],
        grid: Callable[[], Grid],
    ) -> None:
        self._session, self._keys = session, keys
        self._arrays, self._grid = arrays, grid
        self._snapshot = Cell(snapshot)
        self._resources: Guarded[dict[str, bytes]] = Guarded(self._all_nodes(snapshot))
        self._status = Cell(b"")
        self._deltas = session.history_publisher(keys.delta, keep=_DELTAS_KEPT)
        answers: tuple[tuple[str, Callable[[Query], None]], ...] = (
            (keys.snapshot, self._answer_snapshot),
            (keys.building, lambda query: self._answer_nodes(query, keys.building)),
            (keys.rooms, lambda query: self._answer_nodes(query, keys.room(""))),
            (keys.instances, lambda query: self._answer_nodes(query, keys.instance(""))),
            (keys.points("*"), self._answer_points),
            (keys.embedding("*"), self._answer_embedding),
            (keys.occupancy, self._answer_grid),
            (keys.status, self._answer_status),
        )
        self._handles: list[Handle] = [self._deltas, *(session.queryable(key, answer) for key, answer in answers)]

    def announce(self) -> None:
        """Shows the alive token: from now on everything is answered."""
        self._handles.append(self._session.announce(self._keys.alive))

    def publish(self, delta: GraphDelta, snapshot: GraphSnapshot) -> None:
        """One step of the graph; snapshot: the graph after it. A delta that does not follow the last one re-sends all nodes."""
        follows = delta.seq == self._snapshot.get().seq + 1
        gone: set[str] = set()
        if follows:
            changed = self._changed_nodes(delta, snapshot)
            gone = {self._key_of(node_id) for node_id in delta.removed if node_id[0] in "RI"}
            with self._resources.locked() as resources:
                resources.update(changed)
                for key in gone:
                    resources.pop(key, None)
        else:
            changed = self._all_nodes(snapshot)
            with self._resources.locked() as resources:
                gone = resources.keys() - changed.keys()
                resources.clear()
                resources.update(changed)
        self._snapshot.set(snapshot)
        self._deltas.put(delta_to_json(delta))
        for key, payload in changed.items():
            self._session.put(key, payload)
        for key in sorted(gone):
            self._session.delete(key)

    def publish_status(self, document: bytes) -> None:
        """The status document, JSON."""
        self._status.set(document)
        self._session.put(self._keys.status, document, block=False)

    def status(self) -> bytes:
        """The last status document; empty before the first."""
        return self._status.get()

    def close(self) -> None:
        """Withdraws everything, the alive token first."""
        for handle in reversed(self._handles):
            handle.close()

    # -------------------------------------------------------------------------------------------------------- nodes
    def _key_of(self, node_id: str) -> str:
        if node_id.startswith("R"):
            return self._keys.room(node_id)
        return self._keys.instance(node_id) if node_id.startswith("I") else self._keys.building

    def _all_nodes(self, snapshot: GraphSnapshot) -> dict[str, bytes]:
        nodes: tuple[Node, ...] = (snapshot.building, *snapshot.rooms, *snapshot.instances)
        return {self._key_of(n.id): node_to_json(n, seq=snapshot.seq, frame=snapshot.frame) for n in nodes}

    def _changed_nodes(self, delta: GraphDelta, snapshot: GraphSnapshot) -> dict[str, bytes]:
        nodes: tuple[Node, ...] = (*delta.rooms, *delta.instances)
        changed = {self._key_of(n.id): node_to_json(n, seq=delta.seq, frame=delta.frame) for n in nodes}
        if self._snapshot.get().building != snapshot.building:
            changed[self._keys.building] = node_to_json(snapshot.building, seq=delta.seq, frame=delta.frame)
        return changed

    # ------------------------------------------------------------------------------------------------------ answers
    def _answer_snapshot(self, query: Query) -> None:
        query.reply(self._keys.snapshot, snapshot_to_json(self._snapshot.get()))

    def _answer_nodes(self, query: Query, prefix: str) -> None:
        """A question over wildcards reaches each of these queryables; each answers for its own part of the keys."""
        with self._resources.locked() as resources:
            own = [(key, payload) for key, payload in resources.items() if key.startswith(prefix)]
        found = [(key, payload) for key, payload in own if query.matches(key)]
        for key, payload in found:
            query.reply(key, payload)

    def _answer_points(self, query: Query) -> None:
        for instance_id in self._asked_for(query, "points"):
            arrays = self._arrays(instance_id)
            if arrays is not None:
                payload, attachment = array_to_bytes(arrays.points_map)
                query.reply(self._keys.points(instance_id), payload, encoding=BINARY, attachment=attachment)

    def _answer_embedding(self, query: Query) -> None:
        for instance_id in self._asked_for(query, "embedding"):
            arrays = self._arrays(instance_id)
            if arrays is not None and arrays.embedding is not None:
                payload, attachment = array_to_bytes(arrays.embedding)
                query.reply(self._keys.embedding(instance_id), payload, encoding=BINARY, attachment=attachment)

    def _asked_for(self, query: Query, what: str) -> list[str]:
        if query.key.rsplit("/", 1)[-1] != what:
            return []
        ids = [node.id for node in self._snapshot.get().instances]
        return [i for i in ids if query.matches(self._keys.key(f"graph/instances/{i}/{what}"))]

    def _answer_grid(self, query: Query) -> None:
        frame, cells = self._grid()
        if not cells.size:
            raise TransportError("there is no map yet: no sweep has been placed in it")
        snapshot = self._snapshot.get()
        header = {
            "resolution_m": frame.resolution_m,
            "origin_xy_m": list(frame.origin_xy_m),
            "frame": snapshot.frame,
            "seq": snapshot.seq,
        }
        query.reply(self._keys.occupancy, occupancy_to_png(cells), encoding=PNG, attachment=json.dumps(header).encode())

    def _answer_status(self, query: Query) -> None:
        document = self._status.get()
        if not document:
            raise TransportError("irsd is starting")
        query.reply(self._keys.status, document)
