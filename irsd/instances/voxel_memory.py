"""The owner of the voxel arrays: grows them, frees rows, and calls the kernels on them."""

from __future__ import annotations

import numpy as np

from irsd.instances.pack import Bytes, Opened, get, unpack_block
from irsd.instances.voxels import (
    Cells,
    Floats,
    Ints,
    Rows,
    drop_rows,
    find_all,
    gather,
    new_cells,
    new_table,
    owners,
    refill,
    sight,
    take_rows,
)

_LOAD = 2  # places of the table per row, at least
_LAST_STAMP = 1 << 30
_FEW = 0.05  # share of the rows from which on a new table is made when they go


class VoxelMemory:
    """Voxel rows by key. Rows keep their number until they are freed."""

    def __init__(self, voxel_m: float, capacity: int = 1 << 18) -> None:
        self.per_m = 1.0 / voxel_m
        self.cells = new_cells(capacity)
        self._table = new_table(_bits_for(capacity))
        self._free = np.zeros(capacity, np.int32)
        self.counts = np.zeros(3, np.int64)

    def __len__(self) -> int:
        return int(self.counts[0] - self.counts[1])

    def gather(self, points: Floats, offset: Ints) -> tuple[Rows, Ints]:
        """See ``voxels.gather``: the voxels of masks, new ones included."""
        self._reserve(len(points))
        if self.counts[2] > _LAST_STAMP:  # stamps begin anew
            self.cells.stamp[:] = self.counts[2] = 0
        return gather(self._table, self.cells, self.counts, self._free, points, offset, self.per_m)

    def sight(self, rows: Rows, points: Floats, view: int) -> Rows:
        """See ``voxels.sight``: all known voxels that a picture shows."""
        return sight(self._table, self.cells, rows, points, self.per_m, view)

    def owners(self, points: Floats) -> Rows:
        """See ``voxels.owners``: slots [K] of those that points lie in, -1 = nobody."""
        return owners(self._table, self.cells, points, self.per_m)

    def find(self, keys: Ints) -> Rows:
        """Rows [N] of keys [N], -1 where a voxel has none."""
        return find_all(self._table, self.cells.key, keys)

    def insert(self, keys: Ints) -> Rows:
        """Rows [N] of unique keys [N]; those without one get one."""
        self._reserve(len(keys))
        rows = self.find(keys)
        take_rows(self._table, self.cells, self.counts, self._free, keys, rows)
        return rows

    def drop(self, rows: Rows) -> None:
        """Free rows: their keys are forgotten, their claims with them."""
        few = len(rows) < _FEW * len(self)
        drop_rows(self._table if few else self._table[:0], self.cells, self.counts, self._free, rows)
        if not few:  # cheaper than closing so many gaps
            self._table[:] = 0
            refill(self._table, self.cells.key[: self.counts[0]])

    def unpack(self, data: Bytes, slots: Rows, block: int, frame: int) -> Opened:
        """See ``pack.unpack_block``: rows again for the voxels of a packed block."""
        self._reserve(int(get(data, 0, 16)))
        return unpack_block(data, slots, block, self._table, self.cells, self.counts, self._free, frame, self.per_m)

    def _reserve(self, more: int) -> None:
        rows = int(self.counts[0]) + more  # as if nothing could be reused: no more than one growth too early
        if rows > len(self.cells.key):
            size = max(rows, 2 * len(self.cells.key))
            old, self.cells = self.cells, new_cells(size)
            for name in Cells._fields:
                getattr(self.cells, name)[: len(getattr(old, name))] = getattr(old, name)
            free, self._free = self._free, np.zeros(size, np.int32)
            self._free[: len(free)] = free
        if _LOAD * rows > len(self._table):
            self._table = new_table(_bits_for(rows))
            refill(self._table, self.cells.key)


def _bits_for(rows: int) -> int:
    return max(int(np.ceil(np.log2(1.5 * _LOAD * rows))), 8)
