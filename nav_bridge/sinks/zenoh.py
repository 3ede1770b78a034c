"""Waypoints as our own keys: JSON with a heartbeat, and the same as nav_msgs/Path and geometry_msgs/PoseStamped in CDR."""

from __future__ import annotations

import json

from irsd.core.runtime import wall_clock_ns
from irsd.io.cdr import encode_path, encode_pose_stamped
from irsd.io.keys import RobotKeys
from irsd.io.session import CDR, Session
from nav_bridge.sinks.base import Plan


class ZenohSink:
    """Publishes on irs/<robot>/nav/waypoints, nav/path and nav/goal_pose. One thread."""

    def __init__(self, session: Session, keys: RobotKeys) -> None:
        self._session = session
        self._keys = keys

    def send(self, plan: Plan) -> None:
        """The plan on all three keys; a stop has no goal pose."""
        self._put(plan)
        stamp_ns = wall_clock_ns()
        self._session.put(self._keys.nav("path"), encode_path(stamp_ns, plan.frame, plan.waypoints), encoding=CDR)
        if plan.waypoints:
            goal = encode_pose_stamped(stamp_ns, plan.frame, plan.waypoints[-1])
            self._session.put(self._keys.nav("goal_pose"), goal, encoding=CDR)

    def beat(self, plan: Plan) -> None:
        """The document again: who hears none for valid_s holds, who has just started drives on from here."""
        self._put(plan)

    def trouble(self) -> str:
        """Nobody answers on these keys."""
        return ""

    def close(self) -> None:
        """Nothing is declared."""

    def _put(self, plan: Plan) -> None:
        document = {
            "schema": "irs/nav/waypoints/1",
            "seq": plan.seq,
            "frame": plan.frame,
            "goal_id": plan.goal_id,
            "valid_s": plan.valid_s,
            "waypoints": [list(point) for point in plan.waypoints],
        }
        self._session.put(
            self._keys.nav("waypoints"),
            json.dumps(document).encode(),
            priority="data_high" if plan.waypoints else "interactive_high",  # a stop must not wait behind bulk data
            express=True,
        )
