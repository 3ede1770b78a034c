"""How much of what a sweep says about the odometry's error is believed.

A map that is built from corrected poses and corrects poses in turn drifts by itself, slowly, even where the odometry does not. So as
long as the odometry keeps its word it is left alone, and put right only when the sweeps' errors lean to one side by more than their
own scatter. Once its correction is found to change with the way, every sweep counts, weighed by a scalar Kalman gain.
"""

from __future__ import annotations

import numpy as np

from irsd.core.geometry import Pose, invert, yaw_of
from irsd.mapping.kernels import Floats
from irsd.mapping.registration import LEVER_M

_WAY_M = 10.0  # over which the change of the correction is looked at
_LEAN = 0.2  # share of the newest sweep in the mean of the errors
_SCATTER = 0.05  # share of the newest sweep in their scatter
_FIRST_VARIANCE_M2 = 1e-4
_JUMP_M, _JUMP_SIGMA = 0.05, 5.0  # beyond both, odometry has slipped just now


class OdometryTrust:
    """Owner of what is known about the odometry's errors. Sizes are metres: a turn counts as the way of a point LEVER_M off."""

    def __init__(self, *, drift: float, match_m: float, drifts_from: float) -> None:
        """drift: least share of the way by which odometry that drifts is off, as one sigma. match_m: sigma of one sweep's place.

        drifts_from: change of the correction per way from which odometry counts as drifting.
        """
        self._drift, self._match_m, self._drifts_from = drift, match_m, drifts_from
        self._last: Pose | None = None
        self.begin_at(np.eye(4))
        self._variance_m2 = 0.0  # the map starts as the odometry's frame

    def begin_at(self, map_T_odom: Pose) -> None:
        """The correction is another one from now on, as good as one sweep tells."""
        self._usual = _xy_yaw(map_T_odom)
        self._variance_m2 = 16 * self._match_m**2
        self._mean, self._scatter_m2 = np.zeros(3), _FIRST_VARIANCE_M2
        self._before: Floats | None = None

    def follow(self, odom_T_base: Pose, map_T_odom: Pose) -> None:
        """The odometry has gone on: its place in the map is known less well by a share of the way."""
        if self._last is not None:
            step = _xy_yaw(invert(self._last) @ odom_T_base)
            way_m = float(np.hypot(step[0], step[1]))
            self._variance_m2 += (max(self._drift, self._changing(map_T_odom)) * size_m(step)) ** 2
            self._usual -= np.expm1(-way_m / _WAY_M) * _difference(_xy_yaw(map_T_odom), self._usual)
        self._last = odom_T_base

    def part_of(self, error: Floats, map_T_odom: Pose) -> Floats:
        """The part that is made of the move [3] (x, y, yaw about the robot) that lays a sweep on the map."""
        if self._changing(map_T_odom) > self._drifts_from:
            self._mean, self._before = np.zeros(3), None
            return self._gain(error) * error
        if self._before is not None:
            self._scatter_m2 += _SCATTER * (size_m(error - self._before) ** 2 / 2 - self._scatter_m2)
        self._before = error
        if size_m(error) > max(_JUMP_SIGMA * float(np.sqrt(self._scatter_m2)), _JUMP_M):
            self._mean, self._before = np.zeros(3), None
            return error
        self._mean = self._mean + _LEAN * (error - self._mean)
        if size_m(self._mean) <= max(3 * float(np.sqrt(self._scatter_m2 * _LEAN / (2 - _LEAN))), self._match_m):
            return np.zeros(3)
        part, self._mean = self._mean, np.zeros(3)
        self._before = error - part
        return part

    def _changing(self, map_T_odom: Pose) -> float:
        """By how much the correction has changed of late where the robot is, per metre of its way."""
        if self._last is None:
            return 0.0
        (x, y), now, then = self._last[:2, 3].tolist(), _xy_yaw(map_T_odom), self._usual
        move = _put(now, x, y) - _put(then, x, y)
        return (float(np.hypot(*move)) + LEVER_M * abs(float(_difference(now, then)[2]))) / _WAY_M

    def _gain(self, error: Floats) -> float:
        """The scalar Kalman gain. An error beyond three sigma shows that odometry was off by it."""
        noise_m2, error_m2 = self._match_m**2, size_m(error) ** 2
        if error_m2 > 9 * (self._variance_m2 + noise_m2):
            self._variance_m2 = error_m2
        gain = self._variance_m2 / (self._variance_m2 + noise_m2)
        self._variance_m2 *= 1 - gain
        return gain


def size_m(move: Floats) -> float:
    """How far a move (x, y, yaw) takes a point LEVER_M off, at most."""
    return float(np.hypot(move[0], move[1]) + 2 * LEVER_M * abs(np.sin(move[2] / 2)))


def _xy_yaw(pose: Pose) -> Floats:
    return np.array([pose[0, 3], pose[1, 3], yaw_of(pose)])


def _difference(a: Floats, b: Floats) -> Floats:
    """a - b of two (x, y, yaw), the turn the short way round."""
    out = a - b
    out[2] = (out[2] + np.pi) % (2 * np.pi) - np.pi
    return out


def _put(frame: Floats, x: float, y: float) -> Floats:
    """A place of a frame that lies at (x, y, yaw) in another, in that one."""
    c, s = np.cos(frame[2]), np.sin(frame[2])
    return np.array([frame[0] + c * x - s * y, frame[1] + s * x + c * y])
