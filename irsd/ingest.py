"""Sensor messages from zenoh to decoded values: subscriptions in both wire forms, bounded rings, counters per topic.

zenoh's threads append to the rings; ``poll`` runs on the map thread, decodes what waits and returns it in an order that lets the
synchroniser use it at once (mountings and cameras, poses, sweeps, pictures). Wrong bytes are counted, named and dropped.
"""

from __future__ import annotations

import logging
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from irsd.core.errors import ConfigError, DecodeError
from irsd.core.runtime import Event, Rate, Ring, monotonic_ns
from irsd.core.settings import setting
from irsd.core.types import LidarScan, Sensed
from irsd.io import cdr
from irsd.io.keys import check_ros_topic, ros_endpoint_token, ros_node_token, subscriptions
from irsd.io.session import Handle, Sample, Session
from irsd.perception.detections import DetectionPairer
from irsd.sensors.decode import KINDS, decode, decode_detection_ids
from irsd.sensors.watch import SensorWatch

_log = logging.getLogger(__name__)

_ARRIVALS_KEPT = 64
# What one poll takes of the sensors that cost much to decode and to map: the rest stays in the ring, where it can still be dropped.
_AT_A_TIME: Mapping[str, int] = MappingProxyType(
    {"lidar": 1, "image": 1, "image_compressed": 1, "detections_ids": 2, "detections_info": 2}
)
_WATCH_PERIOD_NS = 250_000_000
_NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True)
class IngestSettings:
    """Which ROS topics hold the sensors, and how many messages may wait while the map thread is busy."""

    lidar_topic: str = setting("/lidar/points", "sensor_msgs/PointCloud2")
    odometry_topic: str = setting("/odom", "nav_msgs/Odometry")
    tf_static_topic: str = setting("/tf_static", "tf2_msgs/TFMessage with the mountings of the sensors")
    camera_info_topic: str = setting("/camera/camera_info", "sensor_msgs/CameraInfo")
    image_topic: str = setting("/camera/image/compressed", "sensor_msgs/CompressedImage, or Image with image_raw")
    image_raw: bool = setting(False, "image_topic carries sensor_msgs/Image")
    images: bool = setting(False, "receive pictures; irsd does so by itself when it has eyes of its own")
    detections_ids_topic: str = setting("/detections/ids", "numbered masks as 16-bit PNG, from any perception process")
    detections_info_topic: str = setting("/detections/info", "what the numbers are, as JSON")
    form: str = setting(
        "auto", "how ROS topics arrive: zenoh-bridge-ros2dds, rmw_zenoh, or either", choices=("auto", "bridge", "rmw")
    )
    namespace: str = setting("", "namespace of zenoh-bridge-ros2dds, if it has one")
    domain: int | None = setting(None, "ROS domain to listen to with rmw_zenoh; null = any", lo=0, hi=232)
    announce: bool = setting(True, "show up in ROS as node 'irsd' with its subscriptions (rmw_zenoh)")
    lidar_queue: int = setting(32, "sweeps that may wait; the oldest is dropped and counted", lo=1, hi=1000)
    image_queue: int = setting(2, "pictures that may wait", lo=1, hi=100)
    odometry_queue: int = setting(1000, "poses that may wait", lo=1, hi=10000)
    detections_queue: int = setting(32, "detections that may wait", lo=1, hi=1000)
    max_age_s: float = setting(
        2.0, "sweeps, pictures and detections that waited longer are dropped where newer ones wait", lo=0.1, hi=60.0
    )
    latched_queue: int = setting(32, "mountings and CameraInfo that may wait", lo=1, hi=1000)


@dataclass(frozen=True, slots=True)
class Topic:
    """One configured input. kind: of ``sensors.decode.KINDS``, or detections_ids / detections_info."""

    name: str
    kind: str
    type_name: str | None
    queue: int


def topics_of(settings: IngestSettings) -> tuple[Topic, ...]:
    """The inputs in the order in which they are decoded. Raises ConfigError for a name that is no topic or occurs twice."""
    s = settings
    picture = "image" if s.image_raw else "image_compressed"
    rows: list[tuple[str, str, int]] = [
        (s.tf_static_topic, "tf_static", s.latched_queue),
        (s.camera_info_topic, "camera_info", s.latched_queue),
        (s.odometry_topic, "odometry", s.odometry_queue),
        (s.lidar_topic, "lidar", s.lidar_queue),
        (s.detections_ids_topic, "detections_ids", s.detections_queue),
        (s.detections_info_topic, "detections_info", s.detections_queue),
    ]
    if s.images:
        rows.append((s.image_topic, picture, s.image_queue))
    topics = tuple(
        Topic(check_ros_topic(name), kind, KINDS[kind].type_name if kind in KINDS else None, queue)
        for name, kind, queue in rows
    )
    names = [topic.name for topic in topics]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ConfigError(f"ingest: {', '.join(twice)} is given for more than one input")
    return topics


