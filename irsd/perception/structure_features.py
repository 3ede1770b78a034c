"""What the structure network is told of each voxel: itself, its surroundings at three scales, its column, and its stretch of wall.

Pure kernels over a ``MapBlock``; nothing depends on where the block lies, and little on how it is turned. Means over a surrounding are
means over the cell of a regular grid that holds the voxel, so cost follows the number of voxels alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel
from irsd.core.types import MapBlock

_EDGES_M = (0.2, 0.5, 1.0)
_FAR_M = 3.5  # heights beyond say nothing more
_OFF_M = 0.4  # distances from a wall line beyond say nothing more
_COLUMN_M, _COLUMN_BINS, _BIN_M = 0.12, 10, 0.3
_STRETCHES_M = (0.24, 0.8)
_STRETCH_TOPS_M = np.array(
    [0.5, 0.9, 1.3, 1.75, 2.15], np.float32
)  # sills, handles and lintels lie between these heights
_STRETCH_BINS = len(_STRETCH_TOPS_M) + 1
_SECTORS = 8
_SMOOTH_M = 0.3

_OWN, _POOLED = 15, 12
FEATURES = _OWN + len(_EDGES_M) * (_POOLED + 4) + (_COLUMN_BINS + 2) + len(_STRETCHES_M) * 2 * _STRETCH_BINS

Singles = NDArray[np.float32]
Ints = NDArray[np.int64]


def structure_features(block: MapBlock) -> Singles:
    """float32 [N, FEATURES] of a block's N voxels."""
    if not len(block.points):
        return np.zeros((0, FEATURES), np.float32)
    floor, ceiling = block.levels[:, 0], block.levels[:, 1]
    height = np.clip(block.points[:, 2] - floor, -0.3, 2 * _FAR_M)
    walled = np.isfinite(block.levels[:, 2])
    offset = np.where(walled[:, None], np.clip(block.levels[:, 2:], -_OFF_M, _OFF_M), 0)
    own = _own(block, height, walled, offset, ceiling - floor)
    pooled = [_surrounding(block, own, offset[:, 1], walled, edge_m) for edge_m in _EDGES_M]
    column = _column(block.points, height)
    stretches = [_stretch(block, height, offset, walled, edge_m) for edge_m in _STRETCHES_M]
    return np.ascontiguousarray(np.concatenate([own, *pooled, column, *stretches], axis=1), np.float32)


def smoothed(block: MapBlock, shares: Singles) -> Singles:
    """Probabilities float32 [N, K] of a block's voxels, averaged with those of the voxels that lie near and face alike."""
    if not len(shares):
        return shares
    normals = block.normals
    sector = np.round(np.arctan2(normals[:, 1], normals[:, 0]) / (np.pi / 2)).astype(np.int64) % 4
    facing = np.where((normals == 0).all(1), 0, np.where(np.abs(normals[:, 2]) > 0.7, 1, 2 + sector))
    cell, cells = _cells(block.points, _SMOOTH_M)
    _, means = _pooled(cell * 6 + facing, shares, cells * 6)
    return np.asarray((shares + means[cell * 6 + facing]) / 2, np.float32)


def _own(block: MapBlock, height: Singles, walled: NDArray[np.bool_], offset: Singles, room_m: Singles) -> Singles:
    """[N, _OWN]: heights, steepness, distances from the wall line, and geometry's own opinion."""
    normals = block.normals
    known = (normals != 0).any(1)
    below = np.clip(block.levels[:, 1] - block.points[:, 2], -0.3, _FAR_M)
    out_of_patch = np.einsum("ij,ij->i", normals, block.points - block.surface)
    columns = (
        *(
            np.minimum(height, _FAR_M),
            below,
            np.isfinite(room_m),
            np.clip(np.where(np.isfinite(room_m), room_m, 2.7), 0, 6),
        ),
        *(np.abs(normals[:, 2]), known, known & (np.abs(normals[:, 2]) < 0.35)),
        *(offset[:, 0], offset[:, 1], walled, out_of_patch),
        *(block.geometry == kind for kind in range(4)),
    )
    return np.stack(columns, axis=1).astype(np.float32)


