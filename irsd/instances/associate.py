"""Kernels that match masks to instances by what they share in the voxel memory, the paper's two criteria among them.

A mask asks only its own voxels who lives there, so a query costs the mask's points, whatever the number of instances.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel
from irsd.instances.voxels import CLAIMS, FULL, Cells, Floats, Ints, Rows, Weights

_FEW = 5  # masks from which their spread about the mean is known
_LEAST_SPREAD = 0.02
NEVER = -1.0  # for what is not learned from masks
_LEAST_COVERED = 3  # voxels of an instance that a mask must cover to say anything about it


class Things(NamedTuple):
    """What the kernels need of instances, by slot.

    id int64 [cap] (0 = free slot); mean float32 [cap, D], sum of unit vectors; length float32 [cap] of it; dim int32 [cap]
    (0 = no meaning); level float32 [cap], typical hits of its voxels; size int32 [cap], voxels with good evidence; observations int32;
    expected float32 [cap], pictures that should have seen it; room int32 (0 = none); parted, whole int32: pictures in which
    several masks / one mask made it up; matches int32, likeness, likeness2 float32: how many masks were compared with the mean
    that stood before, the sum of their cosines and of the squares; used int32: last picture
    in which it was seen, missed or compared; column int32, scratch, NOBODY between calls.
    """

    id: Ints
    mean: Floats
    length: Floats
    dim: Rows
    level: Floats
    size: Rows
    observations: Rows
    expected: Floats
    room: Rows
    parted: Rows
    whole: Rows
    matches: Rows
    likeness: Floats
    likeness2: Floats
    used: Rows
    column: Rows


class Rules(NamedTuple):
    """The settings that matching needs, see ``FusionSettings``, and what the masks so far have taught of their meanings.

    usual_s: least cosine that masks have to what they show, as a rule, NEVER = tau_s is all that counts; truth: mean squared cosine of
    masks to what they show, NEVER = means are compared as they are.
    """

    tau_g: float
    tau_s: float
    tau_same: float
    ratio: float
    cover: float
    visible: float
    part: float
    shown: float
    known: float
    tau_merge: float
    level: float
    usual_s: float
    truth: float


class Match(NamedTuple):
    """slots int32 [m], NOBODY = none; missed int32 [k] slots that should have had a mask.

    pairs: int32 [q, 2], instances of one meaning that one mask covers together.
    """

    slots: Rows
    missed: Rows
    pairs: Rows


def new_things(capacity: int, dim: int) -> Things:
    def ints() -> Rows:
        return np.zeros(capacity, np.int32)

    def floats() -> Floats:
        return np.zeros(capacity, np.float32)

    return Things(
        np.zeros(capacity, np.int64), np.zeros((capacity, dim), np.float32), floats(), ints(), floats(), ints(), ints(),
        floats(), ints(), ints(), ints(), ints(), floats(), floats(), ints(), np.full(capacity, -1, np.int32),
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------------------ kernels
@kernel
def dot(a: Floats, b: Floats, n: int) -> float:
    """Sum of products in eight strands, always in the same order."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = np.float32(0.0)
    k = 0
    while k + 8 <= n:
        s0 += a[k] * b[k]
        s1 += a[k + 1] * b[k + 1]
        s2 += a[k + 2] * b[k + 2]
        s3 += a[k + 3] * b[k + 3]
        s4 += a[k + 4] * b[k + 4]
        s5 += a[k + 5] * b[k + 5]
        s6 += a[k + 6] * b[k + 6]
        s7 += a[k + 7] * b[k + 7]
        k += 8
    while k < n:
        s0 += a[k] * b[k]
        k += 1
    return float(((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7)))


@kernel
def is_good(hits: int, seen: int, level: float, rules: Rules) -> bool:
    """Whether a claim's evidence is a fair share of its pictures and of what is typical for its instance."""
    return hits >= rules.ratio * (seen + FULL) and hits >= rules.level * level


