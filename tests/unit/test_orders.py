"""The robot's deadman: plans that are repeated are followed once, plans that are not are given up."""

from __future__ import annotations

import json
from typing import Any

import pytest

from irsd.sim.orders import Orders, Way


def document(seq: int, way: list[list[float]], **more: Any) -> bytes:
    return json.dumps({"goal_id": "g", "seq": seq, "waypoints": way, **more}).encode()


WAY, REST = [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [[2.0, 0.0, 0.0]]


def test_a_heartbeat_is_not_followed_again() -> None:
    orders = Orders()
    assert not orders.overdue(1e9)
    assert orders.hear(document(1, WAY, valid_s=1.0), 10.0) == Way(WAY, "map")
    assert orders.hear(document(1, REST, valid_s=1.0), 10.8) is None
    assert not orders.overdue(11.7)
    assert orders.hear(document(2, REST, valid_s=1.0), 11.0) == Way(REST, "map")


def test_silence_holds_once_and_a_late_word_resumes() -> None:
    orders = Orders()
    orders.hear(document(1, WAY, valid_s=1.0), 0.0)
    assert not orders.overdue(1.0)
    assert orders.overdue(1.01)
    assert not orders.overdue(5.0)
    assert orders.hear(document(1, REST, valid_s=1.0), 6.0) == Way(REST, "map")
    assert orders.overdue(7.5)


def test_a_stop_and_a_plan_for_ever_are_never_overdue() -> None:
    orders = Orders()
    orders.hear(document(1, WAY, valid_s=1.0), 0.0)
    assert orders.hear(document(2, [], valid_s=1.0), 0.5) == Way([], "map")
    assert not orders.overdue(100.0)
    assert orders.hear(document(1, WAY, valid_s=1.0), 101.0) == Way(WAY, "map")
    for _ in range(2):
        assert orders.hear(document(3, WAY), 101.5) == Way(WAY, "map")
    assert not orders.overdue(1e6)


@pytest.mark.parametrize(
    "payload",
    [
        b"nonsense",
        b"[]",
        b'{"waypoints": [[1, 2]]}',
        b'{"waypoints": [], "valid_s": 0}',
        b"\xff",
        b'{"waypoints": [], "frame": "utm"}',
    ],
)
def test_nonsense_changes_nothing(payload: bytes) -> None:
    orders = Orders()
    orders.hear(document(1, WAY, valid_s=1.0), 0.0)
    with pytest.raises(ValueError):  # noqa: PT011  json's, unicode's and ours
        orders.hear(payload, 0.5)
    assert orders.hear(document(1, REST, valid_s=1.0), 0.9) is None


def test_a_way_is_followed_in_the_frame_that_it_names() -> None:
    orders = Orders()
    assert orders.hear(document(1, WAY, frame="odom"), 0.0) == Way(WAY, "odom")
    assert orders.hear(document(2, WAY), 0.0) == Way(WAY, "map")
