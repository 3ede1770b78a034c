"""A robot in the room of ``bay_room``: publishes what it senses, as a bridge would, and can be carried off, fall silent, or lie."""

from __future__ import annotations

import numpy as np
from bay_room import scan_of

from irsd.core.geometry import Pose, pose_from_xy_yaw, yaw_of
from irsd.core.runtime import sleep_s
from irsd.core.types import LidarScan, OdomSample, StaticTransform
from irsd.io.session import CDR, Session
from irsd.sensors.encode import encode_odometry, encode_pointcloud2, encode_tf

TICK_NS = 100_000_000


class SensingRobot:
    """``offset_ns``: of its clock, to which every tick adds a tenth of a second."""

    def __init__(self, session: Session) -> None:
        self._session, self._tick, self.offset_ns = session, 0, 10_000 * 10**9
        tf_static = session.history_publisher("tf_static", encoding=CDR, keep=1)
        tf_static.put(encode_tf([StaticTransform("base_link", "lidar", pose_from_xy_yaw(0.0, 0.0, 0.0, 1.0))]))

    def sense(self, map_T_base: Pose, odom_T_base: Pose, *, lidar: bool = True) -> None:
        """A tenth of a second of its clock at a place, in less."""
        x_m, y_m = map_T_base[:2, 3].tolist()
        points = (scan_of(x_m, y_m) - np.array([x_m, y_m, 1.0])) @ map_T_base[:3, :3]
        yaw_rad = yaw_of(odom_T_base)
        turn = np.array([0.0, 0.0, np.sin(yaw_rad / 2), np.cos(yaw_rad / 2)])
        stamp_ns = self.offset_ns + self._tick * TICK_NS
        for part in range(5):
            at_ns = stamp_ns + part * TICK_NS // 5
            pose = OdomSample(at_ns, "odom", "base_link", odom_T_base[:3, 3], turn)
            self._session.put("odom", encode_odometry(pose), encoding=CDR)
        if lidar:
            scan = LidarScan(stamp_ns, "lidar", points.astype(np.float32), None)
            self._session.put("lidar/points", encode_pointcloud2(scan), encoding=CDR)
        self._tick += 1
        sleep_s(0.03)

    def drive(self, *, lidar: bool = True) -> None:
        """A tick of a way to and fro; odometry is right."""
        place = pose_from_xy_yaw(1.5 * float(np.sin(0.05 * self._tick)), -0.5, 0.1)
        self.sense(place, place, lidar=lidar)
