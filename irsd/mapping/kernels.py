"""Pure functions over arrays for the map: voxel keys, grouped sums, eigenvectors of 3x3 and 2x2 moments, ray samples.

No state, no loops over points. Moments are rows of ten: n, x, y, z, xx, xy, xz, yy, yz, zz.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BLOCK_BITS = 3  # a block is 8 x 8 x 8 voxels: small enough to be mostly full of surface
BLOCK_EDGE = 1 << BLOCK_BITS
BLOCK_VOXELS = BLOCK_EDGE**3
COARSE_EDGE = BLOCK_EDGE // 2  # a coarse cell is 2 x 2 x 2 voxels and owns a normal
BLOCK_COARSE = COARSE_EDGE**3
KEY_BITS = 18  # per axis of a block key: +-41 km at 4 cm
_KEY_OFFSET = 1 << (KEY_BITS - 1)
_KEY_MASK = (1 << KEY_BITS) - 1

IntArray = NDArray[np.int64]
Floats = NDArray[np.float64]


def voxel_keys(points: NDArray[np.floating], voxel_m: float) -> NDArray[np.int64]:
    """Integer voxel coordinates [N, 3] of points [N, 3] in metres: floor(p / voxel)."""
    return np.asarray(np.floor(np.asarray(points, np.float64) / voxel_m), np.int64)


def pack_voxels(keys: IntArray) -> IntArray:
    """One sortable int64 [N] per voxel key [N, 3]: the packed block key above, the voxel's place in the block below."""
    block = (keys >> BLOCK_BITS) + _KEY_OFFSET
    local = keys & (BLOCK_EDGE - 1)
    packed = (block[:, 0] << (2 * KEY_BITS)) | (block[:, 1] << KEY_BITS) | block[:, 2]
    inner = (local[:, 0] << (2 * BLOCK_BITS)) | (local[:, 1] << BLOCK_BITS) | local[:, 2]
    return (packed << (3 * BLOCK_BITS)) | inner


def pack_blocks(block_keys: IntArray) -> IntArray:
    """Packed int64 [B] of block keys [B, 3]; what ``pack_voxels`` holds above its lowest 9 bits."""
    block = block_keys + _KEY_OFFSET
    return (block[:, 0] << (2 * KEY_BITS)) | (block[:, 1] << KEY_BITS) | block[:, 2]


def unpack_blocks(packed: IntArray) -> IntArray:
    """Block keys [B, 3] of packed ones [B]."""
    parts = [(packed >> (2 * KEY_BITS)) & _KEY_MASK, (packed >> KEY_BITS) & _KEY_MASK, packed & _KEY_MASK]
    return np.asarray(np.stack(parts, -1) - _KEY_OFFSET, np.int64)


def addressable(points: NDArray[np.floating], voxel_m: float) -> NDArray[np.bool_]:
    """[N] True for finite points [N, 3] whose block key (and its neighbours') fits the packed form."""
    limit = (_KEY_OFFSET - 2) * BLOCK_EDGE * voxel_m
    return np.asarray((np.abs(points) < limit).all(-1))


def local_offsets() -> NDArray[np.int64]:
    """[512, 3] place of each voxel inside its block, in the order of ``pack_voxels``."""
    grid = np.indices((BLOCK_EDGE,) * 3).reshape(3, -1).T
    return np.asarray(grid, np.int64)


def coarse_of_local() -> NDArray[np.int64]:
    """[512] coarse cell (0..63) of each voxel of a block."""
    x, y, z = (local_offsets() >> 1).T
    return np.asarray((x * COARSE_EDGE + y) * COARSE_EDGE + z, np.int64)


def group_moments(points: Floats, group: IntArray, count: int) -> Floats:
    """Moments [count, 10] of points [N, 3] by group number [N] in 0..count-1."""
    x, y, z = points.T
    columns = (None, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z)
    sums = [np.bincount(group, weights=column, minlength=count) for column in columns]
    return np.stack(sums, -1).astype(np.float64)


def shift_matrix(offset: Floats) -> Floats:
    """[10, 10] matrix T with ``moments @ T`` = the same moments about an origin that lies at -offset (points + offset)."""
    a, b, c = (float(v) for v in offset)
    shift = np.eye(10)
    shift[0] = [1, a, b, c, a * a, a * b, a * c, b * b, b * c, c * c]
    shift[1, 4:7] = [2 * a, b, c]
    shift[2, 5], shift[2, 7], shift[2, 8] = a, 2 * b, c
    shift[3, 6], shift[3, 8], shift[3, 9] = a, b, 2 * c
    return shift


