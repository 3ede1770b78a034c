"""Rules in words: understood or refused, applied to what the graph holds, at their hours."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import navigation_house as house
import numpy as np
import pytest

from irsd.core.errors import ConfigError
from irsd.perception.encoder import LabelEncoder
from nav_bridge.answer import Answer
from nav_bridge.config import BridgeSettings, load_settings
from nav_bridge.drive import way_blocked
from nav_bridge.geofence import GeofenceSettings, parse_rule
from nav_bridge.planner import Planner, World

NOON, NIGHT = 12 * 60, 2 * 60


@pytest.fixture(scope="module")
def encoder() -> LabelEncoder:
    return LabelEncoder.load()


def planner_of(encoder: LabelEncoder, *rules: str) -> Planner:
    return Planner(encoder, replace(BridgeSettings(), geofence=GeofenceSettings(rules)))


def ask(planner: Planner, query: str, minute: int | None = NOON) -> Answer:
    costs = planner.cost_map(house.FRAME, house.occupancy())
    return planner.answer(query, World(house.GRAPH, lambda: costs, house.points_of, (2.5, 3.0, 0.0), minute))


@pytest.mark.parametrize(
    ("text", "name", "metres", "hours"),
    [
        ("never in server room", "server room", None, None),
        ("Never in the `server room`", "server room", None, None),
        ("not within 1 m of `fume hood`", "fume hood", 1.0, None),
        ("never closer than 50 cm to the piano", "piano", 0.5, None),
        ("not within 1.5 m of fume hood 08:00-18:00", "fume hood", 1.5, (480, 1080)),
        ("never in kitchen from 22:00 to 6:30", "kitchen", None, (1320, 390)),
        ("never enter R2", "r2", None, None),
    ],
)
def test_rules_are_understood(text: str, name: str, metres: float | None, hours: tuple[int, int] | None) -> None:
    rule = parse_rule(text)
    assert (rule.name, rule.metres, rule.hours) == (name, metres, hours)


@pytest.mark.parametrize("text", ["", "be careful", "never", "not within of it", "never in kitchen 25:00-26:00"])
def test_what_is_not_understood_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="geofence rule"):
        parse_rule(text)


def test_hours_may_pass_midnight() -> None:
    rule = parse_rule("never in kitchen 22:00-06:00")
    assert [rule.holds(m) for m in (NIGHT, NOON, 1319, 1320, 360, None)] == [True, False, False, True, False, True]


def test_a_room_is_out_of_bounds_at_its_hours(encoder: LabelEncoder) -> None:
    planner = planner_of(encoder, "never in the kitchen 08:00-18:00")
    for query in ("fridge", "kitchen"):
        answer = ask(planner, query)
        assert (answer.status, answer.reason) == ("unreachable", "forbidden: never in the kitchen 08:00-18:00")
        assert ask(planner, query, NIGHT).status == "resolved"
    assert ask(planner, "fridge", None).status == "unreachable"  # offline: rules with hours always hold
    assert ask(planner, "TV in the laboratory").status == "resolved"


def test_a_distance_is_kept_by_every_waypoint(encoder: LabelEncoder) -> None:
    table = next(t for t in house.THINGS if t.id == "I9")
    rule = "not within 1 m of dining table"
    low, high = np.array(table.aabb_min_m[:2]), np.array(table.aabb_max_m[:2])
    answer = ask(planner_of(encoder, rule), "fridge")
    assert answer.route is not None
    for x, y, _ in answer.route.waypoints:
        away = np.hypot(*np.maximum(np.maximum(low - (x, y), (x, y) - high), 0.0))
        assert away >= 1.0 + BridgeSettings().route.robot_radius_m - 0.05
    near = ask(planner_of(encoder, rule), "dining table")
    assert (near.status, near.reason) == ("unreachable", f"forbidden: {rule}")


def test_a_rule_that_begins_while_it_drives_blocks_the_way(encoder: LabelEncoder) -> None:
    planner = planner_of(encoder, "never in kitchen 08:00-18:00")
    answer = ask(planner, "fridge", NIGHT)
    assert answer.route is not None
    costs = planner.cost_map(house.FRAME, house.occupancy())
    way = answer.route.waypoints[1:]
    for minute, blocked in ((NIGHT, False), (NOON, True)):
        assert way_blocked(planner.fenced(costs, house.GRAPH, minute), (2.5, 3.0), way, 0.2) is blocked


def test_a_bad_rule_in_the_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "nav.yaml"
    path.write_text("geofence: {rules: [never in kitchen, be careful]}\n")
    with pytest.raises(ConfigError, match="be careful"):
        load_settings(path)


def test_a_rule_that_names_nothing_is_told(encoder: LabelEncoder) -> None:
    planner = planner_of(
        encoder, "never in the ballroom", "never in the kitchen", "not within 1 m of piano", "not within 1 m of I6"
    )
    told = planner.follow(house.GRAPH)
    assert len(told) == 2
    assert "ballroom" in told[0]
    assert "piano" in told[1]
    piano = house.instance(40, "piano", "R1", (2.0, 5.0, 0.0), (3.0, 5.8, 1.1))
    assert len(planner.follow(replace(house.GRAPH, instances=(*house.THINGS, piano)))) == 1
