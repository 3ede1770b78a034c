"""What may happen to a drive while it is under way: processes die, the way closes, the target goes, another goal comes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace

import navigation_house as house
import numpy as np
import pytest
from navigation_standin import PATIENCE_S, BridgeProcess, StandIn, ready, running

from irsd.core.runtime import monotonic_s, sleep_s
from irsd.graph.model import GraphDelta

SETTINGS = """
monitor: {still_s: 0.4}
drive: {review_s: 0.2, replan_pause_s: 0.3, patience_s: 1.5}
"""


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[StandIn, BridgeProcess]]:
    with running(tmp_path_factory.mktemp("nav"), SETTINGS) as both:
        yield both


@pytest.fixture
def world(pair: tuple[StandIn, BridgeProcess]) -> StandIn:
    stand_in = pair[0]
    stand_in.step()
    stand_in.ask("cancel", {})
    stand_in.pose, stand_in.way, stand_in.cells = [2.5, 3.0, 0.0], [], house.occupancy()
    stand_in.states.drain()
    return stand_in


def close(world: StandIn, x0: float, x1: float, y0: float, y1: float) -> None:
    """Something now stands there."""
    cells = world.cells.copy()
    low = ((np.array([y0, x0]) + 0.5) / house.RESOLUTION_M).astype(int)
    high = ((np.array([y1, x1]) + 0.5) / house.RESOLUTION_M).astype(int)
    cells[low[0] : high[0], low[1] : high[1]] = 100
    world.cells = cells


def test_a_crate_behind_the_door_is_driven_round(world: StandIn) -> None:
    answer = ready(world, "fridge")
    world.drive_until(lambda s: s["state"] == "driving")
    close(world, 5.6, 6.0, 2.4, 3.3)
    states = world.drive_until(lambda s: s["state"] == "reached")
    assert [s["reason"] for s in states if s["state"] == "planning"] == ["blocked"]
    assert {s["goal_id"] for s in states} == {answer["goal_id"]}
    assert states[-1]["plans"] == 2


def test_a_closed_door_is_waited_for_and_then_given_up(world: StandIn) -> None:
    ready(world, "fridge")
    world.drive_until(lambda s: s["state"] == "driving")
    close(world, 4.9, 5.1, 2.3, 3.7)
    world.drive_until(lambda s: s["state"] == "planning")
    failed = world.drive_until(lambda s: s["state"] == "failed")[-1]
    assert failed["reason"].startswith("blocked")
    assert world.way == []
    assert world.pose[0] < 4.9
    # The same, and the door opens again.
    world.cells = house.occupancy()
    ready(world, "fridge")
    world.drive_until(lambda s: s["state"] == "driving")
    close(world, 4.9, 5.1, 2.3, 3.7)
    world.drive_until(lambda s: s["state"] == "planning")
    world.cells = house.occupancy()
    world.drive_until(lambda s: s["state"] == "reached")


def test_a_target_that_vanishes_is_looked_for_anew_or_the_goal_fails(world: StandIn) -> None:
    ready(world, "any trash can")  # I4 in this room is the nearer one
    world.drive_until(lambda s: s["state"] == "driving")
    world.publish_delta(GraphDelta(8, 8, "flat", "map", (), (), (), ("I4",), ()))
    reached = world.drive_until(lambda s: s["state"] == "reached")[-1]
    assert "I14 trash can" in reached["text"]
    ready(world, "any trash can")
    world.publish_delta(GraphDelta(9, 9, "flat", "map", (), (), (), ("I14",), ()))
    failed = world.drive_until(lambda s: s["state"] in ("failed", "reached"))[-1]
    assert failed["reason"].startswith("lost")
    assert world.way == []
    assert "no trash can is known here" in failed["reason"]
    # One that irsd doubts for a moment is waited for.
    ready(world, "fridge")
    world.drive_until(lambda s: s["state"] == "driving")
    world.publish_delta(GraphDelta(10, 10, "flat", "map", (), (), (), ("I6",), ()))
    assert world.drive_until(lambda s: s["state"] == "planning")[-1]["reason"] == "lost"
    fridge = next(thing for thing in house.THINGS if thing.id == "I6")
    world.publish_delta(GraphDelta(11, 11, "flat", "map", (), (), (fridge,), (), ()))
    reached = world.drive_until(lambda s: s["state"] in ("failed", "reached"))[-1]
    assert reached["state"] == "reached"
    assert "I6" in reached["text"]


def test_priorities_decide_who_drives(world: StandIn) -> None:
    first = ready(world, "television in the kitchen")
    world.ask("cancel", {})
    first = world.goto("television in the kitchen", priority=5)
    assert "priority 5" in world.goto("fridge", priority=4)["error"]
    second = world.goto("fridge", priority=5)
    states = world.drive_until(lambda s: s["goal_id"] == second["goal_id"] and s["state"] == "driving")
    assert [s["state"] for s in states if s["goal_id"] == first["goal_id"]][-1] == "preempted"
    assert "error" in world.goto("fridge", priority=-1)
    assert world.ask("cancel", {})["goal_id"] == second["goal_id"]


def test_irsd_comes_back_with_the_same_map_or_with_another(world: StandIn) -> None:
    world.irsd_lives(True)
    ready(world, "fridge")
    world.drive_until(lambda s: s["state"] == "driving")
    world.irsd_lives(False)  # irsd dies and comes back, with the map it had stored
    world.irsd_lives(True)
    world.drive_until(lambda s: s["state"] == "reached")
    world.pose = [2.5, 3.0, 0.0]
    ready(world, "fridge")
    world.drive_until(lambda s: s["state"] == "driving")
    world.irsd_lives(False)
    world.graph = replace(house.GRAPH, map_id="new", instances=())
    world.irsd_lives(True)
    assert world.drive_until(lambda s: s["state"] == "failed")[-1]["reason"].startswith("new map")
    world.graph = house.GRAPH
    world.irsd_lives(False)
    world.irsd_lives(True)
    deadline = monotonic_s() + PATIENCE_S
    while world.goto("fridge")["status"] != "resolved":
        assert monotonic_s() < deadline


def test_a_robot_whose_irsd_is_gone_holds_and_gives_up_with_the_cause(world: StandIn) -> None:
    world.irsd_lives(True)
    ready(world, "fridge")
    world.drive_until(lambda s: s["state"] == "driving")
    stops = world.stops
    world.irsd_lives(False)
    died_s = monotonic_s()
    while world.stops == stops:
        assert monotonic_s() < died_s + PATIENCE_S
        world.step()
        sleep_s(0.005)
    assert monotonic_s() - died_s <= 1.0
    stands = list(world.pose)
    failed = world.drive_until(lambda s: s["state"] == "failed")[-1]
    assert failed["reason"].startswith("irsd is gone")
    assert world.pose == stands
    world.irsd_lives(True)


def killed_mid_drive(world: StandIn, bridge: BridgeProcess) -> str:
    """The id of a goal whose bridge was killed; the robot holds, and soon."""
    world.pose, world.way = [2.5, 3.0, 0.0], []
    goal = ready(world, "fridge")["goal_id"]
    world.drive_until(lambda s: s["state"] == "driving")
    bridge.kill()
    died_s = monotonic_s()
    while world.way:  # the rest of it is given up when the robot holds
        assert monotonic_s() < died_s + PATIENCE_S
        world.step()
        sleep_s(0.005)
    assert monotonic_s() - died_s <= 1.0
    stands = list(world.pose)
    for _ in range(5):
        world.step()
    assert world.pose == stands
    world.states.drain()
    return str(goal)


def test_a_bridge_that_was_killed_holds_and_goes_on_when_it_is_back(
    world: StandIn, pair: tuple[StandIn, BridgeProcess]
) -> None:
    goal = killed_mid_drive(world, pair[1])
    pair[1].start()
    states = world.drive_until(lambda s: s["state"] == "reached")
    assert {s["goal_id"] for s in states} == {goal}
    assert "nav_bridge was restarted" in states[0]["text"]
    again = ready(world, "television in the kitchen")
    assert again["goal_id"] != goal


def test_a_goal_is_not_taken_up_when_nobody_waits_for_it_any_more(
    world: StandIn, pair: tuple[StandIn, BridgeProcess]
) -> None:
    goal = killed_mid_drive(world, pair[1])
    kept = pair[1].state / "bot" / "goal.json"
    long_ago_s = kept.stat().st_mtime - 60.0
    os.utime(kept, (long_ago_s, long_ago_s))
    pair[1].start()
    failed = world.drive_until(lambda s: s["state"] == "failed")[-1]
    assert (failed["goal_id"], "was gone for" in failed["reason"]) == (goal, True)
    assert not kept.exists()
    killed_mid_drive(world, pair[1])  # and nothing is left over that would
    kept.write_text("{ torn")
    pair[1].start()
    ready(world, "fridge")
    world.drive_until(lambda s: s["state"] == "reached")


def test_a_goal_of_another_map_is_not_taken_up(world: StandIn, pair: tuple[StandIn, BridgeProcess]) -> None:
    goal = killed_mid_drive(world, pair[1])
    world.graph = replace(house.GRAPH, map_id="another")
    pair[1].start()
    failed = world.drive_until(lambda s: s["state"] == "failed")[-1]
    assert (failed["goal_id"], failed["reason"][:7]) == (goal, "new map")
    world.graph = house.GRAPH
