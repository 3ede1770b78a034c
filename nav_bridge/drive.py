"""One goal on its way: its plan, the watch over it, and the reasons to plan anew. An owner without clock, thread or transport."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irsd.core.settings import setting
from irsd.graph.model import GraphSnapshot
from nav_bridge.answer import Answer, certificate, name_of
from nav_bridge.approach import ApproachSettings
from nav_bridge.journal import Entry
from nav_bridge.monitor import Driving, Monitor, MonitorSettings
from nav_bridge.route import CostMap, line_cells
from nav_bridge.sinks.base import Plan, Waypoints
from nav_bridge.surface import floor_under, solid_part, surface_distance

_SLACK_M = 0.05  # a target may come this much nearer or farther by itself: fusion goes on
_CAME_ALONG_M, _MOST_TIGHT = 0.15, 3  # a robot that has not moved at all is not in a tight place
_NEAR_M = 0.3  # of the way ahead, what lies closer to the robot than this is not checked: it is there already


@dataclass(frozen=True, slots=True)
class DriveSettings:
    """What happens while a goal is driven to."""

    heartbeat_s: float = setting(0.25, "how often the vehicle is told that its plan still holds", lo=0.02, hi=5.0)
    valid_s: float = setting(0.9, "a vehicle that hears nothing for so long holds", lo=0.1, hi=30.0)
    review_s: float = setting(1.5, "how often map and target are looked at anew", lo=0.1, hi=60.0)
    off_way_m: float = setting(0.6, "a robot farther than this from its way gets a new one", lo=0.1, hi=10.0)
    replan_pause_s: float = setting(1.5, "shortest time between two plans for one goal", lo=0.1, hi=60.0)
    patience_s: float = setting(
        15.0, "how long a robot without a way waits for one to open before it gives up", lo=0.0, hi=600.0
    )
    resume_s: float = setting(
        30.0, "a goal under way when nav_bridge died goes on if it is back within this time; 0: never", lo=0.0, hi=600.0
    )
    max_replans: int = setting(30, "plans after which a goal is given up", lo=0, hi=10_000)


@dataclass(frozen=True, slots=True)
class View:
    """What was seen of the world a moment ago, for one plan: the map and the target's surface (None for a room)."""

    plan_seq: int
    costs: CostMap | None
    surface: NDArray[np.floating] | None


@dataclass(frozen=True, slots=True)
class Doubt:
    """Why a plan is no longer good. cause: new map, vanished (it was carried away), lost (irsd tells of it no more), moved, blocked,
    off the way. text: the same in a sentence."""

    cause: str
    text: str


