"""The store against the real thing: SQLite files, other processes, SIGKILL."""

from __future__ import annotations

import dataclasses
import os
import random
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from irsd.core.errors import StoreError
from irsd.graph.edits import Record
from irsd.graph.model import Edit, GraphDelta, InstanceArrays, InstanceNode, RoomNode
from irsd.graph.scene_graph import SceneGraph
from irsd.graph.store import FILE_NAME, STORE_VERSION, Store

FIXTURES = Path(__file__).resolve().parents[1] / "fixtures"
PER_STEP = 5  # instances that one step touches


def step(seq: int, map_id: str = "m") -> tuple[GraphDelta, dict[str, InstanceArrays]]:
    """Step number seq: five instances get ``observations`` = seq and points that all equal seq; one old instance goes."""
    numbers = [(seq * 3 + k) % 40 + 1 for k in range(PER_STEP)]
    instances = tuple(
        InstanceNode(
            *(f"I{n}", "box", (("box", 0.5),), "R1", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
            *((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.0, 1.0, 100, seq, 1.0, "present", 0, seq),
        )
        for n in numbers
    )
    room = RoomNode(
        "R1", "room", (), ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)), (0.0, 0.0, 1.0, 1.0), 1.0, 0.0, None, (), ()
    )
    removed = (f"I{(seq * 3 + 20) % 40 + 1}",)
    delta = GraphDelta(seq, seq * 10, map_id, "map", (room,), (), instances, removed, ())
    arrays = {
        node.id: InstanceArrays(np.full((200, 3), seq, np.float32), np.eye(384, dtype=np.float32)[seq % 384])
        for node in instances
    }
    return delta, arrays


def expected(seq: int) -> SceneGraph:
    graph = SceneGraph("m")
    for k in range(1, seq + 1):
        graph.apply(step(k)[0])
    return graph


def test_an_empty_store_holds_nothing(tmp_path: Path) -> None:
    store = Store(tmp_path / "state")
    assert store.load() is None
    assert store.steps() == ()
    store.close()


def test_everything_comes_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    points = rng.normal(size=(1000, 3)).astype(np.float32)
    vector = rng.normal(size=384).astype(np.float32)
    vector /= np.linalg.norm(vector)
    store = Store(tmp_path)
    delta, arrays = step(1)
    arrays["I4"] = InstanceArrays(points, vector)
    arrays["I5"] = InstanceArrays(np.zeros((0, 3), np.float32), None)
    store.append(delta, arrays, building_name="house")
    store.close()
    store = Store(tmp_path)
    stored = store.load()
    store.close()
    assert stored is not None
    want = SceneGraph("m", building_name="house").apply(delta)
    assert stored.snapshot == want
    np.testing.assert_array_equal(stored.arrays["I4"].points_map, points)
    got = stored.arrays["I4"].embedding
    assert got is not None
    assert float(got @ vector) > 0.999999
    assert stored.arrays["I5"].points_map.shape == (0, 3)
    assert stored.arrays["I5"].embedding is None


def test_the_log_is_bounded_and_contiguous(tmp_path: Path) -> None:
    store = Store(tmp_path, keep_steps=7)
    for k in range(1, 21):
        store.append(*step(k))
    assert [d.seq for d in store.steps()] == list(range(14, 21))
    assert [d.seq for d in store.steps(18)] == [19, 20]
    stored = store.load()
    store.close()
    assert stored is not None
    assert stored.snapshot == expected(20).snapshot()
    assert sorted(stored.arrays) == sorted(i.id for i in stored.snapshot.instances)


