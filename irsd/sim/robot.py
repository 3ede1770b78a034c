"""A differential-drive robot: limits, contact with the world, and odometry that drifts as wheels do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.sim.space import ROBOT_RADIUS_M, FreeSpace, Obstacles

_SAFE_M = 0.03  # how much farther than touching the steering keeps off things
_HORIZON_S = np.linspace(0.1, 0.8, 8)
_SLOWER = (1.0, 0.6, 0.3)
_TURNS = (0.0, 0.35, -0.35, 0.8, -0.8, 1.4, -1.4)


@dataclass(frozen=True, slots=True)
class RobotSettings:
    """Limits of the drive and errors of its odometry (scale, yaw drift per sqrt metre, share of each turn)."""

    speed_m_s: float = 1.0
    turn_rad_s: float = 1.8
    accel_m_s2: float = 1.5
    turn_accel_rad_s2: float = 5.0
    odom_scale_error: float = 0.003
    odom_yaw_rad_per_sqrt_m: float = float(np.deg2rad(0.1))
    odom_turn_error: float = 0.002


class Robot:
    """The single owner of the robot's state: true pose, speeds, odometry, contacts. Poses are float64 [3] (x, y, yaw unwrapped)."""

    def __init__(self, obstacles: Obstacles, settings: RobotSettings, rng: np.random.Generator) -> None:
        self.settings = settings
        self.pose = np.zeros(3)
        self.odometry = np.zeros(3)
        self.speed_m_s = 0.0
        self.turn_rad_s = 0.0
        self.collisions = 0
        self._touching = False
        self.obstacles = obstacles
        self._rng = rng
        self._scale = 1.0 + settings.odom_scale_error * float(rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.2))
        self._turn_scale = 1.0 + settings.odom_turn_error * float(rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.2))

    def move(self, speed_m_s: float, turn_rad_s: float, dt_s: float) -> None:
        """Drives for dt_s towards the commanded speeds, within the limits; stops at whatever it would run into."""
        s = self.settings
        speed = float(np.clip(speed_m_s, -s.speed_m_s, s.speed_m_s))
        turn = float(np.clip(turn_rad_s, -s.turn_rad_s, s.turn_rad_s))
        self.speed_m_s += float(np.clip(speed - self.speed_m_s, -2 * s.accel_m_s2 * dt_s, s.accel_m_s2 * dt_s))
        step = s.turn_accel_rad_s2 * dt_s
        self.turn_rad_s += float(np.clip(turn - self.turn_rad_s, -step, step))
        heading = self.pose[2] + self.turn_rad_s * dt_s / 2
        ahead = self.speed_m_s * dt_s
        there = self.pose[:2] + ahead * np.array([np.cos(heading), np.sin(heading)])
        blocked = ahead != 0.0 and float(self.obstacles.distance(there[None])[0]) < ROBOT_RADIUS_M
        if blocked:
            self.collisions += not self._touching
            self.speed_m_s, ahead, there = 0.0, 0.0, self.pose[:2]
        self._touching = blocked or (self._touching and ahead == 0.0)
        self.pose = np.array([there[0], there[1], self.pose[2] + self.turn_rad_s * dt_s])
        self._reckon(ahead, self.turn_rad_s * dt_s)

    def _reckon(self, ahead_m: float, turned_rad: float) -> None:
        """Dead reckoning with the wheels' errors."""
        s = self.settings
        noise = s.odom_yaw_rad_per_sqrt_m * np.sqrt(abs(ahead_m)) * float(self._rng.normal())
        turned = turned_rad * self._turn_scale + noise
        heading = self.odometry[2] + turned / 2
        ahead = ahead_m * self._scale
        x, y, yaw = self.odometry
        self.odometry = np.array([x + ahead * np.cos(heading), y + ahead * np.sin(heading), yaw + turned])


def steer_clear(
    space: FreeSpace, pose: NDArray[np.float64], speed_m_s: float, turn_rad_s: float
) -> tuple[float, float]:
    """The command, or the nearest one whose arc of the next 0.8 s keeps off things: what a robot's local planner does.

    pose: true (x, y, yaw); the clearance stands for what the robot's own LiDAR shows around it.
    """
    if speed_m_s <= 0.0:
        return speed_m_s, turn_rad_s
    commands = np.array([(speed_m_s * k, turn_rad_s + d) for k in _SLOWER for d in _TURNS])
    here = float(space.clearance_at(pose[None, :2])[0])
    heading = pose[2] + commands[:, 1, None] * _HORIZON_S / 2
    way = commands[:, 0, None] * _HORIZON_S
    points = np.stack([pose[0] + way * np.cos(heading), pose[1] + way * np.sin(heading)], -1)
    clearance = space.clearance_at(points.reshape(-1, 2)).reshape(points.shape[:2]).min(1)
    good = clearance >= min(ROBOT_RADIUS_M + _SAFE_M, here - 0.002)
    if good[0]:
        return speed_m_s, turn_rad_s
    if not good.any():
        return 0.0, turn_rad_s
    cost = (1 - commands[:, 0] / speed_m_s) + 0.5 * np.abs(commands[:, 1] - turn_rad_s)
    best = int(np.where(good, cost, np.inf).argmin())
    return float(commands[best, 0]), float(commands[best, 1])
