"""What a robot's LiDAR map holds of a thing: points on the sides that were seen, in voxels, with noise, bleed and gaps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irsd.sim.raycast import RayScene

VOXEL_M = 0.04


def surface(triangles: NDArray[np.float32], count: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """count points spread evenly over the triangles [T, 3, 3], float32 [count, 3]."""
    edge0, edge1 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    area = np.linalg.norm(np.cross(edge0, edge1), axis=1).astype(np.float64) + 1e-12
    chosen = np.searchsorted(np.cumsum(area) / area.sum(), rng.random(count)).clip(0, len(triangles) - 1)
    u, v = rng.random((2, count, 1)).astype(np.float32)
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    return triangles[chosen, 0] + u * edge0[chosen] + v * edge1[chosen]


def seen(triangles: NDArray[np.float32], mount: str, rng: np.random.Generator) -> NDArray[np.float32]:
    """Points float32 [n, 3] of a thing in the room's frame (z from the floor) as some robot poses saw it; may be empty."""
    points = surface(triangles, 6000, rng)
    scene = RayScene(triangles)
    middle = points.mean(0)
    size = float(np.ptp(points[:, :2], axis=0).max())
    front_only = mount == "wall" or (mount != "ceiling" and rng.random() < 0.55)
    half = np.pi / 2 * rng.uniform(0.5, 0.95) if front_only else np.pi
    visible = np.zeros(len(points), bool)
    for _ in range(int(rng.integers(1, 6))):
        angle, far = rng.uniform(-half, half), size / 2 + rng.uniform(0.4, 3.5)
        eye = np.array(
            [middle[0] + far * np.cos(angle), middle[1] + far * np.sin(angle), rng.uniform(0.5, 1.1)], np.float32
        )
        ray = points - eye
        length = np.linalg.norm(ray, axis=1)
        hits = scene.cast(np.broadcast_to(eye, points.shape), ray / length[:, None])
        elevation = np.arcsin(np.clip(ray[:, 2] / length, -1, 1))
        inside = (elevation > np.deg2rad(-32)) & (elevation < np.deg2rad(55))
        visible |= (hits.range_m > length - 0.01) & inside
    points = points[visible]
    if rng.random() < 0.25 and len(points) > 20:  # something stands before it, or the robot never looked there
        direction = rng.normal(size=3)
        depth = points @ direction
        points = points[depth > np.quantile(depth, rng.uniform(0, 0.4))]
    return points


def measured(points: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """The points after range noise and voxels, float32 [m, 3]: one point for each voxel that holds any."""
    if not len(points):
        return points
    noisy = points + rng.normal(0, rng.choice([0.0, 0.005, 0.015]), points.shape)
    voxel = VOXEL_M * rng.choice([0.75, 1.0, 1.25])
    _, first = np.unique(np.floor(noisy / voxel).astype(np.int64), axis=0, return_index=True)
    return np.asarray(noisy[first], np.float32)


def placed(
    triangles: NDArray[np.float32], mount: str, bottom_m: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """The thing's triangles at a height where such things are, stretched a little along each axis."""
    stretch = rng.uniform(0.88, 1.12, 3).astype(np.float32)
    out = triangles * stretch
    if mount == "ceiling":
        out = out + np.array([0, 0, rng.uniform(2.35, 3.0)], np.float32)
    elif mount == "wall":
        out = out + np.array([0, 0, max(0.0, bottom_m * rng.uniform(0.85, 1.15))], np.float32)
    elif mount == "top":
        height = rng.choice([0.4, 0.5, 0.6, 0.74, 0.75, 0.9, 0.9, 1.2, 1.5]) if rng.random() < 0.6 else bottom_m
        out = out + np.array([0, 0, height * rng.uniform(0.9, 1.1)], np.float32)
    return np.asarray(out, np.float32)
