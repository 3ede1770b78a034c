"""Where to stand: a pose in known free space, near the target's surface, looking at it, that the robot can get to.

Distances are plan view, from the robot's centre to the target's points: what hangs high on a wall counts as if it stood below.
Pure functions over arrays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.core.settings import setting
from nav_bridge.route import CostMap, connected_to, snap_to_passable
from nav_bridge.surface import MAX_POINTS, surface_at, surface_distance

_RAYS = 12  # target cells a pose is checked for sight of
_HIDDEN = 1.0  # price, in metres, of a pose that sees nothing of its target or stands in another room
_MAX_TRIED, _TRIED_APART_M = 8, 0.2  # of the places weighed, how many an answer tells, and how far they are apart
_LOOK_M = 0.5  # places this much farther than allowed are looked at too, so that a refusal knows the best distance


@dataclass(frozen=True, slots=True)
class ApproachSettings:
    """Where to stand before a target."""

    within_m: float = setting(
        0.5, "farthest distance from the robot's centre to the target's nearest surface", lo=0.05, hi=10.0
    )
    best_m: float = setting(
        0.30,
        "distance liked best; below within_m so that control error, drift and bled surfaces still end within it",
        lo=0.0,
        hi=10.0,
    )
    margin_m: float = setting(
        0.03, "what map and surface may be wrong by: nearer by this to within_m nothing is promised", lo=0.0, hi=1.0
    )
    comfort_m: float = setting(
        0.35, "clearance round the robot's centre that is enough: more is not better", lo=0.0, hi=5.0
    )
    outlier_points: int = setting(
        3, "the surface begins where this many target points are: fewer are taken for noise", lo=1, hi=50
    )


@dataclass(frozen=True, slots=True)
class TriedPose:
    """A place that was weighed. price: what it is worth less than a perfect one, metres; the cheapest wins."""

    x_m: float
    y_m: float
    distance_m: float
    clearance_m: float
    sees: float
    price: float


@dataclass(frozen=True, slots=True)
class ApproachPose:
    """Where to stand. distance_m: plan distance to the target's nearest surface; clearance_m: to the next obstacle.

    sees: share of the target's points that no obstacle hides, 0..1. tried: places that were weighed, at least 0.2 m apart.
    target_m: the point of the surface from which the distance is taken (x, y, z), None for a room. error_m: how much farther the
    surface may be: half a cell's diagonal, and by how much the points before it that were taken for noise are nearer.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    distance_m: float
    clearance_m: float
    sees: float
    tried: tuple[TriedPose, ...] = ()
    target_m: tuple[float, float, float] | None = None
    error_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Unreachable:
    """No pose fulfils the demand. best_m: the least distance any reachable pose has, None when none is reachable."""

    reason: str
    best_m: float | None


