"""irsctl play and replay: recordings onto zenoh, and recordings through the pipeline."""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import click

from irsd.config import IrsdConfig, load_config, with_pictures
from irsd.core.errors import ConfigError, DecodeError
from irsd.core.runtime import monotonic_s, sleep_s
from irsd.core.types import SyncedFrame
from irsd.ctl.link import Target
from irsd.ctl.outputs import write_outputs
from irsd.health import StageTimes
from irsd.ingest import SensorDecoder
from irsd.io.endpoints import ZenohSettings, with_environment
from irsd.io.session import CDR, JSON, open_session
from irsd.perception.encoder import LabelEncoder
from irsd.perception.eyes import open_eyes
from irsd.perception.inline import InlineEyes
from irsd.perception.naming import Namer
from irsd.perception.nano import open_namer
from irsd.pipeline import MapPipeline, StepResult
from irsd.sensors.replay import RawMessage, read_messages
from irsd.sensors.sync import Synchronizer

PROGRESS_S = 2.0
REPLAY_MAP_ID = "replay"
NANO, FOUNDATION = "nano", "foundation"


# ---------------------------------------------------------------------------------------------------------------- replay
@dataclass(slots=True)
class Offline:
    """The live map thread's body without its thread: messages in, frames through the pipeline."""

    decoder: SensorDecoder
    sync: Synchronizer
    pipeline: MapPipeline
    eyes: InlineEyes | None = None
    times: StageTimes = field(default_factory=StageTimes)
    frames: int = 0
    first_ns: int | None = None
    last_ns: int = 0

    def feed(self, message: RawMessage) -> None:
        """One recorded message."""
        for sensed in self.decoder.decode(message.topic, message.data):
            self.sync.push(sensed)
        self._run(self.sync.pop())

    def finish(self) -> StepResult:
        """What is still waiting, then every stage a last time."""
        self._run(self.sync.flush())
        return self.pipeline.finish(self.last_ns)

    def _run(self, frames: Iterable[SyncedFrame]) -> None:
        for frame in frames:
            result = self.pipeline.step(frame)
            self.times.add(result.stage_ms)
            self.frames += 1
            self.first_ns = frame.stamp_ns if self.first_ns is None else self.first_ns
            self.last_ns = frame.stamp_ns


def replay(files: Sequence[Path], out: Path, perception: str, config: Path | None, as_json: bool) -> int:
    """Recordings through the pipeline as fast as it goes; writes the output folder."""
    paths = [*files, *external_perception(perception)]
    settings = load_config(config) if config is not None else IrsdConfig()
    labels = LabelEncoder.load()
    eyes, namer = own_eyes(settings, perception, labels)
    if eyes is not None:
        settings = with_pictures(settings)
    offline = Offline(
        SensorDecoder(settings.ingest),
        Synchronizer(settings.sync),
        MapPipeline(settings.pipeline, labels, map_id=REPLAY_MAP_ID, eyes=eyes, namer=namer),
        eyes,
    )
    wall_s, cpu_s, shown_s = monotonic_s(), time.process_time(), monotonic_s()
    for message in read_messages(paths):
        offline.feed(message)
        if not as_json and monotonic_s() - shown_s > PROGRESS_S:
            shown_s = monotonic_s()
            done_s = (offline.last_ns - (offline.first_ns or 0)) / 1e9
            graph = offline.pipeline.snapshot()
            click.echo(f"{done_s:6.0f} s replayed, {len(graph.rooms)} rooms, {len(graph.instances)} things", err=True)
    snapshot = offline.finish().snapshot
    metrics = measured(offline, monotonic_s() - wall_s, time.process_time() - cpu_s)
    if not offline.frames:
        lost = (
            ", ".join(f"{name} {count}" for name, count in metrics["drops"].items() if count) or "nothing was dropped"
        )
        waiting = offline.sync.blocked_by() or "no sweep of the LiDAR came"
        raise DecodeError(f"no frame came of these recordings: {waiting}; {lost}")
    write_outputs(out, snapshot, offline.pipeline.arrays(), offline.pipeline.navigation_grid(), metrics)
    if as_json:
        click.echo(json.dumps(metrics))
    else:
        click.echo(
            f"{metrics['recorded_s']:.0f} s in {metrics['wall_s']:.0f} s ({metrics['speed_x']:.1f}x real time): "
            f"{len(snapshot.rooms)} rooms, {len(snapshot.instances)} things, wrote {out}/"
        )
    return 0


