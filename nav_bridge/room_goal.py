"""A room as goal, "go to the kitchen": which room is meant, and a place to stand well inside it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.graph.model import GraphSnapshot, RoomNode
from nav_bridge.approach import ApproachPose, ApproachSettings, Unreachable, in_polygon
from nav_bridge.evidence import MATCH, Knowledge
from nav_bridge.goal import GoalSpec
from nav_bridge.resolution import Ambiguous, Candidate, NotFound, Resolution, Resolved
from nav_bridge.route import CostMap, connected_to, snap_to_passable

_WELL_INSIDE_M = 1.0  # deeper inside a room than this is not better
_MAX_AWAY = 0.05  # price of a metre of distance from the robot: of places equally well inside, the nearer


def wanted_room(spec: GoalSpec, graph: GraphSnapshot) -> str:
    """Name or id of the room a sentence asks to be driven to, "" when it asks for a thing."""
    if spec.room_is_goal:
        return spec.room
    name = spec.things[0].name if len(spec.things) == 1 else ""
    return name if any(room.id.casefold() == name for room in graph.rooms) else ""


def room_grades(wanted: str, graph: GraphSnapshot, knowledge: Knowledge) -> dict[str, float]:
    """Per room id how far it is the room that is named, 0..1, seen among the others and by its shape."""
    found = knowledge.places.grades(wanted, knowledge.follow(graph))
    return dict(zip((room.id for room in graph.rooms), map(float, found), strict=True))


def resolve_room(
    wanted: str, spec: GoalSpec, graph: GraphSnapshot, knowledge: Knowledge, robot_xy: tuple[float, float]
) -> Resolution:
    """Which room is meant. robot_xy: where the robot is (for nearest, second, ...), map frame, metres."""
    grades = room_grades(wanted, graph, knowledge)
    considered = tuple(_candidate(room, grades[room.id], wanted) for room in graph.rooms)
    fits = [room for room in graph.rooms if grades[room.id] >= MATCH]
    named = [room for room in fits if room.id.casefold() == wanted]
    fits = named or fits
    if not fits:
        untyped = [room.id for room in graph.rooms if room.label == "room"]
        more = f"; what {', '.join(untyped)} is used for is not known" if untyped else ""
        return NotFound(f"no {wanted} is known here{more}", considered)
    ordered = sorted(fits, key=lambda room: (_order(spec.choice, room, robot_xy), int(room.id[1:])))
    frozen = tuple(_candidate(room, grades[room.id], wanted) for room in ordered)
    if spec.rank > len(ordered):
        return NotFound(f"only {len(ordered)} of them are known, not {spec.rank}", considered)
    if len(ordered) == 1 or spec.choice:
        at = spec.rank - 1
        return Resolved(frozen[at], frozen[:at] + frozen[at + 1 :] if spec.choice == "any" else (), considered)
    frozen = tuple(replace(candidate, answer=candidate.instance) for candidate in frozen)
    return Ambiguous(frozen, f"{len(ordered)} rooms fit: {', '.join(r.id for r in ordered)}. Which one?", considered)


def _candidate(room: RoomNode, grade: float, wanted: str) -> Candidate:
    rejected = "" if grade >= MATCH else f"not known to be a {wanted}"
    return Candidate(room.id, room.label, room.id, round(grade, 3), (f"{room.area_m2:.1f} m2",), rejected)


def _order(choice: str, room: RoomNode, robot_xy: tuple[float, float]) -> float:
    """Smallest first. How far a room is, is how far its outline is; 0 inside it."""
    if choice in ("largest", "smallest"):
        return -room.area_m2 if choice == "largest" else room.area_m2
    away = -cv2.pointPolygonTest(np.asarray(room.polygon_xy, np.float32), robot_xy, True)
    return -away if choice == "farthest" else max(0.0, float(away))


def room_floor(costs: CostMap, polygon_xy: Sequence[tuple[float, float]]) -> NDArray[np.float64]:
    """[N, 2] centres of the cells of a room where the robot can stand, map frame: who is at one of them has arrived."""
    return costs.frame.centres_of(_cells_inside(costs, costs.passable, polygon_xy))


def _cells_inside(
    costs: CostMap, where: NDArray[np.bool_], polygon_xy: Sequence[tuple[float, float]]
) -> NDArray[np.int64]:
    """[N, 2] cells of a mask [H, W] whose centres lie in a polygon. The work is the polygon's, not the map's."""
    if len(polygon_xy) < 3:
        return np.zeros((0, 2), np.int64)
    corners = costs.frame.cells_of(np.asarray(polygon_xy, np.float64))
    low, high = np.maximum(corners.min(0), 0), np.maximum(corners.max(0) + 1, 0)
    cells = np.argwhere(where[low[0] : high[0], low[1] : high[1]]) + low
    return np.asarray(cells[in_polygon(costs.frame.centres_of(cells), polygon_xy)])


def find_place_inside(
    costs: CostMap,
    polygon_xy: Sequence[tuple[float, float]],
    robot_xy: tuple[float, float],
    settings: ApproachSettings,
    *,
    start_reach_m: float = 0.8,
) -> ApproachPose | Unreachable:
    """A reachable place well inside a room, away from outline and furniture, looking to the room's middle."""
    start = snap_to_passable(costs, robot_xy, start_reach_m)
    if start is None:
        return Unreachable("the robot stands where the map has no free space", None)
    cells = _cells_inside(costs, connected_to(costs, start), polygon_xy)
    if not len(cells):
        return Unreachable("no free place in the room can be reached", None)
    xy = costs.frame.centres_of(cells)
    outline = np.asarray(polygon_xy, np.float64)
    depth = _to_outline(xy, outline)
    clear = costs.clear_m[cells[:, 0], cells[:, 1]].astype(np.float64)
    worth = np.minimum(depth, _WELL_INSIDE_M) + 2.0 * np.minimum(clear, settings.comfort_m)
    best = int((worth - _MAX_AWAY * np.hypot(*(xy - robot_xy).T)).argmax())
    x, y = (round(float(v), 4) for v in xy[best])
    dx, dy = xy.mean(0) - xy[best]
    yaw = round(math.atan2(dy, dx), 4) if math.hypot(dx, dy) > costs.frame.resolution_m else 0.0
    return ApproachPose(x, y, yaw, 0.0, float(clear[best]), 1.0)


