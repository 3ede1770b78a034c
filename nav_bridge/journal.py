"""The goal under way, on disk: a bridge that was killed while it drove knows at its next start what it owes, and to whom."""

from __future__ import annotations

import json
import logging
import os
from dataclasses import asdict, dataclass
from pathlib import Path

from irsd.core.runtime import wall_clock_ns

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Entry:
    """A goal as it was driven last. target: id of the instance or room; plan_seq: number of the last plan; map_id: irsd's map."""

    goal_id: str
    query: str
    target: str
    within_m: float
    priority: int
    plan_seq: int
    map_id: str


class Journal:
    """One file, replaced whole; None: nothing is kept. A disk that fails costs the resuming, never the drive."""

    def __init__(self, path: Path | None) -> None:
        self._path = path

    def write(self, entry: Entry) -> None:
        """The goal that is driven from now on."""
        if self._path is None:
            return
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            new = self._path.with_suffix(".new")
            new.write_text(json.dumps(asdict(entry)) + "\n", encoding="utf-8")
            new.replace(self._path)
        except OSError as error:
            _log.warning("the goal under way is not on disk: %s", error)

    def touch(self) -> None:
        """The drive goes on: how old the file is says how long ago that was true."""
        if self._path is not None and self._path.exists():
            os.utime(self._path)

    def clear(self) -> None:
        """No goal is under way."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)

    def read(self) -> tuple[Entry, float] | None:
        """The goal that was under way and how many seconds ago it was last driven; None when there was none."""
        if self._path is None:
            return None
        try:
            entry = Entry(**json.loads(self._path.read_text(encoding="utf-8")))
            age_s = wall_clock_ns() * 1e-9 - self._path.stat().st_mtime
        except FileNotFoundError:
            return None
        except (OSError, ValueError, TypeError) as error:
            _log.warning("%s is unreadable and dropped: %s", self._path, error)
            self.clear()
            return None
        return entry, age_s
