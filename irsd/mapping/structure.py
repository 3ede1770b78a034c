"""What is floor, ceiling and wall, from geometry alone.

Floor and ceiling heights come from a fading histogram of near-horizontal surface around the robot. Walls are the lines, seen
from above, that vertical surface forms just below the ceiling (furniture and pictures do not reach there); a voxel is WALL
at any height when it lies within a few centimetres of such a line and faces the same way. So a television 5 cm in front of
its wall, or a wardrobe that ends below the ceiling, stays OTHER.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.core.settings import setting
from irsd.mapping import structure_kernels as kernels
from irsd.mapping.occupancy import PlanArea

_BIN_M = 0.02
_BINS = 800  # heights within +-8 m of where the robot was first seen
_TILE_M = 0.2
_LEVEL_TILE_M = 0.4


@dataclass(frozen=True)
class StructureSettings:
    """Settings of the structure labels."""

    radius_m: float = setting(5.0, "floor and ceiling are measured within this distance of the robot", lo=1.0, hi=50.0)
    horizontal: float = setting(0.9, "|n_z| from which surface is horizontal", lo=0.5, hi=1.0)
    upright: float = setting(0.35, "|n_z| up to which surface is upright", lo=0.0, hi=0.9)
    level_tolerance_m: float = setting(0.06, "surface this near to floor or ceiling belongs to it", lo=0.01, hi=0.5)
    slope: float = setting(0.01, "tolerance that is added per metre of distance from the robot", lo=0.0, hi=0.2)
    min_ceiling_m: float = setting(1.9, "ceilings are at least this high above the floor", lo=1.0, hi=10.0)
    wall_band_m: float = setting(0.4, "walls are measured from this far below the ceiling", lo=0.1, hi=2.0)
    wall_min_height_m: float = setting(1.8, "but never lower than this above the floor", lo=0.5, hi=5.0)
    wall_distance_m: float = setting(
        0.025, "patches of surface within this distance of a wall's line are wall", lo=0.005, hi=0.2
    )
    wall_front_m: float = setting(0.012, "patches further in front of a wall's line are things on it", lo=0.0, hi=0.2)
    wall_length_m: float = setting(0.5, "shortest stretch of line (in a 1 m window) that is a wall", lo=0.1, hi=1.0)
    wall_spread_m: float = setting(0.035, "standard deviation across a wall's line at most", lo=0.005, hi=0.2)
    refit_scans: int = setting(8, "a wall tile is fitted again after this many scans", lo=1, hi=1000)
    sweep_rows: int = setting(2048, "voxels per scan, in turn, whose label is brought up to date", lo=0, hi=1_000_000)

    @property
    def limits(self) -> kernels.Limits:
        """What the kernels need of these."""
        return kernels.Limits(*(getattr(self, name) for name in kernels.Limits._fields))


class Levels:
    """Floor and ceiling near the robot. floor_z_m is the robot's own base height until surface has been seen."""

    def __init__(self, settings: StructureSettings) -> None:
        self._settings = settings
        self._histogram = np.zeros(_BINS)
        self._base_m: float | None = None
        self.floor_z_m = 0.0
        self.ceiling_z_m: float | None = None

    def update(
        self, points: NDArray[np.float32], normals: NDArray[np.float32], base: NDArray[np.float64], sensor_z_m: float
    ) -> None:
        """points [C, 3], normals [C, 3] of the surface cells just seen; base [3] is the robot's position."""
        if self._base_m is None:
            self._base_m = float(base[2]) - _BIN_M * _BINS / 2
            self.floor_z_m = float(base[2])
        # 0.97 per scan: about the last 30 scans, which is the present room and not the last floor of the building.
        self._histogram *= 0.97
        kernels.count_levels(points, normals, base, self._base_m, _BIN_M, self._histogram, self._settings.limits)
        sensor_bin = int((sensor_z_m - self._base_m) / _BIN_M)
        floor = self._level(0, sensor_bin - 5, lowest=True)
        self.floor_z_m = floor if floor is not None else self.floor_z_m
        start = max(sensor_bin + 5, int((self.floor_z_m + self._settings.min_ceiling_m - self._base_m) / _BIN_M))
        ceiling = self._level(start, _BINS, lowest=False)
        self.ceiling_z_m = ceiling if ceiling is not None else self.ceiling_z_m

    def forget(self) -> None:
        """Start anew on another floor of the building: what was seen below is not the floor here."""
        self._histogram[:] = 0.0
        self.ceiling_z_m = None

    def _level(self, start: int, end: int, *, lowest: bool) -> float | None:
        """Height of the lowest (or highest) strong peak among bins start..end, refined over +-3 bins; None if there is none."""
        start, end = max(start, 0), min(end, _BINS)
        if end - start < 8 or self._base_m is None:
            return None
        part = self._histogram[start:end]
        smooth = np.convolve(part, np.ones(5), mode="same")
        # Weaker levels (a table, a bed) are not the floor; 0.4 of the strongest leaves room for a floor mostly hidden.
        strong = np.flatnonzero(smooth >= max(0.4 * smooth.max(), 20.0))
        if not len(strong):
            return None
        edge = strong[0] if lowest else strong[-1]
        near = slice(max(edge - 6, 0), edge + 7)
        peak = near.start + int(smooth[near].argmax())
        window = slice(max(peak - 3, 0), peak + 4)
        weights = part[window]
        bins = np.arange(window.start, window.start + len(weights))
        return float(self._base_m + (start + (bins * weights).sum() / weights.sum() + 0.5) * _BIN_M)


