"""irsctl against a running irsd: a recording played in real time gives the graph that its replay gives, and every command answers."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from irsd.sensors.replay import RecordingWriter, read_messages

PLAYED_S = 12.0
ROBOT = "tester"


@dataclass(frozen=True)
class Live:
    """A running irsd that has heard the whole recording."""

    endpoint: str
    play: dict[str, Any]
    recording: Path
    scratch: Path

    def irsctl(self, *arguments: str, code: int = 0) -> subprocess.CompletedProcess[str]:
        run = irsctl(self.endpoint, *arguments)
        assert run.returncode == code, run.stderr
        return run

    def json(self, *arguments: str, code: int = 0) -> dict[str, Any]:
        return dict(json.loads(self.irsctl(*arguments, "--json", code=code).stdout))


def irsctl(endpoint: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "IRSD_ENDPOINT": endpoint, "IRSD_CONNECT": ""}
    command = [sys.executable, "-m", "irsd.ctl", *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=120)


def cut(sources: list[Path], target: Path, seconds: float) -> None:
    """The first seconds of the first recording, with what the others hold of that time."""
    messages = read_messages([sources[0]])
    start_ns = next(iter(messages)).log_time_ns
    with RecordingWriter(target) as out:
        for message in read_messages(sources):
            if message.log_time_ns > start_ns + seconds * 1e9:
                break
            if message.log_time_ns < start_ns:
                continue
            if message.encoding == "json":
                out.write_json(message.topic, message.type_name, {"type": "object"}, message.data, message.log_time_ns)
            else:
                out.write(message.topic, message.type_name, message.data, message.log_time_ns)


@pytest.fixture(scope="module")
def live(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    scratch = tmp_path_factory.mktemp("live")
    house = shared_data / "small_house"
    recording = scratch / "cut.mcap"
    cut([house / "small_house_short.mcap", house / "small_house.detections.mcap"], recording, PLAYED_S)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    environment = {**os.environ, "IRSD_ENDPOINT": endpoint, "IRSD_CONNECT": ""}
    with (scratch / "irsd.log").open("wb") as log:
        daemon = subprocess.Popen(
            [sys.executable, "-m", "irsd", "--robot", ROBOT, "--no-store"], stdout=log, stderr=log, env=environment
        )
    try:
        for _ in range(60):
            if irsctl(endpoint, "tree").returncode == 0 or daemon.poll() is not None:
                break
        run = irsctl(endpoint, "play", str(recording), "--json")
        assert run.returncode == 0, run.stderr + (scratch / "irsd.log").read_text()
        yield Live(endpoint, json.loads(run.stdout), recording, scratch)
    finally:
        daemon.send_signal(signal.SIGTERM)
        assert daemon.wait(20) == 0, (scratch / "irsd.log").read_text()


def settled(live: Live) -> dict[str, Any]:
    """The graph once irsd has worked off all that was played."""
    last = -1
    for _ in range(20):
        graph = live.json("tree")
        if graph["seq"] == last:
            break
        last = graph["seq"]
        subprocess.run(["sleep", "1"], check=True)
    return graph


def test_nothing_is_lost_and_status_says_so(live: Live) -> None:
    status = json.loads(irsctl(live.endpoint, "status", "--json").stdout)
    assert status["robot"] == ROBOT
    for topic in ("/lidar/points", "/odom", "/detections/ids", "/detections/info"):
        sensor = status["sensors"][topic]
        assert sensor["received"] > 0
        assert (sensor["bad"], sensor["dropped"]) == (0, 0), topic
    assert sum(s["received"] for s in status["sensors"].values()) <= live.play["messages"]


def test_live_and_replay_agree(live: Live) -> None:
    graph = settled(live)
    out = live.scratch / "replay"
    live.irsctl("replay", str(live.recording), "--out", str(out))
    replayed = json.loads((out / "graph.json").read_text())
    assert len(graph["rooms"]) == len(replayed["rooms"])
    here = [(t["label"], np.array(t["centroid_m"])) for t in graph["instances"]]
    there = [(t["label"], np.array(t["centroid_m"])) for t in replayed["instances"]]
    assert len(there) >= 10

    def found(thing: tuple[str, np.ndarray], among: list[tuple[str, np.ndarray]]) -> bool:
        return any(label == thing[0] and np.linalg.norm(at - thing[1]) < 0.25 for label, at in among)

    assert sum(found(t, here) for t in there) >= 0.9 * len(there)
    assert sum(found(t, there) for t in here) >= 0.9 * len(here)


def test_every_node_can_be_shown(live: Live) -> None:
    graph = settled(live)
    for node in [graph["building"], graph["rooms"][0], graph["instances"][0]]:
        assert live.json("show", node["id"])["id"] == node["id"]
    assert "I99999" in live.irsctl("show", "I99999", code=4).stderr
    live.irsctl("show", "sofa", code=2)
    text = live.irsctl("tree").stdout
    assert all(thing["id"] in text for thing in graph["instances"])


def test_the_plan_is_drawn_in_both_formats(live: Live) -> None:
    svg, png = live.scratch / "plan.svg", live.scratch / "deep" / "plan.png"
    live.irsctl("plan", "-o", str(svg))
    live.irsctl("plan", "-o", str(png))
    assert "image" in {element.tag.rpartition("}")[2] for element in ET.parse(svg).getroot()}
    assert cv2.imread(str(png)) is not None
    live.irsctl("plan", "-o", str(live.scratch / "plan.pdf"), code=2)


def test_watch_gets_what_was_before(live: Live) -> None:
    settled(live)
    lines = live.irsctl("watch", "--count", "2", "--json").stdout.splitlines()
    assert [json.loads(line)["schema"] for line in lines] == ["irs/graph/delta/1"] * 2


def test_without_a_bridge_a_goal_is_an_error_that_says_so(live: Live) -> None:
    run = live.irsctl("--timeout", "1", "goto", "the sofa", code=1)
    assert "nav/goto" in run.stderr
    run = live.irsctl("--robot", "nobody", "--timeout", "0.5", "tree", code=1)
    assert "nobody answers" in run.stderr
