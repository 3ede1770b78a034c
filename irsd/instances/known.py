"""Which instances own the points that a camera sees: the memory's side of seeing only what is new."""

from __future__ import annotations

import numpy as np

from irsd.core.types import KnownThings
from irsd.instances.roster import Roster
from irsd.instances.voxel_memory import VoxelMemory
from irsd.instances.voxels import Floats


def known_things(voxels: VoxelMemory, roster: Roster, points: Floats, dimension: int) -> KnownThings:
    """The instances of points float32 [K, 3], with their embeddings where these have ``dimension``."""
    slot_of = voxels.owners(points)
    slots, row_of = np.unique(slot_of, return_inverse=True)
    if len(slots) and slots[0] < 0:
        slots, row_of = slots[1:], row_of - 1
    things = roster.things
    embedding = np.zeros((len(slots), dimension), np.float32)
    same = things.dim[slots] == dimension
    for k in np.flatnonzero(same).tolist():
        direction = roster.direction(int(slots[k]))
        if direction is not None:
            embedding[k] = direction
    return KnownThings(
        row_of.astype(np.int32),
        things.id[slots],
        embedding,
        np.where(same, things.matches[slots] + 1, 0).astype(np.int32),
        things.observations[slots],
        np.array([roster.by_slot[s].last_seen_ns for s in slots.tolist()], np.int64),
    )
