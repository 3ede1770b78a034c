"""How irsd is doing: stage times, heartbeats, clock and disk, the status document."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from irsd.core.runtime import Guarded, monotonic_s
from irsd.core.settings import setting

STATUS_SCHEMA = "irs/status/1"


@dataclass(frozen=True, slots=True)
class HealthSettings:
    """When something counts as a fault."""

    status_period_s: float = setting(1.0, "how often status is published", lo=0.1, hi=60.0)
    sensor_stale_s: float = setting(1.5, "a sensor silent for longer is a fault", lo=0.1, hi=600.0)
    bad_messages: int = setting(
        5, "so many messages of a topic in a row that can't be used are a fault", lo=1, hi=10000
    )
    lag_limit_s: float = setting(3.0, "a sweep that takes longer into the graph is a fault", lo=0.1, hi=600.0)
    min_free_mb: float = setting(200.0, "less free space where the map is kept is a fault", lo=0.0)
    thread_limit_s: float = setting(
        15.0, "a thread silent for longer is a fault, and systemd is no longer told that irsd lives", lo=1.0, hi=600.0
    )
    max_failures: int = setting(20, "steps failing in a row before irsd gives up (exit code 1)", lo=1, hi=10000)


class StageTimes:
    """Wall milliseconds per stage over the last ``window`` runs of each. Any thread may add or ask."""

    def __init__(self, window: int = 512) -> None:
        self._window = window
        self._times: Guarded[dict[str, deque[float]]] = Guarded({})
        self._counts: dict[str, int] = {}

    def add(self, stage_ms: Mapping[str, float]) -> None:
        """The times of one step."""
        with self._times.locked() as times:
            for stage, ms in stage_ms.items():
                times.setdefault(stage, deque(maxlen=self._window)).append(ms)
                self._counts[stage] = self._counts.get(stage, 0) + 1

    def summary(self) -> dict[str, dict[str, float]]:
        """Per stage, sorted by name: runs (since the start) and p50_ms, p95_ms, max_ms (of the window)."""
        with self._times.locked() as times:
            copy = {stage: list(values) for stage, values in times.items()}
            counts = dict(self._counts)
        out = {}
        for stage in sorted(copy):
            p50, p95, top = np.percentile(np.array(copy[stage]), (50, 95, 100))
            out[stage] = {
                "runs": counts[stage],
                "p50_ms": round(float(p50), 2),
                "p95_ms": round(float(p95), 2),
                "max_ms": round(float(top), 2),
            }
        return out


class Heartbeats:
    """Proof of life of each thread: it beats while it makes progress, and only then."""

    def __init__(self, limit_s: float) -> None:
        self._limit_s = limit_s
        self._beats: Guarded[dict[str, float]] = Guarded({})

    def beat(self, thread: str, now_s: float | None = None) -> None:
        with self._beats.locked() as beats:
            beats[thread] = monotonic_s() if now_s is None else now_s

    def end(self, thread: str) -> None:
        """The thread has finished its work and is no longer expected to beat."""
        with self._beats.locked() as beats:
            beats.pop(thread, None)

    def ages_s(self, now_s: float) -> dict[str, float]:
        """Seconds since each thread's last beat."""
        with self._beats.locked() as beats:
            return {name: round(now_s - beat, 2) for name, beat in sorted(beats.items())}

    def late(self, now_s: float) -> list[str]:
        """Threads that have not beaten within the limit."""
        return [name for name, age in self.ages_s(now_s).items() if age > self._limit_s]


