"""Rooms of one instant: free space above furniture, cut at doorways and merged back where no wall speaks for a cut.

1. ``open_space``: what is free, with small free-standing things and unseen specks filled in.
2. ``cuts.find_cuts``: straight cuts at jambs, wall ends and along wall lines; together they cut space into pieces.
3. ``merge_pieces``: pieces grow together, the weakest cut first, until every cut that is left is a constriction.
4. Footprints are drawn out to the walls (``outline``), openings are the cuts that are left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.core.settings import setting
from irsd.core.types import Opening, PlanEvidence, RoomFootprint, RoomSegmentation
from irsd.rooms import cuts as cutting
from irsd.rooms.cuts import Cuts, Reach
from irsd.rooms.outline import outline

_BESIDE_M = 0.2  # the rooms of an opening are looked up this far beside it
FREE_FROM = 250  # pixel value from which a cell of a 2D map is free (map_server writes 254, drawings 255)


@dataclass(frozen=True, slots=True)
class SegmentSettings:
    """How space is cut into rooms. All lengths are physical and hold for any building."""

    min_room_m2: float = setting(1.5, "a smaller piece is part of its neighbour, not a room", lo=0.1, hi=20.0)
    opening_max_m: float = setting(4.5, "the widest opening that may separate two rooms", lo=0.5, hi=12.0)
    wall_gap_max_m: float = setting(
        7.5, "the widest gap in the line of one wall that may separate two rooms", lo=0.5, hi=20.0
    )
    opening_min_m: float = setting(0.4, "a narrower gap is no passage", lo=0.1, hi=1.0)
    constriction: float = setting(
        0.75, "an opening separates when its width is below this part of the space behind it", lo=0.1, hi=1.0
    )
    doorway: float = setting(
        0.45, "an opening below this part of the space behind it is a doorway beyond doubt", lo=0.05, hi=1.0
    )
    open_rim: float = setting(0.4, "a piece with more of its rim open to others is part of one of them", lo=0.1, hi=1.0)
    hall_m2: float = setting(20.0, "a piece of this size is a room or a hall, however open its rim", lo=1.0, hi=1000.0)
    furniture_m: float = setting(1.0, "a free-standing thing up to this long is furniture, not a wall", lo=0.0, hi=3.0)
    post_gap_m: float = setting(
        0.6, "posts this near, with something at robot height between, are one wall", lo=0.0, hi=2.0
    )
    wall_support: float = setting(
        0.4, "part of a room's rim that must stand on walls; less is the edge of what was seen", lo=0.0, hi=1.0
    )
    simplify_m: float = setting(
        0.15, "outlines may deviate by this much before corners are looked for", lo=0.05, hi=0.5
    )
    wall_reach_m: float = setting(0.15, "footprints grow by up to this much to reach the wall's face", lo=0.0, hi=0.5)


@dataclass(frozen=True, slots=True)
class Plan:
    """What rooms are cut from: bool [H, W] each; lintel: structure above door height, None when that was not measured."""

    free: NDArray[np.bool_]
    wall: NDArray[np.bool_]
    lintel: NDArray[np.bool_] | None


def segment_map(
    image: NDArray[np.uint8], resolution_m: float, settings: SegmentSettings | None = None
) -> RoomSegmentation:
    """Rooms of a 2D map: uint8 [H, W], >= 250 is free. Row 0 of the image is row 0 of the labels; the origin is (0, 0).

    Raises ValueError for an image that is not [H, W] or a resolution that is not positive.
    """
    if image.ndim != 2 or not resolution_m > 0:
        raise ValueError(f"expected a [H, W] image and a positive resolution, got {image.shape} and {resolution_m}")
    free = image >= FREE_FROM
    frame = GridFrame((0.0, 0.0), resolution_m, *image.shape)
    return segment(frame, Plan(free, ~free, None), settings or SegmentSettings(), (0.0, None))


def segment_evidence(evidence: PlanEvidence, settings: SegmentSettings) -> RoomSegmentation:
    """Rooms of the map as seen from above."""
    heights = (evidence.floor_z_m, evidence.ceiling_z_m)
    wall = solid_walls(evidence.wall, evidence.low, settings, evidence.frame.resolution_m)
    return segment(evidence.frame, Plan(evidence.free & ~wall, wall, evidence.lintel), settings, heights)


def solid_walls(
    wall: NDArray[np.bool_], low: NDArray[np.bool_], settings: SegmentSettings, resolution_m: float
) -> NDArray[np.bool_]:
    """bool [H, W]: walls without the things that hang or stand alone, closed where nobody can pass between their parts.

    wall: structure above furniture height; low: anything at robot height. Gaps narrower than a passage are closed; where something
    stands at robot height as well (folded doors, a partition that barely reaches up), gaps of up to ``post_gap_m``.
    """
    _, labels, stats, _ = cv2.connectedComponentsWithStats(wall.astype(np.uint8), connectivity=8)
    extent = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]) * resolution_m
    beneath = np.bincount(labels[low], minlength=len(stats))
    hangs = (extent <= settings.furniture_m) & (beneath < 0.2 * stats[:, cv2.CC_STAT_AREA])  # a lamp
    hangs[0] = True
    standing = ~hangs[labels]
    narrow = _bridged(standing, 0.75 * settings.opening_min_m / resolution_m)
    posts = _bridged(standing, settings.post_gap_m / resolution_m) & low
    return np.asarray(standing | narrow | posts)


def _bridged(mask: NDArray[np.bool_], gap: float) -> NDArray[np.bool_]:
    """Mask closed along straight lines of 12 directions over gaps of up to ``gap`` cells. Outside the grid nothing stands."""
    reach = round(gap / 2)
    padded = np.pad(mask, 2 * reach + 1).astype(np.uint8)
    result = padded.copy()
    for angle in np.pi * np.arange(12) / 12:
        line = np.zeros((2 * reach + 1, 2 * reach + 1), np.uint8)
        step = np.rint(np.array([np.cos(angle), np.sin(angle)]) * reach).astype(int)
        cv2.line(line, (reach - step[0], reach - step[1]), (reach + step[0], reach + step[1]), 1)
        result |= cv2.morphologyEx(padded, cv2.MORPH_CLOSE, line)
    inner = slice(2 * reach + 1, -(2 * reach + 1))
    return np.asarray(result[inner, inner] > 0)


def open_space(free: NDArray[np.bool_], settings: SegmentSettings, resolution_m: float) -> NDArray[np.bool_]:
    """bool [H, W]: free cells, and what stands or hides alone inside them and is too small to be structure."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats((~free).astype(np.uint8), connectivity=8)
    extent = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]) * resolution_m
    touches = np.zeros(count, bool)
    for edge in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        touches[edge] = True
    small = (extent <= settings.furniture_m) & ~touches
    small[0] = True
    space = np.asarray(small[labels])
    # Pieces smaller than a room, with nothing to merge with, are noise of the map.
    count, labels, stats, _ = cv2.connectedComponentsWithStats(space.astype(np.uint8), connectivity=4)
    large = stats[:, cv2.CC_STAT_AREA] * resolution_m**2 >= settings.min_room_m2
    large[0] = False
    return np.asarray(large[labels])


