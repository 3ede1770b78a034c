"""What a camera can see, as a cheap test on points in its optical frame."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.types import CameraModel

_MARGIN = 0.02  # tangent units around the picture: poses and distortion models are never exact


@dataclass(frozen=True, slots=True)
class View:
    """Bounds of x/z and y/z (a pinhole), or for a fisheye the greatest angle from the axis (then the bounds are None)."""

    max_range_m: float
    bounds: tuple[float, float, float, float] | None
    max_angle_rad: float

    def holds(self, points: NDArray[np.floating], radius_m: float) -> NDArray[np.bool_]:
        """[N] True where a ball of radius_m about points [N, 3] (optical frame) may be in view."""
        x, y, z = np.asarray(points).T
        distance = np.sqrt(x * x + y * y + z * z)
        seen = distance <= self.max_range_m + radius_m
        if self.bounds is None:
            angle = np.arccos(np.clip(z / np.maximum(distance, 1e-6), -1, 1))
            slack = np.arcsin(np.clip(radius_m / np.maximum(distance, 1e-6), 0, 1))
            return np.asarray(seen & ((angle - slack <= self.max_angle_rad) | (distance <= radius_m)))
        left, top, right, bottom = self.bounds
        for coordinate, low, high in ((x, left, right), (y, top, bottom)):
            seen &= coordinate - low * z >= -radius_m * np.hypot(1, low)
            seen &= high * z - coordinate >= -radius_m * np.hypot(1, high)
        return np.asarray(seen & (z > -radius_m))


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
        return View(max_range_m, None, float(min(radius.max() * 1.1, np.pi)))
    coefficients = np.asarray(camera.distortion, np.float64)
    rays = cv2.undistortPoints(rim[:, None].copy(), matrix, coefficients if coefficients.size else None)[:, 0]
    low, high = rays.min(0) - _MARGIN, rays.max(0) + _MARGIN
    return View(max_range_m, (float(low[0]), float(low[1]), float(high[0]), float(high[1])), np.pi / 2)
