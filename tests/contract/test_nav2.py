"""Nav2's actions over real zenoh against a stand-in server, as zenoh-bridge-ros2dds and as rmw_zenoh put them on the wire."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from navigation_standin import free_endpoint

from irsd.core.runtime import Event, Ring
from irsd.io import cdr
from irsd.io.keys import parse_ros_attachment, ros_attachment, ros_service_token
from irsd.io.session import CDR, Query, Session, ZenohSettings, open_session
from nav_bridge.config import SinkSettings
from nav_bridge.sinks.base import Plan
from nav_bridge.sinks.nav2 import Nav2Sink

PATIENCE_S = 20.0
WAY = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 3.0, 1.57))
HASH = "RIHS01_" + "5a" * 32  # whatever the server's token says
FORMS = ("bridge", "rmw")


class Server:
    """An action server: accepts, gives feedback, ends when told to or cancelled."""

    def __init__(self, session: Session, form: str, action: str, *, accepts: bool = True) -> None:
        self.session, self.form, self.action, self.accepts = session, form, action, accepts
        self.goals: list[Any] = []
        self.cancelled: list[bytes] = []
        self.attachments: list[tuple[int, int, bytes]] = []
        self.end = Event()
        self.status = 4
        self._handles = [
            session.queryable(self._key("send_goal", "SendGoal"), self._send_goal),
            session.queryable(self._key("get_result", "GetResult"), self._get_result),
            session.queryable(self._key("cancel_goal", "CancelGoal"), self._cancel),
        ]

    def _key(self, service: str, kind: str) -> str:
        name = f"{self.action}/_action/{service}"
        if self.form == "bridge":
            return f"bot1/{name}"
        package = "action_msgs::srv" if kind == "CancelGoal" else "nav2_msgs::action"
        rmw = f"{package}::dds_::{'' if kind == 'CancelGoal' else 'X_'}{kind}_"
        self.session.announce(ros_service_token(self.session.zid, "bt_navigator", len(kind), name, rmw, HASH, 3))
        return f"3/{name}/{rmw}/{HASH}"

    def _reply(self, query: Query, payload: bytes) -> None:
        attachment = None
        if self.form == "rmw":
            parsed = parse_ros_attachment(query.attachment or b"")
            assert parsed is not None
            self.attachments.append(parsed)
            attachment = ros_attachment(*parsed)
        query.reply(query.key, payload, encoding=CDR, attachment=attachment)

    def _send_goal(self, query: Query) -> None:
        kind = cdr.SEND_GOAL_POSE if self.action == "navigate_to_pose" else cdr.SEND_GOAL_PATH
        self.goals.append(cdr.read(query.payload, kind))
        stamp = cdr.make(cdr.TIME, sec=1, nanosec=2)
        self._reply(query, cdr.write(cdr.make(cdr.SEND_GOAL_RESPONSE, accepted=self.accepts, stamp=stamp)))

    def _get_result(self, query: Query) -> None:
        self.end.wait(PATIENCE_S)
        self._reply(query, b"\0\1\0\0" + bytes([self.status]) + b"\0" * 9)

    def _cancel(self, query: Query) -> None:
        request = cdr.read(query.payload, cdr.CANCEL_REQUEST)
        self.cancelled.append(bytes(request.goal_info.goal_id.uuid))
        self._reply(query, cdr.write(cdr.make(cdr.CANCEL_RESPONSE, return_code=0, goals_canceling=[request.goal_info])))
        self.status = 5
        self.end.set()

    def feedback(self, left_m: float) -> None:
        goal = self.goals[-1]
        duration = cdr.make("builtin_interfaces/msg/Duration", sec=1, nanosec=0)
        message = cdr.make(
            cdr.NAVIGATE_FEEDBACK, goal_id=goal.goal_id, current_pose=goal.pose, navigation_time=duration,
            estimated_time_remaining=duration, number_of_recoveries=0, distance_remaining=left_m,
        )  # fmt: skip
        tail = "/nav2_msgs::action::dds_::X_FeedbackMessage_/" + HASH
        prefix = "bot1/" if self.form == "bridge" else "3/"
        key = f"{prefix}{self.action}/_action/feedback{tail if self.form == 'rmw' else ''}"
        self.session.put(key, cdr.write(message), encoding=CDR)


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
