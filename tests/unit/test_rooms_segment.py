"""Rooms of drawn plans: the truth is known by construction."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.core.types import PlanEvidence
from irsd.rooms.segment import segment_evidence, segment_map
from irsd.rooms.settings import SegmentSettings

Plan = NDArray[np.bool_]
CELL_M = 0.05


def cells(metres: float) -> int:
    return round(metres / CELL_M)


def boxes(*rooms: tuple[float, float, float, float], size_m: tuple[float, float] = (16.0, 12.0)) -> Plan:
    """bool [H, W] free cells of boxes (x0, y0, x1, y1) in metres; all else is wall."""
    free = np.zeros((cells(size_m[1]), cells(size_m[0])), bool)
    for x0, y0, x1, y1 in rooms:
        free[cells(y0) : cells(y1), cells(x0) : cells(x1)] = True
    return free


def picture(free: Plan) -> NDArray[np.uint8]:
    return np.where(free, 254, 0).astype(np.uint8)


def evidence(free: Plan, wall: Plan | None = None, lintel: Plan | None = None) -> PlanEvidence:
    """Free cells with a wall of three cells around them, nothing known beyond."""
    if wall is None:
        near = np.zeros_like(free)
        for dy in range(-3, 4):
            for dx in range(-3, 4):
                near |= np.roll(free, (dy, dx), (0, 1))
        wall = near & ~free
    frame = GridFrame((-2.0, 1.0), CELL_M, *free.shape)
    return PlanEvidence(frame, wall, free & ~wall, wall, wall | free, 0.0, 2.6, lintel)


TWO_ROOMS = ((1, 1, 6, 6), (6.2, 1, 11, 6), (5.9, 3, 6.3, 3.9))  # with a door of 0.9 m in a wall of 0.2 m
APARTMENT = (  # a corridor of 1.4 m with two rooms on each side
    (1, 5, 13, 6.4), (1, 1, 6, 4.8), (6.2, 1, 13, 4.8), (1, 6.6, 7, 10), (7.2, 6.6, 13, 10),
    (3, 4.7, 3.9, 5.1), (9, 4.7, 9.9, 5.1), (2, 6.3, 2.9, 6.7), (10, 6.3, 10.9, 6.7),
)  # fmt: skip


def test_an_empty_map_has_no_rooms() -> None:
    found = segment_map(np.zeros((40, 60), np.uint8), CELL_M)
    assert found.rooms == ()
    assert found.openings == ()
    assert not found.labels.any()
    nothing = np.zeros((40, 60), bool)
    assert segment_evidence(evidence(nothing, nothing), SegmentSettings()).rooms == ()
    none = np.zeros((0, 0), bool)
    assert segment_evidence(evidence(none, none), SegmentSettings()).rooms == ()


def test_a_field_without_walls_is_no_room() -> None:
    assert segment_map(np.full((100, 120), 255, np.uint8), CELL_M).rooms == ()


@pytest.mark.parametrize("bad", [np.zeros((4, 4, 3), np.uint8), np.zeros(4, np.uint8)])
def test_an_image_of_the_wrong_shape_is_refused(bad: NDArray[np.uint8]) -> None:
    with pytest.raises(ValueError, match="expected"):
        segment_map(bad, CELL_M)


def test_one_closed_box_is_one_room_drawn_to_its_walls() -> None:
    found = segment_map(picture(boxes((1, 2, 6, 5))), CELL_M)
    assert len(found.rooms) == 1
    assert found.openings == ()
    np.testing.assert_allclose(found.rooms[0].aabb_xy, (1, 2, 6, 5), atol=0.2)
    assert found.rooms[0].area_m2 == pytest.approx(15.0, rel=0.12)
    polygon = found.rooms[0].polygon_xy
    after = np.roll(polygon, -1, axis=0)
    assert (polygon[:, 0] * after[:, 1] - after[:, 0] * polygon[:, 1]).sum() > 0, "counter-clockwise"


def test_two_boxes_with_a_door_are_two_rooms_and_one_opening() -> None:
    found = segment_map(picture(boxes(*TWO_ROOMS)), CELL_M)
    assert len(found.rooms) == 2
    (door,) = found.openings
    assert door.rooms == (1, 2)
    assert door.width_m == pytest.approx(0.9, abs=0.11)
    np.testing.assert_allclose(door.position_xy, (6.1, 3.45), atol=0.2)


def test_rooms_of_a_corridor_are_found_and_the_corridor_is_not_cut() -> None:
    found = segment_map(picture(boxes(*APARTMENT)), CELL_M)
    assert len(found.rooms) == 5
    assert len(found.openings) == 4
    corridor = found.labels[cells(5.7), cells(7)]
    assert all(corridor in opening.rooms for opening in found.openings)
    assert len(np.unique(found.labels[cells(5.7), cells(1.2) : cells(12.8)])) == 1


def test_a_corner_of_a_corridor_is_no_door() -> None:
    assert len(segment_map(picture(boxes((1, 1, 9, 2.6), (7.4, 1, 9, 9))), CELL_M).rooms) == 1


def test_a_wide_opening_in_a_wall_line_is_cut() -> None:
    found = segment_map(picture(boxes((1, 1, 6, 7), (6.2, 1, 11, 7), (5.9, 2.5, 6.3, 5.3))), CELL_M)
    assert len(found.rooms) == 2
    assert found.openings[0].width_m == pytest.approx(2.8, abs=0.2)


def test_free_standing_furniture_cuts_nothing() -> None:
    free = boxes((1, 1, 8, 6))
    for x, y in ((2.5, 2.5), (3.1, 2.5), (2.5, 3.1), (3.1, 3.1), (5, 4), (5.5, 4.2)):
        free[cells(y) : cells(y) + 2, cells(x) : cells(x) + 2] = False
    found = segment_map(picture(free), CELL_M)
    assert len(found.rooms) == 1
    assert (found.labels[cells(1) : cells(6), cells(1) : cells(8)] == 1).all(), (
        "a room holds the floor under its furniture"
    )


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_turning_the_world_turns_the_rooms(turns: int) -> None:
    image = picture(boxes(*APARTMENT))
    one, other = segment_map(image, CELL_M), segment_map(np.ascontiguousarray(np.rot90(image, turns)), CELL_M)
    assert len(one.rooms) == len(other.rooms)
    back = np.rot90(other.labels, -turns)
    for k in range(1, len(one.rooms) + 1):
        mine = one.labels == k
        theirs = back == np.bincount(back[mine]).argmax()
        assert (mine & theirs).sum() / (mine | theirs).sum() > 0.97
    assert sorted(o.width_m for o in one.openings) == pytest.approx(sorted(o.width_m for o in other.openings), abs=0.12)


@pytest.mark.parametrize("shift", [(7, 0), (0, 31), (13, 5)])
def test_moving_the_world_by_whole_cells_changes_nothing_but_coordinates(shift: tuple[int, int]) -> None:
    free = boxes(*APARTMENT)
    moved = np.zeros((free.shape[0] + 40, free.shape[1] + 40), bool)
    moved[shift[0] : shift[0] + free.shape[0], shift[1] : shift[1] + free.shape[1]] = free
    one, other = segment_map(picture(free), CELL_M), segment_map(picture(moved), CELL_M)
    inner = other.labels[shift[0] : shift[0] + free.shape[0], shift[1] : shift[1] + free.shape[1]]
    assert (one.labels == inner).mean() > 0.999  # of two equally good cuts of a door either face may be taken
    offset = np.tile(np.array(shift[::-1]) * CELL_M, 2)
    for a, b in zip(one.rooms, other.rooms, strict=True):
        np.testing.assert_allclose(np.array(b.aabb_xy) - offset, a.aabb_xy, atol=0.25)


def test_the_same_plan_gives_the_same_bytes() -> None:
    image = picture(boxes(*APARTMENT))
    one, other = segment_map(image, CELL_M), segment_map(image.copy(), CELL_M)
    assert one.labels.tobytes() == other.labels.tobytes()
    assert [r.polygon_xy.tobytes() for r in one.rooms] == [r.polygon_xy.tobytes() for r in other.rooms]


def test_what_is_seen_through_a_door_is_no_room_yet() -> None:
    free = boxes((1, 1, 6, 6), (5.9, 3, 6.3, 3.9), size_m=(16, 10))
    walls = evidence(free).wall
    rows, columns = np.indices(free.shape)
    y, x = rows * CELL_M, columns * CELL_M
    wedge = (x > 6.1) & (x < 11) & (np.abs(y - 3.45) < 0.3 + 0.35 * (x - 6.1))
    seen = free | wedge
    found = segment_evidence(evidence(seen, walls & ~wedge), SegmentSettings())
    assert len(found.rooms) == 1
    assert found.rooms[0].aabb_xy[2] < -2.0 + 6.6


def test_posts_with_something_between_them_are_a_wall() -> None:
    free = boxes((1, 1, 9, 6))
    wall = evidence(free).wall
    low = wall.copy()
    for y in np.arange(1.0, 2.6, 0.4):  # folded doors: posts above, closed below; 3 m stay open
        wall[cells(y) : cells(y) + 2, cells(5) : cells(5) + 2] = True
        wall[cells(7.0 - y) - 2 : cells(7.0 - y), cells(5) : cells(5) + 2] = True
    low[cells(1) : cells(2.3), cells(5) : cells(5) + 2] = True
    low[cells(4.7) : cells(6), cells(5) : cells(5) + 2] = True
    plan = evidence(free, wall)
    joined = PlanEvidence(plan.frame, wall, plan.free, low, plan.known, 0.0, 2.6)
    assert len(segment_evidence(joined, SegmentSettings()).rooms) == 2


def test_a_step_of_the_ceiling_separates_a_balcony() -> None:
    free = boxes((1, 1, 8, 9))
    lintel = np.zeros_like(free)
    assert len(segment_evidence(evidence(free, None, lintel), SegmentSettings()).rooms) == 1
    lintel[cells(6.5) : cells(9), cells(1) : cells(8)] = True
    found = segment_evidence(evidence(free, None, lintel), SegmentSettings())
    assert len(found.rooms) == 2
    assert found.openings[0].position_xy[1] == pytest.approx(1.0 + 6.5, abs=0.2)
