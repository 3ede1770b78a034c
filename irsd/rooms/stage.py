"""The room stage: plan evidence in, rooms with stable ids out. Owner of the tracker and of the last result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from irsd.core.types import Opening, PlanEvidence, RoomFootprint, Rooms
from irsd.rooms.segment import SegmentSettings, describe, openings_between, segment_evidence
from irsd.rooms.tracker import RoomTracker, TrackSettings


@dataclass(frozen=True, slots=True)
class RoomSettings:
    """Settings of the room stage."""

    segment: SegmentSettings = field(default_factory=SegmentSettings)
    track: TrackSettings = field(default_factory=TrackSettings)


class RoomStage:
    """Rooms of the growing map. Unchanged evidence costs a comparison and gives back the same object."""

    def __init__(self, settings: RoomSettings) -> None:
        self._settings = settings
        self._tracker = RoomTracker(settings.track)
        self._evidence: PlanEvidence | None = None
        self._rooms: Rooms | None = None

    def restore(self, ids: Sequence[int], footprints: Sequence[RoomFootprint]) -> None:
        """Continue with the rooms of an earlier run: found again, they keep their ids."""
        self._tracker.restore(ids, footprints)

    def update(
        self, evidence: PlanEvidence, wall_points: NDArray[np.float32], wall_normals: NDArray[np.float32]
    ) -> Rooms:
        """Rooms of the map as it is now.

        wall_points, wall_normals: float32 [W, 3], map frame: voxels of walls and their unit normals.
        """
        if self._rooms is not None and self._evidence is not None and _same(evidence, self._evidence):
            return self._settled(self._rooms)
        found = segment_evidence(evidence, self._settings.segment)
        tracked = self._tracker.update(found.labels, evidence.frame)
        ids, footprints = describe(tracked.labels, evidence, self._settings.segment)
        before: tuple[Opening, ...] = () if self._rooms is None else self._rooms.openings
        openings = openings_between(tracked.labels, evidence.frame, (*found.openings, *before))
        self._evidence = evidence
        self._rooms = Rooms(evidence.frame, tracked.labels, ids, footprints, openings, tracked.lineage)
        return self._rooms

    def _settled(self, rooms: Rooms) -> Rooms:
        """The last rooms once more; what happened to them is news only once."""
        if rooms.lineage:
            self._rooms = Rooms(rooms.frame, rooms.labels, rooms.ids, rooms.footprints, rooms.openings, ())
            return self._rooms
        return rooms


def _same(a: PlanEvidence, b: PlanEvidence) -> bool:
    """Whether two evidences lead to the same rooms."""
    return (
        a.frame == b.frame
        and (a.floor_z_m, a.ceiling_z_m) == (b.floor_z_m, b.ceiling_z_m)
        and np.array_equal(a.free, b.free)
        and np.array_equal(a.wall, b.wall)
    )
