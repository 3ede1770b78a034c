"""Compiled kernels over plan tiles: floor and ceiling heights, wall lines, and the labels that follow from both."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel
from irsd.core.types import Structure

SECTORS = 8  # wall directions of 45 degrees, signed: the two faces of a thin wall stay apart
REACH = 2  # tiles on each side of a wall fit: a window of 1 m
_SECTOR_RAD = 2 * np.pi / SECTORS
_PARTS = 3 * (2 * REACH + 1) ** 2
_FLOOR, _CEILING = int(Structure.FLOOR), int(Structure.CEILING)
_WALL, _OTHER = int(Structure.WALL), int(Structure.OTHER)

Singles = NDArray[np.float32]
Floats = NDArray[np.float64]


class Plan(NamedTuple):
    """A rectangle of plan cells: cells per metre, (row, col) of its lowest cell from the map's origin, its shape."""

    scale: float
    row: int
    col: int
    height: int
    width: int


class LevelTiles(NamedTuple):
    """heights [2 (floor, ceiling), H, W] on a plan, NaN = unknown: there the heights near the robot hold (inf: no ceiling)."""

    plan: Plan
    heights: NDArray[np.float32]
    floor_m: float
    ceiling_m: float


class WallTiles(NamedTuple):
    """On a plan: moments [H, W, 8, 6] (n, x, y, xx, xy, yy) of upright surface by the sector that it faces; the lines
    fits [H, W, 8, 4] (n_x, n_y, offset n . xy, 1 = valid); fitted [H, W] clock of the last fit, -1 = nothing within reach."""

    plan: Plan
    moments: NDArray[np.float64]
    fits: NDArray[np.float32]
    fitted: NDArray[np.int64]


class Limits(NamedTuple):
    """Of ``StructureSettings``, what kernels need."""

    radius_m: float
    horizontal: float
    upright: float
    level_tolerance_m: float
    slope: float
    min_ceiling_m: float
    wall_band_m: float
    wall_min_height_m: float
    wall_distance_m: float
    wall_front_m: float
    wall_length_m: float
    wall_spread_m: float
    refit_scans: int


@kernel
def _cell(plan: Plan, x: float, y: float) -> tuple[int, int]:
    """(row, col) of a point in metres; (-1, -1) outside."""
    row, col = int(np.floor(y * plan.scale)) - plan.row, int(np.floor(x * plan.scale)) - plan.col
    if row < 0 or col < 0 or row >= plan.height or col >= plan.width:
        return -1, -1
    return row, col


@kernel
def locate(plan: Plan, points: Singles) -> NDArray[np.int64]:
    """(row, col) [N, 2] of points [N, 2+] in metres; (-1, -1) outside."""
    cells = np.empty((len(points), 2), np.int64)
    for i in range(len(points)):
        cells[i] = _cell(plan, float(points[i, 0]), float(points[i, 1]))
    return cells


