"""The owner of the voxel arrays: grows them, frees rows, and calls the kernels on them."""

from __future__ import annotations

import numpy as np

from irsd.instances.pack import Bytes, Opened, get, unpack_block
from irsd.instances.table import grown, new_index
from irsd.instances.voxels import (
    Cells,
    Floats,
    Ints,
    Rows,
    drop_rows,
    find_all,
    gather,
    new_cells,
    owners,
    sight,
    take_rows,
)

_LAST_STAMP = 1 << 30
_SHARE = 8  # rows per page, about; pages are added where that is not so


class VoxelMemory:
    """Voxel rows by key. Rows keep their number until they are freed."""

    def __init__(self, voxel_m: float, capacity: int = 1 << 18) -> None:
        self.per_m = 1.0 / voxel_m
        self.cells = new_cells(capacity, touch=True)
        self._index = new_index(max(capacity // _SHARE, 1), touch=True)
        self._free = np.zeros(capacity, np.int32)
        self.counts = np.zeros(3, np.int64)

    def __len__(self) -> int:
        return int(self.counts[0] - self.counts[1])

    def gather(self, points: Floats, offset: Ints) -> tuple[Rows, Ints]:
        """See ``voxels.gather``: the voxels of masks, new ones included."""
        self._reserve(len(points))
        if self.counts[2] > _LAST_STAMP:  # stamps begin anew
            self.cells.stamp[:] = self.counts[2] = 0
        return gather(self._index, self.cells, self.counts, self._free, points, offset, self.per_m)

    def sight(self, rows: Rows, points: Floats, view: int) -> Rows:
        """See ``voxels.sight``: all known voxels that a picture shows."""
        return sight(self._index, self.cells, rows, points, self.per_m, view)

    def owners(self, points: Floats) -> Rows:
        """See ``voxels.owners``: slots [K] of those that points lie in, -1 = nobody."""
        return owners(self._index, self.cells, points, self.per_m)

    def find(self, keys: Ints) -> Rows:
        """Rows [N] of keys [N], -1 where a voxel has none."""
        return find_all(self._index, keys)

    def insert(self, keys: Ints) -> Rows:
        """Rows [N] of unique keys [N]; those without one get one."""
        self._reserve(len(keys))
        rows = self.find(keys)
        take_rows(self._index, self.cells, self.counts, self._free, keys, rows)
        return rows

    def drop(self, rows: Rows) -> None:
        """Free rows: their keys are forgotten, their claims with them."""
        drop_rows(self._index, self.cells, self.counts, self._free, rows)

    def unpack(self, data: Bytes, slots: Rows, block: int, frame: int) -> Opened:
        """See ``pack.unpack_block``: rows again for the voxels of a packed block."""
        self._reserve(int(get(data, 0, 16)))
        return unpack_block(data, slots, block, self._index, self.cells, self.counts, self._free, frame, self.per_m)

    def _reserve(self, more: int) -> None:
        rows = int(self.counts[0]) + more  # as if nothing could be reused: no more than one growth too early
        if rows > len(self.cells.key):
            size = max(rows, 2 * len(self.cells.key))
            old, self.cells = self.cells, new_cells(size)
            for name in Cells._fields:
                getattr(self.cells, name)[: len(getattr(old, name))] = getattr(old, name)
            free, self._free = self._free, np.zeros(size, np.int32)
            self._free[: len(free)] = free
        pages = int(self._index.counts[0]) + more
        if pages > len(self._index.key):
            self._index = grown(self._index, max(pages, 2 * len(self._index.key)))
