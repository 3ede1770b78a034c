"""Lays a scan on the map: points to planes of the voxel map, in x, y and yaw.

The map's coarse cells hold planes (centroid and normal of the surface around, see ``mapping.kernels``). A scan's points take an
upright plane near them that faces the sensor; Gauss-Newton with Geman-McClure weights moves the scan onto the planes, as KISS-ICP
does it with points (Vizzo et al. 2023, sections III-C and III-D). Roll, pitch and height are the odometry's: a robot on a floor.
Directions of which the planes say little (along a corridor) are left as they are: Zhang, Kaess and Singh 2016, "On degeneracy of
optimization-based state estimation problems", eq. 10. Pure functions; a move is (x_m, y_m, yaw_rad), the turn about a pivot.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from irsd.core.jit import kernel
from irsd.mapping.kernels import BLOCK_COARSE, KEY_BITS, Floats, Ints, Rows, Singles, find_block

LEVER_M = 3.0  # a turn counts as the way of a point this far off, which is where a room's walls are
_KEY_OFFSET = 1 << (KEY_BITS - 1)


class Planes(NamedTuple):
    """The voxel map's planes. table, blocks: hash of blocks; normal, surface float32 [cells, 3]; cell_m: edge of a coarse cell."""

    table: Rows
    blocks: Ints
    normal: Singles
    surface: Singles
    cell_m: float


class Reach(NamedTuple):
    """How planes are looked for. cells: neighbours on each axis; distance_m: to a centroid; upright: largest |n_z|; scale_m: of the
    robust weight; weak: share of the points' weight that must speak of a direction for it to be moved."""

    cells: int
    distance_m: float
    upright: float
    scale_m: float
    weak: float


class System(NamedTuple):
    """Normal equations of a move: hessian [3, 3] @ step = -gradient [3], yaw in units of 1 / LEVER_M; divided by the sum of weights.

    matched: points that have a plane; fit: their mean weight, 1 where all lie on their planes.
    """

    hessian: Floats
    gradient: Floats
    matched: int
    fit: float


class Alignment(NamedTuple):
    """What came of it. move: float64 [3]; matched and fit as in ``System``, at the end; free: directions that were moved, 0..3."""

    move: Floats
    matched: int
    fit: float
    free: int


@kernel
def moved(points: Singles, pivot: Floats, move: Floats) -> Floats:
    """Points [N, 3] turned by move[2] about pivot [3] and shifted by move[:2]: float64 [N, 3]."""
    out = np.empty((len(points), 3))
    c, s = np.cos(move[2]), np.sin(move[2])
    for i in range(len(points)):
        x, y = points[i, 0] - pivot[0], points[i, 1] - pivot[1]
        out[i, 0] = pivot[0] + move[0] + c * x - s * y
        out[i, 1] = pivot[1] + move[1] + s * x + c * y
        out[i, 2] = points[i, 2]
    return out


@kernel
def _plane_at(a: int, b: int, c: int, planes: Planes, known: Ints) -> int:
    """The coarse cell at integer coordinates, -1 where its block is not in the map. Writes known [2]: the last block and slot."""
    key = (((((a >> 2) + _KEY_OFFSET) << KEY_BITS) | ((b >> 2) + _KEY_OFFSET)) << KEY_BITS) | ((c >> 2) + _KEY_OFFSET)
    if key != known[0]:
        known[0], known[1] = key, find_block(planes.table, planes.blocks, key)
    if known[1] < 0:
        return -1
    return int(known[1] * BLOCK_COARSE + (a & 3) * 16 + (b & 3) * 4 + (c & 3))


