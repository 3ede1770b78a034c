"""What is wrong with nav_bridge is told: a geofence rule that names nothing, until the thing is seen."""

from __future__ import annotations

import json
from pathlib import Path

import navigation_house as house
from navigation_standin import KEYS, PATIENCE_S, StandIn, ready, running

from irsd.core.runtime import monotonic_s
from irsd.graph.model import GraphDelta


def faults(world: StandIn) -> list[dict[str, str]]:
    (reply,) = world.session.get(KEYS.nav("faults"), timeout_s=PATIENCE_S)
    document = json.loads(reply.payload)
    assert document["schema"] == "irs/nav/faults/1"
    return list(document["faults"])


def wait_for(world: StandIn, count: int) -> list[dict[str, str]]:
    deadline = monotonic_s() + PATIENCE_S
    while len(found := faults(world)) != count:
        assert monotonic_s() < deadline, found
        world.step()
    return found


def test_a_rule_that_names_nothing_is_a_fault_until_it_does(tmp_path: Path) -> None:
    with running(tmp_path, 'geofence: {rules: ["never in ballroom", "not within 1 m of piano"]}\n') as (world, _):
        ready(world, "elephant")
        assert [f["code"] for f in wait_for(world, 2)] == ["geofence", "geofence"]
        piano = house.instance(20, "piano", "R1", (2.0, 5.0, 0.0), (3.0, 5.8, 1.1))
        world.publish_delta(GraphDelta(8, 8, "flat", "map", (), (), (piano,), (), ()))
        left = wait_for(world, 1)
        assert "ballroom" in left[0]["text"]


def test_there_is_where_the_last_goal_was(tmp_path: Path) -> None:
    with running(tmp_path, "") as (world, _):
        assert ready(world, "go there")["status"] == "not_found"
        assert world.ask("why", {"query": "TV in the kitchen"})["target"]["instance"] == "I12"
        assert world.ask("why", {"query": "go back there"})["target"]["instance"] == "I12"
        nearest = world.ask("why", {"query": "the table next to it"})
        assert nearest["target"]["instance"] == "I9"
