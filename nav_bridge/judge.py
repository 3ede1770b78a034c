"""The candidates for a goal, judged by rooms and relations: thousands at once, as arrays over rows of the index."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nav_bridge import relations as rel
from nav_bridge.approach import in_polygon
from nav_bridge.evidence import Knowledge
from nav_bridge.goal import GoalSpec, Phrase, Relation
from nav_bridge.index import Index
from nav_bridge.relations import Boxes, Floats
from nav_bridge.resolution import Candidate

Rows = NDArray[np.intp]
Text = Callable[[int], str]

_REACH_M = 5.5  # things farther apart than this stand in no relation but nearest and between
_BETWEEN_M = 12.0
_FEW_OF_TYPICAL = 0.1  # at this share of the typical number of observations a thing is as likely real as not
_BEARS_OUT = (
    0.7  # fit of a relation that makes a doubtful name sure: "the cabinet under the TV" may be called a TV stand
)
_OTHER_ROOM = 0.5  # what a relation through a wall is worth
_IN_REACH = ("near", "front", "left", "right", "behind", "at", "with")  # relations that a wall cuts


@dataclass(slots=True)
class Cases:
    """Candidates while they are judged. rows: of the index. order: what a superlative goes by, smallest first.

    borne: bool [n], a relation that was said fits well, which bears out a name that alone would be a guess.
    reason: 0 for who is still in, else 1 + the place in reasons of why it is out. Notes and reasons are texts made when asked for.
    """

    index: Index
    rows: Rows
    label: Floats
    score: Floats
    order: Floats
    reason: NDArray[np.intp]
    borne: NDArray[np.bool_]
    reasons: list[Text] = field(default_factory=list)
    notes: list[Text] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def alive(self) -> NDArray[np.bool_]:
        return np.asarray(self.reason == 0)

    @property
    def boxes(self) -> Boxes:
        return self.index.boxes.take(self.rows)

    def reject(self, where: NDArray[np.bool_], why: Text) -> None:
        """Puts those out that are still in; the first reason stays."""
        self.reasons.append(why)
        self.reason[where & self.alive] = len(self.reasons)

    def why_out(self, k: int) -> str:
        return self.reasons[self.reason[k] - 1](k) if self.reason[k] else ""

    def part(self, which: Rows) -> Cases:
        """Some of the cases, all of them in, to be judged further without touching these."""
        none = np.zeros(len(which), np.intp)
        judged = self.label[which], self.score[which], self.order[which]
        return Cases(self.index, self.rows[which], *judged, none, self.borne[which].copy())

    def candidate(self, k: int) -> Candidate:
        node = self.index.graph.instances[self.rows[k]]
        evidence = round(min(1.0, float(self.score[k])), 3)
        notes = tuple(filter(None, (note(k) for note in self.notes)))
        own = bool(self.index.chances[self.rows[k]])
        return Candidate(node.id, node.label, node.room, 0.0, notes, self.why_out(k), evidence=evidence, by_chance=own)


# --------------------------------------------------------------------------------------------------------------- names
def label_or_id(phrase: Phrase, index: Index, knowledge: Knowledge) -> Floats:
    """[N] 0..1: how far each thing is what is named; an id of the graph ("I7") names exactly one."""
    row = index.rows.get(phrase.name.upper())
    label = knowledge.label_scores(phrase, index) if row is None else np.zeros(len(index))
    if row is not None:
        label[row] = 1.0
    return label


def named(spec: GoalSpec, index: Index, knowledge: Knowledge, *, least: float, min_existence: float) -> Cases:
    """Things whose labels may mean what was named, scored by label, attributes and how sure the thing is."""
    weights = [max(0.4, 1.0 - 0.12 * k) for k in range(len(spec.things))]  # a purpose names several things, best first
    scores = np.stack([label_or_id(p, index, knowledge) * w for p, w in zip(spec.things, weights, strict=True)])
    label = scores.max(0)
    rows = np.flatnonzero((label >= least) & (index.exists >= max(min_existence, 1e-9)))
    attribute = np.ones(len(rows))
    means = scores[:, rows].argmax(0)
    for k, phrase in enumerate(spec.things):
        mine = means == k
        attribute[mine] = knowledge.attribute_scores(phrase.attributes, rows[mine], index)
    # Both say how surely the thing is one, and mostly of the same pictures: their mean, not their product.
    sure = np.sqrt(index.exists[rows] * _seen_enough(index)[rows])
    label = label[rows]
    n = len(rows)
    cases = Cases(index, rows, label, label * attribute * sure, np.zeros(n), np.zeros(n, np.intp), np.zeros(n, bool))
    cases.notes.append(lambda k: f"labels {label[k]:.2f}")
    cases.notes.append(lambda k: f"attributes x{attribute[k]:.2f}" if attribute[k] != 1.0 else "")
    _by_size(cases, spec)
    return cases


def _seen_enough(index: Index) -> Floats:
    """[N] 0..1: what is seen far less often than most things here is more often a slip of the eye than a thing.

    What no picture has seen (0 observations: found by its shape alone) is none of the eye's slips: 1.
    """
    seen = index.observations.astype(np.float64)
    there = seen[(index.exists > 0) & (seen > 0)]
    few = max(1.0, _FEW_OF_TYPICAL * float(np.median(there))) if len(there) else 1.0
    return np.asarray(np.where(seen > 0, seen**2 / (seen**2 + few**2), 1.0))


def _by_size(cases: Cases, spec: GoalSpec) -> None:
    """Small or large is meant among those that are named: compared with the middle one."""
    sizes = [value for thing in spec.things for group, value in thing.attributes if group == "size"]
    if not sizes or len(cases) < 2:
        return
    volume = cases.index.volume_m3[cases.rows]
    bigger = volume > np.median(volume)
    misfit = bigger if sizes[0] in ("small", "low", "narrow") else ~bigger
    cases.score = np.where(misfit, 0.7, 1.0) * cases.score
    cases.notes.append(lambda k: f"not {sizes[0]} among its like" if misfit[k] else "")


# --------------------------------------------------------------------------------------------------------------- rooms
def by_rooms(cases: Cases, spec: GoalSpec, knowledge: Knowledge, min_room: float) -> str:
    """Judges the cases by the rooms named; returns a doubt in words when no such room is known and nothing contradicts."""
    for room in spec.not_rooms:
        out = knowledge.places.inside(room, cases.rows, cases.index)
        cases.reject(out >= 0.5, lambda k, room=room, out=out: f"is in a {room} ({out[k]:.2f})")  # type: ignore[misc]
    if not spec.room:
        return ""
    scores = knowledge.places.inside(spec.room, cases.rows, cases.index)
    known = knowledge.places.grades(spec.room, cases.index).max(initial=0.0) >= 0.55
    if not known and scores.max(initial=0.0) < min_room:
        return _in_unknown_room(cases, spec.room, knowledge)
    cases.notes.append(lambda k: f"in {spec.room} {scores[k]:.2f}")
    cases.score = cases.score * scores
    cases.reject(scores < min_room, lambda k: f"not in a {spec.room}")
    return ""


def _in_unknown_room(cases: Cases, wanted: str, knowledge: Knowledge) -> str:
    """No room of the kind is known: it may be one of unknown kind. What belongs elsewhere is out; returns the doubt left."""
    nodes = cases.index.graph.instances
    untyped = {room.id for room in cases.index.graph.rooms if room.label == "room"}
    belongs = [knowledge.places.belongs(nodes[row].label, wanted) for row in cases.rows]
    cases.reject(
        np.array([fits is False for fits in belongs]),
        lambda k: f"no {wanted} is known, and a {nodes[cases.rows[k]].label} does not belong in one",
    )
    outside = np.array([nodes[row].room not in untyped for row in cases.rows])
    if (cases.alive & ~outside).any():
        cases.reject(outside, lambda _: f"is in a room known to be no {wanted}")
    left = np.flatnonzero(cases.alive)
    # The only one there is, and it belongs there: the room is merely not recognised.
    certain = len(left) == 1 and belongs[left[0]] is True
    return "" if certain else f"no {wanted} is known here"


# ----------------------------------------------------------------------------------------------------------- relations
@dataclass(frozen=True, slots=True)
class Eye:
    """From where left is left. seen_from: "door", "robot", or "" for what comes natural: where the robot is, or would come in."""

    robot_xy: tuple[float, float]
    seen_from: str = ""

    def on_room(self, index: Index, row: int) -> Floats:
        """[2] where one stands who sees a room: the robot in it, else the door through which it would come in; row -1: the robot."""
        here = np.array(self.robot_xy, np.float64)
        if row < 0 or self.seen_from == "robot":
            return here
        room = index.graph.rooms[row]
        inside = len(room.polygon_xy) >= 3 and bool(in_polygon(here[None], room.polygon_xy)[0])
        doors = np.array([d.position_xy for d in index.graph.doors if room.id in d.rooms], np.float64).reshape(-1, 2)
        if not len(doors) or (inside and self.seen_from != "door"):
            return here
        return np.asarray(doors[np.hypot(*(doors - here).T).argmin()])


@dataclass(frozen=True, slots=True)
class Anchors:
    """What a relation refers to. rows: of the index, -1 for what is no thing; room: row of its room, -1 = none or several."""

    rows: Rows
    boxes: Boxes
    sure: Floats
    room: Rows

    def __len__(self) -> int:
        return len(self.rows)


def by_relation(
    cases: Cases, relation: Relation, knowledge: Knowledge, eye: Eye, min_label: float, least: float
) -> str:
    """Judges the cases by one relation; returns a doubt in words when what it refers to is not known."""
    groups = [_anchors(anchor, cases.index, knowledge, min_label) for anchor in relation.anchors]
    if relation.room:
        groups = [_room_anchors(relation.room, cases.index, knowledge)]
    names = " and ".join(anchor.name for anchor in relation.anchors)
    missing = " and ".join(a.name for a, g in zip(relation.anchors, groups, strict=False) if not len(g))
    if missing:
        return "" if relation.negated or relation.kind == "without" else f"no {missing} is known here"
    if relation.kind in ("nearest", "farthest"):
        gaps = _nearest(cases, groups[0])
        cases.order = gaps if relation.kind == "nearest" else -gaps
        cases.notes.append(lambda k: f"{gaps[k]:.1f} m from {names}")
        return ""
    fit = _fit(cases, relation, groups, eye)
    negated = relation.negated or relation.kind == "without"
    if negated:
        fit = 1.0 - fit
    what = f"{relation.kind.replace('_', ' ')} {names}".strip()
    cases.notes.append(lambda k: f"{'not ' if relation.negated else ''}{what} {fit[k]:.2f}")
    cases.score = cases.score * fit
    if not negated and groups:
        cases.borne |= fit >= _BEARS_OUT
    cases.reject(fit < least, lambda _: f"{'' if relation.negated else 'not '}{what}")
    return ""


def _anchors(phrase: Phrase, index: Index, knowledge: Knowledge, min_label: float) -> Anchors:
    """Everything a relation may refer to by this name, and how surely."""
    label = label_or_id(phrase, index, knowledge)
    rows = np.flatnonzero((label >= min_label) & (index.exists > 0))
    sure = label[rows] * knowledge.attribute_scores(phrase.attributes, rows, index)
    boxes, room = index.boxes.take(rows), index.room[rows]
    doors = index.graph.doors if knowledge.names.canonical(phrase.name) == "door" else ()
    if doors:
        more = rel.boxes([((*d.position_xy, 1.0), (d.width_m, 0.2, 2.0), 0.0) for d in doors])
        boxes = Boxes(*(np.concatenate(p) for p in zip(_parts(boxes), _parts(more), strict=True)))
        none = np.full(len(doors), -1, np.intp)
        rows, room = np.concatenate([rows, none]), np.concatenate([room, none])
        sure = np.concatenate([sure, np.ones(len(doors))])
    return Anchors(rows, boxes, sure, room)


def _parts(boxes: Boxes) -> tuple[Floats, Floats, Floats]:
    return boxes.center_m, boxes.size_m, boxes.yaw_rad


def _room_anchors(name: str, index: Index, knowledge: Knowledge) -> Anchors:
    at = np.flatnonzero(knowledge.places.grades(name, index) >= 0.6)
    none = np.full(len(at), -1, np.intp)
    return Anchors(none, rel.room_boxes([index.graph.rooms[k] for k in at]), np.ones(len(at)), none)


def _apart(a: Boxes, b: Boxes) -> Floats:
    """[n, m] distance of centres in plan."""
    off = a.center_m[:, None, :2] - b.center_m[None, :, :2]
    return np.asarray(np.hypot(off[..., 0], off[..., 1]))


def _nearest(cases: Cases, anchors: Anchors) -> Floats:
    """[n] plan distance to the nearest anchor that is not the case itself; 1000 m where there is none."""
    boxes, out = cases.boxes, np.full(len(cases), 1e3)
    away = _apart(boxes, anchors.boxes)
    away[cases.rows[:, None] == anchors.rows[None]] = np.inf
    least = away - boxes.radius_m[:, None] - anchors.boxes.radius_m[None]
    i, j = np.nonzero(least <= away.min(1, initial=np.inf)[:, None])
    i, j = (side[np.isfinite(away[i, j])] for side in (i, j))
    np.minimum.at(out, i, rel.plan_gap(boxes.take(i), anchors.boxes.take(j)))
    return out


def _fit(cases: Cases, relation: Relation, groups: list[Anchors], eye: Eye) -> Floats:
    """[n] 0..1: how well each case fits a relation to the best of its anchors."""
    if not groups:
        return _place_fit(cases, relation.kind)
    if relation.kind == "between":
        return _between(cases, groups[0], groups[-1])
    anchors, boxes = groups[0], cases.boxes
    away = _apart(boxes, anchors.boxes) - boxes.radius_m[:, None] - anchors.boxes.radius_m[None]
    i, j = np.nonzero((away < _REACH_M) & (cases.rows[:, None] != anchors.rows[None]))
    a, b = boxes.take(i), anchors.boxes.take(j)
    if relation.kind in ("left", "right", "behind"):
        eyes = viewpoints(anchors, cases.index, eye)
        fit = rel.beside(a, b, eyes[j], relation.kind)
    else:
        fit = _pair_fit(a, b, relation.kind)
    fit = fit * np.minimum(1.0, 0.3 + anchors.sure[j])
    if relation.kind in _IN_REACH:
        rooms = cases.index.room[cases.rows][i], anchors.room[j]
        cut = (rooms[0] != rooms[1]) & (rooms[0] >= 0) & (rooms[1] >= 0)
        fit = np.where(cut, _OTHER_ROOM, 1.0) * fit
    out = np.zeros(len(cases))
    np.maximum.at(out, i, fit)
    return out


def _between(cases: Cases, first: Anchors, second: Anchors) -> Floats:
    p, q = np.nonzero(
        (_apart(first.boxes, second.boxes) < _BETWEEN_M) & (first.rows[:, None] != second.rows[None])
    )  # pairs of anchors
    out = np.zeros(len(cases))
    if not len(p):
        return out
    b, c = first.boxes.take(p), second.boxes.take(q)
    middle = Boxes((b.center_m + c.center_m) / 2, b.size_m, b.yaw_rad)
    span = np.hypot(*(b.center_m - c.center_m)[:, :2].T)
    boxes = cases.boxes
    i, j = np.nonzero(_apart(boxes, middle) < span[None] + boxes.radius_m[:, None])
    other = (cases.rows[i] != first.rows[p[j]]) & (cases.rows[i] != second.rows[q[j]])
    i, j = i[other], j[other]
    sure = np.minimum(1.0, first.sure[p] * second.sure[q])
    np.maximum.at(out, i, rel.between(boxes.take(i), b.take(j), c.take(j)) * sure[j])
    return out


def viewpoints(anchors: Anchors, index: Index, eye: Eye) -> Floats:
    """[m, 2] from where one looks at each anchor."""
    eyes = np.tile(np.array(eye.robot_xy, np.float64), (len(anchors), 1))
    for row in np.unique(anchors.room):
        eyes[anchors.room == row] = eye.on_room(index, int(row))
    return eyes


def _place_fit(cases: Cases, kind: str) -> Floats:
    """[n] corner, middle, floor, wall, ceiling of the room a case is in; 0.5 where that is not known."""
    out, rooms = np.full(len(cases), 0.5), cases.index.room[cases.rows]
    for row in np.unique(rooms[rooms >= 0]):
        here = np.flatnonzero(rooms == row)
        room, boxes = cases.index.graph.rooms[row], cases.index.boxes.take(cases.rows[here])
        if kind == "corner":
            out[here] = rel.in_corner(boxes, room.polygon_xy)
        elif kind == "middle":
            out[here] = rel.in_middle(boxes, rel.room_boxes([room]))
        elif kind == "ceiling" and room.ceiling_z_m is not None:
            out[here] = rel.on_ceiling(boxes, room.ceiling_z_m)
        elif kind in ("floor", "wall"):
            out[here] = (rel.on_floor if kind == "floor" else rel.on_wall)(boxes, room.floor_z_m)
    return out


def _pair_fit(a: Boxes, b: Boxes, kind: str) -> Floats:
    """a: the candidates, b: what they are related to."""
    fits: dict[str, Callable[[], Floats]] = {
        "at": lambda: rel.near(a, b, 0.3, 1.8),
        "on": lambda: rel.on(a, b),
        "over": lambda: np.maximum(rel.on(a, b), rel.above(a, b)),  # where one word says both: sopra, encima, 上
        "has_on": lambda: rel.on(b, a),
        "in": lambda: np.maximum(rel.on(a, b), 0.6 * rel.near(a, b, 0.1, 0.6)),
        "under": lambda: rel.under(a, b),
        "has_under": lambda: rel.under(b, a),
        "above": lambda: rel.above(a, b),
        "front": lambda: rel.in_front(a, b),
        "with": lambda: np.maximum(rel.on(b, a), rel.near(a, b, 0.2, 1.2)),
        "without": lambda: np.maximum(rel.on(b, a), rel.near(a, b, 0.2, 1.2)),
    }
    fit = fits.get(kind)
    return rel.near(a, b) if fit is None else fit()
