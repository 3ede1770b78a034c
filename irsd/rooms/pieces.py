"""Space cut into pieces: which cuts are tried, and which pieces face each other across them."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.rooms import cuts as cutting
from irsd.rooms import kernels
from irsd.rooms.cuts import Cuts, Reach
from irsd.rooms.settings import SegmentSettings


def choose_cuts(
    space: NDArray[np.bool_],
    solid: NDArray[np.bool_],
    lintel: NDArray[np.bool_] | None,
    settings: SegmentSettings,
    resolution_m: float,
    before: NDArray[np.float64],
) -> Generator[None, None, Cuts]:
    """The cuts that are tried, a round in each step, none crossing another: doors first, then clear doorways of any
    width, then what is left.

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
        yield
    return cutting.joined(rounds)


@dataclass(frozen=True, slots=True)
class Borders:
    """Where two pieces face each other across a cut. pieces: int64 [B, 2], the first is less; cut: int64 [B], its index; cells:
    int64 [B], of the cut between the two; middle: float64 [B, 2] (x, y) of these; hand: float64 [B], +1 where the first piece
    is to the left of the cut, -1 where it is to the right."""

    pieces: NDArray[np.int64]
    cut: NDArray[np.int64]
    cells: NDArray[np.int64]
    middle: NDArray[np.float64]
    hand: NDArray[np.float64]


def cut_pieces(space: NDArray[np.bool_], cuts: Cuts) -> tuple[NDArray[np.int32], Borders]:
    """Cut space along the cuts. Returns the pieces, int32 [H, W] (0 = wall, -1 = cut), and their borders."""
    lines = cutting.drawn(cuts, space.shape)
    canvas = (space & ~lines).astype(np.uint8)
    # OpenCV's numbers depend on where blocks of cells fall.
    count, found = cv2.connectedComponents(canvas, connectivity=4)
    pieces = np.asarray(kernels.in_reading_order(np.asarray(found, np.int32), count))
    pieces[space & lines] = kernels.CUT
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
    unique, inverse, cells = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
    columns = (at[real, 0], at[real, 1], np.where(sides[0][real] == low[real], 1.0, -1.0))
    inverse = inverse.reshape(-1)
    x, y, hand_sum = (np.bincount(inverse, weights=c, minlength=len(unique)) for c in columns)
    middle = np.stack([x, y], axis=1) / np.maximum(cells, 1)[:, None]
    return pieces, Borders(
        unique[:, :2], unique[:, 2], cells.astype(np.int64), middle, np.where(hand_sum >= 0, 1.0, -1.0)
    )