def plane_fits(moments: Floats) -> tuple[Floats, Floats]:
    """Normals [M, 3] (unit, any sign) and eigenvalues [M, 3] ascending (m^2) of moments [M, 10] with n >= 1.

    Closed form for symmetric 3x3 (Smith 1961); the eigenvector is the longest cross product of two rows of A - l I.
    """
    n = np.maximum(moments[:, 0], 1e-9)
    mean = moments[:, 1:4] / n[:, None]
    xx, xy, xz, yy, yz, zz = moments[:, 4:].T / n
    mx, my, mz = mean.T
    a, b, c = xx - mx * mx, yy - my * my, zz - mz * mz
    d, e, f = xy - mx * my, yz - my * mz, xz - mx * mz
    q = (a + b + c) / 3
    p = np.sqrt(np.maximum(((a - q) ** 2 + (b - q) ** 2 + (c - q) ** 2 + 2 * (d * d + e * e + f * f)) / 6, 1e-18))
    a1, b1, c1, d1, e1, f1 = (a - q) / p, (b - q) / p, (c - q) / p, d / p, e / p, f / p
    half_det = (a1 * (b1 * c1 - e1 * e1) - d1 * (d1 * c1 - e1 * f1) + f1 * (d1 * e1 - b1 * f1)) / 2
    phi = np.arccos(np.clip(half_det, -1, 1)) / 3
    largest = q + 2 * p * np.cos(phi)
    smallest = q + 2 * p * np.cos(phi + 2 * np.pi / 3)
    middle = 3 * q - largest - smallest
    rows = np.stack([a - smallest, d, f, d, b - smallest, e, f, e, c - smallest], -1).reshape(-1, 3, 3)
    crosses = np.cross(rows, rows[:, [1, 2, 0]])
    lengths = np.linalg.norm(crosses, axis=-1)
    best = lengths.argmax(-1)
    index = np.arange(len(moments))
    length = lengths[index, best]
    normal = np.where(length[:, None] > 1e-15, crosses[index, best] / np.maximum(length, 1e-15)[:, None], [0, 0, 1.0])
    return normal, np.maximum(np.stack([smallest, middle, largest], -1), 0.0)


def line_fits(moments: Floats) -> tuple[Floats, Floats, Floats]:
    """Total least squares lines of 2D moments [M, 6] (n, x, y, xx, xy, yy) with n >= 1.

    Returns unit normals [M, 2] (any sign), centroids [M, 2], and variances [M, 2] across and along the line (m^2).
    """
    n = np.maximum(moments[:, 0], 1e-9)
    mean = moments[:, 1:3] / n[:, None]
    a = moments[:, 3] / n - mean[:, 0] ** 2
    b = moments[:, 4] / n - mean[:, 0] * mean[:, 1]
    c = moments[:, 5] / n - mean[:, 1] ** 2
    centre, radius = (a + c) / 2, np.hypot((a - c) / 2, b)
    along = 0.5 * np.arctan2(2 * b, a - c)
    normal = np.stack([-np.sin(along), np.cos(along)], -1)
    return normal, mean, np.maximum(np.stack([centre - radius, centre + radius], -1), 0.0)


def ray_samples(
    origin: Floats, ends: NDArray[np.floating], step_m: float, stop_short_m: Floats, max_range_m: float
) -> NDArray[np.float32]:
    """Points [K, 3] every step_m along the rays origin [3] -> ends [N, 3], ending stop_short_m [N] before each end."""
    delta = np.asarray(ends, np.float64) - origin
    length = np.linalg.norm(delta, axis=-1)
    count = np.maximum((np.minimum(length - stop_short_m, max_range_m) / step_m).astype(np.int64), 0)
    starts = np.cumsum(count) - count
    order = np.arange(int(count.sum()), dtype=np.int64) - np.repeat(starts, count)
    step = (delta / np.maximum(length, 1e-9)[:, None] * step_m).astype(np.float32)
    distance = (order + 1).astype(np.float32)[:, None]
    return np.asarray(origin.astype(np.float32) + np.repeat(step, count, axis=0) * distance, np.float32)
