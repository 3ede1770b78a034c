"""The room stage: plan evidence in, rooms with stable ids out. Owner of the tracker and of the last result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from irsd.core.types import Opening, PlanEvidence, RoomFootprint, Rooms
from irsd.rooms.segment import describe, openings_between, segment_evidence
from irsd.rooms.settings import SegmentSettings
from irsd.rooms.tracker import RoomTracker, TrackSettings
from irsd.rooms.walls import Walls, WallSettings, find_walls, merge_levels, polygon_area, snapped

_MAX_WALL_POINTS = 40_000  # more do not make a wall's line better


@dataclass(frozen=True, slots=True)
class RoomSettings:
    """Settings of the room stage."""

    segment: SegmentSettings = field(default_factory=SegmentSettings)
    walls: WallSettings = field(default_factory=WallSettings)
    track: TrackSettings = field(default_factory=TrackSettings)


class RoomStage:
    """Rooms of the growing map. Unchanged evidence costs a comparison and gives back the same object."""

    def __init__(self, settings: RoomSettings) -> None:
        self._settings = settings
        self._tracker = RoomTracker(settings.track)
        self._evidence: PlanEvidence | None = None
        self._rooms: Rooms | None = None
        self._floors: tuple[tuple[float, float], ...] = ()  # (height, times seen) of every level
        self._ceilings: tuple[tuple[float, float], ...] = ()

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
        before: tuple[Opening, ...] = () if self._rooms is None else self._rooms.openings
        found = segment_evidence(evidence, self._settings.segment, before)
        tracked = self._tracker.update(found.labels, evidence.frame)
        ids, drawn = describe(tracked.labels, evidence, self._settings.segment)
        walls = find_walls(*_thinned(wall_points, wall_normals), self._settings.walls)
        floor_z_m, ceiling_z_m = self._levels(evidence)
        footprints = tuple(_on_walls(f, walls, self._settings.walls.snap_m, floor_z_m, ceiling_z_m) for f in drawn)
        openings = openings_between(tracked.labels, evidence.frame, (*found.openings, *before))
        self._evidence = evidence
        self._rooms = Rooms(evidence.frame, tracked.labels, ids, footprints, openings, tracked.lineage)
        return self._rooms

    def _levels(self, evidence: PlanEvidence) -> tuple[float, float | None]:
        """Heights of the floor and ceiling that the evidence means: of all seen so far, those within tau_3 are one level."""
        tau = self._settings.walls.tau_3_m
        self._floors, floor_z_m = _merged(self._floors, evidence.floor_z_m, tau)
        if evidence.ceiling_z_m is None:
            return floor_z_m, None
        self._ceilings, ceiling_z_m = _merged(self._ceilings, evidence.ceiling_z_m, tau)
        return floor_z_m, ceiling_z_m

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


def _thinned(
    points: NDArray[np.float32], normals: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Every n-th wall point, so that a large building costs no more than a small one."""
    stride = max(-(-len(points) // _MAX_WALL_POINTS), 1)
    return points[::stride], normals[::stride]


def _merged(
    levels: tuple[tuple[float, float], ...], height_m: float, tau_3_m: float
) -> tuple[tuple[tuple[float, float], ...], float]:
    """The levels (height, weight) with one more sighting, and the height of the level it belongs to."""
    heights = np.array([*(h for h, _ in levels), height_m])
    weights = np.array([*(w for _, w in levels), 1.0])
    merged = merge_levels(heights, weights, tau_3_m)
    found = {float(h): float(weights[merged == h].sum()) for h in merged}
    return tuple(sorted(found.items())), float(merged[-1])


def _on_walls(
    drawn: RoomFootprint, walls: Walls, reach_m: float, floor_z_m: float, ceiling_z_m: float | None
) -> RoomFootprint:
    """The footprint with its outline on the wall planes, its AABB (the paper's room) around it, and its levels."""
    polygon = snapped(drawn.polygon_xy, walls, reach_m)
    low, high = polygon.min(0), polygon.max(0)
    box = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    return RoomFootprint(polygon, box, polygon_area(polygon), floor_z_m, ceiling_z_m)
