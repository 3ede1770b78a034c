"""Names of things by shape and by picture together, over one vocabulary, with an honest way out: what is like nothing is an "object".

The chance of a name is softmax(scale * e * (w * cosine by shape + (1 - w) * cosine by picture) + g * log of how common it is), or of
the one that there is, with e = 1. The scale comes with the shape network, the weights w, e and g from measuring on things that nothing
was trained on; e lies between 1, one piece of evidence seen twice, and 2, two independent ones.
Shapes are encoded anew only when a cloud has changed by much, a few at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from irsd.core.settings import setting
from irsd.core.types import InstanceState, Prototype
from irsd.perception.commonness import commonness
from irsd.perception.prototypes import Example, liken

Floats = NDArray[np.float32]
UNKNOWN = "object"
_MOVED_M = 0.02  # a side that moved by less, half a voxel, has not
_WHOLES = 256  # parts of the map whose vector is kept


@dataclass(frozen=True)
class NamingSettings:
    """How irsd's own eyes name things."""

    shape_share: float = setting(0.65, "weight of the shape in a name, against the pictures", lo=0.0, hi=1.0)
    both: float = setting(1.4, "how much more shape and pictures together tell than one of them", lo=1.0, hi=2.0)
    commonness: float = setting(
        0.7,
        "how far a name's being common counts: 0 not at all, 1 as if every building were the usual one",
        lo=0.0,
        hi=2.0,
    )
    shapes_per_step: int = setting(6, "clouds encoded per step of the graph; the others wait", lo=1, hi=1000)
    changed_share: float = setting(
        0.05, "a cloud that grew or shrank by less keeps its shape's embedding", lo=0.0, hi=10.0
    )
    top_labels: int = setting(5, "names given with a thing", lo=1, hi=50)


class Shapes(Protocol):
    """Point clouds as vectors in the space of the names."""

    def encode(self, clouds: Sequence[Floats], floor_z_m: float) -> Floats:
        """float32 [n, D], unit rows (zero: says nothing), of n clouds float32 [k, 3] in the map frame above a floor at floor_z_m."""
        ...


Embed = Callable[[Sequence[str]], Floats]


@dataclass(frozen=True, slots=True)
class _Encoded:
    """A cloud's vector, None where it says nothing, and its points and extent then."""

    shape: Floats | None
    points: int
    extent_m: Floats


@dataclass(slots=True)
class _Known:
    """What is known of one thing: the state as fusion told it, and its cloud as it was encoded."""

    state: InstanceState
    encoded: _Encoded | None = None


