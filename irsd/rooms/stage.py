"""The room stage: plan evidence in, rooms with stable ids out, floor by floor.

A pass over a floor costs its area, so it is made only when its plan has changed by a share of that area, or when a small
change has waited: what a scan costs in the mean follows what it changed.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from irsd.core.types import Opening, PlanEvidence, RoomFootprint, Rooms
from irsd.rooms.algorithm1 import BoxRooms
from irsd.rooms.floor import FloorRooms
from irsd.rooms.outline import WallPoints
from irsd.rooms.segment import finished
from irsd.rooms.settings import RoomSettings
from irsd.rooms.tracker import IdSource

__all__ = ["PlanSource", "RoomSettings", "RoomStage"]

_MAX_WALL_POINTS = 40_000  # more do not make a wall's line better
_MAX_PATH = 4096
_CELLS_A_CALL = 1_000_000  # of the plan (2500 m2 at 5 cm): the work on a larger one rests, so that a scan costs the same in the mean
_EAGER_PASSES, _WALLS_EVERY = 8, 4  # wall points are fetched after each of the first passes, then after every fourth


class PlanSource(Protocol):
    """Where evidence comes from when it is needed: the mapper."""

    def plan_evidence(self) -> PlanEvidence:
        """The map from above. Costs a pass over the grid."""

    def wall_points(self) -> WallPoints:
        """Points [W, 3] of walls and their normals. Costs a pass over the voxels."""


class RoomStage:
    """Rooms of the growing map. Unchanged evidence gives back the same object."""

    def __init__(self, settings: RoomSettings) -> None:
        self._settings = settings
        self._ids = IdSource()
        self._floors: dict[int, FloorRooms | BoxRooms] = {}
        self._restored: tuple[tuple[int, RoomFootprint], ...] = ()
        self._ways: tuple[Opening, ...] = ()
        self._rooms: Rooms | None = None
        self._walls: WallPoints | None = None
        self._path: list[tuple[float, float]] = []
        self._running: Generator[None, None, Rooms] | None = None
        self._waited = 0
        self._pause = self._resting = 0
        self._walls_due = True
        self._passes = 0

    def restore(
        self, ids: Sequence[int], footprints: Sequence[RoomFootprint], openings: Sequence[Opening] = ()
    ) -> None:
        """Continue with the rooms of an earlier run: found again, they keep their ids; until then they stay as they were.

        Opening.rooms hold ids.
        """
        if len(ids) != len(footprints) or any(i < 1 for i in ids):
            raise ValueError(f"expected one positive id per footprint, got {list(ids)} for {len(footprints)}")
        self._restored, self._ways = tuple(zip(ids, footprints, strict=True)), tuple(openings)
        self._ids.reserve(ids)

    @property
    def next_id(self) -> int:
        """The number that the next new room gets."""
        return self._ids.next_id

    def reserve(self, next_id: int) -> None:
        """Numbers below this one are not given out."""
        self._ids.reserve([next_id - 1])

    def follow(self, source: PlanSource, robot_xy: tuple[float, float] | None = None) -> Rooms:
        """Rooms after one more scan: looks at the plan every few calls, works when enough of it has changed, and then one step of
        the work in each call."""
        if robot_xy is not None and len(self._path) < _MAX_PATH:
            self._path.append(robot_xy)
        self._waited += 1
        if self._rooms is None:
            return finished(self._work(source.plan_evidence(), None))
        if self._running is not None:
            if self._resting:
                self._resting -= 1
                return self._settled(self._rooms)
            self._resting = self._pause
            return self._step(self._running)
        if self._waited % self._settings.look_every:
            if self._walls_due:
                self._walls, self._walls_due = _thinned(*source.wall_points()), False
            return self._settled(self._rooms)
        evidence = source.plan_evidence()
        if not self._due(evidence):
            return self._settled(self._rooms)
        self._running = self._work(evidence, self._walls)
        self._pause = self._resting = self._rooms.labels.size // _CELLS_A_CALL
        return self._settled(self._rooms)

    def update(
        self,
        evidence: PlanEvidence,
        wall_points: NDArray[np.float32],
        wall_normals: NDArray[np.float32],
        path_xy: Sequence[tuple[float, float]] = (),
    ) -> Rooms:
        """Rooms of the map as it is now, whatever has changed.

        wall_points, wall_normals: float32 [W, 3], map frame: voxels of walls and their unit normals. path_xy: where the robot went.
        """
        news: tuple[str, ...] = ()
        if self._running is not None:
            news, self._running = finished(self._running).lineage, None
        self._path += path_xy
        floor = self._floors.get(evidence.floor)
        if self._rooms is not None and floor is not None and not floor.changed(evidence) and not path_xy:
            return self._settled(self._rooms)
        rooms = finished(self._work(evidence, _thinned(wall_points, wall_normals)))
        self._rooms = replace(rooms, lineage=(*news, *rooms.lineage)) if news else rooms
        return self._rooms

    def _step(self, work: Generator[None, None, Rooms]) -> Rooms:
        try:
            next(work)
        except StopIteration as done:
            self._running = None
            rooms: Rooms = done.value
            return rooms
        assert self._rooms is not None
        return self._settled(self._rooms)

    def _due(self, evidence: PlanEvidence) -> bool:
        """Whether enough has changed for a pass, or a little has waited long enough."""
        floor = self._floors.get(evidence.floor)
        if floor is None:
            return True
        changed, many = floor.changed(evidence), self._settings.changed_share * float(evidence.known.sum())
        # The longer the wait, the less it takes: with what is left after a long one, any change.
        wait = self._waited / self._settings.settle_after
        least = many if wait < 1 else many / 4 if wait < 5 else 1.0
        return changed >= max(least, 1.0)

    def _work(self, evidence: PlanEvidence, walls: WallPoints | None) -> Generator[None, None, Rooms]:
        floor = self._floors.get(evidence.floor)
        if floor is None:
            make = BoxRooms if self._settings.method == "irs" else FloorRooms
            floor = self._floors[evidence.floor] = make(self._settings, self._ids)
            mine = [(i, f) for i, f in self._restored if f.floor == evidence.floor]
            here = {i for i, _ in mine}
            floor.restore([i for i, _ in mine], [f for _, f in mine], [o for o in self._ways if here >= set(o.rooms)])
        path, self._path = self._path, self._path[-1:]
        self._waited, self._passes = 0, self._passes + 1
        # A pass over the voxels is dear, and walls that were seen well once stay where they are.
        self._walls_due = self._passes <= _EAGER_PASSES or self._passes % _WALLS_EVERY == 0
        rooms = yield from floor.updating(evidence, walls, np.array(path, np.float64).reshape(-1, 2))
        others = [self._floors[k].rooms for k in sorted(self._floors) if k != evidence.floor]
        elsewhere = [(i, f) for i, f in self._restored if f.floor not in self._floors]
        self._rooms = _together(rooms, [o for o in others if o is not None], elsewhere)
        return self._rooms

    def _settled(self, rooms: Rooms) -> Rooms:
        """The last rooms once more; what happened to them is news only once."""
        if rooms.lineage:
            self._rooms = replace(rooms, lineage=())
            return self._rooms
        return rooms


def _together(here: Rooms, others: Sequence[Rooms], unvisited: Sequence[tuple[int, RoomFootprint]]) -> Rooms:
    """The rooms of all floors by id; the labels are those of the floor where the robot is. unvisited: rooms of floors of an
    earlier run on which it was not yet in this one."""
    if not others and not unvisited:
        return here
    pairs = [pair for rooms in (here, *others) for pair in zip(rooms.ids, rooms.footprints, strict=True)]
    pairs += unvisited
    pairs.sort(key=lambda pair: pair[0])
    openings = tuple(o for rooms in (here, *others) for o in rooms.openings)
    return replace(
        here,
        ids=tuple(i for i, _ in pairs),
        footprints=tuple(f for _, f in pairs),
        openings=tuple(sorted(openings, key=lambda o: (o.rooms, o.position_xy))),
    )


def _thinned(points: NDArray[np.float32], normals: NDArray[np.float32]) -> WallPoints:
    """Every n-th wall point, so that a large building costs no more than a small one."""
    stride = max(-(-len(points) // _MAX_WALL_POINTS), 1)
    return points[::stride], normals[::stride]
