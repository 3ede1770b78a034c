"""Kernels that pack the voxels of a block of space into bytes and back: what nobody looks at costs a few bytes a voxel.

A block is a cube of 16 voxels. Packed are all its rows with their claims: a mean position to 1/16 of a voxel, the number of points to
a power of two, all evidence exactly. Claims that are too thin to count for owning or merging are left out, and rows without any left:
spill that the robot looked at long enough not to believe it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel
from irsd.instances.blocks import SHIFT, key_at, place_in_block
from irsd.instances.settle import Limits, fair, worth
from irsd.instances.table import BITS, LOW, Index, enter_row
from irsd.instances.voxels import CLAIMS, NOBODY, Cells, Floats, Ints, Rows, take_row

Bytes = NDArray[np.uint8]

_PLACES = 1 << (3 * SHIFT)
_FINE = 4  # bits of a mean position within its voxel
_NEAR = 4  # bits of a small gap between occupied voxels; the largest value says that a long one follows
_LONG = 3 * SHIFT
_HEAD_BITS = 112  # rows, palette, widths (32 bits), three least values
_ROW_BYTES = 64  # no row needs more, its share of the palette included
_ID_BITS = 48


class Widths(NamedTuple):
    """Bits and least values of a block's columns. slot: number in the palette."""

    slot: int
    hits: int
    seen: int
    views: int
    least_hits: int
    least_seen: int
    least_views: int


class Opened(NamedTuple):
    """rows int32 [n] of a block that was unpacked, claim slots int32 [n, CLAIMS] (NOBODY = none), owned bool [n, CLAIMS]."""

    rows: Rows
    slots: Rows
    owned: NDArray[np.bool_]


# ---------------------------------------------------------------------------------------------------------------- bits
@kernel
def put(out: Bytes, at: int, value: int, bits: int) -> int:
    """Write the low bits of a value at a bit position of zeroed bytes; returns the next position."""
    while bits > 0:
        room = 8 - (at & 7)
        n = min(room, bits)
        out[at >> 3] |= np.uint8((value & ((1 << n) - 1)) << (at & 7))
        value >>= n
        at += n
        bits -= n
    return at


@kernel
def get(data: Bytes, at: int, bits: int) -> int:
    """The value of so many bits at a bit position."""
    value, done = 0, 0
    while done < bits:
        n = min(8 - (at & 7), bits - done)
        value |= ((int(data[at >> 3]) >> (at & 7)) & ((1 << n) - 1)) << done
        done += n
        at += n
    return value


@kernel
def bits_for(most: int) -> int:
    """Bits that hold 0..most."""
    bits = 0
    while most >> bits:
        bits += 1
    return bits


# -------------------------------------------------------------------------------------------------------------- packing
@kernel
def counts_for_more(cells: Cells, levels: Floats, row: int, claim: int, limits: Limits) -> bool:
    """Whether a claim is worth keeping: it could own its voxel, or speaks for merging."""
    slot = cells.owner[row, claim]
    if slot < 0:
        return False
    hits, seen = float(cells.hits[row, claim]), float(cells.seen[row, claim])
    return worth(hits, seen, levels[slot], limits) > 0 or fair(hits, seen, levels[slot], limits)


@kernel
def drop_thin(cells: Cells, levels: Floats, rows: Rows, limits: Limits) -> Rows:
    """Release the claims of rows that are not worth keeping; the rows that keep any."""
    out, n = np.empty(len(rows), np.int32), 0
    for row in rows:
        some = False
        for c in range(CLAIMS):
            if counts_for_more(cells, levels, row, c, limits):
                some = True
            else:
                cells.owner[row, c] = NOBODY
        if some:
            out[n] = row
            n += 1
    return out[:n]


@kernel
def palette_of(cells: Cells, rows: Rows, mark: Rows) -> Rows:
    """Slots int32 [p] that claim any of rows. mark: int32 [cap], NOBODY; gives the number of a slot in the palette, to be reset."""
    out, n = np.empty(len(mark), np.int32), 0
    for row in rows:
        for c in range(CLAIMS):
            slot = cells.owner[row, c]
            if slot >= 0 and mark[slot] < 0:
                mark[slot] = n
                out[n] = slot
                n += 1
    return out[:n]


