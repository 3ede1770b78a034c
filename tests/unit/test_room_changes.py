"""Things are looked at again exactly where the plan changed: never fewer than those whose room is another one now."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from irsd.core.grid import GridFrame
from irsd.core.types import Rooms
from irsd.instances.room_changes import may_have_moved
from irsd.instances.room_prior import room_of


def rooms(labels: np.ndarray, origin: tuple[float, float] = (-1.0, 2.0), resolution_m: float = 0.25) -> Rooms:
    ids = tuple(int(i) for i in np.unique(labels) if i)
    return Rooms(GridFrame(origin, resolution_m, *labels.shape), labels.astype(np.int32), ids, (), (), ())


def boxes_of(things: list[np.ndarray]) -> np.ndarray:
    return np.array([[*t[:, :2].min(0), *t[:, :2].max(0)] for t in things], np.float32).reshape(-1, 4)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(0, 3), st.integers(0, 3), st.booleans())
def test_whoever_is_in_another_room_is_told(seed: int, left: int, below: int, grown: bool) -> None:
    rng = np.random.default_rng(seed)
    old = np.kron(rng.integers(0, 3, (4, 5)), np.ones((5, 4), int))
    new = old.copy()
    r, c = rng.integers(0, old.shape)
    new[r : r + 4, c : c + 3] = rng.integers(0, 4)
    if grown:
        new = np.pad(new, ((below, 2), (left, 1)), constant_values=int(rng.integers(0, 2)))
    before, now = rooms(old), rooms(new, (-1.0 - 0.25 * left * grown, 2.0 - 0.25 * below * grown))
    things = [
        (rng.uniform([-3, 0, 0], [6, 9, 1]) + rng.uniform(-0.4, 0.4, (9, 3))).astype(np.float32) for _ in range(40)
    ]
    told = may_have_moved(before, now, boxes_of(things))
    for thing, is_told in zip(things, told, strict=True):
        assert is_told or room_of(before, thing) == room_of(now, thing)
    same = may_have_moved(now, rooms(new, now.frame.origin_xy_m), boxes_of(things))
    assert not same.any()


def test_only_things_where_it_changed_are_told() -> None:
    old = np.ones((20, 20), int)
    new = old.copy()
    new[2, 3] = 2
    at = np.array([[-1 + 0.25 * 3.5, 2 + 0.25 * 2.5, 0.0]], np.float32)
    assert may_have_moved(rooms(old), rooms(new), boxes_of([at, at + 2.0])).tolist() == [True, False]


def test_nothing_and_grids_that_do_not_match() -> None:
    labels = np.ones((4, 4), int)
    here = boxes_of([np.zeros((1, 3), np.float32)])
    assert may_have_moved(rooms(labels), rooms(labels), np.zeros((0, 4), np.float32)).shape == (0,)
    assert may_have_moved(None, rooms(labels), here).all()
    assert may_have_moved(rooms(labels), None, here).all()
    assert may_have_moved(rooms(labels), rooms(labels, (0.1, 2.0)), here).all()
    assert may_have_moved(rooms(labels), rooms(labels, resolution_m=0.5), here).all()
    assert may_have_moved(rooms(labels), rooms(labels[:2]), here).all()
