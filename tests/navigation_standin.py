"""A stand-in for irsd and the robot round a real nav_bridge process, for the tests of nav_bridge."""

from __future__ import annotations

import json
import math
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import navigation_house as house
import numpy as np

from irsd.core.runtime import Ring, monotonic_s
from irsd.core.types import OdomSample
from irsd.graph.codec import array_to_bytes, delta_to_json, occupancy_to_png, snapshot_to_json
from irsd.graph.model import GraphDelta
from irsd.io.keys import RobotKeys
from irsd.io.session import PNG, Handle, Query, Sample, Session, ZenohSettings, open_session
from irsd.sensors.encode import encode_odometry
from irsd.sim.orders import Orders

KEYS = RobotKeys("bot")
PATIENCE_S = 40.0
STEP_M = 0.06  # per odometry message


class StandIn:
    """irsd (graph, map, points) and the robot (odometry, follows waypoints, never faster than STEP_M a step), in one."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.pose = [2.5, 3.0, 0.0]
        self.way: list[list[float]] = []
        self.silent = self.stalled = False
        self.waypoints: Ring[Sample] = Ring(16)
        self.states: Ring[Sample] = Ring(256)
        self.more_points: dict[str, Any] = {}
        self.stops = self.held = 0
        self.orders = Orders()
        self.graph = house.GRAPH
        self.cells = house.occupancy()
        self._count = 0
        self._token: Handle | None = None
        self._deltas = session.history_publisher(KEYS.delta)
        session.subscribe(KEYS.nav("waypoints"), self.waypoints)
        session.subscribe(KEYS.nav("state"), self.states)
        session.queryable(KEYS.snapshot, lambda q: q.reply(KEYS.snapshot, snapshot_to_json(self.graph)))
        session.queryable(KEYS.occupancy, self._map)
        session.queryable(KEYS.points("*"), self._points)

    def _map(self, query: Query) -> None:
        header = {
            "resolution_m": house.FRAME.resolution_m,
            "origin_xy_m": house.FRAME.origin_xy_m,
            "frame": "map",
            "seq": 1,
        }
        query.reply(KEYS.occupancy, occupancy_to_png(self.cells), encoding=PNG, attachment=json.dumps(header).encode())

    def _points(self, query: Query) -> None:
        name = query.key.split("/")[-2]
        payload, attachment = array_to_bytes(self.more_points.get(name, house.points_of(name)))
        query.reply(query.key, payload, attachment=attachment)

    def irsd_lives(self, lives: bool) -> None:
        """Shows or withdraws irsd's token."""
        if lives and self._token is None:
            self._token = self.session.announce(KEYS.alive)
        elif not lives and self._token is not None:
            self._token.close()
            self._token = None

    def publish_delta(self, delta: GraphDelta) -> None:
        self._deltas.put(delta_to_json(delta))

    def step(self) -> None:
        """One odometry message; a step along the way first."""
        for sample in self.waypoints.drain():
            way = self.orders.hear(sample.payload, sample.received_ns * 1e-9)
            if way is not None:
                self.way = way.points
                self.stops += not way.points
        if self.orders.overdue(monotonic_s()):
            self.way, self.held = [], self.held + 1
        left = 0.0 if self.stalled else STEP_M
        while self.way and left > 0:
            x, y, yaw = self.way[0]
            away = math.hypot(x - self.pose[0], y - self.pose[1])
            if away <= left:
                self.pose, left = [x, y, yaw], left - away
                self.way.pop(0)
            else:
                share = left / away
                self.pose[0] += share * (x - self.pose[0])
                self.pose[1] += share * (y - self.pose[1])
                left = 0.0
        self._count += 1
        if not self.silent:
            turn = np.array([0, 0, math.sin(self.pose[2] / 2), math.cos(self.pose[2] / 2)])
            sample = OdomSample(self._count * 50_000_000, "odom", "base_link", np.array([*self.pose[:2], 0.0]), turn)
            self.session.put("odom", encode_odometry(sample))

    def ask(self, name: str, document: dict[str, Any]) -> dict[str, Any]:
        """The answer to a request; odometry goes on meanwhile."""
        replies = self.session.get(KEYS.nav(name), timeout_s=PATIENCE_S, payload=json.dumps(document).encode())
        assert replies, "nobody answers"
        answer: dict[str, Any] = json.loads(replies[0].payload)
        return answer

    def drive_until(self, done: Callable[[dict[str, Any]], bool]) -> list[dict[str, Any]]:
        """Steps the robot until a state fits; all states on the way there."""
        seen: list[dict[str, Any]] = []
        deadline = monotonic_s() + PATIENCE_S
        while monotonic_s() < deadline:
            self.step()
            sample = self.states.get(0.02)
            if sample is not None:
                seen.append(json.loads(sample.payload))
                if done(seen[-1]):
                    return seen
        raise AssertionError(f"no such state; seen: {seen}")

    def goto(self, query: str, **more: Any) -> dict[str, Any]:
        """A goal, after fresh odometry."""
        for _ in range(3):
            self.step()
        return self.ask("goto", {"query": query, **more})


def ready(stand_in: StandIn, query: str) -> dict[str, Any]:
    """The answer, once the bridge has heard graph and odometry."""
    deadline = monotonic_s() + PATIENCE_S
    while monotonic_s() < deadline:
        answer = stand_in.goto(query)
        if "error" not in answer:
            return answer
    raise AssertionError(answer)


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


class BridgeProcess:
    """nav_bridge as a process."""

    def __init__(self, stand_in: StandIn, endpoint: str, config: Path) -> None:
        self._stand_in = stand_in
        self.state, self.endpoint = config.parent / "state", endpoint
        self._command = [sys.executable, "-m", "nav_bridge", "--config", str(config), "--endpoint", endpoint]
        self.start()

    def start(self) -> None:
        """Until it announces itself."""
        self.process = subprocess.Popen(self._command, stderr=subprocess.PIPE, text=True)
        deadline = monotonic_s() + PATIENCE_S
        session = self._stand_in.session
        while not session.find_alive(KEYS.nav("alive")) and self.process.poll() is None and monotonic_s() < deadline:
            self._stand_in.step()

    def kill(self) -> None:
        """As the kernel would."""
        self.process.kill()
        self.process.wait()
        if self.process.stderr is not None:
            self.process.stderr.close()

    def stop(self) -> None:
        """Politely; it must end well and have logged no traceback."""
        self.process.send_signal(signal.SIGTERM)
        _, log = self.process.communicate(timeout=PATIENCE_S)
        assert self.process.returncode == 0, log
        assert "Traceback" not in log, log


@contextmanager
def running(folder: Path, settings: str) -> Iterator[tuple[StandIn, BridgeProcess]]:
    """Stand-in and bridge, with these settings; the bridge must end well."""
    config, endpoint = folder / "nav.yaml", free_endpoint()
    config.write_text(f"robot: bot\nstate_directory: {folder / 'state'}\nzenoh: {{connect: []}}\n" + settings)
    with open_session(ZenohSettings(endpoint=endpoint, connect=()), "hub") as session:
        stand_in = StandIn(session)
        bridge = BridgeProcess(stand_in, endpoint, config)
        try:
            yield stand_in, bridge
            bridge.stop()
        finally:
            bridge.kill()
