"""A room with a bay in one corner: no way to turn it looks the same, so that a robot can be found in it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def scan_of(x_m: float, y_m: float) -> NDArray[np.float32]:
    """A room of 6 x 5 x 2.6 m with a pillar-like bay in one corner, seen from (x, y), 1 m above its floor: map frame."""
    azimuth, elevation = np.meshgrid(np.linspace(-np.pi, np.pi, 360, False) + 1e-3, np.linspace(-0.6, 0.6, 32))
    ray = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)
    ray = ray.reshape(-1, 3)
    low, high = np.array([-3 - x_m, -2.5 - y_m, -1.0]), np.array([3 - x_m, 2.5 - y_m, 1.6])
    reach = np.where(ray > 0, high / ray, low / ray).min(-1)
    for side, start in (("x", 1.8 - x_m), ("y", 1.2 - y_m)):  # the bay: x > 1.8 and y > 1.2 is solid
        axis = 0 if side == "x" else 1
        with np.errstate(divide="ignore"):
            t = np.where(ray[:, axis] > 0, start / ray[:, axis], np.inf)
        other = ray[:, 1 - axis] * t + (y_m if axis == 0 else x_m)
        hit = (t > 0) & (other > (1.2 if axis == 0 else 1.8)) & (t < reach)
        reach = np.where(hit, t, reach)
    return (ray * reach[:, None] + [x_m, y_m, 1.0]).astype(np.float32)
