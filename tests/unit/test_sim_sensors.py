"""The world's LiDAR, camera and detector: geometry exact without noise, noise as large as stated."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from irsd.core.geometry import pose_from_xy_yaw, transform
from irsd.sim.building import Building, Thing, make_building
from irsd.sim.detector import Detector, DetectorSettings
from irsd.sim.sensors import CameraSettings, Eyes, LidarSettings, mountings

CLEAN = LidarSettings(noise_m=0.0, drop_share=0.0)


@pytest.fixture(scope="module")
def building() -> Building:
    return make_building(2)


@pytest.fixture(scope="module")
def eyes(building: Building) -> Eyes:
    return Eyes(building, CLEAN, CameraSettings())


def moving_poses(eyes: Eyes) -> np.ndarray:
    """A turn of the LiDAR while the robot drives at 1 m/s and turns at 1.5 rad/s."""
    t = eyes.column_times_s()
    return np.column_stack([0.2 + 1.0 * t, 0.1 * t, 0.3 + 1.5 * t])


def off_their_things(building: Building, points_world: np.ndarray, things: np.ndarray) -> np.ndarray:
    """How far each point lies outside of the box of the thing that it was measured on."""
    lo = np.array([t.aabb_min_m for t in building.things])[things - 1]
    hi = np.array([t.aabb_max_m for t in building.things])[things - 1]
    return np.maximum(np.maximum(lo - points_world, points_world - hi), 0).max(1)


def test_moving_sweep_falls_into_place_when_each_point_is_moved_by_its_own_pose(building: Building, eyes: Eyes) -> None:
    poses = moving_poses(eyes)
    sweep = eyes.sweep(10**9, poses, -3.0, np.random.default_rng(0))
    times = sweep.scan.time_offset_s
    assert times is not None
    column = np.rint(times / eyes.column_times_s()[1]).astype(int)
    base_T_lidar = mountings()[0].parent_T_child
    world = np.empty((len(column), 3))
    for k in np.unique(column):
        pose = pose_from_xy_yaw(*poses[k]) @ base_T_lidar
        world[column == k] = transform(pose, sweep.scan.points_sensor[column == k].astype(np.float64))
    assert len(world) > 6000
    assert off_their_things(building, world, sweep.thing).max() < 2e-3
    # the same points with one pose for all do not: the distortion is really in the scan
    middle = pose_from_xy_yaw(*poses[len(poses) // 2]) @ base_T_lidar
    smeared = transform(middle, sweep.scan.points_sensor.astype(np.float64))
    assert np.quantile(off_their_things(building, smeared, sweep.thing), 0.9) > 0.05


def test_range_noise_and_dropouts_are_as_stated(building: Building, eyes: Eyes) -> None:
    noisy = Eyes(building, LidarSettings(), CameraSettings())
    poses = np.zeros((CLEAN.columns, 3))
    clean = np.linalg.norm(eyes.sweep(0, poses, 0.0, np.random.default_rng(1)).scan.points_sensor, axis=1)
    errors, kept = [], 0
    for seed in range(10):
        sweep = noisy.sweep(0, poses, 0.0, np.random.default_rng(seed))
        kept += len(sweep.scan.points_sensor)
        if len(sweep.scan.points_sensor) == len(clean):
            errors.append(np.linalg.norm(sweep.scan.points_sensor, axis=1) - clean)
    assert 1 - kept / (10 * len(clean)) == pytest.approx(0.005, abs=0.0015)
    whole = Eyes(building, dataclasses.replace(CLEAN, noise_m=0.015), CameraSettings())
    ranges = np.linalg.norm(whole.sweep(0, poses, 0.0, np.random.default_rng(3)).scan.points_sensor, axis=1)
    assert (ranges - clean).std() == pytest.approx(0.015, rel=0.05)
    assert abs((ranges - clean).mean()) < 1e-3


def test_camera_depth_and_ids_agree_with_the_building(building: Building, eyes: Eyes) -> None:
    pose = pose_from_xy_yaw(0.3, 0.1, 0.7)
    shot = eyes.expose(5, pose, np.random.default_rng(0))
    assert shot.image.bgr.shape == (480, 640, 3)
    assert shot.ids_px.shape == (480, 640)
    model = eyes.camera_model
    v, u = np.mgrid[:240, :320]
    x = (2 * u + 0.5 - model.matrix[0, 2]) / model.matrix[0, 0] * shot.depth_m
    y = (2 * v + 0.5 - model.matrix[1, 2]) / model.matrix[1, 1] * shot.depth_m
    points = np.stack([x, y, shot.depth_m], -1).reshape(-1, 3).astype(np.float64)
    _, link, optical = (m.parent_T_child for m in mountings())
    world = transform(pose @ link @ optical, points)
    ids = shot.ids_px[::2, ::2].ravel().astype(int)
    assert (ids > 0).all()  # the building is closed
    assert off_their_things(building, world, ids).max() < 3e-3


def test_camera_looks_ahead_and_down(eyes: Eyes) -> None:
    shot = eyes.expose(0, pose_from_xy_yaw(0.0, 0.0, 0.0), np.random.default_rng(0))
    # the lower picture border sees the floor, 5 degrees of nose down and 29 of half the picture below the axis
    ray = np.deg2rad(5) + np.arctan((479 - 239.5) / eyes.camera_model.matrix[1, 1])
    expected = 0.9 / np.sin(ray) * np.cos(ray - np.deg2rad(5))
    assert shot.depth_m[-1, 160] == pytest.approx(expected, rel=0.01)


# ------------------------------------------------------------------------------------------------------- detector
def scene_of_blobs() -> tuple[tuple[Thing, ...], np.ndarray]:
    """Twelve separate things of 40 x 50 px, two that touch, a tiny one, a wall and a door."""
    zero = np.zeros(3)
    ids = np.zeros((480, 640), np.uint16)
    things = []
    for k in range(12):
        things.append(Thing(k + 1, f"thing{k}", ("word",), 0, zero, zero))
        row, col = 20 + 110 * (k // 4), 20 + 150 * (k % 4)
        ids[row : row + 50, col : col + 60] = k + 1
    for number, label, where in ((13, "wall", 400), (14, "door", 440)):
        things.append(Thing(number, label, (), -1, zero, zero))
        ids[where : where + 30, 10:300] = number
    things.append(Thing(15, "speck", (), 0, zero, zero))
    ids[470:480, 600:614] = 15
    return tuple(things), ids


def test_detector_errs_as_often_as_stated() -> None:
    things, ids = scene_of_blobs()
    detector = Detector(things, DetectorSettings())
    rng = np.random.default_rng(7)
    frames = 500
    seen, parts, names, doors, orders = 0, 0, [], 0, set()
    for stamp in range(frames):
        found = detector.detect(stamp, "camera_optical", ids, rng)
        assert sorted(found.number.tolist()) == sorted(set(np.unique(found.ids_px).tolist()) - {0})
        assert ((found.score >= 0.2) & (found.score <= 0.98)).all()
        first = []
        for k in range(12):
            values = np.unique(found.ids_px[ids == k + 1])
            values = values[values > 0]
            inside = [v for v in values if (found.ids_px[ids == k + 1] == v).sum() > 100]
            seen += bool(inside)
            parts += len(inside) > 1
            names += [found.label[found.number.tolist().index(v)] == f"thing{k}" for v in inside]
            first += inside[:1]
        orders.add(tuple(first))
        doors += bool((found.ids_px[ids == 14] > 0).mean() > 0.5)
        assert (found.ids_px[405:425, 20:280] == 0).all()  # walls are never named
        assert (found.ids_px[ids == 15] == 0).all()  # nor is what is too small
    total = 12 * frames
    assert 1 - seen / total == pytest.approx(0.08, abs=0.015)
    assert parts / seen == pytest.approx(0.10, abs=0.02)
    assert 1 - np.mean(names) == pytest.approx(0.33, abs=0.03)
    assert doors / frames == pytest.approx(0.30 * 0.92, abs=0.06)
    assert len(orders) > frames * 0.9  # numbers mean nothing across pictures


def test_detector_fuses_only_what_touches() -> None:
    zero = np.zeros(3)
    things = tuple(Thing(k, f"thing{k}", (), 0, zero, zero) for k in (1, 2, 3))
    ids = np.zeros((200, 300), np.uint16)
    ids[50:110, 40:100], ids[50:110, 100:160], ids[50:110, 220:280] = 1, 2, 3
    settings = DetectorSettings(miss=0.0, split=0.0, fuse=1.0, shrink_px=0, grow_px=0, wrong_name=0.0, other_word=0.0)
    for seed in range(20):
        found = Detector(things, settings).detect(0, "c", ids, np.random.default_rng(seed))
        assert len(found.number) == 2
        assert len(np.unique(found.ids_px[(ids == 1) | (ids == 2)])) == 1
        assert found.ids_px[80, 250] != found.ids_px[80, 70]


def test_detector_of_an_empty_picture_sees_nothing() -> None:
    things, _ = scene_of_blobs()
    empty = np.zeros((480, 640), np.uint16)
    found = Detector(things, DetectorSettings()).detect(3, "c", empty, np.random.default_rng(0))
    assert found.number.shape == (0,)
    assert found.label == ()
    assert not found.ids_px.any()


def test_detector_is_deterministic() -> None:
    things, ids = scene_of_blobs()
    a, b = (Detector(things, DetectorSettings()).detect(0, "c", ids, np.random.default_rng(4)) for _ in range(2))
    assert a.ids_px.tobytes() == b.ids_px.tobytes()
    assert (a.label, a.top_labels) == (b.label, b.top_labels)
