"""Rooms of one instant: free space above furniture, cut at doorways and merged back where no wall speaks for a cut.

1. ``space``: what is free, walls closed where nobody can pass, small free-standing things and unseen specks filled in.
2. ``cuts`` and ``pieces.choose_cuts``: straight cuts at jambs, wall ends, along wall lines and under lintels.
3. ``merge.merge_pieces``: pieces grow together, the weakest cut first, until every cut that is left is a constriction.
4. Here: rooms without walls around them are dropped, footprints drawn out to the walls, the cuts that are left are openings.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Generator, Sequence
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.core.types import Opening, PlanEvidence, RoomFootprint, RoomSegmentation
from irsd.rooms.cuts import Cuts, clearance
from irsd.rooms.merge import merge_pieces
from irsd.rooms.outline import Footprints, filled
from irsd.rooms.pieces import choose_cuts, cut_pieces
from irsd.rooms.settings import SegmentSettings
from irsd.rooms.space import Plan, open_space, solid_walls

T = TypeVar("T")
Labels = NDArray[np.int32]
Labelling = Generator[None, None, tuple[Labels, tuple[Opening, ...]]]

_BESIDE_M = 0.2  # the rooms of an opening are looked up this far beside it
_CORNER_M = 0.3
FREE_FROM = 250  # pixel value from which a cell of a 2D map is free (map_server writes 254, drawings 255)


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
    # What is not free in a 2D map is wall: there is nothing between the room and its face to be grown into.
    exact = dataclasses.replace(settings or SegmentSettings(), wall_reach_m=0.0)
    labels, openings = finished(label_plan(frame, Plan(free, ~free, None), exact))
    _, rooms = Footprints(exact).draw(labels, frame, (0.0, None))
    return RoomSegmentation(frame, labels, rooms, openings)


def segment_evidence(
    evidence: PlanEvidence, settings: SegmentSettings, before: Sequence[Opening] = ()
) -> RoomSegmentation:
    """Rooms of the map as seen from above. before: openings found earlier; a cut at the same place is given some advantage, so
    that evidence that wavers about a threshold does not make rooms come and go."""
    labels, openings = label_evidence(evidence, settings, before)
    _, rooms = describe(labels, evidence, settings)
    return RoomSegmentation(evidence.frame, labels, rooms, openings)


def label_evidence(
    evidence: PlanEvidence, settings: SegmentSettings, before: Sequence[Opening] = ()
) -> tuple[Labels, tuple[Opening, ...]]:
    """``segment_evidence`` without footprints: labels int32 [H, W] (0 = none) and the openings between them."""
    return finished(labelling(evidence, settings, before))


def finished(work: Generator[None, None, T]) -> T:
    """What work in steps comes to, all steps at once."""
    while True:
        try:
            next(work)
        except StopIteration as done:
            result: T = done.value
            return result


def labelling(evidence: PlanEvidence, settings: SegmentSettings, before: Sequence[Opening] = ()) -> Labelling:
    """``label_evidence`` in steps of bounded length: each ``next`` does one, the last one returns."""
    if not evidence.free.any():  # OpenCV does not survive grids without cells
        return np.zeros(evidence.free.shape, np.int32), ()
    wall = solid_walls(evidence.wall, evidence.low, settings, evidence.frame.resolution_m)
    plan = Plan(evidence.free & ~evidence.wall, wall, evidence.lintel)
    return (yield from label_plan(evidence.frame, plan, settings, before))


def label_plan(frame: GridFrame, plan: Plan, settings: SegmentSettings, before: Sequence[Opening] = ()) -> Labelling:
    """Rooms of free space among walls, in steps: labels int32 [H, W] (0 = none) and the openings between them."""
    resolution = frame.resolution_m
    if not plan.free.any():
        return np.zeros((frame.height, frame.width), np.int32), ()
    space = open_space(plan.free & ~plan.wall, settings, resolution)
    solid = cv2.dilate(plan.wall.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    yield
    chosen = yield from choose_cuts(space, solid, plan.lintel, settings, resolution, _cells_of(before, frame))
    dist = clearance(space)
    pieces, borders = cut_pieces(space, chosen)
    room_of = merge_pieces(pieces, borders, chosen, dist, settings, resolution)
    yield
    # Closing walls rounded the corners of rooms off: what is free there belongs to the room beside.
    labels = filled(np.asarray(room_of[np.maximum(pieces, 0)]), space | (plan.free & plan.wall), _CORNER_M / resolution)
    labels = _supported(labels, solid, space, settings, resolution)
    left = np.unique(borders.cut[room_of[borders.pieces[:, 0]] != room_of[borders.pieces[:, 1]]]).tolist()
    return labels, openings_between(labels, frame, _cut_openings(frame, chosen, left))


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
    labels: Labels, evidence: PlanEvidence, settings: SegmentSettings
) -> tuple[tuple[int, ...], tuple[RoomFootprint, ...]]:
    """The numbers that occur in labels [H, W], ascending, and the footprint of each."""
    return Footprints(settings).draw(labels, evidence.frame, (evidence.floor_z_m, evidence.ceiling_z_m))


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
        found.append(dataclasses.replace(opening, rooms=(low, high)))
    return tuple(sorted(found, key=lambda o: (o.rooms, o.position_xy)))


def _cells_of(openings: Sequence[Opening], frame: GridFrame) -> NDArray[np.float64]:
    """Ends [K, 2, 2] of openings in cells (x, y)."""
    ends = np.array([o.segment_xy for o in openings], np.float64).reshape(-1, 2, 2)
    return np.asarray((ends - np.array(frame.origin_xy_m)) / frame.resolution_m - 0.5)


def _cut_openings(frame: GridFrame, cuts: Cuts, which: Sequence[int]) -> list[Opening]:
    """Cuts as openings whose rooms are not known yet."""
    found = []
    for cut in which:
        ends = (cuts.ends[cut] + 0.5) * frame.resolution_m + np.array(frame.origin_xy_m)
        x, y = ends.mean(0).tolist()
        found.append(Opening((0, 0), (x, y), float(cuts.width[cut]) * frame.resolution_m, ends))
    return found
