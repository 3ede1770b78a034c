"""Pieces of space merged back to rooms where no wall speaks for the cut between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irsd.rooms.cuts import Cuts
from irsd.rooms.kernels import piece_stats, width_behind
from irsd.rooms.pieces import Borders
from irsd.rooms.settings import SegmentSettings

# How far behind a cut the width of a region is measured.
_DEPTHS_M = np.array([0.2, 0.4, 0.6, 0.8, 1.0, 1.3, 1.6])
_NOTHING_BEHIND = 9.0
_LONG = 2.0  # squares of the width of its mouth that a passage holds
_WIDE = 4.0  # space more than this many times wider than the cut is as good as wider still


def merge_pieces(
    pieces: NDArray[np.int32],
    borders: Borders,
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
    """Regions (pieces, while they merge) and the borders between them. Works on plain numbers: there are hundreds.

    A border is as weak as its weakest cut: the lesser of width of the cut / width of the regions behind it, measured inside
    the regions as they are now, and of width of the border / diameter of the largest disc that fits in the smaller region.
    """

    def __init__(
        self,
        pieces: NDArray[np.int32],
        borders: Borders,
        cuts: Cuts,
        dist: NDArray[np.float32],
        settings: SegmentSettings,
        resolution_m: float,
    ) -> None:
        self._settings, self._grid, self._borders, self._cuts = settings, pieces, borders, cuts
        self.count = int(pieces.max(initial=0))
        cells, self._disc, self._rim = piece_stats(pieces, dist, self.count)
        self.area = cells * resolution_m**2
        self._cells_per_m2 = resolution_m**-2
        self._root = np.arange(self.count + 1)
        self._members: list[list[int]] = [[k] for k in range(self.count + 1)]
        self._depths = _DEPTHS_M / resolution_m
        size = np.maximum(np.linalg.norm(cuts.ends[:, 1] - cuts.ends[:, 0], axis=1), 1e-9)
        self._tangent = (cuts.ends[:, 1] - cuts.ends[:, 0]) / size[:, None]
        self._width = np.minimum(borders.cells + 1.0, cuts.width[borders.cut])
        # Of every region: who is next to it, and the borders (rows of ``borders``) between them.
        self._near: list[dict[int, list[int]]] = [{} for _ in range(self.count + 1)]
        for row in np.flatnonzero(borders.cells >= 2).tolist():
            a, b = borders.pieces[row].tolist()
            self._near[a].setdefault(b, []).append(row)
            self._near[b].setdefault(a, self._near[a][b])
        self._weak: dict[tuple[int, int], tuple[float, float]] = {}

    def merge_weak(self) -> None:
        """Join regions, the least constricted border first, until all that are left are constrictions."""
        urges = [self._urge(a) for a in range(self.count + 1)]
        while True:
            a = max(range(len(urges)), key=lambda k: (urges[k][0], -k), default=0)
            urge, b = urges[a] if urges else (0.0, 0)
            if urge <= 0:
                return
            keep, gone = self._join(a, b)
            urges[gone] = (0.0, 0)
            for c in (keep, *self._near[keep]):
                urges[c] = self._urge(c)

    def merge_small(self) -> None:
        """Give regions that are too small for a room to the neighbour they are most open to."""
        for a in sorted(range(1, self.count + 1), key=lambda k: (self.area[k], k)):
            if self._root[a] == a and self.area[a] < self._settings.min_room_m2 and self._near[a]:
                self._join(a, max(self._near[a], key=lambda b: (self._weakness(a, b), self.area[b], -b)))

    def roots(self) -> NDArray[np.int64]:
        """The region that every piece [count + 1] has become a part of."""
        return self._root

    def _weakness(self, a: int, b: int) -> float:
        return self._weighed(a, b)[0]

    def _weighed(self, a: int, b: int) -> tuple[float, float]:
        """How weak a border is by the narrower of its two sides, which decides, and by the wider, which says what goes first:
        where neither side is wider than the cut nothing speaks for it."""
        key = (min(a, b), max(a, b))
        if key not in self._weak:
            rows = self._near[a][b]
            opened = self._opened(rows)
            narrow, wide = max(self._ratios(row) for row in self._widest_of_each_cut(rows))
            least = opened / max(min(self._disc[a], self._disc[b]), 1e-9)
            narrow, wide = min(narrow, least), min(wide, least)
            if self._mouth(a, b, opened, wide):
                narrow = min(narrow, self._settings.constriction)
            self._weak[key] = float(narrow), float(wide)
        return self._weak[key]

    def _opened(self, rows: list[int]) -> float:
        """Width of a border, in cells: what its cuts share with both regions, and all of a cut that is mostly between them."""
        whole = [float(self._cuts.width[self._borders.cut[row]]) for row in rows]
        mostly = [w for w, row in zip(whole, rows, strict=True) if 2 * self._borders.cells[row] >= w]
        return max(float(sum(self._width[row] for row in rows)), max(mostly, default=0.0))

    def _mouth(self, a: int, b: int, opened: float, wide: float) -> bool:
        """Whether a border is the mouth of a passage into a hall: all sides of the one are as wide as the border, and the other is
        several times wider, in every direction."""
        small, large = (a, b) if self._disc[a] <= self._disc[b] else (b, a)
        long = self.area[small] * self._cells_per_m2 >= _LONG * opened**2
        return bool(long and max(wide, opened / self._disc[large]) <= self._settings.mouth)

    def _widest_of_each_cut(self, rows: list[int]) -> list[int]:
        best: dict[int, int] = {}
        for row in rows:
            cut = int(self._borders.cut[row])
            if cut not in best or self._borders.cells[row] > self._borders.cells[best[cut]]:
                best[cut] = row
        return list(best.values())

    def _ratios(self, row: int) -> tuple[float, float]:
        """Width of the cut / width behind it on the narrower and on the wider side, inside the regions that meet there now."""
        cut = int(self._borders.cut[row])
        width, hand = float(self._cuts.width[cut]), float(self._borders.hand[row])
        behind = [
            width_behind(
                self._grid, self._root, int(self._root[piece]), self._borders.middle[row], self._tangent[cut],
                side, self._depths, width * _WIDE,
            )
            for piece, side in zip(self._borders.pieces[row].tolist(), (hand, -hand), strict=True)
        ]  # fmt: skip
        favour = float(self._cuts.favour[cut])
        narrow, wide = (favour * (width / b if b > 0 else _NOTHING_BEHIND) for b in (min(behind), max(behind)))
        return narrow, wide

    def _urge(self, a: int) -> tuple[float, int]:
        """How soon a region joins a neighbour, and which; 0 when constrictions are all around it. One that is mostly open wants
        to join, whatever the border."""
        weighed = [(*self._weighed(a, b), -b) for b in self._near[a]]
        # A clear doorway does not make a region open, and is no way to join.
        vague = [(narrow, wide, b) for narrow, wide, b in weighed if narrow > self._settings.doorway]
        total = sum(self._width[row] for _, _, b in vague for row in self._near[a][-b])
        opened = float(total / (total + self._rim[a])) if total > 0 and self.area[a] < self._settings.hall_m2 else 0.0
        open_to_all = opened > self._settings.open_rim
        joins = [(wide + narrow, b) for narrow, wide, b in vague if open_to_all or narrow > self._settings.constriction]
        urge, b = max(joins, default=(0.0, 0))
        return urge, -b

    def _join(self, a: int, b: int) -> tuple[int, int]:
        keep, gone = min(a, b), max(a, b)
        self._root[self._members[gone]] = keep
        self._members[keep] += self._members[gone]
        self._disc[keep] = max(self._disc[keep], self._disc[gone])
        self.area[keep] += self.area[gone]
        self._rim[keep] += self._rim[gone]
        for c in (*self._near[keep], *self._near[gone]):
            for one in (keep, gone):
                self._weak.pop((min(one, c), max(one, c)), None)
        for c, rows in self._near[gone].items():
            del self._near[c][gone]
            if c != keep:
                joined = self._near[keep].get(c, []) + rows
                self._near[keep][c] = self._near[c][keep] = joined
        self._near[gone] = {}
        return keep, gone
