"""The drive monitor on made-up drives: arrival is measured, every failure has its cause. Time is handed in."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from nav_bridge.monitor import Driving, Failed, Monitor, MonitorSettings, Outcome, Reached

SETTINGS = MonitorSettings(stuck_s=5.0, spare_s=20.0, slowest_mps=0.1, odometry_timeout_s=2.0, still_s=0.5)
WAY = ((0.0, 0.0, 0.0), (2.0, 0.0, 1.57), (2.0, 3.0, 1.57))
TARGET = np.array([[2.0, 3.4, 1.0], [2.1, 3.4, 1.0], [2.0, 3.5, 1.2]])
STEP_NS = 50_000_000


def monitor(way: tuple[tuple[float, float, float], ...] = WAY) -> Monitor:
    return Monitor(way, TARGET, 0.5, SETTINGS, 0)


def drive(watch: Monitor, poses: list[tuple[float, float, float]], now_ns: int = 0) -> tuple[list[Outcome], int]:
    outcomes = []
    for pose in poses:
        now_ns += STEP_NS
        outcomes.append(watch.update(now_ns, pose))
        if not isinstance(outcomes[-1], Driving):
            break
    return outcomes, now_ns


def along(metres: float) -> tuple[float, float, float]:
    return (metres, 0.0, 0.0) if metres <= 2 else (2.0, min(metres - 2.0, 3.0), 1.57)


def test_reached_is_measured_and_needs_a_stop() -> None:
    watch = monitor()
    outcomes, now = drive(watch, [along(s) for s in np.arange(0, 5.0, 0.04)])
    assert all(isinstance(o, Driving) for o in outcomes)
    left = [o.remaining_m for o in outcomes if isinstance(o, Driving)]
    assert left[0] == pytest.approx(5.0, abs=0.1)
    assert all(b <= a + 0.06 for a, b in itertools.pairwise(left))
    outcomes, _ = drive(watch, [along(5.0)] * 20, now)
    assert outcomes[-1] == Reached(pytest.approx(0.4))


def test_stopping_short_but_close_enough_counts() -> None:
    watch = monitor()
    _, now = drive(watch, [along(s) for s in np.arange(0, 4.92, 0.04)])
    outcomes, _ = drive(watch, [(2.0, 2.92, 1.57)] * 30, now)
    assert outcomes[-1] == Reached(pytest.approx(0.48, abs=0.01))


def test_standing_at_the_end_too_far_from_the_target_fails() -> None:
    watch = Monitor((WAY[0], (2.0, 0.0, 0.0)), TARGET, 0.5, SETTINGS, 0)
    outcomes, _ = drive(watch, [along(s) for s in np.arange(0, 2.01, 0.04)] + [(2.0, 0.0, 0.0)] * 20)
    last = outcomes[-1]
    assert isinstance(last, Failed)
    assert last.cause == "too far"
    assert last.distance_m == pytest.approx(3.4)


def test_turning_on_the_spot_is_not_arrival() -> None:
    watch = monitor()
    _, now = drive(watch, [along(s) for s in np.arange(0, 5.0, 0.04)])
    outcomes, now = drive(watch, [(2.0, 3.0, 1.57 + 0.1 * k) for k in range(60)], now)
    assert all(isinstance(o, Driving) for o in outcomes)


def test_stuck_silence_and_lateness() -> None:
    outcomes, _ = drive(monitor(), [along(0.5)] * 200)
    assert isinstance(outcomes[-1], Failed)
    assert outcomes[-1].cause == "stuck"
    assert outcomes[-1].remaining_m == pytest.approx(4.5)

    watch = monitor()
    _, now = drive(watch, [along(0.5)] * 3)
    assert isinstance(watch.tick(now + 1_900_000_000), Driving)
    silent = watch.tick(now + 2_100_000_000)
    assert isinstance(silent, Failed)
    assert silent.cause == "no odometry"

    watch = monitor()  # creeps: makes progress, but far too slowly
    creeping = [along(0.16 * k / 80) for k in range(3000)]
    outcomes, now = drive(watch, creeping)
    assert isinstance(outcomes[-1], Failed)
    assert outcomes[-1].cause == "timeout"
    assert now * 1e-9 == pytest.approx(20.0 + 5.0 / 0.1, abs=0.1)


def test_a_way_of_one_place() -> None:
    watch = Monitor(((2.0, 3.0, 0.0),), TARGET, 0.5, SETTINGS, 0)
    outcomes, _ = drive(watch, [(2.0, 3.0, 0.0)] * 20)
    assert isinstance(outcomes[-1], Reached)
    assert math.isclose(outcomes[-1].distance_m, 0.4)
