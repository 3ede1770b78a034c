"""The last minutes of a running irsd, as it took them in: what a bundle reproduces a graph from.

Written is what the map thread consumed, in its order: the messages after all drops, where it stopped to step (``pop``), where it
settled the map (``finish``), and what operators did. Fed to a fresh pipeline that starts from the same stored map, this gives the same
graph. The recording is a row of MCAP files of bounded total size; when the oldest are dropped, it no longer begins at the start.
"""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from irsd.core.errors import StoreError
from irsd.core.runtime import Mailbox, Ring, Stopper, monotonic_s, wall_clock_ns
from irsd.core.settings import setting
from irsd.ingest import Topic
from irsd.io import cdr
from irsd.sensors.decode import KINDS
from irsd.sensors.replay import RecordingWriter

_log = logging.getLogger(__name__)

NAME = "record"
EVENTS, EVENT_SCHEMA = "irsd/events", "irs/event/1"
INFO_SCHEMA = "irs/detections/info"
START = "start.sqlite"
FOLDER = "recording"
_RING = 512
_SEGMENTS = 16  # files of a full recording: what is dropped at a time is one of them
_ANY_JSON: Mapping[str, Any] = {"type": "object"}


@dataclass(frozen=True)
class RecordSettings:
    """What irsd keeps of its input, so that irsctl bundle can show what went wrong."""

    rolling_mb: int = setting(0, "size of the rolling recording in the state directory; 0 = none", lo=0, hi=100_000)


@dataclass(frozen=True, slots=True)
class Recorded:
    """What there is of a recording. complete: it begins at the start of irsd, nothing was left out, and no other map came between."""

    files: tuple[Path, ...]
    complete: bool
    why_not: str


@dataclass(frozen=True, slots=True)
class _Item:
    """A message (``topic`` set) or an event on its way to the file."""

    topic: Topic | None
    payload: bytes
    mark: Mailbox[Recorded | StoreError] | None = None
    into: Path | None = None


class Recorder:
    """Takes what the map thread consumed; ``run`` is the body of the thread that writes it."""

    def __init__(self, folder: Path, settings: RecordSettings, retention_days: float) -> None:
        """folder: emptied first, a recording is of one life of irsd. retention_days: what is older is deleted."""
        self._folder = folder
        self._segment_bytes = max(settings.rolling_mb * 1_000_000 // _SEGMENTS, 1)
        self._items: Ring[_Item] = Ring(_RING)
        self._writer: RecordingWriter | None = None
        self._size, self._number, self._last_ns = 0, 0, 0
        self._kept_s, self._prune_s = retention_days * 86_400.0, 0.0
        self._why_not = ""
        shutil.rmtree(folder, ignore_errors=True)

    @property
    def start(self) -> Path:
        """Where the map lies with which irsd began, if it had one."""
        return self._folder / START

    # ------------------------------------------------------------------------------------------------ the map thread
    def take(self, topic: Topic, payload: bytes) -> None:
        """One message that is about to be decoded."""
        self._items.put(_Item(topic, payload))

    def event(self, do: str, **more: Any) -> None:
        """What the map thread did with the messages so far."""
        self._items.put(_Item(None, json.dumps({"do": do, **more}).encode()))

    # ------------------------------------------------------------------------------------------------ other threads
    def link_into(self, folder: Path, timeout_s: float) -> Recorded:
        """The recording up to now, as links in a folder that later writing does not change. StoreError when it can't be had."""
        box: Mailbox[Recorded | StoreError] = Mailbox()
        self._items.put(_Item(None, b"", box, folder))
        found = box.get(timeout_s)
        if found is None:
            raise StoreError(f"the recording could not be closed within {timeout_s:g} s")
        if isinstance(found, StoreError):
            raise found
        return found

    def run(self, stopper: Stopper, beat: Callable[[str], None]) -> None:
        """The recording thread: until asked to stop, and all is written."""
        while True:
            beat(NAME)
            self._prune()
            item = self._items.get(0.25)
            if item is None:
                if stopper.requested:
                    break
                continue
            try:
                self._write(item)
            except StoreError as error:
                if not self._why_not:
                    _log.error("%s", error)
                self._why_not = str(error)
                if item.mark is not None:
                    item.mark.put(error)
        self._close()

    # ------------------------------------------------------------------------------------------------ writing
    def _write(self, item: _Item) -> None:
        if self._items.dropped and not self._why_not:
            self._why_not = "the disk was too slow: messages are missing"
        if item.mark is not None and item.into is not None:
            item.mark.put(self._linked(item.into))
            return
        if self._writer is None or self._size >= self._segment_bytes:
            self._next_segment()
        assert self._writer is not None
        # Strictly ascending, so that whoever sorts by time gets this order; the clock may be set meanwhile.
        self._last_ns = max(self._last_ns + 1, wall_clock_ns())
        self._size += len(item.payload)
        topic = item.topic
        if topic is None:
            self._writer.write_json(EVENTS, EVENT_SCHEMA, _ANY_JSON, item.payload, self._last_ns)
            if json.loads(item.payload)["do"] == "replace":
                self._why_not = "another map took the place of the first"
        elif topic.kind == "detections_info":
            self._writer.write_json(topic.name, INFO_SCHEMA, _ANY_JSON, item.payload, self._last_ns)
        else:
            known = KINDS[topic.kind].type_name if topic.kind in KINDS else cdr.COMPRESSED_IMAGE
            self._writer.write(topic.name, topic.type_name or known, item.payload, self._last_ns)

    def _next_segment(self) -> None:
        self._close()
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StoreError(f"{self._folder}: can't write the recording: {error}") from error
        self._number += 1
        self._writer, self._size = RecordingWriter(self._folder / f"{self._number:06d}.mcap"), 0
        for old in self._files()[: -_SEGMENTS - 1]:
            old.unlink(missing_ok=True)
            self._why_not = self._why_not or "it is longer than record.rolling_mb holds: its beginning is gone"

    def _prune(self) -> None:
        """Once a minute. A segment is as old as what was written to it last, so the present one ends here, too."""
        if monotonic_s() < self._prune_s:
            return
        self._prune_s = monotonic_s() + 60.0
        for file in self._files():
            if wall_clock_ns() * 1e-9 - file.stat().st_mtime > self._kept_s:
                self._close()
                file.unlink(missing_ok=True)
                self._why_not = self._why_not or "it is older than privacy.retention_days: its beginning is gone"

    def _close(self) -> None:
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()

    def _linked(self, folder: Path) -> Recorded:
        self._close()
        files = []
        try:
            for file in self._files():
                (folder / file.name).hardlink_to(file)
                files.append(folder / file.name)
        except OSError as error:
            raise StoreError(f"{folder}: {error}") from error
        return Recorded(tuple(files), not self._why_not, self._why_not)

    def _files(self) -> list[Path]:
        return sorted(self._folder.glob("*.mcap"))
