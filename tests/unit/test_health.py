"""Stage times, heartbeats, faults, status, and the datagrams systemd reads."""

from __future__ import annotations

import os
import socket
from pathlib import Path
from typing import Any

import pytest

from irsd.core.systemd import notify, watchdog_period_s
from irsd.health import (
    Heartbeats,
    ProcessMeter,
    StageTimes,
    status_document,
    status_line,
)


def sensor(**values: Any) -> dict[str, Any]:
    base = {"kind": "lidar", "rate_hz": 9.8, "received": 5, "decoded": 5, "bad": 0, "dropped": 0, "last_error": ""}
    return {**base, "age_s": 0.1, **values}


def test_no_stage_no_times() -> None:
    assert StageTimes().summary() == {}


def test_percentiles_over_the_window() -> None:
    times = StageTimes(window=100)
    for ms in range(200):
        times.add({"mapping": float(ms), **({"rooms": 7.0} if ms == 0 else {})})
    summary = times.summary()
    assert list(summary) == ["mapping", "rooms"]
    assert summary["mapping"] == {"runs": 200, "p50_ms": 149.5, "p95_ms": 194.05, "max_ms": 199.0}
    assert summary["rooms"]["runs"] == 1


def test_a_silent_thread_is_late_and_an_ended_one_is_not() -> None:
    beats = Heartbeats(limit_s=5.0)
    assert beats.late(0.0) == []
    beats.beat("map", 0.0)
    beats.beat("publish", 4.0)
    assert beats.late(5.0) == []
    assert beats.late(6.0) == ["map"]
    beats.end("map")
    assert beats.late(100.0) == ["publish"]


def document(**values: Any) -> dict[str, Any]:
    base: dict[str, Any] = {
        "seq": 3,
        "robot": "r",
        "version": "1",
        "uptime_s": 1.23456,
        "frame": "map",
        "sensors": {"/lidar/points": sensor()},
        "blocked_by": None,
        "stages": {},
        "drops": {"a": 0, "b": 2},
        "graph": {"rooms": 2, "instances": 5, "seq": 9},
        "lag_s": None,
        "faults": [],
        "process": ProcessMeter().read(),
        "counts": {},
    }
    return status_document(**{**base, **values})


def test_status_document() -> None:
    status = document(lag_s=0.12345)
    assert (status["schema"], status["seq"], status["frame"]) == ("irs/status/1", 3, "map")
    assert status["drops"] == {"b": 2}
    assert status["lag_s"] == 0.123
    assert status["rss_mb"] > 1
    assert status["threads"] >= 1
    assert status["cpu_cores"] >= 0
    assert status_line(status) == "2 rooms, 5 things, lidar 9.8 Hz"
    assert status_line(document(faults=[{"code": "x", "text": "disk full"}])).endswith("; disk full")


def test_nobody_to_notify(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    assert not notify("READY=1")


@pytest.mark.parametrize("abstract", [False, True])
def test_notify_reaches_the_socket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, abstract: bool) -> None:
    name = f"@irsd-test-{os.getpid()}" if abstract else str(tmp_path / "n")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as server:
        server.bind("\0" + name[1:] if abstract else name)
        monkeypatch.setenv("NOTIFY_SOCKET", name)
        assert notify("READY=1")
        assert server.recv(64) == b"READY=1"


def test_nobody_who_listens_holds_us_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as server:
        server.bind(str(tmp_path / "n"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "n"))
        told = 0
        while notify("STATUS=x"):  # until its queue is full
            told += 1
        assert 0 < told < 100_000


@pytest.mark.parametrize(
    ("microseconds", "pid", "period_s"),
    [(None, None, None), ("0", None, None), ("x", None, None), ("20000000", None, 10.0), ("20000000", "1", None)],
)
def test_watchdog_period(
    monkeypatch: pytest.MonkeyPatch, microseconds: str | None, pid: str | None, period_s: float | None
) -> None:
    for name, value in (("WATCHDOG_USEC", microseconds), ("WATCHDOG_PID", pid)):
        monkeypatch.delenv(name, raising=False)
        if value is not None:
            monkeypatch.setenv(name, value)
    assert watchdog_period_s() == period_s
