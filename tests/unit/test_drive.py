"""When a plan is no longer good: the map, the target or the robot says so; and how long the rest will take."""

from __future__ import annotations

from dataclasses import replace

import navigation_house as house
import numpy as np
import pytest

from irsd.graph.model import GraphSnapshot
from irsd.perception.encoder import LabelEncoder
from nav_bridge.config import BridgeSettings
from nav_bridge.drive import Drive, View
from nav_bridge.monitor import Driving
from nav_bridge.planner import Planner, World

SETTINGS = BridgeSettings()
HERE = (2.5, 3.0)
RADIUS_M = SETTINGS.route.robot_radius_m


@pytest.fixture(scope="module")
def planner() -> Planner:
    return Planner(LabelEncoder.load(), SETTINGS)


def world_of(planner: Planner, cells: np.ndarray | None = None) -> World:
    costs = planner.cost_map(house.FRAME, house.occupancy() if cells is None else cells)
    return World(house.GRAPH, lambda: costs, house.points_of, (*HERE, 0.0))


def driving(planner: Planner, query: str) -> Drive:
    drive = Drive("g1", query, 0.5, 0)
    answer = planner.answer(query, world_of(planner))
    assert drive.adopt(answer, house.GRAPH, SETTINGS.monitor, SETTINGS.approach, 0)
    return drive


def cause(drive: Drive, graph: GraphSnapshot = house.GRAPH, view: View | None = None) -> str:
    doubt = drive.doubt(graph, view, HERE, SETTINGS.drive.off_way_m, RADIUS_M)
    return "" if doubt is None else doubt.cause


def with_box(x0: float, x1: float, y0: float, y1: float) -> np.ndarray:
    cells = house.occupancy()
    rows, cols = np.mgrid[: house.FRAME.height, : house.FRAME.width]
    x, y = (house.FRAME.origin_xy_m[k] + (v + 0.5) * house.RESOLUTION_M for k, v in ((0, cols), (1, rows)))
    cells[(x > x0) & (x < x1) & (y > y0) & (y < y1)] = 100
    return cells


@pytest.mark.parametrize("query", ["fridge", "TV in the laboratory", "kitchen", "trash can in the laboratory"])
def test_nothing_new_is_no_doubt(planner: Planner, query: str) -> None:
    drive = driving(planner, query)
    costs = world_of(planner).map_of()
    surface = None if drive.target.is_room else house.points_of(drive.target.instance)
    assert cause(drive, view=View(drive.seq, costs, surface)) == ""
    assert cause(drive, view=View(drive.seq, None, None)) == ""


def test_the_graph_decides_whether_the_target_is_there(planner: Planner) -> None:
    drive = driving(planner, "fridge")
    without = tuple(t for t in house.THINGS if t.id != "I6")
    gone = tuple(replace(t, state="gone") for t in house.THINGS)
    assert cause(drive, replace(house.GRAPH, instances=without)) == "lost"
    assert cause(drive, replace(house.GRAPH, instances=gone)) == "vanished"
    assert cause(drive, replace(house.GRAPH, map_id="other")) == "new map"
    room = driving(planner, "kitchen")
    assert cause(room, replace(house.GRAPH, instances=())) == ""
    assert cause(room, replace(house.GRAPH, rooms=house.GRAPH.rooms[:1])) == "vanished"


def test_something_in_the_way_is_driven_round(planner: Planner) -> None:
    drive = driving(planner, "fridge")
    crate = with_box(5.6, 6.0, 2.4, 3.3)  # behind the door
    costs = planner.cost_map(house.FRAME, crate)
    surface = house.points_of("I6")
    assert cause(drive, view=View(drive.seq, costs, surface)) == "blocked"
    assert cause(drive, view=View(drive.seq - 1, costs, surface)) == ""  # seen for another plan
    answer = planner.again(drive.answer, world_of(planner, crate), 0.5)
    assert drive.adopt(answer, house.GRAPH, SETTINGS.monitor, SETTINGS.approach, 1)
    assert (drive.plans, drive.target.instance) == (2, "I6")
    assert cause(drive, view=View(drive.seq, costs, surface)) == ""
    closed = planner.again(drive.answer, world_of(planner, with_box(4.8, 5.2, 2.0, 4.0)), 0.5)
    assert closed.status == "unreachable"
    assert not drive.adopt(closed, house.GRAPH, SETTINGS.monitor, SETTINGS.approach, 2)
    drive.hold(5)
    assert cause(drive) == "blocked"


def test_a_target_that_moves_and_a_robot_off_its_way(planner: Planner) -> None:
    drive = driving(planner, "fridge")
    costs, surface = world_of(planner).map_of(), house.points_of("I6")
    assert cause(drive, view=View(drive.seq, costs, surface + np.float32([0.02, 0.02, 0]))) == ""
    assert cause(drive, view=View(drive.seq, costs, surface + np.float32([0, 2.5, 0]))) == "moved"
    drive = driving(planner, "fridge")
    drive.monitor.update(1, (*HERE, 0.0))
    assert cause(drive) == ""
    drive.monitor.update(2, (1.0, 1.0, 0.0))
    assert cause(drive) == "off the way"


def test_a_tight_place_is_worth_another_plan_but_a_robot_that_never_moved_is_not_in_one(planner: Planner) -> None:
    drive = driving(planner, "fridge")
    assert not drive.felt(HERE)
    for k in range(3):
        assert drive.felt((4.0, 3.0 + 0.1 * k))
    assert not drive.felt((4.0, 3.5)), "not for ever"
    assert len(drive.tight) == 3


def test_plans_heartbeats_and_stops_are_told_apart(planner: Planner) -> None:
    drive = driving(planner, "fridge")
    plan, rest = drive.plan(SETTINGS.drive), drive.rest(SETTINGS.drive)
    assert (plan.goal_id, plan.seq) == (rest.goal_id, rest.seq)
    assert rest.waypoints == plan.waypoints[1:]
    x, y, yaw = plan.waypoints[-1]
    drive.monitor.update(1, (x, y, yaw))
    assert drive.rest(SETTINGS.drive).waypoints == plan.waypoints[-1:]
    stop = drive.stop(SETTINGS.drive)
    assert stop.seq == plan.seq + 1
    assert stop.waypoints == ()


def test_time_left_is_way_over_speed(planner: Planner) -> None:
    monitor = driving(planner, "fridge").monitor
    way = np.array(driving(planner, "fridge").plan(SETTINGS.drive).waypoints)[:, :2]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    told: list[tuple[float, float]] = []
    for k in range(1, 40):  # 0.5 m/s for 4 s
        at = 0.05 * k
        x, y = (float(np.interp(at, along, way[:, axis])) for axis in (0, 1))
        state = monitor.update(k * 100_000_000, (x, y, 0.0))
        assert isinstance(state, Driving)
        if state.eta_s is not None:
            told.append((state.remaining_m, state.eta_s))
    assert len(told) > 20
    assert told[-1][1] == pytest.approx(told[-1][0] / 0.5, rel=0.05)
