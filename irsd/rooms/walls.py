"""Wall planes from wall points: small segments, merged as in Algorithm 1 of the IRS paper, doors and windows counting as wall.

Two segments are one wall when they overlap (c1 >= tau_1) and face the same way (cosine c2 >= tau_2); two floors or ceilings are
one level when their heights differ by at most tau_3. Room outlines are drawn up to these planes (``snapped``). Pure functions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from irsd.core.settings import setting
from irsd.rooms.kernels import one_wall_pairs

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class WallSettings:
    """Algorithm 1's thresholds and the size of the pieces it starts from."""

    tau_1: float = setting(0.3, "segments that share this part of the shorter one are one wall", lo=0.0, hi=1.0)
    tau_2: float = setting(0.97, "cosine between normals from which segments are parallel", lo=0.5, hi=1.0)
    tau_3_m: float = setting(0.15, "floors or ceilings that differ by at most this are one level", lo=0.0, hi=1.0)
    thickness_m: float = setting(0.08, "points this near to a wall's line belong to it", lo=0.01, hi=0.5)
    gap_m: float = setting(0.5, "a wall interrupted by more than this is two segments", lo=0.1, hi=5.0)
    length_m: float = setting(0.4, "shorter segments are no walls", lo=0.1, hi=5.0)
    block_m: float = setting(8.0, "method irs: side N of the block of points around the robot", lo=1.0, hi=100.0)
    snap_m: float = setting(0.25, "an outline moves by up to this much to lie on its wall", lo=0.0, hi=1.0)


@dataclass(frozen=True, slots=True)
class Walls:
    """Straight walls seen from above. normal: float64 [N, 2], towards the side they were seen from; offset: float64 [N],
    normal . xy of their points; span: float64 [N, 2], from .. to along (-normal_y, normal_x); count: int64 [N] points."""

    normal: FloatArray
    offset: FloatArray
    span: FloatArray
    count: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.offset)

    def take(self, index: NDArray[np.bool_]) -> Walls:
        """The walls at ``index``."""
        return Walls(self.normal[index], self.offset[index], self.span[index], self.count[index])

    def ends(self) -> FloatArray:
        """Where the walls begin and end: float64 [N, 2, 2] (x, y)."""
        tangent = np.stack([-self.normal[:, 1], self.normal[:, 0]], axis=1)
        foot = self.normal * self.offset[:, None]
        return foot[:, None] + tangent[:, None] * self.span[:, :, None]


def find_walls(points: NDArray[np.floating], normals: NDArray[np.floating], settings: WallSettings) -> Walls:
    """Walls of wall points [W, 3] (map frame) with unit normals [W, 3]; points without a horizontal normal are left out."""
    flat = np.asarray(normals, np.float64)[:, :2]
    size = np.linalg.norm(flat, axis=1)
    good = size > 0.7
    xy, facing = np.asarray(points, np.float64)[good, :2], flat[good] / size[good, None]
    moments, ends = _moments(xy, facing, _first_pieces(xy, facing, settings))
    group = np.arange(len(moments))
    while True:
        walls = _fitted(moments, ends, group)
        joined = _one_wall(walls, settings)
        if not len(joined) or joined.max() + 1 == len(joined):
            break
        group = joined[group]
    keep = (walls.span[:, 1] - walls.span[:, 0] >= settings.length_m) & (walls.count >= 5)
    return Walls(walls.normal[keep], walls.offset[keep], walls.span[keep], walls.count[keep])


def _first_pieces(xy: FloatArray, facing: FloatArray, settings: WallSettings) -> NDArray[np.int64]:
    """Number of the piece of every point, [W]: alike in direction (10 degrees) and offset, without a gap along it."""
    if not len(xy):
        return np.zeros(0, np.int64)
    step = np.radians(10.0)
    sector = np.round(np.arctan2(facing[:, 1], facing[:, 0]) / step).astype(np.int64) % 36
    angle = sector * step
    across = xy[:, 0] * np.cos(angle) + xy[:, 1] * np.sin(angle)
    along = xy[:, 1] * np.cos(angle) - xy[:, 0] * np.sin(angle)
    band = np.floor(across / (2 * settings.thickness_m)).astype(np.int64)
    order = np.lexsort((along, band, sector))
    new = np.ones(len(xy), bool)
    new[1:] = (np.diff(sector[order]) != 0) | (np.diff(band[order]) != 0) | (np.diff(along[order]) > settings.gap_m)
    piece = np.empty(len(xy), np.int64)
    piece[order] = np.cumsum(new) - 1
    return piece


