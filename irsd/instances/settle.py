"""Kernels that decide, on the evidence so far, which voxels an instance owns and with whom it shares; they write nothing shared.

A voxel counts for an instance when it lay in its mask in a fair share of the pictures that showed both (seen-through voxels
lose), and often enough for what is typical of that instance: the rim of masks spills over what lies behind, in every picture
somewhere else, so its evidence stays thin however long the robot looks, while that of the thing itself grows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel
from irsd.instances.associate import Things
from irsd.instances.voxels import CLAIMS, FULL, MOST, Cells, Floats, Ints, Rows

_HALF = 13  # neighbours of a cell in a half space
_MOST_OTHERS = 256  # neighbours of one instance that are looked at


class Limits(NamedTuple):
    """own: least share of the pictures that showed both; level, base: see ``least_hits``; floor: hits that a voxel has at least.

    plain: every claim owns (the paper's rule). ratio: share of pictures, fair: share of typical hits, from which a claim counts for
    merging.
    """

    own: float
    level: float
    base: float
    floor: float
    plain: bool
    ratio: float
    fair: float


class Settled(NamedTuple):
    """rows: those the instance claims now; owned: those it owns; typical: hits; good: voxels with good evidence.

    others int32 [k] slots that contest its rows, both int64 [k]: rows on which the two have good evidence for merging,
    touch int64 [k]: rows that both claim; mine: rows on which it has good evidence.
    """

    rows: Rows
    owned: Rows
    typical: float
    good: int
    others: Rows
    both: Ints
    touch: Ints
    mine: int

    def rivals(self) -> Rows:
        """Slots of those whose voxels it may take, or they its."""
        return self.others[self.both > 0]


@kernel
def least_hits(typical: float, limits: Limits) -> float:
    """Hits that spill does not reach: a share of what is typical, more of it where all is still few."""
    return limits.level * typical + min(limits.base * FULL, limits.level * typical)


@kernel
def worth(hits: float, seen: float, typical: float, limits: Limits) -> float:
    """Weight of a claim for owning its voxel: the share of its pictures, times that of what is typical; 0 when it has not enough."""
    if limits.plain:
        return hits
    if hits < limits.own * (seen + FULL) or hits < max(limits.floor * FULL, least_hits(typical, limits)):
        return 0.0
    return hits / (seen + FULL) * (hits / typical)


@kernel
def contest(hits: float, seen: float, typical: float, limits: Limits) -> float:
    """Weight of a claim against another's on its voxel: as to own it, but it need not have been seen for long.

    A small thing of few pictures does not hold all of its rim yet; what it is on must not have that instead.
    """
    if limits.plain:
        return hits
    if hits < limits.own * (seen + FULL) or hits < least_hits(typical, limits):
        return 0.0
    return hits / (seen + FULL) * (hits / max(typical, 1.0))


@kernel
def fair(hits: float, seen: float, typical: float, limits: Limits) -> bool:
    """Whether a claim counts for merging."""
    return limits.plain or (hits >= limits.ratio * (seen + FULL) and hits >= limits.fair * typical)


@kernel
def live_claims(owner: Rows, rows: Rows, ascending: int, slot: int) -> tuple[Rows, Rows]:
    """(rows without repetition, their claims) that a slot still holds; ascending. The first ``ascending`` rows are in order."""
    late = np.sort(rows[ascending:])
    out, claims = np.empty(len(rows), np.int32), np.empty(len(rows), np.int32)
    n, last, a, b = 0, -1, 0, 0
    while a < ascending or b < len(late):
        if b == len(late) or (a < ascending and rows[a] <= late[b]):
            row = rows[a]
            a += 1
        else:
            row = late[b]
            b += 1
        if row == last:
            continue
        last = row
        for c in range(CLAIMS):
            if owner[row, c] == slot:
                out[n], claims[n] = row, c
                n += 1
    return out[:n], claims[:n]


@kernel
def settle(cells: Cells, things: Things, chunk: Rows, ascending: int, slot: int, limits: Limits) -> Settled:
    """Take stock of one instance. chunk: int32 [N] all rows it ever claimed, the first ``ascending`` in order. Reads only."""
    owner, all_hits, all_seen, levels, ids = cells.owner, cells.hits, cells.seen, things.level, things.id
    rows, claims = live_claims(owner, chunk, ascending, slot)
    total = squares = 0.0
    for k in range(len(rows)):
        hits = float(all_hits[rows[k], claims[k]])
        total += hits
        squares += hits * hits
    typical = squares / total if total > 0 else 0.0
    owned = np.empty(len(rows), np.int32)
    others, both = np.empty(_MOST_OTHERS, np.int32), np.zeros(_MOST_OTHERS, np.int64)
    touch = np.zeros(_MOST_OTHERS, np.int64)
    n_owned = n_others = good = mine = 0
    for k in range(len(rows)):
        row = rows[k]
        hits, seen = float(all_hits[row, claims[k]]), float(all_seen[row, claims[k]])
        weight, counts = worth(hits, seen, typical, limits), fair(hits, seen, typical, limits)
        good += weight > 0
        mine += counts
        best = weight > 0
        for c in range(CLAIMS):
            other = owner[row, c]
            if other < 0 or other == slot:
                continue
            hits, seen = float(all_hits[row, c]), float(all_seen[row, c])
            rival = contest(hits, seen, levels[other], limits)
            if not limits.plain and (rival > weight or (rival == weight and ids[other] < ids[slot])):
                best = False
            meet = counts and fair(hits, seen, levels[other], limits)
            at = 0
            while at < n_others and others[at] != other:
                at += 1
            if at < _MOST_OTHERS:
                others[at] = other
                n_others = max(n_others, at + 1)
                both[at] += meet
                touch[at] += 1
        if best:
            owned[n_owned] = row
            n_owned += 1
    k = n_others
    return Settled(
        rows, owned[:n_owned].copy(), typical, good, others[:k].copy(), both[:k].copy(), touch[:k].copy(), mine
    )


@kernel
def absorb(cells: Cells, rows: Rows, kept: int, gone: int) -> None:
    """All claims of ``gone`` in rows become those of ``kept``."""
    for row in rows:
        mine = his = -1
        for c in range(CLAIMS):
            if cells.owner[row, c] == kept:
                mine = c
            elif cells.owner[row, c] == gone:
                his = c
        if his >= 0 and mine >= 0:
            cells.hits[row, mine] = min(int(cells.hits[row, mine]) + int(cells.hits[row, his]), MOST)
            cells.seen[row, mine] = min(int(cells.seen[row, mine]) + int(cells.seen[row, his]), MOST)
            cells.owner[row, his] = -1
            cells.hits[row, his] = 0
        elif his >= 0:
            cells.owner[row, his] = kept


@kernel
def release(cells: Cells, rows: Rows, slot: int) -> None:
    """Give up all claims of a slot in rows."""
    for row in rows:
        for c in range(CLAIMS):
            if cells.owner[row, c] == slot:
                cells.owner[row, c] = -1
                cells.hits[row, c] = 0
                cells.seen[row, c] = 0


@kernel
def root_of(parent: Ints, k: int) -> int:
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = int(parent[k])
    return k


@kernel
def connected_parts(points: Floats, link_m: float) -> Ints:
    """Part number int64 [n] of points [n, 3]: cells of edge link_m that touch (26 neighbours) belong together."""
    n = len(points)
    part = np.zeros(n, np.int64)
    if n == 0:
        return part
    per_m = 1.0 / link_m
    places = 64
    while places < 2 * n:
        places *= 2
    keys, numbers = np.full(places, -1, np.int64), np.zeros(places, np.int64)
    cell_of, cells, used = np.empty(n, np.int64), np.empty(n, np.int64), 0
    last_key, at = -1, 0
    for p in range(n):
        i = int(np.floor(np.float64(points[p, 0]) * per_m)) + (1 << 20)
        j = int(np.floor(np.float64(points[p, 1]) * per_m)) + (1 << 20)
        k = int(np.floor(np.float64(points[p, 2]) * per_m)) + (1 << 20)
        key = (i << 42) | (j << 21) | k
        if key != last_key:
            at = cell_place(keys, key)
            last_key = key
        if keys[at] < 0:
            keys[at], numbers[at] = key, used
            cells[used] = key
            used += 1
        cell_of[p] = numbers[at]
    parent = np.arange(used)
    for a in range(used):
        for step in range(_HALF):
            s = step + 14  # of the 27 steps of -1..1, those after the middle one
            key = cells[a] + ((s // 9 - 1) << 42) + (((s // 3) % 3 - 1) << 21) + (s % 3 - 1)
            at = cell_place(keys, key)
            if keys[at] >= 0:
                one, two = root_of(parent, a), root_of(parent, numbers[at])
                parent[max(one, two)] = min(one, two)
    names, found = np.full(used, -1, np.int64), 0
    for p in range(n):
        root = root_of(parent, cell_of[p])
        if names[root] < 0:
            names[root] = found
            found += 1
        part[p] = names[root]
    return part


@kernel
def cell_place(keys: Ints, key: int) -> int:
    """Where a key stands or would stand in an open addressing table; -1 marks a free place."""
    mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    at = np.int64(mixed >> np.uint64(20)) & (len(keys) - 1)
    while keys[at] >= 0 and keys[at] != key:
        at = (at + 1) & (len(keys) - 1)
    return int(at)


@kernel
def large_parts(points: Floats, link_m: float, share: float) -> NDArray[np.bool_]:
    """[n] True for points [n, 3] in connected parts that hold at least ``share`` of the largest part's points."""
    part = connected_parts(points, link_m)
    size = np.zeros(len(points) + 1, np.int64)
    for p in part:
        size[p] += 1
    least = share * size.max()
    keep = np.zeros(len(points), np.bool_)
    for p in range(len(points)):
        keep[p] = size[part[p]] >= least
    return keep


@kernel
def main_points(point: Floats, rows: Rows, link_m: float, share: float) -> Floats:
    """Points float32 [k, 3] of those rows that lie in large parts, see ``large_parts``. point: float32 [R, 3] by row."""
    points = np.empty((len(rows), 3), np.float32)
    for p in range(len(rows)):
        for axis in range(3):
            points[p, axis] = point[rows[p], axis]
    keep, n = large_parts(points, link_m, share), 0
    for p in range(len(rows)):
        if keep[p]:
            for axis in range(3):
                points[n, axis] = points[p, axis]
            n += 1
    return points if n == len(rows) else points[:n].copy()
