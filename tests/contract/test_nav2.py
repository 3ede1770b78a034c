"""Nav2's actions over real zenoh against a stand-in server, as zenoh-bridge-ros2dds and as rmw_zenoh put them on the wire."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from nav2_standin import Server
from navigation_standin import free_endpoint

from irsd.core.runtime import Ring
from irsd.io.session import ZenohSettings, open_session
from nav_bridge.config import SinkSettings
from nav_bridge.sinks.base import Plan
from nav_bridge.sinks.nav2 import Nav2Sink

PATIENCE_S = 20.0
WAY = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 3.0, 1.57))
FORMS = ("bridge", "rmw")


@contextmanager
def nav2(form: str, action: str = "navigate_to_pose", *, accepts: bool = True) -> Iterator[tuple[Server, Nav2Sink]]:
    endpoint = free_endpoint()
    settings = SinkSettings(action=action, form=form, namespace="/bot1", domain=3)
    with (
        open_session(ZenohSettings(endpoint=endpoint, connect=()), "hub") as hub,
        open_session(ZenohSettings(endpoint=endpoint, connect=()), "client") as client,
    ):
        server = Server(hub, form, action, accepts=accepts)
        sink = Nav2Sink(client, settings)
        try:
            yield server, sink
        finally:
            server.end.set()
            sink.close()


def until(done: Callable[[], bool], beat: Callable[[], None] = lambda: None) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not done():
        assert time.monotonic() < deadline
        beat()
        time.sleep(0.02)


def plan(seq: int, way: tuple[tuple[float, float, float], ...] = WAY) -> Plan:
    return Plan("g", seq, "map", way, 0.6)


@pytest.mark.parametrize("form", FORMS)
def test_a_goal_with_feedback_to_its_result(form: str) -> None:
    with nav2(form) as (server, sink):
        sink.send(plan(1))
        until(lambda: len(server.goals) == 1, lambda: sink.beat(plan(1)))
        pose = server.goals[0].pose
        assert (pose.header.frame_id, pose.pose.position.x, pose.pose.position.y) == ("map", 2.0, 3.0)
        left: Ring[float] = Ring(8)
        for metres in (3.0, 2.0, 1.0):
            until(
                lambda m=metres: sink.distance_left_m.get() == m,  # type: ignore[misc]
                lambda m=metres: (server.feedback(m), sink.beat(plan(1))),  # type: ignore[misc]
            )
            left.put(metres)
        server.end.set()
        for _ in range(20):
            sink.beat(plan(1))
            time.sleep(0.02)
        assert (sink.trouble(), len(server.goals), server.cancelled) == ("", 1, [])
        if form == "rmw":
            assert len({gid for _, _, gid in server.attachments}) == 1
            assert len({seq for seq, _, _ in server.attachments}) == len(server.attachments)


@pytest.mark.parametrize("form", FORMS)
def test_cancel_midway_and_a_stale_plan(form: str) -> None:
    with nav2(form) as (server, sink):
        sink.send(plan(1))
        until(lambda: len(server.goals) == 1, lambda: sink.beat(plan(1)))
        time.sleep(0.1)
        sink.send(plan(2, ()))
        until(lambda: server.cancelled == [bytes(server.goals[0].goal_id.uuid)])
        server.end.clear()
        sink.send(plan(3))
        until(lambda: len(server.goals) == 2, lambda: sink.beat(plan(3)))
        until(lambda: len(server.cancelled) == 2)  # nobody beats
        assert sink.trouble() == ""


@pytest.mark.parametrize("form", FORMS)
def test_refused_aborted_and_absent_are_troubles(form: str) -> None:
    with nav2(form, accepts=False) as (server, sink):
        sink.send(plan(1))
        until(lambda: "refused" in sink.trouble(), lambda: sink.beat(plan(1)))
        assert len(server.goals) == 1  # asked once, not again and again
        server.accepts, server.status = True, 6
        sink.send(plan(2))
        until(lambda: len(server.goals) == 2, lambda: sink.beat(plan(2)))
        server.end.set()
        until(lambda: "aborted" in sink.trouble(), lambda: sink.beat(plan(2)))
    endpoint = free_endpoint()
    with open_session(ZenohSettings(endpoint=endpoint, connect=()), "hub") as session:
        lonely = Nav2Sink(session, SinkSettings(action="navigate_to_pose", form=form))
        lonely.send(plan(1))
        until(lambda: "navigate_to_pose" in lonely.trouble(), lambda: lonely.beat(plan(1)))
        lonely.close()


def test_a_path_is_followed_as_a_whole() -> None:
    with nav2("rmw", "follow_path") as (server, sink):
        sink.send(plan(1))
        until(lambda: len(server.goals) == 1, lambda: sink.beat(plan(1)))
        poses = server.goals[0].path.poses
        assert [(p.pose.position.x, p.pose.position.y) for p in poses] == [w[:2] for w in WAY]
