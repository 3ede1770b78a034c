"""Where a robot is in a stored plan, from what it sees now and nothing else: correlative scan matching by branch and bound.

Every place and heading is scored by how well the walls seen now lie on stored walls, and not in stored free space (Olson 2009,
"Real-time correlative scan matching"). Maxima of the score over windows of 2^h cells bound it from above, so that the best of all is
found without trying all (Hess et al. 2016, "Real-time loop closure in 2D LiDAR SLAM", algorithm 3). The answer is refused when it
fits badly, and when another place fits almost as well: two offices may be alike. Pure functions.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.geometry import Pose, invert, pose_from_xy_yaw
from irsd.core.grid import GridFrame
from irsd.core.jit import kernel
from irsd.core.types import Plan
from irsd.mapping.kernels import Floats

Cells = NDArray[np.int16]

_CELL_M = 0.1
_LEVELS = 5  # windows of up to 16 cells
_UNIT = 200  # of the score, in whole numbers
_SIGMA_M = 0.1  # by how much walls of two plans may lie apart
_IN_FREE = -0.5  # score of a wall where the stored plan is free
_RANGE_M = 12.0  # walls farther off than that are left out
_MOST_POINTS = 400
_LEAST_POINTS = 40  # 4 m of wall
# Least mean score: the right place had >= 0.94 in the embedded world and the small house, another building mostly below 0.8, but 0.94
# once, from inside one room: whoever relocalises compares the plans as well. And the share of it from which another place is alike.
_GOOD, _ALIKE = 0.85, 0.9
_APART_M, _APART_RAD = 0.8, 0.35  # nearer than that it is the same place


@dataclass(frozen=True, slots=True)
class Near:
    """Where to look: within reach_m of (x_m, y_m) in the stored frame, the seen plan turned by yaw_rad, give or take reach_rad."""

    x_m: float
    y_m: float
    reach_m: float
    yaw_rad: float
    reach_rad: float


@dataclass(frozen=True, slots=True)
class Relocation:
    """Where the frame of the plan seen now lies in that of the stored one.

    score: mean over the walls seen now, 1 = all on stored walls, -0.5 = all in stored free space. runner_up: the best score
    elsewhere if that is alike, else 0. refused: why this must not be believed; empty when it may.
    """

    stored_T_now: Pose
    score: float
    runner_up: float
    refused: str

    @property
    def accepted(self) -> bool:
        return not self.refused


def find_place(now: Plan, robot_xy: tuple[float, float], stored: Plan, near: Near | None = None) -> Relocation:
    """Where a robot at robot_xy, in the frame of ``now``, is in ``stored``. Costs 0.1-5 s, by the size of the stored plan.

    near: the only places that come into question; None: all.
    """
    robot = np.array(robot_xy, np.float64)
    walls = _wall_points(now, robot)
    if len(walls) < _LEAST_POINTS or not stored.wall.any() or not stored.free.any():
        return Relocation(np.eye(4), 0.0, 0.0, "too little is seen to tell where this is")
    field, free, origin_xy = _fields(stored)
    if near is not None:
        free &= _disc(free.shape, (np.array([near.x_m, near.y_m]) - origin_xy) / _CELL_M, near.reach_m / _CELL_M)
    bounds = np.stack([_window_max(field, 1 << h) for h in range(_LEVELS)])
    open_to = np.stack([_window_max(free.astype(np.int16), 1 << h) for h in range(_LEVELS)])
    farthest = max(float(np.hypot(*walls.T).max()), 1.0)
    count = int(np.ceil(2 * np.pi / (_CELL_M / farthest)))  # neighbouring headings move the farthest wall by a cell
    yaws = np.arange(count, dtype=np.float64) * (2 * np.pi / count)
    turns = _turned(walls, yaws)
    roots = _root_scores(turns, bounds[-1], open_to[-1])
    if near is not None:
        off_rad = np.abs((yaws - near.yaw_rad + np.pi) % (2 * np.pi) - np.pi)
        roots = roots[off_rad[roots[:, 1]] <= near.reach_rad]
    apart = np.array([_APART_M / _CELL_M, _APART_RAD * count / (2 * np.pi)])
    nowhere = np.array([-1, -1, -1])
    best, place = _descend(turns, bounds, open_to, roots, -_UNIT * len(walls), nowhere, apart)
    if best <= -_UNIT * len(walls):
        return Relocation(np.eye(4), 0.0, 0.0, "nothing seen now fits anywhere in the stored plan")
    alike = int(_ALIKE * best)
    second, _ = _descend(turns, bounds, open_to, roots, alike, place, apart)
    at = origin_xy + (place[[2, 1]] + 0.5) * _CELL_M
    guess = np.array([at[0], at[1], place[0] * 2 * np.pi / count])
    (x, y, yaw), score = _refined(walls, guess, stored)
    runner_up = score * second / best if second > alike else 0.0
    stored_T_now = pose_from_xy_yaw(x, y, yaw) @ invert(pose_from_xy_yaw(robot[0], robot[1], 0.0))
    refused = ""
    if score < _GOOD:
        refused = f"what is seen now fits nowhere well (best {score:.2f}, needed {_GOOD:.2f})"
    elif runner_up > 0.0:
        refused = f"two places look alike ({score:.2f} and {runner_up:.2f}): drive on and try again"
    return Relocation(stored_T_now, score, runner_up, refused)


def _wall_points(now: Plan, robot: Floats) -> Floats:
    """Walls near the robot, about it: float64 [N, 2], one per search cell, at most _MOST_POINTS."""
    points = now.frame.centres_of(np.argwhere(now.wall)) - robot
    points = points[np.hypot(*points.T) <= _RANGE_M]
    _, first = np.unique(np.floor(points / _CELL_M).astype(np.int64), axis=0, return_index=True)
    points = points[np.sort(first)]
    return np.asarray(points[:: max(-(-len(points) // _MOST_POINTS), 1)], np.float64)


def _fields(stored: Plan) -> tuple[Cells, NDArray[np.bool_], Floats]:
    """Score of a wall int16 [H, W], where a robot can stand, and the place of cell (0, 0)'s corner; with room around."""
    margin = int(_RANGE_M / _CELL_M) + (1 << _LEVELS)
    low = np.floor(np.array(stored.frame.origin_xy_m) / _CELL_M).astype(np.int64) - margin
    size = np.array([stored.frame.height, stored.frame.width]) * stored.frame.resolution_m / _CELL_M
    shape = tuple((np.ceil(size).astype(np.int64) + 2 * margin + 1).tolist())
    wall, free = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    for grid, layer in ((wall, stored.wall), (free, stored.free)):
        cells = np.floor(stored.frame.centres_of(np.argwhere(layer)) / _CELL_M).astype(np.int64) - low
        grid[cells[:, 1], cells[:, 0]] = True
    return (
        np.round(_UNIT * _values(wall, free, _CELL_M)).astype(np.int16),
        free & ~wall,
        low.astype(np.float64) * _CELL_M,
    )


