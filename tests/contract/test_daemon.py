"""irsd as a process: found, fed, asked, stopped, started again; and what it does when a stage keeps failing."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.config import IrsdConfig, PipelineSettings
from irsd.core.runtime import Ring, Worker, monotonic_s, sleep_s
from irsd.core.types import LidarScan, OdomSample, StaticTransform, SyncedFrame
from irsd.daemon import Daemon
from irsd.graph.codec import delta_from_json, node_from_json, png_to_occupancy, snapshot_from_json
from irsd.graph.model import RoomNode
from irsd.io.keys import RobotKeys
from irsd.io.session import CDR, Sample, Session, ZenohSettings, open_session
from irsd.perception.encoder import LabelEncoder
from irsd.pipeline import MapPipeline, StepResult
from irsd.sensors.encode import encode_odometry, encode_pointcloud2, encode_tf

WAIT_S = 60.0
KEYS = RobotKeys("tester")


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def until(condition: Callable[[], bool]) -> bool:
    deadline_s = monotonic_s() + WAIT_S
    while not condition():
        if monotonic_s() > deadline_s:
            return False
        sleep_s(0.05)
    return True


@contextmanager
def irsd(endpoint: str, *arguments: str, **environment: str) -> Iterator[subprocess.Popen[str]]:
    """A running irsd; killed at the end if it is still there."""
    env = {**os.environ, "IRSD_CONNECT": "", "OMP_NUM_THREADS": "1", **environment}
    command = [sys.executable, "-m", "irsd", "--robot", KEYS.robot, "--endpoint", endpoint, *arguments]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=env)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def ask(session: Session, key: str) -> dict[str, Any]:
    (reply,) = session.get(key, timeout_s=10.0)
    assert reply.ok, reply.error
    return dict(json.loads(reply.payload))


def room_seen_from(x_m: float, y_m: float) -> NDArray[np.float32]:
    """A 6 x 5 x 2.6 m box as a LiDAR 1 m above its floor sees it: float32 [N, 3] relative to the sensor at (x, y)."""
    azimuth, elevation = np.meshgrid(np.linspace(-np.pi, np.pi, 360, False) + 1e-3, np.linspace(-1.2, 1.2, 48))
    ray = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)
    low, high = np.array([-3 - x_m, -2.5 - y_m, -1.0]), np.array([3 - x_m, 2.5 - y_m, 1.6])
    reach = np.where(ray > 0, high / ray, low / ray).min(-1, keepdims=True)
    return (ray * reach).reshape(-1, 3).astype(np.float32)


def drive(robot: Session, condition: Callable[[], bool]) -> bool:
    """Publishes a robot's sensors, as a bridge would, until the condition holds."""
    mount = np.eye(4)
    mount[2, 3] = 1.0
    tf_static = robot.history_publisher("tf_static", encoding=CDR, keep=1)
    tf_static.put(encode_tf([StaticTransform("base_link", "lidar", mount)]))
    step = 0

    def advance() -> bool:
        nonlocal step
        for tick in range(5):
            t_s = (step * 5 + tick) * 0.02
            position = np.array([np.sin(t_s), 0.0, 0.0])
            pose = OdomSample(round(t_s * 1e9), "odom", "base_link", position, np.array([0, 0, 0, 1.0]))
            robot.put("odom", encode_odometry(pose), encoding=CDR)
        t_s = step * 0.1
        scan = LidarScan(round(t_s * 1e9), "lidar", room_seen_from(float(np.sin(t_s)), 0.0), None)
        robot.put("lidar/points", encode_pointcloud2(scan), encoding=CDR)
        step += 1
        return condition()

    return until(advance)


@pytest.fixture
def endpoint() -> str:
    return free_endpoint()


