"""An answer to a goal and its forms: the JSON document, the sentence, and why it is so."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irsd.graph.model import GraphSnapshot
from nav_bridge.approach import ApproachPose
from nav_bridge.goal import GoalSpec
from nav_bridge.resolution import Ambiguous, Candidate, Resolution, Resolved
from nav_bridge.route import Route

LOOKED = 0.7  # share of a room's floor from which it counts as looked at: under furniture nobody sees


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of a query. status: resolved | ambiguous | not_found | unreachable.

    target and approach are set for resolved (target also for unreachable, with best_m the least distance possible). surface:
    [N, 2+] points in the map frame from which the arrival is measured. rooms: (id, label, how far it is the room that was named).
    looked: where nothing was found, (id, share of the floor ever seen) of the rooms where the thing might be.
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
    surface: NDArray[np.floating] | None = None
    rooms: tuple[tuple[str, str, float], ...] = ()
    looked: tuple[tuple[str, float], ...] = ()


def answer_document(answer: Answer, graph: GraphSnapshot, query_id: str | None = None) -> dict[str, Any]:
    """The answer as JSON-ready mapping (docs/schema/nav_answer.json); ``text`` says it in a sentence."""
    return {
        "id": query_id,
        "query": answer.text,
        "status": answer.status,
        "target": None if answer.target is None else _candidate(answer.target),
        "candidates": [_candidate(c) for c in _candidates(answer.resolution)],
        "approach": None if answer.approach is None else certificate(answer.approach),
        "waypoints": [list(point) for point in answer.route.waypoints] if answer.route is not None else [],
        "text": answer_text(answer, graph),
        "why": why_document(answer, graph),
    }


def name_of(node_id: str, graph: GraphSnapshot) -> str:
    """A node for people: ``I7 television in R3 laboratory``, ``R3 laboratory``."""
    rooms = {room.id: f"{room.id} {room.label}" for room in graph.rooms}
    node = next((n for n in graph.instances if n.id == node_id), None)
    if node is None:
        return rooms.get(node_id, node_id)
    return f"{node.id} {node.label}" + (f" in {rooms[node.room]}" if node.room in rooms else "")


def answer_text(answer: Answer, graph: GraphSnapshot) -> str:
    """The answer in a sentence."""
    if answer.target is not None:
        name = name_of(answer.target.instance, graph)
        if answer.approach is None or answer.route is None:
            return f"unreachable: {name}: {answer.reason}"
        stop = "stopping inside" if answer.target.is_room else f"stopping {answer.approach.distance_m:.2f} m from it"
        return f"going to {name}: {answer.route.length_m:.1f} m, {stop}"
    names = ", ".join(name_of(c.instance, graph) for c in _candidates(answer.resolution))
    return f"{answer.status.replace('_', ' ')}: {answer.reason}" + (f" ({names})" if names else "")


def certificate(pose: ApproachPose) -> dict[str, Any]:
    """What is promised of the place to stand: pose, the point of the target's surface and the distance to it, clearance, error."""
    return {
        "x": pose.x_m, "y": pose.y_m, "yaw": pose.yaw_rad, "distance_to_target_m": round(pose.distance_m, 3),
        "clearance_m": round(pose.clearance_m, 3), "sees": round(pose.sees, 2),
        "target_point": None if pose.target_m is None else list(pose.target_m), "error_m": pose.error_m,
    }  # fmt: skip


def _candidates(resolution: Resolution) -> Sequence[Candidate]:
    if isinstance(resolution, Ambiguous):
        return resolution.candidates
    return (resolution.target, *resolution.alternates) if isinstance(resolution, Resolved) else ()


def _candidate(candidate: Candidate) -> dict[str, Any]:
    """instance is None where the candidate is a room; answer: of several, what to say to mean this one."""
    instance = None if candidate.is_room else candidate.instance
    document = {"instance": instance, "room": candidate.room, "label": candidate.label, "score": candidate.score}
    return document | ({"answer": candidate.answer} if candidate.answer else {})


def parse_document(spec: GoalSpec) -> dict[str, Any]:
    """What a sentence was understood to say."""
    return {
        "language": spec.language,
        "things": [asdict(thing) for thing in spec.things],
        "room": spec.room,
        "room_is_goal": spec.room_is_goal,
        "not_rooms": list(spec.not_rooms),
        "relations": [
            {"kind": r.kind, "anchors": [a.name for a in r.anchors], "negated": r.negated} for r in spec.relations
        ],
        "choice": spec.choice,
        "rank": spec.rank,
        "function": spec.function,
        "seen_from": spec.seen_from,
        "parsed_by": spec.parsed_by,
    }


def why_document(answer: Answer, graph: GraphSnapshot) -> Mapping[str, Any]:
    """How the answer came about: what was understood, what was considered and why it was rejected, which poses were tried."""
    nodes = {node.id: node for node in graph.instances}
    considered = []
    for candidate in answer.resolution.considered:
        entry = {
            **_candidate(candidate),
            "evidence": candidate.evidence,
            "notes": list(candidate.notes),
            "rejected": candidate.rejected or None,
        }
        if candidate.instance in nodes:
            node = nodes[candidate.instance]
            entry |= {
                "observations": node.observations,
                "first_seen_ns": node.first_seen_ns,
                "last_seen_ns": node.last_seen_ns,
            }
        considered.append(entry)
    document: dict[str, Any] = {
        "reason": answer.reason,
        "parse": parse_document(answer.spec),
        "rooms": [{"room": room, "label": label, "grade": round(grade, 3)} for room, label, grade in answer.rooms],
        "considered": considered,
        "map": {"seq": graph.seq, "stamp_ns": graph.stamp_ns, "map_id": graph.map_id},
        "poses_tried": [],
    }
    if answer.approach is not None:
        document["poses_tried"] = [
            {
                "x": round(pose.x_m, 3), "y": round(pose.y_m, 3), "distance_m": round(pose.distance_m, 3),
                "clearance_m": round(pose.clearance_m, 3), "sees": round(pose.sees, 2), "price": round(pose.price, 3),
            }
            for pose in answer.approach.tried
        ]  # fmt: skip
    if answer.looked:
        document["not_found"] = "not seen there" if min(s for _, s in answer.looked) >= LOOKED else "never looked there"
        document["looked"] = [{"room": room, "seen": round(share, 3)} for room, share in answer.looked]
    if answer.best_m is not None and math.isfinite(answer.best_m):
        document["best_distance_m"] = round(answer.best_m, 3)
    if answer.route is not None:
        document["way_m"] = round(answer.route.length_m, 2)
    return document
