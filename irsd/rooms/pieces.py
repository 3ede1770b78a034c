"""Space cut into pieces, and pieces merged back to rooms where no wall speaks for the cut between them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.rooms import cuts as cutting
from irsd.rooms.cuts import Cuts, Reach
from irsd.rooms.settings import SegmentSettings


def choose_cuts(
    space: NDArray[np.bool_],
    solid: NDArray[np.bool_],
    lintel: NDArray[np.bool_] | None,
    settings: SegmentSettings,
    resolution_m: float,
    before: NDArray[np.float64],
) -> Cuts:
    """The cuts that are tried, none crossing another: clear doorways first, then what is left between closed doors.

    before: ends [K, 2, 2] in cells of cuts that stood earlier.
    """
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
        found = cutting.preferring(found, before, reach.jamb)
        rounds.append(cutting.without_crossings(found.take(found.ratio <= limit), reach.jamb))
        closed = closed & ~cutting.drawn(rounds[-1], closed.shape)
    return cutting.joined(rounds)


def cut_pieces(space: NDArray[np.bool_], cuts: Cuts) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Cut space along the cuts. Returns labels int32 [H, W] (0 = wall or cut) and borders int64 [B, 4]:
    (piece, piece, index of the cut, cells of it between the two), first piece < second."""
    canvas = (space & ~cutting.drawn(cuts, space.shape)).astype(np.uint8)
    pieces = _in_reading_order(np.asarray(cv2.connectedComponents(canvas, connectivity=4)[1], np.int32))
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


def _in_reading_order(labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """Labels [H, W] numbered by their first cell in row order, 0 stays: OpenCV's numbers depend on where blocks of cells fall."""
    flat = labels.ravel()
    first = np.zeros(int(flat.max(initial=0)) + 1, np.int64)
    first[flat[::-1]] = np.arange(len(flat))[::-1]  # of equal indices the last assignment stays
    first[0] = -1
    number = np.empty(len(first), np.int32)
    number[np.argsort(first, kind="stable")] = np.arange(len(first))
    return np.asarray(number[labels])


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
        return min(ratio, width / max(float(min(disc[a], disc[b])), 1e-9))

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
