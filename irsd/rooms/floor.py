"""The rooms of one floor of the building: evidence in, rooms with stable ids out. Owner of the tracker and of the last result."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from irsd.core.types import Opening, PlanEvidence, RoomFootprint, Rooms
from irsd.rooms.outline import Footprints, WallPoints
from irsd.rooms.remembered import BLOCK, Remembered
from irsd.rooms.segment import labelling, openings_between
from irsd.rooms.settings import RoomSettings
from irsd.rooms.tracker import IdSource, RoomTracker
from irsd.rooms.walls import merge_levels

_STRIDE_M = 0.2  # steps of the path that is kept
_MAX_PATH = 5000
_PASSED_M = 0.3  # a path this near beside a door's ends still went through it


class FloorRooms:
    """Rooms of one growing floor plan."""

    def __init__(self, settings: RoomSettings, ids: IdSource) -> None:
        self._settings = settings
        self._tracker = RoomTracker(settings.track, ids)
        self._footprints = Footprints(settings.segment, settings.walls)
        self._evidence: PlanEvidence | None = None
        self._floors: tuple[tuple[float, float], ...] = ()  # (height, times seen) of every level
        self._ceilings: tuple[tuple[float, float], ...] = ()
        # An opening may be found long after the robot went through it.
        self._path: deque[tuple[float, float]] = deque(maxlen=_MAX_PATH)
        self._remembered = Remembered()
        self._openings: tuple[Opening, ...] = ()  # those seen in this run
        self.rooms: Rooms | None = None

    def restore(
        self, ids: Sequence[int], footprints: Sequence[RoomFootprint], openings: Sequence[Opening] = ()
    ) -> None:
        """Continue with the rooms of an earlier run; those that are not seen yet stay as they were."""
        self._tracker.restore(ids, footprints)
        self._remembered.restore(ids, footprints, openings)

    def changed(self, evidence: PlanEvidence) -> int:
        """Cells that differ from the evidence of the last update; one more when the height of floor or ceiling does."""
        if self._evidence is None:
            return int(evidence.known.sum())
        now, last = self._remembered.padded(cropped(evidence)), self._evidence
        if now.frame != last.frame:
            last = _on_frame(last, now)
        heights = (now.floor_z_m, now.ceiling_z_m) != (self._evidence.floor_z_m, self._evidence.ceiling_z_m)
        return int(((now.free != last.free) | (now.wall != last.wall)).sum()) + int(heights)

    def updating(
        self, evidence: PlanEvidence, walls: WallPoints | None, path_xy: NDArray[np.float64]
    ) -> Generator[None, None, Rooms]:
        """Rooms of the floor as the evidence shows it, in steps of bounded length. path_xy: float64 [P, 2], where the robot went
        since the last update."""
        evidence = self._remembered.padded(cropped(evidence))
        before = self._openings
        labels, openings = yield from labelling(evidence, self._settings.segment, before)
        yield
        tracked = self._tracker.update(labels, evidence.frame)
        heights = self._levels(evidence)
        labels, unseen = self._remembered.fill(tracked.labels, evidence)
        seen = np.where(np.isin(labels, list(unseen)), 0, labels).astype(np.int32) if unseen else labels
        ids, footprints = self._footprints.draw(seen, evidence.frame, heights, walls)
        places = {i: replace(f, floor=evidence.floor) for i, f in zip(ids, footprints, strict=True)}
        places |= {i: self._remembered.footprint(i) for i in unseen}
        places = {i: places[i] for i in sorted(places)}
        self._openings = openings_between(labels, evidence.frame, (*_remembering(openings, before), *before))
        found = (*self._openings, *self._remembered.openings(evidence, tuple(places), self._openings))
        self._evidence = evidence
        self.rooms = Rooms(evidence.frame, labels, tuple(places), tuple(places.values()), found, tracked.lineage)
        self._walked(path_xy)
        return self.rooms

    def _walked(self, path_xy: NDArray[np.float64]) -> None:
        """Mark the openings that the path goes through; path_xy [P, 2] continues it."""
        for x, y in path_xy.tolist():
            if not self._path or abs(x - self._path[-1][0]) + abs(y - self._path[-1][1]) >= _STRIDE_M:
                self._path.append((x, y))
        if self.rooms is None or len(self._path) < 2:
            return
        path_xy = np.array(self._path)
        marked = tuple(
            o if o.traversed or not _goes_through(path_xy, o.segment_xy) else replace(o, traversed=True)
            for o in self.rooms.openings
        )
        if any(a is not b for a, b in zip(marked, self.rooms.openings, strict=True)):
            self.rooms = replace(self.rooms, openings=marked)
            self._openings = marked[: len(self._openings)]

    def _levels(self, evidence: PlanEvidence) -> tuple[float, float | None]:
        """Heights of the floor and ceiling that the evidence means: of all seen so far, those within tau_3 are one level."""
        tau = self._settings.walls.tau_3_m
        self._floors, floor_z_m = _merged(self._floors, evidence.floor_z_m, tau)
        if evidence.ceiling_z_m is None:
            return floor_z_m, None
        self._ceilings, ceiling_z_m = _merged(self._ceilings, evidence.ceiling_z_m, tau)
        return floor_z_m, ceiling_z_m


def _remembering(openings: Sequence[Opening], before: Sequence[Opening]) -> list[Opening]:
    """The openings, those at the place of one that was traversed earlier marked as traversed."""
    passed = np.array([o.position_xy for o in before if o.traversed]).reshape(-1, 2)
    return [
        replace(
            o, traversed=bool((np.linalg.norm(passed - o.position_xy, axis=1) <= max(o.width_m / 2, _PASSED_M)).any())
        )
        for o in openings
    ]


def cropped(evidence: PlanEvidence) -> PlanEvidence:
    """The part of the evidence where anything is known, in whole blocks of the map's cells."""
    rows, columns = np.flatnonzero(evidence.known.any(1)), np.flatnonzero(evidence.known.any(0))
    if not len(rows):
        return evidence
    frame, edge = evidence.frame, evidence.frame.resolution_m
    column, row = np.rint(np.array(frame.origin_xy_m) / edge).astype(int).tolist()
    low = [((first + start) // BLOCK) * BLOCK - start for first, start in ((rows[0], row), (columns[0], column))]
    high = [-(-(last + 1 + start) // BLOCK) * BLOCK - start for last, start in ((rows[-1], row), (columns[-1], column))]
    top, left = max(low[0], 0), max(low[1], 0)
    bottom, right = min(high[0], frame.height), min(high[1], frame.width)
    if (top, left, bottom, right) == (0, 0, frame.height, frame.width):
        return evidence
    part = (slice(top, bottom), slice(left, right))
    origin = (frame.origin_xy_m[0] + left * edge, frame.origin_xy_m[1] + top * edge)
    layers = {name: getattr(evidence, name)[part] for name in ("wall", "free", "low", "known")}
    lintel = None if evidence.lintel is None else evidence.lintel[part]
    small = replace(frame, origin_xy_m=origin, height=int(bottom - top), width=int(right - left))
    return replace(evidence, frame=small, lintel=lintel, **layers)


def _on_frame(last: PlanEvidence, now: PlanEvidence) -> PlanEvidence:
    """Earlier evidence on the grid of now: what was outside was not known."""
    shift = np.rint((np.array(last.frame.origin_xy_m) - np.array(now.frame.origin_xy_m)) / now.frame.resolution_m)
    column, row = shift.astype(int).tolist()
    out = np.zeros((2, now.frame.height, now.frame.width), bool)
    top, left = max(row, 0), max(column, 0)
    bottom = min(row + last.frame.height, now.frame.height)
    right = min(column + last.frame.width, now.frame.width)
    if top < bottom and left < right:
        part = (slice(top - row, bottom - row), slice(left - column, right - column))
        out[0, top:bottom, left:right] = last.free[part]
        out[1, top:bottom, left:right] = last.wall[part]
    return replace(now, free=out[0], wall=out[1])


def _goes_through(path_xy: NDArray[np.float64], segment_xy: NDArray[np.float64]) -> bool:
    """Whether a path [P, 2] crosses a segment [2, 2]."""
    along = segment_xy[1] - segment_xy[0]
    size = float(np.linalg.norm(along))
    if size <= 0:
        return False
    along = along / size
    x = (path_xy - segment_xy[0]) @ along
    y = (path_xy - segment_xy[0]) @ np.array([-along[1], along[0]])
    crosses = (y[:-1] < 0) != (y[1:] < 0)
    if not crosses.any():
        return False
    share = (y[:-1] / np.where(crosses, y[:-1] - y[1:], 1.0))[crosses]
    at = x[:-1][crosses] + share * (x[1:] - x[:-1])[crosses]
    return bool(((at > -_PASSED_M) & (at < size + _PASSED_M)).any())


def _merged(
    levels: tuple[tuple[float, float], ...], height_m: float, tau_3_m: float
) -> tuple[tuple[tuple[float, float], ...], float]:
    """The levels (height, weight) with one more sighting, and the height of the level it belongs to."""
    heights = np.array([*(h for h, _ in levels), height_m])
    weights = np.array([*(w for _, w in levels), 1.0])
    merged = merge_levels(heights, weights, tau_3_m)
    found = {float(h): float(weights[merged == h].sum()) for h in merged}
    return tuple(sorted(found.items())), float(merged[-1])
