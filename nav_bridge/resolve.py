"""Which instance a goal means: Resolved, Ambiguous with the candidates, or NotFound with the reason. Never a guess.

A candidate's evidence is the product of what its labels, its attributes, its room and its relations say. One clear winner is
resolved, if the chance that it is meant (``calibration``) is good enough; several that nothing tells apart are ambiguous, unless the
goal leaves the choice open (any, nearest, ...).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from irsd.core.settings import setting
from irsd.graph.model import GraphSnapshot
from nav_bridge import relations as rel
from nav_bridge.calibration import chance_of, with_chances
from nav_bridge.evidence import Knowledge
from nav_bridge.goal import GoalSpec
from nav_bridge.judge import Cases, Eye, Rows, by_relation, by_rooms, named
from nav_bridge.questions import ask
from nav_bridge.relations import Floats
from nav_bridge.resolution import Ambiguous, Candidate, NotFound, Resolution, Resolved

_FOR_A_PURPOSE, _ANY_WILL_DO = 0.95, 0.8  # rival_ratio for these at least
# What has at most these shares of the observations and of the points of another of its name is a mask's edge on something else.
_GLIMPSED, _SPECK = 0.35, 0.15
_FLUSH_M = 0.05  # tops as level as this may be one surface


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
    min_chance: float = setting(
        0.4, "chance of being the one meant from which the robot sets off; below it asks", lo=0.0, hi=1.0
    )
    min_existence: float = setting(0.2, "instances whose existence is less certain are not considered", lo=0.0, hi=1.0)
    max_candidates: int = setting(12, "how many candidates an answer lists", lo=1, hi=1000)


def resolve(
    spec: GoalSpec, graph: GraphSnapshot, knowledge: Knowledge, robot_xy: tuple[float, float], settings: ResolveSettings
) -> Resolution:
    """Which thing the goal means in this graph (``room_goal`` is for rooms).

    robot_xy: where the robot is (for nearest, second, left, ...), map frame, metres.
    """
    if not spec.things:
        return NotFound("the sentence names nothing to go to", ())
    index = knowledge.follow(graph)
    what = ", ".join(thing.name for thing in spec.things[:3])
    s = settings
    cases = named(spec, index, knowledge, least=s.maybe_label, min_existence=s.min_existence)
    if not len(cases):
        return NotFound(f"no {what} is known here", ())
    eye = Eye(robot_xy, spec.seen_from)
    doubt = by_rooms(cases, spec, knowledge, s.min_room)
    for relation in spec.relations:
        doubt = by_relation(cases, relation, knowledge, eye, s.min_label, s.min_relation) or doubt
    sure = np.flatnonzero(cases.alive & (cases.label >= s.min_label))
    if not len(sure):
        sure = np.flatnonzero(cases.alive & cases.borne)
    if not len(sure):
        return _none_sure(cases, what, settings)
    rivals = _rivals(sure, cases, spec, settings)
    others = np.ones(len(cases), bool)
    others[rivals] = False
    means = partial(_means, sure, cases, spec, eye, knowledge, settings)
    cases.reject(others & (cases.label >= s.min_label), lambda _: "fits less well")
    ordered = _ordered(rivals, cases, spec, eye)
    considered = _listed(cases, settings)
    best = tuple(cases.candidate(int(k)) for k in ordered[: settings.max_candidates])
    if doubt:
        asked = tuple(replace(candidate, answer=candidate.instance) for candidate in best)
        return with_chances(Ambiguous(asked, f"{doubt}; is one of these meant?", considered), doubt=True)
    if spec.rank > len(ordered):
        return NotFound(f"only {len(ordered)} of them are known, not {spec.rank}", considered)
    if len(ordered) == 1 or _chosen(spec):
        target = cases.candidate(int(ordered[spec.rank - 1]))
        alternates = tuple(c for c in best if c.instance != target.instance) if spec.choice == "any" else ()
        if chance_of(target) >= s.min_chance:
            return with_chances(Resolved(target, alternates, considered))
        asked = tuple(replace(candidate, answer=candidate.instance) for candidate in best)
        return with_chances(Ambiguous(asked, f"it is not sure that this is the {what}; is it meant?", considered))
    question, answers = ask(ordered[: settings.max_candidates], cases, spec, knowledge, means)
    asked = tuple(replace(c, answer=answers[int(k)]) for c, k in zip(best, ordered, strict=False))
    return with_chances(Ambiguous(asked, question, considered))


def _rivals(sure: Rows, cases: Cases, spec: GoalSpec, settings: ResolveSettings) -> Rows:
    """Of the candidates that count as what was named, those that nothing rules out."""
    # Where any will do, it is one of the surest; for a purpose the best thing for it.
    strict = _FOR_A_PURPOSE if spec.function else _ANY_WILL_DO if spec.choice == "any" else 0.0
    ratio = max(settings.rival_ratio, strict)
    rivals = sure[cases.score[sure] >= ratio * cases.score[sure].max()]
    return _without_fragments(_without_glimpses(rivals, cases), cases)


def _chosen(spec: GoalSpec) -> bool:
    """Whether the goal says which of several."""
    return bool(spec.choice) or any(r.kind in ("nearest", "farthest") for r in spec.relations)


def _means(
    sure: Rows, cases: Cases, spec: GoalSpec, eye: Eye, knowledge: Knowledge, settings: ResolveSettings, goal: GoalSpec
) -> int | None:
    """Which of the candidates a goal means that is ``spec`` with something added; None for none or several."""
    part = cases.part(sure)
    if goal.room != spec.room:
        by_rooms(part, replace(goal, not_rooms=()), knowledge, settings.min_room)
    for relation in goal.relations[len(spec.relations) :]:
        by_relation(part, relation, knowledge, eye, settings.min_label, settings.min_relation)
    added = goal.things[0].attributes[len(spec.things[0].attributes) :]
    part.score = part.score * knowledge.attribute_scores(added, part.rows, part.index)
    left = np.flatnonzero(part.alive)
    if not len(left):
        return None
    ordered = _ordered(_rivals(left, part, goal, settings), part, goal, eye)
    if goal.rank > len(ordered) or not (len(ordered) == 1 or _chosen(goal)):
        return None
    return int(sure[ordered[goal.rank - 1]])


def _listed(cases: Cases, settings: ResolveSettings) -> tuple[Candidate, ...]:
    ranked = np.lexsort((cases.rows, -cases.score, ~cases.alive))
    return tuple(cases.candidate(int(k)) for k in ranked[: settings.max_candidates])


def _none_sure(cases: Cases, what: str, settings: ResolveSettings) -> Resolution:
    considered = _listed(cases, settings)
    alive = tuple(c for c in considered if not c.rejected)
    if alive:
        kinds = ", ".join(dict.fromkeys(c.label for c in alive))
        question = f"no {what} is known for sure; is one of these meant: {kinds}?"
        return with_chances(Ambiguous(alive, question, considered), doubt=True)
    sure = [c.rejected for k, c in enumerate(considered)]
    likely = np.flatnonzero(cases.label >= settings.min_label)[: settings.max_candidates]
    reasons = dict.fromkeys(cases.why_out(int(k)) for k in likely) or dict.fromkeys(sure)
    return NotFound(f"{what} fits nothing here: {'; '.join(reasons)}", considered)


def _without_glimpses(rivals: Rows, cases: Cases) -> Rows:
    """Rivals without those that are a few points seen a few times, where another was seen well: one name, so about one size.

    What no picture has seen (found by its shape alone) is no glimpse.
    """
    rows = cases.rows[rivals]
    seen, points = cases.index.observations[rows], cases.index.points[rows]
    well = (seen[:, None] <= _GLIMPSED * seen) & (points[:, None] <= _SPECK * points) & (seen[:, None] > 0)
    name = {int(rivals[k]): cases.index.graph.instances[rows[well[k].argmax()]].id for k in np.flatnonzero(well.any(1))}
    out = np.zeros(len(cases), bool)
    out[list(name)] = True
    cases.reject(out, lambda k: f"only glimpsed, {name[k]} was seen well")
    return np.asarray(rivals[~out[rivals]])


def _without_fragments(rivals: Rows, cases: Cases) -> Rows:
    """Rivals without those that fusion left over of a bigger one: a small piece beside it, or what fills the same space."""
    boxes = cases.boxes.take(rivals)
    points = cases.index.points[cases.rows[rivals]]
    room = np.prod(boxes.size_m, 1)
    off = boxes.center_m[:, None, :2] - boxes.center_m[None, :, :2]
    reach = boxes.radius_m[:, None] + boxes.radius_m[None] + 0.1
    part, whole = np.nonzero(np.hypot(off[..., 0], off[..., 1]) < reach)
    apart = np.maximum(boxes.bottom_m[part] - boxes.top_m[whole], boxes.bottom_m[whole] - boxes.top_m[part])
    level = (apart < 0.1) & (part != whole)
    part, whole = part[level], whole[level]
    a, b = boxes.take(part), boxes.take(whole)
    piece = (points[part] < 0.35 * points[whole]) & (rel.plan_gap(a, b) < 0.1)
    # Of two that lie in each other the one that takes more room is the whole, unless it is but a few points of the other. Two table
    # tops of one height can't even share a corner: they are one, seen from two sides.
    flush = np.abs(a.top_m - b.top_m) < _FLUSH_M
    within = (rel.plan_overlap(a, b) > np.where(flush, 0.2, 0.5)) & (points[whole] >= 0.35 * points[part])
    within &= (room[part] < room[whole]) | ((room[part] == room[whole]) & (part > whole))
    of: dict[int, int] = {}
    for p, w in zip(part[piece | within], whole[piece | within], strict=True):
        of.setdefault(int(p), int(w))
    out = np.zeros(len(cases), bool)
    out[rivals[list(of)]] = True
    name = {int(rivals[p]): cases.index.graph.instances[cases.rows[rivals[w]]].id for p, w in of.items()}
    cases.reject(out, lambda k: f"looks like a piece of {name[k]}")
    return np.asarray(rivals[~out[rivals]])


def _ordered(rivals: Rows, cases: Cases, spec: GoalSpec, eye: Eye) -> Rows:
    """The rivals, the first that is meant first."""
    if any(r.kind in ("nearest", "farthest") for r in spec.relations):
        key = cases.order[rivals]
    elif spec.choice:
        key = _rank_key(spec.choice, rivals, cases, eye)
    else:
        key = -cases.score[rivals]
    return np.asarray(rivals[np.lexsort((cases.rows[rivals], np.round(key, 6)))])


def _rank_key(choice: str, rivals: Rows, cases: Cases, eye: Eye) -> Floats:
    """[n] what a choice among equals goes by, smallest first; nearest to the robot unless it says otherwise."""
    boxes = cases.boxes.take(rivals)
    away = np.hypot(*(boxes.center_m[:, :2] - np.array(eye.robot_xy)).T)
    if choice in ("left", "right"):
        rooms = np.unique(cases.index.room[cases.rows[rivals]])
        place = eye.on_room(cases.index, int(rooms[0]) if len(rooms) == 1 else -1)
        leftward = rel.bearing(boxes, place, boxes.center_m[:, :2].mean(0))
        return leftward if choice == "right" else -leftward
    volume = cases.index.volume_m3[cases.rows[rivals]]
    keys: dict[str, Floats] = {
        "farthest": -away,
        "largest": -volume,
        "smallest": volume,
        "tallest": -boxes.top_m,
        "lowest": boxes.bottom_m,
    }
    chosen = keys.get(choice)
    return away if chosen is None else chosen
