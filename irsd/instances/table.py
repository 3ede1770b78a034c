"""Integer keys to numbers by open addressing, and the index of voxels that is made of it: pages of 4 x 4 x 4 voxels.

Neighbours in space lie side by side, in the table and in a page, so that a mask's look-ups stay in the cache; who stays within a page
needs no look-up at all.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel

EMPTY = 0  # the key of a corner 2^20 voxels away: never used; zero, so that fresh memory needs no filling
BITS = 21  # of a voxel's coordinate in its key
LOW = (1 << BITS) - 1
_PAGE = 64  # voxels of a page
_BLOCK = 64  # places of the table that the 4 x 4 x 4 keys of one block start from


class Index(NamedTuple):
    """table int32 [T]: 1 + page of a page's key; key int64 [P] by page, EMPTY = unused; row int32 [P, 64]: 1 + row of a voxel;
    held int32 [P]: rows of a page; free int32 [P]: stack of freed pages; counts int64 [2]: pages ever used, pages on the stack.
    """

    table: NDArray[np.int32]
    key: NDArray[np.int64]
    row: NDArray[np.int32]
    held: NDArray[np.int32]
    free: NDArray[np.int32]
    counts: NDArray[np.int64]


def new_table(bits: int) -> NDArray[np.int32]:
    """Open addressing: 1 + number int32 [2^bits] of a key, 0 = free; the keys themselves are kept by number."""
    return np.zeros(1 << bits, np.int32)


def new_index(pages: int, *, touch: bool = False) -> Index:
    """An empty index with room for so many pages. touch: see ``new_cells``."""
    bits = max(int(np.ceil(np.log2(2 * pages))), 8)
    row = np.zeros((pages, _PAGE), np.int32)
    if touch:
        row[:] = 0
    return Index(
        new_table(bits), np.zeros(pages, np.int64), row, np.zeros(pages, np.int32), np.zeros(pages, np.int32), np.zeros(2, np.int64)
    )  # fmt: skip


def grown(old: Index, pages: int) -> Index:
    """The same index with room for more pages."""
    new = new_index(pages)
    for name in ("key", "row", "held", "free", "counts"):
        getattr(new, name)[: len(getattr(old, name))] = getattr(old, name)
    refill(new.table, new.key)
    return new


# ------------------------------------------------------------------------------------------------------------ kernels
@kernel
def home(key: int, places: int) -> int:
    """Where a key's search starts: hash of its 4 x 4 x 4 block, then its own place within."""
    i, j, k = key >> (2 * BITS), (key >> BITS) & LOW, key & LOW
    block = np.uint64(((i >> 2) << 42) | ((j >> 2) << 21) | (k >> 2))
    block = (block ^ (block >> np.uint64(31))) * np.uint64(0x9E3779B97F4A7C15)
    block = (block ^ (block >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
    start = np.int64((block >> np.uint64(32)) & np.uint64(places // _BLOCK - 1)) * _BLOCK
    # Within the block's places shuffled by its hash: the same plane of two blocks (a floor, a table) must not meet itself.
    own = (((i & 3) << 4) | ((j & 3) << 2) | (k & 3)) ^ np.int64(block & np.uint64(_BLOCK - 1))
    return int(start) + int(own)


@kernel
def find_key(table: NDArray[np.int32], keys: NDArray[np.int64], key: int) -> int:
    """Number of a key, -1 where it has none. keys: int64 [R] by number."""
    places = len(table)
    at = home(key, places)
    while True:
        row = table[at] - 1
        if row < 0 or keys[row] == key:
            return int(row)
        at = (at + 1) & (places - 1)


@kernel
def enter_key(table: NDArray[np.int32], key: int, row: int) -> None:
    places = len(table)
    at = home(key, places)
    while table[at] > 0:
        at = (at + 1) & (places - 1)
    table[at] = row + 1


@kernel
def drop_key(table: NDArray[np.int32], keys: NDArray[np.int64], key: int) -> None:
    """Take a key out and close the gap, so that no search that passed it ends early."""
    places = len(table)
    at = home(key, places)
    while table[at] == 0 or keys[table[at] - 1] != key:
        if table[at] == 0:
            return
        at = (at + 1) & (places - 1)
    gap = at
    while True:
        at = (at + 1) & (places - 1)
        if table[at] == 0:
            break
        start = home(keys[table[at] - 1], places)
        if ((at - start) & (places - 1)) >= ((at - gap) & (places - 1)):
            table[gap] = table[at]
            gap = at
    table[gap] = 0


@kernel
def refill(table: NDArray[np.int32], keys: NDArray[np.int64]) -> None:
    """Enter all keys in use into an empty table."""
    for row in range(len(keys)):
        if keys[row] != EMPTY:
            enter_key(table, keys[row], row)


@kernel
def page_of(key: int) -> int:
    """Key of the page that holds a voxel."""
    i, j, k = key >> (2 * BITS), (key >> BITS) & LOW, key & LOW
    return ((i >> 2) << (2 * BITS)) | ((j >> 2) << BITS) | (k >> 2)


@kernel
def spot_of(key: int) -> int:
    """A voxel's number within its page."""
    return (((key >> (2 * BITS)) & 3) << 4) | (((key >> BITS) & 3) << 2) | (key & 3)


@kernel
def find_page(index: Index, page_key: int) -> int:
    """Number of a page by its key, -1 where it has none."""
    return find_key(index.table, index.key, page_key)


@kernel
def find_row(index: Index, key: int) -> int:
    """Row of a voxel by its key, -1 where it has none."""
    page = find_page(index, page_of(key))
    return int(index.row[page, spot_of(key)]) - 1 if page >= 0 else -1


@kernel
def take_page(index: Index, page_key: int) -> int:
    """A page for a key that has none."""
    counts = index.counts
    if counts[1] > 0:
        counts[1] -= 1
        page = int(index.free[counts[1]])
    else:
        page = int(counts[0])
        counts[0] += 1
    index.key[page] = page_key
    enter_key(index.table, page_key, page)
    return page


@kernel
def enter_row(index: Index, key: int, row: int) -> None:
    """Note the row of a voxel that had none."""
    page_key = page_of(key)
    page = find_page(index, page_key)
    if page < 0:
        page = take_page(index, page_key)
    index.row[page, spot_of(key)] = row + 1
    index.held[page] += 1


@kernel
def drop_row(index: Index, page: int, key: int) -> None:
    """Forget the row of a voxel of a page, and the page with its last one."""
    index.row[page, spot_of(key)] = 0
    index.held[page] -= 1
    if index.held[page] == 0:
        drop_key(index.table, index.key, index.key[page])
        index.key[page] = EMPTY
        index.free[index.counts[1]] = page
        index.counts[1] += 1
