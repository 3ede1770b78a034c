"""The work on a large plan is spread over more scans, and ends with the rooms that it would have ended with at once."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.core.types import PlanEvidence
from irsd.rooms.settings import RoomSettings
from irsd.rooms.stage import RoomStage

NONE = np.zeros((0, 3), np.float32)


class Hall:
    """Three rooms in a row on a plan of this many cells a side, the third unknown at first."""

    def __init__(self, side: int) -> None:
        self.side, self.seen = side, 2

    def plan_evidence(self) -> PlanEvidence:
        free = np.zeros((self.side, self.side), np.bool_)
        for room in range(self.seen):
            free[20:140, 20 + 110 * room : 120 + 110 * room] = True
        free[75:95, 20 : 110 * self.seen] = True
        free[-9:-1, -9:-1] = True  # the far corner makes the plan as large as it is
        wall = np.zeros_like(free)
        wall[15:145, 15 : 125 + 110 * (self.seen - 1)] = True
        wall &= ~free
        nothing = np.zeros_like(free)
        return PlanEvidence(GridFrame((0.0, 0.0), 0.05, *free.shape), wall, free, nothing, wall | free, 0.0, 2.5)

    def wall_points(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        return NONE, NONE


@pytest.mark.parametrize(("side", "pause"), [(400, 0), (1500, 2)])
def test_a_larger_plan_takes_more_scans_to_the_same_rooms(side: int, pause: int) -> None:
    source, stage = Hall(side), RoomStage(RoomSettings())
    first = stage.follow(source)
    source.seen = 3
    calls = 0
    while len(stage.follow(source).ids) == len(first.ids):
        calls += 1
        assert calls < 400
    whole = RoomStage(RoomSettings())
    at_once = whole.update(source.plan_evidence(), NONE, NONE)
    assert len(at_once.ids) == len(first.ids) + 1
    now = stage.follow(source)
    np.testing.assert_array_equal(now.labels > 0, at_once.labels > 0)
    assert stage._pause == pause


def test_rests_lie_between_the_parts_of_the_work() -> None:
    counts = {}
    for side in (400, 1500):
        source, stage = Hall(side), RoomStage(RoomSettings())
        first = stage.follow(source)
        source.seen = 3
        counts[side] = 0
        while len(stage.follow(source).ids) == len(first.ids):
            counts[side] += 1
    assert counts[1500] > 2 * counts[400]
