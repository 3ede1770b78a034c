"""Whether the first scans fit a stored map: the right place passes, the same place in another frame does not."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.core.errors import DecodeError
from irsd.core.grid import GridFrame
from irsd.core.types import DeskewedScan, SyncedFrame
from irsd.mapping.mapper import Mapper, MappingSettings
from irsd.resume import (
    CORRECTION,
    PLAN,
    Plan,
    Resumption,
    compare,
    plan_from_bytes,
    plan_of,
    plan_to_bytes,
    pose_from_bytes,
    pose_to_bytes,
)

SETTINGS = MappingSettings()


def scan_of(x_m: float, y_m: float) -> NDArray[np.float32]:
    """A room of 6 x 5 x 2.6 m with a pillar-like bay in one corner, seen from (x, y), 1 m above its floor: map frame."""
    azimuth, elevation = np.meshgrid(np.linspace(-np.pi, np.pi, 360, False) + 1e-3, np.linspace(-0.6, 0.6, 32))
    ray = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)
    ray = ray.reshape(-1, 3)
    low, high = np.array([-3 - x_m, -2.5 - y_m, -1.0]), np.array([3 - x_m, 2.5 - y_m, 1.6])
    reach = np.where(ray > 0, high / ray, low / ray).min(-1)
    for side, start in (("x", 1.8 - x_m), ("y", 1.2 - y_m)):  # the bay: x > 1.8 and y > 1.2 is solid
        axis = 0 if side == "x" else 1
        with np.errstate(divide="ignore"):
            t = np.where(ray[:, axis] > 0, start / ray[:, axis], np.inf)
        other = ray[:, 1 - axis] * t + (y_m if axis == 0 else x_m)
        hit = (t > 0) & (other > (1.2 if axis == 0 else 1.8)) & (t < reach)
        reach = np.where(hit, t, reach)
    return (ray * reach[:, None] + [x_m, y_m, 1.0]).astype(np.float32)


def frame(number: int, x_m: float, shift: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> SyncedFrame:
    """One sweep from (x, 0); shift: (x, y, yaw) of the frame in which it is told."""
    dx, dy, yaw = shift
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1.0]])
    move = np.array([dx, dy, 0.0])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, turn @ [x_m, 0.0, 0.0] + move
    points = (scan_of(x_m, 0.0) @ turn.T + move).astype(np.float32)
    origin = turn @ [x_m, 0.0, 1.0] + move
    stamp_ns = number * 200_000_000
    return SyncedFrame(number, stamp_ns, pose, DeskewedScan(stamp_ns, points, origin), ())


@pytest.fixture(scope="module")
def geometry() -> dict[str, bytes]:
    mapper = Mapper(SETTINGS, None)
    for number in range(12):
        mapper.integrate(frame(number, -1.5 + 0.25 * number))
    return {f"{PLAN}0": plan_to_bytes(plan_of(mapper.plan_evidence()))}


def test_a_plan_is_what_it_was_after_a_way_through_bytes() -> None:
    rng = np.random.default_rng(1)
    for height, width in ((1, 1), (7, 13), (40, 9)):
        wall, free = rng.random((2, height, width)) > 0.5
        plan = Plan(GridFrame((-1.5, 2.0), 0.05, height, width), 0.3, wall, free)
        again = plan_from_bytes(plan_to_bytes(plan))
        assert (again.frame, again.floor_z_m) == (plan.frame, plan.floor_z_m)
        np.testing.assert_array_equal(again.wall, wall)
        np.testing.assert_array_equal(again.free, free)


@pytest.mark.parametrize("cut", [0, 10, 44, -1])
def test_bytes_that_are_no_plan_are_an_error(geometry: dict[str, bytes], cut: int) -> None:
    with pytest.raises(DecodeError):
        plan_from_bytes(geometry[f"{PLAN}0"][:cut])
    noise = np.random.default_rng(2).integers(0, 256, 400, np.uint8).tobytes()
    with pytest.raises(DecodeError):
        plan_from_bytes(noise)


def test_the_right_place_passes_with_all_its_frames(geometry: dict[str, bytes]) -> None:
    resumption = Resumption(SETTINGS, geometry)
    admitted = [resumption.admit(frame(n, 1.0)) for n in range(7)]
    assert [[f.seq for f in ready] for ready in admitted] == [[], [], [], [], [0, 1, 2, 3, 4], [5], [6]]
    assert (resumption.problem, resumption.trusted, resumption.held) == ("", True, 0)


@pytest.mark.parametrize("shift", [(0.3, 0.2, 0.0), (0.0, 0.0, 0.2), (0.0, 0.0, np.pi / 2), (1.5, 0.0, 0.0)])
def test_another_frame_is_held_until_someone_decides(
    geometry: dict[str, bytes], shift: tuple[float, float, float], caplog: pytest.LogCaptureFixture
) -> None:
    resumption = Resumption(SETTINGS, geometry)
    with caplog.at_level(logging.WARNING):
        for number in range(16):
            assert resumption.admit(frame(number, 1.0, shift)) == []
    assert "do not fit the stored map" in resumption.problem
    assert len(caplog.records) == 1
    assert not resumption.trusted
    assert resumption.held == 11
    resumption.accept()
    assert [f.seq for f in resumption.admit(frame(16, 1.0, shift))] == [16]
    assert resumption.problem == ""


def test_a_place_that_is_not_on_the_map_is_held_until_the_map_is_reached(geometry: dict[str, bytes]) -> None:
    resumption = Resumption(SETTINGS, geometry)
    for number in range(5):
        assert resumption.admit(frame(number, 1.0, (40.0, 0.0, 0.0))) == []
    assert "no part of the stored map" in resumption.problem
    admitted = [resumption.admit(frame(n, 1.0)) for n in range(5, 11)]
    assert [f.seq for ready in admitted for f in ready] == [9, 10]
    assert resumption.problem == ""


def test_odometry_may_go_on_with_its_drift_or_begin_anew(geometry: dict[str, bytes]) -> None:
    drifted = np.eye(4)
    drifted[:2, 3] = [0.6, -0.4]
    stored = {**geometry, CORRECTION: pose_to_bytes(drifted)}
    for shift, start in (((-0.6, 0.4, 0.0), drifted), ((0.0, 0.0, 0.0), np.eye(4))):
        resumption = Resumption(SETTINGS, stored)
        assert resumption.take_start() is None
        assert len([f for n in range(6) for f in resumption.admit(frame(n, 1.0, shift))]) == 6
        found = resumption.take_start()
        assert found is not None
        np.testing.assert_array_equal(found, start)
        assert resumption.take_start() is None
    for bad in (b"", b"x" * 127, np.full(16, np.nan).tobytes()):
        with pytest.raises(DecodeError):
            pose_from_bytes(bad)


def test_without_a_stored_plan_nothing_is_held() -> None:
    resumption = Resumption(SETTINGS, {})
    assert [f.seq for f in resumption.admit(frame(3, 0.0))] == [3]


def test_a_plan_fits_itself(geometry: dict[str, bytes]) -> None:
    plan = plan_from_bytes(geometry[f"{PLAN}0"])
    found = compare(plan, plan)
    assert (found.walls, found.blocked) == (1.0, 0.0)
    assert 20 < found.shared_m2 < 30
    assert found.good
