"""Structure labels in a made room whose surfaces are known, at any height and heading."""

from __future__ import annotations

import numpy as np
import pytest

from irsd.core.types import CameraModel, DeskewedScan, Structure, SyncedFrame
from irsd.mapping.kernels import BLOCK_COARSE
from irsd.mapping.mapper import Mapper, MappingSettings
from irsd.mapping.structure import Levels, StructureSettings
from irsd.mapping.voxels import VoxelSettings

HEIGHT = 2.6


def surfaces(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points of a 5 x 4 m room, floor at 0, sensor at (0, 0): walls, floor, ceiling, a table, a wardrobe, a flat screen."""

    def sheet(count, x, y, z):
        return np.stack(
            [rng.uniform(*span, count) if span[0] < span[1] else np.full(count, span[0]) for span in (x, y, z)], -1
        )

    room, up = ((-2.5, 2.5), (-2.0, 2.0)), (0.0, HEIGHT)
    parts = [
        (Structure.FLOOR, sheet(1800, *room, (0, 0))),
        (Structure.CEILING, sheet(1500, *room, (HEIGHT, HEIGHT))),
        (Structure.WALL, sheet(900, (2.5, 2.5), room[1], up)),
        (Structure.WALL, sheet(900, (-2.5, -2.5), room[1], up)),
        (Structure.WALL, sheet(900, room[0], (2.0, 2.0), up)),
        (Structure.WALL, sheet(900, room[0], (-2.0, -2.0), up)),
        (Structure.OTHER, sheet(300, (0.8, 1.8), (-0.5, 0.5), (0.74, 0.74))),
        (Structure.OTHER, sheet(500, (-2.0, -0.8), (1.4, 1.4), (0.0, 2.0))),
        (Structure.OTHER, sheet(250, (0.2, 1.4), (1.94, 1.94), (1.0, 1.7))),
    ]
    screen = (parts[4][1][:, 0] > 0.15) & (parts[4][1][:, 0] < 1.45) & (np.abs(parts[4][1][:, 2] - 1.35) < 0.4)
    parts[4] = (Structure.WALL, parts[4][1][~screen])  # the screen hides what is behind it
    labels = np.concatenate([np.full(len(points), label) for label, points in parts])
    return np.concatenate([points for _, points in parts]), labels


def driven(yaw: float, floor: float, scans: int = 30) -> tuple[Mapper, np.ndarray, np.ndarray]:
    """A mapper that saw the room turned by yaw with its floor at ``floor``, and the last scan with its true labels."""
    rng = np.random.default_rng(11)
    mapper = Mapper(MappingSettings())
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    base = np.eye(4)
    base[2, 3] = floor + 0.03  # a base that is not on the floor
    for seq in range(scans):
        points, labels = surfaces(rng)
        points = points @ turn.T + (0, 0, floor) + rng.normal(0, 0.008, points.shape)
        scan = DeskewedScan(seq, points.astype(np.float32), np.array([0, 0, floor + 0.6]))
        update = mapper.integrate(SyncedFrame(seq, seq, base, scan, ()))
    assert update.floor_z_m == pytest.approx(floor, abs=0.02)
    assert update.ceiling_z_m == pytest.approx(floor + HEIGHT, abs=0.02)
    return mapper, scan.points_map, labels


@pytest.mark.parametrize(("yaw", "floor"), [(0.0, 0.0), (0.4, -1.37), (2.9, 4.21)])
def test_floor_ceiling_walls_and_things_are_told_apart(yaw, floor):
    mapper, points, labels = driven(yaw, floor)
    got = mapper.voxels.structure[mapper.voxels.rows_at(points)]
    for structure, least in (
        (Structure.FLOOR, 0.97),
        (Structure.CEILING, 0.97),
        (Structure.WALL, 0.75),
        (Structure.OTHER, 0.9),
    ):
        assert (got[labels == structure] == structure).mean() > least, structure
    walls, normals = mapper.wall_points()
    assert walls.shape == normals.shape
    assert len(walls) > 1000
    inward = -(walls[:, :2] * normals[:, :2]).sum(-1)
    assert (inward > 0).mean() > 0.99


def test_visible_points_are_those_a_brute_projection_finds():
    mapper, _, _ = driven(0.0, 0.0, scans=8)
    matrix = np.array([[300.0, 0, 160], [0, 300.0, 120], [0, 0, 1]])
    camera = CameraModel("camera", 320, 240, matrix, "plumb_bob", np.zeros(0))
    map_T_camera = np.array([[0, 0, 1, 0.3], [-1, 0, 0, 0.1], [0, -1, 0, 0.9], [0, 0, 0, 1.0]])
    points, structure = mapper.visible(map_T_camera, camera, 2.0)
    everything = mapper.voxels.mean[mapper.voxels.live_rows()].astype(np.float64)
    seen = (everything - map_T_camera[:3, 3]) @ map_T_camera[:3, :3]
    u, v = (seen[:, :2] / seen[:, 2:] * 300 + (160, 120)).T
    inside = (seen[:, 2] > 0) & (u > 0) & (u < 320) & (v > 0) & (v < 240) & (np.linalg.norm(seen, axis=-1) < 2.0)
    got = {tuple(p) for p in points.tolist()}
    expected = {tuple(p) for p in everything[inside].astype(np.float32).tolist()}
    assert expected <= got
    assert len(got) < 1.25 * len(expected)  # no more than the margin around the picture
    assert len(structure) == len(points)


def test_fisheye_sees_more_than_a_pinhole_and_nothing_behind():
    mapper, _, _ = driven(0.0, 0.0, scans=3)
    matrix = np.array([[100.0, 0, 160], [0, 100.0, 120], [0, 0, 1]])
    map_T_camera = np.array([[0, 0, 1, 0.0], [-1, 0, 0, 0.0], [0, -1, 0, 0.9], [0, 0, 0, 1.0]])
    fisheye = CameraModel("camera", 320, 240, matrix, "equidistant", np.zeros(4))
    points, _ = mapper.visible(map_T_camera, fisheye, 10.0)
    angle = np.arctan2(np.hypot(points[:, 1], points[:, 2] - 0.9), points[:, 0])
    assert angle.max() <= 2.2 + 1e-3  # 1.1 * the picture's corner at 2.0 rad
    assert len(points) > 1000


def test_an_empty_mapper_answers_and_an_empty_scan_is_taken():
    mapper = Mapper(MappingSettings())
    empty = DeskewedScan(5, np.zeros((0, 3), np.float32), np.array([0, 0, 0.6]))
    update = mapper.integrate(SyncedFrame(1, 5, np.eye(4), empty, ()))
    assert len(update.rows) == 0
    assert update.changed_xy_m is None
    assert update.ceiling_z_m is None
    camera = CameraModel("camera", 320, 240, np.diag([300.0, 300, 1]), "plumb_bob", np.zeros(5))
    assert len(mapper.visible(np.eye(4), camera, 5.0)[0]) == 0
    assert mapper.wall_points()[0].shape == (0, 3)
    assert mapper.plan_evidence().known.shape == (0, 0)
    assert mapper.navigation_grid()[1].shape == (0, 0)


def test_the_same_scans_give_the_same_map():
    one, two = driven(0.3, 0.0, scans=4)[0], driven(0.3, 0.0, scans=4)[0]
    rows, cells = one.voxels.row_count, one.voxels.slot_count * BLOCK_COARSE
    for name, end in (("mean", rows), ("structure", rows), ("hits", rows), ("coarse", rows), ("normal", cells)):
        np.testing.assert_array_equal(getattr(one.voxels, name)[:end], getattr(two.voxels, name)[:end])
    np.testing.assert_array_equal(one.grid.odds, two.grid.odds)


def test_nothing_in_the_map_is_nan_whatever_comes():
    mapper = Mapper(MappingSettings(voxels=VoxelSettings(max_voxels=2000)))
    rng = np.random.default_rng(12)
    for seq in range(6):
        points = rng.uniform(-8, 8, (1500, 3)).astype(np.float32)
        points[rng.integers(0, 1500, 20)] = np.nan
        points[0] = (0, 0, 0.6)  # a return at the sensor itself
        mapper.integrate(SyncedFrame(seq, seq, np.eye(4), DeskewedScan(seq, points, np.array([0, 0, 0.6])), ()))
    for values in (mapper.voxels.mean, mapper.voxels.normal, mapper.voxels.surface):
        assert np.isfinite(values).all()
    assert len(mapper.voxels) <= 2000
    assert mapper.counters()["points_ignored"] >= 100


@pytest.mark.parametrize(("slope", "floor"), [(0.0, -0.8), (0.02, 0.0), (-0.02, 5.0)])
def test_the_floor_is_found_below_tables_on_slopes_and_in_noise(slope, floor):
    rng = np.random.default_rng(13)
    levels = Levels(StructureSettings())
    for _ in range(10):
        xy = rng.uniform(-4, 4, (900, 2))
        z = floor + slope * xy[:, 0] + rng.normal(0, 0.01, 900)
        z[:250] = floor + 0.75  # a large table
        z[250:500] = floor + 3.1
        points = np.column_stack([xy, z]).astype(np.float32)
        normals = np.tile(np.array([0, 0, 1], np.float32), (900, 1))
        levels.update(points, normals, np.array([0, 0, floor + 0.1]), floor + 0.7)
    assert levels.floor_z_m == pytest.approx(floor, abs=0.04)
    assert levels.ceiling_z_m == pytest.approx(floor + 3.1, abs=0.02)