def _surrounding(block: MapBlock, own: Singles, offset: Singles, walled: NDArray[np.bool_], edge_m: float) -> Singles:
    """[N, _POOLED + 4]: means over the cell of edge_m that holds the voxel, and where the voxel lies in it."""
    points, normals = block.points, block.normals
    upright = (own[:, 6] > 0) & walled
    values = np.column_stack(
        (points, normals, own[:, 4] > 0.9, own[:, 6], own[:, 11:15], offset * upright, offset**2 * upright, upright)
    ).astype(np.float32)
    cell, cells = _cells(points, edge_m)
    counts, means = _pooled(cell, values, cells)
    mean, many = means[cell], counts[cell]
    middle, facing = mean[:, :3] - points, mean[:, 3:6]
    share = np.maximum(mean[:, 14], 1e-3)
    off = mean[:, 12] / share
    spread = np.sqrt(np.maximum(mean[:, 13] / share - off**2, 0))
    columns = (
        *(np.log1p(many) / 5, mean[:, 6], mean[:, 7], mean[:, 8], mean[:, 9], mean[:, 10], mean[:, 11]),
        *(off, spread, mean[:, 14], np.linalg.norm(facing, axis=1), np.einsum("ij,ij->i", facing, normals)),
        *(
            np.einsum("ij,ij->i", middle, normals),
            middle[:, 2],
            np.hypot(middle[:, 0], middle[:, 1]),
            np.abs(facing[:, 2]),
        ),
    )
    return np.stack(columns, axis=1).astype(np.float32)


def _column(points: Singles, height: Singles) -> Singles:
    """[N, _COLUMN_BINS + 2]: how full the column above and below is, by height; its lowest and highest."""
    flat = points.copy()
    flat[:, 2] = 0
    cell, cells = _cells(flat, _COLUMN_M)
    level = np.clip((height / _BIN_M).astype(np.int64), 0, _COLUMN_BINS - 1)
    full = np.bincount(cell * _COLUMN_BINS + level, minlength=cells * _COLUMN_BINS).reshape(cells, _COLUMN_BINS)
    low, high = _extent(cell, height, cells)
    share = np.log1p(full[cell]) / 3
    return np.column_stack((share, low[cell] - height, high[cell] - height)).astype(np.float32)


def _stretch(block: MapBlock, height: Singles, offset: Singles, walled: NDArray[np.bool_], edge_m: float) -> Singles:
    """[N, 2 * _STRETCH_BINS]: along the wall that a voxel faces, how far its surface lies before the wall's line, by height, and how
    much of it there is."""
    normals = block.normals
    angle = np.arctan2(normals[:, 1], normals[:, 0])
    sector = np.round(angle / (2 * np.pi / _SECTORS)).astype(np.int64) % _SECTORS
    level = np.hypot(normals[:, 0], normals[:, 1])
    facing = walled & (level > 0.9)
    on_line = np.zeros_like(block.points)
    on_line[:, :2] = block.points[:, :2] - normals[:, :2] * (offset[:, 1] / np.maximum(level, 1e-3))[:, None]
    cell, cells = _cells(on_line, edge_m)
    key = (cell * _SECTORS + sector) * _STRETCH_BINS
    bins = np.searchsorted(_STRETCH_TOPS_M, height)
    size = cells * _SECTORS * _STRETCH_BINS
    count = np.bincount((key + bins)[facing], minlength=size).astype(np.float32)
    total = np.bincount((key + bins)[facing], offset[facing, 1], minlength=size).astype(np.float32)
    rows = key[:, None] + np.arange(_STRETCH_BINS)
    mean, many = (total / np.maximum(count, 1))[rows], (np.log1p(count) / 5)[rows]
    return np.where(walled[:, None], np.concatenate([mean, many], axis=1), 0).astype(np.float32)


def _cells(points: Singles, edge_m: float) -> tuple[Ints, int]:
    """The cell [N] of each point in a grid of edge_m over all of them, and the number of cells."""
    low = points.min(0)
    place = ((points - low) / edge_m).astype(np.int64)
    shape = place.max(0) + 1
    return (place[:, 0] * shape[1] + place[:, 1]) * shape[2] + place[:, 2], int(shape.prod())


@kernel
def _pooled(cell: Ints, values: Singles, cells: int) -> tuple[Singles, Singles]:
    """Counts [cells] and means [cells, K] of values [N, K] by cell [N]."""
    counts, means = np.zeros(cells, np.float32), np.zeros((cells, values.shape[1]), np.float32)
    for i in range(len(cell)):
        counts[cell[i]] += 1
        for k in range(values.shape[1]):
            means[cell[i], k] += values[i, k]
    for c in range(cells):
        if counts[c] > 0:
            for k in range(values.shape[1]):
                means[c, k] /= counts[c]
    return counts, means


@kernel
def _extent(cell: Ints, height: Singles, cells: int) -> tuple[Singles, Singles]:
    """Lowest and highest value [cells] by cell."""
    low, high = np.full(cells, np.inf, np.float32), np.full(cells, -np.inf, np.float32)
    for i in range(len(cell)):
        low[cell[i]] = min(low[cell[i]], height[i])
        high[cell[i]] = max(high[cell[i]], height[i])
    return low, high
