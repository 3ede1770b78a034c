"""irsctl demo: irsd, nav_bridge and the embedded world as separate processes; explore, build the graph, drive to the TV."""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np

from irsd.core.errors import IrsdError
from irsd.core.runtime import Ring, monotonic_s, sleep_s
from irsd.ctl import drive, edits, live
from irsd.ctl.link import Target, ask, connected
from irsd.graph.codec import snapshot_from_json
from irsd.io.endpoints import ZenohSettings, with_environment
from irsd.io.messages import Sample
from irsd.io.session import Session, open_session

ROBOT = "demo"
START_LIMIT_S = 60.0
EXPLORE_LIMIT_S = 200.0
SETTLE_S = 3.0
ARRIVAL_M = 0.5


class DemoError(IrsdError):
    """Something fell short; the message says what, and where the log is."""


@dataclass(slots=True)
class Programs:
    """The three programs of the demo, each with its log in the output folder."""

    folder: Path
    endpoint: str
    running: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    def start(self, name: str, *command: str) -> None:
        """Start ``python -m command`` as a process of its own."""
        environment = {**os.environ, "IRSD_ENDPOINT": self.endpoint, "IRSD_CONNECT": "", "OMP_NUM_THREADS": "1"}
        with (self.folder / f"{name}.log").open("wb") as log:
            self.running[name] = subprocess.Popen(
                [sys.executable, "-m", *command], stdout=log, stderr=log, env=environment
            )

    def check(self) -> None:
        """Raises DemoError when one of them has ended."""
        for name, process in self.running.items():
            if process.poll() is not None:
                log = self.folder / f"{name}.log"
                tail = "\n".join(log.read_text(errors="replace").splitlines()[-15:])
                raise DemoError(f"{name} ended with exit code {process.returncode}; the end of {log}:\n{tail}")

    def stop(self) -> None:
        """End all of them, the world first, politely and then for good."""
        for process in reversed(self.running.values()):
            process.send_signal(signal.SIGTERM)
        for process in self.running.values():
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10)
            process.kill()


def run(folder: Path, seed: int, query: str, detector: bool) -> int:
    """The whole demo; returns the exit code, 0 only if the robot stands within 0.5 m of the target.

    detector: the world's simulated detector sees, in place of irsd's own networks. Without it rooms are named as their operator would
    name them; what things are called is what irsd sees.
    """
    folder.mkdir(parents=True, exist_ok=True)
    began_s = monotonic_s()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    target = Target(ROBOT, endpoint, 5.0)
    programs = Programs(folder, endpoint)
    try:
        click.echo(f"starting irsd, nav_bridge and the world (seed {seed}) on {endpoint}; logs in {folder}/")
        programs.start("irsd", "irsd", "--robot", ROBOT, "--no-store")
        programs.start("nav_bridge", "nav_bridge", "--robot", ROBOT)
        truth = folder / "truth.json"
        blind = () if detector else ("--no-detections",)
        world = ("irsd.sim", "--robot", ROBOT, "--seed", str(seed), "--truth", str(truth), *blind)
        with _session(target) as session:
            _wait_until_up(session, programs)
            programs.start("world", *world)
            _explore(session, programs)
        if not detector:
            _name_rooms(target, json.loads(truth.read_text()))
        click.echo("\nirsctl tree")
        live.tree(target, False)
        click.echo(f'\nirsctl goto "{query}"')
        code, answer = drive.go(target, query)
        programs.check()
        live.plan(target, folder / "plan.svg", False)
        live.plan(target, folder / "plan.png", False)
        if code:
            raise DemoError(f'goto "{query}" ended with exit code {code}; see {folder}/nav_bridge.log')
        _check_against_truth(target, json.loads(truth.read_text()), str(answer["target"]["label"]))
        click.echo(f"done in {monotonic_s() - began_s:.0f} s")
        return 0
    except IrsdError as error:
        click.echo(f"demo failed: {error}", err=True)
        return 1
    finally:
        programs.stop()


@contextlib.contextmanager
def _session(target: Target) -> Iterator[Session]:
    """A peer session, which may be opened before irsd listens."""
    with open_session(with_environment(ZenohSettings(connect=()), target.endpoint), "peer") as session:
        yield session


