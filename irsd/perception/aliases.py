"""The table of names in front of the text encoder: synonyms, other languages and what is a kind of what.

Names are compared in a folded form (case, accents, hyphens, spaces, articles and plurals don't matter); the exact form wins.
"""

from __future__ import annotations

import importlib.resources
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from irsd.core.errors import ModelError
from irsd.models import ALIASES_NAME
from irsd.perception.aliases_fold import fold, keys_of, squeeze, variants


@dataclass(frozen=True, slots=True)
class RoomKind:
    """A kind of room: its canonical name and the names of things one finds there."""

    name: str
    objects: tuple[str, ...]


@dataclass(slots=True)
class _Index:
    """Surface forms to the canonical names they can stand for, first sense first."""

    exact: dict[str, list[str]] = field(default_factory=dict)
    loose: dict[str, list[str]] = field(default_factory=dict)

    def add(self, surface: str, canonical: str, *, first: bool = False) -> None:
        for form in variants(surface):
            _insert(self.exact, squeeze(form), canonical, first)
        for key in keys_of(surface):
            _insert(self.loose, key, canonical, False)

    def find(self, name: str) -> tuple[str, ...]:
        folded = fold(name)
        exact = self.exact.get(squeeze(folded))
        if exact:
            return tuple(exact)
        for key in keys_of(folded):
            found = self.exact.get(key) or self.loose.get(key)
            if found:
                return tuple(found)
        return ()


def _insert(index: dict[str, list[str]], key: str, canonical: str, first: bool) -> None:
    senses = index.setdefault(key, [])
    if first and canonical in senses:
        senses.remove(canonical)
    if canonical not in senses:
        senses.insert(0 if first else len(senses), canonical)


_REMEMBERED = 16384  # names whose senses are kept: folding costs fifty times the look-up


class AliasTable:
    """Canonical names of things and kinds of rooms. Immutable once built."""

    def __init__(self, document: Mapping[str, Any]) -> None:
        """document: the parsed aliases.json. ModelError names the entry that is wrong."""
        self._things, self._rooms = _Index(), _Index()
        self._parents: dict[str, tuple[str, ...]] = {}
        kinds: list[RoomKind] = []
        try:
            for entry in document["objects"]:
                _index_entry(self._things, entry)
                self._parents[entry["name"]] = tuple(entry.get("parents", ()))
            for entry in document["rooms"]:
                _index_entry(self._rooms, entry)
                kinds.append(RoomKind(entry["name"], tuple(entry.get("objects", ()))))
        except (KeyError, TypeError, AttributeError) as error:
            raise ModelError(f"the alias table is not as documented in aliases.json: {error!r}") from error
        for table, names in ((self._things, self._parents), (self._rooms, [kind.name for kind in kinds])):
            for name in names:
                for form in variants(name):
                    _insert(table.exact, squeeze(form), name, True)  # a canonical name always means itself first
        missing = {p for parents in self._parents.values() for p in parents} - self._parents.keys()
        if missing:
            raise ModelError(f"the alias table names parents without an entry: {', '.join(sorted(missing))}")
        self._kinds = {kind.name: kind for kind in kinds}
        self._senses = lru_cache(_REMEMBERED)(self._things.find)
        self._room_senses = lru_cache(_REMEMBERED)(self._rooms.find)
        self._ancestors = lru_cache(_REMEMBERED)(self._find_ancestors)
        self._bare = lru_cache(_REMEMBERED)(lambda name: keys_of(name, squeezed=False)[-1])

    @classmethod
    def load(cls) -> AliasTable:
        """The table as shipped. ModelError when it can't be read."""
        try:
            text = importlib.resources.files("irsd.models").joinpath(ALIASES_NAME).read_text(encoding="utf-8")
            return cls(json.loads(text))
        except (OSError, ValueError) as error:
            raise ModelError(f"{ALIASES_NAME} of irsd can't be read ({error}): install irsd again") from error

    # ---------------------------------------------------------------------------------------------- things
    @property
    def things(self) -> tuple[str, ...]:
        """Canonical names of all known things, as in the file."""
        return tuple(self._parents)

    def canonical(self, name: str) -> str:
        """The canonical name of a thing ("the Fridges" -> "refrigerator"); an unknown name comes back folded."""
        senses = self._senses(name)
        return senses[0] if senses else self._bare(name)

    def senses(self, name: str) -> tuple[str, ...]:
        """All things a name can stand for, the usual one first ("screen": monitor, projection screen); empty if unknown."""
        return self._senses(name)

    def known(self, name: str) -> bool:
        """Whether the table knows this name of a thing."""
        return bool(self._senses(name))

    def ancestors(self, name: str) -> tuple[str, ...]:
        """What a thing is a kind of, nearest first. An unknown "gaming chair" is a kind of the longest known ending: chair."""
        return self._ancestors(name)

    def _find_ancestors(self, name: str) -> tuple[str, ...]:
        canonical = self.canonical(name)
        queue = list(self._parents.get(canonical, ()))
        if canonical not in self._parents:
            words = canonical.split()
            tails = (" ".join(words[k:]) for k in range(1, len(words)))
            queue = next(([self.canonical(tail)] for tail in tails if self.known(tail)), [])
        out: list[str] = []
        while queue:
            name = queue.pop(0)
            if name not in out:
                out.append(name)
                queue += self._parents.get(name, ())
        return tuple(out)

    def is_a(self, name: str, ancestor: str) -> bool:
        """Whether a thing is the ancestor or a kind of it: is_a("coffee table", "table"); never the other way round."""
        wanted = self.canonical(ancestor)
        return self.canonical(name) == wanted or wanted in self.ancestors(name)

    # ---------------------------------------------------------------------------------------------- rooms
    @property
    def rooms(self) -> tuple[str, ...]:
        """Canonical names of all known kinds of rooms, as in the file."""
        return tuple(self._kinds)

    def canonical_room(self, name: str) -> str:
        """The canonical name of a kind of room ("WC" -> "toilet"); an unknown name comes back folded."""
        senses = self._room_senses(name)
        return senses[0] if senses else self._bare(name)

    def known_room(self, name: str) -> bool:
        """Whether the table knows this kind of room."""
        return bool(self._room_senses(name))

    def find_room_kind(self, name: str) -> RoomKind | None:
        """What is typical of a kind of room, or None if unknown."""
        return self._kinds.get(self.canonical_room(name))


def _index_entry(index: _Index, entry: Mapping[str, Any]) -> None:
    name = entry["name"]
    surfaces: Iterable[str] = [name, *entry.get("synonyms", ())]
    for words in entry.get("languages", {}).values():
        surfaces = [*surfaces, *words]
    for surface in surfaces:
        index.add(surface, name)
