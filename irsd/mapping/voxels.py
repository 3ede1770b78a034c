"""The voxel map: running means of points in sparse blocks, with normals from moments of coarse cells.

Storage: a hash table from packed block key to slot; ``index[slot, 512]`` gives the compact row of a voxel; rows hold the mean
point, hits, structure label and the stamps first and last seen. Every 2x2x2 voxels form a coarse cell that keeps ten moments of its
points and a normal fitted over its 3x3x3 neighbours. All arrays have their final size from the start: the system provides
the memory of a page when it is first written, so a small map is small and a growing one is never copied. A scan costs one sort
of its points and work on its own voxels; beyond ``max_voxels`` the blocks farthest from the robot are forgotten, and counted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.core.settings import setting
from irsd.mapping import kernels
from irsd.mapping.registration import Planes

_EVICT_BLOCKS = 256  # blocks counted at a time: work follows what is forgotten, not the map
_EVICT_SHARE = 0.05  # of the bound, freed at once: an eviction pass looks at every block, so it must be rare


@dataclass(frozen=True)
class VoxelSettings:
    """Settings of the voxel map."""

    voxel_m: float = setting(0.04, "edge of a voxel", lo=0.01, hi=0.5)
    max_voxels: int = setting(3_000_000, "voxels kept; beyond, the farthest are forgotten", lo=1000, hi=50_000_000)
    memory_hits: int = setting(
        64, "points after which a voxel's mean follows new points like a filter", lo=1, hi=10_000
    )


@dataclass(frozen=True, slots=True)
class Touched:
    """What one scan touched: rows int32 [M], each once, sorted by voxel key; row_of_point int32 [N], -1 = refused."""

    rows: NDArray[np.int32]
    row_of_point: NDArray[np.int32]


class _Numbers:
    """Hands out the numbers 0, 1, 2...; those that were given back first."""

    def __init__(self) -> None:
        self.end = 0
        self._free = np.zeros(0, np.int32)

    @property
    def used(self) -> int:
        return self.end - len(self._free)

    def take(self, count: int) -> NDArray[np.int32]:
        reused, self._free = self._free[:count], self._free[count:]
        fresh = np.arange(self.end, self.end + count - len(reused), dtype=np.int32)
        self.end += len(fresh)
        return np.concatenate([reused, fresh])

    def give_back(self, numbers: NDArray[np.int32]) -> None:
        self._free = np.concatenate([self._free, numbers])


class VoxelMap:
    """Single writer of the voxels. Rows of one voxel stay valid until it is evicted; then they may be reused."""

    def __init__(self, settings: VoxelSettings) -> None:
        self.settings = settings
        self._rows, self._slots = _Numbers(), _Numbers()
        self.evicted = 0
        self.refused = 0
        # By row: mean point (metres), points so far (bounded by memory_hits), label, stamps of last and first scan, coarse cell.
        rows = settings.max_voxels
        self.mean = np.zeros((rows, 3), np.float32)
        self.hits = np.zeros(rows, np.float32)
        self.structure = np.zeros(rows, np.uint8)
        self.seen_ns = np.zeros(rows, np.int64)
        self.made_ns = np.zeros(rows, np.int64)
        self.coarse = np.zeros(rows, np.int32)
        # By slot: the block's packed key (0 = none), the slots + 1 of the 27 blocks around, the row + 1 of each voxel.
        self._max_blocks = blocks = max(settings.max_voxels // 40, 512)
        self.blocks = np.zeros(blocks, np.int64)
        self.neighbours = np.zeros((blocks, 27), np.int32)
        self.index = np.zeros((blocks, kernels.BLOCK_VOXELS), np.int32)
        self._table = np.zeros(1 << (2 * blocks - 1).bit_length(), np.int32)
        # By coarse cell (slot * 64 + place): moments, normal (zero = unknown), the fitted patch's centroid, scans that hit.
        cells = blocks * kernels.BLOCK_COARSE
        self.moments = np.zeros((cells, 10), np.float32)
        self.normal = np.zeros((cells, 3), np.float32)
        self.surface = np.zeros((cells, 3), np.float32)
        self.touches = np.zeros(cells, np.int32)

    # ------------------------------------------------------------------------------------------------ reading
    def __len__(self) -> int:
        return self._rows.used

    @property
    def row_count(self) -> int:
        """Valid row numbers are below this; those without hits are free."""
        return self._rows.end

    @property
    def slot_count(self) -> int:
        """Valid slots are below this; those whose block is 0 are free."""
        return self._slots.end

    @property
    def planes(self) -> Planes:
        """The surface of coarse cells, to lay scans on; a view, not a copy."""
        return Planes(self._table, self.blocks, self.normal, self.surface, 2 * self.settings.voxel_m)

    def live_rows(self) -> NDArray[np.int64]:
        """Row numbers in use, ascending. Costs a pass over the map."""
        return np.flatnonzero(self.hits[: self.row_count] > 0)

    def rows_at(self, points: NDArray[np.float32]) -> NDArray[np.int32]:
        """Row [N] of the voxel that holds each point [N, 3], -1 where there is none."""
        return self._find(kernels.pack_points(points, self.settings.voxel_m))[1]

    def rows_within(self, low: NDArray[np.float32], high: NDArray[np.float32]) -> NDArray[np.int32]:
        """Rows of the voxels whose points lie in a box from low [3] to high [3]. Costs a pass over the blocks."""
        edge = kernels.BLOCK_EDGE * self.settings.voxel_m
        slots = np.flatnonzero(self.blocks[: self.slot_count])
        corner = kernels.unpack_blocks(self.blocks[slots]) * edge
        slots = slots[((corner <= high) & (corner + edge >= low)).all(-1)]
        entries = self.index[slots]
        rows = entries[entries > 0] - np.int32(1)
        within = ((self.mean[rows] >= low) & (self.mean[rows] <= high)).all(-1)
        return np.asarray(rows[within], np.int32)

    # ------------------------------------------------------------------------------------------------ writing
    def remove(self, points: NDArray[np.float32]) -> None:
        """Forget the voxels that hold points [N, 3]: nothing is there any more. The normals around are left as they were."""
        packed = np.unique(kernels.pack_points(points, self.settings.voxel_m))
        slots, rows = self._find(packed)
        there = rows >= 0
        self.index[slots[there], packed[there] % kernels.BLOCK_VOXELS] = 0
        self.hits[rows[there]] = 0
        self.structure[rows[there]] = 0
        self._rows.give_back(rows[there])

    def insert(self, points: NDArray[np.float32], origin: NDArray[np.float64], stamp_ns: int) -> Touched:
        """Add the points [N, 3] of one scan seen from origin [3] (map frame, metres)."""
        packed = kernels.pack_points(points, self.settings.voxel_m)
        voxels, voxel = kernels.group(packed, np.argsort(packed, kind="stable"))
        slots, rows = self._rows_for(voxels, origin, stamp_ns)
        memory = self.settings.memory_hits
        kernels.update_means(self.mean, self.hits, points, voxel, rows, memory)
        kept = rows[rows >= 0]
        self.seen_ns[kept] = stamp_ns
        cells, cell_of_voxel = kernels.group_cells(voxels, slots, rows)
        size_m = 2 * self.settings.voxel_m
        cell = _at(cell_of_voxel, voxel)
        due = kernels.update_moments(self.moments, self.touches, points, cell, cells, size_m, 8 * memory)
        windows = kernels.window_moments(due, self.neighbours, self.moments, size_m)
        kernels.set_patches(self.normal, self.surface, due, windows, self.blocks, origin, self.settings.voxel_m)
        return Touched(kept, _at(rows, voxel))

    # ------------------------------------------------------------------------------------------------ rows and blocks
    def _find(self, voxels: kernels.Ints) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        return kernels.find_voxels(voxels, self._table, self.blocks, self.index)

    def _rows_for(
        self, voxels: kernels.Ints, origin: NDArray[np.float64], stamp_ns: int
    ) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Slots and rows (-1 = refused) of sorted unique packed voxels; makes what is missing, within the bound."""
        slots, rows = self._find(voxels)
        missing = int((rows < 0).sum())
        if not missing:
            return slots, rows
        new = np.unique(voxels[slots < 0] // kernels.BLOCK_VOXELS)
        if len(self) + missing > self.settings.max_voxels or self._slots.used + len(new) > self._max_blocks:
            self._evict(origin, np.unique(slots[slots >= 0]), missing, len(new))
        if len(new):
            self._make_blocks(new[: self._max_blocks - self._slots.used])
            slots, rows = self._find(voxels)
        wanted = np.flatnonzero((rows < 0) & (slots >= 0))[: self.settings.max_voxels - len(self)]
        self.refused += missing - len(wanted)
        rows[wanted] = made = self._rows.take(len(wanted))
        self.mean[made] = 0
        self.made_ns[made] = stamp_ns
        kernels.enter_voxels(self.index, self.coarse, voxels[wanted], slots[wanted], made)
        return slots, rows

    def _make_blocks(self, blocks: kernels.Ints) -> None:
        """Give slots to block keys [B] that have none."""
        slots = self._slots.take(len(blocks))
        self.blocks[slots] = blocks
        kernels.fill_table(self._table, self.blocks, slots)
        kernels.link_blocks(self.neighbours, self._table, self.blocks, slots)

    def _evict(self, origin: NDArray[np.float64], keep: NDArray[np.int32], rows: int, blocks: int) -> None:
        """Forget the blocks farthest from origin, but none of ``keep``, until rows and blocks more have room to spare."""
        used = self.blocks[: self.slot_count] != 0
        used[keep] = False
        slots = np.flatnonzero(used).astype(np.int32)
        centres = (kernels.unpack_blocks(self.blocks[slots]) + 0.5) * (kernels.BLOCK_EDGE * self.settings.voxel_m)
        distance = np.linalg.norm(centres - origin, axis=-1)
        slots = slots[np.argsort(-distance, kind="stable")]
        spare = int(self.settings.max_voxels * _EVICT_SHARE)
        need_rows = len(self) + rows + spare - self.settings.max_voxels
        need_blocks = self._slots.used + blocks + int(self._max_blocks * _EVICT_SHARE) - self._max_blocks
        freed = end = 0
        while end < len(slots) and (freed < need_rows or end < need_blocks):
            part = slots[end : end + _EVICT_BLOCKS]
            freed += int((self.index[part] > 0).sum())
            end += len(part)
        self._forget(slots[:end])

    def _forget(self, slots: NDArray[np.int32]) -> None:
        """Free the blocks in these slots and their voxels."""
        rows = self.index[slots]
        dead = rows[rows > 0] - np.int32(1)
        self.hits[dead] = 0
        self.structure[dead] = 0
        self._rows.give_back(dead)
        self._slots.give_back(slots)
        self.evicted += len(dead)
        which, k = np.nonzero(self.neighbours[slots])
        self.neighbours[self.neighbours[slots[which], k] - 1, 26 - k] = 0
        self.blocks[slots] = 0
        self.neighbours[slots] = 0
        self.index[slots] = 0
        cells = (slots[:, None] * kernels.BLOCK_COARSE + np.arange(kernels.BLOCK_COARSE)).ravel()
        self.moments[cells] = 0
        self.normal[cells] = 0
        self.touches[cells] = 0
        self._table[:] = 0
        kernels.fill_table(self._table, self.blocks, np.flatnonzero(self.blocks[: self.slot_count]))


def _at(values: NDArray[np.int32], places: NDArray[np.int32]) -> NDArray[np.int32]:
    """values[places], -1 where the place is -1."""
    if not len(values):
        return np.full(len(places), -1, np.int32)
    return np.where(places >= 0, values[places], np.int32(-1))