@dataclass(slots=True)
class TopicCount:
    """What became of one topic's messages; only the decoding thread writes it."""

    received: int = 0
    decoded: int = 0
    bad: int = 0
    bad_run: int = 0
    last_error: str = ""


class SensorDecoder:
    """Messages of the configured topics to sensed values; pairs the halves of detections. Used live and by the replay."""

    def __init__(self, settings: IngestSettings) -> None:
        self.topics = topics_of(settings)
        self.counts: Mapping[str, TopicCount] = {topic.name: TopicCount() for topic in self.topics}
        self._kinds = {topic.name: topic.kind for topic in self.topics}
        self._pairer = DetectionPairer()

    def decode(self, topic: str, payload: bytes) -> tuple[Sensed, ...]:
        """The values in one message; none for wrong bytes (counted), half a detection, or a topic that is not configured."""
        kind = self._kinds.get(topic)
        if kind is None:
            return ()
        count = self.counts[topic]
        count.received += 1
        try:
            sensed = self._decode(kind, payload)
        except DecodeError as error:
            count.bad += 1
            count.bad_run += 1
            count.last_error = str(error)
            if count.bad & (count.bad - 1) == 0:  # the 1st, 2nd, 4th, 8th...: a broken driver must not fill the log
                _log.error("%s: message %d can't be used (%d so far): %s", topic, count.received, count.bad, error)
            return ()
        count.decoded += 1
        count.bad_run = 0
        return sensed

    def counters(self) -> dict[str, int]:
        """Messages that could not be used, as ``/topic.bad``, and halves of detections that stayed alone."""
        bad = {f"{name}.bad": count.bad for name, count in self.counts.items()}
        return {**bad, "detections_unpaired": self._pairer.unpaired}

    def _decode(self, kind: str, payload: bytes) -> tuple[Sensed, ...]:
        if kind == "detections_ids":
            paired = self._pairer.push_ids(decode_detection_ids(payload))
        elif kind == "detections_info":
            paired = self._pairer.push_info(payload)
        else:
            return decode(kind, payload)
        return () if paired is None else (paired,)


class _Input(Ring[Sample]):
    """A topic's ring, which notes when messages arrive: a busy map thread must not make a sensor look silent."""

    def __init__(self, topic: Topic, wake: Event) -> None:
        super().__init__(topic.queue, wake)
        self.topic = topic
        self.rate = Rate()
        self.stale = 0  # written by the thread that polls

    def put(self, item: Sample) -> None:
        self.rate.tick(item.received_ns / _NS_PER_S)
        super().put(item)


