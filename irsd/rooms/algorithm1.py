"""Algorithm 1 of the IRS paper as published: wall segments around the robot joined to rooms, one axis-aligned box per room.

Of the block of side N around the robot come wall segments, doors and windows counting as wall. A segment that overlaps a wall of
a room (c1 > tau_1) and faces the same way (c2 >= tau_2) is added to that room; segments that fit no room are the boundary of a
new one. A room is the box of its walls. Kept for comparison: boxes overlap, and a wall seen from two sides joins two rooms.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.core.types import Opening, PlanEvidence, RoomFootprint, Rooms, RoomSegmentation
from irsd.rooms.outline import WallPoints
from irsd.rooms.settings import RoomSettings
from irsd.rooms.tracker import IdSource
from irsd.rooms.walls import Walls, WallSettings, find_walls, same_wall

FloatArray = NDArray[np.float64]
_NONE = Walls(np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)), np.zeros(0, np.int64))


@dataclass(slots=True)
class _Box:
    """A registered room: its walls and the box around their ends (xmin, ymin, xmax, ymax)."""

    id: int
    walls: Walls
    box: FloatArray

    def add(self, walls: Walls) -> None:
        """Take up wall segments and grow to hold them."""
        self.walls = _joined([self.walls, walls])
        ends = walls.ends().reshape(-1, 2)
        self.box = np.concatenate([np.minimum(self.box[:2], ends.min(0)), np.maximum(self.box[2:], ends.max(0))])

    @property
    def area_m2(self) -> float:
        return float(np.prod(self.box[2:] - self.box[:2]))


class BoxRooms:
    """The set of registered rooms of one floor, by Algorithm 1. Same calls as ``FloorRooms``."""

    def __init__(self, settings: RoomSettings, ids: IdSource) -> None:
        self._settings, self._ids = settings, ids
        self._boxes: list[_Box] = []
        self._known = -1
        self.rooms: Rooms | None = None

    def restore(
        self, ids: Sequence[int], footprints: Sequence[RoomFootprint], openings: Sequence[Opening] = ()
    ) -> None:
        """Continue with the boxes of an earlier run. openings are no affair of the algorithm."""
        self._boxes += [_Box(i, _NONE, np.array(f.aabb_xy)) for i, f in zip(ids, footprints, strict=True)]

    def changed(self, evidence: PlanEvidence) -> int:
        """Cells known now and not at the last update."""
        return abs(int(evidence.known.sum()) - self._known)

    def updating(
        self, evidence: PlanEvidence, walls: WallPoints | None, path_xy: FloatArray
    ) -> Generator[None, None, Rooms]:
        """Rooms after a look at the walls around the robot, the last point of path_xy [P, 2]. One step."""
        yield from ()
        return self.look(evidence, walls, path_xy)

    def look(self, evidence: PlanEvidence, walls: WallPoints | None, path_xy: FloatArray) -> Rooms:
        """``updating`` at once."""
        self._known = int(evidence.known.sum())
        lineage: tuple[str, ...] = ()
        if walls is not None and len(path_xy):
            lineage = self._look(walls, path_xy[-1])
        heights = (evidence.floor_z_m, evidence.ceiling_z_m)
        ids, footprints, labels = self._drawn(evidence.frame, heights, evidence.floor)
        self.rooms = Rooms(evidence.frame, labels, ids, footprints, (), lineage)
        return self.rooms

    def _look(self, walls: WallPoints, robot_xy: FloatArray) -> tuple[str, ...]:
        """One turn of the algorithm's loop with the block of points around the robot."""
        settings = self._settings.walls
        points, normals = walls
        near = (np.abs(points[:, :2] - robot_xy) <= settings.block_m / 2).all(1)
        segments = find_walls(points[near], normals[near], settings)
        fresh = np.ones(len(segments), bool)
        for room in self._boxes:
            mine = _touching(segments, room.walls, settings) & fresh
            if mine.any():
                room.add(segments.take(mine))
                fresh &= ~mine
        if not fresh.any():
            return ()
        new = segments.take(fresh)
        ends = new.ends().reshape(-1, 2)
        self._boxes.append(_Box(self._ids.take(), new, np.concatenate([ends.min(0), ends.max(0)])))
        return (f"R{self._boxes[-1].id} found",)

    def _drawn(
        self, frame: GridFrame, heights: tuple[float, float | None], floor: int
    ) -> tuple[tuple[int, ...], tuple[RoomFootprint, ...], NDArray[np.int32]]:
        """Ids, footprints and labels of the boxes that are large enough for rooms; a smaller box lies on top of a larger one."""
        kept = [b for b in self._boxes if b.area_m2 >= self._settings.segment.min_room_m2]
        labels = np.zeros((frame.height, frame.width), np.int32)
        for room in sorted(kept, key=lambda b: (-b.area_m2, b.id)):
            cells = np.clip(frame.cells_of(room.box.reshape(2, 2)), 0, [frame.height, frame.width])
            labels[cells[0, 0] : cells[1, 0], cells[0, 1] : cells[1, 1]] = room.id
        footprints = []
        for room in kept:
            x0, y0, x1, y1 = room.box.tolist()
            corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
            footprints.append(RoomFootprint(corners, (x0, y0, x1, y1), room.area_m2, heights[0], heights[1], floor))
        return tuple(b.id for b in kept), tuple(footprints), labels


