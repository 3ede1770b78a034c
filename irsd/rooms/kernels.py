"""Compiled inner loops of room segmentation: rays in free space and between pieces of it. Coordinates are cells (x, y)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

WALL, CUT = 0, -1  # of a grid of pieces; pieces count from 1


@njit(cache=True)
def trace(
    dist: NDArray[np.float32], start: NDArray[np.float64], direction: NDArray[np.float64], limit: float
) -> NDArray[np.float64]:
    """How far rays run in free space, in cells: float64 [N], at most ``limit``.

    dist: clearance of free space [H, W]. Sphere tracing: a step never leaves the free disc around a cell's centre.
    """
    height, width = dist.shape
    length = np.zeros(len(start))
    for i in range(len(start)):
        run = 0.0
        while run < limit:
            x = int(np.rint(start[i, 0] + direction[i, 0] * run))
            y = int(np.rint(start[i, 1] + direction[i, 1] * run))
            if x < 0 or y < 0 or x >= width or y >= height:
                break
            here = dist[y, x]
            if here <= 0:
                break
            # A cell's clearance is measured from its centre, up to 0.71 cells from the ray.
            run += max(here - 1.0, 0.5)
        length[i] = min(run, limit)
    return length


@njit(cache=True)
def _run(
    piece: NDArray[np.int32], root: NDArray[np.int64], own: int, x: float, y: float, dx: float, dy: float, limit: float
) -> float:
    """Cells from (x, y) along (dx, dy) that belong to the region ``own`` or to cuts inside it, at most ``limit``."""
    height, width = piece.shape
    run, inside = 0.0, 0.0
    while run < limit:
        column, row = int(np.rint(x + dx * run)), int(np.rint(y + dy * run))
        if column < 0 or row < 0 or column >= width or row >= height:
            break
        here = piece[row, column]
        if here == WALL or (here != CUT and root[here] != own):
            break
        run += 1.0
        if here != CUT:
            inside = run
    return inside if run < limit else limit


@njit(cache=True)
def width_behind(
    piece: NDArray[np.int32],
    root: NDArray[np.int64],
    own: int,
    middle: NDArray[np.float64],
    tangent: NDArray[np.float64],
    hand: float,
    depths: NDArray[np.float64],
    limit: float,
) -> float:
    """Typical width of the region ``own`` behind a cut, across the cut's direction, in cells; 0 when there is nothing behind.

    piece: int32 [H, W], ``WALL``, ``CUT`` or a number; root[number]: the region that the piece belongs to. middle, tangent:
    float64 [2], of the cut; hand: +1 looks to its left, -1 to its right. depths: float64 [D] ascending, where it is measured.
    """
    nx, ny = -tangent[1] * hand, tangent[0] * hand
    reach = _run(piece, root, own, middle[0] + nx * 1.5, middle[1] + ny * 1.5, nx, ny, depths[-1]) + 1.5
    across = np.empty(len(depths))
    count = 0
    for depth in depths:
        if depth > reach:
            break
        x, y = middle[0] + nx * depth, middle[1] + ny * depth
        left = _run(piece, root, own, x, y, tangent[0], tangent[1], limit)
        right = _run(piece, root, own, x, y, -tangent[0], -tangent[1], limit)
        across[count] = max(left + right - 1.0, 0.0)
        count += 1
    if count == 0:
        return 0.0
    ordered = np.sort(across[:count])
    return float(ordered[(count - 1) // 2])


@njit(cache=True)
def piece_stats(
    piece: NDArray[np.int32], dist: NDArray[np.float32], count: int
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Of every piece 0 .. count: its cells, the diameter of the largest disc of free space around one of its cells, in cells, and
    how many of its cells touch a wall. piece: int32 [H, W]; dist: clearance of the whole space [H, W]."""
    cells, disc, rim = np.zeros(count + 1, np.int64), np.zeros(count + 1), np.zeros(count + 1)
    for row in range(piece.shape[0]):
        for column in range(piece.shape[1]):
            number = piece[row, column]
            if number <= 0:
                continue
            here = dist[row, column]
            cells[number] += 1
            disc[number] = max(disc[number], 2.0 * here)
            if here < 1.5:
                rim[number] += 1.0
    return cells, disc, rim


@njit(cache=True)
def in_reading_order(labels: NDArray[np.int32], count: int) -> NDArray[np.int32]:
    """Labels [H, W] of 0 .. count numbered by their first cell in row order, 0 stays."""
    number = np.zeros(count + 1, np.int32)
    out = np.zeros(labels.shape, np.int32)
    last = 0
    for row in range(labels.shape[0]):
        for column in range(labels.shape[1]):
            label = labels[row, column]
            if label == 0:
                continue
            if number[label] == 0:
                last += 1
                number[label] = last
            out[row, column] = number[label]
    return out


@njit(cache=True)
def overlap_table(old: NDArray[np.int32], new: NDArray[np.int32], high_old: int, high_new: int) -> NDArray[np.int64]:
    """int64 [high_old + 1, high_new + 1]: cells shared by each pair of labels of two label grids [H, W]."""
    table = np.zeros((high_old + 1, high_new + 1), np.int64)
    for row in range(old.shape[0]):
        for column in range(old.shape[1]):
            table[old[row, column], new[row, column]] += 1
    return table