@kernel
def widths_of(cells: Cells, rows: Rows, palette: Rows) -> Widths:
    low = np.full(3, 1 << 16, np.int64)
    high = np.zeros(3, np.int64)
    for row in rows:
        views = int(cells.views[row])
        low[2], high[2] = min(low[2], views), max(high[2], views)
        for c in range(CLAIMS):
            if cells.owner[row, c] >= 0:
                hits, seen = int(cells.hits[row, c]), int(cells.seen[row, c])
                low[0], high[0] = min(low[0], hits), max(high[0], hits)
                low[1], high[1] = min(low[1], seen), max(high[1], seen)
    return Widths(
        bits_for(max(len(palette) - 1, 0)),
        bits_for(high[0] - low[0]), bits_for(high[1] - low[1]), bits_for(high[2] - low[2]),
        int(low[0]), int(low[1]), int(low[2]),
    )  # fmt: skip


@kernel
def put_row(
    out: Bytes, at: int, cells: Cells, row: int, mark: Rows, owned: NDArray[np.uint8], w: Widths, per_m: float
) -> int:
    """One row without its key. owned: uint8 [R], bit c = the instance of claim c owns the row."""
    key = cells.key[row]
    for axis in range(3):
        corner = ((key >> (BITS * (2 - axis))) & LOW) - (1 << (BITS - 1))
        fine = int((np.float64(cells.point[row, axis]) * per_m - corner) * (1 << _FINE))
        at = put(out, at, min(max(fine, 0), (1 << _FINE) - 1), _FINE)
    at = put(out, at, int(cells.views[row]) - w.least_views, w.views)
    at = put(out, at, max(bits_for(int(cells.mass[row])) - 1, 0), 3)
    n = 0
    for c in range(CLAIMS):
        n += cells.owner[row, c] >= 0
    at = put(out, at, 1, 1) if n == 1 else put(out, at, 2 * n, 4)  # nearly all have one claim
    for c in range(CLAIMS):
        if cells.owner[row, c] >= 0:
            at = put(out, at, mark[cells.owner[row, c]], w.slot)
            at = put(out, at, int(cells.hits[row, c]) - w.least_hits, w.hits)
            at = put(out, at, int(cells.seen[row, c]) - w.least_seen, w.seen)
            at = put(out, at, (owned[row] >> c) & 1, 1)
    return at


@kernel
def pack_block(
    cells: Cells, ids: Ints, rows: Rows, mark: Rows, owned: NDArray[np.uint8], per_m: float, out: Bytes
) -> int:
    """Write the rows int32 [n] of one block into zeroed bytes; returns how many bytes it took. ids: int64 [cap] by slot."""
    at_place = np.full(_PLACES, -1, np.int32)
    for row in rows:
        at_place[place_in_block(cells.key[row])] = row
    palette = palette_of(cells, rows, mark)
    w = widths_of(cells, rows, palette)
    at = put(out, 0, len(rows), 16)
    at = put(out, at, len(palette), 16)
    at = put(out, at, w.slot | w.hits << 4 | w.seen << 9 | w.views << 14, 32)
    at = put(out, at, w.least_hits, 16)
    at = put(out, at, w.least_seen, 16)
    at = put(out, at, w.least_views, 16)
    for slot in palette:
        at = put(out, at, ids[slot], _ID_BITS)
    last = -1
    for place in range(_PLACES):
        row = at_place[place]
        if row < 0:
            continue
        gap, last = place - last - 1, place
        if gap < (1 << _NEAR) - 1:
            at = put(out, at, gap, _NEAR)
        else:
            at = put(out, at, (1 << _NEAR) - 1, _NEAR)
            at = put(out, at, gap, _LONG)
        at = put_row(out, at, cells, row, mark, owned, w, per_m)
    for slot in palette:
        mark[slot] = NOBODY
    return (at + 7) // 8


