"""Closed loop: random goals in seeded buildings of the embedded world, from a sentence to a robot that stands there.

    python benchmarks/closed_loop.py [--seeds 1-10] [--goals 10] [--json FILE]

Robot, irsd's pipeline and nav_bridge run in one process on simulated time, and talk over real zenoh. irsd explores each building by
the simulated sensors and goes on mapping while the robot drives; nothing is told to it but odometry, sweeps and noisy detections.
Goals are drawn from the true things. A room is named only where a name alone does not say which thing is meant: by its true kind, or
by its id where irsd calls it something else (a person would read that in ``irsctl tree``). The judge alone knows the truth: where
the robot stands (plan distance from its centre to the true surface), whether its body ever met something (at every step of 20 ms),
and how near a body with its clearance can get at all. Things that nobody can come within 0.45 m of are asked for as well, but not
counted: refused or reached is right for them, nothing else. Ways are compared with the shortest on the true map between the same
two places.
"""

from __future__ import annotations

import argparse
import json
import socket
import statistics
import sys
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from closed_loop_truth import CLEARANCE_M, SURE_M, Goal, Truth

from irsd.config import IrsdConfig
from irsd.core.geometry import Pose, pose_from_xy_yaw
from irsd.core.runtime import Guarded, Mailbox, Ring, Worker, sleep_s, use_clock
from irsd.ingest import SensorDecoder
from irsd.io.keys import RobotKeys
from irsd.io.localisation import LocalisationPublisher
from irsd.io.publishers import GraphPublisher
from irsd.io.session import Reply, Sample, Session, ZenohSettings, open_session
from irsd.perception.encoder import LabelEncoder
from irsd.pipeline import MapPipeline
from irsd.sensors.sync import Synchronizer
from irsd.sim.__main__ import Robot2Zenoh
from irsd.sim.space import ROBOT_RADIUS_M
from irsd.sim.world import ODOM_TOPIC, World
from nav_bridge.bridge import Bridge
from nav_bridge.config import BridgeSettings
from nav_bridge.search import warm_up

TICK_S = 0.02
PACE = 4.0  # simulated seconds per second at most: zenoh's threads must keep up
ARRIVAL_M = 0.5
EXPLORE_LIMIT_S, GOAL_LIMIT_S, SETTLE_S = 400.0, 240.0, 3.0
FINAL = ("reached", "failed", "cancelled", "preempted")


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a goal. verdict: reached, refused (truly) or wrong; distance_m, best_m, shortest_m by the truth."""

    seed: int
    query: str
    best_m: float
    verdict: str
    state: str
    reason: str
    distance_m: float
    measured_m: float | None
    planned_m: float | None
    driven_m: float
    shortest_m: float | None
    took_s: float
    plans: int
    target: str


class Loop:
    """Robot, irsd and nav_bridge of one building, on one clock."""

    def __init__(self, seed: int, stack: ExitStack, encoder: LabelEncoder) -> None:
        config = IrsdConfig(robot="loop")
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
        zenoh = ZenohSettings(endpoint=endpoint, connect=())
        self._hub = stack.enter_context(open_session(zenoh, "hub"))
        peer: Session = stack.enter_context(open_session(zenoh, "peer"))
        self.keys = RobotKeys(config.robot)
        self.world = World(seed)
        use_clock(lambda: self.world.now_ns)
        stack.callback(use_clock, None)
        self._robot = Robot2Zenoh(self._hub, config.robot, None)
        stack.callback(self._robot.close)
        self._decoder, self._sync = SensorDecoder(config.ingest), Synchronizer(config.sync)
        pipeline = MapPipeline(config.pipeline, encoder, map_id=f"building-{seed}")
        self._irsd = Guarded(pipeline)
        self._publisher = GraphPublisher(self._hub, self.keys, pipeline.snapshot(), self._arrays, self._grid)
        stack.callback(self._publisher.close)
        self._places = LocalisationPublisher(self._hub, self.keys, pipeline.snapshot().frame)
        stack.callback(self._places.close)
        self.map_T_odom: Pose = np.eye(4)
        self._publisher.announce()
        settings = replace(BridgeSettings(), robot=config.robot)
        settings = replace(
            settings,
            drive=replace(settings.drive, review_s=settings.drive.review_s / PACE),
            route=replace(settings.route, robot_radius_m=ROBOT_RADIUS_M, clearance_m=CLEARANCE_M),
        )
        self._bridge = Bridge(peer, settings, encoder)
        stack.callback(self._bridge.close)
        self.states: Ring[Sample] = Ring(256)
        self._hub.subscribe(self.keys.nav("state"), self.states)
        self.driven_m, self.least_m, self.deepest_m = 0.0, np.inf, 0.0
        self.graph = pipeline.snapshot()

    def _arrays(self, instance: str) -> Any:
        with self._irsd.locked() as pipeline:
            return pipeline.arrays().get(instance)

    def _grid(self) -> Any:
        with self._irsd.locked() as pipeline:
            return pipeline.navigation_grid()

    def tick(self) -> None:
        """20 ms: the robot moves, irsd takes in what is sensed, nav_bridge thinks."""
        began_s = time.perf_counter()
        way = self._robot.new_waypoints()
        if way is not None:
            self.world.follow(*way)
        self.world.map_T_odom = self._robot.map_T_odom
        before = self.world.robot.pose[:2]
        for message in self.world.step(TICK_S):
            if message.topic == ODOM_TOPIC:
                self._robot.send(message)
            for sensed in self._decoder.decode(message.topic, message.data):
                self._sync.push(sensed)
        here = self.world.robot.pose[:2]
        self.driven_m += float(np.hypot(*(here - before)))
        self.least_m = min(self.least_m, float(self.world.building.obstacles.distance(here[None])[0]))
        for frame in self._sync.pop():
            with self._irsd.locked() as pipeline:
                result = pipeline.step(frame)
            if result.where is not None:
                self._places.publish(result.where)
                self.map_T_odom = result.where.map_T_odom
            self.graph = result.snapshot
            if result.delta is not None:
                self._publisher.publish(result.delta, result.snapshot)
        self._bridge.step(self.world.now_ns)
        sleep_s(max(0.0, TICK_S / PACE - (time.perf_counter() - began_s)))

    def run(self, seconds: float) -> None:
        """Lets time pass."""
        end_ns = self.world.now_ns + int(seconds * 1e9)
        while self.world.now_ns < end_ns:
            self.tick()

    def ask(self, query: str) -> dict[str, Any]:
        """nav_bridge's answer to a goal; time goes on meanwhile."""
        box: Mailbox[list[Reply]] = Mailbox()
        payload = json.dumps({"query": query}).encode()
        Worker("ask", lambda: box.put(self._hub.get(self.keys.nav("goto"), timeout_s=30.0, payload=payload))).start()
        while (replies := box.get(0.0)) is None:
            self.tick()
        if not replies:
            raise RuntimeError("nav_bridge does not answer")
        return dict(json.loads(replies[0].payload)) if replies[0].ok else {"status": "error", "text": replies[0].error}

    def final_state(self, goal_id: str) -> dict[str, Any]:
        """How a drive ended."""
        end_ns = self.world.now_ns + int(GOAL_LIMIT_S * 1e9)
        while self.world.now_ns < end_ns:
            self.tick()
            for sample in self.states.drain():
                state = dict(json.loads(sample.payload))
                if state["goal_id"] == goal_id and state["state"] in FINAL:
                    return state
        return {"state": "no end", "reason": f"after {GOAL_LIMIT_S:g} s", "plans": 0, "distance_m": None}


