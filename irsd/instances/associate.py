"""The voxel index of instances and the kernels that match masks to instances by what they share in it.

A mask asks only its own voxels who lives there, so a query costs the mask's points, whatever the number of instances. Each
voxel has a few slots; a slot holds an instance and the evidence for "this voxel belongs to it": in how many pictures it lay
inside the instance's mask (``hits``) and in how many of the pictures that showed the instance it was seen at all (``seen``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Doubles = NDArray[np.float64]
Floats = NDArray[np.float32]

SLOTS = 4  # instances that can claim one voxel; the weakest claim gives way to a new one
_EMPTY = np.iinfo(np.int64).min  # no packed key has this value
_AXIS_BITS = 21
_AXIS_OFFSET = 1 << (_AXIS_BITS - 1)
_HASH = np.uint64(0x9E3779B97F4A7C15)  # 2^64 / golden ratio (Knuth, vol. 3, section 6.4)


def voxel_keys(points: Floats, voxel_m: float) -> Ints:
    """Packed integer keys [N] of the voxels that hold points [N, 3]; unique within +-2^20 voxels of the origin."""
    cells = np.floor(np.asarray(points, np.float64) / voxel_m).astype(np.int64) + _AXIS_OFFSET
    return np.asarray((cells[:, 0] << (2 * _AXIS_BITS)) | (cells[:, 1] << _AXIS_BITS) | cells[:, 2])


class VoxelIndex:
    """Voxel key -> row, and per row the slots. Open addressing in arrays: look-ups and inserts are vectorised.

    owner: int32 [R, SLOTS] instance ids (0 = free); hits, seen: float32 [R, SLOTS]; views: int32 [R], pictures that saw the
    voxel since it has a row; point: float32 [R, 3], its latest position. Rows are never moved or reused.
    """

    def __init__(self, capacity: int = 4096) -> None:
        self._bits = max(int(np.ceil(np.log2(2 * capacity))), 4)
        self._table_key = np.full(1 << self._bits, _EMPTY, np.int64)
        self._table_row = np.zeros(1 << self._bits, np.int64)
        self._count = 0
        self.key = np.zeros(capacity, np.int64)
        self.owner = np.zeros((capacity, SLOTS), np.int32)
        self.hits = np.zeros((capacity, SLOTS), np.float32)
        self.seen = np.zeros((capacity, SLOTS), np.float32)
        self.views = np.zeros(capacity, np.int32)
        self.point = np.zeros((capacity, 3), np.float32)

    def __len__(self) -> int:
        return self._count

    def find(self, keys: Ints) -> Ints:
        """Rows [N] of keys [N], -1 where a voxel has none."""
        rows = np.full(len(keys), -1, np.int64)
        todo = np.arange(len(keys))
        place = self._first_place(keys)
        while len(todo):
            there = self._table_key[place]
            found = there == keys[todo]
            rows[todo[found]] = self._table_row[place[found]]
            on = ~found & (there != _EMPTY)
            todo, place = todo[on], self._next_place(place[on])
        return rows

    def insert(self, keys: Ints) -> Ints:
        """Rows [N] of unique keys [N]; voxels without one get one, in the order given."""
        rows = self.find(keys)
        new = np.flatnonzero(rows < 0)
        if len(new):
            self._reserve(self._count + len(new))
            rows[new] = np.arange(self._count, self._count + len(new))
            self.key[rows[new]] = keys[new]
            self._count += len(new)
            self._enter(keys[new], rows[new])
        return rows

    def slot_of(self, rows: Ints, ids: Ints) -> Ints:
        """Slot [N] that instance ids [N] hold in rows [N], -1 where they hold none."""
        same = self.owner[rows] == ids[:, None]
        return np.asarray(np.where(same.any(1), same.argmax(1), -1), np.int64)

    def claim(self, rows: Ints, ids: Ints, seen_before: Floats) -> None:
        """One more hit for each unique (row, id) pair; a new claim starts with seen_before [N] pictures without a hit."""
        slot = self.slot_of(rows, ids)
        old = slot >= 0
        self.hits[rows[old], slot[old]] += 1
        self.seen[rows[old], slot[old]] += 1
        pending = np.flatnonzero(~old)
        while len(pending):
            # Two ids may be new in one row: one per row and round, the first given first.
            _, first = np.unique(rows[pending], return_index=True)
            now = pending[first]
            row = rows[now]
            weakest = np.where(self.owner[row] == 0, -1.0, self.hits[row]).argmin(1)
            self.owner[row, weakest] = ids[now]
            self.hits[row, weakest] = 1
            self.seen[row, weakest] = 1 + seen_before[now]
            pending = np.delete(pending, first)

    def release(self, rows: Ints, instance: int) -> None:
        """Give up all slots that an instance holds in rows."""
        at, slot = np.nonzero(self.owner[rows] == instance)
        self.owner[rows[at], slot] = 0
        self.hits[rows[at], slot] = 0
        self.seen[rows[at], slot] = 0

    def ratio(self, rows: Ints) -> Doubles:
        """[N, SLOTS] relative evidence of each claim: in what share of an instance's pictures the voxel was in its mask.

        One imaginary picture without a hit keeps single sightings below older claims.
        """
        return np.asarray(self.hits[rows] / (self.seen[rows].astype(np.float64) + 1.0))

    def owners(self, rows: Ints, least_ratio: float) -> Ints:
        """The one owner [N] of each voxel: most hits weighted with their relative evidence; 0 = nobody has enough."""
        ratio = self.ratio(rows)
        weight = np.where((self.owner[rows] > 0) & (ratio >= least_ratio), self.hits[rows] * ratio, 0.0)
        # Among equals the older instance, so that the result does not depend on the order of the slots.
        order = np.lexsort((self.owner[rows], -weight), axis=1)[:, :1]
        best = np.take_along_axis(self.owner[rows], order, 1)[:, 0]
        return np.asarray(np.where(np.take_along_axis(weight, order, 1)[:, 0] > 0, best, 0), np.int64)

    # ------------------------------------------------------------------------------------------------ the table
    def _first_place(self, keys: Ints) -> Ints:
        mixed = keys.astype(np.uint64) * _HASH
        return np.asarray(mixed >> np.uint64(64 - self._bits), np.int64)

    def _next_place(self, place: Ints) -> Ints:
        return np.asarray((place + 1) & ((1 << self._bits) - 1), np.int64)

    def _enter(self, keys: Ints, rows: Ints) -> None:
        place = self._first_place(keys)
        while len(keys):
            free = self._table_key[place] == _EMPTY
            self._table_key[place[free]] = keys[free]  # several may write one place; the last to write got it
            won = free & (self._table_key[place] == keys)
            self._table_row[place[won]] = rows[won]
            keys, rows, place = keys[~won], rows[~won], self._next_place(place[~won])

    def _reserve(self, count: int) -> None:
        if count > len(self.key):
            size = max(count, 2 * len(self.key))
            for name in ("key", "owner", "hits", "seen", "views", "point"):
                old = getattr(self, name)
                new = np.zeros((size, *old.shape[1:]), old.dtype)
                new[: len(old)] = old
                setattr(self, name, new)
        if 2 * count > 1 << self._bits:
            self._bits = int(np.ceil(np.log2(4 * count)))
            self._table_key = np.full(1 << self._bits, _EMPTY, np.int64)
            self._table_row = np.zeros(1 << self._bits, np.int64)
            self._enter(self.key[: self._count], np.arange(self._count))


# ------------------------------------------------------------------------------------------------------------ kernels
def mask_voxels(clouds: Sequence[Floats], voxel_m: float) -> tuple[Ints, Ints, Floats]:
    """(mask number [P], voxel key [P], a point [P, 3]) of each unique pair of mask and voxel; clouds: points [n, 3] per mask."""
    if not clouds:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3), np.float32)
    points = np.concatenate(clouds)
    mask = np.repeat(np.arange(len(clouds)), [len(cloud) for cloud in clouds])
    keys = voxel_keys(points, voxel_m)
    order = np.lexsort((keys, mask))
    first = np.ones(len(order), np.bool_)
    first[1:] = (np.diff(keys[order]) != 0) | (np.diff(mask[order]) != 0)
    pick = order[first]
    return mask[pick], keys[pick], points[pick]


@dataclass(frozen=True, slots=True)
class Shared:
    """What m masks share with c candidate instances. ids: int64 [c] ascending; voxels: float64 [m, c] shared voxel counts.

    mask_voxels: float64 [m]; visible: float64 [c], voxels of the candidate that the picture shows.
    """

    ids: Ints
    voxels: Doubles
    mask_voxels: Doubles
    visible: Doubles

    def overlap(self) -> Doubles:
        """[m, c] shared part of the smaller of the two: 1 when one contains the other."""
        return self.voxels / np.maximum(np.minimum(self.mask_voxels[:, None], self.visible[None]), 1.0)

    def union(self) -> Doubles:
        """[m, c] shared part of both together (IoU), over what the picture shows."""
        return self.voxels / np.maximum(self.mask_voxels[:, None] + self.visible[None] - self.voxels, 1.0)


def shared_voxels(index: VoxelIndex, mask: Ints, rows: Ints, masks: int, seen_rows: Ints, least_ratio: float) -> Shared:
    """Count what masks share with instances.

    mask: int64 [P] mask number 0..masks-1 of each unique (mask, voxel) pair, rows: int64 [P] its row or -1; seen_rows:
    int64 [S] unique rows the picture shows, those of the masks included. Claims below least_ratio do not count.
    """
    mask_voxels = np.bincount(mask, minlength=masks).astype(np.float64)
    known = rows >= 0
    owner, ratio = index.owner[rows[known]], index.ratio(rows[known])
    good = (owner > 0) & (ratio >= least_ratio)
    ids, column = np.unique(owner[good], return_inverse=True)
    which = np.broadcast_to(mask[known][:, None], owner.shape)[good]
    voxels = np.bincount(which * max(len(ids), 1) + column.reshape(-1), minlength=masks * len(ids)).astype(np.float64)
    owner, ratio = index.owner[seen_rows], index.ratio(seen_rows)
    owner = owner[(owner > 0) & (ratio >= least_ratio)]
    at = np.searchsorted(ids, owner)
    wanted = at < len(ids)
    wanted[wanted] = ids[at[wanted]] == owner[wanted]
    visible = np.bincount(at[wanted], minlength=len(ids)).astype(np.float64)
    return Shared(ids.astype(np.int64), voxels.reshape(masks, len(ids)), mask_voxels, visible)


def choose(shared: Shared, cosine: Doubles, allowed: Bools, tau_g: float, tau_s: float, tau_same: float) -> Ints:
    """Instance id [m] that each mask is an observation of, 0 = none.

    A mask belongs to an instance when their overlap >= tau_g and their cosine >= tau_s, the paper's two criteria. Both
    masks and labels err: where the two are the same voxels (IoU >= tau_same over what the picture shows), a different name
    does not make it a different thing. Among several the largest IoU times cosine wins, the older id among equals.
    cosine: [m, c]; allowed: bool [m, c], False where the room prior forbids the pair.
    """
    if not len(shared.ids):
        return np.zeros(len(shared.mask_voxels), np.int64)
    union = shared.union()
    eligible = allowed & (((shared.overlap() >= tau_g) & (cosine >= tau_s)) | (union >= tau_same))
    worth = np.where(eligible, union * (1.0 + np.maximum(cosine, 0.0)), 0.0)
    best = worth.argmax(1)
    return np.where(worth[np.arange(len(best)), best] > 0, shared.ids[best], 0)
