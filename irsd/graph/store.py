"""The map on disk: one SQLite file (WAL) in the state directory. One step of the graph is one transaction.

A process that is killed at any instant loses at most the step in flight: what ``load`` gives is always the state after some step,
with the edits that this step holds. A whole map goes from file to file in one transaction too.
"""

from __future__ import annotations

import contextlib
import os
import sqlite3
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import DecodeError, StoreError
from irsd.core.types import Prototype
from irsd.graph.codec import (
    Node,
    delta_from_json,
    delta_to_json,
    edit_from_json,
    edit_to_json,
    node_from_json,
    node_to_json,
)
from irsd.graph.edits import Beneath, Record
from irsd.graph.model import (
    DoorEdge,
    Edit,
    GraphDelta,
    GraphSnapshot,
    InstanceArrays,
    InstanceNode,
    RoomNode,
    building_of,
)

FILE_NAME = "map.sqlite"
STORE_VERSION = 2
_APPLICATION = 0x49525344  # "IRSD": tells our files from other SQLite files
_ARRAY = "id TEXT PRIMARY KEY, points BLOB NOT NULL, count INTEGER NOT NULL, embedding BLOB"
_LAYOUT_1 = (
    "CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID",
    "CREATE TABLE node (id TEXT PRIMARY KEY, number INTEGER NOT NULL, document BLOB NOT NULL)",
    f"CREATE TABLE array ({_ARRAY})",
    "CREATE TABLE step (seq INTEGER PRIMARY KEY, document BLOB NOT NULL)",
)
_LAYOUT_2 = (
    "CREATE TABLE edit (number INTEGER PRIMARY KEY, document BLOB NOT NULL)",
    f"CREATE TABLE beneath ({_ARRAY}, document BLOB NOT NULL)",
    "CREATE TABLE prototype (number INTEGER PRIMARY KEY, name TEXT NOT NULL, "
    "points BLOB NOT NULL, count INTEGER NOT NULL, embedding BLOB)",
    "CREATE TABLE geometry (key TEXT PRIMARY KEY, value BLOB NOT NULL) WITHOUT ROWID",
)
_MIGRATIONS: Mapping[int, tuple[str, ...]] = MappingProxyType({0: _LAYOUT_1, 1: _LAYOUT_2})
"""What makes the next layout of each; layout 0 is an empty file."""
_TABLES = ("meta", "node", "array", "step", "edit", "beneath", "prototype", "geometry")
_OF_THE_MAP = ("meta", "node", "array", "step", "edit", "beneath", "geometry")  # what was taught outlives it
NodeT = TypeVar("NodeT", RoomNode, DoorEdge, InstanceNode)


_NO_RECORD = Record()


@dataclass(frozen=True, slots=True)
class StoredMap:
    """Everything needed to go on: the graph at its last step, points and embedding of each instance by id, and what operators said.

    edits: the journal. beneath: by id, what perception says of things that are told otherwise. next_ids: first free number by letter.
    geometry: what a scan is compared with to tell whether this is the place, by name. taught: see ``Store.prototypes``.
    """

    snapshot: GraphSnapshot
    arrays: Mapping[str, InstanceArrays]
    edits: tuple[Edit, ...] = ()
    beneath: Mapping[str, Beneath] = field(default_factory=dict)
    next_ids: Mapping[str, int] = field(default_factory=dict)
    geometry: Mapping[str, bytes] = field(default_factory=dict)
    taught: Mapping[int, Prototype] = field(default_factory=dict)


