"""Which instance a goal means: Resolved, Ambiguous with the candidates, or NotFound with the reason. Never a guess.

A candidate's score is the product of what its labels, its attributes, its room and its relations say. One clear winner is
resolved; several that nothing tells apart are ambiguous, unless the goal leaves the choice open (any, nearest, ...).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from irsd.core.settings import setting
from irsd.graph.model import GraphSnapshot, InstanceNode, RoomNode
from nav_bridge import relations as rel
from nav_bridge.evidence import Knowledge
from nav_bridge.language import GoalSpec, Phrase, Relation
from nav_bridge.relations import Box, box_of
from nav_bridge.resolution import Ambiguous, Candidate, NotFound, Resolution, Resolved


@dataclass(frozen=True, slots=True)
class ResolveSettings:
    """When a candidate is the one."""

    min_label: float = setting(0.45, "label evidence from which a thing counts as what was named", lo=0.0, hi=1.0)
    maybe_label: float = setting(0.25, "label evidence from which it is offered as a candidate", lo=0.0, hi=1.0)
    min_room: float = setting(0.35, "evidence for the room below which a candidate is rejected", lo=0.0, hi=1.0)
    min_relation: float = setting(0.25, "fit of a relation below which a candidate is rejected", lo=0.0, hi=1.0)
    rival_ratio: float = setting(
        0.6, "a candidate with this share of the best score can't be ruled out", lo=0.0, hi=1.0
    )
    min_existence: float = setting(0.2, "instances whose existence is less certain are not considered", lo=0.0, hi=1.0)
    max_candidates: int = setting(12, "how many candidates an answer lists", lo=1, hi=1000)


@dataclass(slots=True)
class _Case:
    """A candidate while it is being judged."""

    node: InstanceNode
    box: Box
    label: float
    score: float
    notes: list[str] = field(default_factory=list)
    rejected: str = ""
    order: float = 0.0

    def frozen(self) -> Candidate:
        score = round(min(1.0, self.score), 3)
        return Candidate(self.node.id, self.node.label, self.node.room, score, tuple(self.notes), self.rejected)


def resolve(
    spec: GoalSpec, graph: GraphSnapshot, knowledge: Knowledge, robot_xy: tuple[float, float], settings: ResolveSettings
) -> Resolution:
    """Which thing the goal means in this graph (``room_goal`` is for rooms).

    robot_xy: where the robot is (for nearest, second, ...), map frame, metres.
    """
    if not spec.things:
        return NotFound("the sentence names nothing to go to", ())
    cases = _named(spec, graph, knowledge, settings)
    named = ", ".join(thing.name for thing in spec.things[:3])
    if not cases:
        return NotFound(f"no {named} is known here", ())
    doubt = _by_rooms(cases, spec, graph, knowledge, settings)
    for relation in spec.relations:
        doubt = _by_relation(cases, relation, graph, knowledge, settings) or doubt
    alive = [c for c in cases if not c.rejected]
    sure = [c for c in alive if c.label >= settings.min_label]
    if not sure:
        return _none_sure(cases, alive, named, settings)
    best = max(c.score for c in sure)
    ratio = max(settings.rival_ratio, 0.95) if spec.function else settings.rival_ratio
    rivals = _without_fragments([c for c in sure if c.score >= ratio * best])
    for case in sure:
        if case not in rivals:
            case.rejected = case.rejected or "fits less well"
    return _choose(rivals, cases, spec, robot_xy, doubt, settings)


def _listed(cases: Sequence[_Case], settings: ResolveSettings) -> tuple[Candidate, ...]:
    ranked = sorted(cases, key=lambda c: (bool(c.rejected), -c.score, _number(c.node.id)))
    return tuple(c.frozen() for c in ranked[: settings.max_candidates])


def _number(node_id: str) -> int:
    return int(node_id[1:]) if node_id[1:].isdigit() else 0


def _named(spec: GoalSpec, graph: GraphSnapshot, knowledge: Knowledge, settings: ResolveSettings) -> list[_Case]:
    """Instances whose labels may mean what was named, scored by label, attributes and how sure the instance is."""
    cases = []
    floors = {room.id: room.floor_z_m for room in graph.rooms}
    for node in graph.instances:
        if node.state == "gone" or node.existence < settings.min_existence:
            continue
        # A purpose names several things, best first.
        scores = [knowledge.label_score(p, node) * max(0.4, 1.0 - 0.12 * k) for k, p in enumerate(spec.things)]
        label = 1.0 if spec.things[0].name == node.id.casefold() else max(scores)
        if label < settings.maybe_label:
            continue
        phrase = spec.things[scores.index(max(scores))]
        attribute = knowledge.attribute_score(phrase.attributes, node, floors.get(node.room or "", 0.0))
        sure = node.existence * node.observations / (node.observations + 1.0)
        case = _Case(node, box_of(node), label, label * attribute * sure)
        case.notes.append(f"labels {label:.2f}")
        if attribute != 1.0:
            case.notes.append(f"attributes x{attribute:.2f}")
        cases.append(case)
    _by_size(cases, spec)
    return cases


def _by_size(cases: list[_Case], spec: GoalSpec) -> None:
    """Small or large is meant among those that are named: compared with the middle one."""
    sizes = [value for thing in spec.things for group, value in thing.attributes if group == "size"]
    if not sizes or len(cases) < 2:
        return
    middle = float(np.median([c.node.volume_m3 for c in cases]))
    for case in cases:
        bigger = case.node.volume_m3 > middle
        if (sizes[0] in ("small", "low", "narrow") and bigger) or (
            sizes[0] in ("large", "tall", "wide", "long") and not bigger
        ):
            case.score *= 0.7
            case.notes.append(f"not {sizes[0]} among its like")


def _by_rooms(
    cases: list[_Case], spec: GoalSpec, graph: GraphSnapshot, knowledge: Knowledge, settings: ResolveSettings
) -> str:
    """Judges the cases by the rooms named; returns a doubt in words when no such room is known and nothing contradicts."""
    for room in spec.not_rooms:
        for case in cases:
            if (score := knowledge.in_room_score(room, case.node, graph)) >= 0.5:
                case.rejected = f"is in a {room} ({score:.2f})"
    if not spec.room:
        return ""
    scores = [knowledge.in_room_score(spec.room, case.node, graph) for case in cases]
    known_room = max((knowledge.room_grade(spec.room, room) for room in graph.rooms), default=0.0) >= 0.6
    if not known_room and max(scores) < settings.min_room:
        return _in_unknown_room(cases, spec.room, graph, knowledge)
    for case, score in zip(cases, scores, strict=True):
        case.notes.append(f"in {spec.room} {score:.2f}")
        case.score *= score
        if score < settings.min_room:
            case.rejected = case.rejected or f"not in a {spec.room}"
    return ""


def _in_unknown_room(cases: list[_Case], wanted: str, graph: GraphSnapshot, knowledge: Knowledge) -> str:
    """No room of the kind is known: it may be one of unknown kind. What belongs elsewhere is out; returns the doubt left."""
    untyped = {room.id for room in graph.rooms if room.label == "room"}
    belongs = [knowledge.belongs(case.node.label, wanted) for case in cases]
    for case, fits in zip(cases, belongs, strict=True):
        if fits is False:
            case.rejected = f"no {wanted} is known, and a {case.node.label} does not belong in one"
    left = [case for case in cases if not case.rejected]
    if any(case.node.room in untyped for case in left):
        for case in left:
            if case.node.room not in untyped:
                case.rejected = f"is in a room known to be no {wanted}"
    left = [case for case in cases if not case.rejected]
    # The only one there is, and it belongs there: the room is merely not recognised.
    certain = len(left) == 1 and belongs[cases.index(left[0])] is True
    return "" if certain else f"no {wanted} is known here"


def _by_relation(
    cases: list[_Case], relation: Relation, graph: GraphSnapshot, knowledge: Knowledge, settings: ResolveSettings
) -> str:
    """Judges the cases by one relation; returns a doubt in words when what it refers to is not known."""
    groups = [_anchors(anchor, graph, knowledge, settings) for anchor in relation.anchors]
    if relation.room:
        groups = [[("", rel.room_box(r), 1.0) for r in graph.rooms if knowledge.room_grade(relation.room, r) >= 0.6]]
    names = " and ".join(anchor.name for anchor in relation.anchors)
    if any(not group for group in groups):
        missing = " and ".join(a.name for a, g in zip(relation.anchors, groups, strict=False) if not g)
        return "" if relation.negated or relation.kind == "without" else f"no {missing} is known here"
    for case in cases:
        fit = _fit(case, relation.kind, groups, graph)
        if relation.kind in ("nearest", "farthest"):
            case.order = fit if relation.kind == "nearest" else -fit
            case.notes.append(f"{abs(case.order):.1f} m from {names}")
            continue
        if relation.negated or relation.kind == "without":
            fit = 1.0 - fit
        case.notes.append(f"{'not ' if relation.negated else ''}{relation.kind} {names} {fit:.2f}".replace("  ", " "))
        case.score *= fit
        if fit < settings.min_relation:
            case.rejected = case.rejected or f"not {relation.kind.replace('_', ' ')} {names}".strip()
    return ""


Anchor = tuple[str, Box, float]


def _anchors(phrase: Phrase, graph: GraphSnapshot, knowledge: Knowledge, settings: ResolveSettings) -> list[Anchor]:
    """(id, box, how surely it is what is named) of everything a relation may refer to."""
    found = []
    for node in graph.instances:
        if node.state == "gone" or node.existence < settings.min_existence:
            continue
        score = knowledge.label_score(phrase, node)
        if score >= settings.min_label:
            found.append((node.id, box_of(node), score * knowledge.attribute_score(phrase.attributes, node, 0.0)))
    if knowledge.names.canonical(phrase.name) == "door":
        found += [(d.id, Box((*d.position_xy, 1.0), (d.width_m, 0.2, 2.0)), 1.0) for d in graph.doors]
    return found


def _fit(case: _Case, kind: str, groups: list[list[Anchor]], graph: GraphSnapshot) -> float:
    """0..1: how well one case fits a relation to the best of its anchors. nearest, farthest: metres."""
    others = [[(box, score) for name, box, score in group if name != case.node.id] for group in groups]
    room = next((r for r in graph.rooms if r.id == case.node.room), None)
    if not groups:
        return _place_fit(case.box, kind, room)
    if kind in ("nearest", "farthest"):
        return min((rel.plan_gap(case.box, box) for box, _ in others[0]), default=1e3)
    if kind == "between":
        first, second = others[0], others[1] if len(others) > 1 else others[0]
        pairs = [(a, b, sa * sb) for a, sa in first for b, sb in second if a is not b]
        return max((rel.between(case.box, a, b) * min(1.0, s) for a, b, s in pairs), default=0.0)
    return max((_pair_fit(case.box, box, kind) * min(1.0, 0.3 + score) for box, score in others[0]), default=0.0)


def _place_fit(box: Box, kind: str, room: RoomNode | None) -> float:
    if room is None:
        return 0.5
    if kind == "corner":
        return rel.in_corner(box, room.polygon_xy)
    if kind == "middle":
        return rel.in_middle(box, rel.room_box(room))
    if kind == "ceiling":
        return rel.on_ceiling(box, room.ceiling_z_m) if room.ceiling_z_m is not None else 0.5
    return rel.on_floor(box, room.floor_z_m) if kind == "floor" else rel.on_wall(box, room.floor_z_m)


def _pair_fit(a: Box, b: Box, kind: str) -> float:
    """a: the candidate, b: what it is related to."""
    fits: dict[str, Callable[[], float]] = {
        "at": lambda: rel.near(a, b, 0.3, 1.8),
        "on": lambda: rel.on(a, b),
        "has_on": lambda: rel.on(b, a),
        "in": lambda: max(rel.on(a, b), 0.6 * rel.near(a, b, 0.1, 0.6)),
        "under": lambda: rel.under(a, b),
        "has_under": lambda: rel.under(b, a),
        "above": lambda: rel.above(a, b),
        "front": lambda: rel.in_front(a, b),
        "with": lambda: max(rel.on(b, a), rel.near(a, b, 0.2, 1.2)),
        "without": lambda: max(rel.on(b, a), rel.near(a, b, 0.2, 1.2)),
    }
    fit = fits.get(kind)
    return rel.near(a, b) if fit is None else fit()


def _none_sure(cases: list[_Case], alive: list[_Case], named: str, settings: ResolveSettings) -> Resolution:
    considered = _listed(cases, settings)
    if alive:
        kinds = ", ".join(dict.fromkeys(c.node.label for c in alive))
        return Ambiguous(
            _listed(alive, settings), f"no {named} is known for sure; is one of these meant: {kinds}?", considered
        )
    reasons = dict.fromkeys(c.rejected for c in cases if c.label >= settings.min_label) or dict.fromkeys(
        c.rejected for c in cases
    )
    return NotFound(f"{named} fits nothing here: {'; '.join(reasons)}", considered)


def _without_fragments(rivals: list[_Case]) -> list[_Case]:
    """Rivals without those that are a small piece, left over by fusion, of a bigger one in the same place."""
    kept: list[_Case] = []
    for case in sorted(rivals, key=lambda c: (-c.node.point_count, _number(c.node.id))):
        whole = next((k for k in kept if _is_piece(case, k)), None)
        if whole is None:
            kept.append(case)
        else:
            case.rejected = f"looks like a piece of {whole.node.id}"
    return kept


def _is_piece(part: _Case, whole: _Case) -> bool:
    apart = max(part.box.bottom_m - whole.box.top_m, whole.box.bottom_m - part.box.top_m)
    return (
        part.node.point_count < 0.35 * whole.node.point_count
        and apart < 0.1
        and rel.plan_gap(part.box, whole.box) < 0.1
    )


def _choose(
    rivals: list[_Case],
    cases: list[_Case],
    spec: GoalSpec,
    robot_xy: tuple[float, float],
    doubt: str,
    settings: ResolveSettings,
) -> Resolution:
    """One of the rivals if there is one, or if the goal says which; else Ambiguous."""
    away = {
        c.node.id: float(np.hypot(c.node.centroid_m[0] - robot_xy[0], c.node.centroid_m[1] - robot_xy[1]))
        for c in rivals
    }
    ordered = sorted(rivals, key=lambda c: (-c.score, _number(c.node.id)))
    related = any(r.kind in ("nearest", "farthest") for r in spec.relations)
    if related:
        ordered = sorted(rivals, key=lambda c: (c.order, _number(c.node.id)))
    elif spec.choice:
        ordered = sorted(rivals, key=lambda c: (_rank_key(spec.choice, c, away[c.node.id]), _number(c.node.id)))
    considered = _listed(cases, settings)
    frozen = tuple(c.frozen() for c in ordered)
    if doubt:
        return Ambiguous(frozen[: settings.max_candidates], f"{doubt}; is one of these meant?", considered)
    if spec.rank > len(ordered):
        return NotFound(f"only {len(ordered)} of them are known, not {spec.rank}", considered)
    if len(ordered) == 1 or related or spec.choice:
        at = spec.rank - 1
        alternates = frozen[:at] + frozen[at + 1 :] if spec.choice == "any" else ()
        return Resolved(frozen[at], alternates, considered)
    return Ambiguous(frozen[: settings.max_candidates], _question(ordered), considered)


def _rank_key(choice: str, case: _Case, away_m: float) -> float:
    """What a choice among equals goes by, smallest first; nearest to the robot unless it says otherwise."""
    keys = {
        "farthest": -away_m,
        "largest": -case.node.volume_m3,
        "smallest": case.node.volume_m3,
        "tallest": -case.box.top_m,
        "lowest": case.box.bottom_m,
    }
    return keys.get(choice, away_m)


def _question(cases: Sequence[_Case]) -> str:
    """What would tell the candidates apart: their rooms, or else which one."""
    rooms = list(dict.fromkeys(c.node.room or "no room" for c in cases))
    if len(rooms) > 1:
        return f"{len(cases)} fit, in {', '.join(rooms)}: which room?"
    return f"{len(cases)} fit: which one, or any?"
