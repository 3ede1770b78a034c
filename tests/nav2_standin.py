"""Nav2's action server as zenoh-bridge-ros2dds or rmw_zenoh would show it; also a program of its own, so that it can be killed.

    python nav2_standin.py ENDPOINT FORM ACTION

prints a line of JSON for each goal and cancel, and gives feedback while a goal is under way.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from irsd.core.runtime import Event, sleep_s
from irsd.io import cdr
from irsd.io.keys import parse_ros_attachment, ros_attachment, ros_service_token
from irsd.io.session import CDR, Query, Session, ZenohSettings, open_session

PATIENCE_S = 20.0
HASH = "RIHS01_" + "5a" * 32  # whatever the server's token says


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
        if self.status == 5:  # the goal before was cancelled; this one is another
            self.status = 4
            self.end.clear()
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


def main() -> None:
    """Until killed."""
    endpoint, form, action = sys.argv[1:]
    with open_session(ZenohSettings(endpoint=endpoint, connect=()), "peer") as session:
        server = Server(session, form, action)
        told = [0, 0]
        print(json.dumps({"up": True}), flush=True)
        while True:
            sleep_s(0.05)
            goals = [bytes(goal.goal_id.uuid).hex() for goal in server.goals]
            cancelled = [goal.hex() for goal in server.cancelled]
            for k, (kind, ids) in enumerate((("goal", goals), ("cancel", cancelled))):
                for goal_id in ids[told[k] :]:
                    print(json.dumps({kind: goal_id}), flush=True)
                told[k] = len(ids)
            if goals and goals[-1] not in cancelled:
                server.feedback(1.0)


if __name__ == "__main__":
    main()