class Store:
    """The single writer of the state directory. Not for use by several threads at once, but may be handed from one to another."""

    def __init__(self, directory: Path, *, keep_steps: int = 1000, timeout_s: float = 2.0) -> None:
        """Opens or makes the file. keep_steps: length of the log of deltas.

        Raises StoreError, which says what to do, when the directory can't be written, when another process has the file open, when the
        file is damaged, or when a later version of irsd wrote it. A file of an earlier layout is brought to this one.
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
            self._migrate(0)
        elif found[1] != _APPLICATION:
            raise StoreError(f"{self.path} is a database of another program: give irsd a state directory of its own")
        elif found[0] not in _MIGRATIONS and found[0] != STORE_VERSION:
            raise StoreError(
                f"{self.path} was written in layout {found[0]}, this irsd reads layouts 1 to {STORE_VERSION}: "
                "run the irsd that wrote it, or move the file away to start an empty map"
            )
        elif found[0] != STORE_VERSION:
            self._migrate(found[0])
        # NORMAL: a commit survives the death of the process; a power cut may take the last steps, never the file.
        self._db.execute("PRAGMA synchronous = NORMAL")
        foreign = self._number("SELECT count(*) FROM sqlite_master WHERE type NOT IN ('table', 'index')")
        if foreign:
            raise sqlite3.DatabaseError("it holds views or triggers, which irsd never makes")
        verdict = self._db.execute("PRAGMA quick_check(1)").fetchone()[0]
        if verdict != "ok":
            raise sqlite3.DatabaseError(verdict)

    def _migrate(self, layout: int) -> None:
        """From one layout to this one's, all or nothing."""
        with self._transaction():
            for number in range(layout, STORE_VERSION):
                for statement in _MIGRATIONS[number]:
                    self._db.execute(statement)
            self._db.execute(f"PRAGMA user_version = {STORE_VERSION}")
            self._db.execute(f"PRAGMA application_id = {_APPLICATION}")

    def close(self) -> None:
        """Folds the log into the file and gives it free."""
        with self._explained():
            self._db.close()

    # ------------------------------------------------------------------------------------------------ writing
    def append(
        self,
        delta: GraphDelta,
        arrays: Mapping[str, InstanceArrays],
        record: Record = _NO_RECORD,
        *,
        building_name: str = "building",
    ) -> None:
        """One step: its nodes, the arrays of the instances that changed, the delta itself and its record, all or nothing.

        Raises StoreError when the step does not follow on the last one or is of another map.
        """
        with self._explained():
            self._check_follows(delta)
            with self._transaction():
                self._append(delta, arrays, record, building_name)

    def _append(
        self, delta: GraphDelta, arrays: Mapping[str, InstanceArrays], record: Record, building_name: str
    ) -> None:
        nodes: tuple[Node, ...] = (*delta.rooms, *delta.doors, *delta.instances)
        for node_id in delta.removed:
            self._db.execute("DELETE FROM node WHERE id = ?", (node_id,))
            self._db.execute("DELETE FROM array WHERE id = ?", (node_id,))
        for node in nodes:
            document = node_to_json(node, seq=delta.seq, frame=delta.frame)
            self._db.execute("INSERT OR REPLACE INTO node VALUES (?, ?, ?)", (node.id, int(node.id[1:]), document))
        for node_id, value in arrays.items():
            self._db.execute("INSERT OR REPLACE INTO array VALUES (?, ?, ?, ?)", (node_id, *_packed(value)))
        self._db.execute("INSERT INTO step VALUES (?, ?)", (delta.seq, delta_to_json(delta)))
        self._db.execute("DELETE FROM step WHERE seq <= ?", (delta.seq - self._keep_steps,))
        self._write_record(record, delta)
        meta = {"seq": delta.seq, "stamp_ns": delta.stamp_ns, "map_id": delta.map_id, "frame": delta.frame}
        ids = {f"next_{letter}": number for letter, number in record.next_ids.items()}
        rows = [(key, str(value)) for key, value in {**meta, **ids, "building": building_name}.items()]
        self._db.executemany("INSERT OR REPLACE INTO meta VALUES (?, ?)", rows)

    def _write_record(self, record: Record, delta: GraphDelta) -> None:
        for edit in record.edits:
            document = edit_to_json(edit, seq=delta.seq, frame=delta.frame)
            self._db.execute("INSERT OR REPLACE INTO edit VALUES (?, ?)", (edit.number, document))
        for number, example in record.prototypes.items():
            packed = _packed(InstanceArrays(example.points_m, example.embedding))
            self._db.execute("INSERT OR REPLACE INTO prototype VALUES (?, ?, ?, ?, ?)", (number, example.name, *packed))
        for node_id, value in record.beneath.items():
            self._db.execute("DELETE FROM beneath WHERE id = ?", (node_id,))
            if value is not None:
                document = node_to_json(value[0], seq=delta.seq, frame=delta.frame)
                self._db.execute("INSERT INTO beneath VALUES (?, ?, ?, ?, ?)", (node_id, *_packed(value[1]), document))

    def keep_geometry(self, values: Mapping[str, bytes]) -> None:
        """What scans are compared with after the next start, by name; replaces what had these names, all or nothing."""
        with self._explained(), self._transaction():
            self._db.executemany("INSERT OR REPLACE INTO geometry VALUES (?, ?)", list(values.items()))

    def clear(self, keep_prototypes: frozenset[int] = frozenset()) -> None:
        """Forget the map: an empty store, ready for another. keep_prototypes: examples by number that outlive it."""
        with self._explained(), self._transaction():
            for table in _OF_THE_MAP:
                self._db.execute(f"DELETE FROM {table}")
            kept = ",".join(str(int(n)) for n in sorted(keep_prototypes))
            self._db.execute(f"DELETE FROM prototype WHERE number NOT IN ({kept})")

    # ------------------------------------------------------------------------------------------------ whole maps
    def save_as(self, path: Path) -> None:
        """The map as a file of its own; it appears whole or not at all, and replaces what had the name."""
        partial = path.with_name(f".{path.name}.part")
        with self._explained():
            path.parent.mkdir(parents=True, exist_ok=True)
            partial.unlink(missing_ok=True)
            self._db.execute("VACUUM INTO ?", (str(partial),))
            with partial.open("rb") as stream:
                os.fsync(stream.fileno())
            partial.replace(path)

    def replace_by(self, path: Path, delta: GraphDelta) -> None:
        """The map of another file of this layout instead of this one, in one transaction. delta: tells of it, at its new revision."""
        with self._explained():
            self._db.execute("ATTACH ? AS other", (str(path),))
            try:
                with self._transaction():
                    for table in _TABLES:
                        self._db.execute(f"DELETE FROM main.{table}")
                        self._db.execute(f"INSERT INTO main.{table} SELECT * FROM other.{table}")
                    self._db.execute("DELETE FROM step")
                    self._db.execute("INSERT INTO step VALUES (?, ?)", (delta.seq, delta_to_json(delta)))
                    self._db.execute("UPDATE meta SET value = ? WHERE key = 'seq'", (str(delta.seq),))
            finally:
                self._db.execute("DETACH other")

    def rewrite(self, stored: StoredMap) -> None:
        """The map written whole instead of what was here, in one transaction; the log of deltas begins anew."""
        graph = stored.snapshot
        nodes = (graph.rooms, graph.doors, graph.instances)
        delta = GraphDelta(graph.seq, graph.stamp_ns, graph.map_id, graph.frame, *nodes, (), ("written whole",))
        record = Record(stored.edits, stored.taught, stored.beneath, stored.next_ids)
        with self._explained(), self._transaction():
            for table in (*_OF_THE_MAP, "prototype"):
                self._db.execute(f"DELETE FROM {table}")
            self._append(delta, stored.arrays, record, graph.building.name)
            self._db.executemany("INSERT INTO geometry VALUES (?, ?)", list(stored.geometry.items()))

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
            return StoredMap(
                snapshot,
                {row[0]: _unpacked(*row[1:]) for row in rows if row[0] in known},
                tuple(edit_from_json(row[0]) for row in self._db.execute("SELECT document FROM edit ORDER BY number")),
                self._beneath(),
                {key[5:]: int(value) for key, value in meta.items() if key.startswith("next_")},
                dict(self._db.execute("SELECT key, value FROM geometry").fetchall()),
                self.prototypes(),
            )

    def prototypes(self) -> dict[int, Prototype]:
        """What was ever taught, by the number of its edit, of earlier maps too."""
        with self._explained():
            rows = self._db.execute("SELECT number, name, points, count, embedding FROM prototype ORDER BY number")
            found = {number: (name, _unpacked(*rest)) for number, name, *rest in rows.fetchall()}
            return {n: Prototype(name, value.points_map, value.embedding) for n, (name, value) in found.items()}

    def _beneath(self) -> dict[str, Beneath]:
        out: dict[str, Beneath] = {}
        for node_id, *packed, document in self._db.execute("SELECT * FROM beneath ORDER BY id").fetchall():
            node = node_from_json(document)
            if not isinstance(node, InstanceNode):
                raise DecodeError(f"beneath {node_id} lies no thing")
            out[node_id] = (node, _unpacked(*packed))
        return out

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
    # No more than was promised: a short blob can hold gigabytes of zeros.
    planes = np.frombuffer(zlib.decompressobj().decompress(points, 12 * count + 1), np.uint8).reshape(4, count * 3)
    cloud: NDArray[np.float32] = np.ascontiguousarray(planes.T).view("<f4").reshape(count, 3).astype(np.float32)
    if embedding is None:
        return InstanceArrays(cloud, None)
    vector = np.frombuffer(embedding, "<f2").astype(np.float32)
    return InstanceArrays(cloud, np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12), np.float32))


def _of(kind: type[NodeT], nodes: list[Any]) -> tuple[NodeT, ...]:
    return tuple(node for node in nodes if isinstance(node, kind))