def segment(
    frame: GridFrame, plan: Plan, settings: SegmentSettings, heights: tuple[float, float | None]
) -> RoomSegmentation:
    """Rooms of free space among walls; heights: floor and ceiling z of the rooms."""
    resolution = frame.resolution_m
    none = np.zeros((frame.height, frame.width), np.int32)
    if not plan.free.any():
        return RoomSegmentation(frame, none, (), ())
    space = open_space(plan.free, settings, resolution)
    solid = cv2.dilate(plan.wall.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    dist = cutting.clearance(space)
    chosen = choose_cuts(space, solid, plan.lintel, settings, resolution)
    pieces, borders = cut_pieces(space, chosen)
    room_of = merge_pieces(pieces, borders, chosen, dist, settings, resolution)
    labels = _filled(np.asarray(room_of[pieces]), space)
    labels = _supported(labels, solid, space, settings, resolution)
    _, rooms = _footprints(labels, frame, settings, heights)
    left = np.unique(borders[room_of[borders[:, 0]] != room_of[borders[:, 1]], 2]).tolist()
    openings = openings_between(labels, frame, _cut_openings(frame, chosen, left))
    return RoomSegmentation(frame, labels, rooms, openings)


def choose_cuts(
    space: NDArray[np.bool_],
    solid: NDArray[np.bool_],
    lintel: NDArray[np.bool_] | None,
    settings: SegmentSettings,
    resolution_m: float,
) -> Cuts:
    """The cuts that are tried, none crossing another: clear doorways first, then what is left between closed doors."""
    reach = Reach(
        shortest=2.0,  # leaks of thin walls are cut too, though nobody passes them
        longest=settings.opening_max_m / resolution_m,
        longest_gap=settings.wall_gap_max_m / resolution_m,
        taut=0.75 / resolution_m,
        jamb=0.3 / resolution_m,
        depths=np.array([0.2, 0.4, 0.6, 0.8, 1.0, 1.3, 1.6]) / resolution_m,
    )
    closed, rounds = space, []
    for limit in (settings.doorway, 1.1):
        corners = cutting.find_corners(closed, solid, settings.simplify_m / resolution_m)
        found = cutting.find_cuts(cutting.clearance(closed), corners, reach, lintel)
        rounds.append(cutting.without_crossings(found.take(found.ratio <= limit), reach.jamb))
        closed = closed & ~cutting.drawn(rounds[-1], closed.shape)
    return cutting.joined(rounds)


def cut_pieces(space: NDArray[np.bool_], cuts: Cuts) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Cut space along the cuts. Returns labels int32 [H, W] (0 = wall or cut) and borders int64 [B, 4]:
    (piece, piece, index of the cut, cells of it between the two), first piece < second."""
    canvas = (space & ~cutting.drawn(cuts, space.shape)).astype(np.uint8)
    pieces = np.asarray(cv2.connectedComponents(canvas, connectivity=4)[1], np.int32)
    if not len(cuts.ends):
        return pieces, np.zeros((0, 4), np.int64)
    size = np.linalg.norm(cuts.ends[:, 1] - cuts.ends[:, 0], axis=1)
    steps = np.ceil(size).astype(np.int64) + 1
    which = np.repeat(np.arange(len(steps)), steps)
    part = (np.arange(len(which)) - np.repeat(np.cumsum(steps) - steps, steps)) / np.maximum(steps - 1, 1)[which]
    at = cuts.ends[which, 0] + (cuts.ends[which, 1] - cuts.ends[which, 0]) * part[:, None]
    tangent = (cuts.ends[:, 1] - cuts.ends[:, 0]) / size[:, None]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)[which]
    sides = []
    for hand in (1.5, -1.5):
        cell = np.rint(at + hand * normal).astype(np.int64)
        x, y = np.clip(cell[:, 0], 0, space.shape[1] - 1), np.clip(cell[:, 1], 0, space.shape[0] - 1)
        sides.append(pieces[y, x])
    low, high = np.minimum(*sides), np.maximum(*sides)
    real = (low > 0) & (low != high)
    rows = np.stack([low[real], high[real], which[real]], axis=1).astype(np.int64)
    unique, counts = np.unique(rows, axis=0, return_counts=True)
    return pieces, np.column_stack([unique, counts]).astype(np.int64).reshape(-1, 4)


def merge_pieces(
    pieces: NDArray[np.int32],
    borders: NDArray[np.int64],
    cuts: Cuts,
    dist: NDArray[np.float32],
    settings: SegmentSettings,
    resolution_m: float,
) -> NDArray[np.int32]:
    """Room number of every piece, int32 [pieces + 1], 0 = none; numbered by their first piece.

    A border is as weak as its widest cut: the lesser of the cut's own ratio and of its width / the diameter of the largest disc
    that fits in the smaller piece. The weakest border goes first, while it is above ``constriction``; then pieces that are too
    small for a room go to the neighbour they are most open to.
    """
    count = int(pieces.max(initial=0))
    flat = pieces.ravel()
    area = np.bincount(flat, minlength=count + 1) * resolution_m**2
    disc = np.zeros(count + 1)
    np.maximum.at(disc, flat, 2.0 * dist.ravel())
    rim = np.bincount(pieces[(pieces > 0) & (dist < 1.5)], minlength=count + 1).astype(float)
    parent = list(range(count + 1))
    borders = borders[borders[:, 3] >= 2]
    near: list[dict[int, tuple[float, float]]] = [{} for _ in range(count + 1)]
    for a, b, cut, cells in borders.tolist():
        ratio, width = near[a].get(b, (0.0, 0.0))
        near[a][b] = near[b][a] = (
            max(ratio, float(cuts.ratio[cut])),
            max(width, min(cells + 1.0, float(cuts.width[cut]))),
        )

    def weakness(a: int, b: int) -> float:
        ratio, width = near[a][b]
        return min(ratio, width / max(min(disc[a], disc[b]), 1e-9))

    def urge(a: int) -> tuple[float, int]:
        """The weakest border of a piece and whom it leads to; a piece that is mostly open wants to join, whatever the border."""
        weakest, b = max((weakness(a, b), -b) for b in near[a])
        total = sum(width for _, width in near[a].values())
        opened = total / (total + rim[a]) if area[a] < settings.hall_m2 else 0.0
        return max(weakest, settings.constriction * float(opened) / settings.open_rim), -b

    def join(a: int, b: int) -> None:
        keep, gone = min(a, b), max(a, b)
        parent[gone] = keep
        disc[keep], area[keep] = max(disc[keep], disc[gone]), area[keep] + area[gone]
        rim[keep] += rim[gone]
        for c, (ratio, width) in near[gone].items():
            del near[c][gone]
            if c != keep:
                other = near[keep].get(c, (0.0, 0.0))
                near[keep][c] = near[c][keep] = (max(ratio, other[0]), max(width, other[1]))
        near[gone] = {}

    while True:
        urges = ((*urge(a), a) for a in range(1, count + 1) if near[a])
        strongest, b, a = max(urges, key=lambda u: (u[0], -u[2]), default=(0.0, 0, 0))
        if strongest <= settings.constriction:
            break
        join(a, b)
    for a in sorted(range(1, count + 1), key=lambda k: (area[k], k)):
        if parent[a] == a and area[a] < settings.min_room_m2 and near[a]:
            join(a, max(near[a], key=lambda b: (weakness(a, b), area[b], -b)))
    root = np.array([_root(parent, k) for k in range(count + 1)])
    kept = (area[root] >= settings.min_room_m2) & (root > 0)
    numbers = np.unique(root[kept])
    room_of = np.zeros(count + 1, np.int32)
    room_of[kept] = np.searchsorted(numbers, root[kept]) + 1
    return room_of


def _root(parent: list[int], k: int) -> int:
    while parent[k] != k:
        k = parent[k]
    return k


def _filled(labels: NDArray[np.int32], space: NDArray[np.bool_], reach: float = 3.0) -> NDArray[np.int32]:
    """Labels with the unlabelled cells of space within ``reach`` cells given to the nearest room."""
    if not labels.any():
        return labels
    unlabelled = (labels == 0).astype(np.uint8)
    gap, nearest = cv2.distanceTransformWithLabels(
        unlabelled, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    lookup = np.zeros(int(nearest.max()) + 1, np.int32)
    seed = unlabelled == 0
    lookup[nearest[seed]] = labels[seed]
    return np.where(space & (gap <= reach), lookup[nearest], labels).astype(np.int32)


def _supported(
    labels: NDArray[np.int32],
    solid: NDArray[np.bool_],
    space: NDArray[np.bool_],
    settings: SegmentSettings,
    resolution_m: float,
) -> NDArray[np.int32]:
    """Labels renumbered without rooms whose rim stands on too little wall (glimpses through doors, the frontier)."""
    count = int(labels.max(initial=0))
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    rim = (labels > 0) & (cv2.erode(space.astype(np.uint8), cross, borderType=cv2.BORDER_CONSTANT, borderValue=0) == 0)
    total = np.bincount(labels[rim], minlength=count + 1)
    standing = np.bincount(labels[rim & solid], minlength=count + 1)
    area = np.bincount(labels.ravel(), minlength=count + 1) * resolution_m**2
    kept = (standing >= settings.wall_support * np.maximum(total, 1)) & (area >= settings.min_room_m2)
    kept[0] = False
    number = np.zeros(count + 1, np.int32)
    number[kept] = np.arange(1, int(kept.sum()) + 1)
    return np.asarray(number[labels])


def describe(
    labels: NDArray[np.int32], evidence: PlanEvidence, settings: SegmentSettings
) -> tuple[tuple[int, ...], tuple[RoomFootprint, ...]]:
    """The numbers that occur in labels [H, W], ascending, and the footprint of each."""
    return _footprints(labels, evidence.frame, settings, (evidence.floor_z_m, evidence.ceiling_z_m))


def _footprints(
    labels: NDArray[np.int32], frame: GridFrame, settings: SegmentSettings, heights: tuple[float, float | None]
) -> tuple[tuple[int, ...], tuple[RoomFootprint, ...]]:
    """Rooms drawn out to the walls around them."""
    resolution = frame.resolution_m
    grown = _filled(labels, np.ones(labels.shape, bool), settings.wall_reach_m / resolution)
    cells = np.bincount(grown.ravel())
    numbers = tuple(np.flatnonzero(cells[1:]) + 1)
    rooms = []
    for k in numbers:
        polygon = outline(grown, int(k), frame, settings.simplify_m / 2)
        low, high = polygon.min(0), polygon.max(0)
        box = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
        rooms.append(RoomFootprint(polygon, box, float(cells[k]) * resolution**2, heights[0], heights[1]))
    return tuple(int(k) for k in numbers), tuple(rooms)


def openings_between(labels: NDArray[np.int32], frame: GridFrame, candidates: Sequence[Opening]) -> tuple[Opening, ...]:
    """The candidates that lie between two different labels, with those labels; of two at one place the first stays."""
    found: list[Opening] = []
    for opening in candidates:
        ends = opening.segment_xy
        middle = ends.mean(0)
        tangent = (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1e-9)
        normal = np.array([-tangent[1], tangent[0]])
        cells = frame.cells_of(middle + np.outer([_BESIDE_M, -_BESIDE_M], normal))
        cells = np.clip(cells, 0, [frame.height - 1, frame.width - 1])
        low, high = sorted(labels[cells[:, 0], cells[:, 1]].tolist())
        if low in (0, high):
            continue
        near = max(_BESIDE_M, opening.width_m / 2)
        if any(o.rooms == (low, high) and np.hypot(*(o.segment_xy.mean(0) - middle)) < near for o in found):
            continue
        found.append(Opening((low, high), opening.position_xy, opening.width_m, ends))
    return tuple(sorted(found, key=lambda o: (o.rooms, o.position_xy)))


def _cut_openings(frame: GridFrame, cuts: Cuts, which: Sequence[int]) -> list[Opening]:
    """Cuts as openings whose rooms are not known yet."""
    found = []
    for cut in which:
        ends = (cuts.ends[cut] + 0.5) * frame.resolution_m + np.array(frame.origin_xy_m)
        x, y = ends.mean(0).tolist()
        found.append(Opening((0, 0), (x, y), float(cuts.width[cut]) * frame.resolution_m, ends))
    return found
