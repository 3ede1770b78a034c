"""How irsd is doing: stage times, heartbeats, faults, the status document, and word to systemd."""

from __future__ import annotations

import os
import socket
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
    sensor_stale_s: float = setting(2.0, "a lidar or odometry silent for longer is a fault", lo=0.1, hi=600.0)
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


class ProcessMeter:
    """CPU and memory of this process. One caller."""

    def __init__(self) -> None:
        self._process = psutil.Process()
        self._process.cpu_percent()  # the first call sets the mark, the next ones measure from it

    def read(self) -> dict[str, float]:
        """cpu_cores since the last call (1.0 = one core busy), rss_mb, threads."""
        return {
            "cpu_cores": round(self._process.cpu_percent() / 100.0, 3),
            "rss_mb": round(self._process.memory_info().rss / 1e6, 1),
            "threads": self._process.num_threads(),
        }


def find_faults(
    settings: HealthSettings,
    *,
    sensors: Mapping[str, Mapping[str, Any]],
    late_threads: Sequence[str] = (),
    failures: int = 0,
    last_failure: str = "",
    store_error: str = "",
    perception: Mapping[str, Any] | None = None,
) -> list[dict[str, str]]:
    """What an operator should look at: each with a code that scripts can match and a text that people read.

    sensors: as ``Ingest.sensors`` gives them. failures: steps that failed in a row up to now. perception: the governor's report.
    """
    faults = []
    for topic, sensor in sensors.items():
        age_s = sensor["age_s"]
        if sensor["kind"] in ("lidar", "odometry"):
            if age_s is None:
                faults.append(_fault("sensor_missing", f"{topic}: nothing received yet"))
            elif age_s > settings.sensor_stale_s:
                faults.append(_fault("sensor_stale", f"{topic}: silent for {age_s:.1f} s"))
        if sensor["bad"] and not sensor["decoded"]:
            faults.append(_fault("sensor_undecodable", f"{topic}: no message could be used: {sensor['last_error']}"))
    faults += [_fault("thread_late", f"thread {name} makes no progress") for name in late_threads]
    if failures:
        faults.append(_fault("step_failing", f"the last {failures} steps failed: {last_failure}"))
    if perception and perception.get("why"):
        faults.append(_fault("budget", f"perception at '{perception['rung']}': {perception['why']}"))
    if store_error:
        faults.append(_fault("store", store_error))
    return faults


def _fault(code: str, text: str) -> dict[str, str]:
    return {"code": code, "text": text}


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
    faults: Sequence[Mapping[str, str]],
    process: Mapping[str, float],
    counts: Mapping[str, int],
    rooms_age_s: float | None = None,
    perception: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The document under ``irs/<robot>/status``; drops names only what was dropped.

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
        "faults": [dict(fault) for fault in faults],
        **process,
    }


# ------------------------------------------------------------------------------------------------------------- systemd
def notify(state: str) -> bool:
    """A line of sd_notify(3), such as ``READY=1``; False when no one asked for it ($NOTIFY_SOCKET is not set)."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return False
    if address.startswith("@"):  # an abstract socket
        address = "\0" + address[1:]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as channel:
        channel.sendto(state.encode(), address)
    return True


def watchdog_period_s() -> float | None:
    """How often systemd wants to hear ``WATCHDOG=1``: half of WatchdogSec, None when it does not watch this process."""
    microseconds = os.environ.get("WATCHDOG_USEC", "")
    watched = os.environ.get("WATCHDOG_PID", str(os.getpid()))
    if not microseconds.isdigit() or int(microseconds) == 0 or watched != str(os.getpid()):
        return None
    return int(microseconds) / 2e6


def status_line(document: Mapping[str, Any]) -> str:
    """One line for ``systemctl status``."""
    graph = document["graph"]
    lidar = next((s for s in document["sensors"].values() if s["kind"] == "lidar"), None)
    rate = f", lidar {lidar['rate_hz']:.1f} Hz" if lidar else ""
    faults = "; ".join(fault["text"] for fault in document["faults"])
    return f"{graph['rooms']} rooms, {graph['instances']} things{rate}{'; ' + faults if faults else ''}"
