"""The LiDAR map as a coarse picture, as our own pixel networks were trained on it: pure kernels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel
from irsd.perception.job import Sight

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]
ROWS, COLUMNS = 120, 160
_REACH = 10.0  # cells: a place farther from all map points is unknown
_MOST_INVERSE = 4.0  # 1/m
_PART_REACH = 3.0  # cells: the same for what part of the map a place shows


def map_picture(sight: Sight, hw: tuple[int, int]) -> Floats:
    """float32 [3, ROWS, COLUMNS] of a picture of (height, width) pixels: inverse depth (1/m, at most 4), how well it is known (1 at a
    map point, falling with the distance to the nearest, 0 out of reach), and whether that point is wall, floor or ceiling."""
    return draw_map(
        np.ascontiguousarray(sight.pixel.reshape(-1, 2), np.float32),
        np.ascontiguousarray(sight.depth_m, np.float32),
        np.ascontiguousarray(sight.structural, np.bool_),
        ROWS / hw[0],
        COLUMNS / hw[1],
    )


def alone_cells(sight: Sight, hw: tuple[int, int]) -> Ints:
    """int32 [ROWS, COLUMNS]: 1, 2 .. where parts of the map that stand alone are in sight (``Sight.part``), 0 elsewhere."""
    out = np.zeros((ROWS, COLUMNS), np.int32)
    if sight.part is None:
        return out
    index, away = draw_nearest(
        np.ascontiguousarray(sight.pixel.reshape(-1, 2), np.float32),
        np.ascontiguousarray(sight.depth_m, np.float32),
        ROWS / hw[0],
        COLUMNS / hw[1],
    )
    numbers = np.unique(sight.part[sight.part > 0])
    near = away <= _PART_REACH
    shown = sight.part[index[near]]
    out[near] = np.where(shown > 0, np.searchsorted(numbers, shown) + 1, 0)
    return out


@kernel
def draw_map(pixel: Floats, depth_m: Floats, structural: NDArray[np.bool_], down: float, across: float) -> Floats:
    """The picture of ``map_picture``. down, across: cells per pixel."""
    index, away = draw_nearest(pixel, depth_m, down, across)
    out = np.zeros((3, ROWS, COLUMNS), np.float32)
    for r in range(ROWS):
        for c in range(COLUMNS):
            if away[r, c] <= _REACH:
                k = index[r, c]
                out[0, r, c] = min(1.0 / depth_m[k], _MOST_INVERSE)
                out[1, r, c] = 1.0 / (1.0 + away[r, c])
                out[2, r, c] = 1.0 if structural[k] else 0.0
    return out


@kernel
def draw_nearest(pixel: Floats, depth_m: Floats, down: float, across: float) -> tuple[Ints, Floats]:
    """(row of the point that each cell shows int32 [ROWS, COLUMNS], how far it is away in cells float32 of that size, 1e9 where none).

    Each cell takes the nearest map point in it, an empty one that of the nearest cell with one (two passes of a chamfer distance,
    Borgefors 1986).
    """
    depth = np.full((ROWS, COLUMNS), np.inf, np.float32)
    index = np.zeros((ROWS, COLUMNS), np.int32)
    for k in range(len(depth_m)):
        row, column = int(np.floor((pixel[k, 1] + 0.5) * down)), int(np.floor((pixel[k, 0] + 0.5) * across))
        if 0 <= row < ROWS and 0 <= column < COLUMNS and 0 < depth_m[k] < depth[row, column]:
            depth[row, column] = depth_m[k]
            index[row, column] = k
    away = np.where(np.isfinite(depth), np.float32(0), np.float32(1e9))
    for sweep in range(2):
        sign = 1 if sweep == 0 else -1
        for i in range(ROWS):
            r = i if sweep == 0 else ROWS - 1 - i
            for j in range(COLUMNS):
                c = j if sweep == 0 else COLUMNS - 1 - j
                for dr, dc, cost in ((-1, -1, 1.4), (-1, 0, 1.0), (-1, 1, 1.4), (0, -1, 1.0)):
                    y, x = r + sign * dr, c + sign * dc
                    if 0 <= y < ROWS and 0 <= x < COLUMNS and away[y, x] + cost < away[r, c]:
                        away[r, c] = away[y, x] + np.float32(cost)
                        index[r, c] = index[y, x]
    return index, away
