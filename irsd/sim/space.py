"""Obstacles of the world seen from above, the clearance at any place, and shortest ways through the free space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from irsd.core.grid import GridFrame

ROBOT_RADIUS_M = 0.22
_PLAN_MARGIN_M = 0.05
_CAP_M = 1.0


@dataclass(frozen=True, slots=True)
class Obstacles:
    """Solid shapes at the robot's height: shapes float64 [N, 5] (x, y, half length, half width or -1 for a disc, yaw)."""

    shapes: NDArray[np.float64]

    def distance(self, points_xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """[P] metres from points [P, 2] to the nearest surface, negative inside a shape."""
        x, y, hx, hy, yaw = self.shapes.T
        dx, dy = points_xy[:, None, 0] - x, points_xy[:, None, 1] - y
        return np.asarray(_signed(dx, dy, hx, hy, yaw).min(1))


def _signed(
    dx: NDArray[np.float64],
    dy: NDArray[np.float64],
    half_x: NDArray[np.float64],
    half_y: NDArray[np.float64],
    yaw: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Signed distance of offsets to turned rectangles, or to discs where half_y < 0. Shapes broadcast."""
    c, s = np.cos(yaw), np.sin(yaw)
    qx = np.abs(c * dx + s * dy) - half_x
    qy = np.abs(-s * dx + c * dy) - half_y
    rectangle = np.hypot(np.maximum(qx, 0), np.maximum(qy, 0)) + np.minimum(np.maximum(qx, qy), 0)
    return np.asarray(np.where(half_y < 0, np.hypot(dx, dy) - half_x, rectangle))


class FreeSpace:
    """Clearance on a grid and ways over it. clearance_m: float32 [H, W], metres to the nearest obstacle, capped at 1 m."""

    def __init__(self, frame: GridFrame, obstacles: Obstacles) -> None:
        self.frame = frame
        self.clearance_m = _clearance(frame, obstacles)
        self._drivable = self.clearance_m >= ROBOT_RADIUS_M + _PLAN_MARGIN_M
        labels, _ = ndimage.label(self._drivable, np.ones((3, 3)))
        row, col = frame.cells_of(np.zeros((1, 2)))[0]
        self._reached = (labels == labels[row, col]) & (labels[row, col] > 0)
        self._graph: sparse.csr_array | None = None

    def reachable(self, points_xy: NDArray[np.float64]) -> NDArray[np.bool_]:
        """[P] can the robot drive from the start to points [P, 2]."""
        cells = self.frame.cells_of(points_xy)
        inside = self.frame.inside(cells)
        out = np.zeros(len(cells), np.bool_)
        out[inside] = self._reached[cells[inside, 0], cells[inside, 1]]
        return out

    def clearance_at(self, points_xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """[P] metres to the nearest obstacle, bilinear between cells; outside of the grid as at its border."""
        resolution = self.frame.resolution_m
        col = np.clip((points_xy[:, 0] - self.frame.origin_xy_m[0]) / resolution - 0.5, 0, self.frame.width - 1.001)
        row = np.clip((points_xy[:, 1] - self.frame.origin_xy_m[1]) / resolution - 0.5, 0, self.frame.height - 1.001)
        c, r = col.astype(np.int64), row.astype(np.int64)
        fc, fr = col - c, row - r
        grid = self.clearance_m
        lower = grid[r, c] * (1 - fc) + grid[r, c + 1] * fc
        upper = grid[r + 1, c] * (1 - fc) + grid[r + 1, c + 1] * fc
        return np.asarray(lower * (1 - fr) + upper * fr, np.float64)

    def all_connected(self, polygons_xy: list[NDArray[np.float64]]) -> bool:
        """Has every room a fair share of floor that the robot can reach from the start?"""
        for polygon in polygons_xy:
            cells = self.frame.centres_of(np.argwhere(self._reached))
            if inside_polygon(cells, polygon).sum() * self.frame.resolution_m**2 < 0.35:
                return False
        return True

    def viewpoint(self, polygon_xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """[2] a reachable place in the room from which it is seen well: open, and near the room's middle."""
        cells = np.argwhere(self._reached)
        points = self.frame.centres_of(cells)
        within = inside_polygon(points, polygon_xy)
        cells, points = cells[within], points[within]
        clearance = self.clearance_m[cells[:, 0], cells[:, 1]]
        score = np.minimum(clearance, 0.7) - 0.5 * np.linalg.norm(points - polygon_xy.mean(0), axis=1)
        return np.asarray(points[int(score.argmax())])

    def distances(self, start_xy: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Cost of the way from start [2] to every cell (flat [H*W], inf where none), and each cell's predecessor."""
        if self._graph is None:
            self._graph = _graph(self._drivable, self.clearance_m, self.frame.resolution_m)
        row, col = self._nearest_drivable(start_xy)
        cost, before = csgraph.dijkstra(self._graph, indices=row * self.frame.width + col, return_predecessors=True)
        return np.asarray(cost), np.asarray(before, np.int32)

    def path(self, before: NDArray[np.int32], goal_xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """[K, 2] way to the goal, from predecessors of ``distances``."""
        row, col = self._nearest_drivable(goal_xy)
        flat = [row * self.frame.width + col]
        while before[flat[-1]] >= 0:
            flat.append(int(before[flat[-1]]))
        cells = np.array(flat[::-1])
        return self.frame.centres_of(np.stack([cells // self.frame.width, cells % self.frame.width], -1))

    def cost_at(self, cost: NDArray[np.float64], point_xy: NDArray[np.float64]) -> float:
        """Cost of the way to a point, from ``distances``."""
        row, col = self._nearest_drivable(point_xy)
        return float(cost[row * self.frame.width + col])

    def _nearest_drivable(self, point_xy: NDArray[np.float64]) -> tuple[int, int]:
        cells = np.argwhere(self._reached)
        gap = np.abs(self.frame.centres_of(cells) - point_xy).sum(1)
        row, col = cells[int(gap.argmin())]
        return int(row), int(col)


def _clearance(frame: GridFrame, obstacles: Obstacles) -> NDArray[np.float32]:
    """Distance of every cell's centre to the nearest obstacle, each shape only where it is near (<= _CAP_M)."""
    out = np.full((frame.height, frame.width), _CAP_M)
    for shape in obstacles.shapes:
        x, y, hx, hy, yaw = (float(v) for v in shape)
        reach = np.hypot(hx, max(hy, 0)) + _CAP_M
        (r0, c0), (r1, c1) = frame.cells_of(np.array([[x - reach, y - reach], [x + reach, y + reach]]))
        rows, cols = slice(max(r0, 0), max(r1 + 1, 0)), slice(max(c0, 0), max(c1 + 1, 0))
        height, width = out[rows, cols].shape
        gy = (np.arange(height) + rows.start + 0.5) * frame.resolution_m + frame.origin_xy_m[1] - y
        gx = (np.arange(width) + cols.start + 0.5) * frame.resolution_m + frame.origin_xy_m[0] - x
        distance = _signed(gx[None, :], gy[:, None], *(np.array(v) for v in (hx, hy, yaw)))
        out[rows, cols] = np.minimum(out[rows, cols], distance)
    return out.astype(np.float32)


def _graph(drivable: NDArray[np.bool_], clearance_m: NDArray[np.float32], resolution_m: float) -> sparse.csr_array:
    """8-neighbour graph of the drivable cells; a metre costs up to 3 where it is tight, so that ways keep off walls."""
    height, width = drivable.shape
    price = 1.0 + 2.0 * np.clip((0.45 - clearance_m) / 0.2, 0, 1)
    index = np.arange(height * width).reshape(height, width)
    heads, tails, costs = [], [], []
    for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = (slice(0, height - dr), slice(max(0, -dc), width - max(0, dc)))
        b = (slice(dr, height), slice(max(0, dc), width - max(0, -dc)))
        both = drivable[a] & drivable[b]
        heads.append(index[a][both])
        tails.append(index[b][both])
        costs.append((resolution_m * np.hypot(dr, dc) * (price[a] + price[b]) / 2)[both])
    head, tail, cost = np.concatenate(heads), np.concatenate(tails), np.concatenate(costs)
    both_ways = (np.concatenate([head, tail]), np.concatenate([tail, head]))
    return sparse.csr_array((np.concatenate([cost, cost]), both_ways), shape=(height * width, height * width))


def inside_polygon(points_xy: NDArray[np.float64], polygon_xy: NDArray[np.float64]) -> NDArray[np.bool_]:
    """[P] points [P, 2] inside a convex counter-clockwise polygon [K, 2]."""
    edge = np.roll(polygon_xy, -1, 0) - polygon_xy
    offset = points_xy[:, None] - polygon_xy[None]
    return np.asarray((edge[:, 0] * offset[..., 1] - edge[:, 1] * offset[..., 0] >= 0).all(1))
