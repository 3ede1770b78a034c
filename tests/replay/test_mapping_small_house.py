"""The map of a recorded house against its ground truth (25 s of the drive, drifting odometry)."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from irsd.core.geometry import invert, make_pose, pose_from_xy_yaw
from irsd.core.types import Structure
from irsd.io import cdr
from irsd.mapping.mapper import Mapper, MappingSettings
from irsd.sensors.decode import decode
from irsd.sensors.replay import read_messages
from irsd.sensors.sync import Synchronizer, SyncSettings

KINDS = {"/lidar/points": "lidar", "/odom": "odometry", "/tf_static": "tf_static"}


@pytest.fixture(scope="module")
def house(shared_data: Path) -> Path:
    return shared_data / "small_house"


@pytest.fixture(scope="module")
def mapper(house: Path) -> Mapper:
    """Built from the short recording; its map frame is laid on the house's by the exact pose at the first sweep."""
    messages = list(read_messages([house / "small_house_short.mcap"], list(KINDS)))
    odometry = next(decode("odometry", m.data)[0] for m in messages if m.topic == "/odom")
    exact = next(
        pose
        for m in read_messages([house / "small_house.gt.mcap"], ["/gt/pose"])
        if (pose := cdr.read(m.data, "geometry_msgs/msg/PoseStamped")).header.stamp.sec * 10**9
        + pose.header.stamp.nanosec
        >= odometry.stamp_ns
    ).pose
    p, q = exact.position, exact.orientation
    map_T_base = make_pose(np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w]))
    map_T_odom = map_T_base @ invert(make_pose(odometry.position_m, odometry.quat_xyzw))
    synchronizer, mapper = Synchronizer(SyncSettings(), map_T_odom), Mapper(MappingSettings())
    for message in messages:
        for sensed in decode(KINDS[message.topic], message.data):
            synchronizer.push(sensed)
        for frame in synchronizer.pop():
            mapper.integrate(frame)
    for frame in synchronizer.flush():
        mapper.integrate(frame)
    assert mapper.counters()["scans"] > 100
    return mapper


def test_floor_and_ceiling_are_where_they_are(mapper: Mapper):
    assert mapper.levels.floor_z_m == pytest.approx(0.0, abs=0.02)
    assert mapper.levels.ceiling_z_m == pytest.approx(2.7, abs=0.05)


def test_structure_labels_are_right(mapper: Mapper, house: Path):
    truth = np.load(house / "instances.npz")
    rows = mapper.voxels.live_rows()
    distance, nearest = cKDTree(truth["xyz"]).query(mapper.voxels.mean[rows])
    true = truth["structural"][nearest]
    true = np.where(np.isin(true, [Structure.DOOR, Structure.WINDOW]), Structure.WALL, true)
    matched = distance < 0.08
    got, true = mapper.voxels.structure[rows][matched], true[matched]
    assert matched.mean() > 0.95
    for structure, precision, recall in (
        (Structure.FLOOR, 0.9, 0.95),
        (Structure.CEILING, 0.9, 0.85),
        (Structure.WALL, 0.85, 0.25),
    ):
        both = ((got == structure) & (true == structure)).sum()
        assert both / (got == structure).sum() > precision, structure
        assert both / (true == structure).sum() > recall, structure
    # Points of structure never join things, so things must hardly ever be called structure.
    assert (got[true == Structure.OTHER] != Structure.OTHER).mean() < 0.12


def test_free_is_free_and_obstacles_stand(mapper: Mapper, house: Path):
    image = cv2.imread(str(house / "occupancy.png"), cv2.IMREAD_GRAYSCALE)[::-1]
    frame, cells = mapper.navigation_grid()
    rc = np.argwhere(cells >= 0)
    at = np.floor((frame.centres_of(rc) - (-10.3, -6.5)) / 0.05).astype(int)
    inside = (at >= 0).all(-1) & (at[:, 0] < image.shape[1]) & (at[:, 1] < image.shape[0])
    rc, at = rc[inside], at[inside]
    true, got = image[at[:, 1], at[:, 0]], cells[rc[:, 0], rc[:, 1]]
    known = true != 205
    near_obstacle = cv2.dilate((image == 0).astype(np.uint8), np.ones((3, 3), np.uint8))[at[:, 1], at[:, 0]] > 0
    assert (true[known & (got == 0)] == 254).mean() > 0.94
    assert near_obstacle[known & (got == 100)].mean() > 0.9
    assert (got[known & (true == 254)] == 0).mean() > 0.9


def test_the_start_pose_is_the_documented_one(house: Path):
    # Guards the frame used above: the recording's map frame is the world file's.
    start = json.loads((house / "ground_truth.json").read_text())["start_pose"]
    assert pose_from_xy_yaw(start["x"], start["y"], start["yaw"])[:2, 3].tolist() == [3.3, -3.6]
