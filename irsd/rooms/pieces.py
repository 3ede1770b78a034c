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
    """The cuts that are tried, none crossing another: doors first, then clear doorways of any width, then what is left.

    Each round sees the cuts of those before as walls: an open door beside a cut does not make the space behind it wide.

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
    for limit, widest_m in ((settings.doorway, settings.door_max_m), (settings.doorway, np.inf), (1.1, np.inf)):
        corners = cutting.find_corners(closed, solid, settings.simplify_m / resolution_m)
        found = cutting.find_cuts(cutting.clearance(closed), corners, reach, lintel)
        found = cutting.preferring(found, before, reach.jamb)
        tried = (found.ratio <= limit) & (found.width * resolution_m <= widest_m)
        rounds.append(cutting.without_crossings(found.take(tried), reach.jamb))
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

    The weakest border goes first, while it is above ``constriction``; then pieces that are too small for a room go to the
    neighbour they are most open to.
    """
    graph = _PieceGraph(pieces, borders, cuts, dist, settings, resolution_m)
    graph.merge_weak()
    graph.merge_small()
    root = graph.roots()
    kept = (graph.area[root] >= settings.min_room_m2) & (root > 0)
    numbers = np.unique(root[kept])
    room_of = np.zeros(len(root), np.int32)
    room_of[kept] = np.searchsorted(numbers, root[kept]) + 1
    return room_of


class _PieceGraph:
    """Pieces and the borders between them while they merge. Works on plain numbers: there are hundreds, not thousands.

    A border is as weak as its widest cut: the lesser of the cut's own ratio and of its width / the diameter of the largest disc
    that fits in the smaller piece.
    """

    def __init__(
        self,
        pieces: NDArray[np.int32],
        borders: NDArray[np.int64],
        cuts: Cuts,
        dist: NDArray[np.float32],
        settings: SegmentSettings,
        resolution_m: float,
    ) -> None:
        self._settings = settings
        self.count = int(pieces.max(initial=0))
        flat = pieces.ravel()
        self.area = np.bincount(flat, minlength=self.count + 1) * resolution_m**2
        self._disc = np.zeros(self.count + 1)
        np.maximum.at(self._disc, flat, 2.0 * dist.ravel())
        self._rim = np.bincount(pieces[(pieces > 0) & (dist < 1.5)], minlength=self.count + 1).astype(float)
        self._parent = list(range(self.count + 1))
        self._near: list[dict[int, tuple[float, float]]] = [{} for _ in range(self.count + 1)]
        for a, b, cut, cells in borders[borders[:, 3] >= 2].tolist():
            ratio, width = self._near[a].get(b, (0.0, 0.0))
            ratio = max(ratio, float(cuts.ratio[cut]))
            width += min(cells + 1.0, float(cuts.width[cut]))
            self._near[a][b] = self._near[b][a] = (ratio, width)

    def merge_weak(self) -> None:
        """Join the pieces at the weakest border until all that are left are constrictions."""
        while True:
            urges = ((*self._urge(a), a) for a in range(1, self.count + 1) if self._near[a])
            strongest, b, a = max(urges, key=lambda u: (u[0], -u[2]), default=(0.0, 0, 0))
            if strongest <= self._settings.constriction:
                return
            self._join(a, b)

    def merge_small(self) -> None:
        """Give pieces that are too small for a room to the neighbour they are most open to."""
        for a in sorted(range(1, self.count + 1), key=lambda k: (self.area[k], k)):
            if self._parent[a] == a and self.area[a] < self._settings.min_room_m2 and self._near[a]:
                self._join(a, max(self._near[a], key=lambda b: (self._weakness(a, b), self.area[b], -b)))

    def roots(self) -> NDArray[np.intp]:
        """The piece that every piece [count + 1] has become a part of."""
        root = np.array(self._parent, np.intp)
        while (root[root] != root).any():
            root = root[root]
        return root

    def _weakness(self, a: int, b: int) -> float:
        ratio, width = self._near[a][b]
        return min(ratio, width / max(float(min(self._disc[a], self._disc[b])), 1e-9))

    def _urge(self, a: int) -> tuple[float, int]:
        """The weakest border of a piece and whom it leads to; a piece that is mostly open wants to join, whatever the border."""
        weakest, b = max((self._weakness(a, b), -b) for b in self._near[a])
        total = sum(width for _, width in self._near[a].values())
        opened = float(total / (total + self._rim[a])) if self.area[a] < self._settings.hall_m2 else 0.0
        return max(weakest, self._settings.constriction * opened / self._settings.open_rim), -b

    def _join(self, a: int, b: int) -> None:
        keep, gone = min(a, b), max(a, b)
        self._parent[gone] = keep
        self._disc[keep] = max(self._disc[keep], self._disc[gone])
        self.area[keep] += self.area[gone]
        self._rim[keep] += self._rim[gone]
        for c, (ratio, width) in self._near[gone].items():
            del self._near[c][gone]
            if c != keep:
                other = self._near[keep].get(c, (0.0, 0.0))
                self._near[keep][c] = self._near[c][keep] = (max(ratio, other[0]), width + other[1])
        self._near[gone] = {}
