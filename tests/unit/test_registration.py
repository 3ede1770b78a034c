"""Laying scans on the map: against brute force, on known moves, in corridors, and where no match is right."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from irsd.core.geometry import invert, pose_from_xy_yaw, transform, yaw_of
from irsd.core.types import CameraModel, CameraView, DeskewedScan, SyncedFrame
from irsd.mapping.kernels import BLOCK_COARSE, unpack_blocks
from irsd.mapping.localise import Localiser, LocaliseSettings
from irsd.mapping.registration import Planes, Reach, align, moved, nearest_planes, plane_system
from irsd.mapping.voxels import VoxelMap, VoxelSettings

SENSOR = np.array([0.0, 0.0, 0.6])
REACH = Reach(1, 0.2, 0.5, 0.1, 0.01)
Box = tuple[float, float, float, float]
ROOM: Box = (-3.0, -2.0, 4.0, 2.5)
CORRIDOR: Box = (-60.0, -1.0, 60.0, 1.0)


def scan_of(walls: Box, seed: int, *, noise_m: float = 0.01, range_m: float = 12.0) -> NDArray[np.float32]:
    """What a LiDAR at SENSOR sees of an empty room's floor, walls and ceiling (2.5 m): float32 [N, 3]. Its rings lie elsewhere in
    every scan, as those of a robot that moves."""
    rng = np.random.default_rng(seed)
    turn, rise = np.meshgrid(np.linspace(-np.pi, np.pi, 400, endpoint=False), np.deg2rad(np.linspace(-25, 50, 24)))
    turn, rise = turn + rng.uniform(0, 0.02), rise + rng.uniform(0, 0.06)
    rays = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)], -1).reshape(-1, 3)
    low, high = np.array([walls[0], walls[1], 0.0]), np.array([walls[2], walls[3], 2.5])
    with np.errstate(divide="ignore"):
        range_to = (np.where(rays > 0, high, low) - SENSOR) / rays
    reach = np.where(np.isfinite(range_to), range_to, np.inf).min(1) + rng.normal(0, noise_m, len(rays))
    return (SENSOR + rays * reach[:, None])[reach < range_m].astype(np.float32)


def mapped(walls: Box, scans: int = 6) -> VoxelMap:
    voxels = VoxelMap(VoxelSettings(max_voxels=200_000))
    for seed in range(scans):
        voxels.insert(scan_of(walls, seed), SENSOR, seed)
    return voxels


@pytest.fixture(scope="module")
def room() -> VoxelMap:
    return mapped(ROOM)


def frame_of(points: NDArray[np.float32], odom_T_base: NDArray[np.float64], seq: int = 1) -> SyncedFrame:
    """Points of the robot's own frame as the synchroniser gives them for a robot at odom_T_base."""
    scan = DeskewedScan(seq, transform(odom_T_base, points), transform(odom_T_base, SENSOR[None])[0])
    view = CameraView(seq, odom_T_base, CameraModel("", 4, 3, np.eye(3), "plumb_bob", np.zeros(5)), None, None)
    return SyncedFrame(seq, seq, odom_T_base, scan, (view,))


