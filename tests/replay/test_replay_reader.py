"""Recordings: what is written is read, files are merged by time, and cut or foreign files say so."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from irsd.core.errors import DecodeError, StoreError
from irsd.core.types import StaticTransform
from irsd.io import cdr as ros
from irsd.sensors.decode import decode
from irsd.sensors.encode import encode_tf
from irsd.sensors.replay import RawMessage, RecordingWriter, read_messages, topics_of

SCHEMA = {"type": "object", "required": ["seq"]}


def written(path: Path, times_ns: list[int], topic: str = "/tf_static") -> Path:
    cdr = encode_tf([])
    with RecordingWriter(path) as writer:
        for k, at in enumerate(times_ns):
            writer.write(topic, ros.TF_MESSAGE, cdr, at)
            writer.write_json("/graph/delta", "irs/graph/delta", SCHEMA, json.dumps({"seq": k}).encode(), at)
    return path


def test_an_empty_recording_is_a_recording(tmp_path: Path) -> None:
    path = written(tmp_path / "empty.mcap", [])
    assert list(read_messages(path)) == []
    assert topics_of(path) == {}


def test_what_is_written_is_read_the_same_bytes_every_time(tmp_path: Path) -> None:
    times = [k * 10**8 for k in range(50)]
    path = written(tmp_path / "a.mcap", times)
    assert path.read_bytes() == written(tmp_path / "b.mcap", times).read_bytes()
    messages = list(read_messages([path], ["/graph/delta"]))
    assert [json.loads(m.data)["seq"] for m in messages] == list(range(50))
    assert {(m.type_name, m.encoding) for m in messages} == {("irs/graph/delta", "json")}
    assert next(read_messages(path)) == RawMessage("/tf_static", ros.TF_MESSAGE, encode_tf([]), 0, "cdr")
    assert topics_of(path) == {"/graph/delta": "irs/graph/delta", "/tf_static": ros.TF_MESSAGE}


def test_files_are_merged_by_log_time_and_ties_go_to_the_earlier_file(tmp_path: Path) -> None:
    a = written(tmp_path / "a.mcap", [5, 1, 3], "/a")
    b = written(tmp_path / "b.mcap", [3, 2, 9], "/b")
    merged = [(m.log_time_ns, m.topic) for m in read_messages([a, b], ["/a", "/b"])]
    assert merged == [(1, "/a"), (2, "/b"), (3, "/a"), (3, "/b"), (5, "/a"), (9, "/b")]


def test_a_file_without_its_summary_is_read_in_order(tmp_path: Path) -> None:
    path = tmp_path / "killed.mcap"
    writer = RecordingWriter(path)
    big = encode_tf([StaticTransform("a", f"b{k}", np.eye(4)) for k in range(200)])
    for at in range(400):
        writer.write("/tf_static", ros.TF_MESSAGE, big, at ^ 1)
    writer._stream.flush()  # the process dies here
    with pytest.raises(DecodeError, match=r"killed.mcap: cut off or damaged after \d+ messages"):
        list(read_messages(path))
    times = [m.log_time_ns for m in read_messages(path, allow_cut=True)]
    assert times == sorted(times)
    assert len(times) > 200
    assert topics_of(path) == {"/tf_static": ros.TF_MESSAGE}
    writer.close()
    assert len(list(read_messages(path))) == 400


def test_files_that_are_none(tmp_path: Path) -> None:
    foreign = tmp_path / "foreign.mcap"
    foreign.write_bytes(b"SQLite format 3\0")
    for path, says in ((foreign, "not an MCAP"), (tmp_path / "absent.mcap", "No such file"), (tmp_path, "directory")):
        with pytest.raises(DecodeError, match=says):
            list(read_messages(path))
        with pytest.raises(DecodeError, match=says):
            topics_of(path)
    with pytest.raises(StoreError, match="can't write"):
        RecordingWriter(tmp_path / "no" / "such" / "folder.mcap")


@pytest.mark.parametrize("part", [0.02, 0.3, 0.9, 0.999])
def test_a_recording_that_is_cut_gives_what_is_left(shared_data: Path, tmp_path: Path, part: float) -> None:
    whole = (shared_data / "small_house" / "small_house_short.mcap").read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: int(len(whole) * part)])
    seen: list[RawMessage] = []
    with pytest.raises(DecodeError, match="cut off or damaged"):
        seen.extend(read_messages(path))
    rest = list(read_messages(path, allow_cut=True))
    assert [m.log_time_ns for m in rest] == sorted(m.log_time_ns for m in rest)
    assert len(rest) >= int(part * 1331) - 400


def test_a_recording_with_a_wrong_byte_is_refused_there(shared_data: Path, tmp_path: Path) -> None:
    altered = bytearray((shared_data / "small_house" / "small_house_short.mcap").read_bytes())
    altered[len(altered) // 2] ^= 1
    path = tmp_path / "altered.mcap"
    path.write_bytes(altered)
    with pytest.raises(DecodeError, match="damaged after"):
        list(read_messages(path))


def test_the_shared_recording_survives_being_copied(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "small_house" / "small_house_short.mcap"
    messages = list(read_messages(source))
    with RecordingWriter(tmp_path / "copy.mcap") as writer:
        for message in messages:
            writer.write(message.topic, message.type_name, message.data, message.log_time_ns)
    assert list(read_messages(tmp_path / "copy.mcap")) == messages
    assert len(decode("tf_static", messages[0].data)) == 3
