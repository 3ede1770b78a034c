"""The fault ledger: what is wrong now, since when, what it costs, and what to do. Detectors find; the ledger remembers.

A finding that is no longer found is over: nothing latches. Events (a jump of a clock) are found for a while by their detector.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Any, NamedTuple

from irsd.core.faults import Finding
from irsd.health import HealthSettings

_log = logging.getLogger(__name__)

_ENDED_KEPT = 20


class Advice(NamedTuple):
    """effect: what irsd still does and what not, while the fault lasts. remedy: what the operator should do."""

    effect: str
    remedy: str


_NO_MAP = "the map stands still; what is known stays, and goals are planned on it"
_NO_EYES = "rooms go on; no new things, so goals by room work and goals by thing only where it is known"

ADVICE: Mapping[str, Advice] = MappingProxyType(
    {
        "sensor_missing": Advice(
            _NO_MAP, "start the driver; compare its topic with ingest.* in irsd.yaml (irsctl doctor lists what arrives)"
        ),
        "sensor_stale": Advice(_NO_MAP, "look at the driver, its cable and its power; irsd goes on by itself"),
        "camera_stale": Advice(_NO_EYES, "look at the camera's driver or the detector; irsd goes on by itself"),
        "sensor_undecodable": Advice(
            "its messages are counted and dropped", "the topic carries another type: compare ingest.* (irsctl doctor)"
        ),
        "sensor_frozen": Advice(
            "the map takes the same picture of the world again and again",
            "restart the driver: it repeats its last message",
        ),
        "time_jump": Advice(
            "what was waiting is dropped; the map goes on with the new time",
            "synchronise the sensor's clock (chrony, PTP) before irsd starts; one jump at boot does no harm",
        ),
        "system_clock_jump": Advice(
            "none: irsd measures with a clock that does not jump", "only the times in logs are off; check chrony or NTP"
        ),
        "clock_offset": Advice(
            "sweeps and pictures are placed where the robot was then: walls double, things sit beside their place",
            "synchronise both clocks (chrony, PTP), or stamp both drivers with the host's time",
        ),
        "odometry_jump": Advice(
            "what is seen after the jump lies displaced in the map",
            "wheel slip, a reset or a relocalisation: look at the odometry; a wrong map is undone by irsctl",
        ),
        "tf_missing": Advice(
            "the sensor's messages can't be placed and are dropped", "publish the mounting on /tf_static"
        ),
        "tf_inconsistent": Advice(
            "the newest mounting is used", "two publishers disagree, or one moves a frame that must be fixed: stop one"
        ),
        "tf_cycle": Advice("the frames in the loop can't be placed", "correct the mountings on /tf_static"),
        "camera_info_missing": Advice(_NO_EYES, "publish CameraInfo with the pictures' frame_id and size"),
        "odometry_gap": Advice(
            "sweeps without a pose are dropped",
            "odometry must come at 10 Hz or more, with stamps that enclose the sweeps",
        ),
        "camera_dark": Advice(_NO_EYES, "switch the light on, take the cap off, or correct the exposure"),
        "camera_covered": Advice(_NO_EYES, "clean or uncover the lens; a blank wall right before it looks the same"),
        "camera_blurred": Advice(
            "names and masks become unreliable; rooms go on", "clean or focus the lens; shorten the exposure"
        ),
        "extrinsic_drift": Advice(
            "masks are lifted beside their things", "the camera or LiDAR has moved: fasten and calibrate it anew"
        ),
        "thread_late": Advice(
            "nothing new comes out; systemd restarts irsd when it lasts", "the machine is overloaded or a device hangs"
        ),
        "step_failing": Advice(
            "the frames concerned are lost; the last good graph stays", "report it with irsctl bundle"
        ),
        "behind": Advice(
            "the graph is older than it should be; the oldest sweeps are dropped, counted",
            "give irsd more CPU (CPUQuota=), or thin the LiDAR",
        ),
        "budget": Advice(
            "pictures are looked at less often or less well; rooms and ingest go on", "more CPU, smaller models"
        ),
        "model_missing": Advice(
            "irsd runs without it: " + _NO_EYES,
            "irsctl models pull NAME, or correct perception.* in irsd.yaml; then restart",
        ),
        "store": Advice(
            "the graph is live but not on disk: a restart would lose the latest steps",
            "free space, or make the state directory writable; what waits is then written",
        ),
        "map_mismatch": Advice(
            "the stored map is shown but not added to: what is seen now is of another place, or in another frame",
            "irsctl relocalise looks for the robot in the map; irsctl map accept if odometry is where it was, irsctl map new "
            "elsewhere; it goes on by itself once scans fit",
        ),
        "disk_low": Advice("none yet; soon the map can't be kept", "free space on the disk of the state directory"),
    }
)


@dataclass(frozen=True, slots=True)
class Fault:
    """A finding with its history. since: ISO 8601, UTC, by the wall clock; for_s: by a clock that does not jump."""

    code: str
    subject: str
    text: str
    since: str
    for_s: float

    def document(self) -> dict[str, Any]:
        """As it stands in the status (docs/schema/status.json)."""
        effect, remedy = ADVICE[self.code]
        return {
            "code": self.code,
            "subject": self.subject,
            "text": self.text,
            "effect": effect,
            "remedy": remedy,
            "since": self.since,
            "for_s": self.for_s,
        }


class FaultLedger:
    """Owner of what is wrong now. One thread updates it."""

    def __init__(self) -> None:
        self._begun: dict[tuple[str, str], tuple[float, str]] = {}
        self._texts: dict[tuple[str, str], str] = {}
        self._ended: deque[dict[str, Any]] = deque(maxlen=_ENDED_KEPT)

    def update(self, findings: Iterable[Finding], now_s: float, wall_ns: int) -> tuple[Fault, ...]:
        """The faults there are now, oldest first. A fault that begins or ends is logged once."""
        found = {(finding.code, finding.subject): finding for finding in findings}
        when = datetime.fromtimestamp(wall_ns * 1e-9, UTC).isoformat(timespec="seconds")
        for key in [key for key in self._begun if key not in found]:
            began_s, since = self._begun.pop(key)
            text = self._texts.pop(key)
            self._ended.append(
                {"code": key[0], "subject": key[1], "text": text, "since": since, "for_s": round(now_s - began_s, 1)}
            )
            _log.info("over after %.0f s: %s: %s", now_s - began_s, key[0], text)
        for key, finding in found.items():
            if key not in self._begun:
                self._begun[key] = (now_s, when)
                _log.warning("%s: %s", finding.code, finding.text)
            self._texts[key] = finding.text
        faults = [
            Fault(*key, self._texts[key], since, round(now_s - began_s, 1))
            for key, (began_s, since) in self._begun.items()
        ]
        return tuple(sorted(faults, key=lambda fault: -fault.for_s))

    def ended(self) -> list[dict[str, Any]]:
        """The last faults that are over, oldest first."""
        return list(self._ended)


# --------------------------------------------------------------------------------------------------------- detectors
def silent_sensors(settings: HealthSettings, sensors: Mapping[str, Mapping[str, Any]]) -> list[Finding]:
    """Topics that should be heard and are not, and topics of which no message can be used.

    sensors: as ``Ingest.sensors`` gives them. LiDAR and odometry must be there; a camera or a detector, which a robot need not
    have, must not fall silent once it was heard, and has five of its own periods where it is slow.
    """
    found = []
    for topic, sensor in sensors.items():
        age_s, kind = sensor["age_s"], sensor["kind"]
        if kind in ("lidar", "odometry", "image", "image_compressed", "detections_ids", "detections_info"):
            place = "sensor" if kind in ("lidar", "odometry") else "camera"
            patience_s = max(settings.sensor_stale_s, 5.0 * sensor["period_s"] if place == "camera" else 0.0)
            if age_s is None:
                if place == "sensor":
                    found.append(Finding("sensor_missing", topic, f"{topic}: nothing received yet"))
            elif age_s > patience_s:
                code = "sensor_stale" if place == "sensor" else "camera_stale"
                found.append(Finding(code, topic, f"{topic}: silent for {age_s:.1f} s"))
        if sensor["bad_run"] >= settings.bad_messages and age_s is not None and age_s <= 2.0 * settings.sensor_stale_s:
            text = f"{topic}: the last {sensor['bad_run']} messages can't be used: {sensor['last_error']}"
            found.append(Finding("sensor_undecodable", topic, text))
    return found


_BLOCKED = (
    ("tf_static:", "tf_missing"),
    ("camera_info:", "camera_info_missing"),
    ("camera:", "camera_info_missing"),
    ("odometry:", "odometry_gap"),
)


def blocked(obstacles: Sequence[str]) -> list[Finding]:
    """What the synchroniser waits for in vain, by its own words (``Synchronizer.obstacles``)."""
    found = []
    for text in dict.fromkeys(obstacles):
        code = next((code for start, code in _BLOCKED if text.startswith(start)), None)
        if code is not None:
            found.append(Finding(code, text.partition(":")[0], text))
    return found


def short_disk(free_mb: float | None, writable: bool, directory: str, settings: HealthSettings) -> list[Finding]:
    """A state directory that can't be written, or soon can't be. free_mb: None where it can't be asked for."""
    if not writable:
        return [Finding("store", directory, f"{directory} can't be written")]
    if free_mb is not None and free_mb < settings.min_free_mb:
        return [Finding("disk_low", directory, f"{directory}: {free_mb:.0f} MB are free")]
    return []


