"""irsctl's edits on a running irsd: answered when on disk, so that a kill -9 right after the answer loses nothing."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irsd.core.runtime import monotonic_s, sleep_s
from irsd.core.types import InstanceState, InstanceUpdate
from irsd.graph.builder import GraphBuilder, GraphSettings
from irsd.graph.store import Store
from irsd.io.keys import RobotKeys
from irsd.io.session import ZenohSettings, open_session
from irsd.perception.encoder import LabelEncoder

WAIT_S = 60.0
KEYS = RobotKeys("tester")


def a_map(folder: Path) -> None:
    """Three things on disk, as irsd would have left them."""
    rng = np.random.default_rng(3)
    states = tuple(
        InstanceState(
            n,
            (rng.random((200, 3)) + np.array([3 * n, 0, 0])).astype(np.float32),
            None,
            ((name, 0.9),),
            0,
            9,
            0.9,
            1,
            2,
        )
        for n, name in ((1, "chair"), (2, "table"), (3, "box"))
    )
    builder = GraphBuilder(GraphSettings(), LabelEncoder.load(), "map", "m")
    delta = builder.build(None, InstanceUpdate(5, states, (), ()), 9)
    assert delta is not None
    store = Store(folder / KEYS.robot)
    store.append(delta, builder.all_arrays(), builder.take_record({"I": 4}))
    store.close()


@pytest.fixture
def endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def irsd(endpoint: str, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A running irsd that answers; killed -9 at the end."""
    env = {**os.environ, "IRSD_CONNECT": "", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "irsd", "--robot", KEYS.robot, "--endpoint", endpoint, "--state", str(folder)]
    process = subprocess.Popen(command, env=env)
    try:
        with open_session(ZenohSettings(endpoint=endpoint, connect=()), "peer") as session:
            deadline_s = monotonic_s() + WAIT_S
            while session.find_alive(KEYS.alive) != [KEYS.alive]:
                assert monotonic_s() < deadline_s
                sleep_s(0.05)
        yield process
    finally:
        process.kill()
        process.wait()


def irsctl(endpoint: str, *words: str, code: int = 0) -> str:
    command = [sys.executable, "-m", "irsd.ctl", "--endpoint", endpoint, "--timeout", "20", *words]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "IRSD_CONNECT": ""}, check=False)
    assert done.returncode == code, done.stderr
    return done.stdout + done.stderr


def labels(endpoint: str) -> dict[str, str]:
    graph: dict[str, Any] = json.loads(irsctl(endpoint, "tree", "--json"))
    return {node["id"]: node["label"] for node in graph["instances"]}


def test_edits_outlive_kills_and_are_undone_after_them(endpoint: str, tmp_path: Path) -> None:
    a_map(tmp_path)
    with irsd(endpoint, tmp_path):
        assert irsctl(endpoint, "teach", "I1", "centrifuge") == "edit 1: I1 is called centrifuge\n"
        assert "there is no I9" in irsctl(endpoint, "delete", "I9", code=1)
        irsctl(endpoint, "merge", "I2", "I3")
    with irsd(endpoint, tmp_path):
        assert labels(endpoint) == {"I1": "centrifuge", "I2": "table"}
        assert irsctl(endpoint, "undo", "--count", "2").count("(undone)") == 2
        assert "nothing to undo" in irsctl(endpoint, "undo", code=1)
    with irsd(endpoint, tmp_path):
        assert labels(endpoint) == {"I1": "chair", "I2": "table", "I3": "box"}
        assert irsctl(endpoint, "edits").splitlines() == [
            "edit 1: I1 is called centrifuge (undone)",
            "edit 2: I3 merged into I2 (undone)",
        ]
        with open_session(ZenohSettings(endpoint=endpoint, connect=()), "peer") as session:
            for payload in (b"[]", b"{", b'{"kind": 7}', b'{"kind": "undo", "x": 1}', b"x" * 70_000, b"[" * 60_000):
                (reply,) = session.get(KEYS.command("edit"), payload=payload, timeout_s=20.0)
                assert not reply.ok
                assert "internal error" not in reply.error
