"""The status as a table and as Prometheus' text format, read back by a reader of the format's grammar."""

from __future__ import annotations

import re
from typing import Any

from irsd.core.times import is_due
from irsd.ctl.top import exposition, table

STATUS: dict[str, Any] = {
    "robot": 'r"1\\',
    "uptime_s": 12.5,
    "cpu_cores": 0.5,
    "rss_mb": 300.0,
    "lag_s": None,
    "graph": {"rooms": 2, "instances": 5, "seq": 9},
    "stages": {"mapping": {"runs": 7, "p50_ms": 1.5, "p95_ms": 2.5, "max_ms": 3.0}},
    "sensors": {"/odom": {"rate_hz": 20.0, "age_s": None, "received": 7, "decoded": 6, "bad": 1, "dropped": 3}},
    "queues": {"/odom": 4, "publish": 0},
    "drops": {"/odom.dropped": 3, "sync.scan_late": 2},
    "counts": {"frames": 7},
    "faults": [
        {
            "code": "store",
            "subject": "write",
            "text": "disk full",
            "effect": "e",
            "remedy": "r",
            "since": "t",
            "for_s": 1.0,
        }
    ],
}
SAMPLE = re.compile(r'([a-zA-Z_:][\w:]*)\{((?:\w+="(?:[^"\\\n]|\\\\|\\"|\\n)*",?)*)\} (-?[\d.e+-]+)')


def test_every_line_is_of_the_format_and_every_family_has_one_type_before_its_samples() -> None:
    typed: dict[str, str] = {}
    values: dict[str, float] = {}
    for line in exposition(STATUS):
        if line.startswith("# TYPE "):
            name, kind = line.split()[2:]
            assert name not in typed
            typed[name] = kind
            continue
        match = SAMPLE.fullmatch(line)
        assert match, line
        assert match[1] == list(typed)[-1]
        assert r'robot="r\"1\\"' in match[2]
        values[f"{match[1]} {match[2]}"] = float(match[3])
    assert all((kind == "counter") == name.endswith("_total") for name, kind in typed.items())
    assert "irsd_lag_s" not in typed  # not known is not zero
    found = {key.replace(r'robot="r\"1\\",', ""): value for key, value in values.items()}
    assert found['irsd_stage_ms stage="mapping",quantile="0.95"'] == 2.5
    assert found['irsd_sensor_dropped_total topic="/odom"'] == 3
    assert found['irsd_queue_waiting place="/odom"'] == 4
    assert found['irsd_fault code="store",subject="write"'] == 1


def test_the_table_shows_stages_queues_drops_and_faults() -> None:
    text = "\n".join(table(STATUS))
    for part in ("mapping", "2.5", "/odom", "sync.scan_late 2", "FAULT store: disk full", "lag -"):
        assert part in text
    row = next(line for line in table(STATUS) if line.startswith("/odom"))
    assert row.split() == ["/odom", "20.0", "-", "4", "3", "1"]
    assert table({**STATUS, "faults": []})[-1] == "no faults"


def test_what_is_due_when_a_clock_is_set() -> None:
    period = 500
    assert [is_due(t, 1000, period) for t in (500, 999, 1000, 4_000_000)] == [False, False, True, True]
    assert is_due(-3_599_000, 1000, period)
