"""An instance of a stored map back in the memory: all that is known of it is its state."""

from __future__ import annotations

import numpy as np

from irsd.core.types import InstanceState
from irsd.instances.associate import add_meanings
from irsd.instances.record import Instance, Names
from irsd.instances.roster import Roster
from irsd.instances.voxel_memory import VoxelMemory
from irsd.instances.voxels import FULL, MOST, add_evidence, voxel_keys


def restored(state: InstanceState, names: Names, voxels: VoxelMemory, roster: Roster, view: int) -> Instance:
    """Enter an instance under its id; its voxels carry as much evidence as it had pictures. view: the last picture's number."""
    instance = roster.create(state.first_seen_ns, state.room, state.id)
    instance.last_seen_ns, instance.last_view, instance.published = state.last_seen_ns, view, True
    instance.moved = state.state == "moved"
    slot = np.array([instance.slot], np.int32)
    for name, share in state.labels:
        instance.add_label(name, names.group(name), share * state.observations)
    if state.embedding is not None:
        meanings, dims = roster.meanings([state.embedding * np.float32(state.observations)])
        add_meanings(roster.things, slot, meanings, dims)
    things = roster.things
    things.observations[slot] = state.observations
    things.expected[slot] = state.observations / max(state.existence, 1e-3)
    keys, first = np.unique(voxel_keys(state.points_map, voxels.per_m), return_index=True)
    rows = voxels.insert(keys)
    cells = voxels.cells
    cells.point[rows], cells.mass[rows] = state.points_map[first], min(state.observations, 255)
    offset, full = np.array([0, len(rows)], np.int64), np.full(len(rows), FULL, np.uint8)
    add_evidence(cells, voxels.counts, rows, full, offset, slot, rows[:0], things.observations, 0.0)
    mine = cells.owner[rows] == instance.slot
    count = min(max(state.observations, 1) * FULL, MOST)
    cells.hits[rows] = np.where(mine, count, cells.hits[rows])
    cells.seen[rows] = np.where(mine, count, cells.seen[rows])
    cells.views[rows] = np.maximum(cells.views[rows], min(state.observations, MOST))
    instance.rows, instance.owned = [rows], rows
    things.level[slot], things.size[slot] = count, len(rows)
    return instance
