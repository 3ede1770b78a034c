"""Is the robot getting there? Progress along the way, arrival measured at the target's surface, and the reasons to give up.

An owner without clock, thread or transport: poses and times (monotonic ns) are handed in, states come out.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.core.settings import setting
from nav_bridge.surface import surface_distance

_SPEED_NS = 5_000_000_000  # the time over which the speed is taken for the time left


@dataclass(frozen=True, slots=True)
class MonitorSettings:
    """When a drive has arrived and when it has failed."""

    pose_tolerance_m: float = setting(
        0.12, "a robot that stops this close to the last waypoint has driven the way", lo=0.01, hi=5.0
    )
    still_s: float = setting(0.8, "how long it must not move to count as stopped", lo=0.1, hi=30.0)
    still_m: float = setting(0.02, "movement within still_s that counts as none", lo=0.001, hi=1.0)
    still_rad: float = setting(0.05, "turning within still_s that counts as none", lo=0.001, hi=3.0)
    progress_m: float = setting(0.15, "the way left must shrink by this ...", lo=0.01, hi=10.0)
    stuck_s: float = setting(20.0, "... within this time, or the robot is stuck", lo=1.0, hi=3600.0)
    slowest_mps: float = setting(0.08, "mean speed below which the drive takes too long", lo=0.001, hi=10.0)
    spare_s: float = setting(45.0, "time allowed beyond the way at slowest_mps", lo=1.0, hi=3600.0)
    odometry_timeout_s: float = setting(
        3.0, "silence of the odometry after which the drive is given up", lo=0.1, hi=60.0
    )


@dataclass(frozen=True, slots=True)
class Driving:
    """On the way. remaining_m: along the way; distance_m: plan distance to the target's surface, None before the first pose.

    eta_s: time left at the speed of late, None before there was any.
    """

    remaining_m: float
    distance_m: float | None
    eta_s: float | None = None


@dataclass(frozen=True, slots=True)
class Reached:
    """Arrived and stopped, at this measured plan distance to the target's nearest surface."""

    distance_m: float


@dataclass(frozen=True, slots=True)
class Failed:
    """Given up. cause: stuck, timeout, no odometry or too far; reason: the same in a sentence. distance_m as in Driving."""

    cause: str
    reason: str
    remaining_m: float
    distance_m: float | None


Outcome = Driving | Reached | Failed


