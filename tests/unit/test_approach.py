"""Where to stand: free, reachable, in sight, facing the target and near enough, or an honest refusal."""

from __future__ import annotations

import math

import navigation_house as house
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nav_bridge.approach import ApproachPose, ApproachSettings, Unreachable, find_approach, in_polygon
from nav_bridge.route import RouteSettings, connected_to, make_cost_map, snap_to_passable
from nav_bridge.surface import solid_part, surface_distance

ROUTE = RouteSettings()
COSTS = make_cost_map(house.FRAME, house.occupancy(), ROUTE)
SETTINGS = ApproachSettings()
HERE = (2.5, 3.0)


def approach(name: str, **more: float) -> ApproachPose | Unreachable:
    thing = next(t for t in house.THINGS if t.id == name)
    outline = next(r.polygon_xy for r in house.GRAPH.rooms if r.id == thing.room)
    return find_approach(COSTS, house.points_of(name), HERE, ApproachSettings(**more), room_xy=outline)


@pytest.mark.parametrize("name", [t.id for t in house.THINGS])
def test_pose_before_every_thing(name: str) -> None:
    pose = approach(name)
    points = house.points_of(name)[:, :2].astype(float)
    start = snap_to_passable(COSTS, HERE, 0.5)
    assert start is not None
    standing = COSTS.frame.centres_of(np.argwhere(connected_to(COSTS, start)))
    possible = surface_distance(points, standing, SETTINGS.outlier_points).min()
    if isinstance(pose, Unreachable):
        assert possible > 0.5 - SETTINGS.margin_m
        assert pose.best_m == pytest.approx(possible)
        return
    cell = COSTS.frame.cells_of(np.array([[pose.x_m, pose.y_m]]))[0]
    away = points - [pose.x_m, pose.y_m]
    nearest = float(np.hypot(*away.T).min())
    assert COSTS.passable[tuple(cell)]
    assert nearest - 1e-6 <= pose.distance_m <= 0.5
    assert pose.clearance_m >= ROUTE.robot_radius_m + ROUTE.clearance_m - 1e-6
    bearing = np.arctan2(away[:, 1], away[:, 0])
    assert np.abs(np.angle(np.exp(1j * (bearing - pose.yaw_rad)))).min() < 0.2
    thing = next(t for t in house.THINGS if t.id == name)
    outline = next(r.polygon_xy for r in house.GRAPH.rooms if r.id == thing.room)
    assert in_polygon(np.array([[pose.x_m, pose.y_m]]), outline)[0]


def test_a_thin_wall_is_no_way_round() -> None:
    """The television hangs on the wall between the rooms; the robot starts in the other room."""
    outline = house.GRAPH.rooms[0].polygon_xy
    pose = find_approach(COSTS, house.points_of("I2"), (7.0, 3.0), SETTINGS, room_xy=outline)
    assert isinstance(pose, ApproachPose)
    assert pose.x_m < 4.8
    blind = find_approach(COSTS, house.points_of("I2"), (7.0, 3.0), SETTINGS)
    assert isinstance(blind, ApproachPose)
    assert blind.x_m < 4.8  # line of sight alone says so too


def test_what_is_out_of_reach_is_refused_with_the_best_distance() -> None:
    far = approach("I13")  # a cup in the middle of a table
    near = approach("I13", within_m=1.5)
    assert isinstance(near, ApproachPose)
    if isinstance(far, Unreachable):
        assert far.best_m is not None
        assert 0.47 < far.best_m <= near.distance_m + 1e-9
    nothing = find_approach(COSTS, np.zeros((0, 3)), HERE, SETTINGS)
    assert isinstance(nothing, Unreachable)
    lost = find_approach(COSTS, house.points_of("I1"), (-30.0, 0.0), SETTINGS)
    assert lost == Unreachable("the robot stands where the map has no free space", None)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.3, 9.7), st.floats(0.3, 5.7), st.floats(0.0, 2 * math.pi))
def test_any_pole_is_approached_safely(x: float, y: float, turn: float) -> None:
    ring = np.linspace(0, 2 * math.pi, 24) + turn
    pole = np.stack([x + 0.05 * np.cos(ring), y + 0.05 * np.sin(ring), np.full(24, 1.0)], 1)
    pose = find_approach(COSTS, pole, HERE, SETTINGS)
    if isinstance(pose, Unreachable):
        assert pose.best_m is None or pose.best_m > 0.5 - SETTINGS.margin_m
        return
    cell = COSTS.frame.cells_of(np.array([[pose.x_m, pose.y_m]]))[0]
    assert COSTS.passable[tuple(cell)]
    assert np.hypot(*(pole[:, :2] - [pose.x_m, pose.y_m]).T).min() <= 0.5


