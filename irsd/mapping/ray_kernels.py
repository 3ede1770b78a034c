"""Compiled kernels of the sliced occupancy grid: mark what one scan hit and passed, then add it to the log-odds.

A scan counts once per cell and layer, and a return wins over rays that pass: marks, one bit per layer, are made first; the odds
change after.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel

Marks = NDArray[np.uint32]  # by cell of the window; bit l stands for layer l
Bits = NDArray[np.uint32]  # the layer's bit (0: none) of every centimetre of height


class Window(NamedTuple):
    """The part of the grid that a scan can touch: cells (of the grid) and, float32, its corner in metres and cells per metre.

    base_m: height at which the table of layer bits starts.
    """

    row: int
    col: int
    height: int
    width: int
    x_m: np.float32
    y_m: np.float32
    base_m: np.float32
    scale: np.float32


class Rays(NamedTuple):
    """How rays free cells: one in ``stride`` from ``first``, a sample each step_m up to range_m, ending before the return.

    A ray that ends on level surface (a bed, a table) skims it: it would free the slice (slice_m high) that it ends in over
    a long stretch, so it stops where it enters that slice.
    """

    first: int
    stride: int
    step_m: float
    range_m: float
    slice_m: float


class Steps(NamedTuple):
    """Log-odds steps and bounds; layers from ``slices`` on count sightings only."""

    hit: int
    passed: int
    lowest: int
    highest: int
    occupied: int
    slices: int


@kernel
def _place(window: Window, entries: int, x: np.float32, y: np.float32, z: np.float32) -> tuple[int, int, int]:
    """The window's (row, col) at a point, (-1, -1) outside, and the place of its height among the table's entries."""
    # One is added before truncation, so that what lies left of the window gives 0 and not -0.3 -> 0.
    col = np.int32((x - window.x_m) * window.scale + np.float32(1))
    row = np.int32((y - window.y_m) * window.scale + np.float32(1))
    step = np.int32((z - window.base_m) * np.float32(100))
    if 0 < col <= window.width and 0 < row <= window.height:
        return int(row) - 1, int(col) - 1, min(max(int(step), 0), entries - 1)
    return -1, -1, 0


@kernel
def mark_points(marks: Marks, window: Window, bits: Bits, points: NDArray[np.float32]) -> None:
    """Writes marks [h, w]: the cells that hold points [N, 3]."""
    for i in range(len(points)):
        row, col, step = _place(window, len(bits), points[i, 0], points[i, 1], points[i, 2])
        if row >= 0:
            marks[row, col] |= bits[step]


@kernel
def mark_rays(
    marks: Marks, window: Window, bits: Bits, origin: NDArray[np.float64],
    points: NDArray[np.float32], level: NDArray[np.bool_], rays: Rays,
) -> None:  # fmt: skip
    """Writes marks [h, w]: what the rays origin [3] -> points [N, 3] pass. level [N]: the point lies on level surface."""
    x0, y0, z0 = np.float32(origin[0]), np.float32(origin[1]), np.float32(origin[2])
    for i in range(rays.first, len(points), rays.stride):
        dx, dy, dz = points[i, 0] - origin[0], points[i, 1] - origin[1], points[i, 2] - origin[2]
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        short = 0.08
        if level[i]:
            short = max(rays.slice_m / max(abs(dz) / max(length, 1e-9), 1e-3), 0.08)
        divisor = max(length, 1e-9)
        sx = np.float32(dx / divisor * rays.step_m)
        sy = np.float32(dy / divisor * rays.step_m)
        sz = np.float32(dz / divisor * rays.step_m)
        for k in range(int(min(length - short, rays.range_m) / rays.step_m)):
            far = np.float32(k + 1)
            row, col, step = _place(window, len(bits), x0 + sx * far, y0 + sy * far, z0 + sz * far)
            if row >= 0:
                marks[row, col] |= bits[step]


@kernel
def mark_disc(marks: Marks, row: int, col: int, radius: int, layers: int) -> None:
    """Writes marks [h, w]: the lowest layers of the disc about cell (row, col)."""
    for r in range(max(row - radius, 0), min(row + radius + 1, marks.shape[0])):
        for c in range(max(col - radius, 0), min(col + radius + 1, marks.shape[1])):
            if (r - row) ** 2 + (c - col) ** 2 <= radius * radius:
                marks[r, c] |= np.uint32((1 << layers) - 1)


@kernel
def apply_marks(
    odds: NDArray[np.int8], hit: Marks, passed: Marks, window: Window, steps: Steps
) -> tuple[int, int, int, int]:
    """Writes odds [H, W, layers]; returns the box of the grid's cells whose class changed.

    The box is (lowest col, lowest row, highest col + 1, highest row + 1); (0, 0, 0, 0) if none did.
    """
    x0, y0, x1, y1 = odds.shape[1], odds.shape[0], 0, 0
    for r in range(window.height):
        for c in range(window.width):
            left = hit[r, c] | (passed[r, c] & np.uint32((1 << steps.slices) - 1))
            if left == 0:
                continue
            cell = odds[window.row + r, window.col + c]
            changed = False
            for layer in range(len(cell)):
                bit = np.uint32(1) << np.uint32(layer)
                if not left & bit:
                    continue
                before = int(cell[layer])
                after = before + (steps.hit if hit[r, c] & bit else -steps.passed)
                after = min(max(after, steps.lowest), steps.highest)
                cell[layer] = after
                changed |= (before >= steps.occupied) != (after >= steps.occupied) or (before < 0) != (after < 0)
                changed |= before == 0 and layer >= steps.slices
            if changed:
                x0, y0 = min(x0, window.col + c), min(y0, window.row + r)
                x1, y1 = max(x1, window.col + c + 1), max(y1, window.row + r + 1)
    return (x0, y0, x1, y1) if x1 else (0, 0, 0, 0)


@kernel
def summary(odds: NDArray[np.int8], low: int, body: int, layers: int) -> NDArray[np.int8]:
    """[3 + layers - body, H, W] of odds [H, W, 32]: least of the lowest ``low`` layers, least and greatest of the
    lowest ``body`` ones, then the layers above as they are."""
    height, width, _ = odds.shape
    words = odds.view(np.int64)  # most of the grid was never seen: four words tell
    planes = np.zeros((3 + layers - body, height, width), np.int8)
    for row in range(height):
        for col in range(width):
            if not (words[row, col, 0] | words[row, col, 1] | words[row, col, 2] | words[row, col, 3]):
                continue
            least = most = odds[row, col, 0]
            for layer in range(low):
                least = min(least, odds[row, col, layer])
            planes[0, row, col] = least
            for layer in range(body):
                least, most = min(least, odds[row, col, layer]), max(most, odds[row, col, layer])
            planes[1, row, col], planes[2, row, col] = least, most
            for layer in range(body, layers):
                planes[3 + layer - body, row, col] = odds[row, col, layer]
    return planes
