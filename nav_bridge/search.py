"""The loops of ``route`` over cells, compiled: A* through the worst maze of a floor takes milliseconds, a line microseconds."""

from __future__ import annotations

import heapq
import math

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel

_DIAGONAL = 2.0**0.5
_SEEN, _DONE = 1, 2


@kernel
def search(
    open_cell: NDArray[np.bool_],
    cost: NDArray[np.float32],
    corner: tuple[int, int],
    source: tuple[int, int],
    target: tuple[int, int],
) -> NDArray[np.int64]:
    """Cheapest way [K, 2] through the open cells of a window [h, w] of a map, from source to target (row, col); [0, 2]: none.

    cost: [H, W] of the whole map, whose cell ``corner`` is the window's first. Source, target and way are cells of the window. Ties
    are broken by the cells' numbers. The heuristic (octile distance) is consistent as a cell costs at least 1: what is expanded is
    final.
    """
    height, width = open_cell.shape
    # Only what the search comes to is touched: a window may have millions of cells.
    best = np.empty(open_cell.size)
    came = np.empty(open_cell.size, np.int64)
    state = np.zeros(open_cell.size, np.uint8)
    first, last = source[0] * width + source[1], target[0] * width + target[1]
    best[first], came[first], state[first] = 0.0, -1, _SEEN
    queue = [(0.0, first)]
    while len(queue) > 0:
        here = heapq.heappop(queue)[1]
        if here == last:
            break
        if state[here] == _DONE:
            continue
        state[here] = _DONE
        row, col = here // width, here % width
        price = 0.5 * np.float64(cost[corner[0] + row, corner[1] + col])
        for r in range(max(row - 1, 0), min(row + 2, height)):
            for c in range(max(col - 1, 0), min(col + 2, width)):
                there = r * width + c
                if not open_cell[r, c] or state[there] == _DONE:
                    continue
                length = 1.0
                if r != row and c != col:
                    if not (open_cell[r, col] and open_cell[row, c]):  # the diagonal would cut a corner
                        continue
                    length = _DIAGONAL
                total = best[here] + length * (price + 0.5 * np.float64(cost[corner[0] + r, corner[1] + c]))
                if state[there] != _SEEN or total < best[there]:
                    best[there], came[there], state[there] = total, here, _SEEN
                    dr, dc = abs(r - target[0]), abs(c - target[1])
                    heapq.heappush(queue, (total + max(dr, dc) + (_DIAGONAL - 1.0) * min(dr, dc), there))
    if state[last] == 0:
        return np.empty((0, 2), np.int64)
    count, here = 0, last
    while here >= 0:
        count, here = count + 1, came[here]
    way, here = np.empty((count, 2), np.int64), last
    for k in range(count - 1, -1, -1):
        way[k, 0], way[k, 1] = here // width, here % width
        here = came[here]
    return way


@kernel
def least_clearance(
    clear_m: NDArray[np.float32],
    origin_xy_m: tuple[float, float],
    cell_m: float,
    a_xy: tuple[float, float],
    b_xy: tuple[float, float],
    aside: float,
) -> float:
    """Least of clear_m [H, W] along a segment and ``aside`` cells to its sides, a quarter of a cell apart; inf off the grid."""
    dx, dy = b_xy[0] - a_xy[0], b_xy[1] - a_xy[1]
    length = math.hypot(dx, dy)
    count = max(2, math.ceil(length / (0.25 * cell_m)) + 1)
    least = np.inf
    for side in (0.0, 1.0, -1.0):
        x = a_xy[0] - side * aside * cell_m * dy / max(length, 1e-9)
        y = a_xy[1] + side * aside * cell_m * dx / max(length, 1e-9)
        for k in range(count):
            along = k / (count - 1)
            row = math.floor((y + along * dy - origin_xy_m[1]) / cell_m)
            col = math.floor((x + along * dx - origin_xy_m[0]) / cell_m)
            if 0 <= row < clear_m.shape[0] and 0 <= col < clear_m.shape[1]:
                least = min(least, clear_m[row, col])
    return least


def warm_up() -> None:
    """Compiles the kernels, or loads them: the first goal is then as quick as the others."""
    search(np.ones((3, 3), np.bool_), np.ones((3, 3), np.float32), (0, 0), (1, 1), (2, 2))
    least_clearance(np.ones((3, 3), np.float32), (0.0, 0.0), 1.0, (0.5, 0.5), (2.5, 2.5), 0.2)
