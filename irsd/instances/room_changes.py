"""Which things may have come into another room: those under which a cell of the plan changed hands. The rest need no look."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.types import Rooms
from irsd.instances.voxels import Floats

_MARGIN_M = 0.1  # points move within their voxels


def may_have_moved(before: Rooms | None, now: Rooms | None, boxes_xy: Floats) -> NDArray[np.bool_]:
    """bool [N] for plan boxes float32 [N, 4] (x0, y0, x1, y1): whether any cell in one belongs to another room now.

    Everything, where the grids can't be laid on each other cell by cell. Costs a comparison of the two grids, and O(1) a box.
    """
    if before is None or now is None or before.frame.resolution_m != now.frame.resolution_m:
        return np.ones(len(boxes_xy), np.bool_)
    resolution_m = now.frame.resolution_m
    shift = (np.array(before.frame.origin_xy_m) - now.frame.origin_xy_m) / resolution_m
    column, row = np.round(shift).astype(np.int64).tolist()
    height, width = before.labels.shape
    inside = row >= 0 and column >= 0 and row + height <= now.frame.height and column + width <= now.frame.width
    if np.abs(shift - (column, row)).max() > 1e-3 or not inside:
        return np.ones(len(boxes_xy), np.bool_)
    changed = now.labels != 0
    part = (slice(row, row + height), slice(column, column + width))
    changed[part] = now.labels[part] != before.labels
    rows, columns = np.flatnonzero(changed.any(1)), np.flatnonzero(changed.any(0))
    if not len(rows):
        return np.zeros(len(boxes_xy), np.bool_)
    window = changed[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    sums = cv2.integral(np.ascontiguousarray(window, np.uint8))
    low = now.frame.cells_of(boxes_xy[:, :2] - _MARGIN_M) - (rows[0], columns[0])
    high = now.frame.cells_of(boxes_xy[:, 2:] + _MARGIN_M) - (rows[0], columns[0]) + 1
    r0, c0 = np.clip(low, 0, window.shape).T
    r1, c1 = np.clip(high, 0, window.shape).T
    return np.asarray(sums[r1, c1] - sums[r0, c1] - sums[r1, c0] + sums[r0, c0] > 0)
