"""Kernels over blocks of space: cubes of 16 voxels, which go to rest and wake as one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel
from irsd.instances.settle import cell_place
from irsd.instances.table import BITS, EMPTY, LOW, find_key
from irsd.instances.voxels import CLAIMS, Cells, Floats, Ints, Rows, pack_key

SHIFT = 4  # a block is 2^4 voxels wide
_SIDE = 1 << SHIFT
_CLEAR = 1e-3  # voxels from a block's border within which only a point's key tells on which side it is


@kernel
def block_of(key: int) -> int:
    """Key of the block that holds a voxel, by the voxel's key."""
    i, j, k = key >> (2 * BITS), (key >> BITS) & LOW, key & LOW
    return ((i >> SHIFT) << (2 * BITS)) | ((j >> SHIFT) << BITS) | (k >> SHIFT)


@kernel
def place_in_block(key: int) -> int:
    i, j, k = key >> (2 * BITS), (key >> BITS) & LOW, key & LOW
    return ((i & (_SIDE - 1)) << (2 * SHIFT)) | ((j & (_SIDE - 1)) << SHIFT) | (k & (_SIDE - 1))


@kernel
def key_at(block: int, place: int) -> int:
    """Key of a voxel by its block and its place there."""
    i = ((block >> (2 * BITS)) << SHIFT) | (place >> (2 * SHIFT))
    j = (((block >> BITS) & LOW) << SHIFT) | ((place >> SHIFT) & (_SIDE - 1))
    k = ((block & LOW) << SHIFT) | (place & (_SIDE - 1))
    return (i << (2 * BITS)) | (j << BITS) | k


@kernel
def resting_blocks(cells: Cells, count: int, used: Rows, since: int) -> tuple[Ints, Rows, Ints]:
    """Blocks of which no row was seen, and nobody who claims any was used, in a picture from number ``since`` on.

    Returns (blocks int64 [b] in order, their rows int32 [n], offsets int64 [b + 1]). count: rows ever used; used: int32 [cap], last
    picture by slot.
    """
    places = 64
    while places < count // 8:
        places *= 2
    keys, last = np.full(places, -1, np.int64), np.zeros(places, np.int32)
    at_of = np.full(count, -1, np.int32)
    before, at, number = -1, 0, 0
    row = 0
    while row < count:
        if cells.key[row] == EMPTY:
            row += 1
            continue
        block = block_of(cells.key[row])
        if block != before:
            if 2 * number > places:  # too full: all over again with more room
                places *= 4
                keys, last = np.full(places, -1, np.int64), np.zeros(places, np.int32)
                before, number, row = -1, 0, 0
                continue
            at, before = cell_place(keys, block), block
            number += keys[at] < 0
            keys[at] = block
        at_of[row] = at
        newest = cells.frame[row]
        for c in range(CLAIMS):
            if cells.owner[row, c] >= 0:
                newest = max(newest, used[cells.owner[row, c]])
        last[at] = max(last[at], newest)
        row += 1
    return grouped(at_of, keys, last, since)


@kernel
def grouped(at_of: Rows, keys: Ints, last: Rows, since: int) -> tuple[Ints, Rows, Ints]:
    """See ``resting_blocks``. at_of: int32 [R] place of a row's block among keys, -1 = none; last: last picture by place."""
    sizes = np.zeros(len(keys), np.int64)
    total = 0
    for at in at_of:
        if at >= 0 and last[at] < since:
            sizes[at] += 1
            total += 1
    blocks, offset, n = np.empty(total, np.int64), np.zeros(total + 1, np.int64), 0
    for at in range(len(keys)):
        if sizes[at] > 0:
            blocks[n] = keys[at]
            offset[n + 1] = offset[n] + sizes[at]
            sizes[at] = offset[n]  # from now on: where its next row goes
            n += 1
    rows = np.empty(total, np.int32)
    for row in range(len(at_of)):
        at = at_of[row]
        if at >= 0 and last[at] < since:
            rows[sizes[at]] = row
            sizes[at] += 1
    return blocks[:n].copy(), rows, offset[: n + 1].copy()


@kernel
def note_owned(cells: Cells, owned: NDArray[np.uint8], rows: Rows, slot: int) -> None:
    """Set in owned uint8 [R] that a slot's claims own rows."""
    for row in rows:
        for c in range(CLAIMS):
            if cells.owner[row, c] == slot:
                owned[row] |= np.uint8(1 << c)


@kernel
def held(cells: Cells, rows: Rows, slot: int) -> Rows:
    """Those of rows that a slot claims, in their order."""
    out, n = np.empty(len(rows), np.int32), 0
    for row in rows:
        for c in range(CLAIMS):
            if cells.owner[row, c] == slot:
                out[n] = row
                n += 1
                break
    return out[:n].copy()


@kernel
def find_resting(table: Rows, blocks: Ints, points: Floats, per_m: float) -> Rows:
    """Places int32 [k], each once, of the packed blocks that hold any of points [N, 3]. blocks: int64 [B] by place."""
    out, n = np.empty(64, np.int32), 0
    edge = (_SIDE - 2 * _CLEAR) / per_m
    x0 = y0 = z0 = np.inf
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        if x0 <= x < x0 + edge and y0 <= y < y0 + edge and z0 <= z < z0 + edge:
            continue  # still in the block of the point before
        block = block_of(pack_key(x, y, z, per_m))
        x0 = ((block >> (2 * BITS)) * _SIDE - (1 << (BITS - 1)) + _CLEAR) / per_m
        y0 = (((block >> BITS) & LOW) * _SIDE - (1 << (BITS - 1)) + _CLEAR) / per_m
        z0 = ((block & LOW) * _SIDE - (1 << (BITS - 1)) + _CLEAR) / per_m
        place = find_key(table, blocks, block)
        if place < 0 or (out[:n] == place).any():
            continue
        if n == len(out):
            out = np.concatenate((out, np.empty_like(out)))
        out[n] = place
        n += 1
    return out[:n].copy()
