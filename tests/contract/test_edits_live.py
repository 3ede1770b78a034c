"""irsctl's edits and whole maps on a running irsd: answered when on disk, so that a kill -9 right after the answer loses nothing."""

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
from daemon_here import running

from irsd.config import IrsdConfig, StoreSettings
from irsd.core.runtime import Ring, monotonic_s, sleep_s
from irsd.core.types import InstanceState, InstanceUpdate
from irsd.graph.builder import GraphBuilder, GraphSettings
from irsd.graph.codec import delta_from_json, snapshot_from_json
from irsd.graph.model import GraphSnapshot
from irsd.graph.store import Store
from irsd.io.keys import RobotKeys
from irsd.io.session import Sample, Session, ZenohSettings, open_session
from irsd.perception.encoder import LabelEncoder
from irsd.perception.settings import PerceptionSettings

WAIT_S = 120.0
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


def ask(session: Session, command: str, **question: Any) -> dict[str, Any]:
    (reply,) = session.get(KEYS.command(command), payload=json.dumps(question).encode(), timeout_s=WAIT_S)
    return dict(json.loads(reply.payload)) if reply.ok else {"error": reply.error}


def graph_of(session: Session) -> GraphSnapshot:
    (reply,) = session.get(KEYS.snapshot, timeout_s=WAIT_S)
    return snapshot_from_json(reply.payload)


def things(session: Session) -> dict[str, str]:
    return {node.id: node.label for node in graph_of(session).instances}


def test_whole_maps_come_and_go(tmp_path: Path) -> None:
    a_map(tmp_path)
    config = IrsdConfig(
        robot=KEYS.robot,
        store=StoreSettings(directory=str(tmp_path)),
        perception=PerceptionSettings(nano=False),
    )
    labels = LabelEncoder.load()
    first = {"I1": "chair", "I2": "table", "I3": "box"}
    deltas: Ring[Sample] = Ring(64)
    with running(config, labels) as (_, session):
        session.subscribe_history(KEYS.delta, deltas)
        assert [s["name"] for s in ask(session, "snapshot", do="save", name="as_found")["snapshots"]] == ["as_found"]
        ask(session, "edit", kind="teach", target="I1", name="centrifuge")
        ask(session, "edit", kind="delete", target="I3")
        (reply,) = session.get(KEYS.command("export"), timeout_s=WAIT_S)
        exported = reply.payload
        before = graph_of(session).seq
        restored = ask(session, "snapshot", do="restore", name="as_found")
        assert restored["seq"] > before + 1  # a gap: followers take the snapshot again
        assert things(session) == first
        assert ask(session, "edits") == {"edits": []}
        for name in ("../map", "a/b", "", ".hidden", "x" * 64, "a\u0000"):
            for what in ("save", "restore", "delete"):
                assert "snapshot's name is letters" in ask(session, "snapshot", do=what, name=name)["error"]
        assert "there is no snapshot nowhere" in ask(session, "snapshot", do="restore", name="nowhere")["error"]
        for bad in (b"", b"nonsense", exported[:-20], exported[:30] + b"\0" * 500):
            (reply,) = session.get(KEYS.command("import"), payload=bad, timeout_s=WAIT_S)
            assert not reply.ok
            assert "internal error" not in reply.error
        assert things(session) == first
        ask(session, "edit", kind="rename", target="I2", name="bench")  # goes on from the restored revision
    with running(config, labels) as (_, session):
        assert things(session) == {**first, "I2": "bench"}
        assert session.get(KEYS.command("import"), payload=exported, timeout_s=WAIT_S)[0].ok
        assert things(session) == {"I1": "centrifuge", "I2": "table"}
        assert sorted(s["name"] for s in ask(session, "snapshot", do="list")["snapshots"]) == ["as_found", "previous"]
    with running(config, labels) as (_, session):
        assert things(session) == {"I1": "centrifuge", "I2": "table"}
        map_id = graph_of(session).map_id
        ask(session, "map", do="new")
        assert things(session) == {}
        assert graph_of(session).map_id != map_id
        ask(session, "snapshot", do="restore", name="previous")
        assert graph_of(session).map_id == map_id
        assert things(session) == {"I1": "centrifuge", "I2": "table"}
    seqs = [delta_from_json(sample.payload).seq for sample in deltas.drain()]
    assert seqs == sorted(seqs)
