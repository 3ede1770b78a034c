"""From a sentence to an answer: parse, resolve, approach, route, put together. The bridge and the offline command both call this."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.graph.model import GraphSnapshot, RoomNode
from irsd.perception.encoder import LabelEncoder
from nav_bridge.approach import ApproachPose, Unreachable, find_approach
from nav_bridge.config import BridgeSettings
from nav_bridge.evidence import Knowledge
from nav_bridge.language import GoalSpec, parse
from nav_bridge.resolve import Ambiguous, Candidate, NotFound, Resolution, Resolved, resolve
from nav_bridge.route import CostMap, Route, make_cost_map, plan_route

_ALTERNATES = 6  # of an open choice ("any chair"), how many are tried before the answer is unreachable

XyYaw = tuple[float, float, float]
PointsOf = Callable[[str], NDArray[np.floating]]
MapOf = Callable[[], CostMap | None]


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of a query. status: resolved | ambiguous | not_found | unreachable.

    target and approach are set for resolved (target also for unreachable, with best_m the least distance possible).
    """

    text: str
    status: str
    spec: GoalSpec
    resolution: Resolution
    target: Candidate | None
    approach: ApproachPose | None
    route: Route | None
    reason: str
    best_m: float | None = None


class Planner:
    """Answers queries on a map that is handed in. One owner, one thread (the encoder caches)."""

    def __init__(self, encoder: LabelEncoder, settings: BridgeSettings) -> None:
        self._knowledge = Knowledge(encoder, settings.evidence)
        self._settings = settings

    def cost_map(self, frame: GridFrame, occupancy: NDArray[np.int8]) -> CostMap:
        """The map as the route search needs it, from an occupancy grid [H, W] (-1, 0, 100)."""
        return make_cost_map(frame, occupancy, self._settings.route)

    def resolve(self, text: str, graph: GraphSnapshot, robot_xy: tuple[float, float]) -> tuple[GoalSpec, Resolution]:
        """What a sentence says and means, without a way to it."""
        spec = parse(text, self._knowledge.names)
        return spec, resolve(spec, graph, self._knowledge, robot_xy, self._settings.resolve)

    def answer(
        self,
        text: str,
        graph: GraphSnapshot,
        map_of: MapOf,
        points_of: PointsOf,
        robot: XyYaw,
        within_m: float | None = None,
    ) -> Answer:
        """The whole answer. map_of: gives the map, None when none is known yet; asked only when it is needed. points_of:
        surface points [N, 3] of an instance id, map frame.

        robot: pose in the map frame. within_m: replaces the setting for this goal.
        """
        spec, resolution = self.resolve(text, graph, robot[:2])
        if isinstance(resolution, Ambiguous):
            return Answer(text, "ambiguous", spec, resolution, None, None, None, resolution.question)
        if isinstance(resolution, NotFound):
            return Answer(text, "not_found", spec, resolution, None, None, None, resolution.reason)
        costs = map_of()
        answers = (
            self._to(target, text, spec, resolution, graph, costs, points_of, robot, within_m)
            for target in (resolution.target, *resolution.alternates[:_ALTERNATES])
        )
        first = next(answers)
        if first.status == "resolved":
            return first
        return next((other for other in answers if other.status == "resolved"), first)

    def _to(
        self,
        target: Candidate,
        text: str,
        spec: GoalSpec,
        resolution: Resolved,
        graph: GraphSnapshot,
        costs: CostMap | None,
        points_of: PointsOf,
        robot: XyYaw,
        within_m: float | None,
    ) -> Answer:
        """The answer for one target: where to stand and how to get there."""
        if costs is None:
            return Answer(
                text, "unreachable", spec, resolution, target, None, None, "no map of free space is known yet"
            )
        settings = self._settings.approach
        if within_m is not None:
            settings = replace(settings, within_m=within_m, best_m=min(settings.best_m, 0.85 * within_m))
        room = next((r for r in graph.rooms if r.id == target.room), None)
        outline = room.polygon_xy if isinstance(room, RoomNode) else ()
        reach = self._settings.route.start_reach_m
        found = find_approach(
            costs, points_of(target.instance), robot[:2], settings, start_reach_m=reach, room_xy=outline
        )
        if isinstance(found, Unreachable):
            return Answer(text, "unreachable", spec, resolution, target, None, None, found.reason, found.best_m)
        route = plan_route(costs, robot, (found.x_m, found.y_m, found.yaw_rad), self._settings.route)
        if route is None:
            return Answer(
                text, "unreachable", spec, resolution, target, None, None, "no way leads there", found.distance_m
            )
        return Answer(text, "resolved", spec, resolution, target, found, route, "")


