"""The question that tells candidates apart, and to each the answer that means it and no other.

Tried in turn: the room, the colour, what a candidate stands next to, its size, its side, how near it is. The first by which every
candidate has an answer of its own is asked; where none does for all, each candidate has the first that does for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from nav_bridge import relations as rel
from nav_bridge.evidence import Knowledge
from nav_bridge.goal import GoalSpec, Phrase, Relation
from nav_bridge.judge import Cases, Rows
from nav_bridge.say import ORDINALS, say
from nav_bridge.words_attributes import ATTRIBUTES

_MOST = (
    6  # candidates that are told apart by more than their room and how near they are: a longer question helps nobody
)
_BESIDE = 0.6  # fit from which a thing is named as what a candidate stands next to
_LARGER = 1.4  # ratio of volumes that people see
Means = Callable[[GoalSpec], int | None]  # which candidate (row of the cases) a goal with something added means


Offers = list[tuple[str, GoalSpec]]  # words for the question, and the goal with them added


def ask(rivals: Rows, cases: Cases, spec: GoalSpec, knowledge: Knowledge, means: Means) -> tuple[str, dict[int, str]]:
    """(the question, per rival what to say to mean it). Rivals are rows of the cases, in the order in which they are listed."""
    rows = [int(k) for k in rivals]
    told: dict[int, tuple[str, GoalSpec]] = {}
    for offers in _offers(rows, cases, spec, knowledge):
        found: dict[int, tuple[str, GoalSpec]] = {}
        for words, goal in offers:
            meant = means(goal)
            if meant is not None and meant in rows:
                found.setdefault(meant, (words, goal))
        if len(found) == len(rows):
            told = found
            break
        told = {**found, **told}
    ids = {k: cases.index.graph.instances[cases.rows[k]].id for k in rows}
    called = [told[k][0] if k in told else ids[k] for k in rows[:_MOST]]
    more = f", or one of {len(rows) - _MOST} more" if len(rows) > _MOST else ""
    question = f"{len(rows)} fit: {', '.join(called[:-1])} or {called[-1]}{more}?"
    return question, {k: say(told[k][1], knowledge.names) if k in told else ids[k] for k in rows}


def _offers(rows: list[int], cases: Cases, spec: GoalSpec, knowledge: Knowledge) -> Iterator[Offers]:
    """Per property what the rivals could be called by it."""
    by_room = _by_room(rows, cases, spec)
    yield list(by_room.values())
    if len(rows) <= _MOST:
        yield _by_colour(rows, cases, spec)
        yield _by_neighbour(rows, cases, spec, knowledge)
        yield _by_size(rows, cases, spec)
        yield [(f"the {side} one", replace(spec, choice=side)) for side in ("left", "right")] if len(rows) == 2 else []
    yield _by_rank(len(rows), "", spec)
    in_room = [cases.index.graph.instances[cases.rows[k]].room for k in rows]
    yield [
        offer for room, (words, goal) in by_room.items() for offer in _by_rank(in_room.count(room), f"{words}, ", goal)
    ]


def _by_room(rows: list[int], cases: Cases, spec: GoalSpec) -> dict[str, tuple[str, GoalSpec]]:
    nodes = cases.index.graph.instances
    found = dict.fromkeys(nodes[cases.rows[k]].room for k in rows)
    rooms = {room.id: f"{room.id} {room.label}" for room in cases.index.graph.rooms if room.id in found}
    return {room: (f"the one in {name}", replace(spec, room=room)) for room, name in rooms.items()}


def _by_colour(rows: list[int], cases: Cases, spec: GoalSpec) -> Offers:
    nodes = [cases.index.graph.instances[cases.rows[k]] for k in rows]
    said = [
        ATTRIBUTES[w] for node in nodes for name, _ in node.labels for w in name.casefold().split() if w in ATTRIBUTES
    ]
    thing = spec.things[0]
    return [
        (f"the {value} one", replace(spec, things=(replace(thing, attributes=(*thing.attributes, (group, value))),)))
        for group, value in dict.fromkeys(said)
        if group == "colour" and (group, value) not in thing.attributes
    ]


def _by_neighbour(rows: list[int], cases: Cases, spec: GoalSpec, knowledge: Knowledge) -> Offers:
    """By a thing that stands next to one rival and to no other."""
    index, out = cases.index, []
    rooms = {int(index.room[cases.rows[k]]) for k in rows}
    names = [room.id for at, room in enumerate(index.graph.rooms) if at in rooms]
    around = np.concatenate([index.members[name] for name in names] or [np.zeros(0, np.intp)])
    own = cases.rows[rows]
    around = np.setdiff1d(around, own)
    # Few words are better than many, and a large thing is found more easily than a small one.
    around = around[np.argsort(-index.volume_m3[around], kind="stable")]
    beside = np.zeros((len(rows), len(around)))
    for i, row in enumerate(own):
        mine = index.boxes.take(np.full(len(around), row))
        same_room = index.room[around] == index.room[row]
        beside[i] = rel.near(mine, index.boxes.take(around)) * same_room
    labels = [knowledge.names.canonical(index.graph.instances[k].label) for k in around]
    for i in range(len(rows)):
        for j in np.flatnonzero(beside[i] >= _BESIDE):
            alike = [n for n, label in enumerate(labels) if label == labels[j]]
            others = np.delete(beside[:, alike], i, 0)
            if not len(others) or others.max(initial=0.0) < _BESIDE / 2:
                relation = Relation("near", (Phrase(labels[j]),))
                out.append((f"the one next to the {labels[j]}", replace(spec, relations=(*spec.relations, relation))))
                break
    return out


def _by_size(rows: list[int], cases: Cases, spec: GoalSpec) -> Offers:
    volume = np.sort(cases.index.volume_m3[cases.rows[rows]])
    if len(volume) != 2 or volume[1] < _LARGER * volume[0]:
        return []
    return [(f"the {choice} one", replace(spec, choice=choice)) for choice in ("largest", "smallest")]


def _by_rank(count: int, before: str, spec: GoalSpec) -> Offers:
    return [
        (f"{before}the {f'{ORDINALS[k]} ' if k > 1 else ''}nearest", replace(spec, choice="nearest", rank=k))
        for k in range(1, min(count, len(ORDINALS) - 1) + 1)
    ]
