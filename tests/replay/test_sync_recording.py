"""The recorded robot, synchronised: every sweep and picture arrives, and deskew brings the sweeps closer to the true surfaces."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from irsd.core.geometry import pose_from_xy_yaw, transform
from irsd.core.types import LidarScan, OdomSample, Sensed, SyncedFrame
from irsd.io import cdr as ros
from irsd.perception.detections import DetectionPairer
from irsd.sensors.decode import decode, decode_detection_ids
from irsd.sensors.replay import read_messages
from irsd.sensors.sync import Synchronizer, SyncSettings

KINDS = {"/lidar/points": "lidar", "/odom": "odometry", "/tf_static": "tf_static", "/camera/camera_info": "camera_info"}
DETECTIONS = ("/detections/ids", "/detections/info")
START_NS, END_NS = 1_700_000_035_000_000_000, 1_700_000_060_000_000_000


def recorded(folder: Path) -> Iterator[Sensed]:
    """The short recording with the detections of its time."""
    pairer = DetectionPairer()
    paths = [folder / "small_house_short.mcap", folder / "small_house.detections.mcap"]
    for message in read_messages(paths, [*KINDS, *DETECTIONS]):
        if message.topic in KINDS:
            yield from decode(KINDS[message.topic], message.data)
        elif START_NS <= message.log_time_ns <= END_NS:
            ids = message.topic == DETECTIONS[0]
            pair = pairer.push_ids(decode_detection_ids(message.data)) if ids else pairer.push_info(message.data)
            if pair is not None:
                yield pair
    assert pairer.unpaired == 0


def true_poses(folder: Path) -> list[OdomSample]:
    """Exact map -> base_link, as odometry without drift."""
    out = []
    for message in read_messages(folder / "small_house.gt.mcap", ["/gt/pose"]):
        pose = ros.read(message.data, ros.POSE_STAMPED)
        stamp_ns = ros.stamp_of(pose.header)
        if START_NS - 10**9 <= stamp_ns <= END_NS:
            position = ros.vector_of(pose.pose.position, "gt")
            out.append(OdomSample(stamp_ns, "map", "base_link", position, ros.quat_of(pose.pose.orientation, "gt")))
    return out


def run(items: list[Sensed]) -> tuple[list[SyncedFrame], Synchronizer]:
    sync, frames = Synchronizer(SyncSettings()), []
    for item in items:
        sync.push(item)
        frames += sync.pop()
    return frames + sync.flush(), sync


@pytest.fixture(scope="module")
def sensed(shared_data: Path) -> list[Sensed]:
    return list(recorded(shared_data / "small_house"))


def test_every_sweep_and_picture_comes_through(sensed: list[Sensed]) -> None:
    frames, sync = run(sensed)
    assert (
        len(frames) == 126
    )  # the first of 126 sweeps began before the first pose; the last picture came after the last sweep
    assert [k for k, f in enumerate(frames) if not len(f.scan.points_map)] == [125]
    assert sum(len(f.views) for f in frames) == 101
    lost = {name: count for name, count in sync.counters().items() if count and name not in ("frames", "views")}
    assert lost == {"scan_no_pose": 1}
    assert sync.blocked_by() is None
    stamps = [f.stamp_ns for f in frames]
    assert stamps == sorted(set(stamps))
    assert [f.seq for f in frames] == list(range(1, len(frames) + 1))
    for frame in frames:
        assert all(view.stamp_ns <= frame.stamp_ns or frame is frames[-1] for view in frame.views)
        assert frame.scan.points_map.dtype == np.float32


def test_the_same_input_gives_the_same_bytes(sensed: list[Sensed]) -> None:
    first, second = run(sensed[:400])[0], run(sensed[:400])[0]
    assert [f.scan.points_map.tobytes() for f in first] == [f.scan.points_map.tobytes() for f in second]


def distances(items: list[Sensed], tree: cKDTree) -> np.ndarray:
    """Distance of every fifth point of the map to the true cloud, metres."""
    frames = run(items)[0]
    points = np.concatenate([f.scan.points_map[::5] for f in frames])
    return np.asarray(tree.query(points, distance_upper_bound=0.5)[0])


def test_deskew_brings_sweeps_to_the_true_surfaces(sensed: list[Sensed], shared_data: Path) -> None:
    """With exact poses, the sensor's noise (1.5 cm) and the true cloud's spacing (4 cm) are left; without deskew, motion too."""
    folder = shared_data / "small_house"
    tree = cKDTree(np.load(folder / "instances.npz")["xyz"])
    others = [item for item in sensed if not isinstance(item, OdomSample)]
    exact: list[Sensed] = [*true_poses(folder), *others]
    stiff = [replace(item, time_offset_s=None) if isinstance(item, LidarScan) else item for item in exact]
    deskewed, skewed = distances(exact, tree), distances(stiff, tree)
    assert (deskewed < 0.1).mean() > 0.97
    assert (skewed >= 0.1).sum() > 3 * (deskewed >= 0.1).sum()


def test_odometry_starts_where_the_truth_says(sensed: list[Sensed], shared_data: Path) -> None:
    """map_T_odom places the drifting odometry in the map: after 35 s it is still within 0.3 m of the exact pose."""
    folder = shared_data / "small_house"
    start = json.loads((folder / "ground_truth.json").read_text())["start_pose"]
    map_T_odom = pose_from_xy_yaw(start["x"], start["y"], start["yaw"])
    first = next(item for item in sensed if isinstance(item, OdomSample))
    truth = next(pose for pose in true_poses(folder) if pose.stamp_ns == first.stamp_ns)
    placed = transform(map_T_odom, first.position_m[None])[0]
    assert np.linalg.norm(placed - truth.position_m) < 0.3