def external_perception(perception: str) -> list[Path]:
    """The detection recording named by ``external:FILE.mcap``, none for irsd's own eyes; ConfigError for anything else."""
    if perception in (NANO, FOUNDATION):
        return []
    kind, _, name = perception.partition(":")
    if kind != "external" or not name:
        raise ConfigError(f"--perception {perception}: must be {NANO}, {FOUNDATION} or external:FILE.mcap")
    if not Path(name).is_file():
        raise ConfigError(f"--perception {perception}: there is no file {name}")
    return [Path(name)]


def own_eyes(settings: IrsdConfig, perception: str, labels: LabelEncoder) -> tuple[InlineEyes | None, Namer | None]:
    """The shipped networks, or the models of the configuration, and who names things; ConfigError when it names none."""
    if perception not in (NANO, FOUNDATION):
        return None, None
    if perception == FOUNDATION and not settings.perception.image_encoder:
        raise ConfigError(f"--perception {FOUNDATION}: perception.image_encoder is not set (--config FILE)")
    seeing = settings.perception if perception == FOUNDATION else replace(settings.perception, image_encoder="")
    opened = open_eyes(seeing, settings.models)
    eyes = InlineEyes(opened.chain, settings.budget, opened.costs)
    return eyes, open_namer(seeing, labels) if perception == NANO else None


def measured(offline: Offline, wall_s: float, cpu_s: float) -> dict[str, Any]:
    """metrics.json: times per stage, CPU seconds, peak memory, and everything that was dropped."""
    recorded_s = (offline.last_ns - (offline.first_ns or 0)) / 1e9
    return {
        "frames": offline.frames,
        "recorded_s": round(recorded_s, 3),
        "wall_s": round(wall_s, 3),
        "speed_x": round(recorded_s / max(wall_s, 1e-9), 2),
        "cpu_s": round(cpu_s, 3),
        "peak_rss_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
        "stages": offline.times.summary(),
        "drops": {**offline.decoder.counters(), **offline.sync.counters(), **offline.pipeline.counters()},
        "perception": None if offline.eyes is None else offline.eyes.report(),
    }


# ------------------------------------------------------------------------------------------------------------------ play
def play(target: Target, files: Sequence[Path], rate: float, as_json: bool) -> int:
    """Recordings onto zenoh with their own timing; topics become keys as zenoh-bridge-ros2dds makes them."""
    settings = with_environment(ZenohSettings(), target.endpoint)
    sent, late_s, began_s, first_ns = 0, 0.0, 0.0, None
    with open_session(settings, "client") as session:
        for message in read_messages(list(files)):
            if first_ns is None:
                first_ns, began_s = message.log_time_ns, monotonic_s()
            due_s = began_s + (message.log_time_ns - first_ns) / 1e9 / rate
            wait_s = due_s - monotonic_s()
            if wait_s > 0:
                sleep_s(wait_s)
            late_s = max(late_s, -wait_s)
            encoding = JSON if message.type_name in ("", "json") else CDR
            session.put(message.topic.strip("/"), message.data, encoding=encoding)
            sent += 1
    wall_s = monotonic_s() - began_s
    done = {"messages": sent, "wall_s": round(wall_s, 2), "worst_delay_s": round(late_s, 3), "rate": rate}
    click.echo(
        json.dumps(done)
        if as_json
        else f"played {sent} messages in {wall_s:.0f} s, at most {late_s * 1000:.0f} ms late"
    )
    return 0