@kernel
def nearest_planes(points: Floats, sensor: Floats, planes: Planes, reach: int, reach_m: float, upright: float) -> Ints:
    """The coarse cell [N] whose plane each point [N, 3] is laid on, -1 for none.

    The point's own cell where that has a plane, else the nearest centroid within reach_m among the cells up to ``reach`` away on
    each axis. |n_z| <= upright, and the plane faces the sensor [3]: the other side of a thin wall is another wall.
    """
    cells = np.full(len(points), -1, np.int64)
    known = np.full(2, -1, np.int64)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        u, v, w = int(np.floor(x / planes.cell_m)), int(np.floor(y / planes.cell_m)), int(np.floor(z / planes.cell_m))
        own = _plane_at(u, v, w, planes, known)
        if own >= 0:
            nx, ny, nz = planes.normal[own]
            if nx != 0 or ny != 0 or nz != 0:
                if abs(nz) <= upright and nx * (sensor[0] - x) + ny * (sensor[1] - y) + nz * (sensor[2] - z) > 0:
                    cells[i] = own
                continue
        best = reach_m * reach_m
        for a in range(u - reach, u + reach + 1):
            for b in range(v - reach, v + reach + 1):
                for c in range(w - reach, w + reach + 1):
                    cell = _plane_at(a, b, c, planes, known)
                    if cell < 0:
                        continue
                    nx, ny, nz = planes.normal[cell]
                    if (nx == 0 and ny == 0 and nz == 0) or abs(nz) > upright:
                        continue
                    sx, sy, sz = planes.surface[cell]
                    distance = (x - sx) ** 2 + (y - sy) ** 2 + (z - sz) ** 2
                    facing = nx * (sensor[0] - x) + ny * (sensor[1] - y) + nz * (sensor[2] - z)
                    if distance < best and facing > 0:
                        best = distance
                        cells[i] = cell
    return cells


@kernel
def plane_system(points: Floats, cells: Ints, pivot: Floats, planes: Planes, scale_m: float) -> System:
    """The normal equations of the points [N, 3] with a cell (>= 0), weighted by Geman-McClure of scale_m, about pivot [3]."""
    hessian, gradient = np.zeros((3, 3)), np.zeros(3)
    weight, matched = 0.0, 0
    row = np.empty(3)
    for i in range(len(points)):
        if cells[i] < 0:
            continue
        normal, centre = planes.normal[cells[i]], planes.surface[cells[i]]
        residual = 0.0
        for axis in range(3):
            residual += normal[axis] * (points[i, axis] - centre[axis])
        row[0], row[1] = normal[0], normal[1]
        row[2] = (normal[1] * (points[i, 0] - pivot[0]) - normal[0] * (points[i, 1] - pivot[1])) / LEVER_M
        w = (scale_m**2 / (scale_m**2 + residual**2)) ** 2
        for a in range(3):
            gradient[a] += w * residual * row[a]
            for b in range(3):
                hessian[a, b] += w * row[a] * row[b]
        weight += w
        matched += 1
    total = max(weight, 1e-12)
    return System(hessian / total, gradient / total, matched, weight / max(matched, 1))


def align(
    points: Singles, pivot: Floats, sensor: Floats, planes: Planes, reach: Reach, *, least: int, rounds: int
) -> Alignment:
    """Moves points [N, 3], seen from sensor [3], onto the planes: at most ``rounds`` rounds of matching and one step each.

    Ends early when fewer than ``least`` points have a plane (free = 0), or when a step moves less than 0.1 mm at LEVER_M.
    """
    move, free = np.zeros(3), 0
    for _ in range(rounds):
        here = moved(points, pivot, move)
        shift = np.array([move[0], move[1], 0.0])
        cells = nearest_planes(here, sensor + shift, planes, reach.cells, reach.distance_m, reach.upright)
        system = plane_system(here, cells, pivot + shift, planes, reach.scale_m)
        if system.matched < least:
            return Alignment(move, system.matched, system.fit, 0)
        values, vectors = np.linalg.eigh(system.hessian)
        known = values > reach.weak
        free = int(known.sum())
        step = -vectors[:, known] @ ((vectors[:, known].T @ system.gradient) / values[known])
        move = move + step / np.array([1.0, 1.0, LEVER_M])
        if float(np.abs(step).max(initial=0.0)) < 1e-4:
            break
    here = moved(points, pivot, move)
    shift = np.array([move[0], move[1], 0.0])
    cells = nearest_planes(here, sensor + shift, planes, reach.cells, reach.distance_m, reach.upright)
    system = plane_system(here, cells, pivot + shift, planes, reach.scale_m)
    return Alignment(move, system.matched, system.fit, free)
