"""Whether the sensors are to be believed: frozen messages, clocks that jump or differ, odometry that jumps, mountings that disagree.

``SensorWatch`` looks at every message on the map thread, beside the synchroniser and without influence on it. Each detector is a
small pure rule over the last few values; what they find, others read from any thread.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from irsd.core.faults import Finding
from irsd.core.geometry import farthest_step, invert
from irsd.core.runtime import Cell
from irsd.core.settings import setting
from irsd.core.types import CameraImage, Detections, LidarScan, OdomSample, Sensed, StaticTransform
from irsd.sensors.picture_health import judge_picture

_STAMP_END = 12  # CDR header and stamp: what a driver that repeats itself may still renew
_FROZEN_MESSAGES = 4
_OFFSET_WINDOW_S = 3.0
_SAME_M, _SAME_RAD = 0.005, 0.005  # mountings that differ by less are one
_PICTURE_PERIOD_NS = 300_000_000
_MAX_FRAMES = 1000


@dataclass(frozen=True, slots=True)
class WatchSettings:
    """When a sensor is not to be believed."""

    frozen_s: float = setting(
        1.2, "a LiDAR, camera or odometry that repeats one message for longer is frozen", lo=0.2, hi=60.0
    )
    clock_jump_s: float = setting(
        1.0, "stamps that step by this much more than the time that passed have jumped", lo=0.1
    )
    clock_offset_s: float = setting(0.5, "clocks of two sensors that differ by more are not synchronised", lo=0.05)
    max_speed_mps: float = setting(5.0, "odometry that moves faster has jumped", lo=0.1, hi=100.0)
    shown_s: float = setting(20.0, "how long a jump is shown as a fault", lo=1.0, hi=3600.0)


@dataclass(frozen=True, slots=True)
class _Shown:
    """A finding and when it stops being shown (monotonic ns; None: for as long as it is found)."""

    finding: Finding
    until_ns: int | None


@dataclass(slots=True)
class _Topic:
    """What is remembered of one topic. offsets: (arrival, stamp - arrival), ns."""

    body: bytes | memoryview = b""
    same: int = 0
    same_since_ns: int = 0
    stamp_ns: int | None = None
    arrived_ns: int = 0
    offsets: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=512))


def clock_step_ns(stamps_ns: tuple[int, int], arrivals_ns: tuple[int, int], limit_ns: int) -> int:
    """By how much a clock jumped between two messages; 0 when it did not.

    Stamps may come late and in bursts (a network that stalls), so that only going back, and running ahead of the time that passed,
    are jumps. A stamp that is a little older than the one before is out of order, no jump.
    """
    step, passed = stamps_ns[1] - stamps_ns[0], arrivals_ns[1] - arrivals_ns[0]
    return step - passed if step < -limit_ns or step - passed > limit_ns else 0


def odometry_step(before: OdomSample, after: OdomSample, max_speed_mps: float) -> str:
    """What is impossible about the way between two poses, in words; empty when nothing is."""
    passed_s = (after.stamp_ns - before.stamp_ns) * 1e-9
    if passed_s <= 0 or before.frame_id != after.frame_id:
        return ""
    moved_m = float(np.linalg.norm(after.position_m - before.position_m))
    turned_rad = 2.0 * float(np.arccos(np.clip(abs(before.quat_xyzw @ after.quat_xyzw), 0.0, 1.0)))
    most_m, most_rad = farthest_step(passed_s, max_speed_mps)
    if moved_m > most_m:
        return f"moved {moved_m:.2f} m in {passed_s:.2f} s"
    if turned_rad > most_rad:
        return f"turned {np.degrees(turned_rad):.0f} degrees in {passed_s:.2f} s"
    return ""


def mounting_change(before: StaticTransform, after: StaticTransform) -> str:
    """How two mountings of one frame differ, in words; empty when they don't."""
    if before.parent != after.parent:
        return f"{after.child} is mounted on {before.parent} and on {after.parent}"
    between = invert(before.parent_T_child) @ after.parent_T_child
    moved_m = float(np.linalg.norm(between[:3, 3]))
    turned_rad = float(np.arccos(np.clip((np.trace(between[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)))
    if moved_m > _SAME_M or turned_rad > _SAME_RAD:
        return f"{after.parent} -> {after.child} differs by {moved_m:.3f} m and {np.degrees(turned_rad):.1f} degrees"
    return ""


def cycle_of(parents: dict[str, str], frame: str) -> tuple[str, ...]:
    """The frames of the loop that begins at ``frame``, none when its chain has an end."""
    chain, at = [frame], parents.get(frame)
    while at is not None and len(chain) <= len(parents):
        if at == frame:
            return tuple(chain)
        chain.append(at)
        at = parents.get(at)
    return ()


class SensorWatch:
    """Owner of what was seen of each topic lately. ``hear`` and ``refresh`` belong to one thread, ``findings`` to any."""

    def __init__(self, settings: WatchSettings) -> None:
        self._settings = settings
        self._topics: dict[str, _Topic] = {}
        self._pose: OdomSample | None = None
        self._mounts: dict[str, StaticTransform] = {}
        self._cycle: tuple[str, ...] = ()
        self._events: dict[tuple[str, str], _Shown] = {}
        self._pictures: dict[str, tuple[int, str, str, int]] = {}  # topic -> (first ns, code, text, looked at ns)
        self._shown: Cell[tuple[_Shown, ...]] = Cell(())

    def hear(self, topic: str, kind: str, payload: bytes, received_ns: int, sensed: Sequence[Sensed]) -> None:
        """One message that could be decoded, and what was in it."""
        state = self._topics.setdefault(topic, _Topic())
        if kind in ("lidar", "image", "image_compressed", "odometry"):
            self._compare(state, payload if kind == "odometry" else memoryview(payload)[_STAMP_END:], received_ns)
        for one in sensed:
            if isinstance(one, StaticTransform):
                self._mount(topic, one, received_ns)
            elif isinstance(one, (LidarScan, CameraImage, OdomSample, Detections)):
                self._clock(topic, kind, state, one.stamp_ns, received_ns)
            if isinstance(one, OdomSample):
                self._move(topic, one, received_ns)
            elif isinstance(one, CameraImage):
                self._look(topic, one, received_ns)

    def refresh(self, now_ns: int) -> None:
        """Brings up to date what ``findings`` says; to be called a few times a second."""
        shown = [event for event in self._events.values() if event.until_ns is None or event.until_ns > now_ns]
        self._events = {(event.finding.code, event.finding.subject): event for event in shown}
        for topic, state in self._topics.items():
            frozen_s = (state.arrived_ns - state.same_since_ns) * 1e-9
            if state.same >= _FROZEN_MESSAGES and frozen_s > self._settings.frozen_s:
                text = f"{topic}: {state.same} messages with the same content"
                shown.append(_Shown(Finding("sensor_frozen", topic, text), None))
        shown += [_Shown(finding, None) for finding in self._offsets(now_ns)]
        for topic, (first_ns, code, text, last_ns) in self._pictures.items():
            if code and (last_ns - first_ns) * 1e-9 > self._settings.frozen_s:
                shown.append(_Shown(Finding(code, topic, text), None))
        if self._cycle:
            loop = " -> ".join((*self._cycle, self._cycle[0]))
            shown.append(_Shown(Finding("tf_cycle", self._cycle[0], f"mountings in a circle: {loop}"), None))
        self._shown.set(tuple(shown))

    def findings(self, now_ns: int) -> list[Finding]:
        """What is wrong now."""
        return [one.finding for one in self._shown.get() if one.until_ns is None or one.until_ns > now_ns]

    # ---------------------------------------------------------------------------------------------------- detectors
    def _compare(self, state: _Topic, body: bytes | memoryview, received_ns: int) -> None:
        if body == state.body:
            state.same += 1
        else:
            state.body, state.same, state.same_since_ns = body, 0, received_ns

    def _clock(self, topic: str, kind: str, state: _Topic, stamp_ns: int, received_ns: int) -> None:
        if state.stamp_ns is not None:
            limit_ns = int(self._settings.clock_jump_s * 1e9)
            step_ns = clock_step_ns((state.stamp_ns, stamp_ns), (state.arrived_ns, received_ns), limit_ns)
            if step_ns:
                self._event(
                    received_ns, Finding("time_jump", topic, f"{topic}: stamps jumped by {step_ns * 1e-9:+.1f} s")
                )
                state.offsets.clear()
        state.stamp_ns, state.arrived_ns = stamp_ns, received_ns
        if not kind.startswith("detections"):  # a detector may take seconds
            state.offsets.append((received_ns, stamp_ns - received_ns))

    def _offsets(self, now_ns: int) -> list[Finding]:
        """Topics whose clock differs from that of the odometry (or of the first topic there is).

        Delay only ever makes stamps look older: the newest-looking stamp of a window is the one nearest to the clock's offset.
        """
        since_ns = now_ns - int(_OFFSET_WINDOW_S * 1e9)
        offsets_ns = {}
        for topic, state in self._topics.items():
            lately = [offset for arrived, offset in state.offsets if arrived >= since_ns]
            if len(lately) >= 2:
                offsets_ns[topic] = max(lately)
        if not offsets_ns:
            return []
        base = self._base_topic if self._base_topic in offsets_ns else next(iter(offsets_ns))
        out = []
        for topic, offset_ns in offsets_ns.items():
            apart_s = (offset_ns - offsets_ns[base]) * 1e-9
            if topic != base and abs(apart_s) > self._settings.clock_offset_s:
                text = f"{topic}: its clock is {apart_s:+.2f} s from that of {base}"
                out.append(Finding("clock_offset", topic, text))
        return out

    _base_topic: str = ""

    def _move(self, topic: str, sample: OdomSample, received_ns: int) -> None:
        self._base_topic = topic
        if self._pose is not None:
            wrong = odometry_step(self._pose, sample, self._settings.max_speed_mps)
            if wrong:
                self._event(received_ns, Finding("odometry_jump", topic, f"{topic}: {wrong}"))
        self._pose = sample

    def _mount(self, topic: str, mount: StaticTransform, received_ns: int) -> None:
        before = self._mounts.get(mount.child)
        if before is None and len(self._mounts) >= _MAX_FRAMES:
            return
        if before is not None and (wrong := mounting_change(before, mount)):
            self._event(received_ns, Finding("tf_inconsistent", mount.child, f"{topic}: {wrong}"))
        self._mounts[mount.child] = mount
        parents = {child: known.parent for child, known in self._mounts.items()}
        self._cycle = cycle_of(parents, mount.child) or (self._cycle and cycle_of(parents, self._cycle[0]))

    def _look(self, topic: str, image: CameraImage, received_ns: int) -> None:
        first_ns, before, _, looked_ns = self._pictures.get(topic, (received_ns, "", "", 0))
        if received_ns - looked_ns < _PICTURE_PERIOD_NS:
            return
        code, text = judge_picture(image.bgr)
        first_ns = first_ns if code == before else received_ns
        self._pictures[topic] = (first_ns, code, f"{topic}: {text}", received_ns)

    def _event(self, now_ns: int, finding: Finding) -> None:
        until_ns = now_ns + int(self._settings.shown_s * 1e9)
        self._events[finding.code, finding.subject] = _Shown(finding, until_ns)