def find_approach(
    costs: CostMap,
    target_xy: NDArray[np.floating],
    robot_xy: tuple[float, float],
    settings: ApproachSettings,
    *,
    start_reach_m: float = 0.8,
    room_xy: Sequence[tuple[float, float]] = (),
) -> ApproachPose | Unreachable:
    """The best pose for a target's points [N, 2+] (map frame), or why there is none.

    room_xy: outline of the target's room. Poses in it are preferred: a thin wall between pose and target is then no way round
    the distance. Everything is in the map frame, metres.
    """
    solid = np.asarray(target_xy, np.float64)
    points = solid[:: max(1, len(solid) // MAX_POINTS), :2]
    if not len(points):
        return Unreachable("the target has no points", None)
    start = snap_to_passable(costs, robot_xy, start_reach_m)
    if start is None:
        return Unreachable("the robot stands where the map has no free space", None)
    standing = connected_to(costs, start)
    cells = _cells_near(costs, standing, points, settings.within_m + _LOOK_M)
    xy = costs.frame.centres_of(cells)
    away = surface_distance(points, xy, settings.outlier_points)
    near = np.flatnonzero(away <= settings.within_m - settings.margin_m)
    if not len(near):
        best, words = float(away.min()), ""
        if best <= settings.within_m:
            words = f": too close to the limit of {settings.within_m:.2f} m for what is known"
        return Unreachable(f"the nearest place to stand is {best:.2f} m from its surface{words}", best)
    cells, xy, away = cells[near], xy[near], away[near]
    clear = costs.clear_m[cells[:, 0], cells[:, 1]]
    inside = in_polygon(xy, room_xy) if len(room_xy) >= 3 else np.ones(len(xy), bool)
    price = _price(away, clear, inside, settings) + 0.01 * np.hypot(*(xy - robot_xy).T)
    best, weighed = _cheapest(price, xy, Sight(costs, points))
    x, y = (round(float(v), 4) for v in xy[best])
    tried = _apart(weighed, best, price, xy, away, clear)
    surface, error_m = surface_at(xy[best], solid, costs.frame.resolution_m, settings.outlier_points)
    return ApproachPose(
        x, y, _yaw_to(xy[best], points), float(away[best]), float(clear[best]), weighed[best], tried, surface, error_m
    )


def _cells_near(
    costs: CostMap, standing: NDArray[np.bool_], points: NDArray[np.float64], reach_m: float
) -> NDArray[np.int64]:
    """[K, 2] cells where the robot can stand (mask [H, W], not empty) round a target's points [N, 2]; all, if none is near it.

    The work is the target's, not the map's.
    """
    low, high = costs.frame.cells_of(np.stack([points.min(0) - reach_m, points.max(0) + reach_m]))
    low = np.maximum(low, 0)
    cells = np.argwhere(standing[low[0] : max(high[0] + 1, 0), low[1] : max(high[1] + 1, 0)]) + low
    return cells if len(cells) else np.argwhere(standing)


def _apart(
    weighed: Mapping[int, float],
    best: int,
    price: NDArray[np.float64],
    xy: NDArray[np.float64],
    away: NDArray[np.float64],
    clear: NDArray[np.float32],
) -> tuple[TriedPose, ...]:
    """The places that were weighed (index -> share seen) for people: the best first, no two neighbours, not too many."""
    kept: list[int] = []
    for k in sorted(weighed, key=lambda k: (k != best, price[k] + _HIDDEN * (1.0 - weighed[k]))):
        if len(kept) < _MAX_TRIED and all(np.hypot(*(xy[k] - xy[j])) >= _TRIED_APART_M for j in kept):
            kept.append(k)
    return tuple(
        TriedPose(
            float(xy[k, 0]), float(xy[k, 1]), float(away[k]), float(clear[k]), weighed[k],
            float(price[k] + _HIDDEN * (1.0 - weighed[k])),
        )
        for k in kept
    )  # fmt: skip


def _cheapest(price: NDArray[np.float64], xy: NDArray[np.float64], sight: Sight) -> tuple[int, dict[int, float]]:
    """The place [N, 2] whose price and hidden target together cost least, and what share is seen from each that was weighed.

    Sight is dear to compute and only adds to the price: places are tried in order of price until none can be better.
    """
    best, best_price = 0, math.inf
    weighed: dict[int, float] = {}
    for k in np.argsort(price, kind="stable"):
        if price[k] >= best_price:
            break
        sees = weighed[int(k)] = sight.share(xy[k])
        total = price[k] + _HIDDEN * (1.0 - sees)
        if total < best_price:
            best, best_price = int(k), float(total)
    return best, weighed


def _price(
    away: NDArray[np.float64], clear: NDArray[np.float32], inside: NDArray[np.bool_], settings: ApproachSettings
) -> NDArray[np.float64]:
    """What each pose [N] is worth less: distance, tightness, wrong side of a wall. Metres, roughly."""
    best = min(settings.best_m, settings.within_m - settings.margin_m)
    distance = np.abs(away - best) * np.where(away > best, 4.0, 1.0)
    tight = np.clip(settings.comfort_m - clear, 0.0, None) * 2.0
    return np.asarray(distance + tight + np.where(inside, 0.0, _HIDDEN))


class Sight:
    """Which share of a target a place sees past obstacles, in plan. Cells that hold target points hide nothing."""

    def __init__(self, costs: CostMap, target_xy: NDArray[np.floating]) -> None:
        self._frame = costs.frame
        self._blocked = costs.blocked.copy()
        own = self._frame.cells_of(target_xy)
        own = np.unique(own[self._frame.inside(own)], axis=0)
        self._blocked[own[:, 0], own[:, 1]] = False
        self._target = self._frame.centres_of(own) if len(own) else np.asarray(target_xy, np.float64)[:1, :2]

    def share(self, place: NDArray[np.floating]) -> float:
        """0..1 for a place (x, y): of the nearer half of the target's cells, as its far side is hidden by itself."""
        away = np.hypot(*(self._target - place).T)
        order = np.argsort(away, kind="stable")[: max(1, len(away) // 2)]
        sample = self._target[order][:: max(1, len(order) // _RAYS)][:_RAYS]
        steps = max(2, math.ceil(float(away[order[-1]]) / (0.4 * self._frame.resolution_m)))
        lines = place + np.linspace(0.0, 1.0, steps)[None, :, None] * (sample - place)[:, None, :]
        cells = self._frame.cells_of(lines.reshape(-1, 2))
        inside = self._frame.inside(cells)
        cells = np.where(inside[:, None], cells, 0)
        hidden = (self._blocked[cells[:, 0], cells[:, 1]] & inside).reshape(len(sample), steps).any(1)
        return float(1.0 - hidden.mean())


def in_polygon(xy: NDArray[np.floating], polygon_xy: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    """[N] True for points [N, 2] inside a polygon (even-odd rule)."""
    corners = np.asarray(polygon_xy, np.float64)
    x, y = np.asarray(xy, np.float64)[:, :2].T
    inside = np.zeros(len(x), bool)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, 0), strict=True):
        if ay == by:
            continue
        crosses = (ay > y) != (by > y)
        inside ^= crosses & (x < (bx - ax) * (y - ay) / (by - ay) + ax)
    return inside


def _yaw_to(place: NDArray[np.float64], points: NDArray[np.float64]) -> float:
    """Heading towards the target: between its nearest surface and its middle, so that long things are faced squarely."""
    away = np.hypot(*(points - place).T)
    near = points[away <= away.min() + 0.15].mean(0)
    dx, dy = near - place
    if math.hypot(dx, dy) < 1e-6:
        dx, dy = points.mean(0) - place
    return round(math.atan2(dy, dx), 4)
