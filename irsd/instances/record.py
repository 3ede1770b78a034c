"""What the memory keeps of one instance beside its voxels: counts, meaning and names."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from irsd.instances.voxels import Floats, Rows

Embed = Callable[[Sequence[str]], NDArray[np.float32]]

NO_ROWS = np.zeros(0, np.int32)
_VIEWS = 16
_SAME_NAME = 0.98  # label vectors closer than this are one name in other words (aliases map to the same vector)


class Names:
    """Label vectors, and which names mean the same: the vectors of one group are closer than ``_SAME_NAME``."""

    def __init__(self, embed: Embed) -> None:
        self._embed = embed
        self._vector: dict[str, Floats] = {}
        self._group: dict[str, int] = {}
        self._heads: list[Floats] = []

    def vector(self, name: str) -> Floats:
        """Unit vector float32 [D] of a name; asked for once."""
        if name not in self._vector:
            self._vector[name] = np.asarray(self._embed([name]), np.float32)[0]
        return self._vector[name]

    def group(self, name: str) -> int:
        """Number of the group of names that mean the same; the first name of a group stands for it."""
        if name not in self._group:
            vector = self.vector(name)
            close = np.flatnonzero([head @ vector >= _SAME_NAME for head in self._heads])
            if not len(close):
                self._heads.append(vector)
            self._group[name] = int(close[0]) if len(close) else len(self._heads) - 1
        return self._group[name]


class Numbers(NamedTuple):
    """What ``Things`` hold of an instance: its numbers in their order but id and mean, and the direction of the mean, float16 [D]."""

    scalars: array[float]
    mean: NDArray[np.float16]


@dataclass(slots=True)
class Instance:
    """One instance beside its numbers in ``Things``. rows: chunks of the rows it ever claimed; owned: those it owned.

    ascending: so many rows of the first chunk are in order.

    beside: id of another instance -> (pictures in which one mask covered both, pictures in which each had its own).
    moved: it stands elsewhere than where it was first found. views: the last pictures that had a mask of it.
    blocks: keys of blocks at rest that hold voxels of it (see ``attic``); outline: some of its points float32 [k, 3] meanwhile.
    box_xy: (x0, y0, x1, y1) of its points, good for as long as ``boxed`` is what it owns or its outline.
    numbers: what ``Things`` held of it, while it has no slot (slot = NOBODY).
    """

    id: int
    slot: int
    first_seen_ns: int
    last_seen_ns: int = 0
    last_view: int = 0
    group_score: dict[int, float] = field(default_factory=dict)
    name_score: dict[str, float] = field(default_factory=dict)
    rows: list[Rows] = field(default_factory=list)
    ascending: int = 0
    owned: Rows = field(default_factory=lambda: NO_ROWS)
    published: bool = False
    moved: bool = False
    beside: dict[int, tuple[int, int]] = field(default_factory=dict)
    views: array[int] = field(default_factory=lambda: array("i"))
    blocks: array[int] = field(default_factory=lambda: array("q"))
    outline: Floats | None = None
    boxed: Rows | Floats | None = None
    box_xy: array[float] = field(default_factory=lambda: array("f"))
    numbers: Numbers | None = None

    @property
    def somewhere(self) -> bool:
        """Whether it owns any voxel, be it at rest."""
        return bool(len(self.owned) or self.blocks)

    def seen_in(self, view: int) -> None:
        """A picture had a mask of it."""
        self.last_view = view
        self.views.append(view)
        del self.views[:-_VIEWS]

    def add_label(self, name: str, group: int, score: float) -> None:
        self.group_score[group] = self.group_score.get(group, 0.0) + score
        self.name_score[name] = self.name_score.get(name, 0.0) + score

    def main_group(self) -> int:
        """Number of the group of names that it was called by most."""
        return max(self.group_score, key=lambda group: self.group_score[group])

    def compare(self, other: Instance, together: int, apart: int) -> None:
        """Note on both sides in how many pictures they were covered together and in how many they were apart."""
        noted = self.beside.get(other.id, (0, 0))
        self.beside[other.id] = other.beside[self.id] = (noted[0] + together, noted[1] + apart)

    def mostly_beside(self, other: Instance) -> bool:
        """Whether pictures had a mask of each too often for two parts of one thing, compared with those that had one mask.

        Two things that touch are mostly seen together; one thing is seldom cut in two. Pictures before both were known don't count.
        """
        if not self.views or not other.views:
            return False
        since = max(self.views[0], other.views[0])
        mine, his = ({v for v in views if v >= since} for views in (self.views, other.views))
        return len(mine ^ his) < 2 * len(mine & his)

    def take_over(self, other: Instance) -> None:
        """Add what is known of another instance that proved to be this one (voxels and numbers are the arrays' affair)."""
        self.first_seen_ns = min(self.first_seen_ns, other.first_seen_ns)
        self.last_seen_ns = max(self.last_seen_ns, other.last_seen_ns)
        self.last_view = max(self.last_view, other.last_view)
        self.views = array("i", sorted({*self.views, *other.views})[-_VIEWS:])
        for group, score in other.group_score.items():
            self.group_score[group] = self.group_score.get(group, 0.0) + score
        for name, score in other.name_score.items():
            self.name_score[name] = self.name_score.get(name, 0.0) + score

    def labels(self, names: Names, count: int) -> tuple[tuple[str, float], ...]:
        """(most frequent name of a group, the group's share of all scores), best first; the name decides among equals."""
        total = sum(self.group_score.values()) or 1.0
        best: dict[int, tuple[float, str]] = {}
        for name, score in self.name_score.items():
            group = names.group(name)
            best[group] = min(best.get(group, (np.inf, "")), (-score, name))
        ranked = sorted((-score / total, best[group][1]) for group, score in self.group_score.items())
        # Rounded down, so that the shares never add up to more than one.
        return tuple((name, int(-score * 1e6) / 1e6) for score, name in ranked[:count])
