"""A* on a flat grid, compiled: the worst maze of a floor takes milliseconds. Called by ``route.find_path`` only."""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel

_DIAGONAL = 2.0**0.5


@kernel
def search(
    open_cell: NDArray[np.bool_], price: NDArray[np.float64], width: int, source: int, target: int
) -> NDArray[np.int64]:
    """Predecessor of each cell on the cheapest ways from source, -1 where none is known; good as far as target.

    open_cell: [H * W] with a closed ring round it, row after row; price: [H * W] half the cost of a cell. Ties are broken by the
    cells' numbers. The heuristic (octile distance) is consistent as a cell costs at least 1: what is expanded is final.
    """
    best = np.full(open_cell.size, np.inf)
    came = np.full(open_cell.size, -1, np.int64)
    done = np.zeros(open_cell.size, np.bool_)
    goal_row, goal_col = target // width, target % width
    best[source] = 0.0
    queue = [(0.0, source)]
    while len(queue) > 0:
        here = heapq.heappop(queue)[1]
        if here == target:
            return came
        if done[here]:
            continue
        done[here] = True
        for row in range(-1, 2):
            for col in range(-1, 2):
                step = row * width + col
                there = here + step
                if step == 0 or not open_cell[there] or done[there]:
                    continue
                length = 1.0
                if row != 0 and col != 0:
                    if not (open_cell[here + row * width] and open_cell[here + col]):  # the diagonal would cut a corner
                        continue
                    length = _DIAGONAL
                total = best[here] + length * (price[here] + price[there])
                if total < best[there]:
                    best[there] = total
                    came[there] = here
                    dr, dc = abs(there // width - goal_row), abs(there % width - goal_col)
                    heapq.heappush(queue, (total + max(dr, dc) + (_DIAGONAL - 1.0) * min(dr, dc), there))
    return came


def warm_up() -> None:
    """Compiles the search, or loads it: the first goal is then as quick as the others."""
    search(np.ones(9, np.bool_), np.full(9, 0.5), 3, 4, 4)