def test_a_step_that_does_not_follow_or_is_of_another_map_is_refused_and_changes_nothing(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.append(*step(1))
    with pytest.raises(StoreError, match="at step 1, step 3 does not follow"):
        store.append(*step(3))
    with pytest.raises(StoreError, match="holds map m"):
        store.append(*step(2, map_id="other"))
    store.append(*step(2))
    store.clear()
    assert store.load() is None
    store.append(*step(1, map_id="other"))
    store.close()


def test_another_process_cannot_open_it_meanwhile(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.append(*step(1))
    with pytest.raises(StoreError, match="in use by another process"):
        Store(tmp_path, timeout_s=0.05)
    store.close()
    Store(tmp_path).close()


def test_another_version_says_what_to_do(tmp_path: Path) -> None:
    Store(tmp_path).close()
    with sqlite3.connect(tmp_path / FILE_NAME) as db:
        db.execute("PRAGMA user_version = 99")
    db.close()
    with pytest.raises(StoreError, match=r"layout 99.*move the file away"):
        Store(tmp_path)


def test_a_store_of_layout_1_is_brought_to_this_one(tmp_path: Path) -> None:
    """The fixture was written by irsd before layout 2: all of it is there, edits can be added, and the file says so."""
    with sqlite3.connect(tmp_path / FILE_NAME) as db:
        db.executescript((FIXTURES / "store_v1.sql").read_text())
    db.close()
    store = Store(tmp_path)
    stored = store.load()
    assert stored is not None
    assert [node.label for node in stored.snapshot.instances] == ["television", "chair", "table"]
    assert stored.snapshot.instances[1].observations == 5
    assert [room.id for room in stored.snapshot.rooms] == ["R1", "R2"]
    assert stored.arrays["I3"].points_map.shape == (12, 3)
    assert (stored.edits, stored.beneath, stored.next_ids, stored.geometry, stored.taught) == ((), {}, {}, {}, {})
    assert [delta.seq for delta in store.steps()] == [1, 2]
    edit = Edit(1, "rename", "I3", "telly", (), None, (), 7)
    store.append(GraphDelta(3, 900, "0123456789ab", "map", (), (), (), (), ()), {}, Record((edit,)))
    store.close()
    store = Store(tmp_path)
    again = store.load()
    store.close()
    assert again is not None
    assert again.edits == (edit,)
    with sqlite3.connect(tmp_path / FILE_NAME) as db:
        assert db.execute("PRAGMA user_version").fetchone() == (STORE_VERSION,)
    db.close()


def test_a_database_of_someone_else_is_left_alone(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / FILE_NAME) as db:
        db.execute("CREATE TABLE theirs (x)")
    db.close()
    with pytest.raises(StoreError, match="another program"):
        Store(tmp_path)


@pytest.mark.parametrize("damage", ["text", "cut", "noise"])
def test_a_damaged_file_is_a_store_error(tmp_path: Path, damage: str) -> None:
    store = Store(tmp_path)
    for k in range(1, 30):
        store.append(*step(k))
    store.close()
    file = tmp_path / FILE_NAME
    content = bytearray(file.read_bytes())
    if damage == "text":
        content[:] = b"this is no database at all\n" * 300
    elif damage == "cut":
        del content[len(content) // 2 :]
    else:
        middle = slice(4096, len(content))
        content[middle] = random.Random(1).randbytes(len(content) - 4096)
    file.write_bytes(content)
    with pytest.raises(StoreError, match=r"damaged|disk"):
        Store(tmp_path).load()


def test_a_directory_that_cannot_be_made_is_a_store_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="check the directory"):
        Store(tmp_path / "file" / "state")


CHILD = """
import sys
sys.path.insert(0, {folder!r})
from pathlib import Path
from test_store import step
from irsd.graph.store import Store
store = Store(Path(sys.argv[1]), keep_steps=50)
stored = store.load()
seq = stored.snapshot.seq if stored else 0
while True:
    seq += 1
    store.append(*step(seq))
    print(seq, flush=True)
"""


def test_a_killed_writer_leaves_a_whole_prefix(tmp_path: Path) -> None:
    """SIGKILL after a drawn number of steps plus a drawn delay, several times on one file: nothing told as stored is lost."""
    rng = random.Random(7)
    seq = 0
    for _ in range(6):
        child = subprocess.Popen(
            [sys.executable, "-c", CHILD.format(folder=str(Path(__file__).parent)), str(tmp_path)],
            stdout=subprocess.PIPE,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
        assert child.stdout is not None
        told = seq
        for _ in range(rng.randint(1, 60)):
            told = int(child.stdout.readline())
        for _ in range(rng.randint(0, 2000)):  # let some instants pass, without a clock
            pass
        child.send_signal(signal.SIGKILL)
        rest = child.stdout.read().splitlines()
        child.stdout.close()
        child.wait()
        told = max([told, *(int(line) for line in rest if line)])
        store = Store(tmp_path, keep_steps=50)
        stored = store.load()
        steps = store.steps()
        store.close()
        assert stored is not None
        seq = stored.snapshot.seq
        assert told <= seq <= told + 1  # the step in flight may or may not have made it
        assert [d.seq for d in steps] == list(range(max(1, seq - 49), seq + 1))
        assert stored.snapshot == expected(seq).snapshot()
        for node in stored.snapshot.instances:
            points = stored.arrays[node.id].points_map
            assert points.shape == (200, 3)
            assert (points == node.observations).all()


def test_a_saved_map_is_whole_and_takes_the_place_of_another(tmp_path: Path) -> None:
    store = Store(tmp_path / "a")
    for k in range(1, 6):
        store.append(*step(k))
    store.keep_geometry({"plan/0": b"walls"})
    store.save_as(tmp_path / "snapshots" / "five.sqlite")
    for k in range(6, 9):
        store.append(*step(k))
    at_eight = store.load()
    told = GraphDelta(20, 50, "m", "map", (), (), (), (), ("restored",))
    store.replace_by(tmp_path / "snapshots" / "five.sqlite", told)
    restored = store.load()
    assert at_eight is not None
    assert restored is not None
    assert restored.snapshot == dataclasses.replace(expected(5).snapshot(), seq=20)
    assert restored.geometry == {"plan/0": b"walls"}
    assert store.steps() == (told,)
    with pytest.raises(StoreError):
        store.replace_by(tmp_path / "absent.sqlite", told)
    store.rewrite(at_eight)
    again = store.load()
    store.close()
    assert again is not None
    assert again.snapshot == at_eight.snapshot
    assert sorted(again.arrays) == sorted(at_eight.arrays)
    assert [path.name for path in (tmp_path / "snapshots").iterdir()] == ["five.sqlite"]


SWITCHER = """
import sys, itertools
sys.path.insert(0, {folder!r})
from pathlib import Path
from irsd.graph.model import GraphDelta
from irsd.graph.store import Store
folder = Path(sys.argv[1])
store = Store(folder)
seq = store.load().snapshot.seq
for name in itertools.cycle(("three", "nine")):
    seq += 1
    store.replace_by(folder / f"{{name}}.sqlite", GraphDelta(seq, 1, "m", "map", (), (), (), (), (name,)))
    print(seq, flush=True)
"""


def test_a_process_killed_while_maps_change_places_leaves_one_of_them_whole(tmp_path: Path) -> None:
    rng = random.Random(11)
    store = Store(tmp_path)
    for k in range(1, 10):
        store.append(*step(k))
        if k in (3, 9):
            store.save_as(tmp_path / f"{'three' if k == 3 else 'nine'}.sqlite")
    store.close()
    whole = {k: expected(k).snapshot().instances for k in (3, 9)}
    for _ in range(4):
        command = [sys.executable, "-c", SWITCHER.format(folder=str(Path(__file__).parent)), str(tmp_path)]
        child = subprocess.Popen(command, stdout=subprocess.PIPE, env={**os.environ, "OMP_NUM_THREADS": "1"})
        assert child.stdout is not None
        for _ in range(rng.randint(1, 12)):
            told = int(child.stdout.readline())
        child.send_signal(signal.SIGKILL)
        rest = child.stdout.read().splitlines()
        child.stdout.close()
        child.wait()
        told = max([told, *(int(line) for line in rest if line)])
        store = Store(tmp_path)
        stored = store.load()
        (last,) = store.steps()
        store.close()
        assert stored is not None
        assert told <= stored.snapshot.seq <= told + 1
        assert stored.snapshot.instances == whole[3 if last.lineage == ("three",) else 9]
        assert sorted(stored.arrays) == sorted(node.id for node in stored.snapshot.instances)
