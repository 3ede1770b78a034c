"""Where the voxels of what nobody looks at are kept, packed, until somebody looks there again.

Space is packed, not things: a block of voxels goes to rest when no picture showed it and nobody who claims any of it was seen for
long. A thing of which all blocks rest gives its slot back; the blocks that hold its voxels are noted with it. Whatever a picture shows
is unpacked before it is looked at, so that no answer depends on what was at rest.
"""

from __future__ import annotations

import numpy as np

from irsd.instances.blocks import find_resting, held, note_owned, resting_blocks
from irsd.instances.pack import pack_all, read_palette
from irsd.instances.record import NO_ROWS, Instance
from irsd.instances.roster import Roster
from irsd.instances.settle import Limits
from irsd.instances.table import EMPTY, drop_key, enter_key, find_key, new_table
from irsd.instances.voxel_memory import VoxelMemory
from irsd.instances.voxels import Floats

_OUTLINE = 12  # points that stand for a thing while not all of its voxels are there
_PASSES = 4  # per time of rest


class Attic:
    """Owner of the packed blocks; takes voxels out of the memory and gives them back, with their rows in the instances."""

    def __init__(self, voxels: VoxelMemory, roster: Roster, rest_views: int) -> None:
        """rest_views: pictures without a look after which a block goes to rest."""
        self._voxels, self._roster, self._rest = voxels, roster, rest_views
        self._data: list[bytes] = []  # empty: a free place
        self._blocks = np.full(256, EMPTY, np.int64)  # by place in _data
        self._table = new_table(10)
        self._free: list[int] = []
        self._due = rest_views

    def __len__(self) -> int:
        """Blocks at rest."""
        return len(self._data) - len(self._free)

    @property
    def size_bytes(self) -> int:
        """What the packed blocks hold."""
        return sum(map(len, self._data))

    # ------------------------------------------------------------------------------------------------ waking
    def show(self, points: Floats, view: int) -> None:
        """Somebody looks at points float32 [N, 3] in picture number ``view``."""
        if len(self):
            for place in find_resting(self._table, self._blocks, points, self._voxels.per_m).tolist():
                self._open(place, view)

    def wake(self, instance: Instance, view: int) -> None:
        """All voxels of an instance are wanted."""
        for block in list(instance.blocks):
            self._open(find_key(self._table, self._blocks, block), view)
        self._roster.recall(instance)

    def _open(self, place: int, view: int) -> None:
        data, block = self._data[place], int(self._blocks[place])
        drop_key(self._table, self._blocks, block)
        self._data[place], self._blocks[place] = b"", EMPTY
        self._free.append(place)
        instances = [self._roster.by_id[number] for number in read_palette(data)]
        for instance in instances:
            self._roster.recall(instance)
        slots = np.array([instance.slot for instance in instances], np.int32)
        opened = self._voxels.unpack(np.frombuffer(data, np.uint8), slots, block, view - 1)
        for instance in instances:
            claimed = opened.slots == instance.slot
            instance.rows.append(opened.rows[claimed.any(1)])
            instance.owned = np.concatenate([instance.owned, opened.rows[(claimed & opened.owned).any(1)]])
            instance.blocks.remove(block)
            if not instance.blocks:
                instance.outline = None

    # ------------------------------------------------------------------------------------------------ going to rest
    def tidy(self, limits: Limits, view: int) -> None:
        """Put to rest what was not looked at for long, now and then. limits: which claims are worth keeping."""
        if view >= self._due:
            self._due = view + max(self._rest // _PASSES, 1)
            self.put_away(limits, view - self._rest)

    def put_away(self, limits: Limits, since: int) -> None:
        """Put to rest what was not looked at in the pictures from number ``since`` on."""
        voxels, cells, things = self._voxels, self._voxels.cells, self._roster.things
        count = int(voxels.counts[0])
        blocks, rows, offset = resting_blocks(cells, count, things.used, since)
        if not len(blocks):
            return
        slots = np.unique(cells.owner[rows])
        sleepers = [self._roster.by_slot[slot] for slot in slots[slots >= 0].tolist()]
        owned = np.zeros(count, np.uint8)
        for instance in sleepers:
            if instance.outline is None and len(instance.owned):
                step = -(-len(instance.owned) // _OUTLINE)
                instance.outline, instance.boxed = cells.point[instance.owned[::step]], None
            note_owned(cells, owned, instance.owned, instance.slot)
        data, ends = pack_all(cells, things.level, things.id, rows, offset, owned, limits, voxels.per_m)
        for k, block in enumerate(blocks.tolist()):
            if ends[k + 1] > ends[k]:
                self._keep(block, data[ends[k] : ends[k + 1]].tobytes())
        voxels.drop(rows)
        for instance in sleepers:
            self._let_go(instance)

    def _keep(self, block: int, data: bytes) -> None:
        if not self._free:
            self._free.append(len(self._data))
            self._data.append(b"")
            if len(self._data) > len(self._blocks):
                self._grow()
        place = self._free.pop()
        self._data[place], self._blocks[place] = data, block
        enter_key(self._table, block, place)
        for number in read_palette(data):
            self._roster.by_id[number].blocks.append(block)

    def _grow(self) -> None:
        self._blocks = np.concatenate([self._blocks, np.full_like(self._blocks, EMPTY)])
        self._table = new_table(int(np.log2(len(self._table))) + 1)
        for place in np.flatnonzero(self._blocks).tolist():
            enter_key(self._table, int(self._blocks[place]), place)

    def _let_go(self, instance: Instance) -> None:
        """Forget the rows that an instance has no more, and its slot with the last of them."""
        cells = self._voxels.cells
        instance.rows, instance.ascending = [held(cells, np.concatenate(instance.rows), instance.slot)], 0
        instance.owned = held(cells, instance.owned, instance.slot)
        if not len(instance.rows[0]):
            instance.rows, instance.owned = [], NO_ROWS
            self._roster.retire(instance)
