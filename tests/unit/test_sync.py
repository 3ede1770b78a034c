"""Synchronisation: deskew against the exact motion, order, lateness, bounds, and who is to blame for a standstill."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from irsd.core.geometry import invert, make_pose, transform
from irsd.core.types import (
    CameraImage,
    CameraModel,
    CameraView,
    Detections,
    LidarScan,
    OdomSample,
    StaticTransform,
    SyncedFrame,
)
from irsd.sensors.motion import MountTree, PoseTrack
from irsd.sensors.sync import Synchronizer, SyncSettings

T0 = 1_700_000_000_000_000_000
BASE_T_LIDAR = make_pose(np.array([0.2, -0.1, 0.6]), Rotation.from_euler("xyz", [0.02, -0.1, 0.3]).as_quat())
BASE_T_LINK = make_pose(np.array([0.15, 0.0, 0.9]), Rotation.from_euler("y", 5, degrees=True).as_quat())
LINK_T_OPTICAL = make_pose(np.zeros(3), np.array([-0.5, 0.5, -0.5, 0.5]))
MOUNTS = (
    StaticTransform("base_link", "lidar", BASE_T_LIDAR),
    StaticTransform("camera_link", "cam", LINK_T_OPTICAL),
    StaticTransform("base_link", "camera_link", BASE_T_LINK),
)
CAMERA = CameraModel("cam", 8, 6, np.array([[5.0, 0, 3.5], [0, 5.0, 2.5], [0, 0, 1]]), "plumb_bob", np.zeros(0))


def ns(seconds: float) -> int:
    return T0 + round(seconds * 1e9)


def odom_T_base(seconds: float, speed_m_s: float = 1.0, turn_rad_s: float = 1.5) -> np.ndarray:
    """A robot on a circle: exact pose at any instant."""
    yaw, radius = turn_rad_s * seconds, speed_m_s / turn_rad_s
    position = np.array([radius * np.sin(yaw), radius * (1 - np.cos(yaw)), 0.0])
    return make_pose(position, np.array([0, 0, np.sin(yaw / 2), np.cos(yaw / 2)]))


def odometry(seconds: float, **motion: float) -> OdomSample:
    pose = odom_T_base(seconds, **motion)
    return OdomSample(ns(seconds), "odom", "base_link", pose[:3, 3], Rotation.from_matrix(pose[:3, :3]).as_quat())


def scan(
    seconds: float, points: np.ndarray | None = None, times: np.ndarray | None = None, frame: str = "lidar"
) -> LidarScan:
    points = np.ones((2, 3), np.float32) if points is None else points
    return LidarScan(ns(seconds), frame, points.astype(np.float32), None if times is None else times.astype(np.float32))


def detections(seconds: float, shape: tuple[int, int] = (6, 8)) -> Detections:
    nothing = np.zeros(0)
    return Detections(
        ns(seconds),
        "cam",
        np.zeros(shape, np.uint16),
        nothing.astype(np.int32),
        nothing.astype(np.float32),
        (),
        (),
        None,
    )


def image(seconds: float) -> CameraImage:
    return CameraImage(ns(seconds), "cam", np.zeros((6, 8, 3), np.uint8))


def ready(**changes: object) -> Synchronizer:
    """Mounted, with odometry from 0 to 1 s."""
    sync = Synchronizer(replace(SyncSettings(), **changes))
    for mount in MOUNTS:
        sync.push(mount)
    for k in range(21):
        sync.push(odometry(k * 0.05))
    return sync


def test_nothing_gives_nothing_and_says_who_is_missing() -> None:
    sync = Synchronizer(SyncSettings())
    assert sync.pop() == []
    assert sync.flush() == []
    assert sync.blocked_by() == "lidar, odometry: nothing received yet"
    assert not any(sync.counters().values())


def test_a_standing_world_stands_still_after_deskew() -> None:
    """Points of fixed places, each seen from the pose of its own instant, in shuffled order of time: within 1 mm of the truth."""
    rng = np.random.default_rng(3)
    places = rng.uniform(-15, 15, (3000, 3))
    times = rng.permutation(np.linspace(0, 0.2, 3000))
    seen = np.stack(
        [transform(invert(odom_T_base(0.3 + t) @ BASE_T_LIDAR), p[None])[0] for p, t in zip(places, times, strict=True)]
    )
    sync = Synchronizer(SyncSettings())
    for mount in MOUNTS:
        sync.push(mount)
    for k in range(101):  # 100 Hz: what is tested is the deskew, not how well 20 Hz chords follow a circle
        sync.push(odometry(k * 0.01))
    sync.push(scan(0.3, seen, times))
    (frame,) = sync.pop()
    assert np.linalg.norm(frame.scan.points_map - places, axis=1).max() < 1e-3
    assert frame.stamp_ns == pytest.approx(ns(0.5), abs=1000)
    np.testing.assert_allclose(frame.map_T_base, odom_T_base(0.5), atol=1e-4)
    np.testing.assert_allclose(frame.scan.origin_map, (odom_T_base(0.4) @ BASE_T_LIDAR)[:3, 3], atol=5e-3)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(-3, 3).map(lambda turn: round(turn, 6)), st.floats(0.02, 0.4))
def test_deskew_equals_scipy_point_by_point(seed: int, turn: float, span_s: float) -> None:
    """Between odometry samples the pose is slerp: the knots may differ from it by less than 1 mm at 30 m."""
    rng = np.random.default_rng(seed)
    samples = [odometry(k * 0.05, turn_rad_s=turn or 0.1) for k in range(21)]
    sync = Synchronizer(SyncSettings())
    for item in (*MOUNTS, *samples):
        sync.push(item)
    points, times = rng.uniform(-30, 30, (40, 3)), rng.uniform(0, span_s, 40)
    sync.push(scan(0.2, points, times))
    (frame,) = sync.pop()
    for point, time, got in zip(points, times.astype(np.float32), frame.scan.points_map, strict=True):
        stamp_s = 0.2 + float(time)
        k = min(int(stamp_s / 0.05), 19)
        fraction = stamp_s / 0.05 - k
        a, b = samples[k], samples[k + 1]
        a_R_b = Rotation.from_quat(a.quat_xyzw).inv() * Rotation.from_quat(b.quat_xyzw)
        rotation = Rotation.from_quat(a.quat_xyzw) * Rotation.from_rotvec(fraction * a_R_b.as_rotvec())
        in_base = BASE_T_LIDAR[:3, :3] @ point + BASE_T_LIDAR[:3, 3]
        expected = rotation.apply(in_base) + (1 - fraction) * a.position_m + fraction * b.position_m
        assert np.linalg.norm(got - expected) < 1e-3


def test_a_scan_without_times_is_one_instant() -> None:
    points = np.random.default_rng(0).uniform(-5, 5, (10, 3))
    sync = ready()
    sync.push(scan(0.5, points))
    (frame,) = sync.pop()
    np.testing.assert_allclose(frame.scan.points_map, transform(odom_T_base(0.5) @ BASE_T_LIDAR, points), atol=1e-5)
    assert frame.stamp_ns == ns(0.5)


def test_the_map_may_lie_elsewhere_than_odometry() -> None:
    map_T_odom = make_pose(np.array([5.0, 6.0, 0.0]), np.array([0, 0, 1.0, 0]))
    sync = Synchronizer(SyncSettings(), map_T_odom)
    for item in (*MOUNTS, odometry(0.0), odometry(0.05), scan(0.05)):
        sync.push(item)
    np.testing.assert_allclose(sync.pop()[0].map_T_base, map_T_odom @ odom_T_base(0.05), atol=1e-12)


def test_a_sweep_waits_for_odometry_after_it_but_not_for_ever() -> None:
    sync = ready()
    sync.push(scan(0.9, times=np.array([0.0, 0.2])))
    assert sync.pop() == []
    assert sync.blocked_by() == "odometry: newest pose is 0.100 s older than the scan"
    sync.push(odometry(1.1))
    assert len(sync.pop()) == 1
    assert sync.blocked_by() is None
    for k in range(12):  # odometry has died
        sync.push(scan(1.2 + 0.2 * k))
        assert sync.pop() == []
    assert sync.counters()["scan_no_pose"] > 5
    assert "odometry: newest pose is" in str(sync.blocked_by())


def test_what_was_before_the_first_pose_is_dropped_at_once() -> None:
    sync = ready()
    sync.push(scan(-0.1, times=np.array([0.0, 0.15])))
    assert sync.pop() == []
    assert sync.counters()["scan_no_pose"] == 1


def test_a_hole_in_odometry_is_not_bridged() -> None:
    sync = ready()
    sync.push(odometry(3.0))
    sync.push(scan(2.0))
    assert sync.pop() == []
    assert sync.blocked_by() == "odometry: 2.00 s without a pose"
    for k in range(40):  # late samples fill it
        sync.push(odometry(1.0 + k * 0.05))
    assert len(sync.pop()) == 1
    assert sync.counters()["odometry_out_of_order"] == 39
    assert sync.counters()["odometry_duplicate"] == 1


def test_missing_mountings_are_named() -> None:
    sync = Synchronizer(SyncSettings())
    for item in (odometry(0.0), odometry(0.1), scan(0.05)):
        sync.push(item)
    assert sync.pop() == []
    assert sync.blocked_by() == "tf_static: no chain from base_link to lidar"
    sync.push(MOUNTS[0])
    assert len(sync.pop()) == 1


def test_order_of_scans_late_and_double_ones() -> None:
    sync = ready()
    for at in (0.6, 0.4, 0.5, 0.5):
        sync.push(scan(at))
    assert [f.stamp_ns for f in sync.pop()] == [ns(0.4), ns(0.5), ns(0.6)]
    sync.push(scan(0.45))
    sync.push(scan(0.6))
    assert sync.pop() == []
    counters = sync.counters()
    assert (counters["scan_out_of_order"], counters["scan_late"], counters["scan_duplicate"]) == (2, 1, 2)


def test_frames_do_not_depend_on_the_order_of_arrival() -> None:
    items = [*MOUNTS, CAMERA, *(odometry(k * 0.05) for k in range(21))]
    items += [scan(0.1 + 0.2 * k, times=np.array([0.0, 0.1])) for k in range(4)] + [detections(0.15), detections(0.35)]
    results = []
    for seed in range(4):
        sync = Synchronizer(SyncSettings())
        for k in np.random.default_rng(seed).permutation(len(items)):
            sync.push(items[k])
        results.append(sync.pop())
    for frames in results[1:]:
        assert [f.stamp_ns for f in frames] == [f.stamp_ns for f in results[0]]
        for ours, theirs in zip(frames, results[0], strict=True):
            np.testing.assert_array_equal(ours.scan.points_map, theirs.scan.points_map)
            assert [v.stamp_ns for v in ours.views] == [v.stamp_ns for v in theirs.views]


def test_views_ride_on_the_first_frame_after_them_even_when_late() -> None:
    sync = ready()
    sync.push(CAMERA)
    sync.push(detections(0.3))
    sync.push(detections(0.2))
    sync.push(detections(0.7))
    sync.push(scan(0.4))
    first = sync.pop()
    assert [v.stamp_ns for v in first[0].views] == [ns(0.2), ns(0.3)]
    np.testing.assert_allclose(
        first[0].views[1].map_T_camera, odom_T_base(0.3) @ BASE_T_LINK @ LINK_T_OPTICAL, atol=1e-6
    )
    sync.push(detections(0.1))  # the detector took its time
    sync.push(scan(0.8))
    assert [v.stamp_ns for f in sync.pop() for v in f.views] == [ns(0.1), ns(0.7)]


def views_of(frames: list[SyncedFrame]) -> list[CameraView]:
    return [view for frame in frames for view in frame.views]


def test_views_wait_for_their_camera_and_say_so() -> None:
    sync = ready()
    sync.push(detections(0.3))
    sync.push(scan(0.4))
    assert views_of(sync.pop()) == []
    assert sync.blocked_by() == "camera_info: none for frame cam"
    sync.push(CAMERA)
    sync.push(scan(0.6))
    assert len(views_of(sync.pop())) == 1
    assert sync.blocked_by() is None


def test_resized_pictures_get_a_resized_camera_and_foreign_ones_none() -> None:
    sync = ready()
    sync.push(CAMERA)
    sync.push(detections(0.3, (12, 16)))
    sync.push(detections(0.35, (6, 6)))
    sync.push(scan(0.4))
    (view,) = views_of(sync.pop())
    np.testing.assert_allclose(view.camera.matrix, [[10, 0, 7.5], [0, 10, 5.5], [0, 0, 1]])
    assert sync.counters()["view_wrong_size"] == 1


def test_pictures_are_held_only_when_wanted_and_only_a_few() -> None:
    sync = ready()
    sync.push(image(0.3))
    assert sync.counters()["image_unused"] == 1
    sync = ready(keep_images=True, max_pending_images=2)
    sync.push(CAMERA)
    for at in (0.1, 0.2, 0.3, 0.35):
        sync.push(image(at))
        sync.push(detections(at))
    sync.push(scan(0.4))
    views = views_of(sync.pop())
    assert [(v.detections is not None, v.image is not None) for v in views] == [
        (True, False),
        (True, False),
        (True, True),
        (True, True),
    ]


def test_every_buffer_is_bounded() -> None:
    sync = Synchronizer(replace(SyncSettings(), max_pending_scans=3, max_pending_views=2))
    for k in range(10):
        sync.push(scan(0.01 * k))
        sync.push(detections(0.01 * k))
    counters = sync.counters()
    assert (counters["scan_overflow"], counters["view_overflow"]) == (7, 8)
    track = PoseTrack(1.0)
    for k in range(100):
        track.push(odometry(k * 0.05))
    assert track.last_ns - track.first_ns == 1_000_000_000


def test_flush_gives_the_views_after_the_last_sweep_a_frame() -> None:
    sync = ready()
    sync.push(CAMERA)
    sync.push(scan(0.4))
    sync.push(detections(0.9))
    sync.push(scan(1.2))
    assert len(sync.pop()) == 1
    (last,) = sync.flush()
    assert last.scan.points_map.shape == (0, 3)
    assert [v.stamp_ns for v in last.views] == [ns(0.9)]
    assert last.seq == 2
    assert sync.counters()["scan_no_pose"] == 1
    assert sync.flush() == []


def test_a_clock_that_is_set_back_starts_anew() -> None:
    sync = ready()
    sync.push(scan(0.5))
    assert len(sync.pop()) == 1
    for at in (-100.0, -99.95):
        sync.push(odometry(at))
    sync.push(scan(-99.97))
    assert [f.stamp_ns for f in sync.pop()] == [ns(-99.97)]
    assert sync.counters()["odometry_clock_reset"] == 1


def test_one_wrong_stamp_does_not_stop_the_others() -> None:
    sync = ready()
    sync.push(scan(1e8))
    assert sync.pop() == []
    sync.push(scan(0.5))
    sync.push(odometry(1.05))
    assert [f.stamp_ns for f in sync.pop()] == [ns(0.5)]


def test_a_silent_lidar_is_named() -> None:
    sync = ready()
    sync.push(scan(0.5))
    sync.pop()
    for k in range(40):
        sync.push(odometry(1.0 + k * 0.05))
    assert str(sync.blocked_by()).startswith("lidar: last sweep 2.")


def test_mountings_compose_along_the_tree_in_any_direction() -> None:
    tree = MountTree()
    for mount in MOUNTS:
        assert tree.push(mount)
    np.testing.assert_allclose(tree.find("base_link", "cam"), BASE_T_LINK @ LINK_T_OPTICAL)
    np.testing.assert_allclose(
        tree.find("cam", "lidar"), invert(BASE_T_LINK @ LINK_T_OPTICAL) @ BASE_T_LIDAR, atol=1e-12
    )
    np.testing.assert_array_equal(tree.find("nowhere", "nowhere"), np.eye(4))
    assert tree.find("base_link", "nowhere") is None
    tree.push(StaticTransform("cam", "base_link", np.eye(4)))  # closes a loop
    assert tree.find("base_link", "nowhere") is None
