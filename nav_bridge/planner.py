"""From a sentence to an answer: parse, resolve, approach, route, put together. The bridge and the offline command both call this."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.graph.model import GraphSnapshot
from irsd.perception.encoder import LabelEncoder
from nav_bridge.answer import LOOKED, Answer
from nav_bridge.approach import ApproachPose, Unreachable, find_approach
from nav_bridge.config import BridgeSettings
from nav_bridge.evidence import MATCH, Knowledge
from nav_bridge.geofence import Geofence
from nav_bridge.goal import GoalSpec, refer
from nav_bridge.language import parse
from nav_bridge.resolution import Ambiguous, Candidate, NotFound, Resolution
from nav_bridge.resolve import resolve
from nav_bridge.room_goal import find_place_inside, looked_at, resolve_room, room_floor, room_grades, wanted_room
from nav_bridge.route import CostMap, make_cost_map, plan_route
from nav_bridge.surface import floor_under, solid_part

_ALTERNATES = 6  # of an open choice ("any chair"), how many are tried before the answer is unreachable

XyYaw = tuple[float, float, float]
PointsOf = Callable[[str], NDArray[np.floating]]
MapOf = Callable[[], CostMap | None]


@dataclass(frozen=True, slots=True)
class World:
    """What is known when a goal is planned. map_of: gives the map, None when none is known yet; asked only when it is needed.

    points_of: surface points [N, 3] of an instance id, map frame. robot: pose in the map frame.
    minute: of the day, for rules with hours; None: those hold at any time. last: id of the last goal's node, for "there"; "": none.
    """

    graph: GraphSnapshot
    map_of: MapOf
    points_of: PointsOf
    robot: XyYaw
    minute: int | None = None
    last: str = ""


class Planner:
    """Answers queries on a map that is handed in. One owner, one thread (the encoder caches)."""

    def __init__(self, encoder: LabelEncoder, settings: BridgeSettings) -> None:
        self._knowledge = Knowledge(encoder, settings.evidence)
        self._settings = settings
        self._fence = Geofence(settings.geofence, self._knowledge, settings.route.robot_radius_m)

    def fenced(self, costs: CostMap, graph: GraphSnapshot, minute: int | None) -> CostMap:
        """The map with what the geofence forbids at a minute of the day (None: at any) walled off."""
        return self._fence.apply(costs, graph, minute) if self._fence else costs

    def cost_map(self, frame: GridFrame, occupancy: NDArray[np.int8]) -> CostMap:
        """The map as the route search needs it, from an occupancy grid [H, W] (-1, 0, 100)."""
        return make_cost_map(frame, occupancy, self._settings.route)

    def follow(self, graph: GraphSnapshot) -> tuple[str, ...]:
        """Takes in a revision of the graph before a goal has to wait for it; the geofence's rules that name nothing in it."""
        self._knowledge.follow(graph)
        return self._fence.idle(graph)

    def resolve(self, text: str, world: World, read: GoalSpec | None = None) -> tuple[GoalSpec, Resolution]:
        """What a sentence says and means, without a way to it. read: what it says, where somebody has read it already."""
        spec = refer(read or parse(text, self._knowledge.names), world.last)
        graph, robot_xy = world.graph, world.robot[:2]
        if room := wanted_room(spec, graph):
            return spec, resolve_room(room, spec, graph, self._knowledge, robot_xy)
        return spec, resolve(spec, graph, self._knowledge, robot_xy, self._settings.resolve)

    def answer(self, text: str, world: World, within_m: float | None = None, read: GoalSpec | None = None) -> Answer:
        """The whole answer. within_m: replaces the setting for this goal. read: what the sentence says, where it is read already."""
        spec, resolution = self.resolve(text, world, read)
        rooms = self._rooms(spec, world.graph)
        if isinstance(resolution, Ambiguous):
            return Answer(text, "ambiguous", spec, resolution, None, None, None, resolution.question, rooms=rooms)
        if isinstance(resolution, NotFound):
            looked = self._looked(spec, world)
            reason = f"{resolution.reason}{_where(looked)}"
            return Answer(text, "not_found", spec, resolution, None, None, None, reason, rooms=rooms, looked=looked)
        blank = Answer(text, "unreachable", spec, resolution, resolution.target, None, None, "", rooms=rooms)
        costs = world.map_of()
        if costs is None:
            return replace(blank, reason="no map of free space is known yet")
        targets = (resolution.target, *resolution.alternates[:_ALTERNATES])
        answers: Iterator[Answer] = (
            self._to(replace(blank, target=target), target, world, costs, within_m) for target in targets
        )
        first = next(answers)
        if first.status == "resolved":
            return first
        return next((other for other in answers if other.status == "resolved"), first)

    def _looked(self, spec: GoalSpec, world: World) -> tuple[tuple[str, float], ...]:
        """How much was seen of each room the thing might be in: those of the kind that was named, or else all."""
        costs = world.map_of() if spec.things and world.graph.rooms else None
        if costs is None:
            return ()
        grades = room_grades(spec.room, world.graph, self._knowledge) if spec.room else {}
        named = [room for room in world.graph.rooms if grades.get(room.id, 0.0) >= MATCH]
        return tuple((room.id, looked_at(costs, room)) for room in named or world.graph.rooms)

    def again(self, answer: Answer, world: World, within_m: float | None = None) -> Answer:
        """A new way to the target that an answer has, on what is known now."""
        costs = world.map_of()
        blank = replace(answer, status="unreachable", approach=None, route=None, reason="", best_m=None)
        if costs is None or answer.target is None:
            return replace(blank, reason="no map of free space is known")
        return self._to(blank, answer.target, world, costs, within_m)

    def back_to(self, text: str, target_id: str, world: World, within_m: float) -> Answer:
        """A way to the instance or room that a sentence once meant; the answer to the sentence where that is no longer known."""
        spec, resolution = self.resolve(text, world)
        target = next((c for c in resolution.considered if c.instance == target_id), None)
        if target is None:
            return self.answer(text, world, within_m)
        return self.again(Answer(text, "unreachable", spec, resolution, target, None, None, ""), world, within_m)

    def _rooms(self, spec: GoalSpec, graph: GraphSnapshot) -> tuple[tuple[str, str, float], ...]:
        """How far each room is the one that was named; empty when none was."""
        if not spec.room:
            return ()
        grades = room_grades(spec.room, graph, self._knowledge)
        return tuple((room.id, room.label, grades[room.id]) for room in graph.rooms)

    def _to(self, blank: Answer, target: Candidate, world: World, costs: CostMap, within_m: float | None) -> Answer:
        """The answer for one target: where to stand and how to get there, by the rules of the geofence."""
        answer = self._free_to(blank, target, world, self.fenced(costs, world.graph, world.minute), within_m)
        if answer.status == "resolved" or not self._fence:
            return answer
        free = self._free_to(blank, target, world, costs, within_m)
        if free.route is None:
            return answer
        way = np.asarray([world.robot[:2], *(point[:2] for point in free.route.waypoints)])
        rules = self._fence.broken(costs, world.graph, world.minute, way)
        return replace(answer, reason=f"forbidden: {'; '.join(rules)}") if rules else answer

    def _free_to(
        self, blank: Answer, target: Candidate, world: World, costs: CostMap, within_m: float | None
    ) -> Answer:
        """The same on a map as it is handed in."""
        found, surface = self._place(target, world, costs, within_m)
        if isinstance(found, Unreachable):
            return replace(blank, reason=found.reason, best_m=found.best_m)
        stand = (found.x_m, found.y_m, found.yaw_rad)
        route = plan_route(costs, world.robot, stand, self._settings.route, world.graph.doors)
        if route is None:
            return replace(blank, reason="no way leads there", best_m=found.distance_m)
        return replace(blank, status="resolved", approach=found, route=route, surface=surface)

    def _place(
        self, target: Candidate, world: World, costs: CostMap, within_m: float | None
    ) -> tuple[ApproachPose | Unreachable, NDArray[np.floating]]:
        """Where to stand, and the points from which the arrival is measured."""
        settings, reach = self._settings.approach, self._settings.route.start_reach_m
        if within_m is not None:
            settings = replace(settings, within_m=within_m, best_m=min(settings.best_m, 0.85 * within_m))
        room = next((r for r in world.graph.rooms if r.id == target.room), None)
        outline = room.polygon_xy if room is not None else ()
        at = world.robot[:2]
        if target.is_room:
            return find_place_inside(costs, outline, at, settings, start_reach_m=reach), room_floor(costs, outline)
        points = solid_part(world.points_of(target.instance), costs, floor_under(world.graph, target.room))
        return find_approach(costs, points, at, settings, start_reach_m=reach, room_xy=outline), points


def _where(looked: tuple[tuple[str, float], ...]) -> str:
    """Whether a thing that is not found can't be there or may be where nobody looked, in words."""
    if not looked:
        return ""
    dark = [f"{room} ({100 * share:.0f} % seen)" for room, share in looked if share < LOOKED]
    if dark:
        return f"; never looked everywhere in {', '.join(dark)}"
    return f"; not seen there: {', '.join(room for room, _ in looked)} looked at"
