"""From a bundle back to the graph: the recorded messages and decisions, through a fresh pipeline from the same stored map."""

from __future__ import annotations

import json
import logging
import shutil
import tempfile
import zipfile
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from irsd.bundles import SCHEMA, graph_hash
from irsd.config import IrsdConfig, load_config
from irsd.core.errors import DecodeError, EditError, IrsdError
from irsd.core.types import Sensed, SyncedFrame
from irsd.graph.edits import Request
from irsd.graph.store import FILE_NAME, Store, StoredMap
from irsd.ingest import SensorDecoder
from irsd.opening import open_names
from irsd.perception.encoder import LabelEncoder
from irsd.pipeline import MapPipeline
from irsd.record import EVENTS, START
from irsd.sensors.replay import RawMessage, read_messages
from irsd.sensors.sync import Synchronizer
from irsd.stored import resumption_of

_log = logging.getLogger(__name__)

_MAX_BYTES = 1 << 32  # of a bundle's content


@dataclass(frozen=True, slots=True)
class Bundle:
    """An opened bundle. meta: see ``bundles``; recording: its files; start: a directory with the store of the beginning, or None."""

    meta: dict[str, Any]
    config: IrsdConfig
    recording: tuple[Path, ...]
    start: Path | None


@contextmanager
def opened(path: Path) -> Iterator[Bundle]:
    """A bundle, unpacked for as long as the block lasts. DecodeError when the file is no bundle."""
    with tempfile.TemporaryDirectory(prefix="irsd-bundle-") as scratch:
        folder = Path(scratch)
        try:
            with zipfile.ZipFile(path) as archive:
                if sum(info.file_size for info in archive.infolist()) > _MAX_BYTES:
                    raise DecodeError(f"{path}: holds more than {_MAX_BYTES >> 30} GB")
                for info in archive.infolist():
                    # By its last part alone: a bundle from elsewhere must not choose where its files go.
                    target = folder / Path(info.filename).name
                    with archive.open(info) as source, target.open("wb") as sink:
                        shutil.copyfileobj(source, sink)
            meta = json.loads((folder / "meta.json").read_text())
            if not isinstance(meta, dict) or meta.get("schema") != SCHEMA:
                raise DecodeError(f"{path}: not a bundle of this version ({SCHEMA})")
        except (OSError, zipfile.BadZipFile, ValueError, KeyError) as error:
            raise DecodeError(f"{path}: not a bundle: {error}") from error
        start = None
        if (folder / START).is_file():
            start = folder / "start"
            start.mkdir()
            (folder / START).rename(start / FILE_NAME)
        yield Bundle(meta, load_config(folder / "config.yaml"), tuple(sorted(folder.glob("*.mcap"))), start)


class Reproduction:
    """A pipeline that is given what the map thread of a running irsd was given."""

    def __init__(self, bundle: Bundle, labels: LabelEncoder) -> None:
        stored: StoredMap | None = None
        taught = {}
        if bundle.start is not None:
            store = Store(bundle.start)
            stored, taught = store.load(), store.prototypes()
            store.close()
        settings = bundle.config
        namer = open_names(settings, labels, [])
        self.pipeline = MapPipeline(settings.pipeline, labels, map_id=str(bundle.meta.get("map_id")), namer=namer)
        if stored is not None:
            self.pipeline.restore(stored)
        else:
            self.pipeline.learn(taught)
        self._resumption = resumption_of(settings, stored)
        self._decoder, self._sync = SensorDecoder(settings.ingest), Synchronizer(settings.sync)
        self._sensed: list[Sensed] = []
        self._waiting: deque[SyncedFrame] = deque()
        self._stamp_ns = 0
        self.frames = self.failed = 0

    def run(self, bundle: Bundle) -> str:
        """Everything that was recorded; the hash of the graph at its end."""
        for message in read_messages(bundle.recording):
            self.feed(message)
        return graph_hash(self.pipeline.snapshot())

    def feed(self, message: RawMessage) -> None:
        """One recorded message or event."""
        if message.topic == EVENTS:
            self._do(dict(json.loads(message.data)))
        else:
            self._sensed += self._decoder.decode(message.topic, message.data)

    def _do(self, event: dict[str, Any]) -> None:
        what = event.get("do")
        try:
            if what == "pop":
                self._pop()
            elif what == "step":
                self._step()
            elif what == "finish":
                self.pipeline.finish(self._stamp_ns)
            elif what == "edit":
                others = tuple(event["others"])
                self.pipeline.edit(Request(event["kind"], event["target"], event["name"], others))
            elif what == "undo":
                self.pipeline.undo()
            elif what == "accept":
                self._resumption.accept()
            elif what == "relocalise":
                at = event["at"]
                self._resumption.seek(self.pipeline, None if at is None else tuple(at))
        except EditError as error:
            raise DecodeError(f"an edit of the recording can't be done again: {error}") from error

    def _pop(self) -> None:
        sensed, self._sensed = self._sensed, []
        for one in sensed:
            self._sync.push(one)
        self._waiting.extend(self._sync.pop() if sensed else [])

    def _step(self) -> None:
        """The next frame: edits and questions came between the frames of one pop, too."""
        if self._waiting:
            frame = self._waiting.popleft()
            admitted, start = self._resumption.admit(frame, self.pipeline), self._resumption.take_start()
            if start is not None:
                self.pipeline.begin_at(start)
            for ready in admitted:
                self.frames += 1
                self._stamp_ns = ready.stamp_ns
                try:
                    self.pipeline.step(ready)
                except Exception as error:  # as the map thread does: a stage's failure costs its frame, not the map
                    if isinstance(error, IrsdError):
                        _log.debug("frame %d failed again: %s", ready.seq, error)
                    self.failed += 1