@njit(cache=True)
def one_wall_pairs(
    normal: NDArray[np.float64],
    offset: NDArray[np.float64],
    span: NDArray[np.float64],
    tau_1: float,
    tau_2: float,
    thickness: float,
    gap: float,
) -> NDArray[np.int64]:
    """Pairs [K, 2] (i, j) of walls of which i, the shorter, lies beside the line of j within ``thickness``, faces the same way
    (cosine >= tau_2) and shares at least tau_1 of itself with j, or of the gap that a wall may have."""
    count = len(offset)
    found = np.empty((64, 2), np.int64)
    size = 0
    for i in range(count):
        half_i = (span[i, 1] - span[i, 0]) / 2
        middle = (span[i, 1] + span[i, 0]) / 2
        cx = normal[i, 0] * offset[i] - normal[i, 1] * middle
        cy = normal[i, 1] * offset[i] + normal[i, 0] * middle
        for j in range(count):
            cosine = normal[i, 0] * normal[j, 0] + normal[i, 1] * normal[j, 1]
            if cosine < tau_2 or i == j:
                continue
            half_j = (span[j, 1] - span[j, 0]) / 2
            if half_i > half_j or abs(normal[j, 0] * cx + normal[j, 1] * cy - offset[j]) > thickness:
                continue
            at = normal[j, 0] * cy - normal[j, 1] * cx
            low = max(at - half_i * abs(cosine), span[j, 0] - gap / 2)
            high = min(at + half_i * abs(cosine), span[j, 1] + gap / 2)
            # Pieces that continue each other share little; an overlap of part of the allowed gap joins them as well.
            shorter = min(max(2 * half_i, thickness), gap)
            if max(high - low, 0.0) < tau_1 * shorter:
                continue
            if size == len(found):
                found = np.concatenate((found, np.empty_like(found)))
            found[size, 0], found[size, 1] = i, j
            size += 1
    return found[:size]


@njit(cache=True)
def _same_ends(a: NDArray[np.float64], b: NDArray[np.float64], near: float) -> bool:
    """Whether both ends of two segments [2, 2] lie within ``near`` of each other, in either order."""
    for swap in range(2):
        good = True
        for end in range(2):
            other = end if swap == 0 else 1 - end
            good &= np.hypot(a[end, 0] - b[other, 0], a[end, 1] - b[other, 1]) < near
        if good:
            return True
    return False


@njit(cache=True)
def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """Whether the insides of two segments [2, 2] cross; ends up to a cell beyond the other do not."""
    ux, uy, vx, vy = a[1, 0] - a[0, 0], a[1, 1] - a[0, 1], b[1, 0] - b[0, 0], b[1, 1] - b[0, 1]
    size_a, size_b = np.hypot(ux, uy), np.hypot(vx, vy)
    one = (ux * (b[0, 1] - a[0, 1]) - uy * (b[0, 0] - a[0, 0])) / size_a
    two = (ux * (b[1, 1] - a[0, 1]) - uy * (b[1, 0] - a[0, 0])) / size_a
    three = (vx * (a[0, 1] - b[0, 1]) - vy * (a[0, 0] - b[0, 0])) / size_b
    four = (vx * (a[1, 1] - b[0, 1]) - vy * (a[1, 0] - b[0, 0])) / size_b
    apart = min(abs(one), abs(two)) > 1.0 and min(abs(three), abs(four)) > 1.0
    return bool(one * two < 0 and three * four < 0 and apart)


@njit(cache=True)
def choose_apart(ends: NDArray[np.float64], order: NDArray[np.int64], near: float) -> NDArray[np.int64]:
    """Of segments [N, 2, 2], taken in ``order`` [N], those that neither cross one taken before nor have the same two ends."""
    chosen = np.empty(len(order), np.int64)
    count = 0
    for i in order:
        free = True
        for k in range(count):
            if _cross(ends[i], ends[chosen[k]]) or _same_ends(ends[i], ends[chosen[k]], near):
                free = False
                break
        if free:
            chosen[count] = i
            count += 1
    return chosen[:count]


@njit(cache=True)
def any_same(ends: NDArray[np.float64], others: NDArray[np.float64], near: float) -> NDArray[np.bool_]:
    """[N] True for segments [N, 2, 2] with the same two ends as any of ``others`` [K, 2, 2]."""
    found = np.zeros(len(ends), np.bool_)
    for i in range(len(ends)):
        for k in range(len(others)):
            if _same_ends(ends[i], others[k], near):
                found[i] = True
                break
    return found


def warm_up() -> None:
    """Load (or compile) every kernel for the arrays it gets, so that no scan has to wait for that."""
    labels, dist = np.zeros((2, 2), np.int32), np.zeros((2, 2), np.float32)
    ends, point = np.ones((1, 2, 2)), np.ones(2)
    trace(dist, np.ones((1, 2)), np.ones((1, 2)), 1.0)
    width_behind(labels, np.zeros(1, np.int64), 0, point, point, 1.0, point, 1.0)
    piece_stats(labels, dist, 0)
    in_reading_order(labels, 1)
    overlap_table(labels, labels, 0, 0)
    one_wall_pairs(np.ones((1, 2)), np.ones(1), np.ones((1, 2)), 0.5, 0.5, 0.1, 0.1)
    choose_apart(ends, np.zeros(1, np.int64), 1.0)
    any_same(ends, ends, 1.0)
