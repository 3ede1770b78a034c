"""Nav2 as the driver: the actions NavigateToPose and FollowPath over zenoh-bridge-ros2dds or rmw_zenoh.

An action is three services and two topics. The bridge's keys are their ROS names; rmw_zenoh's hold type and hash besides, which are
read from the servers' liveliness tokens, never computed. A thread of its own asks, as an answer may take long.
"""

from __future__ import annotations

import hashlib
import logging
from dataclasses import dataclass

from irsd.core.errors import DecodeError, TransportError
from irsd.core.runtime import Cell, Stopper, Worker, monotonic_ns, monotonic_s, wall_clock_ns
from irsd.io.cdr import (
    GET_RESULT_REQUEST,
    NAVIGATE_FEEDBACK,
    SEND_GOAL_RESPONSE,
    decode_result_status,
    encode_goal_path,
    encode_goal_pose,
    make,
    make_uuid,
    read,
    write,
)
from irsd.io.session import Sample, Session
from nav_bridge.config import SinkSettings
from nav_bridge.sinks.action import ActionClient
from nav_bridge.sinks.base import Plan
from nav_bridge.sinks.guard import Guard

_log = logging.getLogger(__name__)

_PERIOD_S = 0.05
_ASK_S = 5.0
_FEEDBACK_S = 3.0  # Nav2 speaks many times a second; a bridge between us goes on answering when Nav2 is dead
_RESULT_S = 300.0  # as long as the bridge lets a get_result wait; then it is asked again
_SUCCEEDED, _ENDS = 4, {5: "Nav2 cancelled the goal", 6: "Nav2 gave up (aborted)"}


@dataclass(frozen=True, slots=True)
class _Order:
    """The last plan and when it was last said to hold."""

    plan: Plan
    beat_s: float


@dataclass(frozen=True, slots=True)
class _Goal:
    """A goal that Nav2 has accepted: the plan it is of, its id and the worker that waits for its result."""

    plan: tuple[str, int]
    goal_id: bytes
    waiting: Worker


