"""Rooms of an earlier run that the robot has not seen again: they stay as they were stored until it does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.core.types import Opening, PlanEvidence, RoomFootprint

BLOCK = 32  # evidence covers whole blocks of cells, so that its frame seldom changes
_SEEN = 0.8  # share of a room's cells that are known from which it is what is seen of it
_DOOR_M, _DOOR_SEEN = 1.0, 0.9  # a door is seen when this share of what lies this near is known


class Remembered:
    """The stored rooms of one floor. ``take`` what was found of them, then ``fill`` what was not seen."""

    def __init__(self) -> None:
        self._rooms: dict[int, RoomFootprint] = {}
        self._openings: tuple[Opening, ...] = ()
        self._found: set[int] = set()
        self._drawn: tuple[GridFrame, NDArray[np.int32]] | None = None

    def restore(self, ids: Sequence[int], footprints: Sequence[RoomFootprint], openings: Sequence[Opening]) -> None:
        """Rooms and the ways between them as stored; Opening.rooms hold ids."""
        self._rooms, self._openings = dict(zip(ids, footprints, strict=True)), tuple(openings)
        self._drawn = None

    def __bool__(self) -> bool:
        return bool(self._rooms)

    def footprint(self, room: int) -> RoomFootprint:
        """A room as it was stored."""
        return self._rooms[room]

    def padded(self, evidence: PlanEvidence) -> PlanEvidence:
        """The evidence on a grid that holds all remembered rooms, too; nothing is known of what is added."""
        if not self._rooms:
            return evidence
        frame = evidence.frame
        corners = np.concatenate([f.polygon_xy for f in self._rooms.values()])
        start = np.rint(np.array(frame.origin_xy_m) / frame.resolution_m).astype(
            int
        )  # of the grid, in cells of the map
        size = np.array([frame.width, frame.height])
        low = np.floor(corners.min(0) / frame.resolution_m).astype(int) // BLOCK * BLOCK
        high = -(-np.ceil(corners.max(0) / frame.resolution_m).astype(int) // BLOCK) * BLOCK
        (left, bottom), (right, top) = np.maximum(start - low, 0), np.maximum(high - start - size, 0)
        if not (left or bottom or right or top):
            return evidence
        around = ((bottom, top), (left, right))
        layers: dict[str, Any] = {
            name: np.pad(getattr(evidence, name), around) for name in ("wall", "free", "low", "known")
        }
        lintel = None if evidence.lintel is None else np.pad(evidence.lintel, around)
        x, y = frame.origin_xy_m
        height, width = layers["known"].shape
        origin = (x - float(left) * frame.resolution_m, y - float(bottom) * frame.resolution_m)
        wide = replace(frame, origin_xy_m=origin, height=height, width=width)
        return replace(evidence, frame=wide, lintel=lintel, **layers)

    def fill(self, labels: NDArray[np.int32], evidence: PlanEvidence) -> tuple[NDArray[np.int32], frozenset[int]]:
        """(labels [H, W] of ids with the unseen parts of remembered rooms, ids of which nothing was seen).

        What was seen for the most part, or was seen and is no more (it became part of another room), is remembered no longer.
        """
        if not self._rooms:
            return labels, frozenset()
        drawn = self._on(evidence.frame)
        most = max(int(drawn.max()), int(labels.max()), *self._rooms) + 1
        cells = np.bincount(drawn.ravel(), minlength=most)
        known = np.bincount(drawn[evidence.known], minlength=most)
        live = np.bincount(labels.ravel(), minlength=most) > 0
        over = [i for i in self._rooms if known[i] >= _SEEN * cells[i] or (i in self._found and not live[i])]
        self._found |= {i for i in self._rooms if live[i]}
        for room in over:
            del self._rooms[room]
        gone = np.zeros(most, np.bool_)
        gone[[0, *over]] = True
        drawn[gone[drawn]] = 0
        out = np.where((labels == 0) & ~evidence.known, drawn, labels).astype(np.int32)
        return out, frozenset(i for i in self._rooms if not live[i])

    def openings(self, evidence: PlanEvidence, ids: Sequence[int], found: Sequence[Opening]) -> tuple[Opening, ...]:
        """The stored ways between rooms that are still there, where the robot has neither looked nor found one."""
        frame, reach = evidence.frame, round(_DOOR_M / evidence.frame.resolution_m)
        kept = []
        for opening in self._openings:
            row, col = frame.cells_of(np.array([opening.position_xy]))[0]
            near = evidence.known[max(row - reach, 0) : row + reach + 1, max(col - reach, 0) : col + reach + 1]
            seen = near.size and near.mean() >= _DOOR_SEEN
            again = any(o.rooms == opening.rooms and _apart_m(o, opening) < _DOOR_M for o in found)
            if not seen and not again and all(room in ids for room in opening.rooms):
                kept.append(opening)
        self._openings = tuple(kept)
        return self._openings

    def _on(self, frame: GridFrame) -> NDArray[np.int32]:
        """The rooms drawn on a grid, smaller ones over larger."""
        if self._drawn is None or self._drawn[0] != frame:
            labels = np.zeros((frame.height, frame.width), np.int32)
            for number, place in sorted(self._rooms.items(), key=lambda r: -r[1].area_m2):
                corners = (place.polygon_xy - np.array(frame.origin_xy_m)) / frame.resolution_m - 0.5
                cv2.fillPoly(labels, [np.rint(corners).astype(np.int32)], int(number))
            self._drawn = (frame, labels)
        return self._drawn[1]


def _apart_m(one: Opening, two: Opening) -> float:
    return float(np.hypot(*np.subtract(one.position_xy, two.position_xy)))
