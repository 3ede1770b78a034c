"""Between the map and irsd's own eyes: which pictures are offered to them, with all that a late answer will need."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from irsd.core.types import CameraView, Rooms, Structure
from irsd.instances.lift import LiftSettings, points_in_sight
from irsd.instances.memory import InstanceMemory
from irsd.instances.room_prior import room_of
from irsd.mapping.mapper import Mapper
from irsd.perception.job import PerceptionJob, PerceptionResult, Sight
from irsd.perception.select import KeyframeSelector
from irsd.perception.worker import Eyes

Alone = Callable[[NDArray[np.float32]], NDArray[np.int32]]
_ALONE_NS = 10_000_000_000  # without detections from outside, after which irsd sees by itself again
_PATIENCE_NS = 3_000_000_000  # at the start, for a detector to be heard


class Company:
    """Whether somebody else sees: while detections come from outside, irsd's own eyes rest. By sensor time alone."""

    def __init__(self) -> None:
        self._first_ns: int | None = None
        self._heard_ns: int | None = None

    def heard(self, stamp_ns: int) -> None:
        """Detections of a picture of this time came from outside."""
        self._heard_ns = stamp_ns if self._heard_ns is None else max(self._heard_ns, stamp_ns)

    def alone(self, now_ns: int) -> bool:
        """Whether irsd must see by itself."""
        if self._first_ns is None:
            self._first_ns = now_ns
        if self._heard_ns is not None:
            return now_ns - self._heard_ns > _ALONE_NS
        return now_ns - self._first_ns >= _PATIENCE_NS


class Lookout:
    """Owner of what was looked at. Called by the map thread for every picture."""

    def __init__(self, eyes: Eyes, settings: LiftSettings) -> None:
        self.eyes = eyes
        self._settings = settings
        self._selector = KeyframeSelector()
        self._seq = 0
        self._passed = 0
        self._began_ns: int | None = None

    def show(
        self, view: CameraView, mapper: Mapper, memory: InstanceMemory, rooms: Rooms | None, alone: Alone | None = None
    ) -> None:
        """A picture; it is offered to the eyes when they can pay for one and it is worth it.

        alone: which part of the map that stands alone is at points [K, 3]: int32 [K], 0 none.
        """
        if not self.eyes.wants(view.stamp_ns):
            return
        points, structure = mapper.visible(view.map_T_camera, view.camera, self._settings.max_range_m)
        known = memory.known(points, self.eyes.dimension)
        room = room_of(rooms, view.map_T_camera[None, :3, 3].astype(np.float32))
        worth = self._selector.judge(view.stamp_ns, view.map_T_camera, points, known, room)
        if not self._selector.wants(view.stamp_ns, worth, self.eyes.waiting):
            self._passed += 1
            return
        self._selector.take(view.stamp_ns, worth, view.map_T_camera, points, room)
        index, pixel, depth_m = points_in_sight(view, points, self._settings)
        part = structure[index] != Structure.OTHER
        numbers = None if alone is None else alone(points[index])
        sight = Sight(pixel.astype(np.float32), depth_m.astype(np.float32), known.of_point[index], part, numbers)
        self._seq += 1
        self._began_ns = view.stamp_ns if self._began_ns is None else self._began_ns
        self.eyes.offer(PerceptionJob(self._seq, view, points, structure, sight, known, mapper.levels.floor_z_m))

    def answers(self) -> list[PerceptionResult]:
        """What the eyes have seen since the last call; what they were asked before this one looked is of another map."""
        began_ns = self._began_ns
        return [r for r in self.eyes.results() if began_ns is not None and r.job.view.stamp_ns >= began_ns]

    def counters(self) -> dict[str, int]:
        """Keyframes that were offered, and pictures that were compared and found to be worth less."""
        return {"keyframes_offered": self._seq, "pictures_passed_over": self._passed}