def _moments(xy: FloatArray, facing: FloatArray, piece: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """Of every piece: sums [P, 8] of (1, x, y, xx, yy, xy, normal x, normal y) and its two end points [P, 2, 2].

    ``piece`` numbers must be such that points of one piece are alike in direction; ends are taken along the widest axis.
    """
    number = int(piece.max(initial=-1)) + 1
    x, y = xy.T if len(xy) else (np.zeros(0), np.zeros(0))
    columns = (None, x, y, x * x, y * y, x * y, facing[:, 0], facing[:, 1])
    moments = np.stack([np.bincount(piece, weights=c, minlength=number) for c in columns], axis=1).astype(np.float64)
    along = x * -moments[piece, 7] + y * moments[piece, 6]
    order = np.lexsort((along, piece))
    first = np.searchsorted(piece[order], np.arange(number), side="left")
    last = np.searchsorted(piece[order], np.arange(number), side="right") - 1
    return moments, np.stack([xy[order[first]], xy[order[last]]], axis=1).reshape(number, 2, 2)


def _fitted(moments: FloatArray, ends: FloatArray, group: NDArray[np.int64]) -> Walls:
    """A line through every group of pieces [P]: total least squares, the mean normal where a group is too round for that."""
    number = int(group.max(initial=-1)) + 1
    sums = np.zeros((number, 8))
    np.add.at(sums, group, moments)
    count = np.maximum(sums[:, 0], 1.0)
    x, y = sums[:, 1] / count, sums[:, 2] / count
    xx, yy, xy = sums[:, 3] / count - x * x, sums[:, 4] / count - y * y, sums[:, 5] / count - x * y
    direction = 0.5 * np.arctan2(2 * xy, xx - yy)
    fitted = np.stack([-np.sin(direction), np.cos(direction)], axis=1)
    seen = sums[:, 6:] / np.maximum(np.linalg.norm(sums[:, 6:], axis=1), 1e-9)[:, None]
    fitted = np.where((fitted * seen).sum(1)[:, None] < 0, -fitted, fitted)
    normal = np.where((fitted * seen).sum(1)[:, None] >= np.cos(np.radians(20.0)), fitted, seen)
    along = (ends @ np.stack([-normal[group, 1], normal[group, 0]], axis=1)[:, :, None])[..., 0]
    low, high = np.full(number, np.inf), np.full(number, -np.inf)
    np.minimum.at(low, group, along.min(1, initial=np.inf))
    np.maximum.at(high, group, along.max(1, initial=-np.inf))
    offset = normal[:, 0] * x + normal[:, 1] * y
    return Walls(normal, offset, np.stack([low, high], axis=1), sums[:, 0].astype(np.int64))


def _one_wall(walls: Walls, settings: WallSettings) -> NDArray[np.int64]:
    """Group number of every wall [N]: connected by c1 >= tau_1 and c2 >= tau_2."""
    if not len(walls):
        return np.zeros(0, np.int64)
    pairs = same_wall(walls, settings)
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(walls), len(walls)))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def same_wall(walls: Walls, settings: WallSettings) -> NDArray[np.int64]:
    """Pairs [K, 2] of walls that are one: c1 >= tau_1 and c2 >= tau_2 beside one line; the first is not the longer."""
    s = settings
    normal, offset, span = (np.ascontiguousarray(a) for a in (walls.normal, walls.offset, walls.span))
    pairs = one_wall_pairs(normal, offset, span, s.tau_1, s.tau_2, s.thickness_m, s.gap_m)
    return np.asarray(pairs, np.int64)


def merge_levels(heights_m: FloatArray, weights: FloatArray, tau_3_m: float) -> FloatArray:
    """Heights [N] of floors (or ceilings) with those of one level replaced by their weighted mean: neighbours in height that
    differ by at most tau_3 from the mean of the level so far are one level."""
    merged = np.array(heights_m, np.float64)
    order = np.argsort(merged, kind="stable")
    start = 0
    for end in range(1, len(order) + 1):
        level = order[start:end]
        mean = np.average(heights_m[level], weights=weights[level])
        if end == len(order) or heights_m[order[end]] - mean > tau_3_m:
            merged[level] = mean
            start = end
    return merged


