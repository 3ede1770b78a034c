"""Recordings in and out: MCAP files with ROS 2 messages as CDR, and JSON topics. The only module that imports mcap.

Several files are read as one, merged by log time. A file without its summary (the recorder was killed) is read through from
the start; a file that is cut or foreign ends in a DecodeError that says how far it was good.
"""

from __future__ import annotations

import heapq
import json
import logging
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import zstandard
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer

from irsd.core.errors import DecodeError, StoreError
from irsd.io import cdr as ros

_log = logging.getLogger(__name__)

JSON_TYPE = "json"
_WINDOW_NS = 2_000_000_000  # how far out of order the messages of a file without index may stand
_MAX_CHUNK_BYTES = 2**30
_BROKEN = (McapError, struct.error, zstandard.ZstdError, ValueError, KeyError, EOFError, OSError)
_LATCHED = (  # rosbag2's words for a topic that late subscribers still get
    "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n  deadline:\n    sec: 9223372036\n    nsec: 854775807\n"
    "  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n  liveliness: 1\n  liveliness_lease_duration:\n"
    "    sec: 9223372036\n    nsec: 854775807\n  avoid_ros_namespace_conventions: false"
)


@dataclass(frozen=True, slots=True)
class RawMessage:
    """One recorded message. type_name: ``pkg/msg/Type``, or the schema's name for JSON topics; encoding: ``cdr`` or ``json``."""

    topic: str
    type_name: str
    data: bytes
    log_time_ns: int
    encoding: str = "cdr"


# ---------------------------------------------------------------------------------------------------------- reading
def read_messages(
    paths: Sequence[Path | str] | Path | str, topics: Iterable[str] | None = None, *, allow_cut: bool = False
) -> Iterator[RawMessage]:
    """All messages of one or several MCAP files, oldest log time first; at equal times, the earlier file of ``paths`` first.

    topics: only these, None = all. allow_cut: a file that is cut off or damaged ends with a warning after its last good
    message; else with a DecodeError (raised there too, so everything before it was delivered). A foreign file is always an error.
    """
    files = [Path(p) for p in ([paths] if isinstance(paths, (str, Path)) else paths)]
    wanted = None if topics is None else frozenset(topics)
    streams = [_file_messages(path, wanted, allow_cut) for path in files]
    yield from heapq.merge(*streams, key=lambda message: message.log_time_ns)


def topics_of(path: Path | str) -> dict[str, str]:
    """topic -> type name of one file, sorted by topic; reads all of it where it has no summary. DecodeError for a foreign file."""
    path = Path(path)
    with _open(path) as stream:
        summary = _summary_of(stream, path)
        if summary is not None:
            found = {c.topic: _type_of(summary.schemas.get(c.schema_id)) for c in summary.channels.values()}
            return dict(sorted(found.items()))
    return dict(sorted({m.topic: m.type_name for m in read_messages(path, allow_cut=True)}.items()))


def _file_messages(path: Path, topics: frozenset[str] | None, allow_cut: bool) -> Iterator[RawMessage]:
    with _open(path) as stream:
        indexed = _summary_of(stream, path) is not None
        source = _by_index(stream, path, topics) if indexed else _in_window(_read_through(stream, path, topics))
        count = 0
        try:
            for message in source:
                yield message
                count += 1
        except _BROKEN as error:
            what = f"{path}: cut off or damaged after {count} messages: {str(error) or type(error).__name__}"
            if not allow_cut:
                raise DecodeError(what) from error
            _log.warning("%s", what)


def _open(path: Path) -> IO[bytes]:
    """The file, positioned at its start. Raises DecodeError when it is absent or no MCAP file."""
    try:
        stream = path.open("rb")
    except OSError as error:
        raise DecodeError(f"{path}: {error.strerror or error}") from error
    if stream.read(8) != b"\x89MCAP0\r\n":
        stream.close()
        raise DecodeError(f"{path}: not an MCAP recording")
    stream.seek(0)
    return stream


def _summary_of(stream: IO[bytes], path: Path) -> Any:
    """The summary with its chunk index, or None where the file has none that can be read."""
    try:
        summary = SeekingReader(stream, record_size_limit=path.stat().st_size).get_summary()
    except _BROKEN as error:
        _log.info("%s: no usable summary (%s), reading it through", path, error)
        summary = None
    finally:
        stream.seek(0)
    return summary if summary is not None and summary.chunk_indexes else None


def _by_index(stream: IO[bytes], path: Path, topics: frozenset[str] | None) -> Iterator[RawMessage]:
    """In order of log time, by the file's index; holds only the chunks that overlap in time."""
    reader = SeekingReader(stream, validate_crcs=True, record_size_limit=path.stat().st_size)
    for schema, channel, message in reader.iter_messages(topics=topics, log_time_order=True):
        yield _raw(schema, channel, message)


