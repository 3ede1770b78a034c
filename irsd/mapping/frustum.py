"""What a camera can see, as a cheap test on points in its optical frame."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.geometry import Pose
from irsd.core.jit import kernel
from irsd.core.types import CameraModel
from irsd.mapping.kernels import BLOCK_EDGE, Ints, Singles, block_place

_MARGIN = 0.02  # tangent units around the picture: poses and distortion models are never exact


_NO_PLANE = (0.0, 0.0, 0.0)
_Plane = tuple[float, float, float]


class View(NamedTuple):
    """Five planes through the camera's centre (unit, facing inwards; zero for a fisheye), the greatest range and angle."""

    planes: tuple[_Plane, _Plane, _Plane, _Plane, _Plane]
    max_range_m: float
    max_angle_rad: float


@kernel
def in_view(view: View, x: float, y: float, z: float, radius_m: float) -> bool:
    """Whether a ball about a point (optical frame) may be in view."""
    distance = np.sqrt(x * x + y * y + z * z)
    if distance > view.max_range_m + radius_m:
        return False
    for a, b, c in view.planes:
        if a * x + b * y + c * z < -radius_m:
            return False
    if view.max_angle_rad >= np.pi or distance <= radius_m:
        return True
    divisor = max(distance, 1e-6)
    angle, slack = np.arccos(min(max(z / divisor, -1.0), 1.0)), np.arcsin(min(radius_m / divisor, 1.0))
    return bool(angle - slack <= view.max_angle_rad)


@kernel
def rows_in_view(
    view: View, camera_T_map: Pose, blocks: Ints, index: NDArray[np.int32], mean: Singles, voxel_m: float
) -> NDArray[np.int32]:
    """Rows [K] of the voxels in view, block by block. blocks [B] packed keys (0 = none), index [B+, 512] rows + 1."""
    rows = np.empty(len(blocks) * index.shape[1], np.int32)
    edge_m = BLOCK_EDGE * voxel_m
    count = 0
    for slot in range(len(blocks)):
        if blocks[slot] == 0:
            continue
        i, j, k = block_place(blocks[slot])
        x, y, z = _to_camera(camera_T_map, (i + 0.5) * edge_m, (j + 0.5) * edge_m, (k + 0.5) * edge_m)
        if not in_view(view, x, y, z, edge_m * np.sqrt(3) / 2):
            continue
        for local in range(index.shape[1]):
            row = index[slot, local] - 1
            if row >= 0:
                x, y, z = _to_camera(camera_T_map, mean[row, 0], mean[row, 1], mean[row, 2])
                if in_view(view, x, y, z, 0.0):
                    rows[count] = row
                    count += 1
    return rows[:count].copy()


@kernel
def _to_camera(pose: Pose, x: float, y: float, z: float) -> tuple[float, float, float]:
    return (
        pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3],
        pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3],
        pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3],
    )


def view_of(camera: CameraModel, max_range_m: float) -> View:
    """The view of a camera model, from the undistorted rim of its picture."""
    along = np.linspace(0, 1, 17)
    u, v = along * camera.width_px, along * camera.height_px
    zero = np.zeros_like(along)
    rim = np.concatenate(
        [
            np.stack([u, zero], -1),
            np.stack([u, zero + camera.height_px], -1),
            np.stack([zero, v], -1),
            np.stack([zero + camera.width_px, v], -1),
        ]
    )
    matrix = np.asarray(camera.matrix, np.float64)
    if camera.model == "equidistant":
        # theta grows with the radius (nearly theta = r / f); a tenth more covers the polynomial.
        radius = np.hypot((rim[:, 0] - matrix[0, 2]) / matrix[0, 0], (rim[:, 1] - matrix[1, 2]) / matrix[1, 1])
        return View((_NO_PLANE,) * 5, max_range_m, float(min(radius.max() * 1.1, np.pi)))
    coefficients = np.asarray(camera.distortion, np.float64)
    rays = cv2.undistortPoints(rim[:, None].copy(), matrix, coefficients if coefficients.size else None)[:, 0]
    low, high = rays.min(0) - _MARGIN, rays.max(0) + _MARGIN
    return View(
        (_plane(1, 0, -low[0]), _plane(-1, 0, high[0]), _plane(0, 1, -low[1]), _plane(0, -1, high[1]), _plane(0, 0, 1)),
        max_range_m,
        np.pi,
    )


def _plane(x: float, y: float, z: float) -> _Plane:
    length = float(np.sqrt(x * x + y * y + z * z))
    return float(x) / length, float(y) / length, float(z) / length
