"""Where the robot was at any instant, and sweeps with the robot's motion taken out. Everything between samples is slerp."""

from __future__ import annotations

import bisect
import itertools

import numpy as np
from numpy.typing import NDArray

from irsd.core.geometry import Pose, invert, make_pose, slerp, transform
from irsd.core.types import OdomSample, StaticTransform

KNOT_S = 0.004
"""Between knots this far apart a chord stands for the arc: at 3 rad/s and 30 m it is off by (3 * 0.004)^2 / 8 * 30 = 0.5 mm."""

_MAX_FRAMES = 1000  # static frames kept; a robot has tens


class PoseTrack:
    """The odometry of the last ``window_s`` seconds, sorted by stamp. Owner of that state; times are int ns of the sensor clock."""

    def __init__(self, window_s: float) -> None:
        self._window_ns = int(window_s * 1e9)
        self._stamps: list[int] = []
        self._rows: list[NDArray[np.float64]] = []  # position, quat_xyzw

    def __bool__(self) -> bool:
        return bool(self._stamps)

    @property
    def first_ns(self) -> int:
        return self._stamps[0]

    @property
    def last_ns(self) -> int:
        return self._stamps[-1]

    def push(self, sample: OdomSample) -> str:
        """What became of the sample: ``kept``, ``out_of_order`` (kept, in its place), ``duplicate`` (dropped) or ``clock_reset``.

        A sample older than the whole window can't be late: the clock was set back, and all that was known is void.
        """
        outcome = "kept"
        if self._stamps and sample.stamp_ns < self.last_ns - self._window_ns:
            self.clear()
            outcome = "clock_reset"
        at = bisect.bisect_left(self._stamps, sample.stamp_ns)
        if at < len(self._stamps):
            if self._stamps[at] == sample.stamp_ns:
                return "duplicate"
            outcome = "out_of_order"
        self._stamps.insert(at, sample.stamp_ns)
        self._rows.insert(at, np.concatenate([sample.position_m, sample.quat_xyzw]))
        expired = bisect.bisect_left(self._stamps, self.last_ns - self._window_ns)
        del self._stamps[:expired], self._rows[:expired]
        return outcome

    def clear(self) -> None:
        """Forgets everything."""
        self._stamps.clear()
        self._rows.clear()

    def widest_gap_ns(self, start_ns: int, end_ns: int) -> int:
        """The longest time without a sample among those that enclose start..end, which the track must cover."""
        low, high = self._enclosing(start_ns, end_ns)
        stamps = self._stamps[low:high]
        return max((b - a for a, b in itertools.pairwise(stamps)), default=0)

    def covers(self, start_ns: int, end_ns: int) -> bool:
        """Whether there is a sample at or before the start and at or after the end."""
        return bool(self._stamps) and self.first_ns <= start_ns and end_ns <= self.last_ns

    def knots(self, start_ns: int, end_ns: int) -> NDArray[np.int64]:
        """int64 [K]: start, end and instants between, at every sample and at most ``KNOT_S`` apart. K >= 1, increasing."""
        low, high = self._enclosing(start_ns, end_ns)
        count = 1 + int(np.ceil((end_ns - start_ns) / (KNOT_S * 1e9)))
        even = np.linspace(0, end_ns - start_ns, count).astype(np.int64) + start_ns
        at_samples = [s for s in self._stamps[low:high] if start_ns < s < end_ns]
        return np.unique(np.concatenate([even, np.array([start_ns, end_ns, *at_samples], np.int64)]))

    def poses(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """odom_T_base [K, 4, 4] at sorted stamps int64 [K] (K >= 1), which the track must cover: position linear, rotation slerp."""
        low, high = self._enclosing(int(stamps_ns[0]), int(stamps_ns[-1]))
        rows = np.array(self._rows[low:high])
        known = np.array(self._stamps[low:high], np.int64)
        if len(known) == 1:
            return np.repeat(make_pose(rows[:, :3], rows[:, 3:]), len(stamps_ns), 0)
        left = np.clip(np.searchsorted(known, stamps_ns, side="right") - 1, 0, len(known) - 2)
        fraction = (stamps_ns - known[left]) / (known[left + 1] - known[left])
        a, b = rows[left], rows[left + 1]
        position = a[:, :3] + fraction[:, None] * (b[:, :3] - a[:, :3])
        return make_pose(position, slerp(a[:, 3:], b[:, 3:], fraction))

    def _enclosing(self, start_ns: int, end_ns: int) -> tuple[int, int]:
        """[low, high): the samples from the last at or before the start to the first at or after the end."""
        low = max(0, bisect.bisect_right(self._stamps, start_ns) - 1)
        return low, bisect.bisect_left(self._stamps, end_ns) + 1


class MountTree:
    """The fixed transforms between the robot's frames, and the chain between any two of them."""

    def __init__(self) -> None:
        self._parents: dict[str, StaticTransform] = {}
        self._chains: dict[tuple[str, str], Pose | None] = {}

    def push(self, mount: StaticTransform) -> bool:
        """Adds or replaces the mounting of a frame. False when there are too many frames to be a robot's."""
        if mount.child not in self._parents and len(self._parents) >= _MAX_FRAMES:
            return False
        self._parents[mount.child] = mount
        self._chains.clear()
        return True

    def find(self, base: str, sensor: str) -> Pose | None:
        """base_T_sensor [4, 4] composed along the tree, up and down, or None where the frames are not connected."""
        key = (base, sensor)
        if key not in self._chains:
            self._chains[key] = self._compose(base, sensor)
        return self._chains[key]

    def _compose(self, base: str, sensor: str) -> Pose | None:
        base_side, sensor_side = self._ancestors(base), self._ancestors(sensor)
        shared = next((frame for frame in sensor_side if frame in base_side), None)
        if shared is None:
            return None
        return np.asarray(invert(base_side[shared]) @ sensor_side[shared], np.float64)

    def _ancestors(self, frame: str) -> dict[str, Pose]:
        """ancestor -> ancestor_T_frame, nearest first, the frame itself included. A loop ends where it closes."""
        ancestor_T_frame: Pose = np.eye(4)
        found: dict[str, Pose] = {frame: ancestor_T_frame}
        at = frame
        while (mount := self._parents.get(at)) is not None and mount.parent not in found:
            ancestor_T_frame = mount.parent_T_child @ ancestor_T_frame
            at = mount.parent
            found[at] = ancestor_T_frame
        return found


def deskew(
    points_sensor: NDArray[np.float32],
    time_s: NDArray[np.float32],
    knots_s: NDArray[np.float64],
    map_T_sensor: NDArray[np.float64],
) -> NDArray[np.float32]:
    """points_map float32 [N, 3] of points_sensor [N, 3], measured at time_s [N], by poses [K, 4, 4] at increasing knots_s [K].

    Between knots the matrices blend linearly; their chord error is what ``KNOT_S`` bounds. Times outside take the nearest pose.
    """
    if len(knots_s) == 1:
        return transform(map_T_sensor[0], points_sensor).astype(np.float32, copy=False)
    left = np.clip(np.searchsorted(knots_s, time_s, side="right") - 1, 0, len(knots_s) - 2)
    fraction = ((time_s - knots_s[:-1].take(left)) / np.diff(knots_s).take(left)).astype(np.float32)
    np.clip(fraction, 0.0, 1.0, out=fraction)
    # element by element over all points: half the time of gathering whole matrices
    at = map_T_sensor[:-1].astype(np.float32)
    step = np.diff(map_T_sensor, axis=0).astype(np.float32)
    xyz = np.ascontiguousarray(points_sensor.T)
    out = np.empty((len(points_sensor), 3), np.float32)
    for row in range(3):
        total = at[:, row, 3].take(left) + fraction * step[:, row, 3].take(left)
        for column in range(3):
            total += (at[:, row, column].take(left) + fraction * step[:, row, column].take(left)) * xyz[column]
        out[:, row] = total
    return out
