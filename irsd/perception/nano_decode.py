"""From the segmenter's heads, the map and the colours to masks: nested regions of like cells, judged, the best kept. Pure kernels.

Neighbouring cells are joined where they point at the same middle, no border is said to lie between, and neither depth nor colour steps
(Felzenszwalb & Huttenlocher, IJCV 2004), at several scales; a second hierarchy looks at depth and colour alone. So masks end at depth
edges. Parts of the map that stand alone are regions, too. Each region is measured, a small perceptron says how likely it is one thing,
and the most likely that are not over one another stay. Cells: ROWS x COLUMNS of the picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel
from irsd.core.types import Structure
from irsd.perception.nano_map import COLUMNS, ROWS

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]
Layers = tuple[tuple[Floats, Floats], ...]  # weights [in, out] and biases [out]
OFFSET_CELLS = 16.0  # an offset of 1 is so many cells
MEASURES = 19
# What a step between neighbours weighs: vote (per 8 cells), border, colour, depth, thing; and the scales of the regions.
HIERARCHIES = (((1.0, 1.0, 0.4, 1.0, 1.0), (3.0, 8.0, 20.0, 50.0)), ((0.0, 0.2, 0.7, 2.0, 0.3), (6.0, 20.0, 60.0)))
_LEAST_CELLS, _MOST_CELLS = 12, 15_000
_LEAST_THING = 0.2  # mean chance of a region that is looked at


@dataclass(frozen=True, slots=True)
class Regions:
    """Regions of several partitions: label int32 [P, ROWS, COLUMNS], their numbers over all partitions, -1 where none is worth a look;
    measures float32 [n, MEASURES]; partition int32 [n], where each is drawn; cells int32 [n], how many."""

    label: Ints
    measures: Floats
    partition: Ints
    cells: Ints


def regions_of(heads: Floats, parts: Floats, map_: Floats, colour: Floats, alone: Ints) -> Regions:
    """Regions that may be things. heads: float32 [5, ROWS, COLUMNS] (thing, border, middle as logits; offset); parts: float32
    [6, ROWS, COLUMNS], logits of ``Structure``; map_: float32 [3, ROWS, COLUMNS] of ``nano_map``; colour: float32 [ROWS, COLUMNS, 3],
    0..255; alone: int32 [ROWS, COLUMNS], 1, 2 .. where parts of the map that stand alone are in sight, 0 elsewhere."""
    chance = chances(heads, parts)
    down, across = np.mgrid[:ROWS, :COLUMNS].astype(np.float32)
    votes = np.stack([across + heads[3] * np.float32(OFFSET_CELLS), down + heads[4] * np.float32(OFFSET_CELLS)])
    found = _Found([], [], [], [])
    for weights, scales in HIERARCHIES:
        first, second, step = _steps(chance, votes, colour, map_[0], weights)
        order = np.argsort(step, kind="stable").astype(np.int32)
        for scale in scales:
            label, n = joined(first, second, step, order, scale)
            found.add(label, *measured(label, n, first, second, step, chance, votes, map_), 0)
    if alone.any():
        first, second, step = _steps(chance, votes, colour, map_[0], HIERARCHIES[0][0])
        label = alone.reshape(-1).astype(np.int32)
        found.add(label, *measured(label, int(label.max()) + 1, first, second, step, chance, votes, map_), 1)
    labels, measures = np.stack(found.labels), np.concatenate(found.measures)
    return Regions(labels, measures, np.concatenate(found.partitions), np.concatenate(found.cells))


def _steps(
    chance: Floats, votes: Floats, colour: Floats, inverse: Floats, weights: tuple[float, ...]
) -> tuple[Ints, Ints, Floats]:
    return steps_between(chance, votes, colour, inverse, np.array(weights, np.float32))


def chances(heads: Floats, parts: Floats) -> Floats:
    """float32 [5, ROWS, COLUMNS], 0..1: thing, border, middle; part of no structure; part of a door or a window."""
    own = 1 / (1 + np.exp(-np.clip(heads[:3], -30, 30)))
    share = np.exp(parts - parts.max(0))
    share /= share.sum(0)
    opening = share[Structure.DOOR] + share[Structure.WINDOW]
    return np.concatenate([own, share[Structure.OTHER][None], opening[None]]).astype(np.float32)


@dataclass(frozen=True, slots=True)
class _Found:
    """Regions as they are gathered, by partition."""

    labels: list[Ints]
    measures: list[Floats]
    partitions: list[Ints]
    cells: list[Ints]

    def add(self, label: Ints, measures: Floats, size: Ints, least: int) -> None:
        """The regions of one partition label [cells] that are worth a look, of number ``least`` and above."""
        usable = (size >= _LEAST_CELLS) & (size <= _MOST_CELLS) & (measures[:, 0] > _LEAST_THING)
        rows = np.flatnonzero(usable)
        rows = rows[rows >= least]
        number = np.full(len(size), -1, np.int32)
        number[rows] = sum(len(m) for m in self.measures) + np.arange(len(rows))
        self.partitions.append(np.full(len(rows), len(self.labels), np.int32))
        self.labels.append(number[label].reshape(ROWS, COLUMNS))
        self.measures.append(measures[rows])
        self.cells.append(size[rows])


def score_of(measures: Floats, layers: Layers) -> Floats:
    """The chance float32 [n] that a region is one thing, by a small perceptron over its measures [n, MEASURES]."""
    x = measures
    for k, (weight, bias) in enumerate(layers):
        x = np.asarray(x @ weight + bias, np.float32)
        x = np.maximum(x, 0) if k + 1 < len(layers) else x
    return np.asarray(1 / (1 + np.exp(-np.clip(x[:, 0], -30, 30))), np.float32)


def chosen(regions: Regions, scores: Floats, least_score: float, most_over: float) -> tuple[Ints, Floats]:
    """(cells int32 [ROWS, COLUMNS]: k + 1 where mask k lies, 0 where none; scores float32 [n], best first).

    Greedy: the best region first; one of which more than the share ``most_over`` is taken is left out, else it gets what is left.
    """
    order = np.argsort(-scores, kind="stable")
    order = order[scores[order] >= least_score]
    return pick(regions.label, regions.partition, regions.cells, order.astype(np.int32), scores, most_over)


# ------------------------------------------------------------------------------------------------ kernels
@kernel
def steps_between(
    chance: Floats, votes: Floats, colour: Floats, inverse: Floats, weights: Floats
) -> tuple[Ints, Ints, Floats]:
    """(first, second int32 [E], step float32 [E]) of all pairs of cells side by side or one above the other."""
    first, second = np.empty(2 * ROWS * COLUMNS, np.int32), np.empty(2 * ROWS * COLUMNS, np.int32)
    step = np.empty(2 * ROWS * COLUMNS, np.float32)
    n = 0
    for r in range(ROWS):
        for c in range(COLUMNS):
            for k in range(2):
                y, x = (r, c + 1) if k == 0 else (r + 1, c)
                if y >= ROWS or x >= COLUMNS:
                    continue
                vote = np.hypot(votes[0, r, c] - votes[0, y, x], votes[1, r, c] - votes[1, y, x]) / 8
                tint = 0.0
                for i in range(3):
                    tint += abs(colour[r, c, i] - colour[y, x, i])
                low, high = min(inverse[r, c], inverse[y, x]), max(inverse[r, c], inverse[y, x])
                deep = 0.0 if low <= 0 else min(4 * (high - low) / high, 1.0)
                step[n] = (
                    weights[0] * vote
                    + weights[1] * max(chance[1, r, c], chance[1, y, x])
                    + weights[2] * min(tint / 90, 1.0)
                    + weights[3] * deep
                    + weights[4] * abs(chance[0, r, c] - chance[0, y, x])
                )
                first[n], second[n] = r * COLUMNS + c, y * COLUMNS + x
                n += 1
    return first[:n], second[:n], step[:n]


@kernel
def joined(first: Ints, second: Ints, step: Floats, order: Ints, scale: float) -> tuple[Ints, int]:
    """(label int32 [cells] 0.., how many): cells joined while the step is at most each side's largest inner step + scale / its size;
    what is too small then joins its nearest neighbour."""
    cells = ROWS * COLUMNS
    parent, size = np.arange(cells).astype(np.int32), np.ones(cells, np.int32)
    limit = np.full(cells, scale, np.float32)
    for sweep in range(2):
        for e in order:
            i, j = first[e], second[e]
            while parent[i] != i:
                parent[i] = parent[parent[i]]
                i = parent[i]
            while parent[j] != j:
                parent[j] = parent[parent[j]]
                j = parent[j]
            if i == j:
                continue
            near = step[e] <= limit[i] and step[e] <= limit[j]
            if near if sweep == 0 else min(size[i], size[j]) < _LEAST_CELLS:
                if size[i] < size[j]:
                    i, j = j, i
                parent[j] = i
                size[i] += size[j]
                limit[i] = step[e] + scale / size[i]
    label, number = np.empty(cells, np.int32), np.full(cells, -1, np.int32)
    n = 0
    for p in range(cells):
        i = p
        while parent[i] != i:
            i = parent[i]
        if number[i] < 0:
            number[i] = n
            n += 1
        label[p] = number[i]
    return label, n


@kernel
def measured(
    label: Ints, n: int, first: Ints, second: Ints, step: Floats, chance: Floats, votes: Floats, map_: Floats
) -> tuple[Floats, Ints]:
    """(measures float32 [n, MEASURES], cells int32 [n]) of the regions.

    Mean chance of a thing inside, and just outside; of a border inside, and along the edge; highest chance of a middle; logarithm of
    the cells; spread of its votes, and how far they lie from its middle, by its size; depth step along its edge; shares that are
    structure, and known; share of its box; whether it touches the picture's edge; length of its edge by its size; mean step inside,
    and along the edge; mean chance of no structure, and of a door or window; mean inverse depth where known.
    """
    size, box, total, peak = insides(label, n, chance, votes, map_)
    edge, inner = edges(label, n, first, second, step, chance, map_)
    out = np.zeros((n, MEASURES), np.float32)
    for k in range(n):
        cells = float(size[k])
        root, long = np.sqrt(cells), max(edge[k, 0], 1.0)
        x, y = total[k, 2] / cells, total[k, 3] / cells
        out[k, 0], out[k, 1] = total[k, 0] / cells, edge[k, 1] / long
        out[k, 2], out[k, 3] = total[k, 1] / cells, edge[k, 2] / long
        out[k, 4], out[k, 5] = peak[k], np.log(cells) / 4
        out[k, 6] = min(np.sqrt(max(total[k, 4] / cells - x * x - y * y, 0.0)) / root, 3.0)
        out[k, 7] = min(np.hypot(x - total[k, 5] / cells, y - total[k, 6] / cells) / root, 3.0)
        out[k, 8] = edge[k, 3] / long
        out[k, 9], out[k, 10] = total[k, 7] / cells, total[k, 8] / cells
        out[k, 11] = cells / ((box[k, 1] - box[k, 0] + 1) * (box[k, 3] - box[k, 2] + 1))
        touches = box[k, 0] == 0 or box[k, 1] == ROWS - 1 or box[k, 2] == 0 or box[k, 3] == COLUMNS - 1
        out[k, 12] = 1.0 if touches else 0.0
        out[k, 13] = min(long / root / 4, 4.0)
        out[k, 14], out[k, 15] = edge[k, 5] / max(inner[k], 1.0), min(edge[k, 4] / long, 3.0)
        out[k, 16], out[k, 17] = total[k, 9] / cells, total[k, 10] / cells
        out[k, 18] = total[k, 11] / max(total[k, 8], 1.0)
    return out, size


@kernel
def insides(
    label: Ints, n: int, chance: Floats, votes: Floats, map_: Floats
) -> tuple[Ints, Ints, NDArray[np.float64], Floats]:
    """Of each region: cells int32 [n]; box int32 [n, 4], first and last row and column; sums float64 [n, 12] of thing, border, votes
    across and down, their squares, columns, rows, structure, known, no structure, doors and windows, inverse depth; highest middle
    float32 [n]."""
    size, box = np.zeros(n, np.int32), np.empty((n, 4), np.int32)
    total = np.zeros((n, 12), np.float64)
    peak = np.zeros(n, np.float32)
    box[:, 0], box[:, 1], box[:, 2], box[:, 3] = ROWS, -1, COLUMNS, -1
    for p in range(ROWS * COLUMNS):
        k, r, c = label[p], p // COLUMNS, p % COLUMNS
        size[k] += 1
        x, y = float(votes[0, r, c]), float(votes[1, r, c])
        total[k, 0] += chance[0, r, c]
        total[k, 1] += chance[1, r, c]
        total[k, 2] += x
        total[k, 3] += y
        total[k, 4] += x * x + y * y
        total[k, 5] += c
        total[k, 6] += r
        total[k, 7] += map_[2, r, c]
        total[k, 8] += 1.0 if map_[1, r, c] > 0 else 0.0
        total[k, 9] += chance[3, r, c]
        total[k, 10] += chance[4, r, c]
        total[k, 11] += map_[0, r, c]
        peak[k] = max(peak[k], chance[2, r, c])
        box[k, 0], box[k, 1] = min(box[k, 0], r), max(box[k, 1], r)
        box[k, 2], box[k, 3] = min(box[k, 2], c), max(box[k, 3], c)
    return size, box, total, peak


@kernel
def edges(
    label: Ints, n: int, first: Ints, second: Ints, step: Floats, chance: Floats, map_: Floats
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of each region: float64 [n, 6], its edge's length and sums along it of the thing outside, border, depth step and step, and of
    the steps inside; pairs inside float64 [n]."""
    edge = np.zeros((n, 6), np.float64)
    inner = np.zeros(n, np.float64)
    for e in range(len(step)):
        a, b = first[e], second[e]
        i, j = label[a], label[b]
        if i == j:
            edge[i, 5] += step[e]
            inner[i] += 1
            continue
        ya, xa, yb, xb = a // COLUMNS, a % COLUMNS, b // COLUMNS, b % COLUMNS
        low, high = min(map_[0, ya, xa], map_[0, yb, xb]), max(map_[0, ya, xa], map_[0, yb, xb])
        deep = 0.0 if low <= 0 else min(4 * (high - low) / high, 1.0)
        border = max(chance[1, ya, xa], chance[1, yb, xb])
        edge[i, 1] += chance[0, yb, xb]
        edge[j, 1] += chance[0, ya, xa]
        for k in (i, j):
            edge[k, 0] += 1
            edge[k, 2] += border
            edge[k, 3] += deep
            edge[k, 4] += step[e]
    return edge, inner


@kernel
def pick(
    label: Ints, partition: Ints, cells: Ints, order: Ints, scores: Floats, most_over: float
) -> tuple[Ints, Floats]:
    """The greedy choice of ``chosen``: regions in their order, each unless too much of it is taken."""
    out, kept = np.zeros((ROWS, COLUMNS), np.int32), np.empty(len(order), np.float32)
    n = 0
    for k in order:
        p, taken = partition[k], 0
        for r in range(ROWS):
            for c in range(COLUMNS):
                if label[p, r, c] == k and out[r, c] > 0:
                    taken += 1
        if taken > most_over * cells[k] or cells[k] - taken < _LEAST_CELLS:
            continue
        kept[n] = scores[k]
        n += 1
        for r in range(ROWS):
            for c in range(COLUMNS):
                if label[p, r, c] == k and out[r, c] == 0:
                    out[r, c] = n
    return out, kept[:n].copy()