class LevelMap:
    """Floor and ceiling height by plan tile of 0.4 m, for rooms of different height and for labels far from the robot."""

    def __init__(self, settings: StructureSettings, max_area_m2: float) -> None:
        self._limits = settings.limits
        self.area = PlanArea(_LEVEL_TILE_M, max_area_m2)
        self._heights = np.full((2, 0, 0), np.nan, np.float32)  # floor, ceiling

    def update(self, surface: NDArray[np.float32], normals: NDArray[np.float32], levels: Levels) -> None:
        """Take in the level patches among the surface cells [C, 3] of one scan."""
        flat = surface[np.abs(normals[:, 2]) >= self._limits.horizontal]
        if not len(flat):
            return
        padding = self.area.cover(*kernels.bounds_xy(flat))
        if padding is not None:
            top, bottom, left, right = padding
            self._heights = np.pad(self._heights, ((0, 0), (top, bottom), (left, right)), constant_values=np.nan)
        kernels.blend_levels(self.tiles(levels), surface, normals, self._limits)

    def tiles(self, levels: Levels) -> kernels.LevelTiles:
        """The heights; where unknown, those near the robot hold."""
        ceiling_m = np.inf if levels.ceiling_z_m is None else levels.ceiling_z_m
        return kernels.LevelTiles(self.area.plan, self._heights, levels.floor_z_m, ceiling_m)


class WallLines:
    """Wall lines by plan tile of 0.2 m and by the sector that the wall faces."""

    def __init__(self, settings: StructureSettings, max_area_m2: float) -> None:
        self._limits = settings.limits
        self.area = PlanArea(_TILE_M, max_area_m2)
        self._moments = np.zeros((0, 0, kernels.SECTORS, 6))
        self._fits = np.zeros((0, 0, kernels.SECTORS, 4), np.float32)
        self._fitted = np.zeros((0, 0), np.int64)
        self._clock = 0

    @property
    def tiles(self) -> kernels.WallTiles:
        return kernels.WallTiles(self.area.plan, self._moments, self._fits, self._fitted)

    def add(self, points: NDArray[np.float32], normals: NDArray[np.float32]) -> None:
        """Upright surface near the ceiling: points [N, 3], normals [N, 3] towards the side it was seen from."""
        if not len(points):
            return
        padding = self.area.cover(*kernels.bounds_xy(points))
        if padding is not None:
            top, bottom, left, right = padding
            plan = ((top, bottom), (left, right))
            self._moments = np.pad(self._moments, (*plan, (0, 0), (0, 0)))
            self._fits = np.pad(self._fits, (*plan, (0, 0), (0, 0)))
            self._fitted = np.pad(self._fitted, plan, constant_values=-1)
        kernels.add_walls(self.tiles, points, normals)

    def refit(self, points: NDArray[np.float32]) -> None:
        """Fit the lines of the tiles that hold these points [N, 3], each tile at most once in refit_scans calls."""
        self._clock += 1
        kernels.fit_walls(self.tiles, points, self._clock, self._limits)
