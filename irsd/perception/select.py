"""Which pictures are worth a look: motion, novelty, room coverage, and things that were not looked at for long come first.

A pure owner of what was looked at already: it is told poses, map points and rooms, and sensor time.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.core.geometry import Pose
from irsd.core.types import KnownThings

_CELL_M = 0.25  # of what counts as one place
_ENOUGH = 2  # keyframes after which a place is no news
_MOVED_M, _TURNED_RAD = 1.0, math.radians(45)  # a picture from so far off is wholly another one
_STALE_S = 30.0  # after which a thing should be looked at again
_BLUR_RAD_S = 0.6  # rate of turning at which a picture is worth half
_LEAST, _PATIENCE_S = 0.15, 8.0  # a picture must be worth so much; after this time, anything is
_AGEING = 0.15  # worth that a waiting picture loses per second to newer ones
_MAX_CELLS = 400_000
_WEIGHTS = (0.4, 0.2, 0.15, 0.25)  # novelty, motion, room, staleness


@dataclass(frozen=True, slots=True)
class Worth:
    """Of one picture, each 0..1: the parts and their weighted sum times how sharp it should be."""

    novelty: float
    motion: float
    room: float
    staleness: float
    sharpness: float

    @property
    def total(self) -> float:
        parts = (self.novelty, self.motion, self.room, self.staleness)
        return self.sharpness * sum(w * p for w, p in zip(_WEIGHTS, parts, strict=True))


class KeyframeSelector:
    """Judges pictures in the order of their stamps. ``judge`` then ``take`` for those that are taken."""

    def __init__(self) -> None:
        self._cells: dict[int, int] = {}
        self._poses: deque[Pose] = deque(maxlen=64)
        self._rooms: dict[int, int] = {}
        self._last: tuple[int, Pose] | None = None  # the picture before, whether taken or not
        self._taken_ns: int | None = None
        self._waiting: tuple[int, float] | None = None  # stamp and worth of the picture taken last

    def judge(
        self, stamp_ns: int, map_T_camera: Pose, points_map: NDArray[np.float32], known: KnownThings, room: int
    ) -> Worth:
        """points_map: float32 [K, 3] in view, whose owners ``known`` tells; room: id of the room the camera is in, 0 = none."""
        keys = place_keys(points_map)
        new = sum(self._cells.get(key, 0) < _ENOUGH for key in keys.tolist()) / max(len(keys), 1)
        moved = min((_distance(map_T_camera, pose) for pose in self._poses), default=1.0)
        fresh_ns = stamp_ns - round(_STALE_S * 1e9)
        stale = float((known.last_seen_ns < fresh_ns).mean()) if len(known.id) else 0.0
        sharp = 1.0
        if self._last is not None and 0 < stamp_ns - self._last[0] < 1_000_000_000:
            rate = _angle(map_T_camera, self._last[1]) / ((stamp_ns - self._last[0]) * 1e-9)
            sharp = 1.0 / (1.0 + (rate / _BLUR_RAD_S) ** 2)
        self._last = (stamp_ns, map_T_camera)
        return Worth(new, min(moved, 1.0), 1.0 / (1.0 + self._rooms.get(room, 0)), stale, sharp)

    def wants(self, stamp_ns: int, worth: Worth, waiting: bool) -> bool:
        """Whether to take this picture. waiting: the one taken last was not begun yet, and would be given up for this one."""
        if waiting and self._waiting is not None:
            age_s = (stamp_ns - self._waiting[0]) * 1e-9
            return worth.total >= self._waiting[1] - _AGEING * age_s
        if self._taken_ns is None:
            return True
        patience = 1.0 - (stamp_ns - self._taken_ns) * 1e-9 / _PATIENCE_S
        return worth.total >= _LEAST * patience

    def take(self, stamp_ns: int, worth: Worth, map_T_camera: Pose, points_map: NDArray[np.float32], room: int) -> None:
        """The picture becomes a keyframe."""
        self._taken_ns, self._waiting = stamp_ns, (stamp_ns, worth.total)
        self._poses.append(map_T_camera)
        self._rooms[room] = self._rooms.get(room, 0) + 1
        if len(self._cells) > _MAX_CELLS:  # a site of many thousand square metres: begin anew
            self._cells.clear()
        for key in place_keys(points_map).tolist():
            self._cells[key] = self._cells.get(key, 0) + 1


def place_keys(points_map: NDArray[np.float32]) -> NDArray[np.int64]:
    """Unique keys int64 of the places that hold points float32 [K, 3]."""
    cell = np.floor(points_map / np.float32(_CELL_M)).astype(np.int64) + (1 << 20)
    return np.unique((cell[:, 0] << 42) | (cell[:, 1] << 21) | cell[:, 2])


def _distance(a: Pose, b: Pose) -> float:
    """How different two pictures are by their poses: 1 = a metre, or 45 degrees, or some of both."""
    return float(np.linalg.norm(a[:3, 3] - b[:3, 3])) / _MOVED_M + _angle(a, b) / _TURNED_RAD


def _angle(a: Pose, b: Pose) -> float:
    """Angle in radians between the viewing directions."""
    return math.acos(min(max(float(a[:3, 2] @ b[:3, 2]), -1.0), 1.0))
