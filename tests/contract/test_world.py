"""irs-world as a process over real zenoh: every topic arrives and decodes, waypoints are followed, a signal ends it."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from irsd.core.runtime import Ring, monotonic_s
from irsd.io.session import Sample, Session, ZenohSettings, open_session
from irsd.sensors.decode import decode_detections, decode_odometry, decode_pointcloud2, decode_tf
from irsd.sensors.replay import read_messages

PATIENCE_S = 40.0
TOPICS = (
    "lidar/points",
    "odom",
    "tf_static",
    "camera/image/compressed",
    "camera/camera_info",
    "detections/ids",
    "detections/info",
)


@pytest.fixture
def endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def hub(endpoint: str) -> Iterator[Session]:
    with open_session(ZenohSettings(endpoint=endpoint, connect=()), "hub") as session:
        yield session


def until(ring: Ring[Sample], what: Any) -> Sample:
    """The first sample for which ``what`` is true."""
    deadline = monotonic_s() + PATIENCE_S
    while monotonic_s() < deadline:
        sample = ring.get(0.5)
        if sample is not None and what(sample):
            return sample
    raise AssertionError("nothing came that fits")


def test_world_is_a_robot_on_zenoh(hub: Session, endpoint: str, tmp_path: Path) -> None:
    rings: dict[str, Ring[Sample]] = {topic: Ring(50) for topic in TOPICS}
    for topic, ring in rings.items():
        if topic == "tf_static":
            hub.subscribe_history(topic, ring)
        else:
            hub.subscribe(topic, ring)
    state: Ring[Sample] = Ring(50)
    hub.subscribe("irs/r1/sim/state", state)
    truth, record = tmp_path / "truth.json", tmp_path / "world.mcap"
    command = [sys.executable, "-m", "irsd.sim", "--seed", "4", "--robot", "r1", "--endpoint", endpoint, "--no-explore"]
    world = subprocess.Popen([*command, "--truth", str(truth), "--record", str(record)], stderr=subprocess.PIPE)
    try:
        assert len(decode_pointcloud2(until(rings["lidar/points"], bool).payload).points_sensor) > 5000
        assert decode_odometry(until(rings["odom"], bool).payload).frame_id == "odom"
        assert len(decode_tf(until(rings["tf_static"], bool).payload)) == 3
        info = until(rings["detections/info"], bool)
        stamp = json.loads(info.payload)["stamp_ns"]
        ids = until(rings["detections/ids"], bool)
        assert decode_detections(ids.payload, info.payload).stamp_ns == stamp
        assert until(rings["camera/image/compressed"], bool).encoding == "application/cdr"
        until(rings["camera/camera_info"], bool)
        first = json.loads(until(state, bool).payload)
        assert (first["schema"], first["phase"]) == ("irs/sim/state/1", "idle")
        hub.put("irs/r1/nav/waypoints", b"nonsense")
        way = {"schema": "irs/nav/waypoints/1", "seq": 1, "goal_id": "g", "frame": "map"}
        hub.put("irs/r1/nav/waypoints", json.dumps({**way, "waypoints": [[0.3, 0, 0], [0.6, 0, 0.5]]}).encode())
        until(state, lambda s: json.loads(s.payload)["phase"] == "driving")
        last = json.loads(until(state, lambda s: json.loads(s.payload)["phase"] == "idle").payload)
        assert last["true_pose"] == pytest.approx([0.6, 0.0, 0.5], abs=0.1)
        key = "irs/r1/sim/change"
        (brought,) = hub.get(key, payload=json.dumps({"bring": "box", "to": [2.2, 0.0]}).encode(), timeout_s=10.0)
        number = json.loads(brought.payload)["id"]
        until(rings["detections/info"], lambda s: b'"box"' in s.payload or b'"carton"' in s.payload)
        for document in ({"move": number, "to": [2.4, 0.3]}, {"remove": number}, {"walk": [[2, 0], [3, 0]]}):
            (done,) = hub.get(key, payload=json.dumps(document).encode(), timeout_s=10.0)
            assert done.ok, done.payload
        for wrong in (b"nonsense", json.dumps({"remove": number}).encode(), b'{"bring": "moon", "to": [1, 1]}'):
            (refused,) = hub.get(key, payload=wrong, timeout_s=10.0)
            assert not refused.ok
    finally:
        world.send_signal(signal.SIGTERM)
        _, log = world.communicate(timeout=PATIENCE_S)
    assert world.returncode == 0, log.decode()
    assert b"waypoints dropped" in log
    assert "laboratory" in {room["label"] for room in json.loads(truth.read_text())["rooms"]}
    assert {m.topic.strip("/") for m in read_messages(record)} == set(TOPICS)


def test_a_file_that_cannot_be_written_is_said_in_one_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "irsd.sim", "--truth", str(tmp_path / "no" / "truth.json"), "--duration", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode != 0
    assert "truth.json" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
