"""What must hold of rooms whatever the building: where the world lies does not matter, nor in which order scans of one stamp come."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from irsd.core.types import DeskewedScan, Rooms, SyncedFrame
from irsd.mapping.mapper import Mapper, MappingSettings
from irsd.rooms.segment import segment_map
from irsd.rooms.stage import RoomSettings, RoomStage

CELL_M = 0.05


def flat(door_m: float, corridor_m: float, left_m: float) -> NDArray[np.bool_]:
    """bool [H, W] free cells: a corridor with two rooms above it, one door each."""
    free = np.zeros((220, 300), bool)
    width, top = round(corridor_m / CELL_M), 30
    split = 20 + round(left_m / CELL_M)
    free[top : top + width, 20:280] = True
    rooms = top + width + 4
    free[rooms:200, 20:split] = True
    free[rooms:200, split + 4 : 280] = True
    for column in (40, 220):
        free[top + width : rooms, column : column + round(door_m / CELL_M)] = True
    return free


def turned(free: NDArray[np.bool_], angle_rad: float) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """The plan turned about its middle on a larger grid; and the matrix [2, 3] from old cells (x, y) to new ones."""
    height, width = free.shape
    size = int(np.ceil(np.hypot(height, width))) + 20
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    old, new = np.array([width / 2, height / 2]), np.array([size / 2, size / 2])
    rotation = np.array([[c, -s], [s, c]])
    rows, columns = np.indices((size, size))
    source = (np.stack([columns, rows], -1) - new) @ rotation + old
    cell = np.rint(source).astype(int)
    inside = (cell >= 0).all(-1) & (cell[..., 0] < width) & (cell[..., 1] < height)
    out = np.zeros((size, size), bool)
    out[inside] = free[cell[inside][:, 1], cell[inside][:, 0]]
    return out, np.column_stack([rotation, new - rotation @ old])


def picture(free: NDArray[np.bool_]) -> NDArray[np.uint8]:
    return np.where(free, 255, 0).astype(np.uint8)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    angle_rad=st.floats(0, 2 * np.pi),
    door_m=st.floats(0.8, 1.2),
    corridor_m=st.floats(1.5, 2.2),
    left_m=st.floats(4.0, 8.0),
)
def test_turning_the_world_changes_nothing_but_coordinates(
    angle_rad: float, door_m: float, corridor_m: float, left_m: float
) -> None:
    free = flat(door_m, corridor_m, left_m)
    turned_free, matrix = turned(free, angle_rad)
    one, other = segment_map(picture(free), CELL_M), segment_map(picture(turned_free), CELL_M)
    assert len(one.rooms) == len(other.rooms) == 3
    assert len(one.openings) == len(other.openings) == 2
    rows, columns = np.nonzero(one.labels)
    there = np.rint(np.stack([columns, rows], 1) @ matrix[:, :2].T + matrix[:, 2]).astype(int)
    pairs = np.stack([one.labels[rows, columns], other.labels[there[:, 1], there[:, 0]]], 1)
    for k in (1, 2, 3):
        partner = np.bincount(pairs[pairs[:, 0] == k, 1]).argmax()
        assert partner > 0
        assert (pairs[pairs[:, 0] == k, 1] == partner).mean() > 0.94


@settings(max_examples=12, deadline=None, derandomize=True)
@given(width_m=st.floats(2.0, 9.0), depth_m=st.floats(2.0, 9.0), angle_rad=st.floats(0, 2 * np.pi))
def test_one_closed_box_is_one_room_of_its_size(width_m: float, depth_m: float, angle_rad: float) -> None:
    free = np.zeros((220, 220), bool)
    free[10 : 10 + round(depth_m / CELL_M), 10 : 10 + round(width_m / CELL_M)] = True
    found = segment_map(picture(turned(free, angle_rad)[0]), CELL_M)
    assert len(found.rooms) == 1
    assert found.openings == ()
    assert found.rooms[0].area_m2 == pytest.approx(width_m * depth_m, rel=0.08)


def box_cloud(seed: int) -> NDArray[np.float32]:
    """Points of the inside of a closed box of 5 x 4 x 2.6 m around (2.5, 2, 0)."""
    rng = np.random.default_rng(seed)
    points = rng.uniform((0, 0, 0), (5, 4, 2.6), (6000, 3))
    side, axis = rng.integers(0, 2, 6000), rng.integers(0, 3, 6000)
    points[np.arange(6000), axis] = np.where(side == 1, np.array([5, 4, 2.6])[axis], 0.0)
    return points.astype(np.float32)


def rooms_of(scans: list[SyncedFrame]) -> Rooms:
    mapper, stage = Mapper(MappingSettings()), RoomStage(RoomSettings())
    for scan in scans:
        mapper.integrate(scan)
    return stage.update(mapper.plan_evidence(), *mapper.wall_points())


def scan_at(x: float, y: float, seed: int, stamp_ns: int) -> SyncedFrame:
    pose = np.eye(4)
    pose[:2, 3] = x, y
    return SyncedFrame(seed, stamp_ns, pose, DeskewedScan(stamp_ns, box_cloud(seed), np.array([x, y, 0.8])), ())


def test_a_cloud_of_one_closed_box_is_one_room_drawn_to_its_walls() -> None:
    rooms = rooms_of([scan_at(2.5, 2.0, k, k) for k in range(12)])
    assert rooms.ids == (1,)
    assert rooms.openings == ()
    np.testing.assert_allclose(rooms.footprints[0].aabb_xy, (0, 0, 5, 4), atol=0.1)
    assert rooms.footprints[0].floor_z_m == pytest.approx(0.0, abs=0.05)
    assert rooms.footprints[0].ceiling_z_m == pytest.approx(2.6, abs=0.05)


def test_the_order_of_two_scans_of_one_stamp_does_not_matter() -> None:
    before = [scan_at(2.5, 2.0, k, k) for k in range(4)]
    a, b = scan_at(2.0, 1.5, 11, 9), scan_at(3.0, 2.5, 12, 9)
    one, other = rooms_of([*before, a, b]), rooms_of([*before, b, a])
    assert one.ids == other.ids
    assert (one.labels != other.labels).mean() < 0.002  # log-odds are clamped, so single cells may differ
    for f, g in zip(one.footprints, other.footprints, strict=True):
        np.testing.assert_allclose(f.aabb_xy, g.aabb_xy, atol=0.02)


def test_a_world_elsewhere_has_the_same_rooms_elsewhere() -> None:
    here = rooms_of([scan_at(2.5, 2.0, k, k) for k in range(12)])
    moved, shift = [], np.array([12.8, -6.4, 0.0])
    for k in range(12):
        frame = scan_at(2.5, 2.0, k, k)
        pose = frame.map_T_base.copy()
        pose[:3, 3] += shift
        scan = DeskewedScan(k, (frame.scan.points_map + shift).astype(np.float32), frame.scan.origin_map + shift)
        moved.append(SyncedFrame(k, k, pose, scan, ()))
    there = rooms_of(moved)
    assert there.ids == here.ids
    offset = np.tile(shift[:2], 2)
    np.testing.assert_allclose(np.subtract(there.footprints[0].aabb_xy, offset), here.footprints[0].aabb_xy, atol=0.05)


def test_an_empty_map_has_no_rooms_by_either_method() -> None:
    for method in ("ours", "irs"):
        stage, mapper = RoomStage(RoomSettings(method=method)), Mapper(MappingSettings())
        assert stage.follow(mapper, (0.0, 0.0)).ids == ()
        assert stage.update(mapper.plan_evidence(), *mapper.wall_points()).ids == ()


def test_algorithm_1_keeps_one_box_per_room() -> None:
    mapper, stage = Mapper(MappingSettings()), RoomStage(RoomSettings(method="irs"))
    for k in range(12):
        mapper.integrate(scan_at(2.5, 2.0, k, k))
        stage.follow(mapper, (2.5, 2.0))
    rooms = stage.update(mapper.plan_evidence(), *mapper.wall_points(), ((2.5, 2.0),))
    assert rooms.ids == (1,)
    np.testing.assert_allclose(rooms.footprints[0].aabb_xy, (0, 0, 5, 4), atol=0.1)
    assert len(rooms.footprints[0].polygon_xy) == 4
