"""A bundle of a running irsd gives the graph that it had, byte for byte, from an empty map and from a stored one."""

from __future__ import annotations

import json
import os
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from daemon_here import running
from test_daemon import KEYS, WAIT_S, ask, drive, until

from irsd.bundles import without_secrets
from irsd.config import IrsdConfig, StoreSettings
from irsd.core.errors import DecodeError
from irsd.core.runtime import Stopper, Worker
from irsd.ingest import IngestSettings, SensorDecoder
from irsd.io import cdr
from irsd.io.session import CDR, Session
from irsd.perception.encoder import LabelEncoder
from irsd.perception.settings import PerceptionSettings
from irsd.privacy import PrivacySettings
from irsd.record import Recorder, RecordSettings
from irsd.reproduce import Reproduction, opened
from irsd.sensors.replay import read_messages

PICTURES = "/camera/image/compressed"


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


def show_three(robot: Session, name: str, picture: bytes) -> None:
    """Three pictures in a room of this name."""
    assert drive(robot, lambda: bool(ask(robot, KEYS.building)["rooms"]))
    (room, *_) = ask(robot, KEYS.building)["rooms"]
    question = json.dumps({"kind": "teach", "target": room, "name": name}).encode()
    assert robot.get(KEYS.command("edit"), payload=question, timeout_s=WAIT_S)[0].ok
    frames = ask(robot, KEYS.status)["counts"].get("frames", 0)
    assert drive(robot, lambda: ask(robot, KEYS.status)["counts"].get("frames", 0) > frames + 2)
    before = ask(robot, KEYS.status)["sensors"][PICTURES]["decoded"]
    for _ in range(3):
        robot.put(PICTURES.lstrip("/"), picture, encoding=CDR)
    assert until(lambda: ask(robot, KEYS.status)["sensors"][PICTURES]["decoded"] == before + 3)


@pytest.mark.parametrize(("store_pictures", "rooms", "kept"), [(False, (), 0), (True, (), 6), (True, ("Bath",), 3)])
def test_pictures_reach_the_disk_only_where_they_may(
    tmp_path: Path, store_pictures: bool, rooms: tuple[str, ...], kept: int
) -> None:
    config = IrsdConfig(
        robot=KEYS.robot,
        store=StoreSettings(directory=str(tmp_path / "state")),
        record=RecordSettings(200),
        privacy=PrivacySettings(store_pictures=store_pictures, no_pictures_in=rooms),
        perception=PerceptionSettings(nano=False),
        ingest=IngestSettings(images=True, image_queue=10),
    )
    header = cdr.make_header(1, "camera")
    data = cv2.imencode(".png", np.zeros((8, 8, 3), np.uint8))[1].ravel()
    picture = cdr.write(cdr.make(cdr.COMPRESSED_IMAGE, header=header, format="png", data=data))
    with running(config, LabelEncoder.load()) as (_, robot):
        for name in ("hall", "bath"):
            show_three(robot, name, picture)
        path = bundle_of(robot, tmp_path / "bundle.zip")
    with opened(path) as bundle:
        assert sum(message.topic == PICTURES for message in read_messages(bundle.recording)) == kept


def test_what_is_older_than_its_time_is_deleted(tmp_path: Path) -> None:
    recorder, stopper = Recorder(tmp_path / "recording", RecordSettings(200), retention_days=1.0), Stopper()
    writer = Worker("test-record", lambda: recorder.run(stopper, lambda _: None)).start()
    recorder.take(SensorDecoder(IngestSettings()).topics[0], b"old")
    kept = recorder.link_into(_made(tmp_path / "one"), WAIT_S)
    assert (len(kept.files), kept.complete) == (1, True)
    stopper.request("test")
    assert writer.join(WAIT_S)
    for file in (tmp_path / "recording").glob("*.mcap"):
        os.utime(file, (1.0, 1.0))
    recorder._prune_s = 0.0  # a minute later
    recorder._prune()
    assert not list((tmp_path / "recording").glob("*.mcap"))
    assert "retention_days" in recorder._linked(_made(tmp_path / "two")).why_not


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


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