def judge(loop: Loop, truth: Truth, goal: Goal, seed: int) -> Outcome:
    """One goal, from the question to where the robot stands."""
    start, began_ns, driven_m = loop.world.robot.pose[:2].copy(), loop.world.now_ns, loop.driven_m
    answer = loop.ask(goal.query)
    state = {"state": answer["status"], "reason": answer.get("text", ""), "plans": 0, "distance_m": None}
    planned = None
    if answer["status"] == "resolved":
        way = np.array(answer["waypoints"])[:, :2]
        planned = float(np.hypot(*np.diff(way, axis=0).T).sum())
        state = loop.final_state(str(answer["goal_id"]))
        loop.run(0.5)
    here = loop.world.robot.pose[:2]
    distance = min(float(truth.distance(number, here[None])[0]) for number in goal.accepted)
    verdict = "wrong"
    if state["state"] == "reached" and distance <= ARRIVAL_M:
        verdict = "reached"
    elif not goal.possible and (
        state["state"] == "unreachable" or state["reason"].startswith(("too far", "blocked: the nearest"))
    ):
        verdict = "refused"
    target = answer.get("target") or {}
    return Outcome(
        seed, goal.query, round(goal.best_m, 3), verdict, state["state"], state["reason"], round(distance, 3), state["distance_m"],
        planned, loop.driven_m - driven_m, truth.shortest_m(start, here), (loop.world.now_ns - began_ns) * 1e-9,
        int(state["plans"]), f"{target.get('instance')} {target.get('label')}",
    )  # fmt: skip


