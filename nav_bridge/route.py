"""From where the robot stands to where it shall stand: A* on the inflated occupancy, straightened, cut into waypoints.

Pure functions over arrays. A ``CostMap`` is made once per map; every plan on it is a search, no search touches the map.
Cells are (row, col) of a ``GridFrame``; occupancy is int8: -1 unknown, 0 free, 100 occupied.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.core.settings import setting
from irsd.graph.model import DoorEdge
from nav_bridge.search import least_clearance, search

_DOOR_APART_M = 0.1  # a corner of the way as near to a door as this needs no waypoint beside it
_LARGE_CELLS = 500_000  # a map with more is searched coarsely first
_COARSE = 4  # cells in a side of a coarse one
_FELT_M = 0.6  # round a place where a robot did not get on
_BAND = 6  # coarse cells to each side of the coarse way that are searched


@dataclass(frozen=True, slots=True)
class RouteSettings:
    """How to drive from place to place."""

    robot_radius_m: float = setting(
        0.20, "radius of the circle round the robot's centre that holds its body", lo=0.0, hi=5.0
    )
    clearance_m: float = setting(0.02, "distance kept beyond the radius, always", lo=0.0, hi=2.0)
    comfort_m: float = setting(
        0.25, "distance beyond radius and clearance that is preferred where there is room", lo=0.0, hi=5.0
    )
    comfort_weight: float = setting(
        3.0, "how many times longer a way may be that keeps the comfort distance", lo=0.0, hi=50.0
    )
    spacing_m: float = setting(1.0, "longest distance between two waypoints", lo=0.1, hi=100.0)
    unknown: str = setting(
        "avoid", "cells never seen: avoid them or allow driving into them", choices=("avoid", "allow")
    )
    start_reach_m: float = setting(
        0.8, "how far a robot that stands too close to something may move to get clear", lo=0.0, hi=5.0
    )


@dataclass(frozen=True)
class CostMap:
    """The map as the search sees it.

    clear_m: float32 [H, W], distance of a cell's centre to the next blocked cell's centre. passable: bool [H, W], the robot's
    centre may be there. cost: float32 [H, W] >= 1, price of a metre in a cell. blocked: bool [H, W]. known: bool [H, W], was seen.
    """

    frame: GridFrame
    blocked: NDArray[np.bool_]
    clear_m: NDArray[np.float32]
    passable: NDArray[np.bool_]
    cost: NDArray[np.float32]
    known: NDArray[np.bool_]

    @cached_property
    def regions(self) -> NDArray[np.int32]:
        """[H, W] number of the connected region of a passable cell; cells that are not are of region 0."""
        _, labels = cv2.connectedComponents(self.passable.astype(np.uint8), connectivity=4)
        return np.asarray(labels, np.int32)

    @cached_property
    def coarse(self) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
        """(passable, cost) on coarse cells: passable where any cell is, at the mean cost of those.

        No wall is lost: what is passable keeps off walls by more than a coarse cell.
        """
        height, width = self.passable.shape
        size = (-(-width // _COARSE), -(-height // _COARSE))
        more = (0, -height % _COARSE, 0, -width % _COARSE)
        passable = self.passable.astype(np.float32)
        share, total = (
            cv2.resize(cv2.copyMakeBorder(cells, *more, cv2.BORDER_CONSTANT), size, interpolation=cv2.INTER_AREA)
            for cells in (passable, passable * self.cost)
        )
        return np.asarray(share > 0), np.asarray(total / np.maximum(share, 1e-6), np.float32)


@dataclass(frozen=True, slots=True)
class Route:
    """waypoints: (x_m, y_m, yaw_rad) in the map frame, the first where the robot is, the last where it shall stand."""

    waypoints: tuple[tuple[float, float, float], ...]
    length_m: float
    clearance_m: float


def make_cost_map(frame: GridFrame, occupancy: NDArray[np.int8], settings: RouteSettings) -> CostMap:
    """The search's view of an occupancy grid [H, W]. Beyond the grid's edge nothing is known."""
    cells = np.asarray(occupancy)
    if cells.shape != (frame.height, frame.width):
        raise ValueError(f"occupancy {cells.shape}, its frame says {(frame.height, frame.width)}")
    obstacle = cells >= 50
    blocked = obstacle | (cells < 0) if settings.unknown == "avoid" else obstacle
    edge_is_blocked = settings.unknown == "avoid"
    padded = np.pad(blocked, 1, constant_values=edge_is_blocked)
    if padded.any():
        pixels = cv2.distanceTransform((~padded).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        clear = np.asarray(pixels[1:-1, 1:-1] * np.float32(frame.resolution_m), np.float32)
    else:
        clear = np.full(cells.shape, 1e6, np.float32)
    hard = settings.robot_radius_m + settings.clearance_m
    passable = (clear >= hard) & ~blocked
    lacking = np.clip((hard + settings.comfort_m - clear) / max(settings.comfort_m, 1e-6), 0.0, 1.0)
    cost = (1.0 + settings.comfort_weight * lacking**2).astype(np.float32)
    return CostMap(frame, blocked, clear, passable, cost, cells >= 0)


def narrowed(costs: CostMap, places_xy: Sequence[tuple[float, float]], settings: RouteSettings) -> CostMap:
    """The map as a robot has felt it: round each place where it did not get on, things stand out by a cell more than was seen.

    places_xy: a place that comes twice counts twice.
    """
    if not places_xy:
        return costs
    frame, obstacle = costs.frame, costs.blocked & costs.known
    for place in places_xy:
        low, high = frame.cells_of(np.array([np.subtract(place, _FELT_M), np.add(place, _FELT_M)]))
        window = obstacle[max(low[0], 0) : max(high[0] + 1, 0), max(low[1], 0) : max(high[1] + 1, 0)]
        if window.size:
            window |= cv2.dilate(window.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return make_cost_map(frame, np.where(obstacle, 100, np.where(costs.known, 0, -1)).astype(np.int8), settings)


def snap_to_passable(costs: CostMap, xy: tuple[float, float], reach_m: float) -> tuple[int, int] | None:
    """The passable cell nearest to a place, at most reach_m away; None when there is none."""
    frame = costs.frame
    row, col = (int(v) for v in frame.cells_of(np.array([xy]))[0])
    k = math.ceil(reach_m / frame.resolution_m) + 1
    r0, c0 = max(0, row - k), max(0, col - k)
    window = costs.passable[r0 : max(r0, row + k + 1), c0 : max(c0, col + k + 1)]
    found = np.argwhere(window) + np.array([r0, c0], np.int64)
    if not len(found):
        return None
    away = np.hypot(*(frame.centres_of(found) - xy).T)
    best = int(away.argmin())
    half_cell = frame.resolution_m
    return (int(found[best, 0]), int(found[best, 1])) if away[best] <= max(reach_m, half_cell) else None


def connected_to(costs: CostMap, cell: tuple[int, int]) -> NDArray[np.bool_]:
    """bool [H, W]: passable cells that the robot can get to from a passable cell."""
    return np.asarray((costs.regions == costs.regions[cell]) & costs.passable)


def find_path(costs: CostMap, start: tuple[int, int], goal: tuple[int, int]) -> NDArray[np.int64] | None:
    """Cheapest 8-connected way [K, 2] of passable cells from start to goal, both included; None when there is none.

    A step costs its length in cells times the mean cost of its two cells; diagonal steps never cut a corner. The heuristic
    (octile distance) never over-estimates because a cell costs at least 1: the way is optimal. On a large map it is the cheapest
    near a way on coarse cells, and only where there is none the cheapest of all.
    """
    if not (costs.passable[start] and costs.passable[goal]):
        return None
    if costs.passable.size > _LARGE_CELLS:
        near = _near_coarse_way(costs, start, goal)
        path = None if near is None else _cheapest(near[0], near[1], costs.cost, start, goal)
        if path is not None:
            return path
    return _cheapest(costs.passable, (0, 0), costs.cost, start, goal)


def _cheapest(
    passable: NDArray[np.bool_],
    corner: tuple[int, int],
    cost: NDArray[np.float32],
    start: tuple[int, int],
    goal: tuple[int, int],
) -> NDArray[np.int64] | None:
    """``find_path`` over the passable cells of a window [h, w] whose first cell is ``corner`` of the map that cost [H, W] tells of."""
    source, target = ((cell[0] - corner[0], cell[1] - corner[1]) for cell in (start, goal))
    path = search(np.ascontiguousarray(passable), np.ascontiguousarray(cost), corner, source, target)
    return path + np.array(corner, np.int64) if len(path) else None


def _near_coarse_way(
    costs: CostMap, start: tuple[int, int], goal: tuple[int, int]
) -> tuple[NDArray[np.bool_], tuple[int, int]] | None:
    """Window of the passable cells near the cheapest way on coarse cells, and its first cell; None when there is none."""
    passable, cost = costs.coarse
    ends = ((cell[0] // _COARSE, cell[1] // _COARSE) for cell in (start, goal))
    way = _cheapest(passable, (0, 0), cost, *ends)
    if way is None:
        return None
    low = np.maximum(way.min(0) - _BAND, 0)
    high = np.minimum(way.max(0) + _BAND + 1, passable.shape)
    band = np.zeros(high - low, np.uint8)
    band[way[:, 0] - low[0], way[:, 1] - low[1]] = 1
    wide = np.asarray(cv2.dilate(band, np.ones((2 * _BAND + 1, 2 * _BAND + 1), np.uint8)), bool)
    (r0, c0), (r1, c1) = _COARSE * low, _COARSE * high
    near = costs.passable[r0:r1, c0:c1]
    fine = np.repeat(np.repeat(wide, _COARSE, 0), _COARSE, 1)[: near.shape[0], : near.shape[1]]
    return fine & near, (int(r0), int(c0))


def path_cost(costs: CostMap, path: NDArray[np.integer]) -> float:
    """What ``find_path`` minimises, of a given way [K, 2]; in cells."""
    cells = np.asarray(path)
    price = costs.cost[cells[:, 0], cells[:, 1]].astype(np.float64)
    length = np.hypot(*np.diff(cells, axis=0).T) if len(cells) > 1 else np.zeros(0)
    return float((length * 0.5 * (price[:-1] + price[1:])).sum())


def line_cells(frame: GridFrame, a_xy: NDArray[np.floating], b_xy: NDArray[np.floating]) -> NDArray[np.int64]:
    """[K, 2] cells along a segment, sampled at a quarter of a cell; clipped to the grid by dropping what lies outside."""
    a, b = np.asarray(a_xy, np.float64)[:2], np.asarray(b_xy, np.float64)[:2]
    count = max(2, math.ceil(float(np.hypot(*(b - a))) / (0.25 * frame.resolution_m)) + 1)
    cells = frame.cells_of(a + np.linspace(0.0, 1.0, count)[:, None] * (b - a))
    return cells[frame.inside(cells)]


def _line_clearance(costs: CostMap, a_xy: NDArray[np.floating], b_xy: NDArray[np.floating]) -> float:
    """Least clearance along a segment and a fifth of a cell to its sides: a line that grazes a corner must not depend on rounding."""
    frame = costs.frame
    a, b = ((float(point[0]), float(point[1])) for point in (a_xy, b_xy))
    least = least_clearance(costs.clear_m, frame.origin_xy_m, frame.resolution_m, a, b, 0.2)
    return 0.0 if math.isinf(least) else float(least)


def straighten(costs: CostMap, path: NDArray[np.integer], settings: RouteSettings) -> list[int]:
    """Indices of the corners of a way [K, 2] that are kept: a shortcut is taken only where it comes no closer to obstacles
    than the piece of way it replaces, or keeps the comfort distance."""
    points = costs.frame.centres_of(path)
    clear = costs.clear_m[path[:, 0], path[:, 1]]
    comfort = settings.robot_radius_m + settings.clearance_m + settings.comfort_m
    # A run of equal steps is a line already, however close its neighbours are: where the run of each step ends.
    turns = np.flatnonzero((np.diff(np.diff(path, axis=0), axis=0) != 0).any(1)) + 1
    run_end = np.append(turns, len(path) - 1)[np.searchsorted(turns, np.arange(len(path)), side="right")]
    kept, here, last = [0], 0, len(path) - 1
    while here < last:
        step, reach = 1, here + 1
        # Gallop, then halve: the farthest visible corner, with few line checks.
        low, high = here + 1, last + 1
        while low < high - 1:
            middle = min(here + 2 * step, last) if reach == low and here + 2 * step < high else (low + high) // 2
            middle = min(max(middle, low + 1), high - 1)
            needed = min(comfort, float(clear[here : middle + 1].min())) - 1e-6
            if middle <= run_end[here] or _line_clearance(costs, points[here], points[middle]) >= needed:
                low = reach = middle
                step *= 2
            else:
                high = middle
        here = low
        kept.append(here)
    return kept


def plan_route(
    costs: CostMap,
    start_xy_yaw: tuple[float, float, float],
    goal_xy_yaw: tuple[float, float, float],
    settings: RouteSettings,
    doors: Sequence[DoorEdge] = (),
) -> Route | None:
    """The way from where the robot is to where it shall stand, None when there is none.

    The first waypoint is the robot's own pose, the last is exactly the goal; each waypoint between looks to the next. There is one
    in each of the doors that the way goes through.
    """
    start = snap_to_passable(costs, start_xy_yaw[:2], settings.start_reach_m)
    goal = snap_to_passable(costs, goal_xy_yaw[:2], costs.frame.resolution_m)
    path = find_path(costs, start, goal) if start is not None and goal is not None else None
    if path is None:
        return None
    corners = costs.frame.centres_of(path[straighten(costs, path, settings)])
    if len(corners) == 1:
        corners = np.repeat(corners, 2, 0)
    corners[-1] = goal_xy_yaw[:2]
    here = np.array(start_xy_yaw[:2])
    inside = bool(costs.frame.inside(costs.frame.cells_of(here[None]))[0])
    if inside and _same_cell(costs.frame, here, corners[0]):
        corners[0] = here
    else:  # the robot stands where it should not (too close, or off the map): first move to the nearest good cell
        corners = np.vstack([here, corners])
    points = resample(_with_doors(corners, doors), settings.spacing_m)
    cells = costs.frame.cells_of(points[1:])
    clearance = float(costs.clear_m[cells[:, 0], cells[:, 1]].min()) if len(cells) else 0.0
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    return Route(_with_headings(points, goal_xy_yaw[2]), length, clearance)


def _with_doors(corners: NDArray[np.float64], doors: Sequence[DoorEdge]) -> NDArray[np.float64]:
    """The corners [K, 2] of a way and the points of it that are nearest to the doors it goes through, in order along it."""
    places = np.array([door.position_xy for door in doors], np.float64).reshape(-1, 2)
    widths = np.maximum(np.array([door.width_m for door in doors]) / 2, _DOOR_APART_M)
    out = [corners[:1]]
    for a, b in itertools.pairwise(corners):
        length = float(np.hypot(*(b - a)))
        ahead, offset = (b - a) / max(length, 1e-9), places - a
        along, aside = offset @ ahead, np.abs(offset[:, 0] * ahead[1] - offset[:, 1] * ahead[0])
        through = (along > _DOOR_APART_M) & (along < length - _DOOR_APART_M) & (aside <= widths)
        out += [a + np.sort(along[through])[:, None] * ahead, b[None]]
    return np.concatenate(out)


def _same_cell(frame: GridFrame, a: NDArray[np.floating], b: NDArray[np.floating]) -> bool:
    return bool((frame.cells_of(np.stack([a, b]))[0] == frame.cells_of(np.stack([a, b]))[1]).all())


def resample(corners: NDArray[np.floating], spacing_m: float) -> NDArray[np.float64]:
    """Corners [K, 2] with points put between so that no two are more than spacing_m apart; every corner stays, doubles go."""
    out = [np.asarray(corners[0], np.float64)]
    for corner in np.asarray(corners[1:], np.float64):
        length = float(np.hypot(*(corner - out[-1])))
        if length < 1e-6:
            continue
        pieces = max(1, math.ceil(length / spacing_m - 1e-9))
        begin = out[-1]
        out += [begin + (corner - begin) * (k / pieces) for k in range(1, pieces + 1)]
    return np.asarray(out)


def _with_headings(points: NDArray[np.float64], last_yaw_rad: float) -> tuple[tuple[float, float, float], ...]:
    ahead = np.diff(points, axis=0)
    yaws = [*np.arctan2(ahead[:, 1], ahead[:, 0]).tolist(), last_yaw_rad]
    return tuple(
        (round(float(x), 4), round(float(y), 4), round(float(t), 4)) for (x, y), t in zip(points, yaws, strict=True)
    )
