"""What the live benchmarks share: an irsd process that is measured, and recordings that are played in a loop as the sensors would."""

from __future__ import annotations

import json
import os
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

from irsd.core.runtime import Ring, monotonic_s, sleep_s
from irsd.io.keys import RobotKeys
from irsd.io.session import CDR, JSON, Sample, Session, ZenohSettings, open_session
from irsd.sensors.replay import read_messages

ROBOT = "bench"
STAMPED = ("PointCloud2", "Odometry", "CompressedImage", "Image", "CameraInfo")
START_S = 300.0


@dataclass(frozen=True)
class Reading:
    """What the kernel says of the process, and irsd of itself."""

    at_s: float
    rss_mb: float
    cpu_s: float
    files: int
    threads: int
    status: dict[str, Any]


class Live:
    """A running irsd, a session to it, and its newest status."""

    def __init__(self, process: psutil.Process, session: Session) -> None:
        self.process, self.session, self.keys = process, session, RobotKeys(ROBOT)
        self._statuses: Ring[Sample] = Ring(4)
        session.subscribe(self.keys.status, self._statuses)
        self.status: dict[str, Any] = {}

    def read(self) -> Reading:
        for sample in self._statuses.drain():
            self.status = json.loads(sample.payload)
        with self.process.oneshot():
            times = self.process.cpu_times()
            return Reading(
                monotonic_s(),
                self.process.memory_info().rss / 1e6,
                times.user + times.system,
                self.process.num_fds(),
                self.process.num_threads(),
                self.status,
            )


@contextmanager
def running_irsd(folder: Path, settings: str = "") -> Iterator[Live]:
    """irsd with its map in the folder, alive; ended at the end."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    (folder / "irsd.yaml").write_text(settings)
    command = [sys.executable, "-m", "irsd", "--robot", ROBOT, "--endpoint", endpoint]
    command += ["--state", str(folder / "state"), "--config", str(folder / "irsd.yaml")]
    environment = {**os.environ, "IRSD_CONNECT": "", "OMP_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}
    with (folder / "irsd.log").open("wb") as log:
        process = subprocess.Popen(command, stderr=log, env=environment)
    try:
        with open_session(ZenohSettings(endpoint=endpoint, connect=()), "peer") as session:
            live = Live(psutil.Process(process.pid), session)
            end_s = monotonic_s() + START_S
            while session.find_alive(live.keys.alive) == []:
                if process.poll() is not None or monotonic_s() > end_s:
                    raise SystemExit(f"irsd did not start: {(folder / 'irsd.log').read_text()[-2000:]}")
                sleep_s(0.2)
            yield live
    finally:
        process.terminate()
        process.wait(60)


def restamped(type_name: str, data: bytes, shift_ns: int) -> bytes:
    """The message as it would be that much later."""
    if type_name in ("", "json"):
        document = json.loads(data)
        document["stamp_ns"] += shift_ns
        return json.dumps(document).encode()
    if not type_name.endswith(STAMPED):
        return data
    sec, nanosec = struct.unpack_from("<iI", data, 4)
    sec, nanosec = divmod(sec * 10**9 + nanosec + shift_ns, 10**9)
    return data[:4] + struct.pack("<iI", sec, nanosec) + data[12:]


def play(session: Session, files: Sequence[Path], seconds: float) -> Iterator[float]:
    """Plays in a loop with the recordings' own timing, stamps going on; yields now and then, with the seconds played."""
    messages = list(read_messages(list(files)))
    first_ns, length_ns = messages[0].log_time_ns, messages[-1].log_time_ns - messages[0].log_time_ns + 10**8
    began_s, shift_ns, told_s = monotonic_s(), 0, 0.0
    while True:
        for message in messages:
            due_s = began_s + (message.log_time_ns - first_ns + shift_ns) * 1e-9
            sleep_s(max(0.0, due_s - monotonic_s()))
            encoding = JSON if message.type_name in ("", "json") else CDR
            data = restamped(message.type_name, message.data, shift_ns)
            session.put(message.topic.strip("/"), data, encoding=encoding, block=False)
            played_s = monotonic_s() - began_s
            if played_s - told_s > 1.0:
                told_s = played_s
                yield played_s
            if played_s > seconds:
                return
        shift_ns += length_ns


def recordings() -> list[Path]:
    """The short recording with its detections, where it lies beside the checkout."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("IRSD_SHARED_DATA", default)) / "small_house"
    files = [folder / "small_house.mcap", folder / "small_house.detections.mcap"]
    if not all(file.is_file() for file in files):
        raise SystemExit(f"the recordings are absent: {folder} ($IRSD_SHARED_DATA)")
    return files
