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
