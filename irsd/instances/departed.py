"""Things that were found gone: told of for a while, then ended, and recognised where they turn up again."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from irsd.core.times import is_due
from irsd.core.types import InstanceState
from irsd.instances.change import ChangeSettings
from irsd.instances.voxels import Floats

_MOST = 256  # departed things that are remembered
_SMALLEST, _LARGEST = 0.6, 1.35  # of its old extents: what has just been found again is not yet seen from all sides
_SLACK_M = 0.08
_LEAST_COSINE = 0.8
_YOUNG_NS = 30_000_000_000  # how long a new thing may turn out to be an old one
_PLACE_M = 0.5
_LOOKS = 3  # after so many looks a place is known


@dataclass(slots=True)
class Departed:
    """The ids, last states and times of what is gone."""

    settings: ChangeSettings
    _told: dict[int, int] = field(default_factory=dict)
    _untold: dict[int, InstanceState] = field(default_factory=dict)
    _remembered: dict[int, tuple[InstanceState, int]] = field(default_factory=dict)

    def leave(self, state: InstanceState, stamp_ns: int) -> None:
        """An instance was found gone."""
        gone = replace(state, existence=0.0, state="gone")
        self._untold[state.id] = gone
        self._told[state.id] = stamp_ns
        self._remembered[state.id] = (state, stamp_ns)
        while len(self._remembered) > _MOST:
            self._remembered.pop(next(iter(self._remembered)))

    def tell(self, stamp_ns: int) -> tuple[list[InstanceState], list[int]]:
        """(states of what has just gone, ids of what was told of as gone for long enough)."""
        told = [self._untold[i] for i in sorted(self._untold)]
        self._untold.clear()
        keep_ns, remember_ns = (round(t * 1e9) for t in (self.settings.keep_s, self.settings.remember_s))
        over = [i for i, at_ns in self._told.items() if stamp_ns >= at_ns + keep_ns]
        for instance_id in over:
            del self._told[instance_id]
        for instance_id in [i for i, (_, at_ns) in self._remembered.items() if stamp_ns > at_ns + remember_ns]:
            del self._remembered[instance_id]
        return told, over

    def recognise(self, new: InstanceState) -> InstanceState | None:
        """The one departed thing that a new instance can be; None when there is none, or more than one."""
        alike = [old for old, _ in self._remembered.values() if is_same(old, new)]
        return alike[0] if len(alike) == 1 else None

    def recognised_by(self, old: InstanceState, present: Iterable[InstanceState]) -> InstanceState | None:
        """The one instance that a thing, just found gone, can be; None when there is none, or more than one."""
        alike = [new for new in present if is_same(old, new)]
        return alike[0] if len(alike) == 1 else None

    def back(self, instance_id: int) -> None:
        """A departed thing was found again: it is told of no more."""
        for known in (self._told, self._untold, self._remembered):
            known.pop(instance_id, None)


def is_same(old: InstanceState, new: InstanceState) -> bool:
    """Whether a thing that vanished can be one that appeared since: same name, meaning and size, and new when it was found.

    Extents are height and the two along the main directions in plan.
    """
    if new.first_seen_ns <= old.last_seen_ns or new.last_seen_ns - new.first_seen_ns > _YOUNG_NS:
        return False
    if not old.labels or not new.labels or old.labels[0][0] != new.labels[0][0]:
        return False
    one, two = old.embedding, new.embedding
    if one is not None and two is not None and (len(one) != len(two) or float(one @ two) < _LEAST_COSINE):
        return False
    return same_size(old.points_map, new.points_map)


def same_size(old: Floats, new: Floats) -> bool:
    """Whether points [n, 3] can be of one body, the new ones not yet seen from all sides."""
    before, after = extents(old), extents(new)
    return bool((after >= _SMALLEST * before - _SLACK_M).all() and (after <= _LARGEST * before + _SLACK_M).all())


def extents(points: Floats) -> NDArray[np.float64]:
    """[3] metres: height, length and width in plan of points float32 [n, 3], each between the 2nd and the 98th percentile."""
    centred = points[:, :2] - points[:, :2].mean(0)
    _, axes = np.linalg.eigh(centred.T.astype(np.float64) @ centred + 1e-9 * np.eye(2))
    values = np.column_stack([points[:, 2], centred @ axes[:, ::-1]])
    low, high = np.percentile(values, [2, 98], axis=0)
    return np.asarray(high - low, np.float64)


@dataclass(slots=True)
class KnownPlaces:
    """Since when the camera has known a place of the plan: only what appears where nothing was before can have moved there."""

    period_ns: int
    _looks: dict[int, int] = field(default_factory=dict)
    _since_ns: dict[int, int] = field(default_factory=dict)
    _due_ns: int = -(1 << 62)

    def look(self, points_map: Floats, stamp_ns: int) -> None:
        """The camera saw points float32 [n, 3]."""
        if not is_due(stamp_ns, self._due_ns, self.period_ns) or not len(points_map):
            return
        self._due_ns = stamp_ns + self.period_ns
        for place in _places(points_map[::4]):
            count = self._looks.get(place, 0) + 1
            self._looks[place] = count
            if count == _LOOKS:
                self._since_ns[place] = stamp_ns

    def known(self, points_map: Floats, at_ns: int) -> bool:
        """Whether most of the places of points [n, 3] were known before a time."""
        places = _places(points_map)
        return 2 * sum(self._since_ns.get(place, at_ns) < at_ns for place in places) >= len(places)


def _places(points: Floats) -> list[int]:
    cells = np.floor(points[:, :2] / _PLACE_M).astype(np.int64)
    return list(np.unique((cells[:, 0] << 32) + cells[:, 1]).tolist())