class Monitor:
    """Watches one drive. waypoints: (x, y, yaw) in the map frame; target_xy: [N, 2+] surface points, map frame."""

    def __init__(
        self,
        waypoints: tuple[tuple[float, float, float], ...],
        target_xy: NDArray[np.floating],
        within_m: float,
        settings: MonitorSettings,
        now_ns: int,
        outlier_points: int = 1,
    ) -> None:
        self._waypoints = waypoints
        self._way = np.asarray([point[:2] for point in waypoints], np.float64)
        self._target = np.asarray(target_xy, np.float64)[:, :2]
        self._within_m = within_m
        self._settings = settings
        self._outlier_points = outlier_points
        lengths = np.hypot(*np.diff(self._way, axis=0).T) if len(self._way) > 1 else np.zeros(0)
        self._left_from = np.append(np.cumsum(lengths[::-1])[::-1], 0.0)
        self._deadline_ns = now_ns + int(1e9 * (settings.spare_s + float(lengths.sum()) / settings.slowest_mps))
        self._heard_ns = now_ns
        self._segment = 0
        self._best_m, self._best_ns = math.inf, now_ns
        self._recent: deque[tuple[int, float, float, float]] = deque()
        self._state = Driving(float(lengths.sum()), None)
        self._lately: deque[tuple[int, float]] = deque()  # (time, way left) of the last seconds
        self.off_way_m = 0.0

    def ahead(self) -> tuple[tuple[float, float, float], ...]:
        """The waypoints still ahead, at least the last."""
        return self._waypoints[min(self._segment + 1, len(self._waypoints) - 1) :]

    def retarget(self, target_xy: NDArray[np.floating]) -> None:
        """The target's surface as it is known by now; an empty one changes nothing."""
        if len(target_xy):
            self._target = np.asarray(target_xy, np.float64)[:, :2]

    def update(self, now_ns: int, xy_yaw: tuple[float, float, float]) -> Outcome:
        """A pose of the robot in the map frame, heard now."""
        self._heard_ns = now_ns
        place = np.asarray(xy_yaw[:2], np.float64)
        remaining = self._remaining(place)
        distance = float(surface_distance(self._target, place[None], self._outlier_points)[0])
        self._state = Driving(remaining, distance, self._eta_s(now_ns, remaining))
        self._recent.append((now_ns, *xy_yaw))
        turning = self._is_still(now_ns) is False
        if remaining < self._best_m - self._settings.progress_m or (
            turning and remaining < self._settings.pose_tolerance_m
        ):
            self._best_m, self._best_ns = min(remaining, self._best_m), now_ns
        if self._is_still(now_ns) and self._near_end(remaining, place, distance):
            return self._arrived(distance, remaining)
        return self.tick(now_ns)

    def tick(self, now_ns: int) -> Outcome:
        """What time alone says: silence, standstill, lateness."""
        s, state = self._settings, self._state
        silent_s = (now_ns - self._heard_ns) * 1e-9
        if silent_s > s.odometry_timeout_s:
            return self._failed("no odometry", f"no odometry for {silent_s:.1f} s")
        if now_ns > self._deadline_ns:
            return self._failed("timeout", f"not there in time, {state.remaining_m:.1f} m to go")
        if (now_ns - self._best_ns) * 1e-9 > s.stuck_s:
            if state.distance_m is not None and state.distance_m <= self._within_m and self._is_still(now_ns):
                return Reached(state.distance_m)
            return self._failed("stuck", f"no progress for {s.stuck_s:.0f} s, {state.remaining_m:.1f} m to go")
        return state

    def _arrived(self, distance: float, remaining: float) -> Outcome:
        if distance <= self._within_m:
            return Reached(distance)
        return self._failed("too far", f"stopped {distance:.2f} m from the target, more than {self._within_m:.2f} m")

    def _near_end(self, remaining: float, place: NDArray[np.float64], distance: float) -> bool:
        """At the last waypoint, or near it and already close enough to the target."""
        to_end = float(np.hypot(*(self._way[-1] - place)))
        return to_end <= self._settings.pose_tolerance_m or (
            distance <= self._within_m and max(to_end, remaining) <= 0.4
        )

    def _eta_s(self, now_ns: int, remaining: float) -> float | None:
        """Way left over the mean speed of the last _SPEED_NS; None until a second of driving has shown one."""
        self._lately.append((now_ns, remaining))
        while self._lately[0][0] < now_ns - _SPEED_NS:
            self._lately.popleft()
        passed_s = (now_ns - self._lately[0][0]) * 1e-9
        gained = self._lately[0][1] - remaining
        if passed_s < 1.0 or gained <= 0.0:
            return None
        return remaining / max(gained / passed_s, self._settings.slowest_mps)

    def _failed(self, cause: str, reason: str) -> Failed:
        return Failed(cause, reason, self._state.remaining_m, self._state.distance_m)

    def _is_still(self, now_ns: int) -> bool:
        """Whether poses over at least still_s show no movement. Poses older than that are dropped."""
        horizon = now_ns - int(1e9 * self._settings.still_s)
        while len(self._recent) > 1 and self._recent[1][0] <= horizon:
            self._recent.popleft()
        if not self._recent or self._recent[0][0] > horizon:
            return False
        poses = np.array([pose[1:] for pose in self._recent])
        moved = np.hypot(*(poses[:, :2] - poses[0, :2]).T).max()
        turned = np.abs(np.angle(np.exp(1j * (poses[:, 2] - poses[0, 2])))).max()
        return bool(moved <= self._settings.still_m and turned <= self._settings.still_rad)

    def _remaining(self, place: NDArray[np.float64]) -> float:
        """Way left: to the nearest point of the way (never back before the segment reached), and from there along it."""
        if len(self._way) < 2:
            self.off_way_m = 0.0
            return float(np.hypot(*(self._way[-1] - place)))
        a, b = self._way[self._segment : -1], self._way[self._segment + 1 :]
        span = b - a
        square = np.maximum((span**2).sum(1), 1e-12)
        along = np.clip(((place - a) * span).sum(1) / square, 0.0, 1.0)
        foot = a + along[:, None] * span
        away = np.hypot(*(foot - place).T)
        # A way may pass the same corner twice: prefer the part that comes next.
        k = int((away + 0.05 * np.arange(len(away))).argmin())
        self._segment += k
        self.off_way_m = float(away[k])
        return float(away[k] + np.hypot(*(b[k] - foot[k])) + self._left_from[self._segment + 1])