def own_state(
    settings: HealthSettings,
    *,
    late_threads: Sequence[str] = (),
    failures: int = 0,
    last_failure: str = "",
    store_error: str = "",
    map_mismatch: str = "",
    lag_s: float | None = None,
    perception: Mapping[str, Any] | None = None,
    missing_models: Sequence[str] = (),
    clock_step_s: float = 0.0,
) -> list[Finding]:
    """What is wrong with irsd itself. failures: steps that failed in a row up to now. perception: the governor's report.

    clock_step_s: how far the system clock was set lately. lag_s: of the newest sweep, None while there is none.
    """
    found = [Finding("thread_late", name, f"thread {name} makes no progress") for name in late_threads]
    if failures:
        found.append(Finding("step_failing", "map", f"the last {failures} steps failed: {last_failure}"))
    if lag_s is not None and lag_s > settings.lag_limit_s:
        found.append(Finding("behind", "map", f"the newest sweep in the graph was {lag_s:.1f} s on its way"))
    if perception and perception.get("why"):
        text = f"perception at '{perception['rung']}': {perception['why']}"
        found.append(Finding("budget", "perception", text))
    found += [Finding("model_missing", text.partition(":")[0], text) for text in missing_models]
    if store_error:
        found.append(Finding("store", "write", store_error))
    if map_mismatch:
        found.append(Finding("map_mismatch", "map", map_mismatch))
    if clock_step_s:
        found.append(Finding("system_clock_jump", "clock", f"the system clock was set by {clock_step_s:+.1f} s"))
    return found
