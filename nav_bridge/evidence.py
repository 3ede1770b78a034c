"""What speaks for things being what a word says: their labels by alias table first, then by embedding, and their attributes.

The table's word is final where it knows both names. All things of a graph are judged at once: a name is compared with every label
that occurs, and a thing has the grades of its labels by their shares.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from irsd.core.settings import setting
from irsd.graph.model import GraphSnapshot, RoomNode
from irsd.perception.encoder import LabelEncoder
from nav_bridge.goal import Phrase
from nav_bridge.index import Index, index_of
from nav_bridge.places import Places
from nav_bridge.relations import on_floor
from nav_bridge.words import fold
from nav_bridge.words_attributes import ATTRIBUTES


@dataclass(frozen=True, slots=True)
class EvidenceSettings:
    """How names are compared. The cosines were measured with the shipped text encoder on synonym and distractor pairs."""

    match_cosine: float = setting(
        0.65,
        "embedding cosine from which two names mean the same (of 30 things one passes by chance in 6 %)",
        lo=0.0,
        hi=1.0,
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
_BY_HEIGHT: Mapping[str, bool] = MappingProxyType({"standing": True, "wall-mounted": False})
UNTOLD = 0.5  # weight of an attribute that nothing is known about
MATCH = 0.6  # grade from which a name counts as said
MAYBE = 0.3  # grade from which it counts as perhaps meant
_MAX_PHRASES = 256  # whose grades are kept


class Knowledge:
    """The alias table and text encoder as the resolver asks them; keeps what it was asked. One owner, one thread."""

    def __init__(self, encoder: LabelEncoder, settings: EvidenceSettings) -> None:
        self.names = encoder.aliases
        self.places = Places(encoder, settings.neighbourhood_m)
        self._encoder = encoder
        self._settings = settings
        self._grades: dict[tuple[str, str], dict[str, float]] = {}
        self._senses: dict[str, tuple[str, ...]] = {}
        self._index: Index | None = None

    def follow(self, graph: GraphSnapshot) -> Index:
        """The index of a graph, made from that of its last revision; what is asked next is then answered without delay."""
        if self._index is None or self._index.graph is not graph:
            known = self._index.names if self._index is not None else {}
            self._index = index_of(graph, self._index)
            self.places.follow(self._index)
            self._encoder.encode([name for name in self._index.names if name not in known])
        return self._index

    # ------------------------------------------------------------------------------------------------- names of things
    def grade(self, phrase: Phrase, label: str) -> float:
        """0..1: does a label mean what the phrase says. 1 same name, 0.9 a kind of it, >= MATCH taken for it, >= MAYBE perhaps."""
        key = (phrase.name, phrase.head)
        known = self._grades.get(key)
        if known is None:
            if len(self._grades) >= _MAX_PHRASES:
                self._grades.pop(next(iter(self._grades)))
            known = self._grades[key] = {}
        found = known.get(label)
        if found is None:
            found = known[label] = self._grade(phrase, label)
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
        meant = self._senses_of(seen)
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
            return 0.8 if seen.endswith(f" {wanted}") else 0.55  # by another name than was said: only perhaps
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

    def _senses_of(self, folded: str) -> tuple[str, ...]:
        found = self._senses.get(folded)
        if found is None:
            if len(self._senses) >= 64 * _MAX_PHRASES:  # labels come from outside: they must not fill the memory
                self._senses.clear()
            found = self._senses[folded] = self.names.senses(folded)
        return found

    def label_scores(self, phrase: Phrase, index: Index) -> NDArray[np.float64]:
        """[N] 0..1: how much of what was said about each thing means the phrase."""
        if not len(index):
            return np.zeros(0)
        grades = np.array([self.grade(phrase, name) for name in index.names])
        of_label, first = grades[index.name], index.begin[:-1]
        said = index.per_thing(np.where(of_label >= MATCH, of_label * index.share, 0.0))
        perhaps = index.per_thing(np.where((of_label >= MAYBE) & (of_label < MATCH), of_label * index.share, 0.0))
        scores = np.where(said >= 0.3, said + perhaps, np.maximum(said, np.minimum(said + perhaps, 0.44)))
        # A rarer name that was given several times, for a thing whose usual name is related, is a second name and no slip.
        second = np.maximum.reduceat(np.where(of_label >= 0.8, index.share, 0.0), first)
        doubtful = np.flatnonzero((scores < 0.5) & (second >= 0.03) & (second * index.observations >= 2.0))
        usual, names = index.first_name[doubtful], tuple(index.names)
        related = {k: self._related(phrase, names[k]) for k in np.unique(usual)}
        for row, name in zip(doubtful, usual, strict=True):
            if related[name]:
                scores[row] = 0.5
        return np.minimum(1.0, scores)

    def _related(self, phrase: Phrase, label: str) -> bool:
        """Whether a name may be a second name of what is usually called label: same family, or close in meaning."""
        if self.grade(phrase, label) >= MAYBE:
            return True
        parents = [self.names.ancestors(name)[:1] for name in (phrase.name, label)]
        if parents[0] and parents[0] == parents[1] and parents[0][0] not in _BROAD:
            return True
        va, vb = self._encoder.encode([phrase.name, label])
        return float(va @ vb) >= self._settings.maybe_cosine

    # ----------------------------------------------------------------------------------------------------- attributes
    def attribute_scores(
        self, wanted: Sequence[tuple[str, str]], rows: NDArray[np.intp], index: Index
    ) -> NDArray[np.float64]:
        """[n] how far things have the attributes: 1 named so by their labels (or seen so), 0.5 nothing known, 0.1 named otherwise."""
        scores = np.ones(len(rows))
        told = (
            [{ATTRIBUTES[t] for t in fold(name).split() if t in ATTRIBUTES} for name in index.names] if wanted else []
        )
        floors = np.array([room.floor_z_m for room in index.graph.rooms] + [0.0])[index.room[rows]]
        for said, value in wanted:
            group = said.removeprefix("not ")
            if group == "size":
                continue  # sizes are compared between candidates
            if said != group:
                scores *= np.where(self._told(index, [(group, value) in names for names in told])[rows], 0.1, 1.0)
                continue
            so = self._told(index, [(group, value) in names for names in told])[rows]
            if group == "place":
                factor = np.where(self.places.leads_out(rows, index), 1.0, 0.1)
            elif value in _BY_HEIGHT:
                stands = on_floor(index.boxes.take(rows), floors)
                factor = np.where(so, 1.0, np.maximum(0.1, stands if _BY_HEIGHT[value] else 1.0 - stands))
            else:
                other = self._told(index, [any(g == group for g, _ in names) for names in told])[rows]
                factor = np.where(so, 1.0, np.where(other & (group == "colour"), 0.1, UNTOLD))
            scores *= factor
        return scores

    def _told(self, index: Index, names: Sequence[bool]) -> NDArray[np.bool_]:
        """[N] whether a thing has one of the labels that are marked."""
        marked = np.array(names, np.float64)
        return np.asarray(index.per_thing(marked[index.name]) > 0)

    # ---------------------------------------------------------------------------------------------------------- rooms
    def room_grade(self, wanted: str, room: RoomNode) -> float:
        """0..1: is a room of the kind asked for, by its own labels alone."""
        return self.places.grade(wanted, room)
