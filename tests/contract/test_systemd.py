"""The units: without a word from systemd-analyze, tight enough, and real programs that work under their sandbox."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from navigation_standin import free_endpoint
from test_daemon import KEYS, ask, drive, until

from irsd.core.runtime import Event, Ring, Worker, monotonic_s
from irsd.io.session import Sample, ZenohSettings, open_session

ROOT = Path(__file__).resolve().parents[2]
UNITS = ("irsd.service", "nav-bridge.service")
PATIENCE_S = 240.0

analyze = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
sandbox = pytest.mark.skipif(
    os.getuid() != 0
    or os.uname().machine != "x86_64"
    or not Path("/usr/include/x86_64-linux-gnu/asm/unistd_64.h").is_file(),
    reason="the sandbox is made by root on x86-64, with the numbers of system calls from linux-libc-dev",
)


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """A root with the units and what they start, which is all that verify looks for."""
    folder = tmp_path / "etc/systemd/system"
    folder.mkdir(parents=True)
    for unit in UNITS:
        shutil.copy(ROOT / "systemd" / unit, folder)
    for name in ("sysinit.target", "basic.target", "shutdown.target", "network.target", "multi-user.target"):
        (folder / name).write_text(f"[Unit]\nDescription={name}\nDefaultDependencies=no\n")
    for name in ("irsd", "nav-bridge"):
        program = tmp_path / "opt/irsd/bin" / name
        program.parent.mkdir(parents=True, exist_ok=True)
        program.write_text("#!/bin/sh\n")
        program.chmod(0o755)
    return tmp_path


def verify(root: Path) -> str:
    """Every word that systemd-analyze has to say; some of its complaints leave the exit code at 0."""
    said = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", f"--root={root}", *UNITS], capture_output=True, text=True, check=False
    )
    return (said.stdout + said.stderr).strip()


@analyze
def test_verify_says_nothing(installed: Path) -> None:
    assert verify(installed) == ""


@analyze
@pytest.mark.parametrize("line", ["MemoryHihg=1G", "Type=notfy", "ExecStart=/opt/irsd/bin/absent"])
def test_verify_would_say_something(installed: Path, line: str) -> None:
    unit = installed / "etc/systemd/system/irsd.service"
    key = line.split("=", maxsplit=1)[0]
    text = re.sub(rf"^{key}=.*\n", "", unit.read_text(), flags=re.M)
    unit.write_text(text.replace("[Service]\n", f"[Service]\n{line}\n"))
    assert verify(installed) != ""


@analyze
@pytest.mark.parametrize("unit", UNITS)
def test_the_units_are_tight(unit: str) -> None:
    """Exposure of at most 2.0 of 10."""
    command = [
        "systemd-analyze",
        "security",
        "--offline=true",
        "--no-pager",
        "--threshold=20",
        str(ROOT / "systemd" / unit),
    ]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stdout[-400:]


def warm_cache(state: Path) -> None:
    """The compiled kernels of this tree, where the unit's programs look for them (as the installation leaves them)."""
    for compiled in (ROOT / "irsd").rglob("__pycache__/*.nb?"):
        source = compiled.parent.parent
        name = f"{source.name}_{hashlib.sha1(str(source).encode()).hexdigest()}"
        folder = state / "CacheDirectory/irsd" / name
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copy2(compiled, folder)


