"""Odometry that keeps its word is left alone, one that drifts is followed, one that slips is put right at once."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.core.geometry import Pose, invert, pose_from_xy_yaw, yaw_of
from irsd.mapping.trust import OdometryTrust, size_m

STEP_M = 0.05


class Drive:
    """A robot on a long curve: ``sweep`` takes it a step on; its sweeps tell where it is, with noise, on a map without error."""

    def __init__(self, start: Pose, seed: int = 1) -> None:
        self.trust = OdometryTrust(drift=0.01, match_m=0.01, drifts_from=0.002)
        self.trust.begin_at(start)
        self.map_T_odom, self._start, self._rng, self._way_m = start, start, np.random.default_rng(seed), 0.0

    def sweep(self, drift: float, *, heading_rad: float = 0.0, match_m: float = 0.003, step_m: float = STEP_M) -> float:
        """One step; how far the place in the map is off after it, metres."""
        self._way_m += step_m
        truth = pose_from_xy_yaw(10 * np.sin(self._way_m / 10), 10 - 10 * np.cos(self._way_m / 10), self._way_m / 10)
        slipped = pose_from_xy_yaw(drift * self._way_m, 0.5 * drift * self._way_m, 0.02 * drift * self._way_m)
        odom = invert(self._start) @ slipped @ truth @ pose_from_xy_yaw(0, 0, self._rng.normal(0, heading_rad))
        self.trust.follow(odom, self.map_T_odom)
        believed = self.map_T_odom @ odom
        error = self._to(truth, believed) + self._rng.normal(0, match_m, 3) / [1, 1, 3]
        part = self.trust.part_of(error, self.map_T_odom)
        pivot = pose_from_xy_yaw(*believed[:2, 3], 0.0)
        self.map_T_odom = pivot @ pose_from_xy_yaw(*part) @ invert(pivot) @ self.map_T_odom
        return size_m(self._to(truth, self.map_T_odom @ odom))

    def correction_m(self) -> float:
        return size_m(self._to(self._start, self.map_T_odom))

    @staticmethod
    def _to(truth: Pose, believed: Pose) -> NDArray[np.float64]:
        return np.array([*(truth - believed)[:2, 3], yaw_of(truth @ invert(believed))])


TURNED = pose_from_xy_yaw(3.0, -2.0, np.pi - 1e-3)


@pytest.mark.parametrize("start", [np.eye(4), TURNED])
@pytest.mark.parametrize("heading_rad", [0.0, 0.0035])
def test_odometry_that_keeps_its_word_is_left_alone(start: Pose, heading_rad: float) -> None:
    drive = Drive(start)
    for _ in range(2000):
        drive.sweep(0.0, heading_rad=heading_rad)
    assert drive.correction_m() < 0.01


@pytest.mark.parametrize("start", [np.eye(4), TURNED])
@pytest.mark.parametrize("drift", [0.005, 0.01, 0.03])
def test_odometry_that_drifts_is_followed(start: Pose, drift: float) -> None:
    drive = Drive(start)
    off_m = [drive.sweep(drift) for _ in range(2000)]
    assert max(off_m) < 0.05
    assert np.mean(off_m[1000:]) < 0.012


def test_a_slip_is_put_right_at_once() -> None:
    drive = Drive(np.eye(4))
    assert max(drive.sweep(0.0) for _ in range(100)) < 0.01
    drive.map_T_odom = pose_from_xy_yaw(0.12, 0.05, 0.01) @ drive.map_T_odom
    assert drive.sweep(0.0) < 0.02


def test_a_robot_that_stands_does_not_jitter() -> None:
    drive = Drive(np.eye(4))
    places = []
    for _ in range(300):
        drive.sweep(0.0, step_m=0.0)
        places.append(drive.map_T_odom)
    assert np.ptp(places, axis=0).max() < 1e-9
