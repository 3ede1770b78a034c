"""MAVSDK against a vehicle that moves, over real UDP: three waypoints, cancel, a stale plan, a lost link, and who may arm."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from navigation_standin import ready, running

pytest.importorskip("pymavlink")
from mavlink_vehicle import HOLD, OFFBOARD, STABILIZED, Vehicle

from nav_bridge.sinks.base import Plan
from nav_bridge.sinks.mavlink import MavlinkSink
from nav_bridge.sinks.ned import MavlinkSettings, to_ned

PATIENCE_S = 20.0
WAY = ((0.0, 0.0, 0.0), (1.5, 0.0, 0.0), (1.5, 1.5, 1.57), (0.5, 2.0, 3.0))
LONG = ((0.0, 0.0, 0.0), (50.0, 0.0, 0.0))


@contextmanager
def flying(*, armed: bool = True, **settings: float | bool) -> Iterator[tuple[Vehicle, MavlinkSink, MavlinkSettings]]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    chosen = MavlinkSettings(url=f"udpin://127.0.0.1:{port}", **settings)  # type: ignore[arg-type]
    with Vehicle(port, armed=armed) as vehicle:
        sink = MavlinkSink(chosen)
        try:
            until(lambda: not sink.trouble())
            yield vehicle, sink, chosen
        finally:
            sink.close()


def until(done: Callable[[], bool], beat: Callable[[], None] = lambda: None) -> float:
    """Waits; returns how long it took."""
    began = time.monotonic()
    while not done():
        assert time.monotonic() < began + PATIENCE_S
        beat()
        time.sleep(0.02)
    return time.monotonic() - began


def plan(seq: int, way: tuple[tuple[float, float, float], ...]) -> Plan:
    return Plan("g", seq, "map", way, 0.6)


def away(vehicle: Vehicle, point: tuple[float, float, float], settings: MavlinkSettings) -> float:
    return math.dist(vehicle.ned[:2], to_ned(point, settings)[:2])


def test_three_waypoints_then_cancel() -> None:
    with flying(x_heading_deg=30.0, origin_north_m=2.0, origin_east_m=-1.0) as (vehicle, sink, settings):
        vehicle.ned = [*to_ned(WAY[0], settings)[:2], -1.5]
        order = plan(1, WAY)
        sink.send(order)
        until(lambda: away(vehicle, WAY[-1], settings) < 0.02, lambda: sink.beat(order))
        assert sink.trouble() == ""
        for point in WAY[1:]:
            target = to_ned(point, settings)[:2]
            assert min(math.dist(target, at) for at in vehicle.trail) <= settings.accept_m + 0.01
        assert {round(z, 3) for _, _, z, _ in vehicle.setpoints} == {-1.5}  # the height it was found at
        assert math.degrees(vehicle.heading_rad) % 360 == pytest.approx((30.0 - math.degrees(3.0)) % 360, abs=0.1)
        assert vehicle.masks == {2552}  # position and yaw, nothing else
        assert vehicle.arm_commands == 0
        sink.send(plan(2, LONG))
        until(
            lambda: away(vehicle, LONG[0], settings) > 1.0 and vehicle.mode == OFFBOARD,
            lambda: sink.beat(plan(2, LONG)),
        )
        sink.send(plan(3, ()))
        assert until(lambda: vehicle.mode == HOLD) < 1.0


def test_a_stale_plan_holds_and_its_return_resumes() -> None:
    with flying() as (vehicle, sink, settings):
        order = plan(1, LONG)
        sink.send(order)
        until(lambda: away(vehicle, LONG[0], settings) > 0.5, lambda: sink.beat(order))
        assert until(lambda: vehicle.mode == HOLD) < 1.0  # nobody beats
        stands = list(vehicle.ned)
        time.sleep(0.3)
        assert vehicle.ned == stands
        until(lambda: vehicle.mode == OFFBOARD, lambda: sink.beat(order))
        sink.beat(plan(7, LONG))  # of another plan: no heartbeat
    assert vehicle.mode == HOLD  # closing holds too


def test_a_lost_link_is_trouble_and_nothing_is_sent_after_it() -> None:
    with flying() as (vehicle, sink, settings):
        order = plan(1, LONG)
        sink.send(order)
        until(lambda: away(vehicle, LONG[0], settings) > 0.3, lambda: sink.beat(order))
        vehicle.linked = False
        until(lambda: "link" in sink.trouble(), lambda: sink.beat(order))
        sink.send(plan(2, ()))
        time.sleep(0.5)
        vehicle.mode, vehicle.linked = HOLD, True  # as its failsafe would
        until(lambda: not sink.trouble())
        sent = len(vehicle.setpoints)
        time.sleep(0.3)
        assert len(vehicle.setpoints) == sent


def test_arming_is_left_to_others_unless_configured() -> None:
    with flying(armed=False) as (vehicle, sink, _):
        sink.send(plan(1, LONG))
        until(lambda: "not armed" in sink.trouble(), lambda: sink.beat(plan(1, LONG)))
        assert (vehicle.arm_commands, vehicle.mode) == (0, STABILIZED)
    with flying(armed=False, arm=True) as (vehicle, sink, settings):
        sink.send(plan(1, LONG))
        until(lambda: away(vehicle, LONG[0], settings) > 0.3, lambda: sink.beat(plan(1, LONG)))
        assert vehicle.arm_commands == 1


def test_a_pilot_who_takes_over_keeps_control() -> None:
    with flying() as (vehicle, sink, settings):
        order = plan(1, LONG)
        sink.send(order)
        until(lambda: away(vehicle, LONG[0], settings) > 0.3, lambda: sink.beat(order))
        vehicle.mode = STABILIZED
        until(lambda: "pilot" in sink.trouble(), lambda: sink.beat(order))
        time.sleep(0.2)
        assert vehicle.mode == STABILIZED


def test_the_bridge_drives_the_vehicle_it_is_configured_for(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    settings = f"sinks: {{mavlink: {{url: 'udpin://127.0.0.1:{port}'}}}}\n"
    with Vehicle(port, armed=True) as vehicle, running(tmp_path, settings) as (world, _):
        until(lambda: ready(world, "elephant")["status"] == "not_found")
        time.sleep(2.0)  # the first heartbeats
        ready(world, "fridge")
        world.drive_until(lambda s: s["state"] == "driving")
        world.stalled = True  # it must not arrive before the take-over is heard
        until(lambda: vehicle.mode == OFFBOARD, world.step)
        vehicle.mode = STABILIZED
        failed = world.drive_until(lambda s: s["state"] == "failed")[-1]
        assert failed["reason"] == "vehicle: the pilot has taken over"
