"""Whether the first scans fit a stored map: the right place passes, the same place in another frame does not."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from bay_room import scan_of

from irsd.core.errors import DecodeError
from irsd.core.grid import GridFrame
from irsd.core.types import DeskewedScan, Plan, PlanEvidence, SyncedFrame
from irsd.mapping.mapper import Mapper, MappingSettings
from irsd.plans import (
    CORRECTION,
    PLAN,
    compare,
    plan_from_bytes,
    plan_of,
    plan_to_bytes,
    pose_from_bytes,
    pose_to_bytes,
)
from irsd.resume import Resumption

SETTINGS = MappingSettings()


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


class Mapped:
    """A map that holds a stored plan."""

    map_T_odom = np.eye(4)

    def __init__(self, geometry: dict[str, bytes]) -> None:
        self._plan = plan_from_bytes(geometry[f"{PLAN}0"])

    def plan_evidence(self) -> PlanEvidence:
        plan, nothing = self._plan, np.zeros_like(self._plan.wall)
        return PlanEvidence(plan.frame, plan.wall, plan.free, nothing, plan.wall | plan.free, plan.floor_z_m, None)


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
    resumption = Resumption(SETTINGS, geometry, search=False, max_speed_mps=5.0)
    admitted = [resumption.admit(frame(n, 1.0), Mapped(geometry)) for n in range(7)]
    assert [[f.seq for f in ready] for ready in admitted] == [[], [], [], [], [0, 1, 2, 3, 4], [5], [6]]
    assert (resumption.problem, resumption.trusted, resumption.held) == ("", True, 0)


@pytest.mark.parametrize("shift", [(0.3, 0.2, 0.0), (0.0, 0.0, 0.2), (0.0, 0.0, np.pi / 2), (1.5, 0.0, 0.0)])
def test_another_frame_is_held_until_someone_decides(
    geometry: dict[str, bytes], shift: tuple[float, float, float], caplog: pytest.LogCaptureFixture
) -> None:
    resumption = Resumption(SETTINGS, geometry, search=False, max_speed_mps=5.0)
    with caplog.at_level(logging.WARNING):
        for number in range(16):
            assert resumption.admit(frame(number, 1.0, shift), Mapped(geometry)) == []
    assert "do not fit the stored map" in resumption.problem
    assert len(caplog.records) == 1
    assert not resumption.trusted
    assert resumption.held == 11
    resumption.accept()
    assert [f.seq for f in resumption.admit(frame(16, 1.0, shift), Mapped(geometry))] == [16]
    assert resumption.problem == ""


def test_a_place_that_is_not_on_the_map_is_held_until_the_map_is_reached(geometry: dict[str, bytes]) -> None:
    resumption = Resumption(SETTINGS, geometry, search=False, max_speed_mps=5.0)
    for number in range(5):
        assert resumption.admit(frame(number, 1.0, (40.0, 0.0, 0.0)), Mapped(geometry)) == []
    assert "no part of the stored map" in resumption.problem
    admitted = [resumption.admit(frame(n, 1.0), Mapped(geometry)) for n in range(5, 11)]
    assert [f.seq for ready in admitted for f in ready] == [9, 10]
    assert resumption.problem == ""


def test_odometry_may_go_on_with_its_drift_or_begin_anew(geometry: dict[str, bytes]) -> None:
    drifted = np.eye(4)
    drifted[:2, 3] = [0.6, -0.4]
    stored = {**geometry, CORRECTION: pose_to_bytes(drifted)}
    for shift, start in (((-0.6, 0.4, 0.0), drifted), ((0.0, 0.0, 0.0), np.eye(4))):
        resumption = Resumption(SETTINGS, stored, search=False, max_speed_mps=5.0)
        assert resumption.take_start() is None
        assert len([f for n in range(6) for f in resumption.admit(frame(n, 1.0, shift), Mapped(geometry))]) == 6
        found = resumption.take_start()
        assert found is not None
        np.testing.assert_array_equal(found, start)
        assert resumption.take_start() is None
    for bad in (b"", b"x" * 127, np.full(16, np.nan).tobytes()):
        with pytest.raises(DecodeError):
            pose_from_bytes(bad)


def test_without_a_stored_plan_nothing_is_held(geometry: dict[str, bytes]) -> None:
    resumption = Resumption(SETTINGS, {}, search=False, max_speed_mps=5.0)
    assert [f.seq for f in resumption.admit(frame(3, 0.0), Mapped(geometry))] == [3]


def test_a_plan_fits_itself(geometry: dict[str, bytes]) -> None:
    plan = plan_from_bytes(geometry[f"{PLAN}0"])
    found = compare(plan, plan)
    assert (found.walls, found.blocked) == (1.0, 0.0)
    assert 20 < found.shared_m2 < 30
    assert found.good


@pytest.mark.parametrize("shift", [(0.3, 0.2, 0.4), (12.0, -7.0, 2.5), (0.0, 0.0, np.pi / 2)])
def test_a_search_finds_the_place_in_any_frame(geometry: dict[str, bytes], shift: tuple[float, float, float]) -> None:
    resumption = Resumption(SETTINGS, geometry, search=True, max_speed_mps=5.0)
    admitted = [resumption.admit(frame(n, 1.0, shift), Mapped(geometry)) for n in range(6)]
    assert [[f.seq for f in ready] for ready in admitted] == [[], [], [], [], [0, 1, 2, 3, 4], [5]]
    start = resumption.take_start()
    assert start is not None
    np.testing.assert_allclose(start @ frame(0, 1.0, shift).map_T_base, frame(0, 1.0).map_T_base, atol=0.08)
    assert resumption.take_start() is None


def test_an_operator_has_the_robot_looked_for_and_calls_it_off(geometry: dict[str, bytes]) -> None:
    shift = (5.0, 1.0, -2.0)
    resumption = Resumption(SETTINGS, geometry, search=False, max_speed_mps=5.0)
    for number in range(7):
        assert resumption.admit(frame(number, 1.0, shift), Mapped(geometry)) == []
    resumption.seek(Mapped(geometry))
    assert "looked for" in resumption.problem
    admitted = [resumption.admit(frame(n, 1.0, shift), Mapped(geometry)) for n in range(7, 12)]
    assert [f.seq for ready in admitted for f in ready] == [7, 8, 9, 10, 11]
    assert resumption.take_start() is not None
    resumption.seek(Mapped(geometry), at=(-2.0, -1.5, 3.0))  # it is at (1, 0, 0): not there
    for number in range(12, 18):
        assert resumption.admit(frame(number, 1.0), Mapped(geometry)) == []
    assert "not found in the map" in resumption.problem
    resumption.accept()
    assert [f.seq for f in resumption.admit(frame(18, 1.0), Mapped(geometry))] == [18]
    assert resumption.take_start() is None  # it is where it was before
    resumption.seek(Mapped(geometry), at=(0.6, 0.4, -0.3))
    assert sum(len(resumption.admit(frame(n, 1.0, shift), Mapped(geometry))) for n in range(19, 25)) == 6
    start = resumption.take_start()
    assert start is not None
    np.testing.assert_allclose(start @ frame(0, 1.0, shift).map_T_base, frame(0, 1.0).map_T_base, atol=0.08)


def test_another_building_is_not_found(geometry: dict[str, bytes]) -> None:
    resumption = Resumption(SETTINGS, geometry, search=True, max_speed_mps=5.0)
    for number in range(21):
        sweep = frame(number, 1.0)
        mirrored = sweep.scan.points_map * np.array([1, -1, 1], np.float32) * np.float32(0.8)
        scan = DeskewedScan(sweep.stamp_ns, mirrored, sweep.scan.origin_map * 0.8)
        assert resumption.admit(SyncedFrame(number, sweep.stamp_ns, sweep.map_T_base, scan, ()), Mapped(geometry)) == []
    assert resumption.problem


def test_after_a_jump_of_the_odometry_nothing_is_merged_until_the_robot_is_found(geometry: dict[str, bytes]) -> None:
    resumption, present = Resumption(SETTINGS, {}, search=False, max_speed_mps=5.0), Mapped(geometry)
    assert [len(resumption.admit(frame(n, 0.1 * n), present)) for n in range(4)] == [1] * 4
    shift = (4.0, -3.0, 1.0)
    admitted = [[f.seq for f in resumption.admit(frame(n, 0.4, shift), present)] for n in range(4, 10)]
    assert admitted == [[], [], [], [], [4, 5, 6, 7, 8], [9]]
    start = resumption.take_start()
    assert start is not None
    np.testing.assert_allclose(start @ frame(0, 0.4, shift).map_T_base, frame(0, 0.4).map_T_base, atol=0.08)


def test_a_jump_to_where_the_robot_is_changes_nothing(geometry: dict[str, bytes]) -> None:
    resumption, present = Resumption(SETTINGS, {}, search=False, max_speed_mps=5.0), Mapped(geometry)
    places = [-1.5, -1.4, 1.4, 1.4, 1.4, 1.4, 1.4, 1.4]
    admitted = [[f.seq for f in resumption.admit(frame(n, x), present)] for n, x in enumerate(places)]
    assert admitted == [[0], [1], [], [], [], [], [2, 3, 4, 5, 6], [7]]
    start = resumption.take_start()
    assert start is not None
    np.testing.assert_allclose(start, np.eye(4))


def test_a_jump_in_a_map_of_nothing_is_let_through() -> None:
    resumption = Resumption(SETTINGS, {}, search=False, max_speed_mps=5.0)
    nothing = Mapped({f"{PLAN}0": plan_to_bytes(Plan(GridFrame((0, 0), 0.05, 9, 9), 0.0, *np.zeros((2, 9, 9), bool)))})
    assert [len(resumption.admit(frame(n, 0.0, (9.0 * n, 0.0, 0.0)), nothing)) for n in range(3)] == [1, 1, 1]
