"""Log-odds occupancy seen from above, in height slices, so that a ray frees a cell only at the height at which it passes.

The body slices divide the robot's own height (an obstacle in any of them is an obstacle; a ray under or over a table top does
not erase it), then one slice of tall furniture, one just above furniture, one below the ceiling. Heights are above the
floor near the robot. Work is proportional to the scan and the sensor's range, never to the map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.core.settings import setting
from irsd.mapping import kernels

BODY_SLICES = 24  # about 5 cm each: a bed seen at a grazing angle is not erased by the rays just above it
LOW_SLICES = BODY_SLICES // 3  # a ray through these passes under what furniture there is
TALL = BODY_SLICES  # slice between the robot's height and wall_low_m
WALL = BODY_SLICES + 1  # just above furniture, below door lintels
LINTEL = BODY_SLICES + 2  # from the lintels to the ceiling
SLICES = BODY_SLICES + 3
FLOOR, CEILING = SLICES, SLICES + 1  # layers that count sightings of the floor and the ceiling
LAYERS = SLICES + 2
_CHUNK_M = 6.4  # grids grow by whole chunks, so that reallocation is rare
_NONE = 255


@dataclass(frozen=True)
class OccupancySettings:
    """Settings of the occupancy grid."""

    resolution_m: float = setting(0.05, "edge of a plan cell", lo=0.02, hi=0.5)
    max_area_m2: float = setting(10_000.0, "largest area of the grid's rectangle; beyond, points are refused", lo=25.0)
    body_low_m: float = setting(
        0.08, "lowest height above the floor at which something is an obstacle", lo=0.02, hi=0.5
    )
    body_high_m: float = setting(1.2, "the robot's height", lo=0.2, hi=2.0)
    wall_low_m: float = setting(1.8, "above furniture: what stands higher than this is structure", lo=1.0, hi=3.0)
    wall_high_m: float = setting(2.05, "below door lintels: the wall slice ends here", lo=1.2, hi=4.0)
    ceiling_margin_m: float = setting(0.12, "what is closer to the ceiling than this is the ceiling", lo=0.02, hi=0.5)
    hit: int = setting(12, "log-odds steps of a return", lo=1, hi=100)
    passed: int = setting(4, "log-odds steps of a ray that passes", lo=1, hi=100)
    highest: int = setting(60, "log-odds are clamped here, so that what moved away fades", lo=1, hi=120)
    lowest: int = setting(-40, "log-odds are clamped here", lo=-120, hi=-1)
    occupied: int = setting(10, "log-odds from which a slice is occupied", lo=0, hi=120)
    max_rays: int = setting(2500, "rays per scan that free cells (the others take turns)", lo=100, hi=1_000_000)
    ray_range_m: float = setting(12.0, "rays free cells up to this range", lo=1.0, hi=100.0)
    footprint_m: float = setting(0.2, "radius around the robot that is free because it stands there", lo=0.0, hi=1.0)


class PlanArea:
    """A rectangle of plan cells that grows in chunks within a bound, and the arrays [..., H, W] or [H, W, ...] on it."""

    def __init__(self, resolution_m: float, max_area_m2: float) -> None:
        self.resolution_m = resolution_m
        self._chunk = max(round(_CHUNK_M / resolution_m), 1)
        self._max_cells = max_area_m2 / resolution_m**2
        self.low = np.zeros(2, np.int64)  # (row, col) of cell (0, 0) counted from the map's origin
        self.shape = (0, 0)
        self.refused = 0

    @property
    def frame(self) -> GridFrame:
        """Where cell (row, col) of the arrays lies."""
        origin = self.low[::-1] * self.resolution_m
        return GridFrame((float(origin[0]), float(origin[1])), self.resolution_m, *self.shape)

    def cells_of(self, points: NDArray[np.floating]) -> NDArray[np.int64]:
        """(row, col) [N, 2] on the present rectangle of points [N, 2+]."""
        absolute = np.floor(np.asarray(points[:, 1::-1], np.float64) / self.resolution_m).astype(np.int64)
        return absolute - self.low

    def locate(self, points: NDArray[np.floating]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Flat cell numbers [N] (row * width + col; 0 outside) of points [N, 2+], and whether they lie inside [N]."""
        scale = 1 / self.resolution_m
        row = np.floor(points[:, 1].astype(np.float64) * scale).astype(np.int64) - self.low[0]
        col = np.floor(points[:, 0].astype(np.float64) * scale).astype(np.int64) - self.low[1]
        inside = (row >= 0) & (col >= 0) & (row < self.shape[0]) & (col < self.shape[1])
        return np.where(inside, row * self.shape[1] + col, 0), inside

    def cover(self, low_xy: NDArray[np.floating], high_xy: NDArray[np.floating]) -> tuple[int, int, int, int] | None:
        """Grow to hold the box; returns the padding (top, bottom, left, right) in cells, None when nothing changes."""
        low = np.floor(np.asarray(low_xy, np.float64)[::-1] / self.resolution_m).astype(np.int64) // self._chunk
        high = np.floor(np.asarray(high_xy, np.float64)[::-1] / self.resolution_m).astype(np.int64) // self._chunk + 1
        new_low, new_high = low * self._chunk, high * self._chunk
        old_high = self.low + self.shape
        if self.shape[0]:
            new_low, new_high = np.minimum(new_low, self.low), np.maximum(new_high, old_high)
            if (new_low == self.low).all() and (new_high == old_high).all():
                return None
        size = new_high - new_low
        if float(size[0]) * float(size[1]) > self._max_cells:
            self.refused += 1
            return None
        padding = (*(self.low - new_low), *(new_high - old_high)) if self.shape[0] else (0, 0, *size)
        self.low, self.shape = new_low, (int(size[0]), int(size[1]))
        return int(padding[0]), int(padding[2]), int(padding[1]), int(padding[3])


