"""irsctl relocalise on a running irsd: odometry begins anew somewhere else, and the robot is found in its map."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from daemon_here import free_endpoint, running
from sensing_robot import SensingRobot

from irsd.config import IrsdConfig, StoreSettings
from irsd.core.geometry import invert, pose_from_xy_yaw
from irsd.core.runtime import monotonic_s
from irsd.io.keys import RobotKeys
from irsd.io.localisation import MapFrame
from irsd.perception.encoder import LabelEncoder
from irsd.perception.settings import PerceptionSettings

KEYS = RobotKeys("tester")
WAIT_S = 60.0


def test_a_robot_that_was_carried_off_is_found(tmp_path: Path) -> None:
    config = IrsdConfig(
        robot=KEYS.robot, store=StoreSettings(directory=str(tmp_path)), perception=PerceptionSettings(nano=False)
    )
    endpoint = free_endpoint()
    with running(config, LabelEncoder.load(), endpoint) as (_, session):
        robot, frame = SensingRobot(session), MapFrame(session, KEYS)
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
