"""A full disk, one that went read-only, clocks that jump, silence, garbage: irsd says so, and goes on."""

from __future__ import annotations

import contextlib
import json
import sqlite3
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from daemon_here import running
from sensing_robot import SensingRobot

from irsd.config import IrsdConfig, StoreSettings
from irsd.core.errors import StoreError
from irsd.core.runtime import monotonic_s
from irsd.daemon import Daemon
from irsd.graph.store import FILE_NAME, Store
from irsd.io.keys import RobotKeys
from irsd.io.session import CDR, Session
from irsd.perception.encoder import LabelEncoder
from irsd.perception.settings import PerceptionSettings

KEYS = RobotKeys("tester")
WAIT_S = 60.0
HOUR_NS = 3600 * 10**9


@pytest.fixture(scope="module")
def labels() -> LabelEncoder:
    return LabelEncoder.load()


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 3 MB of its own."""
    disk = tmp_path / "disk"
    disk.mkdir()
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(disk)], capture_output=True, check=False
    )
    if made.returncode:
        pytest.skip("mounting a small disk takes the rights of root")
    yield disk
    subprocess.run(["umount", "-l", str(disk)], check=True)


@contextlib.contextmanager
def at_work(directory: Path, labels: LabelEncoder) -> Iterator[tuple[Daemon, Session, SensingRobot]]:
    """irsd with a room in its map."""
    config = IrsdConfig(
        robot=KEYS.robot, store=StoreSettings(directory=str(directory)), perception=PerceptionSettings(nano=False)
    )
    with running(config, labels) as (daemon, session):
        robot = SensingRobot(session)
        drive_until(robot, lambda: status(session)["graph"]["rooms"] == 1)
        yield daemon, session, robot


def status(session: Session) -> dict[str, Any]:
    (reply,) = session.get(KEYS.status, timeout_s=10.0)
    return dict(json.loads(reply.payload))


def faults(session: Session) -> set[str]:
    return {fault["code"] for fault in status(session)["faults"]}


def drive_until(robot: SensingRobot, condition: Callable[[], bool], *, lidar: bool = True) -> None:
    end_s = monotonic_s() + WAIT_S
    while True:
        for _ in range(5):
            robot.drive(lidar=lidar)
        if condition():
            return
        assert monotonic_s() < end_s


def teach(session: Session, name: str) -> str:
    """Empty, or why it is not done."""
    question = json.dumps({"kind": "teach", "target": "R1", "name": name}).encode()
    (reply,) = session.get(KEYS.command("edit"), timeout_s=20.0, payload=question)
    return "" if reply.ok else str(reply.error)


def test_a_full_disk_is_said_and_what_waits_is_written_when_it_is_not(small_disk: Path, labels: LabelEncoder) -> None:
    filler = small_disk / "filler"
    with at_work(small_disk, labels) as (_, session, robot):
        with contextlib.suppress(OSError), filler.open("wb", buffering=0) as file:
            while True:
                file.write(b"x" * 1024)
        told = [teach(session, f"{name} room") for name in ("red", "blue", "green")]
        assert any("not on disk" in each for each in told), told
        drive_until(robot, lambda: "store" in faults(session))
        frames = status(session)["counts"]["frames"]
        drive_until(robot, lambda: status(session)["counts"]["frames"] > frames)  # the map goes on
        filler.unlink()
        drive_until(robot, lambda: "store" not in faults(session))
        assert teach(session, "the last room") == ""
        seq = status(session)["graph"]["seq"]
    store = Store(small_disk / KEYS.robot)
    stored = store.load()
    store.close()
    assert stored is not None
    assert stored.snapshot.seq >= seq
    assert len(stored.edits) == 4
    assert stored.snapshot.rooms[0].label == "the last room"


def test_a_disk_that_went_read_only_is_said_and_written_again_when_it_can_be(
    tmp_path: Path, labels: LabelEncoder
) -> None:
    with at_work(tmp_path, labels) as (daemon, session, robot):
        store = daemon._store
        assert store is not None
        store._db.execute("PRAGMA query_only = ON")  # SQLite's own refusal, as of a disk remounted read-only
        assert "not on disk" in teach(session, "red room")
        drive_until(robot, lambda: "store" in faults(session))
        store._db.execute("PRAGMA query_only = OFF")
        drive_until(robot, lambda: "store" not in faults(session))
    with contextlib.closing(sqlite3.connect(tmp_path / KEYS.robot / FILE_NAME)) as file:
        assert file.execute("SELECT count(*) FROM edit").fetchone() == (1,)


def test_a_read_only_state_directory_is_refused_in_words(small_disk: Path) -> None:
    Store(small_disk / KEYS.robot).close()
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    with pytest.raises(StoreError, match=FILE_NAME):
        Store(small_disk / KEYS.robot)


@pytest.mark.parametrize("jump_ns", [HOUR_NS, -HOUR_NS])
def test_a_clock_that_jumps_by_an_hour_is_said_and_the_map_goes_on(
    tmp_path: Path, labels: LabelEncoder, jump_ns: int
) -> None:
    with at_work(tmp_path, labels) as (_, session, robot):
        robot.offset_ns += jump_ns
        drive_until(robot, lambda: "time_jump" in faults(session))
        frames = status(session)["counts"]["frames"]
        drive_until(robot, lambda: status(session)["counts"]["frames"] >= frames + 10)


def test_a_lidar_that_falls_silent_is_said_and_taken_up_again(tmp_path: Path, labels: LabelEncoder) -> None:
    with at_work(tmp_path, labels) as (_, session, robot):
        drive_until(robot, lambda: "sensor_stale" in faults(session), lidar=False)
        frames = status(session)["counts"]["frames"]
        drive_until(robot, lambda: "sensor_stale" not in faults(session))
        drive_until(robot, lambda: status(session)["counts"]["frames"] >= frames + 10)


def test_garbage_on_every_topic_is_counted_said_and_forgotten(tmp_path: Path, labels: LabelEncoder) -> None:
    rng = np.random.default_rng(7)
    with at_work(tmp_path, labels) as (_, session, robot):
        topics = [name.lstrip("/") for name in status(session)["sensors"]]
        assert {"odom", "lidar/points", "tf_static", "detections/ids"} <= set(topics)
        end_s = monotonic_s() + WAIT_S
        while "sensor_undecodable" not in faults(session):
            assert monotonic_s() < end_s
            for topic in topics:
                for size in (0, 3, 400):
                    session.put(topic, rng.bytes(size), encoding=CDR)
        drops = status(session)["drops"]
        assert all(drops[f"/{topic}.bad"] for topic in ("odom", "lidar/points")), drops
        frames = status(session)["counts"]["frames"]
        drive_until(robot, lambda: "sensor_undecodable" not in faults(session))
        drive_until(robot, lambda: status(session)["counts"]["frames"] >= frames + 10)
        assert status(session)["graph"]["rooms"] == 1
