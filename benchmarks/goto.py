"""What goals in words are worth: time to an answer on a large site, and right answers with calibrated scores on known buildings.

    python benchmarks/goto.py                         time to accepted: 10,000 things in 200 rooms, in process and over zenoh
    python benchmarks/goto.py --calibrate [--nano] [--seeds 1-3] [--folders DIR ...] [--cache DIR] [--write FILE]

Times: every sentence is asked once, after some that warm up caches; CPU seconds of the process beside wall clock, as other work on
the machine counts only for the latter. Over zenoh, nav_bridge is a process of its own and so is whoever asks (CPU: of both); graph,
map, points and odometry come from a stand-in for irsd in the asking process.

Calibration: each building of the embedded world is explored by the simulated sensors (and detector; --nano: irsd's own eyes), and
sentences are made from its truth: names, rooms by their true kind, relations, choices, and things that are not there. Folders are
those of ``irsctl replay`` on the small house, with its 71 sentences. A candidate's score is right as a probability when of those
scored about 0.8 four in five are meant.
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
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from large_site import Site, make_site, sentences

from irsd.core.runtime import monotonic_s
from irsd.core.types import OdomSample
from irsd.graph.codec import array_to_bytes, occupancy_to_png, snapshot_to_json
from irsd.io.keys import RobotKeys
from irsd.io.session import PNG, Query, Session, ZenohSettings, open_session
from irsd.perception.encoder import LabelEncoder
from irsd.sensors.encode import encode_odometry
from nav_bridge.config import BridgeSettings
from nav_bridge.planner import Planner, World
from nav_bridge.search import warm_up

ROOMS, THINGS, SENTENCES, WARM = 200, 10_000, 300, 30
START = (-1.0, 5.0, 0.0)
KEYS = RobotKeys("bench")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calibrate", action="store_true")
    parser.add_argument("--nano", action="store_true", help="buildings are seen with irsd's own eyes")
    parser.add_argument("--seeds", default="1-3")
    parser.add_argument("--folders", nargs="*", type=Path, default=[])
    parser.add_argument("--truth", type=Path, default=Path("../shared/data/small_house"))
    parser.add_argument("--cache", type=Path, default=Path("calibration"), help="keeps the explored buildings")
    parser.add_argument("--write", type=Path, default=None)
    options = parser.parse_args()
    if options.calibrate:
        from goto_calibration import calibrate  # noqa: PLC0415  needs the embedded world

        first, _, last = options.seeds.partition("-")
        seeds = range(int(first), int(last or first) + 1) if options.seeds else range(0)
        table = calibrate(seeds, options.folders, options.truth, options.cache, nano=options.nano)
        print(table)
        if options.write is not None:
            options.write.write_text(table + "\n")
        return
    site = make_site(ROOMS, THINGS, 1)
    print(f"{THINGS} things, {ROOMS} rooms, map of {site.cells.shape[1]} x {site.cells.shape[0]} cells; ms")
    print(f"{'':28s} {'n':>4s} {'p50':>7s} {'p95':>7s} {'p99':>7s} {'max':>7s}")
    in_process(site)
    over_zenoh(site)


def row(name: str, seconds: list[float]) -> None:
    ms = 1e3 * np.array(seconds)
    p50, p95, p99 = np.percentile(ms, [50, 95, 99])
    print(f"{name:28s} {len(ms):4d} {p50:7.1f} {p95:7.1f} {p99:7.1f} {ms.max():7.1f}", flush=True)


def in_process(site: Site) -> None:
    """Parse, resolve, approach and route, without any wire."""
    warm_up()
    planner = Planner(LabelEncoder.load(), BridgeSettings())
    costs = planner.cost_map(site.frame, site.cells)
    begin = time.process_time()
    planner.follow(site.graph)
    print(f"taking in the whole graph: {1e3 * (time.process_time() - begin):.0f} ms of CPU")
    world = World(site.graph, lambda: costs, site.points_of, START)
    wall: list[float] = []
    cpu: list[float] = []
    accepted: list[float] = []
    for k, text in enumerate(sentences(site, SENTENCES + WARM, 2)):
        t, c = time.perf_counter(), time.process_time()
        answer = planner.answer(text, world)
        if k >= WARM:
            wall.append(time.perf_counter() - t)
            cpu.append(time.process_time() - c)
            if answer.status == "resolved":
                accepted.append(cpu[-1])
    row("in process, wall", wall)
    row("in process, CPU", cpu)
    row("in process, resolved, CPU", accepted)


def serve(session: Session, site: Site) -> Callable[[], None]:
    """A stand-in for irsd; returns what sends one odometry message."""
    header = {"resolution_m": site.frame.resolution_m, "origin_xy_m": site.frame.origin_xy_m, "frame": "map", "seq": 1}
    picture, attachment = occupancy_to_png(site.cells), json.dumps(header).encode()
    document = snapshot_to_json(site.graph)

    def points(query: Query) -> None:
        payload, shape = array_to_bytes(site.points_of(query.key.split("/")[-2]))
        query.reply(query.key, payload, attachment=shape)

    session.queryable(KEYS.snapshot, lambda q: q.reply(KEYS.snapshot, document))
    session.queryable(KEYS.occupancy, lambda q: q.reply(KEYS.occupancy, picture, encoding=PNG, attachment=attachment))
    session.queryable(KEYS.points("*"), points)
    turn = np.array([0.0, 0.0, 0.0, 1.0])
    count = iter(range(1, 10**9))

    def beat() -> None:
        sample = OdomSample(next(count) * 50_000_000, "odom", "base_link", np.array([*START[:2], 0.0]), turn)
        session.put("odom", encode_odometry(sample))

    return beat


def over_zenoh(site: Site) -> None:
    """From the question of one process to the answer of another: accepted, and the drive has begun."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder) / "nav.yaml"
        config.write_text("robot: bench\nzenoh: {connect: []}\n")
        with open_session(ZenohSettings(endpoint=endpoint, connect=()), "hub") as session:
            beat = serve(session, site)
            environment = {**os.environ, "XDG_STATE_HOME": folder}
            command = [sys.executable, "-m", "nav_bridge", "--config", str(config), "--endpoint", endpoint]
            bridge = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
            try:
                ask_all(session, site, beat, bridge.pid)
            finally:
                bridge.terminate()
                bridge.wait()