class SliceGrid:
    """The single writer of the log-odds, int8 [LAYERS, H, W]. Layers FLOOR and CEILING count sightings up to a clamp."""

    def __init__(self, settings: OccupancySettings) -> None:
        self.settings = settings
        self.area = PlanArea(settings.resolution_m, settings.max_area_m2)
        self.odds: NDArray[np.int8] = np.zeros((LAYERS, 0, 0), np.int8)

    def integrate(
        self,
        points: NDArray[np.float32],
        origin: NDArray[np.float64],
        level: NDArray[np.bool_],
        floor_z_m: float,
        ceiling_z_m: float | None,
        turn: int,
    ) -> tuple[float, float, float, float] | None:
        """One scan [N, 3] seen from origin [3]; returns the box (xmin, ymin, xmax, ymax) whose class changed, or None."""
        window = self._window(points, origin)
        if window is None:
            return None
        low, shape = window
        table, base_m = self._slice_table(floor_z_m, ceiling_z_m)
        chosen = slice(turn % (stride := max(-(-len(points) // self.settings.max_rays), 1)), None, stride)
        samples = kernels.ray_samples(
            origin, points[chosen], self.settings.resolution_m, self._stop_short(points[chosen], origin, level[chosen]),
            self.settings.ray_range_m,
        )  # fmt: skip
        passed = np.zeros((SLICES, *shape), np.bool_)
        self._mark(passed, samples, low, table, base_m)
        self._mark_footprint(passed, origin, low)
        hit = np.zeros((LAYERS, *shape), np.bool_)
        self._mark(hit, points, low, table, base_m)
        passed &= ~hit[:SLICES]
        return self._apply(hit, passed, low)

    def _stop_short(
        self, points: NDArray[np.float32], origin: NDArray[np.float64], level: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """How far before its end each ray stops to free cells.

        A ray that ends on level surface (a bed, a table) skims it: it would free the slice it ends in over a long stretch.
        """
        slice_m = (self.settings.body_high_m - self.settings.body_low_m) / BODY_SLICES
        delta = points.astype(np.float64) - origin
        length = np.sqrt(np.einsum("ij,ij->i", delta, delta))
        sine = np.abs(delta[:, 2]) / np.maximum(length, 1e-9)
        skim = slice_m / np.maximum(sine, 1e-3)
        return np.where(level, np.maximum(skim, 0.08), 0.08)

    def _window(
        self, points: NDArray[np.float32], origin: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], tuple[int, int]] | None:
        """The part of the grid that this scan can touch: its lowest (row, col) and (height, width); grows the grid."""
        reach = self.settings.ray_range_m
        xy = np.concatenate([points[:, :2], origin[None, :2].astype(np.float32)])
        low_xy = np.maximum(xy.min(0), origin[:2] - reach) - self.settings.footprint_m
        high_xy = np.minimum(xy.max(0), origin[:2] + reach) + self.settings.footprint_m
        padding = self.area.cover(low_xy, high_xy)
        if padding is not None:
            top, bottom, left, right = padding
            self.odds = np.pad(self.odds, ((0, 0), (top, bottom), (left, right)))
        cells = self.area.cells_of(np.stack([low_xy, high_xy]))
        first = np.maximum(cells[0], 0)
        last = np.minimum(cells[1] + 1, self.area.shape)
        if (last <= first).any():
            return None
        return first, (int(last[0] - first[0]), int(last[1] - first[1]))

    def _slice_table(self, floor_z_m: float, ceiling_z_m: float | None) -> tuple[NDArray[np.uint8], float]:
        """Layer of every 1 cm of height (255 = none), and the height at which the table starts."""
        s = self.settings
        below = 0.25  # the table starts this far below the floor: what lies there (a stair down) is not floor
        top = 8.0
        height = np.arange(-below, top, 0.01) + 0.005
        table = np.full(len(height), _NONE, np.uint8)
        body = np.floor((height - s.body_low_m) / (s.body_high_m - s.body_low_m) * BODY_SLICES)
        inside = (height >= s.body_low_m) & (height < s.body_high_m)
        table[inside] = body[inside].clip(0, BODY_SLICES - 1)
        table[(height >= s.body_high_m) & (height < s.wall_low_m)] = TALL
        table[(height >= s.wall_low_m) & (height < s.wall_high_m)] = WALL
        table[(height >= s.wall_high_m)] = LINTEL
        table[np.abs(height) < s.body_low_m] = FLOOR
        table[0] = table[-1] = _NONE  # whatever is lower or higher is clipped to the ends
        if ceiling_z_m is not None:
            table[:-1][height[:-1] > ceiling_z_m - floor_z_m - s.ceiling_margin_m] = CEILING
        return table, floor_z_m - below

    def _mark(
        self,
        seen: NDArray[np.bool_],
        points: NDArray[np.float32],
        low: NDArray[np.int64],
        table: NDArray[np.uint8],
        base_m: float,
    ) -> None:
        """Set the cells of the window [layers, H, W], whose lowest cell is ``low``, that hold the points."""
        resolution = self.area.resolution_m
        corner = (self.area.low + low) * resolution
        layers, height, width = seen.shape
        # One is added before truncation, so that what lies left of the window gives 0 and not -0.3 -> 0.
        col = ((points[:, 0] - np.float32(corner[1])) * np.float32(1 / resolution) + 1).astype(np.int32)
        row = ((points[:, 1] - np.float32(corner[0])) * np.float32(1 / resolution) + 1).astype(np.int32)
        step = ((points[:, 2] - np.float32(base_m)) * np.float32(100)).astype(np.int32)
        layer = table[np.clip(step, 0, len(table) - 1)]
        inside = (col > 0) & (col <= width) & (row > 0) & (row <= height) & (layer < layers)
        flat = (layer.astype(np.int32) * height + (row - 1)) * width + (col - 1)
        seen.reshape(-1)[flat[inside]] = True

    def _mark_footprint(self, seen: NDArray[np.bool_], origin: NDArray[np.float64], low: NDArray[np.int64]) -> None:
        """The robot stands here, so its body slices are free."""
        reach = round(self.settings.footprint_m / self.area.resolution_m)
        if reach < 1:
            return
        row, col = (self.area.cells_of(origin[None, :])[0] - low).tolist()
        offsets = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2, indexing="ij"), -1).reshape(-1, 2)
        cells = offsets[(offsets**2).sum(-1) <= reach * reach] + (row, col)
        cells = cells[(cells >= 0).all(-1) & (cells < seen.shape[1:]).all(-1)]
        seen[:BODY_SLICES, cells[:, 0], cells[:, 1]] = True

    def _apply(
        self, hit: NDArray[np.bool_], passed: NDArray[np.bool_], low: NDArray[np.int64]
    ) -> tuple[float, float, float, float] | None:
        """Add the steps, clamp, and say where a slice changed between occupied, free and unknown."""
        s = self.settings
        height, width = self.area.shape
        flat_odds = self.odds.reshape(-1)
        boxes = []
        for cells, step in ((hit, s.hit), (passed, -s.passed)):
            flat = np.flatnonzero(cells).astype(np.int32)
            line, col = np.divmod(flat, np.int32(cells.shape[2]))
            layer, row = np.divmod(line, np.int32(cells.shape[1]))
            row, col = row + np.int32(low[0]), col + np.int32(low[1])
            place = (layer.astype(np.int64) * height + row) * width + col
            before = flat_odds[place].astype(np.int16)
            after = np.clip(before + np.int16(step), s.lowest, s.highest)
            flat_odds[place] = after
            changed = ((before >= s.occupied) != (after >= s.occupied)) | ((before < 0) != (after < 0))
            changed |= (before == 0) & (layer >= SLICES)
            if changed.any():
                rows, cols = row[changed] + self.area.low[0], col[changed] + self.area.low[1]
                boxes.append((cols.min(), rows.min(), cols.max() + 1, rows.max() + 1))
        if not boxes:
            return None
        box, edge = np.array(boxes), self.area.resolution_m
        x0, y0 = box[:, :2].min(0) * edge
        x1, y1 = box[:, 2:].max(0) * edge
        return float(x0), float(y0), float(x1), float(y1)

    # ------------------------------------------------------------------------------------------------ reading
    def navigation(self) -> tuple[GridFrame, NDArray[np.int8]]:
        """(frame, int8 [H, W]): 100 where any body slice is occupied, 0 where the floor was seen or passed over low, else -1.

        A ray that passes high says nothing of what stands below it: behind a kitchen counter's edge is not free.
        """
        highest = self.odds[:BODY_SLICES].max(0)
        free = (self.odds[:LOW_SLICES].min(0) < 0) | (self.odds[FLOOR] > 0)
        cells = np.where(highest >= self.settings.occupied, 100, np.where(free, 0, -1)).astype(np.int8)
        return self.area.frame, cells

    def layers(self) -> tuple[GridFrame, dict[str, NDArray[np.bool_]]]:
        """Boolean [H, W] layers: wall, free, low, known, lintel (structure between door height and ceiling)."""
        odds, limit = self.odds, self.settings.occupied
        low = (odds[:BODY_SLICES] >= limit).any(0)
        wall, lintel = odds[WALL] >= limit, odds[LINTEL] >= limit
        passed_above = (odds[WALL] < 0) | (odds[LINTEL] < 0)
        seen_flat = (odds[FLOOR] > 0) | (odds[CEILING] > 0)
        passed_low = (odds[: TALL + 1] < 0).any(0) & ~low & (odds[TALL] < limit)
        free = ~wall & (passed_above | seen_flat | passed_low)
        known = (odds != 0).any(0)
        return self.area.frame, {"wall": wall, "free": free, "low": low, "known": known, "lintel": lintel}
