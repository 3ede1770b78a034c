"""Which map a running irsd is in: snapshots of it, its way out as one file and in again, and the start of a new one.

A snapshot is a store of its own under ``snapshots/`` in the state directory. Another map takes the place of the present one between
two steps, on disk in one transaction: after a kill -9 it is wholly the one or wholly the other.
"""

from __future__ import annotations

import re
import shutil
import tempfile
import uuid
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from irsd.core.errors import EditError, StoreError
from irsd.core.types import Prototype
from irsd.graph.edits import known_prototypes
from irsd.graph.store import FILE_NAME, Store, StoredMap
from irsd.keeper import Keeper
from irsd.maploop import MapLoop, Replacement
from irsd.pipeline import MapPipeline

SNAPSHOTS = "snapshots"
SUFFIX = ".sqlite"
PREVIOUS = "previous"  # the snapshot that is made before another map takes over
EXPORT_HEADER = b"irsd-map/1\n"
MAX_MAP_BYTES = 1 << 30
_INCOMING = ".incoming"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,62}")
_TIMEOUT_S = 120.0

Make = Callable[[StoredMap | None, str, Mapping[int, Prototype]], MapPipeline]
"""A pipeline that holds a stored map; or an empty one with this id, in which these examples were taught before."""


@dataclass(frozen=True, slots=True)
class SnapshotInfo:
    """A saved map: its name, size, and when it was saved (seconds since 1970)."""

    name: str
    size_bytes: int
    saved_s: float


class Maps:
    """Saves the running map and puts others in its place. Any thread but the map's and the keeper's may call."""

    def __init__(self, directory: Path, loop: MapLoop, keeper: Keeper, make: Make) -> None:
        """directory: the robot's state directory."""
        self._folder, self._incoming = directory / SNAPSHOTS, directory / _INCOMING
        self._loop, self._keeper, self._make = loop, keeper, make
        shutil.rmtree(self._incoming, ignore_errors=True)  # left by a process that was killed

    # ------------------------------------------------------------------------------------------------ snapshots
    def save(self, name: str) -> SnapshotInfo:
        """The map as it is on disk now, under a name; a snapshot of that name is replaced."""
        path = self._path(name)
        self._keeper.ask(lambda store: store.save_as(path), _TIMEOUT_S)
        return _info(path)

    def list(self) -> list[SnapshotInfo]:
        """All snapshots by name."""
        return [_info(path) for path in sorted(self._folder.glob(f"*{SUFFIX}")) if _NAME.fullmatch(path.stem)]

    def delete(self, name: str) -> None:
        """Removes a snapshot. EditError when there is none."""
        self._existing(name).unlink()

    def restore(self, name: str) -> int:
        """A snapshot takes the place of the map, which is kept as snapshot ``previous``; the new revision.

        EditError when there is none, StoreError when it can't be read.
        """
        return self._take_over(self._existing(name), f"restored from snapshot {name}")

    # ------------------------------------------------------------------------------------------------ one file
    def export(self) -> bytes:
        """The whole map as the content of one file."""
        with self._workshop() as folder:
            path = folder / "export.sqlite"
            self._keeper.ask(lambda store: store.save_as(path), _TIMEOUT_S)
            return EXPORT_HEADER + zlib.compress(path.read_bytes(), 1)

    def take_in(self, content: bytes) -> int:
        """An exported map takes the place of the present one (kept as ``previous``); the new revision. StoreError for other bytes."""
        if not content.startswith(EXPORT_HEADER):
            raise StoreError("this is no map that irsctl export wrote")
        reader = zlib.decompressobj()
        try:
            database = reader.decompress(content[len(EXPORT_HEADER) :], MAX_MAP_BYTES)
        except zlib.error as error:
            raise StoreError(f"the map file is damaged: {error}") from error
        if not reader.eof:
            raise StoreError(f"the map file is cut off, or holds more than {MAX_MAP_BYTES >> 20} MB")
        with self._workshop() as folder:
            path = folder / "import.sqlite"
            path.write_bytes(database)
            return self._take_over(path, "imported")

    # ------------------------------------------------------------------------------------------------ another map
    def start_new(self) -> int:
        """An empty map from now on, the present one kept as snapshot ``previous``; names that were taught remain as examples."""
        self.save(PREVIOUS)
        now = self._loop.call(lambda pipeline: pipeline.whole(), _TIMEOUT_S)
        pipeline = self._make(None, uuid.uuid4().hex[:12], known_prototypes(now.edits, now.taught))
        return self._loop.replace(pipeline, "a new map", Replacement(None), {}, _TIMEOUT_S)

    def _take_over(self, source: Path, why: str) -> int:
        with self._workshop() as folder:
            path = folder / FILE_NAME
            try:
                shutil.copyfile(source, path)
            except OSError as error:
                raise StoreError(f"{source}: {error}") from error
            store = Store(folder)  # brings it to this layout, and finds damage before anything is replaced
            try:
                stored = store.load()
            finally:
                store.close()
            if stored is None:
                raise StoreError("that file holds an empty map")
            pipeline = self._make(stored, stored.snapshot.map_id, stored.taught)
            self.save(PREVIOUS)
            return self._loop.replace(pipeline, why, Replacement(path), stored.geometry, _TIMEOUT_S)

    @contextmanager
    def _workshop(self) -> Iterator[Path]:
        """A folder for one job, in the state directory: on the same disk, with its rights, gone afterwards."""
        try:
            self._incoming.mkdir(parents=True, exist_ok=True)
            folder = Path(tempfile.mkdtemp(dir=self._incoming))
        except OSError as error:
            raise StoreError(f"{self._incoming}: {error}: check the directory, its owner and the free space") from error
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _existing(self, name: str) -> Path:
        path = self._path(name)
        if not path.is_file():
            raise EditError(f"there is no snapshot {name}: irsctl snapshot list")
        return path

    def _path(self, name: str) -> Path:
        """Where a snapshot lies. EditError for a name that is no plain word."""
        if not _NAME.fullmatch(name):
            raise EditError(
                "a snapshot's name is letters, digits, '_' and '-', at most 63, the first a letter or digit"
            )
        return self._folder / f"{name}{SUFFIX}"


def _info(path: Path) -> SnapshotInfo:
    try:
        found = path.stat()
    except OSError as error:
        raise StoreError(f"{path}: {error}") from error
    return SnapshotInfo(path.stem, found.st_size, found.st_mtime)