class Drive:
    """The goal being driven. ``adopt`` gives it a (new) plan; ``doubt`` says whether the plan is still good."""

    def __init__(self, goal_id: str, query: str, within_m: float, priority: int, seq: int = 0) -> None:
        """seq: number of the last plan told for this goal by a bridge that has died since."""
        self.goal_id = goal_id
        self.query = query
        self.within_m = within_m
        self.priority = priority
        self.plans = 0
        self.planned_ns = 0
        self.holding_ns: int | None = None
        self.tight: list[tuple[float, float]] = []  # where the robot did not get on, though the map is free there
        self.frame = "map"
        self._seq = seq
        self._certificate: dict[str, Any] | None = None

    def adopt(
        self,
        answer: Answer,
        graph: GraphSnapshot,
        monitoring: MonitorSettings,
        approach: ApproachSettings,
        now_ns: int,
    ) -> bool:
        """Drive by this answer from now on; False when it is none to drive by."""
        if answer.target is None or answer.route is None or answer.surface is None:
            return False
        self.answer, self.target = answer, answer.target
        self._certificate = None if answer.approach is None else certificate(answer.approach)
        self.map_id, self.frame = graph.map_id, graph.frame
        self.name = name_of(answer.target.instance, graph)
        self.length_m, self.clearance_m = answer.route.length_m, answer.route.clearance_m
        self._outliers = 1 if answer.target.is_room else approach.outlier_points
        way = answer.route.waypoints
        self.monitor = Monitor(way, answer.surface, self.within_m, monitoring, now_ns, self._outliers)
        self._way: Waypoints = way
        self.plans += 1
        self._seq += 1
        self.planned_ns, self.holding_ns = now_ns, None
        return True

    def felt(self, robot_xy: tuple[float, float]) -> bool:
        """The robot is stuck here; True if another plan may help: it did come along by this one, and has not tried too often."""
        came_m = float(np.hypot(*(np.array(self._way[0][:2]) - robot_xy)))
        if came_m < _CAME_ALONG_M or len(self.tight) >= _MOST_TIGHT:
            return False
        self.tight.append(robot_xy)
        return True

    def hold(self, now_ns: int) -> None:
        """There is no way now: the robot waits where it is."""
        if self.holding_ns is None:
            self.holding_ns = now_ns
        self.planned_ns = now_ns

    def plan(self, settings: DriveSettings) -> Plan:
        """The whole plan; from the start of the way to its end."""
        return Plan(self.goal_id, self._seq, self.frame, self._way, settings.valid_s)

    def rest(self, settings: DriveSettings) -> Plan:
        """The same plan, with the waypoints still ahead."""
        return Plan(self.goal_id, self._seq, self.frame, self.monitor.ahead(), settings.valid_s)

    def stop(self, settings: DriveSettings) -> Plan:
        """The word to stand still."""
        self._seq += 1
        return Plan(self.goal_id, self._seq, self.frame, (), settings.valid_s)

    def entry(self) -> Entry:
        """What must be known to go on with the goal after a death. Its numbers leave room for the stops told meanwhile."""
        target = self.target.instance
        return Entry(self.goal_id, self.query, target, self.within_m, self.priority, self._seq + 100, self.map_id)

    @property
    def seq(self) -> int:
        """Number of the plan being driven."""
        return self._seq

    def doubt(
        self, graph: GraphSnapshot, view: View | None, robot_xy: tuple[float, float], off_way_m: float, radius_m: float
    ) -> Doubt | None:
        """Why the plan is no longer good, None while it is. view: what was seen for this plan, None before anything was."""
        if graph.map_id != self.map_id:
            return Doubt("new map", "irsd has started another map: places of the old one mean nothing in it")
        if gone := self._gone(graph):
            return gone
        if self.holding_ns is not None:
            return Doubt("blocked", "waiting for a way")
        if view is not None and view.plan_seq == self._seq:
            if view.surface is not None and len(view.surface) and view.costs is not None:
                surface = solid_part(view.surface, view.costs, floor_under(graph, self.target.room))
                self.monitor.retarget(surface)
                end = np.array([self._way[-1][:2]])
                away = float(surface_distance(surface, end, self._outliers)[0])
                if away > self.within_m + _SLACK_M:
                    return Doubt("moved", f"{self.name} has moved: the way ends {away:.2f} m from it")
            body = min(radius_m, self.clearance_m)
            if view.costs is not None and way_blocked(view.costs, robot_xy, self.monitor.ahead(), body):
                return Doubt("blocked", "something stands in the way")
        if self.monitor.off_way_m > off_way_m:
            return Doubt("off the way", f"{self.monitor.off_way_m:.1f} m off the way")
        return None

    def _gone(self, graph: GraphSnapshot) -> Doubt | None:
        name = self.target.instance
        if self.target.is_room:
            known = any(room.id == name for room in graph.rooms)
            return None if known else Doubt("vanished", f"{self.name} is no longer known")
        node = next((n for n in graph.instances if n.id == name), None)
        if node is None:
            return Doubt("lost", f"{self.name} is no longer known")
        return Doubt("vanished", f"{self.name} is gone") if node.state == "gone" else None

    def document(self, seq: int, state: str, progress: Driving, text: str, reason: str) -> dict[str, Any]:
        """What nav/state says (docs/schema/nav_state.json)."""
        return {
            "schema": "irs/nav/state/1",
            "seq": seq,
            "frame": self.frame,
            "goal_id": self.goal_id,
            "state": state,
            "distance_m": None if progress.distance_m is None else round(progress.distance_m, 3),
            "remaining_m": round(progress.remaining_m, 3),
            "eta_s": None if progress.eta_s is None else round(progress.eta_s, 1),
            "plans": self.plans,
            "certificate": self._certificate,
            "reason": reason,
            "text": text,
        }


def way_blocked(costs: CostMap, robot_xy: tuple[float, float], ahead: Waypoints, radius_m: float) -> bool:
    """Whether the robot's body would touch something known on the way ahead of it. Off the map counts as free: nothing is known."""
    here = np.asarray(robot_xy, np.float64)
    for point in ahead:
        there = np.asarray(point[:2], np.float64)
        cells = line_cells(costs.frame, here, there)
        far = np.hypot(*(costs.frame.centres_of(cells) - robot_xy).T) >= _NEAR_M
        cells = cells[far]
        if (costs.clear_m[cells[:, 0], cells[:, 1]] < radius_m).any():
            return True
        here = there
    return False