def run_building(seed: int, goals: int, encoder: LabelEncoder) -> tuple[list[Outcome], dict[str, Any]]:
    """One building: explore it, then its goals one after the other."""
    wall_s = time.perf_counter()
    with ExitStack() as stack:
        loop = Loop(seed, stack, encoder)
        while loop.world.phase == "exploring":
            if (loop.world.now_ns - loop.world.start_ns) * 1e-9 > EXPLORE_LIMIT_S:
                raise RuntimeError(f"building {seed} is not explored after {EXPLORE_LIMIT_S:g} s")
            loop.tick()
        loop.run(SETTLE_S)
        explored_s = (loop.world.now_ns - loop.world.start_ns) * 1e-9
        truth = Truth(loop.world.building)
        outcomes = []
        for goal in truth.goals(lambda: loop.graph, goals, np.random.default_rng([seed, 2026])):
            outcomes.append(judge(loop, truth, goal, seed))
            show(outcomes[-1])
        robot = loop.world.robot
        believed = loop.map_T_odom @ pose_from_xy_yaw(*robot.odometry)
        off_m = float(np.hypot(*(robot.pose[:2] - believed[:2, 3])))
        drift_m = float(np.hypot(*(robot.pose[:2] - robot.odometry[:2])))
        simulated_s = (loop.world.now_ns - loop.world.start_ns) * 1e-9
        summary = {
            "seed": seed, "explored_s": round(explored_s, 1), "things": len(loop.graph.instances), "collisions": robot.collisions,
            "least_clearance_m": round(loop.least_m - ROBOT_RADIUS_M, 3), "drift_m": round(drift_m, 3), "off_m": round(off_m, 3),
            "driven_m": round(loop.driven_m, 1), "simulated_s": round(simulated_s, 1),
            "speed_x": round(simulated_s / (time.perf_counter() - wall_s), 2),
        }  # fmt: skip
    print(summary, flush=True)
    return outcomes, summary


def show(outcome: Outcome) -> None:
    """A line per goal, as it ends."""
    print(
        f"{outcome.seed:3d} {outcome.verdict:8s} {outcome.distance_m:5.2f} m  {outcome.query}: {outcome.target}, "
        f"{outcome.state} {outcome.reason}  [{outcome.driven_m:.1f} m, {outcome.took_s:.0f} s, {outcome.plans} plans]",
        flush=True,
    )


def table(outcomes: list[Outcome], summaries: list[dict[str, Any]]) -> list[str]:
    """The figures of all buildings together; printed, and returned for the JSON file."""
    possible = [outcome for outcome in outcomes if outcome.best_m <= SURE_M]
    verdicts = Counter(outcome.verdict for outcome in possible)
    beyond = Counter(outcome.verdict for outcome in outcomes if outcome.best_m > SURE_M)
    reached = [outcome for outcome in outcomes if outcome.verdict == "reached"]
    long_enough = [o for o in reached if o.shortest_m is not None and o.planned_m is not None and o.shortest_m >= 1.0]
    ratios = {
        name: statistics.median(getattr(o, name) / o.shortest_m for o in long_enough) if long_enough else float("nan")
        for name in ("planned_m", "driven_m")
    }
    away = sorted(outcome.distance_m for outcome in reached)
    rows: list[tuple[str, Any, str]] = [
        ("goals that can be reached", len(possible), ""),
        ("reached within 0.5 m by true pose", verdicts["reached"], f">= {0.97 * len(possible):.0f}"),
        ("anything else", verdicts["wrong"], ""),
        ("asked for besides, out of reach or on its edge", sum(beyond.values()), ""),
        ("refused or reached, and truly so", beyond["refused"] + beyond["reached"], ""),
        ("anything else", beyond["wrong"], "0"),
        ("collisions", sum(s["collisions"] for s in summaries), "0"),
        ("least distance of the body to anything, m", min(s["least_clearance_m"] for s in summaries), ">= 0"),
        (
            "true distance, median / worst, m",
            f"{statistics.median(away):.2f} / {away[-1]:.2f}" if away else "-",
            "<= 0.5",
        ),
        ("planned way / shortest true way, median", f"{ratios['planned_m']:.3f}", "<= 1.15"),
        ("driven way / shortest true way, median", f"{ratios['driven_m']:.3f}", ""),
        ("driven, m", f"{sum(s['driven_m'] for s in summaries):.0f}", ""),
        ("simulated s / s", f"{statistics.mean(s['speed_x'] for s in summaries):.2f}", ""),
    ]
    print()
    for name, value, bar in rows:
        print(f"{name:44s} {value!s:>14s}   {bar}")
    return [f"{name}: {value}" for name, value, _ in rows]


def _seeds(text: str) -> list[int]:
    first, _, last = text.partition("-")
    return list(range(int(first), int(last or first) + 1))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=_seeds, default=_seeds("1-10"), help="buildings, such as 1-10")
    parser.add_argument("--goals", type=int, default=10, help="goals that can be reached, per building")
    parser.add_argument("--json", type=Path, help="also write every goal and the table to this file")
    arguments = parser.parse_args()
    warm_up()
    encoder = LabelEncoder.load()
    outcomes: list[Outcome] = []
    summaries: list[dict[str, Any]] = []
    for seed in arguments.seeds:
        more, summary = run_building(seed, arguments.goals, encoder)
        outcomes += more
        summaries.append(summary)
    figures = table(outcomes, summaries)
    if arguments.json is not None:
        document = {"table": figures, "buildings": summaries, "goals": [asdict(outcome) for outcome in outcomes]}
        arguments.json.write_text(json.dumps(document, indent=1, default=str) + "\n")
    wrong = sum(outcome.verdict == "wrong" and outcome.best_m <= SURE_M for outcome in outcomes)
    return int(
        wrong > 0.03 * arguments.goals * len(arguments.seeds) or any(summary["collisions"] for summary in summaries)
    )


if __name__ == "__main__":
    sys.exit(main())
