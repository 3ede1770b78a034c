"""What the shape encoder is given of a cloud: points along the sides of its smallest upright box, and its measures."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

MEASURES = 9
_THIN_M = 0.02  # thinner than a voxel means nothing


def aligned(points: NDArray[np.floating], seen: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Points [N, 3] (z from the floor, metres) to (float32 [N, 4], float32 [MEASURES]); seen: how many points there truly were.

    The four columns: short side, long side, height from the middle, height above the floor. Which way a side points is not
    told: training turns both at random. Measures: logarithms of short side, long side and height; lowest and highest z; logarithm
    of the count; the two ratios; the spread in the plan.
    """
    (cx, cy), (a, b), angle_deg = cv2.minAreaRect(np.ascontiguousarray(points[:, :2], np.float32))
    angle = np.deg2rad(angle_deg)
    turned = (points[:, :2] - (cx, cy)) @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    if a > b:
        turned, a, b = turned[:, ::-1], b, a
    low, high = float(points[:, 2].min()), float(points[:, 2].max())
    short, long, height = max(a, _THIN_M), max(b, _THIN_M), max(high - low, _THIN_M)
    columns = np.column_stack([turned, points[:, 2] - (low + high) / 2, points[:, 2]])
    extent = (np.log(short), np.log(long), np.log(height), low, high)
    shape = (np.log(max(seen, 1)) / 3, np.log(short / long), np.log(height / long), turned.std())
    measures = (*extent, *shape)
    return columns.astype(np.float32), np.array(measures, np.float32)