def _wait_until_up(session: Session, programs: Programs) -> None:
    """Until irsd and nav_bridge both announce themselves."""
    deadline_s = monotonic_s() + START_LIMIT_S
    wanted = {f"irs/{ROBOT}/alive": "irsd", f"irs/{ROBOT}/nav/alive": "nav_bridge"}
    while monotonic_s() < deadline_s:
        programs.check()
        missing = [name for key, name in wanted.items() if not session.find_alive(key, timeout_s=0.5)]
        if not missing:
            return
    raise DemoError(f"not up within {START_LIMIT_S:g} s: {', '.join(missing)}")


def _explore(session: Session, programs: Programs) -> None:
    """Until the world says that the robot has seen everything; prints how it goes."""
    states: Ring[Sample] = Ring(16)
    statuses: Ring[Sample] = Ring(4)
    graph: dict[str, Any] = {}
    began_s, shown_s = monotonic_s(), 0.0
    with session.subscribe(f"irs/{ROBOT}/sim/state", states), session.subscribe(f"irs/{ROBOT}/status", statuses):
        while monotonic_s() - began_s < EXPLORE_LIMIT_S:
            programs.check()
            for sample in statuses.drain():
                graph = json.loads(sample.payload).get("graph", {})
            sample_or_none = states.get(timeout_s=0.5)
            if sample_or_none is None:
                continue
            state = json.loads(sample_or_none.payload)
            elapsed_s = monotonic_s() - began_s
            if elapsed_s - shown_s >= 5.0:
                shown_s = elapsed_s
                _progress(elapsed_s, state, graph)
            if state["phase"] == "idle":
                sleep_s(SETTLE_S)  # irsd works off the last frames and settles the map
                return
    raise DemoError(f"the robot is not done exploring after {EXPLORE_LIMIT_S:g} s; see the world's log")


def _name_rooms(target: Target, truth: dict[str, Any]) -> None:
    """What an operator does once at a new site: each room gets its name from who knows the building."""
    with connected(target) as (session, keys):
        snapshot = snapshot_from_json(ask(session, keys.snapshot, target.timeout_s))
    for true in truth["rooms"]:
        low, high = np.min(true["polygon"], axis=0), np.max(true["polygon"], axis=0)
        middle = [float(v) for v in (low + high) / 2]
        for room in snapshot.rooms:
            if cv2.pointPolygonTest(np.array(room.polygon_xy, np.float32), middle, False) >= 0:
                click.echo(f'irsctl teach --room {room.id} "{true["label"]}"')
                edits.edit(target, False, "teach", room.id, true["label"])


def _check_against_truth(target: Target, truth: dict[str, Any], label: str) -> None:
    """The robot's true place against the true things of that name, which irsd and nav_bridge never saw."""
    states: Ring[Sample] = Ring(4)
    with _session(target) as session, session.subscribe(f"irs/{ROBOT}/sim/state", states):
        sample = states.get(timeout_s=10.0)
    if sample is None:
        raise DemoError("the world no longer says where the robot is; see the world's log")
    state = json.loads(sample.payload)
    x, y, _ = state["true_pose"]
    things = [t for t in truth["instances"] if label in (t["label"], *t["synonyms"])]
    away_m = min((_plan_distance(x, y, t["aabb_min"], t["aabb_max"]) for t in things), default=math.inf)
    if away_m > ARRIVAL_M or state["collisions"]:
        raise DemoError(
            f"the robot truly stands {away_m:.2f} m from the nearest {label}, with {state['collisions']} collisions"
        )
    click.echo(f"checked against the world's truth: {away_m:.2f} m from a {label}, no collision")


def _plan_distance(x: float, y: float, low: Sequence[float], high: Sequence[float]) -> float:
    """Distance in the plan from a place to an upright box between two corners [3]."""
    return math.hypot(max(low[0] - x, 0.0, x - high[0]), max(low[1] - y, 0.0, y - high[1]))


def _progress(elapsed_s: float, state: dict[str, Any], graph: dict[str, Any]) -> None:
    click.echo(
        f"[{elapsed_s:4.0f} s] {state['phase']} {100 * state['progress']:3.0f} %   "
        f"rooms {graph.get('rooms', 0):2d}   things {graph.get('instances', 0):3d}"
    )