def _read_through(stream: IO[bytes], path: Path, topics: frozenset[str] | None) -> Iterator[RawMessage]:
    """In the order of the file, which needs no summary. Ends with the error that ends the file."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    limit = path.stat().st_size
    for outer in StreamReader(stream, emit_chunks=True, record_size_limit=limit).records:
        if isinstance(outer, Chunk) and outer.uncompressed_size > _MAX_CHUNK_BYTES:
            raise ValueError(f"a chunk claims {outer.uncompressed_size} bytes")
        for record in breakup_chunk(outer, validate_crc=True) if isinstance(outer, Chunk) else [outer]:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                channel = channels[record.channel_id]
                if topics is None or channel.topic in topics:
                    yield _raw(schemas.get(channel.schema_id), channel, record)


def _in_window(messages: Iterator[RawMessage]) -> Iterator[RawMessage]:
    """Sorted by log time within a window, so that memory stays bounded. An error of the source comes after all messages before it."""
    heap: list[tuple[int, int, RawMessage]] = []
    newest_ns = 0
    broken: Exception | None = None
    try:
        for order, message in enumerate(messages):
            heapq.heappush(heap, (message.log_time_ns, order, message))
            newest_ns = max(newest_ns, message.log_time_ns)
            while heap[0][0] < newest_ns - _WINDOW_NS:
                yield heapq.heappop(heap)[2]
    except _BROKEN as error:
        broken = error
    while heap:
        yield heapq.heappop(heap)[2]
    if broken is not None:
        raise broken


def _raw(schema: Schema | None, channel: Channel, message: Message) -> RawMessage:
    return RawMessage(channel.topic, _type_of(schema), message.data, message.log_time, channel.message_encoding)


def _type_of(schema: Schema | None) -> str:
    return JSON_TYPE if schema is None else schema.name


# ---------------------------------------------------------------------------------------------------------- writing
class RecordingWriter:
    """Writes a recording that rosbag2, Foxglove and ``read_messages`` open: ROS 2 profile, zstd chunks, with summary.

    The same calls give the same bytes. A context manager: without ``close`` the file has no summary. Disk errors are StoreError.
    """

    def __init__(self, path: Path | str) -> None:
        self._path = Path(path)
        self._channels: dict[str, int] = {}
        self._sequence: dict[int, int] = {}
        self._schemas: dict[str, int] = {}
        self._stream = self._guard(lambda: self._path.open("wb"))
        self._writer = Writer(self._stream)
        self._guard(lambda: self._writer.start(profile="ros2", library="irsd"))

    def write(self, topic: str, type_name: str, cdr: bytes, log_time_ns: int, *, latched: bool | None = None) -> None:
        """One ROS message, untouched. latched: late subscribers get it too (default: for topics that end in ``tf_static``)."""
        if topic not in self._channels:
            if type_name not in self._schemas:
                text = ros.message_definition(type_name).encode()
                self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", text)
            keeps = topic.endswith("tf_static") if latched is None else latched
            qos = {"offered_qos_profiles": _LATCHED if keeps else ""}
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[type_name], qos)
        self._add(self._channels[topic], cdr, log_time_ns)

    def write_json(
        self, topic: str, schema_name: str, schema: Mapping[str, Any], document: bytes, log_time_ns: int
    ) -> None:
        """One JSON document with the JSON Schema of its topic (taken at the topic's first message)."""
        if topic not in self._channels:
            if schema_name not in self._schemas:
                text = json.dumps(schema, sort_keys=True).encode()
                self._schemas[schema_name] = self._writer.register_schema(schema_name, "jsonschema", text)
            self._channels[topic] = self._writer.register_channel(topic, "json", self._schemas[schema_name])
        self._add(self._channels[topic], document, log_time_ns)

    def close(self) -> None:
        """Writes the summary and closes the file. Harmless when called twice."""
        if not self._stream.closed:
            try:
                self._guard(self._writer.finish)
            finally:
                self._guard(self._stream.close)

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _add(self, channel: int, data: bytes, log_time_ns: int) -> None:
        sequence = self._sequence.get(channel, 0)
        self._sequence[channel] = (sequence + 1) % 2**32
        self._guard(lambda: self._writer.add_message(channel, log_time_ns, data, log_time_ns, sequence))

    def _guard(self, action: Callable[[], Any]) -> Any:
        try:
            return action()
        except OSError as error:
            raise StoreError(f"{self._path}: can't write the recording: {error}") from error
