"""A room as goal: the right one or a question, and a place well inside it."""

from __future__ import annotations

import itertools
from dataclasses import replace

import navigation_house as house
import numpy as np
import pytest

from irsd.graph.model import DoorEdge, GraphSnapshot
from irsd.perception.encoder import LabelEncoder
from nav_bridge.answer import answer_document
from nav_bridge.config import BridgeSettings
from nav_bridge.evidence import MATCH
from nav_bridge.planner import Planner, World
from nav_bridge.room_goal import room_grades


@pytest.fixture(scope="module")
def planner() -> Planner:
    return Planner(LabelEncoder.load(), BridgeSettings())


def world(planner: Planner, graph: GraphSnapshot = house.GRAPH, x: float = 2.5) -> World:
    costs = planner.cost_map(house.FRAME, house.occupancy())
    return World(graph, lambda: costs, house.points_of, (x, 3.0, 0.0))


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("go to the kitchen", "R2"),
        ("kitchen", "R2"),
        ("drive to the lab", "R1"),
        ("geh in die Küche", "R2"),
        ("vai in cucina", "R2"),
        ("the nearest kitchen", "R2"),
        ("R2", "R2"),
        ("the nearest room", None),
        ("bathroom", None),
    ],
)
def test_which_room(text: str, wanted: str | None, planner: Planner) -> None:
    answer = planner.answer(text, world(planner))
    if wanted is None:
        assert answer.status == "not_found", answer.reason
        return
    assert answer.status == "resolved", answer.reason
    document = answer_document(answer, house.GRAPH)
    assert (document["target"]["instance"], document["target"]["room"]) == (None, wanted)
    x, y, _ = document["waypoints"][-1]
    x0, y0, x1, y1 = next(r.aabb_xy for r in house.GRAPH.rooms if r.id == wanted)
    assert min(x - x0, x1 - x, y - y0, y1 - y) > 0.6  # well inside
    assert document["approach"]["clearance_m"] >= 0.35
    assert answer.surface is not None
    assert np.hypot(*(answer.surface - [x, y]).T).min() < 0.05


def test_two_of_a_kind_are_a_question(planner: Planner) -> None:
    twins = tuple(replace(r, label="bedroom", labels=(("bedroom", 0.8),)) for r in house.GRAPH.rooms)
    graph = replace(house.GRAPH, rooms=twins)
    assert planner.answer("the bedroom", world(planner, graph)).status == "ambiguous"
    near = planner.answer("the nearest bedroom", world(planner, graph, 7.5))
    far = planner.answer("the farthest bedroom", world(planner, graph, 7.5))
    assert near.target is not None
    assert far.target is not None
    assert (near.target.room, far.target.room) == ("R2", "R1")
    assert planner.answer("the third bedroom", world(planner, graph)).status == "not_found"


def test_a_room_behind_a_closed_door_is_unreachable(planner: Planner) -> None:
    cells = house.occupancy()
    column = int((5.0 - house.FRAME.origin_xy_m[0]) / house.RESOLUTION_M)
    cells[:, column - 2 : column + 2] = 100
    costs = planner.cost_map(house.FRAME, cells)
    answer = planner.answer("kitchen", World(house.GRAPH, lambda: costs, house.points_of, (2.5, 3.0, 0.0)))
    assert (answer.status, answer.reason) == ("unreachable", "no free place in the room can be reached")
    empty = replace(house.GRAPH, rooms=(), instances=())
    assert planner.answer("kitchen", world(planner, empty)).status == "not_found"


def test_why_tells_what_was_weighed(planner: Planner) -> None:
    answer = planner.answer("TV in the kitchen", world(planner))
    why = answer_document(answer, house.GRAPH)["why"]
    assert {r["room"]: r["grade"] >= 0.6 for r in why["rooms"]} == {"R1": False, "R2": True}
    told = {c["instance"]: c for c in why["considered"]}
    assert told["I12"]["rejected"] is None
    assert told["I2"]["rejected"] == "not in a kitchen"
    assert (told["I12"]["observations"], told["I12"]["last_seen_ns"]) == (40, 1)
    poses = why["poses_tried"]
    assert [poses[0]["x"], poses[0]["y"]] == pytest.approx(list(answer.route.waypoints[-1][:2]), abs=1e-3)  # type: ignore[union-attr]
    assert all(a["price"] <= b["price"] for a, b in itertools.pairwise(poses))


def test_not_found_tells_not_seen_from_never_looked(planner: Planner) -> None:
    seen = planner.answer("elephant", world(planner))
    assert answer_document(seen, house.GRAPH)["why"]["not_found"] == "not seen there"
    assert all(share > 0.95 for _, share in seen.looked)
    assert "not seen there: R1, R2" in seen.reason
    cells = house.occupancy()
    cells[:, int((6.0 - house.FRAME.origin_xy_m[0]) / house.RESOLUTION_M) :] = -1  # most of the kitchen
    costs = planner.cost_map(house.FRAME, cells)
    dark = World(house.GRAPH, lambda: costs, house.points_of, (2.5, 3.0, 0.0))
    for query, rooms, kind in (
        ("elephant", ["R1", "R2"], "never looked there"),
        ("elephant in the kitchen", ["R2"], "never looked there"),
        ("elephant in the laboratory", ["R1"], "not seen there"),
    ):
        answer = planner.answer(query, dark)
        assert [room for room, _ in answer.looked] == rooms
        assert answer_document(answer, house.GRAPH)["why"]["not_found"] == kind
    assert dict(planner.answer("elephant in the kitchen", dark).looked)["R2"] == pytest.approx(0.9 / 4.9, abs=0.03)
    nothing = World(house.GRAPH, lambda: None, house.points_of, (2.5, 3.0, 0.0))
    assert planner.answer("elephant", nothing).looked == ()


@pytest.mark.parametrize(("width_m", "doors", "corridor"), [(1.8, 4, True), (1.8, 1, False), (4.0, 4, False)])
def test_a_corridor_is_known_by_its_shape(planner: Planner, width_m: float, doors: int, corridor: bool) -> None:
    """Long, narrow and with many doors: whatever the plants and pictures in it are typical of."""
    long = replace(
        house.GRAPH.rooms[0], id="R9", label="living room", labels=(("living room", 0.7), ("office", 0.1)), instances=(),
        polygon_xy=((20.0, 0.0), (30.0, 0.0), (30.0, width_m), (20.0, width_m)), aabb_xy=(20.0, 0.0, 30.0, width_m),
    )  # fmt: skip
    ways = tuple(
        DoorEdge(f"D{90 + k}", ("R9", house.GRAPH.rooms[k % 2].id), (21.0 + k, 0.0), 0.9) for k in range(doors)
    )
    graph = replace(house.GRAPH, rooms=(*house.GRAPH.rooms, long), doors=(*house.GRAPH.doors, *ways))
    grades = room_grades("corridor", graph, planner._knowledge)
    assert (grades["R9"] >= MATCH) == corridor
    assert (room_grades("living room", graph, planner._knowledge)["R9"] >= MATCH) != corridor