def centres(planes: Planes) -> NDArray[np.int64]:
    """Integer coordinates [cells, 3] of every coarse cell, far away where its block is free."""
    place = np.arange(BLOCK_COARSE)
    inner = np.stack([place // 16, place // 4 % 4, place % 4], -1)
    blocks = np.where(planes.blocks[:, None] != 0, unpack_blocks(planes.blocks) * 4, 10**6)
    return (blocks[:, None, :] + inner[None]).reshape(-1, 3)


def test_nearest_planes_are_those_of_brute_force(room: VoxelMap) -> None:
    planes, size = room.planes, room.planes.cell_m
    rng = np.random.default_rng(1)
    points = scan_of(ROOM, 99)[::40]
    points = points + rng.uniform(-0.1, 0.1, points.shape)
    found = nearest_planes(points, SENSOR, planes, 1, 0.2, 0.5)
    cells = np.flatnonzero(np.abs(planes.normal).sum(1) > 0)
    places = centres(planes)[cells]
    hits = 0
    for point, got in zip(points, found, strict=True):
        own = np.floor(point / size).astype(int)
        at_home = cells[(places == own).all(1)]
        near = at_home if len(at_home) else cells[(np.abs(places - own) <= 1).all(1)]
        facing = (planes.normal[near] * (SENSOR - point)).sum(1) > 0
        good = near[(np.abs(planes.normal[near, 2]) <= 0.5) & facing]
        away = np.linalg.norm(planes.surface[good] - point, axis=1)
        if len(at_home):
            expected = int(good[0]) if len(good) else -1
        else:
            expected = int(good[away.argmin()]) if len(good) and away.min() < 0.2 else -1
        assert got == expected
        hits += expected >= 0
    assert 5 < hits < len(points)


def test_gradient_and_hessian_are_those_of_the_cost(room: VoxelMap) -> None:
    """Gauss-Newton on fixed pairs and weights: numeric derivatives of the residuals give the same system."""
    planes, pivot = room.planes, np.array([0.3, -0.2, 0.0])
    points = moved(scan_of(ROOM, 5)[::50], pivot, np.array([0.02, -0.01, 0.004]))
    cells = nearest_planes(points, SENSOR, planes, 1, 0.2, 0.5)
    there = cells >= 0
    normal, centre = planes.normal[cells[there]].astype(float), planes.surface[cells[there]].astype(float)

    def residuals(move: NDArray[np.float64]) -> NDArray[np.float64]:
        at = moved(points[there].astype(np.float32), pivot, move / np.array([1, 1, 3.0]))
        return ((at - centre) * normal).sum(1)

    step = 1e-3
    jacobian = np.stack([(residuals(step * e) - residuals(-step * e)) / (2 * step) for e in np.eye(3)], -1)
    here = ((points[there] - centre) * normal).sum(1)
    weight = (0.01 / (0.01 + here**2)) ** 2
    system = plane_system(points, cells, pivot, planes, 0.1)
    assert system.matched == there.sum()
    assert system.fit == pytest.approx(weight.mean())
    np.testing.assert_allclose(system.gradient, (weight * here) @ jacobian / weight.sum(), atol=1e-4)
    np.testing.assert_allclose(
        system.hessian, (jacobian * weight[:, None]).T @ jacobian / weight.sum(), rtol=1e-3, atol=1e-4
    )


@settings(max_examples=25, deadline=None)
@given(x=st.floats(-0.08, 0.08), y=st.floats(-0.08, 0.08), yaw=st.floats(-0.03, 0.03), seed=st.integers(100, 120))
def test_a_known_move_is_found(room: VoxelMap, x: float, y: float, yaw: float, seed: int) -> None:
    off = pose_from_xy_yaw(x, y, yaw)
    points = transform(off, scan_of(ROOM, seed))
    found = align(points[::8].copy(), np.zeros(3), SENSOR, room.planes, REACH, least=50, rounds=10)
    left = pose_from_xy_yaw(*found.move) @ off
    assert found.free == 3
    assert found.fit > 0.8
    assert np.hypot(*left[:2, 3]) < 0.006
    assert abs(yaw_of(left)) < 0.003


def test_along_a_corridor_odometry_is_left_alone() -> None:
    voxels = mapped(CORRIDOR)
    off = pose_from_xy_yaw(0.07, 0.05, 0.01)
    points = transform(off, scan_of(CORRIDOR, 50))
    found = align(points[::4].copy(), np.zeros(3), SENSOR, voxels.planes, REACH, least=50, rounds=10)
    assert found.free == 2
    assert found.move[0] == pytest.approx(0.0, abs=0.01)  # the shift along it is neither found nor invented
    assert found.move[1] == pytest.approx(-0.05, abs=0.01)
    assert found.move[2] == pytest.approx(-0.01, abs=0.003)


# ------------------------------------------------------------------------------------------------ the owner
def test_drift_is_taken_out_and_everything_moves_with_it(room: VoxelMap) -> None:
    localiser = Localiser(LocaliseSettings())
    drift = np.eye(4)
    for seq in range(1, 40):
        drift = drift @ pose_from_xy_yaw(0.01, -0.006, 0.002)  # it stands, and odometry slips 1 cm and 0.1 deg a sweep
        placed, where = localiser.place(frame_of(scan_of(ROOM, 200 + seq), drift, seq), room)
        assert where.state == "map"
        assert np.hypot(*placed.map_T_base[:2, 3]) < 0.04  # three sigma of a match, and the sweep's own slip
        assert abs(yaw_of(placed.map_T_base)) < 0.012
    np.testing.assert_allclose(where.map_T_odom @ drift, placed.map_T_base, atol=1e-9)
    np.testing.assert_allclose(placed.views[0].map_T_camera, placed.map_T_base, atol=1e-9)
    np.testing.assert_allclose(placed.scan.origin_map, transform(placed.map_T_base, SENSOR[None])[0], atol=1e-6)
    back = transform(invert(placed.map_T_base), placed.scan.points_map)
    np.testing.assert_allclose(back, scan_of(ROOM, 200 + 39), atol=1e-4)
    assert localiser.counters() == {
        "localise_matched": 39,
        "localise_thin": 0,
        "localise_bad_fit": 0,
        "localise_too_far": 0,
        "localise_degenerate": 0,
    }


@pytest.mark.parametrize(
    ("points", "why"), [(scan_of(ROOM, 1) + np.float32(40.0), "thin"), (scan_of(ROOM, 3, noise_m=0.1), "bad_fit")]
)
def test_a_bad_match_moves_nothing(room: VoxelMap, points: NDArray[np.float32], why: str) -> None:
    localiser = Localiser(LocaliseSettings(min_fit=0.8))
    for seq in range(5):
        placed, where = localiser.place(frame_of(points, pose_from_xy_yaw(0.0, 0.0, 0.0), seq), room)
        assert where.state == "odometry"
        np.testing.assert_array_equal(where.map_T_odom, np.eye(4))
        np.testing.assert_array_equal(placed.scan.points_map, points)
    assert localiser.counters()[f"localise_{why}"] == 5


def test_a_step_that_is_too_large_moves_nothing(room: VoxelMap) -> None:
    localiser = Localiser(LocaliseSettings(max_step_m=0.03))
    _, where = localiser.place(frame_of(scan_of(ROOM, 3), pose_from_xy_yaw(0.08, 0.0, 0.0)), room)
    assert where.state == "odometry"
    assert localiser.counters()["localise_too_far"] == 1


def test_switched_off_the_map_is_the_odometry_s_frame(room: VoxelMap) -> None:
    localiser = Localiser(LocaliseSettings(enabled=False))
    frame = frame_of(scan_of(ROOM, 3), pose_from_xy_yaw(0.05, 0.0, 0.0))
    placed, where = localiser.place(frame, room)
    assert where.state == "off"
    np.testing.assert_array_equal(placed.map_T_base, frame.map_T_base)


def test_the_first_sweep_and_an_empty_one_stay_where_odometry_has_them() -> None:
    localiser = Localiser(LocaliseSettings())
    empty = VoxelMap(VoxelSettings(max_voxels=1000))
    frame = frame_of(scan_of(ROOM, 3), pose_from_xy_yaw(1.0, 2.0, 0.3))
    placed, _ = localiser.place(frame, empty)
    np.testing.assert_array_equal(placed.map_T_base, frame.map_T_base)
    nothing = frame_of(np.zeros((0, 3), np.float32), pose_from_xy_yaw(1.0, 2.0, 0.3))
    assert localiser.place(nothing, mapped(ROOM, 1))[1].state == "odometry"
