"""Who is who: rooms of one instant matched to the rooms known before, so that ids stay while the map grows.

An id goes to the new room that holds most of the old one's floor. When a room splits, the larger part keeps the id; when rooms
merge, the oldest keeps it. A split or a merge is believed only after it was seen several times in a row: until then the old
partition is held. Owner: ``RoomTracker`` is the single writer of its memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.core.settings import setting
from irsd.core.types import RoomFootprint
from irsd.rooms.kernels import overlap_table

Labels = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class TrackSettings:
    """How slowly rooms change their identity."""

    patience: int = setting(2, "a split is adopted after it was found in this many updates in a row", lo=1, hi=100)
    merge_patience: int = setting(
        10, "a merge is adopted after this many: a cut once seen needs more to vanish", lo=1, hi=1000
    )
    overlap: float = setting(
        0.3, "part of a room (the smaller of old and new) that must be shared to be the same room", lo=0.05, hi=0.95
    )


@dataclass(frozen=True, slots=True)
class Tracked:
    """labels: int32 [H, W] of room ids. lineage: what became of rooms in this update."""

    labels: Labels
    lineage: tuple[str, ...]


def resampled(labels: Labels, old: GridFrame, new: GridFrame) -> Labels:
    """Labels of one grid as seen on another of the same resolution, by whole cells; what falls outside is lost."""
    out = np.zeros((new.height, new.width), np.int32)
    shift = np.rint((np.array(old.origin_xy_m) - np.array(new.origin_xy_m)) / new.resolution_m).astype(int)
    column, row = int(shift[0]), int(shift[1])
    top, left = max(row, 0), max(column, 0)
    bottom, right = min(row + old.height, new.height), min(column + old.width, new.width)
    if top < bottom and left < right:
        out[top:bottom, left:right] = labels[top - row : bottom - row, left - column : right - column]
    return out


def overlaps(old: Labels, new: Labels) -> NDArray[np.int64]:
    """int64 [old.max() + 1, new.max() + 1]: cells shared by each pair of labels of two label grids [H, W]."""
    return np.asarray(overlap_table(old, new, int(old.max(initial=0)), int(new.max(initial=0))), np.int64)


class IdSource:
    """Gives out room ids, each once, over all floors."""

    def __init__(self) -> None:
        self._next = 1

    def take(self) -> int:
        """A new id."""
        self._next += 1
        return self._next - 1

    @property
    def next_id(self) -> int:
        """The id that comes next."""
        return self._next

    def reserve(self, ids: Sequence[int]) -> None:
        """New ids will be higher than these."""
        self._next = max([self._next, *(i + 1 for i in ids)])


class RoomTracker:
    """Keeps room ids over successive segmentations. Ids count from 1 and are never used twice."""

    def __init__(self, settings: TrackSettings, ids: IdSource | None = None) -> None:
        self._settings = settings
        self._ids = ids or IdSource()
        self._frame: GridFrame | None = None
        self._memory: Labels = np.zeros((0, 0), np.int32)  # the last id each cell had, also of rooms not seen now
        self._retired: Labels = self._memory  # the last id of cells whose room was merged into another
        self._waiting: dict[tuple[str, int, int], int] = {}  # changes seen but not yet believed, with how often
        self._restored: tuple[tuple[int, RoomFootprint], ...] = ()

    def restore(self, ids: Sequence[int], footprints: Sequence[RoomFootprint]) -> None:
        """Start from rooms of an earlier run. Raises ValueError when the two differ in length or an id is not positive."""
        if len(ids) != len(footprints) or any(i < 1 for i in ids):
            raise ValueError(f"expected one positive id per footprint, got {list(ids)} for {len(footprints)}")
        self._restored = tuple(zip(ids, footprints, strict=True))
        self._ids.reserve(ids)

    def update(self, labels: Labels, frame: GridFrame) -> Tracked:
        """Labels [H, W] of one segmentation (0 = none, 1.. = rooms) as labels of ids, held back where change is too young."""
        if not labels.size:
            return Tracked(labels, ())
        memory, retired = self._recalled(frame)
        shared = overlaps(memory, labels)
        merges, splits, heirs = self._relations(shared)
        held, waiting, lineage = labels.copy(), {}, []
        ids = np.zeros(shared.shape[1], np.int32)
        for old, new in heirs:
            ids[new] = old
        for new, others in merges:
            for other in others:
                key = ("merge", int(ids[new]), other)
                waiting[key] = self._waiting.get(key, 0) + 1
        believed = {key for key, seen in waiting.items() if seen >= self._settings.merge_patience}
        fresh: list[int] = []
        for old, parts in splits:
            for part in parts:
                key = ("split", old, self._part_key(labels, frame, part))
                waiting[key] = self._waiting.get(key, 0) + 1
                if waiting[key] < self._settings.patience:
                    ids[part] = old
        for new in range(1, len(ids)):
            if ids[new] == 0 and shared[:, new].any():
                ids[new] = self._revived(labels == new, retired, set(ids.tolist()))
                fresh.append(new)
        held = ids[labels]
        for new, others in merges:
            young = [o for o in others if ("merge", int(ids[new]), o) not in believed]
            if young:
                held = _held_apart(held, labels == new, memory, [int(ids[new]), *young])
            gone = [f"R{o}" for o in others if o not in young]
            if gone:
                absorbed = np.isin(memory, [o for o in others if o not in young])
                retired[absorbed] = memory[absorbed]
                lineage.append(f"{', '.join(gone)} merged into R{ids[new]}")
        for old, parts in splits:
            names = [f"R{ids[p]}" for p in parts if ids[p] != old]
            if names:
                lineage.append(f"R{old} split into {', '.join([f'R{old}', *names])}")
        born = [n for n in fresh if not any(n in parts for _, parts in splits)]
        lineage += [f"R{ids[n]} found" for n in born]
        self._waiting = waiting
        self._retired = retired
        self._frame, self._memory = frame, np.where(held > 0, held, memory).astype(np.int32)
        return Tracked(held.astype(np.int32), tuple(lineage))

    def _revived(self, part: NDArray[np.bool_], retired: Labels, taken: set[int]) -> int:
        """The id for a new room: that of a room that stood here before it was merged into another, else a new one."""
        here = np.bincount(retired[part])
        here[:1] = 0
        best = int(here.argmax()) if here.any() else 0
        if best and best not in taken and 2 * here[best] > max(int(part.sum()), int((retired == best).sum())):
            retired[retired == best] = 0
            return best
        return self._ids.take()

    def _recalled(self, frame: GridFrame) -> tuple[Labels, Labels]:
        """The memory of rooms and of merged rooms on the grid of now; the first time, the restored rooms."""
        memory, retired = np.zeros((2, frame.height, frame.width), np.int32)
        if self._frame is not None:
            memory = resampled(self._memory, self._frame, frame)
            retired = resampled(self._retired, self._frame, frame)
        restored, self._restored = self._restored, ()
        for number, footprint in sorted(restored, key=lambda r: -r[1].area_m2):
            corners = (footprint.polygon_xy - np.array(frame.origin_xy_m)) / frame.resolution_m - 0.5
            cv2.fillPoly(memory, [np.rint(corners).astype(np.int32)], int(number))
        return memory, retired

    def _relations(
        self, shared: NDArray[np.int64]
    ) -> tuple[list[tuple[int, list[int]]], list[tuple[int, list[int]]], list[tuple[int, int]]]:
        """From the overlap table: merges (new, absorbed old ids), splits (old id, other new parts), heirs (old id, new)."""
        inner = shared[1:, 1:]
        size_old, size_new = shared[1:].sum(1), shared[:, 1:].sum(0)
        least = self._settings.overlap * np.minimum(size_old[:, None], size_new[None, :])
        same = (inner >= np.maximum(least, 1)) & (inner > 0)
        home = np.where(same.any(1), np.where(same, inner, 0).argmax(1), -1) if inner.size else np.full(len(inner), -1)
        heirs, merges, splits = [], [], []
        for new in range(inner.shape[1]):
            claims = np.flatnonzero(home == new)
            if len(claims):
                heirs.append((int(claims[0]) + 1, new + 1))
                if len(claims) > 1:
                    merges.append((new + 1, [int(c) + 1 for c in claims[1:]]))
        heir_of = {old: new for old, new in heirs}
        taken = set(heir_of.values())
        for old in heir_of:
            # A part belongs to the split room when most of what was known of it belonged to that room.
            parts = [
                new + 1
                for new in np.flatnonzero(same[old - 1]).tolist()
                if new + 1 not in taken
                and inner[:, new].argmax() == old - 1
                and 2 * inner[old - 1, new] > size_new[new]
            ]
            if parts:
                splits.append((old, parts))
        return merges, splits, heirs

    def _part_key(self, labels: Labels, frame: GridFrame, part: int) -> int:
        """A name for a young part that survives growth: its innermost cell's metre square, of the whole map."""
        mask = np.pad((labels == part).astype(np.uint8), 1)
        row, column = np.unravel_index(int(cv2.distanceTransform(mask, cv2.DIST_L2, 3).argmax()), mask.shape)
        x, y = frame.centres_of(np.array([[row - 1, column - 1]]))[0]
        return int(np.floor(x / 2.0)) * 100_003 + int(np.floor(y / 2.0))


def _held_apart(held: Labels, region: NDArray[np.bool_], memory: Labels, ids: list[int]) -> Labels:
    """``held`` with a region of newly joined rooms still split among their old ids: each cell goes to the nearest old cell."""
    seeds = np.where(region & np.isin(memory, ids), memory, 0)
    _, nearest = cv2.distanceTransformWithLabels(
        (seeds == 0).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    lookup = np.zeros(int(nearest.max()) + 1, np.int32)
    lookup[nearest[seeds > 0]] = seeds[seeds > 0]
    return np.asarray(np.where(region, lookup[nearest], held), np.int32)
