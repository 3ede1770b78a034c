"""irsctl record, bundle, and the replay of a bundle."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from irsd.config import IrsdConfig, load_config
from irsd.core.errors import DecodeError, StoreError
from irsd.core.runtime import Event, Ring, monotonic_s, wall_clock_ns
from irsd.ctl.link import Target, ask, connected
from irsd.ctl.outputs import write_outputs
from irsd.ingest import Topic, topics_of
from irsd.io import cdr
from irsd.io.keys import subscriptions
from irsd.io.session import Sample
from irsd.perception.encoder import LabelEncoder
from irsd.reproduce import Reproduction, opened
from irsd.sensors.decode import KINDS
from irsd.sensors.replay import RecordingWriter

_PATIENCE_S = 180.0
_RING = 4096
_JSON_SCHEMA = {"type": "object"}
EXIT_UNEQUAL = 1


def record(target: Target, file: Path, seconds: float | None, config: Path | None, as_json: bool) -> int:
    """Sensor topics and graph deltas into an MCAP file, until the time is up or Ctrl-C."""
    settings = load_config(config) if config is not None else IrsdConfig()
    wake = Event()
    inputs: list[tuple[Topic | None, Ring[Sample]]] = []
    with connected(target) as (session, keys), RecordingWriter(file) as writer:
        for topic in topics_of(settings.ingest):
            ring: Ring[Sample] = Ring(_RING, wake)
            inputs.append((topic, ring))
            latched = topic.kind == "tf_static"
            for key in subscriptions(topic.name, topic.type_name, namespace=settings.ingest.namespace):
                (session.subscribe_history if latched else session.subscribe)(key, ring)
        deltas: Ring[Sample] = Ring(_RING, wake)
        inputs.append((None, deltas))
        session.subscribe(keys.delta, deltas)
        end_s = None if seconds is None else monotonic_s() + seconds
        try:
            while end_s is None or monotonic_s() < end_s:
                wake.wait(0.25)
                wake.clear()
                _write_all(writer, inputs, keys.delta)
        except KeyboardInterrupt:
            _write_all(writer, inputs, keys.delta)
    counts = {("graph/delta" if t is None else t.name): r.received - r.dropped for t, r in inputs if r.received}
    lost = sum(ring.dropped for _, ring in inputs)
    if as_json:
        click.echo(json.dumps({"messages": counts, "dropped": lost}))
    else:
        click.echo(
            f"wrote {file}: {', '.join(f'{n} {t}' for t, n in counts.items()) or 'nothing came'}; {lost} dropped"
        )
    return 0


def _write_all(writer: RecordingWriter, inputs: list[tuple[Topic | None, Ring[Sample]]], delta_key: str) -> None:
    for topic, ring in inputs:
        for sample in ring.drain():
            stamp_ns = wall_clock_ns()
            if topic is None:
                writer.write_json(delta_key, "irs/graph/delta", _JSON_SCHEMA, sample.payload, stamp_ns)
            elif topic.kind == "detections_info":
                writer.write_json(topic.name, "irs/detections/info", _JSON_SCHEMA, sample.payload, stamp_ns)
            else:
                known = KINDS[topic.kind].type_name if topic.kind in KINDS else cdr.COMPRESSED_IMAGE
                writer.write(topic.name, topic.type_name or known, sample.payload, stamp_ns)


def bundle(target: Target, file: Path) -> int:
    """What the running irsd can tell of its last minutes, as one zip."""
    with connected(target) as (session, keys):
        content = ask(session, keys.command("bundle"), _PATIENCE_S)
    try:
        file.write_bytes(content)
    except OSError as error:
        raise StoreError(f"{file}: {error}") from error
    with opened(file) as made:
        whole = "it reproduces the graph" if made.meta["complete"] else f"it does not reproduce: {made.meta['why_not']}"
    click.echo(f"wrote {file}, {len(content) / 1e6:.1f} MB; {whole}")
    return 0


def reproduce(file: Path, out: Path, as_json: bool) -> int:
    """A bundle through the pipeline; writes the output folder; exit code 1 when a whole one gives another graph."""
    with opened(file) as made:
        meta: dict[str, Any] = made.meta
        if not made.recording:
            raise DecodeError(f"{file}: holds no recording (record.rolling_mb was 0)")
        began_s = monotonic_s()
        again = Reproduction(made, LabelEncoder.load())
        found = again.run(made)
    metrics = {
        "frames": again.frames,
        "failed": again.failed,
        "wall_s": round(monotonic_s() - began_s, 3),
        "graph_sha256": found,
        "recorded_sha256": meta["graph_sha256"],
        "same": found == meta["graph_sha256"],
        "complete": meta["complete"],
    }
    pipeline = again.pipeline
    write_outputs(out, pipeline.snapshot(), pipeline.arrays(), pipeline.navigation_grid(), metrics)
    if as_json:
        click.echo(json.dumps(metrics))
    else:
        same = "the same graph" if metrics["same"] else f"another graph than recorded ({meta['graph_sha256']})"
        why = "" if meta["complete"] else f"; the bundle is not whole: {meta['why_not']}"
        click.echo(f"{again.frames} frames, graph {found}: {same}{why}; wrote {out}/")
    return 0 if metrics["same"] or not meta["complete"] else EXIT_UNEQUAL
