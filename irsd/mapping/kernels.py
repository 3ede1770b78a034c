"""Compiled kernels of the voxel map: packed keys, the table of blocks, grouped sums, moments and the planes through them.

No state; what a kernel writes in place is named first in its docstring. Moments are rows of ten: n, x, y, z, xx, xy, xz, yy,
yz, zz. Arrays that refer to rows or slots hold the number plus one, so that zeroed memory means "none".
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel

BLOCK_BITS = 3  # a block is 8 x 8 x 8 voxels: small enough to be mostly full of surface
BLOCK_EDGE = 1 << BLOCK_BITS
BLOCK_VOXELS = BLOCK_EDGE**3
COARSE_EDGE = BLOCK_EDGE // 2  # a coarse cell is 2 x 2 x 2 voxels and owns a normal
BLOCK_COARSE = COARSE_EDGE**3
KEY_BITS = 18  # per axis of a block key: +-41 km at 4 cm
_INNER_BITS = 3 * BLOCK_BITS
_INNER_MASK = BLOCK_VOXELS - 1
_KEY_OFFSET = 1 << (KEY_BITS - 1)
_KEY_MASK = (1 << KEY_BITS) - 1
_HASH = -7046029254386353131  # 2^64 / golden ratio, as int64

Ints = NDArray[np.int64]
Rows = NDArray[np.int32]
Singles = NDArray[np.float32]
Floats = NDArray[np.float64]


# ---------------------------------------------------------------------------------------------------- keys and groups
@kernel
def pack_points(points: Singles, voxel_m: float) -> Ints:
    """One sortable int64 [N] per point [N, 3]: the key of its block above, the voxel's place in the block in the low 9 bits.

    -1 for points that are not finite or so far away that their block (or its neighbours) has no key.
    """
    packed = np.empty(len(points), np.int64)
    limit = (_KEY_OFFSET - 2) * BLOCK_EDGE * voxel_m
    for i in range(len(points)):
        block, inner = 0, 0
        for axis in range(3):
            value = float(points[i, axis])
            if not abs(value) < limit:
                block = -1
                break
            key = int(np.floor(value / voxel_m))
            block = (block << KEY_BITS) | ((key >> BLOCK_BITS) + _KEY_OFFSET)
            inner = (inner << BLOCK_BITS) | (key & (BLOCK_EDGE - 1))
        packed[i] = (block << _INNER_BITS) | inner if block >= 0 else -1
    return packed


def unpack_blocks(blocks: Ints) -> Ints:
    """Integer block coordinates [B, 3] (units of a block's edge) of block keys [B]."""
    parts = [(blocks >> (2 * KEY_BITS)) & _KEY_MASK, (blocks >> KEY_BITS) & _KEY_MASK, blocks & _KEY_MASK]
    return np.asarray(np.stack(parts, -1) - _KEY_OFFSET, np.int64)


@kernel
def block_place(block: int) -> tuple[int, int, int]:
    """Integer coordinates (units of a block's edge) of a block key."""
    x, y, z = (block >> (2 * KEY_BITS)) & _KEY_MASK, (block >> KEY_BITS) & _KEY_MASK, block & _KEY_MASK
    return x - _KEY_OFFSET, y - _KEY_OFFSET, z - _KEY_OFFSET


@kernel
def group(packed: Ints, order: Ints) -> tuple[Ints, Rows]:
    """The different keys, ascending, and for each of packed [N] its place among them (-1 for -1). order sorts packed."""
    keys = np.empty(len(packed), np.int64)
    of_point = np.empty(len(packed), np.int32)
    count = 0
    for i in order:
        if packed[i] >= 0 and (count == 0 or packed[i] != keys[count - 1]):
            keys[count] = packed[i]
            count += 1
        of_point[i] = count - 1
    return keys[:count].copy(), of_point


@kernel
def group_cells(voxels: Ints, slots: Rows, rows: Rows) -> tuple[Ints, Rows]:
    """The coarse cells (slot * 64 + place) of ascending voxels, each once, and for each voxel its place among them.

    Voxels whose row is -1 get -1.
    """
    cells = np.empty(len(voxels), np.int64)
    of_voxel = np.full(len(voxels), -1, np.int32)
    seen = np.zeros(BLOCK_COARSE, np.int32)
    count, first, slot = 0, 0, -1
    for i in range(len(voxels)):
        if rows[i] < 0:
            continue
        if slots[i] != slot:
            slot, first = slots[i], count
            seen[:] = 0
        place = _coarse_place(voxels[i])
        if seen[place] == 0:
            cells[count] = slot * BLOCK_COARSE + place
            count += 1
            seen[place] = count - first
        of_voxel[i] = first + seen[place] - 1
    return cells[:count].copy(), of_voxel


@kernel
def _coarse_place(voxel: int) -> int:
    """The coarse cell (0..63) of a packed voxel in its block."""
    return int((voxel >> 3) & 48 | (voxel >> 2) & 12 | (voxel >> 1) & 3)


# ---------------------------------------------------------------------------------------------------- table of blocks
@kernel
def _home(key: int, size: int) -> int:
    return int((((key ^ (key >> 17)) * _HASH) >> 40) & (size - 1))


@kernel
def find_block(table: Rows, blocks: Ints, key: int) -> int:
    """The slot of a block key, -1 if there is none. table [power of two] holds slots + 1; blocks [slots] their keys."""
    place = _home(key, len(table))
    while table[place] and blocks[table[place] - 1] != key:
        place = (place + 1) & (len(table) - 1)
    return int(table[place]) - 1


@kernel
def fill_table(table: Rows, blocks: Ints, slots: NDArray[np.integer]) -> None:
    """Writes table: enters slots [B] that are not in it, under their keys blocks[slots]."""
    for slot in slots:
        place = _home(blocks[slot], len(table))
        while table[place]:
            place = (place + 1) & (len(table) - 1)
        table[place] = slot + 1


@kernel
def link_blocks(neighbours: NDArray[np.int32], table: Rows, blocks: Ints, slots: NDArray[np.integer]) -> None:
    """Writes neighbours [slots, 27] (slots + 1) of new blocks and of those around them. The new ones are in the table."""
    for slot in slots:
        for k in range(27):
            step = ((k // 9 - 1) << (2 * KEY_BITS)) + ((k // 3 % 3 - 1) << KEY_BITS) + k % 3 - 1
            other = find_block(table, blocks, blocks[slot] + step)
            neighbours[slot, k] = other + 1
            if other >= 0:
                neighbours[other, 26 - k] = slot + 1


@kernel
def find_voxels(voxels: Ints, table: Rows, blocks: Ints, index: NDArray[np.int32]) -> tuple[Rows, Rows]:
    """Slots and rows [V] of packed voxels [V], -1 where there is none. index [slots, 512] holds rows + 1."""
    slots, rows = np.empty(len(voxels), np.int32), np.full(len(voxels), -1, np.int32)
    last, slot = -1, -1
    for i in range(len(voxels)):
        key = voxels[i] >> _INNER_BITS
        if key != last:
            last, slot = key, find_block(table, blocks, key)
        slots[i] = slot
        if slot >= 0:
            rows[i] = index[slot, voxels[i] & _INNER_MASK] - 1
    return slots, rows


@kernel
def enter_voxels(index: NDArray[np.int32], coarse: Rows, voxels: Ints, slots: Rows, rows: Rows) -> None:
    """Writes index [slots, 512] and coarse [rows] (slot * 64 + place) for new voxels [V] in their slots and rows."""
    for i in range(len(voxels)):
        index[slots[i], voxels[i] & _INNER_MASK] = rows[i] + 1
        coarse[rows[i]] = slots[i] * BLOCK_COARSE + _coarse_place(voxels[i])


# ---------------------------------------------------------------------------------------------------- sums
@kernel
def update_means(mean: Singles, hits: Singles, points: Singles, voxel: Rows, rows: Rows, memory: float) -> None:
    """Writes mean [rows, 3] and hits [rows]: running means; past ``memory`` hits an exponential filter.

    voxel [N] is each point's place in rows [V]; -1 in either means it is left out.
    """
    sums = np.zeros((len(rows), 4))
    for i in range(len(points)):
        if voxel[i] >= 0:
            total = sums[voxel[i]]
            total[0] += 1
            for axis in range(3):
                total[axis + 1] += points[i, axis]
    for v in range(len(rows)):
        row, count = rows[v], sums[v, 0]
        if row < 0:
            continue
        weight = min(hits[row] + count, max(memory, count))
        for axis in range(3):
            old = float(mean[row, axis])
            mean[row, axis] = old + (sums[v, axis + 1] - count * old) / weight
        hits[row] = weight


@kernel
def group_moments(points: Floats, cell: Rows, count: int) -> Floats:
    """Moments [count, 10] of points [N, 3] by group number cell [N] in 0..count-1 (-1 = none)."""
    moments = np.zeros((count, 10))
    for i in range(len(points)):
        g, x, y, z = cell[i], points[i, 0], points[i, 1], points[i, 2]
        if g >= 0:
            moments[g, 0] += 1
            moments[g, 1] += x
            moments[g, 2] += y
            moments[g, 3] += z
            moments[g, 4] += x * x
            moments[g, 5] += x * y
            moments[g, 6] += x * z
            moments[g, 7] += y * y
            moments[g, 8] += y * z
            moments[g, 9] += z * z
    return moments


@kernel
def update_moments(
    moments: Singles, touches: Rows, points: Singles, cell: Rows, cells: Ints, size_m: float, full: float
) -> Ints:
    """Writes moments [cells, 10] about cell centres and touches [cells]; returns the cells whose normal is due.

    cell [N] is each point's place in cells [C]. Normals are due at touches that are powers of two or multiples of 16: new
    cells at once, old ones seldom. A cell past ``full`` points forgets half, so that a moved surface wins after a while.
    """
    centred = np.empty((len(points), 3))
    for i in range(len(points)):
        for axis in range(3):
            value = float(points[i, axis])
            centred[i, axis] = value - (np.floor(value / size_m) + 0.5) * size_m
    sums = group_moments(centred, cell, len(cells))
    due = np.empty(len(cells), np.int64)
    count = 0
    for g in range(len(cells)):
        old = moments[cells[g]]
        fade = 0.5 if old[0] > full else 1.0
        for k in range(10):
            old[k] = old[k] * fade + sums[g, k]
        touches[cells[g]] += 1
        n = touches[cells[g]]
        if n & (n - 1) == 0 or n % 16 == 0:
            due[count] = cells[g]
            count += 1
    return due[:count].copy()


# ---------------------------------------------------------------------------------------------------- planes
@kernel
def window_moments(cells: Ints, neighbours: NDArray[np.int32], moments: Singles, size_m: float) -> Floats:
    """Moments [C, 10] of each cell's 3 x 3 x 3 surroundings, about the cell's centre."""
    windows = np.zeros((len(cells), 10))
    for i in range(len(cells)):
        slot, place = cells[i] // BLOCK_COARSE, cells[i] % BLOCK_COARSE
        x, y, z = place // 16, place // 4 % 4, place % 4
        for k in range(27):
            dx, dy, dz = k // 9 - 1, k // 3 % 3 - 1, k % 3 - 1
            u, v, w = x + dx, y + dy, z + dz
            other = neighbours[slot, ((u >> 2) + 1) * 9 + ((v >> 2) + 1) * 3 + (w >> 2) + 1] - 1
            if other < 0:
                continue
            m = other * BLOCK_COARSE + (u & 3) * 16 + (v & 3) * 4 + (w & 3)
            n, sx, sy, sz = float(moments[m, 0]), float(moments[m, 1]), float(moments[m, 2]), float(moments[m, 3])
            if n == 0:
                continue
            # The neighbour's points lie at +(a, b, c) from where its moments have them.
            a, b, c = dx * size_m, dy * size_m, dz * size_m
            windows[i, 0] += n
            windows[i, 1] += sx + n * a
            windows[i, 2] += sy + n * b
            windows[i, 3] += sz + n * c
            windows[i, 4] += moments[m, 4] + 2 * a * sx + n * a * a
            windows[i, 5] += moments[m, 5] + a * sy + b * sx + n * a * b
            windows[i, 6] += moments[m, 6] + a * sz + c * sx + n * a * c
            windows[i, 7] += moments[m, 7] + 2 * b * sy + n * b * b
            windows[i, 8] += moments[m, 8] + b * sz + c * sy + n * b * c
            windows[i, 9] += moments[m, 9] + 2 * c * sz + n * c * c
    return windows


@kernel
def plane_fits(moments: Floats) -> tuple[Floats, Floats]:
    """Normals [M, 3] (unit, any sign) and eigenvalues [M, 3] ascending (m^2) of moments [M, 10].

    Closed form for symmetric 3x3 (Smith 1961); the eigenvector is the longest cross product of two rows of A - l I.
    """
    normals, values = np.empty((len(moments), 3)), np.empty((len(moments), 3))
    for i in range(len(moments)):
        n = max(moments[i, 0], 1e-9)
        mx, my, mz = moments[i, 1] / n, moments[i, 2] / n, moments[i, 3] / n
        a, d, f = moments[i, 4] / n - mx * mx, moments[i, 5] / n - mx * my, moments[i, 6] / n - mx * mz
        b, e, c = moments[i, 7] / n - my * my, moments[i, 8] / n - my * mz, moments[i, 9] / n - mz * mz
        q = (a + b + c) / 3
        spread = (a - q) ** 2 + (b - q) ** 2 + (c - q) ** 2 + 2 * (d * d + e * e + f * f)
        p = np.sqrt(max(spread / 6, 1e-18))
        a1, b1, c1, d1, e1, f1 = (a - q) / p, (b - q) / p, (c - q) / p, d / p, e / p, f / p
        half_det = (a1 * (b1 * c1 - e1 * e1) - d1 * (d1 * c1 - e1 * f1) + f1 * (d1 * e1 - b1 * f1)) / 2
        phi = np.arccos(min(max(half_det, -1.0), 1.0)) / 3
        largest = q + 2 * p * np.cos(phi)
        smallest = q + 2 * p * np.cos(phi + 2 * np.pi / 3)
        values[i] = max(smallest, 0.0), max(3 * q - largest - smallest, 0.0), max(largest, 0.0)
        normals[i] = _null_vector(a - smallest, b - smallest, c - smallest, d, e, f)
    return normals, values


@kernel
def _null_vector(a: float, b: float, c: float, d: float, e: float, f: float) -> tuple[float, float, float]:
    """Unit vector that the singular matrix [[a, d, f], [d, b, e], [f, e, c]] takes to zero; (0, 0, 1) if all are."""
    crosses = (
        (d * e - f * b, f * d - a * e, a * b - d * d),
        (b * c - e * e, e * f - d * c, d * e - b * f),
        (e * f - c * d, c * a - f * f, f * d - e * a),
    )
    best, longest = (0.0, 0.0, 1.0), 1e-15
    for x, y, z in crosses:
        length = np.sqrt(x * x + y * y + z * z)
        if length > longest:
            best, longest = (x / length, y / length, z / length), length
    return best


@kernel
def set_patches(
    normal: Singles, surface: Singles, cells: Ints, windows: Floats, blocks: Ints, origin: Floats, voxel_m: float
) -> None:
    """Writes normal and surface [cells, 3]: unit normals towards origin [3] where the window is flat, else 0; centroids."""
    fits, values = plane_fits(windows)
    for i in range(len(cells)):
        slot, place = cells[i] // BLOCK_COARSE, cells[i] % BLOCK_COARSE
        n, facing = windows[i, 0], 0.0
        for axis in range(3):
            block = ((blocks[slot] >> ((2 - axis) * KEY_BITS)) & _KEY_MASK) - _KEY_OFFSET
            inner = (place >> (4 - 2 * axis)) & 3
            centre = (block * COARSE_EDGE + inner + 0.5) * 2 * voxel_m
            facing += (origin[axis] - centre) * fits[i, axis]
            surface[cells[i], axis] = centre + windows[i, axis + 1] / max(n, 1e-6)
        flat = n >= 5 and values[i, 1] > 0.4 * voxel_m**2 and values[i, 0] < 0.3 * values[i, 1]
        for axis in range(3):
            normal[cells[i], axis] = (-fits[i, axis] if facing < 0 else fits[i, axis]) if flat else 0.0


@kernel
def select(
    structure: NDArray[np.uint8], wanted: int, mean: Singles, coarse: Rows, normal: Singles
) -> tuple[Singles, Singles]:
    """Means and normals [K, 3] of the rows whose structure [rows] is the wanted one and whose normal is known."""
    points, normals = np.empty((len(structure), 3), np.float32), np.empty((len(structure), 3), np.float32)
    count = 0
    for row in range(len(structure)):
        if structure[row] == wanted:
            x, y, z = normal[coarse[row], 0], normal[coarse[row], 1], normal[coarse[row], 2]
            if x != 0 or y != 0 or z != 0:
                points[count, 0], points[count, 1], points[count, 2] = mean[row, 0], mean[row, 1], mean[row, 2]
                normals[count, 0], normals[count, 1], normals[count, 2] = x, y, z
                count += 1
    return points[:count].copy(), normals[:count].copy()
