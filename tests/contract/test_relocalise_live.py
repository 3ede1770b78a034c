"""irsctl relocalise on a running irsd: odometry begins anew somewhere else, and the robot is found in its map."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from bay_room import scan_of
from daemon_here import free_endpoint, running

from irsd.config import IrsdConfig, StoreSettings
from irsd.core.geometry import Pose, invert, pose_from_xy_yaw
from irsd.core.runtime import monotonic_s, sleep_s
from irsd.core.types import LidarScan, OdomSample, StaticTransform
from irsd.io.keys import RobotKeys
from irsd.io.localisation import MapFrame
from irsd.io.session import CDR, Session
from irsd.perception.encoder import LabelEncoder
from irsd.perception.settings import PerceptionSettings
from irsd.sensors.encode import encode_odometry, encode_pointcloud2, encode_tf

KEYS = RobotKeys("tester")
WAIT_S = 60.0


class Robot:
    """Stands in a room and publishes what it senses; its odometry may begin anew at any time."""

    def __init__(self, session: Session) -> None:
        self._session, self._tick = session, 0
        tf_static = session.history_publisher("tf_static", encoding=CDR, keep=1)
        mount = pose_from_xy_yaw(0.0, 0.0, 0.0, 1.0)
        tf_static.put(encode_tf([StaticTransform("base_link", "lidar", mount)]))

    def sense(self, map_T_base: Pose, odom_T_base: Pose) -> None:
        """A tenth of a second."""
        x_m, y_m = map_T_base[:2, 3].tolist()
        points = (scan_of(x_m, y_m) - np.array([x_m, y_m, 1.0])) @ map_T_base[:3, :3]
        yaw = float(np.arctan2(odom_T_base[1, 0], odom_T_base[0, 0]))
        turn = np.array([0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)])
        for part in range(5):
            stamp_ns = self._tick * 100_000_000 + part * 20_000_000
            pose = OdomSample(stamp_ns, "odom", "base_link", odom_T_base[:3, 3], turn)
            self._session.put("odom", encode_odometry(pose), encoding=CDR)
        scan = LidarScan(self._tick * 100_000_000, "lidar", points.astype(np.float32), None)
        self._session.put("lidar/points", encode_pointcloud2(scan), encoding=CDR)
        self._tick += 1
        sleep_s(0.03)


def test_a_robot_that_was_carried_off_is_found(tmp_path: Path) -> None:
    config = IrsdConfig(
        robot=KEYS.robot, store=StoreSettings(directory=str(tmp_path)), perception=PerceptionSettings(nano=False)
    )
    endpoint = free_endpoint()
    with running(config, LabelEncoder.load(), endpoint) as (_, session):
        robot, frame = Robot(session), MapFrame(session, KEYS)
        began_s = monotonic_s()
        for n in range(4000):
            place = pose_from_xy_yaw(1.5 * np.sin(0.05 * n), -0.5, 0.1)
            robot.sense(place, invert(pose_from_xy_yaw(0.0, -0.5, 0.1)) @ place)
            graph = json.loads(session.get(KEYS.snapshot)[0].payload) if n % 10 == 9 else {}
            if graph.get("rooms"):
                break
            assert monotonic_s() < began_s + WAIT_S
        for _ in range(30):  # it stands, so that what is heard of its place is of now
            robot.sense(place, invert(pose_from_xy_yaw(0.0, -0.5, 0.1)) @ place)
        before = frame.where
        assert before is not None
        origin = place @ invert(before.map_T_base)  # where the map's frame lies in the room

        # Carried to another place and turned, and the odometry begins anew there.
        place = pose_from_xy_yaw(-1.0, 0.8, 2.2)
        command = [sys.executable, "-m", "irsd.ctl", "--endpoint", endpoint, "relocalise", "--json"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as asking:
            while asking.poll() is None:
                robot.sense(place, np.eye(4))
            assert asking.stdout is not None
            assert json.loads(asking.stdout.read()) == {"found": True, "problem": ""}
        assert asking.returncode == 0
        for _ in range(30):
            robot.sense(place, np.eye(4))
        assert frame.where is not None
        np.testing.assert_allclose(origin @ frame.where.map_T_base, place, atol=0.06)
