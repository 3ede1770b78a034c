"""The room prior of fusion: in which rooms points lie, and which masks may meet which instances."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irsd.core.types import Rooms
from irsd.instances.associate import Bools, Floats, Ints


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


def may_meet(rooms: Rooms | None, masks: Sequence[Floats], instance_rooms: Ints, cross_share: float) -> Bools:
    """[m, c] False where a mask and an instance lie in different rooms.

    masks: points [n, 3] each; instance_rooms: int64 [c], 0 = unknown, which meets everything. A mask with at least
    cross_share of its points in a second room crosses the border and meets the instances of both; one that lies in no room
    meets everything.
    """
    allowed = np.ones((len(masks), len(instance_rooms)), np.bool_)
    if rooms is None:
        return allowed
    for m, points in enumerate(masks):
        ids, counts = room_votes(rooms, points)
        mine = ids[(ids > 0) & (counts >= cross_share * len(points))]
        if len(mine):
            allowed[m] = (instance_rooms == 0) | np.isin(instance_rooms, mine)
    return allowed
