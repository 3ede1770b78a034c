"""A robot that does not know where it is finds its place in a stored plan, or says why it can't."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import ndimage

from irsd.core.geometry import invert, pose_from_xy_yaw, transform, yaw_of
from irsd.core.grid import GridFrame
from irsd.core.types import DeskewedScan, Plan, SyncedFrame
from irsd.mapping import relocalise
from irsd.mapping.localise import Localiser, LocaliseSettings
from irsd.mapping.relocalise import find_place
from irsd.mapping.voxels import VoxelMap, VoxelSettings

RESOLUTION_M = 0.05
Rect = tuple[float, float, float, float]
FLAT: tuple[Rect, ...] = ((0.0, 0.0, 5.0, 4.0), (5.2, 0.0, 8.0, 4.0), (0.0, 4.2, 3.0, 9.0), (3.2, 4.2, 8.0, 9.0))
DOORS: tuple[Rect, ...] = ((4.9, 1.0, 5.3, 1.9), (1.0, 3.9, 1.9, 4.3), (6.0, 3.9, 6.9, 4.3))
TWINS: tuple[Rect, ...] = ((0.0, 0.0, 4.0, 3.0), (10.0, 0.0, 14.0, 3.0))


def plan_of(rooms: tuple[Rect, ...], doors: tuple[Rect, ...] = (), origin: tuple[float, float] = (-2.0, -1.5)) -> Plan:
    """Rooms are free inside and have a wall around; doors are cut through."""
    frame = GridFrame(origin, RESOLUTION_M, 260, 360)
    free = np.zeros((260, 360), bool)
    for x0, y0, x1, y1 in (*rooms, *doors):
        row, col = frame.cells_of(np.array([[x0, y0], [x1, y1]])).T
        free[row[0] : row[1], col[0] : col[1]] = True
    return Plan(frame, 0.0, ndimage.binary_dilation(free, np.ones((3, 3))) & ~free, free)


def seen_from(plan: Plan, robot: tuple[float, float], now_T_map: NDArray[np.float64], range_m: float) -> Plan:
    """The part of a plan around the robot, as another frame has it."""
    points = plan.frame.centres_of(np.argwhere(plan.wall))
    near = points[np.hypot(*(points - robot).T) < range_m]
    moved = transform(now_T_map, np.c_[near, np.zeros(len(near))])[:, :2]
    frame = GridFrame((-30.0, -30.0), RESOLUTION_M, 1200, 1200)
    wall = np.zeros((1200, 1200), bool)
    row, col = frame.cells_of(moved).T
    wall[row, col] = True
    return Plan(frame, 0.0, wall, np.zeros_like(wall))


@settings(max_examples=12, deadline=None)
@given(
    x=st.floats(-8, 8),
    y=st.floats(-8, 8),
    yaw=st.floats(-3.1, 3.1),
    at=st.sampled_from([(2.0, 2.0), (4.5, 6.0), (6.5, 1.5)]),
)
def test_any_frame_is_found(x: float, y: float, yaw: float, at: tuple[float, float]) -> None:
    stored, now_T_map = plan_of(FLAT, DOORS), pose_from_xy_yaw(x, y, yaw)
    robot = transform(now_T_map, np.array([[*at, 0.0]]))[0]
    found = find_place(seen_from(stored, at, now_T_map, 5.0), (float(robot[0]), float(robot[1])), stored)
    assert found.accepted, found.refused
    left = found.stored_T_now @ now_T_map
    place = transform(left, np.array([[*at, 0.0]]))[0]
    assert np.hypot(place[0] - at[0], place[1] - at[1]) < 0.05
    assert abs(yaw_of(left)) < 0.015


def test_branch_and_bound_finds_what_trying_everything_finds() -> None:
    rng = np.random.default_rng(4)
    field = rng.integers(-100, 200, (45, 60)).astype(np.int16)
    stand = rng.random((45, 60)) < 0.3
    stand[:22] = stand[:, :22] = False  # the margin that a search needs
    turns = rng.integers(-6, 7, (5, 12, 2)).astype(np.int32)
    levels = range(relocalise._LEVELS)
    bounds = np.stack([relocalise._window_max(field, 1 << h) for h in levels])
    open_to = np.stack([relocalise._window_max(stand.astype(np.int16), 1 << h) for h in levels])
    everything = np.full((5, 45, 60), -(10**6))
    for k, row, col in np.argwhere(np.broadcast_to(stand, (5, 45, 60))):
        at = turns[k] + [row, col]
        inside = ((at >= 0) & (at < field.shape)).all(1)
        everything[k, row, col] = field[at[inside, 0], at[inside, 1]].sum()
    roots = relocalise._root_scores(turns, bounds[-1], open_to[-1])
    apart = np.array([4.0, 1.0])
    best, place = relocalise._descend(turns, bounds, open_to, roots, -(10**6), np.array([-1, -1, -1]), apart)
    assert best == everything.max()
    assert everything[tuple(place)] == best
    k, row, col = np.indices(everything.shape)
    turn = np.abs(k - place[0])
    near = (np.minimum(turn, 5 - turn) <= 1) & (np.hypot(row - place[1], col - place[2]) <= 4)
    second, _ = relocalise._descend(turns, bounds, open_to, roots, -(10**6), place, apart)
    assert second == np.where(near, -(10**6), everything).max()


def test_two_rooms_alike_are_refused() -> None:
    stored = plan_of(TWINS)
    found = find_place(seen_from(stored, (2.0, 1.0), np.eye(4), 5.0), (2.0, 1.0), stored)
    assert not found.accepted
    assert "alike" in found.refused
    assert found.runner_up > 0.9 * found.score


def test_another_building_is_refused() -> None:
    other = plan_of(((0.0, 0.0, 6.7, 2.2), (0.0, 2.4, 2.4, 8.0), (2.6, 2.4, 6.7, 5.0)), ((1.0, 2.1, 1.8, 2.5),))
    found = find_place(seen_from(other, (1.5, 1.0), np.eye(4), 6.0), (1.5, 1.0), plan_of(FLAT, DOORS))
    assert not found.accepted
    assert "fits nowhere" in found.refused


def test_who_sees_next_to_nothing_is_told_so() -> None:
    stored = plan_of(FLAT, DOORS)
    assert "too little" in find_place(seen_from(stored, (2.0, 2.0), np.eye(4), 0.2), (2.0, 2.0), stored).refused
    nothing = Plan(stored.frame, 0.0, np.zeros_like(stored.wall), np.zeros_like(stored.free))
    assert "too little" in find_place(seen_from(stored, (2.0, 2.0), np.eye(4), 5.0), (2.0, 2.0), nothing).refused


def test_the_localiser_goes_on_from_there() -> None:
    localiser, map_T_odom = Localiser(LocaliseSettings()), pose_from_xy_yaw(3.0, -2.0, 0.7, 0.1)
    localiser.begin_at(map_T_odom)
    odom_T_base = pose_from_xy_yaw(1.0, 0.0, 0.2)
    frame = SyncedFrame(1, 1, odom_T_base, DeskewedScan(1, np.zeros((0, 3), np.float32), np.zeros(3)), ())
    placed, where = localiser.place(frame, VoxelMap(VoxelSettings(max_voxels=1000)))
    np.testing.assert_allclose(placed.map_T_base, map_T_odom @ odom_T_base, atol=1e-9)
    np.testing.assert_allclose(where.map_T_odom @ invert(map_T_odom), np.eye(4), atol=1e-9)
