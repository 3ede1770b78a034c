"""nav_bridge as a process over real zenoh: goals in words, waypoints out, a robot that drives them, every way a drive can end."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import navigation_house as house
import numpy as np
import pytest
from navigation_standin import KEYS, PATIENCE_S, StandIn, ready, running

from irsd.core.runtime import Ring, monotonic_s
from irsd.graph.model import GraphDelta
from irsd.io.cdr import read
from irsd.io.session import Sample


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StandIn]:
    settings = (
        "sinks: {goal_topic: /goal_pose, path_topic: /plan}\n"
        "monitor: {stuck_s: 3.0, odometry_timeout_s: 1.5, still_s: 0.4}\n"
    )
    with running(tmp_path_factory.mktemp("nav"), settings) as (stand_in, _):
        yield stand_in


@pytest.fixture(autouse=True)
def _fresh(world: StandIn) -> None:
    world.pose, world.way, world.silent, world.stalled = [2.5, 3.0, 0.0], [], False, False
    world.waypoints.drain()
    world.states.drain()


def test_a_goal_is_driven_to_its_end(world: StandIn) -> None:
    goal_poses: Ring[Sample] = Ring(8)
    plans: Ring[Sample] = Ring(8)
    own: Ring[Sample] = Ring(8)
    handles = [
        world.session.subscribe("goal_pose", goal_poses),
        world.session.subscribe("plan", plans),
        world.session.subscribe(KEYS.nav("path"), own),
    ]
    answer = ready(world, "the TV in the kitchen")
    assert (answer["status"], answer["target"]["instance"], answer["target"]["room"]) == ("resolved", "I12", "R2")
    states = world.drive_until(lambda s: s["state"] == "reached")
    assert [s["state"] for s in states][:2] == ["accepted", "driving"]
    assert {s["goal_id"] for s in states} == {answer["goal_id"]}
    truth = float(np.hypot(*(house.points_of("I12")[:, :2] - world.pose[:2]).T).min())
    assert truth <= 0.5
    assert states[-1]["distance_m"] == pytest.approx(truth, abs=0.06)
    assert states[-1]["text"] == f"Reached: {states[-1]['distance_m']:.2f} m from I12 television in R2 kitchen"
    last = answer["waypoints"][-1]
    for ring, type_name in (
        (goal_poses, "geometry_msgs/msg/PoseStamped"),
        (own, "nav_msgs/msg/Path"),
        (plans, "nav_msgs/msg/Path"),
    ):
        sample = ring.get(PATIENCE_S)
        assert sample is not None
        message = read(sample.payload, type_name)
        pose = message.pose if type_name.endswith("PoseStamped") else message.poses[-1].pose
        assert (pose.position.x, pose.position.y) == pytest.approx(last[:2])
    for handle in handles:
        handle.close()


def test_what_cannot_be_driven_is_answered_and_not_driven(world: StandIn) -> None:
    assert ready(world, "the TV")["status"] == "ambiguous"
    assert {c["instance"] for c in world.goto("trash can")["candidates"]} == {"I4", "I14"}
    assert world.goto("elephant")["status"] == "not_found"
    far = world.goto("fridge", within_m=0.06)
    assert far["status"] == "unreachable"
    assert far["target"]["instance"] == "I6"
    assert far["why"]["best_distance_m"] > 0.06
    assert "error" in world.ask("goto", {})
    assert "error" in world.ask("goto", {"query": "fridge", "within_m": "near"})
    assert world.states.drain() == []
    assert world.ask("cancel", {})["goal_id"] is None


def test_why_explains_and_does_not_drive(world: StandIn) -> None:
    ready(world, "elephant")
    answer = world.ask("why", {"query": "the TV in the kitchen"})
    assert (answer["status"], answer["target"]["instance"]) == ("resolved", "I12")
    assert {c["instance"] for c in answer["why"]["considered"]} == {"I2", "I12"}
    assert answer["why"]["poses_tried"]
    assert "goal_id" not in answer
    assert "error" in world.ask("why", {"query": ""})
    assert world.states.drain() == []


def test_a_room_is_a_goal_too(world: StandIn) -> None:
    answer = ready(world, "go to the kitchen")
    assert (answer["target"]["instance"], answer["target"]["room"]) == (None, "R2")
    assert world.drive_until(lambda s: s["state"] == "reached")[-1]["text"] == "Reached: R2 kitchen"
    assert 5.6 < world.pose[0] < 9.4


def test_cancel_stops_the_robot(world: StandIn) -> None:
    answer = ready(world, "fridge")
    world.drive_until(lambda s: s["state"] == "driving")
    before = world.stops
    assert world.ask("cancel", {})["goal_id"] == answer["goal_id"]
    states = world.drive_until(lambda s: s["state"] == "cancelled")
    assert states[-1]["goal_id"] == answer["goal_id"]
    while world.stops == before:
        world.step()
    assert world.way == []


def test_a_new_goal_preempts_the_old_one(world: StandIn) -> None:
    first = ready(world, "fridge")
    world.drive_until(lambda s: s["state"] == "driving")
    second = world.goto("trash can in the laboratory")
    states = world.drive_until(lambda s: s["state"] == "reached")
    assert [s["state"] for s in states if s["goal_id"] == first["goal_id"]][-1] == "preempted"
    assert states[-1]["goal_id"] == second["goal_id"]


def test_a_stuck_robot_and_a_silent_one_fail_with_the_reason(world: StandIn) -> None:
    ready(world, "fridge")
    world.stalled = True
    assert world.drive_until(lambda s: s["state"] == "failed")[-1]["reason"].startswith("stuck")
    world.stalled = False
    ready(world, "fridge")
    world.silent = True
    assert world.drive_until(lambda s: s["state"] == "failed")[-1]["reason"].startswith("no odometry")


def test_the_graph_is_followed(world: StandIn) -> None:
    assert ready(world, "microscope")["status"] == "not_found"
    new = house.instance(20, "microscope", "R1", (0.2, 4.6, 0.75), (0.4, 4.8, 1.1))
    world.more_points["I20"] = house.surface(new.aabb_min_m, new.aabb_max_m)
    for seq, things, removed in ((8, (new,), ()), (9, (), ("I20",))):
        world.publish_delta(GraphDelta(seq, seq, "flat", "map", (), (), things, removed, ()))
        wanted = "resolved" if things else "not_found"
        deadline = monotonic_s() + PATIENCE_S
        while (answer := world.goto("microscope", within_m=1.5)).get("status") != wanted:
            assert monotonic_s() < deadline, answer
    world.ask("cancel", {})


@pytest.mark.parametrize(("text", "named"), [("x: 1\n", "x = 1: unknown key"), ("[1]\n", "bad.yaml")])
def test_a_wrong_configuration_is_named_and_final(tmp_path: Path, text: str, named: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    environment = {**os.environ, "NAV_BRIDGE_CONFIG": str(path)}
    run = subprocess.run(
        [sys.executable, "-m", "nav_bridge"], capture_output=True, text=True, env=environment, check=False
    )
    assert run.returncode == 2
    assert named in run.stderr
    assert "Traceback" not in run.stderr
