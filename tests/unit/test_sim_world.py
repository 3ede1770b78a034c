"""The embedded robot and its world: it never enters anything, goes where it is told, and repeats itself exactly."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import pytest

from irsd.sensors.decode import decode_camera_info, decode_detections, decode_odometry, decode_pointcloud2, decode_tf
from irsd.sim.drive import PathTask
from irsd.sim.space import ROBOT_RADIUS_M
from irsd.sim.world import World, WorldSettings, simulate


def drive(world: World, limit_s: float) -> float:
    """Steps until idle; checks at every step that the robot is in nothing. Returns the least clearance met."""
    least = np.inf
    end_ns = world.now_ns + int(limit_s * 1e9)
    while world.phase != "idle" and world.now_ns < end_ns:
        world.step(0.02)
        least = min(least, float(world.building.obstacles.distance(world.robot.pose[None, :2])[0]))
    return least


def test_no_time_no_messages() -> None:
    assert list(simulate(1, 0.0)) == []


def test_clock_can_be_set_once_and_moves_nothing_but_stamps() -> None:
    default, late = World(1), World(1)
    late.start_at(5 * 10**9)
    a, b = default.step(0.5), late.step(0.5)
    shift_ns = default.start_ns - 5 * 10**9
    assert [(m.topic, m.log_time_ns - shift_ns) for m in a] == [(m.topic, m.log_time_ns) for m in b]
    scans = [decode_pointcloud2(next(m.data for m in ms if m.topic == "/lidar/points")) for ms in (a, b)]
    np.testing.assert_array_equal(scans[0].points_sensor, scans[1].points_sensor)
    with pytest.raises(ValueError, match="clock"):
        late.start_at(0)


@pytest.mark.parametrize("seed", [0, 1])
def test_exploring_visits_every_room_without_touching_anything(seed: int) -> None:
    world = World(seed, sensing=False)
    visited = set()
    while world.phase == "exploring" and world.now_ns < world.start_ns + 120 * 10**9:
        world.step(0.1)
        assert float(world.building.obstacles.distance(world.robot.pose[None, :2])[0]) >= ROBOT_RADIUS_M
        for room in world.building.rooms:
            lo, hi = room.polygon_xy.min(0), room.polygon_xy.max(0)
            if ((world.robot.pose[:2] > lo) & (world.robot.pose[:2] < hi)).all():
                visited.add(room.label)
    assert world.phase == "idle"
    assert world.progress == 1.0
    assert world.robot.collisions == 0
    assert visited == {room.label for room in world.building.rooms}


@pytest.mark.parametrize("seed", [3, 4])
def test_random_waypoints_never_lead_into_anything(seed: int) -> None:
    """Waypoints that ignore every wall: the robot may fail to arrive, never to stop."""
    world = World(seed, explore=False, sensing=False)
    rng = np.random.default_rng(seed)
    for _ in range(6):
        way = np.column_stack([rng.uniform(-3, 9, 4), rng.uniform(-4, 4, 4), rng.uniform(-3, 3, 4)])
        world.follow(way.tolist())
        assert drive(world, 25.0) >= ROBOT_RADIUS_M - 1e-9


def test_reached_by_odometry_with_the_final_heading_and_the_drift_stays_real() -> None:
    world = World(5, explore=False, sensing=False)
    space = world.building.space
    for room in world.building.rooms[:3]:
        goal = space.viewpoint(room.polygon_xy)
        _, before = space.distances(world.robot.pose[:2])
        way = space.path(before, goal)
        world.follow([[x, y, 1.0] for x, y in way.tolist()])
        assert world.phase == "driving"
        drive(world, 60.0)
        assert world.waypoints_stuck == 0
        assert np.linalg.norm(world.robot.odometry[:2] - way[-1]) < 0.06
        assert abs(np.angle(np.exp(1j * (world.robot.odometry[2] - 1.0)))) < 0.05
    drift = np.linalg.norm(world.robot.odometry[:2] - world.robot.pose[:2])
    assert 0.0 < drift < 0.5


def test_empty_waypoints_stop_the_robot_and_the_exploring() -> None:
    world = World(1, sensing=False)
    world.step(3.0)
    assert world.phase == "exploring"
    world.follow([])
    assert world.phase == "idle"
    world.step(2.0)
    held = world.robot.pose.copy()
    world.step(2.0)
    np.testing.assert_array_equal(world.robot.pose, held)


def test_path_task_of_a_goal_underfoot_only_turns() -> None:
    task = PathTask(np.zeros((2, 2)), 1.0, 0.9)
    command = task.command(np.zeros(3), 0.02)
    assert command.speed_m_s == 0.0
    assert command.turn_rad_s > 0
    assert task.command(np.array([0.0, 0.0, 1.0]), 0.02).done


def test_same_seed_gives_the_same_bytes_and_stamps_in_order() -> None:
    a, b = list(simulate(2, 1.0)), list(simulate(2, 1.0))
    assert a == b
    other = list(simulate(3, 1.0))
    assert [m.data for m in other] != [m.data for m in a]
    assert all(p.log_time_ns <= q.log_time_ns for p, q in itertools.pairwise(a))


def test_messages_are_what_a_robot_sends() -> None:
    messages = list(simulate(1, 4.0))
    count = Counter(m.topic for m in messages)
    assert count["/lidar/points"] == 20
    assert count["/odom"] == 101
    assert count["/camera/image/compressed"] == count["/camera/camera_info"] == 20
    assert count["/detections/ids"] == count["/detections/info"] == 20
    last = {m.topic: m for m in messages}
    scan = decode_pointcloud2(last["/lidar/points"].data)
    assert scan.frame_id == "lidar"
    assert len(scan.points_sensor) > 6000
    assert scan.time_offset_s is not None
    assert 0 <= scan.time_offset_s.min() < scan.time_offset_s.max() < 0.2
    assert last["/lidar/points"].log_time_ns - scan.stamp_ns == 200_000_000
    odometry = decode_odometry(last["/odom"].data)
    assert (odometry.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    children = {t.child for t in decode_tf(last["/tf_static"].data)}
    assert children == {"lidar", "camera_link", "camera_optical"}
    camera = decode_camera_info(last["/camera/camera_info"].data)
    assert (camera.width_px, camera.height_px) == (640, 480)
    pairs = zip(
        (m.data for m in messages if m.topic == "/detections/ids"),
        (m.data for m in messages if m.topic == "/detections/info"),
        strict=True,
    )
    found = [decode_detections(ids, info) for ids, info in pairs]
    assert sum(len(d.number) for d in found) > 20
    assert all(d.frame_id == "camera_optical" for d in found)


def test_a_world_without_a_detector_sends_pictures_only() -> None:
    topics = {message.topic for message in simulate(4, 0.8, WorldSettings(detections=False))}
    assert "/camera/image/compressed" in topics
    assert not {topic for topic in topics if topic.startswith("/detections")}