@kernel
def candidates(cells: Cells, things: Things, rows: Rows, rules: Rules) -> Rows:
    """Slots [c] with good claims in rows, by id; their ``column`` is set and must be reset by the caller."""
    owner, hits, seen, level, column = cells.owner, cells.hits, cells.seen, things.level, things.column
    found = np.empty(len(column), np.int32)
    n = 0
    for row in rows:
        for c in range(CLAIMS):
            slot = owner[row, c]
            if slot >= 0 and column[slot] < 0 and is_good(hits[row, c], seen[row, c], level[slot], rules):
                found[n] = slot
                column[slot] = n
                n += 1
    order = np.argsort(things.id[found[:n]])
    slots = found[:n][order]
    for k in range(n):
        column[slots[k]] = k
    return slots


@kernel
def share_counts(
    cells: Cells, things: Things, rows: Rows, weights: Weights, starts: Ints, shown: Rows, slots: Rows, rules: Rules
) -> tuple[NDArray[np.float32], Ints]:
    """(voxels float32 [m, c] that masks share with candidates, by their weights; visible int64 [c] voxels of each in the picture)."""
    owner, hits, seen, level, column = cells.owner, cells.hits, cells.seen, things.level, things.column
    shared = np.zeros((len(starts) - 1, len(slots)), np.float32)
    visible = np.zeros(len(slots), np.int64)
    for m in range(len(starts) - 1):
        for p in range(starts[m], starts[m + 1]):
            row, weight = rows[p], weights[p] * np.float32(1.0 / FULL)
            for c in range(CLAIMS):
                slot = owner[row, c]
                if slot >= 0 and column[slot] >= 0 and is_good(hits[row, c], seen[row, c], level[slot], rules):
                    shared[m, column[slot]] += weight
    for row in shown:
        for c in range(CLAIMS):
            slot = owner[row, c]
            if slot >= 0 and column[slot] >= 0 and is_good(hits[row, c], seen[row, c], level[slot], rules):
                visible[column[slot]] += 1
    return shared, visible


@kernel
def cosine_to(things: Things, slot: int, meaning: Floats, dim: int) -> float:
    """Cosine of a unit vector and an instance's mean; 0 where there is none or they come from different spaces."""
    if dim == 0 or things.dim[slot] != dim or things.length[slot] <= 1e-9:
        return 0.0
    return float(dot(meaning, things.mean[slot], dim) / things.length[slot])


@kernel
def usual_cosine(things: Things, slot: int, rules: Rules) -> float:
    """Least cosine that a mask of this instance has: tau_s, or more where all masks so far were closer to its mean."""
    n, tau_s = things.matches[slot], rules.tau_s
    if n < _FEW or rules.usual_s == NEVER:
        return max(tau_s, rules.usual_s)
    mean = things.likeness[slot] / n
    spread = np.sqrt(max(things.likeness2[slot] / n - mean * mean, 0.0))
    return float(max(tau_s, mean - 3.0 * max(spread, _LEAST_SPREAD)))


@kernel
def may_meet(rooms: Rows, room: int) -> bool:
    """rooms: int32 [k] those that a mask lies in, 0 = filler. A mask in no known room, or an instance of none, meets everything."""
    return room == 0 or rooms[0] == 0 or (rooms == room).any()


