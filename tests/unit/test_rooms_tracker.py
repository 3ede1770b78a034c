"""Room ids over time: growth, split, merge, wavering, grids that grow, rooms of an earlier run."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.core.types import PlanEvidence, RoomFootprint, Rooms
from irsd.rooms.stage import RoomSettings, RoomStage
from irsd.rooms.tracker import RoomTracker, TrackSettings, overlaps, resampled

FRAME = GridFrame((0.0, 0.0), 0.1, 60, 100)
NO_WALLS = np.zeros((0, 3), np.float32)


def labels(*boxes: tuple[int, int, int, int]) -> NDArray[np.int32]:
    """Label k for the k-th box (row, row, column, column)."""
    grid = np.zeros((60, 100), np.int32)
    for k, (top, bottom, left, right) in enumerate(boxes, 1):
        grid[top:bottom, left:right] = k
    return grid


LEFT, RIGHT, BOTH = (5, 45, 5, 45), (5, 45, 45, 75), (5, 45, 5, 75)


def tracker(patience: int = 3) -> RoomTracker:
    return RoomTracker(TrackSettings(patience=patience, merge_patience=patience))


def ids_of(grid: NDArray[np.int32]) -> list[int]:
    return sorted(set(np.unique(grid).tolist()) - {0})


def test_nothing_gives_nothing() -> None:
    assert ids_of(tracker().update(labels(), FRAME).labels) == []
    none = np.zeros((0, 0), bool)
    nothing = PlanEvidence(GridFrame((0.0, 0.0), 0.05, 0, 0), none, none, none, none, 0.0, None)
    assert RoomStage(RoomSettings()).update(nothing, NO_WALLS, NO_WALLS).ids == ()


def test_overlaps_are_those_counted_cell_by_cell() -> None:
    rng = np.random.default_rng(4)
    old, new = rng.integers(0, 5, (20, 30)).astype(np.int32), rng.integers(0, 4, (20, 30)).astype(np.int32)
    expected = [[int(((old == a) & (new == b)).sum()) for b in range(4)] for a in range(5)]
    np.testing.assert_array_equal(overlaps(old, new), expected)


def test_ids_stay_when_rooms_grow_and_labels_are_renumbered() -> None:
    track = tracker()
    first = track.update(labels((5, 20, 5, 20), (5, 20, 50, 60)), FRAME).labels
    second = track.update(labels(RIGHT, LEFT), FRAME).labels
    assert first[10, 10] == second[10, 10] == 1
    assert first[10, 55] == second[10, 55] == 2


def test_ids_stay_when_the_grid_grows() -> None:
    track = tracker()
    track.update(labels(LEFT, RIGHT), FRAME)
    wide = GridFrame((-1.0, -2.0), 0.1, 90, 120)
    grown = resampled(labels(RIGHT, LEFT), FRAME, wide)
    found = track.update(grown, wide).labels
    assert found[20 + 10, 10 + 10] == 1
    assert found[20 + 10, 10 + 60] == 2


def test_a_split_is_believed_after_patience_and_the_larger_part_keeps_the_id() -> None:
    track = tracker(patience=3)
    track.update(labels(BOTH), FRAME)
    seen = [track.update(labels(RIGHT, LEFT), FRAME) for _ in range(3)]
    assert [ids_of(s.labels) for s in seen] == [[1], [1], [1, 2]]
    assert seen[2].labels[10, 10] == 1
    assert seen[2].labels[10, 60] == 2
    assert seen[2].lineage == ("R1 split into R1, R2",)


def test_a_merge_is_believed_after_patience_and_the_oldest_keeps_the_id() -> None:
    track = tracker(patience=3)
    track.update(labels(RIGHT, LEFT), FRAME)  # the smaller one is the older
    seen = [track.update(labels(BOTH), FRAME) for _ in range(3)]
    assert [ids_of(s.labels) for s in seen] == [[1, 2], [1, 2], [1]]
    assert seen[2].lineage == ("R2 merged into R1",)


def test_a_cut_that_wavers_changes_no_id() -> None:
    track = tracker(patience=3)
    track.update(labels(LEFT, RIGHT), FRAME)
    for _ in range(5):
        for now in (labels(BOTH), labels(LEFT, RIGHT), labels(LEFT, RIGHT)):
            found = track.update(now, FRAME)
            assert ids_of(found.labels) == [1, 2]
            assert found.lineage == ()


def test_a_room_that_was_merged_gets_its_id_back_when_it_splits_off_again() -> None:
    track = tracker(patience=1)
    track.update(labels(LEFT, RIGHT), FRAME)
    assert ids_of(track.update(labels(BOTH), FRAME).labels) == [1]
    assert track.update(labels(LEFT, RIGHT), FRAME).labels[10, 60] == 2


def test_a_room_out_of_sight_keeps_its_id() -> None:
    track = tracker()
    track.update(labels(LEFT, RIGHT), FRAME)
    assert ids_of(track.update(labels(LEFT), FRAME).labels) == [1]
    assert ids_of(track.update(labels(RIGHT, LEFT), FRAME).labels) == [1, 2]


def footprint(x0: float, y0: float, x1: float, y1: float) -> RoomFootprint:
    polygon = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    return RoomFootprint(polygon, (x0, y0, x1, y1), (x1 - x0) * (y1 - y0), 0.0, None)


def test_rooms_of_an_earlier_run_keep_their_ids_and_new_ones_come_after() -> None:
    track = tracker()
    track.restore([7, 4], [footprint(0.5, 0.5, 4.5, 4.5), footprint(4.5, 0.5, 7.5, 4.5)])
    found = track.update(labels(LEFT, RIGHT, (5, 45, 80, 95)), FRAME).labels
    assert (found[10, 10], found[10, 60], found[10, 90]) == (7, 4, 8)


@pytest.mark.parametrize("ids", [[1], [0, 2]])
def test_restoring_nonsense_is_refused(ids: list[int]) -> None:
    with pytest.raises(ValueError, match="positive id"):
        tracker().restore(ids, [footprint(0, 0, 1, 1), footprint(2, 0, 3, 1)])


# ------------------------------------------------------------------------------------------------ the stage
def house(seen_m: float) -> PlanEvidence:
    """Three rooms in a row with doors, seen up to x = seen_m."""
    free = np.zeros((140, 320), bool)
    for x0, x1 in ((1.0, 5.0), (5.2, 10.0), (10.2, 15.0)):
        free[20:120, round(x0 * 20) : round(x1 * 20)] = True
    for x in (5.0, 10.0):
        free[60:78, round(x * 20) : round(x * 20) + 4] = True
    wall = np.zeros_like(free)
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            wall |= np.roll(free, (dy, dx), (0, 1))
    wall &= ~free
    known = np.zeros_like(free)
    known[:, : round(seen_m * 20)] = True
    frame = GridFrame((-3.0, -3.0), 0.05, *free.shape)
    return PlanEvidence(frame, wall & known, free & known, wall & known, known, 0.0, 2.6)


def explore(stage: RoomStage) -> list[Rooms]:
    return [stage.update(house(x), NO_WALLS, NO_WALLS) for x in np.arange(3.0, 16.0, 0.5)]


def test_ids_are_stable_while_the_map_grows() -> None:
    history = explore(RoomStage(RoomSettings()))
    assert history[-1].ids == (1, 2, 3)
    assert {o.rooms for o in history[-1].openings} == {(1, 2), (2, 3)}
    for before, after in itertools.pairwise(history):
        earlier = resampled(before.labels, before.frame, after.frame)
        both = (earlier > 0) & (after.labels > 0)
        assert (earlier[both] == after.labels[both]).mean() > 0.9  # a strip behind a door becomes a room of its own
    assert max(max(r.ids, default=0) for r in history) == 3, "the frontier made no phantom rooms"


def test_unchanged_evidence_gives_the_same_object() -> None:
    stage = RoomStage(RoomSettings())
    first = stage.update(house(16.0), NO_WALLS, NO_WALLS)
    again = stage.update(house(16.0), NO_WALLS, NO_WALLS)
    assert again.lineage == ()
    assert again.footprints is first.footprints
    assert stage.update(house(16.0), NO_WALLS, NO_WALLS) is again


def test_a_restarted_stage_takes_up_the_ids() -> None:
    rooms = explore(RoomStage(RoomSettings()))[-1]
    stage = RoomStage(RoomSettings())
    stage.restore([i + 10 for i in rooms.ids], rooms.footprints)
    assert stage.update(house(16.0), NO_WALLS, NO_WALLS).ids == (11, 12, 13)


def test_rooms_that_are_not_seen_after_a_restart_stay_as_they_were_until_they_are() -> None:
    """Restarted in the first of three rooms: all three are there all the time, on the plan too, and with their doors."""
    full = explore(RoomStage(RoomSettings()))[-1]
    stage = RoomStage(RoomSettings())
    stage.restore(full.ids, full.footprints, full.openings)
    for x in np.arange(2.0, 16.0, 0.5):
        rooms = stage.update(house(x), NO_WALLS, NO_WALLS)
        assert rooms.ids == (1, 2, 3)
        assert [o.rooms for o in rooms.openings] == [(1, 2), (2, 3)]
        rows = rooms.frame.cells_of(np.array([[0.0, 0.0], [4.5, 0.0], [9.5, 0.0]]))
        assert rooms.labels[rows[:, 0], rows[:, 1]].tolist() == [1, 2, 3]
        for old, new in zip(full.footprints, rooms.footprints, strict=True):
            assert abs(old.area_m2 - new.area_m2) <= 0.2 * old.area_m2  # what counts as seen
    upstairs = RoomFootprint(full.footprints[0].polygon_xy, full.footprints[0].aabb_xy, 9.0, 3.0, 5.6, floor=1)
    stage = RoomStage(RoomSettings())
    stage.restore([*full.ids, 9], [*full.footprints, upstairs], full.openings)
    assert stage.update(house(4.0), NO_WALLS, NO_WALLS).ids == (1, 2, 3, 9)


def test_a_remembered_room_that_turns_out_to_be_part_of_another_is_gone() -> None:
    """Stored as two rooms, seen as one: in the end one is left, wherever the other was painted."""
    full = explore(RoomStage(RoomSettings()))[-1]
    left, right = (-2.0, -2.0, 0.0, 3.0), (0.0, -2.0, 2.0, 3.0)
    stage = RoomStage(RoomSettings())
    stage.restore([1, 7, 2, 3], [footprint(*left), footprint(*right), *full.footprints[1:]])
    for x in (*np.arange(2.0, 16.0, 0.5), *[16.0] * 30):
        rooms = stage.update(house(x), NO_WALLS, NO_WALLS, [(0.0, 0.0)])
    assert rooms.ids == (1, 2, 3)


def test_floor_heights_that_jitter_are_one_level() -> None:
    stage = RoomStage(RoomSettings())
    for k, x in enumerate((15.0, 15.5, 16.0)):
        seen = house(x)
        jittered = PlanEvidence(seen.frame, seen.wall, seen.free, seen.low, seen.known, 0.02 * k, 2.6)
        rooms = stage.update(jittered, NO_WALLS, NO_WALLS)
    assert [f.floor_z_m for f in rooms.footprints] == pytest.approx([0.02] * 3)
