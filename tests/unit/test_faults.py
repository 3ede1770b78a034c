"""The ledger, and every detector against values that it must and must not find."""

from __future__ import annotations

import logging
import re
from pathlib import Path
from typing import Any

import pytest

import irsd
from irsd.core.faults import Finding
from irsd.faults import ADVICE, FaultLedger, blocked, own_state, short_disk, silent_sensors
from irsd.health import HealthSettings, WallClock

SETTINGS = HealthSettings()
PACKAGE = Path(irsd.__file__).parent
BASE_NS = 1_700_000_000_000_000_000


def sensor(**values: Any) -> dict[str, Any]:
    base = {"kind": "lidar", "age_s": 0.1, "period_s": 0.1, "bad": 0, "bad_run": 0, "last_error": ""}
    return {**base, **values}


def codes(findings: list[Finding]) -> list[str]:
    return [finding.code for finding in findings]


def test_a_fault_has_a_beginning_and_an_end(caplog: pytest.LogCaptureFixture) -> None:
    ledger = FaultLedger()
    with caplog.at_level(logging.INFO):
        assert ledger.update([], 10.0, BASE_NS) == ()
        (first,) = ledger.update([Finding("store", "write", "disk full")], 11.0, BASE_NS)
        assert (first.since, first.for_s) == ("2023-11-14T22:13:20+00:00", 0.0)
        two = ledger.update(
            [Finding("thread_late", "map", "late"), Finding("store", "write", "still full")], 14.5, BASE_NS + 10**10
        )
        assert [(f.code, f.text, f.for_s) for f in two] == [("store", "still full", 3.5), ("thread_late", "late", 0.0)]
        assert two[0].since == first.since
        assert ledger.update([], 20.0, BASE_NS) == ()
    assert [(f["code"], f["for_s"]) for f in ledger.ended()] == [("store", 9.0), ("thread_late", 5.5)]
    assert sum("disk full" in record.message for record in caplog.records) == 1  # said once, not every second
    (again,) = ledger.update([Finding("store", "write", "disk full")], 30.0, BASE_NS)
    assert again.for_s == 0.0


def test_what_is_over_is_bounded() -> None:
    ledger = FaultLedger()
    for k in range(200):
        ledger.update([Finding("store", str(k), "x")], float(k), BASE_NS)
    assert len(ledger.ended()) < 50


def test_every_fault_says_what_it_costs_and_what_to_do() -> None:
    for code, advice in ADVICE.items():
        document = FaultLedger().update([Finding(code, "s", "t")], 0.0, BASE_NS)[0].document()
        assert document["effect"] == advice.effect
        assert min(len(advice.effect), len(advice.remedy)) > 10, code


def test_every_code_in_the_source_has_its_advice() -> None:
    """A code without advice would end the daemon when its fault is told. A code is the only text of its form in these files."""
    said: set[str] = set()
    for path in (
        PACKAGE / "faults.py",
        *(PACKAGE / "sensors" / f"{n}.py" for n in ("watch", "alignment", "picture_health")),
    ):
        said |= set(
            re.findall(r'"((?:sensor|camera|tf|odometry|time|clock|extrinsic|system)_[a-z_]+)"', path.read_text())
        )
        said |= set(re.findall(r'Finding\("([a-z_]+)"', path.read_text()))
    frames_of_the_input = {"camera_info", "tf_static"}
    assert said - frames_of_the_input == set(ADVICE)


@pytest.mark.parametrize(
    ("topic", "expected"),
    [
        (sensor(), []),
        (sensor(kind="tf_static", age_s=None), []),
        (sensor(age_s=1.6), ["sensor_stale"]),
        (sensor(kind="odometry", age_s=None), ["sensor_missing"]),
        (sensor(kind="image_compressed", age_s=None), []),  # a robot without a camera is no broken robot
        (sensor(kind="detections_ids", age_s=None), []),  # a robot without a detector is no broken robot
        (sensor(kind="detections_ids", age_s=1.6), ["camera_stale"]),
        (sensor(kind="detections_info", age_s=1.6, period_s=2.0), []),  # a slow detector has its own patience
        (sensor(kind="camera_info", bad=3, bad_run=3), []),
        (sensor(kind="camera_info", bad=9, bad_run=5, last_error="K is zero"), ["sensor_undecodable"]),
        (sensor(kind="camera_info", bad=9, bad_run=9, age_s=60.0), []),  # nobody sends it any more
        (sensor(bad=900, bad_run=0), []),  # it was bad and is good again
    ],
)
def test_silent_sensors(topic: dict[str, Any], expected: list[str]) -> None:
    assert codes(silent_sensors(SETTINGS, {"/t": topic})) == expected


def test_what_the_synchroniser_waits_for() -> None:
    assert codes(blocked(["tf_static: no chain from base_link to lidar"])) == ["tf_missing"]
    assert codes(blocked(["camera_info: none for frame camera", "odometry: 0.90 s without a pose"])) == [
        "camera_info_missing",
        "odometry_gap",
    ]
    assert blocked([]) == []


def test_disk() -> None:
    assert short_disk(5000.0, True, "/s", SETTINGS) == []
    assert codes(short_disk(5.0, True, "/s", SETTINGS)) == ["disk_low"]
    assert codes(short_disk(None, False, "/s", SETTINGS)) == ["store"]


def test_own_state() -> None:
    assert own_state(SETTINGS, lag_s=0.2, perception={"why": "", "rung": "full"}) == []
    found = own_state(
        SETTINGS,
        late_threads=["map"],
        failures=2,
        last_failure="frame 7",
        store_error="disk full",
        lag_s=9.0,
        perception={"why": "latency", "rung": "rooms"},
        missing_models=["eyes: no file"],
        clock_step_s=-3600.0,
    )
    assert codes(found) == [
        "thread_late",
        "step_failing",
        "behind",
        "budget",
        "model_missing",
        "store",
        "system_clock_jump",
    ]
    assert all(code in ADVICE for code in codes(found))


def test_the_wall_clock_is_told_from_time_that_passes() -> None:
    clock = WallClock(limit_s=1.0, shown_s=5.0)
    assert [clock.step_s(s, BASE_NS + int(s * 1e9)) for s in (0.0, 1.0, 60.0)] == [0.0, 0.0, 0.0]
    assert clock.step_s(61.0, BASE_NS + int((61 - 3600) * 1e9)) == pytest.approx(-3600.0, abs=1e-3)
    assert clock.step_s(65.0, BASE_NS + int((65 - 3600) * 1e9)) != 0.0
    assert clock.step_s(66.5, BASE_NS + int((66.5 - 3600) * 1e9)) == 0.0
    assert clock.step_s(67.5, BASE_NS + int((67.51 - 3600) * 1e9)) == 0.0  # steered, not set