class Namer:
    """Owner of the shapes' vectors. One thread."""

    def __init__(
        self,
        settings: NamingSettings,
        shapes: Shapes,
        embed: Embed,
        vocabulary: Sequence[str],
        *,
        scale: float,
        min_probability: float,
    ) -> None:
        """embed: names to unit vectors float32 [n, D]; vocabulary: the names that things may get. scale: of cosines to logits;
        min_probability: a best name with a smaller chance is not given, the thing is an ``UNKNOWN``."""
        self._settings, self._shapes = settings, shapes
        self._scale, self._min_probability = scale, min_probability
        self._names = tuple(dict.fromkeys([*vocabulary, UNKNOWN]))
        self._vectors = np.asarray(embed(self._names), np.float32)
        self._common = settings.commonness * np.log(commonness(self._names))
        self._known: dict[int, _Known] = {}
        self._wholes: dict[int, _Encoded] = {}  # parts of the map by number, the latest asked for last
        self._waiting: dict[int, None] = {}
        self._examples: tuple[Example, ...] = ()
        self._taught: tuple[Prototype, ...] = ()

    def learn(self, taught: tuple[Prototype, ...]) -> None:
        """What operators taught, all of it; things are named anew as they change."""
        if taught == self._taught:
            return
        self._taught = taught
        shapes = self._shapes.encode([p.points_m for p in taught], 0.0)
        self._examples = tuple(Example(p.name, shape, p.embedding) for p, shape in zip(taught, shapes, strict=True))
        self._waiting.update(dict.fromkeys(sorted(self._known)))

    def name(
        self, changed: Iterable[InstanceState], ended: Iterable[int], floor_z_m: Callable[[int], float]
    ) -> tuple[InstanceState, ...]:
        """The changed states with names, and those that got another name because their turn has come, by id.

        floor_z_m: height of the floor in the room of an id.
        """
        due: dict[int, None] = {}
        for state in changed:
            known = self._known.get(state.id)
            if known is None:
                self._known[state.id] = known = _Known(state)
            known.state = state
            due[state.id] = None
            if self._has_changed(known.encoded, state.points_map):
                self._waiting[state.id] = None
        for instance_id in ended:
            if instance_id not in due:
                self._known.pop(instance_id, None)
                self._waiting.pop(instance_id, None)
        for instance_id in list(self._waiting)[: self._settings.shapes_per_step]:
            del self._waiting[instance_id]
            known = self._known[instance_id]
            known.encoded = self._encode(known.state.points_map, floor_z_m(known.state.room))
            due[instance_id] = None
        return tuple(self._named(self._known[i]) for i in sorted(due))

    def _has_changed(self, encoded: _Encoded | None, points_map: Floats) -> bool:
        """Whether the cloud is much another one than that which was encoded."""
        share = self._settings.changed_share
        if encoded is None or abs(len(points_map) - encoded.points) > share * encoded.points:
            return True
        return bool((np.abs(_extent(points_map) - encoded.extent_m) > share * encoded.extent_m + _MOVED_M).any())

    def _encode(self, points_map: Floats, floor_z_m: float) -> _Encoded:
        vector = self._shapes.encode([points_map], floor_z_m)[0]
        return _Encoded(vector if vector.any() else None, len(points_map), _extent(points_map))

    def _named(self, known: _Known) -> InstanceState:
        image = known.state.embedding
        image = image if image is not None and image.shape == self._vectors.shape[1:] else None
        return replace(
            known.state, labels=self.rank(known.encoded.shape if known.encoded else None, image), score_kind="chances"
        )

    def name_of(self, number: int, points_map: Floats, floor_z_m: float) -> tuple[str, float]:
        """Name and chance of a part of the map by its shape alone; ``UNKNOWN`` where none is likely enough.

        points_map: float32 [k, 3] above a floor at floor_z_m; encoded anew only when the part of that number has changed by much.
        """
        whole = self._wholes.pop(number, None)
        if whole is None or self._has_changed(whole, points_map):
            whole = self._encode(points_map, floor_z_m)
        self._wholes[number] = whole
        if len(self._wholes) > _WHOLES:
            del self._wholes[next(iter(self._wholes))]
        return self.rank(whole.shape, None)[0]

    def rank(self, shape: Floats | None, image: Floats | None) -> tuple[tuple[str, float], ...]:
        """(name, chance) best first of a thing with unit vectors float32 [D]; ``UNKNOWN`` first where no name is likely enough."""
        if shape is None and image is None:
            return ((UNKNOWN, 1.0),)
        share = 0.0 if shape is None else 1.0 if image is None else self._settings.shape_share
        scale = self._scale * (1.0 if shape is None or image is None else self._settings.both)
        by = np.zeros((2, len(self._names)))
        by[0] = 0.0 if shape is None else self._vectors @ shape
        by[1] = 0.0 if image is None else self._vectors @ image
        likely = scale * (share * by[0] + (1 - share) * by[1]) + self._common
        at = dict(zip(self._names, likely.tolist(), strict=True))
        for name, (by_shape, by_image) in liken(self._examples, shape, image).items():
            at[name] = max(at.get(name, -np.inf), scale * (share * by_shape + (1 - share) * by_image))
        names, values = list(at), np.array(list(at.values()))
        chance = np.exp(values - values.max())
        chance /= chance.sum()
        order = sorted(range(len(names)), key=lambda k: (-chance[k], names[k]))
        best = [(names[k], _down(float(chance[k]))) for k in order if names[k] != UNKNOWN]
        unknown = _down(float(chance[names.index(UNKNOWN)]))
        if best[0][1] >= self._min_probability and best[0][1] > unknown:
            return tuple(best[: self._settings.top_labels])
        # Nothing is likely enough: what the names that are told leave over is the chance of none of them, and it is told first.
        best = best[: self._settings.top_labels - 1]
        told = sum(share for _, share in best)
        none = max(unknown, 1.0 - told, best[0][1])
        shrink = min(1.0, (1.0 - none) / told) if told > 0 else 1.0
        return ((UNKNOWN, _down(none)), *((name, _down(share * shrink)) for name, share in best))


def _extent(points: Floats) -> Floats:
    return np.asarray(points.max(0) - points.min(0), np.float32)


def _down(value: float) -> float:
    """Rounded down, so that chances never add up to more than one."""
    return int(value * 1e6) / 1e6
