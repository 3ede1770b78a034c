"""The footprint of rooms in a label grid: outlines as polygons in map coordinates, drawn up to the wall planes around them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects

from irsd.core.grid import GridFrame
from irsd.core.types import RoomFootprint
from irsd.rooms.settings import SegmentSettings
from irsd.rooms.walls import WallSettings, find_walls, polygon_area, snapped

Labels = NDArray[np.int32]
WallPoints = tuple[NDArray[np.float32], NDArray[np.float32]]
_MAX_POINTS = 3000  # around one room
_REFRESHED = 2  # rooms per call whose cells are as before, drawn again because more is known of their walls
Box = tuple[slice, slice]


@dataclass(frozen=True, slots=True)
class _Drawn:
    """One room as it was drawn last. corner: (row, column) of its mask's first cell, counted from the map's origin."""

    mask: NDArray[np.bool_]
    corner: tuple[int, int]
    wall_count: int
    polygon_xy: NDArray[np.float64]
    area_m2: float


class Footprints:
    """Draws rooms, and draws again only those whose cells have changed."""

    def __init__(self, settings: SegmentSettings, walls: WallSettings | None = None) -> None:
        self._settings, self._walls = settings, walls
        self._drawn: dict[int, _Drawn] = {}

    def draw(
        self,
        labels: Labels,
        frame: GridFrame,
        heights: tuple[float, float | None],
        walls: WallPoints | None = None,
    ) -> tuple[tuple[int, ...], tuple[RoomFootprint, ...]]:
        """The numbers that occur in labels [H, W], ascending, and the footprint of each: the largest part of its cells, drawn out
        to the walls around it. heights: floor and ceiling z. walls: points [W, 3] of walls and their normals."""
        if not labels.any():
            self._drawn = {}
            return (), ()
        grown = filled(labels, np.ones(labels.shape, bool), self._settings.wall_reach_m / frame.resolution_m)
        start = np.rint(np.array(frame.origin_xy_m)[::-1] / frame.resolution_m).astype(int)
        drawn, refreshed = {}, 0
        for number, box in enumerate(find_objects(grown), 1):
            if box is None:
                continue
            mask = grown[box] == number
            corner = (int(start[0]) + box[0].start, int(start[1]) + box[1].start)
            near = None if walls is None else _near(walls, box, frame, 2 * (self._walls or WallSettings()).snap_m)
            count = 0 if near is None else len(near[0])
            last = self._drawn.get(number)
            if last is not None and last.corner == corner and np.array_equal(last.mask, mask):
                # Walls are seen better all the time, but few points more do not move an outline.
                again = count > 1.5 * last.wall_count and refreshed < _REFRESHED
                if not again:
                    drawn[number] = last
                    continue
                refreshed += 1
            polygon = outline(mask, (box[0].start, box[1].start), frame, self._settings.simplify_m / 2)
            area_m2 = float(mask.sum()) * frame.resolution_m**2
            if near is not None and self._walls is not None and count:
                polygon = snapped(polygon, find_walls(*near, self._walls), self._walls.snap_m)
                area_m2 = polygon_area(polygon)
            drawn[number] = _Drawn(mask, corner, count, polygon, area_m2)
        self._drawn = drawn
        return tuple(drawn), tuple(_footprint(room, heights) for room in drawn.values())


def _footprint(room: _Drawn, heights: tuple[float, float | None]) -> RoomFootprint:
    low, high = room.polygon_xy.min(0), room.polygon_xy.max(0)
    box = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    return RoomFootprint(room.polygon_xy, box, room.area_m2, heights[0], heights[1])


def _near(walls: WallPoints, box: Box, frame: GridFrame, reach_m: float) -> WallPoints:
    """The wall points around a box of cells."""
    points, normals = walls
    origin, edge = np.array(frame.origin_xy_m), frame.resolution_m
    low = origin + np.array([box[1].start, box[0].start]) * edge - reach_m
    high = origin + np.array([box[1].stop, box[0].stop]) * edge + reach_m
    x, y = points[:, 0], points[:, 1]
    inside = np.flatnonzero((x > low[0]) & (y > low[1]) & (x < high[0]) & (y < high[1]))
    inside = inside[:: max(-(-len(inside) // _MAX_POINTS), 1)]
    return points[inside], normals[inside]


def filled(labels: Labels, space: NDArray[np.bool_], reach: float) -> Labels:
    """Labels with the unlabelled cells of space within ``reach`` cells given to the nearest room."""
    if not labels.any() or reach <= 0:
        return labels
    unlabelled = (labels == 0).astype(np.uint8)
    gap, nearest = cv2.distanceTransformWithLabels(
        unlabelled, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    lookup = np.zeros(int(nearest.max()) + 1, np.int32)
    seed = unlabelled == 0
    lookup[nearest[seed]] = labels[seed]
    near = space & (gap <= reach) & (labels == 0)
    out = labels.copy()
    out[near] = lookup[nearest[near]]
    return out


def outline(
    mask: NDArray[np.bool_], first: tuple[int, int], frame: GridFrame, tolerance_m: float
) -> NDArray[np.float64]:
    """Polygon [K, 2] metres, counter-clockwise, not closed, around the largest part of a mask whose cell (0, 0) is cell ``first``
    of the frame. It runs along the outer edges of the cells, simplified by at most ``tolerance_m``. ValueError for an empty mask."""
    if not mask.any():
        raise ValueError("an empty mask has no outline")
    # Twice the resolution, so that the outline of cell centres lies a quarter of a cell from the cells' edges.
    fine = np.repeat(np.repeat(mask.astype(np.uint8), 2, axis=0), 2, axis=1)
    contours, _ = cv2.findContours(fine, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest = max(contours, key=cv2.contourArea)
    points = largest[:, 0].astype(np.float64)
    if len(points) >= 3:
        simple = cv2.approxPolyDP(largest, 2 * tolerance_m / frame.resolution_m, True)[:, 0].astype(np.float64)
        points = simple if len(simple) >= 3 else points
    if len(points) < 3:
        low, high = points.min(0), points.max(0)
        points = np.array([low, [high[0] + 1, low[1]], high + 1, [low[0], high[1] + 1]])
    cells = (points + 0.5) / 2 + [first[1], first[0]]
    polygon = cells * frame.resolution_m + np.array(frame.origin_xy_m)
    following = np.roll(polygon, -1, axis=0)
    turn = polygon[:, 0] * following[:, 1] - following[:, 0] * polygon[:, 1]
    return np.ascontiguousarray(polygon if turn.sum() > 0 else polygon[::-1])
