"""What a sentence asks for, as data: the types between language and resolution."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

IT = "it"  # the name of what was spoken of last


class Names(Protocol):
    """What the parser asks of the alias table."""

    def known(self, name: str) -> bool: ...

    def known_room(self, name: str) -> bool: ...

    def senses(self, name: str) -> tuple[str, ...]: ...

    def is_a(self, name: str, ancestor: str) -> bool: ...

    def canonical_room(self, name: str) -> str: ...


@dataclass(frozen=True, slots=True)
class Phrase:
    """A thing as named. name: the words of the noun, folded; head: its known ending, "" when the name is known or nothing is.

    attributes: (group, canonical attribute), such as ("colour", "orange"); ("not colour", "orange") is one it must not have.
    """

    name: str
    head: str = ""
    attributes: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Relation:
    """How the goal lies to others. kind: near, at, on, over (on or above), under, above, front, behind, left, right, between, in,
    with, without, has_on, has_under, nearest, farthest (with anchors), corner, middle, floor, wall, ceiling (without). room: the
    anchor is a room of this name."""

    kind: str
    anchors: tuple[Phrase, ...] = ()
    negated: bool = False
    room: str = ""


@dataclass(frozen=True, slots=True)
class GoalSpec:
    """What a sentence asks for.

    things: names wanted, best first (several for a purpose). room / not_rooms: names of rooms as said. choice: "" (must be
    unique), any, nearest, farthest, largest, smallest, tallest, lowest, left, right, ordinal; rank: which one in the order of
    choice, 1 = first. function: the purpose it was asked by, "". seen_from: "door" or "robot" where it is said from where left is
    left, "" where it is not. parsed_by: "offline", or the model that read it.
    """

    text: str
    language: str
    things: tuple[Phrase, ...]
    room: str = ""
    not_rooms: tuple[str, ...] = ()
    relations: tuple[Relation, ...] = ()
    choice: str = ""
    rank: int = 1
    function: str = ""
    room_is_goal: bool = False
    seen_from: str = ""
    parsed_by: str = "offline"


def refer(spec: GoalSpec, last: str) -> GoalSpec:
    """The goal with "it" and "there" replaced by the id of the node that was the last goal; "" leaves them as they are."""
    if not last:
        return spec

    def named(phrase: Phrase) -> Phrase:
        return Phrase(last.casefold()) if phrase.name == IT else phrase

    relations = tuple(replace(r, anchors=tuple(named(a) for a in r.anchors)) for r in spec.relations)
    return replace(spec, things=tuple(named(t) for t in spec.things), relations=relations)