@kernel
def choose(
    things: Things,
    shared: Floats,
    visible: Ints,
    sizes: Floats,
    slots: Rows,
    meanings: Floats,
    dims: Rows,
    rooms: Rows,
    rules: Rules,
) -> Rows:
    """Slot [m] that each mask is an observation of, NOBODY = none. sizes: float32 [m] voxels of the masks, by their weights.

    A mask belongs to an instance when their overlap (shared part of the smaller of the two) >= tau_g and their cosine >= tau_s.
    Both masks and labels err: where the two are the same voxels (IoU >= tau_same over what the picture shows), a different
    name does not make it a different thing. Among several the largest IoU times cosine wins, the older among equals.
    """
    out = np.full(len(sizes), -1, np.int32)
    worths = np.zeros(len(sizes))
    tau_s = np.array([usual_cosine(things, slot, rules) for slot in slots])
    for m in range(len(sizes)):
        for c in range(len(slots)):
            both = shared[m, c]
            if both == 0 or not may_meet(rooms[m], things.room[slots[c]]):
                continue
            # What the picture does not show of it can't be missed, but its rim alone does not stand for the whole.
            known = max(float(visible[c]), rules.known * things.size[slots[c]])
            overlap = both / max(min(float(sizes[m]), known), 1.0)
            union = both / max(sizes[m] + visible[c] - both, 1)
            if overlap < rules.tau_g and union < rules.tau_same:
                continue
            cosine = cosine_to(things, slots[c], meanings[m], dims[m])
            if (overlap < rules.tau_g or cosine < tau_s[c]) and union < rules.tau_same:
                continue
            worth = union * (1.0 + max(cosine, 0.0))
            if worth > worths[m]:
                worths[m], out[m] = worth, slots[c]
    part_ways(things, out, worths, rules.part)
    return out


@kernel
def part_ways(things: Things, slots: Rows, worths: NDArray[np.float64], part: float) -> None:
    """Where an instance was made up of several masks in nearly all pictures, it is several things: only the best mask stays."""
    for m in range(len(slots)):
        slot = slots[m]
        if slot < 0 or things.parted[slot] < max(6.0, part * (things.parted[slot] + things.whole[slot])):
            continue
        for k in range(len(slots)):
            if k != m and slots[k] == slot and (worths[k] < worths[m] or (worths[k] == worths[m] and k > m)):
                slots[k] = -1


@kernel
def count_views(things: Things, shared: Floats, visible: Ints, slots: Rows, chosen: Rows, rules: Rules) -> Rows:
    """Count the picture for the instances that it shows well enough that they should have been detected, and how they were.

    Returns the slots of those that were not.
    """
    missed, n = np.empty(len(slots), np.int32), 0
    for c in range(len(slots)):
        slot = slots[c]
        masks, most = 0, np.float32(0.0)
        for m in range(len(chosen)):
            if chosen[m] == slot:
                masks += 1
                most = max(most, shared[m, c])
        if masks > 0 or visible[c] >= rules.visible * things.size[slot] > 0:
            things.expected[slot] += 1
            if masks == 0:
                missed[n] = slot
                n += 1
        if masks > 1:
            things.parted[slot] += 1
        elif masks == 1 and most >= 0.8 * visible[c]:
            things.whole[slot] += 1
    return missed[:n]


