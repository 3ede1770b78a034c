"""What kind of room a room is, told by the things in it.

The paper's rule (section III-D): the volume-weighted mean of the objects' embeddings against prototypes. Taken literally it lets the
wardrobe-sized and the ubiquitous decide, so: volume counts by its square root and per kind of thing (eight photo frames are one
piece of evidence), what stands in every room is cancelled by centring, a prototype is the room's name and its typical things
of which the nearest counts most, and too little evidence is answered by "room".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.core.settings import setting
from irsd.perception.encoder import LabelEncoder

UNKNOWN = "room"
_STRUCTURE = ("wall", "window", "door", "floor", "ceiling", "column", "stairs", "railing", "person")
_NEAREST = 0.75  # share of the nearest typical thing in the similarity; the rest is the prototype's mean direction
_MIN_VOLUME_M3, _MAX_VOLUME_M3 = (
    0.005,
    2.0,
)  # bounds of one thing's say: a cup counts a little, a hall-sized merge is no proof
_SUPPORT = 0.1  # centred similarity from which a kind of thing speaks for a type: typical things lie at 0.2 .. 0.6
_CACHED_NAMES = 8192


@dataclass(frozen=True, slots=True)
class RoomTypeSettings:
    """Kinds of rooms and how sure to be."""

    types: tuple[str, ...] = setting(
        (
            *("kitchen", "office", "dining room", "bedroom", "bathroom", "living room", "laboratory", "meeting room"),
            *("corridor", "hall", "storage room", "toilet", "laundry room", "workshop", "gym", "balcony", "garage"),
        ),
        "kinds of rooms at this site; a kind of its own may list what is typical: 'clean room: microscope, fume hood'",
    )
    temperature: float = setting(0.03, "similarity that changes the odds between two kinds by e", lo=0.001, hi=1.0)
    min_share: float = setting(0.5, "share of the best kind below which a room is just a room", lo=0.0, hi=1.0)
    min_similarity: float = setting(0.1, "centred similarity of the best kind, below it just a room", lo=0.0, hi=1.0)
    min_kinds: int = setting(2, "kinds of things that must speak for a type", lo=1, hi=20)
    alone_volume_m3: float = setting(
        0.5, "a thing this large may speak alone (a bed makes a bedroom)", lo=0.0, hi=100.0
    )
    keep_margin: float = setting(
        0.03, "similarity by which another kind must be better to replace the last one", lo=0.0
    )


@dataclass(frozen=True, slots=True)
class Evidence:
    """One thing in a room: names with their scores, and its volume weighted by how sure we are that it exists."""

    labels: tuple[tuple[str, float], ...]
    volume_m3: float


@dataclass(frozen=True, slots=True)
class RoomType:
    """label: the type, or "room". labels: (type, share) best first, shares of all types sum to 1; empty without evidence."""

    label: str
    labels: tuple[tuple[str, float], ...]


class RoomTyper:
    """Types of rooms from what stands in them. Prototypes are embedded when made (about a second); names of things are cached."""

    def __init__(self, settings: RoomTypeSettings, encoder: LabelEncoder) -> None:
        self.settings = settings
        self._encoder = encoder
        self._names, things_of = _kinds(settings.types, encoder)
        self._members = [
            np.concatenate([encoder.encode_rooms([name]), encoder.encode(things)])
            for name, things in zip(self._names, things_of, strict=True)
        ]
        means = [m[0] + m[1:].mean(0) if len(m) > 1 else m[0] for m in self._members]
        self._prototypes = np.array([mean / np.linalg.norm(mean) for mean in means], np.float32)
        self._cache: dict[str, NDArray[np.float64]] = {}
        self._speaking: dict[str, str | None] = {}

    def type_of(self, things: Sequence[Evidence], last: str = UNKNOWN) -> RoomType:
        """The type of a room with these things; last: its type so far, which is kept while another one is not clearly better."""
        volume = self._volumes(things)
        if not volume or not self._names:
            return RoomType(UNKNOWN, ())
        similarity = np.stack([self._similarity(name) for name in volume])
        amount = np.array(list(volume.values()))
        score = np.sqrt(amount) @ similarity / np.sqrt(amount).sum()
        share = np.exp((score - score.max()) / self.settings.temperature)
        share /= share.sum()
        order = np.lexsort((np.arange(len(score)), -score))
        labels = tuple((self._names[k], float(share[k])) for k in order[:5] if share[k] >= 0.01)
        return RoomType(self._decide(similarity, amount, score, share, last), labels)

    def _decide(
        self,
        similarity: NDArray[np.float64],
        amount: NDArray[np.float64],
        score: NDArray[np.float64],
        share: NDArray[np.float64],
        last: str,
    ) -> str:
        s, best = self.settings, int(score.argmax())
        held = self._names.index(last) if last in self._names else None
        if held is not None and score[best] - score[held] < s.keep_margin and score[held] >= s.min_similarity / 2:
            return last
        speakers = similarity[:, best] >= _SUPPORT
        heard = speakers.sum() >= s.min_kinds or (amount[speakers] >= s.alone_volume_m3).any()
        sure = share[best] >= s.min_share and score[best] >= s.min_similarity
        return self._names[best] if heard and sure else UNKNOWN

    def _volumes(self, things: Sequence[Evidence]) -> dict[str, float]:
        """Volume per kind of thing; a thing whose name is uncertain is shared among its names. Structure has no say."""
        out: dict[str, float] = {}
        for thing in things:
            volume = min(max(thing.volume_m3, _MIN_VOLUME_M3), _MAX_VOLUME_M3)
            total = sum(score for _, score in thing.labels)
            for label, score in thing.labels:
                name = self._speaker(label)
                if score > 0 and name is not None:
                    out[name] = out.get(name, 0.0) + volume * score / total
        return {name: out[name] for name in sorted(out)}

    def _speaker(self, label: str) -> str | None:
        """The canonical name of a thing that says something about its room, None for structure."""
        if label not in self._speaking:
            if len(self._speaking) >= _CACHED_NAMES:  # labels come from outside: they must not fill the memory
                self._speaking.clear()
                self._cache.clear()
            aliases = self._encoder.aliases
            name = aliases.canonical(label)
            self._speaking[label] = None if any(aliases.is_a(name, part) for part in _STRUCTURE) else name
        return self._speaking[label]

    def _similarity(self, name: str) -> NDArray[np.float64]:
        """[T] similarity of a thing to each type, centred over the types."""
        known = self._cache.get(name)
        if known is None:
            vector = self._encoder.encode([name])[0]
            nearest = np.array([(member @ vector).max() for member in self._members], np.float64)
            raw = _NEAREST * nearest + (1 - _NEAREST) * (self._prototypes @ vector)
            known = self._cache[name] = raw - raw.mean()
        return known


def _kinds(types: Sequence[str], encoder: LabelEncoder) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """(names, typical things of each) of the configured types; what the site lists comes before what the table knows."""
    found: Mapping[str, tuple[str, ...]] = {}
    for entry in types:
        name, colon, listed = entry.partition(":")
        canonical = encoder.aliases.canonical_room(name)
        kind = encoder.aliases.find_room_kind(name)
        known = kind.objects if kind else ()
        own = tuple(thing.strip() for thing in listed.split(",") if thing.strip()) if colon else ()
        found = {**found, canonical: own or known}
    return tuple(found), tuple(found.values())