class Service:
    """A program under its unit, strictly: one forbidden system call ends it. words: what it told systemd."""

    def __init__(self, unit: str, folder: Path, endpoint: str, *command: str) -> None:
        name = f"irsd-test-{os.getpid()}-{unit}"
        self.server = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.server.bind("\0" + name)
        self.server.settimeout(0.5)
        self.words: Ring[str] = Ring(4096)
        self._closed = Event()
        self._reader = Worker("notified", self._read).start()
        paths = [str(ROOT), *(path for path in sys.path if path.endswith("site-packages"))]
        environment = {
            **{name: value for name, value in os.environ.items() if name in ("PATH", "LANG")},
            "PYTHONPATH": ":".join(paths),
            "NOTIFY_SOCKET": "@" + name,
            "WATCHDOG_USEC": "2000000",
            "IRSD_ENDPOINT": endpoint,
            "IRSD_CONNECT": "",
            "JOURNAL_STREAM": "8:1",
        }
        kind = folder.parent / unit  # on a machine that does other things besides, Nice= would be a test of patience
        kind.write_text(re.sub(r"^Nice=.*\n", "", (ROOT / "systemd" / unit).read_text(), flags=re.M))
        wrapper = [sys.executable, str(ROOT / "systemd/as_unit.py"), str(kind)]
        whole = [*wrapper, "--state", str(folder), "--strict", "--", sys.executable, "-m", *command]
        self.process = subprocess.Popen(whole, env=environment, stderr=subprocess.PIPE, text=True)

    def hear(self, word: str) -> None:
        end_s = monotonic_s() + PATIENCE_S
        while monotonic_s() < end_s:
            if self.words.get(0.5) == word:
                return
        raise AssertionError(f"{word} was not said")

    def _read(self) -> None:
        while not self._closed.is_set():
            with suppress(TimeoutError):
                self.words.put(self.server.recv(4096).decode())

    def stop(self) -> str:
        """Asks it to end; its log."""
        self.process.terminate()
        _, log = self.process.communicate(timeout=PATIENCE_S)
        assert self.process.returncode == 0, log
        return log

    def kill(self) -> None:
        self.process.kill()
        self.process.communicate()
        self._closed.set()
        self._reader.join(5.0)
        self.server.close()


@analyze
@sandbox
@pytest.mark.timeout(600)
def test_the_programs_work_in_the_sandbox_of_their_units(tmp_path: Path) -> None:
    """onnxruntime, numba, SQLite and zenoh under the filter; state, cache and nothing else to write; a room is mapped and kept."""
    endpoint = free_endpoint()
    tmp_path.chmod(0o755)
    warm_cache(tmp_path / "state")
    services: list[Service] = []
    start: Callable[..., None] = lambda *given: services.append(Service(*given))  # noqa: E731
    try:
        start("irsd.service", tmp_path / "state", endpoint, "irsd", "--robot", KEYS.robot)
        services[0].hear("READY=1")
        start("nav-bridge.service", tmp_path / "nav", endpoint, "nav_bridge", "--robot", KEYS.robot)
        services[1].hear("READY=1")
        with open_session(ZenohSettings(endpoint=endpoint, connect=()), "peer") as robot:
            rooms: Ring[Sample] = Ring(64)
            robot.subscribe("irs/*/graph/rooms/**", rooms)
            mapped = any(drive(robot, lambda: rooms.received > 0) for _ in range(3))
            assert mapped, ask(robot, KEYS.status)
            (reply,) = robot.get(KEYS.nav("why"), timeout_s=60.0, payload=b'{"query": "the room", "from": [0, 0]}')
            assert reply.ok, reply.error
            assert until(lambda: robot.find_alive(KEYS.nav("alive")) != [])
        for service in services:
            service.hear("WATCHDOG=1")
        logs = [service.stop() for service in reversed(services)]
    finally:
        for service in services:
            service.kill()
    for log in logs:
        lines = [line for line in log.splitlines() if not line.startswith("as_unit: ")]
        assert lines
        assert all(re.match(r"<[2-7]>", line) for line in lines), log
    assert (tmp_path / "state/StateDirectory/irsd" / KEYS.robot / "map.sqlite").is_file()


def test_onnxruntime_tells_nobody(tmp_path: Path) -> None:
    """Its wheels write an id of the machine and what was run below $HOME, and send it to their maker, unless told not to."""
    code = "from irsd.perception.encoder import LabelEncoder; LabelEncoder.load().encode(['chair'])"
    environment = {**os.environ, "HOME": str(tmp_path), "XDG_CACHE_HOME": "", "PYTHONPATH": str(ROOT)}
    environment.pop("ORT_DISABLE_TELEMETRY", None)
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
    assert list(tmp_path.rglob("*")) == []
