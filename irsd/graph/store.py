"""The map on disk: one SQLite file (WAL) in the state directory. One step of the graph is one transaction.

A process that is killed at any instant loses at most the step in flight: what ``load`` gives is always the state after some step.
"""

from __future__ import annotations

import contextlib
import sqlite3
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import DecodeError, StoreError
from irsd.graph.codec import Node, delta_from_json, delta_to_json, node_from_json, node_to_json
from irsd.graph.model import (
    DoorEdge,
    GraphDelta,
    GraphSnapshot,
    InstanceArrays,
    InstanceNode,
    RoomNode,
    building_of,
)

FILE_NAME = "map.sqlite"
STORE_VERSION = 1
_APPLICATION = 0x49525344  # "IRSD": tells our files from other SQLite files
_TABLES = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE node (id TEXT PRIMARY KEY, number INTEGER NOT NULL, document BLOB NOT NULL);
CREATE TABLE array (id TEXT PRIMARY KEY, points BLOB NOT NULL, count INTEGER NOT NULL, embedding BLOB);
CREATE TABLE step (seq INTEGER PRIMARY KEY, document BLOB NOT NULL);
"""
NodeT = TypeVar("NodeT", RoomNode, DoorEdge, InstanceNode)


@dataclass(frozen=True, slots=True)
class StoredMap:
    """Everything needed to go on: the graph at its last step, and points and embedding of each instance by id."""

    snapshot: GraphSnapshot
    arrays: Mapping[str, InstanceArrays]


class Store:
    """The single writer of the state directory. Not for use by several threads at once, but may be handed from one to another."""

    def __init__(self, directory: Path, *, keep_steps: int = 1000, timeout_s: float = 2.0) -> None:
        """Opens or makes the file. keep_steps: length of the log of deltas.

        Raises StoreError, which says what to do, when the directory can't be written, when another process has the file open, when the
        file is damaged, or when another version of irsd wrote it.
        """
        self.path = Path(directory) / FILE_NAME
        self._keep_steps = keep_steps
        with self._explained():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(self.path, timeout=timeout_s, isolation_level=None, check_same_thread=False)
        try:
            with self._explained():
                self._open()
        except StoreError:
            self._db.close()
            raise

    def _open(self) -> None:
        # Exclusive: two daemons on one map would corrupt each other's numbering. The lock ends with the process.
        self._db.execute("PRAGMA locking_mode = EXCLUSIVE")
        found = self._number("PRAGMA user_version"), self._number("PRAGMA application_id")
        if found == (0, 0) and not self._number("SELECT count(*) FROM sqlite_master"):
            self._db.execute("PRAGMA journal_mode = WAL")
            with self._transaction():
                for statement in filter(str.strip, _TABLES.split(";")):
                    self._db.execute(statement)
                self._db.execute(f"PRAGMA user_version = {STORE_VERSION}")
                self._db.execute(f"PRAGMA application_id = {_APPLICATION}")
        elif found[1] != _APPLICATION:
            raise StoreError(f"{self.path} is a database of another program: give irsd a state directory of its own")
        elif found[0] != STORE_VERSION:
            raise StoreError(
                f"{self.path} was written in layout {found[0]}, this irsd reads layout {STORE_VERSION}: "
                "run the irsd that wrote it, or move the file away to start an empty map"
            )
        # NORMAL: a commit survives the death of the process; a power cut may take the last steps, never the file.
        self._db.execute("PRAGMA synchronous = NORMAL")
        verdict = self._db.execute("PRAGMA quick_check(1)").fetchone()[0]
        if verdict != "ok":
            raise sqlite3.DatabaseError(verdict)

    def close(self) -> None:
        """Folds the log into the file and gives it free."""
        with self._explained():
            self._db.close()

    # ------------------------------------------------------------------------------------------------ writing
    def append(
        self, delta: GraphDelta, arrays: Mapping[str, InstanceArrays], *, building_name: str = "building"
    ) -> None:
        """One step: its nodes, the arrays of the instances that changed, and the delta itself, all or nothing.

        Raises StoreError when the step does not follow on the last one or is of another map.
        """
        nodes: tuple[Node, ...] = (*delta.rooms, *delta.doors, *delta.instances)
        with self._explained():
            self._check_follows(delta)
            with self._transaction():
                for node_id in delta.removed:
                    self._db.execute("DELETE FROM node WHERE id = ?", (node_id,))
                    self._db.execute("DELETE FROM array WHERE id = ?", (node_id,))
                for node in nodes:
                    document = node_to_json(node, seq=delta.seq, frame=delta.frame)
                    self._db.execute(
                        "INSERT OR REPLACE INTO node VALUES (?, ?, ?)", (node.id, int(node.id[1:]), document)
                    )
                for node_id, value in arrays.items():
                    self._db.execute("INSERT OR REPLACE INTO array VALUES (?, ?, ?, ?)", (node_id, *_packed(value)))
                self._db.execute("INSERT INTO step VALUES (?, ?)", (delta.seq, delta_to_json(delta)))
                self._db.execute("DELETE FROM step WHERE seq <= ?", (delta.seq - self._keep_steps,))
                meta = {"seq": delta.seq, "stamp_ns": delta.stamp_ns, "map_id": delta.map_id, "frame": delta.frame}
                rows = [(key, str(value)) for key, value in {**meta, "building": building_name}.items()]
                self._db.executemany("INSERT OR REPLACE INTO meta VALUES (?, ?)", rows)

    def clear(self) -> None:
        """Forget the map: an empty store, ready for another."""
        with self._explained(), self._transaction():
            for table in ("meta", "node", "array", "step"):
                self._db.execute(f"DELETE FROM {table}")

    def _check_follows(self, delta: GraphDelta) -> None:
        meta = self._meta()
        if not meta:
            return
        if (meta["map_id"], meta["frame"]) != (delta.map_id, delta.frame):
            raise StoreError(
                f"{self.path} holds map {meta['map_id']} in frame {meta['frame']}, the step is of {delta.map_id} in "
                f"{delta.frame}: use another state directory, or clear this one"
            )
        if delta.seq != int(meta["seq"]) + 1:
            raise StoreError(f"{self.path} is at step {meta['seq']}, step {delta.seq} does not follow: load it first")

    # ------------------------------------------------------------------------------------------------ reading
    def load(self) -> StoredMap | None:
        """The map after its last step, None when nothing was ever stored. StoreError when it can't be read."""
        with self._explained():
            meta = self._meta()
            if not meta:
                return None
            nodes = [node_from_json(row[0]) for row in self._db.execute("SELECT document FROM node ORDER BY number")]
            rows = self._db.execute("SELECT id, points, count, embedding FROM array ORDER BY id").fetchall()
            rooms = _of(RoomNode, nodes)
            snapshot = GraphSnapshot(
                seq=int(meta["seq"]),
                stamp_ns=int(meta["stamp_ns"]),
                map_id=meta["map_id"],
                frame=meta["frame"],
                building=building_of("B0", meta["building"], rooms),
                rooms=rooms,
                doors=_of(DoorEdge, nodes),
                instances=_of(InstanceNode, nodes),
            )
            known = {node.id for node in snapshot.instances}
            return StoredMap(snapshot, {row[0]: _unpacked(*row[1:]) for row in rows if row[0] in known})

    def steps(self, after_seq: int = 0) -> tuple[GraphDelta, ...]:
        """The deltas in the log with seq > after_seq, oldest first; older ones may have been dropped."""
        with self._explained():
            rows = self._db.execute("SELECT document FROM step WHERE seq > ? ORDER BY seq", (after_seq,)).fetchall()
            return tuple(delta_from_json(row[0]) for row in rows)

    # ------------------------------------------------------------------------------------------------ helpers
    def _meta(self) -> dict[str, str]:
        return dict(self._db.execute("SELECT key, value FROM meta").fetchall())

    def _number(self, statement: str) -> int:
        return int(self._db.execute(statement).fetchone()[0])

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        self._db.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            self._db.execute("ROLLBACK")
            raise
        self._db.execute("COMMIT")

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        """Turns what SQLite and the file system raise into a StoreError that says what to do."""
        try:
            yield
        except sqlite3.OperationalError as error:
            if "locked" in str(error):
                raise StoreError(f"{self.path} is in use by another process: stop that irsd first") from error
            raise StoreError(f"{self.path}: {error}: check the directory, its owner and the free space") from error
        except OSError as error:
            raise StoreError(f"{self.path}: {error}: check the directory, its owner and the free space") from error
        except (sqlite3.DatabaseError, DecodeError, zlib.error, KeyError, ValueError) as error:
            raise StoreError(f"{self.path} is damaged ({error}): move it away to start an empty map") from error


def _packed(value: InstanceArrays) -> tuple[bytes, int, bytes | None]:
    points = np.ascontiguousarray(value.points_map, "<f4")
    # Byte planes apart: exponents of neighbours are equal, which halves what zlib makes of them.
    planes = points.view(np.uint8).reshape(-1, 4).T.tobytes()
    embedding = None if value.embedding is None else np.asarray(value.embedding, "<f2").tobytes()
    return zlib.compress(planes, 1), len(points), embedding


def _unpacked(points: bytes, count: int, embedding: bytes | None) -> InstanceArrays:
    planes = np.frombuffer(zlib.decompress(points), np.uint8).reshape(4, count * 3)
    cloud: NDArray[np.float32] = np.ascontiguousarray(planes.T).view("<f4").reshape(count, 3).astype(np.float32)
    if embedding is None:
        return InstanceArrays(cloud, None)
    vector = np.frombuffer(embedding, "<f2").astype(np.float32)
    return InstanceArrays(cloud, np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12), np.float32))


def _of(kind: type[NodeT], nodes: list[Any]) -> tuple[NodeT, ...]:
    return tuple(node for node in nodes if isinstance(node, kind))
