"""The outline of one room in a label grid as a polygon in map coordinates."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame


def outline(labels: NDArray[np.int32], number: int, frame: GridFrame, tolerance_m: float) -> NDArray[np.float64]:
    """Polygon [K, 2] metres, counter-clockwise, not closed, around the largest part of label ``number``.

    It runs along the outer edges of the cells, simplified by at most ``tolerance_m``. Raises ValueError when there is no such cell.
    """
    mask = labels == number
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        raise ValueError(f"no cell has label {number}")
    top, left = rows[0], columns[0]
    part = mask[top : rows[-1] + 1, left : columns[-1] + 1].astype(np.uint8)
    # Twice the resolution, so that the outline of cell centres lies a quarter of a cell from the cells' edges.
    fine = np.kron(part, np.ones((2, 2), np.uint8))
    contours, _ = cv2.findContours(fine, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest = max(contours, key=cv2.contourArea)
    points = largest[:, 0].astype(np.float64)
    if len(points) >= 3:
        simple = cv2.approxPolyDP(largest, 2 * tolerance_m / frame.resolution_m, True)[:, 0].astype(np.float64)
        points = simple if len(simple) >= 3 else points
    if len(points) < 3:
        low, high = points.min(0), points.max(0)
        points = np.array([low, [high[0] + 1, low[1]], high + 1, [low[0], high[1] + 1]])
    cells = (points + 0.5) / 2 + [left, top]
    polygon = cells * frame.resolution_m + np.array(frame.origin_xy_m)
    following = np.roll(polygon, -1, axis=0)
    turn = polygon[:, 0] * following[:, 1] - following[:, 0] * polygon[:, 1]
    return np.ascontiguousarray(polygon if turn.sum() > 0 else polygon[::-1])
