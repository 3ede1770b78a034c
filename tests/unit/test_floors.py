"""Floors of the building: found along the trajectory, and no room on two of them. The two-storey house is ray cast exactly."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.core.types import DeskewedScan, Rooms, SyncedFrame
from irsd.mapping.floors import Floors, FloorSettings
from irsd.mapping.mapper import Mapper, MappingSettings
from irsd.rooms.stage import RoomSettings, RoomStage

STOREY_M = 3.0


def test_a_building_without_stairs_has_one_floor_that_follows_drift() -> None:
    floors = Floors(FloorSettings())
    for k in range(400):
        assert floors.update(0.002 * k, 0.002 * k) == 0
    assert len(floors.heights_m) == 1
    assert floors.heights_m[0] == pytest.approx(0.8, abs=0.1)


def test_stairs_are_no_floor_and_the_way_back_leads_to_the_floor_known() -> None:
    floors = Floors(FloorSettings())
    climb = np.linspace(0.0, STOREY_M, 31)
    path = [0.0] * 10 + climb.tolist() + [STOREY_M] * 10 + climb[::-1].tolist() + [0.0] * 10
    seen = [floors.update(z, z) for z in path]
    assert set(seen[:10]) == {0}
    assert None in seen[10:41]
    assert seen[50] == 1
    assert seen[-1] == 0
    assert floors.heights_m == pytest.approx((0.0, STOREY_M), abs=0.15)


def boxes() -> NDArray[np.float64]:
    """Walls, slabs and door lintels of two equal storeys as boxes [B, 6] (low xyz, high xyz): two rooms of 5 x 5 m with a door each;
    upstairs one wall stands elsewhere. The stairs lead through a hole in the slab at the far end."""
    out = []
    for z0, partition in ((0.0, 5.0), (STOREY_M, 6.5)):
        z1 = z0 + 2.6
        for x0, y0, x1, y1 in ((-0.2, -0.2, 10.4, 0), (-0.2, 5, 10.4, 5.2), (-0.2, 0, 0, 5), (10.2, 0, 10.4, 5)):
            out.append((x0, y0, z0, x1, y1, z1))
        out.append((partition, 0.0, z0, partition + 0.2, 2.0, z1))
        out.append((partition, 2.9, z0, partition + 0.2, 5.0, z1))
        out.append((partition, 2.0, z0 + 2.1, partition + 0.2, 2.9, z1))
    out.append((-0.2, -0.2, -0.3, 10.4, 5.2, 0.0))
    out.append((-0.2, -0.2, 2.6, 8.7, 5.2, STOREY_M))
    out.append((8.7, 1.5, 2.6, 10.4, 5.2, STOREY_M))
    out.append((-0.2, -0.2, STOREY_M + 2.6, 10.4, 5.2, STOREY_M + 2.8))
    return np.array(out)


def cast(
    origin: NDArray[np.float64], direction: NDArray[np.float64], solid: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance [R] to the first box that rays from one origin hit, by slabs."""
    with np.errstate(divide="ignore"):
        inverse = 1.0 / direction
    near = (solid[:, None, :3] - origin) * inverse
    far = (solid[:, None, 3:] - origin) * inverse
    enter, leave = np.minimum(near, far).max(2), np.maximum(near, far).min(2)
    return np.where((enter <= leave) & (enter > 0), enter, np.inf).min(0)


def walk() -> list[tuple[float, float, float]]:
    """Base positions: through both rooms, up the stairs at the far end, and through both rooms upstairs."""
    along = [(x, 2.45, 0.0) for x in np.arange(1.0, 9.4, 0.2)]
    to_stairs = [(9.4, y, 0.0) for y in np.arange(2.4, 0.7, -0.2)]
    stairs = [(9.4, 0.7, z) for z in np.arange(0.1, STOREY_M, 0.1)]
    off = [(9.4, y, STOREY_M) for y in np.arange(0.7, 2.5, 0.2)]
    back = [(x, 2.45, STOREY_M) for x in np.arange(9.2, 1.0, -0.2)]
    return [*along, *to_stairs, *stairs, *off, *back]


def climb() -> tuple[Mapper, Rooms, list[Rooms]]:
    rng = np.random.default_rng(3)
    solid, mapper, stage, history = boxes(), Mapper(MappingSettings()), RoomStage(RoomSettings()), []
    for k, place in enumerate(walk()):
        azimuth = np.linspace(0, 2 * np.pi, 120, endpoint=False) + rng.uniform(0, 1)
        elevation = np.radians(np.linspace(-40, 60, 24))
        a, e = (g.ravel() for g in np.meshgrid(azimuth, elevation))
        direction = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)
        origin = np.add(place, (0.0, 0.0, 0.8))
        length = cast(origin, direction, solid)
        seen = np.isfinite(length)
        points = (origin + direction[seen] * length[seen, None]).astype(np.float32)
        pose = np.eye(4)
        pose[:3, 3] = place
        mapper.integrate(SyncedFrame(k, k * 200_000_000, pose, DeskewedScan(k * 200_000_000, points, origin), ()))
        history.append(stage.follow(mapper, (place[0], place[1])))
    return mapper, stage.update(mapper.plan_evidence(), *mapper.wall_points()), history


def test_a_two_storey_house_has_two_floors_and_no_room_spans_both() -> None:
    mapper, rooms, history = climb()
    assert mapper.floors.heights_m == pytest.approx((0.0, STOREY_M), abs=0.1)
    by_floor = {k: [f for f in rooms.footprints if f.floor == k] for k in (0, 1)}
    assert [len(by_floor[k]) for k in (0, 1)] == [2, 2]
    for k, partition_m in ((0, 5.0), (1, 6.5)):
        assert [f.floor_z_m for f in by_floor[k]] == pytest.approx([k * STOREY_M] * 2, abs=0.1)
        sizes = sorted(f.aabb_xy[2] - f.aabb_xy[0] for f in by_floor[k])
        assert sizes == pytest.approx(sorted([partition_m, 10.0 - partition_m]), abs=0.35)
    floor_of: dict[int, int] = {}
    for step in history:
        for number, footprint in zip(step.ids, step.footprints, strict=True):
            assert floor_of.setdefault(number, footprint.floor) == footprint.floor
    doors = {o.rooms: o for o in rooms.openings}
    assert len(doors) == 2
    assert all(floor_of[a] == floor_of[b] for a, b in doors)
    assert all(o.traversed for o in doors.values())