def test_lone_points_do_not_count_as_surface() -> None:
    box = house.surface((0, 0, 0), (1, 1, 1))
    stray = np.vstack([box, [[3.0, 0.5, 0.5], [3.0, 0.5, 0.6]]]).astype(np.float32)
    at = np.array([[3.4, 0.5]])
    assert surface_distance(stray, at)[0] == pytest.approx(0.4, abs=1e-6)
    assert surface_distance(stray, at, 3)[0] == pytest.approx(2.4, abs=0.06)


def test_two_percent_of_bled_points_do_not_bring_the_surface_nearer() -> None:
    box = house.surface((0, 0, 0), (1, 1, 1))
    rng = np.random.default_rng(3)
    bled = np.column_stack([rng.uniform(1.0, 1.4, len(box) // 60), rng.uniform(0, 1, (len(box) // 60, 2))])
    at = np.array([[1.6, 0.5]])
    assert surface_distance(np.vstack([box, bled]), at)[0] < 0.45
    assert surface_distance(np.vstack([box, bled]), at, 3)[0] == pytest.approx(0.6, abs=0.08)
    assert surface_distance(np.vstack([box] * 8), at, 3)[0] == pytest.approx(0.6, abs=0.08)  # thinned, not slower


def test_floor_that_is_free_is_no_surface_but_what_lies_flat_is() -> None:
    """A mask of the fridge has bled over the floor before it; a carpet is nothing but floor."""
    fridge = house.points_of("I6").astype(float)
    free = COSTS.frame.centres_of(np.argwhere(~COSTS.blocked))
    floor = np.column_stack([free, np.full(len(free), 0.02)])[:: max(1, len(free) // (6 * len(fridge)))]
    bled = np.vstack([fridge, floor])
    solid = solid_part(bled, COSTS, 0.0)
    assert len(solid) >= 0.95 * len(fridge)
    assert (solid[:, None] == fridge).all(-1).any(1).all(), "what is left was the fridge's"
    assert len(solid_part(floor, COSTS, 0.0)) == len(floor), "a carpet"
    assert len(solid_part(bled, COSTS, None)) == len(bled)
    beyond = floor + np.array([100.0, 0.0, 0.0])
    assert len(solid_part(beyond, COSTS, 0.0)) == len(beyond), "off the map nothing is known"
    place = np.array([[2.5, 3.0]])
    assert surface_distance(solid, place)[0] == pytest.approx(surface_distance(fridge, place)[0], abs=0.1)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.0, 6.3), st.floats(0.6, 3.0), st.integers(1, 45))
def test_the_greatest_part_is_the_thing_and_what_its_masks_bled_onto_is_not(
    angle: float, away_m: float, share: int
) -> None:
    box = house.surface((2.0, 2.0, 1.3), (2.5, 2.3, 1.8)).astype(float)
    aside = (away_m + 0.5) * np.array([math.cos(angle), math.sin(angle), 0.2])
    bled = box[: len(box) * share // 100] + aside
    mixed = np.random.default_rng(share).permutation(np.vstack([bled, box]))
    solid = solid_part(mixed, COSTS, 0.0)
    assert {tuple(p) for p in solid} == {tuple(p) for p in box}
    assert len(solid_part(box[:0], COSTS, 0.0)) == 0


def test_a_pose_comes_with_its_point_and_its_error() -> None:
    pose = approach("I6")
    assert isinstance(pose, ApproachPose)
    assert pose.target_m is not None
    x, y, _ = pose.target_m
    assert math.hypot(x - pose.x_m, y - pose.y_m) == pytest.approx(pose.distance_m, abs=2e-3)
    assert 0.035 <= pose.error_m < 0.1
    assert pose.distance_m <= 0.5 - SETTINGS.margin_m


def test_what_can_just_be_reached_is_not_promised() -> None:
    deep = np.array([[7.5, 4.45, 0.8]] * 5)  # in the middle of a table
    poses = {w: find_approach(COSTS, deep, HERE, ApproachSettings(within_m=w)) for w in (0.5, 1.0)}
    best = poses[0.5].best_m if isinstance(poses[0.5], Unreachable) else None
    assert best is not None
    assert isinstance(find_approach(COSTS, deep, HERE, ApproachSettings(within_m=best + 0.031)), ApproachPose)
    refused = find_approach(COSTS, deep, HERE, ApproachSettings(within_m=best + 0.01))
    assert isinstance(refused, Unreachable)
    assert "too close to the limit" in refused.reason
