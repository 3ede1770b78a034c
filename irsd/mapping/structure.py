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
from irsd.core.types import Structure
from irsd.mapping import kernels
from irsd.mapping.occupancy import PlanArea

_BIN_M = 0.02
_BINS = 800  # heights within +-8 m of where the robot was first seen
_SECTORS = 8  # wall directions of 45 degrees, signed: the two faces of a thin wall stay apart
_TILE_M = 0.2
_LEVEL_TILE_M = 0.4
_REACH = 2  # tiles on each side of a wall fit: a window of 1 m


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


class Levels:
    """Floor and ceiling near the robot. floor_z_m is the robot's own base height until surface has been seen."""

    def __init__(self, settings: StructureSettings) -> None:
        self._settings = settings
        self._histogram = np.zeros(_BINS)
        self._base_m: float | None = None
        self.floor_z_m = 0.0
        self.ceiling_z_m: float | None = None

    def update(
        self, points: NDArray[np.float32], normals: NDArray[np.float32], base: kernels.Floats, sensor_z_m: float
    ) -> None:
        """points [C, 3], normals [C, 3] of the surface cells just seen; base [3] is the robot's position."""
        if self._base_m is None:
            self._base_m = float(base[2]) - _BIN_M * _BINS / 2
            self.floor_z_m = float(base[2])
        near = np.linalg.norm(points[:, :2] - base[:2], axis=-1) < self._settings.radius_m
        z = points[near & (np.abs(normals[:, 2]) > self._settings.horizontal), 2]
        bins = np.floor((z - self._base_m) / _BIN_M).astype(np.int64)
        bins = bins[(bins >= 0) & (bins < _BINS)]
        # 0.97 per scan: about the last 30 scans, which is the present room and not the last floor of the building.
        self._histogram = 0.97 * self._histogram + np.bincount(bins, minlength=_BINS)
        sensor_bin = int((sensor_z_m - self._base_m) / _BIN_M)
        floor = self._level(0, sensor_bin - 5, lowest=True)
        self.floor_z_m = floor if floor is not None else self.floor_z_m
        start = max(sensor_bin + 5, int((self.floor_z_m + self._settings.min_ceiling_m - self._base_m) / _BIN_M))
        ceiling = self._level(start, _BINS, lowest=False)
        self.ceiling_z_m = ceiling if ceiling is not None else self.ceiling_z_m

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
        self._settings = settings
        self.area = PlanArea(_LEVEL_TILE_M, max_area_m2)
        self._heights = np.full((2, 0, 0), np.nan, np.float32)  # floor, ceiling

    def update(self, surface: NDArray[np.float32], normals: NDArray[np.float32], levels: Levels) -> None:
        """Take in the level patches [C, 3] of one scan."""
        surface = surface[np.abs(normals[:, 2]) >= self._settings.horizontal]
        if not len(surface):
            return
        padding = self.area.cover(surface[:, :2].min(0), surface[:, :2].max(0))
        if padding is not None:
            top, bottom, left, right = padding
            self._heights = np.pad(self._heights, ((0, 0), (top, bottom), (left, right)), constant_values=np.nan)
        height = surface[:, 2] - np.float32(levels.floor_z_m)
        self._blend(0, surface[np.abs(height) < 2 * self._settings.level_tolerance_m])
        self._blend(1, surface[height > self._settings.min_ceiling_m])

    def _blend(self, which: int, surface: NDArray[np.float32]) -> None:
        """Floor: follow the mean. Ceiling: follow the highest patch; lower ones (lamps, cupboard tops) don't count."""
        cells, inside = self.area.locate(surface)
        place, group = np.unique(cells[inside], return_inverse=True)
        z = surface[inside, 2]
        flat = self._heights[which].reshape(-1)
        old = flat[place]
        if which == 0:
            new = (np.bincount(group, weights=z) / np.maximum(np.bincount(group), 1)).astype(np.float32)
            step = np.where(np.isnan(old), new, old + np.float32(0.2) * (new - old))
        else:
            new = np.full(len(place), -np.inf, np.float32)
            np.maximum.at(new, group, z)
            follow = old + np.float32(0.2) * (new - old)
            step = np.where(np.isnan(old) | (new > old + 0.1), new, np.where(new > old - 0.05, follow, old))
        flat[place] = step

    def at(self, points: NDArray[np.float32], levels: Levels) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Floor and ceiling heights [N] at points [N, 2+]; where unknown, those near the robot (ceiling +inf if unknown)."""
        floor = np.full(len(points), levels.floor_z_m, np.float32)
        ceiling = np.full(len(points), np.inf if levels.ceiling_z_m is None else levels.ceiling_z_m, np.float32)
        if not self._heights.size:
            return floor, ceiling
        cells, inside = self.area.locate(points)
        for which, level in ((0, floor), (1, ceiling)):
            here = self._heights[which].reshape(-1)[cells]
            np.copyto(level, here, where=inside & ~np.isnan(here))
        return floor, ceiling


class WallLines:
    """Wall lines by plan tile of 0.2 m and by the sector that the wall faces."""

    def __init__(self, settings: StructureSettings, max_area_m2: float) -> None:
        self._settings = settings
        self.area = PlanArea(_TILE_M, max_area_m2)
        self._moments = np.zeros((0, 0, _SECTORS, 6))
        self._fits = np.zeros((0, 0, _SECTORS, 4), np.float32)  # n_x, n_y, offset (n . xy), 1 = valid
        self._valid = np.zeros((0, 0), np.bool_)  # any valid line in the tile
        self._fitted = np.zeros((0, 0), np.int64)  # clock of the last fit; -1 = no evidence within reach
        self._clock = 0

    def add(self, points: NDArray[np.float32], normals: NDArray[np.float32]) -> None:
        """Upright surface near the ceiling: points [N, 3], normals [N, 3] towards the side it was seen from."""
        if not len(points):
            return
        self._cover(points)
        cells, inside = self.area.locate(points)
        cells, xy, normals = cells[inside], points[inside, :2].astype(np.float64), normals[inside]
        sector = np.round(np.arctan2(normals[:, 1], normals[:, 0]) / (2 * np.pi / _SECTORS)).astype(np.int64) % _SECTORS
        place = cells * _SECTORS + sector
        unique, group = np.unique(place, return_inverse=True)
        x, y = xy.T
        columns = (None, x, y, x * x, x * y, y * y)
        sums = np.stack([np.bincount(group, weights=c, minlength=len(unique)) for c in columns], -1)
        flat = self._moments.reshape(-1, 6)
        self._wake(np.unique(unique // _SECTORS))
        # Old evidence fades when plenty is there, so that a wall follows the odometry's drift.
        flat[unique] = flat[unique] * np.where(flat[unique, :1] > 300, 0.5, 1.0) + sums

    def _wake(self, tiles: NDArray[np.int64]) -> None:
        """Tiles within reach of evidence are worth fitting."""
        row, col = tiles // self.area.shape[1], tiles % self.area.shape[1]
        fresh = self._moments[row, col, :, 0].sum(-1) == 0
        for down in range(-_REACH, _REACH + 1):
            for right in range(-_REACH, _REACH + 1):
                r = np.clip(row[fresh] + down, 0, self.area.shape[0] - 1)
                c = np.clip(col[fresh] + right, 0, self.area.shape[1] - 1)
                self._fitted[r, c] = np.maximum(self._fitted[r, c], 0)

    def refit(self, points: NDArray[np.float32]) -> None:
        """Fit the lines of the tiles that hold these points, each tile at most once in refit_scans calls."""
        self._clock += 1
        if not len(points) or not self._moments.size:
            return
        cells, inside = self.area.locate(points)
        fitted = self._fitted.reshape(-1)[cells]
        due = (fitted == 0) | ((fitted > 0) & (self._clock - fitted >= self._settings.refit_scans))
        row, col = np.divmod(np.unique(cells[due & inside]), self.area.shape[1])
        if not len(row):
            return
        self._fitted[row, col] = self._clock
        step = np.arange(-_REACH, _REACH + 1)
        rows, cols = row[:, None, None] + step[:, None], col[:, None, None] + step
        rows, cols = np.broadcast_arrays(rows, cols)
        inside = (rows >= 0) & (cols >= 0) & (rows < self.area.shape[0]) & (cols < self.area.shape[1])
        gathered = self._moments[np.where(inside, rows, 0), np.where(inside, cols, 0)]
        gathered = (gathered * inside[..., None, None]).reshape(len(row), -1, _SECTORS, 6)
        # A tile's evidence counts for the sector it faces and both beside it; [T * sectors, tiles * 3, 6].
        parts = np.concatenate([np.roll(gathered, turn, 2) for turn in (-1, 0, 1)], 1)
        parts = parts.transpose(0, 2, 1, 3).reshape(len(row) * _SECTORS, -1, 6)
        fits = self._lines(parts).reshape(len(row), _SECTORS, 4)
        self._fits[row, col] = fits
        self._valid[row, col] = (fits[..., 3] > 0).any(-1)

    def _lines(self, parts: kernels.Floats) -> NDArray[np.float32]:
        """Lines [L, 4] (n_x, n_y, offset, valid) through the parts [L, P, 6] that agree on one; others are left out."""
        fits = np.zeros((len(parts), 4), np.float32)
        some = np.flatnonzero(parts[:, :, 0].sum(-1) >= 20)
        parts = parts[some]
        count = np.maximum(parts[..., 0], 1e-9)
        mean = parts[..., 1:3] / count[..., None]
        weight = np.ones(parts.shape[:2])
        for reach in (0.10, 0.05, 0.0):
            moments = np.einsum("lp,lpk->lk", weight, parts)
            normal, centre, variance = kernels.line_fits(moments)
            if reach:
                away = np.abs(np.einsum("lpk,lk->lp", mean - centre[:, None], normal))
                weight = (
                    away < np.maximum(away.min(-1, keepdims=True, where=count >= 1, initial=9) + 0.02, reach)
                ) * 1.0
        sector = some % _SECTORS * (2 * np.pi / _SECTORS)
        facing = normal[:, 0] * np.cos(sector) + normal[:, 1] * np.sin(sector)
        normal = np.where(facing[:, None] < 0, -normal, normal)
        length, spread = np.sqrt(12 * variance[:, 1]), np.sqrt(variance[:, 0])
        valid = (moments[:, 0] >= 20) & (length >= self._settings.wall_length_m)
        valid &= (spread <= self._settings.wall_spread_m) & (np.abs(facing) > 0.7)
        fits[some] = np.concatenate([normal, (normal * centre).sum(-1, keepdims=True), valid[:, None]], -1)
        return fits

    def near(
        self, points: NDArray[np.float32], surface: NDArray[np.float32], normals: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """[N] True where points [N, 3] are part of a wall.

        A point with a normal (non-zero) must lie on a patch (its centroid: surface [N, 3]) that is in the wall's line and
        faces as the wall does; the patch is an average, so it tells a picture from the wall where single points can't.
        """
        result = np.zeros(len(points), np.bool_)
        if not self._fits.size:
            return result
        cells, in_area = self.area.locate(points)
        inside = np.flatnonzero(in_area & self._valid.reshape(-1)[cells])
        fits = self._fits.reshape(-1, _SECTORS, 4)[cells[inside]]
        n_x, n_y, offset, valid = fits.transpose(2, 1, 0)  # [sectors, M] each
        point, patch, normal = points[inside].T, surface[inside].T, normals[inside].T
        unknown = (normal[0] == 0) & (normal[1] == 0)
        limit = np.float32(self._settings.wall_distance_m)
        own = np.abs(n_x * point[0] + n_y * point[1] - offset)
        in_front = n_x * patch[0] + n_y * patch[1] - offset
        aligned = (n_x * normal[0] + n_y * normal[1] > 0.8) & (own <= 3 * limit)
        aligned &= (in_front <= np.float32(self._settings.wall_front_m)) & (in_front >= -limit)
        result[inside] = ((valid > 0) & np.where(unknown, own <= limit, aligned)).any(0)
        return result

    def _cover(self, points: NDArray[np.float32]) -> None:
        padding = self.area.cover(points[:, :2].min(0), points[:, :2].max(0))
        if padding is None:
            return
        top, bottom, left, right = padding
        plan = ((top, bottom), (left, right))
        self._moments = np.pad(self._moments, (*plan, (0, 0), (0, 0)))
        self._fits = np.pad(self._fits, (*plan, (0, 0), (0, 0)))
        self._valid = np.pad(self._valid, plan)
        self._fitted = np.pad(self._fitted, plan, constant_values=-1)


def in_wall_band(
    surface: NDArray[np.float32],
    normals: NDArray[np.float32],
    levels: Levels,
    level_map: LevelMap,
    settings: StructureSettings,
) -> NDArray[np.bool_]:
    """[N] True for upright patches [N, 3] just below the ceiling of the room that they face."""
    # A wall's own tile may belong to two rooms: ask a little way in front of it.
    floor, ceiling = level_map.at(surface[:, :2] + np.float32(0.3) * normals[:, :2], levels)
    lowest = floor + np.float32(settings.wall_min_height_m)
    top = np.where(np.isfinite(ceiling), ceiling - np.float32(0.08), lowest + np.float32(0.8))
    # Above 2.3 m nothing but structure stands, however high the ceiling is.
    start = np.minimum(np.maximum(top - np.float32(settings.wall_band_m), lowest), floor + np.float32(2.3))
    upright = (np.abs(normals[:, 2]) < settings.upright) & ((normals[:, 0] != 0) | (normals[:, 1] != 0))
    return np.asarray(upright & (surface[:, 2] > start) & (surface[:, 2] < top))


def label_points(
    points: NDArray[np.float32],
    surface: NDArray[np.float32],
    normals: NDArray[np.float32],
    levels: Levels,
    level_map: LevelMap,
    walls: WallLines,
    base: kernels.Floats,
    settings: StructureSettings,
) -> NDArray[np.uint8]:
    """Structure labels [N] of points [N, 3] on patches with centroid surface [N, 3] and normal [N, 3] (zero = not known)."""
    labels = np.full(len(points), Structure.OTHER, np.uint8)
    level = np.abs(normals[:, 2])
    known = (level > 0) | (normals[:, 0] != 0) | (normals[:, 1] != 0)
    distance = np.hypot(points[:, 0] - np.float32(base[0]), points[:, 1] - np.float32(base[1]))
    tolerance = settings.level_tolerance_m + settings.slope * distance
    upright = np.flatnonzero(level <= settings.upright)
    labels[upright[walls.near(points[upright], surface[upright], normals[upright])]] = Structure.WALL
    flat, leaning = level >= settings.horizontal, ~known | (level > settings.upright)
    floor_z, ceiling_z = level_map.at(points, levels)
    height = points[:, 2] - floor_z
    # Without a level normal only what hardly rises above the floor counts, so that feet of furniture stay things.
    floor = (flat & (np.abs(height) < tolerance)) | (leaning & (height < 0.5 * tolerance)) | (height < -tolerance)
    labels[floor] = Structure.FLOOR
    below = ceiling_z - points[:, 2]
    labels[((flat | leaning) & (below < tolerance)) | (below < -tolerance)] = Structure.CEILING
    return labels
