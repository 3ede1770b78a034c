"""kill -9 of whoever takes part in a drive, all of them real processes: the vehicle holds, and no goal is left without an end."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from navigation_standin import PATIENCE_S, StandIn, free_endpoint, ready, running

from irsd.core.runtime import Ring, Worker, monotonic_s, sleep_s
from irsd.graph.codec import snapshot_from_json
from irsd.io.keys import RobotKeys
from irsd.io.session import Sample, Session, ZenohSettings, open_session

LOADED_S = 3.0  # a tenth of it on an idle machine; the least that a loaded one must keep
TESTS = Path(__file__).resolve().parents[1]


class Program:
    """A stand-in as a process; its lines of JSON arrive in a ring."""

    def __init__(self, name: str, *arguments: str) -> None:
        command = [sys.executable, str(TESTS / name), *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.lines: Ring[dict[str, Any]] = Ring(4096)
        self._reader = Worker(name, self._read).start()

    def _read(self) -> None:
        for line in self.process.stdout or ():
            self.lines.put(json.loads(line))

    def until(self, fits: Callable[[dict[str, Any]], Any], step: Callable[[], None]) -> tuple[dict[str, Any], float]:
        """The first line that fits, and how long it took; ``step`` goes on meanwhile."""
        began_s = monotonic_s()
        while monotonic_s() < began_s + PATIENCE_S:
            step()
            for line in self.lines.drain():
                if fits(line):
                    return line, monotonic_s() - began_s
            sleep_s(0.01)
        raise AssertionError("no such line")

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()
        self._reader.join(PATIENCE_S)
        if self.process.stdout is not None:
            self.process.stdout.close()


@contextmanager
def program(name: str, *arguments: str) -> Iterator[Program]:
    one = Program(name, *arguments)
    try:
        yield one
    finally:
        one.kill()


@pytest.mark.parametrize("form", ["bridge", "rmw"])
def test_nav2s_goal_ends_with_the_bridge_and_the_bridges_with_nav2(tmp_path: Path, form: str) -> None:
    settings = f"sinks: {{action: navigate_to_pose, form: {form}, namespace: /bot1, domain: 3}}\n"
    with (
        running(tmp_path, settings) as (world, bridge),
        program("nav2_standin.py", bridge.endpoint, form, "navigate_to_pose") as nav2,
    ):
        nav2.until(lambda line: "up" in line, world.step)
        world.stalled = True  # it is Nav2 who would drive
        goal = ready(world, "fridge")["goal_id"]
        first, _ = nav2.until(lambda line: "goal" in line, world.step)
        sleep_s(0.3)
        bridge.kill()
        cancelled, after_s = nav2.until(lambda line: "cancel" in line, lambda: None)
        assert cancelled["cancel"] == first["goal"]
        assert after_s <= LOADED_S
        bridge.start()
        second, _ = nav2.until(lambda line: "goal" in line, world.step)
        assert second["goal"] != first["goal"]
        world.drive_until(lambda s: s["state"] == "driving" and s["goal_id"] == goal)
        nav2.kill()
        failed = world.drive_until(lambda s: s["state"] == "failed")[-1]
        assert failed["goal_id"] == goal
        assert failed["reason"].startswith("vehicle: Nav2 is gone")


def driven(world: StandIn) -> str:
    """The id of a goal that is under way: until the bridge has heard the vehicle, goals fail at once."""
    deadline_s = monotonic_s() + PATIENCE_S
    while monotonic_s() < deadline_s:
        goal = str(ready(world, "fridge")["goal_id"])
        world.drive_until(lambda s: s["goal_id"] == goal and s["state"] in ("driving", "failed"))  # noqa: B023
        for _ in range(20):
            world.step()
            sleep_s(0.02)
        if "failed" not in {json.loads(sample.payload)["state"] for sample in world.states.drain()}:
            return goal
    raise AssertionError("no goal is driven")


def test_a_mavlink_vehicle_holds_without_the_bridge_and_the_goal_fails_without_the_vehicle(tmp_path: Path) -> None:
    pytest.importorskip("pymavlink")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    settings = f"sinks: {{mavlink: {{url: 'udpin://127.0.0.1:{port}'}}}}\n"
    with program("mavlink_vehicle.py", str(port)) as vehicle, running(tmp_path, settings) as (world, bridge):
        world.stalled = True
        vehicle.until(lambda line: True, world.step)
        goal = driven(world)
        vehicle.until(lambda line: line["offboard"], world.step)
        bridge.kill()
        _, after_s = vehicle.until(lambda line: line["hold"], lambda: None)
        assert after_s <= LOADED_S
        bridge.start()
        states = world.drive_until(lambda s: s["state"] in ("driving", "failed"))
        assert states[-1]["goal_id"] == goal
        if states[-1]["state"] == "driving":
            vehicle.kill()
            states = world.drive_until(lambda s: s["state"] == "failed")
        assert states[-1]["reason"].startswith("vehicle: ")
        world.ask("cancel", {})


class Trio:
    """irsd, nav_bridge and the embedded world as processes; a robot that stands in a corridor and drives slowly."""

    def __init__(self, folder: Path) -> None:
        self.endpoint, self.folder = free_endpoint(), folder
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        config = folder / "nav.yaml"
        config.write_text(f"state_directory: {folder / 'nav'}\ndrive: {{patience_s: 30.0}}\n")
        self.commands = {
            "irsd": ("irsd", "--robot", "bot", "--state", str(folder / "irsd")),
            "nav": ("nav_bridge", "--robot", "bot", "--config", str(config)),
            "world": ("irsd.sim", "--robot", "bot", "--seed", "4", "--no-explore", "--speed", "0.25"),
        }

    def start(self, name: str) -> None:
        environment = {**os.environ, "IRSD_ENDPOINT": self.endpoint, "IRSD_CONNECT": "", "OMP_NUM_THREADS": "1"}
        with (self.folder / f"{name}.log").open("ab") as log:
            command = [sys.executable, "-m", *self.commands[name]]
            self.running[name] = subprocess.Popen(command, env=environment, stdout=log, stderr=log)

    def kill(self, name: str) -> None:
        self.running[name].kill()
        self.running[name].wait()


def newest(ring: Ring[Sample], fits: Callable[[dict[str, Any]], Any], patience_s: float = 90.0) -> dict[str, Any]:
    """The next document that fits."""
    deadline_s = monotonic_s() + patience_s
    while monotonic_s() < deadline_s:
        sample = ring.get(0.5)
        if sample is not None and fits(document := json.loads(sample.payload)):
            return dict(document)
    raise AssertionError("nothing that fits was said")


def far_goal(session: Session, keys: RobotKeys) -> str:
    """The id of a goal two metres away or more, as soon as irsd knows of one."""
    deadline_s = monotonic_s() + 90.0
    while monotonic_s() < deadline_s:
        sleep_s(1.0)
        replies = session.get(keys.snapshot)
        things = snapshot_from_json(replies[0].payload).instances if replies and replies[0].ok else ()
        for label in {thing.label for thing in things if thing.centroid_m[0] > 2.5}:
            ask = json.dumps({"query": f"farthest {label}", "within_m": 1.0}).encode()
            told = session.get(keys.nav("why"), timeout_s=20.0, payload=ask)
            if told and told[0].ok and len(json.loads(told[0].payload)["waypoints"]) > 3:
                told = session.get(keys.nav("goto"), timeout_s=20.0, payload=ask)
                return str(json.loads(told[0].payload)["goal_id"])
    raise AssertionError("nothing far away was seen")


@pytest.mark.timeout(280)
@pytest.mark.parametrize("victim", ["irsd", "nav"])
def test_the_real_three_survive_a_kill(tmp_path: Path, victim: str) -> None:
    keys, trio = RobotKeys("bot"), Trio(tmp_path)
    moves: Ring[Sample] = Ring(512)
    states: Ring[Sample] = Ring(512)
    try:
        for name in trio.commands:
            trio.start(name)
        with open_session(ZenohSettings(endpoint=trio.endpoint, connect=()), "peer") as session:
            session.subscribe(keys.key("sim/state"), moves)
            session.subscribe(keys.nav("state"), states)
            goal = far_goal(session, keys)
            newest(moves, lambda s: s["phase"] == "driving")
            trio.kill(victim)
            died_s = monotonic_s()
            moves.drain()
            stands = newest(moves, lambda s: s["phase"] == "idle")
            assert monotonic_s() - died_s <= LOADED_S
            states.drain()
            trio.start(victim)
            end = newest(states, lambda s: s["goal_id"] == goal and s["state"] in ("reached", "failed"))
            assert end["state"] == "reached" or end["reason"], end
            moves.drain()
            last = newest(moves, lambda s: s["phase"] == "idle")
            assert last["collisions"] == 0
            if end["state"] == "reached":
                assert last["true_pose"] != stands["true_pose"]
            assert json.loads(session.get(keys.nav("cancel"), payload=b"{}")[0].payload)["goal_id"] is None
    finally:
        for name in trio.running:
            trio.kill(name)
