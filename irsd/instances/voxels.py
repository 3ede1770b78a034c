"""The voxel memory as flat arrays: integer key -> row (see ``table``), and per row who claims the voxel on what evidence.

A row has a few claims; a claim holds an instance (by its slot) and the evidence for "this voxel belongs to it": in how many
pictures it lay inside the instance's mask (``hits``) and in how many of the pictures that showed the instance it was seen at all
(``seen``), both in sixteenths of a picture: near the edge of a mask a voxel may not belong to it. Neighbours in space lie side by
side in the table, so that a mask's look-ups stay in the cache.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel
from irsd.instances.table import (
    BITS,
    EMPTY,
    Index,
    drop_row,
    enter_row,
    find_page,
    find_row,
    page_of,
    spot_of,
    take_page,
)

Ints = NDArray[np.int64]
Rows = NDArray[np.int32]
Floats = NDArray[np.float32]
Counts = NDArray[np.uint16]
Weights = NDArray[np.uint8]

CLAIMS = 4  # instances that can claim one voxel; the weakest claim gives way to a new one
NOBODY = -1
FULL = 16  # evidence of one picture that certainly shows a voxel inside a mask; near the mask's edge it is less
_OFFSET = 1 << (BITS - 1)
MOST = 60_000  # evidence is halved before a count of 16 bits could overflow
_WORDS = 16  # 32-bit words of a row: one line of the cache
_STEADY = 255  # points after which a voxel's mean position follows new ones at a fixed rate


class Cells(NamedTuple):
    """Per row: key int64 [R] (EMPTY = unused), point float32 [R, 3] mean position, owner int32 [R, C] slot or NOBODY, hits and seen
    uint16 [R, C] evidence (FULL a picture), stamp int32 [R], frame int32 [R] last picture, views uint16 [R] pictures that saw it,
    mass uint16 [R] points in it. Views of one array in which a row is one line of the cache.
    """

    key: Ints
    point: Floats
    owner: Rows
    hits: Counts
    seen: Counts
    stamp: Rows
    frame: Rows
    views: Counts
    mass: Counts


def new_cells(capacity: int, *, touch: bool = False) -> Cells:
    """touch: have the system give the memory now, so that a robot's first pictures need not wait for it."""
    raw = np.zeros((capacity + 1) * _WORDS, np.int32)
    if touch:
        raw[:] = 0
    start = -(raw.ctypes.data // 4) % _WORDS
    words = raw[start : start + capacity * _WORDS].reshape(capacity, _WORDS)
    halves = words.view(np.uint16)
    return Cells(
        words.view(np.int64)[:, 0], words.view(np.float32)[:, 2:5], words[:, 5:9], halves[:, 18:22], halves[:, 22:26],
        words[:, 13], words[:, 14], halves[:, 30], halves[:, 31],
    )  # fmt: skip


def voxel_keys(points: Floats, per_m: float) -> Ints:
    """Packed integer keys [N] of the voxels that hold points [N, 3]; see ``pack_key``."""
    cells = np.floor(np.asarray(points, np.float64) * per_m).astype(np.int64) + _OFFSET
    return np.asarray((cells[:, 0] << (2 * BITS)) | (cells[:, 1] << BITS) | cells[:, 2])


# ------------------------------------------------------------------------------------------------------------ kernels
@kernel
def pack_key(x: float, y: float, z: float, per_m: float) -> int:
    """Packed integer key of the voxel that holds a point; unique within +-2^20 voxels of the origin."""
    i = int(np.floor(np.float64(x) * per_m)) + _OFFSET
    j = int(np.floor(np.float64(y) * per_m)) + _OFFSET
    k = int(np.floor(np.float64(z) * per_m)) + _OFFSET
    return (i << (2 * BITS)) | (j << BITS) | k


@kernel
def take_row(cells: Cells, counts: Ints, free: Rows, key: int) -> int:
    """A row for a new key, not yet in the index. counts: int64 [3], rows ever used, free rows on the stack ``free``, stamps given."""
    if counts[1] > 0:
        counts[1] -= 1
        row = int(free[counts[1]])
    else:
        row = int(counts[0])
        counts[0] += 1
    cells.key[row] = key
    cells.mass[row] = cells.views[row] = 0
    cells.frame[row] = cells.stamp[row] = 0
    for c in range(CLAIMS):
        cells.owner[row, c] = NOBODY
        cells.hits[row, c] = cells.seen[row, c] = 0
    return row


@kernel
def find_all(index: Index, wanted: Ints) -> Rows:
    """Rows int32 [N] of keys [N], -1 where a voxel has none."""
    out = np.empty(len(wanted), np.int32)
    for k in range(len(wanted)):
        out[k] = find_row(index, wanted[k])
    return out


@kernel
def take_rows(index: Index, cells: Cells, counts: Ints, free: Rows, keys: Ints, rows: Rows) -> None:
    """Rows for those of unique keys [N] that have none: rows int32 [N], -1 there, is completed."""
    for k in range(len(keys)):
        if rows[k] < 0:
            rows[k] = take_row(cells, counts, free, keys[k])
            enter_row(index, keys[k], rows[k])


@kernel
def drop_rows(index: Index, cells: Cells, counts: Ints, free: Rows, rows: Rows) -> None:
    """Free rows: their keys are forgotten, their claims with them."""
    page = 0
    for row in rows:
        page_key = page_of(cells.key[row])
        if index.key[page] != page_key:
            page = find_page(index, page_key)
        drop_row(index, page, cells.key[row])
        cells.key[row] = EMPTY
        for c in range(CLAIMS):
            cells.owner[row, c] = NOBODY
        free[counts[1]] = row
        counts[1] += 1


@kernel
def gather(
    index: Index, cells: Cells, counts: Ints, free: Rows, points: Floats, offset: Ints, per_m: float
) -> tuple[Rows, Ints]:
    """The voxels of masks: (rows int32 [P], unique within a mask, offsets int64 [m + 1]). New voxels get rows.

    points: float32 [N, 3], those of mask k at offset[k]:offset[k + 1]. Adds the points to the voxels' mean positions.
    """
    point, mass, stamp = cells.point, cells.mass, cells.stamp
    rows = np.empty(len(points), np.int32)
    starts = np.zeros(len(offset), np.int64)
    n = 0
    last_key, row = EMPTY, -1
    last_page, page = EMPTY, -1
    for m in range(len(offset) - 1):
        counts[2] += 1
        for p in range(offset[m], offset[m + 1]):
            x, y, z = points[p, 0], points[p, 1], points[p, 2]
            key = pack_key(x, y, z, per_m)
            if key != last_key:
                last_key, page_key = key, page_of(key)
                if page_key != last_page:
                    last_page, page = page_key, find_page(index, page_key)
                    if page < 0:
                        page = take_page(index, page_key)
                spot = spot_of(key)
                row = index.row[page, spot] - 1
                if row < 0:
                    row = take_row(cells, counts, free, key)
                    index.row[page, spot] = row + 1
                    index.held[page] += 1
            have = mass[row]
            share = np.float32(1.0) / np.float32(have + 1)
            point[row, 0] += (x - point[row, 0]) * share
            point[row, 1] += (y - point[row, 1]) * share
            point[row, 2] += (z - point[row, 2]) * share
            mass[row] = min(have + 1, _STEADY)
            if stamp[row] != counts[2]:
                stamp[row] = counts[2]
                rows[n] = row
                n += 1
        starts[m + 1] = n
    return rows[:n], starts


@kernel
def sight(index: Index, cells: Cells, rows: Rows, points: Floats, per_m: float, view: int) -> Rows:
    """Unique rows [S] that a picture shows: those of its masks (rows) and the known voxels of points [N, 3]; each is one view more."""
    frame, views = cells.frame, cells.views
    shown = np.empty(len(rows) + len(points), np.int32)
    n = 0
    for row in rows:
        if frame[row] != view:
            frame[row] = view
            views[row] = min(views[row] + 1, MOST)
            shown[n] = row
            n += 1
    last = last_page = EMPTY
    page = -1
    for p in range(len(points)):
        key = pack_key(points[p, 0], points[p, 1], points[p, 2], per_m)
        if key == last:
            continue
        last, page_key = key, page_of(key)
        if page_key != last_page:
            last_page, page = page_key, find_page(index, page_key)
        row = index.row[page, spot_of(key)] - 1 if page >= 0 else -1
        if row >= 0 and frame[row] != view:
            frame[row] = view
            views[row] = min(views[row] + 1, MOST)
            shown[n] = row
            n += 1
    return shown[:n]


@kernel
def owners(index: Index, cells: Cells, points: Floats, per_m: float) -> Rows:
    """Slot int32 [K] of the best claim on each point's voxel, -1 where nobody has one."""
    out = np.full(len(points), -1, np.int32)
    for p in range(len(points)):
        row = find_row(index, pack_key(points[p, 0], points[p, 1], points[p, 2], per_m))
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
def halve(hits: Counts, seen: Counts, row: int) -> None:
    """Keep the ratios of evidence and make room for more."""
    for c in range(CLAIMS):
        hits[row, c] = (hits[row, c] + 1) >> 1
        seen[row, c] = (seen[row, c] + 1) >> 1


@kernel
def add_evidence(
    cells: Cells,
    counts: Ints,
    rows: Rows,
    weights: Weights,
    starts: Ints,
    slots: Rows,
    shown: Rows,
    observations: Rows,
    doubt: float,
) -> tuple[Rows, Ints]:
    """Write one picture. Returns the rows newly claimed, by mask: (rows [Q], offsets [m + 1]).

    rows, weights, starts: voxels of the masks and the evidence that each is inside, of FULL; slots: int32 [m] the instance of each
    mask; observations: int32 [cap]. A new claim starts with ``doubt`` times the earlier pictures that saw the voxel and the
    instance, without a hit.
    """
    owner, hits, seen, views, stamp = cells.owner, cells.hits, cells.seen, cells.views, cells.stamp
    in_view = np.zeros(len(observations), np.bool_)
    for slot in slots:
        in_view[slot] = True
    for row in shown:
        for c in range(CLAIMS):
            slot = owner[row, c]
            if slot >= 0 and in_view[slot]:
                if seen[row, c] >= MOST:
                    halve(hits, seen, row)
                seen[row, c] += FULL
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
                    before = doubt * max(min(int(views[row]), observations[slot]) - 1, 0)
                    if claim(owner, hits, seen, row, slot, int(weights[p]), before):
                        fresh[n] = row
                        n += 1
        ends[m + 1] = n
    return fresh[:n], ends


@kernel
def claim(owner: Rows, hits: Counts, seen: Counts, row: int, slot: int, weight: int, before: float) -> bool:
    """One more hit of a slot in a row; True when the claim is new. ``seen`` of old claims is counted apart."""
    weakest, least = 0, 1 << 30
    for c in range(CLAIMS):
        if owner[row, c] == slot:
            hits[row, c] += weight
            return False
        strength = -1 if owner[row, c] < 0 else int(hits[row, c])
        if strength < least:
            weakest, least = c, strength
    owner[row, weakest] = slot
    hits[row, weakest] = weight
    seen[row, weakest] = min(FULL * (1 + int(before + 0.5)), MOST)
    return True