def snapped(polygon_xy: FloatArray, walls: Walls, reach_m: float) -> FloatArray:
    """The polygon [K, 2] (counter-clockwise) with its edges moved onto the walls they follow, where that keeps its shape.

    An edge follows a wall that faces into the room, is parallel within 12 degrees, at most ``reach_m`` away and beside at least half
    of the edge.
    """
    if len(polygon_xy) < 3 or not len(walls):
        return polygon_xy
    after = np.roll(polygon_xy, -1, axis=0)
    step = after - polygon_xy
    size = np.maximum(np.linalg.norm(step, axis=1), 1e-9)
    inward = np.stack([-step[:, 1], step[:, 0]], axis=1) / size[:, None]
    middle = (polygon_xy + after) / 2
    facing = inward @ walls.normal.T
    away = np.abs(middle @ walls.normal.T - walls.offset[None, :])
    tangent = np.stack([-walls.normal[:, 1], walls.normal[:, 0]], axis=1)
    at = middle @ tangent.T
    beside = np.minimum(at + size[:, None] / 2, walls.span[None, :, 1]) - np.maximum(
        at - size[:, None] / 2, walls.span[None, :, 0]
    )
    fits = (facing >= np.cos(np.radians(12.0))) & (away <= reach_m) & (beside >= 0.5 * size[:, None])
    best = np.where(fits, beside - away, -np.inf).argmax(1)
    found = fits[np.arange(len(best)), best] & (size >= reach_m)
    normal = np.where(found[:, None], walls.normal[best], inward)
    offset = np.where(found, walls.offset[best], (inward * middle).sum(1))
    # A short edge between two walls that meet is a corner cut off by the cells: the walls' own corner takes its place.
    n0, n1 = np.roll(normal, 1, axis=0), np.roll(normal, -1, axis=0)
    meet = np.abs(n0[:, 0] * n1[:, 1] - n0[:, 1] * n1[:, 0]) > np.sin(np.radians(20.0))
    kept = found | (size >= reach_m) | ~(np.roll(found, 1) & np.roll(found, -1) & meet)
    if kept.sum() < 3:
        return polygon_xy
    moved = _corners(polygon_xy[kept], normal[kept], offset[kept], found[kept], reach_m)
    before_m2, after_m2 = polygon_area(polygon_xy), polygon_area(moved)
    return moved if abs(after_m2 - before_m2) <= 0.15 * before_m2 else polygon_xy


def _corners(
    polygon: FloatArray, normal: FloatArray, offset: FloatArray, found: NDArray[np.bool_], reach_m: float
) -> FloatArray:
    """Where consecutive edges (lines normal . xy = offset) meet; a corner of two walls at right angles moves by at most
    sqrt(2) ``reach_m``, and no other corner moves more: nearly parallel walls meet far away."""
    n0, n1 = np.roll(normal, 1, axis=0), normal
    o0, o1 = np.roll(offset, 1), offset
    f0, f1 = np.roll(found, 1), found
    det = n0[:, 0] * n1[:, 1] - n0[:, 1] * n1[:, 0]
    meets = np.abs(det) > np.sin(np.radians(20.0))
    safe = np.where(meets, det, 1.0)
    met = np.stack([(o0 * n1[:, 1] - o1 * n0[:, 1]) / safe, (o1 * n0[:, 0] - o0 * n1[:, 0]) / safe], axis=1)
    to0 = polygon + n0 * (o0 - (polygon * n0).sum(1))[:, None]
    to1 = polygon + n1 * (o1 - (polygon * n1).sum(1))[:, None]
    slid = np.where(f0[:, None] & f1[:, None], (to0 + to1) / 2, np.where(f0[:, None], to0, to1))
    moved = np.where((meets & (f0 | f1))[:, None], met, np.where((f0 | f1)[:, None], slid, polygon))
    near = np.linalg.norm(moved - polygon, axis=1) <= np.sqrt(2.0) * reach_m
    return np.where(near[:, None], moved, polygon)


def polygon_area(polygon: FloatArray) -> float:
    """Signed area of a polygon [K, 2], positive when counter-clockwise."""
    after = np.roll(polygon, -1, axis=0)
    return float((polygon[:, 0] * after[:, 1] - after[:, 0] * polygon[:, 1]).sum() / 2)