class Nav2Sink:
    """Sends plans as goals of one action. send, beat, trouble, close: from one thread; Nav2 is spoken to by another."""

    def __init__(self, session: Session, settings: SinkSettings, guard: Guard | None = None) -> None:
        """guard: cancels the goal should this process be killed; None: nobody does."""
        self._settings = settings
        self._guard = guard
        self._client = ActionClient(session, settings)
        self._order: Cell[_Order | None] = Cell(None)
        self._trouble: Cell[str] = Cell("")
        self._result: Cell[tuple[bytes, str] | None] = Cell(None)
        self._heard_s: Cell[float | None] = Cell(None)
        self.distance_left_m: Cell[float | None] = Cell(None)
        self._goal: _Goal | None = None
        self._failed: tuple[str, int] | None = None
        self._stopper = Stopper()
        self._feedback = session.subscribe(self._client.feedback_key, self._hear)
        self._worker = Worker("nav2", self._run, lambda error: self._trouble.set(f"internal error: {error}")).start()

    def send(self, plan: Plan) -> None:
        self._trouble.set("")
        self._order.set(_Order(plan, monotonic_s()))

    def beat(self, plan: Plan) -> None:
        order = self._order.get()
        if order is not None and (order.plan.goal_id, order.plan.seq) == (plan.goal_id, plan.seq):
            self._order.set(_Order(order.plan, monotonic_s()))

    def trouble(self) -> str:
        return self._trouble.get()

    def close(self) -> None:
        """Cancels the goal under way."""
        self._stopper.request("closed")
        self._worker.join(2 * _ASK_S)
        self._feedback.close()

    def _hear(self, sample: Sample) -> None:
        """Feedback, on the session's dispatcher thread. FollowPath's has other fields: that it comes is enough."""
        self._heard_s.set(monotonic_s())
        if self._settings.action != "navigate_to_pose":
            return
        try:
            message = read(sample.payload, NAVIGATE_FEEDBACK)
        except DecodeError as error:
            _log.debug("feedback dropped: %s", error)
            return
        goal = self._goal
        if goal is not None and bytes(message.goal_id.uuid) == goal.goal_id:
            self.distance_left_m.set(float(message.distance_remaining))

    # ---------------------------------------------------------------------------------------------- on the own thread
    def _run(self) -> None:
        while not self._stopper.wait(_PERIOD_S):
            try:
                self._step(self._order.get(), monotonic_s())
            except (TransportError, DecodeError) as error:
                self._fail(f"Nav2: {error}")
        try:
            self._cancel("nav_bridge stops")
        except (TransportError, DecodeError) as error:
            _log.warning("the goal could not be cancelled: %s", error)
        if self._guard is not None:
            self._guard.close()

    def _step(self, order: _Order | None, now_s: float) -> None:
        self._take_result()
        if order is None or not order.plan.waypoints:
            self._cancel("stop")
            return
        if now_s - order.beat_s > order.plan.valid_s:
            self._cancel("the plan is stale")
            return
        heard_s, goal = self._heard_s.get(), self._goal
        if goal is not None and goal.waiting.alive and heard_s is not None and now_s - heard_s > _FEEDBACK_S:
            self._failed = goal.plan
            self._trouble.set(f"Nav2 is gone: no feedback for {now_s - heard_s:.0f} s")
            self._cancel("it is silent")
        if self._guard is not None:
            self._guard.check()
        name = (order.plan.goal_id, order.plan.seq)
        if name != self._failed and (self._goal is None or self._goal.plan != name):
            self._start(order.plan, name)  # Nav2 itself preempts the goal before

    def _take_result(self) -> None:
        result, goal = self._result.get(), self._goal
        if result is None or goal is None or result[0] != goal.goal_id:
            return
        self._result.set(None)
        if result[1]:
            self._fail(result[1])
        else:
            self._watch(None)

    def _start(self, plan: Plan, name: tuple[str, int]) -> None:
        stamp_ns, follow = wall_clock_ns(), self._settings.action == "follow_path"
        goal_id = hashlib.sha256(f"{plan}/{stamp_ns}/{monotonic_ns()}".encode()).digest()[:16]
        if follow:
            request = encode_goal_path(goal_id, stamp_ns, plan.frame, plan.waypoints, self._settings.progress_checker)
        else:
            request = encode_goal_pose(goal_id, stamp_ns, plan.frame, plan.waypoints[-1])
        self._failed = name  # until it is accepted
        self._heard_s.set(None)
        self._watch(goal_id)
        answer = self._client.ask("send_goal", request, _ASK_S)
        if not read(answer, SEND_GOAL_RESPONSE).accepted:
            self._watch(None)
            self._trouble.set("Nav2 refused the goal")
            return
        self._failed = None
        _log.info("Nav2 accepted %s, plan %d", *name)
        waiting = Worker("nav2-result", lambda: self._await(goal_id)).start()
        self._goal = _Goal(name, goal_id, waiting)

    def _await(self, goal_id: bytes) -> None:
        """Until the goal's end, on a thread of its own."""
        request = write(make(GET_RESULT_REQUEST, goal_id=make_uuid(goal_id)))
        while not self._stopper.requested:
            began_s = monotonic_s()
            try:
                status = decode_result_status(self._client.ask("get_result", request, _RESULT_S))
            except (TransportError, DecodeError) as error:
                if monotonic_s() - began_s < 0.9 * _RESULT_S:
                    self._result.set((goal_id, f"Nav2 is gone: {error}"))
                    return
                continue
            _log.info("Nav2's goal ended with status %d", status)
            self._result.set((goal_id, "" if status == _SUCCEEDED else _ENDS.get(status, f"Nav2: status {status}")))
            return

    def _cancel(self, why: str) -> None:
        goal, self._goal = self._goal, None
        if goal is None:
            return
        if goal.waiting.alive:
            code = self._client.cancel(goal.goal_id, _ASK_S)
            _log.info("Nav2's goal is cancelled (%s), return code %d", why, code)
        self._watch(None)

    def _fail(self, why: str) -> None:
        """The plan is given up; the bridge hears it as trouble."""
        goal, self._goal = self._goal, None
        if goal is not None:
            self._failed = goal.plan
            self._watch(None)
        self._trouble.set(why)

    def _watch(self, goal_id: bytes | None) -> None:
        if self._guard is not None:
            self._guard.watch(goal_id)
