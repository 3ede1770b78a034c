"""A goal in plain English, such that reading it again gives the goal: what a question offers as its answers."""

from __future__ import annotations

from irsd.perception.encoder import AliasTable
from nav_bridge.goal import GoalSpec, Phrase, Relation

_BEFORE = {
    "near": "next to", "at": "at", "on": "on", "under": "under", "above": "above", "front": "in front of", "behind": "behind",
    "left": "left of", "right": "right of", "between": "between", "in": "in", "with": "with", "without": "without",
    "nearest": "nearest to", "farthest": "farthest from",
}  # fmt: skip
_ALONE = {
    "corner": "in the corner", "middle": "in the middle", "floor": "on the floor", "wall": "on the wall", "ceiling": "on the ceiling",
}  # fmt: skip
_BEHIND = {"has_on": "on it", "has_under": "under it"}
ORDINALS = ("", "first", "second", "third", "fourth", "fifth")


def say(spec: GoalSpec, names: AliasTable) -> str:
    """The sentence: "second nearest red chair next to the desk in R2"."""
    thing = _phrase(spec.things[0], names) if spec.things else ""
    rank = ORDINALS[spec.rank] if spec.rank > 1 else ""
    choice = "" if spec.choice == "ordinal" else spec.choice
    relations = [_relation(relation, names) for relation in spec.relations]
    room = [f"in {_room(spec.room, names)}"] if spec.room else []
    not_rooms = [f"not in {_room(name, names)}" for name in spec.not_rooms]
    eye = {"door": "seen from the door", "robot": "seen from here"}.get(spec.seen_from, "")
    return " ".join(filter(None, [rank, choice, thing, *relations, *room, *not_rooms, eye]))


def _phrase(phrase: Phrase, names: AliasTable) -> str:
    colours_and_such = [value for group, value in phrase.attributes if group != "place"]
    outside = "front " if ("place", "outside") in phrase.attributes else ""
    name = names.canonical(phrase.name) if names.known(phrase.name) else phrase.name
    return " ".join([*colours_and_such, f"{outside}{name}"])


def _room(name: str, names: AliasTable) -> str:
    if name[:1] in "rR" and name[1:].isdigit():
        return name.upper()
    return f"the {names.canonical_room(name) if names.known_room(name) else name}"


def _relation(relation: Relation, names: AliasTable) -> str:
    no = "not " if relation.negated else ""
    if relation.kind in _ALONE:
        return no + _ALONE[relation.kind]
    anchors = " and ".join(f"the {_phrase(anchor, names)}" for anchor in relation.anchors)
    if relation.kind in _BEHIND:
        return f"with {anchors} {_BEHIND[relation.kind]}"
    return f"{no}{_BEFORE[relation.kind]} {anchors}"
