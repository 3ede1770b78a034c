"""Which pictures become keyframes: motion, novelty, rooms, stale things; and no blurred ones while others come."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irsd.core.types import KnownThings
from irsd.perception.select import KeyframeSelector, Worth, place_keys

S = 1_000_000_000
LOOK_X = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def pose(x: float, yaw_rad: float = 0.0) -> NDArray[np.float64]:
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    out = np.eye(4)
    out[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ LOOK_X
    out[0, 3] = x
    return out


def wall(x: float) -> NDArray[np.float32]:
    return np.stack([np.full(400, x), np.linspace(-2, 2, 400), np.ones(400)], 1).astype(np.float32)


def things(*last_seen_s: float) -> KnownThings:
    count = len(last_seen_s)
    return KnownThings(
        np.zeros(0, np.int32), np.arange(count, dtype=np.int64), np.zeros((count, 4), np.float32), np.ones(count, np.int32),
        np.ones(count, np.int32), np.array([round(s * S) for s in last_seen_s], np.int64),
    )  # fmt: skip


def test_a_robot_that_stands_still_looks_seldom_and_one_that_moves_often() -> None:
    taken = {}
    for speed in (0.0, 0.5):
        selector, count = KeyframeSelector(), 0
        for k in range(160):  # 40 s at 4 Hz
            at = pose(speed * k / 4)
            worth = selector.judge(k * S // 4, at, wall(2 + speed * k / 4), things(), 1)
            if selector.wants(k * S // 4, worth, waiting=False):
                selector.take(k * S // 4, worth, at, wall(2 + speed * k / 4), 1)
                count += 1
        taken[speed] = count
    assert 4 <= taken[0.0] <= 8
    assert taken[0.5] > 3 * taken[0.0]


def test_each_reason_makes_a_picture_worth_more() -> None:
    def worth(
        *, x: float = 0.0, place: float = 2.0, room: int = 1, seen_s: float = 99.0, yaw_rad: float = 0.0
    ) -> Worth:
        selector = KeyframeSelector()
        first = selector.judge(0, pose(0), wall(2.0), things(), 1)
        for _ in range(3):
            selector.take(0, first, pose(0), wall(2.0), 1)
        selector.judge(100 * S - S // 4, pose(x), wall(place), things(seen_s), room)
        return selector.judge(100 * S, pose(x, yaw_rad), wall(place), things(seen_s), room)

    plain = worth()
    assert worth(x=0.5).motion > plain.motion == 0.0
    assert worth(place=3.0).novelty == 1.0 > plain.novelty
    assert worth(room=2).room == 1.0 > plain.room
    assert worth(seen_s=1.0).staleness == 1.0 > plain.staleness
    assert worth(yaw_rad=0.3).sharpness < 0.5 < plain.sharpness
    for better in (worth(x=0.5), worth(place=3.0), worth(room=2), worth(seen_s=1.0)):
        assert better.total > plain.total


def test_of_those_that_wait_the_better_one_stays_until_it_ages() -> None:
    selector = KeyframeSelector()
    good = Worth(1.0, 1.0, 1.0, 0.0, 1.0)
    poor = Worth(0.5, 0.5, 0.5, 0.0, 1.0)
    selector.take(10 * S, good, pose(0), wall(2.0), 1)
    assert not selector.wants(10 * S + S // 4, poor, waiting=True)
    assert selector.wants(10 * S + S // 4, good, waiting=True)
    assert selector.wants(14 * S, poor, waiting=True)


def test_places_are_counted_once() -> None:
    assert len(place_keys(np.zeros((5, 3), np.float32))) == 1
    assert len(place_keys(np.array([[0.1, 0, 0], [-0.1, 0, 0], [0.3, 0, 0]], np.float32))) == 3
    assert len(place_keys(np.zeros((0, 3), np.float32))) == 0
