"""A MAVLink vehicle's side of a plan, without MAVLink: its frame (NED), its settings, and which place to go to next."""

from __future__ import annotations

import math
from dataclasses import dataclass

from irsd.core.settings import setting
from nav_bridge.sinks.base import Waypoints


@dataclass(frozen=True, slots=True)
class MavlinkSettings:
    """How to reach a vehicle, and where its local NED frame lies in ours."""

    url: str = setting("", "where the vehicle is, such as udpin://0.0.0.0:14540 or serial:///dev/ttyUSB0; empty = none")
    arm: bool = setting(False, "whether nav_bridge may arm the vehicle; otherwise somebody else must have")
    origin_north_m: float = setting(0.0, "north of the map's origin in the vehicle's local frame", lo=-1e6, hi=1e6)
    origin_east_m: float = setting(0.0, "east of the map's origin in the vehicle's local frame", lo=-1e6, hi=1e6)
    x_heading_deg: float = setting(
        90.0, "compass heading of the map's x axis; 90 for a map with x to the east", lo=-360.0, hi=360.0
    )
    accept_m: float = setting(0.15, "a waypoint is passed within this distance", lo=0.01, hi=10.0)
    link_timeout_s: float = setting(
        1.0, "silence of the vehicle's position that counts as a lost link", lo=0.2, hi=30.0
    )


def to_ned(xy_yaw: tuple[float, float, float], frame: MavlinkSettings) -> tuple[float, float, float]:
    """(north_m, east_m, heading_deg in 0..360) of a pose (x, y, yaw_rad, counter-clockwise) in the map frame."""
    x, y, yaw = xy_yaw
    heading = math.radians(frame.x_heading_deg)
    north = frame.origin_north_m + x * math.cos(heading) + y * math.sin(heading)
    east = frame.origin_east_m + x * math.sin(heading) - y * math.cos(heading)
    return north, east, math.degrees(heading - yaw) % 360.0


def from_ned(north_m: float, east_m: float, heading_deg: float, frame: MavlinkSettings) -> tuple[float, float, float]:
    """Inverse of ``to_ned``; yaw in -pi..pi."""
    heading = math.radians(frame.x_heading_deg)
    n, e = north_m - frame.origin_north_m, east_m - frame.origin_east_m
    yaw = heading - math.radians(heading_deg)
    return (
        n * math.cos(heading) + e * math.sin(heading),
        n * math.sin(heading) - e * math.cos(heading),
        math.atan2(math.sin(yaw), math.cos(yaw)),
    )


class Follower:
    """Which of a plan's waypoints the vehicle shall go to now: the next one it has not passed."""

    def __init__(self, waypoints: Waypoints, accept_m: float) -> None:
        self._way = waypoints
        self._accept_m = accept_m
        self._next = 0

    def setpoint(self, xy: tuple[float, float]) -> tuple[float, float, float]:
        """The waypoint to go to from (x, y), all in the map frame. The last one stays."""
        while self._next < len(self._way) - 1 and math.dist(xy, self._way[self._next][:2]) <= self._accept_m:
            self._next += 1
        return self._way[self._next]
