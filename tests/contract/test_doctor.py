"""irsctl doctor: over a real network with sensors that are right, wrong, misnamed and missing; and this machine's own troubles."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from navigation_standin import free_endpoint

from irsd.core.geometry import make_pose
from irsd.core.runtime import Event, Worker
from irsd.core.types import CameraModel, LidarScan, OdomSample, StaticTransform
from irsd.ctl.doctor import doctor
from irsd.ctl.link import Target
from irsd.io.session import CDR, Session, ZenohSettings, open_session
from irsd.sensors.encode import encode_camera_info, encode_odometry, encode_pointcloud2, encode_tf

UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
CAMERA = CameraModel("camera", 64, 48, np.array([[50.0, 0, 32], [0, 50.0, 24], [0, 0, 1]]), "plumb_bob", np.zeros(0))


class Robot:
    """A hub that is alive with a status, and sensors at 20 Hz: topic -> bytes."""

    def __init__(self, hub: Session, topics: dict[str, bytes]) -> None:
        self._hub, self._topics, self._stop = hub, topics, Event()
        status = {
            "graph": {"rooms": 2, "instances": 5},
            "faults": [{"code": "store", "text": "disk full", "remedy": "free it"}],
        }
        hub.queryable("irs/r/status", lambda q: q.reply("irs/r/status", json.dumps(status).encode()))
        hub.announce("irs/r/alive")
        self._worker = Worker("robot", self._run).start()

    def _run(self) -> None:
        while not self._stop.wait(0.05):
            for topic, payload in self._topics.items():
                self._hub.put(topic, payload, encoding=CDR)

    def close(self) -> None:
        self._stop.set()
        self._worker.join(5.0)


@pytest.fixture
def endpoint(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> str:
    monkeypatch.setenv("IRSD_CONNECT", "")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("IRSD_CONFIG", raising=False)
    return free_endpoint()


@pytest.fixture
def robot(endpoint: str) -> Iterator[str]:
    scan = LidarScan(10**18, "lidar", np.ones((20, 3), np.float32), None)
    pose = OdomSample(10**18, "odom", "base_link", np.zeros(3), UPRIGHT)
    topics = {
        "lidar/points": encode_odometry(pose),  # a wrong type under the name of another
        "velodyne": encode_pointcloud2(scan),  # the right type under a name that nobody configured
        "odom": encode_odometry(pose),
        "camera/camera_info": encode_camera_info(CAMERA, 10**18),
    }
    with open_session(ZenohSettings(endpoint=endpoint, connect=()), "hub") as hub:
        latched = hub.history_publisher("tf_static", encoding=CDR, keep=4)
        latched.put(encode_tf([StaticTransform("base_link", "lidar", make_pose(np.zeros(3), UPRIGHT))]))
        there = Robot(hub, topics)
        yield endpoint
        there.close()


def run(
    endpoint: str, capsys: pytest.CaptureFixture[str], config: Path | None = None
) -> tuple[int, list[dict[str, Any]]]:
    code = doctor(Target(None, endpoint, 2.0), config, 1.5, True)
    document = json.loads(capsys.readouterr().out)
    assert document["ok"] == (code == 0)
    return code, document["reports"]


def about(reports: list[dict[str, Any]], words: str) -> dict[str, Any]:
    found = [report for report in reports if words in report["text"]]
    assert len(found) == 1, (words, reports)
    return found[0]


def test_a_robot_with_mistakes(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, reports = run(robot, capsys)
    assert code == 1
    wrong = about(reports, "/lidar/points can't be decoded")
    assert wrong["level"] == "error"
    assert "it is nav_msgs/msg/Odometry" in wrong["fix"]
    assert "ingest.lidar_topic" in wrong["fix"]
    assert about(reports, "/velodyne: sensor_msgs/msg/PointCloud2")["level"] == "note"
    assert about(reports, "/odom: ")["level"] in ("ok", "note", "warning")
    assert about(reports, "/tf_static: ")["level"] == "ok"
    assert about(reports, "no mounting leads from base_link to camera")["fix"].startswith("publish base_link -> camera")
    assert about(reports, "1 peers and 0 routers")["level"] == "ok"
    assert about(reports, "r is alive: 2 rooms, 5 things")["level"] == "ok"
    assert about(reports, "store: disk full")["fix"] == "free it"
    assert all(report["fix"] for report in reports if report["level"] in ("error", "warning"))


def test_nobody_there_and_a_wrong_configuration(
    endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "irsd.yaml"
    config.write_text("ingest: {lidar_topc: /x}")
    code, reports = run(endpoint, capsys, config)
    assert code == 1
    assert about(reports, "lidar_topc")["area"] == "config"
    assert about(reports, "nobody is linked at")["level"] == "error"
    for topic in ("/lidar/points", "/odom", "/tf_static"):
        assert about(reports, f"{topic}: nothing arrives")["level"] == "error"
    assert about(reports, "/detections/ids: nothing arrives")["level"] == "note"


def test_this_machine(endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    key = tmp_path / "irsd.key"
    key.write_text("secret words")
    key.chmod(0o644)
    config = tmp_path / "irsd.yaml"
    config.write_text(
        f"store: {{directory: {tmp_path / 'file'}}}\nperception: {{image_encoder: nanoclip}}\n"
        f"zenoh: {{endpoint: tls/127.0.0.1:1, listen: [], connect: [], tls: {{ca: /absent/ca.pem, certificate: c, key: {key}}}}}\n"
    )
    (tmp_path / "file").write_text("no folder")
    (tmp_path / "file").chmod(0o400)
    code, reports = run(endpoint, capsys, config)
    assert code == 1
    assert about(reports, "nanoclip")["area"] == "models"
    assert about(reports, "zenoh.tls.ca: /absent/ca.pem can't be read")["level"] == "error"
    assert about(reports, "everybody may read this key")["fix"].startswith("chmod 640")
    if os.getuid():  # root may write anywhere
        assert about(reports, "can't be written")["level"] == "error"
    assert "secret words" not in json.dumps(reports)
