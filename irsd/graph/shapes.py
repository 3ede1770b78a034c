"""Boxes of point clouds: pure kernels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Vector3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Box:
    """Extent of points [N, 3]: centroid, axis-aligned corners and the upright box of least footprint (metres, map frame).

    obb_size_m[0] >= obb_size_m[1] lie in the plan, obb_size_m[2] is the height; obb_yaw_rad in (-pi/2, pi/2] turns the
    x axis onto the longer side.
    """

    centroid_m: Vector3
    aabb_min_m: Vector3
    aabb_max_m: Vector3
    obb_center_m: Vector3
    obb_size_m: Vector3
    obb_yaw_rad: float

    @property
    def volume_m3(self) -> float:
        """Volume of the upright box, each side at least 1 cm: a picture on the wall is not nothing."""
        return math.prod(max(side, 0.01) for side in self.obb_size_m)


def box_of(points_map: NDArray[np.floating]) -> Box:
    """The box of points [N, 3], N >= 1. Raises ValueError without points."""
    points = np.asarray(points_map, np.float64)
    if not len(points):
        raise ValueError("no points, no box")
    low, high, mean = points.min(0), points.max(0), points.mean(0)
    # Single precision is what OpenCV computes in: take the far origin out first.
    (cx, cy), (width, depth), degrees = cv2.minAreaRect((points[:, :2] - low[:2]).astype(np.float32))
    if width < depth:
        width, depth, degrees = depth, width, degrees + 90.0
    yaw = math.radians((degrees + 90.0) % 180.0 - 90.0)
    return Box(
        centroid_m=_triple(mean),
        aabb_min_m=_triple(low),
        aabb_max_m=_triple(high),
        obb_center_m=(cx + float(low[0]), cy + float(low[1]), float(low[2] + high[2]) / 2),
        obb_size_m=(float(width), float(depth), float(high[2] - low[2])),
        obb_yaw_rad=math.pi / 2 if yaw == -math.pi / 2 else yaw,
    )


def _triple(values: NDArray[np.float64]) -> Vector3:
    return float(values[0]), float(values[1]), float(values[2])