def ask_all(session: Session, site: Site, beat: Callable[[], None], bridge_pid: int) -> None:
    def ask(text: str) -> dict[str, Any]:
        beat()
        replies = session.get(KEYS.nav("goto"), timeout_s=30.0, payload=json.dumps({"query": text}).encode())
        return dict(json.loads(replies[0].payload)) if replies else {"error": "no reply"}

    def cpu_s() -> float:
        """Of both processes; Linux names the CPU clock of another process by its number's complement."""
        return time.process_time() + time.clock_gettime((~bridge_pid << 3) | 2)

    deadline = monotonic_s() + 60.0
    while "error" in ask("elephant"):
        if monotonic_s() > deadline:
            raise SystemExit("nav_bridge does not answer")
        time.sleep(0.2)
    wall: list[float] = []
    cpu: list[float] = []
    accepted: list[int] = []
    for k, text in enumerate(sentences(site, SENTENCES + WARM, 2)):
        begin, begin_cpu = time.perf_counter(), cpu_s()
        answer = ask(text)
        if k < WARM:
            continue
        wall.append(time.perf_counter() - begin)
        cpu.append(cpu_s() - begin_cpu)
        if answer.get("status") == "resolved":
            accepted.append(len(wall) - 1)
    row("over zenoh, wall", wall)
    row("over zenoh, accepted, wall", [wall[k] for k in accepted])
    row("over zenoh, accepted, CPU", [cpu[k] for k in accepted])


if __name__ == "__main__":
    main()
