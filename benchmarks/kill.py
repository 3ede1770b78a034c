"""kill -9 of irsd at random instants while a recording is played to it, and a start on what it left: is anything lost?

    python benchmarks/kill.py [--kills 200] [--data ../shared/data/small_house] [--seed 1]

Everything is real: the daemon as its own process on its own state directory, zenoh, SQLite, SIGKILL. Each life plays from a random
instant of the recording and ends after a random time, also while it starts or answers an edit. After each death:
the store opens (SQLite's own check), what it holds is exactly the sum of the deltas up to its last revision, that revision is not
before the last one that was published, and every edit that was answered is there. The next life must begin with the same ids.

One process has everything imported and forks a daemon for each life, so that a life costs its work and not Python's start.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from irsd import daemon
from irsd.core.errors import StoreError
from irsd.core.runtime import Ring
from irsd.graph.codec import delta_from_json, snapshot_from_json
from irsd.graph.model import GraphSnapshot
from irsd.graph.scene_graph import SceneGraph
from irsd.graph.store import Store
from irsd.io.keys import RobotKeys
from irsd.io.session import CDR, JSON, Sample, Session, ZenohSettings, open_session
from irsd.sensors.replay import RawMessage, read_messages
from irsd.warm import warm_up

HERE = Path(__file__).resolve().parent
KEYS = RobotKeys("killed")
LATCHED = ("/tf_static", "/camera/camera_info")
LIFE_S = (0.05, 6.0)  # from the fork on
PATIENCE_S = 120.0


# --------------------------------------------------------------------------------------------------- the forking process
def nursery() -> None:
    """Forks one daemon per line of arguments on stdin; answers with its process id. Ends with stdin."""
    warm_up()
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    print("ready", flush=True)
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            os.close(0)
            os._exit(daemon.main(json.loads(line)))
        print(child, flush=True)


class Lives:
    """Starts and kills daemons."""

    def __init__(self, endpoint: str, folder: Path) -> None:
        config = folder / "irsd.yaml"
        config.write_text("perception: {nano: false}\n")  # the detections come with the recording
        self._words = [
            "--config",
            str(config),
            "--robot",
            KEYS.robot,
            "--endpoint",
            endpoint,
            "--state",
            str(folder),
            "--log-level",
            "error",
        ]
        env = {**os.environ, "IRSD_CONNECT": "", "OMP_NUM_THREADS": "1"}
        command = [sys.executable, str(Path(__file__).resolve()), "--nursery"]
        self._nursery = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=env)
        self._ask()

    def start(self) -> int:
        assert self._nursery.stdin is not None
        self._nursery.stdin.write(json.dumps(self._words) + "\n")
        self._nursery.stdin.flush()
        return int(self._ask())

    @staticmethod
    def kill(process: int) -> bool:
        """False when it had died by itself."""
        try:
            os.kill(process, signal.SIGKILL)
        except ProcessLookupError:
            return False
        while Path(f"/proc/{process}").exists():
            time.sleep(0.005)
        return True

    def close(self) -> None:
        assert self._nursery.stdin is not None
        self._nursery.stdin.close()
        self._nursery.wait()

    def _ask(self) -> str:
        assert self._nursery.stdout is not None
        return self._nursery.stdout.readline()


# ---------------------------------------------------------------------------------------------------------- the judge
@dataclass
class Verdict:
    """What was found, over all kills."""

    kills: int = 0
    corrupt: int = 0
    lost: int = 0
    unequal: int = 0
    edits: int = 0
    edits_lost: int = 0
    ids_changed: int = 0
    died_alone: int = 0
    unready: int = 0
    revisions: int = 0
    gone_rooms: int = 0
    start_s: list[float] = field(default_factory=list)

    @property
    def good(self) -> bool:
        return not (self.corrupt or self.lost or self.unequal or self.edits_lost or self.ids_changed or self.died_alone)


class Judge:
    """Follows the published graph over all lives, and compares it with what is on disk after each death."""

    def __init__(self, session: Session, folder: Path, verdict: Verdict) -> None:
        self._session, self._folder, self.verdict = session, folder / KEYS.robot, verdict
        self._deltas: Ring[Sample] = Ring(65_536)
        self._handle = session.subscribe(KEYS.delta, self._deltas)
        self.graph: SceneGraph | None = None
        self.answered: dict[int, str] = {}

    def after_death(self) -> None:
        """Takes stock: disk against what was seen."""
        seen = [delta_from_json(sample.payload) for sample in self._deltas.drain()]
        try:
            store = Store(self._folder, timeout_s=10.0)
            stored, steps = store.load(), store.steps(0 if self.graph is None else self.graph.snapshot().seq)
            store.close()
        except StoreError as error:
            self.verdict.corrupt += 1
            print(f"  corrupt: {error}", file=sys.stderr)
            return
        if stored is None:
            self.verdict.lost += bool(seen or self.graph is not None)
            return
        graph = self.graph or SceneGraph(stored.snapshot.map_id, stored.snapshot.frame)
        if seen and seen[-1].seq > stored.snapshot.seq:
            self.verdict.lost += 1
            print(f"  revision {seen[-1].seq} was published, {stored.snapshot.seq} is on disk", file=sys.stderr)
        published = {delta.seq: delta for delta in seen}
        for step in steps:
            if published.get(step.seq, step) != step:
                self.verdict.unequal += 1
            graph.apply(step)
        self.verdict.revisions = stored.snapshot.seq
        self.verdict.unequal += graph.snapshot() != stored.snapshot
        known = {edit.number: edit.name for edit in stored.edits}
        self.verdict.edits_lost += sum(known.get(n) != name for n, name in self.answered.items())
        self.verdict.gone_rooms += len(
            {i for step in steps for i in step.removed if i[0] == "R" and not graph.has_node(i)}
        )
        self.graph = graph

    def after_birth(self, snapshot: GraphSnapshot) -> None:
        """The first word of a new life: with what came since it must be what was on disk."""
        if self.graph is None:
            return
        before = self.graph.snapshot()
        same = snapshot.seq > before.seq or ids(snapshot) == ids(before)
        if snapshot.map_id != before.map_id or snapshot.seq < before.seq or not same:
            self.verdict.ids_changed += 1

    def edit(self, rng: random.Random) -> None:
        """An edit in the middle of it all; only what is answered must survive."""
        if self.graph is None or not self.graph.snapshot().instances:
            return
        name = f"thing {rng.randint(0, 10**6)}"
        question = {"kind": "rename", "target": rng.choice(self.graph.snapshot().instances).id, "name": name}
        for reply in self._session.get(KEYS.command("edit"), payload=json.dumps(question).encode(), timeout_s=2.0):
            if reply.ok:
                self.answered[json.loads(reply.payload)["edit"]["number"]] = name
                self.verdict.edits += 1


def ids(snapshot: GraphSnapshot) -> list[str]:
    """All ids of a graph."""
    return [node.id for nodes in (snapshot.rooms, snapshot.doors, snapshot.instances) for node in nodes]


# ----------------------------------------------------------------------------------------------------------- a life
def live(session: Session, judge: Judge, lives: Lives, messages: list[RawMessage], rng: random.Random) -> None:
    """One daemon from its start to its death."""
    began_s = time.monotonic()
    process = lives.start()
    end_s = began_s + rng.uniform(*LIFE_S) if rng.random() < 0.1 else 0.0  # some do not see the end of their start
    while not end_s or time.monotonic() < end_s:
        if session.find_alive(KEYS.alive, timeout_s=0.2):
            replies = session.get(KEYS.snapshot, timeout_s=2.0)
            if replies and replies[0].ok:
                judge.after_birth(snapshot_from_json(replies[0].payload))
            judge.verdict.start_s.append(time.monotonic() - began_s)
            end_s = end_s or time.monotonic() + rng.uniform(*LIFE_S)
            play(session, judge, messages, rng, end_s)
            break
        if not Path(f"/proc/{process}").exists() or time.monotonic() > began_s + PATIENCE_S:
            break
    else:
        judge.verdict.unready += 1
    judge.verdict.died_alone += not lives.kill(process)
    judge.verdict.kills += 1


def play(session: Session, judge: Judge, messages: list[RawMessage], rng: random.Random, end_s: float) -> None:
    """The recording from a random instant on, in its own time, until the end."""
    for message in messages:
        if message.topic in LATCHED:
            put(session, message)
    first = rng.randrange(len(messages) * 3 // 4)
    began_s, first_ns = time.monotonic(), messages[first].log_time_ns
    edit_s = rng.uniform(began_s, end_s) if rng.random() < 0.5 else None
    for message in messages[first:]:
        wait_s = began_s + (message.log_time_ns - first_ns) * 1e-9 - time.monotonic()
        if wait_s > 0:
            time.sleep(wait_s)
        now_s = time.monotonic()
        if now_s >= end_s:
            return
        if edit_s is not None and now_s >= edit_s:
            edit_s = None
            judge.edit(rng)
        put(session, message)


def put(session: Session, message: RawMessage) -> None:
    encoding = JSON if message.type_name in ("", "json") else CDR
    session.put(message.topic.strip("/"), message.data, encoding=encoding, block=False)


def report(verdict: Verdict) -> None:
    starts = sorted(verdict.start_s) or [0.0]
    print(f"kills                        {verdict.kills}, of which {verdict.unready} before irsd was ready")
    print(f"revisions written            {verdict.revisions}")
    print(f"corrupt stores               {verdict.corrupt}   (bar 0)")
    print(f"published revisions lost     {verdict.lost}   (bar 0)")
    print(f"stores unequal to deltas     {verdict.unequal}   (bar 0)")
    print(f"ids changed by a restart     {verdict.ids_changed}   (bar 0)")
    print(f"answered edits lost          {verdict.edits_lost} of {verdict.edits}   (bar 0)")
    print(f"deaths that were not ours    {verdict.died_alone}   (bar 0)")
    print(f"rooms that ended for good    {verdict.gone_rooms}")
    print(f"fork to ready                median {starts[len(starts) // 2]:.2f} s, worst {starts[-1]:.2f} s")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=HERE.parents[1] / "shared" / "data" / "small_house")
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--minutes", type=float, default=60.0, help="stop earlier after so long")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--nursery", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.nursery:
        nursery()
        return 0
    files = [arguments.data / "small_house_short.mcap", arguments.data / "small_house.detections.mcap"]
    if not files[0].is_file():
        print(f"the recording is absent: {files[0]}", file=sys.stderr)
        return 2
    messages = list(read_messages(files[0]))
    last_ns = messages[-1].log_time_ns
    messages = [m for m in read_messages([f for f in files if f.is_file()]) if m.log_time_ns <= last_ns]
    rng, verdict = random.Random(arguments.seed), Verdict()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with tempfile.TemporaryDirectory() as scratch:
        lives = Lives(endpoint, Path(scratch))
        with open_session(ZenohSettings(endpoint=endpoint, connect=()), "peer") as session:
            judge = Judge(session, Path(scratch), verdict)
            end_s = time.monotonic() + 60 * arguments.minutes
            for number in range(arguments.kills):
                if time.monotonic() > end_s:
                    break
                live(session, judge, lives, messages, rng)
                judge.after_death()
                if number % 10 == 9:
                    print(f"  {number + 1} kills, revision {verdict.revisions}, {verdict}", file=sys.stderr)
        lives.close()
    report(verdict)
    return 0 if verdict.good else 1


if __name__ == "__main__":
    sys.exit(main())
