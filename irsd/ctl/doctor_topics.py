"""The part of irsctl doctor that listens: which topics arrive, how often, of which type, and whether their frames hang together."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from irsd.core.errors import DecodeError
from irsd.core.runtime import Guarded, monotonic_s, sleep_s, wall_clock_ns
from irsd.core.types import CameraModel, LidarScan, OdomSample, Sensed, StaticTransform
from irsd.ingest import IngestSettings, Topic, topics_of
from irsd.io.keys import parse_ros_key
from irsd.io.session import Sample, Session
from irsd.perception.detections import parse_info
from irsd.sensors.decode import KINDS, decode, decode_detection_ids
from irsd.sensors.motion import MountTree

Level = Literal["ok", "note", "warning", "error"]
Row = tuple[Level, str, str, str]
"""level, area, text, fix: the fields of a ``doctor.Report``."""

_LEAST_HZ = {"lidar": 1.0, "odometry": 9.0}
_MAX_KEYS = 500
_PAYLOADS = 16


@dataclass(slots=True)
class Heard:
    """One key: messages, bytes, first and last arrival (monotonic s), the newest payloads, and the type where the key names it."""

    topic: str
    type_name: str | None
    count: int = 0
    size: int = 0
    first_s: float = 0.0
    last_s: float = 0.0
    payloads: deque[bytes] = field(default_factory=lambda: deque(maxlen=_PAYLOADS), repr=False)

    @property
    def payload(self) -> bytes:
        return self.payloads[-1]

    @property
    def rate_hz(self) -> float:
        passed_s = self.last_s - self.first_s
        return (self.count - 1) / passed_s if self.count > 1 and passed_s > 0 else 0.0


def listen(session: Session, settings: IngestSettings, seconds: float) -> dict[str, Heard]:
    """Everything that is on the network for a while, by key; no more than ``_MAX_KEYS`` of them."""
    found: Guarded[dict[str, Heard]] = Guarded({})

    def hear(sample: Sample, latched: bool) -> None:
        known = parse_ros_key(sample.key, settings.namespace)
        if sample.deleted or sample.key.startswith("irs/") or latched != (known.topic == settings.tf_static_topic):
            return
        with found.locked() as heard:
            if sample.key not in heard:
                if len(heard) >= _MAX_KEYS:
                    return
                heard[sample.key] = Heard(known.topic, known.type_name, first_s=sample.received_ns * 1e-9)
            one = heard[sample.key]
            one.count, one.size, one.last_s = one.count + 1, one.size + len(sample.payload), sample.received_ns * 1e-9
            one.payloads.append(sample.payload)

    mountings = f"**/{settings.tf_static_topic.strip('/')}/**"
    with (
        session.subscribe("**", lambda sample: hear(sample, False)),
        session.subscribe_history(mountings, lambda sample: hear(sample, True)),
    ):
        end_s = monotonic_s() + seconds
        while monotonic_s() < end_s:
            sleep_s(min(0.1, seconds))
    with found.locked() as heard:
        return dict(heard)


def topic_reports(heard: Mapping[str, Heard], settings: IngestSettings) -> Iterator[Row]:
    """What is said of every topic that irsd wants, of those that it could want, and of the frames between them."""
    wanted = topics_of(dataclasses.replace(settings, images=True))
    values: dict[str, tuple[Sensed, ...]] = {}
    for topic in wanted:
        mine = [one for one in heard.values() if one.topic == topic.name]
        optional = topic.kind not in ("lidar", "odometry", "tf_static")
        if not mine:
            yield _absent(topic, heard, optional)
        for one in mine:
            row, found = _judged(topic, one)
            values[topic.kind] = values.get(topic.kind, ()) + found
            yield row
    names = {topic.name for topic in wanted}
    for one in heard.values():
        if one.topic not in names and (guess := guess_type(one.payload)):
            text = f"{one.topic}: {guess} at {one.rate_hz:.1f} Hz, not used"
            yield "note", "topics", text, ""
    yield from frame_rows(values)


def _absent(topic: Topic, heard: Mapping[str, Heard], optional: bool) -> Row:
    """Nothing came under this name: does something of its type come under another?"""
    others = sorted({one.topic for one in heard.values() if guess_type(one.payload) == topic.type_name})
    level: Level = "note" if optional else "error"
    text = f"{topic.name}: nothing arrives"
    if topic.type_name is not None and others:
        return (
            level,
            "topics",
            text,
            f"{topic.type_name} arrives on {', '.join(others)}: set ingest.{setting_of(topic)}",
        )
    return (
        level,
        "topics",
        text,
        "" if optional else "start the driver, and the bridge or router that carries its topic",
    )


def setting_of(topic: Topic) -> str:
    """The key of the section ingest that names the topic."""
    return "image_topic" if topic.kind.startswith("image") else f"{topic.kind}_topic"


def _judged(topic: Topic, one: Heard) -> tuple[Row, tuple[Sensed, ...]]:
    text = f"{topic.name}: {one.rate_hz:.1f} Hz, {one.size / max(one.count, 1) / 1e3:.1f} kB each"
    try:
        values = tuple(value for payload in one.payloads for value in _decoded(topic.kind, payload))
    except DecodeError as error:
        there = guess_type(one.payload) or one.type_name or "of no type that irsd knows"
        fix = f"it is {there}; {topic.name} must be {topic.type_name or topic.kind}: set ingest.{setting_of(topic)}"
        return ("error", "topics", f"{topic.name} can't be decoded: {error}", fix), ()
    least_hz = _LEAST_HZ.get(topic.kind)
    if least_hz is not None and one.rate_hz < least_hz:
        return ("warning", "topics", text, f"slower than {least_hz:g} Hz: sweeps will wait or be dropped"), values
    stamp_ns = next((v.stamp_ns for v in values if isinstance(v, (LidarScan, OdomSample))), None)
    apart_s = 0.0 if stamp_ns is None else (wall_clock_ns() - stamp_ns) * 1e-9
    if abs(apart_s) > 60.0:
        return ("note", "topics", f"{text}; stamps are {-apart_s:+.0f} s from this computer's clock", ""), values
    return ("ok", "topics", text, ""), values


def _decoded(kind: str, payload: bytes) -> tuple[Sensed, ...]:
    if kind == "detections_ids":
        decode_detection_ids(payload)
    elif kind == "detections_info":
        parse_info(payload)
    else:
        return decode(kind, payload)
    return ()


def guess_type(payload: bytes) -> str | None:
    """The type of a message by its bytes: the first of ours that decodes; None for anything else."""
    for kind in KINDS.values():
        try:
            if kind.decode(payload):
                return kind.type_name
        except DecodeError:
            continue
    return None


def frame_rows(values: Mapping[str, tuple[Sensed, ...]]) -> Iterator[Row]:
    """Whether the robot's base and its sensors hang together by mountings."""
    tree = MountTree()
    for mount in values.get("tf_static", ()):
        if isinstance(mount, StaticTransform):
            tree.push(mount)
    base = next((v.child_frame_id for v in values.get("odometry", ()) if isinstance(v, OdomSample)), None)
    if base is None:
        return
    for kind in ("lidar", "camera_info"):
        frames = {v.frame_id for v in values.get(kind, ()) if isinstance(v, (LidarScan, CameraModel))}
        for frame in sorted(frames):
            if tree.find(base, frame) is None:
                fix = f"publish {base} -> {frame} on tf_static (static_transform_publisher)"
                yield "error", "frames", f"no mounting leads from {base} to {frame or '(empty)'}", fix
            else:
                yield "ok", "frames", f"{base} -> {frame}", ""