def _to_outline(xy: NDArray[np.float64], outline: NDArray[np.float64]) -> NDArray[np.float64]:
    """[N] distance of places [N, 2] to the sides of a closed polygon [K, 2]."""
    nearest = np.full(len(xy), np.inf)
    for a, b in zip(outline, np.roll(outline, -1, 0), strict=True):
        span = b - a
        along = np.clip((xy - a) @ span / max(float(span @ span), 1e-12), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(*(xy - a - along[:, None] * span).T))
    return nearest


def looked_at(costs: CostMap, room: RoomNode) -> float:
    """0..1: how much of a room's floor was ever seen."""
    if len(room.polygon_xy) < 3:
        return 0.0
    x0, y0, x1, y1 = room.aabb_xy
    (r0, c0), (r1, c1) = np.clip(costs.frame.cells_of(np.array([[x0, y0], [x1, y1]])), 0, costs.known.shape)
    known = costs.known[r0 : r1 + 1, c0 : c1 + 1]
    places = costs.frame.centres_of(np.argwhere(known) + np.array([r0, c0]))
    # What of the outline lies beyond the map was never seen either.
    corners = np.asarray(room.polygon_xy, np.float64)
    x, y = corners.T
    area = abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))) / 2
    seen_m2 = float(in_polygon(places, room.polygon_xy).sum()) * costs.frame.resolution_m**2
    return min(1.0, seen_m2 / max(area, 1e-9))