def box_map(free: NDArray[np.bool_], resolution_m: float, settings: RoomSettings) -> RoomSegmentation:
    """Algorithm 1 on a 2D map (free: bool [H, W]): its walls are the edges of free space, and the robot visits the middle of
    every wide place, nearest first."""
    frame = GridFrame((0.0, 0.0), resolution_m, *free.shape)
    known = np.ones_like(free)
    evidence = PlanEvidence(frame, ~free, free, ~free, known, 0.0, None)
    rooms = BoxRooms(settings, IdSource())
    walls = _edges(free, resolution_m)
    found = rooms.look(evidence, None, np.zeros((0, 2)))
    for place in _places(free, resolution_m):
        found = rooms.look(evidence, walls, place[None])
    numbers = np.zeros(max(found.ids, default=0) + 1, np.int32)
    numbers[list(found.ids)] = np.arange(1, len(found.ids) + 1)
    labels = np.where(free, numbers[found.labels], 0).astype(np.int32)
    return RoomSegmentation(frame, labels, found.footprints, ())


def _edges(free: NDArray[np.bool_], resolution_m: float) -> WallPoints:
    """Points on the rim of free space and the directions from there into it."""
    smooth = cv2.GaussianBlur(free.astype(np.float32), (5, 5), 1.0)
    inward = np.stack([cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)], axis=-1)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    rim = free & (cv2.erode(free.astype(np.uint8), cross, borderType=cv2.BORDER_CONSTANT, borderValue=0) == 0)
    size = np.linalg.norm(inward, axis=-1)
    rows, columns = np.nonzero(rim & (size > 1e-3))
    normals = np.zeros((len(rows), 3), np.float32)
    normals[:, :2] = inward[rows, columns] / size[rows, columns, None]
    points = np.stack([(columns + 0.5) * resolution_m, (rows + 0.5) * resolution_m, np.ones(len(rows))], axis=1)
    return points.astype(np.float32), normals


def _places(free: NDArray[np.bool_], resolution_m: float) -> FloatArray:
    """The middles of wide places, float64 [P, 2], each next to be visited the nearest to the one before."""
    dist = cv2.distanceTransform(np.pad(free, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    widest = cv2.dilate(dist, np.ones((2 * round(1.0 / resolution_m) + 1,) * 2, np.uint8))
    rows, columns = np.nonzero((dist >= widest) & (dist * resolution_m > 0.4))
    left = (np.stack([columns, rows], axis=1) + 0.5) * resolution_m
    order = np.zeros((0, 2))
    while len(left):
        here = left[0] if not len(order) else order[-1]
        nearest = int(np.linalg.norm(left - here, axis=1).argmin())
        order = np.concatenate([order, left[nearest : nearest + 1]])
        left = left[np.linalg.norm(left - order[-1], axis=1) > 1.0]
    return order


def _touching(segments: Walls, walls: Walls, settings: WallSettings) -> NDArray[np.bool_]:
    """[N] True for segments that are one wall with any of ``walls``."""
    if not len(segments) or not len(walls):
        return np.zeros(len(segments), bool)
    pairs = same_wall(_joined([segments, walls]), settings)
    low, high = pairs.min(1), pairs.max(1)
    touching = np.zeros(len(segments), bool)
    touching[low[(low < len(segments)) & (high >= len(segments))]] = True
    return touching


def _joined(parts: Sequence[Walls]) -> Walls:
    return Walls(*(np.concatenate([getattr(p, n) for p in parts]) for n in ("normal", "offset", "span", "count")))
