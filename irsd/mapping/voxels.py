"""The voxel map: running means of points in sparse blocks, with normals from moments of coarse cells.

Storage: a dictionary from packed block key to slot; ``index[slot, 512]`` gives the compact row of a voxel or -1; rows hold
the mean point, hits, structure label and the stamp last seen. Every 2x2x2 voxels form a coarse cell that keeps ten moments
of its points and a normal fitted over its 3x3x3 neighbours. A scan costs one sort of its points and work on its own voxels;
beyond ``max_voxels`` the blocks farthest from the robot are forgotten, and counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from irsd.core.settings import setting
from irsd.mapping import kernels

_Item = TypeVar("_Item", bound=np.generic)
_EVICT_SHARE = 0.05  # of the bound, freed at once: an eviction pass looks at every block, so it must be rare
_NEIGHBOURS = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), -1).reshape(27, 3)


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


class VoxelMap:
    """Single writer of the voxels. Rows of one voxel stay valid until it is evicted; then they may be reused."""

    def __init__(self, settings: VoxelSettings) -> None:
        self.settings = settings
        self._slots: dict[int, int] = {}
        self._free_slots: list[int] = []
        self._free_rows = np.zeros(0, np.int32)
        self._row_end = 0
        self._slot_end = 0
        self._live = 0
        self._max_blocks = max(settings.max_voxels // 40, 512)
        self.evicted = 0
        self.refused = 0
        self._coarse_of_local = kernels.coarse_of_local()
        coarse_m = 2 * settings.voxel_m
        # Points of the neighbour at +k lie at +k cells in this cell's coordinates.
        self._shifts = np.concatenate([kernels.shift_matrix(k * coarse_m) for k in _NEIGHBOURS]).astype(np.float32)
        self._coarse_neighbours = _coarse_neighbour_table()
        # By row: mean point (metres), points so far (bounded by memory_hits), label, stamp, slot * 512 + place in block.
        self.mean = np.zeros((0, 3), np.float32)
        self.hits = np.zeros(0, np.float32)
        self.structure = np.zeros(0, np.uint8)
        self.seen_ns = np.zeros(0, np.int64)
        self.cell = np.zeros(0, np.int32)
        # By slot: whether it holds a block, the block's key, the slots of the 27 blocks around, the row of each voxel.
        self.block_used = np.zeros(0, np.bool_)
        self.block_key = np.zeros((0, 3), np.int64)
        self.neighbours = np.zeros((0, 27), np.int32)
        self.index = np.zeros((0, kernels.BLOCK_VOXELS), np.int32)
        # By coarse cell (slot * 64 + place): moments, normal (zero = unknown), the fitted patch's centroid, scans that hit.
        self.moments = np.zeros((0, 10), np.float32)
        self.normal = np.zeros((0, 3), np.float32)
        self.surface = np.zeros((0, 3), np.float32)
        self.touches = np.zeros(0, np.int32)
        self._allocate_rows(min(4096, settings.max_voxels))
        self._allocate_slots(256)

    # ------------------------------------------------------------------------------------------------ reading
    def __len__(self) -> int:
        return self._live

    @property
    def row_count(self) -> int:
        """Rows in use or on the free list; valid row numbers are below this."""
        return self._row_end

    def coarse_of(self, rows: NDArray[np.integer]) -> NDArray[np.int64]:
        """Coarse cell numbers [M] of rows [M]."""
        slot, local = np.divmod(self.cell[rows].astype(np.int64), kernels.BLOCK_VOXELS)
        return np.asarray(slot * kernels.BLOCK_COARSE + self._coarse_of_local[local], np.int64)

    def live_rows(self) -> NDArray[np.int64]:
        """Row numbers in use, ascending. Costs a pass over the map."""
        return np.flatnonzero(self.hits[: self._row_end] > 0)

    def rows_at(self, points: NDArray[np.floating]) -> NDArray[np.int32]:
        """Row [N] of the voxel that holds each point [N, 3], -1 where there is none."""
        packed, inverse = np.unique(
            kernels.pack_voxels(kernels.voxel_keys(points, self.settings.voxel_m)), return_inverse=True
        )
        slots = self._find_slots(packed >> 9)
        rows = self.index[slots, packed & 511]
        return np.asarray(np.where(slots >= 0, rows, -1)[inverse], np.int32)

    def block_centres(self) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Slots in use [B] and the centres [B, 3] of their blocks in metres."""
        slots = np.flatnonzero(self.block_used[: self._slot_end])
        edge = kernels.BLOCK_EDGE * self.settings.voxel_m
        return slots, ((self.block_key[slots] + 0.5) * edge).astype(np.float32)

    def rows_of_blocks(self, slots: NDArray[np.int64]) -> NDArray[np.int32]:
        """All rows of the given blocks."""
        rows = self.index[slots].ravel()
        return np.asarray(rows[rows >= 0], np.int32)

    # ------------------------------------------------------------------------------------------------ writing
    def insert(self, points: NDArray[np.float32], origin: NDArray[np.float64], stamp_ns: int) -> Touched:
        """Add the points [N, 3] of one scan seen from origin [3] (map frame, metres)."""
        row_of_point = np.full(len(points), -1, np.int32)
        good = np.flatnonzero(kernels.addressable(points, self.settings.voxel_m))
        points = points[good]
        if not len(points):
            return Touched(np.zeros(0, np.int32), row_of_point)
        packed, inverse = np.unique(
            kernels.pack_voxels(kernels.voxel_keys(points, self.settings.voxel_m)), return_inverse=True
        )
        rows, slots = self._rows_for(packed, origin)
        kept = rows >= 0
        exact = np.asarray(points, np.float64)
        self._update_rows(rows, kept, exact, inverse, stamp_ns)
        cells = slots * kernels.BLOCK_COARSE + self._coarse_of_local[packed & 511]
        coarse = self._update_moments(exact, cells, kept, inverse)
        self._refresh_normals(coarse, origin)
        row_of_point[good] = rows[inverse]
        return Touched(rows[kept], row_of_point)

    def _update_rows(
        self,
        rows: NDArray[np.int32],
        kept: NDArray[np.bool_],
        points: kernels.Floats,
        inverse: kernels.IntArray,
        stamp: int,
    ) -> None:
        """Running means of the voxels; past memory_hits the mean becomes an exponential filter, so drift can pull it."""
        count = np.bincount(inverse, minlength=len(rows))[kept].astype(np.float64)
        sums = np.stack([np.bincount(inverse, weights=c, minlength=len(rows)) for c in points.T], -1)[kept]
        rows = rows[kept]
        total = np.minimum(self.hits[rows] + count, np.maximum(self.settings.memory_hits, count))
        mean = self.mean[rows].astype(np.float64)
        self.mean[rows] = mean + (sums - count[:, None] * mean) / total[:, None]
        self.hits[rows] = total
        self.seen_ns[rows] = stamp

    def _update_moments(
        self, points: kernels.Floats, cells: NDArray[np.int64], kept: NDArray[np.bool_], inverse: kernels.IntArray
    ) -> NDArray[np.int64]:
        """Add the points to their coarse cells' moments (about the cell's centre); returns the cells touched."""
        cells = np.where(kept, cells, -1)
        coarse, group = np.unique(cells, return_inverse=True)
        size = 2 * self.settings.voxel_m
        centred = points - (np.floor(points / size) + 0.5) * size
        moments = kernels.group_moments(centred, group[inverse], len(coarse))
        if coarse[0] < 0:
            coarse, moments = coarse[1:], moments[1:]
        old = self.moments[coarse]
        # A cell that has seen much forgets half, so that a moved surface or drift wins after a while.
        fade = np.where(old[:, :1] > 8 * self.settings.memory_hits, 0.5, 1.0)
        self.moments[coarse] = old * fade + moments
        self.touches[coarse] += 1
        return coarse

    def _refresh_normals(self, coarse: NDArray[np.int64], origin: NDArray[np.float64]) -> None:
        """Fit normals where a cell's touch count is a power of two or a multiple of 16: new cells at once, old ones seldom."""
        touches = self.touches[coarse]
        todo = coarse[((touches & (touches - 1)) == 0) | (touches % 16 == 0)]
        if not len(todo):
            return
        slot, inner = todo // kernels.BLOCK_COARSE, todo % kernels.BLOCK_COARSE
        block_step, cell = self._coarse_neighbours[0][inner], self._coarse_neighbours[1][inner]
        neighbour_slot = self.neighbours[slot[:, None], block_step]
        gathered = self.moments[np.maximum(neighbour_slot, 0) * kernels.BLOCK_COARSE + cell]
        gathered[neighbour_slot < 0] = 0
        window = (gathered.reshape(len(todo), -1) @ self._shifts).astype(np.float64)
        normal, variance = kernels.plane_fits(window)
        planar = (window[:, 0] >= 5) & (variance[:, 1] > 0.4 * self.settings.voxel_m**2)
        planar &= variance[:, 0] < 0.3 * variance[:, 1]
        size = 2 * self.settings.voxel_m
        place = np.stack([inner // 16, inner // 4 % 4, inner % 4], -1)
        centre = (self.block_key[slot] * kernels.COARSE_EDGE + place + 0.5) * size
        away = ((origin - centre) * normal).sum(-1) < 0
        self.normal[todo] = np.where(planar[:, None], np.where(away[:, None], -normal, normal), 0.0)
        self.surface[todo] = centre + window[:, 1:4] / np.maximum(window[:, :1], 1e-6)

    # ------------------------------------------------------------------------------------------------ rows and blocks
    def _rows_for(
        self, packed: kernels.IntArray, origin: NDArray[np.float64]
    ) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        """Rows (-1 = refused) and slots of sorted unique packed voxels; makes what is missing, within the bound."""
        blocks, of_block = np.unique(packed >> 9, return_inverse=True)
        slots = self._find_slots(blocks)
        local = packed & 511
        rows = np.where(slots[of_block] >= 0, self.index[slots[of_block], local], -1)
        missing = int((rows < 0).sum())
        new_blocks = int((slots < 0).sum())
        if self._live + missing > self.settings.max_voxels or len(self._slots) + new_blocks > self._max_blocks:
            self._evict(origin, slots[slots >= 0], missing, new_blocks)
        self._make_blocks(blocks, slots)
        of_voxel = slots[of_block]
        wanted = np.flatnonzero((rows < 0) & (of_voxel >= 0))
        room = max(self.settings.max_voxels - self._live, 0)
        self.refused += missing - min(len(wanted), room)
        wanted = wanted[:room]
        made = self._take_rows(len(wanted))
        rows[wanted] = made
        self.index[of_voxel[wanted], local[wanted]] = made
        self.cell[made] = of_voxel[wanted] * kernels.BLOCK_VOXELS + local[wanted]
        return rows.astype(np.int32), of_voxel

    def _find_slots(self, blocks: kernels.IntArray) -> NDArray[np.int64]:
        """Slots [B] of packed block keys, -1 where there is no block."""
        get = self._slots.get
        return np.fromiter((get(key, -1) for key in blocks.tolist()), np.int64, len(blocks))

    def _make_blocks(self, blocks: kernels.IntArray, slots: NDArray[np.int64]) -> None:
        """Give slots (written in place) to the blocks that have none, while the bound allows."""
        new = np.flatnonzero(slots < 0)[: max(self._max_blocks - len(self._slots), 0)]
        if not len(new):
            return
        reused = [self._free_slots.pop() for _ in range(min(len(self._free_slots), len(new)))]
        fresh = len(new) - len(reused)
        if self._slot_end + fresh > len(self.block_used):
            self._allocate_slots(max(self._slot_end + fresh, len(self.block_used) * 3 // 2))
        slots[new] = [*reused, *range(self._slot_end, self._slot_end + fresh)]
        self._slot_end += fresh
        self._slots.update(zip(blocks[new].tolist(), slots[new].tolist(), strict=True))
        made, keys = slots[new], kernels.unpack_blocks(blocks[new])
        self.block_used[made] = True
        self.block_key[made] = keys
        around = kernels.pack_blocks((keys[:, None] + _NEIGHBOURS).reshape(-1, 3))
        beside = self._find_slots(around).reshape(-1, 27)
        self.neighbours[made] = beside
        which, k = np.nonzero(beside >= 0)
        self.neighbours[beside[which, k], 26 - k] = made[which]

    def _evict(self, origin: NDArray[np.float64], keep: NDArray[np.int64], rows: int, blocks: int) -> None:
        """Forget the blocks farthest from origin, but none of ``keep``, until rows and blocks more have room to spare."""
        slots, centres = self.block_centres()
        candidates = ~np.isin(slots, keep)
        slots, centres = slots[candidates], centres[candidates]
        distance = np.linalg.norm(centres - origin, axis=-1)
        slots = slots[np.argsort(-distance, kind="stable")]
        freed = np.cumsum((self.index[slots] >= 0).sum(-1))
        spare = int(self.settings.max_voxels * _EVICT_SHARE)
        need_rows = self._live + rows + spare - self.settings.max_voxels
        need_blocks = len(self._slots) + blocks + int(self._max_blocks * _EVICT_SHARE) - self._max_blocks
        count = max(int(np.searchsorted(freed, need_rows)) + 1 if need_rows > 0 else 0, need_blocks)
        gone = slots[:count]
        dead = self.rows_of_blocks(gone)
        self.hits[dead] = 0
        self.structure[dead] = 0
        self._free_rows = np.concatenate([self._free_rows, dead])
        self._live -= len(dead)
        self.evicted += len(dead)
        for packed, slot in zip(kernels.pack_blocks(self.block_key[gone]).tolist(), gone.tolist(), strict=True):
            del self._slots[packed]
            self._free_slots.append(slot)
        beside = self.neighbours[gone]
        which, k = np.nonzero(beside >= 0)
        self.neighbours[beside[which, k], 26 - k] = -1
        self._clear_slots(gone)

    def _clear_slots(self, slots: NDArray[np.int64]) -> None:
        self.block_used[slots] = False
        self.neighbours[slots] = -1
        self.index[slots] = -1
        coarse = (slots[:, None] * kernels.BLOCK_COARSE + np.arange(kernels.BLOCK_COARSE)).ravel()
        self.moments[coarse] = 0
        self.normal[coarse] = 0
        self.touches[coarse] = 0

    def _take_rows(self, count: int) -> NDArray[np.int32]:
        """Row numbers for new voxels: freed ones first."""
        reused = self._free_rows[:count]
        self._free_rows = self._free_rows[len(reused) :]
        fresh = count - len(reused)
        if self._row_end + fresh > len(self.hits):
            self._allocate_rows(min(max(self._row_end + fresh, len(self.hits) * 3 // 2), self.settings.max_voxels))
        made = np.concatenate([reused, np.arange(self._row_end, self._row_end + fresh, dtype=np.int32)])
        self._row_end += fresh
        self._live += count
        self.mean[made] = 0
        self.hits[made] = 0
        self.structure[made] = 0
        return made

    def _allocate_rows(self, size: int) -> None:
        """Room for ``size`` rows."""
        self.mean = _grown(self.mean, size)
        self.hits = _grown(self.hits, size)
        self.structure = _grown(self.structure, size)
        self.seen_ns = _grown(self.seen_ns, size)
        self.cell = _grown(self.cell, size)

    def _allocate_slots(self, size: int) -> None:
        """Room for ``size`` blocks, within the bound."""
        size = min(size, self._max_blocks)
        self.block_used = _grown(self.block_used, size)
        self.block_key = _grown(self.block_key, size)
        self.neighbours = _grown(self.neighbours, size, -1)
        self.index = _grown(self.index, size, -1)
        coarse = size * kernels.BLOCK_COARSE
        self.moments = _grown(self.moments, coarse)
        self.normal = _grown(self.normal, coarse)
        self.surface = _grown(self.surface, coarse)
        self.touches = _grown(self.touches, coarse)


def _grown(old: NDArray[_Item], size: int, fill: int = 0) -> NDArray[_Item]:
    """A longer array that starts with the old one's rows."""
    new: NDArray[_Item] = np.full((size, *old.shape[1:]), fill, old.dtype)
    new[: len(old)] = old
    return new


def _coarse_neighbour_table() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For each coarse cell of a block and each of 27 offsets: which neighbouring block (0..26) and which cell in it."""
    edge = kernels.COARSE_EDGE
    place = np.indices((edge,) * 3).reshape(3, -1).T[:, None] + _NEIGHBOURS
    step, inner = place // edge, place % edge
    block = ((step[..., 0] + 1) * 3 + step[..., 1] + 1) * 3 + step[..., 2] + 1
    return block, (inner[..., 0] * edge + inner[..., 1]) * edge + inner[..., 2]
