"""irsctl top and metrics: the status as a live table, and as Prometheus reads it."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator, Mapping
from typing import Any

import click

from irsd.core.runtime import Ring
from irsd.ctl.link import Target, ask_json, connected
from irsd.ctl.live import fault_lines
from irsd.io.session import Sample

_CLEAR = "\x1b[H\x1b[2J"
_SILENT_S = 5.0


def top(target: Target, count: int | None) -> int:
    """The table, anew with every status, until interrupted or ``count`` times."""
    with connected(target) as (session, keys):
        statuses: Ring[Sample] = Ring(2)
        with session.subscribe(keys.status, statuses):
            shown = 0
            while count is None or shown < count:
                sample = statuses.get(_SILENT_S)
                if sample is None:
                    click.echo(f"no status for {_SILENT_S:g} s: is irsd alive?", err=True)
                    return 1
                clear = _CLEAR if sys.stdout.isatty() else ""
                click.echo(clear + "\n".join(table(json.loads(sample.payload))))
                shown += 1
    return 0


def table(status: Mapping[str, Any]) -> list[str]:
    """The lines of the table."""
    graph, lag_s = status.get("graph", {}), status.get("lag_s")
    lines = [
        f"{status.get('robot')}  up {status.get('uptime_s', 0):.0f} s   cpu {status.get('cpu_cores', 0):.2f}   "
        f"rss {status.get('rss_mb', 0):.0f} MB   threads {status.get('threads', 0)}   files {status.get('files', 0)}   "
        f"lag {'-' if lag_s is None else f'{lag_s:.2f} s'}",
        f"rooms {graph.get('rooms', 0)}   things {graph.get('instances', 0)}   revision {graph.get('seq', 0)}",
        "",
        f"{'STAGE':24s}{'RUNS':>9s}{'P50 ms':>9s}{'P95 ms':>9s}{'MAX ms':>9s}",
    ]
    for name, times in status.get("stages", {}).items():
        lines.append(f"{name:24s}{times['runs']:9d}{times['p50_ms']:9.1f}{times['p95_ms']:9.1f}{times['max_ms']:9.1f}")
    lines += ["", f"{'TOPIC':24s}{'Hz':>9s}{'AGE s':>9s}{'WAITING':>9s}{'DROPPED':>9s}{'BAD':>9s}"]
    queues = status.get("queues", {})
    for topic, sensor in status.get("sensors", {}).items():
        age = "-" if sensor["age_s"] is None else f"{sensor['age_s']:.1f}"
        numbers = f"{queues.get(topic, 0):9d}{sensor['dropped']:9d}{sensor['bad']:9d}"
        lines.append(f"{topic[-24:]:24s}{sensor['rate_hz']:9.1f}{age:>9s}{numbers}")
    others = {name: count for name, count in status.get("drops", {}).items() if not name.startswith("/")}
    if others:
        lines += ["", "dropped: " + ", ".join(f"{name} {count}" for name, count in others.items())]
    lines.append("")
    for fault in status.get("faults", []):
        lines += fault_lines(fault)
    return lines if status.get("faults") else [*lines, "no faults"]


def metrics(target: Target) -> int:
    """One status in Prometheus' text format, for a textfile collector or a scrape script."""
    with connected(target) as (session, keys):
        click.echo("\n".join(exposition(ask_json(session, keys.status, target.timeout_s))))
    return 0


def exposition(status: Mapping[str, Any]) -> Iterator[str]:
    """Lines of the text format 0.0.4: one family per metric, its type before its samples, every sample with the robot's name."""
    robot = str(status.get("robot", ""))
    families: dict[str, tuple[str, list[tuple[dict[str, str], float]]]] = {}

    def add(name: str, kind: str, value: Any, **labels: str) -> None:
        if value is not None:
            families.setdefault(name, (kind, []))[1].append((labels, float(value)))

    for name in ("uptime_s", "cpu_cores", "rss_mb", "threads", "files", "lag_s", "rooms_age_s"):
        add(name, "gauge", status.get(name))
    for name, value in status.get("graph", {}).items():
        add(f"graph_{name}", "gauge", value)
    for stage, times in status.get("stages", {}).items():
        add("stage_runs_total", "counter", times["runs"], stage=stage)
        for quantile, key in (("0.5", "p50_ms"), ("0.95", "p95_ms"), ("1", "max_ms")):
            add("stage_ms", "gauge", times[key], stage=stage, quantile=quantile)
    for topic, sensor in status.get("sensors", {}).items():
        add("sensor_rate_hz", "gauge", sensor["rate_hz"], topic=topic)
        add("sensor_age_s", "gauge", sensor["age_s"], topic=topic)
        for name in ("received", "decoded", "bad", "dropped"):
            add(f"sensor_{name}_total", "counter", sensor[name], topic=topic)
    for section in ("drops", "counts"):
        for place, value in status.get(section, {}).items():
            add(f"{section}_total", "counter", value, place=place)
    for place, value in status.get("queues", {}).items():
        add("queue_waiting", "gauge", value, place=place)
    for fault in status.get("faults", []):
        add("fault", "gauge", 1, code=fault["code"], subject=fault["subject"])
    for name, (kind, samples) in families.items():
        yield f"# TYPE irsd_{name} {kind}"
        for labels, value in samples:
            words = ",".join(f'{key}="{_escaped(text)}"' for key, text in {"robot": robot, **labels}.items())
            yield f"irsd_{name}{{{words}}} {value:g}"


def _escaped(text: str) -> str:
    return re.sub(r'([\\"])', r"\\\1", text).replace("\n", r"\n")
