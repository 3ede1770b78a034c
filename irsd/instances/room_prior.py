"""The room prior of fusion: in which rooms points lie, and which masks may meet which instances."""

from __future__ import annotations

import numpy as np

from irsd.core.types import Rooms
from irsd.instances.associate import rooms_of_masks
from irsd.instances.voxels import Floats, Ints, Rows


def room_votes(rooms: Rooms | None, points_map: Floats) -> tuple[Ints, Ints]:
    """(room ids ascending, points in each) of points [n, 3] in plan view; 0 = outside of all rooms."""
    if rooms is None or not len(points_map):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    cells = rooms.frame.cells_of(points_map)
    inside = rooms.frame.inside(cells)
    label = np.zeros(len(points_map), np.int64)
    label[inside] = rooms.labels[cells[inside, 0], cells[inside, 1]]
    ids, counts = np.unique(label, return_counts=True)
    return np.asarray(ids, np.int64), np.asarray(counts, np.int64)


def room_of(rooms: Rooms | None, points_map: Floats) -> int:
    """The room that holds most of those points [n, 3] that lie in any; 0 = none, the lower id among equals."""
    ids, counts = room_votes(rooms, points_map)
    counts, ids = counts[ids > 0], ids[ids > 0]
    return int(ids[counts.argmax()]) if len(counts) else 0


def rooms_of_all(rooms: Rooms | None, points_map: Floats, offset: Ints, cross_share: float) -> Rows:
    """Rooms int32 [m, 4] that masks may meet instances of, 0 = filler; a mask without any meets everything.

    points_map: float32 [N, 3], those of mask k at offset[k]:offset[k + 1]. A mask with at least cross_share of its points in a
    second room crosses the border and meets the instances of both.
    """
    if rooms is None:
        return np.zeros((len(offset) - 1, 4), np.int32)
    x0, y0 = rooms.frame.origin_xy_m
    return np.asarray(
        rooms_of_masks(rooms.labels, x0, y0, 1.0 / rooms.frame.resolution_m, points_map, offset, cross_share)
    )
