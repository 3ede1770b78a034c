"""What the robot was told last, and whether it still holds: waypoints documents in, ways to follow out. No clock of its own."""

from __future__ import annotations

import json
import math
from typing import Any, NamedTuple

FRAMES = ("map", "odom")


class Way(NamedTuple):
    """Points [[x_m, y_m, yaw_rad], ..] to follow in their frame, map or odom; none: stop."""

    points: list[list[float]]
    frame: str


class Orders:
    """The deadman: a plan with ``valid_s`` must be repeated in time, or the robot holds until it is."""

    def __init__(self) -> None:
        self._plan: tuple[str, int] | None = None
        self._until_s = math.inf
        self._held = False

    def hear(self, payload: bytes, now_s: float) -> Way | None:
        """The way to follow from now on, None when the document only repeats what is being done.

        Raises ValueError for what is no ``irs/nav/waypoints/1`` document; nothing changes then.
        """
        way, plan, valid_s = _parsed(payload)
        known = plan is not None and plan == self._plan and not self._held
        self._until_s = now_s + valid_s if valid_s is not None and way.points else math.inf
        self._plan, self._held = (plan if valid_s is not None and way.points else None), False
        return None if known and way.points else way

    def overdue(self, now_s: float) -> bool:
        """True once when the last word is too old: the robot must hold. The same plan, heard again, is then followed anew."""
        if self._held or now_s <= self._until_s:
            return False
        self._held = True
        return True


def _parsed(payload: bytes) -> tuple[Way, tuple[str, int] | None, float | None]:
    """(way, name of the plan, how long it is valid)."""
    document: Any = json.loads(payload)
    points = document.get("waypoints") if isinstance(document, dict) else None
    if not isinstance(points, list):
        raise ValueError("no list of waypoints")
    for point in points:
        if not isinstance(point, list) or len(point) != 3 or not all(isinstance(v, (int, float)) for v in point):
            raise ValueError(f"{point!r} is not [x, y, yaw]")
    frame = document.get("frame", "map")
    if frame not in FRAMES:
        raise ValueError(f"frame {frame!r}: this robot knows {' and '.join(FRAMES)}")
    valid_s = document.get("valid_s")
    if valid_s is not None and not (isinstance(valid_s, (int, float)) and valid_s > 0):
        raise ValueError(f"valid_s = {valid_s!r} is no time")
    goal, seq = document.get("goal_id"), document.get("seq")
    plan = (goal, seq) if isinstance(goal, str) and isinstance(seq, int) else None
    way = Way([[float(v) for v in point] for point in points], frame)
    return way, plan, None if valid_s is None else float(valid_s)