def _disc(shape: tuple[int, ...], centre_xy: Floats, radius: float) -> NDArray[np.bool_]:
    """The cells [H, W] whose centres are within a radius of a place, both in cells."""
    row, column = np.ogrid[: shape[0], : shape[1]]
    return np.asarray(np.hypot(column + 0.5 - centre_xy[0], row + 0.5 - centre_xy[1]) <= radius)


def _values(wall: NDArray[np.bool_], free: NDArray[np.bool_], cell_m: float) -> NDArray[np.float32]:
    """What a wall seen at a cell counts: 1 on stored walls, falling off with the distance to _IN_FREE or 0: float32 [H, W]."""
    away_m = cv2.distanceTransform((~wall).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * cell_m
    near = np.exp(-0.5 * (away_m / _SIGMA_M) ** 2)
    return np.asarray(np.where(free & (away_m > 2 * _SIGMA_M), _IN_FREE, near), np.float32)


def _window_max(values: Cells, size: int) -> Cells:
    """[H, W]: the largest of values[r : r + size, c : c + size]."""
    padded = np.pad(values, ((0, size - 1), (0, size - 1)))
    window = np.ones((size, size), np.uint8)
    grown = cv2.dilate(padded, window, anchor=(0, 0), borderType=cv2.BORDER_CONSTANT, borderValue=-_UNIT)
    return np.asarray(grown[: values.shape[0], : values.shape[1]], np.int16)


def _turned(walls: Floats, yaws: Floats) -> NDArray[np.int32]:
    """Offsets (row, column) [K, N, 2] in cells of points [N, 2], seen from the robot, at each heading [K]."""
    c, s = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
    x, y = c * walls[:, 0] - s * walls[:, 1], s * walls[:, 0] + c * walls[:, 1]
    return np.floor(np.stack([y, x], -1) / _CELL_M + 0.5).astype(np.int32)


@kernel
def _score(offsets: NDArray[np.int32], row: int, column: int, values: Cells) -> int:
    """Sum of values [H, W] at a robot's cell plus offsets [N, 2]; outside counts nothing."""
    total = 0
    for i in range(len(offsets)):
        r, c = row + offsets[i, 0], column + offsets[i, 1]
        if 0 <= r < values.shape[0] and 0 <= c < values.shape[1]:
            total += values[r, c]
    return total


@kernel
def _root_scores(turns: NDArray[np.int32], bound: Cells, open_to: Cells) -> NDArray[np.int64]:
    """[R, 4]: bound, heading, row and column of every largest window in which a robot can stand, best first.

    Offsets from a window's corner must stay inside the grid: hence the margin of ``_fields``.
    """
    size = 1 << (_LEVELS - 1)
    height, width = bound.shape
    found = np.empty((len(turns) * (height // size + 1) * (width // size + 1), 4), np.int64)
    count = 0
    for row in range(0, height, size):
        for column in range(0, width, size):
            if open_to[row, column] <= 0:
                continue
            for k in range(len(turns)):
                found[count, 0] = _score(turns[k], row, column, bound)
                found[count, 1], found[count, 2], found[count, 3] = k, row, column
                count += 1
    found = found[:count]
    return found[np.argsort(-found[:, 0], kind="mergesort")]


@kernel
def _descend(
    turns: NDArray[np.int32],
    bounds: Cells,
    open_to: Cells,
    roots: NDArray[np.int64],
    beat: int,
    banned: NDArray[np.int64],
    apart: Floats,
) -> tuple[int, NDArray[np.int64]]:
    """The best score above ``beat`` and its (heading, row, column); ``beat`` itself where there is none.

    banned: (heading, row, column) whose surroundings, ``apart`` (cells, headings), don't count; row -1 for none.
    """
    best, place = beat, np.full(3, -1, np.int64)
    stack = np.empty((4 * _LEVELS * 4, 5), np.int64)  # bound, heading, row, column, level
    for root in range(len(roots)):
        if roots[root, 0] <= best:
            break
        stack[0, :4], stack[0, 4] = roots[root], _LEVELS - 1
        depth = 1
        while depth:
            depth -= 1
            bound, k, row, column, level = stack[depth]
            if bound <= best:
                continue
            if level == 0:
                if banned[1] >= 0:
                    turn = abs(k - banned[0])
                    turn = min(turn, len(turns) - turn)
                    way = np.hypot(row - banned[1], column - banned[2])
                    if turn <= apart[1] and way <= apart[0]:
                        continue
                best, place[0], place[1], place[2] = bound, k, row, column
                continue
            half, first = 1 << (level - 1), depth
            for quarter in range(4):
                r, c = row + half * (quarter // 2), column + half * (quarter % 2)
                if r >= bounds.shape[1] or c >= bounds.shape[2] or open_to[level - 1, r, c] <= 0:
                    continue
                score = _score(turns[k], r, c, bounds[level - 1])
                at = depth
                while at > first and stack[at - 1, 0] > score:  # the best on top
                    stack[at] = stack[at - 1]
                    at -= 1
                stack[at, 0], stack[at, 1], stack[at, 2], stack[at, 3], stack[at, 4] = score, k, r, c, level - 1
                depth += 1
    return best, place


def _refined(walls: Floats, guess: Floats, stored: Plan) -> tuple[Floats, float]:
    """(x, y, yaw) [3] near a guess where walls [N, 2] about the robot lie best, and their score: ever smaller steps by axis."""
    values = _values(stored.wall, stored.free, stored.frame.resolution_m)
    best, score = guess, _fit(walls, guess, values, stored.frame)
    step = np.array([_CELL_M / 2, _CELL_M / 2, _CELL_M / 2 / _RANGE_M])
    for _ in range(30):
        tried = [best + sign * step * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
        scores = [_fit(walls, one, values, stored.frame) for one in tried]
        if max(scores) > score:
            best, score = tried[int(np.argmax(scores))], max(scores)
        else:
            step = step / 2
    return np.asarray(best, np.float64), score


def _fit(walls: Floats, pose: Floats, values: NDArray[np.float32], frame: GridFrame) -> float:
    """Mean of a grid, bilinear, at walls [N, 2] about a robot at pose (x, y, yaw)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    at = np.stack([c * walls[:, 0] - s * walls[:, 1], s * walls[:, 0] + c * walls[:, 1]], -1) + pose[:2]
    x, y = (((at - frame.origin_xy_m) / frame.resolution_m - 0.5).astype(np.float32)).T
    found = cv2.remap(values, x[None], y[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return float(found.mean())