def test_life_of_a_map(endpoint: str, tmp_path: Path) -> None:
    """Empty start, a room, every resource of it; a clean stop; the same room after the next start."""
    settings = ZenohSettings(endpoint=endpoint, connect=())
    deltas: Ring[Sample] = Ring(4096)
    rooms: Ring[Sample] = Ring(4096)
    with open_session(settings, "peer") as robot:
        robot.subscribe_history(KEYS.delta, deltas)
        robot.subscribe("irs/*/graph/rooms/**", rooms)
        with irsd(endpoint, "--state", str(tmp_path)) as process:
            assert until(lambda: robot.find_alive("irs/*/alive") == [KEYS.alive])
            status = ask(robot, KEYS.status)
            assert status["schema"] == "irs/status/1"
            assert "nothing received" in status["blocked_by"]
            faults = {fault["code"] for fault in status["faults"]}
            # A machine that is busy may be short of CPU right after the start.
            assert faults - {"budget"} == {"sensor_missing"}
            assert snapshot_from_json(robot.get(KEYS.snapshot)[0].payload).rooms == ()
            assert "no map yet" in robot.get(KEYS.occupancy)[0].error or robot.get(KEYS.occupancy)[0].ok
            assert drive(robot, lambda: rooms.received > 0)
            assert until(lambda: ask(robot, KEYS.status)["graph"]["rooms"] == 1)

            (room,) = [node_from_json(reply.payload) for reply in robot.get("irs/*/graph/rooms/**")]
            assert isinstance(room, RoomNode)
            assert 20 < room.area_m2 < 40  # 30 m2, walls of one voxel either way
            assert ask(robot, KEYS.room(room.id))["schema"] == "irs/graph/room/1"
            assert ask(robot, KEYS.building)["rooms"] == [room.id]
            (grid,) = robot.get(KEYS.occupancy)
            header = json.loads(grid.attachment or b"{}")
            assert set(header) == {"resolution_m", "origin_xy_m", "frame", "seq"}
            assert (png_to_occupancy(grid.payload) == 0).any()
            heavy = [reply.key for reply in robot.get(f"irs/{KEYS.robot}/graph/**")]
            assert KEYS.snapshot in heavy
            assert not [key for key in heavy if key.endswith(("points", "embedding"))]
            assert ask(robot, KEYS.status)["lag_s"] is not None

            process.send_signal(signal.SIGTERM)
            assert process.wait(WAIT_S) == 0
        seqs = [delta_from_json(sample.payload).seq for sample in deltas.drain()]
        assert seqs == list(range(1, len(seqs) + 1))

        with irsd(endpoint, "--state", str(tmp_path)) as process:
            assert until(lambda: robot.find_alive("irs/*/alive") == [KEYS.alive])
            again = snapshot_from_json(robot.get(KEYS.snapshot)[0].payload)
            assert again.seq == seqs[-1]
            assert [node.id for node in again.rooms] == [room.id]
            process.send_signal(signal.SIGKILL)
            process.wait(WAIT_S)
        assert until(lambda: robot.find_alive("irs/*/alive") == [])


def test_systemd_is_told(endpoint: str, tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as server:
        server.bind(str(tmp_path / "notify"))
        server.settimeout(WAIT_S)
        environment = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "400000"}
        with irsd(endpoint, "--no-store", **environment) as process:
            words: list[str] = []
            while not {"READY=1", "WATCHDOG=1"} <= set(words):
                words.append(server.recv(4096).decode())
            process.send_signal(signal.SIGINT)
            while "STOPPING=1" not in words:
                words.append(server.recv(4096).decode())
            assert process.wait(WAIT_S) == 0
    assert any(word.startswith("STATUS=0 rooms, 0 things") for word in words)


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (("--config", "/does/not/exist.yaml"), 2, "can't be read"),
        (("--robot", "a/b"), 2, "robot's name"),
        (("--colour", "red"), 2, "unrecognized"),
    ],
)
def test_what_stops_a_start(endpoint: str, arguments: tuple[str, ...], code: int, says: str) -> None:
    with irsd(endpoint, "--no-store", *arguments) as process:
        _, errors = process.communicate(timeout=WAIT_S)
        assert process.returncode == code
    assert says in errors


def test_an_endpoint_in_use_stops_a_start(endpoint: str, tmp_path: Path) -> None:
    config = tmp_path / "irsd.yaml"
    config.write_text("zenoh: {open_timeout_s: 0}")
    there = open_session(ZenohSettings(endpoint=endpoint, connect=()), "hub")
    with there, irsd(endpoint, "--no-store", "--config", str(config)) as process:
        _, errors = process.communicate(timeout=WAIT_S)
    assert process.returncode == 1
    assert "another irsd has it" in errors


class BrokenPipeline(MapPipeline):
    """A pipeline with a stage that fails on every frame: the fault that is injected."""

    def step(self, frame: SyncedFrame) -> StepResult:
        raise ArithmeticError(f"no solution for frame {frame.seq}")


def test_a_stage_that_keeps_failing_ends_the_daemon(endpoint: str, caplog: pytest.LogCaptureFixture) -> None:
    config = IrsdConfig(robot=KEYS.robot)
    settings = ZenohSettings(endpoint=endpoint, connect=())
    with open_session(settings, "hub") as session, open_session(settings, "peer") as robot:
        daemon = Daemon(config, session, BrokenPipeline(PipelineSettings(), LabelEncoder.load(), map_id="m"), None)
        daemon.start()
        main = Worker("test-main", daemon.main_loop).start()
        assert drive(robot, lambda: not main.alive)
        assert daemon.failed
        assert "20 steps failed in a row; the last: frame 20: ArithmeticError" in daemon.stopper.reason
        assert daemon.stop()
    assert "step of frame 1 failed (1 in a row)" in caplog.text
