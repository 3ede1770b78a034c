"""``irsctl replay`` on a real recording, as a process: the same input gives the same bytes, and the graph is right."""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from irsd.sensors.replay import RecordingWriter, read_messages

SAME_BYTES = (
    "graph.json",
    "rooms.json",
    "instances.npz",
    "embeddings.npz",
    "occupancy.png",
    "occupancy.yaml",
    "plan.svg",
)


def irsctl(*arguments: str, seed: int = 0) -> subprocess.CompletedProcess[str]:
    """Run irsctl; the hash seed is varied so that an order taken from a set would show."""
    environment = {**os.environ, "PYTHONHASHSEED": str(seed)}
    return subprocess.run(
        [sys.executable, "-m", "irsd.ctl", *arguments], capture_output=True, text=True, env=environment, check=False
    )


@pytest.fixture(scope="module")
def replayed(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two output folders of the short recording."""
    house = shared_data / "small_house"
    folders = [tmp_path_factory.mktemp("replay") / name for name in ("a", "b")]
    for seed, folder in enumerate(folders):
        recording, seen = house / "small_house_short.mcap", house / "small_house.detections.mcap"
        run = irsctl(
            "replay", str(recording), "--perception", f"external:{seen}", "--out", str(folder), "--json", seed=seed
        )
        assert run.returncode == 0, run.stderr
    return folders


def test_same_input_same_bytes(replayed: list[Path]) -> None:
    one, two = replayed
    for name in SAME_BYTES:
        assert (one / name).read_bytes() == (two / name).read_bytes(), name


def test_the_files_agree_with_each_other(replayed: list[Path]) -> None:
    folder = replayed[0]
    graph = json.loads((folder / "graph.json").read_text())
    rooms = json.loads((folder / "rooms.json").read_text())
    cloud = np.load(folder / "instances.npz")
    metrics = json.loads((folder / "metrics.json").read_text())
    ids = {int(node["id"][1:]) for node in graph["instances"]}
    assert len(ids) >= 15
    assert set(cloud["instance"].tolist()) == ids
    assert {room["id"] for room in rooms} == {room["id"] for room in graph["rooms"]}
    assert {node["room"] for node in graph["instances"]} - {None} <= {room["id"] for room in rooms}
    assert metrics["frames"] >= 120  # 25 s at 5 Hz
    assert {"mapping", "rooms", "lift", "fusion", "graph"} <= set(metrics["stages"])
    assert not [name for name, count in metrics["drops"].items() if name.endswith(".bad") and count]


def test_rooms_and_things_are_right(replayed: list[Path], shared_data: Path, shared_tools: Path) -> None:
    scorer = [
        sys.executable,
        str(shared_tools / "score_replay.py"),
        str(replayed[0]),
        str(shared_data / "small_house"),
        "--json",
    ]
    run = subprocess.run(scorer, capture_output=True, text=True, check=True)
    score = json.loads(run.stdout)
    assert score["instances"]["precision50"] >= 0.5
    assert score["instances"]["wrong_merges"] <= 2
    assert score["labels"]["top1"] >= 0.9
    assert score["rooms"]["precision"] >= 0.8


@pytest.mark.parametrize("name", ["graph.mcap", "small_house.mcap"])
def test_a_file_that_is_no_recording_is_named(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"not a recording")
    run = irsctl("replay", str(path), "--out", str(tmp_path / "out"))
    assert run.returncode == 1
    assert name in run.stderr
    assert "Traceback" not in run.stderr


def test_unknown_perception_is_refused(shared_data: Path, tmp_path: Path) -> None:
    recording = shared_data / "small_house" / "small_house_short.mcap"
    run = irsctl("replay", str(recording), "--perception", "external:nowhere.mcap", "--out", str(tmp_path / "out"))
    assert run.returncode == 1
    assert "nowhere.mcap" in run.stderr


def test_a_recording_without_a_lidar_is_refused_with_what_is_missing(shared_data: Path, tmp_path: Path) -> None:
    source, cut = shared_data / "small_house" / "small_house_short.mcap", tmp_path / "cut.mcap"
    with RecordingWriter(cut) as out:
        for message in itertools.islice(read_messages([source], topics=["/odom", "/tf_static"]), 50):
            out.write(message.topic, message.type_name, message.data, message.log_time_ns)
    run = irsctl("replay", str(cut), "--out", str(tmp_path / "out"))
    assert run.returncode == 1
    assert "no frame came of these recordings" in run.stderr
    assert "Traceback" not in run.stderr
    assert not (tmp_path / "out").exists()
