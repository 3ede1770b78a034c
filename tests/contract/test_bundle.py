"""A bundle of a running irsd gives the graph that it had, byte for byte, from an empty map and from a stored one."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest
from daemon_here import running
from test_daemon import KEYS, WAIT_S, ask, drive

from irsd.bundles import without_secrets
from irsd.config import IrsdConfig, StoreSettings
from irsd.core.errors import DecodeError
from irsd.io.session import Session
from irsd.perception.encoder import LabelEncoder
from irsd.perception.settings import PerceptionSettings
from irsd.record import RecordSettings
from irsd.reproduce import Reproduction, opened


def bundle_of(session: Session, path: Path) -> Path:
    (reply,) = session.get(KEYS.command("bundle"), timeout_s=WAIT_S)
    assert reply.ok, reply.error
    path.write_bytes(reply.payload)
    return path


def test_a_bundle_gives_the_same_graph(tmp_path: Path) -> None:
    store = StoreSettings(directory=str(tmp_path / "state"))
    config = IrsdConfig(
        robot=KEYS.robot, store=store, record=RecordSettings(200), perception=PerceptionSettings(nano=False)
    )
    labels, made = LabelEncoder.load(), []
    for life in ("first", "second"):
        with running(config, labels) as (_, robot):
            assert drive(robot, lambda: ask(robot, KEYS.status)["counts"].get("frames", 0) > 10)
            (room, *_) = ask(robot, KEYS.building)["rooms"]
            question = json.dumps({"kind": "teach", "target": room, "name": f"{life} name"}).encode()
            assert robot.get(KEYS.command("edit"), payload=question, timeout_s=WAIT_S)[0].ok
            assert drive(robot, lambda: ask(robot, KEYS.status)["counts"]["frames"] > 20)
            made.append(bundle_of(robot, tmp_path / f"{life}.zip"))
    for path in made:
        with opened(path) as bundle:
            assert bundle.meta["complete"], bundle.meta["why_not"]
            again = Reproduction(bundle, labels)
            assert again.run(bundle) == bundle.meta["graph_sha256"]
            assert again.frames > 5
            assert again.pipeline.snapshot().seq == bundle.meta["seq"] > 0
            assert again.pipeline.edits()[-1].name == f"{path.stem} name"
    with zipfile.ZipFile(made[1]) as archive:
        names = set(archive.namelist())
        assert {"meta.json", "config.yaml", "status.json", "start.sqlite"} <= names
        assert json.loads(archive.read("status.json"))["robot"] == KEYS.robot


def test_what_is_no_bundle_is_said(tmp_path: Path) -> None:
    path = tmp_path / "x.zip"
    path.write_bytes(b"PK nonsense")
    with pytest.raises(DecodeError, match="not a bundle"), opened(path):
        pass
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("meta.json", '{"schema": "irs/bundle/1"}')
        archive.writestr("config.yaml", "{}")
        archive.writestr("../../outside.mcap", b"")
    with opened(path) as bundle:
        assert [file.name for file in bundle.recording] == ["outside.mcap"]
        assert not list(tmp_path.parent.glob("outside.mcap"))


def test_secrets_stay_at_home() -> None:
    text = (
        "zenoh:\n  endpoint: tls/host:1\n  user_password: hunter2\n  connect: [https://me:pw@router:7447]\nrobot: r\n"
    )
    clean = without_secrets(text)
    assert "hunter2" not in clean
    assert "me:pw" not in clean
    assert "robot: r\n" in clean
    assert "user_password: ''" in clean