def answer_document(answer: Answer, graph: GraphSnapshot, query_id: str | None = None) -> dict[str, Any]:
    """The answer as JSON-ready mapping, in the form DESIGN.md gives it; ``text`` says it in a sentence."""
    document: dict[str, Any] = {"id": query_id, "query": answer.text, "status": answer.status, "target": None}
    if answer.target is not None:
        target = answer.target
        document["target"] = {
            "instance": target.instance,
            "room": target.room,
            "label": target.label,
            "score": target.score,
        }
    document["candidates"] = [_candidate(c) for c in _candidates(answer.resolution)]
    document["approach"] = _approach(answer)
    document["waypoints"] = [list(point) for point in answer.route.waypoints] if answer.route is not None else []
    document["text"] = answer_text(answer, graph)
    document["why"] = why_document(answer)
    return document


def name_of(instance: str, graph: GraphSnapshot) -> str:
    """An instance for people: ``I7 television in R3 laboratory``."""
    node = next((n for n in graph.instances if n.id == instance), None)
    if node is None:
        return instance
    room = next((r for r in graph.rooms if r.id == node.room), None)
    return f"{node.id} {node.label}" + (f" in {room.id} {room.label}" if room is not None else "")


def answer_text(answer: Answer, graph: GraphSnapshot) -> str:
    """The answer in a sentence."""
    if answer.target is not None:
        name = name_of(answer.target.instance, graph)
        if answer.approach is not None and answer.route is not None:
            return (
                f"going to {name}: {answer.route.length_m:.1f} m, stopping {answer.approach.distance_m:.2f} m from it"
            )
        return f"unreachable: {name}: {answer.reason}"
    names = ", ".join(name_of(c.instance, graph) for c in _candidates(answer.resolution))
    return f"{answer.status.replace('_', ' ')}: {answer.reason}" + (f" ({names})" if names else "")


def _approach(answer: Answer) -> dict[str, Any] | None:
    if answer.approach is None:
        return None
    pose = answer.approach
    return {
        "x": pose.x_m, "y": pose.y_m, "yaw": pose.yaw_rad, "distance_to_target_m": round(pose.distance_m, 3),
        "clearance_m": round(pose.clearance_m, 3), "sees": round(pose.sees, 2),
    }  # fmt: skip


def _candidates(resolution: Resolution) -> Sequence[Candidate]:
    if isinstance(resolution, Ambiguous):
        return resolution.candidates
    return (resolution.target, *resolution.alternates) if isinstance(resolution, Resolved) else ()


def _candidate(candidate: Candidate) -> dict[str, Any]:
    return {"instance": candidate.instance, "room": candidate.room, "label": candidate.label, "score": candidate.score}


def why_document(answer: Answer) -> Mapping[str, Any]:
    """How the answer came about: what was understood, what was considered and why it was rejected, and the reason in words."""
    spec = answer.spec
    parsed: dict[str, Any] = {
        "language": spec.language,
        "things": [asdict(thing) for thing in spec.things],
        "room": spec.room,
        "not_rooms": list(spec.not_rooms),
        "relations": [
            {"kind": r.kind, "anchors": [a.name for a in r.anchors], "negated": r.negated} for r in spec.relations
        ],
        "choice": spec.choice,
        "rank": spec.rank,
        "function": spec.function,
    }
    considered = [
        {**_candidate(c), "notes": list(c.notes), "rejected": c.rejected or None} for c in answer.resolution.considered
    ]
    document: dict[str, Any] = {"reason": answer.reason, "parse": parsed, "considered": considered}
    if answer.best_m is not None and math.isfinite(answer.best_m):
        document["best_distance_m"] = round(answer.best_m, 3)
    if answer.route is not None:
        document["way_m"] = round(answer.route.length_m, 2)
    return document
