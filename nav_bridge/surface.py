"""What of a thing's points is its surface, and how far places are from it. Pure functions over arrays, map frame, metres."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from irsd.graph.model import GraphSnapshot
from nav_bridge.route import CostMap

MAX_POINTS = 1000  # a target's points beyond this many are thinned: they lie millimetres apart
_ON_FLOOR_M = 0.08  # what is no higher than this is no obstacle: the floor, or flat on it
_APART_M = 0.2  # parts of a thing are apart, in plan, where a free square of this edge lies between them
_RISES, _RISES_POINTS = 0.05, 5  # share and number of points above the floor from which a thing is not flat on it


def solid_part(points: NDArray[np.floating], costs: CostMap, floor_z_m: float | None) -> NDArray[np.floating]:
    """Of a thing's points [N, 3] those that are surely it: its greatest part in plan, and no floor that the map knows to be free.

    Masks bleed over the floor and onto what is behind; who stands before the greatest part stands before the thing, also where only
    pieces of it were seen. What lies flat on the floor (carpets, mats) keeps its points. floor_z_m: None where it is not known.
    """
    return _greatest_part(points if floor_z_m is None else _off_free_floor(points, costs, floor_z_m))


def _off_free_floor(points: NDArray[np.floating], costs: CostMap, floor_z_m: float) -> NDArray[np.floating]:
    on_floor = points[:, 2] < floor_z_m + _ON_FLOOR_M
    if np.count_nonzero(~on_floor) < max(_RISES * len(points), _RISES_POINTS):
        return points
    low = np.flatnonzero(on_floor)
    cells = costs.frame.cells_of(points[low])
    inside = costs.frame.inside(cells)
    low, (rows, cols) = low[inside], cells[inside].T
    return np.delete(points, low[costs.known[rows, cols] & ~costs.blocked[rows, cols]], axis=0)


def _greatest_part(points: NDArray[np.floating]) -> NDArray[np.floating]:
    """The points [N, 2+] of the part that has most of them."""
    if not len(points):
        return points
    cells = np.floor(points[:, :2] / _APART_M).astype(np.int64)
    cells -= cells.min(0)
    taken = np.zeros(cells.max(0) + 1, bool)
    taken[cells[:, 0], cells[:, 1]] = True
    part = ndimage.label(taken, np.ones((3, 3)))[0][cells[:, 0], cells[:, 1]]
    return np.asarray(points[part == np.bincount(part).argmax()])


def floor_under(graph: GraphSnapshot, room_id: str | None) -> float | None:
    """Height of the floor of a room, None for what is in none."""
    return next((room.floor_z_m for room in graph.rooms if room.id == room_id), None)


def surface_distance(
    target_xy: NDArray[np.floating], xy: NDArray[np.floating], outlier_points: int = 1
) -> NDArray[np.float64]:
    """[N] plan distance of places [N, 2] to the target's points [M, 2]: the k-th nearest, so that lone noise does not count."""
    points = np.asarray(target_xy, np.float64)[:, :2]
    points, k = _thinned(points, outlier_points)
    away, _ = cKDTree(points).query(np.asarray(xy, np.float64)[:, :2], k=[k])
    return np.asarray(away[:, -1], np.float64)


def surface_at(
    place: NDArray[np.float64], solid: NDArray[np.float64], resolution_m: float, outlier_points: int
) -> tuple[tuple[float, float, float] | None, float]:
    """The point of a target's points [N, 2+] from which its distance to a place is taken, and the bound of its error."""
    points, k = _thinned(solid, outlier_points)
    away = np.hypot(*(points[:, :2] - place).T)
    order = np.argsort(away, kind="stable")
    error_m = resolution_m / math.sqrt(2.0) + float(away[order[k - 1]] - away[order[0]])
    if points.shape[1] < 3:
        return None, round(error_m, 3)
    x, y, z = (round(float(v), 3) for v in points[order[k - 1], :3])
    return (x, y, z), round(error_m, 3)


def _thinned(points: NDArray[np.float64], outlier_points: int) -> tuple[NDArray[np.float64], int]:
    """The points [N, 2+] from which a surface is measured, and how many of them must be as near as it."""
    if outlier_points <= 1:
        return points, 1
    points = points[:: max(1, len(points) // MAX_POINTS)]
    # Masks bleed over the edge of a thing: of many points, two percent may float before the surface.
    return points, max(min(outlier_points, max(1, len(points) // 6)), len(points) // 50)
