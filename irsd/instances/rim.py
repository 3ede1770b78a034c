"""How surely the voxels of a mask belong to its thing: segmenters err along edges, so evidence is weak near the silhouette.

For masks that come as points alone. Where the mask is still pixels (``lift``), uncertain edges are left out before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel
from irsd.core.types import CameraView
from irsd.instances.voxels import FULL, Floats, Ints, Rows, Weights

_CELL_PX = 2.0  # of the raster in which distances are taken, at least
_SIDE = 64  # cells that a mask's raster is wide and high, at most
_FAR = np.float32(1e6)
_DIAGONAL = np.float32(1.4142135)


def rim_weights(
    view: CameraView, points: Floats, rows: Rows, starts: Ints, voxel_m: float, edge_px: float, edge_share: float
) -> Weights:
    """Evidence uint8 [P], of FULL, that voxels are inside their masks. points: float32 [R, 3] by row; rows [P], starts [m + 1]: masks.

    It rises from the silhouette inwards to full at edge_px, or at edge_share of the mask's half width where that is less.
    """
    k = view.camera.matrix
    camera = np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2], view.camera.width_px, view.camera.height_px], np.float64)
    return np.asarray(weigh(points, rows, starts, view.map_T_camera, camera, voxel_m, edge_px, edge_share))


@kernel
def weigh(
    points: Floats,
    rows: Rows,
    starts: Ints,
    map_T_camera: NDArray[np.float64],
    camera: NDArray[np.float64],
    voxel_m: float,
    edge_px: float,
    edge_share: float,
) -> Weights:
    """See ``rim_weights``. camera: fx, fy, cx, cy, width, height in pixels."""
    out = np.full(len(rows), FULL, np.uint8)
    most = 0
    for m in range(len(starts) - 1):
        most = max(most, starts[m + 1] - starts[m])
    uvr = np.empty((most, 3), np.float32)
    raster = np.empty((_SIDE + 2, _SIDE + 2), np.float32)
    for m in range(len(starts) - 1):
        first, count = starts[m], starts[m + 1] - starts[m]
        if count == 0 or not to_pixels(points, rows[first : first + count], map_T_camera, camera, voxel_m, uvr):
            continue
        u0, v0, u1, v1 = float(_FAR), float(_FAR), -float(_FAR), -float(_FAR)
        for p in range(count):
            u0, u1 = min(u0, float(uvr[p, 0])), max(u1, float(uvr[p, 0]))
            v0, v1 = min(v0, float(uvr[p, 1])), max(v1, float(uvr[p, 1]))
        cell = max(_CELL_PX, max(u1 - u0, v1 - v0) / (_SIDE - 2))
        wide, high = int((u1 - u0) / cell) + 1, int((v1 - v0) / cell) + 1
        draw(uvr[:count], u0, v0, cell, wide, high, raster)
        right, lower = float(camera[4]) - 1 - cell, float(camera[5]) - 1 - cell
        inside = (u0 < cell, v0 < cell, u1 > right, v1 > lower)
        half_width = spread_distance(raster, wide, high, inside) * cell
        band = max(min(edge_px, edge_share * half_width), 1e-3)
        for p in range(count):
            column, row = int((uvr[p, 0] - u0) / cell) + 1, int((uvr[p, 1] - v0) / cell) + 1
            share = min(float(raster[row, column]) * cell / band, 1.0)
            out[first + p] = np.uint8(max(int(share * FULL + 0.5), 1))
    return out


@kernel
def to_pixels(
    points: Floats,
    rows: Rows,
    map_T_camera: NDArray[np.float64],
    camera: NDArray[np.float64],
    voxel_m: float,
    uvr: Floats,
) -> bool:
    """Pixel and half size in pixels of voxels into uvr [n, 3]; False when one is not in front of the camera. Lenses are not undone."""
    t = map_T_camera
    for p in range(len(rows)):
        x = points[rows[p], 0] - t[0, 3]
        y = points[rows[p], 1] - t[1, 3]
        z = points[rows[p], 2] - t[2, 3]
        depth = t[0, 2] * x + t[1, 2] * y + t[2, 2] * z
        if depth < 0.05:
            return False
        one = 1.0 / depth
        uvr[p, 0] = (t[0, 0] * x + t[1, 0] * y + t[2, 0] * z) * one * camera[0] + camera[2]
        uvr[p, 1] = (t[0, 1] * x + t[1, 1] * y + t[2, 1] * z) * one * camera[1] + camera[3]
        uvr[p, 2] = 0.5 * voxel_m * camera[0] * one
    return True


@kernel
def draw(uvr: Floats, u0: float, v0: float, cell: float, wide: int, high: int, raster: Floats) -> None:
    """The mask as squares of its voxels' size: raster 1e6 inside, 0 elsewhere; one row of cells more on every side."""
    for row in range(high + 2):
        for column in range(wide + 2):
            raster[row, column] = 0.0
    for p in range(len(uvr)):
        u, v, r = uvr[p, 0] - u0, uvr[p, 1] - v0, uvr[p, 2]
        c0, c1 = max(int((u - r) / cell), 0), min(int((u + r) / cell), wide - 1)
        r0, r1 = max(int((v - r) / cell), 0), min(int((v + r) / cell), high - 1)
        for row in range(r0, r1 + 1):
            for column in range(c0, c1 + 1):
                raster[row + 1, column + 1] = _FAR


@kernel
def spread_distance(raster: Floats, wide: int, high: int, inside: tuple[bool, bool, bool, bool]) -> float:
    """Cells from every cell of the mask to the nearest outside of it, in place; returns the largest.

    inside: whether left, upper, right and lower side are the picture's own border, which is no edge of the mask.
    """
    for row in range(high + 2):
        raster[row, 0] = _FAR if inside[0] else np.float32(0.0)
        raster[row, wide + 1] = _FAR if inside[2] else np.float32(0.0)
    for column in range(wide + 2):
        raster[0, column] = _FAR if inside[1] else np.float32(0.0)
        raster[high + 1, column] = _FAR if inside[3] else np.float32(0.0)
    for row in range(1, high + 1):
        for column in range(1, wide + 1):
            if raster[row, column] > 0:
                near = min(raster[row - 1, column], raster[row, column - 1]) + np.float32(1.0)
                aslant = min(raster[row - 1, column - 1], raster[row - 1, column + 1]) + _DIAGONAL
                raster[row, column] = min(raster[row, column], near, aslant)
    most = np.float32(0.0)
    for row in range(high, 0, -1):
        for column in range(wide, 0, -1):
            if raster[row, column] > 0:
                near = min(raster[row + 1, column], raster[row, column + 1]) + np.float32(1.0)
                aslant = min(raster[row + 1, column + 1], raster[row + 1, column - 1]) + _DIAGONAL
                raster[row, column] = min(raster[row, column], near, aslant)
                most = max(most, raster[row, column])
    return float(most)