@kernel
def pack_all(
    cells: Cells,
    levels: Floats,
    ids: Ints,
    rows: Rows,
    offset: Ints,
    owned: NDArray[np.uint8],
    limits: Limits,
    per_m: float,
) -> tuple[Bytes, Ints]:
    """Pack blocks, the rows of each at offset[b]:offset[b + 1]: (bytes, offsets int64 [b + 1]); none where nothing is worth keeping.

    levels, ids: by slot; owned: see ``put_row``. Thin claims are released on the way.
    """
    mark = np.full(len(ids), NOBODY, np.int32)
    out = np.zeros(_ROW_BYTES * len(rows) + (len(offset) - 1) * (_HEAD_BITS // 8) + 1024, np.uint8)
    ends = np.zeros(len(offset), np.int64)
    for b in range(len(offset) - 1):
        kept = drop_thin(cells, levels, rows[offset[b] : offset[b + 1]], limits)
        size = pack_block(cells, ids, kept, mark, owned, per_m, out[ends[b] :]) if len(kept) else 0
        ends[b + 1] = ends[b] + size
    return out[: ends[-1]].copy(), ends


# ------------------------------------------------------------------------------------------------------------ unpacking
def read_palette(data: bytes) -> list[int]:
    """Ids of the instances that a packed block names."""
    first, size = _HEAD_BITS // 8, _ID_BITS // 8
    count = int.from_bytes(data[2:4], "little")
    return [int.from_bytes(data[at : at + size], "little") for at in range(first, first + count * size, size)]


@kernel
def unpack_block(
    data: Bytes,
    palette: Rows,
    block: int,
    index: Index,
    cells: Cells,
    counts: Ints,
    free: Rows,
    frame: int,
    per_m: float,
) -> Opened:
    """Give the voxels of a packed block rows again. palette: slots of those it names; frame: picture that they were last seen in."""
    n = get(data, 0, 16)
    bits = get(data, 32, 32)
    w_slot, w_hits, w_seen, w_views = bits & 15, (bits >> 4) & 31, (bits >> 9) & 31, (bits >> 14) & 31
    least_hits, least_seen, least_views = get(data, 64, 16), get(data, 80, 16), get(data, 96, 16)
    at = _HEAD_BITS + _ID_BITS * len(palette)
    rows, slots = np.empty(n, np.int32), np.full((n, CLAIMS), -1, np.int32)
    owned = np.zeros((n, CLAIMS), np.bool_)
    place = -1
    for r in range(n):
        gap = get(data, at, _NEAR)
        at += _NEAR
        if gap == (1 << _NEAR) - 1:
            gap = get(data, at, _LONG)
            at += _LONG
        place += gap + 1
        key = key_at(block, place)
        row = take_row(cells, counts, free, key)
        enter_row(index, key, row)
        rows[r] = row
        for axis in range(3):
            corner = ((key >> (BITS * (2 - axis))) & LOW) - (1 << (BITS - 1))
            cells.point[row, axis] = (corner + (get(data, at, _FINE) + 0.5) / (1 << _FINE)) / per_m
            at += _FINE
        cells.views[row] = get(data, at, w_views) + least_views
        at += w_views
        cells.mass[row] = 1 << get(data, at, 3)
        at += 3
        count = 1 if get(data, at, 1) == 1 else get(data, at + 1, 3)
        at += 1 if count == 1 else 4
        for c in range(count):
            slots[r, c] = palette[get(data, at, w_slot)]
            at += w_slot
            cells.hits[row, c] = get(data, at, w_hits) + least_hits
            at += w_hits
            cells.seen[row, c] = get(data, at, w_seen) + least_seen
            at += w_seen
            owned[r, c] = get(data, at, 1) == 1
            at += 1
            cells.owner[row, c] = slots[r, c]
        cells.frame[row] = frame
    return Opened(rows, slots, owned)
