"""Waypoints as our own keys: JSON, and the same as nav_msgs/Path and geometry_msgs/PoseStamped in CDR."""

from __future__ import annotations

import json

from irsd.core.runtime import wall_clock_ns
from irsd.io.cdr import encode_path, encode_pose_stamped
from irsd.io.keys import RobotKeys
from irsd.io.session import CDR, Session

Waypoints = tuple[tuple[float, float, float], ...]


class ZenohSink:
    """Publishes on irs/<robot>/nav/waypoints, nav/path and nav/goal_pose. One thread."""

    def __init__(self, session: Session, keys: RobotKeys) -> None:
        self._session = session
        self._keys = keys
        self._seq = 0

    def send(self, goal_id: str, frame: str, waypoints: Waypoints) -> None:
        """Drive these (x, y, yaw), map frame. None at all means stop."""
        self._seq += 1
        document = {
            "schema": "irs/nav/waypoints/1",
            "seq": self._seq,
            "frame": frame,
            "goal_id": goal_id,
            "waypoints": [list(point) for point in waypoints],
        }
        stamp_ns = wall_clock_ns()
        # A stop must not wait behind bulk data.
        urgent = not waypoints
        self._session.put(
            self._keys.nav("waypoints"),
            json.dumps(document).encode(),
            priority="interactive_high" if urgent else "data_high",
            express=True,
        )
        self._session.put(self._keys.nav("path"), encode_path(stamp_ns, frame, waypoints), encoding=CDR)
        if waypoints:
            goal = encode_pose_stamped(stamp_ns, frame, waypoints[-1])
            self._session.put(self._keys.nav("goal_pose"), goal, encoding=CDR)

    def close(self) -> None:
        """Nothing is declared."""
