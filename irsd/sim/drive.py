"""Following ways: drive along a path and end with a heading, or turn on the spot to look around; and the exploring tour."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, permutations

import numpy as np
from numpy.typing import NDArray

from irsd.sim.building import Building

_SPACING_M = 0.02
_WINDOW_M = 0.6  # how far along the path the robot's place is searched, so that crossings do not shorten the way
_AT_GOAL_M, _AT_YAW_RAD = 0.04, 0.03
_STUCK_S = 6.0


@dataclass(frozen=True, slots=True)
class Command:
    """Wanted speeds; done: the task is over; stuck: it is over because nothing moved for long."""

    speed_m_s: float
    turn_rad_s: float
    done: bool = False
    stuck: bool = False


_DONE = Command(0.0, 0.0, True)


class PathTask:
    """Follows a polyline by pure pursuit, slower in bends and at the end, then turns to the final heading."""

    def __init__(self, path_xy: NDArray[np.float64], final_yaw_rad: float | None, speed_m_s: float) -> None:
        """path_xy: [K, 2] from the robot's place to the goal, K >= 2, in the frame of the poses given to ``command``."""
        self._points = _resampled(path_xy)
        self._yaw = final_yaw_rad
        self._speed = speed_m_s
        self._at = 0
        self._arrived = False
        self._best_m = np.inf
        self._still_s = 0.0

    @property
    def remaining_m(self) -> float:
        """Way left along the path."""
        return (len(self._points) - 1 - self._at) * _SPACING_M

    def command(self, pose: NDArray[np.float64], dt_s: float) -> Command:
        """pose: (x, y, yaw) now. Call once per time step."""
        window = self._points[self._at : self._at + int(_WINDOW_M / _SPACING_M)]
        self._at += int(np.linalg.norm(window - pose[:2], axis=1).argmin())
        to_goal = self._points[-1] - pose[:2]
        distance = float(np.hypot(*to_goal))
        if self._is_stuck(distance, dt_s):
            return Command(0.0, 0.0, True, True)
        near_end = self.remaining_m < 0.15
        if distance < _AT_GOAL_M or (near_end and distance < 0.15 and abs(_bearing(to_goal, pose)) > 1.2):
            self._arrived = True
        if self._arrived:
            return self._turn_to_final(pose)
        carrot = self._points[min(self._at + int(0.3 / _SPACING_M), len(self._points) - 1)]
        error = _bearing(carrot - pose[:2], pose)
        turn = 3.0 * error
        if abs(error) > 0.7:
            return Command(0.0, turn)
        beyond = self._points[min(self._at + int(0.75 / _SPACING_M), len(self._points) - 1)]
        bend = abs(_bearing(beyond - pose[:2], pose)) if self.remaining_m > 0.75 else 0.0
        speed = self._speed * np.cos(error) ** 2 * np.clip(1 - bend / 1.8, 0.35, 1.0)
        return Command(float(min(speed, 0.08 + np.sqrt(1.2 * max(distance - 0.02, 0.0)))), turn)

    def _turn_to_final(self, pose: NDArray[np.float64]) -> Command:
        if self._yaw is None:
            return _DONE
        error = _wrapped(self._yaw - pose[2])
        return _DONE if abs(error) < _AT_YAW_RAD else Command(0.0, float(np.clip(3.0 * error, -1.2, 1.2)))

    def _is_stuck(self, distance: float, dt_s: float) -> bool:
        """No way gained for a while (turning at corners or to the final heading takes less)."""
        measure = self.remaining_m + distance
        if measure < self._best_m - 0.02:
            self._best_m, self._still_s = measure, 0.0
        elif not self._arrived:
            self._still_s += dt_s
        return self._still_s > _STUCK_S


class LookTask:
    """Turns on the spot by an angle (positive: counter-clockwise)."""

    def __init__(self, angle_rad: float, rate_rad_s: float) -> None:
        self._left = angle_rad
        self._rate = rate_rad_s
        self._last: float | None = None

    @property
    def remaining_rad(self) -> float:
        """Angle left to turn."""
        return abs(self._left)

    def command(self, pose: NDArray[np.float64], dt_s: float) -> Command:
        """pose: (x, y, unwrapped yaw) now."""
        if self._last is not None:
            self._left -= float(pose[2]) - self._last
        self._last = float(pose[2])
        if abs(self._left) < 0.05:
            return _DONE
        rate = min(self._rate, 0.2 + 2.0 * abs(self._left))
        return Command(0.0, float(np.copysign(rate, self._left)))


@dataclass(frozen=True, slots=True)
class Leg:
    """A part of the tour: drive the path [K, 2], then look around by turn_rad."""

    path_xy: NDArray[np.float64]
    turn_rad: float

    @property
    def length_m(self) -> float:
        """Way of the path."""
        return float(np.linalg.norm(np.diff(self.path_xy, axis=0), axis=1).sum())


def exploring_tour(building: Building) -> tuple[Leg, ...]:
    """From the start (the origin) through every room and around in each, by the shortest order.

    Looking around alternates in direction, as a careful operator would: turn errors of the odometry then cancel.
    """
    space = building.space
    stops = [space.viewpoint(room.polygon_xy) for room in building.rooms if room.label != "corridor"]
    nodes = [np.zeros(2), *stops]
    fields = [space.distances(node) for node in nodes]
    cost = np.array([[space.cost_at(field[0], node) for node in nodes] for field in fields])
    orders = np.array(list(permutations(range(1, len(nodes)))))
    steps = np.column_stack([np.zeros(len(orders), np.int64), orders])
    order = steps[int(cost[steps[:, :-1], steps[:, 1:]].sum(1).argmin())].tolist()
    legs: list[Leg] = []
    for k, (a, b) in enumerate(pairwise(order)):
        way = space.path(fields[a][1], nodes[b])
        turn = 2 * np.pi * (1.0 if k % 2 == 0 else -1.0)
        legs.append(Leg(_smoothed(np.vstack([nodes[a], way, nodes[b]])), turn))
    return tuple(legs)


def _smoothed(path_xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """A moving average over half a metre, ends kept: grid paths turn in steps of 45 degrees."""
    width = 5
    padded = np.vstack([np.repeat(path_xy[:1], width, 0), path_xy, np.repeat(path_xy[-1:], width, 0)])
    kernel = np.ones(2 * width + 1) / (2 * width + 1)
    smooth = np.column_stack([np.convolve(padded[:, k], kernel, "valid") for k in range(2)])
    return np.vstack([path_xy[:1], smooth[1:-1], path_xy[-1:]])


def _resampled(path_xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points every 2 cm along a polyline, both ends included."""
    steps = np.linalg.norm(np.diff(path_xy, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    count = max(int(np.ceil(along[-1] / _SPACING_M)), 1)
    at = np.linspace(0, along[-1], count + 1)
    return np.column_stack([np.interp(at, along, path_xy[:, k]) for k in range(2)])


def _bearing(offset_xy: NDArray[np.float64], pose: NDArray[np.float64]) -> float:
    """Angle from the robot's heading to an offset, in (-pi, pi]."""
    return _wrapped(float(np.arctan2(offset_xy[1], offset_xy[0])) - pose[2])


def _wrapped(angle_rad: float) -> float:
    return float(np.arctan2(np.sin(angle_rad), np.cos(angle_rad)))
