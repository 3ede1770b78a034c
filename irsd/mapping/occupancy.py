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
from irsd.mapping import ray_kernels
from irsd.mapping.ray_kernels import Rays, Steps, Window
from irsd.mapping.structure_kernels import Plan, bounds_xy

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
_DEPTH = 32  # layers with padding: four words of memory


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

    @property
    def plan(self) -> Plan:
        """The rectangle as kernels take it."""
        return Plan(1 / self.resolution_m, int(self.low[0]), int(self.low[1]), *self.shape)

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
    """The single writer of the log-odds, int8 [H, W, 32]. Layers FLOOR and CEILING count sightings up to a clamp."""

    def __init__(self, settings: OccupancySettings) -> None:
        self.settings = settings
        self.area = PlanArea(settings.resolution_m, settings.max_area_m2)
        self.odds: NDArray[np.int8] = np.zeros((0, 0, _DEPTH), np.int8)

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
        bits, base_m = self._slice_bits(floor_z_m, ceiling_z_m)
        window = self._window(points, origin, base_m)
        if window is None:
            return None
        s = self.settings
        stride = max(-(-len(points) // s.max_rays), 1)
        slice_m = (s.body_high_m - s.body_low_m) / BODY_SLICES
        rays = Rays(turn % stride, stride, s.resolution_m, s.ray_range_m, slice_m)
        hit, passed = np.zeros((2, window.height, window.width), np.uint32)
        ray_kernels.mark_points(hit, window, bits, points)
        ray_kernels.mark_rays(passed, window, bits, origin, points, level, rays)
        if (radius := round(s.footprint_m / s.resolution_m)) > 0:  # the robot stands here, so its body slices are free
            row, col = (self.area.cells_of(origin[None, :])[0] - (window.row, window.col)).tolist()
            ray_kernels.mark_disc(passed, row, col, radius, BODY_SLICES)
        steps = Steps(s.hit, s.passed, s.lowest, s.highest, s.occupied, SLICES)
        x0, y0, x1, y1 = ray_kernels.apply_marks(self.odds, hit, passed, window, steps)
        if x1 == 0:
            return None
        (bottom, left), edge = self.area.low.tolist(), s.resolution_m
        return (x0 + left) * edge, (y0 + bottom) * edge, (x1 + left) * edge, (y1 + bottom) * edge

    def _window(self, points: NDArray[np.float32], origin: NDArray[np.float64], base_m: float) -> Window | None:
        """The part of the grid that this scan can touch; grows the grid."""
        reach = self.settings.ray_range_m
        low, high = bounds_xy(points)
        low_xy = np.clip(low, origin[:2] - reach, origin[:2]) - self.settings.footprint_m
        high_xy = np.clip(high, origin[:2], origin[:2] + reach) + self.settings.footprint_m
        padding = self.area.cover(low_xy, high_xy)
        if padding is not None:
            top, bottom, left, right = padding
            self.odds = np.pad(self.odds, ((top, bottom), (left, right), (0, 0)))
        cells = self.area.cells_of(np.stack([low_xy, high_xy]))
        first = np.maximum(cells[0], 0)
        last = np.minimum(cells[1] + 1, self.area.shape)
        if (last <= first).any():
            return None
        (row, col), (height, width) = first.tolist(), (last - first).tolist()
        resolution = self.area.resolution_m
        corner = (self.area.low + first) * resolution
        y_m, x_m, base, scale = np.array([*corner, base_m, 1 / resolution], np.float32)
        return Window(row, col, height, width, x_m, y_m, base, scale)

    def _slice_bits(self, floor_z_m: float, ceiling_z_m: float | None) -> tuple[ray_kernels.Bits, float]:
        """Layer, as a bit, of every 1 cm of height (0 = none), and the height at which the table starts."""
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
        return np.where(table == _NONE, 0, 1 << table.astype(np.int64) % 32).astype(np.uint32), floor_z_m - below

    # ------------------------------------------------------------------------------------------------ reading
    def navigation(self) -> tuple[GridFrame, NDArray[np.int8]]:
        """(frame, int8 [H, W]): 100 where any body slice is occupied, 0 where the floor was seen or passed over low, else -1.

        A ray that passes high says nothing of what stands below it: behind a kitchen counter's edge is not free.
        """
        low, _, highest, _, _, _, floor, _ = ray_kernels.summary(self.odds, LOW_SLICES, BODY_SLICES, LAYERS)
        free = (low < 0) | (floor > 0)
        cells = np.where(highest >= self.settings.occupied, np.int8(100), np.where(free, np.int8(0), np.int8(-1)))
        return self.area.frame, cells

    def layers(self) -> tuple[GridFrame, dict[str, NDArray[np.bool_]]]:
        """Boolean [H, W] layers: wall, free, low, known, lintel (structure between door height and ceiling)."""
        planes = ray_kernels.summary(self.odds, LOW_SLICES, BODY_SLICES, LAYERS)
        _, lowest, highest, tall, above, upper, floor, ceiling = planes
        limit = self.settings.occupied
        low, wall, lintel = highest >= limit, above >= limit, upper >= limit
        passed_above = (above < 0) | (upper < 0)
        seen_flat = (floor > 0) | (ceiling > 0)
        passed_low = ((lowest < 0) | (tall < 0)) & ~low & (tall < limit)
        free = ~wall & (passed_above | seen_flat | passed_low)
        known = planes.any(0)
        return self.area.frame, {"wall": wall, "free": free, "low": low, "known": known, "lintel": lintel}