@kernel
def covered_pairs(things: Things, shared: Floats, visible: Ints, slots: Rows, rules: Rules) -> Rows:
    """Pairs [q, 2] of instances of one meaning that one mask covers together, lower id first."""
    n_slots = len(slots)
    pairs = np.empty((len(shared) * n_slots * max(n_slots - 1, 0) // 2, 2), np.int32)
    least = np.empty(n_slots)
    for c in range(n_slots):  # a few voxels of its rim in view say nothing about a thing
        least[c] = max(rules.cover * visible[c], rules.shown * things.size[slots[c]], _LEAST_COVERED)
    n = 0
    for m in range(len(shared)):
        for a in range(n_slots):
            if shared[m, a] < least[a]:
                continue
            for b in range(a + 1, n_slots):
                if shared[m, b] >= least[b] and alike(things, slots[a], slots[b], rules.truth) >= rules.tau_merge:
                    pairs[n, 0], pairs[n, 1] = slots[a], slots[b]
                    n += 1
    return pairs[:n]


@kernel
def likeness_of(things: Things, slot: int, truth: float) -> float:
    """Squared cosine of single observations to what they observe, from the length of their mean: 1 = no noise.

    As long as there are few it is taken to be the usual one, truth.
    """
    n = float(things.matches[slot] + 1)
    resultant = min(things.length[slot] / n, 1.0)
    return float(max((n * resultant * resultant - 1.0 + _FEW * truth) / (n - 1.0 + _FEW), 0.25))


@kernel
def alike(things: Things, a: int, b: int, truth: float) -> float:
    """Cosine of the meanings of two instances, freed from the noise of their means; 0 where they can't be compared."""
    if things.dim[a] == 0 or things.dim[a] != things.dim[b] or min(things.length[a], things.length[b]) <= 1e-9:
        return 0.0
    cosine = dot(things.mean[a], things.mean[b], things.dim[a]) / (things.length[a] * things.length[b])
    if truth == NEVER:
        return float(cosine)
    for slot in (a, b):
        n, q2 = float(things.matches[slot] + 1), likeness_of(things, slot, truth)
        cosine *= np.sqrt(1.0 + (1.0 - q2) / (q2 * n))
    return float(min(cosine, 1.0))


@kernel
def match(
    cells: Cells,
    things: Things,
    rows: Rows,
    weights: Weights,
    starts: Ints,
    shown: Rows,
    meanings: Floats,
    dims: Rows,
    rooms: Rows,
    rules: Rules,
) -> Match:
    """Which instance each mask is an observation of. rows, weights, starts: voxels of the masks; shown: all that the picture shows.

    meanings: float32 [m, D] unit vectors, dims: int32 [m] their length (0 = none); rooms: int32 [m, k].
    """
    slots = candidates(cells, things, shown, rules)
    shared, visible = share_counts(cells, things, rows, weights, starts, shown, slots, rules)
    for slot in slots:
        things.column[slot] = -1
    sizes = np.zeros(len(starts) - 1, np.float32)
    for m in range(len(sizes)):
        for p in range(starts[m], starts[m + 1]):
            sizes[m] += weights[p] * np.float32(1.0 / FULL)
    chosen = choose(things, shared, visible, sizes, slots, meanings, dims, rooms, rules)
    missed = count_views(things, shared, visible, slots, chosen, rules)
    return Match(chosen, missed, covered_pairs(things, shared, visible, slots, rules))


@kernel
def add_meanings(things: Things, slots: Rows, meanings: Floats, dims: Rows) -> None:
    """Each mask's unit vector into its instance's mean; a vector of another space starts anew."""
    for m in range(len(slots)):
        slot, dim = slots[m], dims[m]
        if dim == 0:
            continue
        if things.dim[slot] != dim:
            things.mean[slot] = 0
            things.dim[slot] = dim
        elif things.length[slot] > 1e-9:
            cosine = dot(meanings[m], things.mean[slot], dim) / things.length[slot]
            things.matches[slot] += 1
            things.likeness[slot] += cosine
            things.likeness2[slot] += cosine * cosine
        for k in range(dim):
            things.mean[slot, k] += meanings[m, k]
        things.length[slot] = np.sqrt(dot(things.mean[slot], things.mean[slot], dim))


@kernel
def rooms_of_masks(
    labels: NDArray[np.int32], x0: float, y0: float, per_m: float, points: Floats, offset: Ints, least: float
) -> Rows:
    """Rooms int32 [m, 4] that hold at least a share ``least`` of a mask's points each, 0 = filler; labels: int32 [H, W]."""
    out = np.zeros((len(offset) - 1, 4), np.int32)
    for m in range(len(out)):
        ids, votes, n, asked = np.zeros(16, np.int32), np.zeros(16, np.int64), 0, 0
        for p in range(offset[m], offset[m + 1], 4):  # every fourth point tells as much
            asked += 1
            row, col = int(np.floor((points[p, 1] - y0) * per_m)), int(np.floor((points[p, 0] - x0) * per_m))
            if not (0 <= row < labels.shape[0] and 0 <= col < labels.shape[1]) or labels[row, col] == 0:
                continue
            k = 0
            while k < n and ids[k] != labels[row, col]:
                k += 1
            if k < 16:
                ids[k] = labels[row, col]
                votes[k] += 1
                n = max(n, k + 1)
        found = 0
        for k in range(n):
            if votes[k] >= least * asked and found < 4:
                out[m, found] = ids[k]
                found += 1
    return out