class Ingest:
    """The subscriptions of a running irsd. ``poll`` and ``arrived_ns`` belong to one thread; ``sensors`` may be asked by any."""

    def __init__(
        self,
        session: Session,
        settings: IngestSettings,
        wake: Event,
        watch: SensorWatch,
        record: Callable[[Topic, bytes], None] | None = None,
    ) -> None:
        """watch: is shown every message that could be decoded. record: every message, before that is tried."""
        self._watch, self._record = watch, record
        self._watched_ns = 0
        self._max_age_ns = round(settings.max_age_s * _NS_PER_S)
        self._decoder = SensorDecoder(settings)
        self._inputs = tuple(_Input(topic, wake) for topic in self._decoder.topics)
        self._arrivals: OrderedDict[int, int] = OrderedDict()
        self._handles: list[Handle] = []
        for entry in self._inputs:
            self._subscribe(session, settings, entry)
        if settings.announce and settings.form != "bridge":
            self._announce(session, settings)

    def poll(self) -> list[Sensed]:
        """What waits, decoded: all poses and mountings, of what costs much a few at a time, and not what is too old."""
        out: list[Sensed] = []
        oldest_ns = monotonic_ns() - self._max_age_ns
        for entry in self._inputs:
            most = _AT_A_TIME.get(entry.topic.kind)
            if most is not None:
                entry.stale += entry.drop_while(lambda sample: sample.received_ns < oldest_ns)
            for sample in entry.drain(most):
                if sample.deleted:
                    continue
                if self._record is not None:
                    self._record(entry.topic, sample.payload)
                values = self._decoder.decode(entry.topic.name, sample.payload)
                if values:
                    self._watch.hear(entry.topic.name, entry.topic.kind, sample.payload, sample.received_ns, values)
                for sensed in values:
                    if isinstance(sensed, LidarScan):
                        self._remember(sensed.stamp_ns, sample.received_ns)
                    out.append(sensed)
        now_ns = monotonic_ns()
        if now_ns - self._watched_ns > _WATCH_PERIOD_NS:
            self._watched_ns = now_ns
            self._watch.refresh(now_ns)
        return out

    @property
    def more_waits(self) -> bool:
        """Whether a poll would find something."""
        return any(len(entry) for entry in self._inputs)

    def waiting(self) -> dict[str, int]:
        """Messages that wait to be decoded, by topic."""
        return {entry.topic.name: len(entry) for entry in self._inputs}

    def arrived_ns(self, stamp_ns: int) -> int | None:
        """When (monotonic) the sweep came in that ended at ``stamp_ns``; None when that is long ago.

        It is the newest that began by then: frames carry the end of their sweep, messages mostly its start.
        """
        begun = [stamp for stamp in self._arrivals if stamp <= stamp_ns]
        return self._arrivals[max(begun)] if begun else None

    def sensors(self, now_s: float) -> dict[str, dict[str, Any]]:
        """Per topic: kind, rate_hz, period_s, received, decoded, bad, bad_run, dropped, last_error, age_s (None: never heard)."""
        return {entry.topic.name: self._state(entry, now_s) for entry in self._inputs}

    def counters(self) -> dict[str, int]:
        """What was lost before the synchroniser: wrong bytes, overflowing rings, what waited too long, lone halves."""
        dropped = {f"{entry.topic.name}.dropped": entry.dropped + entry.stale for entry in self._inputs}
        return {**self._decoder.counters(), **dropped}

    def close(self) -> None:
        """Ends the subscriptions; what waits can still be polled."""
        for handle in self._handles:
            handle.close()

    def _subscribe(self, session: Session, settings: IngestSettings, entry: _Input) -> None:
        topic = entry.topic
        own = topic.type_name is None  # detections come from a process of ours, not through a bridge's namespace
        namespace = "" if own else settings.namespace
        expressions = subscriptions(topic.name, topic.type_name, namespace=namespace, domain=settings.domain)
        if not own and settings.form != "auto":
            expressions = (expressions[0],) if settings.form == "bridge" else (expressions[1],)
        for expression in expressions:
            # TRANSIENT_LOCAL topics are kept by an advanced publisher and asked for by its subscriber
            declare = session.subscribe_history if topic.kind == "tf_static" else session.subscribe
            self._handles.append(declare(expression, entry))

    def _announce(self, session: Session, settings: IngestSettings) -> None:
        domain = settings.domain or 0
        tokens = [ros_node_token(session.zid, "irsd", domain)]
        for number, entry in enumerate(self._inputs, start=1):
            topic = entry.topic
            if topic.type_name is None:
                continue
            tokens.append(
                ros_endpoint_token(
                    session.zid,
                    "irsd",
                    number,
                    topic.name,
                    topic.type_name,
                    cdr.type_hash(topic.type_name),
                    publishes=False,
                    latched=topic.kind == "tf_static",
                    domain=domain,
                )
            )
        self._handles += [session.announce(token) for token in tokens]

    def _remember(self, stamp_ns: int, received_ns: int) -> None:
        self._arrivals[stamp_ns] = received_ns
        if len(self._arrivals) > _ARRIVALS_KEPT:
            self._arrivals.popitem(last=False)

    def _state(self, entry: _Input, now_s: float) -> dict[str, Any]:
        count = self._decoder.counts[entry.topic.name]
        age_s = entry.rate.age_s(now_s)
        return {
            "kind": entry.topic.kind,
            "rate_hz": round(entry.rate.hz(now_s), 2),
            "period_s": round(entry.rate.period_s, 3),
            "received": entry.received,
            "decoded": count.decoded,
            "bad": count.bad,
            "bad_run": count.bad_run,
            "dropped": entry.dropped + entry.stale,
            "last_error": count.last_error,
            "age_s": None if age_s is None else round(age_s, 2),
        }
