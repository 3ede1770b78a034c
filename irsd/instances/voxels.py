"""The voxel memory as flat arrays: integer key -> row by open addressing, and per row who claims the voxel on what evidence.

A row has a few claims; a claim holds an instance (by its slot) and the evidence for "this voxel belongs to it": in how many
pictures it lay inside the instance's mask (``hits``) and in how many of the pictures that showed the instance it was seen at all
(``seen``). Neighbours in space lie side by side in the table, so that a mask's look-ups stay in the cache.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel

Ints = NDArray[np.int64]
Rows = NDArray[np.int32]
Floats = NDArray[np.float32]

CLAIMS = 4  # instances that can claim one voxel; the weakest claim gives way to a new one
EMPTY = 0  # the key of a corner 2^20 voxels away: never used; zero, so that fresh memory needs no filling
NOBODY = -1
_BITS = 21
_OFFSET = 1 << (_BITS - 1)
_LOW = (1 << _BITS) - 1
_BLOCK = 64  # places of the table that the 4 x 4 x 4 voxels of one block start from
_MOST = 60_000  # evidence is halved before a count of 16 bits could overflow


class Table(NamedTuple):
    """Open addressing: key int64 [T] (EMPTY = free) and its row int32 [T]; T is a power of two."""

    key: Ints
    row: Rows


class Cells(NamedTuple):
    """Per row: key int64 [R] (EMPTY = unused), point float32 [R, 3] mean position, mass int32 [R] points in it, owner int32 [R, C]
    slot or NOBODY, hits and seen uint16 [R, C], views int32 [R] pictures that saw it, stamp int32 [R], frame int32 [R] last picture.
    """

    key: Ints
    point: Floats
    mass: Rows
    owner: Rows
    hits: NDArray[np.uint16]
    seen: NDArray[np.uint16]
    views: Rows
    stamp: Rows
    frame: Rows


def new_table(bits: int) -> Table:
    return Table(np.zeros(1 << bits, np.int64), np.zeros(1 << bits, np.int32))


def new_cells(capacity: int) -> Cells:
    return Cells(
        np.zeros(capacity, np.int64),
        np.zeros((capacity, 3), np.float32),
        np.zeros(capacity, np.int32),
        np.zeros((capacity, CLAIMS), np.int32),
        np.zeros((capacity, CLAIMS), np.uint16),
        np.zeros((capacity, CLAIMS), np.uint16),
        np.zeros(capacity, np.int32),
        np.zeros(capacity, np.int32),
        np.zeros(capacity, np.int32),
    )


def voxel_keys(points: Floats, per_m: float) -> Ints:
    """Packed integer keys [N] of the voxels that hold points [N, 3]; see ``pack_key``."""
    cells = np.floor(np.asarray(points, np.float64) * per_m).astype(np.int64) + _OFFSET
    return np.asarray((cells[:, 0] << (2 * _BITS)) | (cells[:, 1] << _BITS) | cells[:, 2])


# ------------------------------------------------------------------------------------------------------------ kernels
@kernel
def pack_key(x: float, y: float, z: float, per_m: float) -> int:
    """Packed integer key of the voxel that holds a point; unique within +-2^20 voxels of the origin."""
    i = int(np.floor(np.float64(x) * per_m)) + _OFFSET
    j = int(np.floor(np.float64(y) * per_m)) + _OFFSET
    k = int(np.floor(np.float64(z) * per_m)) + _OFFSET
    return (i << (2 * _BITS)) | (j << _BITS) | k


@kernel
def home(key: int, places: int) -> int:
    """Where a key's search starts: hash of its 4 x 4 x 4 block, then its own place within."""
    i, j, k = key >> (2 * _BITS), (key >> _BITS) & _LOW, key & _LOW
    block = np.uint64(((i >> 2) << 42) | ((j >> 2) << 21) | (k >> 2))
    block = (block ^ (block >> np.uint64(31))) * np.uint64(0x9E3779B97F4A7C15)
    block = (block ^ (block >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
    start = np.int64((block >> np.uint64(32)) & np.uint64(places // _BLOCK - 1)) * _BLOCK
    # Within the block's places shuffled by its hash: the same plane of two blocks (a floor, a table) must not meet itself.
    own = (((i & 3) << 4) | ((j & 3) << 2) | (k & 3)) ^ np.int64(block & np.uint64(_BLOCK - 1))
    return int(start) + int(own)


@kernel
def find_key(table_key: Ints, table_row: Rows, key: int) -> int:
    """Row of a key, -1 where it has none."""
    places = len(table_key)
    at = home(key, places)
    while True:
        there = table_key[at]
        if there == key:
            return int(table_row[at])
        if there == EMPTY:
            return -1
        at = (at + 1) & (places - 1)


@kernel
def enter_key(table_key: Ints, table_row: Rows, key: int, row: int) -> None:
    places = len(table_key)
    at = home(key, places)
    while table_key[at] != EMPTY:
        at = (at + 1) & (places - 1)
    table_key[at] = key
    table_row[at] = row


@kernel
def drop_key(table: Table, key: int) -> None:
    """Take a key out and close the gap, so that no search that passed it ends early."""
    places = len(table.key)
    at = home(key, places)
    while table.key[at] != key:
        if table.key[at] == EMPTY:
            return
        at = (at + 1) & (places - 1)
    gap = at
    while True:
        at = (at + 1) & (places - 1)
        if table.key[at] == EMPTY:
            break
        start = home(table.key[at], places)
        if ((at - start) & (places - 1)) >= ((at - gap) & (places - 1)):
            table.key[gap], table.row[gap] = table.key[at], table.row[at]
            gap = at
    table.key[gap] = EMPTY


@kernel
def refill(table: Table, cells: Cells) -> None:
    """Enter all rows in use into an empty table."""
    for row in range(len(cells.key)):
        if cells.key[row] != EMPTY:
            enter_key(table.key, table.row, cells.key[row], row)


@kernel
def take_row(
    table_key: Ints,
    table_row: Rows,
    key_of: Ints,
    owner: Rows,
    count: Rows,
    views: Rows,
    counts: Ints,
    free: Rows,
    key: int,
) -> int:
    """A row for a new key. counts: int64 [3], rows ever used, free rows on the stack ``free``, stamps given."""
    if counts[1] > 0:
        counts[1] -= 1
        row = int(free[counts[1]])
    else:
        row = int(counts[0])
        counts[0] += 1
    key_of[row] = key
    count[row] = 0
    views[row] = 0
    for c in range(CLAIMS):
        owner[row, c] = NOBODY
    enter_key(table_key, table_row, key, row)
    return row


@kernel
def rows_of(table: Table, keys: Ints) -> Rows:
    """Rows [N] of keys [N], -1 where a voxel has none."""
    rows = np.empty(len(keys), np.int32)
    for k in range(len(keys)):
        rows[k] = find_key(table.key, table.row, keys[k])
    return rows


@kernel
def enter_rows(table: Table, cells: Cells, counts: Ints, free: Rows, keys: Ints) -> Rows:
    """Rows [N] of keys [N]; those without one get one. counts, free: see ``take_row``."""
    rows = rows_of(table, keys)
    for k in range(len(keys)):
        if rows[k] < 0:
            rows[k] = take_row(
                table.key, table.row, cells.key, cells.owner, cells.mass, cells.views, counts, free, keys[k]
            )
    return rows


@kernel
def gather(
    table: Table, cells: Cells, counts: Ints, free: Rows, points: Floats, offset: Ints, per_m: float, view: int
) -> tuple[Rows, Ints]:
    """The voxels of masks: (rows int32 [P], unique within a mask, offsets int64 [m + 1]). New voxels get rows.

    points: float32 [N, 3], those of mask k at offset[k]:offset[k + 1]. Adds the points to the voxels' mean positions.
    """
    table_key, table_row, point, count, stamp = table.key, table.row, cells.point, cells.mass, cells.stamp
    rows = np.empty(len(points), np.int32)
    starts = np.zeros(len(offset), np.int64)
    n = 0
    last_key, last_row = EMPTY, -1
    for m in range(len(offset) - 1):
        counts[2] += 1
        for p in range(offset[m], offset[m + 1]):
            x, y, z = points[p, 0], points[p, 1], points[p, 2]
            key = pack_key(x, y, z, per_m)
            if key != last_key:
                last_row = find_key(table_key, table_row, key)
                if last_row < 0:
                    last_row = take_row(
                        table_key, table_row, cells.key, cells.owner, count, cells.views, counts, free, key
                    )
                last_key = key
            row = last_row
            have = count[row]
            if have == 0:
                point[row, 0], point[row, 1], point[row, 2] = x, y, z
            else:
                share = np.float32(1.0 / (min(have, 255) + 1.0))
                point[row, 0] += (x - point[row, 0]) * share
                point[row, 1] += (y - point[row, 1]) * share
                point[row, 2] += (z - point[row, 2]) * share
            count[row] = have + 1
            if stamp[row] != counts[2]:
                stamp[row] = counts[2]
                rows[n] = row
                n += 1
        starts[m + 1] = n
    return rows[:n], starts


@kernel
def sight(table: Table, cells: Cells, rows: Rows, points: Floats, per_m: float, view: int) -> Rows:
    """Unique rows [S] that a picture shows: those of its masks (rows) and the known voxels of points [N, 3]; each is one view more."""
    table_key, table_row, frame, views = table.key, table.row, cells.frame, cells.views
    shown = np.empty(len(rows) + len(points), np.int32)
    n = 0
    for row in rows:
        if frame[row] != view:
            frame[row] = view
            views[row] += 1
            shown[n] = row
            n += 1
    last = EMPTY
    for p in range(len(points)):
        key = pack_key(points[p, 0], points[p, 1], points[p, 2], per_m)
        if key == last:
            continue
        last = key
        row = find_key(table_key, table_row, key)
        if row >= 0 and frame[row] != view:
            frame[row] = view
            views[row] += 1
            shown[n] = row
            n += 1
    return shown[:n]


@kernel
def owners(table: Table, cells: Cells, points: Floats, per_m: float) -> Rows:
    """Slot int32 [K] of the best claim on each point's voxel, -1 where nobody has one."""
    out = np.full(len(points), -1, np.int32)
    for p in range(len(points)):
        row = find_key(table.key, table.row, pack_key(points[p, 0], points[p, 1], points[p, 2], per_m))
        if row < 0:
            continue
        best = 0.0
        for c in range(CLAIMS):
            slot = cells.owner[row, c]
            share = cells.hits[row, c] / max(float(cells.seen[row, c]), 1.0)
            if slot >= 0 and share > best:
                best, out[p] = share, slot
    return out


@kernel
def halve(hits: NDArray[np.uint16], seen: NDArray[np.uint16], row: int) -> None:
    """Keep the ratios of evidence and make room for more."""
    for c in range(CLAIMS):
        hits[row, c] = (hits[row, c] + 1) >> 1
        seen[row, c] = (seen[row, c] + 1) >> 1


@kernel
def add_evidence(
    cells: Cells,
    counts: Ints,
    rows: Rows,
    starts: Ints,
    slots: Rows,
    shown: Rows,
    in_view: NDArray[np.bool_],
    observations: Rows,
    doubt: float,
) -> tuple[Rows, Ints]:
    """Write one picture. Returns the rows newly claimed, by mask: (rows [Q], offsets [m + 1]).

    slots: int32 [m] the instance of each mask; in_view: bool [cap], True for those slots; observations: int32 [cap]. A new claim
    starts with ``doubt`` times the earlier pictures that saw the voxel and the instance, without a hit.
    """
    owner, hits, seen, views, stamp = cells.owner, cells.hits, cells.seen, cells.views, cells.stamp
    for row in shown:
        for c in range(CLAIMS):
            slot = owner[row, c]
            if slot >= 0 and in_view[slot]:
                if seen[row, c] >= _MOST:
                    halve(hits, seen, row)
                seen[row, c] += 1
    fresh = np.empty(len(rows), np.int32)
    ends = np.zeros(len(starts), np.int64)
    n = 0
    for m in range(len(slots)):
        slot = slots[m]
        first = True
        for j in range(m):
            first = first and slots[j] != slot
        if first:  # all masks of one instance together: a voxel in two of them is one hit
            counts[2] += 1
            for k in range(m, len(slots)):
                if slots[k] != slot:
                    continue
                for p in range(starts[k], starts[k + 1]):
                    row = rows[p]
                    if stamp[row] == counts[2]:
                        continue
                    stamp[row] = counts[2]
                    before = doubt * max(min(views[row], observations[slot]) - 1, 0)
                    if claim(owner, hits, seen, row, slot, before):
                        fresh[n] = row
                        n += 1
        ends[m + 1] = n
    return fresh[:n], ends


@kernel
def claim(owner: Rows, hits: NDArray[np.uint16], seen: NDArray[np.uint16], row: int, slot: int, before: float) -> bool:
    """One more hit of a slot in a row; True when the claim is new. ``seen`` of old claims is counted apart."""
    weakest, least = 0, 1 << 30
    for c in range(CLAIMS):
        if owner[row, c] == slot:
            hits[row, c] += 1
            return False
        strength = -1 if owner[row, c] < 0 else int(hits[row, c])
        if strength < least:
            weakest, least = c, strength
    owner[row, weakest] = slot
    hits[row, weakest] = 1
    seen[row, weakest] = min(1 + int(before + 0.5), _MOST)
    return True
