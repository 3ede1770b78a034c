"""Play a recording live at irsd with its own eyes, and print how the budget was kept.

    python benchmarks/governor.py --config foundation.yaml [--cores 0.5 1.0] [--minutes 5] [--stress] [--data FOLDER]

The configuration names the models (perception, models); random weights do (benchmarks/random_models.py), their answers are noise but
their cost is real. CPU and memory are those of the process as the kernel counts them. On a busy machine a process can't use what it
may: windows in which its threads were ready and had no core for as long as is missing are told apart. The recording is played in a
loop, its stamps go on. --stress: the middle third of the time has a busy process on each core.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import struct
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import yaml

from irsd.core.runtime import Stopper, Worker, monotonic_s, sleep_s
from irsd.io.endpoints import ZenohSettings, with_environment
from irsd.io.keys import RobotKeys
from irsd.io.session import CDR, Session, open_session
from irsd.sensors.replay import read_messages

HERE = Path(__file__).resolve().parent
ROBOT = "governed"
WINDOW_S, SAMPLE_S, WARM_S = 10.0, 0.1, 20.0
STAMPED = {
    "sensor_msgs/msg/PointCloud2",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/CameraInfo",
    "nav_msgs/msg/Odometry",
}


@dataclass
class Measured:
    """Samples of one run: (time, CPU seconds, RSS MB, seconds that threads were ready and had no core), and status documents."""

    samples: list[tuple[float, float, float, float]] = field(default_factory=list)
    states: list[tuple[float, dict[str, Any]]] = field(default_factory=list)
    sent: Counter[str] = field(default_factory=Counter)
    crashed: bool = False

    def windows(self, cores: float) -> tuple[np.ndarray, np.ndarray]:
        """(share of the setting that was used, and that threads waited for a core) of every window of 10 s after the first seconds."""
        time_s, cpu_s, _, waited_s = np.array(self.samples).T
        starts = np.arange(time_s[0] + WARM_S, time_s[-1] - WINDOW_S, 0.2)
        used, waited = (
            np.interp(starts + WINDOW_S, time_s, v) - np.interp(starts, time_s, v) for v in (cpu_s, waited_s)
        )
        return used / WINDOW_S / cores, waited / WINDOW_S / cores


def waited_s(pid: int) -> float:
    """Seconds that the threads of a process, those that live, were ready to run and had no core (the kernel's schedstat)."""
    total = 0.0
    for task in Path(f"/proc/{pid}/task").iterdir():
        try:
            total += int((task / "schedstat").read_text().split()[1]) * 1e-9
        except (OSError, IndexError):
            continue
    return total


def restamped(data: bytes, type_name: str, shift_ns: int) -> bytes:
    """The message with its header's stamp moved: it stands first in the CDR, little endian."""
    if type_name not in STAMPED or not shift_ns:
        return data
    sec, nsec = struct.unpack_from("<iI", data, 4)
    moved = divmod(sec * 1_000_000_000 + nsec + shift_ns, 1_000_000_000)
    return data[:4] + struct.pack("<iI", *moved) + data[12:]


def play(session: Session, recording: Path, seconds: float, stopper: Stopper, sent: Counter[str]) -> None:
    """The recording in a loop with its own timing until the time is up."""
    began_s, loop_s, shift_ns = monotonic_s(), 0.0, 0
    while True:
        first_ns = last_ns = None
        for message in read_messages(recording):
            first_ns = message.log_time_ns if first_ns is None else first_ns
            last_ns = message.log_time_ns
            due_s = loop_s + (message.log_time_ns - first_ns) * 1e-9
            if due_s > seconds or stopper.requested:
                return
            sleep_s(max(began_s + due_s - monotonic_s(), 0.0))
            data = restamped(message.data, message.type_name, shift_ns)
            session.put(message.topic.strip("/"), data, encoding=CDR)
            sent[message.topic] += 1
        assert first_ns is not None
        assert last_ns is not None
        loop_s += (last_ns - first_ns) * 1e-9 + 0.2
        shift_ns += last_ns - first_ns + 200_000_000


def measure(config: Path, recording: Path, seconds: float, stress: bool, log: Path) -> Measured:
    """irsd as a process, fed, watched and stopped."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    environment = {**os.environ, "IRSD_CONNECT": "", "IRSD_ENDPOINT": endpoint, "OMP_NUM_THREADS": "1"}
    os.environ.update(IRSD_CONNECT="", IRSD_ENDPOINT=endpoint)
    command = [sys.executable, "-m", "irsd", "--robot", ROBOT, "--config", str(config), "--no-store"]
    out, stopper, busy = Measured(), Stopper(), []
    with log.open("w") as errors, subprocess.Popen(command, stderr=errors, env=environment) as irsd:
        process = psutil.Process(irsd.pid)
        try:
            with open_session(with_environment(ZenohSettings(open_timeout_s=600.0), endpoint), "client") as session:
                session.subscribe(
                    RobotKeys(ROBOT).status,
                    lambda sample: out.states.append((monotonic_s(), json.loads(sample.payload))),
                )
                while not out.states and irsd.poll() is None:
                    sleep_s(0.2)
                player = Worker("play", lambda: play(session, recording, seconds, stopper, out.sent)).start()
                began_s = monotonic_s()
                while player.alive and irsd.poll() is None:
                    used = process.cpu_times()
                    out.samples.append(
                        (monotonic_s(), used.user + used.system, process.memory_info().rss / 1e6, waited_s(irsd.pid))
                    )
                    part = 3 * (monotonic_s() - began_s) / seconds
                    if stress and 1 <= part < 2 and not busy:
                        busy = [
                            subprocess.Popen([sys.executable, "-c", "while True: pass"])
                            for _ in range(os.cpu_count() or 1)
                        ]
                    if part >= 2 and busy:
                        [b.kill() for b in busy]
                        busy = []
                    sleep_s(SAMPLE_S)
                sleep_s(3.0)  # the last messages are counted in the next status
        finally:
            stopper.request("done")
            [b.kill() for b in busy]
            out.crashed = irsd.poll() is not None
            irsd.terminate()
    return out


def rows(cores: float, rss_mb: float, measured: Measured) -> list[tuple[str, str, str]]:
    """(what, measured, bar)."""
    used, waited = measured.windows(cores)
    starved = (used < 0.9) & (used + waited >= 0.9)
    last = measured.states[-1][1]
    lost = {}
    for topic, sensor in last["sensors"].items():
        if sensor["kind"] in ("lidar", "odometry"):
            lost[topic] = measured.sent[topic] - sensor["received"] + sensor["dropped"] + sensor["bad"]
    playing = [s for t, s in measured.states if measured.samples[0][0] + WARM_S < t < measured.samples[-1][0]]
    ages = [s["rooms_age_s"] for s in playing if s["rooms_age_s"] is not None]
    seen = last["perception"] or {}
    rungs = Counter(s["perception"]["rung"] for s in playing)
    time_s, cpu_s, rss, _ = np.array(measured.samples).T
    return [
        ("crashed", "yes" if measured.crashed else "no", "no"),
        ("CPU of any 10 s / setting, least", f"{used.min():.2f}", ">= 0.90"),
        ("CPU of any 10 s / setting, most", f"{used.max():.2f}", "<= 1.10"),
        ("windows of 10 s above 1.10", f"{100 * np.mean(used > 1.1):.1f} %", "0 %"),
        ("windows of 10 s below 0.90", f"{100 * np.mean(used < 0.9):.1f} %", "0 %"),
        ("of these, ready but without a core", f"{100 * np.mean(starved):.1f} %", "all"),
        ("CPU in the mean, cores", f"{(cpu_s[-1] - cpu_s[0]) / (time_s[-1] - time_s[0]):.3f}", f"{cores}"),
        ("messages lost", json.dumps(lost), "0"),
        ("age of the rooms, p95, s", f"{np.percentile(ages, 95):.2f}", "<= 1"),
        ("lag of the graph, p95, ms", f"{last['stages'].get('lag', {}).get('p95_ms')}", ""),
        ("RSS, most, MB", f"{rss.max():.0f}", f"<= {rss_mb:.0f}"),
        ("keyframes", str(seen.get("keyframes", 0)), ""),
        ("keyframe, p95, ms", str(seen.get("keyframe_p95_ms")), ""),
        ("rungs, seconds", json.dumps(dict(rungs)), ""),
        ("ladder down / up", f"{seen.get('steps_down')} / {seen.get('steps_up')}", ""),
        ("dropped", json.dumps(seen.get("dropped")), ""),
        ("costs", json.dumps(seen.get("costs")), ""),
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", type=Path, required=True)
    parser.add_argument("--cores", type=float, nargs="+", default=[0.5, 1.0])
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--stress", action="store_true")
    parser.add_argument("--data", type=Path, default=HERE.parents[1] / "shared" / "data" / "small_house")
    parser.add_argument("--keep", type=Path, help="folder for samples and status of each run")
    arguments = parser.parse_args()
    recording = arguments.data / f"{arguments.data.name}.mcap"
    if not recording.is_file():
        print(f"the recording is absent: {recording}", file=sys.stderr)
        return 2
    document = yaml.safe_load(arguments.config.read_text())
    for cores in arguments.cores:
        document["budget"] = {**document.get("budget", {}), "cpu_cores": cores}
        with tempfile.TemporaryDirectory() as scratch:
            folder = arguments.keep or Path(scratch)
            folder.mkdir(parents=True, exist_ok=True)
            config = folder / f"{cores}.yaml"
            config.write_text(yaml.safe_dump(document))
            measured = measure(config, recording, arguments.minutes * 60, arguments.stress, folder / f"{cores}.log")
            (folder / f"{cores}.json").write_text(json.dumps({"samples": measured.samples, "states": measured.states}))
        print(
            f"\ncpu_cores {cores}, {arguments.minutes:g} min{', stress in the middle third' if arguments.stress else ''}"
        )
        for what, value, bar in rows(cores, document["budget"].get("rss_mb", 1500.0), measured):
            print(f"| {what:36} | {value:>12} | {bar} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
