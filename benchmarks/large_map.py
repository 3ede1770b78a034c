"""A start on a stored map of 10,000 things in 300 rooms: how long until READY, how long irsctl status takes, how much memory.

    python benchmarks/large_map.py [--things 10000] [--rooms 300] [--recording ../shared/data/small_house/small_house.mcap]

The store is written by the product's own store from a generated site; the daemon is a process of its own, told of by sd_notify.
CPU seconds are printed beside the wall's, for machines that are busy with something else.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
from large_site import make_site

from irsd.config import IrsdConfig
from irsd.core.types import Plan
from irsd.graph.model import InstanceArrays
from irsd.graph.store import Store, StoredMap
from irsd.ingest import SensorDecoder
from irsd.perception.encoder import LabelEncoder
from irsd.pipeline import MapPipeline
from irsd.plans import PLAN, plan_to_bytes
from irsd.sensors.replay import read_messages
from irsd.sensors.sync import Synchronizer, SyncSettings

ROBOT = "large"


def write_store(folder: Path, rooms: int, things: int) -> float:
    """Writes the site; returns the megabytes on disk."""
    site = make_site(rooms, things, 1)
    rng = np.random.default_rng(2)
    vectors = rng.normal(size=(things, 384)).astype(np.float32)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    arrays = {
        node.id: InstanceArrays(site.points_of(node.id), vectors[k]) for k, node in enumerate(site.graph.instances)
    }
    plan = plan_to_bytes(Plan(site.frame, 0.0, site.cells == 100, site.cells == 0))
    store = Store(folder / ROBOT)
    store.rewrite(
        StoredMap(site.graph, arrays, next_ids={"I": things + 1, "R": rooms + 1}, geometry={f"{PLAN}0": plan})
    )
    store.close()
    return (folder / ROBOT / "map.sqlite").stat().st_size / 1e6


def measure(folder: Path) -> list[tuple[str, str, str]]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    environment = {**os.environ, "IRSD_CONNECT": "", "OMP_NUM_THREADS": "1", "NOTIFY_SOCKET": str(folder / "notify")}
    command = [sys.executable, "-m", "irsd", "--robot", ROBOT, "--endpoint", endpoint, "--state", str(folder)]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as server:
        server.bind(str(folder / "notify"))
        server.settimeout(600.0)
        began_s = time.monotonic()
        process = subprocess.Popen([*command, "--log-level", "error"], env=environment)
        try:
            while server.recv(4096).decode() != "READY=1":
                pass
            ready_s = time.monotonic() - began_s
            times = psutil.Process(process.pid).cpu_times()
            asked = [ask(endpoint) for _ in range(5)]
            rss_mb = psutil.Process(process.pid).memory_info().rss / 1e6
        finally:
            process.kill()
            process.wait()
    wall, cpu = sorted(asked)[2]
    return [
        ("start to READY, s (CPU s)", f"{ready_s:.1f} ({times.user + times.system:.1f})", "<= 8"),
        ("irsctl status, s (CPU s), median of 5", f"{wall:.2f} ({cpu:.2f})", "<= 0.5"),
        ("memory after the start, MB", f"{rss_mb:.0f}", "<= 2000"),
    ]


def step_ms(folder: Path, recording: Path) -> tuple[float, float]:
    """CPU milliseconds of a step beside the stored map and beside none, over the same frames in turn; the first ten don't count."""
    labels, sync, config = LabelEncoder.load(), Synchronizer(SyncSettings()), IrsdConfig()
    decoder = SensorDecoder(config.ingest)
    store = Store(folder / ROBOT)
    stored = store.load()
    store.close()
    assert stored is not None
    large, empty = (MapPipeline(config.pipeline, labels, map_id=stored.snapshot.map_id) for _ in range(2))
    large.restore(stored)
    times: list[tuple[float, ...]] = []
    for message in read_messages([recording, recording.with_name("small_house.detections.mcap")]):
        for sensed in decoder.decode(message.topic, message.data):
            sync.push(sensed)
        for frame in sync.pop():
            marks = [time.thread_time()]
            for pipeline in (large, empty) if len(times) % 2 else (empty, large):
                pipeline.step(frame)
                marks.append(time.thread_time())
            passed = np.diff(marks)
            times.append(tuple(passed if len(times) % 2 else passed[::-1]))
        if len(times) >= 400:
            break
    beside, alone = np.mean(times[10:], axis=0) * 1e3
    return float(beside), float(alone)


def ask(endpoint: str) -> tuple[float, float]:
    """(wall, CPU) seconds of one irsctl status, its process included."""
    began_s, before = time.monotonic(), os.times()
    command = [sys.executable, "-m", "irsd.ctl", "--endpoint", endpoint, "--timeout", "20", "status", "--json"]
    done = subprocess.run(command, stdout=subprocess.PIPE, env={**os.environ, "IRSD_CONNECT": ""}, check=False)
    after = os.times()
    assert json.loads(done.stdout)["graph"]["instances"] > 0
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return time.monotonic() - began_s, used


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--things", type=int, default=10_000)
    parser.add_argument("--rooms", type=int, default=300)
    parser.add_argument(
        "--recording", type=Path, help="small_house.mcap, to compare steps beside this map and beside none"
    )
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        size_mb = write_store(Path(scratch), arguments.rooms, arguments.things)
        print(f"{arguments.things} things in {arguments.rooms} rooms, {size_mb:.0f} MB on disk")
        for what, found, bar in measure(Path(scratch)):
            print(f"{what:40s} {found:>16s}   {bar}")
        if arguments.recording is not None:
            beside, alone = step_ms(Path(scratch), arguments.recording)
            print(
                f"{'CPU of a step, ms, beside it and alone':40s} {beside:7.1f} {alone:7.1f}   {beside / alone:.2f} <= 1.3"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
