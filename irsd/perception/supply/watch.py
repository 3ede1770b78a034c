"""What goes through the networks of a model while its adapter works: shapes, times, and the inputs themselves for calibration."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irsd.perception.models import Cancel, Session

Feeds = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class Call:
    """One run of one network. shapes: of all inputs and outputs that went through, by name, with their dtype."""

    path: Path
    shapes: Mapping[str, tuple[str, tuple[int, ...]]]
    wall_ms: float
    cpu_ms: float


@dataclass(slots=True)
class Watch:
    """The calls so far. keep: of how many calls per file the inputs are kept, in ``feeds``; stand_ins: files to run instead.

    opened: the sessions by the file that was asked for."""

    keep: int = 0
    stand_ins: Mapping[Path, Path] = field(default_factory=dict)
    opened: dict[Path, Session] = field(default_factory=dict)
    calls: list[Call] = field(default_factory=list)
    feeds: dict[str, list[Feeds]] = field(default_factory=dict)

    def open_session(self, path: Path, **options: Any) -> Session:
        """As ``Session``, watched."""
        self.opened[path] = WatchedSession(self, self.stand_ins.get(path, path), **options)
        return self.opened[path]


class WatchedSession(Session):
    """A Session that tells its watch."""

    def __init__(self, watch: Watch, path: Path, **options: Any) -> None:
        super().__init__(path, **options)
        self._watch = watch

    def run(self, feeds: Feeds, outputs: tuple[str, ...], cancel: Cancel | None = None) -> tuple[NDArray[Any], ...]:
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        values = super().run(feeds, outputs, cancel)
        wall_ms, cpu_ms = (time.perf_counter() - wall_s) * 1e3, (time.process_time() - cpu_s) * 1e3
        named = {**feeds, **dict(zip(outputs, values, strict=True))}
        shapes = {name: (str(value.dtype), tuple(value.shape)) for name, value in named.items()}
        self._watch.calls.append(Call(self.path, shapes, wall_ms, cpu_ms))
        kept = self._watch.feeds.setdefault(self.path.name, [])
        if len(kept) < self._watch.keep:
            kept.append({name: np.array(value) for name, value in feeds.items()})
        return values
