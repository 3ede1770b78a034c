"""Map frame to NED and back, for every origin and heading; and the order in which waypoints are gone to."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nav_bridge.sinks.ned import Follower, MavlinkSettings, from_ned, to_ned

metres = st.floats(-500.0, 500.0)
angles = st.floats(-math.pi, math.pi)
frames = st.builds(
    lambda n, e, h: MavlinkSettings(origin_north_m=n, origin_east_m=e, x_heading_deg=h),
    metres,
    metres,
    st.floats(-360.0, 360.0),
)
poses = st.tuples(metres, metres, angles)


def test_an_east_north_up_map() -> None:
    assert to_ned((3.0, 4.0, 0.0), MavlinkSettings()) == pytest.approx((4.0, 3.0, 90.0))
    assert to_ned((3.0, 4.0, math.pi / 2), MavlinkSettings()) == pytest.approx((4.0, 3.0, 0.0))
    forward = MavlinkSettings(x_heading_deg=0.0)  # x to the north: y, its left, is to the west
    assert to_ned((3.0, 4.0, 0.0), forward) == pytest.approx((3.0, -4.0, 0.0))


@given(poses, frames)
def test_there_and_back(pose: tuple[float, float, float], frame: MavlinkSettings) -> None:
    back = from_ned(*to_ned(pose, frame), frame)
    assert back[:2] == pytest.approx(pose[:2], abs=1e-6)
    assert math.cos(back[2] - pose[2]) == pytest.approx(1.0, abs=1e-9)


@given(poses, poses, frames)
def test_distances_stay_and_yaw_points_along(
    a: tuple[float, float, float], b: tuple[float, float, float], frame: MavlinkSettings
) -> None:
    (n0, e0, _), (n1, e1, _) = to_ned(a, frame), to_ned(b, frame)
    away = math.dist(a[:2], b[:2])
    assert math.hypot(n1 - n0, e1 - e0) == pytest.approx(away, abs=1e-6)
    if away > 1e-3:  # looking from a to b on the map is looking from a to b on the compass
        _, _, heading = to_ned((*a[:2], math.atan2(b[1] - a[1], b[0] - a[0])), frame)
        bearing = math.atan2(e1 - e0, n1 - n0)
        assert math.cos(math.radians(heading) - bearing) == pytest.approx(1.0, abs=1e-6)


def test_waypoints_are_passed_in_order() -> None:
    way = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    follower = Follower(way, 0.2)
    assert follower.setpoint((0.1, 0.0)) == way[1]
    assert follower.setpoint((1.0, 0.9)) == way[1]  # near the last one, but the one before is not passed
    assert follower.setpoint((0.9, 0.0)) == way[2]
    assert follower.setpoint((1.0, 1.0)) == way[2]
