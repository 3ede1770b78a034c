"""Voxels that are no structure, in components of touching cells of 8 cm: brought up to date where something is new.

A voxel is loose when it was hit often enough, is labelled OTHER and stays so when walls, floor and ceiling are taken a little thicker
(odometry that drifts draws a wall twice). Only cells whose loose voxels changed are looked at again, with the component they
are in: work follows what is new, not the map.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel
from irsd.core.settings import setting
from irsd.core.types import LooseChange, Structure
from irsd.mapping.kernels import BLOCK_COARSE
from irsd.mapping.structure import LevelMap, Levels, StructureSettings, WallLines
from irsd.mapping.structure_kernels import label_points
from irsd.mapping.voxels import VoxelMap

Rows = NDArray[np.int32]
_OTHER = int(Structure.OTHER)


@dataclass(frozen=True)
class LooseSettings:
    """Which voxels may be part of things, and how much is looked at."""

    min_hits: float = setting(2.0, "points from which a voxel counts", lo=1.0, hi=100.0)
    wall_m: float = setting(0.10, "parallel surface this near to a wall's line is no thing", lo=0.0, hi=0.5)
    level_m: float = setting(0.08, "level surface this near to floor or ceiling is no thing", lo=0.0, hi=0.5)
    cells: int = setting(20_000, "cells of 8 cm looked at again in one go; what is left waits", lo=100, hi=10_000_000)
    sweep_rows: int = setting(2048, "voxels per scan, in turn, whose label may have changed", lo=0, hi=1_000_000)


@dataclass(slots=True)
class _Counts:
    """By voxel row: the cell in which it was counted + 1, or 0. By cell: loose voxels, and the number of the last visit."""

    cell_of_row: Rows
    loose: NDArray[np.uint8]
    visited: Rows
    visit: int = 0
    dirty: list[Rows] = field(default_factory=list)
    gone: list[Rows] = field(default_factory=list)


class LooseVoxels:
    """Owner of the counts. ``follow`` after every scan, ``changed`` whenever the components are wanted."""

    def __init__(self, settings: LooseSettings, structure: StructureSettings, voxels: VoxelMap) -> None:
        self._settings, self._voxels = settings, voxels
        self._limits = structure.limits._replace(
            wall_distance_m=settings.wall_m, wall_front_m=settings.wall_m, level_tolerance_m=settings.level_m
        )
        cells = len(voxels.normal)
        self._counts = _Counts(
            np.zeros(len(voxels.hits), np.int32), np.zeros(cells, np.uint8), np.zeros(cells, np.int32)
        )
        self._next = 0

    def follow(self, touched: Rows, level_map: LevelMap, levels: Levels, walls: WallLines) -> None:
        """One scan later. touched: rows [M] of its voxels; the rest: what is known of floor, ceiling and walls there."""
        voxels, s = self._voxels, self._settings
        rows = np.concatenate([touched, self._in_turn()])
        loose = (voxels.hits[rows] >= s.min_hits) & (voxels.structure[rows] == _OTHER)
        some = np.flatnonzero(loose)
        if len(some):
            mine = rows[some]
            coarse = voxels.coarse[mine]
            again = label_points(
                voxels.mean.take(mine, 0), voxels.surface.take(coarse, 0), voxels.normal.take(coarse, 0),
                level_map.tiles(levels), walls.tiles, np.zeros(3), self._limits._replace(slope=0.0),
            )  # fmt: skip
            loose[some] = again == _OTHER
        self._count(rows, loose)

    def forget(self, rows: Rows) -> None:
        """These voxels are no more."""
        self._count(rows, np.zeros(len(rows), np.bool_))

    def changed(self) -> LooseChange:
        """The components of cells that changed since the last call, as far as ``cells`` allows."""
        counts, voxels = self._counts, self._voxels
        seeds = np.unique(np.concatenate(counts.dirty)) if counts.dirty else np.zeros(0, np.int32)
        gone = np.concatenate(counts.gone) if counts.gone else np.zeros(0, np.int32)
        gone = gone[counts.cell_of_row[gone] == 0]
        counts.gone = []
        counts.visit += 1
        cells, offset, done = grow(
            seeds.astype(np.int32), counts.loose, counts.visited, counts.visit, voxels.neighbours, self._settings.cells
        )
        counts.dirty = [seeds[done:].astype(np.int32)] if done < len(seeds) else []
        rows, ends = rows_of_cells(cells, offset, voxels.index, counts.cell_of_row)
        return LooseChange(rows, voxels.mean.take(rows, 0), ends, np.unique(gone))

    def _count(self, rows: Rows, loose: NDArray[np.bool_]) -> None:
        counts = self._counts
        cells, gone = recount(rows, loose, self._voxels.coarse, counts.cell_of_row, counts.loose)
        if len(cells):
            counts.dirty.append(cells)
        if len(gone):
            counts.gone.append(gone)

    def _in_turn(self) -> Rows:
        end = self._voxels.row_count
        count = min(self._settings.sweep_rows, end)
        rows = (self._next + np.arange(count, dtype=np.int64)) % max(end, 1)
        self._next = int((self._next + count) % max(end, 1))
        return rows.astype(np.int32)


# ------------------------------------------------------------------------------------------------------------ kernels
@kernel
def recount(
    rows: Rows, loose: NDArray[np.bool_], coarse: Rows, cell_of_row: Rows, count: NDArray[np.uint8]
) -> tuple[Rows, Rows]:
    """Writes cell_of_row and count for rows [M]; returns (cells whose voxels changed, with repetitions, rows no longer loose)."""
    cells, gone = np.empty(2 * len(rows), np.int32), np.empty(len(rows), np.int32)
    n = g = 0
    for i in range(len(rows)):
        row = rows[i]
        was, now = cell_of_row[row], coarse[row] + 1 if loose[i] else 0
        if was == now:
            continue
        if was > 0:
            count[was - 1] -= 1
            cells[n] = was - 1
            n += 1
            if now == 0:
                gone[g] = row
                g += 1
        if now > 0:
            count[now - 1] += 1
            cells[n] = now - 1
            n += 1
        cell_of_row[row] = now
    return cells[:n], gone[:g]


@kernel
def grow(
    seeds: Rows, count: NDArray[np.uint8], visited: Rows, visit: int, neighbours: NDArray[np.int32], limit: int
) -> tuple[Rows, NDArray[np.int64], int]:
    """Components (26 neighbours) of the cells with count > 0 that hold a seed or touch an emptied one.

    Returns (cells [C] by component, offset int64 [K + 1], seeds done). Stops before the next seed once limit cells were visited.
    """
    out, offset = np.empty(1024, np.int32), np.zeros(64, np.int64)
    n = k = done = 0
    for s in range(len(seeds)):
        if n >= limit:
            break
        done = s + 1
        for step in range(27):  # an emptied cell's neighbours may have come apart
            start = seeds[s] if step == 0 else _beside(seeds[s], step - 1 if step <= 13 else step, neighbours)
            if start < 0 or count[start] == 0 or visited[start] == visit:
                continue
            first = n
            visited[start] = visit
            if n == len(out):
                out = np.concatenate((out, np.empty(len(out), np.int32)))
            out[n] = start
            n += 1
            while first < n:
                cell = out[first]
                first += 1
                for way in range(27):
                    other = _beside(cell, way, neighbours)
                    if other >= 0 and count[other] > 0 and visited[other] != visit:
                        visited[other] = visit
                        if n == len(out):
                            out = np.concatenate((out, np.empty(len(out), np.int32)))
                        out[n] = other
                        n += 1
            k += 1
            if k == len(offset):
                offset = np.concatenate((offset, np.zeros(len(offset), np.int64)))
            offset[k] = n
            if count[seeds[s]] > 0:
                break  # the seed is in this component, and so is all that touches it
    return out[:n], offset[: k + 1], done


@kernel
def _beside(cell: int, way: int, neighbours: NDArray[np.int32]) -> int:
    """The cell (slot * 64 + place) one step away in direction 0..26 (13: itself), -1 where the map has none."""
    slot, place = cell // BLOCK_COARSE, cell % BLOCK_COARSE
    u, v, w = place // 16 + way // 9 - 1, place // 4 % 4 + way // 3 % 3 - 1, place % 4 + way % 3 - 1
    other = neighbours[slot, ((u >> 2) + 1) * 9 + ((v >> 2) + 1) * 3 + (w >> 2) + 1] - 1
    if other < 0:
        return -1
    return int(other * BLOCK_COARSE + (u & 3) * 16 + (v & 3) * 4 + (w & 3))


@kernel
def rows_of_cells(
    cells: Rows, offset: NDArray[np.int64], index: NDArray[np.int32], cell_of_row: Rows
) -> tuple[Rows, NDArray[np.int64]]:
    """Rows of the loose voxels in cells [C] by component, and their offset [K + 1]."""
    rows, ends = np.empty(8 * len(cells), np.int32), np.zeros(len(offset), np.int64)
    n = 0
    for k in range(len(offset) - 1):
        for c in range(offset[k], offset[k + 1]):
            slot, place = cells[c] // BLOCK_COARSE, cells[c] % BLOCK_COARSE
            x, y, z = 2 * (place // 16), 2 * (place // 4 % 4), 2 * (place % 4)
            for corner in range(8):
                inner = ((x + corner // 4) << 6) | ((y + corner // 2 % 2) << 3) | (z + corner % 2)
                row = index[slot, inner] - 1
                if row >= 0 and cell_of_row[row] == cells[c] + 1:
                    rows[n] = row
                    n += 1
        ends[k + 1] = n
    return rows[:n], ends
