"""Sensor messages over real zenoh, as both bridges put them: decoded, counted, and wrong ones dropped by name."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from irsd.core.errors import ConfigError
from irsd.core.runtime import Event, monotonic_s, sleep_s
from irsd.core.types import LidarScan, OdomSample, Sensed, StaticTransform
from irsd.ingest import Ingest, IngestSettings, SensorDecoder, topics_of
from irsd.io import cdr
from irsd.io.keys import rmw_key, ros_attachment
from irsd.io.session import CDR, Session, ZenohSettings, open_session
from irsd.sensors.encode import encode_odometry, encode_pointcloud2, encode_tf
from irsd.sensors.watch import SensorWatch, WatchSettings

WAIT_S = 20.0
SCAN = LidarScan(7_000_000_000, "lidar", np.arange(30, dtype=np.float32).reshape(10, 3) + 1, None)
POSE = OdomSample(5, "odom", "base_link", np.zeros(3), np.array([0, 0, 0, 1.0]))
MOUNT = StaticTransform("base_link", "lidar", np.eye(4))


@pytest.fixture
def pair() -> Iterator[tuple[Session, Session]]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        settings = ZenohSettings(endpoint=f"tcp/127.0.0.1:{probe.getsockname()[1]}", connect=())
    with open_session(settings, "hub") as daemon, open_session(settings, "peer") as robot:
        assert until(lambda: bool(daemon.neighbours() and robot.neighbours()))
        yield daemon, robot


def until(condition: Callable[[], bool]) -> bool:
    deadline_s = monotonic_s() + WAIT_S
    while not condition():
        if monotonic_s() > deadline_s:
            return False
        sleep_s(0.01)
    return True


def received(ingest: Ingest, topic: str) -> int:
    return int(ingest.sensors(monotonic_s())[topic]["received"])


def test_nothing_heard_is_a_state(pair: tuple[Session, Session]) -> None:
    ingest = Ingest(pair[0], IngestSettings(), Event(), SensorWatch(WatchSettings()))
    assert ingest.poll() == []
    assert ingest.arrived_ns(1) is None
    assert set(ingest.counters().values()) == {0}
    for sensor in ingest.sensors(monotonic_s()).values():
        assert (sensor["received"], sensor["age_s"], sensor["rate_hz"]) == (0, None, 0.0)


@pytest.mark.parametrize("form", ["bridge", "rmw"])
def test_both_forms_are_heard(pair: tuple[Session, Session], form: str) -> None:
    daemon, robot = pair
    wake = Event()
    ingest = Ingest(daemon, IngestSettings(namespace="bot1"), wake, SensorWatch(WatchSettings()))

    def key(topic: str, type_name: str) -> str:
        return f"bot1{topic}" if form == "bridge" else rmw_key(topic, type_name, cdr.type_hash(type_name), 3)

    attachment = ros_attachment(1, 2, bytes(16)) if form == "rmw" else None
    for topic, type_name, payload in (
        ("/lidar/points", cdr.POINT_CLOUD, encode_pointcloud2(SCAN)),
        ("/odom", cdr.ODOMETRY, encode_odometry(POSE)),
        ("/tf_static", cdr.TF_MESSAGE, encode_tf([MOUNT])),
    ):

        def arrives(topic: str = topic, type_name: str = type_name, payload: bytes = payload) -> bool:
            robot.put(key(topic, type_name), payload, encoding=CDR, attachment=attachment)
            return received(ingest, topic) > 0

        assert until(arrives)
    assert wake.is_set()
    sensed: list[Sensed] = ingest.poll()
    kinds = [type(one) for one in sensed]
    assert kinds.index(StaticTransform) < kinds.index(OdomSample) < kinds.index(LidarScan)
    scan = next(one for one in sensed if isinstance(one, LidarScan))
    np.testing.assert_array_equal(scan.points_sensor, SCAN.points_sensor)
    assert ingest.arrived_ns(SCAN.stamp_ns) == ingest.arrived_ns(SCAN.stamp_ns + 100) is not None
    assert ingest.arrived_ns(SCAN.stamp_ns - 1) is None


def test_latched_mountings_reach_a_daemon_that_starts_late(pair: tuple[Session, Session]) -> None:
    daemon, robot = pair
    latched = robot.history_publisher("tf_static", encoding=CDR, keep=1)
    latched.put(encode_tf([MOUNT]))
    ingest = Ingest(daemon, IngestSettings(), Event(), SensorWatch(WatchSettings()))
    assert until(lambda: received(ingest, "/tf_static") == 1)
    (mount,) = ingest.poll()
    assert isinstance(mount, StaticTransform)
    assert (mount.parent, mount.child) == ("base_link", "lidar")


def test_wrong_bytes_are_counted_named_and_dropped(pair: tuple[Session, Session]) -> None:
    daemon, robot = pair
    ingest = Ingest(daemon, IngestSettings(lidar_queue=2), Event(), SensorWatch(WatchSettings()))

    def three_arrive() -> bool:
        robot.put("lidar/points", b"no cloud", encoding=CDR)
        return received(ingest, "/lidar/points") >= 3

    assert until(three_arrive)
    robot.put("tf_static", encode_tf([MOUNT]), encoding=CDR)  # comes after all that is still on its way
    assert until(lambda: received(ingest, "/tf_static") == 1)
    assert [[type(one) for one in ingest.poll()] for _ in range(2)] == [[StaticTransform], []]
    state = ingest.sensors(monotonic_s())["/lidar/points"]
    assert (state["bad"], state["decoded"]) == (2, 0)
    assert state["dropped"] == state["received"] - 2
    assert "PointCloud2" in state["last_error"]
    assert ingest.counters()["/lidar/points.bad"] == 2


def test_behind_its_sensors_it_takes_a_sweep_at_a_time_and_drops_what_is_too_old(pair: tuple[Session, Session]) -> None:
    ours, theirs = pair
    ingest = Ingest(ours, IngestSettings(max_age_s=0.3), Event(), SensorWatch(WatchSettings()))
    for number in range(4):
        theirs.put("lidar/points", encode_pointcloud2(replace(SCAN, stamp_ns=number)), encoding=CDR)
        theirs.put("odom", encode_odometry(replace(POSE, stamp_ns=number)), encoding=CDR)
    end_s = monotonic_s() + WAIT_S
    while sum(ingest.waiting().values()) < 8:
        assert monotonic_s() < end_s
        sleep_s(0.01)
    sleep_s(0.4)
    for number in (4, 5):
        theirs.put("lidar/points", encode_pointcloud2(replace(SCAN, stamp_ns=number)), encoding=CDR)
    while ingest.waiting()["/lidar/points"] < 6:
        assert monotonic_s() < end_s
        sleep_s(0.01)
    polls = [ingest.poll() for _ in range(3)]
    assert [[each.stamp_ns for each in poll if isinstance(each, LidarScan)] for poll in polls] == [[4], [5], []]
    assert sum(isinstance(each, OdomSample) for each in polls[0]) == 4  # a pose costs nothing and is never too old
    assert ingest.counters()["/lidar/points.dropped"] == 4
    assert not ingest.more_waits
    ingest.close()


def test_ros_sees_our_subscriptions(pair: tuple[Session, Session]) -> None:
    daemon, robot = pair
    ingest = Ingest(daemon, IngestSettings(), Event(), SensorWatch(WatchSettings()))
    tokens = "@ros2_lv/0/*/*/*/MS/**"
    assert until(lambda: len(robot.find_alive(tokens)) == 4)
    assert any("%lidar%points" in token and token.endswith("2::,5:,:,:,,") for token in robot.find_alive(tokens))
    ingest.close()
    assert until(lambda: not robot.find_alive(tokens))


def test_decoder_ignores_topics_that_are_not_its_own() -> None:
    decoder = SensorDecoder(IngestSettings())
    assert decoder.decode("/gt/poses", b"anything") == ()
    assert set(decoder.counters().values()) == {0}


def test_one_topic_for_two_inputs_is_refused() -> None:
    with pytest.raises(ConfigError, match="/odom"):
        topics_of(IngestSettings(lidar_topic="/odom"))
    assert "/camera/image/compressed" not in [topic.name for topic in topics_of(IngestSettings())]
    assert topics_of(IngestSettings(images=True, image_raw=True))[-1].kind == "image"
