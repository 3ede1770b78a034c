"""What speaks for a thing being what a word says, and for its standing in a room of the kind a word says.

Names are compared by alias table first, then by embedding; the table's word is final where it knows both names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from irsd.core.settings import setting
from irsd.graph.model import GraphSnapshot, InstanceNode, RoomNode
from irsd.perception.encoder import LabelEncoder
from nav_bridge.language import Phrase
from nav_bridge.relations import box_of, on_floor, plan_gap
from nav_bridge.words import ATTRIBUTES, fold


@dataclass(frozen=True, slots=True)
class EvidenceSettings:
    """How names are compared. The cosines were measured with the shipped text encoder on synonym and distractor pairs."""

    match_cosine: float = setting(
        0.60, "embedding cosine from which two names mean the same (0.2 % of distractors pass)", lo=0.0, hi=1.0
    )
    maybe_cosine: float = setting(0.45, "embedding cosine from which a thing is offered as a candidate", lo=0.0, hi=1.0)
    sibling_cosine: float = setting(
        0.75, "cosine from which two known things of one kind (dumbbell, barbell) pass for each other", lo=0.0, hi=1.0
    )
    neighbourhood_m: float = setting(
        1.5, "distance over which neighbours tell what part of a room a thing is in", lo=0.1, hi=20.0
    )


# Families too wide for two names in them to mean one thing.
_BROAD = frozenset({"furniture", "appliance", "electronics", "container", "tool", "toy", "decoration", "light"})
# What hangs or stands about anywhere tells nothing of the room it is in.
_ANYWHERE = frozenset({"decoration", "light"})
# Things that belong in one kind of room: elsewhere they are not looked for.
_BOUND = frozenset(
    {
        "bed", "nightstand", "wardrobe", "toilet", "urinal", "bathtub", "shower", "bathroom sink", "stove", "cooktop", "oven",
        "range hood", "refrigerator", "freezer", "dishwasher", "kitchen sink", "kitchen cabinet", "kitchen counter",
        "washing machine", "tumble dryer", "dining table", "fume hood",
    }
)  # fmt: skip
_BY_HEIGHT: Mapping[str, bool] = MappingProxyType({"standing": True, "wall-mounted": False})
UNTOLD = 0.5  # weight of an attribute that nothing is known about
MATCH = 0.6  # grade from which a name counts as said
MAYBE = 0.3  # grade from which it counts as perhaps meant


class Knowledge:
    """The alias table and text encoder as the resolver asks them; caches what it was asked. One owner, one thread."""

    def __init__(self, encoder: LabelEncoder, settings: EvidenceSettings) -> None:
        self.names = encoder.aliases
        self._encoder = encoder
        self._settings = settings
        self._grades: dict[tuple[str, str, str], float] = {}
        self._kinds_of: dict[str, tuple[str, ...]] = {}

    # ------------------------------------------------------------------------------------------------- names of things
    def grade(self, phrase: Phrase, label: str) -> float:
        """0..1: does a label mean what the phrase says. 1 same name, 0.9 a kind of it, >= MATCH taken for it, >= MAYBE perhaps."""
        key = (phrase.name, phrase.head, label)
        found = self._grades.get(key)
        if found is None:
            found = self._grade(phrase, label)
            self._grades[key] = found
        return found

    def _grade(self, phrase: Phrase, label: str) -> float:
        wanted, seen = fold(phrase.name), fold(label)
        if not wanted or not seen:
            return 0.0
        if wanted == seen:
            return 1.0
        senses = self.names.senses(wanted)
        if senses:
            return self._grade_known(wanted, senses, seen)
        grade = self._by_cosine(wanted, seen, self._settings.match_cosine)
        if phrase.head:  # "piano bench" is some bench, but any bench need not be one
            grade = max(grade, 0.5 * self.grade(Phrase(phrase.head), label))
        return grade

    def _grade_known(self, wanted: str, senses: Sequence[str], seen: str) -> float:
        meant = self.names.senses(seen)
        for rank, sense in enumerate(senses):
            weight = 1.0 if rank == 0 else 0.85
            if sense in meant:
                return weight if sense == meant[0] else 0.8 * weight
            if any(self.names.is_a(m, sense) for m in meant[:1]):
                return 0.9 * weight
        if not meant:
            if any(self.names.is_a(seen, sense) for sense in senses):
                return 0.85
            return self._by_cosine(self.names.canonical(wanted), seen, self._settings.match_cosine)
        # "tv cabinet" is called a cabinet, whatever the table files it under; so is a "tv stand", its other name.
        other_name = " ".join([*seen.split()[:-1], wanted])
        called_so = " " in other_name and meant[0] in self.names.senses(other_name)
        if called_so or seen.endswith(f" {wanted}"):
            return 0.8 if seen.endswith(f" {wanted}") else 0.65
        # Both are known and differ: only things of one kind may still pass for each other, and only if they are very close.
        parents = [set(self.names.ancestors(s)[:1]) for s in (senses[0], meant[0])]
        if parents[0] & parents[1]:
            close = self._by_cosine(senses[0], meant[0], self._settings.sibling_cosine)
            return close if close >= MATCH else 0.0
        if senses[0] in self.names.ancestors(meant[0]) or meant[0] in self.names.ancestors(senses[0])[:1]:
            return 0.5  # the label says less than the phrase: chair for armchair
        return 0.0

    def _by_cosine(self, a: str, b: str, match: float) -> float:
        """Cosine as a grade: ``match`` -> 0.7, 1 -> 0.9, maybe -> 0.35; 0 below."""
        va, vb = self._encoder.encode([a, b])
        cosine = float(va @ vb)
        if cosine >= match:
            return 0.7 + 0.2 * (cosine - match) / max(1e-6, 1.0 - match)
        return 0.35 + 0.1 * (cosine - self._settings.maybe_cosine) if cosine >= self._settings.maybe_cosine else 0.0

    def label_score(self, phrase: Phrase, node: InstanceNode) -> float:
        """0..1: how much of what was said about an instance means the phrase."""
        labels = node.labels or ((node.label, 1.0),)
        total = sum(score for _, score in labels)
        if total <= 0:
            return 0.0
        shares = [(self.grade(phrase, name), score / total) for name, score in labels]
        said = sum(grade * share for grade, share in shares if grade >= MATCH)
        perhaps = sum(grade * share for grade, share in shares if MAYBE <= grade < MATCH)
        score = said + perhaps if said >= 0.3 else max(said, min(said + perhaps, 0.44))
        # A rarer name that was given several times, for a thing whose usual name is related, is a second name and no slip.
        second = max((share for grade, share in shares if grade >= 0.8), default=0.0)
        if score < 0.5 and second >= 0.03 and second * node.observations >= 2.0 and self._related(phrase, labels[0][0]):
            score = max(score, 0.5)
        return min(1.0, score)

    def _related(self, phrase: Phrase, label: str) -> bool:
        """Whether a name may be a second name of what is usually called label: same family, or close in meaning."""
        if self.grade(phrase, label) >= MAYBE:
            return True
        parents = [self.names.ancestors(name)[:1] for name in (phrase.name, label)]
        if parents[0] and parents[0] == parents[1] and parents[0][0] not in _BROAD:
            return True
        va, vb = self._encoder.encode([phrase.name, label])
        return float(va @ vb) >= self._settings.maybe_cosine

    def attribute_score(self, wanted: Sequence[tuple[str, str]], node: InstanceNode, floor_z_m: float) -> float:
        """How far an instance has the attributes: 1 named so by its labels (or seen so), 0.5 nothing known, 0.1 named otherwise."""
        score = 1.0
        told = (
            [ATTRIBUTES[t] for name, _ in node.labels for t in fold(name).split() if t in ATTRIBUTES] if wanted else []
        )
        for group, value in wanted:
            if group == "size":
                continue  # sizes are compared between candidates
            stands = on_floor(box_of(node), floor_z_m)
            if (group, value) in told:
                continue
            if value in _BY_HEIGHT:
                score *= max(0.1, stands if _BY_HEIGHT[value] else 1.0 - stands)
            elif group == "colour" and any(g == group for g, _ in told):
                score *= 0.1
            else:
                score *= UNTOLD
        return score

    # -------------------------------------------------------------------------------------------------- kinds of rooms
    def room_grade(self, wanted: str, room: RoomNode) -> float:
        """0..1: is a room of the kind asked for, by its own labels alone."""
        if fold(wanted) == fold(room.label) or fold(wanted) == fold(room.id):
            return 1.0
        kind = self.names.canonical_room(wanted)
        if kind == self.names.canonical_room(room.label):
            return 0.9
        best = max((score for _, score in room.labels), default=0.0)
        for name, score in room.labels:
            if self.names.canonical_room(name) == kind and best > 0:
                return 0.6 * max(0.0, (score / best - 0.5) / 0.5)
        if not self.names.known_room(wanted) and room.label != "room":
            va, vb = self._encoder.encode_rooms([wanted, room.label])
            cosine = float(va @ vb)
            return cosine if cosine >= 0.75 else 0.0
        return 0.0

    def kinds_of(self, label: str) -> tuple[str, ...]:
        """Kinds of rooms a thing is typical of, sorted by the table; empty when it is typical of none."""
        found = self._kinds_of.get(label)
        if found is None:
            thing = self.names.canonical(label)
            family = {thing, *self.names.ancestors(label)}
            found = tuple(
                kind
                for kind in self.names.rooms
                if (about := self.names.find_room_kind(kind))
                and any(self.names.canonical(o) in family for o in about.objects)
            )
            self._kinds_of[label] = found
        return found

    def belongs(self, label: str, wanted: str) -> bool | None:
        """Whether a thing belongs in a kind of room: True typical of it, False bound to another kind, None it may be anywhere."""
        if self.names.canonical_room(wanted) in self.kinds_of(label):
            return True
        return False if self.names.canonical(label) in _BOUND else None

    def surroundings(self, node: InstanceNode, graph: GraphSnapshot) -> Mapping[str, float]:
        """Votes per kind of room of the things round an instance (and of itself, if it is bound to a kind), shared by their kinds."""
        votes: dict[str, float] = {}
        own, reach = box_of(node), self._settings.neighbourhood_m
        for other in graph.instances:
            if other.room != node.room or other.state == "gone":
                continue
            away = float(np.hypot(other.centroid_m[0] - node.centroid_m[0], other.centroid_m[1] - node.centroid_m[1]))
            if away > 4 * reach + max(*other.obb_size_m[:2], *own.size_m[:2]):
                continue
            if other.id == node.id and self.names.canonical(other.label) not in _BOUND:
                continue
            kinds = () if _ANYWHERE & set(self.names.ancestors(other.label)) else self.kinds_of(other.label)
            for kind in kinds:
                gap = plan_gap(own, box_of(other))
                votes[kind] = votes.get(kind, 0.0) + float(np.exp(-gap / reach)) / len(kinds)
        return votes

    def in_room_score(self, wanted: str, node: InstanceNode, graph: GraphSnapshot) -> float:
        """0..1: does an instance stand in a room of the kind asked for; from the room's labels and, softly, from what is round it."""
        rooms = {room.id: room for room in graph.rooms}
        room = rooms.get(node.room or "")
        by_room = self.room_grade(wanted, room) if room is not None else 0.0
        if fold(wanted) == fold(node.room or ""):
            return 1.0
        votes = self.surroundings(node, graph)
        most = max(votes.values(), default=0.0)
        by_things = votes.get(self.names.canonical_room(wanted), 0.0) / most if most >= 0.15 else 0.0
        return 1.0 - (1.0 - 0.95 * by_room) * (1.0 - 0.7 * by_things)