class WallClock:
    """Watches the system's clock for steps, against the one that never jumps. One caller."""

    def __init__(self, limit_s: float = 1.0, shown_s: float = 20.0) -> None:
        self._limit_s, self._shown_s = limit_s, shown_s
        self._ahead_s: float | None = None
        self._step_s, self._until_s = 0.0, 0.0

    def step_s(self, now_s: float, wall_ns: int) -> float:
        """How far the clock was set lately, seconds; 0 when it was not. Slow steering (NTP) is no step."""
        ahead_s = wall_ns * 1e-9 - now_s
        if self._ahead_s is not None and abs(ahead_s - self._ahead_s) > self._limit_s:
            self._step_s, self._until_s = ahead_s - self._ahead_s, now_s + self._shown_s
        self._ahead_s = ahead_s
        return self._step_s if now_s < self._until_s else 0.0


def disk_state(directory: Path) -> tuple[float | None, bool]:
    """(free MB, whether it can be written) of the disk that holds a directory; free MB is None where it can't be asked."""
    try:
        stats = os.statvfs(directory)
    except OSError:
        return None, False
    writable = not stats.f_flag & os.ST_RDONLY and os.access(directory, os.W_OK)
    return stats.f_bavail * stats.f_frsize / 1e6, writable


class ProcessMeter:
    """CPU, memory, threads and files of this process. One caller."""

    def __init__(self) -> None:
        self._process = psutil.Process()
        self._process.cpu_percent()  # the first call sets the mark, the next ones measure from it

    def read(self) -> dict[str, float]:
        """cpu_cores since the last call (1.0 = one core busy), rss_mb, threads, open files."""
        return {
            "cpu_cores": round(self._process.cpu_percent() / 100.0, 3),
            "rss_mb": round(self._process.memory_info().rss / 1e6, 1),
            "threads": self._process.num_threads(),
            "files": self._process.num_fds(),
        }


def status_document(
    *,
    seq: int,
    robot: str,
    version: str,
    uptime_s: float,
    frame: str,
    sensors: Mapping[str, Mapping[str, Any]],
    blocked_by: str | None,
    stages: Mapping[str, Mapping[str, float]],
    drops: Mapping[str, int],
    graph: Mapping[str, int],
    lag_s: float | None,
    faults: Sequence[Mapping[str, Any]],
    process: Mapping[str, float],
    counts: Mapping[str, int],
    rooms_age_s: float | None = None,
    perception: Mapping[str, Any] | None = None,
    faults_ended: Sequence[Mapping[str, Any]] = (),
    queues: Mapping[str, int] | None = None,
) -> dict[str, Any]:
    """The document under ``irs/<robot>/status``; drops names only what was dropped. queues: items that wait, by place.

    rooms_age_s: since the newest sweep that the rooms took in was received. perception: the governor's report; None without eyes.
    """
    return {
        "schema": STATUS_SCHEMA,
        "seq": seq,
        "frame": frame,
        "robot": robot,
        "version": version,
        "uptime_s": round(uptime_s, 1),
        "sensors": {name: dict(sensor) for name, sensor in sensors.items()},
        "blocked_by": blocked_by,
        "stages": {name: dict(times) for name, times in stages.items()},
        "drops": {name: count for name, count in sorted(drops.items()) if count},
        "counts": {name: count for name, count in sorted(counts.items()) if count},
        "graph": dict(graph),
        "lag_s": None if lag_s is None else round(lag_s, 3),
        "rooms_age_s": None if rooms_age_s is None else round(rooms_age_s, 3),
        "perception": None if perception is None else dict(perception),
        "queues": dict(queues or {}),
        "faults": [dict(fault) for fault in faults],
        "faults_ended": [dict(fault) for fault in faults_ended],
        **process,
    }


def status_line(document: Mapping[str, Any]) -> str:
    """One line for ``systemctl status``."""
    graph = document["graph"]
    lidar = next((s for s in document["sensors"].values() if s["kind"] == "lidar"), None)
    rate = f", lidar {lidar['rate_hz']:.1f} Hz" if lidar else ""
    faults = "; ".join(fault["text"] for fault in document["faults"])
    return f"{graph['rooms']} rooms, {graph['instances']} things{rate}{'; ' + faults if faults else ''}"
