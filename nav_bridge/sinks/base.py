"""What every sink is told: plans, and that the last plan is still meant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

Waypoints = tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True)
class Plan:
    """Where to drive. waypoints: (x, y, yaw) in ``frame``, none at all means stop. (goal_id, seq) names a plan: the same again is
    a heartbeat, its waypoints then are those still ahead. valid_s: a vehicle that hears nothing newer for so long holds."""

    goal_id: str
    seq: int
    frame: str
    waypoints: Waypoints
    valid_s: float


class Sink(Protocol):
    """Somebody who makes a vehicle drive. All calls come from one thread and return promptly."""

    def send(self, plan: Plan) -> None:
        """A new plan, or a stop."""

    def beat(self, plan: Plan) -> None:
        """The plan sent last still holds; waypoints: the rest of it."""

    def trouble(self) -> str:
        """Why the vehicle can't follow the plan sent last, "" while it can."""

    def close(self) -> None: ...
