"""Where free space could be cut into rooms: straight cuts from corner to wall, each with what speaks for it.

A cut starts at a corner that juts into free space (a door jamb, the end of a wall) and runs to another such corner, to the
nearest point of a wall opposite, or straight on along the wall it ends. Everything here is in cells of one grid: points are
(x, y) = (column, row) of cell centres. Pure functions over arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from irsd.rooms.kernels import any_same, choose_apart, trace

FloatArray = NDArray[np.float64]

# Rays around a corner: fine enough that a local minimum of their length is the foot of the perpendicular within a cell or two.
_RAYS = 96
_MIN_TURN_RAD = np.radians(25.0)  # a boundary that turns less is a curved wall or noise, not a jamb
_TAUT = 0.77  # a cut that leaves a wall at less than 50 degrees is not the way across
_STRAIGHT = np.cos(np.radians(10.0))  # directions that differ less are those of one wall
_WALL_CELLS = 4.0  # a straight piece of outline of fewer cells has no direction worth extending
_LINTEL_SHARE = 0.7  # part of a cut that must lie under a lintel
# What speaks for a cut besides being narrow: it closes a gap in one wall's line, or a lintel runs along it.
_IN_WALL_LINE = 0.85
_UNDER_LINTEL = 0.7
_STOOD = 0.9  # or it stood before


@dataclass(frozen=True, slots=True)
class Corners:
    """Corners that jut into free space. at: float64 [N, 2]; along: float64 [N, 2, 2], unit vectors that continue its two
    walls past the corner; wall_length: float64 [N, 2], how long each of those walls is."""

    at: FloatArray
    along: FloatArray
    wall_length: FloatArray


@dataclass(frozen=True, slots=True)
class Cuts:
    """Candidate cuts. ends: float64 [N, 2, 2] cell centres; width: float64 [N], cells between the walls at both ends;
    ratio: float64 [N], width / width of free space behind it on its narrower side, both along the cut (1 = no constriction),
    times favour: float64 [N], below 1 when more than being narrow speaks for the cut."""

    ends: FloatArray
    width: FloatArray
    ratio: FloatArray
    favour: FloatArray

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Cuts:
        """The cuts at ``index``."""
        return Cuts(self.ends[index], self.width[index], self.ratio[index], self.favour[index])

    def favoured(self, which: NDArray[np.bool_], factor: float) -> Cuts:
        """The cuts, those at ``which`` made likelier."""
        factors = np.where(which, factor, 1.0)
        return Cuts(self.ends, self.width, self.ratio * factors, self.favour * factors)


@dataclass(frozen=True, slots=True)
class Reach:
    """The lengths, in cells, that decide what is tried as a cut: between ``shortest`` and ``longest``, up to ``longest_gap``
    within the line of a wall. taut: the way from its ends on which a cut must be the shortest way across. jamb: how near a
    corner is the end of a cut. depths: float64 [D] ascending, how far behind a cut the width of space is measured."""

    shortest: float
    longest: float
    longest_gap: float
    taut: float
    jamb: float
    depths: FloatArray


def clearance(space: NDArray[np.bool_]) -> NDArray[np.float32]:
    """float32 [H, W]: cells to the nearest cell that is not space (0 there). Outside the grid nothing is space."""
    padded = np.pad(space, 1).astype(np.uint8)
    return np.asarray(cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1], np.float32)


def free_length(dist: NDArray[np.float32], start: FloatArray, direction: FloatArray, limit: float) -> FloatArray:
    """How far rays run in free space, in cells: float64 [N], at most ``limit``.

    start, direction: [N, 2] (x, y), unit directions.
    """
    return np.asarray(
        trace(np.ascontiguousarray(dist), np.ascontiguousarray(start), np.ascontiguousarray(direction), float(limit))
    )


def find_corners(space: NDArray[np.bool_], solid: NDArray[np.bool_], tolerance: float) -> Corners:
    """Corners of free space that jut into it and stand on something solid.

    space, solid: bool [H, W]; solid marks cells near structure, so that the frontier of what was seen has no corners.
    tolerance: cells by which an outline may be simplified.
    """
    at, along, length = [], [], []
    contours, _ = cv2.findContours(space.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    for contour in contours:
        if len(contour) < 4:
            continue
        points = cv2.approxPolyDP(contour, tolerance, True)[:, 0].astype(np.float64)
        if len(points) < 3:
            continue
        before = points - np.roll(points, 1, axis=0)
        after = np.roll(points, -1, axis=0) - points
        size_in, size_out = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
        turn = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(1))
        # OpenCV runs outlines with the inside at the same hand for outer borders and holes: a turn of this sign juts in.
        juts = turn > _MIN_TURN_RAD
        at.append(points[juts])
        along.append(np.stack([before / size_in[:, None], -after / size_out[:, None]], axis=1)[juts])
        length.append(np.stack([size_in, size_out], axis=1)[juts])
    if not at:
        return Corners(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, 2)))
    corner = np.concatenate(at)
    cell = corner.astype(np.int64)
    stands = solid[cell[:, 1], cell[:, 0]]
    return Corners(corner[stands], np.concatenate(along)[stands], np.concatenate(length)[stands])


def _perpendicular(corners: Corners, dist: NDArray[np.float32], shortest: float, longest: float) -> FloatArray:
    """Cuts to the wall opposite: rays whose length is a local minimum over the direction. Ends [K, 2, 2]."""
    count = len(corners.at)
    angle = 2 * np.pi * np.arange(_RAYS) / _RAYS
    direction = np.tile(np.stack([np.cos(angle), np.sin(angle)], 1), (count, 1))
    start = np.repeat(corners.at, _RAYS, axis=0)
    length = free_length(dist, start, direction, longest + 2).reshape(count, _RAYS)
    smaller = (length <= np.roll(length, 1, 1)) & (length <= np.roll(length, -1, 1))
    # Of a plateau only its first ray; and a true minimum within +-4 rays.
    first = length < np.roll(length, 1, 1)
    wide = np.min([np.roll(length, k, 1) for k in range(-4, 5)], axis=0)
    good = smaller & first & (length <= wide) & (length >= shortest) & (length <= longest)
    row, ray = np.nonzero(good)
    begin = corners.at[row]
    reach = np.maximum(length[row, ray] - 1.0, 0.0)
    end = begin + np.stack([np.cos(angle[ray]), np.sin(angle[ray])], 1) * reach[:, None]
    return np.stack([begin, end], axis=1)


def _extensions(
    corners: Corners, dist: NDArray[np.float32], shortest: float, longest: float, wall: float
) -> FloatArray:
    """Cuts that continue a wall (at least ``wall`` cells long) past its corner. Ends [K, 2, 2]."""
    row, side = np.nonzero(corners.wall_length >= wall)
    direction, begin = corners.along[row, side], corners.at[row]
    length = free_length(dist, begin + direction, direction, longest + 2) + 1.0
    good = (length >= shortest) & (length <= longest)
    end = begin + direction * np.maximum(length - 1.0, 0.0)[:, None]
    return np.stack([begin, end], axis=1)[good]


def _between(
    corners: Corners, dist: NDArray[np.float32], shortest: float, longest: float, longest_gap: float
) -> FloatArray:
    """Cuts from corner to corner in sight of each other; up to ``longest_gap`` where both continue their walls. Ends [K, 2, 2]."""
    if len(corners.at) < 2:
        return np.zeros((0, 2, 2))
    pairs = cKDTree(corners.at).query_pairs(max(longest, longest_gap), output_type="ndarray")
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    begin, end = corners.at[pairs[:, 0]], corners.at[pairs[:, 1]]
    size = np.linalg.norm(end - begin, axis=1)
    fits = size >= shortest
    pairs, begin, end, size = pairs[fits], begin[fits], end[fits], size[fits]
    direction = (end - begin) / size[:, None]
    gap = _continues(corners, pairs[:, 0], direction) & _continues(corners, pairs[:, 1], -direction)
    tried = (size <= longest) | gap
    begin, end, size, direction = begin[tried], end[tried], size[tried], direction[tried]
    seen = free_length(dist, begin, direction, max(longest, longest_gap) + 2) >= size - 1.0
    return np.asarray(np.stack([begin, end], axis=1)[seen])


def _continues(corners: Corners, which: NDArray[np.intp], direction: FloatArray) -> NDArray[np.bool_]:
    """[K] True where a direction (unit, [K, 2]) leaves corner ``which`` [K] as the continuation of one of its walls."""
    cosine = (corners.along[which] * direction[:, None]).sum(-1)
    # The wall must be long enough to have a direction; a metre away its end is then known to the width of a wall.
    return np.asarray(((cosine >= _STRAIGHT) & (corners.wall_length[which] >= _WALL_CELLS)).any(1))


def in_wall_line(ends: FloatArray, corners: Corners, reach: float) -> NDArray[np.bool_]:
    """[K] True for cuts [K, 2, 2] that close a gap in a wall: at both ends a corner within ``reach`` whose wall they continue."""
    if not len(corners.at) or not len(ends):
        return np.zeros(len(ends), bool)
    direction = ends[:, 1] - ends[:, 0]
    direction = direction / np.linalg.norm(direction, axis=1)[:, None]
    far, other = cKDTree(corners.at).query(ends, k=min(3, len(corners.at)))
    far, other = far.reshape(*ends.shape[:2], -1), other.reshape(*ends.shape[:2], -1)
    good = []
    for end, sign in ((0, 1.0), (1, -1.0)):
        close = [
            (far[:, end, k] <= reach) & _continues(corners, other[:, end, k], sign * direction)
            for k in range(far.shape[2])
        ]
        good.append(np.any(close, axis=0))
    return np.asarray(good[0] & good[1])


def share_of(mask: NDArray[np.bool_], ends: FloatArray, beside: float) -> FloatArray:
    """Share of the cells of the lines parallel to cuts [K, 2, 2], ``beside`` cells to their left, that are in mask: [K]."""
    tangent = ends[:, 1] - ends[:, 0]
    tangent = tangent / np.linalg.norm(tangent, axis=1)[:, None]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    part = (np.arange(24) + 0.5)[None, :, None] / 24
    at = ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * part + beside * normal[:, None]
    cell = np.clip(np.rint(at).astype(np.int64), 0, [mask.shape[1] - 1, mask.shape[0] - 1])
    return np.asarray(mask[cell[..., 1], cell[..., 0]].mean(1))


def _ratio(ends: FloatArray, width: FloatArray, dist: NDArray[np.float32], depths: FloatArray) -> FloatArray:
    """Width of each cut / width of free space behind it, the narrower side counting. inf where nothing is behind."""
    count = len(ends)
    middle = ends.mean(1)
    tangent = ends[:, 1] - ends[:, 0]
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    limit = float(depths[-1]) * 8
    narrow = np.full(count, np.inf)
    for hand in (normal, -normal):
        reach = free_length(dist, middle, hand, float(depths[-1]) + 1)
        start = (middle[:, None] + hand[:, None] * depths[:, None]).reshape(-1, 2)
        along = np.repeat(tangent, len(depths), axis=0)
        across = free_length(dist, start, along, limit) + free_length(dist, start, -along, limit)
        behind = _typical(np.where(reach[:, None] >= depths, across.reshape(count, -1), -1.0))
        narrow = np.minimum(narrow, behind)
    return np.asarray(np.where(narrow > 0, width / np.maximum(narrow, 1e-9), np.inf))


def _typical(across: FloatArray) -> FloatArray:
    """Lower quartile of each row's non-negative values, float64 [N], 0 where there are none: rays through open doors beside
    the cut must not make a corridor wide."""
    count = (across >= 0).sum(1)
    ordered = np.sort(across, axis=1)
    index = across.shape[1] - count + count // 4
    return np.where(count > 0, ordered[np.arange(len(across)), np.minimum(index, across.shape[1] - 1)], 0.0)


def _tautness(ends: FloatArray, dist: NDArray[np.float32], reach: float) -> FloatArray:
    """How much a cut looks like the shortest way across, near its ends: 1 = no wall is nearer than the end it leaves, sin(a) =
    it leaves a wall at the angle a. Looks up to ``reach`` cells from each end, and never past the middle."""
    size = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    tangent = (ends[:, 1] - ends[:, 0]) / size[:, None]
    worst = np.ones(len(ends))
    for part in np.linspace(0.3, 1.0, 6):
        step = part * np.minimum(size / 2, reach)
        for at in (ends[:, 0] + tangent * step[:, None], ends[:, 1] - tangent * step[:, None]):
            cell = np.rint(at).astype(np.int64)
            # The end is the last free cell: the wall is a cell behind it.
            worst = np.minimum(worst, (dist[cell[:, 1], cell[:, 0]] + 0.3) / (step + 1.0))
    return np.asarray(worst)


def _ceiling_steps(dist: NDArray[np.float32], lintel: NDArray[np.bool_], reach: Reach) -> FloatArray:
    """Cuts where a low ceiling begins: straight edges of wide areas with structure above door height. Ends [K, 2, 2]."""
    # Returns from a ceiling are sparse; what is narrower than a passage is a beam or the top of a wall.
    closed = cv2.morphologyEx(lintel.astype(np.uint8), cv2.MORPH_CLOSE, _disc(reach.jamb / 2))
    region = cv2.morphologyEx(closed, cv2.MORPH_OPEN, _disc(reach.taut / 2))
    contours, _ = cv2.findContours(region, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    begin, end = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for contour in contours:
        points = cv2.approxPolyDP(contour, reach.jamb / 2, True)[:, 0].astype(np.float64)
        begin.append(points)
        end.append(np.roll(points, -1, axis=0))
    first, last = np.concatenate(begin), np.concatenate(end)
    size = np.linalg.norm(last - first, axis=1)
    long = size >= reach.taut
    first, last, size = first[long], last[long], size[long]
    direction, middle = (last - first) / size[:, None], (first + last) / 2
    ahead = free_length(dist, middle, direction, reach.longest_gap)
    behind = free_length(dist, middle, -direction, reach.longest_gap)
    # Most of the way across must be such an edge, and the whole of it free.
    spans = (size >= 0.6 * (ahead + behind)) & (ahead + behind <= reach.longest_gap) & (ahead > 1) & (behind > 1)
    ends = np.stack([middle - direction * (behind - 1)[:, None], middle + direction * (ahead - 1)[:, None]], axis=1)
    return np.asarray(ends[spans])


def _disc(radius: float) -> NDArray[np.uint8]:
    size = 2 * round(radius) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), np.uint8)


def find_cuts(dist: NDArray[np.float32], corners: Corners, reach: Reach, lintel: NDArray[np.bool_] | None) -> Cuts:
    """All candidate cuts of free space.

    dist: ``clearance`` of the space. lintel: bool [H, W], structure above door height, or None when that is not known.
    """
    steps = np.zeros((0, 2, 2)) if lintel is None else _ceiling_steps(dist, lintel, reach)
    ends = np.concatenate(
        [
            steps,
            _between(corners, dist, reach.shortest, reach.longest, reach.longest_gap),
            _perpendicular(corners, dist, reach.shortest, reach.longest),
            _extensions(corners, dist, reach.shortest, reach.longest, _WALL_CELLS),
        ]
    )
    size = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    ends = ends[size >= 1]
    ends = ends[_tautness(ends, dist, reach.taut) >= _TAUT]
    if not len(ends):
        return Cuts(ends, np.zeros(0), np.zeros(0), np.zeros(0))
    width = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) + 1.0  # from wall to wall: half a cell more at both ends
    cuts = Cuts(ends, width, _ratio(ends, width, dist, reach.depths), np.ones(len(ends)))
    cuts = cuts.favoured(in_wall_line(ends, corners, reach.jamb), _IN_WALL_LINE)
    if lintel is not None:
        thick = cv2.dilate(lintel.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        above = share_of(thick, ends, 0.0) >= _LINTEL_SHARE
        open_beside = np.minimum(share_of(lintel, ends, reach.taut), share_of(lintel, ends, -reach.taut)) <= 0.3
        cuts = cuts.favoured(above & open_beside, _UNDER_LINTEL)
    return cuts


def without_crossings(cuts: Cuts, near: float) -> Cuts:
    """The best cuts (least ratio, then least width) of which no two cross or share both ends within ``near`` cells."""
    order = np.lexsort((cuts.ends[:, 0, 1], cuts.ends[:, 0, 0], cuts.width, np.round(cuts.ratio, 2)))
    return cuts.take(choose_apart(np.ascontiguousarray(cuts.ends), order, near))


def preferring(cuts: Cuts, before: FloatArray, near: float) -> Cuts:
    """The cuts, those whose ends lie within ``near`` cells of the ends of one that stood before [K, 2, 2] made likelier."""
    if not len(before) or not len(cuts.ends):
        return cuts
    stood = any_same(np.ascontiguousarray(cuts.ends), np.ascontiguousarray(before), near)
    return cuts.favoured(stood, _STOOD)


def joined(rounds: Sequence[Cuts]) -> Cuts:
    """All cuts of several finds."""
    return Cuts(
        *(np.concatenate([getattr(cuts, name) for cuts in rounds]) for name in ("ends", "width", "ratio", "favour"))
    )


def drawn(cuts: Cuts, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """bool [H, W]: the cells that the cuts run through, each line unbroken for 4-connected space and a cell into the walls."""
    canvas = np.zeros(shape, np.uint8)
    step = cuts.ends[:, 1] - cuts.ends[:, 0]
    beyond = step / np.maximum(np.linalg.norm(step, axis=1), 1e-9)[:, None]
    longer = np.stack([cuts.ends[:, 0] - beyond, cuts.ends[:, 1] + beyond], axis=1)
    for ends in longer:
        (x0, y0), (x1, y1) = np.rint(ends).astype(int).tolist()
        cv2.line(canvas, (x0, y0), (x1, y1), 1, 1, cv2.LINE_8)
    return canvas > 0
