"""irsctl replay as it comes: irsd sees with its own networks, the same each time, and rests where a detector was recorded."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from irsd.sensors.replay import RecordingWriter, read_messages

SAME_BYTES = ("graph.json", "rooms.json", "instances.npz", "embeddings.npz")
SECONDS = 9


@pytest.fixture(scope="module")
def recording(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first seconds of the short recording."""
    path = tmp_path_factory.mktemp("nano") / "start.mcap"
    first_ns: int | None = None
    with RecordingWriter(path) as writer:
        for message in read_messages([shared_data / "small_house" / "small_house_short.mcap"]):
            first_ns = message.log_time_ns if first_ns is None else first_ns
            if message.log_time_ns - first_ns > SECONDS * 10**9:
                break
            writer.write(message.topic, message.type_name, message.data, message.log_time_ns)
    return path


def replay(*arguments: str, out: Path, seed: int) -> dict[str, object]:
    command = [sys.executable, "-m", "irsd.ctl", "replay", *arguments, "--out", str(out), "--json"]
    environment = {**os.environ, "PYTHONHASHSEED": str(seed)}
    run = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert run.returncode == 0, run.stderr
    return dict(json.loads(run.stdout))


def test_the_shipped_eyes_see_the_same_things_each_time(recording: Path, tmp_path: Path) -> None:
    folders = [tmp_path / "a", tmp_path / "b"]
    metrics = [replay(str(recording), out=folder, seed=seed) for seed, folder in enumerate(folders)]
    assert metrics[0]["perception"]["keyframes"] >= 3  # type: ignore[index]
    for name in SAME_BYTES:
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes(), name
    nodes = json.loads((folders[0] / "graph.json").read_text())["instances"]
    assert any(node["observations"] == 0 for node in nodes)  # what stands alone in the map is a thing
    for node in nodes:
        assert 1 <= len(node["labels"]) <= 5
        assert sum(score for _, score in node["labels"]) <= 1.0
    ids = set(np.load(folders[0] / "instances.npz")["instance"].tolist())
    assert ids == {int(node["id"][1:]) for node in nodes}


def test_where_a_detector_was_recorded_the_shipped_eyes_rest(
    recording: Path, shared_data: Path, tmp_path: Path
) -> None:
    detections = shared_data / "small_house" / "small_house.detections.mcap"
    metrics = replay(str(recording), str(detections), out=tmp_path / "c", seed=0)
    assert metrics["perception"]["keyframes"] == 0  # type: ignore[index]
    nodes = json.loads((tmp_path / "c" / "graph.json").read_text())["instances"]
    assert nodes
    assert all(node["observations"] > 0 for node in nodes)