@kernel
def bounds_xy(points: Singles) -> tuple[Floats, Floats]:
    """Lowest and highest (x, y) of points [N, 3]; (inf, inf) and (-inf, -inf) of none."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for i in range(len(points)):
        for axis in range(2):
            low[axis], high[axis] = min(low[axis], points[i, axis]), max(high[axis], points[i, axis])
    return low, high


# ---------------------------------------------------------------------------------------------------- levels
@kernel
def count_levels(
    surface: Singles, normals: Singles, base: Floats, start_m: float, bin_m: float, counts: Floats, limits: Limits
) -> None:
    """Writes counts [B]: adds the horizontal patches [C, 3] near base [3] by height, in bins of bin_m from start_m."""
    for i in range(len(surface)):
        if abs(normals[i, 2]) > limits.horizontal:
            place = int(np.floor((surface[i, 2] - np.float32(start_m)) / np.float32(bin_m)))
            near = np.hypot(surface[i, 0] - base[0], surface[i, 1] - base[1]) < limits.radius_m
            if near and 0 <= place < len(counts):
                counts[place] += 1


@kernel
def blend_levels(tiles: LevelTiles, surface: Singles, normals: Singles, limits: Limits) -> None:
    """Writes tiles.heights from the level patches [C, 3] of one scan.

    Floor: follow the mean. Ceiling: follow the highest patch; lower ones (lamps, cupboard tops) don't count.
    """
    plan = tiles.plan
    sums = np.zeros((plan.height, plan.width, 2))
    tops = np.full((plan.height, plan.width), -np.inf)
    for i in range(len(surface)):
        row, col = _cell(plan, float(surface[i, 0]), float(surface[i, 1]))
        if row < 0 or abs(normals[i, 2]) < limits.horizontal:
            continue
        z = float(surface[i, 2])
        if abs(z - tiles.floor_m) < 2 * limits.level_tolerance_m:
            sums[row, col, 0] += 1
            sums[row, col, 1] += z
        elif z - tiles.floor_m > limits.min_ceiling_m:
            tops[row, col] = max(tops[row, col], z)
    floor, ceiling = tiles.heights
    for row in range(plan.height):
        for col in range(plan.width):
            count, old, top = sums[row, col, 0], floor[row, col], tops[row, col]
            if count > 0:
                mean = sums[row, col, 1] / count
                floor[row, col] = mean if np.isnan(old) else old + 0.2 * (mean - old)
            old = ceiling[row, col]
            if np.isnan(old) or top > old + 0.1:
                ceiling[row, col] = top if top > -np.inf else np.nan
            elif top > old - 0.05:
                ceiling[row, col] = old + 0.2 * (top - old)


@kernel
def _levels_at(tiles: LevelTiles, x: float, y: float) -> tuple[float, float]:
    """Floor and ceiling height at a point."""
    floor, ceiling = tiles.floor_m, tiles.ceiling_m
    row, col = _cell(tiles.plan, x, y)
    if row >= 0:
        low, high = float(tiles.heights[0, row, col]), float(tiles.heights[1, row, col])
        floor = floor if np.isnan(low) else low
        ceiling = ceiling if np.isnan(high) else high
    return floor, ceiling


@kernel
def in_wall_band(surface: Singles, normals: Singles, tiles: LevelTiles, limits: Limits) -> NDArray[np.bool_]:
    """[N] True for upright patches [N, 3] just below the ceiling of the room that they face."""
    result = np.zeros(len(surface), np.bool_)
    for i in range(len(surface)):
        nx, ny, z = normals[i, 0], normals[i, 1], surface[i, 2]
        if abs(normals[i, 2]) >= limits.upright or (nx == 0 and ny == 0):
            continue
        # A wall's own tile may belong to two rooms: ask a little way in front of it.
        floor, ceiling = _levels_at(tiles, surface[i, 0] + 0.3 * nx, surface[i, 1] + 0.3 * ny)
        lowest = floor + limits.wall_min_height_m
        top = ceiling - 0.08 if ceiling < np.inf else lowest + 0.8
        # Above 2.3 m nothing but structure stands, however high the ceiling is.
        start = min(max(top - limits.wall_band_m, lowest), floor + 2.3)
        result[i] = start < z < top
    return result


# ---------------------------------------------------------------------------------------------------- walls
@kernel
def add_walls(tiles: WallTiles, points: Singles, normals: Singles) -> None:
    """Writes tiles.moments from upright surface: points and normals [N, 3]; wakes tiles within reach of new evidence."""
    plan, moments = tiles.plan, tiles.moments
    faded = np.zeros((plan.height, plan.width, SECTORS), np.bool_)
    for i in range(len(points)):
        x, y = float(points[i, 0]), float(points[i, 1])
        row, col = _cell(plan, x, y)
        if row < 0:
            continue
        if moments[row, col, :, 0].sum() == 0:
            for r in range(max(row - REACH, 0), min(row + REACH + 1, plan.height)):
                for c in range(max(col - REACH, 0), min(col + REACH + 1, plan.width)):
                    tiles.fitted[r, c] = max(tiles.fitted[r, c], 0)
        sector = int(np.rint(np.arctan2(normals[i, 1], normals[i, 0]) / _SECTOR_RAD)) % SECTORS
        total = moments[row, col, sector]
        # Old evidence fades when plenty is there, so that a wall follows the odometry's drift.
        if not faded[row, col, sector] and total[0] > 300:
            total *= 0.5
        faded[row, col, sector] = True
        total[0] += 1
        total[1] += x
        total[2] += y
        total[3] += x * x
        total[4] += x * y
        total[5] += y * y


@kernel
def fit_walls(tiles: WallTiles, points: Singles, clock: int, limits: Limits) -> None:
    """Writes tiles.fits and tiles.fitted where points [N, 3] lie, each tile at most once in refit_scans ticks of clock."""
    parts = np.empty((_PARTS, 6))
    for i in range(len(points)):
        row, col = _cell(tiles.plan, float(points[i, 0]), float(points[i, 1]))
        if row < 0:
            continue
        last = tiles.fitted[row, col]
        if last < 0 or (last > 0 and clock - last < limits.refit_scans):
            continue
        tiles.fitted[row, col] = clock
        for sector in range(SECTORS):
            count = _gather(parts, tiles, row, col, sector)
            tiles.fits[row, col, sector] = _wall_line(parts[:count], sector, limits)


@kernel
def _gather(parts: Floats, tiles: WallTiles, row: int, col: int, sector: int) -> int:
    """Writes parts: the evidence around a tile that faces a sector or the ones beside it; returns how many parts."""
    count = 0
    for turn in range(-1, 2):
        facing = (sector + turn) % SECTORS
        for r in range(max(row - REACH, 0), min(row + REACH + 1, tiles.plan.height)):
            for c in range(max(col - REACH, 0), min(col + REACH + 1, tiles.plan.width)):
                if tiles.moments[r, c, facing, 0] > 0:
                    parts[count] = tiles.moments[r, c, facing]
                    count += 1
    return count


@kernel
def _wall_line(parts: Floats, sector: int, limits: Limits) -> tuple[float, float, float, float]:
    """Line (n_x, n_y, offset, 1 = valid) through those of the parts [P, 6] that agree on one; others are left out."""
    if parts[:, 0].sum() < 20:
        return 0.0, 0.0, 0.0, 0.0
    away = np.zeros(len(parts))
    total, farthest = np.zeros(6), 0.0
    for reach in (0.10, 0.05, 0.0):
        total[:] = 0
        for p in range(len(parts)):
            if away[p] <= farthest:
                total += parts[p]
        nx, ny, x, y, across, along = line_fit(total)
        nearest = 9.0
        for p in range(len(parts)):
            n = parts[p, 0]
            away[p] = abs((parts[p, 1] / n - x) * nx + (parts[p, 2] / n - y) * ny)
            nearest = min(nearest, away[p])
        farthest = max(nearest + 0.02, reach)
    angle = sector * _SECTOR_RAD
    facing = nx * np.cos(angle) + ny * np.sin(angle)
    if facing < 0:
        nx, ny = -nx, -ny
    valid = total[0] >= 20 and np.sqrt(12 * along) >= limits.wall_length_m
    valid = valid and np.sqrt(across) <= limits.wall_spread_m and abs(facing) > 0.7
    return nx, ny, nx * x + ny * y, 1.0 if valid else 0.0


@kernel
def line_fit(moments: Floats) -> tuple[float, float, float, float, float, float]:
    """Total least squares line of moments [6] (n, x, y, xx, xy, yy) with n >= 1.

    Returns its unit normal x, y (any sign), the centroid x, y, and the variances across and along it (m^2).
    """
    n = max(moments[0], 1e-9)
    x, y = moments[1] / n, moments[2] / n
    a, b, c = moments[3] / n - x * x, moments[4] / n - x * y, moments[5] / n - y * y
    centre, radius = (a + c) / 2, np.hypot((a - c) / 2, b)
    angle = 0.5 * np.arctan2(2 * b, a - c)
    return -np.sin(angle), np.cos(angle), x, y, max(centre - radius, 0.0), max(centre + radius, 0.0)


@kernel
def _in_wall(tiles: WallTiles, point: Singles, patch: Singles, normal: Singles, limits: Limits) -> bool:
    """True where a point is part of a wall.

    A point with a normal (non-zero) must lie on a patch (its centroid) that is in the wall's line and faces as the wall
    does; the patch is an average, so it tells a picture from the wall where single points can't.
    """
    row, col = _cell(tiles.plan, float(point[0]), float(point[1]))
    if row < 0:
        return False
    limit = limits.wall_distance_m
    for nx, ny, offset, valid in tiles.fits[row, col]:
        own = abs(nx * point[0] + ny * point[1] - offset)
        if valid == 0 or own > 3 * limit:
            continue
        if normal[0] == 0 and normal[1] == 0:
            if own <= limit:
                return True
        elif nx * normal[0] + ny * normal[1] > 0.8:
            in_front = nx * patch[0] + ny * patch[1] - offset
            if -limit <= in_front <= limits.wall_front_m:
                return True
    return False


@kernel
def surroundings(points: Singles, surface: Singles, normals: Singles, levels: LevelTiles, walls: WallTiles) -> Singles:
    """[N, 4] of points [N, 3] on patches with centroid surface [N, 3] and normal [N, 3] (zero = not known).

    Floor and ceiling height there (ceiling inf: not known); how far the point and its patch lie in front of the nearest wall line that
    faces as the patch does (NaN: none near).
    """
    out = np.empty((len(points), 4), np.float32)
    for i in range(len(points)):
        x, y = float(points[i, 0]), float(points[i, 1])
        out[i, 0], out[i, 1] = _levels_at(levels, x, y)
        out[i, 2], out[i, 3] = np.nan, np.nan
        row, col = _cell(walls.plan, x, y)
        if row < 0:
            continue
        unknown = normals[i, 0] == 0 and normals[i, 1] == 0
        nearest = np.inf
        for nx, ny, offset, valid in walls.fits[row, col]:
            own = nx * x + ny * y - offset
            if valid == 0 or abs(own) >= nearest:
                continue
            if unknown or nx * normals[i, 0] + ny * normals[i, 1] > 0.7 * np.hypot(normals[i, 0], normals[i, 1]):
                nearest = abs(own)
                out[i, 2] = own
                out[i, 3] = nx * surface[i, 0] + ny * surface[i, 1] - offset
    return out


# ---------------------------------------------------------------------------------------------------- labels
@kernel
def label_points(
    points: Singles,
    surface: Singles,
    normals: Singles,
    levels: LevelTiles,
    walls: WallTiles,
    base: Floats,
    limits: Limits,
) -> NDArray[np.uint8]:
    """Structure labels [N] of points [N, 3] on patches with centroid surface [N, 3] and normal [N, 3] (zero = not known).

    base [3] is the robot's position: levels are taken less strictly far from it.
    """
    labels = np.empty(len(points), np.uint8)
    for i in range(len(points)):
        normal, z = normals[i], points[i, 2]
        steep = abs(normal[2])
        tolerance = limits.level_tolerance_m + limits.slope * np.hypot(points[i, 0] - base[0], points[i, 1] - base[1])
        floor, ceiling = _levels_at(levels, float(points[i, 0]), float(points[i, 1]))
        height, below = z - floor, ceiling - z
        unknown = steep == 0 and normal[0] == 0 and normal[1] == 0
        flat, leaning = steep >= limits.horizontal, unknown or steep > limits.upright
        # Without a level normal only what hardly rises above the floor counts, so that feet of furniture stay things.
        if below < -tolerance or (below < tolerance and (flat or leaning)):
            labels[i] = _CEILING
        elif height < -tolerance or (flat and height < tolerance) or (leaning and height < 0.5 * tolerance):
            labels[i] = _FLOOR
        elif steep <= limits.upright and _in_wall(walls, points[i], surface[i], normal, limits):
            labels[i] = _WALL
        else:
            labels[i] = _OTHER
    return labels
